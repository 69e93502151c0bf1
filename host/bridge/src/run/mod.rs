//! `gripline run`: source → pipeline → session → line, frame by frame, with the view, plain lines or JSON.
//! With two fingertips a frame is a picture of either, as they come, and each has its turn.
//!
//! The loop is a straight line: a picture is taken at frame k, its map goes out at once, the link works until frame
//! k+1, and the line it then holds is what the (simulated) gripper feels next. Paced by the wall clock.

#[cfg(test)]
mod faults;
mod fingertips;
#[cfg(test)]
mod late;
mod output;
mod report;
mod summary;
#[cfg(test)]
mod two_fingertips;
mod usage;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below};
use gripline_network::scene::Verdict;
use gripline_network::{Architecture, InstructionSet, Network};
use gripline_protocol::message::{Command, Configuration, FingertipGeometry, GripMode, Refusal, Status};
use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT, SENSORS};
use gripline_simulation::constants::{SCENE_INITIAL_GRIP_N, SCENE_LOOP_S};

use self::fingertips::{Fingertips, Looked};
use self::output::{Output, Wish};
use self::report::{faults_of, image, report_of};
use self::summary::{FingertipSummary, StageSummary, Summary};
use crate::calibrate::line::with_points;
use crate::calibration::Calibration;
use crate::capture::Counts;
use crate::config::{Overrides, Settings, settings_text};
use crate::cycle::{At, Cycle, Late, Lateness, Turn};
use crate::error::Failure;
use crate::faults::names;
use crate::live::fleet::Fleet;
use crate::live::{Live, QUANTILES};
use crate::pipeline::{Pipeline, fingerprint};
use crate::realtime;
use crate::recording::{About, Frame, Pace, Pictures, Recorder};
use crate::session::Session;
use crate::source::{Picture, Source};
use crate::stats::Times;
use crate::telemetry::{DEADLINES_US, FrameReport, Limits, STAGES};
use crate::units::{newtons, ratio};

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
    let opened = fingertips::open(&wanted)?;
    if !matches!(wanted.source, Source::Simulated) {
        for open in &opened {
            eprintln!("gripline: {}", open.told);
        }
    }
    // Of one fingertip, and of all.
    let frames_per_second = opened[0].frames_per_second;
    let pictures_per_second: f64 = opened.iter().map(|open| open.frames_per_second).sum();
    let link = wanted.mcu.open().map_err(Failure::failed)?;
    let mut session = Session::connect(link).map_err(Failure::failed)?;
    // What neither the network nor the configuration says stays as the microcontroller has it.
    let settings = wanted.microcontroller(&Configuration {
        sensors: opened.len() as u8,
        friction: calibrated_friction(&wanted).unwrap_or(of_network.friction),
        contact_min: of_network.contact_min,
        floor: of_network.floor,
        fingertips: calibrated_fingertips(&wanted, session.settings()),
        ..*session.settings()
    })?;
    as_many_fingertips(&wanted, &settings, opened.len())?;
    session.configure(settings).map_err(Failure::failed)?;
    if let Some(note) = session.other_version() {
        eprintln!("gripline: {note}");
    }
    tell_of_another_line(&wanted, &settings);
    let rests: Vec<_> = opened.iter().map(|open| open.rest.clone()).collect();
    let about = about(&wanted, &network, &session, (&rests[0], frames_per_second));
    let recorder = match &wanted.record {
        Some(path) => {
            let pace = if wanted.unpaced {
                Pace::AsFastAsPossible
            } else {
                Pace::RealTime
            };
            Some(Recorder::start(path, &about, &rests, pace)?)
        }
        None => None,
    };
    let about_run = serde_json::to_string(&about).unwrap_or_default();
    drop(rests);
    let mut fingertips = Fingertips::new(opened, &network, &wanted, TaxelRule::of(&settings));

    let stop = Arc::new(AtomicBool::new(false));
    let signalled = Arc::clone(&stop);
    ctrlc::set_handler(move || signalled.store(true, Ordering::Relaxed)).map_err(Failure::failed)?;
    let mut output = Output::open(args.json, limits(&settings))?;
    let one_round = fingertips.are_simulated() && !output.is_live();
    let seconds = wanted.seconds.or(one_round.then_some(SCENE_LOOP_S));

    let clock = Clock::of(fingertips.are_live(), wanted.unpaced);
    let mut run = Run::new(session, clock, pictures_per_second);
    run.summary.fingertips = [Some(&wanted.source), wanted.second_source.as_ref()]
        .into_iter()
        .flatten()
        .map(FingertipSummary::of)
        .collect();
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
    play(&mut run, &mut fingertips, &mut output, (seconds, &is_wanted))?;
    let counts = fingertips.counts();
    run.summary.pictures = counts.iter().flatten().copied().reduce(Counts::plus);
    for (summary, pictures) in run.summary.fingertips.iter_mut().zip(counts) {
        summary.pictures = pictures;
    }
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
    fingertips: &mut Fingertips,
    output: &mut Output,
    (seconds, is_wanted): (Option<f64>, &dyn Fn() -> bool),
) -> Result<(), Failure> {
    while is_wanted() && seconds.is_none_or(|seconds| !run.is_over(seconds)) {
        let wish = match fingertips.next(run.cycle.session.line_n())? {
            Looked::Picture(sensor, picture) => {
                let pipeline = fingertips.pipeline(sensor);
                let report = run.frame(pipeline, sensor, picture)?;
                output.frame(&report, pipeline.newtons())?
            }
            Looked::NotYet => {
                run.idle()?;
                output.idle()?
            }
            Looked::End => Wish::Stop,
        };
        run.notes.append(&mut fingertips.take_news());
        run.look_after_the_pictures(&fingertips.counts());
        for note in run.take_notes() {
            output.note(&note)?;
        }
        match wish {
            Wish::GoOn => {}
            Wish::Acknowledge => run.acknowledge()?,
            Wish::Stop => break,
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

/// Every fingertip that the microcontroller waits for must have a source, or its maps would be stale from the start.
fn as_many_fingertips(wanted: &Settings, settings: &Configuration, sources: usize) -> Result<(), Failure> {
    if usize::from(settings.sensors) == sources {
        return Ok(());
    }
    let second = wanted
        .second_source
        .as_ref()
        .map_or("none".to_owned(), Source::to_string);
    Err(Failure::usage(format!(
        "microcontroller.sensors: found {} with camera.second_source {second}, expected {sources}: leave it out, a run sets it to \
         the number of its sources",
        settings.sensors
    )))
}

/// The friction that the calibration says the detector should work with; of two fingertips the lower one, so that neither
/// is believed to hold more than it does.
fn calibrated_friction(wanted: &Settings) -> Option<u16> {
    let of = |calibration: &Option<Calibration>| Some(calibration.as_ref()?.friction.as_ref()?.detector);
    let both = [&wanted.calibration, &wanted.second_calibration];
    let least = both.into_iter().filter_map(of).min_by(f64::total_cmp)?;
    Some((least * f64::from(PER_UNIT)).floor() as u16)
}

/// How the fingertips sit, as the calibrations say, else as the microcontroller has it.
fn calibrated_fingertips(wanted: &Settings, now: &Configuration) -> [FingertipGeometry; SENSORS] {
    let mut fingertips = now.fingertips;
    let both = [&wanted.calibration, &wanted.second_calibration];
    for (fingertip, calibration) in fingertips.iter_mut().zip(both) {
        if let Some(geometry) = calibration.as_ref().and_then(|found| found.geometry.as_ref()) {
            *fingertip = geometry.setting();
        }
    }
    fingertips
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
    const fn of(is_live: bool, is_unpaced: bool) -> Self {
        match (is_live, is_unpaced) {
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
    /// Time of the newest picture, on the recording's clock.
    t_s: f64,
    started: Instant,
    clock: Clock,
    /// Pictures a second, of all fingertips together.
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
    /// Pictures that never came, were overtaken and were damaged so far.
    pictures_lost: [u64; 3],
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
            t_s: 0.0,
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
            pictures_lost: [0; 3],
            presence: (0, false),
            notes: Vec::new(),
        }
    }

    /// One frame: picture in, map out, answer in.
    fn frame(
        &mut self,
        pipeline: &mut Pipeline,
        sensor: u8,
        picture: Picture,
    ) -> Result<FrameReport, Failure> {
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
        let at = At {
            sensor,
            wish: picture.wish,
            // Elsewhere pictures are of the moment at which they are asked for.
            age_us: match self.clock {
                Clock::Pictures => waited.as_micros() as u32,
                Clock::Wall | Clock::None => 0,
            },
            until_us,
        };
        let mut turn = self.cycle.turn(pipeline, &picture.crop, lateness, at)?;
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
            picture.truth,
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
                begun_us: turn.begun_us,
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
        self.t_s = report.t_s;
        Ok(report)
    }

    /// Says when pictures are lost: the first one, and then whenever they have become twice as many.
    fn look_after_the_pictures(&mut self, counts: &[Option<Counts>]) {
        let all = counts
            .iter()
            .flatten()
            .copied()
            .reduce(Counts::plus)
            .unwrap_or_default();
        let lost = [all.missed, all.overtaken, all.damaged];
        let (before, now) = (self.pictures_lost.iter().sum::<u64>(), lost.iter().sum::<u64>());
        if now.checked_ilog2() != before.checked_ilog2() {
            let [missed, overtaken, damaged] = lost;
            self.notes.push(format!(
                "{now} pictures lost so far: {missed} never came, {overtaken} were overtaken by newer ones, {damaged} were damaged"
            ));
        }
        self.pictures_lost = lost;
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

    /// Somebody has looked at the latched faults that are shown.
    fn acknowledge(&mut self) -> Result<(), Failure> {
        let session = &mut self.cycle.session;
        let latched = session.status().map_or(0, |status| status.latched);
        if latched == 0 {
            return Ok(());
        }
        let command = Command::Acknowledge { faults: latched };
        let is_told = session.command(command).map_err(Failure::failed)?;
        self.notes.push(if is_told {
            // Of what was refused meanwhile, a release, the gripper is told anew.
            self.cycle.tell_again();
            format!("acknowledged: {}", names(latched).join(", "))
        } else {
            "not acknowledged: the microcontroller does not take commands now, try again".to_owned()
        });
        Ok(())
    }

    /// What a person should know now; the recording keeps it too.
    fn take_notes(&mut self) -> Vec<String> {
        let notes = std::mem::take(&mut self.notes);
        if let Some(recorder) = &self.recorder {
            let t_s = self.t_s;
            for note in &notes {
                recorder.note(t_s, note);
            }
        }
        notes
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
            values.pictures_lost = self.pictures_lost;
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
        if let Some(fingertip) = summary.fingertips.get_mut(usize::from(turn.sensor)) {
            fingertip.frames += 1;
            fingertip.maps_unanswered += u64::from(!turn.answered && turn.late.is_none());
        }
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
        let shadow = self.cycle.session.shadow();
        let mut fingertips = self.summary.fingertips.clone();
        for (sensor, fingertip) in fingertips.iter_mut().enumerate() {
            [fingertip.answers_checked, fingertip.shadow_mismatches] = shadow.of(sensor);
        }
        Summary {
            fingertips,
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
