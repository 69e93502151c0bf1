//! What the sections share: gels made once, contacts whose every step is checked and counted, and the ledger of
//! those checks. Units: mm, N, MPa, N·mm, rad.

use std::sync::{Arc, Mutex, PoisonError};

use gripline_simulation::contact_world::{Contact, Drive, GelSurface, HeightMap, Mount, Press, Truth};
use gripline_simulation::{ForceMap, Gel, SimulationError};

/// Threads of the sections that have independent cases; the bound on speed is for as many cores.
pub(crate) const THREADS: usize = 2;

/// Friction of every section that does not draw its own.
pub(crate) const FRICTION: f64 = 0.65;

/// No coupling (ν = ½) and no base: what the closed forms assume.
pub(crate) fn half_space() -> Gel {
    Gel {
        thickness_mm: 1e9,
        poisson: 0.5,
        ..Gel::default()
    }
}

/// A paraboloid: the surface of Hertz's theory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Paraboloid {
    pub(crate) radius_mm: f64,
}

impl HeightMap for Paraboloid {
    fn height_mm(&self, [x, y]: [f64; 2]) -> f64 {
        (x * x + y * y) / (2.0 * self.radius_mm)
    }
}

/// A drive by force without tilt.
pub(crate) fn drive(force_n: f64, at_mm: [f64; 2], turn_rad: f64) -> Drive {
    Drive {
        press: Press::Force(force_n),
        at_mm,
        turn_rad,
        tilt_rad: [0.0; 2],
    }
}

/// Root of the sum of squares of the difference over that of the second, over all components of all taxels.
pub(crate) fn difference(a: &ForceMap, b: &ForceMap) -> f64 {
    let (mut off, mut size) = (0.0, 0.0);
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        off += f64::from(a - b).powi(2);
        size += f64::from(*b).powi(2);
    }
    (off / size).sqrt()
}

/// What every step of every section came to.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Ledger {
    pub(crate) steps: usize,
    pub(crate) unsolved: usize,
    pub(crate) gap: f64,
    pub(crate) friction: f64,
    /// Sum of taxel forces against the applied load, share of the normal force.
    pub(crate) force: f64,
    /// Moment of the tractions against the applied one, share of the largest that friction can hold.
    pub(crate) moment: f64,
    /// Moment by taxel centres, which is what a detector sees, against the tractions', share of the largest
    /// moment that friction can hold.
    pub(crate) taxel_moment: f64,
}

impl Ledger {
    pub(crate) fn merge(&mut self, other: &Self) {
        self.steps += other.steps;
        self.unsolved += other.unsolved;
        self.gap = self.gap.max(other.gap);
        self.friction = self.friction.max(other.friction);
        self.force = self.force.max(other.force);
        self.moment = self.moment.max(other.moment);
        self.taxel_moment = self.taxel_moment.max(other.taxel_moment);
    }
}

/// Gels of the sections and the ledger of their steps; shared between threads.
#[derive(Debug, Default)]
pub(crate) struct World {
    /// Whether the long sections take fewer cases.
    pub(crate) quick: bool,
    surfaces: Mutex<Vec<Arc<GelSurface>>>,
    ledger: Mutex<Ledger>,
}

impl World {
    pub(crate) fn new(quick: bool) -> Self {
        Self {
            quick,
            ..Self::default()
        }
    }

    /// The surface of `gel` on `cells`, made at most once.
    pub(crate) fn surface(&self, gel: &Gel, cells: usize) -> Result<Arc<GelSurface>, SimulationError> {
        let mut surfaces = self.surfaces.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(surface) = surfaces
            .iter()
            .find(|surface| surface.gel() == gel && surface.cells() == cells)
        {
            return Ok(Arc::clone(surface));
        }
        let surface = Arc::new(GelSurface::new(gel, cells)?);
        surfaces.push(Arc::clone(&surface));
        Ok(surface)
    }

    /// A contact whose steps enter the ledger.
    pub(crate) fn contact(
        &self,
        gel: &Gel,
        cells: usize,
        indenter: impl HeightMap + 'static,
        mount: Mount,
    ) -> Result<Checked<'_>, SimulationError> {
        self.rubbing(gel, cells, indenter, mount, FRICTION)
    }

    /// The same with a friction of its own.
    pub(crate) fn rubbing(
        &self,
        gel: &Gel,
        cells: usize,
        indenter: impl HeightMap + 'static,
        mount: Mount,
        friction: f64,
    ) -> Result<Checked<'_>, SimulationError> {
        let contact = Contact::new(self.surface(gel, cells)?, Arc::new(indenter), friction, mount)?;
        Ok(Checked {
            world: self,
            contact,
            mount,
            friction,
            at: None,
        })
    }

    /// Enters checks from elsewhere.
    pub(crate) fn enter(&self, ledger: &Ledger) {
        self.ledger
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .merge(ledger);
    }

    /// What all steps came to so far.
    pub(crate) fn ledger(&self) -> Ledger {
        *self.ledger.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A contact that checks every step it makes.
#[derive(Debug)]
pub(crate) struct Checked<'a> {
    world: &'a World,
    contact: Contact,
    mount: Mount,
    friction: f64,
    at: Option<Drive>,
}

impl Checked<'_> {
    /// With pressure straight down, as closed forms and other programs have it.
    pub(crate) fn vertical_pressure(mut self) -> Self {
        self.contact = self.contact.vertical_pressure();
        self
    }

    pub(crate) fn truth(&self) -> &Truth {
        self.contact.truth()
    }

    /// One step, checked.
    pub(crate) fn step(&mut self, drive: Drive) -> Result<&Truth, SimulationError> {
        let outcome = self.contact.step(drive).map(|_| ());
        let mut ledger = Ledger {
            steps: 1,
            ..Ledger::default()
        };
        if let Err(error) = outcome {
            if matches!(error, SimulationError::ContactUnsolved { .. }) {
                ledger.unsolved = 1;
                self.world.enter(&ledger);
            }
            return Err(error);
        }
        self.at = Some(drive);
        balance(
            self.contact.truth(),
            &drive,
            self.mount,
            self.friction,
            &mut ledger,
        );
        self.world.enter(&ledger);
        Ok(self.contact.truth())
    }

    /// `steps` equal steps to `drive`, from the last one or, at first, from no force at the same place.
    pub(crate) fn go(&mut self, drive: Drive, steps: u32) -> Result<&Truth, SimulationError> {
        let from = self.at.unwrap_or(Drive {
            press: Press::Force(0.0),
            ..drive
        });
        for step in 1..=steps {
            let part = f64::from(step) / f64::from(steps);
            let between = |a: f64, b: f64| a + (b - a) * part;
            let press = match (from.press, drive.press) {
                (Press::Force(a), Press::Force(b)) => Press::Force(between(a, b)),
                (Press::Depth(a), Press::Depth(b)) => Press::Depth(between(a, b)),
                (_, press) => press,
            };
            self.step(Drive {
                press,
                at_mm: [0, 1].map(|k| between(from.at_mm[k], drive.at_mm[k])),
                turn_rad: between(from.turn_rad, drive.turn_rad),
                tilt_rad: [0, 1].map(|k| between(from.tilt_rad[k], drive.tilt_rad[k])),
            })?;
        }
        Ok(self.contact.truth())
    }
}

/// Taxel sums and moments of `truth` against what `drive` applies through `mount`.
fn balance(truth: &Truth, drive: &Drive, mount: Mount, friction: f64, ledger: &mut Ledger) {
    // A mount turns about where the indenter stands on the gel.
    let about = truth.footprint_mm();
    let residuals = truth.residuals();
    ledger.gap = residuals.gap;
    ledger.friction = residuals.friction;
    let (map, force) = (truth.force_map(), truth.force_n());
    let normal = force[2];
    if normal <= 0.0 {
        return;
    }
    let pose = truth.pose();
    let mut applied = force;
    if let Press::Force(press) = drive.press {
        applied[2] = press;
    }
    if mount.shift_mm_per_n > 0.0 {
        for ((applied, order), at) in applied.iter_mut().zip(drive.at_mm).zip(pose.at_mm) {
            *applied = (order - at) / mount.shift_mm_per_n;
        }
    }
    let (mut sum, mut by_taxel) = ([0.0; 3], 0.0);
    for (taxel, [fx, fy, fz]) in map.iter().map(|t| t.map(f64::from)).enumerate() {
        let place = |i: usize| (i as f64 - 9.5) * gripline_simulation::constants::TAXEL_PITCH_MM;
        let [x, y] = [place(taxel % 20), place(taxel / 20)];
        by_taxel += (x - about[0]) * fy - (y - about[1]) * fx;
        for (sum, f) in sum.iter_mut().zip([fx, fy, fz]) {
            *sum += f;
        }
    }
    for k in 0..3 {
        ledger.force = ledger.force.max((sum[k] - applied[k]).abs() / normal);
    }
    let moment = truth.torsional_moment_nmm(about);
    let max = max_moment_nmm(truth, friction, about);
    if mount.turn_rad_per_nmm > 0.0 {
        let applied = (drive.turn_rad - pose.turn_rad) / mount.turn_rad_per_nmm;
        ledger.moment = (moment - applied).abs() / max;
    }
    ledger.taxel_moment = (by_taxel - moment).abs() / max;
}

/// Moment about `about` that friction holds at most, μ Σ p r, N·mm.
pub(crate) fn max_moment_nmm(truth: &Truth, friction: f64, about_mm: [f64; 2]) -> f64 {
    let cell_mm2 = truth.pitch_mm() * truth.pitch_mm();
    let sum: f64 = truth
        .pressure_mpa()
        .iter()
        .enumerate()
        .filter(|(_, p)| **p > 0.0)
        .map(|(cell, p)| {
            let [x, y] = truth.place_mm(cell);
            p * libm::hypot(x - about_mm[0], y - about_mm[1])
        })
        .sum();
    friction * sum * cell_mm2
}
