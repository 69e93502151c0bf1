//! What happens in a grasp, whichever world it is of: the scene, its times, what goes wrong with pictures and forces.
//! Units: s, mm.

use gripline_simulation::Random;
use gripline_simulation::contact_world::Shape;
use gripline_simulation::grasp::{GraspScene, Stroke};

use super::distortion::Distortion;
use super::pictures::PictureFault;

/// Frames a second.
pub const FRAMES_PER_SECOND: f64 = 60.0;
/// Cells of the contact world: the grid that training uses, a few percent off the production grid.
pub(super) const CELLS: usize = 40;
/// First number of a grasp's sensor.
pub(super) const FIRST_SENSOR: u64 = 9_000_000;
/// Grip that the object's weight needs, N: mass follows from it and friction.
pub(super) const NEEDS_N: [f64; 2] = [1.0, 6.0];
/// Standard gravity, N/g.
pub(super) const NEWTONS_PER_GRAM: f64 = 9.806_65e-3;
/// From picture to gripper: readout 10 ms, gate and network 2 ms, wire and decision 3 ms, the gripper's bus 10 ms.
pub const DEAD_TIME_S: f64 = 0.025;
/// The arm takes up the load before it lifts, as people do (loading phase; Johansson and Westling 1984): so far, in so
/// long.
pub(super) const LOADING_MM: f64 = 1.5;
pub(super) const LOADING_S: f64 = 0.5;
/// When the arm takes up the load.
pub const LIFT_S: f64 = 0.3;

/// When it happens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Times {
    /// The object is up: the hold begins.
    pub up_s: f64,
    /// The hold ends: the arm puts the object down.
    pub put_down_s: f64,
    /// The object stands again.
    pub down_s: f64,
    /// The end.
    pub end_s: f64,
}

/// A grasp.
#[derive(Debug, Clone)]
pub struct GraspPlan {
    /// Its number.
    pub number: u64,
    /// Everything that happens.
    pub scene: GraspScene,
    /// When.
    pub times: Times,
    /// What disturbs it.
    pub disturbance: String,
    /// The virtual sensor that looks.
    pub sensor: u64,
    /// How its forces are off beyond the model of the chain.
    pub distortion: Option<Distortion>,
    /// What goes wrong with its pictures.
    pub picture_faults: Vec<PictureFault>,
}

impl GraspPlan {
    /// The same, but that the object is held for so much longer, s, in which nothing happens.
    #[must_use]
    pub fn held_longer(mut self, hold_s: f64) -> Self {
        let put_down_s = self.times.put_down_s;
        for stroke in &mut self.scene.arm.strokes {
            if let Stroke::Move { from_s, .. } = stroke
                && *from_s >= put_down_s
            {
                *from_s += hold_s;
            }
        }
        self.times.put_down_s += hold_s;
        self.times.down_s += hold_s;
        self.times.end_s += hold_s;
        self
    }

    /// The same, but that friction falls evenly to `share` of itself in the last `hold_s` of the hold.
    #[must_use]
    pub fn fading(mut self, hold_s: f64, share: f64) -> Self {
        let put_down_s = self.times.put_down_s;
        for law in &mut self.scene.friction_laws {
            let course = std::mem::take(&mut law.course);
            law.course = course.fading([put_down_s - hold_s, put_down_s], share);
        }
        self
    }
}

/// A rounded patch.
pub(super) fn shape(random: &mut Random) -> Shape {
    let mut length = |from: f64, to: f64| random.log_uniform(from, to);
    let lengths = [length(8.0, 30.0), length(8.0, 25.0), length(2.0, 5.0)];
    match random.below(4) {
        0 => Shape::Sphere {
            radius_mm: lengths[0],
        },
        1 => Shape::Cylinder {
            radius_mm: lengths[0],
            length_mm: 8.0 + 0.4 * lengths[1],
            edge_mm: lengths[2],
        },
        2 => Shape::Ellipsoid {
            axes_mm: [lengths[0], lengths[1], 0.5 * (lengths[0] + lengths[1])],
        },
        _ => Shape::Block {
            sides_mm: [0.3 * lengths[0] + 1.0, 0.3 * lengths[1] + 1.0],
            edge_mm: lengths[2],
        },
    }
}

#[cfg(test)]
mod tests {
    use super::super::{adverse, nominal};

    #[test]
    fn friction_that_fades_is_as_it_was_until_the_longer_hold_begins() {
        let mut adverse = (0..).map(|number| adverse::grasp(1, number));
        let drops = adverse.find(|plan| plan.disturbance.contains("friction drops"));
        for plan in [nominal::grasp(1, 0), drops.unwrap()] {
            let longer = plan.clone().held_longer(20.0).fading(20.0, 0.5);
            let share = |plan: &super::GraspPlan, time_s: f64| plan.scene.friction_laws[0].course.at(time_s);
            let last = share(&plan, 100.0);
            for part in [0.0, 0.4, 0.6, 0.9, 1.0] {
                let time_s = part * plan.times.put_down_s;
                assert!(
                    (share(&longer, time_s) - share(&plan, time_s)).abs() < 1e-12,
                    "{time_s} s"
                );
            }
            assert!((share(&longer, longer.times.put_down_s) - 0.5 * last).abs() < 1e-12);
        }
    }

    #[test]
    fn a_longer_hold_puts_the_object_down_later_and_moves_nothing_before() {
        for plan in [nominal::grasp(1, 0), adverse::grasp(1, 0)] {
            let longer = plan.clone().held_longer(60.0);
            let [before, after] = [&plan, &longer].map(|plan| plan.times);
            assert!((after.up_s - before.up_s).abs() < 1e-9);
            for (after_s, before_s) in [
                (after.put_down_s, before.put_down_s),
                (after.down_s, before.down_s),
                (after.end_s, before.end_s),
            ] {
                assert!((after_s - before_s - 60.0).abs() < 1e-9);
            }
            // A shake may still go on when the object is put down.
            let calm_s = before.put_down_s + 0.15;
            let assert_same_place = |early_s: f64, late_s: f64| {
                let [one, other] = [(&plan, early_s), (&longer, late_s)]
                    .map(|(plan, time_s)| plan.scene.arm.place_mm(time_s));
                assert!((one[0] - other[0]).hypot(one[1] - other[1]) < 1e-9, "{early_s} s");
            };
            for step in 0..100 {
                let share = f64::from(step) / 100.0;
                let early_s = share * before.put_down_s;
                assert_same_place(early_s, early_s);
                let late_s = calm_s + share * (before.end_s - calm_s);
                assert_same_place(late_s, late_s + 60.0);
            }
        }
    }
}
