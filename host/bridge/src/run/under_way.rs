//! A run in progress: the work of one frame, the work between frames, and the reports to the user.

use std::ops::Add as _;
use std::time::{Duration, Instant};

use gripline_protocol::{ForceMap, Motion, SensorId};

use gripline_control::channel;

use super::drift::{DriftWatch, is_at_rest};
use super::helpers::Helpers;
use super::report::{faults_of, image, report_of};
use super::requests::{Requests, Unasked};
use super::summary::Summary;
use super::usage;
use crate::error::Error;
use crate::live::fleet::Fleet;
use crate::live::foxglove::Foxglove;
use crate::live::ros2::Ros2;
use crate::live::{FrameView, Live, QUANTILES, Values};
use crate::run::capture_to_line::CaptureToLine;
use crate::run::stats::Times;
use crate::source::Picture;
use gripline_capture::Counts;
use gripline_link::session::Session;
use gripline_pipeline::PipelineError;
use gripline_pipeline::control_loop::{ControlLoop, FrameOutcome, FrameRequest, Late, Lateness};
use gripline_pipeline::markers::MarkerStage;
use gripline_pipeline::pipeline::Pipeline;
use gripline_recording::telemetry::{FrameReport, STAGES};
use gripline_recording::units::millimetres;
use gripline_recording::{Frame, Pictures, Recorder};

/// What a frame waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pacing {
    /// The wall clock.
    Wall,
    /// Nothing: frames follow each other at once.
    None,
    /// The camera, which delivers at its own rate.
    Pictures,
}

impl Pacing {
    pub(super) const fn of(is_live: bool, is_unpaced: bool) -> Self {
        match (is_live, is_unpaced) {
            (true, _) => Self::Pictures,
            (false, true) => Self::None,
            (false, false) => Self::Wall,
        }
    }
}

/// A run in progress.
pub struct Run {
    /// The session with the device, and its frames.
    pub control: ControlLoop,
    /// Number of the next frame.
    pub frame: u64,
    /// Time of the newest picture, on the recording's clock.
    pub(super) t_s: f64,
    pub(super) started: Instant,
    /// What a frame waits for.
    pub pacing: Pacing,
    /// Pictures a second, of all fingertips together.
    pub(super) frames_per_second: f64,
    /// Processor time of this process at the start.
    pub(super) cpu_s: Option<f64>,
    /// Where frames are recorded.
    pub recorder: Option<Recorder>,
    /// Which size of pictures is recorded.
    pub pictures: Pictures,
    pub(super) live: Option<Live>,
    pub(super) fleet: Option<Fleet>,
    pub(super) ros2: Option<Ros2>,
    pub(super) foxglove: Option<Foxglove>,
    pub(super) stages: [Times; STAGES.len()],
    /// Frames in which each of them missed its deadline.
    pub(super) late: [u64; STAGES.len()],
    pub(super) frame_to_link: Times,
    pub(super) network_frame_to_link: Times,
    pub(super) capture_to_line: CaptureToLine,
    /// Pictures lost, overtaken and damaged so far.
    pub(super) pictures_lost: [u64; 3],
    /// How often the device had gone away, and whether it was away, at the last report.
    pub(super) presence: (u32, bool),
    /// How often the microcontroller had restarted when requests were last taken.
    pub(super) restarts: u32,
    /// When the gripper's state was last published, µs of the link's clock.
    pub(super) published_us: u64,
    /// Monitors of the untouched fingertips of cameras.
    pub(super) drift: Vec<DriftWatch>,
    /// The requests of clients.
    pub(super) requests: Requests,
    /// Threads that share a picture with the loop's.
    pub(super) helpers: Helpers,
    /// Counts so far; [`Run::summary`] completes them.
    pub summary: Summary,
}

/// Polling interval for unconfirmed requests between two frames.
const WATCH_STEP: Duration = Duration::from_millis(1);
/// The same without any: the microcontroller must hear of this host (`SIGNS_OF_LIFE` in its `link_lost_ms`).
const LINK_STEP: Duration = Duration::from_millis(50);

impl Run {
    /// A run without view, readers or recording, with this many pictures a second of all fingertips together.
    #[must_use]
    pub fn new(session: Session, pacing: Pacing, frames_per_second: f64) -> Self {
        Self {
            summary: Summary::of_link(session.link_name(), session.firmware()),
            restarts: session.restarts(),
            published_us: 0,
            control: ControlLoop::new(session),
            frame: 0,
            t_s: 0.0,
            started: Instant::now(),
            pacing,
            frames_per_second,
            cpu_s: usage::cpu_s(),
            recorder: None,
            pictures: Pictures::default(),
            live: None,
            fleet: None,
            ros2: None,
            foxglove: None,
            stages: Default::default(),
            late: [0; STAGES.len()],
            frame_to_link: Times::default(),
            network_frame_to_link: Times::default(),
            capture_to_line: CaptureToLine::default(),
            pictures_lost: [0; 3],
            presence: (0, false),
            drift: Vec::new(),
            requests: Requests::new(channel().1, Unasked::SCRIPT, 0),
            helpers: Helpers::default(),
        }
    }

    /// One frame: picture in, map out, answer in.
    ///
    /// # Errors
    /// [`Error`] when the picture does not fit, or the link fails for good.
    pub fn frame(
        &mut self,
        pipeline: &mut Pipeline,
        sensor: SensorId,
        picture: Picture,
    ) -> Result<FrameReport, Error> {
        let frame_us = 1e6 / self.frames_per_second;
        let (t_s, until_us, lateness) = match self.pacing {
            // Half a frame for the answer; then the next picture may be there.
            Pacing::Pictures => {
                self.idle()?;
                let came = picture.came.saturating_duration_since(self.started);
                let until_us = self.elapsed_us() + (frame_us / 2.0) as u64;
                (came.as_secs_f64(), until_us, Lateness::Since(picture.came))
            }
            // To the next frame. A world or a file that is slower than the clock waits for nobody: its pictures are taken when
            // they are there.
            Pacing::Wall | Pacing::None => (
                self.frame as f64 * frame_us / 1e6,
                ((self.frame + 1) as f64 * frame_us) as u64,
                if self.pacing == Pacing::Wall {
                    Lateness::Since(picture.came)
                } else {
                    Lateness::Never
                },
            ),
        };
        let waited = picture.came.elapsed();
        let (age_us, waited_us) = match self.pacing {
            Pacing::Pictures => {
                let age_us = picture.taken.elapsed().as_micros();
                (
                    u32::try_from(age_us).unwrap_or(u32::MAX),
                    waited.as_secs_f64() * 1e6,
                )
            }
            // Elsewhere pictures are of the moment at which they are asked for.
            Pacing::Wall | Pacing::None => (0, picture.decode_us),
        };
        self.requests.scripted(picture.requested_mode);
        self.handle_requests()?;
        let mode = self.requests.mode();
        let request = FrameRequest {
            sensor,
            mode,
            age_us,
            // Particles in the gel move with it: they say nothing of the object's own motion. Printed markers bring it with the map.
            motion: Motion::UNKNOWN,
            decode_us: picture.decode_us,
            waited_us,
            until_us,
        };
        self.helpers.leave_this_core();
        let outcome = self
            .control
            .frame(pipeline, &picture.crop, lateness, request)
            .map_err(|error| self.with_picture_number(error, sensor))?;
        self.count(&outcome);
        if self.pacing == Pacing::Pictures && outcome.late.is_none() {
            let driver = picture.came.saturating_duration_since(picture.taken);
            self.capture_to_line
                .push(driver, waited, picture.decode_us, outcome.latency_us);
        }
        self.check_link();
        self.settle_requests()?;
        let is_at_rest = is_at_rest(outcome.gate, outcome.late, self.mode_in_force());
        let watch = self.drift.get_mut(sensor.index());
        if let Some(warning) = watch.and_then(|watch| watch.observe(t_s, is_at_rest, &picture.crop)) {
            tracing::warn!("fingertip {}: {warning}", sensor.number() + 1);
        }
        if let Some(rezero) = &mut self.requests.rezero {
            rezero.observe(sensor, &picture.crop);
        }
        let fingertips = &self.control.session.settings().fingertips;
        let host_faults = faults_of(&self.control.session);
        let report = FrameReport {
            markers: pipeline.markers().map(MarkerStage::report),
            ..report_of(
                (self.frame, t_s),
                &outcome,
                fingertips,
                picture.truth,
                &host_faults,
            )
        };
        self.observe(&report, &outcome.status);
        self.publish(&report, pipeline, &picture.crop);
        self.publish_status(self.frame + 1, &host_faults);
        self.publish_to_many(&report, pipeline.map(), picture.taken);
        self.keep(&report, &outcome, request, pipeline, picture.crop);
        if self.pacing == Pacing::Wall {
            self.wait_for_the_clock()?;
        }
        self.frame += 1;
        self.t_s = report.t_s;
        Ok(report)
    }

    /// Adds source and number to the error of a picture without markers.
    fn with_picture_number(&self, error: PipelineError, sensor: SensorId) -> Error {
        let source = self.summary.fingertips.get(sensor.index());
        match error {
            PipelineError::Markers(problem) => Error::failed(format!(
                "{}, frame {}: {problem}",
                source.map_or("pictures", |source| &source.source),
                self.frame
            )),
            other => other.into(),
        }
    }

    /// Queues a frame for Foxglove and for the recording.
    fn keep(
        &mut self,
        report: &FrameReport,
        outcome: &FrameOutcome,
        request: FrameRequest,
        pipeline: &Pipeline,
        crop: Vec<u8>,
    ) {
        if self.recorder.is_none() && self.foxglove.is_none() {
            return;
        }
        let frame = Frame {
            report: report.clone(),
            sequence: outcome.sequence,
            capture_us: outcome.capture_us,
            begun_us: outcome.begun_us,
            until_us: request.until_us,
            requested_mode: request.mode,
            floor_lsb: self.control.session.settings().floor,
            health_bits: outcome.health.bits(),
            motion_bits: outcome.motion.bits(),
            wire: outcome.status,
            map: Box::new(pipeline.map().clone()),
            pitch_um: self.pitch_um(report),
            picture: None,
        };
        let is_pictured = outcome.late != Some(Late::Picture);
        if let Some(foxglove) = &mut self.foxglove {
            let is_wanted = is_pictured && foxglove.wants_picture(report.sensor);
            let picture = is_wanted
                .then(|| image(self.pictures, &*crop, pipeline))
                .flatten();
            foxglove.publish(Frame {
                picture,
                ..frame.clone()
            });
        }
        if let Some(recorder) = &mut self.recorder {
            let picture = is_pictured
                .then(|| image(self.pictures, crop, pipeline))
                .flatten();
            recorder.offer(Frame { picture, ..frame });
        }
    }

    /// Distance of the taxels of a frame's fingertip, µm.
    fn pitch_um(&self, report: &FrameReport) -> u16 {
        self.control.session.settings().fingertips[report.sensor.index()].pitch_um
    }

    /// Queues a frame for zenoh and ROS 2; its picture was taken at this time.
    fn publish_to_many(&mut self, report: &FrameReport, map: &ForceMap, taken: Instant) {
        if let Some(fleet) = &mut self.fleet {
            fleet.publish(report);
        }
        if let Some(ros2) = &self.ros2 {
            ros2.publish(report, map, millimetres(self.pitch_um(report)), taken);
        }
    }

    /// Reports lost pictures: the first one, and then whenever their number has doubled.
    pub(super) fn check_pictures(&mut self, counts: &[Option<Counts>]) {
        let all = counts
            .iter()
            .flatten()
            .copied()
            .reduce(Counts::add)
            .unwrap_or_default();
        let lost = [all.missed, all.overtaken, all.damaged];
        let (before, now) = (self.pictures_lost.iter().sum::<u64>(), lost.iter().sum::<u64>());
        if now.checked_ilog2() != before.checked_ilog2() {
            let [missed, overtaken, damaged] = lost;
            tracing::warn!(
                "{now} pictures lost so far: {missed} never came, {overtaken} were overtaken by newer ones, {damaged} were damaged"
            );
        }
        self.pictures_lost = lost;
    }

    /// Reports when the device goes away and when it is back.
    fn check_link(&mut self) {
        let session = &self.control.session;
        let presence = session.presence();
        let now = (presence.losses, presence.away.is_some());
        if now == self.presence {
            return;
        }
        let link = session.link_name();
        if now.0 != self.presence.0 {
            let why = presence.away.as_deref().unwrap_or("it went away for a moment");
            tracing::warn!(
                "{link} is gone ({why}); the run goes on without it and takes it up again when it is back"
            );
        }
        if !now.1 {
            tracing::info!("{link} is back");
        }
        self.presence = now;
    }

    /// Passes a log line to the recording and to Foxglove.
    pub(super) fn record_line(&self, line: &str) {
        if let Some(foxglove) = &self.foxglove {
            foxglove.note(self.t_s, line);
        }
        if let Some(recorder) = &self.recorder {
            recorder.note(self.t_s, line);
        }
    }

    fn elapsed_us(&self) -> u64 {
        self.started.elapsed().as_micros() as u64
    }

    /// Without a picture: keeps the link working, and publishes what changes.
    pub(super) fn idle(&mut self) -> Result<(), Error> {
        self.handle_requests()?;
        let now_us = self.elapsed_us();
        self.control.idle(now_us)?;
        self.check_link();
        self.settle_requests()?;
        self.publish_between_frames(self.frame);
        Ok(())
    }

    /// Whether it has lasted this long.
    pub(super) fn is_over(&self, seconds: f64) -> bool {
        match self.pacing {
            Pacing::Pictures => self.started.elapsed().as_secs_f64() >= seconds,
            Pacing::Wall | Pacing::None => self.frame >= (seconds * self.frames_per_second).round() as u64,
        }
    }

    /// Publishes the frame as live values.
    fn publish(&self, report: &FrameReport, pipeline: &Pipeline, crop: &[u8]) {
        let Some(live) = &self.live else {
            return;
        };
        let square = std::cell::OnceCell::new();
        let view = || FrameView {
            newtons: pipeline.newtons(),
            picture: square.get_or_init(|| pipeline.square(crop)),
            settings: self.control.session.settings(),
        };
        let fill = |values: &mut Values| {
            let summary = &self.summary;
            values.frames = self.frame + 1;
            values.gate = [
                summary.gate_no_contact,
                summary.gate_unchanged,
                summary.gate_network,
                summary.gate_unhealthy,
            ];
            values.maps_unanswered = summary.maps_unanswered;
            values.shadow_mismatches = self.control.session.shadow().mismatches();
            values.frames_late = summary.pictures_late + summary.maps_late;
            values.pictures_lost = self.pictures_lost;
            values.record_dropped = self.recorder.as_ref().map_or([0; 2], Recorder::dropped);
            // Once a second: a distribution takes longer to look at than a number.
            if self.frame.is_multiple_of(self.frames_per_second.ceil() as u64) {
                for (times_us, stage) in values.stages_us.iter_mut().zip(&self.stages) {
                    *times_us = QUANTILES.map(|quantile| stage.quantile_us(quantile));
                }
                values.capture_us = self.capture_to_line.quantiles_us(QUANTILES);
            }
        };
        live.publish(report, fill, view);
    }

    /// When a frame's picture is due, if paced by the wall clock.
    fn due(&self, frame: u64) -> Instant {
        self.started + Duration::from_secs_f64(frame as f64 / self.frames_per_second)
    }

    /// Waits until the next frame is due; requests are executed at once meanwhile, and polled until confirmed.
    fn wait_for_the_clock(&mut self) -> Result<(), Error> {
        let due = self.due(self.frame + 1);
        loop {
            let is_under_way = self.control.is_asking() || self.requests.is_under_way();
            // A virtual clock goes on with the one on the wall while a request waits; the next frame begins when it was due anyway.
            let (step, passed) = if is_under_way {
                (WATCH_STEP, WATCH_STEP)
            } else {
                (LINK_STEP, Duration::ZERO)
            };
            let until = due.min(Instant::now() + step);
            if let Some(asked) = self.requests.next_until(until) {
                self.take_request(asked)?;
            } else if until == due {
                return Ok(());
            } else {
                self.control.pass(passed)?;
                self.handle_requests()?;
                self.publish_between_frames(self.frame + 1);
            }
        }
    }
}
