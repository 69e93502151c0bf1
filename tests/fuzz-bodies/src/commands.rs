//! A host that does anything in any order: handshakes, commands, settings, maps, noise, silence. The microcontroller's
//! program never panics or wraps, its settings stay in range, and the line obeys its rules after every step.

use gripline_firmware::grip::Guard;
use gripline_firmware::{Device, Fault, GripForce, LinkId, ResetCause, Start};
use gripline_protocol::configuration::{CONFIGURATION_VALUES, Configuration};
use gripline_protocol::message::{Command, GripMode, Hello, Message, MessagePackets, Report, Stage, Status};
use gripline_protocol::{Event, ForceMap, Health, MapInfo, Parser, SensorId, TaxelForce, encode_map};

/// Steps of one input, and milliseconds that it may let pass.
const STEPS_MAX: u32 = 60;
/// See [`STEPS_MAX`]; twice LINK LOST's half second.
const TICKS_MAX: u32 = 1_000;

/// Reads the input bit by bit; past its end everything is 0.
struct Input<'a>(&'a [u8]);

impl Input<'_> {
    fn byte(&mut self) -> u8 {
        match self.0.split_first() {
            Some((&byte, rest)) => {
                self.0 = rest;
                byte
            }
            None => 0,
        }
    }

    fn word(&mut self) -> u32 {
        u32::from_le_bytes([self.byte(), self.byte(), self.byte(), self.byte()])
    }

    fn half(&mut self) -> i16 {
        i16::from_le_bytes([self.byte(), self.byte()])
    }
}

/// The microcontroller and what is known of it.
struct Bench {
    device: Device,
    now_us: u64,
    sequence: u32,
    message_id: u8,
    /// The host's reading of what comes back.
    host: Parser,
    /// As the line stood after the last step.
    line: i32,
    mode: GripMode,
    /// So that no input takes long: the fuzzer learns more from many short ones.
    ticks_left: u32,
    /// The settings that were in force at the last step, and in range.
    settings: Configuration,
    /// How far rises are ahead of the slew limit, 1/4096 N: a map may bring what the next tick would.
    ahead: i64,
}

impl Bench {
    fn start(input: &mut Input<'_>) -> Self {
        let choice = input.byte();
        let restored = (choice & 1 != 0).then(|| GripForce::from_lsb(i32::from(input.half()) * 16));
        let reset = [
            ResetCause::PowerOn,
            ResetCause::Watchdog,
            ResetCause::Software,
            ResetCause::BrownOut,
        ][usize::from(choice >> 1) % 4];
        let device = Device::new(Start {
            restored_line: restored,
            reset,
            ..Start::default()
        });
        Self {
            line: device.program.line().lsb(),
            mode: device.program.status().mode,
            device,
            now_us: 0,
            sequence: 0,
            message_id: 0,
            host: Parser::new(),
            ticks_left: TICKS_MAX,
            settings: Configuration::DEFAULT,
            ahead: 0,
        }
    }

    fn packet(&mut self, packet: &[u8]) {
        let before_us = self.now_us;
        let action = self.device.packet(packet, self.now_us);
        self.judge(action.line, before_us);
    }

    fn message(&mut self, message: &Message) {
        self.message_id = self.message_id.wrapping_add(1);
        for packet in MessagePackets::new(message, self.message_id).expect("every message fits") {
            self.packet(&packet);
        }
    }

    fn command(&mut self, input: &mut Input<'_>) {
        let command = match input.byte() % 8 {
            0 => Command::Hold,
            1 => Command::Release,
            2 => Command::Acknowledge { faults: input.word() },
            3 => Command::ReadStatus,
            4 => Command::ReadConfiguration,
            5 => Command::Store,
            _ => match Self::settings(input) {
                Some(settings) => Command::Configure(settings),
                None => return,
            },
        };
        self.message(&Message::Command(command));
        if let Some(settings) = self.device.program.take_store() {
            assert_eq!(
                (self.device.program.line(), settings.check()),
                (GripForce::ZERO, Ok(()))
            );
            self.device.program.stored(Some(1));
        }
    }

    /// Up to four settings of the standard ones changed, or none when no settings can be those numbers.
    fn settings(input: &mut Input<'_>) -> Option<Configuration> {
        let mut values = Configuration::DEFAULT.values();
        for _ in 0..input.byte() % 5 {
            let place = usize::from(input.byte()) % CONFIGURATION_VALUES;
            values[place] = match input.byte() % 3 {
                0 => i32::from(input.half()),
                1 => i32::from(input.byte()) * 1_000,
                _ => input.word().cast_signed(),
            };
        }
        Configuration::from_values(&values)
    }

    fn map(&mut self, input: &mut Input<'_>) {
        let kind = input.byte();
        self.sequence = self.sequence.wrapping_add(match kind & 3 {
            0 | 1 => 1,
            2 => u32::from(input.byte()),
            _ => input.word(),
        });
        let info = MapInfo {
            sensor: SensorId::ALL[usize::from(kind >> 2 & 1)],
            sequence: self.sequence,
            capture_us: (self.now_us as u32).wrapping_sub(u32::from(input.byte()) << (kind >> 6 << 3)),
            health: Health::from_bits(if kind & 8 != 0 { input.byte() } else { 0 }),
            ..MapInfo::default()
        };
        let mut map = ForceMap::EMPTY;
        let force = TaxelForce {
            x: input.half(),
            y: input.half(),
            z: input.half(),
        };
        let (from, count) = (usize::from(input.byte()), usize::from(input.byte()));
        map.taxels[from..from + count.min(145)].fill(force);
        let mut packets = Vec::new();
        encode_map(&info, &map, |packet| packets.push(packet.to_vec()));
        let lost = if kind & 32 != 0 {
            usize::from(input.byte())
        } else {
            usize::MAX
        };
        for (place, packet) in packets.iter().enumerate() {
            if place != lost {
                self.packet(packet);
            }
        }
    }

    /// Time passes in ticks, or a tick comes late.
    fn wait(&mut self, input: &mut Input<'_>) {
        let kind = input.byte();
        let (ticks, step_us) = match kind & 3 {
            0 => (1, 1_000),
            1 => (u32::from(kind >> 2) * 4, 1_000),
            2 => (u32::from(kind >> 2), 10_000),
            _ => (1, u64::from(input.word())),
        };
        for _ in 0..ticks.min(self.ticks_left) {
            self.ticks_left -= 1;
            let before_us = self.now_us;
            self.now_us += step_us;
            let action = self.device.tick(self.now_us);
            self.judge(action.line, before_us);
        }
    }

    /// What must hold after every step.
    fn judge(&mut self, line: GripForce, before_us: u64) {
        let status = self.device.program.status();
        let rise_rate_before = self.settings.rise_rate;
        if *self.device.program.settings() != self.settings {
            self.settings = *self.device.program.settings();
            assert_eq!(self.settings.check(), Ok(()), "settings in force are in range");
        }
        let settings = self.settings;
        let (line, before) = (line.lsb(), self.line);
        assert_eq!((line, line), (self.device.program.line().lsb(), status.line));
        let passed_ms = (self.now_us - before_us).div_ceil(1_000);
        let grown = |rate: u16| i64::from(rate) * passed_ms as i64 + 1;
        let change = i64::from(line) - i64::from(before);
        assert!(line >= 0, "no force below none");
        // Over any time: the slew limit, and once the millisecond until the next tick.
        let rise_rate = settings.rise_rate.max(rise_rate_before);
        self.ahead = (self.ahead + change.max(0) - i64::from(rise_rate) * passed_ms as i64).max(0);
        assert!(
            self.ahead <= i64::from(rise_rate) + 2,
            "rises by {change} in {passed_ms} ms, {} ahead of the slew limit",
            self.ahead
        );
        assert!(
            change <= 0 || line <= settings.ceiling,
            "rises to {line} past the ceiling {}",
            settings.ceiling
        );
        let faulty = is_guarded(&status);
        match status.mode {
            GripMode::Released => {
                let fall = grown(settings.release_rate);
                assert!(
                    -change <= fall,
                    "falls by {} in {passed_ms} ms after release",
                    -change
                );
                assert!(change <= 0, "a released line rises");
            }
            GripMode::Hold if self.mode == GripMode::Hold => {
                let relax = i64::from(settings.relax_rate) * passed_ms as i64 / 1_000 + 1;
                assert!(
                    -change <= relax,
                    "falls by {} in {passed_ms} ms while it holds",
                    -change
                );
                assert!(change >= 0 || !faulty, "falls in a fault that forbids it");
            }
            GripMode::Hold => {}
        }
        (self.line, self.mode) = (line, status.mode);
        self.listen();
    }

    /// Everything the microcontroller says can be read.
    fn listen(&mut self) {
        while let Some(packet) = self.device.next_packet() {
            match self.host.push(&packet) {
                Ok(Event::Message(bytes)) => match Message::from_bytes(bytes) {
                    Ok(
                        Message::Hello(_)
                        | Message::Report(Report::Refused(_) | Report::Stored { .. } | Report::Status(_)),
                    ) => {}
                    Ok(Message::Report(Report::Configuration(settings))) => {
                        assert_eq!(settings, *self.device.program.settings());
                    }
                    other => panic!("the microcontroller said {other:?}"),
                },
                Ok(Event::Fragment) => {}
                other => panic!("the microcontroller sent {other:?}"),
            }
        }
    }
}

/// Whether a fault that holds the line is there, as the status tells it.
fn is_guarded(status: &Status) -> bool {
    let faults = status.faults | status.latched;
    Fault::ALL
        .iter()
        .any(|fault| faults & fault.bit() != 0 && fault.guard() != Guard::Free)
}

/// Panics when something does not hold for this input.
pub fn check(input: &[u8]) {
    let mut input = Input(input);
    let mut bench = Bench::start(&mut input);
    let mut steps = 0;
    while !input.0.is_empty() && steps < STEPS_MAX {
        steps += 1;
        match input.byte() % 10 {
            0 => {
                let mut hello = Hello::of_this_build(0, input.byte().into());
                if input.byte() & 15 == 15 {
                    hello.schema_hash ^= 1;
                }
                bench.message(&Message::Hello(hello));
            }
            1 | 2 => bench.command(&mut input),
            3 | 4 => bench.map(&mut input),
            5 | 6 => bench.wait(&mut input),
            7 => {
                let length = usize::from(input.byte()).min(input.0.len());
                let (packet, rest) = input.0.split_at(length);
                input.0 = rest;
                bench.packet(packet);
            }
            8 => {
                bench.device.malformed_frame(LinkId::Usb);
                // What was refused is counted at once, and holds the line from the next step on.
                bench.wait(&mut Input(&[0]));
            }
            _ => {
                let stage =
                    [Stage::Packet, Stage::Decide, Stage::Line, Stage::Tick][usize::from(input.byte()) % 4];
                bench.device.program.note_cycles(stage, input.word());
            }
        }
    }
}
