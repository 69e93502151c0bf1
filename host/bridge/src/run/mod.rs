//! `gripline run`: source → pipeline → session → line, frame by frame, with the view, plain lines or JSON. With two fingertips a
//! frame is a picture of either, in turn.
//!
//! The loop is sequential: it takes a picture at frame k, sends its map at once, and lets the link work until frame k+1; the
//! resulting line drives the (simulated) gripper in the next frame. Paced by the wall clock.

mod background;
mod capture_to_line;
mod drift;
mod fingertips;
mod handle_requests;
mod helpers;
mod output;
mod report;
mod requests;
mod restart_loop;
mod rezero;
mod settings;
mod stats;
mod summary;
mod supervisor;
mod tally;
mod terminal;
#[cfg(test)]
mod tests;
mod under_way;
mod usage;

use std::ops::Add as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use gripline_control::{Handle, channel};
use gripline_firmware::sums::TaxelRule;
use gripline_network::Architecture;
use gripline_protocol::message::Configuration;
use gripline_simulation::constants::SCENE_LOOP_S;

pub use self::capture_to_line::{CaptureToLineSummary, PartQuantiles};
use self::drift::DriftWatch;
use self::fingertips::{Fingertips, Open, Polled};
use self::helpers::Helpers;
use self::output::{Output, UserInput};
use self::requests::Requests;
use self::restart_loop::is_restart_loop;
use self::settings::{
    about, as_many_fingertips, calibrated_fingertips, calibrated_friction, floor, tell_of_another_line,
    unasked,
};
pub use self::summary::{FingertipSummary, StageSummary, Summary};
use self::supervisor::Supervisor;
use self::terminal::Terminal;
pub use self::under_way::{Pacing, Run};
use crate::config::{Overrides, Settings};
use crate::error::{Completion, Error};
use crate::live::Live;
use crate::live::fleet::Fleet;
use crate::live::foxglove::Foxglove;
use crate::live::ros2::Ros2;
use crate::log::Collector;
use crate::model::Model;
use crate::realtime::{self, behind};
use crate::source::Source;
use crate::token;
use crate::writer::WhenFull;
use gripline_capture::Counts;
use gripline_link::session::Session;
use gripline_pipeline::settings_of;
use gripline_recording::telemetry::Limits;
use gripline_recording::{Image, Metadata, Pace, Pictures, Recorder};

/// Arguments of `gripline run`.
#[derive(Debug, Clone, Args)]
pub struct RunArgs {
    #[command(flatten)]
    overrides: Overrides,
    /// Print one JSON object per frame and a summary object last on standard output.
    #[arg(long)]
    json: bool,
}

/// Runs until the end, `q`, or Ctrl-C.
///
/// # Errors
/// [`Error`] when weights, link or terminal fail.
pub fn run(args: &RunArgs) -> Result<Completion, Error> {
    let wanted = Settings::load(&args.overrides)?;
    let model = Model::of(&wanted)?;
    let of_model = settings_of(model.calibration());
    may_be_recorded(&wanted, &model)?;
    let opened = fingertips::open(&wanted, &model)?;
    if !matches!(wanted.source, Source::Simulated) {
        for open in &opened {
            tracing::info!("{}", open.description);
        }
    }
    // Of one fingertip, and of all.
    let frames_per_second = opened[0].frames_per_second;
    let pictures_per_second: f64 = opened.iter().map(|open| open.frames_per_second).sum();
    let link = wanted.mcu.open()?;
    let mut session = Session::connect(link)?;
    let opened = fingertips::at_rest(opened, &wanted, &model, &mut session)?;
    // What neither the network nor the configuration says stays as the microcontroller has it.
    let settings = wanted.microcontroller(&Configuration {
        sensors: opened.len() as u8,
        friction: calibrated_friction(&wanted).unwrap_or(of_model.friction),
        contact_min: of_model.contact_min,
        floor: floor(&wanted.source, session.settings()),
        fingertips: calibrated_fingertips(&wanted, session.settings()).map(|tip| model.sized(tip)),
        ..*session.settings()
    })?;
    as_many_fingertips(&wanted, &settings, opened.len())?;
    session.configure(settings)?;
    if let Some(note) = session.other_version() {
        tracing::warn!("{note}");
    }
    tell_of_another_line(&wanted, &settings);
    let about = about(&wanted, &model, &session, (&opened[0].rest, frames_per_second));
    let images = |open: &Open| -> Vec<Image> {
        let pictures = open.rest.pictures().iter();
        pictures.map(|crop| model.image(crop.clone())).collect()
    };
    let rests: Vec<_> = opened.iter().map(images).collect();
    // A run that waits for nothing has the time to wait for its readers.
    let (pace, when_full) = if wanted.unpaced {
        (Pace::AsFastAsPossible, WhenFull::Wait)
    } else {
        (Pace::RealTime, WhenFull::Drop)
    };
    let record = |path: &PathBuf| match Recorder::start(path, &about, &rests, pace) {
        // A service started again on a full disk still has a gripper to control.
        Err(why) if Supervisor::is_there() => {
            tracing::warn!("{why}; the run goes on without a recording");
            Ok(Recorder::unstarted(path, &why))
        }
        started => started,
    };
    let recorder = recording_file(&wanted).map(record).transpose()?;
    let drift: Vec<_> = opened.iter().filter_map(Open::particles).collect();
    let mut fingertips = Fingertips::new(opened, &model, &wanted, TaxelRule::of(&settings))?;

    let stop = Arc::new(AtomicBool::new(false));
    let signalled = Arc::clone(&stop);
    ctrlc::set_handler(move || signalled.store(true, Ordering::Relaxed))?;
    let mut output = Output::open(args.json, Limits::of(&settings), when_full)?;
    let log = Collector::start(output.is_live());
    let one_round = fingertips.are_simulated() && !output.is_live();
    let seconds = wanted.seconds.or(one_round.then_some(SCENE_LOOP_S));

    let pacing = Pacing::of(fingertips.are_live(), wanted.unpaced);
    let mut run = Run::new(session, pacing, pictures_per_second);
    let (control, inbox) = channel();
    let mut terminal = Terminal::new(control.clone())?;
    let unasked = unasked(&wanted);
    run.requests = Requests::new(inbox, unasked, fingertips.to_rezero());
    if !unasked.hold && !unasked.script {
        tracing::info!("the gripper stays as it is until it is asked for something: key h, HTTP, or --hold");
    }
    run.summary.fingertips = [Some(&wanted.source), wanted.second_source.as_ref()]
        .into_iter()
        .flatten()
        .map(FingertipSummary::of)
        .collect();
    run.recorder = recorder;
    run.pictures = wanted.pictures;
    open_to_others(&mut run, &wanted, &control, (&about, &rests))?;
    run.drift = DriftWatch::of_cameras(pacing == Pacing::Pictures, drift);
    run.helpers = Helpers::start(wanted.threads, wanted.realtime);
    background::start();
    // After the other threads have started, which would inherit it.
    if wanted.realtime {
        let lacks = realtime::enter(wanted.realtime_core);
        for lack in &lacks {
            tracing::warn!("{lack}");
        }
        run.summary.realtime_lacks = Some(lacks);
    }
    let is_wanted = || !stop.load(Ordering::Relaxed);
    play(
        &mut run,
        &mut fingertips,
        &mut output,
        &log,
        &mut terminal,
        (seconds, &is_wanted),
    )?;
    close(run, &fingertips, output)
}

/// Values and requests for other programs, as configured.
fn open_to_others(
    run: &mut Run,
    wanted: &Settings,
    control: &Handle,
    (about, rests): (&Metadata, &[Vec<Image>]),
) -> Result<(), Error> {
    run.live = serve(wanted, control)?;
    if let Some(fleet) = &wanted.fleet() {
        let about = serde_json::to_string(about).unwrap_or_default();
        run.fleet = Some(behind(|| Fleet::start(fleet, about))?);
    }
    if let Some(ros2) = &wanted.ros2() {
        let sensors = run.control.session.settings().sensors;
        run.ros2 = Some(behind(|| Ros2::start(ros2, sensors, control))?);
    }
    if let Some(address) = wanted.foxglove {
        run.foxglove = Some(behind(|| Foxglove::start(address, about, rests))?);
    }
    Ok(())
}

/// Finishes the recording and prints what the run came to.
fn close(mut run: Run, fingertips: &Fingertips, output: Output) -> Result<Completion, Error> {
    let counts = fingertips.counts();
    run.summary.pictures = counts.iter().flatten().copied().reduce(Counts::add);
    for (summary, pictures) in run.summary.fingertips.iter_mut().zip(counts) {
        summary.pictures = pictures;
    }
    run.summary.output_dropped = output.dropped();
    let summary = run.summary();
    output.close(&summary)?;
    match summary.losses().as_slice() {
        [] => Ok(Completion::Whole),
        losses => Ok(Completion::WithLoss(format!(
            "done with loss: {}",
            losses.join("; ")
        ))),
    }
}

/// Serves live values and takes requests, if configured.
fn serve(wanted: &Settings, control: &Handle) -> Result<Option<Live>, Error> {
    let Some(address) = wanted.serve else {
        return Ok(None);
    };
    let file = wanted.token_file.clone().or_else(token::default_file).ok_or_else(|| {
        Error::usage(
            "serve.token_file (--token-file): found none, and no state folder (XDG_STATE_HOME, HOME); expected a file",
        )
    })?;
    let token = token::of(&file)?;
    let live = behind(|| Live::start(address, control.clone(), token))?;
    tracing::info!(
        "requests bear the token in {}; page, /status, /metrics and /frames at http://{}",
        file.display(),
        live.address()
    );
    Ok(Some(live))
}

/// The file to record into, unless systemd seems to restart the program in a loop.
fn recording_file(wanted: &Settings) -> Option<&PathBuf> {
    let file = wanted.record.as_ref()?;
    if Supervisor::is_there() && is_restart_loop(file) {
        tracing::warn!(
            "{}: not recorded, because the last 20 recordings of this name lasted less than a minute each: find out why the \
             program ends, and move them away",
            file.display()
        );
        return None;
    }
    Some(file)
}

/// Only one of the networks works with small pictures.
fn may_be_recorded(wanted: &Settings, model: &Model) -> Result<(), Error> {
    let is_enough = |model: &Model| {
        let network = model.network();
        network.is_some_and(|network| network.architecture() == Architecture::Unet)
    };
    if wanted.record.is_some() && wanted.pictures == Pictures::Small && !is_enough(model) {
        let of = model.network().map_or_else(
            || format!("sensor {}", model.sensor.identity()),
            |network| format!("the network {}", network.architecture()),
        );
        return Err(Error::usage(format!(
            "record.pictures (--record-pictures): found small with {of}, expected full or off: it looks at the whole picture"
        )));
    }
    Ok(())
}

/// Processes pictures until the time is over or the user stops it.
fn play(
    run: &mut Run,
    fingertips: &mut Fingertips,
    output: &mut Output,
    log: &Collector,
    terminal: &mut Terminal,
    (seconds, is_wanted): (Option<f64>, &dyn Fn() -> bool),
) -> Result<(), Error> {
    let supervisor = Supervisor::of_environment();
    supervisor.ready();
    while is_wanted() && seconds.is_none_or(|seconds| !run.is_over(seconds)) {
        supervisor.turned();
        let input = match fingertips.next(run.control.session.line_n())? {
            Polled::Picture(sensor, picture) => {
                let pipeline = fingertips.pipeline(sensor);
                let report = run.frame(pipeline, sensor, picture)?;
                output.frame(&report, pipeline.newtons())?
            }
            Polled::NotYet => {
                run.idle()?;
                output.idle()?
            }
            Polled::End => UserInput::Stop,
        };
        run.advance_rezero(fingertips)?;
        if run.settings_changed() {
            output.limits(Limits::of(run.control.session.settings()));
        }
        run.check_pictures(&fingertips.counts());
        for line in log.take() {
            run.record_line(&line);
            output.show_line(&line);
        }
        match input {
            UserInput::Nothing => {}
            UserInput::Keys(keys) => keys.into_iter().for_each(|key| terminal.ask(key)),
            UserInput::Stop => break,
        }
    }
    supervisor.stopping();
    Ok(())
}
