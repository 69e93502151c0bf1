//! Who sets the grip: the microcontroller's own library, or simpler rules, a particle filter and an oracle for comparison. All start with the
//! same least force and, where they move, with the same rates. Units: N, s.

use gripline_firmware::Friction;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below, sums_of};
use gripline_network::Network;
use gripline_protocol::message::{Command, Configuration};
use gripline_protocol::{LSB_PER_NEWTON, MapInfo, Motion, PER_UNIT, SensorId};
use serde::{Deserialize, Serialize};

use super::super::detectors::{PAPER_FRICTION, PAPER_THRESHOLD};
use super::follower::Follower;
use super::oracle::{Oracle, Truth};
use super::particle_filter::ParticleFilter;
use super::pictures::Delivered;
use crate::error::EvaluationError;
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;
use gripline_pipeline::{GripSetting, settings_for};

/// Least grip of every policy that moves, N.
pub const FLOOR_N: f64 = 1.0;
/// Largest grip of every policy, N: the firmware's ceiling.
#[must_use]
pub fn ceiling_n() -> f64 {
    f64::from(Configuration::DEFAULT.ceiling) / f64::from(LSB_PER_NEWTON)
}
/// The rules' rates: that of the reflex and of relaxing, N/s, and how long nothing slips before it relaxes.
const RAISE_N_PER_S: f64 = 40.0;
const RELAX_N_PER_S: f64 = 1.0;
const RELAX_AFTER_S: f64 = 0.5;

/// A policy's name.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Policy {
    /// Gripline as `gripline run` sets it, except for the least force.
    Gripline,
    /// The same with evidence of motion from the host.
    GriplineMotion,
    /// The same with the named setting `sparing`.
    GriplineSparing,
    /// The same with the named setting `secure`.
    GriplineSecure,
    /// The same, but that nothing is learnt: by the detector's friction, with a reflex.
    GriplineCareful,
    /// Up while F_T > μ F_N.
    Coulomb,
    /// Up while the stick ratio is below the threshold.
    StickRatio,
    /// A particle filter on friction.
    ParticleFilter,
    /// Knows the load and the sliding friction of the moment.
    Oracle,
    /// The same force for every grasp.
    Fixed,
}

impl Policy {
    /// Those that look; a fixed force follows from what came of them.
    pub const LOOKING: [Self; 9] = [
        Self::Gripline,
        Self::GriplineMotion,
        Self::GriplineSparing,
        Self::GriplineSecure,
        Self::GriplineCareful,
        Self::Coulomb,
        Self::StickRatio,
        Self::ParticleFilter,
        Self::Oracle,
    ];

    /// All of them.
    #[must_use]
    pub fn all() -> Vec<Self> {
        Self::LOOKING.into_iter().chain([Self::Fixed]).collect()
    }

    /// Its name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gripline => "Gripline",
            Self::GriplineMotion => "Gripline, sees motion",
            Self::GriplineSparing => "Gripline, sparing",
            Self::GriplineSecure => "Gripline, secure",
            Self::GriplineCareful => "Gripline, nothing learnt",
            Self::Coulomb => "Coulomb bang-bang",
            Self::StickRatio => "stick ratio bang-bang",
            Self::ParticleFilter => "particle filter on friction",
            Self::Oracle => "oracle",
            Self::Fixed => "fixed force",
        }
    }
}

/// A policy at work.
pub(super) enum Worker {
    /// The microcontroller's library behind its protocol, on its own clock.
    Microcontroller {
        session: Box<Session>,
        sequence: u32,
        /// It gets the host's evidence of motion.
        sees_motion: bool,
    },
    /// A rule.
    Rule {
        by_stick_ratio: bool,
        line_n: f64,
        quiet_s: f64,
    },
    /// A particle filter.
    ParticleFilter(Box<ParticleFilter>),
    /// The oracle.
    Oracle(Oracle),
    /// A force.
    Fixed(f64),
}

impl Worker {
    /// Begins to hold; `seed` is for what a policy draws.
    ///
    /// # Errors
    /// Settings that the microcontroller refuses.
    pub(super) fn new(
        policy: Policy,
        network: &Network,
        fixed_n: f64,
        seed: u64,
    ) -> Result<Self, EvaluationError> {
        let defaults = Configuration {
            floor: (FLOOR_N * f64::from(LSB_PER_NEWTON)) as i32,
            ..settings_for(network)
        };
        let rule = |by_stick_ratio| Self::Rule {
            by_stick_ratio,
            line_n: FLOOR_N,
            quiet_s: 0.0,
        };
        let settings = match policy {
            Policy::Fixed => return Ok(Self::Fixed(fixed_n)),
            Policy::Coulomb => return Ok(rule(false)),
            Policy::StickRatio => return Ok(rule(true)),
            Policy::ParticleFilter => {
                let filter = ParticleFilter::new(Follower::new(FLOOR_N, ceiling_n()), seed);
                return Ok(Self::ParticleFilter(Box::new(filter)));
            }
            Policy::Oracle => return Ok(Self::Oracle(Oracle::new(Follower::new(FLOOR_N, ceiling_n())))),
            Policy::Gripline | Policy::GriplineMotion => GripSetting::Normal.apply(defaults),
            Policy::GriplineSparing => GripSetting::Sparing.apply(defaults),
            Policy::GriplineSecure => GripSetting::Secure.apply(defaults),
            Policy::GriplineCareful => Configuration {
                friction: defaults.friction,
                contact_min: defaults.contact_min,
                floor: defaults.floor,
                ..Configuration::CAREFUL
            },
        };
        let mut session = Session::open(Box::new(EmbeddedLink::new()), settings)?;
        session.command(Command::Hold)?;
        Ok(Self::Microcontroller {
            session: Box::new(session),
            sequence: 0,
            sees_motion: policy == Policy::GriplineMotion,
        })
    }

    /// The line after what came of a frame and the frame's time; `truth` is for the oracle.
    ///
    /// # Errors
    /// A link that is gone.
    pub(super) fn line_n(
        &mut self,
        came: Option<&Delivered>,
        truth: Truth,
        frame_s: f64,
    ) -> Result<f64, EvaluationError> {
        // Rules without a safety of their own leave doubtful pictures out.
        let good = came.filter(|came| came.health.is_good()).map(|came| &came.map);
        match self {
            Self::Oracle(oracle) => Ok(oracle.line_n(truth, frame_s)),
            Self::ParticleFilter(filter) => Ok(match good {
                Some(map) => filter.line_n(map, frame_s),
                None => filter.stays_n(),
            }),
            Self::Fixed(force_n) => Ok(*force_n),
            Self::Rule {
                by_stick_ratio,
                line_n,
                quiet_s,
            } => {
                let Some(map) = good else { return Ok(*line_n) };
                let friction = Friction::clamped((PAPER_FRICTION * f64::from(PER_UNIT)) as u16);
                let sums = sums_of(
                    map,
                    TaxelRule {
                        friction,
                        contact_min: 0,
                    },
                );
                let [x, y, normal] = sums.force;
                let slips = if *by_stick_ratio {
                    stick_ratio_below(&sums, (PAPER_THRESHOLD * f64::from(PER_UNIT)) as u16)
                } else {
                    friction.exceeded_by([x, y], normal)
                };
                *quiet_s = if slips { 0.0 } else { *quiet_s + frame_s };
                if slips {
                    *line_n = (*line_n + RAISE_N_PER_S * frame_s).min(ceiling_n());
                } else if *quiet_s > RELAX_AFTER_S {
                    *line_n = (*line_n - RELAX_N_PER_S * frame_s).max(FLOOR_N);
                }
                Ok(*line_n)
            }
            Self::Microcontroller {
                session,
                sequence,
                sees_motion,
            } => {
                if let Some(Delivered {
                    map,
                    health,
                    motion,
                    age,
                }) = came
                {
                    let age_us = (f64::from(*age) * frame_s * 1e6).round() as u32;
                    let info = MapInfo {
                        sensor: SensorId::FIRST,
                        sequence: *sequence,
                        capture_us: session.capture_us().wrapping_sub(age_us),
                        health: *health,
                        motion: if *sees_motion { *motion } else { Motion::UNKNOWN },
                    };
                    session.send_map(&info, map)?;
                    *sequence += 1;
                }
                let until_us = session.now_us() + (frame_s * 1e6).round() as u64;
                session.run_until(until_us)?;
                Ok(session.line_n())
            }
        }
    }
}
