//! A rigid sphere pressed, pulled and twisted on the skin, step by step: Hertz for the normal load, springs
//! with friction (see `springs`) for pull and twist, tractions and taxel sums from both. Units: mm, N, MPa,
//! N·mm, rad. Limits: half-space contact on a layer's field; pressure and shear uncoupled; under pull AND
//! twist the tractions keep the friction bound everywhere but may carry less than the loads (see
//! `ContactState::traction_mpa`).

use std::f64::consts::{PI, TAU};

use crate::closed_form::Hertz;
use crate::constants::{SCENE_FRICTION, SCENE_SPHERE_RADIUS_MM, TAXEL_COUNT, TAXEL_PITCH_MM, TAXELS};
use crate::error::{SimulationError, finite, not_negative, positive};
use crate::gel::Gel;
use crate::springs::{Springs, Stiffness, Triple};

/// Newtons per taxel that the object exerts on the skin, (x, y, z), z into the skin; index = row * 20 +
/// column.
pub type ForceMap = [[f32; 3]; TAXEL_COUNT];

/// Loads under this count as no contact, N.
const TOUCH_N: f64 = 1e-6;
/// A demand this close to the limit surface slides: the circle that would stick is under 3 % of the radius.
const GROSS_SHARE: f64 = 1.0 - 1e-5;
/// Radii at which the tractions are tabulated.
const RADII: usize = 128;
/// Contact radii per sub-cell, at least, when tractions are summed over cells.
const SUBCELLS_PER_RADIUS: f64 = 32.0;

/// A sphere and the skin under it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereParams {
    /// Radius of the sphere, mm.
    pub radius_mm: f64,
    /// True Coulomb friction between sphere and skin.
    pub friction: f64,
    /// Where the sphere touches, mm from the centre of the surface.
    pub centre_mm: [f64; 2],
    /// The skin.
    pub gel: Gel,
}

impl Default for SphereParams {
    fn default() -> Self {
        Self {
            radius_mm: SCENE_SPHERE_RADIUS_MM,
            friction: SCENE_FRICTION,
            centre_mm: [0.0; 2],
            gel: Gel::default(),
        }
    }
}

/// What presses the sphere on the skin.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    /// Normal force into the skin, N, 0 or above.
    pub normal_n: f64,
    /// Tangential force on the skin, N.
    pub shear_n: [f64; 2],
    /// Moment on the skin about z through the contact's centre, M = Σ(x f_y − y f_x), N·mm.
    pub torsion_nmm: f64,
}

/// A sphere in quasi-static contact with the skin, with its load history.
#[derive(Debug, Clone)]
pub struct SphereContact {
    params: SphereParams,
    springs: Springs,
    state: ContactState,
}

/// What the contact does at one instant.
#[derive(Debug, Clone)]
pub struct ContactState {
    demand: Load,
    load: Load,
    radius_mm: f64,
    peak_pressure_mpa: f64,
    friction: f64,
    centre_mm: [f64; 2],
    stick_ratio: f64,
    gross_slip: bool,
    displacement_mm: [f64; 2],
    rotation_rad: f64,
    slip_distance_mm: f64,
    /// Pull x, pull y and twist as shares of the pressure, at the middles of `RADII` equal steps of depth
    /// under the pressure's dome, 1 − √(1 − r²/a²): dense at the rim, where slip begins.
    profile: Vec<Triple>,
}

impl SphereContact {
    /// A sphere that does not touch yet.
    ///
    /// # Errors
    /// A radius, friction or gel constant outside its range.
    pub fn new(params: SphereParams) -> Result<Self, SimulationError> {
        params.gel.check()?;
        positive("sphere radius_mm", params.radius_mm)?;
        positive("friction", params.friction)?;
        finite("centre_mm[0]", params.centre_mm[0])?;
        finite("centre_mm[1]", params.centre_mm[1])?;
        let springs = Springs::new(Stiffness {
            pull_mpa: params.gel.tangential_modulus_mpa(),
            twist_mpa: 4.0 / PI * params.gel.shear_modulus_mpa(),
            friction: params.friction,
        });
        let state = ContactState {
            demand: Load::default(),
            load: Load::default(),
            radius_mm: 0.0,
            peak_pressure_mpa: 0.0,
            friction: params.friction,
            centre_mm: params.centre_mm,
            stick_ratio: 1.0,
            gross_slip: false,
            displacement_mm: [0.0; 2],
            rotation_rad: 0.0,
            slip_distance_mm: 0.0,
            profile: Vec::with_capacity(RADII),
        };
        Ok(Self {
            params,
            springs,
            state,
        })
    }

    /// One quasi-static step to `load`, all loads changing together; to press first and pull then, take two
    /// steps. What lies outside the limit surface (Q/μP)² + (M/M_max)² = 1 is cut back to it along the same
    /// direction: gross slip. Statics cannot tell how far the sphere then slides: see [`Self::slide`].
    ///
    /// # Errors
    /// A normal force below 0, a load that is not finite, or a step that does not converge.
    pub fn step(&mut self, load: Load) -> Result<&ContactState, SimulationError> {
        not_negative("normal_n", load.normal_n)?;
        finite("shear_n[0]", load.shear_n[0])?;
        finite("shear_n[1]", load.shear_n[1])?;
        finite("torsion_nmm", load.torsion_nmm)?;
        if load.normal_n < TOUCH_N {
            self.lift_off(load);
            return Ok(&self.state);
        }
        let hertz = Hertz::of(
            load.normal_n,
            self.params.radius_mm,
            self.params.gel.contact_modulus_mpa(),
        );
        let a = hertz.radius_mm();
        let pull_limit = self.params.friction * load.normal_n;
        let limit = [pull_limit, 3.0 * PI / 16.0 * pull_limit * a];
        let share = [
            load.shear_n[0] / limit[0],
            load.shear_n[1] / limit[0],
            load.torsion_nmm / limit[1],
        ];
        let used = share.iter().map(|v| v * v).sum::<f64>().sqrt();

        let mut springs = self.springs.clone();
        springs.press(&hertz);
        let gross_slip = used >= GROSS_SHARE;
        let carried = if gross_slip {
            let unit = share.map(|v| v / used);
            springs.slide(unit);
            Load {
                normal_n: load.normal_n,
                shear_n: [unit[0] * limit[0], unit[1] * limit[0]],
                torsion_nmm: unit[2] * limit[1],
            }
        } else {
            let motion =
                springs.pull_and_twist([load.shear_n[0], load.shear_n[1], load.torsion_nmm], limit)?;
            self.state.displacement_mm[0] += motion[0];
            self.state.displacement_mm[1] += motion[1];
            self.state.rotation_rad += motion[2];
            load
        };
        self.springs = springs;
        self.state.demand = load;
        self.state.load = carried;
        self.state.radius_mm = a;
        self.state.peak_pressure_mpa = hertz.peak_pressure_mpa();
        self.state.gross_slip = gross_slip;
        self.state.stick_ratio = if gross_slip {
            0.0
        } else {
            self.springs.stick_ratio()
        };
        self.tabulate();
        Ok(&self.state)
    }

    /// Moves the sphere over the skin by `by_mm`, as gross slip does. The tractions move along.
    ///
    /// # Errors
    /// A shift that is not finite.
    pub fn slide(&mut self, by_mm: [f64; 2]) -> Result<(), SimulationError> {
        finite("by_mm[0]", by_mm[0])?;
        finite("by_mm[1]", by_mm[1])?;
        for (k, by) in by_mm.into_iter().enumerate() {
            self.state.centre_mm[k] += by;
            self.state.displacement_mm[k] += by;
        }
        self.state.slip_distance_mm += libm::hypot(by_mm[0], by_mm[1]);
        Ok(())
    }

    /// The state after the last step.
    #[must_use]
    pub fn state(&self) -> &ContactState {
        &self.state
    }

    fn lift_off(&mut self, demand: Load) {
        self.springs.release();
        self.state.demand = demand;
        self.state.load = Load::default();
        self.state.radius_mm = 0.0;
        self.state.peak_pressure_mpa = 0.0;
        self.state.gross_slip = false;
        self.state.stick_ratio = 1.0;
        self.state.displacement_mm = [0.0; 2];
        self.state.rotation_rad = 0.0;
        self.state.slip_distance_mm = 0.0;
        self.state.profile.clear();
    }

    fn tabulate(&mut self) {
        let domes: [f64; RADII] = std::array::from_fn(|k| 1.0 - (k as f64 + 0.5) / RADII as f64);
        let area = self.state.radius_mm * self.state.radius_mm;
        let squares = domes.map(|dome| area * (1.0 - dome * dome));
        self.springs.tractions_mpa(&squares, &mut self.state.profile);
        for (traction, dome) in self.state.profile.iter_mut().zip(domes) {
            *traction = traction.map(|q| q / (self.state.peak_pressure_mpa * dome));
        }
        self.state.balance();
    }
}

impl ContactState {
    /// Whether the sphere touches.
    #[must_use]
    pub fn in_contact(&self) -> bool {
        self.radius_mm > 0.0
    }

    /// The load that was asked for.
    #[must_use]
    pub fn demand(&self) -> Load {
        self.demand
    }

    /// The load that the contact holds: the demand, cut at the limit surface.
    #[must_use]
    pub fn load(&self) -> Load {
        self.load
    }

    /// Contact radius a, mm; 0 when nothing touches.
    #[must_use]
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Peak pressure p0, MPa.
    #[must_use]
    pub fn peak_pressure_mpa(&self) -> f64 {
        self.peak_pressure_mpa
    }

    /// True friction of the contact.
    #[must_use]
    pub fn friction(&self) -> f64 {
        self.friction
    }

    /// Centre of the contact, mm.
    #[must_use]
    pub fn centre_mm(&self) -> [f64; 2] {
        self.centre_mm
    }

    /// Share of the contact area that sticks, 0 to 1; 0 in gross slip, 1 when nothing touches.
    #[must_use]
    pub fn true_stick_ratio(&self) -> f64 {
        self.stick_ratio
    }

    /// Whether the whole contact slides.
    #[must_use]
    pub fn gross_slip(&self) -> bool {
        self.gross_slip
    }

    /// Shift of the sphere since it touched, mm: elastic, and what [`SphereContact::slide`] added.
    #[must_use]
    pub fn displacement_mm(&self) -> [f64; 2] {
        self.displacement_mm
    }

    /// Elastic twist of the sphere since it touched, rad.
    #[must_use]
    pub fn rotation_rad(&self) -> f64 {
        self.rotation_rad
    }

    /// Way slid over the skin since the sphere touched, mm.
    #[must_use]
    pub fn slip_distance_mm(&self) -> f64 {
        self.slip_distance_mm
    }

    /// Tractions on the skin (x, y, pressure) at a point of the surface, MPa.
    ///
    /// Pull and twist alone are the springs' superposition. Together they add as vectors where the skin
    /// sticks; where it slips, the vector's direction is kept and its size is μp, and both are enlarged
    /// until the sum over the contact carries the loads. |q| ≤ μp holds everywhere; beyond 0.9 of the limit
    /// surface, with pull and twist alike, the enlargement runs out: 5 % of both are missing at 0.99 of it,
    /// a tenth in gross slip.
    #[must_use]
    pub fn traction_mpa(&self, at_mm: [f64; 2]) -> [f64; 3] {
        let [x, y] = [at_mm[0] - self.centre_mm[0], at_mm[1] - self.centre_mm[1]];
        let square = x * x + y * y;
        let area = self.radius_mm * self.radius_mm;
        if square >= area {
            return [0.0; 3];
        }
        let dome = (1.0 - square / area).sqrt();
        let pressure = self.peak_pressure_mpa * dome;
        let place = ((1.0 - dome) * RADII as f64 - 0.5).clamp(0.0, (RADII - 1) as f64);
        let ring = (place as usize).min(RADII - 2);
        let part = place - ring as f64;
        let [low, high] = [self.profile[ring], self.profile[ring + 1]];
        let share: Triple = std::array::from_fn(|k| low[k] + part * (high[k] - low[k]));
        let r = square.sqrt().max(1e-9);
        let [qx, qy] = self.combined(share, [x / r, y / r]);
        [qx * pressure, qy * pressure, pressure]
    }

    /// Traction over pressure where `share` is (pull x, pull y, twist) over pressure and `outward` points
    /// from the centre.
    fn combined(&self, share: Triple, outward: [f64; 2]) -> [f64; 2] {
        let [pull_x, pull_y, twist] = share;
        let q = [pull_x - twist * outward[1], pull_y + twist * outward[0]];
        let sum = (q[0] * q[0] + q[1] * q[1]).sqrt();
        if sum == 0.0 {
            return q;
        }
        let size = (pull_x * pull_x + pull_y * pull_y + twist * twist)
            .sqrt()
            .min(self.friction);
        let slipped = (size / self.friction).powi(4);
        let scale = (slipped * size + (1.0 - slipped) * sum.min(self.friction)) / sum;
        [q[0] * scale, q[1] * scale]
    }

    /// Enlarges pull and twist in the profile until the tractions carry the loads, as far as friction lets
    /// them.
    fn balance(&mut self) {
        const ROUNDS: usize = 20;
        const ANGLES: usize = 12;
        const STRIDE: usize = 2;
        const LARGEST: f64 = 4.0;
        let pull_n = libm::hypot(self.load.shear_n[0], self.load.shear_n[1]);
        let force_unit = self.friction * self.load.normal_n;
        let moment_unit = force_unit * self.radius_mm;
        // Either one alone is in balance already.
        if pull_n < 1e-3 * force_unit || self.load.torsion_nmm.abs() < 1e-3 * moment_unit {
            return;
        }
        let along = self.load.shear_n.map(|q| q / pull_n);
        let outward: [[f64; 2]; ANGLES] = std::array::from_fn(|k| {
            let (sin, cos) = libm::sincos((k as f64 + 0.5) / ANGLES as f64 * TAU);
            [cos, sin]
        });
        let mut factor = [1.0; 2];
        for _ in 0..ROUNDS {
            let (mut force, mut moment) = (0.0, 0.0);
            for (k, share) in self.profile.iter().enumerate().skip(STRIDE / 2).step_by(STRIDE) {
                let dome = 1.0 - (k as f64 + 0.5) / RADII as f64;
                let r = self.radius_mm * (1.0 - dome * dome).sqrt();
                let share = [factor[0] * share[0], factor[0] * share[1], factor[1] * share[2]];
                // p dA = p0 dome · 2π a² dome d(dome).
                let ring = dome * dome;
                for direction in outward {
                    let q = self.combined(share, direction);
                    force += ring * (q[0] * along[0] + q[1] * along[1]);
                    moment += ring * r * (q[1] * direction[0] - q[0] * direction[1]);
                }
            }
            let area = TAU * self.radius_mm * self.radius_mm * self.peak_pressure_mpa;
            let unit = area / (RADII / STRIDE * ANGLES) as f64;
            let missing = [pull_n / (force * unit), self.load.torsion_nmm / (moment * unit)];
            if missing.iter().all(|m| (m - 1.0).abs() < 1e-3) {
                break;
            }
            for k in 0..2 {
                if missing[k].is_finite() && missing[k] > 0.0 {
                    factor[k] = (factor[k] * missing[k].clamp(0.5, 2.0).sqrt()).clamp(0.5, LARGEST);
                }
            }
        }
        for share in &mut self.profile {
            *share = [factor[0] * share[0], factor[0] * share[1], factor[1] * share[2]];
        }
    }

    /// Taxel sums of the tractions, N. What lies outside the 32 mm square is not in it.
    #[must_use]
    pub fn force_map(&self) -> ForceMap {
        let mut map = [[0.0; 3]; TAXEL_COUNT];
        self.add_cell_forces(TAXEL_PITCH_MM, TAXELS, &mut map);
        map
    }

    /// Adds the tractions' sums over a centred grid of `cells` x `cells` squares of side `pitch_mm` to
    /// `out`, N.
    pub(crate) fn add_cell_forces(&self, pitch_mm: f64, cells: usize, out: &mut [[f32; 3]]) {
        if !self.in_contact() {
            return;
        }
        let corner = -0.5 * cells as f64 * pitch_mm;
        let range = |centre: f64| {
            let cell = |at: f64| ((at - corner) / pitch_mm).floor().clamp(0.0, cells as f64);
            let first = cell(centre - self.radius_mm) as usize;
            let last = (cell(centre + self.radius_mm) as usize + 1).min(cells);
            first..last
        };
        let parts = (pitch_mm * SUBCELLS_PER_RADIUS / self.radius_mm)
            .ceil()
            .clamp(2.0, 64.0);
        let side = pitch_mm / parts;
        for row in range(self.centre_mm[1]) {
            for column in range(self.centre_mm[0]) {
                let mut sum = [0.0; 3];
                for j in 0..parts as usize {
                    let y = corner + row as f64 * pitch_mm + (j as f64 + 0.5) * side;
                    for i in 0..parts as usize {
                        let x = corner + column as f64 * pitch_mm + (i as f64 + 0.5) * side;
                        let traction = self.traction_mpa([x, y]);
                        for k in 0..3 {
                            sum[k] += traction[k];
                        }
                    }
                }
                for k in 0..3 {
                    out[row * cells + column][k] += (sum[k] * side * side) as f32;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_form::{CattaneoMindlin, Torsion};

    fn contact() -> SphereContact {
        SphereContact::new(SphereParams::default()).unwrap()
    }

    fn load(normal_n: f64, pull: f64, torsion_nmm: f64) -> Load {
        Load {
            normal_n,
            shear_n: [pull, 0.0],
            torsion_nmm,
        }
    }

    fn closed(normal_n: f64) -> (Hertz, CattaneoMindlin, Torsion) {
        let gel = Gel::default();
        let hertz = Hertz::new(normal_n, SCENE_SPHERE_RADIUS_MM, &gel).unwrap();
        (
            hertz,
            CattaneoMindlin::new(hertz, SCENE_FRICTION, &gel).unwrap(),
            Torsion::new(hertz, SCENE_FRICTION, &gel).unwrap(),
        )
    }

    /// Net force and moment about the contact's centre of a force map.
    fn totals(state: &ContactState) -> [f64; 4] {
        // Taxel forces act at unknown points of a taxel: the moment needs fine cells.
        let (pitch, cells) = (0.1, 320);
        let mut fine = vec![[0.0; 3]; cells * cells];
        state.add_cell_forces(pitch, cells, &mut fine);
        let mut sum = [0.0; 4];
        for (i, f) in fine.iter().enumerate() {
            let x = (i % cells) as f64 * pitch - 15.95 - state.centre_mm()[0];
            let y = (i / cells) as f64 * pitch - 15.95 - state.centre_mm()[1];
            let [fx, fy, fz] = f.map(f64::from);
            sum[0] += fx;
            sum[1] += fy;
            sum[2] += fz;
            sum[3] += x * fy - y * fx;
        }
        sum
    }

    #[test]
    fn taxel_sums_carry_normal_and_pull_within_half_a_percent() {
        for (radius_mm, normal_n, centre_mm) in [
            (4.0, 0.1, [0.13, -0.4]),
            (12.0, 2.5, [3.1, 5.9]),
            (25.0, 15.0, [-0.7, 0.2]),
            (8.0, 1.0, [0.0, 0.0]),
        ] {
            let mut contact = SphereContact::new(SphereParams {
                radius_mm,
                centre_mm,
                ..SphereParams::default()
            })
            .unwrap();
            for share in [0.1, 0.6, 0.97, 1.5] {
                let pull = share * SCENE_FRICTION * normal_n;
                let state = contact
                    .step(Load {
                        normal_n,
                        shear_n: [0.6 * pull, -0.8 * pull],
                        torsion_nmm: 0.0,
                    })
                    .unwrap();
                let mut sum = [0.0; 3];
                for taxel in state.force_map() {
                    for k in 0..3 {
                        sum[k] += f64::from(taxel[k]);
                    }
                }
                let held = share.min(1.0) * SCENE_FRICTION * normal_n;
                assert!((sum[2] / normal_n - 1.0).abs() < 0.005, "{sum:?}");
                assert!((sum[0] - 0.6 * held).abs() < 0.005 * held, "{sum:?} for {share}");
                assert!((sum[1] + 0.8 * held).abs() < 0.005 * held, "{sum:?} for {share}");
            }
        }
    }

    #[test]
    fn a_growing_pull_gives_cattaneo_mindlin() {
        let (hertz, closed, _) = closed(3.0);
        let mut contact = contact();
        contact.step(load(3.0, 0.0, 0.0)).unwrap();
        for i in 1..=99 {
            let pull = f64::from(i) / 100.0 * closed.limit_n();
            let state = contact.step(load(3.0, pull, 0.0)).unwrap();
            assert!((state.true_stick_ratio() - closed.stick_ratio(pull).unwrap()).abs() < 0.006);
            let shift = closed.displacement_mm(pull).unwrap();
            assert!((state.displacement_mm()[0] / shift - 1.0).abs() < 2e-3);
            for r in [0.0, 0.3, 0.7, 0.95] {
                let at = r * hertz.radius_mm();
                let exact = closed.traction_mpa(pull, at).unwrap();
                let found = state.traction_mpa([0.0, at]);
                let bound = SCENE_FRICTION * hertz.pressure_mpa(at);
                assert!(
                    (found[0] - exact).abs() < 0.02 * bound,
                    "{i} {r}: {found:?} {exact}"
                );
                assert!(found[1].abs() < 1e-9);
            }
        }
    }

    #[test]
    fn unloading_and_reversal_give_mindlin_deresiewicz_and_the_loop_closes() {
        let (hertz, closed, _) = closed(3.0);
        let peak = 0.8 * closed.limit_n();
        let mut contact = contact();
        contact.step(load(3.0, 0.0, 0.0)).unwrap();
        contact.step(load(3.0, peak, 0.0)).unwrap();
        let start = contact.state().displacement_mm()[0];
        let steps = 400;
        let mut lost = 0.0;
        let mut last = start;
        for i in 1..=2 * steps {
            let way = f64::from(i) / f64::from(steps);
            let pull = if i <= steps {
                peak * (1.0 - 2.0 * way)
            } else {
                peak * (2.0 * way - 3.0)
            };
            let state = contact.step(load(3.0, pull, 0.0)).unwrap();
            let shift = state.displacement_mm()[0];
            let middle = pull + if i <= steps { peak } else { -peak } / f64::from(steps);
            lost += middle * (shift - last);
            last = shift;
            if i <= steps && i % 50 == 0 {
                let exact = closed.unloading_displacement_mm(peak, pull).unwrap();
                assert!((shift - exact).abs() < 2e-3 * start, "{shift} {exact}");
                for r in [0.1, 0.5, 0.9] {
                    let at = r * hertz.radius_mm();
                    let exact = closed.unloading_traction_mpa(peak, pull, at).unwrap();
                    let bound = SCENE_FRICTION * hertz.pressure_mpa(at);
                    assert!((state.traction_mpa([at, 0.0])[0] - exact).abs() < 0.02 * bound);
                }
                assert!((totals(state)[0] - pull).abs() < 0.005 * closed.limit_n());
            }
        }
        assert!(
            (last - start).abs() < 1e-4 * start,
            "the loop is open by {}",
            last - start
        );
        let exact = closed.cycle_loss_nmm(peak).unwrap();
        assert!((lost / exact - 1.0).abs() < 5e-3, "{lost} against {exact}");
    }

    #[test]
    fn a_growing_twist_gives_lubkins_relation_and_carries_its_moment() {
        let (hertz, _, closed) = closed(3.0);
        let mut contact = contact();
        contact.step(load(3.0, 0.0, 0.0)).unwrap();
        let mut last = 1.0;
        for i in 1..=19 {
            let moment = f64::from(i) / 20.0 * closed.limit_nmm();
            let state = contact.step(load(3.0, 0.0, moment)).unwrap();
            let c = closed.stick_radius_mm(moment).unwrap();
            let stick = (c / hertz.radius_mm()).powi(2);
            assert!(
                (state.true_stick_ratio() - stick).abs() < 0.008,
                "{} {stick}",
                state.true_stick_ratio()
            );
            assert!(state.true_stick_ratio() < last);
            last = state.true_stick_ratio();
            assert!((state.rotation_rad() / closed.rotation_rad(c) - 1.0).abs() < 0.01);
            let sum = totals(state);
            assert!(
                (sum[3] - moment).abs() < 0.005 * closed.limit_nmm(),
                "{sum:?} {moment}"
            );
            assert!(sum[0].abs() + sum[1].abs() < 1e-6);
        }
        let state = contact.step(load(3.0, 0.0, 1.2 * closed.limit_nmm())).unwrap();
        assert!(state.gross_slip() && state.true_stick_ratio() == 0.0);
        assert!((totals(state)[3] / closed.limit_nmm() - 1.0).abs() < 0.005);
    }

    #[test]
    fn pull_and_twist_together_slide_on_the_limit_surface_and_nearly_carry_their_loads() {
        let (_, pull, twist) = closed(3.0);
        for angle in [0.2_f64, 0.5, 0.785, 1.1, 1.4] {
            let mut contact = contact();
            contact.step(load(3.0, 0.0, 0.0)).unwrap();
            for (share, missing) in [
                (0.3, 0.015),
                (0.6, 0.015),
                (0.9, 0.02),
                (0.99, 0.06),
                (1.01, 0.12),
            ] {
                let demand = [
                    share * angle.cos() * pull.limit_n(),
                    share * angle.sin() * twist.limit_nmm(),
                ];
                let state = contact.step(load(3.0, demand[0], demand[1])).unwrap();
                assert_eq!(state.gross_slip(), share > 1.0);
                let held = [state.load().shear_n[0], state.load().torsion_nmm];
                let cut = share.min(1.0) / share;
                assert!((0..2).all(|k| (held[k] / (cut * demand[k]) - 1.0).abs() < 1e-9));
                let sum = totals(state);
                let off = [sum[0] / held[0] - 1.0, sum[3] / held[1] - 1.0];
                assert!(
                    off.iter().all(|v| v.abs() < missing),
                    "{off:?} at {angle} rad, {share} of the limit"
                );
            }
        }
    }

    #[test]
    fn tractions_never_leave_the_friction_cone_over_random_histories() {
        let mut random = crate::random::Random::new(7, 0);
        let mut contact = SphereContact::new(SphereParams {
            radius_mm: 9.0,
            ..SphereParams::default()
        })
        .unwrap();
        for _ in 0..3000 {
            let normal_n = random.log_uniform(1e-5, 20.0);
            let limit = SCENE_FRICTION * normal_n;
            let turn = random.uniform(0.0, TAU);
            let pull = random.uniform(0.0, 1.1) * limit;
            let state = contact
                .step(Load {
                    normal_n,
                    shear_n: [pull * turn.cos(), pull * turn.sin()],
                    torsion_nmm: random.uniform(-1.0, 1.0) * limit * 2.0 * normal_n.cbrt(),
                })
                .unwrap();
            assert!((0.0..=1.0).contains(&state.true_stick_ratio()));
            for _ in 0..20 {
                let at = [random.uniform(-6.0, 6.0), random.uniform(-6.0, 6.0)];
                let [qx, qy, p] = state.traction_mpa(at);
                assert!(p >= 0.0 && qx.hypot(qy) <= SCENE_FRICTION * p * (1.0 + 1e-9));
            }
        }
    }

    #[test]
    fn grip_and_pull_that_grow_in_proportion_never_slip_and_shear_in_proportion_to_pressure() {
        // Exact for any Hertz contact (Mindlin and Deresiewicz): q(r) = (Q/P) p(r) while Q/P < μ.
        let mut contact = contact();
        for i in 1..=30 {
            let normal_n = 0.1 * f64::from(i);
            let state = contact.step(load(normal_n, 0.5 * normal_n, 0.0)).unwrap();
            if i % 10 == 0 {
                assert!(state.true_stick_ratio() > 0.99, "{}", state.true_stick_ratio());
                for r in [0.0, 0.3, 0.6, 0.85] {
                    let [q, _, p] = state.traction_mpa([r * state.radius_mm(), 0.0]);
                    assert!((q / p - 0.5).abs() < 0.002, "{} at {r} a", q / p);
                }
            }
        }
    }

    #[test]
    fn more_grip_under_the_same_pull_sticks_again() {
        let mut contact = contact();
        contact.step(load(2.0, 0.0, 0.0)).unwrap();
        let before = contact.step(load(2.0, 1.1, 0.0)).unwrap().true_stick_ratio();
        let after = contact.step(load(2.5, 1.1, 0.0)).unwrap().true_stick_ratio();
        assert!(before < 0.4 && after > 0.95, "{before} {after}");
    }

    #[test]
    fn sliding_moves_the_contact_and_lifting_off_forgets_everything() {
        let mut contact = contact();
        assert!(contact.step(load(2.0, 5.0, 0.0)).unwrap().gross_slip());
        contact.slide([0.5, 0.0]).unwrap();
        assert!((contact.state().centre_mm()[0] - 0.5).abs() < 1e-12);
        assert!((contact.state().slip_distance_mm() - 0.5).abs() < 1e-12);
        let state = contact.step(load(0.0, 5.0, 0.0)).unwrap();
        assert!(!state.in_contact() && !state.gross_slip());
        assert!(state.force_map().iter().flatten().all(|&f| f == 0.0));
    }

    #[test]
    fn bad_parameters_and_loads_are_named() {
        let bad = |params: SphereParams| SphereContact::new(params).unwrap_err().to_string();
        let good = SphereParams::default();
        assert_eq!(
            bad(SphereParams {
                friction: 0.0,
                ..good
            }),
            "friction is 0, expected a finite number above 0"
        );
        assert!(
            bad(SphereParams {
                radius_mm: f64::NAN,
                ..good
            })
            .contains("radius_mm is NaN")
        );
        assert!(
            bad(SphereParams {
                centre_mm: [0.0, f64::INFINITY],
                ..good
            })
            .contains("centre_mm[1] is inf")
        );
        let error = contact().step(load(-1.0, 0.0, 0.0)).unwrap_err().to_string();
        assert_eq!(error, "normal_n is -1, expected a finite number, 0 or above");
        assert!(contact().step(load(1.0, f64::NAN, 0.0)).is_err());
        assert!(contact().slide([f64::NAN, 0.0]).is_err());
    }
}
