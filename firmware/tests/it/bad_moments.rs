//! Bad moments in the middle of a good hold: the picture after the black one, the map after the lost packet, the same command again.

use gripline_firmware::{Fault, LinkId};
use gripline_protocol::message::{
    Command, Configuration, GripMode, Hello, Message, MessagePackets, SlipState,
};
use gripline_protocol::{ForceMap, Health, MapInfo, SensorId, encode_map};

use crate::bench::Bench;
use crate::grasp_world::contact_map;

/// A quiet hold of 1.6 N with the shipped settings, except for these.
fn quiet_hold(settings: &Configuration) -> Bench {
    let mut bench = Bench::cold();
    bench.message(Message::Hello(Hello::of_this_build(0, 1)));
    bench.command(Command::Configure(*settings));
    bench.command(Command::Hold);
    for step in 0..60 {
        bench.map(&held(1.6 * f64::from(step) / 60.0));
        bench.wait_ms(16);
    }
    bench.maps_for_ms(&held(1.6), 2_000);
    bench
}

/// A contact that carries this shear under 5 N, N.
fn held(shear: f64) -> ForceMap {
    contact_map(5.0, shear, 5.0, shear, 0.8, false)
}

impl Bench {
    /// A map with this health, captured `late_us` ago.
    fn odd_map(&mut self, sensor: SensorId, map: &ForceMap, health: Health, late_us: u64) {
        self.sequence += 1;
        let info = MapInfo {
            sensor,
            sequence: self.sequence,
            capture_us: (self.now_us - late_us) as u32,
            health,
            ..MapInfo::default()
        };
        assert!(self.map_with(info, map).last().unwrap().decided);
    }

    /// The packets of a map that is sent now.
    fn packets(&mut self, map: &ForceMap) -> Vec<Vec<u8>> {
        self.sequence += 1;
        let info = MapInfo {
            sequence: self.sequence,
            capture_us: self.now_us as u32,
            ..MapInfo::default()
        };
        let mut packets = Vec::new();
        encode_map(&info, map, |packet| packets.push(packet.to_vec()));
        packets
    }

    fn line(&self) -> i32 {
        self.device.program.line().lsb()
    }
}

#[test]
fn a_board_that_writes_the_ticks_line_later_writes_that_of_a_map_that_came_meanwhile() {
    let mut bench = quiet_hold(&Configuration::CAREFUL);
    for step in 1..=60 {
        bench.wait_ms(16);
        let _ = bench.device.tick(bench.now_us);
        let shear = 1.6 + 0.01 * f64::from(step % 30);
        let packets = bench.packets(&held(shear));
        // The map ends between the part of the tick that moves the line and the one that writes it.
        let mapped = packets
            .iter()
            .map(|packet| bench.device.packet(packet, bench.now_us + 500).line)
            .last()
            .unwrap();
        assert_eq!(bench.device.program.line(), mapped, "map {step}");
    }
}

#[test]
fn an_empty_doubtful_map_ends_no_contact_and_forgets_no_friction() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    let (line, state) = (bench.line(), bench.device.program.state());
    for black in 0..300 {
        bench.odd_map(SensorId::FIRST, &ForceMap::EMPTY, Health::TOO_DARK, 0);
        bench.wait_ms(16);
        assert_ne!(state, SlipState::NoContact);
        assert_eq!(
            bench.device.program.state(),
            state,
            "after {black} black pictures"
        );
        assert!(
            bench.line() >= line,
            "after {black} black pictures the line fell to {}",
            bench.line()
        );
    }
    let after = bench.maps_for_ms(&held(1.6), 1_000).line;
    assert!(
        (line - line / 50..line + line / 50).contains(&after),
        "{line} became {after}"
    );
}

#[test]
fn a_doubtful_map_teaches_no_friction() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    let line = bench.line();
    // It says that friction 0.96 is proven.
    for _ in 0..60 {
        bench.odd_map(SensorId::FIRST, &held(4.8), Health::UNLIKE_TRAINING, 0);
        bench.wait_ms(16);
    }
    let after = bench.maps_for_ms(&held(1.6), 4_000).line;
    assert!(after >= line - line / 50, "{line} became {after}");
}

#[test]
fn maps_that_come_late_still_raise_the_line() {
    for settings in [Configuration::CAREFUL, Configuration::DEFAULT] {
        let mut bench = quiet_hold(&settings);
        let line = bench.line();
        let late_us = 2_000 * u64::from(settings.stale_ms);
        for _ in 0..30 {
            bench.odd_map(SensorId::FIRST, &held(3.6), Health::GOOD, late_us);
            bench.wait_ms(16);
        }
        assert_ne!(bench.faults() & Fault::StaleMaps.bit(), 0);
        assert!(bench.line() > line + line / 4, "{line} became {}", bench.line());
    }
}

#[test]
fn a_lost_packet_breaks_one_map_and_is_no_storm() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    // Dense: 40 packets.
    let mut dense = held(1.6);
    for taxel in &mut dense.taxels {
        taxel.z = taxel.z.max(1);
    }
    for lost in [1, 20] {
        for (place, packet) in bench.packets(&dense).iter().enumerate() {
            if place != lost {
                let _ = bench.device.packet(packet, bench.now_us);
            }
        }
        bench.wait_ms(16);
        assert_eq!(bench.faults() & Fault::CrcStorm.bit(), 0, "packet {lost} lost");
    }
    // Nothing but broken maps is a storm.
    for _ in 0..6 {
        for packet in bench.packets(&dense).iter().skip(1) {
            let _ = bench.device.packet(packet, bench.now_us);
        }
        bench.wait_ms(16);
    }
    assert_ne!(bench.faults() & Fault::CrcStorm.bit(), 0);
}

#[test]
fn a_bad_byte_on_one_link_leaves_the_other_links_map_alone() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    let packets = bench.packets(&held(1.6));
    let mut decided = false;
    for packet in &packets {
        bench.device.malformed_frame(LinkId::Uart);
        let _ = bench.device.packet_from(LinkId::Uart, &[0xFF; 20], bench.now_us);
        decided |= bench.device.packet(packet, bench.now_us).decided;
        bench.wait_ms(20);
    }
    assert!(decided, "the map over USB was lost");
}

#[test]
fn maps_of_one_link_count_at_a_time_and_the_other_link_takes_over_when_they_are_stale() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    let over = |bench: &mut Bench, link: LinkId, shear_n: f64| {
        let packets = bench.packets(&held(shear_n));
        let actions = packets
            .iter()
            .map(|packet| bench.device.packet_from(link, packet, bench.now_us));
        actions.filter(|action| action.decided).count()
    };
    let (line, refused) = (bench.line(), bench.device.program.status().maps_refused);
    // Every other packet is one of the other link: those of the first are taken as if they were alone.
    let (first, second) = (bench.packets(&held(1.6)), bench.packets(&held(6.0)));
    let mut decided = 0;
    for (one, other) in first.iter().zip(second.iter().cycle()) {
        decided += u32::from(
            bench
                .device
                .packet_from(LinkId::Uart, other, bench.now_us)
                .decided,
        );
        decided += u32::from(bench.device.packet(one, bench.now_us).decided);
    }
    assert_eq!(decided, 1);
    assert!(bench.line() <= line + line / 50, "{line} became {}", bench.line());
    assert!(bench.device.program.status().maps_refused > refused);
    // The last map is as fresh as may be, then stale.
    let stale_ms = u64::from(Configuration::DEFAULT.stale_ms);
    bench.wait_ms(stale_ms - 1);
    assert_eq!(over(&mut bench, LinkId::Uart, 1.6), 0);
    bench.wait_ms(1);
    // A beginning alone keeps the link for that long, but not for ever.
    let head = bench.packets(&held(1.6)).remove(0);
    let _ = bench.device.packet_from(LinkId::Uart, &head, bench.now_us);
    assert_eq!(over(&mut bench, LinkId::Usb, 1.6), 0);
    for _ in 0..stale_ms {
        bench.wait_ms(1);
        let head = bench.packets(&held(1.6)).remove(0);
        let _ = bench.device.packet_from(LinkId::Uart, &head, bench.now_us);
    }
    assert_eq!(over(&mut bench, LinkId::Usb, 1.6), 1);
    assert_eq!(over(&mut bench, LinkId::Uart, 1.6), 0);
}

/// A map of this shear over a link, as a host counts and dates it. Returns whether it counted.
fn map_over(bench: &mut Bench, link: LinkId, shear_n: f64, sequence: u32, capture_us: u32) -> bool {
    let info = MapInfo {
        sequence,
        capture_us,
        ..MapInfo::default()
    };
    let mut decided = false;
    encode_map(&info, &held(shear_n), |packet| {
        decided |= bench.device.packet_from(link, packet, bench.now_us).decided;
    });
    decided
}

#[test]
fn the_host_of_the_other_link_takes_over_with_its_own_numbers_and_clock() {
    let doubts = Fault::StaleMaps.bit() | Fault::ReplayedMap.bit() | Fault::FutureMap.bit();
    // Its numbers are behind and its clock is younger, then both ahead, by more than a map may be late or early.
    for (sequence, ahead_us) in [(0, -5_000_000_i64), (2_000_000, -5_000_000), (0, 5_000_000)] {
        let mut bench = quiet_hold(&Configuration::DEFAULT);
        for packet in MessagePackets::new(&Message::Hello(Hello::of_this_build(0, 2)), 1).unwrap() {
            let _ = bench.device.packet_from(LinkId::Uart, &packet, bench.now_us);
        }
        for map in 0..10 {
            let now_us = bench.now_us as u32;
            assert!(map_over(&mut bench, LinkId::Usb, 1.6, 1_000 + map, now_us));
            bench.wait_ms(16);
        }
        let line = bench.line();
        bench.wait_ms(150);
        for map in 0..60 {
            let capture_us = (bench.now_us as i64 + ahead_us) as u32;
            assert!(
                map_over(&mut bench, LinkId::Uart, 3.6, sequence + map, capture_us),
                "map {map} from number {sequence} with a clock {ahead_us} us ahead"
            );
            bench.wait_ms(16);
            assert_eq!(bench.faults() & doubts, 0, "after map {map}");
        }
        assert!(bench.line() > line + line / 4, "{line} became {}", bench.line());
    }
}

#[test]
fn one_spoilt_frame_in_every_map_is_a_storm_and_one_in_every_fourth_is_none() {
    let mut dense = held(1.6);
    for taxel in &mut dense.taxels {
        taxel.z = taxel.z.max(1);
    }
    for spoilt in [0, 1, 20, 39] {
        for every in [1, 4] {
            let mut bench = quiet_hold(&Configuration::DEFAULT);
            for map in 0..24 {
                let packets = bench.packets(&dense);
                assert!(packets.len() > 39);
                for (place, packet) in packets.iter().enumerate() {
                    if map % every == 0 && place == spoilt {
                        bench.device.malformed_frame(LinkId::Usb);
                    } else {
                        let _ = bench.device.packet(packet, bench.now_us);
                    }
                }
                bench.wait_ms(16);
            }
            let storm = bench.device.program.status().latched & Fault::CrcStorm.bit();
            assert_eq!(storm != 0, every == 1, "frame {spoilt} of every {every}th map");
        }
    }
}

#[test]
fn many_spoilt_frames_of_one_map_are_one_broken_map_and_settings_in_mid_map_break_none() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    let packets = bench.packets(&held(1.6));
    assert!(packets.len() > 6);
    for (place, packet) in packets.iter().enumerate() {
        if [2, 4].contains(&place) {
            bench.device.malformed_frame(LinkId::Usb);
        } else {
            let _ = bench.device.packet(packet, bench.now_us);
        }
    }
    // One broken map and a frame: another broken map is no storm yet.
    for packet in &bench.packets(&held(1.6))[1..] {
        let _ = bench.device.packet(packet, bench.now_us);
    }
    assert_eq!(bench.faults() & Fault::CrcStorm.bit(), 0);
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    for _ in 0..20 {
        let packets = bench.packets(&held(1.6));
        let (first, rest) = packets.split_at(3);
        for packet in first {
            let _ = bench.device.packet(packet, bench.now_us);
        }
        bench.command(Command::Configure(Configuration::DEFAULT));
        for packet in rest {
            let _ = bench.device.packet(packet, bench.now_us);
        }
        bench.wait_ms(1);
    }
    assert_eq!(bench.device.program.status().latched, 0);
}

#[test]
fn only_good_maps_tell_that_the_object_is_lost() {
    let settings = Configuration {
        stale_ms: 400,
        ..Configuration::DEFAULT
    };
    let lost = Fault::ObjectLost.bit();
    // One empty map, then silence.
    let mut bench = quiet_hold(&settings);
    bench.map(&ForceMap::EMPTY);
    for ms in 0..300 {
        bench.wait_ms(1);
        assert_eq!(bench.faults() & lost, 0, "{ms} ms after one empty map");
    }
    // One empty map, then doubtful ones.
    let mut bench = quiet_hold(&settings);
    bench.map(&ForceMap::EMPTY);
    bench.wait_ms(1);
    for map in 0..20 {
        bench.odd_map(SensorId::FIRST, &ForceMap::EMPTY, Health::TOO_DARK, 0);
        bench.wait_ms(16);
        assert_eq!(bench.faults() & lost, 0, "after {map} doubtful maps");
    }
    // Good ones tell it after 100 ms, and silence does not take it back.
    let mut bench = quiet_hold(&settings);
    for map in 0..7 {
        bench.map(&ForceMap::EMPTY);
        bench.wait_ms(16);
        assert_eq!(bench.faults() & lost != 0, map == 6, "after {map} empty maps");
    }
    bench.wait_ms(1_000);
    assert_ne!(bench.faults() & lost, 0);
    bench.map(&held(1.6));
    bench.wait_ms(1);
    assert_eq!(bench.faults() & lost, 0);
}

#[test]
fn holding_again_makes_no_old_map_new() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    for _ in 0..20 {
        bench.wait_ms(50);
        bench.command(Command::Hold);
    }
    assert_ne!(bench.faults() & Fault::StaleMaps.bit(), 0);
}

#[test]
fn settings_that_come_while_holding_never_lower_the_line() {
    let shipped = Configuration::DEFAULT;
    for loose in [
        Configuration {
            ceiling: shipped.floor + 1,
            fail_safe: shipped.floor + 1,
            ..shipped
        },
        Configuration {
            margin: 0,
            relax_rate: 65_535,
            relax_after_ms: 0,
            ..shipped
        },
        Configuration {
            friction: 9_000,
            ..shipped
        },
    ] {
        let mut bench = quiet_hold(&shipped);
        let line = bench.line();
        bench.command(Command::Configure(loose));
        for _ in 0..60 {
            bench.map(&held(1.0));
            bench.wait_ms(16);
            assert!(
                bench.line() >= line,
                "{line} became {} under {loose:?}",
                bench.line()
            );
        }
        bench.command(Command::Release);
        bench.wait_ms(2_000);
        assert_eq!((bench.line(), bench.status().mode), (0, GripMode::Released));
    }
}

#[test]
fn lateness_that_grows_by_a_millisecond_a_second_becomes_stale() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    for map in 0..8_000_u64 {
        bench.odd_map(SensorId::FIRST, &held(1.6), Health::GOOD, map / 60 * 1_000);
        bench.wait_ms(16);
        bench.reports.clear();
    }
    assert_ne!(bench.faults() & Fault::StaleMaps.bit(), 0);
}

#[test]
fn either_fingertip_may_fall_silent_and_the_other_goes_on() {
    for (silent, other) in [
        (SensorId::FIRST, SensorId::SECOND),
        (SensorId::SECOND, SensorId::FIRST),
    ] {
        let mut bench = quiet_hold(&Configuration {
            sensors: 2,
            stale_ms: 60,
            ..Configuration::DEFAULT
        });
        // Both under load, then one falls silent under a heavier one.
        for sensor in SensorId::ALL {
            bench.odd_map(
                sensor,
                &held(if sensor == silent { 3.9 } else { 1.6 }),
                Health::GOOD,
                0,
            );
            bench.wait_ms(8);
        }
        let mut lines = Vec::new();
        for _ in 0..120 {
            bench.odd_map(other, &held(1.6), Health::GOOD, 0);
            bench.wait_ms(16);
            lines.push(bench.line());
        }
        assert_ne!(bench.faults() & Fault::StaleMaps.bit(), 0);
        assert!(
            lines[119] <= lines[30],
            "fingertip {silent} is silent: {} then {}",
            lines[30],
            lines[119]
        );
        assert!(lines.iter().all(|line| *line < Configuration::DEFAULT.ceiling));
    }
}

#[test]
fn tests_of_a_slide_do_not_add_up_while_a_fault_forbids_the_way_back() {
    let mut bench = quiet_hold(&Configuration::DEFAULT);
    let line = bench.line();
    // Every other picture is doubtful, so the line must hold; the load halves and swings.
    for map in 0..400_u32 {
        let load = if map % 40 < 20 { 0.8 } else { 0.6 };
        for health in [Health::TOO_DARK, Health::GOOD] {
            bench.odd_map(SensorId::FIRST, &held(load), health, 0);
            bench.wait_ms(8);
            assert!(
                bench.line() >= line,
                "{line} became {} at map {map}",
                bench.line()
            );
        }
    }
    assert!(bench.line() < 2 * line, "{line} became {}", bench.line());
}
