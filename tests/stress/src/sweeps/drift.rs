//! A million frames of everything that remembers: constant input must end in a constant line, a closed loop in one that
//! stays within a step, and the clock between host and microcontroller must not wander.

use gripline_firmware::GripForce;
use gripline_firmware::clock_sync::{CaptureTime, ClockSync};
use gripline_firmware::line::DAC_LIVE_ZERO;
use gripline_firmware::{DeviceMicros, HostMicros};
use gripline_protocol::message::Configuration;
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, TaxelForce};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde_json::json;

use super::one_step_in_time::moved;
use crate::board::{Board, Origin};
use crate::picture::Picture;
use crate::{Effort, Sweep};

const FRAME_US: u64 = 16_667;
/// After this the line must have come to rest, frames: 30 s of falling by plan at 1 N/s, the dwell, the rise.
const SETTLED: usize = 2_400;

/// `contact` taxels of which `stick` stick and make the total shear; the others pull against each other.
fn map_of(contact: usize, stick: usize, shear: i16) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    for (n, taxel) in map.taxels.iter_mut().skip(180).take(contact).enumerate() {
        let z = 1_000;
        // Slipping taxels pull against each other: a torsional moment.
        let x = if n < stick {
            shear
        } else if n % 2 == 0 {
            700
        } else {
            -700
        };
        *taxel = TaxelForce { x, y: 0, z };
    }
    map
}

/// The same map for ever: name, map, whether noise of a step comes on top.
type Constant = (&'static str, fn() -> ForceMap, bool);

const CONSTANT: [Constant; 7] = [
    ("all of 12 stick", || map_of(12, 12, 200), false),
    ("58 % of 12 stick: dead band", || map_of(12, 7, 100), false),
    ("half of 12 stick: the threshold", || map_of(12, 6, 100), false),
    ("a third of 12 stick: slip", || map_of(12, 4, 100), false),
    ("shear beyond the ceiling", || map_of(100, 100, 440), false),
    ("nothing touches", || ForceMap::EMPTY, false),
    ("all of 12 stick, noise of one step", || map_of(12, 12, 200), true),
];

/// Contacts of the closed loop.
const SIZES: [usize; 13] = [1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 25, 100, 400];

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "a million frames",
        "The whole program at 60 maps a second. Constant maps: from 40 s on the line must not move by more than one step of \
         1/4096 N. Closed loop: a torsional moment that needs 4 N, of a contact whose stick ratio follows the grip force as in a \
         Hertzian contact, quantised to its number of taxels. Clocks: 100 ppm apart, frames late by up to 5 ms.",
        &[
            "what",
            "frames",
            "line from N",
            "to N",
            "moves 1/4096 N",
            "of it drift",
            "DAC codes",
            "later than jitter, µs",
        ],
    );
    let frames = effort.of(1_000_000, 6_000);
    let mut worst = 0;
    let settings = [
        ("", Configuration::CAREFUL),
        (", learning", Configuration::DEFAULT),
    ];
    let each = CONSTANT
        .into_iter()
        .flat_map(|constant| settings.map(|settings| (constant, settings)));
    for (stream, ((name, map, is_noisy), (learning, settings))) in (1_100..).zip(each) {
        let name = &format!("{name}{learning}");
        let span = constant(
            effort.random(stream),
            settings,
            &map(),
            is_noisy,
            if is_noisy {
                (frames / 5).max(2 * SETTLED)
            } else {
                frames
            },
        );
        let is_judged = !is_noisy;
        if is_judged {
            worst = worst.max(span.max - span.min);
        } else {
            // Twelve components of a step up or down, through the feed-forward's gain.
            let max = 24.0 * 14_000.0 / 4_500.0 + 1.0;
            sweep.check(
                format!("{name}: moves of the line, 1/4096 N (gain times the noise)"),
                f64::from(span.max - span.min),
                max,
            );
        }
        sweep.row(span.row(name));
    }
    sweep.check(
        "moves of the line under a constant map, 1/4096 N, from 40 s on",
        f64::from(worst),
        1.0,
    );
    let (mut cycling, mut curves) = (Vec::new(), Vec::new());
    let mut worst = 0;
    for size in SIZES {
        let (span, curve) = closed_loop(size, effort.of(40_000, 5_000));
        sweep.row(span.row(&format!("closed loop, torsional moment, {size} taxels")));
        worst = worst.max(span.max - span.min);
        if span.max - span.min > 1 {
            cycling.push(size.to_string());
        }
        if [1, 4, 12, 100].contains(&size) {
            curves.push((format!("{size} taxels"), curve));
        }
    }
    sweep.check(
        "moves of the line in the closed loop once settled, 1/4096 N",
        f64::from(worst),
        1.0,
    );
    if !cycling.is_empty() {
        sweep.notes.push(format!(
            "limit cycles with contacts of {} taxels",
            cycling.join(", ")
        ));
    }
    sweep.pictures.push(Picture {
        file: "stress-loop.png",
        caption: "Closed loop under a torsional moment that needs 4 N: the line after the load came, by the number of taxels in contact".to_owned(),
        axes: ["time, s", "grip-force line, N"],
        is_log: [false; 2],
        curves,
    });
    both_clocks(effort, frames, &mut sweep);
    sweep
}

fn both_clocks(effort: Effort, frames: usize, sweep: &mut Sweep) {
    for (parts_per_million, name) in [
        (-100, "clocks, host 100 ppm slower"),
        (100, "clocks, host 100 ppm faster"),
    ] {
        let (late_us, refused) = clocks(effort, parts_per_million, frames);
        sweep.row(vec![
            json!(name),
            json!(frames),
            json!(null),
            json!(null),
            json!(null),
            json!(null),
            json!(null),
            json!(late_us),
        ]);
        sweep.none(format!("{name}: maps refused as from the future"), refused);
        sweep.check(
            format!("{name}: age beyond the jitter, µs"),
            f64::from(late_us),
            1_000.0,
        );
    }
}

/// Where the line was once settled.
struct Span {
    frames: usize,
    min: i32,
    max: i32,
    first: i32,
    last: i32,
}

impl Span {
    fn row(&self, name: &str) -> Vec<serde_json::Value> {
        let newtons = |line: i32| f64::from(line) / f64::from(LSB_PER_NEWTON);
        let code = |line: i32| DAC_LIVE_ZERO.code(GripForce::from_lsb(line));
        vec![
            json!(name),
            json!(self.frames),
            json!(newtons(self.min)),
            json!(newtons(self.max)),
            json!(self.max - self.min),
            json!(self.last - self.first),
            json!(code(self.max).0 - code(self.min).0),
            json!(null),
        ]
    }

    fn of(frames: usize, lines: impl Iterator<Item = i32>) -> Self {
        let mut span = Self {
            frames,
            min: i32::MAX,
            max: i32::MIN,
            first: 0,
            last: 0,
        };
        for line in lines {
            if span.min > span.max {
                span.first = line;
            }
            span.min = span.min.min(line);
            span.max = span.max.max(line);
            span.last = line;
        }
        span
    }
}

fn constant(
    mut random: Pcg64Mcg,
    settings: Configuration,
    map: &ForceMap,
    is_noisy: bool,
    frames: usize,
) -> Span {
    let mut board = Board::holding(settings, Origin::default());
    let lines = (0..frames).filter_map(|frame| {
        if is_noisy {
            board.map(&moved(map, &mut random));
        } else {
            board.map(map);
        }
        board.pass_us(FRAME_US);
        (frame >= SETTLED).then(|| board.device.program.line().lsb())
    });
    Span::of(frames, lines)
}

/// The grip force makes the stick ratio, the stick ratio the grip force.
fn closed_loop(taxels: usize, frames: usize) -> (Span, Vec<(f64, f64)>) {
    let settings = Configuration::CAREFUL;
    let mut board = Board::holding(settings, Origin::default());
    let needed = 4 * LSB_PER_NEWTON;
    let mut lines = Vec::with_capacity(frames);
    for _ in 0..frames {
        let line = board.device.program.line().lsb();
        let share = f64::from(needed) / f64::from(line.max(1));
        let ratio = (1.0 - share).max(0.0).powf(2.0 / 3.0);
        let stick = (ratio * taxels as f64).round() as usize;
        let mut map = ForceMap::EMPTY;
        for (n, taxel) in map.taxels.iter_mut().take(taxels).enumerate() {
            // A torsional moment: no total shear, so nothing but the stick ratio tells.
            let x = if n < stick {
                0
            } else if n % 2 == 0 {
                700
            } else {
                -700
            };
            *taxel = TaxelForce { x, y: 0, z: 1_000 };
        }
        board.map(&map);
        board.pass_us(FRAME_US);
        lines.push(board.device.program.line().lsb());
    }
    let curve = lines
        .iter()
        .take(420)
        .step_by(3)
        .enumerate()
        .map(|(n, line)| {
            (
                n as f64 * 3.0 * 0.016_667,
                f64::from(*line) / f64::from(LSB_PER_NEWTON),
            )
        })
        .collect();
    (Span::of(frames, lines.into_iter().skip(SETTLED)), curve)
}

/// (greatest age beyond the jitter, maps refused).
fn clocks(effort: Effort, parts_per_million: i64, frames: usize) -> (u32, u64) {
    let mut random = effort.random(1_200);
    let mut clock = ClockSync::new();
    let (mut worst, mut refused) = (0, 0);
    let start_us = 5_000_000_000;
    for frame in 0..frames as u64 {
        let passed = frame * FRAME_US;
        let jitter: u64 = random.random_range(0..5_000);
        let host = passed as i64 + passed as i64 * parts_per_million / 1_000_000;
        match clock.check(
            HostMicros(u32::MAX - 30_000_000).later_by(host as u32),
            DeviceMicros(start_us + passed + jitter),
        ) {
            CaptureTime::Late { us } => worst = worst.max(us.saturating_sub(5_000)),
            CaptureTime::Future => refused += 1,
        }
    }
    (worst, refused)
}
