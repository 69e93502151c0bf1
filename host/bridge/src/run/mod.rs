//! `gripline run`: source → pipeline → session → line, frame by frame, with the view, plain lines or JSON.
//!
//! The loop is a straight line: a picture is taken at frame k, its map goes out at once, the link works until frame
//! k+1, and the line it then holds is what the (simulated) gripper feels next. Paced by the wall clock.

#[cfg(test)]
mod faults;
mod output;
mod summary;
mod usage;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use gripline_firmware::Fault;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below};
use gripline_network::constants::{CROP_SIDE, IMAGE_SIDE};
use gripline_network::scene::Verdict;
use gripline_network::{Architecture, InstructionSet, Network};
use gripline_protocol::message::{Configuration, FingertipGeometry, GripMode, Refusal, Status};
use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT, SENSORS};
use gripline_simulation::constants::{REST_PICTURES, SCENE_INITIAL_GRIP_N, SCENE_LOOP_S};

use self::output::{Output, Wish};
use self::summary::{StageSummary, Summary};
use crate::calibrate::line::with_points;
use crate::config::{Overrides, Settings, settings_text};
use crate::cycle::{Cycle, Late, Lateness, Turn};
use crate::error::Failure;
use crate::live::fleet::Fleet;
use crate::live::{Live, QUANTILES};
use crate::pipeline::{Pipeline, fingerprint};
use crate::realtime;
use crate::recording::{About, Frame, Image, Pace, Pictures, Recorder};
use crate::session::Session;
use crate::source::{Frames, Opened, Picture, Source, Taken};
use crate::stats::Times;
use crate::telemetry::{
    DEADLINES_US, FrameReport, LATE, Limits, NO_DEVICE, NO_STATUS, STAGES, STATUS_OLD_US, health_names,
};
use crate::units::{
    Load, centre_of_pressure_mm, force_n, millimetres, moment_nmm, newtons, ratio, shear_n, stick_ratio,
};

/// Arguments of `gripline run`.
#[derive(Debug, Clone, Args)]
pub struct RunArgs {
    #[command(flatten)]
    overrides: Overrides,
    /// One JSON object a frame, and a summary object last, on standard output.
    #[arg(long)]
    json: bool,
}

/// Runs until the end, `q`, or Ctrl-C.
///
/// # Errors
/// [`Failure`] when weights, link or terminal fail, and with kind Loss when maps got no answer.
pub fn run(args: &RunArgs) -> Result<(), Failure> {
    let wanted = Settings::load(&args.overrides)?;
    let network = network_for(&wanted)?;
    let of_network = settings_for(&network);
    may_be_recorded(&wanted, &network)?;
    let mut opened = wanted.source.open(&wanted.pictures_of)?;
    if !matches!(wanted.source, Source::Simulated) {
        eprintln!("gripline: {}", opened.told);
    }
    let calibrated = match &wanted.calibration {
        Some(calibration) => calibration.rest_pictures()?,
        None => None,
    };
    let rest = match calibrated {
        Some(rest) => rest,
        None => opened.rest(REST_PICTURES.into())?.crops,
    };
    let Opened {
        pictures: mut source,
        frames_per_second,
        ..
    } = opened;
    let link = wanted.mcu.open().map_err(Failure::failed)?;
    let mut session = Session::connect(link).map_err(Failure::failed)?;
    // What neither the network nor the configuration says stays as the microcontroller has it.
    let settings = wanted.microcontroller(&Configuration {
        friction: calibrated_friction(&wanted).unwrap_or(of_network.friction),
        contact_min: of_network.contact_min,
        floor: of_network.floor,
        ..*session.settings()
    })?;
    session.configure(settings).map_err(Failure::failed)?;
    if let Some(note) = session.other_version() {
        eprintln!("gripline: {note}");
    }
    tell_of_another_line(&wanted, &settings);
    let about = about(&wanted, &network, &session, (&rest, frames_per_second));
    let recorder = match &wanted.record {
        Some(path) => {
            let pace = if wanted.unpaced {
                Pace::AsFastAsPossible
            } else {
                Pace::RealTime
            };
            Some(Recorder::start(path, &about, &rest, pace)?)
        }
        None => None,
    };
    let about_run = serde_json::to_string(&about).unwrap_or_default();
    let mut pipeline = Pipeline::new(network, &rest, wanted.gate, TaxelRule::of(&settings));

    let stop = Arc::new(AtomicBool::new(false));
    let signalled = Arc::clone(&stop);
    ctrlc::set_handler(move || signalled.store(true, Ordering::Relaxed)).map_err(Failure::failed)?;
    let mut output = Output::open(args.json, limits(&settings))?;
    let one_round = source.is_simulated() && !output.is_live();
    let seconds = wanted.seconds.or(one_round.then_some(SCENE_LOOP_S));

    let mut run = Run::new(session, Clock::of(&source, wanted.unpaced), frames_per_second);
    run.summary.source = wanted.source.to_string();
    run.recorder = recorder;
    run.pictures = wanted.pictures;
    run.live = wanted.serve.map(Live::start).transpose()?;
    if let Some(live) = &run.live {
        eprintln!("gripline: /metrics and /frames at http://{}", live.address());
    }
    if let Some(fleet) = &wanted.fleet {
        run.fleet = Some(Fleet::start(fleet, about_run)?);
    }
    // After the other threads have started: they keep their ordinary priority.
    if wanted.realtime {
        let lacks = realtime::enter(wanted.realtime_core);
        for lack in &lacks {
            eprintln!("gripline: {lack}");
        }
        run.summary.realtime_lacks = Some(lacks);
    }
    let is_wanted = || !stop.load(Ordering::Relaxed);
    play(
        &mut run,
        &mut source,
        &mut pipeline,
        &mut output,
        (seconds, &is_wanted),
    )?;
    run.summary.pictures = source.counts();
    let summary = run.summary();
    output.close(&summary)?;
    match summary.losses().as_slice() {
        [] => Ok(()),
        losses => Err(Failure::loss(format!("done with loss: {}", losses.join("; ")))),
    }
}

/// Small pictures are enough for one of the networks only.
fn may_be_recorded(wanted: &Settings, network: &Network) -> Result<(), Failure> {
    if wanted.record.is_some()
        && wanted.pictures == Pictures::Small
        && network.architecture() != Architecture::Unet
    {
        return Err(Failure::usage(format!(
            "record.pictures (--record-pictures): found small with the network {}, expected full or off: it looks at the \
             whole picture",
            network.architecture()
        )));
    }
    Ok(())
}

/// Picture after picture, until the time is over or nobody wants more.
fn play(
    run: &mut Run,
    source: &mut Frames,
    pipeline: &mut Pipeline,
    output: &mut Output,
    (seconds, is_wanted): (Option<f64>, &dyn Fn() -> bool),
) -> Result<(), Failure> {
    while is_wanted() && seconds.is_none_or(|seconds| !run.is_over(seconds)) {
        let wish = match source.next(run.line_n())? {
            Taken::Picture(picture) => {
                let report = run.frame(pipeline, picture)?;
                output.frame(&report, pipeline.newtons())?
            }
            Taken::NotYet => {
                run.idle()?;
                output.idle()?
            }
            Taken::End => Wish::Stop,
        };
        for note in run.notes.drain(..).chain(source.take_news()) {
            output.note(&note)?;
        }
        if wish == Wish::Stop {
            break;
        }
    }
    Ok(())
}

/// The network that was asked for.
pub(crate) fn network_for(wanted: &Settings) -> Result<Network, Failure> {
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

/// The friction that the calibration says the detector should work with.
fn calibrated_friction(wanted: &Settings) -> Option<u16> {
    let friction = wanted.calibration.as_ref()?.friction.as_ref()?;
    Some((friction.detector * f64::from(PER_UNIT)).floor() as u16)
}

/// Says so when the microcontroller's table of the line is not the calibrated one: only a stored one counts.
fn tell_of_another_line(wanted: &Settings, settings: &Configuration) {
    let Some(calibration) = &wanted.calibration else {
        return;
    };
    if let Some(line) = &calibration.line
        && with_points(settings, &line.points).line.points != settings.line.points
    {
        eprintln!(
            "gripline: the microcontroller's line.points are not those of {}, expected the same: store them with `gripline \
             calibrate line --store`, or as [line] points of `gripline config mcu --write`",
            calibration.path.display()
        );
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

/// What a recording has to say of the run as a whole.
fn about(
    wanted: &Settings,
    network: &Network,
    session: &Session,
    (rest, frames_per_second): (&[Vec<u8>], f64),
) -> About {
    About {
        gripline: env!("CARGO_PKG_VERSION").to_owned(),
        mcu: session.link_name(),
        firmware: session.firmware().map_or(String::new(), ToString::to_string),
        network: network.architecture().to_string(),
        weights: network.manifest().to_owned(),
        weights_file: wanted
            .weights
            .as_deref()
            .map_or(String::new(), |path| path.display().to_string()),
        fingerprint: fingerprint(network, &rest[0]),
        instructions: wanted
            .instructions
            .unwrap_or_else(InstructionSet::widest)
            .to_string(),
        gate: wanted.gate.to_string(),
        frames_per_second: frames_per_second.to_string(),
        settings: settings_text(session.settings()),
    }
}

/// What the view draws its limits by.
pub(crate) fn limits(settings: &Configuration) -> Limits {
    Limits {
        friction: ratio(settings.friction),
        slip_threshold: ratio(settings.slip_threshold),
        contact_min_n: newtons(settings.contact_min.into()),
        floor_n: newtons(settings.floor),
        ceiling_n: newtons(settings.ceiling),
    }
}

/// What a frame waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Clock {
    /// The wall clock.
    Wall,
    /// Nothing: time is what the frames make of it.
    None,
    /// The camera, whose pictures come when they come.
    Pictures,
}

impl Clock {
    const fn of(source: &Frames, is_unpaced: bool) -> Self {
        match (source.is_live(), is_unpaced) {
            (true, _) => Self::Pictures,
            (false, true) => Self::None,
            (false, false) => Self::Wall,
        }
    }
}

/// A run under way.
struct Run {
    cycle: Cycle,
    frame: u64,
    started: Instant,
    clock: Clock,
    frames_per_second: f64,
    /// Processor time of this process at the start.
    cpu_s: Option<f64>,
    recorder: Option<Recorder>,
    /// What of the pictures is recorded.
    pictures: Pictures,
    live: Option<Live>,
    fleet: Option<Fleet>,
    stages: [Times; STAGES.len()],
    /// Frames in which each of them missed its deadline.
    late: [u64; STAGES.len()],
    frame_to_link: Times,
    network_frame_to_link: Times,
    /// How often the device had gone away, and whether it is away, when that was last told.
    presence: (u32, bool),
    /// What a person should know now.
    notes: Vec<String>,
    summary: Summary,
}

impl Run {
    fn new(session: Session, clock: Clock, frames_per_second: f64) -> Self {
        Self {
            summary: Summary::of_link(session.link_name(), session.firmware()),
            cycle: Cycle::new(session),
            frame: 0,
            started: Instant::now(),
            clock,
            frames_per_second,
            cpu_s: usage::cpu_s(),
            recorder: None,
            pictures: Pictures::default(),
            live: None,
            fleet: None,
            stages: Default::default(),
            late: [0; STAGES.len()],
            frame_to_link: Times::default(),
            network_frame_to_link: Times::default(),
            presence: (0, false),
            notes: Vec::new(),
        }
    }

    /// The grip-force line as the microcontroller last told it.
    fn line_n(&self) -> f64 {
        self.cycle
            .session
            .status()
            .map_or(0.0, |status| newtons(status.line))
    }

    /// One frame: picture in, map out, answer in.
    fn frame(&mut self, pipeline: &mut Pipeline, picture: Picture) -> Result<FrameReport, Failure> {
        let frame_us = 1e6 / self.frames_per_second;
        let (t_s, until_us, lateness) = match self.clock {
            // Half a frame for the answer; then the next picture may be there.
            Clock::Pictures => {
                self.idle()?;
                let came = picture.came.saturating_duration_since(self.started);
                let until_us = self.elapsed_us() + (frame_us / 2.0) as u64;
                (came.as_secs_f64(), until_us, Lateness::Since(picture.came))
            }
            // To the next frame. A world or a file that is slower than the clock waits for nobody: its pictures are taken when
            // they are there.
            Clock::Wall | Clock::None => (
                self.frame as f64 * frame_us / 1e6,
                ((self.frame + 1) as f64 * frame_us) as u64,
                if self.clock == Clock::Wall {
                    Lateness::Since(picture.came)
                } else {
                    Lateness::Never
                },
            ),
        };
        let waited = picture.came.elapsed();
        let mut turn = self
            .cycle
            .turn(pipeline, &picture.crop, picture.wish, lateness, until_us)?;
        turn.stages_us[0] = picture.decode_us;
        if self.clock == Clock::Pictures {
            turn.latency_us += waited.as_secs_f64() * 1e6;
        }
        self.count(&turn);
        self.look_after_the_link();
        if let Some(refusal) = self.cycle.session.take_refusal() {
            self.summary.commands_refused += 1;
            self.summary.last_refusal = Some(format!("{refusal:?}"));
            if refusal == Refusal::NoHandshake {
                // It restarted and did not take up what is still wanted.
                self.cycle.tell_again();
            }
        }
        let fingertips = &self.cycle.session.settings().fingertips;
        let report = report_of(
            (self.frame, t_s),
            &turn,
            fingertips,
            &picture,
            &faults_of(&self.cycle.session),
        );
        self.observe(&report, &turn.status);
        self.publish(&report);
        if let Some(fleet) = &mut self.fleet {
            fleet.publish(&report);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.offer(Frame {
                report: report.clone(),
                sequence: turn.sequence,
                capture_us: turn.capture_us,
                until_us,
                wish: picture.wish,
                health_bits: turn.health.bits(),
                wire: turn.status,
                map: Box::new(pipeline.map().clone()),
                picture: (turn.late != Some(Late::Picture))
                    .then(|| image(self.pictures, picture.crop, pipeline))
                    .flatten(),
            });
        }
        if self.clock == Clock::Wall {
            self.wait_for_the_clock();
        }
        self.frame += 1;
        Ok(report)
    }

    /// Says when the device goes away and when it is back.
    fn look_after_the_link(&mut self) {
        let session = &self.cycle.session;
        let presence = session.presence();
        let now = (presence.losses, presence.away.is_some());
        if now == self.presence {
            return;
        }
        let link = session.link_name();
        if now.0 != self.presence.0 {
            let why = presence.away.as_deref().unwrap_or("it went away for a moment");
            self.notes.push(format!(
                "{link} is gone ({why}); the run goes on without it and takes it up again when it is back"
            ));
        }
        if !now.1 {
            self.notes.push(format!("{link} is back"));
        }
        self.presence = now;
    }

    fn elapsed_us(&self) -> u64 {
        self.started.elapsed().as_micros() as u64
    }

    /// There is no picture: the link goes on living.
    fn idle(&mut self) -> Result<(), Failure> {
        let now_us = self.elapsed_us();
        self.cycle.idle(now_us)?;
        self.look_after_the_link();
        Ok(())
    }

    /// Whether it has lasted so long.
    fn is_over(&self, seconds: f64) -> bool {
        match self.clock {
            Clock::Pictures => self.started.elapsed().as_secs_f64() >= seconds,
            Clock::Wall | Clock::None => self.frame >= (seconds * self.frames_per_second).round() as u64,
        }
    }

    /// Leaves the frame for programs that look at live values.
    fn publish(&self, report: &FrameReport) {
        let Some(live) = &self.live else {
            return;
        };
        live.publish(report, |values| {
            let summary = &self.summary;
            values.frames = self.frame + 1;
            values.gate = [
                summary.gate_no_contact,
                summary.gate_unchanged,
                summary.gate_network,
                summary.gate_unhealthy,
            ];
            values.maps_unanswered = summary.maps_unanswered;
            values.shadow_mismatches = self.cycle.session.shadow().mismatches();
            values.frames_late = summary.pictures_late + summary.maps_late;
            values.record_dropped = self.recorder.as_ref().map_or([0; 2], Recorder::dropped);
            // Once a second: a distribution takes longer to look at than a number.
            if self.frame.is_multiple_of(self.frames_per_second.ceil() as u64) {
                for (times_us, stage) in values.stages_us.iter_mut().zip(&self.stages) {
                    *times_us = QUANTILES.map(|quantile| stage.quantile_us(quantile));
                }
            }
        });
    }

    /// When a frame's picture is taken, where the wall clock says it.
    fn due(&self, frame: u64) -> Instant {
        self.started + Duration::from_secs_f64(frame as f64 / self.frames_per_second)
    }

    /// Waits until the next frame is due; a link that waits for the wall clock itself leaves nothing to wait for.
    fn wait_for_the_clock(&self) {
        thread::sleep(self.due(self.frame + 1).saturating_duration_since(Instant::now()));
    }

    fn count(&mut self, turn: &Turn) {
        let summary = &mut self.summary;
        let passed = match turn.late {
            None => STAGES.len(),
            Some(Late::Map) => {
                summary.maps_late += 1;
                STAGES.len() - 2
            }
            Some(Late::Picture) => {
                summary.pictures_late += 1;
                return;
            }
        };
        *match turn.verdict {
            Verdict::NoContact => &mut summary.gate_no_contact,
            Verdict::Unchanged => &mut summary.gate_unchanged,
            Verdict::Network => &mut summary.gate_network,
            Verdict::Unhealthy => &mut summary.gate_unhealthy,
        } += 1;
        summary.wire_bytes += turn.wire_bytes as u64;
        summary.maps_not_taken += u64::from(turn.is_lost);
        summary.maps_unanswered += u64::from(!turn.answered && turn.late.is_none());
        for ((times, us), name) in self
            .stages
            .iter_mut()
            .zip(turn.stages_us)
            .zip(STAGES)
            .take(passed)
        {
            if (name != "network" || turn.verdict == Verdict::Network) && (name != "decode" || us > 0.0) {
                times.push(us);
            }
        }
        for ((late, us), deadline_us) in self.late.iter_mut().zip(turn.stages_us).zip(DEADLINES_US) {
            *late += u64::from(us > deadline_us);
        }
        if turn.late.is_some() {
            return;
        }
        self.frame_to_link.push(turn.latency_us);
        if turn.verdict == Verdict::Network {
            self.network_frame_to_link.push(turn.latency_us);
        }
    }

    fn observe(&mut self, report: &FrameReport, status: &Status) {
        let summary = &mut self.summary;
        summary.slip_frames += u64::from(stick_ratio_below(
            &status.sums,
            self.cycle.session.settings().slip_threshold,
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
            .zip(DEADLINES_US.into_iter().zip(self.late))
            .map(|((stage, times), (deadline_us, late))| StageSummary {
                stage,
                frames: times.count(),
                median_us: times.quantile_us(0.5),
                p99_us: times.quantile_us(0.99),
                p999_us: times.quantile_us(0.999),
                deadline_us,
                late,
            });
        let line_n_min_holding = self.summary.line_n_min_holding;
        Summary {
            recording: self.recorder.map(Recorder::finish),
            frames: self.frame,
            seconds,
            frames_per_second: self.frame as f64 / seconds.max(1e-9),
            cpu_share: usage::cpu_s()
                .zip(self.cpu_s)
                .map(|(now_s, then_s)| (now_s - then_s) / seconds.max(1e-9)),
            stages: stages.collect(),
            frame_to_link_us_median: self.frame_to_link.quantile_us(0.5),
            frame_to_link_us_p99: self.frame_to_link.quantile_us(0.99),
            frame_to_link_us_p999: self.frame_to_link.quantile_us(0.999),
            network_frame_to_link_us_median: self.network_frame_to_link.quantile_us(0.5),
            network_frame_to_link_us_p999: self.network_frame_to_link.quantile_us(0.999),
            answers_checked: self.cycle.session.shadow().checked(),
            shadow_mismatches: self.cycle.session.shadow().mismatches(),
            microcontroller_restarts: self.cycle.session.restarts(),
            clock_jumps: self.cycle.session.clock_jumps(),
            link_losses: self.cycle.session.presence().losses,
            link_packets_lost: self.cycle.session.presence().packets_lost,
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

/// What of a picture is recorded.
fn image(wanted: Pictures, crop: Vec<u8>, pipeline: &Pipeline) -> Option<Image> {
    match wanted {
        Pictures::Full => Some(Image {
            side: CROP_SIDE,
            pixels: crop,
        }),
        Pictures::Small => Some(Image {
            side: IMAGE_SIDE,
            pixels: pipeline.small().to_vec(),
        }),
        Pictures::Off => None,
    }
}

/// What the host itself has against the microcontroller's part.
fn faults_of(session: &Session) -> Vec<&'static str> {
    let faults = [
        (session.presence().away.is_some(), NO_DEVICE),
        (session.status_age_us() > STATUS_OLD_US, NO_STATUS),
    ];
    let there = faults.into_iter().filter(|(is_there, _)| *is_there);
    there.map(|(_, name)| name).collect()
}

fn report_of(
    (frame, t_s): (u64, f64),
    turn: &Turn,
    fingertips: &[FingertipGeometry; SENSORS],
    picture: &Picture,
    host_faults: &[&'static str],
) -> FrameReport {
    let status = &turn.status;
    let sums = &status.sums;
    let fingertip = &fingertips[usize::from(status.sensor).min(SENSORS - 1)];
    let pitch_mm = millimetres(fingertip.pitch_um);
    let [x, y, z] = force_n(sums);
    let faults = status.faults | status.latched;
    FrameReport {
        frame,
        t_s,
        gate: turn.verdict,
        health: health_names(turn.health),
        normal_n: z,
        shear_x_n: x,
        shear_y_n: y,
        shear_n: shear_n(sums),
        moment_nmm: moment_nmm(sums, pitch_mm),
        centre_of_pressure_mm: centre_of_pressure_mm(sums, pitch_mm),
        load: Load::of(sums, status.sensor, fingertip),
        contact: sums.contact,
        stick: sums.stick,
        stick_ratio: stick_ratio(sums),
        coulomb_slip: status.coulomb_slip,
        state: status.state.name(),
        time_to_slip_ms: status.time_to_slip_ms,
        line_n: newtons(status.line),
        latency_us: turn.latency_us,
        stages_us: turn.stages_us,
        faults: Fault::ALL
            .iter()
            .filter(|fault| faults & fault.bit() != 0)
            .map(|fault| fault.name())
            .chain(host_faults.iter().copied())
            .chain(turn.late.map(|_| LATE))
            .collect(),
        late: turn.late.map(Late::name),
        wire_bytes: turn.wire_bytes,
        truth: picture.truth.clone(),
    }
}
