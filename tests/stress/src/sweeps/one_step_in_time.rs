//! The whole program over played scenes, once as they are and once with every input of every frame moved by at most one
//! step: how often decision, state and line differ.

use gripline_firmware::grip::{Evidence, GripController, Guard};
use gripline_firmware::sums::stick_ratio_below;
use gripline_protocol::message::{Configuration, GripMode, SlipState, Status};
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, PER_UNIT, TaxelForce};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde_json::json;

use super::judge::quantised;
use super::one_step::half_stuck;
use crate::board::{Board, Origin};
use crate::contacts::Contact;
use crate::picture::Picture;
use crate::{Effort, Sweep};

const FRAME_US: u64 = 16_667;

/// Forces at a part of the scene, 0 to 1.
type Scene = (&'static str, fn(f64) -> ForceMap, bool);

const SCENES: [Scene; 4] = [
    ("steady hold", |_| pulled(0.3, 0.6), true),
    (
        "pull until it slips, and back",
        |at| pulled(1.05 * (1.0 - (2.0 * at - 1.0).abs()), 0.6),
        false,
    ),
    ("half of it sticks", |_| half_stuck(&mut Pcg64Mcg::new(7)), false),
    (
        "gross slip, skin as the detector's",
        |_| pulled(1.05, 0.45),
        false,
    ),
];

fn pulled(share: f64, friction: f64) -> ForceMap {
    let contact = Contact {
        centre_mm: [0.4, -0.3],
        radius_mm: 6.0,
        peak_n: 0.2,
        friction,
        share,
        way_rad: 0.5,
        torsion_share: 0.0,
    };
    quantised(&contact.newtons()).0
}

/// Every component of a loaded taxel moved by −1, 0 or 1.
pub(super) fn moved(map: &ForceMap, random: &mut Pcg64Mcg) -> ForceMap {
    let mut map = map.clone();
    for taxel in map.taxels.iter_mut().filter(|taxel| **taxel != TaxelForce::ZERO) {
        for component in [&mut taxel.x, &mut taxel.y, &mut taxel.z] {
            *component = component.saturating_add(random.random_range(-1..=1));
        }
    }
    map
}

fn play(frames: usize, mut map_at: impl FnMut(usize) -> ForceMap) -> Vec<Status> {
    let mut board = Board::holding(Configuration::CAREFUL, Origin::default());
    (0..frames)
        .map(|frame| {
            let status = board.map(&map_at(frame));
            board.pass_us(FRAME_US);
            status
        })
        .collect()
}

fn changes<T: PartialEq>(values: impl Iterator<Item = T>) -> u64 {
    let mut last = None;
    let mut count = 0;
    for value in values {
        count += u64::from(last.as_ref().is_some_and(|last| *last != value));
        last = Some(value);
    }
    count
}

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "one step, over time",
        "Scenes of 20 s at 60 maps a second through the whole program, and again with every component of every frame moved \
         by −1, 0 or +1/4096 N at random: frames that decide otherwise, changes of the state, and how far the line is off.",
        &[
            "scene",
            "frames",
            "bare decision differs",
            "bare changes",
            "state differs",
            "state changes",
            "without noise",
            "line off by N",
        ],
    );
    let frames = effort.of(1_200, 240);
    let settings = Configuration::CAREFUL;
    let bare = |status: &Status| stick_ratio_below(&status.sums, settings.slip_threshold);
    let mut curves = Vec::new();
    for (stream, (name, scene, is_steady)) in (200..).zip(SCENES) {
        let mut random = effort.random(stream);
        let at = |frame: usize| scene(frame as f64 / frames as f64);
        let plain = play(frames, at);
        let noisy = play(frames, |frame| moved(&at(frame), &mut random));
        let differ = |same: &dyn Fn(&Status, &Status) -> bool| {
            plain.iter().zip(&noisy).filter(|(a, b)| !same(a, b)).count() as u64
        };
        let states = differ(&|a, b| a.state == b.state);
        let bares = differ(&|a, b| bare(a) == bare(b));
        let off = plain
            .iter()
            .zip(&noisy)
            .map(|(a, b)| (a.line - b.line).abs())
            .max()
            .unwrap_or(0);
        let bare_changes = changes(noisy.iter().map(bare));
        let [were, are] =
            [&plain, &noisy].map(|statuses| changes(statuses.iter().map(|status| status.state)));
        sweep.row(vec![
            json!(name),
            json!(frames),
            json!(bares),
            json!(bare_changes),
            json!(states),
            json!(are),
            json!(were),
            json!(f64::from(off) / f64::from(LSB_PER_NEWTON)),
        ]);
        if is_steady {
            sweep.none(format!("{name}: frames whose state differs"), states);
        } else {
            // The dwell is three frames: a state that followed each flicker would change as often as the decision.
            sweep.check(
                format!("{name}: changes of the state with noise more than without"),
                are as f64 - were as f64,
                2.0,
            );
        }
        if name == "half of it sticks" {
            let shown = 180.min(frames);
            curves.push((
                "stick ratio below 0.5, frame by frame".to_owned(),
                (0..shown)
                    .map(|n| (n as f64 * 0.016_667, f64::from(u8::from(bare(&noisy[n])))))
                    .collect(),
            ));
            curves.push((
                "state is SLIP (drawn 1.2 higher)".to_owned(),
                (0..shown)
                    .map(|n| {
                        (
                            n as f64 * 0.016_667,
                            1.2 + f64::from(u8::from(noisy[n].state == SlipState::Slip)),
                        )
                    })
                    .collect(),
            ));
        }
    }
    sweep.pictures.push(Picture {
        file: "stress-flicker.png",
        caption: "A contact held with a stick ratio of one half, every component of every frame moved by at most 1/4096 N: the bare decision flickers, the state does not".to_owned(),
        axes: ["time, s", "1 slip, 0 no slip"],
        is_log: [false; 2],
        curves,
    });
    let gain = gain(&settings, effort.of(200_000, 20_000) as i32);
    let max = (i64::from(PER_UNIT) + i64::from(settings.margin)).div_euclid(i64::from(settings.friction)) + 1;
    sweep.check(
        "line, 1/4096 N, that one step of shear moves at most ((1 + margin) / μ rounded up)",
        f64::from(gain),
        max as f64,
    );
    sweep
}

/// The most that one step of total shear moves the settled line.
fn gain(settings: &Configuration, to: i32) -> i32 {
    let settled = |shear: i32| {
        let mut controller = GripController::new(0, None);
        controller.set_mode(GripMode::Hold);
        let evidence = Evidence {
            state: SlipState::Stick,
            stick_ratio: Some(10_000),
            shear,
            has_spare: true,
        };
        controller.observe(evidence, 1_000_000);
        // A second of rise at 100 N/s.
        controller.advance(1_000_000, Guard::Free, settings).lsb()
    };
    let mut last = settled(0);
    (1..to)
        .map(|shear| {
            let line = settled(shear);
            let step = line - last;
            last = line;
            assert!(step >= 0, "more shear is never less grip");
            step
        })
        .max()
        .unwrap_or(0)
}
