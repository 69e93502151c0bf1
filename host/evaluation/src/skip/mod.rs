//! The command `gripline evaluate skip`: what looking only at what changes costs, and every decision that it changes. The same pictures
//! go through the way that ships and through one that skips nothing, in turns; both with sixteen pictures at rest and with one.
//! Units: N, µs, s. Limits: times are of this machine as it is.

mod scenes;

use std::fmt::Write as _;
use std::io::{self, Write as _};

use clap::Args;
use gripline_firmware::slip::SlipDetector;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below, sums_of};
use gripline_firmware::{DeviceMicros, HostMicros};
use gripline_network::scene::{GateDecision, GateKind};
use gripline_network::{Architecture, Evaluation, InstructionSet, Network};
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;
use gripline_protocol::message::{Configuration, SlipState};
use gripline_recording::error::Completion;
use serde::Serialize;

use super::progress::Progress;
use crate::error::EvaluationError;
use scenes::{FRAMES_PER_SECOND, Kind, Scene};

/// A touch of this normal force must not be taken for none, N.
const SEEN_N: f32 = 0.05;
/// A quiet hold lasts from here on, s: it is pressed, and sheared a little, before.
const QUIET_FROM_S: f64 = 2.0;

/// The arguments.
#[derive(Debug, Clone, Args)]
pub struct SkipArgs {
    /// Length of each scene.
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    pub seconds: u16,
    /// Sensors and pressed places.
    #[arg(long, default_value_t = 1)]
    pub seed: u8,
    /// Only the scenes whose name contains this.
    #[arg(long, value_name = "WORD", default_value = "")]
    pub only: String,
    /// The scene gate.
    #[arg(long, default_value_t)]
    pub gate: GateKind,
    /// Instruction set of both ways, by default the widest.
    #[arg(long, value_name = "SET")]
    pub instructions: Option<InstructionSet>,
    /// One JSON object on standard output.
    #[arg(long)]
    pub json: bool,
}

/// A scene with this many pictures at rest.
#[derive(Debug, Clone, Serialize)]
struct Row {
    scene: &'static str,
    rest_pictures: usize,
    frames: usize,
    no_contact: usize,
    unchanged: usize,
    /// Time of all frames over that with nothing skipped.
    cost: f64,
    /// The same from [`QUIET_FROM_S`] on.
    cost_after_2_s: f64,
    frame_us_median: f64,
    /// With nothing skipped.
    full_us_median: f64,
    /// Frames with a touch of 99 % of [`SEEN_N`] or more that the gate took for none.
    touch_missed: usize,
    /// The longest time for which the gate took such a touch for none, ms.
    touch_missed_ms_longest: f64,
    /// Frames whose slip decision differs from that with nothing skipped, and those whose state does.
    slip_decisions_changed: usize,
    states_changed: usize,
    /// Each of them, as a line for people.
    differences: Vec<String>,
}

/// One way to the decision.
struct Variant {
    pipeline: Pipeline,
    settings: Configuration,
    detector: SlipDetector,
    us: Vec<f64>,
}

/// A frame's outcome.
struct Seen {
    gate: GateDecision,
    slips: bool,
    state: SlipState,
    ratio: f64,
    normal_n: f64,
}

impl Variant {
    fn new(
        rest: &[Vec<u8>],
        gate: GateKind,
        evaluation: Evaluation,
        instructions: InstructionSet,
    ) -> Result<Self, EvaluationError> {
        let network = Network::embedded(Architecture::default())
            .and_then(|network| network.with_instructions(instructions))?
            .with_evaluation(evaluation);
        let settings = settings_for(&network);
        Ok(Self {
            pipeline: Pipeline::new(network, rest, gate, TaxelRule::of(&settings)),
            settings,
            detector: SlipDetector::new(),
            us: Vec::new(),
        })
    }

    fn process(&mut self, crop: &[u8], time_s: f64) -> Result<Seen, EvaluationError> {
        let processed = self.pipeline.process(crop)?;
        let sums = sums_of(processed.map, TaxelRule::of(&self.settings));
        // The detector's clock begins where no wait is open.
        let now_us = (time_s * 1e6) as u64;
        let judgement = self.detector.update(
            &sums,
            HostMicros(now_us as u32),
            DeviceMicros(now_us + 1_000_000),
            &self.settings,
        );
        self.detector.observe(&sums);
        self.us.push(processed.stages_us.iter().sum());
        Ok(Seen {
            gate: processed.gate,
            slips: stick_ratio_below(&sums, self.settings.slip_threshold),
            state: judgement.state,
            ratio: f64::from(sums.stick) / f64::from(sums.contact.max(1)),
            normal_n: f64::from(sums.force[2]) / f64::from(gripline_protocol::LSB_PER_NEWTON),
        })
    }
}

/// Runs the command.
///
/// # Errors
/// [`EvaluationError`] when a scene has no solution or the network cannot be loaded.
pub fn run(args: &SkipArgs) -> Result<Completion, EvaluationError> {
    let instructions = match args.instructions {
        Some(set) => set
            .checked()
            .map_err(|error| EvaluationError::Instructions(error.into()))?,
        None => InstructionSet::widest(),
    };
    let kinds: Vec<Kind> = Kind::ALL
        .into_iter()
        .filter(|kind| kind.name().contains(&args.only))
        .collect();
    let skin = scenes::skin()?;
    let progress = Progress::new("scenes", kinds.len());
    let mut rows = Vec::new();
    for kind in kinds {
        let mut scene = Scene::new(kind, &skin, args.seed.into())?;
        rows.extend(play(kind, &mut scene, args, instructions)?);
        progress.step();
    }
    progress.finish();
    let text = if args.json {
        let total = |value: fn(&Row) -> usize| rows.iter().map(value).sum::<usize>();
        serde_json::json!({
            "seconds": args.seconds, "seed": args.seed, "gate": args.gate.name(), "instructions": instructions.to_string(),
            "states": total(|row| row.frames), "states_changed": total(|row| row.states_changed),
            "slip_decisions_changed": total(|row| row.slip_decisions_changed), "rows": rows,
        })
        .to_string()
            + "\n"
    } else {
        table(&rows)
    };
    io::stdout().write_all(text.as_bytes())?;
    Ok(Completion::Whole)
}

/// Plays a scene with sixteen pictures at rest and with one.
fn play(
    kind: Kind,
    scene: &mut Scene,
    args: &SkipArgs,
    instructions: InstructionSet,
) -> Result<Vec<Row>, EvaluationError> {
    let rests = [scene.rest.len(), 1];
    let mut variants = Vec::new();
    for count in rests {
        let rest = &scene.rest[..count];
        variants.push([
            Variant::new(rest, GateKind::Off, Evaluation::Dense, instructions)?,
            Variant::new(rest, args.gate, Evaluation::default(), instructions)?,
        ]);
    }
    let frames = (f64::from(args.seconds) * FRAMES_PER_SECOND) as usize;
    let mut rows = rests.map(|rest_pictures| Row {
        scene: kind.name(),
        rest_pictures,
        frames,
        no_contact: 0,
        unchanged: 0,
        cost: 0.0,
        cost_after_2_s: 0.0,
        frame_us_median: 0.0,
        full_us_median: 0.0,
        touch_missed: 0,
        touch_missed_ms_longest: 0.0,
        slip_decisions_changed: 0,
        states_changed: 0,
        differences: Vec::new(),
    });
    let mut missed_in_a_row = [0; 2];
    for number in 0..frames {
        let frame = scene.next()?;
        let time_s = number as f64 / FRAMES_PER_SECOND;
        for ((variants, row), missed) in variants.iter_mut().zip(&mut rows).zip(&mut missed_in_a_row) {
            let full = variants[0].process(&frame.crop, time_s)?;
            let seen = variants[1].process(&frame.crop, time_s)?;
            row.no_contact += usize::from(seen.gate == GateDecision::NoContact);
            row.unchanged += usize::from(seen.gate == GateDecision::Unchanged);
            let is_missed = seen.gate == GateDecision::NoContact && frame.normal_n >= 0.99 * SEEN_N;
            *missed = if is_missed { *missed + 1 } else { 0 };
            row.touch_missed += usize::from(is_missed);
            row.touch_missed_ms_longest = row
                .touch_missed_ms_longest
                .max(f64::from(*missed) * 1e3 / FRAMES_PER_SECOND);
            row.slip_decisions_changed += usize::from(full.slips != seen.slips);
            row.states_changed += usize::from(full.state != seen.state);
            if full.slips != seen.slips || full.state != seen.state {
                row.differences.push(format!(
                    "frame {number}, {:.2} N: {:?}, stick ratio {:.3}, {:.2} N with nothing skipped; {:?}, {:.3}, {:.2} N (gate: {})",
                    frame.normal_n, full.state, full.ratio, full.normal_n, seen.state, seen.ratio, seen.normal_n, seen.gate.name()
                ));
            }
        }
    }
    for ([full, skipping], row) in variants.iter_mut().zip(&mut rows) {
        let after = frames.min((QUIET_FROM_S * FRAMES_PER_SECOND) as usize);
        let sum = |times: &[f64]| times.iter().sum::<f64>();
        row.cost = sum(&skipping.us) / sum(&full.us);
        row.cost_after_2_s = sum(&skipping.us[after..]) / sum(&full.us[after..]);
        row.frame_us_median = median(&mut skipping.us);
        row.full_us_median = median(&mut full.us);
    }
    Ok(rows.into())
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<14} {:>4} {:>6} {:>8} {:>9} {:>6} {:>8} {:>8} {:>8} {:>6} {:>10} {:>6} {:>7}\n",
        "scene",
        "rest",
        "frames",
        "nothing",
        "unchanged",
        "cost",
        "from 2 s",
        "us",
        "full us",
        "missed",
        "longest ms",
        "slip",
        "states"
    );
    // Writing to a String cannot fail.
    for row in rows {
        let share = |count: usize| 100.0 * count as f64 / row.frames.max(1) as f64;
        let _ = writeln!(
            text,
            "{:<14} {:>4} {:>6} {:>6.1} % {:>7.1} % {:>6.3} {:>8.3} {:>8.1} {:>8.1} {:>6} {:>10.0} {:>6} {:>7}",
            row.scene,
            row.rest_pictures,
            row.frames,
            share(row.no_contact),
            share(row.unchanged),
            row.cost,
            row.cost_after_2_s,
            row.frame_us_median,
            row.full_us_median,
            row.touch_missed,
            row.touch_missed_ms_longest,
            row.slip_decisions_changed,
            row.states_changed,
        );
    }
    let _ = writeln!(
        text,
        "cost: time over that with nothing skipped; missed: frames with {SEEN_N} N or more that the gate took for no touch; slip, states: decisions that differ from those with nothing skipped"
    );
    for row in rows {
        for difference in &row.differences {
            let _ = writeln!(text, "{}, {} at rest: {difference}", row.scene, row.rest_pictures);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten seconds of a scene with sixteen pictures at rest, then with one.
    fn played(kind: Kind) -> Vec<Row> {
        let args = SkipArgs {
            seconds: 10,
            seed: 1,
            only: String::new(),
            gate: GateKind::default(),
            instructions: None,
            json: false,
        };
        let mut scene = Scene::new(kind, &scenes::skin().unwrap(), args.seed.into()).unwrap();
        play(kind, &mut scene, &args, InstructionSet::widest()).unwrap()
    }

    #[test]
    fn a_picture_that_may_be_decided_otherwise_is_not_skipped_and_one_that_may_not_is() {
        for row in played(Kind::LightTouches) {
            let changed = (row.slip_decisions_changed, row.states_changed);
            assert!(changed.0 == 0 && changed.1 <= 1, "{:#?}", row.differences);
            assert!(row.no_contact + row.unchanged > row.frames / 2, "{row:?}");
        }
        for row in played(Kind::QuietHold) {
            assert_eq!(
                (row.slip_decisions_changed, row.states_changed),
                (0, 0),
                "{:#?}",
                row.differences
            );
            assert!(row.unchanged > row.frames * 9 / 10, "{row:?}");
        }
    }

    /// Only `cargo xtask test --all` runs these.
    mod slow {
        use super::*;

        #[test]
        fn a_motion_below_the_noise_does_not_hide_a_slide() {
            for kind in [Kind::Slide, Kind::SlowCreep] {
                for row in played(kind) {
                    assert_eq!(row.slip_decisions_changed, 0, "{:#?}", row.differences);
                    assert!(row.states_changed <= 4, "{}: {:#?}", row.scene, row.differences);
                }
            }
        }
    }
}
