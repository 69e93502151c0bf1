//! The detector's variants over the same maps in memory: what each decides, how long it takes, what NumPy says and takes.
//! Truth is exact arithmetic on the f32 newtons themselves. Units: newtons, N·mm, seconds.

use std::hint::black_box;
use std::time::Instant;

use gripline_evaluation::detect::judge::sums;
use gripline_firmware::sums::{Accumulator, Kernel as _, Portable};
use gripline_protocol::message::MapSums;
use gripline_protocol::{
    Event, ForceMap, LSB_PER_NEWTON, MapInfo, PER_UNIT, Parser, Place, TAXELS, encode_map,
};
use gripline_stress::exact;
use gripline_stress::floating::{Form, double, single};

use crate::failure::Failure;
use crate::numpy::{Call, Numpy};
use crate::rule::{BLOCK, CONTACT_MIN, Decision, FRICTION, RULE, THRESHOLD};

/// Instructions of a Cortex-M4 by taxels that a map carries, as counted on the emulated board.
const COUNTS: &str = include_str!("../../emulator/latency/tests/counts.txt");

type Newtons = [[f32; 3]; TAXELS];

/// Maps one after the other, in every form that a variant starts from.
pub(crate) struct Maps {
    pub(crate) newtons: Vec<Newtons>,
    /// Where each played scene begins.
    pub(crate) begins: Vec<usize>,
    doubles: Vec<[[f64; 3]; TAXELS]>,
    quantised: Vec<ForceMap>,
    /// Places and bytes of the taxels that travel.
    active: Vec<(Vec<Place>, Vec<[u8; 6]>)>,
    packets: Vec<Vec<Vec<u8>>>,
}

impl Maps {
    pub(crate) fn new(newtons: Vec<Newtons>, begins: Vec<usize>) -> Result<Self, Failure> {
        let mut quantised = Vec::new();
        for map in &newtons {
            quantised.push(ForceMap::quantise(map)?.0);
        }
        let active = quantised.iter().map(active_of).collect();
        let packets = (0..)
            .zip(&quantised)
            .map(|(sequence, map)| packets_of(sequence, map))
            .collect();
        Ok(Self {
            doubles: newtons
                .iter()
                .map(|map| map.map(|force| force.map(f64::from)))
                .collect(),
            newtons,
            begins,
            quantised,
            active,
            packets,
        })
    }

    pub(crate) fn len(&self) -> usize {
        self.newtons.len()
    }

    /// Taxels that a map carries on average.
    pub(crate) fn mean_active(&self) -> f64 {
        self.active
            .iter()
            .map(|(places, _)| places.len() as f64)
            .sum::<f64>()
            / self.len() as f64
    }
}

pub(crate) fn active_of(map: &ForceMap) -> (Vec<Place>, Vec<[u8; 6]>) {
    let set = map.active();
    let mut places = [Place::default(); TAXELS];
    let count = usize::from(set.places(&mut places));
    let bytes = places[..count]
        .iter()
        .map(|place| map.taxels[usize::from(place.taxel())].to_le_bytes());
    (places[..count].to_vec(), bytes.collect())
}

pub(crate) fn packets_of(sequence: u32, map: &ForceMap) -> Vec<Vec<u8>> {
    let info = MapInfo {
        sequence,
        ..MapInfo::default()
    };
    let mut packets = Vec::new();
    encode_map(&info, map, |packet| packets.push(packet.to_vec()));
    packets
}

/// A map from its packets, taxels added as they land.
pub(crate) fn incremental(parser: &mut Parser, packets: &[Vec<u8>]) -> Option<MapSums> {
    let mut sums = Accumulator::new(RULE);
    let mut whole = None;
    for packet in packets {
        match parser.push(packet) {
            Ok(Event::MapForces(forces)) => Portable::add(&mut sums, forces.places(), forces.bytes()),
            Ok(Event::MapEnd { forces, .. }) => {
                Portable::add(&mut sums, forces.places(), forces.bytes());
                whole = Some(sums.finish());
            }
            Ok(_) => {}
            Err(_) => return None,
        }
    }
    whole
}

/// A way to the decisions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Variant {
    Double,
    Single,
    FixedFromNewtons,
    FixedDense,
    FixedSparse,
    Incremental,
    NumpyBatch,
    NumpyFrames,
}

impl Variant {
    pub(crate) const ALL: [Self; 8] = [
        Self::Double,
        Self::Single,
        Self::FixedFromNewtons,
        Self::FixedDense,
        Self::FixedSparse,
        Self::Incremental,
        Self::NumpyBatch,
        Self::NumpyFrames,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Double => "f64",
            Self::Single => "f32",
            Self::FixedFromNewtons => "fixed, from f32 newtons",
            Self::FixedDense => "fixed, dense",
            Self::FixedSparse => "fixed, sparse",
            Self::Incremental => "fixed, packet by packet",
            Self::NumpyBatch => "NumPy, one call for all",
            Self::NumpyFrames => "NumPy, one call a map",
        }
    }

    fn call(self) -> Option<Call> {
        match self {
            Self::NumpyBatch => Some(Call::Batch),
            Self::NumpyFrames => Some(Call::Frames),
            _ => None,
        }
    }

    /// Instructions on the microcontroller, averaged over the maps: sums alone, or all that takes the packets in.
    pub(crate) fn instructions(self, maps: &Maps) -> Option<f64> {
        let column = match self {
            Self::FixedSparse => 1,
            Self::Incremental => 2,
            _ => return None,
        };
        let counts: Vec<f64> = COUNTS
            .lines()
            .skip(1)
            .filter_map(|line| line.split(' ').nth(column)?.parse().ok())
            .collect();
        let sum: Option<f64> = maps
            .active
            .iter()
            .map(|(places, _)| counts.get(places.len()))
            .sum();
        sum.map(|sum| sum / maps.len() as f64)
    }

    /// What one of ours decides about a map.
    fn decide(self, maps: &Maps, index: usize, parser: &mut Parser) -> Option<Decision> {
        let friction = f64::from(FRICTION) / f64::from(PER_UNIT);
        let contact_min_n = f64::from(CONTACT_MIN) / f64::from(LSB_PER_NEWTON);
        let float = |contact: u16, stick: u16, slips, force_n| Decision {
            contact,
            stick,
            slips,
            force_n,
        };
        Some(match self {
            Self::Double => {
                let rule = double::Rule {
                    friction,
                    contact_min_n,
                    form: Form::Root,
                };
                let sums = double::sums_of(&maps.doubles[index], rule);
                black_box(sums.moment_nmm);
                float(
                    sums.contact,
                    sums.stick,
                    sums.stick_ratio().is_some_and(|ratio| ratio < 0.5),
                    sums.force_n,
                )
            }
            Self::Single => {
                let rule = single::Rule {
                    friction: friction as f32,
                    contact_min_n: contact_min_n as f32,
                    form: Form::Root,
                };
                let sums = single::sums_of(&maps.newtons[index], rule);
                black_box(sums.moment_nmm);
                float(
                    sums.contact,
                    sums.stick,
                    sums.stick_ratio().is_some_and(|ratio| ratio < 0.5),
                    sums.force_n.map(f64::from),
                )
            }
            Self::FixedFromNewtons => {
                let newtons = &maps.newtons[index];
                let (map, _) = ForceMap::quantise(newtons).ok()?;
                Decision::of(&sums(&map, RULE))
            }
            Self::FixedDense => Decision::of(&sums(&maps.quantised[index], RULE)),
            Self::FixedSparse => {
                let (places, bytes) = &maps.active[index];
                let mut sums = Accumulator::new(RULE);
                Portable::add(&mut sums, places, bytes);
                Decision::of(&sums.finish())
            }
            Self::Incremental => Decision::of(&incremental(parser, &maps.packets[index])?),
            Self::NumpyBatch | Self::NumpyFrames => return None,
        })
    }
}

/// What exact arithmetic decides about the newtons themselves.
pub(crate) fn truth_of(newtons: &Newtons) -> Decision {
    let contact_min_n = f64::from(CONTACT_MIN) / f64::from(LSB_PER_NEWTON);
    let mut truth = Decision {
        contact: 0,
        stick: 0,
        slips: false,
        force_n: [0.0; 3],
    };
    for force in newtons {
        let force = force.map(f64::from);
        if force[2] > contact_min_n {
            truth.contact += 1;
            truth.stick += u16::from(exact::sticks(force, FRICTION));
        }
        for (sum, part) in truth.force_n.iter_mut().zip(force) {
            *sum += part;
        }
    }
    truth.slips = exact::slips(truth.stick, truth.contact, THRESHOLD);
    truth
}

/// How far decisions are from the truth.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Errors {
    /// Largest error of the total force, newtons.
    pub(crate) force_n: f64,
    /// Mean error of the stick ratio.
    pub(crate) ratio: f64,
    /// Maps decided otherwise.
    pub(crate) flips: u64,
    /// Largest difference of a scene's first slip, ms: positive is later than the truth.
    pub(crate) lead_ms: f64,
}

/// Compares decisions with the truth, scene by scene.
pub(crate) fn errors(truth: &[Decision], found: &[Decision], begins: &[usize]) -> Errors {
    let mut errors = Errors::default();
    let mut ratios = 0_u64;
    for (right, found) in truth.iter().zip(found) {
        let off = right
            .force_n
            .iter()
            .zip(found.force_n)
            .map(|(a, b)| (a - b).powi(2))
            .sum::<f64>();
        errors.force_n = errors.force_n.max(off.sqrt());
        if let Some(ratio) = right.ratio() {
            errors.ratio += (ratio - found.ratio().unwrap_or(1.0)).abs();
            ratios += 1;
        }
        errors.flips += u64::from(right.slips != found.slips);
    }
    errors.ratio /= ratios.max(1) as f64;
    for (scene, begin) in begins.iter().enumerate() {
        let end = begins.get(scene + 1).copied().unwrap_or(truth.len());
        let first = |all: &[Decision]| all[*begin..end].iter().position(|map| map.slips);
        if let (Some(right), Some(found)) = (first(truth), first(found)) {
            let ms = (found as f64 - right as f64) * 1e3 / crate::scenes::FRAMES_PER_SECOND;
            if ms.abs() > errors.lead_ms.abs() {
                errors.lead_ms = ms;
            }
        }
    }
    errors
}

/// A variant's figures.
pub(crate) struct Row {
    pub(crate) variant: Variant,
    /// Times of a map by round, seconds.
    pub(crate) times_s: Vec<f64>,
    /// The least time that each block of maps took in any round, seconds.
    pub(crate) blocks_s: Vec<f64>,
    pub(crate) errors: Option<Errors>,
    pub(crate) instructions: Option<f64>,
}

impl Row {
    /// What a map takes while nothing else wants the processor: the best of all rounds, block by block.
    pub(crate) fn best_s(&self, maps: usize) -> f64 {
        self.blocks_s.iter().sum::<f64>() / maps as f64
    }
}

/// Every variant over the maps, in turns.
pub(crate) fn measure(maps: &Maps, rounds: usize, numpy: &mut Option<Numpy>) -> Result<Vec<Row>, Failure> {
    let truth: Vec<Decision> = maps.newtons.iter().map(truth_of).collect();
    let mut parser = Parser::new();
    let mut rows = Vec::new();
    for variant in Variant::ALL {
        let found: Vec<Decision> = if variant.call().is_some() {
            match numpy {
                Some(numpy) => numpy.decide()?,
                None => continue,
            }
        } else {
            (0..maps.len())
                .filter_map(|index| variant.decide(maps, index, &mut parser))
                .collect()
        };
        if found.len() != maps.len() {
            return Err(format!(
                "{}: {} of {} maps were decided",
                variant.name(),
                found.len(),
                maps.len()
            )
            .into());
        }
        let mut errors = errors(&truth, &found, &maps.begins);
        if variant.call().is_some() {
            errors.force_n = f64::NAN;
        }
        rows.push(Row {
            variant,
            times_s: Vec::new(),
            blocks_s: Vec::new(),
            errors: Some(errors),
            instructions: variant.instructions(maps),
        });
    }
    for _ in 0..rounds {
        for row in &mut rows {
            let seconds = if let (Some(call), Some(numpy)) = (row.variant.call(), numpy.as_mut()) {
                numpy.seconds(call)?
            } else {
                let mut seconds = Vec::new();
                for begin in (0..maps.len()).step_by(BLOCK) {
                    let start = Instant::now();
                    for index in begin..maps.len().min(begin + BLOCK) {
                        black_box(row.variant.decide(black_box(maps), index, &mut parser));
                    }
                    seconds.push(start.elapsed().as_secs_f64());
                }
                seconds
            };
            row.times_s.push(seconds.iter().sum::<f64>() / maps.len() as f64);
            row.blocks_s.resize(seconds.len(), f64::INFINITY);
            for (min, seconds) in row.blocks_s.iter_mut().zip(seconds) {
                *min = min.min(seconds);
            }
        }
    }
    Ok(rows)
}
