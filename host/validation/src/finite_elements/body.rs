//! The rubber block at rest and now, brought into balance by Newton's method with a line search on the energy.
//! Units: mm, N, MPa, N·mm. Limits: static, elastic; loads must derive from an energy.

use super::element;
use super::error::{BALANCE, FiniteElementError};
use super::mesh::Mesh;
use super::ogden::Ogden;
use super::sparse::Sparse;

/// Newton steps before a solve gives up.
const NEWTON_STEPS: usize = 60;
/// Halvings of one step before a solve gives up.
const HALVINGS: usize = 12;
/// Energy that rounding may add, share of bulk modulus times volume: stretches near 1 cancel.
const ENERGY_NOISE: f64 = 1e-15;

/// What acts on the block.
pub(super) trait Load {
    /// Energy of the load with the nodes at `now`.
    fn energy(&self, now: &[[f64; 3]]) -> f64;
    /// Adds the energy's gradient to `force` and its second derivative to `stiffness`.
    fn add(&self, now: &[[f64; 3]], force: &mut [[f64; 3]], stiffness: &mut Sparse);
}

/// A meshed piece of rubber.
#[derive(Debug)]
pub(super) struct Body {
    pub(super) mesh: Mesh,
    pub(super) material: Ogden,
    /// Where the nodes are.
    pub(super) now: Vec<[f64; 3]>,
    energy_noise: f64,
    /// Newton steps taken since the body was made.
    pub(super) newton_steps: usize,
}

impl Body {
    /// The block at rest.
    pub(super) fn new(mesh: Mesh, material: Ogden) -> Self {
        let last = mesh.nodes.last().map_or(0.0, |corner| corner.iter().product());
        Self {
            now: mesh.nodes.clone(),
            energy_noise: ENERGY_NOISE * material.bulk_mpa() * last,
            mesh,
            material,
            newton_steps: 0,
        }
    }

    fn corners(&self, element: &[usize; 8], of: &[[f64; 3]]) -> [[[f64; 3]; 8]; 2] {
        [
            element.map(|node| self.mesh.nodes[node]),
            element.map(|node| of[node]),
        ]
    }

    fn energy(&self, now: &[[f64; 3]]) -> Option<f64> {
        let mut sum = 0.0;
        for element in &self.mesh.elements {
            let [rest, now] = self.corners(element, now);
            sum += element::energy(&self.material, &rest, &now)?;
        }
        Some(sum)
    }

    /// Fills `stiffness` and returns energy and forces of the rubber; none if an element is inside out.
    pub(super) fn respond(&self, stiffness: &mut Sparse) -> Option<(f64, Vec<[f64; 3]>)> {
        stiffness.clear();
        let mut energy = 0.0;
        let mut forces = vec![[0.0; 3]; self.now.len()];
        for element in &self.mesh.elements {
            let [rest, now] = self.corners(element, &self.now);
            let found = element::response(&self.material, &rest, &now)?;
            energy += found.energy;
            for (corner, node) in element.iter().enumerate() {
                for (axis, force) in forces[*node].iter_mut().enumerate() {
                    *force += found.force[3 * corner + axis];
                }
            }
            stiffness.add_element(element, &found.stiffness);
        }
        Some((energy, forces))
    }

    /// Moves the free nodes of `stiffness` until all forces on them are in balance.
    ///
    /// # Errors
    /// [`FiniteElementError::OutOfBalance`] with the forces that are left; the nodes stay where they got to.
    pub(super) fn balance(
        &mut self,
        stiffness: &mut Sparse,
        load: &impl Load,
    ) -> Result<(), FiniteElementError> {
        let mut left = f64::INFINITY;
        for _ in 0..NEWTON_STEPS {
            let Some((energy, mut forces)) = self.respond(stiffness) else {
                break;
            };
            let energy = energy + load.energy(&self.now);
            load.add(&self.now, &mut forces, stiffness);
            let (mut free, mut held) = (0.0, 0.0);
            let mut step = vec![0.0; stiffness.size()];
            for (node, force) in forces.iter().enumerate() {
                for (axis, force) in force.iter().enumerate() {
                    match stiffness.row(node, axis) {
                        Some(row) => {
                            step[row] = -force;
                            free += force * force;
                        }
                        None => held += force * force,
                    }
                }
            }
            left = if free > 0.0 { (free / held).sqrt() } else { 0.0 };
            if left <= BALANCE {
                return Ok(());
            }
            self.newton_steps += 1;
            let downhill = step.clone();
            if !stiffness.solve(&mut step) {
                break;
            }
            let slope: f64 = step.iter().zip(&downhill).map(|(s, d)| s * d).sum();
            let allowed = |share: f64| energy - 1e-4 * share * slope + self.energy_noise;
            let mut share = 1.0;
            let moved = (0..HALVINGS).find_map(|_| {
                let trial = self.moved(stiffness, &step, share);
                let found = self.energy(&trial).map(|rubber| rubber + load.energy(&trial));
                let fits = found.is_some_and(|found| found <= allowed(share));
                share *= 0.5;
                fits.then_some(trial)
            });
            match moved {
                Some(trial) => self.now = trial,
                None => break,
            }
        }
        Err(FiniteElementError::OutOfBalance {
            found: left,
            steps: self.newton_steps,
        })
    }

    fn moved(&self, stiffness: &Sparse, step: &[f64], share: f64) -> Vec<[f64; 3]> {
        let mut trial = self.now.clone();
        for (node, place) in trial.iter_mut().enumerate() {
            for (axis, value) in place.iter_mut().enumerate() {
                if let Some(row) = stiffness.row(node, axis) {
                    *value += share * step[row];
                }
            }
        }
        trial
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_simulation::Gel;
    use gripline_simulation::Random;

    struct Nothing;

    impl Load for Nothing {
        fn energy(&self, _: &[[f64; 3]]) -> f64 {
            0.0
        }

        fn add(&self, _: &[[f64; 3]], _: &mut [[f64; 3]], _: &mut Sparse) {}
    }

    /// A cube of side 2 in 3 x 3 x 3 elements whose inner nodes were shaken.
    fn shaken_cube() -> Mesh {
        let lines: Vec<f64> = (0..4).map(|i| f64::from(i) * 2.0 / 3.0).collect();
        let mut mesh = Mesh::block(lines.clone(), lines);
        let mut random = Random::new(11, 0);
        for node in &mut mesh.nodes {
            if is_inner(node) {
                for x in node {
                    *x += 0.3 * (random.unit() - 0.5);
                }
            }
        }
        mesh
    }

    fn is_inner(rest: &[f64; 3]) -> bool {
        rest.iter().all(|x| *x > 0.1 && *x < 1.9)
    }

    #[test]
    fn a_layer_pressed_all_over_has_the_confined_modulus_of_the_linear_one() {
        let gel = Gel::default();
        let mesh = shaken_cube();
        let rest = mesh.nodes.clone();
        let held = |node: usize, axis: usize| {
            let place: [f64; 3] = rest[node];
            place[axis] < 1e-9 || place[axis] > 2.0 - 1e-9
        };
        let mut stiffness = Sparse::new(&mesh, held);
        let mut body = Body::new(mesh, Ogden::of_gel(&gel).unwrap());
        let strain = 1e-4;
        for (now, rest) in body.now.iter_mut().zip(&rest) {
            now[2] = rest[2] * (1.0 - strain);
        }
        body.balance(&mut stiffness, &Nothing).unwrap();
        let (_, forces) = body.respond(&mut stiffness).unwrap();
        let force: f64 = forces
            .iter()
            .zip(&rest)
            .filter(|(_, r)| r[2] < 1e-9)
            .map(|(f, _)| f[2])
            .sum();
        let nu = gel.poisson;
        let modulus = 2.0 * gel.shear_modulus_mpa() * (1.0 - nu) / (1.0 - 2.0 * nu);
        assert!((force / (4.0 * modulus * strain) - 1.0).abs() < 5e-4, "{force} N");
    }

    #[test]
    fn a_bar_of_distorted_elements_follows_ogdens_closed_form_in_pull_and_push() {
        let gel = Gel::default();
        for material in [Ogden::of_gel(&gel).unwrap(), Ogden::neo_hooke(&gel).unwrap()] {
            for stretch in [0.6, 0.85, 1.3] {
                let mesh = shaken_cube();
                let rest = mesh.nodes.clone();
                let held = |node: usize, axis: usize| {
                    let place: [f64; 3] = rest[node];
                    place[axis] < 1e-9 || axis == 2 && place[2] > 2.0 - 1e-9
                };
                let mut stiffness = Sparse::new(&mesh, held);
                let mut body = Body::new(mesh, material);
                for step in 1..=4 {
                    // From a guess that keeps the volume: far from it the matrix is indefinite.
                    let along: f64 = 1.0 + (stretch - 1.0) * f64::from(step) / 4.0;
                    for (now, rest) in body.now.iter_mut().zip(&rest) {
                        *now = [rest[0] / along.sqrt(), rest[1] / along.sqrt(), along * rest[2]];
                    }
                    body.balance(&mut stiffness, &Nothing).unwrap();
                }
                let (stress, side) = material.uniaxial(stretch);
                for (now, rest) in body.now.iter().zip(&rest) {
                    let exact = [side * rest[0], side * rest[1], stretch * rest[2]];
                    for (found, exact) in now.iter().zip(exact) {
                        assert!((found - exact).abs() < 1e-6, "{found} {exact}");
                    }
                }
                let (_, forces) = body.respond(&mut stiffness).unwrap();
                let force: f64 = forces
                    .iter()
                    .zip(&rest)
                    .filter(|(_, r)| r[2] > 1.9)
                    .map(|(f, _)| f[2])
                    .sum();
                let exact = stress * 4.0 * side * side;
                assert!((force / exact - 1.0).abs() < 1e-6, "{force} {exact} N");
            }
        }
    }
}
