//! Clocks and numbers that wrap, wherever in a scene that happens, and silences of any length.

use gripline_firmware::clock_sync::{CaptureTime, ClockSync};
use gripline_firmware::{DeviceMicros, HostMicros};
use gripline_protocol::ForceMap;
use gripline_protocol::message::{Configuration, SlipState};
use serde_json::json;

use super::judge::quantised;
use crate::board::{Board, Origin};
use crate::contacts::Contact;
use crate::{Effort, Sweep};

const FRAME_US: u64 = 16_667;
const FRAMES: usize = 240;
const SCENE_US: u64 = FRAME_US * FRAMES as u64;

/// Pull until it slips, and back, then let go.
fn map_at(frame: usize) -> ForceMap {
    let at = frame as f64 / FRAMES as f64;
    if at > 0.9 {
        return ForceMap::EMPTY;
    }
    let contact = Contact {
        centre_mm: [0.0; 2],
        radius_mm: 4.0,
        peak_n: 0.3,
        friction: 0.6,
        share: 1.1 * (1.0 - (2.0 * at - 0.9).abs()),
        way_rad: 0.3,
        torsion_share: 0.2,
    };
    quantised(&contact.newtons()).0
}

/// What is decided after a frame.
type Decided = (SlipState, i32, Option<u16>, u32, u32);

fn play(maps: &[ForceMap], origin: Origin) -> Vec<Decided> {
    let mut board = Board::holding(Configuration::CAREFUL, origin);
    maps.iter()
        .map(|map| {
            let status = board.map(map);
            board.pass_us(FRAME_US);
            (
                status.state,
                status.line,
                status.time_to_slip_ms,
                status.faults,
                status.maps,
            )
        })
        .collect()
}

/// A clock or number that wraps when this many µs have passed.
type Wrap = (&'static str, fn(u64) -> Origin);

const WRAPS: [Wrap; 5] = [
    ("host's clock, 2³² µs", |us| Origin {
        capture_us: 0_u32.wrapping_sub(us as u32),
        ..Origin::default()
    }),
    ("number of the map, 2³²", |us| Origin {
        sequence: 0_u32.wrapping_sub((us / FRAME_US) as u32),
        ..Origin::default()
    }),
    ("microcontroller's clock past 2³² µs", |us| Origin {
        now_us: (1 << 32) - us,
        ..Origin::default()
    }),
    ("microcontroller's uptime, 2³² ms", |us| Origin {
        now_us: (1 << 32) * 1_000 - us,
        ..Origin::default()
    }),
    ("all of them at once", |us| Origin {
        now_us: (1 << 32) * 1_000 - us,
        capture_us: 0_u32.wrapping_sub(us as u32),
        sequence: 0_u32.wrapping_sub((us / FRAME_US) as u32),
    }),
];

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "clocks and numbers that wrap",
        "A scene of 4 s whose clocks or map numbers wrap at one of its frames, against the same scene far from any wrap: \
         state, line, time to slip, faults and count of maps, frame by frame. Then one silence, and the first map after it.",
        &["what wraps", "scenes", "frames", "decided otherwise"],
    );
    let maps: Vec<ForceMap> = (0..FRAMES).map(map_at).collect();
    let plain = play(&maps, Origin::default());
    let mut all = 0;
    for (name, origin) in WRAPS {
        let scenes = effort.of(120, 4) as u64;
        let mut differ = 0;
        for scene in 0..scenes {
            let found = play(&maps, origin(SCENE_US * scene / scenes + 1 + scene));
            differ += plain
                .iter()
                .zip(&found)
                .filter(|(one, other)| one != other)
                .count() as u64;
        }
        sweep.row(vec![
            json!(name),
            json!(scenes),
            json!(scenes * FRAMES as u64),
            json!(differ),
        ]);
        all += differ;
    }
    sweep.none("frames that a wrap decides otherwise", all);
    let mut refused = 0;
    let mut failures = Vec::new();
    for (name, silence_us) in SILENCES {
        for parts_per_million in [-100, 0, 100] {
            let late_us = after_silence(silence_us, parts_per_million);
            refused += u64::from(late_us.is_none());
            if late_us.is_none() {
                failures.push(format!("{name} at {parts_per_million} ppm"));
            }
        }
    }
    sweep.row(vec![
        json!("a silence of 1 s to 30 days, clocks apart by up to 100 ppm"),
        json!(3 * SILENCES.len()),
        json!(3 * SILENCES.len()),
        json!(refused),
    ]);
    sweep.none(
        "maps that are refused as from the future because none came for long",
        refused,
    );
    if !failures.is_empty() {
        sweep
            .notes
            .push(format!("refused after: {}", failures.join(", ")));
    }
    sweep
}

const SILENCES: [(&str, u64); 10] = [
    ("1 s", 1_000_000),
    ("1 minute", 60_000_000),
    ("10 minutes", 600_000_000),
    ("17 minutes", 17 * 60_000_000),
    ("18 minutes", 18 * 60_000_000),
    ("36 minutes", 36 * 60_000_000),
    ("72 minutes", 72 * 60_000_000),
    ("5 hours", 5 * 3_600_000_000),
    ("1 day", 24 * 3_600_000_000),
    ("30 days", 30 * 24 * 3_600_000_000),
];

/// How late the first map after a silence counts; `None` when it is refused.
fn after_silence(silence_us: u64, parts_per_million: i64) -> Option<u32> {
    let mut clock = ClockSync::new();
    let start_us = 7_000_000;
    clock.check(HostMicros(1_000), DeviceMicros(start_us));
    let passed = silence_us as i64 + silence_us as i64 * parts_per_million / 1_000_000;
    match clock.check(
        HostMicros(1_000).later_by(passed as u32),
        DeviceMicros(start_us + silence_us),
    ) {
        CaptureTime::Late { us } => Some(us),
        CaptureTime::Future => None,
    }
}
