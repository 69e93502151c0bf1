//! The whole program through its packets: decisions, grip force, faults, handshake.

use gripline_firmware::constants::DECIDE_BUDGET_CYCLES;
use gripline_firmware::grip::Guard;
use gripline_firmware::line::LineHealth;
use gripline_firmware::storage::Stored;
use gripline_firmware::sums::{TaxelRule, sums_of};
use gripline_firmware::{Fault, Friction, GripForce};
use gripline_firmware::{ResetCause, Start};
use gripline_protocol::message::{
    Command, Configuration, GripMode, Hello, LineSettings, Message, MessagePackets, OutOfRange, Refusal,
    Report, SlipState, Stage,
};
use gripline_protocol::{
    ForceMap, Health, LSB_PER_NEWTON, MapInfo, SensorId, TAXELS, TaxelForce, encode_map,
};
use proptest::prelude::*;

use crate::bench::Bench;

fn newtons(value: f64) -> i32 {
    (value * f64::from(LSB_PER_NEWTON)) as i32
}

/// `contact` taxels of 0.1 N, of which `stick` carry little shear and the others nearly all that friction 0.6 allows.
fn contact_map(contact: usize, stick: usize) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    for (n, taxel) in map.taxels.iter_mut().take(contact).enumerate() {
        *taxel = TaxelForce {
            x: if n < stick { 40 } else { 230 },
            y: 0,
            z: 410,
        };
    }
    map
}

/// The same, but the slipping taxels pull to and fro, so that load and torsional moment of the whole map stay as they are.
fn balanced_map(contact: usize, stick: usize) -> ForceMap {
    let mut map = contact_map(contact, contact);
    for (n, taxel) in map.taxels.iter_mut().take(contact).enumerate().skip(stick) {
        taxel.y = if n % 4 == 0 || n % 4 == 3 { 230 } else { -230 };
    }
    map
}

/// 100 taxels of 0.1 N that all carry this shear, 1/4096 N; friction 0.45 holds 184.
fn pulled_map(shear: i16) -> ForceMap {
    let mut map = contact_map(100, 100);
    for taxel in map.taxels.iter_mut().take(100) {
        taxel.x = shear;
    }
    map
}

#[test]
fn an_empty_a_sticking_and_a_slipping_map_lead_to_their_states() {
    let mut bench = Bench::holding();
    assert_eq!(bench.map(&ForceMap::EMPTY).state, SlipState::NoContact);
    let sticking = bench.map(&contact_map(100, 90));
    assert_eq!(
        (sticking.state, sticking.sums.contact, sticking.sums.stick),
        (SlipState::Stick, 100, 90)
    );
    let slipping = bench.map(&contact_map(100, 49));
    assert_eq!((slipping.state, slipping.sums.stick), (SlipState::Slip, 49));
    assert_eq!(slipping.maps, 3);
}

#[test]
fn fifty_percent_sticking_is_not_below_a_threshold_of_one_half() {
    let mut bench = Bench::holding();
    assert_eq!(bench.map(&contact_map(100, 50)).state, SlipState::Incipient);
    assert_eq!(bench.map(&contact_map(101, 50)).state, SlipState::Slip);
}

#[test]
fn slip_is_left_only_above_the_leave_threshold_and_after_the_dwell_time() {
    let mut bench = Bench::holding();
    assert_eq!(bench.map(&balanced_map(100, 40)).state, SlipState::Slip);
    // Above the threshold but below the leave threshold: still slip, however long.
    assert_eq!(
        bench.maps_for_ms(&balanced_map(100, 55), 400).state,
        SlipState::Slip
    );
    assert_eq!(
        bench.map(&balanced_map(100, 90)).state,
        SlipState::Slip,
        "the dwell time has not passed"
    );
    assert_eq!(
        bench.maps_for_ms(&balanced_map(100, 90), 80).state,
        SlipState::Stick
    );
}

#[test]
fn a_contact_that_is_let_go_sticks_at_once_although_its_ratios_say_slip() {
    let mut bench = Bench::holding();
    assert_eq!(bench.maps_for_ms(&pulled_map(230), 100).state, SlipState::Slip);
    for shear in [212, 200] {
        bench.wait_ms(16);
        let status = bench.map(&pulled_map(shear));
        assert_eq!((status.state, status.sums.stick), (SlipState::Stick, 0));
    }
    // It falls no further: then it slides, only with less friction.
    assert_eq!(bench.maps_for_ms(&pulled_map(200), 200).state, SlipState::Slip);
}

#[test]
fn what_slid_slips_early_when_the_load_turns_back_and_late_when_it_comes_again() {
    for (shear, state) in [(100, SlipState::Stick), (-100, SlipState::Incipient)] {
        let mut bench = Bench::holding();
        bench.maps_for_ms(&pulled_map(100), 300);
        assert_eq!(
            bench.map(&pulled_map(-100)).state,
            SlipState::Stick,
            "nothing slid"
        );
        bench.maps_for_ms(&pulled_map(230), 100);
        for falling in [180, 120, 60, 0] {
            bench.wait_ms(16);
            bench.map(&pulled_map(falling));
        }
        let status = bench.maps_for_ms(&pulled_map(shear), 200);
        assert_eq!((status.state, status.sums.stick), (state, 100));
    }
}

#[test]
fn under_less_than_half_of_what_slid_the_ratios_are_not_believed_unless_hardly_anything_sticks() {
    let mut bench = Bench::holding();
    assert_eq!(bench.map(&balanced_map(100, 44)).state, SlipState::Slip);
    bench.maps_for_ms(&pulled_map(230), 100);
    for falling in [180, 120, 60, 40] {
        bench.wait_ms(16);
        bench.map(&pulled_map(falling));
    }
    assert_eq!(
        bench.maps_for_ms(&balanced_map(100, 14), 400).state,
        SlipState::Stick
    );
    let status = bench.map(&balanced_map(100, 12));
    assert_eq!((status.state, status.sums.stick), (SlipState::Slip, 12));
}

#[test]
fn a_falling_stick_ratio_is_incipient_before_it_is_low() {
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration {
        incipient_horizon_ms: 150,
        ..Configuration::CAREFUL
    }));
    for stick in [99, 98, 99, 98, 99, 98, 96, 94, 92, 90, 87, 83] {
        bench.wait_ms(16);
        bench.map(&contact_map(100, stick));
    }
    let status = bench.status();
    assert_eq!(status.state, SlipState::Stick, "a slow fall is no alarm");
    assert!(status.time_to_slip_ms.is_some());
    for stick in [80, 77, 74, 71] {
        bench.wait_ms(16);
        bench.map(&contact_map(100, stick));
    }
    let status = bench.status();
    assert_eq!(status.state, SlipState::Incipient, "{status:?}");
    // The mean falls by 3 taxels a map of 16 ms: 21 taxels above the threshold are about 112 ms.
    assert!((80..150).contains(&status.time_to_slip_ms.unwrap()), "{status:?}");
}

#[test]
fn the_line_rises_fast_in_slip_and_never_beyond_the_ceiling() {
    let mut bench = Bench::holding();
    bench.maps_for_ms(&contact_map(100, 95), 300);
    let before = bench.device.program.line();
    let after = bench.maps_for_ms(&contact_map(100, 20), 100).line;
    assert!(
        after - before.lsb() > newtons(1.5),
        "rose by {} LSB in 100 ms",
        after - before.lsb()
    );
    let ceiling = Configuration::CAREFUL.ceiling;
    let status = bench.maps_for_ms(&contact_map(100, 20), 4_000);
    assert_eq!(status.line, ceiling);
    assert_ne!(bench.faults() & Fault::LineAtCeiling.bit(), 0);
}

#[test]
fn the_line_follows_shear_with_the_margin() {
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration {
        margin: 2_500,
        ..Configuration::CAREFUL
    }));
    // 100 taxels of 300 LSB shear and 3 N each stick: F_T = 7.32 N, F_T/μ·1.25 = 20.3 N.
    let mut map = ForceMap::EMPTY;
    map.taxels[..100].fill(TaxelForce {
        x: 180,
        y: -240,
        z: 12_288,
    });
    let status = bench.maps_for_ms(&map, 1_000);
    let expected = 30_000_f64 * 1.25 / 0.45;
    assert!(
        (f64::from(status.line) - expected).abs() < 2.0,
        "line {} expected {expected}",
        status.line
    );
}

#[test]
fn the_line_relaxes_by_plan_only_and_only_after_it_stuck_long_enough() {
    for (relax_rate, falls) in [(0, false), (4_096, true)] {
        let mut bench = Bench::holding();
        bench.command(Command::Configure(Configuration {
            relax_rate,
            ..Configuration::CAREFUL
        }));
        let raised = bench.maps_for_ms(&contact_map(100, 20), 150).line;
        let soon = bench.maps_for_ms(&contact_map(100, 95), 300).line;
        assert!(soon >= raised, "fell before the contact had stuck for long");
        let late = bench.maps_for_ms(&contact_map(100, 95), 2_000).line;
        assert_eq!(late < raised, falls);
        assert!(late >= Configuration::CAREFUL.floor);
    }
}

/// A torsional moment, which total shear does not show. The grip force sets the stick ratio, as in a Hertzian contact that
/// needs 4 N.
#[test]
fn the_line_comes_to_rest_however_few_taxels_touch() {
    for taxels in [1, 2, 3, 4, 5, 6, 7, 9, 10, 30] {
        let mut bench = Bench::holding();
        let mut lines = Vec::new();
        for _ in 0..2_400 {
            let share = f64::from(newtons(4.0)) / f64::from(bench.device.program.line().lsb().max(1));
            let stick = ((1.0 - share).max(0.0).powf(2.0 / 3.0) * f64::from(taxels)).round() as i32;
            let mut map = ForceMap::EMPTY;
            for (n, taxel) in (0..).zip(map.taxels.iter_mut().take(taxels as usize)) {
                let x = if n < stick { 0 } else { 700 - 1_400 * (n % 2) };
                *taxel = TaxelForce {
                    x: x as i16,
                    y: 0,
                    z: 1_000,
                };
            }
            bench.map(&map);
            bench.wait_ms(16);
            lines.push(bench.device.program.line());
        }
        let rest = &lines[1_800..];
        assert!(
            rest.iter().all(|line| *line == rest[0]),
            "{taxels} taxels: {} to {}",
            rest[0].lsb(),
            lines[2_399].lsb()
        );
        assert!(
            rest[0].lsb() > newtons(4.0) && rest[0].lsb() < newtons(15.0),
            "{taxels} taxels at {}",
            rest[0].lsb()
        );
    }
}

/// `taxels` in a row that share these forces, 1/4096 N.
fn even_map(taxels: usize, shear: f64, normal: f64) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    map.taxels[..taxels].fill(TaxelForce {
        x: (shear / taxels as f64).round() as i16,
        y: 0,
        z: (normal / taxels as f64).round() as i16,
    });
    map
}

/// An object of this friction whose load comes on in 0.3 s to `load_n`, in a gripper with 80 ms from map to force.
/// Returns the line at the end and how long it slid, frames of 16 ms.
fn loaded(bench: &mut Bench, friction: f64, load_n: f64) -> (f64, usize) {
    let mut lines = [f64::from(Configuration::CAREFUL.floor); 5];
    let mut slid = 0;
    for frame in 0..240 {
        let force = lines[frame % lines.len()];
        let load = f64::from(newtons(load_n)) * ((frame as f64 - 20.0) * 0.016 / 0.3).clamp(0.0, 1.0);
        slid += usize::from(load > friction * force);
        bench.map(&even_map(60, load.min(friction * force), force));
        lines[frame % lines.len()] = f64::from(bench.wait_ms(16).lsb());
    }
    (f64::from(bench.device.program.line().lsb()), slid)
}

#[test]
fn a_contact_that_learns_is_held_by_the_friction_it_proved_and_one_that_may_not_by_the_detectors() {
    for (friction, load_n) in [(0.5, 2.0), (0.7, 3.0), (0.9, 5.0)] {
        let needed = f64::from(newtons(load_n)) / friction;
        let mut bench = Bench::holding();
        bench.command(Command::Configure(Configuration::DEFAULT));
        let (line, slid) = loaded(&mut bench, friction, load_n);
        assert!(
            line > 1.1 * needed && line < 1.55 * needed && slid < 20,
            "friction {friction}: {line} where {needed} are needed, {slid} frames slid"
        );
        let mut bench = Bench::holding();
        bench.command(Command::Configure(Configuration {
            friction_max: 4_500,
            ..Configuration::DEFAULT
        }));
        let (line, _) = loaded(&mut bench, friction, load_n);
        let by_detector = f64::from(newtons(load_n)) / 0.45 * kept();
        assert!(line > 0.99 * by_detector, "{line} expected {by_detector}");
    }
}

#[test]
fn with_the_shipped_settings_a_map_that_demands_more_raises_the_line_before_the_next_tick() {
    for sensors in [1, 2] {
        let used = || SensorId::ALL.into_iter().take(sensors.into());
        for sensor in used() {
            let mut bench = Bench::holding();
            bench.command(Command::Configure(Configuration {
                sensors,
                ..Configuration::DEFAULT
            }));
            // The last packet's part in the rise of the line.
            let send = |bench: &mut Bench, sensor: SensorId, shear_n: f64| {
                bench.sequence += 1;
                let info = MapInfo {
                    sensor,
                    sequence: bench.sequence,
                    capture_us: bench.now_us as u32,
                    ..MapInfo::default()
                };
                let before = bench.device.program.line();
                let actions = bench.map_with(info, &even_map(59, f64::from(newtons(shear_n)), 24_000.0));
                let [.., full, last] = actions[..] else {
                    panic!("a map of 59 taxels has seven packets");
                };
                assert_eq!(full.line, before, "only a whole map moves the line");
                last.line.lsb() - before.lsb()
            };
            for _ in 0..60 {
                for sensor in used() {
                    // The other fingertip needs less.
                    send(&mut bench, sensor, 2.0 - 0.5 * f64::from(sensor.number()));
                }
                bench.wait_ms(16);
            }
            // No more than before, and what may be fluctuation, moves nothing, or hardly.
            assert_eq!(
                send(&mut bench, sensor, 2.0 - 0.5 * f64::from(sensor.number())),
                0
            );
            bench.wait_ms(3);
            bench.now_us += 300;
            let rise = send(&mut bench, sensor, 3.4);
            let max_rise = i32::from(Configuration::DEFAULT.rise_rate);
            assert!(
                (max_rise - 1..=max_rise).contains(&rise),
                "{sensors} {sensor}: {rise}"
            );
            // A millisecond's worth is taken. Another one comes with time, and no sooner.
            assert_eq!(send(&mut bench, sensor, 4.2), 0, "{sensors} {sensor}");
            bench.now_us += 500;
            let rise = send(&mut bench, sensor, 4.2);
            assert!(
                (max_rise / 2 - 1..=max_rise / 2).contains(&rise),
                "{sensors} {sensor}: {rise}"
            );
        }
    }
}

/// The grip that the default settings keep, over the one that is needed.
fn kept() -> f64 {
    1.0 + f64::from(Configuration::DEFAULT.margin) / f64::from(gripline_protocol::PER_UNIT)
}

#[test]
fn what_a_contact_proved_ends_with_it() {
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration::DEFAULT));
    let proof = even_map(60, f64::from(newtons(2.4)), f64::from(newtons(3.0)));
    let load = even_map(60, f64::from(newtons(2.0)), f64::from(newtons(6.0)));
    bench.maps_for_ms(&proof, 100);
    let proven = bench.maps_for_ms(&load, 3_000).line;
    bench.map(&ForceMap::EMPTY);
    bench.wait_ms(16);
    let unproven = bench.maps_for_ms(&load, 3_000).line;
    let by = |friction: f64| 2.0 / friction * kept();
    assert!(
        (newtons(by(0.8) - 0.1)..newtons(by(0.8) + 0.1)).contains(&proven),
        "{proven}"
    );
    assert!(
        (newtons(by(0.45) - 0.1)..newtons(by(0.45) + 0.1)).contains(&unproven),
        "{unproven}"
    );
}

#[test]
fn forces_that_did_not_fit_prove_no_friction() {
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration::DEFAULT));
    // The wire cut the normal force and not the shear: it looks like a friction of 0.8.
    let clipped = even_map(60, f64::from(newtons(2.4)), f64::from(newtons(3.0)));
    let load = even_map(60, f64::from(newtons(2.0)), f64::from(newtons(6.0)));
    for sequence in 1..8 {
        let info = MapInfo {
            sequence,
            capture_us: bench.now_us as u32,
            health: Health::SATURATED,
            ..MapInfo::default()
        };
        assert!(bench.map_with(info, &clipped).last().unwrap().decided);
        bench.wait_ms(16);
    }
    bench.sequence = 8;
    let line = bench.maps_for_ms(&load, 3_000).line;
    assert!(
        f64::from(line) > f64::from(newtons(2.0 / 0.45 * kept() - 0.1)),
        "{line}"
    );
}

#[test]
fn a_torsional_moment_counts_as_the_shear_that_slides_as_soon() {
    // 64 taxels in a square that push crosswise: no shear in sum.
    let turned = |pull: i16| {
        let mut map = ForceMap::EMPTY;
        for row in 6..14 {
            for column in 6..14 {
                map.taxels[row * 20 + column] = TaxelForce {
                    x: if row < 10 { pull } else { -pull },
                    y: 0,
                    z: 600,
                };
            }
        }
        map
    };
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration::DEFAULT));
    let status = bench.maps_for_ms(&turned(200), 2_000);
    assert_eq!(status.sums.force[0], 0);
    // 64 · 200 · 4 half pitches. The pressure's mean square distance is 42 square half pitches, of which a map's blur makes
    // 70/16, and its lever 0.85 of the root of the rest: √(16/22).
    let shear = 64.0 * 200.0 * 4.0 / ((42.0 - 70.0 / 16.0) * 16.0_f64 / 22.0).sqrt();
    let expected = shear / 0.45 * kept();
    assert!(
        (f64::from(status.line) / expected - 1.0).abs() < 0.01,
        "line {} expected {expected}",
        status.line
    );
}

#[test]
fn a_friction_is_expected_while_a_load_comes_on_and_only_then() {
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration::DEFAULT));
    // Under 15 N a shear of 3 N proves a friction of 0.2.
    let load = |share: f64| even_map(60, share * f64::from(newtons(3.0)), f64::from(newtons(15.0)));
    let needs = |friction: f64| newtons(3.0 / friction * kept());
    for step in 1..=12 {
        bench.map(&load(f64::from(step) / 12.0));
        bench.wait_ms(16);
    }
    let coming = bench.device.program.line().lsb();
    assert!(
        (needs(0.65)..needs(0.52)).contains(&coming),
        "{coming} expected {}",
        needs(0.6)
    );
    let rested = bench.maps_for_ms(&load(1.0), 2_000).line;
    assert!(
        (needs(0.455)..needs(0.445)).contains(&rested),
        "{rested} expected {}",
        needs(0.45)
    );
}

#[test]
fn what_maps_hardly_see_proves_no_friction() {
    let load = even_map(60, f64::from(newtons(3.0)), f64::from(newtons(9.0)));
    let by = |friction: f64| 3.0 / friction * kept();
    // A light touch says 0.9 while the gripper presses with 8 N; the same, seen whole, is believed.
    for (light, friction) in [(1.5, 0.45), (6.0, 0.9)] {
        let mut bench = Bench::holding();
        bench.command(Command::Configure(Configuration::DEFAULT));
        bench.maps_for_ms(&load, 1_000);
        let touch = even_map(60, 0.9 * f64::from(newtons(light)), f64::from(newtons(light)));
        bench.maps_for_ms(&touch, 64);
        let line = bench.maps_for_ms(&load, 4_000).line;
        assert!(
            (newtons(by(friction) - 0.1)..newtons(by(friction) + 0.1)).contains(&line),
            "{line} expected {}",
            newtons(by(friction))
        );
    }
}

/// Taxels of which a share sticks by the detector's friction of 0.45, under this shear over the normal force in all.
fn partly_sticking(sticks: usize, ratio: f64, normal: f64) -> ForceMap {
    let mut map = even_map(60, 0.0, normal);
    // Those that slip carry 0.55 of their normal force, the others the rest.
    let slips = 0.55 * (60 - sticks) as f64;
    for (taxel, force) in map.taxels.iter_mut().take(60).enumerate() {
        let share = if taxel < sticks {
            (60.0 * ratio - slips) / sticks as f64
        } else {
            0.55
        };
        force.x = (share * normal / 60.0).round() as i16;
    }
    map
}

#[test]
fn a_contact_that_half_sticks_slides_when_its_load_stalls_and_one_that_sticks_does_not() {
    let normal = f64::from(newtons(4.0));
    let line_after = |sticks: usize| {
        let mut bench = Bench::holding();
        bench.command(Command::Configure(Configuration::DEFAULT));
        // The load comes on in 0.2 s, and stands at 0.45 of the normal force.
        for step in 1..=12 {
            bench.map(&even_map(60, f64::from(step) / 12.0 * 0.44 * normal, normal));
            bench.wait_ms(16);
        }
        bench.maps_for_ms(&partly_sticking(sticks, 0.45, normal), 64);
        f64::from(bench.device.program.line().lsb())
    };
    let [half, full] = [line_after(30), line_after(48)];
    assert!(
        half > 1.25 * full,
        "{half} where half stick, {full} where most do"
    );
}

#[test]
fn a_load_that_comes_slowly_after_a_rest_is_no_slide_though_only_half_sticks() {
    let normal = f64::from(newtons(4.0));
    let line_after = |sticks: usize| {
        let mut bench = Bench::holding();
        bench.command(Command::Configure(Configuration::DEFAULT));
        bench.maps_for_ms(&even_map(60, 0.3 * normal, normal), 500);
        for step in 0..60 {
            bench.map(&partly_sticking(sticks, 0.3 + 0.0025 * f64::from(step), normal));
            bench.wait_ms(16);
        }
        f64::from(bench.device.program.line().lsb())
    };
    let [half, full] = [line_after(30), line_after(48)];
    assert!(half < 1.1 * full, "{half} where half stick, {full} where most do");
}

#[test]
fn a_contact_of_which_nothing_sticks_slides_from_seven_eighths_of_its_friction_on() {
    let normal = f64::from(newtons(6.0));
    let load = |ratio: f64| even_map(60, ratio * normal, normal);
    let line_over_load = |ratio: f64| {
        let mut bench = Bench::holding();
        bench.command(Command::Configure(Configuration::DEFAULT));
        bench.maps_for_ms(&load(0.6), 400);
        // So slowly that nothing falls suddenly: the slide witness would test that.
        for step in 0..240 {
            bench.map(&load(0.6 + (ratio - 0.6) * f64::from(step) / 240.0));
            bench.wait_ms(16);
        }
        f64::from(bench.maps_for_ms(&load(ratio), 1_500).line) / ratio
    };
    let [slides, holds] = [0.54, 0.51].map(line_over_load);
    assert!(
        slides > 1.4 * holds,
        "{slides} at 0.90 of friction, {holds} at 0.85"
    );
}

#[test]
fn a_touch_too_light_to_be_felt_is_closed_upon_by_a_newton_at_most() {
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration::DEFAULT));
    let floor = Configuration::DEFAULT.floor;
    assert_eq!(
        bench.maps_for_ms(&ForceMap::EMPTY, 2_000).line,
        floor + newtons(1.0)
    );
    // Felt as it should be, it falls back to the floor.
    let felt = even_map(30, 0.0, f64::from(floor));
    assert_eq!(bench.maps_for_ms(&felt, 4_000).line, floor);
    // Without maps nothing closes any further.
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration::DEFAULT));
    bench.map(&ForceMap::EMPTY);
    assert!(bench.wait_ms(400).lsb() < floor + newtons(1.0));
}

#[test]
fn release_lets_go_slowly_and_hold_closes_to_the_floor() {
    let mut bench = Bench::holding();
    assert_eq!(bench.wait_ms(80).lsb(), Configuration::CAREFUL.floor);
    bench.command(Command::Release);
    let after_10_ms = bench.wait_ms(10).lsb();
    assert!(
        (3_200..3_300).contains(&after_10_ms),
        "20 N/s for 10 ms leaves 3,276, found {after_10_ms}"
    );
    assert_eq!(bench.wait_ms(100), GripForce::ZERO);
    assert_eq!(bench.device.program.status().mode, GripMode::Released);
}

#[test]
fn nothing_is_commanded_before_the_handshake() {
    let mut bench = Bench::cold();
    bench.command(Command::Hold);
    assert_eq!(bench.reports, [Report::Refused(Refusal::NoHandshake)]);
    assert_eq!(bench.wait_ms(200), GripForce::ZERO);
    // Maps are judged anyway, so that a listener sees what the fingertip feels.
    assert_eq!(bench.map(&contact_map(100, 10)).state, SlipState::Slip);
}

#[test]
fn a_host_with_another_schema_is_told_ours_and_refused() {
    let mut bench = Bench::cold();
    let stranger = Hello {
        schema_version: 99,
        ..Hello::of_this_build(0, 1)
    };
    bench.message(Message::Hello(stranger));
    assert_eq!(bench.hellos, [Hello::of_this_build(1, 5)]);
    assert_ne!(bench.faults() & Fault::SchemaMismatch.bit(), 0);
    bench.command(Command::Hold);
    assert_eq!(bench.reports, [Report::Refused(Refusal::NoHandshake)]);
}

#[test]
fn a_setting_out_of_range_is_named_and_changes_nothing() {
    let mut bench = Bench::holding();
    let before = *bench.device.program.settings();
    bench.command(Command::Configure(Configuration {
        slip_threshold: 10_001,
        ..before
    }));
    let refusal = OutOfRange {
        field: 4,
        found: 10_001,
        min: 0,
        max: 10_000,
    };
    assert_eq!(bench.reports, [Report::Refused(Refusal::OutOfRange(refusal))]);
    assert_eq!(*bench.device.program.settings(), before);
    assert_ne!(bench.faults() & Fault::OutOfRange.bit(), 0);
}

#[test]
fn a_corrupted_map_changes_nothing_and_the_next_one_is_accepted() {
    let mut bench = Bench::holding();
    let before = bench.map(&contact_map(100, 90));
    let mut packets = Vec::new();
    let info = MapInfo {
        sequence: 2,
        ..MapInfo::default()
    };
    encode_map(&info, &contact_map(100, 10), |packet| {
        packets.push(packet.to_vec());
    });
    packets[3][20] ^= 0x10;
    for packet in &packets {
        assert!(!bench.device.packet(packet, bench.now_us).decided);
    }
    let after = bench.device.program.status();
    assert_eq!(
        (after.sums, after.state, after.sequence),
        (before.sums, before.state, before.sequence)
    );
    assert_eq!((after.maps_refused, after.packets_refused), (1, 1));
    bench.sequence = 2;
    assert_eq!(bench.map(&contact_map(100, 80)).sums.stick, 80);
}

#[test]
fn a_replayed_map_is_a_fault_and_changes_nothing() {
    let mut bench = Bench::holding();
    let before = bench.map(&contact_map(100, 90));
    let info = MapInfo {
        sequence: before.sequence,
        ..MapInfo::default()
    };
    assert!(
        bench
            .map_with(info, &contact_map(100, 10))
            .iter()
            .all(|action| !action.decided)
    );
    assert_ne!(bench.faults() & Fault::ReplayedMap.bit(), 0);
    assert_eq!(bench.device.program.status().sums, before.sums);
    bench.map(&contact_map(100, 90));
    assert_eq!(bench.faults() & Fault::ReplayedMap.bit(), 0);
}

#[test]
fn a_host_that_restarts_may_count_from_anywhere() {
    let mut bench = Bench::holding();
    bench.sequence = 1_000_000;
    bench.map(&contact_map(10, 10));
    bench.message(Message::Hello(Hello::of_this_build(0, 2)));
    bench.sequence = 0;
    bench.map(&contact_map(10, 10));
    assert_eq!(
        bench.faults() & (Fault::ReplayedMap.bit() | Fault::MapsLost.bit()),
        0
    );
}

#[test]
fn missing_maps_are_noticed() {
    let mut bench = Bench::holding();
    bench.map(&contact_map(10, 10));
    bench.sequence += 1;
    bench.map(&contact_map(10, 10));
    assert_ne!(bench.faults() & Fault::MapsLost.bit(), 0);
    bench.map(&contact_map(10, 10));
    assert_eq!(bench.faults() & Fault::MapsLost.bit(), 0);
}

#[test]
fn stale_maps_hold_the_line_and_a_lost_link_tightens_it_until_acknowledged() {
    let mut bench = Bench::holding();
    let held = bench.maps_for_ms(&contact_map(100, 95), 500).line;
    let stale = bench.wait_ms(u64::from(Configuration::CAREFUL.stale_ms) + 2);
    assert_ne!(bench.faults() & Fault::StaleMaps.bit(), 0);
    assert_eq!(stale.lsb(), held);
    let tightened = bench.wait_ms(1_000);
    assert_ne!(bench.faults() & Fault::LinkLost.bit(), 0);
    assert_eq!(tightened.lsb(), Configuration::CAREFUL.fail_safe);
    // The host is back: maps are judged again, but the line stays up until a person has looked.
    let back = bench.maps_for_ms(&contact_map(100, 95), 3_000);
    assert_eq!(
        (back.faults, back.latched, back.line),
        (0, Fault::LinkLost.bit(), Configuration::CAREFUL.fail_safe)
    );
    bench.command(Command::Release);
    assert_eq!(bench.reports.last(), Some(&Report::Refused(Refusal::Latched)));
    bench.command(Command::Acknowledge {
        faults: Fault::LinkLost.bit(),
    });
    let relaxed = bench.maps_for_ms(&contact_map(100, 95), 3_000);
    assert!(relaxed.line < Configuration::CAREFUL.fail_safe);
}

#[test]
fn a_slip_that_is_long_past_squeezes_no_further() {
    let mut bench = Bench::holding();
    bench.maps_for_ms(&contact_map(100, 95), 300);
    let slipping = bench.map(&contact_map(100, 20)).line;
    // The reflex stops at `stale_ms`; the line still comes up to what was decided by then (100 N/s).
    let settled = bench.wait_ms(250).lsb();
    assert!(settled > slipping, "fresh evidence of slip raises the line");
    assert!(settled < Configuration::CAREFUL.ceiling);
    assert_eq!(bench.wait_ms(200).lsb(), settled, "stale maps hold the line");
}

#[test]
fn a_storm_of_bad_packets_is_a_latched_fault_that_holds_the_line() {
    let mut bench = Bench::holding();
    bench.maps_for_ms(&contact_map(100, 95), 200);
    for _ in 0..10 {
        let _ = bench.device.packet(&[0xFF; 64], bench.now_us);
    }
    assert_ne!(bench.faults() & Fault::CrcStorm.bit(), 0);
    bench.maps_for_ms(&contact_map(100, 95), 400);
    let status = bench.device.program.status();
    assert_eq!(
        (status.faults & Fault::CrcStorm.bit(), status.latched),
        (0, Fault::CrcStorm.bit())
    );
}

#[test]
fn a_doubtful_picture_may_raise_the_line_but_not_lower_it() {
    let mut bench = Bench::holding();
    let mut line = bench.maps_for_ms(&contact_map(100, 30), 200).line;
    for _ in 0..200 {
        bench.wait_ms(16);
        bench.sequence += 1;
        let info = MapInfo {
            sequence: bench.sequence,
            health: Health::TOO_DARK,
            ..MapInfo::default()
        };
        bench.map_with(info, &contact_map(100, 100));
        assert!(bench.device.program.line().lsb() >= line);
        line = bench.device.program.line().lsb();
    }
    assert_ne!(bench.faults() & Fault::UnhealthyMap.bit(), 0);
}

#[test]
fn a_saturated_map_holds_the_line_under_its_own_name() {
    let mut bench = Bench::holding();
    let mut line = bench.maps_for_ms(&contact_map(100, 30), 200).line;
    for _ in 0..200 {
        bench.wait_ms(16);
        bench.sequence += 1;
        let info = MapInfo {
            sequence: bench.sequence,
            capture_us: bench.now_us as u32,
            health: Health::SATURATED,
            ..MapInfo::default()
        };
        bench.map_with(info, &contact_map(100, 100));
        assert!(bench.device.program.line().lsb() >= line);
        line = bench.device.program.line().lsb();
    }
    assert_eq!(
        bench.faults() & (Fault::SaturatedMap.bit() | Fault::UnhealthyMap.bit()),
        Fault::SaturatedMap.bit()
    );
}

#[test]
fn a_map_from_the_future_is_refused_until_the_next_believable_one_or_a_new_handshake() {
    let mut bench = Bench::holding();
    let before = bench.map(&contact_map(100, 90));
    let info = |bench: &mut Bench, ahead_us: u32| {
        bench.wait_ms(16);
        bench.sequence += 1;
        MapInfo {
            sequence: bench.sequence,
            capture_us: (bench.now_us as u32).wrapping_add(ahead_us),
            ..MapInfo::default()
        }
    };
    let future = info(&mut bench, 5_000_000);
    bench.map_with(future, &contact_map(100, 10));
    assert_ne!(bench.faults() & Fault::FutureMap.bit(), 0);
    let status = bench.device.program.status();
    assert_eq!((status.sums, status.maps_refused), (before.sums, 1));
    bench.map(&contact_map(100, 90));
    assert_eq!(bench.faults() & Fault::FutureMap.bit(), 0);
    // The host's clock was set: only a host that says who it is may bring another one.
    let future = info(&mut bench, 5_000_000);
    bench.map_with(future, &contact_map(100, 10));
    bench.message(Message::Hello(Hello::of_this_build(0, 2)));
    assert_eq!(bench.faults() & Fault::FutureMap.bit(), 0);
    let future = info(&mut bench, 5_000_000);
    bench.map_with(future, &contact_map(100, 80));
    assert_eq!(bench.device.program.status().sums.stick, 80);
}

#[test]
fn maps_that_are_old_when_they_come_are_stale_although_they_come_often() {
    let mut bench = Bench::holding();
    bench.maps_for_ms(&contact_map(100, 95), 300);
    let late_us = u32::from(Configuration::CAREFUL.stale_ms) * 1_000 + 5_000;
    for _ in 0..5 {
        bench.wait_ms(16);
        bench.sequence += 1;
        let info = MapInfo {
            sequence: bench.sequence,
            capture_us: (bench.now_us as u32).wrapping_sub(late_us),
            ..MapInfo::default()
        };
        bench.map_with(info, &contact_map(100, 95));
    }
    bench.wait_ms(1);
    assert_ne!(bench.faults() & Fault::StaleMaps.bit(), 0);
    bench.maps_for_ms(&contact_map(100, 95), 16);
    assert_eq!(bench.faults() & Fault::StaleMaps.bit(), 0);
}

#[test]
fn messages_that_cannot_be_read_prove_no_host() {
    let mut bench = Bench::holding();
    for _ in 0..600 {
        // A right CRC around a class that does not exist: as a host of a broken build would send it.
        let mut packets = MessagePackets::new(&Message::Command(Command::Hold), 1).unwrap();
        let mut packet = packets.next().unwrap();
        packet[6] = 9;
        let end = packet.len() - 4;
        let crc = gripline_protocol::crc::crc32(packet[..end].iter().copied());
        packet[end..].copy_from_slice(&crc.to_le_bytes());
        let _ = bench.device.packet(&packet, bench.now_us);
        bench.wait_ms(1);
    }
    let expected = Fault::UnreadableMessage.bit() | Fault::LinkLost.bit() | Fault::StaleMaps.bit();
    assert_eq!(bench.faults(), expected);
    let refused = |report: &&Report| **report == Report::Refused(Refusal::Unreadable);
    assert_eq!(bench.reports.iter().filter(refused).count(), 600);
}

#[test]
fn settings_are_stored_only_with_an_open_gripper() {
    let mut bench = Bench::holding();
    bench.wait_ms(50);
    bench.command(Command::Store);
    assert_eq!(bench.reports.last(), Some(&Report::Refused(Refusal::Holding)));
    assert_eq!(bench.device.program.take_store(), None);
    bench.command(Command::Release);
    bench.command(Command::Store);
    assert_eq!(
        bench.reports.last(),
        Some(&Report::Refused(Refusal::Holding)),
        "the line is still on its way down"
    );
    bench.wait_ms(200);
    bench.command(Command::Store);
    assert_eq!(bench.device.program.take_store(), Some(Configuration::CAREFUL));
    assert_eq!(bench.device.program.take_store(), None, "once");
    bench.device.program.stored(Some(3));
    bench.listen();
    assert_eq!(bench.reports.last(), Some(&Report::Stored { writes: 3 }));
    // Who holds between the order and its turn is not stopped for it.
    bench.command(Command::Store);
    bench.command(Command::Hold);
    assert_eq!(bench.device.program.take_store(), None);
    bench.listen();
    assert_eq!(bench.reports.last(), Some(&Report::Refused(Refusal::Holding)));
}

#[test]
fn a_release_is_told_to_the_line_once_also_when_nothing_is_held_and_never_when_it_is_refused() {
    let mut bench = Bench::cold();
    bench.message(Message::Hello(Hello::of_this_build(0, 1)));
    assert!(!bench.device.program.take_release(), "a start is no release");
    bench.command(Command::Release);
    assert!(bench.device.program.take_release());
    assert!(!bench.device.program.take_release(), "once");
    bench.device.program.inhibit_release(true);
    bench.command(Command::Release);
    assert!(!bench.device.program.take_release(), "the robot forbids it");
}

#[test]
fn another_line_table_that_was_stored_comes_into_force_only_at_a_start_with_nothing_held() {
    let before = LineSettings::DEFAULT;
    let mut after = before;
    after.points[4].code = 4_000;
    let stored = Stored {
        settings: Some(Configuration {
            line: after,
            ..Configuration::DEFAULT
        }),
        ..Stored::default()
    };
    let start = |restored_line, line_before| Start {
        restored_line,
        line_before,
        stored,
        ..Start::default()
    };
    let (held, open) = (GripForce::from_lsb(1), GripForce::ZERO);
    assert_eq!(*start(Some(held), Some(before)).line(), before);
    assert_eq!(*start(Some(open), Some(before)).line(), after);
    assert_eq!(*start(None, Some(before)).line(), after);
    assert_eq!(*start(Some(held), None).line(), after);
    assert_eq!(
        Bench::starting(start(Some(held), Some(before)))
            .device
            .program
            .settings()
            .line,
        after,
        "the next start has them"
    );
}

#[test]
fn a_start_with_stored_settings_has_them_in_force_and_one_with_lost_settings_tells_it() {
    let stored = Stored {
        settings: Some(Configuration {
            friction: 3_000,
            ..Configuration::CAREFUL
        }),
        lost: false,
        writes: 1,
    };
    let bench = Bench::starting(Start {
        stored,
        ..Start::default()
    });
    assert_eq!(bench.device.program.settings().friction, 3_000);
    assert_eq!(bench.faults(), 0);
    let mut bench = Bench::starting(Start {
        stored: Stored {
            lost: true,
            ..Stored::default()
        },
        ..Start::default()
    });
    assert_eq!(*bench.device.program.settings(), Configuration::DEFAULT);
    assert_eq!(bench.device.program.status().latched, Fault::SettingsLost.bit());
    // New settings end the fault; a person acknowledges it.
    bench.message(Message::Hello(Hello::of_this_build(0, 1)));
    bench.command(Command::Configure(Configuration::CAREFUL));
    bench.command(Command::Acknowledge {
        faults: Fault::SettingsLost.bit(),
    });
    assert_eq!((bench.faults(), bench.device.program.status().latched), (0, 0));
}

#[test]
fn a_map_that_takes_longer_than_its_bound_is_reported_and_held_against_nothing() {
    let mut bench = Bench::holding();
    let held = bench.maps_for_ms(&contact_map(100, 95), 300).line;
    bench.device.program.note_map_to_line(DECIDE_BUDGET_CYCLES);
    assert_eq!(bench.faults(), 0, "the bound itself is kept");
    bench.device.program.note_map_to_line(DECIDE_BUDGET_CYCLES + 1);
    let late = bench.map(&contact_map(100, 95));
    assert_eq!((late.faults, late.latched), (Fault::DeadlineMissed.bit(), 0));
    assert_eq!(late.line, held);
    bench.device.program.note_map_to_line(DECIDE_BUDGET_CYCLES);
    assert_eq!(bench.faults(), 0);
    bench
        .device
        .program
        .note_cycles(Stage::Decide, DECIDE_BUDGET_CYCLES + 1);
    bench
        .device
        .program
        .note_cycles(Stage::Decide, DECIDE_BUDGET_CYCLES);
    assert_eq!(
        bench.device.program.status().worst_cycles[Stage::Decide as usize],
        DECIDE_BUDGET_CYCLES + 1,
        "the worst stays to be seen"
    );
}

#[test]
fn after_a_watchdog_reset_the_line_is_the_old_one_until_a_person_has_looked() {
    let old = GripForce::from_lsb(newtons(7.0));
    let start = Start {
        now_us: 9_000,
        reset: ResetCause::Watchdog,
        restored_line: Some(old),
        ..Start::default()
    };
    let mut bench = Bench::starting(start);
    assert_eq!(bench.device.program.line(), old);
    assert_eq!(bench.device.program.status().latched, Fault::WatchdogReset.bit());
    assert!(bench.wait_ms(3_000) >= old);
}

#[test]
fn a_restored_line_beyond_every_gripper_becomes_the_greatest_and_does_not_wrap() {
    for kept in [newtons(125.0) + 1, 4_294_968, i32::MAX] {
        let bench = Bench::starting(Start {
            reset: ResetCause::Watchdog,
            restored_line: Some(GripForce::from_lsb(kept)),
            ..Start::default()
        });
        assert_eq!(bench.device.program.line().lsb(), newtons(125.0), "{kept}");
    }
}

#[test]
fn a_host_that_was_silent_for_twenty_minutes_need_not_shake_hands_again() {
    let mut bench = Bench::holding();
    bench.maps_for_ms(&contact_map(100, 95), 200);
    bench.now_us += 20 * 60_000_000;
    let _ = bench.device.tick(bench.now_us);
    // `map` wants every map accepted.
    let status = bench.maps_for_ms(&contact_map(100, 95), 200);
    assert_eq!(status.faults & Fault::FutureMap.bit(), 0);
}

#[test]
fn two_fingertips_are_judged_by_the_worse_one() {
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration {
        sensors: 2,
        ..Configuration::CAREFUL
    }));
    bench.map(&contact_map(100, 95));
    let info = MapInfo {
        sensor: SensorId::SECOND,
        sequence: 77,
        ..MapInfo::default()
    };
    bench.map_with(info, &contact_map(50, 5));
    let status = bench.status();
    assert_eq!(
        (status.state, status.sensor, status.sums.contact),
        (SlipState::Slip, SensorId::SECOND, 50)
    );
    // One of two that falls silent is stale, although the other speaks.
    bench.maps_for_ms(&contact_map(100, 95), 200);
    assert_ne!(bench.faults() & Fault::StaleMaps.bit(), 0);
}

#[test]
fn a_fingertip_that_fell_silent_in_slip_squeezes_no_further_while_the_other_speaks() {
    let mut bench = Bench::holding();
    bench.command(Command::Configure(Configuration {
        sensors: 2,
        ..Configuration::CAREFUL
    }));
    let silent = MapInfo {
        sensor: SensorId::SECOND,
        sequence: 1,
        ..MapInfo::default()
    };
    bench.map_with(silent, &contact_map(20, 4));
    let settled = bench.maps_for_ms(&contact_map(20, 20), 300);
    assert_ne!(settled.faults & Fault::StaleMaps.bit(), 0);
    assert!(settled.line > Configuration::CAREFUL.floor && settled.line < Configuration::CAREFUL.ceiling);
    assert_eq!(bench.maps_for_ms(&contact_map(20, 20), 500).line, settled.line);
}

fn any_bytes() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        proptest::collection::vec(any::<u8>(), 0..70),
        (
            0..4_u8,
            0..2_u8,
            any::<u8>(),
            0..42_u8,
            proptest::collection::vec(any::<u8>(), 0..61)
        )
            .prop_map(|(kind, owner, sequence, index, payload)| {
                let mut packet = vec![1 << 4 | kind, owner, sequence, index];
                packet.extend(payload);
                packet
            }),
    ]
}

proptest! {
    /// Packet by packet and all at once must be the same, whatever the map.
    #[test]
    fn incremental_sums_equal_batch_sums(
        taxels in proptest::collection::vec(proptest::option::of(any::<[i16; 3]>()), TAXELS),
        friction in 0..=20_000_u16,
        contact_min in 0..=2_000_i16,
    ) {
        let mut map = ForceMap::EMPTY;
        for (taxel, [x, y, z]) in map.taxels.iter_mut().zip(taxels.into_iter().map(Option::unwrap_or_default)) {
            *taxel = TaxelForce { x, y, z };
        }
        let mut bench = Bench::holding();
        bench.command(Command::Configure(Configuration { friction, contact_min, ..Configuration::CAREFUL }));
        let rule = TaxelRule { friction: Friction::from_per_unit(friction).unwrap(), contact_min };
        let status = bench.map(&map);
        prop_assert_eq!(status.sums, sums_of(&map, rule));
        let [x, y, normal] = status.sums.force;
        prop_assert_eq!(status.coulomb_slip, rule.friction.exceeded_by([x, y], normal));
    }

    /// Whatever arrives: no panic, and while holding the line stays between floor and ceiling once it got there.
    #[test]
    fn any_bytes_leave_the_line_where_safety_allows(packets in proptest::collection::vec((any_bytes(), 0..30_u64), 0..60)) {
        let mut bench = Bench::holding();
        bench.maps_for_ms(&contact_map(100, 95), 200);
        let mut line = bench.device.program.line();
        for (packet, ms) in packets {
            let _ = bench.device.packet(&packet, bench.now_us);
            let now = bench.wait_ms(ms);
            prop_assert!(now >= line, "the line fell from {line:?} to {now:?}");
            prop_assert!(now.lsb() >= Configuration::CAREFUL.floor && now.lsb() <= Configuration::CAREFUL.ceiling);
            line = now;
        }
    }
}

#[test]
fn a_line_that_fails_is_a_fault_that_holds_ends_with_it_and_lets_a_person_release() {
    let mut bench = Bench::cold();
    bench.message(Message::Hello(Hello::of_this_build(0, 1)));
    bench.device.program.note_line(LineHealth::Starting);
    assert_eq!(
        bench.faults() & Fault::LineFailed.bit(),
        0,
        "nothing is to be held yet"
    );
    bench.command(Command::Hold);
    bench.wait_ms(100);
    for health in LineHealth::ALL {
        bench.device.program.note_line(health);
        let expected = !matches!(health, LineHealth::Good | LineHealth::ObjectLost);
        assert_eq!(
            bench.faults() & Fault::LineFailed.bit() != 0,
            expected,
            "{health:?}"
        );
    }
    assert_eq!(Fault::LineFailed.guard(), Guard::Hold);
    bench.command(Command::Release);
    let refused = bench
        .reports
        .iter()
        .any(|report| matches!(report, Report::Refused(_)));
    assert!(!refused, "{:?}", bench.reports);
    bench.wait_ms(2_000);
    assert_eq!(bench.device.program.line(), GripForce::ZERO);
    bench.device.program.note_line(LineHealth::Good);
    assert_eq!(bench.faults() & Fault::LineFailed.bit(), 0);
}

/// As a timer's overflow that is counted wrongly makes a clock: 65.536 ms off for one reading. It happened on the emulated
/// board, once in a quarter of an hour of random faults.
#[test]
fn a_clock_that_leaps_for_a_moment_lets_the_line_fall_by_no_more_than_a_frames_worth() {
    let mut bench = Bench::holding();
    let mut sticking = ForceMap::EMPTY;
    for taxel in &mut sticking.taxels[100..160] {
        *taxel = TaxelForce {
            x: 400,
            y: 0,
            z: 1_000,
        };
    }
    for _ in 0..20 {
        bench.map(&sticking);
        for _ in 0..16 {
            bench.now_us += 1_000;
            let _ = bench.device.tick(bench.now_us);
        }
    }
    // Less shear: the plan lets the line fall.
    for taxel in &mut sticking.taxels[100..160] {
        taxel.x = 100;
    }
    let mut falls = 0;
    for ms in 0..3_000 {
        if ms % 16 == 0 {
            bench.map(&sticking);
        }
        let before = bench.device.program.line().lsb();
        bench.now_us += 1_000;
        let stamp_us = match ms % 200 {
            99 => bench.now_us - 65_536,
            199 => bench.now_us + 65_536,
            _ => bench.now_us,
        };
        let line = bench.device.tick(stamp_us).line.lsb();
        // 4,096 a second, so 82 in 20 ms.
        let max_fall = if ms % 100 == 99 || ms % 100 == 0 { 83 } else { 5 };
        assert!(before - line <= max_fall, "{before} to {line} after {ms} ms");
        falls += before - line;
        assert_eq!(bench.status().faults, 0, "after {ms} ms");
    }
    assert!(falls > 4_096, "the line fell by {falls} only");
}
