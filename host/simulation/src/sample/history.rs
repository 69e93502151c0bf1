//! Random load histories in the contact world: press, then pull, twist, reverse, unload, grip again and roll, in
//! small steps, with some of the states on the way shown as samples. Units: mm, N, N·mm, rad. Limits: states in
//! which the gel is strained beyond [`STRAIN_LIMIT`] of its thickness are never shown; they are counted.

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use super::shapes::Indenter;
use super::split::Split;
use crate::constants::{HALF_SURFACE_MM, LARGEST_INDENTATION};
use crate::contact_world::{Contact, Drive, GelSurface, Mount, Press, Truth, production_cells};
use crate::error::SimulationError;
use crate::gel::Gel;
use crate::random::Random;

/// Deepest indentation and largest elastic shift that training sees, share of the layer's thickness: beyond
/// [`LARGEST_INDENTATION`], where the linear layer is doubtful, so that a hard grip is not a picture unlike all others.
/// Figures are reported, and the detector is calibrated, up to [`LARGEST_INDENTATION`] only.
pub const STRAIN_LIMIT: f64 = 0.35;
/// Peak force below which training samples take the finer grid, N.
const LIGHT_N: f64 = 1.5;
/// True friction.
const FRICTION: [f64; 2] = [0.4, 1.0];
/// Free gel kept between the contact and the surface's edge where it can be, mm.
const MARGIN_MM: f64 = 1.0;
/// Steps of a press; see [`Contact::go_to`].
const PRESS_STEPS: u32 = 8;
/// Depth grows with the load to two thirds, so these loads are even steps in depth.
const PRESS_POWER: f64 = 1.5;
/// Largest travel of the indenter in a step beyond the elastic shift, mm: half of a coarse cell.
const SLIDE_STEP_MM: f64 = 0.4;
/// Largest tilt of the indenter, rad.
const TILT_RAD: f64 = 0.08;

/// What became of the histories that a stream has drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Load histories begun.
    pub histories: u64,
    /// Steps solved.
    pub steps: u64,
    /// Steps whose solve did not converge: the history ended there and nothing of the step was used.
    pub unsolved: u64,
    /// Steps that reached the edge of the sensing surface: the history ended there too.
    pub off_surface: u64,
    /// States not shown because the gel was strained too far ([`STRAIN_LIMIT`]).
    pub overstrained: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, more: Self) {
        self.histories += more.histories;
        self.steps += more.steps;
        self.unsolved += more.unsolved;
        self.off_surface += more.off_surface;
        self.overstrained += more.overstrained;
    }
}

/// Where and how hard contacts are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Range {
    /// Normal loads, log-uniform, N; the strain limit cuts them for slender shapes.
    pub(crate) normal_n: [f64; 2],
    /// Half of the surface on which contacts are placed, along x and y, mm.
    pub(crate) half_mm: [f64; 2],
}

impl Default for Range {
    /// The particle fingertip's whole sensing surface.
    fn default() -> Self {
        Self {
            normal_n: [0.1, 15.0],
            half_mm: [HALF_SURFACE_MM; 2],
        }
    }
}

/// Gels of all resolutions, shared by all streams of a thread: their spectra are made once.
#[derive(Debug, Clone)]
pub(crate) struct GelSurfaces(Vec<Arc<GelSurface>>);

impl GelSurfaces {
    pub(crate) fn new(gel: &Gel) -> Result<Self, SimulationError> {
        let sides = [40, 80, 120, 160];
        let surfaces = sides.map(|cells| GelSurface::new(gel, cells).map(Arc::new));
        surfaces.into_iter().collect::<Result<_, _>>().map(Self)
    }

    /// The surface with the most cells.
    pub(crate) fn finest(&self) -> Arc<GelSurface> {
        Arc::clone(&self.0[self.0.len() - 1])
    }

    fn for_load(&self, split: Split, peak_n: f64) -> Arc<GelSurface> {
        let cells = grid_cells(split, peak_n);
        let fits = self.0.iter().find(|surface| surface.cells() >= cells);
        Arc::clone(fits.unwrap_or(&self.0[self.0.len() - 1]))
    }
}

/// One indenter on its way.
#[derive(Debug)]
pub(crate) struct History {
    contact: Contact,
    gel: Gel,
    range: Range,
    friction: f64,
    shape: &'static str,
    drive: Drive,
    /// Turn without torsion, about.
    neutral_rad: f64,
    /// Load of the last state within the strain limit, N.
    mild_n: f64,
    plan: VecDeque<Step>,
    phases_left: usize,
    pulled: bool,
    /// Deepest indentation that is shown, share of the thickness.
    deepest: f64,
}

#[derive(Debug, Clone, Copy)]
struct Step {
    drive: Drive,
    shown: bool,
}

impl History {
    /// A random indenter over a random place, its press planned.
    pub(crate) fn draw(
        random: &mut Random,
        split: Split,
        surfaces: &GelSurfaces,
        gel: &Gel,
        range: Range,
    ) -> Result<Self, SimulationError> {
        let indenter = Indenter::draw(random, split)?;
        let friction = random.uniform(FRICTION[0], FRICTION[1]);
        let normal_n = random.log_uniform(range.normal_n[0], range.normal_n[1]);
        // Hertz on a ball of 10 mm tells about how deep and how wide.
        let deep_mm = libm::pow(
            0.75 * normal_n / (gel.contact_modulus_mpa() * 10.0_f64.sqrt()),
            2.0 / 3.0,
        )
        .min(STRAIN_LIMIT * gel.thickness_mm);
        let reach_mm = indenter.reach_mm(0.8 * deep_mm);
        let at_mm = range.half_mm.map(|half_mm| {
            let room = (half_mm - MARGIN_MM - reach_mm).max(0.5);
            random.uniform(-room, room)
        });
        let turn_rad = random.uniform(0.0, TAU);
        let tilt_rad = if random.unit() < 0.5 {
            [0.0; 2]
        } else {
            random_tilt(random)
        };
        let contact = Contact::new(
            surfaces.for_load(split, normal_n),
            indenter.surface,
            friction,
            Mount::default(),
        )?;
        let touch = Drive {
            press: Press::Force(0.0),
            at_mm,
            turn_rad,
            tilt_rad,
        };
        let mut history = Self {
            contact,
            gel: *gel,
            range,
            friction,
            shape: indenter.name,
            drive: touch,
            neutral_rad: turn_rad,
            mild_n: 0.0,
            plan: VecDeque::new(),
            phases_left: 1 + random.below(3),
            pulled: false,
            deepest: match split {
                Split::Calibration | Split::Test => LARGEST_INDENTATION,
                Split::Train | Split::Validation => STRAIN_LIMIT,
            },
        };
        history.plan_press(random, split, normal_n, deep_mm);
        Ok(history)
    }

    /// Goes on to the next state that is shown; none when the history is over. What happens on the way counts.
    pub(crate) fn advance(&mut self, random: &mut Random, counts: &mut Counts) -> Option<&Truth> {
        loop {
            let Some(step) = self.plan.pop_front() else {
                if self.phases_left == 0 || !self.contact.truth().in_contact() {
                    return None;
                }
                self.phases_left -= 1;
                self.plan_phase(random);
                continue;
            };
            if let Err(error) = self.contact.step(step.drive) {
                match error {
                    SimulationError::OffSurface { .. } => counts.off_surface += 1,
                    _ => counts.unsolved += 1,
                }
                self.phases_left = 0;
                self.plan.clear();
                return None;
            }
            counts.steps += 1;
            self.drive = step.drive;
            if overstrained(self.contact.truth(), &self.gel, self.deepest) {
                counts.overstrained += 1;
                // Back to what was still mild, then on from there.
                self.plan.clear();
                if self.mild_n > 0.0 {
                    self.plan.push_back(Step {
                        drive: Drive {
                            press: Press::Force(0.9 * self.mild_n),
                            ..step.drive
                        },
                        shown: true,
                    });
                    self.mild_n = 0.0;
                } else {
                    self.phases_left = 0;
                }
                continue;
            }
            self.mild_n = self.contact.truth().force_n()[2];
            // Nothing touches when a release was complete: samples without contact have their own place.
            if step.shown && self.contact.truth().in_contact() {
                return Some(self.contact.truth());
            }
        }
    }

    pub(crate) fn friction(&self) -> f64 {
        self.friction
    }

    pub(crate) fn shape(&self) -> &'static str {
        self.shape
    }

    /// The contact as advanced last.
    pub(crate) fn truth(&self) -> &Truth {
        self.contact.truth()
    }

    /// Straight down, or pulled or turned on the way.
    fn plan_press(&mut self, random: &mut Random, split: Split, normal_n: f64, deep_mm: f64) {
        let wide_mm = (10.0 * deep_mm).sqrt();
        let [shift_mm, turn_rad] = elastic_limits(&self.gel, self.friction * normal_n, wide_mm);
        let [x, y] = random.direction();
        let kind = random.unit();
        let pull = if kind < 0.4 {
            random.uniform(0.0, 1.0) * shift_mm
        } else {
            0.0
        };
        let turn = if kind > 0.85 {
            random.uniform(-1.5, 1.5) * turn_rad
        } else {
            0.0
        };
        let end_shown = random.unit() < 0.4;
        let between = (random.unit() < 0.5).then(|| 3 + random.below(4) as u32);
        let grid = grid_cells(split, normal_n);
        for step in 1..=PRESS_STEPS {
            let part = f64::from(step) / f64::from(PRESS_STEPS);
            let load_n = normal_n * libm::pow(part, PRESS_POWER);
            let drive = Drive {
                press: Press::Force(load_n),
                at_mm: [
                    self.drive.at_mm[0] + part * pull * x,
                    self.drive.at_mm[1] + part * pull * y,
                ],
                turn_rad: self.drive.turn_rad + part * turn,
                ..self.drive
            };
            // Only a finer grid is right about the light loads on the way.
            let between = Some(step) == between && grid_cells(split, load_n) == grid;
            let shown = (step == PRESS_STEPS && end_shown) || between;
            self.plan.push_back(Step { drive, shown });
        }
    }

    /// A few steps from where the contact stands now.
    fn plan_phase(&mut self, random: &mut Random) {
        let truth = self.contact.truth();
        let normal_n = truth.force_n()[2];
        let wide_mm = (truth.area_mm2() / PI).sqrt();
        let mut to = self.drive;
        let mut load_n = normal_n;
        let kind = random.unit();
        if kind < 0.65 || !self.pulled {
            // Pull and torsion, some while the grip changes.
            self.pulled = true;
            if random.unit() < 0.25 {
                load_n *= random.uniform(0.6, 1.5);
            }
            self.aim(random, &mut to, load_n, wide_mm);
        } else if kind < 0.80 {
            // Less grip under the same shift: slip comes without motion.
            load_n *= random.uniform(0.3, 0.8);
        } else if kind < 0.92 {
            load_n *= random.uniform(1.2, 1.8);
        } else {
            to.tilt_rad = random_tilt(random);
        }
        to.press = Press::Force(load_n.min(self.range.normal_n[1]));
        let distance = libm::hypot(
            to.at_mm[0] - self.drive.at_mm[0],
            to.at_mm[1] - self.drive.at_mm[1],
        );
        let steps = (4 + random.below(3)).max((distance / SLIDE_STEP_MM).ceil() as usize);
        let from = Drive {
            press: Press::Force(normal_n),
            ..self.drive
        };
        // Every second step and the last.
        let first = steps % 2;
        for step in 1..=steps {
            self.plan.push_back(Step {
                drive: between(&from, &to, step as f64 / steps as f64),
                shown: step % 2 == first && step > 1,
            });
        }
    }

    /// Sets place and turn to a random point of the way to gross slip and beyond.
    fn aim(&mut self, random: &mut Random, to: &mut Drive, load_n: f64, wide_mm: f64) {
        let [shift_mm, turn_rad] = elastic_limits(&self.gel, self.friction * load_n, wide_mm);
        // What slid has no torsion left beyond the elastic turn.
        self.neutral_rad = self
            .neutral_rad
            .clamp(to.turn_rad - 1.5 * turn_rad, to.turn_rad + 1.5 * turn_rad);
        // Pull alone, twist alone, both.
        let kind = random.unit();
        let mix = if kind < 0.4 {
            0.0
        } else if kind < 0.55 {
            0.5 * PI
        } else {
            random.uniform(0.0, 0.5 * PI)
        };
        // How far towards gross slip: hardly loaded, anywhere, near slip, beyond.
        let kind = random.unit();
        let share = if kind < 0.1 {
            random.uniform(0.0, 0.1)
        } else if kind < 0.65 {
            random.uniform(0.1, 1.0)
        } else if kind < 0.85 {
            random.uniform(0.8, 1.1)
        } else {
            random.uniform(1.1, 1.8)
        };
        let (sin, cos) = libm::sincos(mix);
        let [x, y] = random.direction();
        let pull = (share * cos * shift_mm).min(0.9 * STRAIN_LIMIT * self.gel.thickness_mm);
        let [x0, y0] = self.contact.truth().footprint_mm();
        to.at_mm = [x0 + pull * x, y0 + pull * y];
        let sign = if random.unit() < 0.5 { -1.0 } else { 1.0 };
        to.turn_rad = self.neutral_rad + sign * share * sin * 2.0 * turn_rad;
    }
}

/// Cells along the gel's side for a history that peaks at `peak_n`: the production grid where figures are reported
/// and the detector is calibrated, a third to a half of it where thousands of samples are learned from. The coarser
/// grid's maps are a few percent off (the test below prints it), a fraction of what the network misses, at a fifth of
/// the cost.
fn grid_cells(split: Split, peak_n: f64) -> usize {
    match split {
        Split::Calibration | Split::Test => production_cells(peak_n),
        Split::Train | Split::Validation if peak_n < LIGHT_N => 80,
        Split::Train | Split::Validation => 40,
    }
}

fn random_tilt(random: &mut Random) -> [f64; 2] {
    [
        random.uniform(-TILT_RAD, TILT_RAD),
        random.uniform(-TILT_RAD, TILT_RAD),
    ]
}

/// Shift at which a contact of radius `wide_mm` slides as a whole under the friction bound `limit_n`, and the turn
/// of torsion alone at which a linear contact would: half-space (Mindlin 1949; 16Ga³/3) and plain layer (shear of a
/// column) side by side.
fn elastic_limits(gel: &Gel, limit_n: f64, wide_mm: f64) -> [f64; 2] {
    let (g, h, a) = (gel.shear_modulus_mpa(), gel.thickness_mm, wide_mm.max(0.3));
    let column = g * PI * a * a / h;
    let shift = limit_n / (16.0 * g * a / (3.0 * (2.0 - gel.poisson)) + column);
    let turn = 3.0 * PI / 16.0 * limit_n * a / (16.0 * g * a * a * a / 3.0 + 0.5 * column * a * a);
    [shift, turn]
}

/// Whether the indentation (an upper bound of it under a tilted indenter) exceeds `deepest`, or the elastic shift
/// [`STRAIN_LIMIT`], as shares of the thickness.
fn overstrained(truth: &Truth, gel: &Gel, deepest: f64) -> bool {
    let pose = truth.pose();
    let [x0, y0] = truth.footprint_mm();
    let [slope_x, slope_y] = pose.tilt_rad;
    let touching = truth.pressure_mpa().iter().enumerate().filter(|(_, p)| **p > 0.0);
    let lowered = touching.fold(0.0_f64, |max, (cell, _)| {
        let [x, y] = truth.place_mm(cell);
        max.max(slope_x * (x - x0) + slope_y * (y - y0))
    });
    let shift = libm::hypot(pose.at_mm[0] - x0, pose.at_mm[1] - y0);
    pose.depth_mm + lowered > deepest * gel.thickness_mm || shift > STRAIN_LIMIT * gel.thickness_mm
}

/// The drive `part` of the way; both press by force.
fn between(from: &Drive, to: &Drive, part: f64) -> Drive {
    let mix = |a: f64, b: f64| a + (b - a) * part;
    let press = match (from.press, to.press) {
        (Press::Force(a), Press::Force(b)) => Press::Force(mix(a, b)),
        _ => to.press,
    };
    Drive {
        press,
        at_mm: [0, 1].map(|k| mix(from.at_mm[k], to.at_mm[k])),
        turn_rad: mix(from.turn_rad, to.turn_rad),
        tilt_rad: [0, 1].map(|k| mix(from.tilt_rad[k], to.tilt_rad[k])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Force maps of the states that `gels` show along the same histories.
    fn maps(surfaces: &GelSurfaces, histories: u32) -> Vec<Vec<[f32; 3]>> {
        let mut maps = Vec::new();
        for seed in 0..histories {
            let mut random = Random::new(u64::from(seed), 77);
            let mut counts = Counts::default();
            let drawn = History::draw(
                &mut random,
                Split::Train,
                surfaces,
                &Gel::default(),
                Range::default(),
            );
            let mut history = drawn.unwrap();
            while let Some(truth) = history.advance(&mut random, &mut counts) {
                maps.push(truth.force_map().to_vec());
            }
            assert_eq!(counts.unsolved, 0);
        }
        maps
    }

    /// Only `cargo xtask test --all` runs these.
    mod slow {
        use super::*;

        #[test]
        fn the_training_grid_is_a_few_percent_from_a_grid_that_is_two_to_three_times_finer() {
            let gel = Gel::default();
            let surface = |cells: usize| Arc::new(GelSurface::new(&gel, cells).unwrap());
            let coarse = maps(&GelSurfaces(vec![surface(40), surface(80)]), 36);
            let fine = maps(&GelSurfaces(vec![surface(160)]), 36);
            assert_eq!(coarse.len(), fine.len());
            let norm = |map: &[[f32; 3]]| map.as_flattened().iter().map(|f| f * f).sum::<f32>().sqrt();
            let mut off: Vec<f32> = coarse
                .iter()
                .zip(&fine)
                .map(|(a, b)| {
                    let between: Vec<[f32; 3]> = a
                        .iter()
                        .zip(b)
                        .map(|(a, b)| [0, 1, 2].map(|k| a[k] - b[k]))
                        .collect();
                    norm(&between) / norm(b)
                })
                .collect();
            off.sort_by(f32::total_cmp);
            let at = |share: f32| off[((off.len() - 1) as f32 * share) as usize];
            println!(
                "training grid against 160 cells, {} states: median {:.3}, 90 % below {:.3}, most {:.3}",
                off.len(),
                at(0.5),
                at(0.9),
                at(1.0)
            );
            assert!(at(0.5) < 0.03 && at(0.9) < 0.06);
        }
    }
}
