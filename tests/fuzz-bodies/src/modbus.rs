//! Any bytes from the gripper's bus at any time: the line's client never panics, never asks faster than 200 Hz, never
//! stands still, and never orders what could open the fingers while something is to be held.

use gripline_firmware::GripForce;
use gripline_firmware::constants::{MODBUS_SLOT_US, ROBOTIQ_COMMAND};
use gripline_firmware::line::GripLine;
use gripline_firmware::modbus::{ANSWER_MAX, REGISTERS, Request};
use gripline_firmware::robotiq::{GripperStatus, Robotiq, force_register};

/// Panics when something does not hold for this input.
pub fn check(input: &[u8]) {
    let mut line = Robotiq::new(0);
    let (mut now_us, mut asked_us, mut held) = (0, None::<u64>, None::<i32>);
    let mut asked: &[u8] = &[];
    let mut rest = input;
    while let Some((&step, after)) = rest.split_first() {
        rest = after;
        let mut take = |count: usize| {
            let (taken, after) = rest.split_at(count.min(rest.len()));
            rest = after;
            taken
        };
        match step % 5 {
            // Another force.
            0 => {
                let force = take(2)
                    .iter()
                    .fold(0, |force, byte| force << 8 | i32::from(*byte))
                    * 16;
                let Ok(()) = line.write(GripForce::from_lsb(force));
                held = (force > 0).then_some(force);
            }
            // Any bytes.
            1 => line.receive(take(usize::from(step / 5)), now_us),
            // A right answer with any content, as far as it fits the question.
            2 => {
                let content = take(2 * REGISTERS);
                let answer = answer_to(asked, content);
                line.receive(&answer, now_us);
                asked = &[];
            }
            // Time passes.
            3 => now_us += u64::from(step / 5) * 1_000,
            _ => now_us = now_us.max(line.wake_us()),
        }
        if let Some(request) = line.poll_transmit(now_us) {
            assert!(
                asked_us.is_none_or(|us| now_us - us >= MODBUS_SLOT_US),
                "faster than 200 Hz"
            );
            asked_us = Some(now_us);
            let active = line.status().is_some_and(GripperStatus::has_act);
            judge(&request, held, active);
            asked = if request.is_full() { &[16] } else { &[4] };
        }
        assert!(line.wake_us() > now_us, "time stands still");
    }
}

/// What may be ordered while `held` is to be held; `active` when the gripper last said that it is
/// activated or being so, in which case ordering it again changes nothing.
fn judge(frame: &[u8], held: Option<i32>, active: bool) {
    let Some((&[9, function, high, low, 0, 3], rest)) = frame.split_first_chunk() else {
        panic!("request {frame:02x?}");
    };
    if function == 4 {
        return;
    }
    assert_eq!((function, u16::from_be_bytes([high, low])), (16, ROBOTIQ_COMMAND));
    let &[6, action, 0, 0, position, _, force, _, _] = rest else {
        panic!("write {frame:02x?}");
    };
    if let Some(held) = held {
        assert!(
            action == 9 || (action == 1 && active),
            "{frame:02x?} while {held} is held"
        );
        if action == 9 {
            assert!(position >= 254 && force >= force_register(GripForce::from_lsb(held)));
        }
    }
}

/// The frame that answers function `asked`, its content from the input.
fn answer_to(asked: &[u8], content: &[u8]) -> Vec<u8> {
    let mut answer = vec![9];
    if asked == [16] {
        answer.extend([16, 3, 0xE8, 0, 3]);
    } else {
        let mut registers = [0; 2 * REGISTERS];
        registers[..content.len()].copy_from_slice(content);
        answer.extend([4, 6]);
        answer.extend(registers);
    }
    // Bitwise, as the standard writes it.
    let mut crc = 0xFFFF_u16;
    for &byte in &answer {
        crc ^= u16::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xA001 } else { crc >> 1 };
        }
    }
    answer.extend(crc.to_le_bytes());
    assert!(answer.len() <= ANSWER_MAX);
    // The client agrees that this is an answer.
    let question = if asked == [16] {
        Request::Write {
            address: ROBOTIQ_COMMAND,
            values: [0; REGISTERS],
        }
    } else {
        Request::Read { address: 0x07D0 }
    };
    assert!(matches!(question.answer(9, &answer), Some(Ok(_))));
    answer
}
