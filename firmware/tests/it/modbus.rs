//! Modbus frames against those printed in the gripper's manual, and against everything that is not an answer.

use gripline_firmware::modbus::{ANSWER_MAX, Answer, AnswerError, Request};
use proptest::prelude::*;

fn frame(request: Request) -> Vec<u8> {
    request.frame(9).to_vec()
}

const STATUS: Request = Request::Read { address: 0x07D0 };
const OPEN: Request = Request::Write {
    address: 0x03E8,
    values: [0x0900, 0x0000, 0xFFFF],
};

/// 2F-85 & 2F-140 Instruction Manual, section 4.8.5, steps 1, 3, 5 and 7.
#[test]
fn requests_are_those_of_the_manual() {
    let close = Request::Write {
        address: 0x03E8,
        values: [0x0900, 0x00FF, 0xFFFF],
    };
    let clear = Request::Write {
        address: 0x03E8,
        values: [0, 0, 0],
    };
    assert_eq!(
        frame(OPEN),
        [
            0x09, 0x10, 0x03, 0xE8, 0x00, 0x03, 0x06, 0x09, 0x00, 0x00, 0x00, 0xFF, 0xFF, 0x72, 0x19
        ]
    );
    assert_eq!(
        frame(close),
        [
            0x09, 0x10, 0x03, 0xE8, 0x00, 0x03, 0x06, 0x09, 0x00, 0x00, 0xFF, 0xFF, 0xFF, 0x42, 0x29
        ]
    );
    assert_eq!(
        frame(clear),
        [
            0x09, 0x10, 0x03, 0xE8, 0x00, 0x03, 0x06, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x73, 0x30
        ]
    );
    assert_eq!(frame(STATUS), [0x09, 0x04, 0x07, 0xD0, 0x00, 0x03, 0xB1, 0xCE]);
}

/// The same section, steps 6 and 8, and the response to every write.
#[test]
fn answers_of_the_manual_are_read() {
    let written = [0x09, 0x10, 0x03, 0xE8, 0x00, 0x03, 0x01, 0x30];
    assert_eq!(OPEN.answer(9, &written), Some(Ok(Answer::Written)));
    for (bytes, registers) in [
        (
            [0x09, 0x04, 0x06, 0x39, 0x00, 0x00, 0x00, 0xBB, 0x10, 0x71, 0x06],
            [0x3900, 0x0000, 0xBB10],
        ),
        (
            [0x09, 0x04, 0x06, 0xB9, 0x00, 0x00, 0xFF, 0xBD, 0x00, 0x5C, 0x9A],
            [0xB900, 0x00FF, 0xBD00],
        ),
        (
            [0x09, 0x04, 0x06, 0xF9, 0x00, 0x00, 0x00, 0x0D, 0x00, 0x17, 0xAA],
            [0xF900, 0x0000, 0x0D00],
        ),
    ] {
        assert_eq!(STATUS.answer(9, &bytes), Some(Ok(Answer::Registers(registers))));
        for length in 0..bytes.len() {
            assert_eq!(
                STATUS.answer(9, &bytes[..length]),
                None,
                "{length} bytes are not all"
            );
        }
    }
}

#[test]
fn exceptions_tell_their_code_and_other_answers_are_named() {
    let with_crc = |body: &[u8]| {
        let crc = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS).checksum(body);
        [body, &crc.to_le_bytes()].concat()
    };
    let cases: [(&Request, &[u8], AnswerError); 6] = [
        (&STATUS, &[9, 0x84, 2], AnswerError::Exception(2)),
        (&OPEN, &[9, 0x90, 6], AnswerError::Exception(6)),
        (&STATUS, &[8, 4, 6, 0, 0, 0, 0, 0, 0], AnswerError::Other),
        (&STATUS, &[9, 4, 4, 0, 0, 0, 0, 0, 0], AnswerError::Other),
        (&OPEN, &[9, 16, 3, 0xE9, 0, 3], AnswerError::Other),
        (&OPEN, &[9, 4, 3, 0xE8, 0, 3], AnswerError::Other),
    ];
    for (request, body, expected) in cases {
        assert_eq!(
            request.answer(9, &with_crc(body)),
            Some(Err(expected)),
            "{body:02x?}"
        );
    }
}

proptest! {
    #[test]
    fn any_one_or_two_flipped_bits_of_an_answer_are_noticed(first in 0..88_usize, second in 0..88_usize) {
        let good = [0x09, 0x04, 0x06, 0xB9, 0x00, 0x00, 0xFF, 0xBD, 0x00, 0x5C, 0x9A];
        let mut bytes = good;
        bytes[first / 8] ^= 1 << (first % 8);
        if first != second {
            bytes[second / 8] ^= 1 << (second % 8);
        }
        let read = STATUS.answer(9, &bytes);
        prop_assert!(!matches!(read, Some(Ok(_))), "{read:?}");
    }

    #[test]
    fn any_bytes_are_an_answer_only_when_their_crc_says_so(bytes in proptest::collection::vec(any::<u8>(), 0..=ANSWER_MAX)) {
        for request in [OPEN, STATUS] {
            if let Some(Ok(_)) = request.answer(9, &bytes) {
                let (body, crc) = bytes.split_at(bytes.len() - 2);
                prop_assert_eq!(crc, crc::Crc::<u16>::new(&crc::CRC_16_MODBUS).checksum(body).to_le_bytes());
            }
        }
    }
}
