//! What the sweeps share: the detectors beside ours, and exact arithmetic as the judge of all of them.

use gripline_firmware::Friction;
use gripline_firmware::sums::TaxelRule;
use gripline_protocol::force_map::quantise_component;
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, PER_UNIT, TaxelForce};

use crate::contacts::Newtons;
use crate::floating::{Form, double, single};

/// The paper's friction, 1/10000.
pub(crate) const FRICTION: u16 = 4_500;
/// The paper's threshold, 1/10000.
pub(crate) const THRESHOLD: u16 = 5_000;

/// The detector's rule.
pub(crate) const fn rule(friction: u16, contact_min: i16) -> TaxelRule {
    TaxelRule {
        friction: Friction::clamped(friction),
        contact_min,
    }
}

/// As `gripline detect` rounds: to the nearest step; and how many components were clipped.
pub(crate) fn quantised(newtons: &Newtons) -> (ForceMap, u32) {
    let (mut map, mut clipped) = (ForceMap::EMPTY, 0);
    for (force, out) in newtons.iter().zip(&mut map.taxels) {
        let [x, y, z] = force.map(|newton| {
            let (step, is_clipped) = quantise_component(newton);
            clipped += u32::from(is_clipped);
            step
        });
        *out = TaxelForce { x, y, z };
    }
    (map, clipped)
}

/// The four detectors in floating point.
pub(crate) const FLOATS: [(&str, bool, Form); 4] = [
    ("f32 root", false, Form::Root),
    ("f32 squares", false, Form::Squares),
    ("f64 root", true, Form::Root),
    ("f64 squares", true, Form::Squares),
];

/// What each of [`FLOATS`] decides about a taxel.
pub(crate) fn floats_decide(newtons: [f64; 3], friction: u16, contact_min: i16) -> [(bool, bool); 4] {
    FLOATS.map(|(_, is_double, form)| {
        let friction = f64::from(friction) / f64::from(PER_UNIT);
        let contact_min_n = newton(contact_min);
        if is_double {
            let rule = double::Rule {
                friction,
                contact_min_n,
                form,
            };
            double::decide(newtons, rule)
        } else {
            let rule = single::Rule {
                friction: friction as f32,
                contact_min_n: contact_min_n as f32,
                form,
            };
            single::decide(newtons.map(|value| value as f32), rule)
        }
    })
}

pub(crate) fn newton(step: i16) -> f64 {
    f64::from(step) / f64::from(LSB_PER_NEWTON)
}

pub(crate) fn newtons_of(force: TaxelForce) -> [f64; 3] {
    [force.x, force.y, force.z].map(newton)
}

/// Wrong decisions of the detector and of the four in floating point.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Wrong {
    pub(crate) fixed: u64,
    pub(crate) floats: [u64; 4],
    /// Wrong decisions of any of the four about taxels exactly on the cone.
    pub(crate) ties: u64,
}

impl Wrong {
    /// Asks all of them about a taxel of the wire.
    pub(crate) fn ask(&mut self, force: TaxelForce, friction: u16, contact_min: i16) -> (bool, bool) {
        let right = crate::exact::taxel(force, friction, contact_min);
        self.fixed += u64::from(rule(friction, contact_min).decide(force) != right);
        let floats = floats_decide(newtons_of(force), friction, contact_min);
        for (wrong, found) in self.floats.iter_mut().zip(floats) {
            let differs = found != right;
            *wrong += u64::from(differs);
            self.ties += u64::from(differs && crate::exact::is_on_cone(force, friction));
        }
        right
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.fixed += other.fixed;
        self.ties += other.ties;
        for (sum, part) in self.floats.iter_mut().zip(other.floats) {
            *sum += part;
        }
    }
}
