//! `gripline run`: source → pipeline → session → line, frame by frame, with the view, plain lines or JSON.
//!
//! The loop is a straight line: a picture is taken at frame k, its map goes out at once, the link works until frame
//! k+1, and the line it then holds is what the (simulated) gripper feels next. Paced by the wall clock.

use std::fmt;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use gripline_firmware::Fault;
use gripline_firmware::sums::{TaxelRule, centre_of_pressure_um, stick_ratio_below};
use gripline_network::Network;
use gripline_network::scene::Verdict;
use gripline_protocol::message::{Command, Configuration, GripMode, Status};
use gripline_protocol::{Health, LSB_PER_NEWTON, MapInfo, PER_UNIT};
use gripline_simulation::constants::{SCENE_INITIAL_GRIP_N, SCENE_LOOP_S};
use serde::Serialize;

use crate::config::{Overrides, Settings};
use crate::error::Failure;
use crate::pipeline::Pipeline;
use crate::session::{SentMap, Session};
use crate::source::{Picture, SimulatedSource, Source};
use crate::stats::Times;
use crate::telemetry::{FrameReport, Limits, STAGES, health_names};
use crate::units::{force_n, moment_nmm, newtons, ratio, shear_n, stick_ratio};
use crate::view::{Screen, View};

/// Frames a second of the simulated camera.
const FRAMES_PER_SECOND: f64 = 60.0;
/// Pictures at rest that are averaged before anything touches.
const REST_PICTURES: usize = 16;

/// Arguments of `gripline run`.
#[derive(Debug, Clone, Args)]
pub struct RunArgs {
    #[command(flatten)]
    overrides: Overrides,
    /// One JSON object a frame, and a summary object last, on standard output.
    #[arg(long)]
    json: bool,
}

/// The last line of `--json`.
#[derive(Debug, Serialize)]
struct Summary {
    /// Always true: tells this object from those of the frames.
    #[serde(rename = "summary")]
    last: bool,
    mcu: String,
    /// Version, commit and board, as the handshake told them.
    firmware: Option<String>,
    frames: u64,
    seconds: f64,
    frames_per_second: f64,
    gate_no_contact: u64,
    gate_unchanged: u64,
    gate_network: u64,
    /// Frames whose picture could not be believed: their maps were empty and marked.
    gate_unhealthy: u64,
    stages: Vec<StageSummary>,
    frame_to_link_us_median: f64,
    frame_to_link_us_p99: f64,
    frame_to_link_us_p999: f64,
    /// The same over the frames that the network looked at.
    network_frame_to_link_us_median: f64,
    network_frame_to_link_us_p999: f64,
    wire_bytes: u64,
    answers_checked: u64,
    shadow_mismatches: u64,
    maps_unanswered: u64,
    commands_refused: u64,
    last_refusal: Option<String>,
    frames_late: u64,
    slip_frames: u64,
    /// Frames in which the object slides as a whole while it is to be held: what is let go may slide.
    gross_slip_frames: u64,
    slip_mm: f64,
    line_n_min_holding: f64,
    line_n_max: f64,
    microcontroller_worst_cycles: [u32; 4],
}

#[derive(Debug, Serialize)]
struct StageSummary {
    stage: &'static str,
    frames: u64,
    median_us: f64,
    p99_us: f64,
}

/// Runs until the end, `q`, or Ctrl-C.
///
/// # Errors
/// [`Failure`] when weights, link or terminal fail, and with kind Loss when maps got no answer.
pub fn run(args: &RunArgs) -> Result<(), Failure> {
    let wanted = Settings::load(&args.overrides)?;
    let network = network_for(&wanted)?;
    let of_network = settings_for(&network);
    let Source::Simulated = wanted.source;
    let mut source = SimulatedSource::new(wanted.seed, FRAMES_PER_SECOND);
    let rest = source.rest(REST_PICTURES);
    let link = wanted.mcu.open().map_err(Failure::failed)?;
    let mut session = Session::connect(link).map_err(Failure::failed)?;
    // What neither the network nor the configuration says stays as the microcontroller has it.
    let settings = wanted.microcontroller(&Configuration {
        friction: of_network.friction,
        contact_min: of_network.contact_min,
        floor: of_network.floor,
        ..*session.settings()
    })?;
    session.configure(settings).map_err(Failure::failed)?;
    let mut pipeline = Pipeline::new(network, &rest, wanted.gate, TaxelRule::of(&settings));

    let stop = Arc::new(AtomicBool::new(false));
    let signalled = Arc::clone(&stop);
    ctrlc::set_handler(move || signalled.store(true, Ordering::Relaxed)).map_err(Failure::failed)?;
    let mut output = Output::open(args.json, limits(&settings))?;
    let seconds = wanted.seconds.or((!output.is_live()).then_some(SCENE_LOOP_S));
    let frames = seconds.map(|seconds| (seconds * FRAMES_PER_SECOND).round() as u64);

    let mut run = Run::new(session, !wanted.unpaced);
    while !stop.load(Ordering::Relaxed) && frames.is_none_or(|frames| run.frame < frames) {
        let picture = source.next(run.line_n()).map_err(Failure::failed)?;
        let report = run.frame(&mut pipeline, picture)?;
        if output.frame(&report, pipeline.newtons())? == Wish::Stop {
            break;
        }
    }
    let summary = run.summary();
    output.close(&summary)?;
    if summary.gate_unhealthy > 0 {
        return Err(Failure::loss(format!(
            "done with loss: {} of {} pictures could not be believed; their maps were empty and marked",
            summary.gate_unhealthy, summary.frames
        )));
    }
    if summary.maps_unanswered > 0 {
        return Err(Failure::loss(format!(
            "done with loss: {} of {} maps got no answer from the microcontroller",
            summary.maps_unanswered, summary.frames
        )));
    }
    Ok(())
}

/// The network that was asked for.
fn network_for(wanted: &Settings) -> Result<Network, Failure> {
    let network = match &wanted.weights {
        Some(path) => Network::from_file(path, wanted.architecture),
        None => Network::embedded(wanted.architecture.unwrap_or_default()),
    }
    .map_err(Failure::failed)?;
    match wanted.instructions {
        Some(set) => network.with_instructions(set).map_err(Failure::failed),
        None => Ok(network),
    }
}

/// The default settings with what the network was calibrated for, and the grip with which the scene's object is held.
#[must_use]
pub fn settings_for(network: &Network) -> Configuration {
    let calibration = network.calibration();
    Configuration {
        friction: (calibration.friction * PER_UNIT as f32).round() as u16,
        contact_min: (calibration.contact_min_n * LSB_PER_NEWTON as f32) as i16,
        floor: (SCENE_INITIAL_GRIP_N * f64::from(LSB_PER_NEWTON)) as i32,
        ..Configuration::DEFAULT
    }
}

fn limits(settings: &Configuration) -> Limits {
    Limits {
        friction: ratio(settings.friction),
        slip_threshold: ratio(settings.slip_threshold),
        contact_min_n: newtons(settings.contact_min.into()),
        floor_n: newtons(settings.floor),
        ceiling_n: newtons(settings.ceiling),
    }
}

/// A run under way.
struct Run {
    session: Session,
    frame: u64,
    /// The link's time of frame 0, µs.
    start_us: u64,
    started: Instant,
    paced: bool,
    wish: Option<GripMode>,
    stages: [Times; STAGES.len()],
    frame_to_link: Times,
    network_frame_to_link: Times,
    summary: Summary,
}

impl Run {
    fn new(session: Session, paced: bool) -> Self {
        let summary = Summary {
            last: true,
            mcu: session.link_name(),
            firmware: session.firmware().map(ToString::to_string),
            frames: 0,
            seconds: 0.0,
            frames_per_second: 0.0,
            gate_no_contact: 0,
            gate_unchanged: 0,
            gate_network: 0,
            gate_unhealthy: 0,
            stages: Vec::new(),
            frame_to_link_us_median: 0.0,
            frame_to_link_us_p99: 0.0,
            frame_to_link_us_p999: 0.0,
            network_frame_to_link_us_median: 0.0,
            network_frame_to_link_us_p999: 0.0,
            wire_bytes: 0,
            answers_checked: 0,
            shadow_mismatches: 0,
            maps_unanswered: 0,
            commands_refused: 0,
            last_refusal: None,
            frames_late: 0,
            slip_frames: 0,
            gross_slip_frames: 0,
            slip_mm: 0.0,
            line_n_min_holding: f64::INFINITY,
            line_n_max: 0.0,
            microcontroller_worst_cycles: [0; 4],
        };
        Self {
            start_us: session.now_us(),
            session,
            frame: 0,
            started: Instant::now(),
            paced,
            wish: None,
            stages: Default::default(),
            frame_to_link: Times::default(),
            network_frame_to_link: Times::default(),
            summary,
        }
    }

    /// The grip-force line as the microcontroller last told it.
    fn line_n(&self) -> f64 {
        self.session.status().map_or(0.0, |status| newtons(status.line))
    }

    /// µs of the link's clock at frame `frame`.
    fn time_us(&self, frame: u64) -> u64 {
        self.start_us + (frame as f64 * 1e6 / FRAMES_PER_SECOND) as u64
    }

    /// One frame: picture in, map out, answer in.
    fn frame(&mut self, pipeline: &mut Pipeline, picture: Picture) -> Result<FrameReport, Failure> {
        if self.wish != Some(picture.wish) {
            let command = if picture.wish == GripMode::Hold {
                Command::Hold
            } else {
                Command::Release
            };
            self.session.command(command).map_err(Failure::failed)?;
            self.wish = Some(picture.wish);
        }
        let sequence = self.frame as u32;
        let taken = Instant::now();
        let capture_us = self.session.capture_us();
        let processed = pipeline.process(&picture.crop).map_err(Failure::failed)?;
        let info = MapInfo {
            sensor: 0,
            sequence,
            capture_us,
            health: processed.health,
        };
        let sent = self
            .session
            .send_map(&info, processed.map)
            .map_err(Failure::failed)?;
        let latency_us = taken.elapsed().as_secs_f64() * 1e6;
        let (verdict, health, stages) = (processed.verdict, processed.health, processed.stages_us);
        let stages_us = [stages[0], stages[1], stages[2], sent.encode_us, sent.link_us];
        self.count(verdict, &stages_us, latency_us, &sent);

        self.session
            .run_until(self.time_us(self.frame + 1))
            .map_err(Failure::failed)?;
        if let Some(refusal) = self.session.take_refusal() {
            self.summary.commands_refused += 1;
            self.summary.last_refusal = Some(format!("{refusal:?}"));
        }
        if self.paced {
            self.wait_for_the_clock();
        }
        let status = self.session.status().copied().unwrap_or_default();
        let answered = status.sequence == sequence && status.maps > 0;
        self.summary.maps_unanswered += u64::from(!answered);
        let report = report_of(
            self.frame, &status, verdict, health, latency_us, stages_us, sent.bytes, picture,
        );
        self.observe(&report, &status);
        self.frame += 1;
        Ok(report)
    }

    /// Waits until the next frame is due; a link that waits for the wall clock itself leaves nothing to wait for.
    fn wait_for_the_clock(&mut self) {
        let due = self.started + Duration::from_secs_f64((self.frame + 1) as f64 / FRAMES_PER_SECOND);
        let now = Instant::now();
        if due > now {
            thread::sleep(due - now);
        } else if now - due > Duration::from_secs_f64(1.0 / FRAMES_PER_SECOND) {
            // More than a frame behind: the machine is too slow for real time, which is no loss in a simulated world.
            self.summary.frames_late += 1;
        }
    }

    fn count(&mut self, verdict: Verdict, stages_us: &[f64; STAGES.len()], latency_us: f64, sent: &SentMap) {
        let summary = &mut self.summary;
        *match verdict {
            Verdict::NoContact => &mut summary.gate_no_contact,
            Verdict::Unchanged => &mut summary.gate_unchanged,
            Verdict::Network => &mut summary.gate_network,
            Verdict::Unhealthy => &mut summary.gate_unhealthy,
        } += 1;
        summary.wire_bytes += sent.bytes as u64;
        for ((times, &us), name) in self.stages.iter_mut().zip(stages_us).zip(STAGES) {
            if name != "network" || verdict == Verdict::Network {
                times.push(us);
            }
        }
        self.frame_to_link.push(latency_us);
        if verdict == Verdict::Network {
            self.network_frame_to_link.push(latency_us);
        }
    }

    fn observe(&mut self, report: &FrameReport, status: &Status) {
        let summary = &mut self.summary;
        summary.slip_frames += u64::from(stick_ratio_below(
            &status.sums,
            self.session.settings().slip_threshold,
        ));
        if let Some(truth) = &report.truth {
            summary.gross_slip_frames += u64::from(truth.gross_slip && status.mode == GripMode::Hold);
            summary.slip_mm = summary.slip_mm.max(truth.slip_mm);
        }
        if report.contact > 0 && status.mode == GripMode::Hold {
            summary.line_n_min_holding = summary.line_n_min_holding.min(report.line_n);
        }
        summary.line_n_max = summary.line_n_max.max(report.line_n);
        summary.microcontroller_worst_cycles = status.worst_cycles;
    }

    fn summary(self) -> Summary {
        let seconds = self.started.elapsed().as_secs_f64();
        let stages = STAGES
            .into_iter()
            .zip(&self.stages)
            .map(|(stage, times)| StageSummary {
                stage,
                frames: times.count(),
                median_us: times.quantile_us(0.5),
                p99_us: times.quantile_us(0.99),
            });
        let line_n_min_holding = self.summary.line_n_min_holding;
        Summary {
            frames: self.frame,
            seconds,
            frames_per_second: self.frame as f64 / seconds.max(1e-9),
            stages: stages.collect(),
            frame_to_link_us_median: self.frame_to_link.quantile_us(0.5),
            frame_to_link_us_p99: self.frame_to_link.quantile_us(0.99),
            frame_to_link_us_p999: self.frame_to_link.quantile_us(0.999),
            network_frame_to_link_us_median: self.network_frame_to_link.quantile_us(0.5),
            network_frame_to_link_us_p999: self.network_frame_to_link.quantile_us(0.999),
            answers_checked: self.session.shadow().checked(),
            shadow_mismatches: self.session.shadow().mismatches(),
            // JSON has no infinity: never held, so nothing to say.
            line_n_min_holding: if line_n_min_holding.is_finite() {
                line_n_min_holding
            } else {
                0.0
            },
            ..self.summary
        }
    }
}

#[expect(clippy::too_many_arguments, reason = "what one frame is known by")]
fn report_of(
    frame: u64,
    status: &Status,
    gate: Verdict,
    health: Health,
    latency_us: f64,
    stages_us: [f64; STAGES.len()],
    wire_bytes: usize,
    picture: Picture,
) -> FrameReport {
    let sums = &status.sums;
    let [x, y, z] = force_n(sums);
    let faults = status.faults | status.latched;
    FrameReport {
        frame,
        t_s: frame as f64 / FRAMES_PER_SECOND,
        gate,
        health: health_names(health),
        normal_n: z,
        shear_x_n: x,
        shear_y_n: y,
        shear_n: shear_n(sums),
        moment_nmm: moment_nmm(sums),
        centre_of_pressure_mm: centre_of_pressure_um(sums).map(|place| place.map(|um| f64::from(um) / 1e3)),
        contact: sums.contact,
        stick: sums.stick,
        stick_ratio: stick_ratio(sums),
        coulomb_slip: status.coulomb_slip,
        state: status.state.name(),
        time_to_slip_ms: status.time_to_slip_ms,
        line_n: newtons(status.line),
        latency_us,
        stages_us,
        faults: Fault::ALL
            .iter()
            .filter(|fault| faults & fault.bit() != 0)
            .map(|fault| fault.name())
            .collect(),
        wire_bytes,
        truth: Some(picture.truth),
    }
}

/// What the person at the terminal wants.
#[derive(Debug, PartialEq, Eq)]
enum Wish {
    GoOn,
    Stop,
}

/// Where the reports go.
enum Output {
    Json(io::BufWriter<io::Stdout>),
    Live { screen: Box<Screen>, view: Box<View> },
    Lines,
}

impl Output {
    fn open(json: bool, limits: Limits) -> Result<Self, Failure> {
        if json {
            return Ok(Self::Json(io::BufWriter::new(io::stdout())));
        }
        if io::stdout().is_terminal() {
            let screen = Screen::open().map_err(|error| {
                Failure::failed(format!("terminal: {error}, expected one to draw on; try --json"))
            })?;
            return Ok(Self::Live {
                screen: Box::new(screen),
                view: Box::new(View::new(limits)),
            });
        }
        Ok(Self::Lines)
    }

    fn is_live(&self) -> bool {
        matches!(self, Self::Live { .. })
    }

    fn frame(&mut self, report: &FrameReport, map: &[[f32; 3]; 400]) -> Result<Wish, Failure> {
        match self {
            Self::Json(out) => {
                let written = serde_json::to_writer(&mut *out, report)
                    .map_err(io::Error::from)
                    .and_then(|()| writeln!(out))
                    .and_then(|()| out.flush());
                still_wanted(written)
            }
            Self::Live { screen, view } => {
                view.push(report, map);
                // Every second frame: terminals gain nothing from more.
                if report.frame.is_multiple_of(2) {
                    screen.draw(view).map_err(terminal_failed)?;
                }
                Ok(if screen.quit_requested().map_err(terminal_failed)? {
                    Wish::Stop
                } else {
                    Wish::GoOn
                })
            }
            Self::Lines if report.frame.is_multiple_of(FRAMES_PER_SECOND as u64) => {
                still_wanted(writeln!(io::stdout(), "{}", progress_line(report)))
            }
            Self::Lines => Ok(Wish::GoOn),
        }
    }

    fn close(self, summary: &Summary) -> Result<(), Failure> {
        let written = match self {
            Self::Json(mut out) => serde_json::to_writer(&mut out, summary)
                .map_err(io::Error::from)
                .and_then(|()| writeln!(out))
                .and_then(|()| out.flush()),
            Self::Live { screen, .. } => {
                drop(screen);
                writeln!(io::stdout(), "{}", summary_text(summary))
            }
            Self::Lines => writeln!(io::stdout(), "{}", summary_text(summary)),
        };
        still_wanted(written).map(|_| ())
    }
}

/// A reader that went away (`| head`) is no failure.
fn still_wanted(written: io::Result<()>) -> Result<Wish, Failure> {
    match written {
        Ok(()) => Ok(Wish::GoOn),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(Wish::Stop),
        Err(error) => Err(Failure::failed(format!("standard output: {error}"))),
    }
}

fn terminal_failed(error: impl fmt::Display) -> Failure {
    Failure::failed(format!("terminal: {error}"))
}

fn progress_line(report: &FrameReport) -> String {
    let ratio = report
        .stick_ratio
        .map_or_else(|| "  - ".to_owned(), |ratio| format!("{ratio:4.2}"));
    let truth = report.truth.as_ref().map_or_else(String::new, |truth| {
        format!("  [{}, slid {:.2} mm]", truth.phase, truth.slip_mm)
    });
    format!(
        "{:6.1} s  {:10}  stick ratio {ratio}  F_N {:5.2} N  F_T {:5.2} N  M_z {:6.1} Nmm  line {:5.2} N  {:4.0} µs{truth}",
        report.t_s,
        report.state,
        report.normal_n,
        report.shear_n,
        report.moment_nmm,
        report.line_n,
        report.latency_us
    )
}

fn summary_text(summary: &Summary) -> String {
    use fmt::Write as _;
    let firmware = summary.firmware.as_deref().unwrap_or("unknown");
    let mut text = format!(
        "{} frames in {:.1} s ({:.1} a second) with the {}, firmware {firmware}\n",
        summary.frames, summary.seconds, summary.frames_per_second, summary.mcu
    );
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "gate: {} no contact, {} unchanged, {} to the network",
        summary.gate_no_contact, summary.gate_unchanged, summary.gate_network
    );
    for stage in &summary.stages {
        let _ = writeln!(
            text,
            "{:>12}  median {:7.1} µs  p99 {:7.1} µs",
            stage.stage, stage.median_us, stage.p99_us
        );
    }
    let _ = writeln!(
        text,
        "frame to link: median {:.0} µs, p99.9 {:.0} µs; with the network {:.0} and {:.0} µs",
        summary.frame_to_link_us_median,
        summary.frame_to_link_us_p999,
        summary.network_frame_to_link_us_median,
        summary.network_frame_to_link_us_p999
    );
    let _ = write!(
        text,
        "line {:.2} to {:.2} N; {} slip frames, {} frames of gross slip ({:.2} mm); {} answers checked, {} wrong, {} maps unanswered",
        summary.line_n_min_holding,
        summary.line_n_max,
        summary.slip_frames,
        summary.gross_slip_frames,
        summary.slip_mm,
        summary.answers_checked,
        summary.shadow_mismatches,
        summary.maps_unanswered
    );
    if let Some(refusal) = &summary.last_refusal {
        let _ = write!(
            text,
            "\n{} commands refused by the microcontroller, the last: {refusal}",
            summary.commands_refused
        );
    }
    text
}
