//! The state of a map is a function of its packets alone: lost packets of other maps change nothing, on either fingertip, and a
//! whole map at once gives the sums of its packets.

use gripline_firmware::sums::{TaxelRule, sums_of};
use gripline_protocol::message::{Command, Configuration, Hello, Message, Status};
use gripline_protocol::{ForceMap, MapInfo, SENSORS, SensorId, TAXELS, TaxelForce, encode_map};
use proptest::prelude::*;

use crate::bench::Bench;

/// A map on its way.
#[derive(Debug, Clone)]
struct Sent {
    sensor: SensorId,
    map: ForceMap,
    /// A bit for each packet that is lost.
    lost: u64,
}

fn any_sent() -> impl Strategy<Value = Sent> {
    let shear = -8_000..8_000_i16;
    let taxels = proptest::collection::vec((0..TAXELS, shear.clone(), shear, 0..20_000_i16), 0..60);
    // Packets are few: of a thin mask some are lost, of a full one all.
    let lost = prop_oneof![
        3 => Just(0),
        2 => (any::<u64>(), any::<u64>()).prop_map(|(one, other)| one & other),
        1 => Just(u64::MAX),
    ];
    (0..SENSORS, taxels, lost).prop_map(|(place, taxels, lost)| {
        let mut map = ForceMap::EMPTY;
        for (taxel, x, y, z) in taxels {
            map.taxels[taxel] = TaxelForce { x, y, z };
        }
        Sent {
            sensor: SensorId::ALL[place],
            map,
            lost,
        }
    })
}

/// What a status says of maps, counters and the line left out.
fn state(status: &Status) -> impl PartialEq + std::fmt::Debug {
    (
        (status.sensor, status.sequence, status.sums, status.coulomb_slip),
        (status.state, status.time_to_slip_ms),
        (status.slip_evidence, status.witnesses),
    )
}

fn holding(settings: Configuration) -> Bench {
    let mut bench = Bench::cold();
    bench.message(Message::Hello(Hello::of_this_build(0, 1)));
    bench.command(Command::Configure(settings));
    bench.command(Command::Hold);
    bench
}

proptest! {
    #[test]
    fn the_state_of_a_map_is_a_function_of_its_packets_alone(
        sent in proptest::collection::vec(any_sent(), 1..24),
        base in prop_oneof![Just(Configuration::CAREFUL), Just(Configuration::DEFAULT)],
    ) {
        let settings = Configuration { sensors: SENSORS as u8, ..base };
        let rule = TaxelRule::of(&settings);
        // One sees what a bad link leaves, the other only the maps that came whole.
        let (mut lossy, mut clean) = (holding(settings), holding(settings));
        for (sequence, Sent { sensor, map, lost }) in (1..).zip(&sent) {
            lossy.wait_ms(16);
            clean.wait_ms(16);
            let info = MapInfo {
                sensor: *sensor,
                sequence,
                capture_us: lossy.now_us as u32,
                ..MapInfo::default()
            };
            let mut packets = Vec::new();
            encode_map(&info, map, |packet| packets.push(packet.to_vec()));
            let is_lost = |place: usize| lost >> place & 1 == 1;
            let mut decided = 0;
            for (place, packet) in packets.iter().enumerate() {
                if !is_lost(place) {
                    decided += u32::from(lossy.device.packet(packet, lossy.now_us).decided);
                }
            }
            let is_whole = !(0..packets.len()).any(is_lost);
            prop_assert_eq!(decided, u32::from(is_whole), "map {}", sequence);
            if is_whole {
                for packet in &packets {
                    let _ = clean.device.packet(packet, clean.now_us);
                }
                prop_assert_eq!(lossy.device.program.status().sums, sums_of(map, rule));
            }
            let (lossy, clean) = (lossy.device.program.status(), clean.device.program.status());
            prop_assert_eq!(state(&lossy), state(&clean), "map {}", sequence);
        }
    }
}
