//! The detector's confidence that something slips: all witnesses combined in one number.
//!
//! | witness | says slip when | knows friction |
//! |---|---|---|
//! | stick ratio | few taxels stick and the load does not say otherwise ([`slip`](crate::slip)) | the detector's |
//! | unrest | the pressure is rearranged at constant load (`unrest.rs`) | no |
//! | shear follows | the shear rises and falls with the grip ([`slide_witness`](crate::slide_witness)) | no |
//! | motion | the camera sees the object move against the skin ([`Motion`]) | no |
//!
//! Each gives natural logarithms of odds, which add up for independent witnesses (Good 1950). Without a witness the odds are −3.
//! The weights follow from the reliability of each: one picture in which hardly a taxel sticks, a test in which the shear followed,
//! or a clear picture of motion is enough; unrest alone is hardly enough.
//!
//! Units: odds in 1/256, evidence 1/10000.

use gripline_protocol::Motion;
use gripline_protocol::message::{MapSums, SlipState, Witnesses};

use crate::arithmetic::divide;
use crate::clock::HostMicros;
use crate::slide_witness::Urgency;
use crate::slip::{SlipDecision, severity};
use crate::unrest::Unrest;

/// Odds of 1.
const NAT: i32 = 256;
/// Without any witness.
const SILENCE: i32 = -3 * NAT;
/// When nothing sticks at all.
const NOTHING_STICKS: i32 = 7 * NAT;
/// For each doubling of the unrest above twice the usual, and its limit in either direction.
const OCTAVE_OF_UNREST: i32 = 3 * NAT / 2;
const UNREST_MAX: i32 = 4 * NAT;
/// The shear follows the grip; a clear picture of motion, or of rest.
const FOLLOWS: i32 = 7 * NAT;
const MOTION: i32 = 7 * NAT;

/// The evidence of one fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct SlipEvidence {
    unrest: Unrest,
    joined: u16,
    witnesses: Witnesses,
}

impl SlipEvidence {
    /// Before the first map.
    pub(crate) const fn new() -> Self {
        Self {
            unrest: Unrest::new(),
            joined: 0,
            witnesses: Witnesses {
                stick_ratio: 0,
                unrest: 0,
                shear_follows: 0,
                motion: 0,
            },
        }
    }

    /// Takes a new map and its decision; from the stick ratio `leave` on, the ratio is no evidence of slip.
    pub(crate) fn observe(
        &mut self,
        sums: &MapSums,
        decision: SlipDecision,
        (motion, urgency): (Motion, Urgency),
        capture: HostMicros,
        leave: u16,
    ) {
        if sums.contact == 0 {
            *self = Self::new();
            // An object that slides off the skin leaves an empty map behind; whoever saw it go says so.
            if of_motion(motion) > 0 {
                self.joined = probability(SILENCE + of_motion(motion));
                self.witnesses.motion = self.joined;
            }
            return;
        }
        self.unrest.observe(sums, capture);
        let unrest = of_unrest(self.unrest.above_usual());
        // A slide without stick-slip is calm: where another witness sees a slide, calm says nothing against it.
        let is_seen = urgency == Urgency::Follows || motion.shows_motion();
        let odds = [
            of_stick_ratio(decision, leave),
            if is_seen { unrest.max(0) } else { unrest },
            of_test(urgency),
            of_motion(motion),
        ];
        let alone = |odds: i32| probability(SILENCE + odds);
        let [stick_ratio, unrest, shear_follows, motion] = odds.map(alone);
        self.witnesses = Witnesses {
            stick_ratio,
            unrest,
            shear_follows,
            motion,
        };
        self.joined = probability(SILENCE + odds.iter().sum::<i32>());
    }

    /// The confidence of all witnesses together.
    pub(crate) const fn joined(&self) -> u16 {
        self.joined
    }

    /// The confidence of each by itself.
    pub(crate) const fn witnesses(&self) -> Witnesses {
        self.witnesses
    }
}

/// From 0 at `leave` to [`NOTHING_STICKS`] at 0. If the load shows that the contact holds, the ratios do not count.
fn of_stick_ratio(decision: SlipDecision, leave: u16) -> i32 {
    let Some(ratio) = decision.stick_ratio else {
        return 0;
    };
    if severity(decision.state) <= severity(SlipState::Stick) {
        return 0;
    }
    let missing = u64::from(leave.saturating_sub(ratio));
    divide(missing * NOTHING_STICKS as u64, leave) as i32
}

fn of_unrest(above_usual: Option<i32>) -> i32 {
    let Some(above_usual) = above_usual else { return 0 };
    let octaves_256ths = (above_usual >> 8) - NAT;
    (octaves_256ths * OCTAVE_OF_UNREST / NAT).clamp(-UNREST_MAX, UNREST_MAX)
}

const fn of_test(urgency: Urgency) -> i32 {
    match urgency {
        Urgency::None => 0,
        Urgency::Tests => NAT / 2,
        Urgency::Short | Urgency::SuddenlyShort => 3 * NAT / 2,
        Urgency::Follows => FOLLOWS,
    }
}

fn of_motion(motion: Motion) -> i32 {
    let [evidence, quality, evidence_max, quality_max] = [
        motion.evidence(),
        motion.quality(),
        Motion::EVIDENCE_MAX,
        Motion::QUALITY_MAX,
    ]
    .map(i32::from);
    (2 * evidence - evidence_max) * quality * MOTION / (evidence_max * quality_max)
}

/// Odds as a probability, 1/10000: straight lines between the logistic function's values every quarter.
fn probability(odds: i32) -> u16 {
    let size = odds.unsigned_abs();
    let (place, beyond) = ((size / 64) as usize, size % 64);
    let at = |place: usize| u32::from(LOGISTIC.get(place).copied().unwrap_or(10_000));
    let above = at(place) + (at(place + 1) - at(place)) * beyond / 64;
    (if odds < 0 { 10_000 - above } else { above }) as u16
}

/// 10000/(1 + e^(−x)) for x = 0, ¼, ½ … 8.
const LOGISTIC: [u16; 33] = [
    5_000, 5_622, 6_225, 6_792, 7_311, 7_773, 8_176, 8_520, 8_808, 9_047, 9_241, 9_399, 9_526, 9_627, 9_707,
    9_770, 9_820, 9_859, 9_890, 9_914, 9_933, 9_948, 9_959, 9_968, 9_975, 9_981, 9_985, 9_988, 9_991, 9_993,
    9_994, 9_996, 9_997,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_become_probabilities_as_the_logistic_function_says() {
        for odds in -5_000..5_000 {
            let exact = 10_000.0 / (1.0 + (-f64::from(odds) / 256.0).exp());
            assert!((f64::from(probability(odds)) - exact).abs() < 12.0, "{odds}");
            assert!(probability(odds + 1) >= probability(odds));
        }
    }

    fn contact() -> MapSums {
        MapSums {
            contact: 20,
            stick: 20,
            force: [0, 0, 40_000],
            second_moment: 200_000,
            ..MapSums::default()
        }
    }

    fn evidence(state: SlipState, ratio: u16, motion: Motion, urgency: Urgency) -> SlipEvidence {
        let mut evidence = SlipEvidence::new();
        let decision = SlipDecision {
            state,
            stick_ratio: Some(ratio),
            time_to_slip_ms: None,
        };
        evidence.observe(&contact(), decision, (motion, urgency), HostMicros(0), 6_000);
        evidence
    }

    #[test]
    fn each_witness_that_is_sure_is_enough_and_none_leaves_little() {
        let unknown = Motion::UNKNOWN;
        let calm = evidence(SlipState::Stick, 10_000, unknown, Urgency::None);
        assert!(calm.joined() < 1_000, "{calm:?}");
        for sure in [
            evidence(SlipState::Slip, 0, unknown, Urgency::None),
            evidence(SlipState::Stick, 10_000, unknown, Urgency::Follows),
            evidence(SlipState::Stick, 10_000, Motion::new(63, 3), Urgency::None),
        ] {
            assert!(sure.joined() > 8_000, "{sure:?}");
        }
    }

    #[test]
    fn ratios_near_friction_are_little_evidence_and_a_clear_picture_of_rest_takes_it_away() {
        let near = evidence(SlipState::Incipient, 5_500, Motion::UNKNOWN, Urgency::None);
        assert!(near.joined() < 2_500, "{near:?}");
        let at_rest = evidence(SlipState::Slip, 2_000, Motion::new(0, 3), Urgency::None);
        assert!(at_rest.joined() < 1_000, "{at_rest:?}");
    }

    #[test]
    fn the_better_the_picture_the_more_motion_says_and_the_middle_says_nothing() {
        let joined = |evidence_of: u8, quality: u8| {
            evidence(
                SlipState::Stick,
                10_000,
                Motion::new(evidence_of, quality),
                Urgency::None,
            )
            .joined()
        };
        assert!(joined(63, 1) < joined(63, 2) && joined(63, 2) < joined(63, 3));
        assert!(joined(0, 1) > joined(0, 2) && joined(0, 2) > joined(0, 3));
        let nothing = joined(0, 0);
        assert!(joined(31, 3).abs_diff(nothing) < 200 && joined(32, 3).abs_diff(nothing) < 200);
    }

    #[test]
    fn a_calm_map_takes_nothing_from_a_slide_that_another_witness_sees() {
        let mut evidence = SlipEvidence::new();
        let sticks = SlipDecision {
            state: SlipState::Stick,
            stick_ratio: Some(10_000),
            time_to_slip_ms: None,
        };
        let mut look = |urgency: Urgency, map: u32| {
            // The RMS radius changes by less and less: the calmest map there is.
            let sums = MapSums {
                second_moment: 200_000 + 8_000 / (map as i32 + 1),
                ..contact()
            };
            evidence.observe(
                &sums,
                sticks,
                (Motion::UNKNOWN, urgency),
                HostMicros(map * 16_667),
                6_000,
            );
            evidence.joined()
        };
        let calm = (0..60).map(|map| look(Urgency::None, map)).last().unwrap();
        assert!(calm < 200, "{calm}");
        let slides = look(Urgency::Follows, 60);
        assert!(slides > 9_500, "{slides}");
    }

    #[test]
    fn without_contact_there_is_none_unless_the_picture_shows_the_object_leave() {
        let empty = |motion: Motion| {
            let mut evidence = evidence(SlipState::Slip, 0, Motion::new(63, 3), Urgency::Follows);
            evidence.observe(
                &MapSums::default(),
                SlipDecision::default(),
                (motion, Urgency::None),
                HostMicros(1),
                6_000,
            );
            evidence
        };
        for silent in [Motion::UNKNOWN, Motion::new(0, 3), Motion::new(31, 3)] {
            assert_eq!(empty(silent), SlipEvidence::new());
        }
        let left = empty(Motion::new(63, 3));
        assert!(
            left.joined() > 9_000 && left.witnesses().motion == left.joined(),
            "{left:?}"
        );
    }
}
