//! One turn of the loop: picture in, map out, answer in. The same for a run and for the replay of a recording, so that
//! the replay decides what the run decided. Times in µs of the link's clock.

use std::time::{Duration, Instant};

use gripline_network::scene::Verdict;
use gripline_protocol::message::{Command, GripMode, MapSums, Status};
use gripline_protocol::{ForceMap, Health, MapInfo, SENSORS};

use crate::pipeline::Pipeline;
use gripline_link::session::{SentMap, Session};
use gripline_recording::error::Failure;
use gripline_recording::telemetry::STAGES;

/// A picture that is older than this when its turn comes, µs, is dropped: a frame at 60 a second, and what a busy system may
/// hold a thread up.
pub const PICTURE_OLD_US: u64 = 20_000;
/// A map whose picture is older than this when it could be sent, µs, is dropped: half of what the microcontroller by default
/// calls stale.
pub const MAP_OLD_US: u64 = 50_000;

/// The gate decision's name, for programs.
#[must_use]
pub const fn gate_name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::NoContact => "no_contact",
        Verdict::Unchanged => "unchanged",
        Verdict::Network => "network",
        Verdict::Unhealthy => "unhealthy",
    }
}

/// Where a frame was dropped because it was too old by then. Nothing is done late: the next picture is fresher.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Late {
    /// Before anybody looked at it.
    Picture,
    /// Its map was not sent.
    Map,
}

impl Late {
    /// Its name, for programs.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Picture => "picture",
            Self::Map => "map",
        }
    }

    /// The one with this name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Picture, Self::Map]
            .into_iter()
            .find(|late| late.name() == name)
    }
}

/// What may be late in a turn.
#[derive(Debug, Clone, Copy)]
pub enum Lateness {
    /// Nothing: the world waits.
    Never,
    /// What is too old, for a picture that was taken then.
    Since(Instant),
    /// What was late when it was recorded.
    Recorded(Option<Late>),
}

impl Lateness {
    fn is_late(self, at: Late) -> bool {
        let most_us = match at {
            Late::Picture => PICTURE_OLD_US,
            Late::Map => MAP_OLD_US,
        };
        match self {
            Self::Never => false,
            Self::Since(taken) => taken.elapsed() > Duration::from_micros(most_us),
            Self::Recorded(late) => late == Some(at),
        }
    }
}

/// Whose turn it is, and until when.
#[derive(Debug, Clone, Copy)]
pub struct At {
    /// The fingertip, from 0.
    pub sensor: u8,
    /// What is wanted of the gripper.
    pub wish: GripMode,
    /// How long ago the picture was taken, by the link's clock.
    pub age_us: u32,
    /// The turn works until then, after frame 0.
    pub until_us: u64,
}

/// A session and what the gripper was last told.
pub struct Cycle {
    /// The conversation with the microcontroller.
    pub session: Session,
    wish: Option<GripMode>,
    /// The number of each fingertip's next map.
    sequences: [u32; SENSORS],
    /// The link's time of frame 0.
    start_us: u64,
    /// How often the device had gone away, and how often it had restarted, when it last was as it should be.
    met: (u32, u32),
}

/// What one turn came to.
#[derive(Debug, Clone, Copy)]
pub struct Turn {
    /// The fingertip, from 0.
    pub sensor: u8,
    /// Number of the map.
    pub sequence: u32,
    /// When the picture was taken, on the link's clock.
    pub capture_us: u32,
    /// When the turn began, on the link's clock.
    pub begun_us: u32,
    /// What the gate said.
    pub verdict: Verdict,
    /// What is known against the picture.
    pub health: Health,
    /// Time of each of [`STAGES`]; 0 where the gate skipped it, and for the decoding, which lies before.
    pub stages_us: [f64; STAGES.len()],
    /// Picture in to map out.
    pub latency_us: f64,
    /// Bytes on the wire.
    pub wire_bytes: usize,
    /// The link did not take the map.
    pub is_lost: bool,
    /// Where it was dropped because it was too old; there is then no map to answer.
    pub late: Option<Late>,
    /// The newest status about this fingertip, which may be older than this map.
    pub status: Status,
    /// The status is the answer to this map.
    pub answered: bool,
}

impl Turn {
    /// The map is out.
    fn with(self, sent: &SentMap) -> Self {
        let mut stages_us = self.stages_us;
        stages_us[STAGES.len() - 2..].copy_from_slice(&[sent.encode_us, sent.link_us]);
        Self {
            stages_us,
            latency_us: sent.encode_us + sent.link_us,
            wire_bytes: sent.bytes,
            is_lost: sent.is_lost,
            ..self
        }
    }
}

impl Cycle {
    /// Frame 0 is now.
    pub fn new(session: Session) -> Self {
        Self {
            start_us: session.now_us(),
            session,
            wish: None,
            sequences: [0; SENSORS],
            met: (0, 0),
        }
    }

    /// The fingertip's next map has this number: the maps before it are not to be had.
    pub fn resume_at(&mut self, sensor: u8, sequence: u32) {
        self.sequences[usize::from(sensor)] = sequence;
    }

    /// Works with this picture's map, as far as it is not too old.
    ///
    /// # Errors
    /// [`Failure`] when the network's output is no number or the link is gone.
    pub fn turn(
        &mut self,
        pipeline: &mut Pipeline,
        crop: &[u8],
        lateness: Lateness,
        at: At,
    ) -> Result<Turn, Failure> {
        self.tell(at.wish)?;
        let begun = Instant::now();
        let begun_us = self.session.capture_us();
        if lateness.is_late(Late::Picture) {
            return self.skip(at);
        }
        let processed = pipeline.process(crop).map_err(Failure::failed)?;
        let (verdict, health, stages) = (processed.verdict, processed.health, processed.stages_us);
        let looked = Turn {
            stages_us: [0.0, stages[0], stages[1], stages[2], 0.0, 0.0],
            ..self.unsent(at, begun_us, (verdict, health))
        };
        if lateness.is_late(Late::Map) {
            let turn = Turn {
                late: Some(Late::Map),
                ..looked
            };
            return self.finish(turn, at.until_us);
        }
        let sent = self.send(&looked, processed.map)?;
        let turn = Turn {
            latency_us: begun.elapsed().as_secs_f64() * 1e6,
            ..looked.with(&sent)
        };
        self.finish(turn, at.until_us)
    }

    /// Works with a picture that is too old to be looked at.
    ///
    /// # Errors
    /// [`Failure`] when the link is gone.
    pub fn skip(&mut self, at: At) -> Result<Turn, Failure> {
        self.tell(at.wish)?;
        let begun_us = self.session.capture_us();
        let turn = Turn {
            late: Some(Late::Picture),
            ..self.unsent(at, begun_us, (Verdict::Unchanged, Health::GOOD))
        };
        self.finish(turn, at.until_us)
    }

    /// The same with a map that is already there.
    ///
    /// # Errors
    /// [`Failure`] when the link is gone.
    pub fn turn_with(&mut self, map: &ForceMap, looked: (Verdict, Health), at: At) -> Result<Turn, Failure> {
        self.tell(at.wish)?;
        let turn = self.unsent(at, self.session.capture_us(), looked);
        let sent = self.send(&turn, map)?;
        self.finish(turn.with(&sent), at.until_us)
    }

    /// Works until `until_us` after frame 0 without a picture.
    ///
    /// # Errors
    /// [`Failure`] when the link is gone.
    pub fn idle(&mut self, until_us: u64) -> Result<(), Failure> {
        self.session
            .run_until(self.start_us + until_us)
            .map_err(Failure::failed)
    }

    /// Works until the link's clock, of which these are the low 32 bits, shows this time; not at all when it is past.
    ///
    /// # Errors
    /// [`Failure`] when the link is gone.
    pub fn idle_until_begun(&mut self, begun_us: u32) -> Result<(), Failure> {
        let ahead = begun_us.wrapping_sub(self.session.capture_us());
        if ahead > u32::MAX / 2 {
            return Ok(());
        }
        let until_us = self.session.now_us() + u64::from(ahead);
        self.session.run_until(until_us).map_err(Failure::failed)
    }

    /// The next turn tells the gripper anew what is wanted.
    pub const fn tell_again(&mut self) {
        self.wish = None;
    }

    /// A command may have been lost with the link. A microcontroller that came back as it was is told anew; one that
    /// restarted is not: nothing must move by itself because power came back.
    fn after_absence(&mut self) {
        if !self.session.is_sound() {
            return;
        }
        let now = (self.session.presence().losses, self.session.restarts());
        if now.0 != self.met.0 && now.1 == self.met.1 {
            self.wish = None;
        }
        self.met = now;
    }

    fn tell(&mut self, wish: GripMode) -> Result<(), Failure> {
        if self.wish != Some(wish) {
            let command = match wish {
                GripMode::Hold => Command::Hold,
                GripMode::Released => Command::Release,
            };
            let is_told = self.session.command(command).map_err(Failure::failed)?;
            self.wish = is_told.then_some(wish);
        }
        Ok(())
    }

    fn send(&mut self, turn: &Turn, map: &ForceMap) -> Result<SentMap, Failure> {
        let info = MapInfo {
            sensor: turn.sensor,
            sequence: turn.sequence,
            capture_us: turn.capture_us,
            health: turn.health,
        };
        self.session.send_map(&info, map).map_err(Failure::failed)
    }

    /// A turn as far as it is before its map is out.
    fn unsent(&self, at: At, begun_us: u32, (verdict, health): (Verdict, Health)) -> Turn {
        Turn {
            sensor: at.sensor,
            sequence: self.sequences[usize::from(at.sensor)],
            capture_us: begun_us.wrapping_sub(at.age_us),
            begun_us,
            verdict,
            health,
            stages_us: [0.0; STAGES.len()],
            latency_us: 0.0,
            wire_bytes: 0,
            is_lost: false,
            late: None,
            status: Status::default(),
            answered: false,
        }
    }

    fn finish(&mut self, turn: Turn, until_us: u64) -> Result<Turn, Failure> {
        self.session
            .run_until(self.start_us + until_us)
            .map_err(Failure::failed)?;
        self.after_absence();
        // A map that was never sent leaves no gap.
        self.sequences[usize::from(turn.sensor)] = turn.sequence.wrapping_add(u32::from(turn.late.is_none()));
        let spoken = self.session.status_of(turn.sensor);
        let is_answer = |status: Status| status.sequence == turn.sequence && status.maps > 0;
        Ok(Turn {
            answered: turn.late.is_none() && spoken.is_some_and(is_answer),
            // Nothing was said of this fingertip yet: the rest is known all the same.
            status: spoken.unwrap_or_else(|| Status {
                sensor: turn.sensor,
                sequence: 0,
                sums: MapSums::default(),
                coulomb_slip: false,
                time_to_slip_ms: None,
                ..self.session.status().copied().unwrap_or_default()
            }),
            ..turn
        })
    }
}
