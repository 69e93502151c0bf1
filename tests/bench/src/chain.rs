//! The whole chain over played scenes: camera crop to decision, by network and gate. What each takes, how far it is from what is
//! true of the contact, and what skipping changed. Units: N, ms, µs.

use std::path::Path;

use gripline_firmware::slip::SlipDetector;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below, sums_of};
use gripline_firmware::{DeviceMicros, HostMicros};
use gripline_network::scene::{GateDecision, GateKind};
use gripline_network::tracked::TrackedNetwork;
use gripline_network::{Architecture, Evaluation, InstructionSet, Network, Precision};
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;
use gripline_protocol::message::{MapSums, SlipState};
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, Parser, map_bytes};

use crate::detectors::{incremental, packets_of, truth_of};
use crate::failure::Failure;
use crate::rule::RULE;
use crate::scenes::{FRAMES_PER_SECOND, Kind, Scene};

/// A network, or one of its variants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Variant {
    Tracked,
    /// Half as wide.
    TrackedHalf,
    TrackedF32,
    Unet,
    UnetHalf,
}

impl Variant {
    const ALL: [Self; 5] = [
        Self::Tracked,
        Self::TrackedHalf,
        Self::TrackedF32,
        Self::Unet,
        Self::UnetHalf,
    ];

    const fn name(self) -> &'static str {
        match self {
            Self::Tracked => "tracked",
            Self::TrackedHalf => "tracked-half",
            Self::TrackedF32 => "tracked in f32",
            Self::Unet => "unet",
            Self::UnetHalf => "unet-half",
        }
    }

    fn network(self) -> Result<Network, Failure> {
        let half = |name: &str| {
            let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../host/network/weights/bench");
            Network::from_file(&Path::new(folder).join(name), None)
        };
        Ok(match self {
            Self::Tracked => Network::embedded(Architecture::Tracked)?,
            Self::TrackedHalf => half("tracked-half.safetensors")?,
            Self::TrackedF32 => TrackedNetwork::embedded()?.with_precision(Precision::F32).into(),
            Self::Unet => Network::embedded(Architecture::Unet)?,
            Self::UnetHalf => half("unet-half.safetensors")?,
        })
    }
}

/// All that can be chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Choice {
    pub(crate) network: Variant,
    pub(crate) gate: GateKind,
    pub(crate) evaluation: Evaluation,
    pub(crate) instructions: InstructionSet,
    /// Of so many pictures one is looked at.
    pub(crate) every: usize,
}

/// All of them; the first of each network skips nothing and is what the others are compared with.
pub(crate) fn choices(instructions: InstructionSet) -> Vec<Choice> {
    let choice = |network, gate, evaluation| Choice {
        network,
        gate,
        evaluation,
        instructions,
        every: 1,
    };
    let mut choices = Vec::new();
    for network in Variant::ALL {
        choices.push(choice(network, GateKind::Off, Evaluation::Dense));
        if [Variant::Tracked, Variant::Unet].contains(&network) {
            choices.push(choice(network, GateKind::Off, Evaluation::Skip));
            choices.push(choice(network, GateKind::Difference, Evaluation::Skip));
        }
        choices.push(choice(network, GateKind::Network, Evaluation::Skip));
    }
    // `unet` knows no noise.
    for gate in [GateKind::Off, GateKind::Difference, GateKind::Network] {
        choices.push(choice(Variant::Tracked, gate, Evaluation::SkipNoise));
    }
    let default = choice(Variant::Tracked, GateKind::default(), Evaluation::default());
    choices.push(Choice { every: 2, ..default });
    let others = InstructionSet::ALL
        .into_iter()
        .filter(|set| set.is_available() && *set != instructions);
    choices.extend(others.map(|instructions| Choice {
        instructions,
        ..default
    }));
    choices
}

impl Choice {
    pub(crate) fn name(self) -> String {
        let skip = match self.evaluation {
            Evaluation::Dense => "nothing skipped",
            Evaluation::Skip => "regions skipped",
            Evaluation::SkipNoise => "regions and noise skipped",
        };
        let mut name = match self.gate {
            GateKind::Off => format!("{}, {skip}", self.network.name()),
            gate => format!("{}, gate {}", self.network.name(), gate.name()),
        };
        if self.gate != GateKind::Off && self.evaluation == Evaluation::SkipNoise {
            name += ", noise skipped";
        }
        if self.every > 1 {
            name += ", every second picture";
        }
        name
    }

    /// As [`Self::name`], with the instruction set.
    pub(crate) fn label(self, usual: InstructionSet) -> String {
        if self.instructions == usual {
            self.name()
        } else {
            format!("{}, {}", self.name(), self.instructions)
        }
    }

    /// The way that skips nothing.
    pub(crate) fn is_measure(self) -> bool {
        self.evaluation == Evaluation::Dense
    }

    /// Whether it is to decide as the one that skips nothing: with the same instructions, at the same rate.
    pub(crate) fn is_judged(self, usual: InstructionSet) -> bool {
        !self.is_measure() && self.every == 1 && self.instructions == usual
    }
}

/// A frame's outcome.
#[derive(Debug, Clone, Copy)]
struct Seen {
    sums: MapSums,
    slips: bool,
    state: SlipState,
    us: f64,
    skipped: bool,
}

/// One way over one scene.
pub(crate) struct Row {
    pub(crate) kind: Kind,
    pub(crate) choice: Choice,
    pub(crate) frames: usize,
    /// Downsampling, gate, network, rounding: of frames that the network saw, and of those that it did not.
    pub(crate) full_us: Vec<f64>,
    pub(crate) skipped_us: Vec<f64>,
    /// Errors of the normal and shear force over the true one where that is above 0.5 N.
    pub(crate) normal_off: Vec<f64>,
    pub(crate) shear_off: Vec<f64>,
    pub(crate) ratio_off: Vec<f64>,
    /// Frames whose slip decision is not that on the true forces.
    pub(crate) flips: usize,
    /// From the chain's first SLIP to the object's first sliding as a whole, ms; none where one of them never came.
    pub(crate) lead_ms: Option<f64>,
    /// Frames decided differently than without any skipping: decision, state.
    pub(crate) changed: [usize; 2],
    pub(crate) wire: Wire,
}

/// What travels, and what the way it travels changes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Wire {
    pub(crate) bytes: usize,
    pub(crate) dense_bytes: usize,
    /// Maps whose sums from their packets are not those of the whole map.
    pub(crate) differ: usize,
}

/// Every way over every scene. `told` hears the name of each scene.
pub(crate) fn measure(
    scenes: &[Scene],
    instructions: InstructionSet,
    mut report: impl FnMut(&str),
) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for scene in scenes {
        report(scene.kind.name());
        let choices = choices(instructions);
        let mut pipelines = Vec::new();
        for choice in &choices {
            let network = choice.network.network()?.with_instructions(choice.instructions)?;
            let network = network.with_evaluation(choice.evaluation);
            let settings = settings_for(&network);
            let rule = TaxelRule::of(&settings);
            let pipeline = Pipeline::new(network, &scene.rest, choice.gate, rule);
            pipelines.push((pipeline, settings, SlipDetector::new()));
        }
        let mut seen: Vec<Vec<Seen>> = vec![Vec::new(); choices.len()];
        let mut wires = vec![Wire::default(); choices.len()];
        for (number, frame) in (0_u32..).zip(&scene.frames) {
            // In turns, so that what else the machine does falls on all of them.
            for (place, (pipeline, settings, detector)) in pipelines.iter_mut().enumerate() {
                if let Some(last) = seen[place].last().copied()
                    && !(number as usize).is_multiple_of(choices[place].every)
                {
                    // What was decided stands.
                    seen[place].push(Seen {
                        us: 0.0,
                        skipped: true,
                        ..last
                    });
                    continue;
                }
                let processed = pipeline.process(&frame.crop)?;
                let rule = TaxelRule::of(settings);
                let sums = sums_of(processed.map, rule);
                let now_us = (f64::from(number) * 1e6 / FRAMES_PER_SECOND) as u64;
                let judgement = detector.update(
                    &sums,
                    HostMicros(now_us as u32),
                    DeviceMicros(now_us + 1_000_000),
                    settings,
                );
                detector.observe(&sums);
                seen[place].push(Seen {
                    sums,
                    slips: stick_ratio_below(&sums, settings.slip_threshold),
                    state: judgement.state,
                    us: processed.stages_us.iter().sum(),
                    skipped: matches!(processed.gate, GateDecision::NoContact | GateDecision::Unchanged),
                });
                wires[place].add(number, processed.map);
            }
        }
        for (place, choice) in choices.iter().enumerate() {
            let measure = choices
                .iter()
                .position(|other| other.network == choice.network && other.is_measure());
            let plain = &seen[measure.unwrap_or(place)];
            rows.push(row(scene, *choice, &seen[place], plain, wires[place]));
        }
    }
    Ok(rows)
}

impl Wire {
    fn add(&mut self, number: u32, map: &ForceMap) {
        let packets = packets_of(number, map);
        self.bytes += packets.iter().map(Vec::len).sum::<usize>();
        self.dense_bytes += map_bytes(map.taxels.len());
        // The detector of the bench's own rule: any rule shows whether the way changes sums.
        self.differ += usize::from(incremental(&mut Parser::new(), &packets) != Some(sums_of(map, RULE)));
    }
}

fn row(scene: &Scene, choice: Choice, seen: &[Seen], plain: &[Seen], wire: Wire) -> Row {
    let mut row = Row {
        kind: scene.kind,
        choice,
        frames: seen.len(),
        full_us: seen
            .iter()
            .filter(|seen| !seen.skipped)
            .map(|seen| seen.us)
            .collect(),
        skipped_us: seen
            .iter()
            .filter(|seen| seen.skipped)
            .map(|seen| seen.us)
            .collect(),
        normal_off: Vec::new(),
        shear_off: Vec::new(),
        ratio_off: Vec::new(),
        flips: 0,
        lead_ms: None,
        changed: [0; 2],
        wire,
    };
    for ((frame, seen), plain) in scene.frames.iter().zip(seen).zip(plain) {
        let truth = truth_of(&frame.forces);
        let found = seen
            .sums
            .force
            .map(|sum| f64::from(sum) / f64::from(LSB_PER_NEWTON));
        let [x, y, z] = truth.force_n;
        if z > 0.5 {
            row.normal_off.push((found[2] - z).abs() / z);
            row.shear_off
                .push((found[0] - x).hypot(found[1] - y) / x.hypot(y).max(0.2));
        }
        if let Some(ratio) = truth.ratio() {
            let found = if seen.sums.contact == 0 {
                1.0
            } else {
                f64::from(seen.sums.stick) / f64::from(seen.sums.contact)
            };
            row.ratio_off.push((found - ratio).abs());
        }
        row.flips += usize::from(seen.slips != truth.slips);
        row.changed[0] += usize::from(seen.slips != plain.slips);
        row.changed[1] += usize::from(seen.state != plain.state);
    }
    let slides = scene.frames.iter().position(|frame| frame.slides);
    let says = seen.iter().position(|seen| seen.state == SlipState::Slip);
    row.lead_ms = slides
        .zip(says)
        .map(|(slides, says)| (slides as f64 - says as f64) * 1e3 / FRAMES_PER_SECOND);
    row
}
