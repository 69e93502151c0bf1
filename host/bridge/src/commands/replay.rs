//! `gripline replay`: the pictures of a recording through the same loop again, and every decision compared with the recorded
//! one: gate, health, map, the microcontroller's sums, slip state, line and faults. Bit by bit.
//!
//! The microcontroller is the firmware's library in this process. Where a real one answered, its own clock is not in the
//! recording: then its state and line, which depend on milliseconds, are compared too but only counted.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use gripline_firmware::sums::TaxelRule;
use gripline_network::scene::{GateDecision, GateKind};
use gripline_network::{Architecture, InstructionSet, Network, NetworkError};
use gripline_protocol::message::{Configuration, Status};
use gripline_protocol::{Health, Motion, SENSORS};
use serde::Serialize;

use crate::config::settings_from_text;
use crate::error::{Completion, Error};
use crate::model::{AtRest, Model};
use gripline_link::session::Session;
use gripline_link::{EmbeddedLink, Link};
use gripline_pipeline::control_loop::gate_name;
use gripline_pipeline::control_loop::{ControlLoop, FrameOutcome, FrameRequest, Late, Lateness};
use gripline_pipeline::markers::MarkerRest;
use gripline_pipeline::pipeline::{Pipeline, fingerprint};
use gripline_recording::{Completeness, Image, Metadata, Reader, RecordedFrame, RecordedStatus};

/// Up to this number, differing frames are listed one by one.
const NAMED: usize = 5;

/// Arguments of `gripline replay`.
#[derive(Debug, Clone, Args)]
pub struct ReplayArgs {
    /// The recording.
    #[arg(value_name = "REC.mcap")]
    recording: PathBuf,
    /// Weights of the run, if it did not use the built-in ones.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Print the summary as one JSON object.
    #[arg(long)]
    json: bool,
}

/// The result of a replay.
#[derive(Debug, Default, Serialize)]
struct Replayed {
    frames: u64,
    /// Frames without a picture, whose maps were taken from the recording.
    without_picture: u64,
    /// Frames after such a gap that depend on a missing picture.
    not_comparable: u64,
    /// Frames decided differently than in the run.
    different: u64,
    /// Frames in which a real microcontroller's state or line differed from the library's.
    state_or_line_different: u64,
    /// Numbers of frames missing in the recording.
    missing: u64,
    /// Why the recording ends early.
    cut_short: Option<String>,
    #[serde(skip)]
    named: Vec<String>,
}

/// Replays.
///
/// # Errors
/// [`Error`] when the recording cannot be used or a decision differs.
pub fn run(args: &ReplayArgs) -> Result<Completion, Error> {
    let mut reader = Reader::open(&args.recording)?;
    let shown = args.recording.display();
    let replayed = replay(&mut reader, args)?;
    let line = if args.json {
        serde_json::to_string(&replayed)?
    } else {
        text(&replayed)
    };
    writeln!(std::io::stdout(), "{line}")?;
    if replayed.different > 0 {
        return Err(Error::failed(format!(
            "{shown}: {} of {} frames decided otherwise, expected none: {}",
            replayed.different,
            replayed.frames,
            replayed.named.join("; ")
        )));
    }
    if let Some(why) = &replayed.cut_short {
        return Ok(Completion::WithLoss(format!(
            "{shown}: a recording cut short after {} frames ({why}); what is there was replayed",
            replayed.frames
        )));
    }
    if replayed.missing > 0 {
        return Ok(Completion::WithLoss(format!(
            "{shown}: {} frames are missing in the recording: the disk was too slow",
            replayed.missing
        )));
    }
    Ok(Completion::Whole)
}

fn text(replayed: &Replayed) -> String {
    let compared = replayed.frames - replayed.not_comparable;
    let mut parts = vec![format!(
        "{compared} of {} frames compared, {} decided otherwise",
        replayed.frames, replayed.different
    )];
    let mut counted = |count: u64, what: &str| {
        if count > 0 {
            parts.push(format!("{count} {what}"));
        }
    };
    counted(replayed.without_picture, "without a picture, from their maps on");
    counted(
        replayed.state_or_line_different,
        "with another state or line of the real microcontroller",
    );
    parts.join("; ")
}

/// A client set another floor.
fn follow_floor(control: &mut ControlLoop, floor_lsb: Option<i32>) -> Result<(), Error> {
    let settings = *control.session.settings();
    if let Some(floor) = floor_lsb.filter(|floor| *floor != settings.floor) {
        control.session.configure(Configuration { floor, ..settings })?;
    }
    Ok(())
}

fn replay(reader: &mut Reader, args: &ReplayArgs) -> Result<Replayed, Error> {
    let shown = args.recording.display();
    let (mut pipelines, settings) = pipelines_of(reader, args)?;
    let link = Box::new(EmbeddedLink::new());
    // The same name in the recording means the same code on the same virtual clock.
    let exact = reader.metadata.mcu == link.name();
    let mut session = Session::connect(link)?;
    session.configure(settings)?;
    let mut control = ControlLoop::new(session);
    let mut replayed = Replayed::default();
    // Whether each gate's reference is the one that the run had: not after a picture that the recording lacks.
    let mut all_known = [true; SENSORS];
    // Fingertips whose maps' numbers are unknown since frames are missing.
    let mut lost = [false; SENSORS];
    let mut next = 0;
    while let Some(RecordedFrame {
        status, map, picture, ..
    }) = reader.next_frame()?
    {
        let verdict = verdict_of(&status.gate).ok_or_else(|| {
            Error::failed(format!(
                "{shown}: frame {}: found gate {}",
                status.frame, status.gate
            ))
        })?;
        let recorded = (verdict, Health::from_bits(status.health_bits));
        if status.frame != next {
            replayed.missing += status.frame.saturating_sub(next);
            (lost, all_known) = ([true; SENSORS], [false; SENSORS]);
        }
        let sensor = status.sensor.index();
        let known = &mut all_known[sensor];
        let pipeline = pipelines.get_mut(sensor).ok_or_else(|| {
            Error::failed(format!(
                "{shown}: frame {}: found a frame of the second fingertip, expected its pictures at rest before it",
                status.frame
            ))
        })?;
        if std::mem::take(&mut lost[sensor]) {
            control.resume_at(status.sensor, status.sequence);
        }
        next = status.frame + 1;
        replayed.frames += 1;
        let late = status.late.as_deref().and_then(Late::named);
        // Nobody looked at it in the run either.
        let unseen = late == Some(Late::Picture);
        replayed.without_picture += u64::from(picture.is_none() && !unseen);
        *known &= picture.is_some() || unseen;
        let mut wrong = Vec::new();
        // A camera's pictures come when they come.
        let begun_us = status.begun_us.unwrap_or(status.capture_us);
        control.idle_until_begun(begun_us)?;
        follow_floor(&mut control, status.floor_lsb)?;
        let request = FrameRequest {
            mode: status.requested_mode,
            age_us: begun_us.wrapping_sub(status.capture_us),
            motion: Motion::from_bits(status.motion_bits),
            ..FrameRequest::of_now(status.sensor, status.until_us)
        };
        let outcome = match picture.map(Image::into_crop) {
            _ if unseen => control.skip(request)?,
            Some(crop) if *known => control.frame(pipeline, &crop, Lateness::Recorded(late), request)?,
            picture => {
                if let Some(crop) = picture {
                    let found = pipeline.process(&crop)?.gate;
                    // Both looked afresh, or both saw nothing: from here on the references are the same.
                    *known =
                        found == verdict && [GateDecision::Infer, GateDecision::NoContact].contains(&found);
                }
                if late.is_some() {
                    control.skip(request)?
                } else {
                    control.frame_of(&map, recorded, request)?
                }
            }
        };
        if !*known {
            replayed.not_comparable += 1;
        } else if (outcome.gate, outcome.health) != recorded {
            wrong.push("gate");
        } else if *pipeline.map() != *map {
            wrong.push("map");
        }
        if !same_sums(&outcome, &status) {
            wrong.push("sums");
        }
        match same_state_and_line(&outcome.status, &status.wire) {
            true => {}
            false if exact && replayed.missing == 0 => wrong.push("state or line"),
            false => replayed.state_or_line_different += 1,
        }
        if !wrong.is_empty() {
            replayed.different += 1;
            if replayed.named.len() < NAMED {
                replayed
                    .named
                    .push(format!("frame {}: {}", status.frame, wrong.join(", ")));
            }
        }
    }
    if let Completeness::Truncated(why) = reader.completeness() {
        replayed.cut_short = Some(why);
    }
    Ok(replayed)
}

/// The run's pipelines, one per fingertip, and its settings, restored.
fn pipelines_of(reader: &Reader, args: &ReplayArgs) -> Result<(Vec<Pipeline>, Configuration), Error> {
    let Metadata {
        network,
        instructions,
        gate,
        settings,
        ..
    } = &reader.metadata;
    let wrong = |what: String| Error::failed(format!("{}: {what}", args.recording.display()));
    if let Some(model) = Model::recorded(&reader.metadata, args.weights.as_deref())? {
        return marker_pipelines_of(reader, &model, wrong);
    }
    let unknown = |error: NetworkError| wrong(error.to_string());
    let architecture: Architecture = network.parse().map_err(unknown)?;
    let gate: GateKind = gate.parse().map_err(unknown)?;
    let settings = settings_from_text(settings, &Configuration::DEFAULT).map_err(&wrong)?;
    let first = reader.rest[0].first().ok_or_else(|| {
        wrong("found no picture at rest, expected some at the beginning of the recording".to_owned())
    })?;
    let mut network = match &args.weights {
        Some(path) => Network::from_file(path, Some(architecture)),
        None => Network::embedded(architecture),
    }?;
    // The others all compute the same bits.
    if instructions == &InstructionSet::Portable.to_string() {
        network = network.with_instructions(InstructionSet::Portable)?;
    }
    let found = fingerprint(&network, first);
    if found != reader.metadata.fingerprint {
        return Err(wrong(format!(
            "recorded with other weights ({}; {}; fingerprint {}), found {} with fingerprint {found}; name them with --weights",
            reader.metadata.weights_file,
            reader.metadata.weights,
            reader.metadata.fingerprint,
            network.manifest()
        )));
    }
    let calibrations = reader.metadata.calibrations()?;
    let rests = reader.rest.iter().zip(calibrations);
    let pipelines = rests
        .filter(|(rest, _)| !rest.is_empty())
        .map(|(rest, calibration)| {
            let network = network.clone().with_gain(calibration.gain);
            Pipeline::new(network, rest, gate, TaxelRule::of(&settings))
        });
    Ok((pipelines.collect(), settings))
}

/// The same of printed markers, whose description is in the recording.
fn marker_pipelines_of(
    reader: &Reader,
    model: &Model,
    wrong: impl Fn(String) -> Error,
) -> Result<(Vec<Pipeline>, Configuration), Error> {
    let metadata = &reader.metadata;
    let gate: GateKind = metadata
        .gate
        .parse()
        .map_err(|error: NetworkError| wrong(error.to_string()))?;
    let settings = settings_from_text(&metadata.settings, &Configuration::DEFAULT).map_err(&wrong)?;
    let rests = reader.rest.iter().take(settings.sensors.into());
    let rests: Vec<AtRest> = rests
        .map(|pictures| Ok::<_, Error>(AtRest::Markers(MarkerRest::recorded(&metadata.rest, pictures)?)))
        .collect::<Result<_, _>>()?;
    for rest in rests.iter().take(1) {
        let [name, manifest, fingerprint] = model.named(rest);
        if fingerprint != metadata.fingerprint {
            return Err(wrong(format!(
                "recorded with other forces ({}; {}; fingerprint {}), found {name}; {manifest}; with fingerprint {fingerprint}; name \
                 the weights with --weights",
                metadata.network, metadata.weights, metadata.fingerprint
            )));
        }
    }
    let pipelines = rests
        .iter()
        .enumerate()
        .map(|(fingertip, rest)| model.pipeline(fingertip, rest, gate, TaxelRule::of(&settings)));
    Ok((pipelines.collect::<Result<_, _>>()?, settings))
}

fn verdict_of(name: &str) -> Option<GateDecision> {
    use GateDecision::{Infer, NoContact, Unchanged, Unhealthy};
    [NoContact, Unchanged, Infer, Unhealthy]
        .into_iter()
        .find(|verdict| gate_name(*verdict) == name)
}

/// Whether the microcontroller decided the same for this map; a map without an answer is not compared.
fn same_sums(outcome: &FrameOutcome, recorded: &RecordedStatus) -> bool {
    let (now, then) = (&outcome.status, &recorded.wire);
    then.sequence != recorded.sequence
        || then.sensor != recorded.sensor
        || recorded.late.is_some()
        || (outcome.answered && (now.sums, now.coulomb_slip) == (then.sums, then.coulomb_slip))
}

/// What depends on the microcontroller's clock.
fn same_state_and_line(now: &Status, then: &Status) -> bool {
    (now.state, now.time_to_slip_ms, now.mode, now.line)
        == (then.state, then.time_to_slip_ms, then.mode, then.line)
        && (now.faults, now.latched) == (then.faults, then.latched)
}
