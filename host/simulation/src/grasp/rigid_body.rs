//! The object as a rigid body in the plane of the fingers, one implicit Euler step: where it would be under its
//! momentum, the loads and the table, and how hard it resists being elsewhere. Units: mm, rad, s, N, N·mm; mass
//! in N·s²/mm. Limits: first order in time: oscillations faster than a few steps are damped away, never fed.

use super::object::Object;
use super::setting::Table;
use crate::contact_world::{Matrix, Triple};

/// What the object is and how it moves against the gripper.
#[derive(Debug, Clone)]
pub(crate) struct RigidBody {
    mass: f64,
    inertia: f64,
    centre_mm: [f64; 2],
    /// Place of the grip point and turn.
    pub(crate) pose: Triple,
    /// Velocity of the centre of mass, and spin.
    speed: Triple,
    table: Option<TableState>,
}

/// How the table supports the object.
#[derive(Debug, Clone)]
struct TableState {
    table: Table,
    /// Unit vector into the table, and along it.
    down: [f64; 2],
    along: [f64; 2],
    half_base_mm: f64,
    /// Centre of mass and turn where its springs are slack, in the room.
    level_mm: f64,
    anchor_mm: f64,
    anchor_rad: f64,
    /// Its force at the end of the last step.
    force_n: f64,
}

/// What acts during a step.
#[derive(Debug, Clone)]
pub(crate) struct Actions {
    pub(crate) step_s: f64,
    /// Force per mass on the centre of mass: gravity less the arm's acceleration, mm/s².
    pub(crate) field_mm_per_s2: [f64; 2],
    /// Forces with their points on the object, and the moment.
    pub(crate) forces: Vec<([f64; 2], [f64; 2])>,
    pub(crate) torsional_moment_nmm: f64,
    /// Where the gripper is in the room at the step's end.
    pub(crate) gripper_mm: [f64; 2],
}

fn turned([x, y]: [f64; 2], turn: f64) -> [f64; 2] {
    let (sin, cos) = libm::sincos(turn);
    [cos * x - sin * y, sin * x + cos * y]
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Slope of a spring that gives way at `cap`, and its stiffness there.
fn capped(stretch: f64, stiffness: f64, cap: f64) -> [f64; 2] {
    let force = stiffness * stretch;
    if force.abs() <= cap {
        [force, stiffness]
    } else {
        [cap * force.signum(), 0.0]
    }
}

impl RigidBody {
    /// At rest with its grip point at `pose`; `down` is where the table lies.
    pub(crate) fn new(object: &Object, pose: Triple, table: Option<Table>, down: [f64; 2]) -> Self {
        let mass = object.mass_g * 1e-6;
        let mut body = Self {
            mass,
            inertia: object.inertia_g_mm2 * 1e-6,
            centre_mm: object.centre_of_mass_mm,
            pose,
            speed: [0.0; 3],
            table: None,
        };
        body.table = table.map(|table| {
            let along = [-down[1], down[0]];
            let centre = body.centre(pose);
            let force_n = object.weight_n();
            TableState {
                table,
                down,
                along,
                half_base_mm: 0.5 * object.size_mm[0],
                level_mm: dot(centre, down) - force_n / table.stiffness_n_per_mm,
                anchor_mm: dot(centre, along),
                anchor_rad: pose[2],
                force_n,
            }
        });
        body
    }

    fn arm(&self, pose: Triple) -> [f64; 2] {
        turned(self.centre_mm, pose[2])
    }

    /// Centre of mass at `pose`.
    fn centre(&self, pose: Triple) -> [f64; 2] {
        let arm = self.arm(pose);
        [pose[0] + arm[0], pose[1] + arm[1]]
    }

    /// Velocity of the grip point, and spin.
    pub(crate) fn grip_point_speed(&self) -> Triple {
        let arm = self.arm(self.pose);
        let [vx, vy, spin] = self.speed;
        [vx + spin * arm[1], vy - spin * arm[0], spin]
    }

    /// Its mass and moment of inertia are `share` of the object's.
    pub(crate) fn set_mass(&mut self, object: &Object, share: f64) {
        self.mass = object.mass_g * 1e-6 * share;
        self.inertia = object.inertia_g_mm2 * 1e-6 * share;
    }

    /// Whether the table carries any of it.
    pub(crate) fn on_table(&self) -> bool {
        self.table.as_ref().is_some_and(|table| table.force_n > 0.0)
    }

    /// Unbalanced force and moment about the grip point at `pose` (mass times acceleration less loads), and how
    /// they grow with the pose.
    pub(crate) fn resistance(&self, actions: &Actions, pose: Triple) -> (Triple, Matrix) {
        let inverse = 1.0 / (actions.step_s * actions.step_s);
        let (before, now) = (self.centre(self.pose), self.centre(pose));
        let mass = self.mass * inverse;
        let mut on_centre = [0, 1].map(|k| {
            mass * (now[k] - before[k] - actions.step_s * self.speed[k])
                - self.mass * actions.field_mm_per_s2[k]
        });
        let mut stiff = [[mass, 0.0], [0.0, mass]];
        let turn = pose[2] - self.pose[2] - actions.step_s * self.speed[2];
        let mut moment = self.inertia * inverse * turn - actions.torsional_moment_nmm;
        let mut stiff_turn = self.inertia * inverse;
        if let Some(table) = &self.table {
            let [push, slide, tilt] = table.reactions(now, pose[2], actions.gripper_mm);
            for k in 0..2 {
                on_centre[k] += push[0] * table.down[k] + slide[0] * table.along[k];
                for (l, row) in stiff[k].iter_mut().enumerate() {
                    *row +=
                        push[1] * table.down[k] * table.down[l] + slide[1] * table.along[k] * table.along[l];
                }
            }
            moment += tilt[0];
            stiff_turn += tilt[1];
        }
        let arm = self.arm(pose);
        let swing = [-arm[1], arm[0]];
        let mut force = on_centre;
        moment += dot(swing, on_centre);
        for (point, pull) in &actions.forces {
            let lever = turned(*point, pose[2]);
            force = [force[0] - pull[0], force[1] - pull[1]];
            moment -= lever[0] * pull[1] - lever[1] * pull[0];
        }
        let coupling = [0, 1].map(|k| dot(stiff[k], swing));
        // The pendulum's own stiffness, where it is one.
        let pendulum = (-dot(arm, on_centre)).max(0.0);
        let growth = [
            [stiff[0][0], stiff[0][1], coupling[0]],
            [stiff[1][0], stiff[1][1], coupling[1]],
            [
                coupling[0],
                coupling[1],
                stiff_turn + dot(coupling, swing) + pendulum,
            ],
        ];
        ([force[0], force[1], moment], growth)
    }

    /// All but inertia that acts at `pose`, about the grip point.
    pub(crate) fn load(&self, actions: &Actions, pose: Triple) -> Triple {
        let mut at_rest = self.clone();
        at_rest.mass = 0.0;
        at_rest.inertia = 0.0;
        let (unbalanced, _) = at_rest.resistance(actions, pose);
        let arm = self.arm(pose);
        let field = actions.field_mm_per_s2.map(|a| self.mass * a);
        [
            field[0] - unbalanced[0],
            field[1] - unbalanced[1],
            arm[0] * field[1] - arm[1] * field[0] - unbalanced[2],
        ]
    }

    /// Goes to `pose` in a step.
    pub(crate) fn go(&mut self, actions: &Actions, pose: Triple) {
        let (before, now) = (self.centre(self.pose), self.centre(pose));
        self.speed = [
            (now[0] - before[0]) / actions.step_s,
            (now[1] - before[1]) / actions.step_s,
            (pose[2] - self.pose[2]) / actions.step_s,
        ];
        self.pose = pose;
        if let Some(table) = &mut self.table {
            table.follow(now, pose[2], actions.gripper_mm);
        }
    }

    /// Stays where it is, in the gripper's frame, without speed.
    pub(crate) fn stay(&mut self) {
        self.speed = [0.0; 3];
    }
}

impl TableState {
    /// Force and stiffness against pressing into the table, sliding along it, and turning on it.
    fn reactions(&self, centre: [f64; 2], turn: f64, gripper_mm: [f64; 2]) -> [[f64; 2]; 3] {
        let room = [centre[0] + gripper_mm[0], centre[1] + gripper_mm[1]];
        let stiffness = self.table.stiffness_n_per_mm;
        let depth = dot(room, self.down) - self.level_mm;
        let push = if depth > 0.0 {
            [stiffness * depth, stiffness]
        } else {
            [0.0; 2]
        };
        // Friction and footing as the last step's force allows them: so the step stays convex.
        let base = self.half_base_mm;
        [
            push,
            capped(
                dot(room, self.along) - self.anchor_mm,
                stiffness,
                self.table.friction * self.force_n,
            ),
            capped(
                turn - self.anchor_rad,
                stiffness * base * base,
                self.force_n * base,
            ),
        ]
    }

    /// Where the springs gave way their ends follow.
    fn follow(&mut self, centre: [f64; 2], turn: f64, gripper_mm: [f64; 2]) {
        let [push, slide, tilt] = self.reactions(centre, turn, gripper_mm);
        let room = [centre[0] + gripper_mm[0], centre[1] + gripper_mm[1]];
        let stiffness = self.table.stiffness_n_per_mm;
        self.anchor_mm = dot(room, self.along) - slide[0] / stiffness;
        self.anchor_rad = turn - tilt[0] / (stiffness * self.half_base_mm * self.half_base_mm);
        self.force_n = push[0];
    }
}

#[cfg(test)]
mod tests {
    use super::super::object::OBJECTS;
    use super::*;

    fn actions(step_s: f64) -> Actions {
        Actions {
            step_s,
            field_mm_per_s2: [0.0, -9_806.65],
            forces: vec![([3.0, 1.0], [0.2, -0.1])],
            torsional_moment_nmm: 1.5,
            gripper_mm: [0.0; 2],
        }
    }

    #[test]
    fn resistance_grows_as_its_matrix_says_and_rests_on_the_table() {
        for table in [None, Some(Table::default())] {
            let body = RigidBody::new(&OBJECTS[2], [1.0, 2.0, 0.3], table, [0.0, -1.0]);
            let actions = actions(0.01);
            let pose = [1.01, 1.98, 0.301];
            let (_, growth) = body.resistance(&actions, pose);
            for k in 0..3 {
                let mut moved = [pose; 2];
                moved[0][k] -= 1e-6;
                moved[1][k] += 1e-6;
                let [low, high] = moved.map(|pose| body.resistance(&actions, pose).0);
                for i in 0..3 {
                    let slope = (high[i] - low[i]) / 2e-6;
                    // Levers' changes are left out of the matrix.
                    let scale = (growth[i][i] * growth[k][k]).sqrt();
                    assert!(
                        (slope - growth[i][k]).abs() < 0.02 * scale,
                        "{i} {k}: {slope} {growth:?}"
                    );
                }
            }
        }
        let body = RigidBody::new(&OBJECTS[2], [1.0, 2.0, 0.3], Some(Table::default()), [0.0, -1.0]);
        let still = Actions {
            forces: Vec::new(),
            torsional_moment_nmm: 0.0,
            ..actions(0.01)
        };
        let (unbalanced, _) = body.resistance(&still, body.pose);
        assert!(unbalanced.iter().all(|v| v.abs() < 1e-9), "{unbalanced:?}");
        assert!(body.load(&still, body.pose).iter().all(|v| v.abs() < 1e-9));
    }
}
