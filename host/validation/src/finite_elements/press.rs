//! A quarter of a rigid sphere pressed into the bonded rubber layer, sliding freely or stuck, and the stiffness
//! against dragging it once its contact is stuck. Contact at the surface nodes by augmented Lagrange multipliers. Units:
//! mm, N, MPa. z points into the gel. Limits: sphere over the middle, static.

use super::body::{Body, Load};
use super::error::{FiniteElementError, checked};
use super::mesh::Mesh;
use super::ogden::Ogden;
use super::sparse::Sparse;
use gripline_simulation::Gel;
use gripline_simulation::constants::{HALF_SURFACE_MM, TAXEL_COUNT, TAXEL_PITCH_MM, TAXELS};

/// Stiffness of the contact springs, MPa per mm and per MPa of Young's modulus: the surface's own is about one
/// over the size of an element (0.2 mm and up).
const SPRING_PER_YOUNG: f64 = 200.0;
/// Penetration that ends the multipliers' updates, share of the depth.
const PENETRATION: f64 = 1e-5;
/// Updates of the multipliers at most.
const UPDATES: usize = 8;
/// Depth of one load step, share of the thickness.
const STEP_SHARE: f64 = 0.05;
/// The same while the gel sticks (what touches late has moved before), and steps from touch to any depth at least.
const STUCK_STEP_SHARE: f64 = 0.02;
const STUCK_STEPS: f64 = 8.0;
/// A step of this share that does not settle ends the press.
const SMALLEST_STEP_SHARE: f64 = 1e-3;

/// What the gel does on the sphere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// It slides freely.
    Frictionless,
    /// What touches at the end of a load step stays where it touches.
    Stuck,
}

/// A surface node that sticks.
#[derive(Debug, Clone, Copy)]
struct Hold {
    /// Its place on the sphere, from the centre.
    place: [f64; 3],
    /// Its force before the spring adds to it, N.
    multiplier: [f64; 3],
}

/// A sphere against the surface nodes.
#[derive(Debug)]
struct Sphere {
    surface: Surface,
    radius_mm: f64,
    /// Depth of its lowest point under the gel at rest.
    depth_mm: f64,
    /// Spring of each surface node, N/mm.
    springs: Vec<f64>,
    /// Normal force of each sliding surface node before its spring adds to it, N.
    multipliers: Vec<f64>,
    holds: Vec<Option<Hold>>,
}

impl Sphere {
    /// From the centre to a node.
    fn arm(&self, place: &[f64; 3]) -> [f64; 3] {
        [place[0], place[1], place[2] + self.radius_mm - self.depth_mm]
    }

    /// Direction away from the centre, and distance outside the sphere, of a node.
    fn gap(&self, place: &[f64; 3]) -> ([f64; 3], f64) {
        let away = self.arm(place);
        let distance = away.iter().map(|x| x * x).sum::<f64>().sqrt();
        (away.map(|x| x / distance), distance - self.radius_mm)
    }

    /// Force of the sphere on a surface node, N; none if they do not touch.
    fn force(&self, node: usize, place: &[f64; 3]) -> Option<[f64; 3]> {
        let spring = self.springs[node];
        if let Some(hold) = &self.holds[node] {
            let away = self.arm(place);
            return Some([0, 1, 2].map(|k| hold.multiplier[k] - spring * (away[k] - hold.place[k])));
        }
        let (normal, gap) = self.gap(place);
        let force = self.multipliers[node] - spring * gap;
        (force > 0.0).then(|| normal.map(|n| force * n))
    }

    /// Distance between a touching node and where it should be, mm.
    fn miss_mm(&self, node: usize, place: &[f64; 3]) -> f64 {
        match &self.holds[node] {
            Some(hold) => {
                let away = self.arm(place);
                (0..3)
                    .map(|k| (away[k] - hold.place[k]).powi(2))
                    .sum::<f64>()
                    .sqrt()
            }
            None => self.gap(place).1.abs(),
        }
    }

    /// Surface nodes in contact and the forces on them.
    fn touching<'a>(&'a self, now: &'a [[f64; 3]]) -> impl Iterator<Item = (usize, [f64; 3])> + 'a {
        let surface = now.iter().take(self.springs.len()).enumerate();
        surface.filter_map(|(node, place)| self.force(node, place).map(|force| (node, force)))
    }

    /// Takes the springs' forces over into the multipliers.
    fn update(&mut self, now: &[[f64; 3]]) {
        for (node, place) in now.iter().enumerate().take(self.springs.len()) {
            let force = self.force(node, place);
            match (&mut self.holds[node], force) {
                (Some(hold), Some(force)) => hold.multiplier = force,
                (_, force) => self.multipliers[node] = force.map_or(0.0, |f| length(&f)),
            }
        }
    }

    /// Holds what touches.
    fn stick(&mut self, now: &[[f64; 3]]) {
        for (node, place) in now.iter().enumerate().take(self.springs.len()) {
            if let (None, Some(_)) = (&self.holds[node], self.force(node, place)) {
                let (normal, _) = self.gap(place);
                self.holds[node] = Some(Hold {
                    place: normal.map(|n| n * self.radius_mm),
                    multiplier: normal.map(|n| n * self.multipliers[node]),
                });
            }
        }
    }
}

fn length(v: &[f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

impl Load for Sphere {
    fn energy(&self, now: &[[f64; 3]]) -> f64 {
        (0..self.springs.len())
            .map(|node| {
                let force = self.force(node, &now[node]).map_or(0.0, |f| length(&f));
                let multiplier = match &self.holds[node] {
                    Some(hold) => length(&hold.multiplier),
                    None => self.multipliers[node],
                };
                (force * force - multiplier * multiplier) / (2.0 * self.springs[node])
            })
            .sum()
    }

    fn add(&self, now: &[[f64; 3]], forces: &mut [[f64; 3]], stiffness: &mut Sparse) {
        for (node, force) in self.touching(now) {
            for (sum, force) in forces[node].iter_mut().zip(force) {
                *sum -= force;
            }
            let spring = self.springs[node];
            let block = if self.holds[node].is_some() {
                isotropic(spring)
            } else {
                // The turn of the normal, force over radius, is left out: it is 0.4 % of the rubber's stiffness
                // in balance, and far from balance it makes the matrix indefinite.
                let (normal, _) = self.gap(&now[node]);
                normal.map(|n| normal.map(|m| spring * n * m))
            };
            stiffness.add_node(node, &block);
        }
    }
}

fn isotropic(spring: f64) -> [[f64; 3]; 3] {
    [[spring, 0.0, 0.0], [0.0, spring, 0.0], [0.0, 0.0, spring]]
}

/// The layer under a sphere.
#[derive(Debug)]
pub struct SpherePress {
    body: Body,
    stiffness: Sparse,
    /// The same nodes, held as an increment along x mirrors: against y at y = 0, against y and z at x = 0.
    dragged: Sparse,
    sphere: Sphere,
    thickness_mm: f64,
}

impl SpherePress {
    /// A sphere of `radius_mm` just touching a layer of `material` as thick as `gel`; `fineness` elements along
    /// a taxel in the middle: 4 to try, 8 for figures.
    ///
    /// # Errors
    /// A constant outside its range.
    pub fn new(
        gel: &Gel,
        material: Ogden,
        radius_mm: f64,
        surface: Surface,
        fineness: usize,
    ) -> Result<Self, FiniteElementError> {
        gel.check()?;
        checked(
            "sphere radius_mm",
            radius_mm,
            "a finite number above 0",
            radius_mm > 0.0 && radius_mm.is_finite(),
        )?;
        let mesh = Mesh::layer(gel.thickness_mm, fineness)?;
        let base = gel.thickness_mm - 1e-9;
        let springs: Vec<f64> = (0..mesh.surface_count())
            .map(|node| SPRING_PER_YOUNG * gel.young_mpa * mesh.node_area_mm2(node))
            .collect();
        let place = |node: usize| mesh.nodes[node];
        let stiffness = Sparse::new(&mesh, |node, axis| {
            place(node)[2] > base || axis < 2 && place(node)[axis] == 0.0
        });
        let dragged = Sparse::new(&mesh, |node, axis| {
            let [x, y, z] = place(node);
            z > base || axis == 1 && y == 0.0 || axis > 0 && x == 0.0
        });
        Ok(Self {
            sphere: Sphere {
                surface,
                radius_mm,
                depth_mm: 0.0,
                multipliers: vec![0.0; springs.len()],
                holds: vec![None; springs.len()],
                springs,
            },
            body: Body::new(mesh, material),
            stiffness,
            dragged,
            thickness_mm: gel.thickness_mm,
        })
    }

    /// Presses on to `depth_mm`, in small steps that are halved where one does not settle, and refines the contact
    /// there.
    ///
    /// # Errors
    /// [`FiniteElementError::OutOfBalance`] if the smallest step does not settle; the sphere stays where it got to.
    pub fn press_to(&mut self, depth_mm: f64) -> Result<(), FiniteElementError> {
        let mut step_mm = match self.sphere.surface {
            Surface::Frictionless => STEP_SHARE * self.thickness_mm,
            Surface::Stuck => (STUCK_STEP_SHARE * self.thickness_mm).min(depth_mm / STUCK_STEPS),
        };
        while self.sphere.depth_mm < depth_mm {
            let from = self.sphere.depth_mm;
            let before = self.body.now.clone();
            // No crumb of a step before the end.
            let left = depth_mm - from;
            self.sphere.depth_mm = if left < 1.01 * step_mm {
                depth_mm
            } else {
                from + step_mm
            };
            match self.body.balance(&mut self.stiffness, &self.sphere) {
                Ok(()) => {
                    if self.sphere.surface == Surface::Stuck {
                        self.sphere.stick(&self.body.now);
                    }
                }
                Err(error) => {
                    self.sphere.depth_mm = from;
                    self.body.now = before;
                    step_mm *= 0.5;
                    if step_mm < SMALLEST_STEP_SHARE * self.thickness_mm {
                        return Err(error);
                    }
                }
            }
        }
        for _ in 0..UPDATES {
            if self.penetration_mm() <= PENETRATION * depth_mm.abs() {
                break;
            }
            self.sphere.update(&self.body.now);
            self.body.balance(&mut self.stiffness, &self.sphere)?;
        }
        Ok(())
    }

    /// Depth of the sphere's lowest point under the gel at rest, mm.
    #[must_use]
    pub fn depth_mm(&self) -> f64 {
        self.sphere.depth_mm
    }

    /// Largest distance of a touching node from the sphere's surface, mm.
    #[must_use]
    pub fn penetration_mm(&self) -> f64 {
        let miss = |node: usize| self.sphere.miss_mm(node, &self.body.now[node]);
        self.sphere
            .touching(&self.body.now)
            .map(|(node, _)| miss(node))
            .fold(0.0, f64::max)
    }

    /// Force of the whole sphere into the gel, N.
    #[must_use]
    pub fn force_n(&self) -> f64 {
        4.0 * self
            .sphere
            .touching(&self.body.now)
            .map(|(_, force)| force[2])
            .sum::<f64>()
    }

    /// Newton steps taken so far.
    #[must_use]
    pub fn newton_steps(&self) -> usize {
        self.body.newton_steps
    }

    /// Nodes free to move.
    #[must_use]
    pub fn freedoms(&self) -> usize {
        self.stiffness.size()
    }

    /// Contact radius from the second moment of the pressure, a² = 5/2 ⟨r²⟩, which is exact for Hertz's pressure
    /// and hardly knows the mesh, mm at rest places.
    #[must_use]
    pub fn contact_radius_mm(&self) -> f64 {
        let (mut sum, mut moment) = (0.0, 0.0);
        for (node, force) in self.sphere.touching(&self.body.now) {
            let [x, y, _] = self.body.mesh.nodes[node];
            sum += force[2];
            moment += force[2] * (x * x + y * y);
        }
        if sum > 0.0 {
            (2.5 * moment / sum).sqrt()
        } else {
            0.0
        }
    }

    /// Mean pressure within `radius_mm` of the middle, force per area at rest, MPa.
    #[must_use]
    pub fn pressure_within_mpa(&self, radius_mm: f64) -> f64 {
        let (mut sum, mut area) = (0.0, 0.0);
        for (node, force) in self.sphere.touching(&self.body.now) {
            let [x, y, _] = self.body.mesh.nodes[node];
            if x * x + y * y <= radius_mm * radius_mm {
                sum += force[2];
                area += self.body.mesh.node_area_mm2(node);
            }
        }
        if area > 0.0 { sum / area } else { 0.0 }
    }

    /// Force on every taxel, N: x, y, z into the gel, at rest places, row-major.
    #[must_use]
    pub fn force_map(&self) -> Vec<[f64; 3]> {
        self.mirrored_map(self.sphere.touching(&self.body.now))
    }

    /// Nodal forces of the quarter spread over the taxels around, as a bilinear traction would, and mirrored.
    fn mirrored_map(&self, forces: impl Iterator<Item = (usize, [f64; 3])>) -> Vec<[f64; 3]> {
        let mesh = &self.body.mesh;
        let n = mesh.across_mm.len();
        let mut map = vec![[0.0; 3]; TAXEL_COUNT];
        let taxel = |line: usize, side: usize, mirrored: bool| {
            let reach = mesh.reach(line);
            let place = mesh.across_mm[line]
                + if side == 0 {
                    -0.5 * reach[0]
                } else {
                    0.5 * reach[1]
                };
            let place = if mirrored { -place } else { place };
            let index = libm::floor((place + HALF_SURFACE_MM) / TAXEL_PITCH_MM);
            (index.clamp(0.0, (TAXELS - 1) as f64) as usize, reach[side])
        };
        for (node, force) in forces {
            let [i, j] = [node % n, node / n];
            let area = mesh.node_area_mm2(node);
            for sides in 0..16 {
                let [side_x, side_y] = [sides & 1, sides >> 1 & 1];
                let [flip_x, flip_y] = [sides >> 2 & 1 == 1, sides >> 3 == 1];
                let (column, reach_x) = taxel(i, side_x, flip_x);
                let (row, reach_y) = taxel(j, side_y, flip_y);
                let share = reach_x * reach_y / area;
                let signs = [
                    if flip_x { -1.0 } else { 1.0 },
                    if flip_y { -1.0 } else { 1.0 },
                    1.0,
                ];
                for ((sum, force), sign) in map[row * TAXELS + column].iter_mut().zip(force).zip(signs) {
                    *sum += share * sign * force;
                }
            }
        }
        map
    }

    /// Displacement of the material point that rests at `place_mm` (z the depth), mm; x and y at or above 0.
    #[must_use]
    pub fn displacement_mm(&self, place_mm: [f64; 3]) -> [f64; 3] {
        let moved = |node: usize| {
            let (now, rest) = (self.body.now[node], self.body.mesh.nodes[node]);
            [now[0] - rest[0], now[1] - rest[1], now[2] - rest[2]]
        };
        self.body.mesh.interpolate(moved, place_mm)
    }

    /// Force per shift against a small drag along x with every touching node stuck to the sphere, N/mm, at the
    /// present depth.
    ///
    /// # Errors
    /// [`FiniteElementError::OutOfBalance`] if the block is not stable.
    pub fn drag_stiffness_n_per_mm(&mut self) -> Result<f64, FiniteElementError> {
        let failed = FiniteElementError::OutOfBalance {
            found: f64::INFINITY,
            steps: self.body.newton_steps,
        };
        if self.body.respond(&mut self.dragged).is_none() {
            return Err(failed);
        }
        let mut shift = vec![0.0; self.dragged.size()];
        let stuck: Vec<usize> = self
            .sphere
            .touching(&self.body.now)
            .map(|(node, _)| node)
            .collect();
        for node in &stuck {
            let spring = self.sphere.springs[*node];
            self.dragged.add_node(*node, &isotropic(spring));
            if let Some(row) = self.dragged.row(*node, 0) {
                shift[row] = spring;
            }
        }
        if !self.dragged.solve(&mut shift) {
            return Err(failed);
        }
        let force = |node: &usize| match self.dragged.row(*node, 0) {
            Some(row) => self.sphere.springs[*node] * (1.0 - shift[row]),
            None => 0.0,
        };
        Ok(4.0 * stuck.iter().map(force).sum::<f64>())
    }
}
