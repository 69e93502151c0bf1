//! The incremental path in any order of packets against the whole map at once.

use gripline_firmware::sums::{Accumulator, Kernel as _, Portable, sums_of};
use gripline_protocol::constants::TAXELS_PER_PACKET;
use gripline_protocol::message::{Command, Configuration};
use gripline_protocol::{ForceMap, Place, SIDE, SensorId, TAXELS, TaxelForce};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64Mcg;
use serde_json::json;

use super::judge::{FRICTION, quantised, rule};
use crate::board::{Board, Origin};
use crate::contacts::Contact;
use crate::floating::{Form, double, single};
use crate::{Effort, Sweep};

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "order of packets",
        "Sums added packet by packet in random orders against the whole map at once; then whole packets in wrong orders, \
         doubled, lost, and mixed with another fingertip's, with messages and with ticks, through the program.",
        &[
            "what",
            "maps",
            "orders",
            "sums differ",
            "accepted wrongly",
            "changed by what was refused",
            "next map not as it should be",
        ],
    );
    let maps = effort.of(2_000, 30);
    let mut random = effort.random(900);
    let mut differ = [0_u64; 3];
    let orders = 5;
    for _ in 0..maps {
        let map = any_map(&mut random);
        for (sum, part) in differ.iter_mut().zip(shuffled_sums(&map, orders, &mut random)) {
            *sum += part;
        }
    }
    for (name, differ) in ["sums of the detector", "sums in f32", "sums in f64"]
        .iter()
        .zip(differ)
    {
        sweep.row(vec![
            json!(name),
            json!(maps),
            json!(maps * orders),
            json!(differ),
            json!(null),
            json!(null),
            json!(null),
        ]);
    }
    sweep.none("sums that depend on the order of packets", differ[0]);
    let mut all = [0_u64; 4];
    for (name, disturb) in DISTURBANCES {
        let mut found = [0_u64; 4];
        let rounds = effort.of(1_500, 25);
        for _ in 0..rounds {
            for (sum, part) in found.iter_mut().zip(disturbed(*disturb, &mut random)) {
                *sum += part;
            }
        }
        let mut row = vec![json!(name), json!(rounds), json!(rounds)];
        row.extend(found.iter().map(|count| json!(count)));
        sweep.row(row);
        for (sum, part) in all.iter_mut().zip(found) {
            *sum += part;
        }
    }
    sweep.none("accepted maps whose sums are not those of the whole map", all[0]);
    sweep.none(
        "maps accepted although packets were lost, doubled or out of order",
        all[1],
    );
    sweep.none("refused maps that changed sums, state or line", all[2]);
    sweep.none(
        "good maps after a disturbance that were refused or came out otherwise",
        all[3],
    );
    sweep
}

fn any_map(random: &mut Pcg64Mcg) -> ForceMap {
    if random.random_bool(0.7) {
        return quantised(&Contact::random(random).newtons()).0;
    }
    let mut map = ForceMap::EMPTY;
    map.taxels.fill_with(|| TaxelForce {
        x: random.random(),
        y: random.random(),
        z: random.random(),
    });
    map
}

/// Orders in which the detector's, f32's and f64's sums are not those of the map at once.
fn shuffled_sums(map: &ForceMap, orders: usize, random: &mut Pcg64Mcg) -> [u64; 3] {
    let whole = sums_of(map, rule(FRICTION, 0));
    let (singles, doubles) = (single::newtons(map), double::newtons(map));
    let narrow = single::Rule {
        friction: 0.45,
        contact_min_n: 0.0,
        form: Form::Root,
    };
    let wide = double::Rule {
        friction: 0.45,
        contact_min_n: 0.0,
        form: Form::Root,
    };
    let (single_whole, double_whole) = (single::sums_of(&singles, narrow), double::sums_of(&doubles, wide));
    let mut taxels: Vec<usize> = (0..TAXELS).collect();
    let mut differ = [0; 3];
    for _ in 0..orders {
        let mut packets: Vec<&mut [usize]> = taxels.chunks_mut(TAXELS_PER_PACKET).collect();
        packets.shuffle(random);
        let mut sums = Accumulator::new(rule(FRICTION, 0));
        let (mut single, mut double) = (single::Sums::default(), double::Sums::default());
        for packet in packets {
            packet.shuffle(random);
            let places: Vec<Place> = packet
                .iter()
                .map(|taxel| Place::new((taxel % SIDE) as u16, (taxel / SIDE) as u16))
                .collect();
            let bytes: Vec<[u8; 6]> = packet
                .iter()
                .map(|taxel| map.taxels[*taxel].to_le_bytes())
                .collect();
            Portable::add(&mut sums, &places, &bytes);
            for taxel in packet.iter() {
                single.add(*taxel, singles[*taxel], narrow);
                double.add(*taxel, doubles[*taxel], wide);
            }
        }
        taxels.sort_unstable();
        differ[0] += u64::from(sums.finish() != whole);
        differ[1] += u64::from(single != single_whole);
        differ[2] += u64::from(double != double_whole);
    }
    differ
}

/// What happens to a map's packets.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Disturbance {
    Shuffled,
    Doubled,
    Lost,
    Swapped,
    Torn,
    OtherFingertip,
    MessagesAndTicks,
}

const DISTURBANCES: &[(&str, Disturbance)] = &[
    ("packets in any order", Disturbance::Shuffled),
    ("two neighbours swapped", Disturbance::Swapped),
    ("one packet twice", Disturbance::Doubled),
    ("one packet lost", Disturbance::Lost),
    ("one bit turned", Disturbance::Torn),
    ("another fingertip's packets between", Disturbance::OtherFingertip),
    ("messages and ticks between", Disturbance::MessagesAndTicks),
];

/// [accepted with wrong sums, accepted wrongly, changed though refused, next map wrong].
fn disturbed(disturbance: Disturbance, random: &mut Pcg64Mcg) -> [u64; 4] {
    let settings = Configuration::DEFAULT;
    let mut board = Board::holding(settings, Origin::default());
    board.map(&quantised(&Contact::random(random).newtons()).0);
    board.pass_us(5_000);
    let before = board.device.program.status();
    let map = any_map(random);
    let packets = board.packets(SensorId::FIRST, &map, 0);
    let mut sent = packets.clone();
    let at = random.random_range(0..sent.len());
    match disturbance {
        Disturbance::Shuffled => sent.shuffle(random),
        Disturbance::Swapped => sent.swap(at, (at + 1) % packets.len()),
        Disturbance::Doubled => sent.insert(at, packets[at].clone()),
        Disturbance::Lost => drop(sent.remove(at)),
        Disturbance::Torn => {
            let byte = random.random_range(0..sent[at].len());
            sent[at][byte] ^= 1 << random.random_range(0..8);
        }
        Disturbance::OtherFingertip => {
            let other = board.packets(SensorId::SECOND, &ForceMap::EMPTY, 0);
            sent.splice(at..at, other);
        }
        Disturbance::MessagesAndTicks => {}
    }
    for packet in &sent {
        board.packet(packet);
        if disturbance == Disturbance::MessagesAndTicks {
            board.command(Command::ReadStatus);
            board.pass_us(random.random_range(0..300));
        }
    }
    let rule = rule(settings.friction, settings.contact_min);
    let status = board.device.program.status();
    let accepted = status.sequence == before.sequence + 1
        && status.sensor == SensorId::FIRST
        && status.maps > before.maps;
    let must = disturbance == Disturbance::MessagesAndTicks || sent == packets;
    // A doubled tail comes after the map was accepted; a doubled head starts the same map afresh.
    let may = must
        || disturbance == Disturbance::Doubled && (at + 1 == packets.len() || at == 0)
        || disturbance == Disturbance::OtherFingertip;
    let wrong_sums = accepted && status.sums != sums_of(&map, rule);
    let wrongly = accepted && !may || !accepted && must;
    let other = disturbance == Disturbance::OtherFingertip;
    let changed = !accepted
        && !other
        && (status.sums, status.state, status.maps) != (before.sums, before.state, before.maps);
    board.pass_us(5_000);
    let next = any_map(random);
    let after = board.map(&next);
    let wrong_after = after.sums != sums_of(&next, rule);
    [wrong_sums, wrongly, changed, wrong_after].map(u64::from)
}
