//! One frame of the control loop: picture in, map out, answer in. The same code for a run and for the replay of a recording, so
//! that both decide the same. Times in µs of the link's clock.

use std::time::{Duration, Instant};

use gripline_link::session::{SentMap, Session};
use gripline_network::scene::GateDecision;
use gripline_protocol::message::{Command, GripMode, MapSums, Refusal, Status};
use gripline_protocol::{ForceMap, Health, MapInfo, Motion, SENSORS, SensorId};
use gripline_recording::telemetry::STAGES;

use crate::PipelineError;
use crate::mode_request::{ModeRequest, REPEAT_US, Unconfirmed};
use crate::pipeline::Pipeline;

/// A picture older than this when it would be processed, µs, is dropped: one frame at 60 Hz, plus the delay of a thread on a busy
/// system.
pub const PICTURE_OLD_US: u64 = 20_000;
/// A map whose picture is older than this when it could be sent, µs, is dropped: half of the device's default `stale_ms`.
pub const MAP_OLD_US: u64 = 50_000;

/// How often the device hears from this host, with pictures or without, in the time after which it takes the link for lost.
const SIGNS_OF_LIFE: u64 = 5;

/// Polling interval for the answer to a map, µs.
const ANSWER_STEP_US: u64 = 1_000;

/// The gate decision's name, for programs.
#[must_use]
pub const fn gate_name(decision: GateDecision) -> &'static str {
    match decision {
        GateDecision::NoContact => "no_contact",
        GateDecision::Unchanged => "unchanged",
        GateDecision::Infer => "network",
        GateDecision::Unhealthy => "unhealthy",
    }
}

/// Where a frame was dropped because it was too old. Late work is never done: the next picture is fresher.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Late {
    /// Before the gate saw it.
    Picture,
    /// Its map was not sent.
    Map,
}

impl Late {
    /// Its name, for programs.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Picture => "picture",
            Self::Map => "map",
        }
    }

    /// The one with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        [Self::Picture, Self::Map]
            .into_iter()
            .find(|late| late.name() == name)
    }
}

/// What may be late in a frame.
#[derive(Debug, Clone, Copy)]
pub enum Lateness {
    /// Nothing: the world waits.
    Never,
    /// Late by the age of a picture taken at this time.
    Since(Instant),
    /// What was late when it was recorded.
    Recorded(Option<Late>),
}

impl Lateness {
    fn is_late(self, at: Late) -> bool {
        let max_us = match at {
            Late::Picture => PICTURE_OLD_US,
            Late::Map => MAP_OLD_US,
        };
        match self {
            Self::Never => false,
            Self::Since(taken) => taken.elapsed() > Duration::from_micros(max_us),
            Self::Recorded(late) => late == Some(at),
        }
    }
}

/// A frame, and how long it may work.
#[derive(Debug, Clone, Copy)]
pub struct FrameRequest {
    /// The fingertip.
    pub sensor: SensorId,
    /// The requested mode of the gripper; `None`: nothing is requested, it stays as it is.
    pub mode: Option<GripMode>,
    /// How long ago the picture was taken, by the link's clock.
    pub age_us: u32,
    /// Whether the object moves, if known from another source; evidence from the sensor's picture replaces it.
    pub motion: Motion,
    /// Time for decoding the picture.
    pub decode_us: f64,
    /// Part of the latency before the frame begins: from the picture's bytes on.
    pub waited_us: f64,
    /// The frame works until then, after frame 0.
    pub until_us: u64,
}

impl FrameRequest {
    /// A frame of a picture that was taken just now, until `until_us` after frame 0; nothing is requested, and no motion known.
    #[must_use]
    pub const fn of_now(sensor: SensorId, until_us: u64) -> Self {
        Self {
            sensor,
            mode: None,
            age_us: 0,
            motion: Motion::UNKNOWN,
            decode_us: 0.0,
            waited_us: 0.0,
            until_us,
        }
    }
}

/// The outcome of one frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameOutcome {
    /// The fingertip.
    pub sensor: SensorId,
    /// Number of the map.
    pub sequence: u32,
    /// When the picture was taken, on the link's clock.
    pub capture_us: u32,
    /// When the frame began, on the link's clock.
    pub begun_us: u32,
    /// What the scene gate decided.
    pub gate: GateDecision,
    /// Doubts about the picture.
    pub health: Health,
    /// The evidence of motion sent with the map.
    pub motion: Motion,
    /// Time of each of [`STAGES`]; 0 where the gate skipped it.
    pub stages_us: [f64; STAGES.len()],
    /// Picture's bytes in to map out.
    pub latency_us: f64,
    /// Bytes on the wire.
    pub wire_bytes: usize,
    /// The link did not take the map.
    pub is_lost: bool,
    /// Where the frame was dropped because it was too old; there is then no map to answer.
    pub late: Option<Late>,
    /// The newest status about this fingertip, which may be older than this map.
    pub status: Status,
    /// The status is the answer to this map.
    pub answered: bool,
}

/// A frame whose mode was requested.
#[derive(Clone, Copy)]
struct Begun {
    request: FrameRequest,
    at: Instant,
    start_us: u32,
    info: MapInfo,
}

/// The result of gate and network for a picture.
#[derive(Clone, Copy)]
struct Processed {
    gate: GateDecision,
    health: Health,
    stages_us: [f64; 3],
}

impl Processed {
    /// Not compared.
    const NOTHING: Self = Self {
        gate: GateDecision::Unchanged,
        health: Health::GOOD,
        stages_us: [0.0; 3],
    };
}

/// How a frame's map ended.
enum Ended {
    Sent { sent: SentMap, latency_us: f64 },
    Dropped(Late),
}

/// The loop around one session.
pub struct ControlLoop {
    /// The session with the device.
    pub session: Session,
    /// The last requested mode.
    asked: Option<ModeRequest>,
    /// Why it has no effect, until it is read.
    unconfirmed: Option<Unconfirmed>,
    /// The number of each fingertip's next map.
    sequences: [u32; SENSORS],
    /// The link's time of frame 0.
    start_us: u64,
    /// How often the device had gone away when it was last there and sound.
    losses: u32,
}

impl ControlLoop {
    /// Frame 0 is now.
    #[must_use]
    pub fn new(session: Session) -> Self {
        Self {
            start_us: session.now_us(),
            losses: session.presence().losses,
            session,
            asked: None,
            unconfirmed: None,
            sequences: [0; SENSORS],
        }
    }

    /// The fingertip's next map has this number: the maps before it are missing.
    pub fn resume_at(&mut self, sensor: SensorId, sequence: u32) {
        self.sequences[sensor.index()] = sequence;
    }

    /// Processes a picture: gate, network and quantisation, then the link; drops it if it is too old.
    ///
    /// # Errors
    /// [`PipelineError`] when the network's output is no number or the link is gone.
    pub fn frame(
        &mut self,
        pipeline: &mut Pipeline,
        crop: &[u8],
        lateness: Lateness,
        request: FrameRequest,
    ) -> Result<FrameOutcome, PipelineError> {
        let mut begun = self.begin(request)?;
        if lateness.is_late(Late::Picture) {
            return self.finish(begun, Processed::NOTHING, &Ended::Dropped(Late::Picture));
        }
        let picture = pipeline.process(crop)?;
        let processed = Processed {
            gate: picture.gate,
            health: picture.health,
            stages_us: picture.stages_us,
        };
        if lateness.is_late(Late::Map) {
            return self.finish(begun, processed, &Ended::Dropped(Late::Map));
        }
        begun.info.health = picture.health;
        begun.info.motion = picture.motion.unwrap_or(begun.info.motion);
        let sent = self
            .session
            .send_judged(&begun.info, picture.map, &picture.judgement)?;
        let latency_us = request.waited_us + begun.at.elapsed().as_secs_f64() * 1e6;
        self.finish(begun, processed, &Ended::Sent { sent, latency_us })
    }

    /// A picture that is too old for the gate to see.
    ///
    /// # Errors
    /// [`PipelineError`] when the link is gone.
    pub fn skip(&mut self, request: FrameRequest) -> Result<FrameOutcome, PipelineError> {
        let begun = self.begin(request)?;
        self.finish(begun, Processed::NOTHING, &Ended::Dropped(Late::Picture))
    }

    /// A frame whose map, gate decision and health are known.
    ///
    /// # Errors
    /// [`PipelineError`] when the link is gone.
    pub fn frame_of(
        &mut self,
        map: &ForceMap,
        (gate, health): (GateDecision, Health),
        request: FrameRequest,
    ) -> Result<FrameOutcome, PipelineError> {
        let begun = self.begin(request)?;
        let sent = self.session.send_map(&MapInfo { health, ..begun.info }, map)?;
        let latency_us = request.waited_us + sent.encode_us + sent.link_us;
        let processed = Processed {
            gate,
            health,
            ..Processed::NOTHING
        };
        self.finish(begun, processed, &Ended::Sent { sent, latency_us })
    }

    /// Works until `until_us` after frame 0 without a picture.
    ///
    /// # Errors
    /// [`PipelineError`] when the link is gone.
    pub fn idle(&mut self, until_us: u64) -> Result<(), PipelineError> {
        self.work_until(self.start_us + until_us)
    }

    /// Works until the link's clock reaches this time (its low 32 bits); returns at once if it is past.
    ///
    /// # Errors
    /// [`PipelineError`] when the link is gone.
    pub fn idle_until_begun(&mut self, begun_us: u32) -> Result<(), PipelineError> {
        let ahead = begun_us.wrapping_sub(self.session.capture_us());
        if ahead <= u32::MAX / 2 {
            self.run_until(self.session.now_us() + u64::from(ahead))?;
        }
        Ok(())
    }

    /// The mode that the next frame asks for is a new request.
    pub const fn request_anew(&mut self) {
        self.asked = None;
    }

    /// The requested mode is sent again, but not to a device that restarted since: nothing may move by itself because power
    /// came back.
    pub fn request_again(&mut self) {
        let (now_us, restarts) = (self.session.now_us(), self.session.restarts());
        if let Some(asked) = &mut self.asked {
            asked.again(now_us, restarts);
        }
    }

    /// The device refused a command: a request that this answers is not repeated.
    pub fn refused(&mut self, refusal: Refusal) {
        if let Some(why) = self.asked.as_mut().and_then(|asked| asked.refused(refusal)) {
            self.unconfirmed = Some(why);
        }
    }

    /// Why the last request for a mode has no effect, once.
    pub const fn take_unconfirmed(&mut self) -> Option<Unconfirmed> {
        self.unconfirmed.take()
    }

    /// Whether the device's status shows the mode that was last asked for.
    #[must_use]
    pub fn is_confirmed(&self) -> bool {
        self.asked.is_some_and(|asked| asked.is_confirmed())
    }

    /// Whether a mode was asked for that no status shows yet.
    #[must_use]
    pub fn is_asking(&self) -> bool {
        self.asked.is_some_and(|asked| asked.is_waiting())
    }

    /// Lets the link work for this time between two frames; a real one only takes what has arrived and does not wait.
    ///
    /// # Errors
    /// [`PipelineError`] when the link is gone.
    pub fn pass(&mut self, time: Duration) -> Result<(), PipelineError> {
        let now_us = self.session.now_us();
        let passed_us = if self.session.is_real_time() {
            0
        } else {
            time.as_micros() as u64
        };
        self.run_until(now_us + passed_us)
    }

    /// Requests the mode repeatedly until a status shows it; `None` withdraws the previous request. A device that may have
    /// restarted gets no hold before it has answered the handshake: else a restarted one could close by itself. A release is said
    /// whatever is heard: a restarted one refuses it until then.
    ///
    /// # Errors
    /// [`PipelineError`] when the link is gone.
    pub fn ask_for(&mut self, mode: Option<GripMode>) -> Result<(), PipelineError> {
        let Some(mode) = mode else {
            self.asked = None;
            return Ok(());
        };
        let now_us = self.session.now_us();
        if !self.session.is_sound() {
            // The answer to the handshake may be there already.
            self.session.run_until(now_us)?;
        }
        let restarts = self.session.restarts();
        let asked = match self.asked {
            Some(asked) if asked.mode() == mode => asked,
            _ => ModeRequest::new(mode, now_us, restarts),
        };
        if !self.step(asked) {
            return Ok(());
        }
        let command = match mode {
            GripMode::Hold => Command::Hold,
            GripMode::Released => Command::Release,
        };
        let is_withheld =
            mode == GripMode::Hold && !self.session.is_sound() && self.session.presence().away.is_none();
        let was_taken =
            is_withheld || self.session.command(command)? && self.session.command(Command::ReadStatus)?;
        if let Some(asked) = &mut self.asked {
            asked.sent(now_us, was_taken);
        }
        // A microcontroller in this process has answered already.
        self.session.run_until(now_us)?;
        self.look();
        Ok(())
    }

    /// Takes the newest status, and sends nothing.
    pub fn look(&mut self) {
        if let Some(asked) = self.asked {
            self.step(asked);
        }
    }

    /// Takes the newest status; whether the request is to be sent now.
    fn step(&mut self, mut asked: ModeRequest) -> bool {
        let (now_us, restarts) = (self.session.now_us(), self.session.restarts());
        let status = (self.session.status(), self.session.status_age_us());
        let (is_due, why) = asked.step(now_us, status, restarts);
        self.unconfirmed = why.or(self.unconfirmed);
        self.asked = Some(asked);
        is_due
    }

    /// Lets the link work until then; repeats the request meanwhile.
    fn work_until(&mut self, until_us: u64) -> Result<(), PipelineError> {
        while let Some(asked) = self.asked
            && asked.is_waiting()
            && self.session.now_us() + REPEAT_US < until_us
        {
            self.run_until(self.session.now_us() + REPEAT_US)?;
            self.ask_for(Some(asked.mode()))?;
        }
        self.run_until(until_us)
    }

    /// Lets the link work until then. Where nothing else goes out it asks for a status: without pictures maps get stale, but the
    /// link is not lost, as it is when this loop hangs.
    fn run_until(&mut self, until_us: u64) -> Result<(), PipelineError> {
        let silence_us = u64::from(self.session.settings().link_lost_ms) * 1_000 / SIGNS_OF_LIFE;
        loop {
            let due_us = self.session.sent_us() + silence_us.max(1);
            self.session.run_until(until_us.min(due_us))?;
            if due_us > until_us {
                return Ok(());
            }
            self.session.command(Command::ReadStatus)?;
        }
    }

    /// Lets the link work until then. In real time this waits only for the answer to `map` (fingertip and number of the last map),
    /// so that requests are handled soon.
    fn work_until_answered(
        &mut self,
        map: Option<(SensorId, u32)>,
        until_us: u64,
    ) -> Result<(), PipelineError> {
        if !self.session.is_real_time() {
            return self.work_until(until_us);
        }
        let now_us = self.session.now_us();
        self.work_until(now_us)?;
        while map.is_some_and(|map| !self.is_answered(map)) && self.session.now_us() < until_us {
            self.work_until(until_us.min(self.session.now_us() + ANSWER_STEP_US))?;
        }
        Ok(())
    }

    fn is_answered(&self, (sensor, sequence): (SensorId, u32)) -> bool {
        self.session
            .status_of(sensor)
            .is_some_and(|status| status.sequence == sequence && status.maps > 0)
    }

    fn begin(&mut self, request: FrameRequest) -> Result<Begun, PipelineError> {
        self.ask_for(request.mode)?;
        let (at, begun_us) = (Instant::now(), self.session.capture_us());
        Ok(Begun {
            request,
            at,
            start_us: begun_us,
            info: MapInfo {
                sensor: request.sensor,
                sequence: self.sequences[request.sensor.index()],
                capture_us: begun_us.wrapping_sub(request.age_us),
                health: Health::GOOD,
                motion: request.motion,
            },
        })
    }

    /// Lets the link work until the frame is over, and returns the outcome.
    fn finish(
        &mut self,
        begun: Begun,
        processed: Processed,
        ended: &Ended,
    ) -> Result<FrameOutcome, PipelineError> {
        let map = match ended {
            Ended::Sent { .. } => Some((begun.info.sensor, begun.info.sequence)),
            Ended::Dropped(_) => None,
        };
        self.work_until_answered(map, self.start_us + begun.request.until_us)?;
        self.after_absence();
        let (sent, latency_us, late) = match ended {
            Ended::Sent { sent, latency_us } => (*sent, *latency_us, None),
            Ended::Dropped(late) => (SentMap::NOTHING, begun.request.waited_us, Some(*late)),
        };
        let MapInfo {
            sensor,
            sequence,
            capture_us,
            ..
        } = begun.info;
        // A map that was never sent leaves no gap.
        self.sequences[sensor.index()] = sequence.wrapping_add(u32::from(late.is_none()));
        let newest = self.session.status_of(sensor);
        let [downsample_us, gate_us, network_us] = processed.stages_us;
        Ok(FrameOutcome {
            sensor,
            sequence,
            capture_us,
            begun_us: begun.start_us,
            gate: processed.gate,
            health: processed.health,
            motion: begun.info.motion,
            stages_us: [
                begun.request.decode_us,
                downsample_us,
                gate_us,
                network_us,
                sent.encode_us,
                sent.link_us,
            ],
            latency_us,
            wire_bytes: sent.bytes,
            is_lost: sent.is_lost,
            late,
            answered: late.is_none() && self.is_answered((sensor, sequence)),
            // No status of this fingertip yet: what holds for the whole device is known anyway.
            status: newest.unwrap_or_else(|| Status {
                sensor,
                sequence: 0,
                sums: MapSums::default(),
                coulomb_slip: false,
                time_to_slip_ms: None,
                ..self.session.status().copied().unwrap_or_default()
            }),
        })
    }

    /// A command may have been lost with the link: it is sent again once the device is back and has answered the handshake.
    fn after_absence(&mut self) {
        let presence = self.session.presence();
        if presence.away.is_some() || !self.session.is_sound() {
            return;
        }
        if std::mem::replace(&mut self.losses, presence.losses) != presence.losses {
            self.request_again();
        }
    }
}
