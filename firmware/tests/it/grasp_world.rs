//! A grasp as a mass on a spring between two fingertips, with friction that is known here alone: what the program's maps are made
//! from, and what judges its line. One fingertip stands for both; forces are per fingertip.
//!
//! Units: newtons, metres, seconds. The maps are those of a round contact with partial slip (Cattaneo–Mindlin). Limits: one
//! direction of shear, no moment; the gel creeps and hysteresis only as gains.

use gripline_protocol::{ForceMap, LSB_PER_NEWTON, SIDE, TaxelForce};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Time of a step, s: 32 to a picture at 60 Hz.
pub(crate) const STEP: f64 = 1.0 / 60.0 / 32.0;
/// Steps from picture to picture.
pub(crate) const PICTURE_STEPS: usize = 32;
/// Steps from a picture to the arrival of its map: 25 ms.
pub(crate) const DELAY_STEPS: usize = 48;
const GRAVITY: f64 = 9.81;
/// An object that slid so far is lost, m.
pub(crate) const LOST: f64 = 0.016;

/// What is true of one grasp, and nobody but the judge knows.
#[derive(Debug, Clone)]
pub(crate) struct Truth {
    /// Sticking friction, and sliding friction over it.
    pub(crate) friction: f64,
    pub(crate) sliding: f64,
    /// Friction is multiplied by the factor from that time on.
    pub(crate) drop: Option<(f64, f64)>,
    /// Time constant of the gripper.
    pub(crate) lag: f64,
    /// Measured over true normal force and shear, and the noise of both.
    pub(crate) gains: [f64; 2],
    pub(crate) noise: f64,
    /// Stiffness of gel and fingers in shear, N/m.
    pub(crate) stiffness: f64,
    /// Mass on a fingertip before and after a pouring of 1.5 s, kg, and when that begins.
    pub(crate) mass: [f64; 2],
    pub(crate) pour_at: f64,
    /// A knock: change of velocity, when, for how long.
    pub(crate) knock: (f64, f64, f64),
    /// Shaking for a second: acceleration, frequency, when.
    pub(crate) shake: (f64, f64, f64),
}

impl Truth {
    /// A random grasp; an adverse one is drawn from wider ranges, and friction may fall in the middle of the hold.
    pub(crate) fn random(seed: u64, is_adverse: bool) -> Self {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let mut within = |min: f64, max: f64| rng.random_range(min..max);
        let error = if is_adverse { 0.25 } else { 0.05 };
        let (friction, sliding) = if is_adverse {
            (within(0.2, 1.2), within(0.6, 1.0))
        } else {
            (within(0.5, 1.0), 1.0)
        };
        let falls = is_adverse && within(0.0, 1.0) < 0.5;
        let drop = (within(2.2, 5.0), within(0.5, 0.9));
        let heavy = within(0.1, 0.6) / 2.0;
        let poured = if within(0.0, 1.0) < 0.3 {
            within(0.2, 0.8)
        } else {
            0.0
        };
        let shakes = within(0.0, 1.0) < 0.4;
        let knocked = within(0.0, 1.0) < 0.4;
        Self {
            friction,
            sliding,
            drop: falls.then_some(drop),
            lag: if is_adverse { 0.1 } else { 0.04 },
            gains: [within(1.0 - error, 1.0 + error), within(1.0 - error, 1.0 + error)],
            noise: 0.02,
            stiffness: within(1_000.0, 2_000.0),
            mass: [heavy / (1.0 + poured), heavy],
            pour_at: within(2.2, 4.0),
            knock: (
                if knocked { within(0.02, 0.1) } else { 0.0 },
                within(2.2, 5.5),
                within(0.02, 0.04),
            ),
            shake: (
                if shakes { within(1.0, 3.0) } else { 0.0 },
                within(2.0, 4.0),
                within(2.2, 4.5),
            ),
        }
    }

    fn mass_at(&self, time: f64) -> f64 {
        let [before, after] = self.mass;
        before + (after - before) * ((time - self.pour_at) / 1.5).clamp(0.0, 1.0)
    }

    /// Where the hand is: 3 mm in a second, then 30 mm in 0.6 s, then perhaps shaken.
    fn hand(&self, time: f64) -> f64 {
        let share = ((time - 1.3) / 0.6).clamp(0.0, 1.0);
        let lifted = 0.003 * (time - 0.3).clamp(0.0, 1.0)
            + 0.03 * share.powi(3) * (10.0 - 15.0 * share + 6.0 * share * share);
        let (acceleration, frequency, at) = self.shake;
        let rate = std::f64::consts::TAU * frequency;
        let window = (std::f64::consts::PI * (time - at).clamp(0.0, 1.0)).sin().powi(2);
        lifted + acceleration / (rate * rate) * window * (rate * (time - at)).sin()
    }

    /// Sticking friction at a time.
    fn friction_at(&self, time: f64) -> f64 {
        match self.drop {
            Some((at, factor)) if time >= at => self.friction * factor,
            _ => self.friction,
        }
    }

    /// Sliding friction at a time.
    pub(crate) fn sliding_at(&self, time: f64) -> f64 {
        self.friction_at(time) * self.sliding
    }

    /// What the object needs of shear at a time, if it follows the hand.
    fn weight_at(&self, time: f64) -> f64 {
        let dt = 1e-3;
        let acceleration = (self.hand(time + dt) - 2.0 * self.hand(time) + self.hand(time - dt)) / (dt * dt);
        self.mass_at(time) * (GRAVITY + acceleration)
    }
}

/// The grasp as it moves.
#[derive(Debug, Clone)]
pub(crate) struct Grasp {
    pub(crate) truth: Truth,
    rng: Pcg64Mcg,
    pub(crate) time: f64,
    /// The gripper's normal force, and the shear.
    pub(crate) normal: f64,
    pub(crate) shear: f64,
    height: f64,
    velocity: f64,
    stretch: f64,
    /// How far the object has slid in the grip, and whether it slides now.
    pub(crate) slid: f64,
    pub(crate) slides: bool,
}

impl Grasp {
    pub(crate) fn new(truth: Truth, seed: u64) -> Self {
        Self {
            truth,
            rng: Pcg64Mcg::seed_from_u64(seed ^ 0x5bd1),
            time: 0.0,
            normal: 0.0,
            shear: 0.0,
            height: 0.0,
            velocity: 0.0,
            stretch: 0.0,
            slid: 0.0,
            slides: false,
        }
    }

    /// A step of time with this force asked of the gripper.
    pub(crate) fn step(&mut self, asked: f64) {
        let truth = &self.truth;
        self.normal += (asked - self.normal) * STEP / truth.lag;
        let (mass, friction) = (truth.mass_at(self.time), truth.friction_at(self.time));
        let hand = (truth.hand(self.time + STEP) - truth.hand(self.time)) / STEP;
        let speed = hand - self.velocity;
        let damping = 0.2 * (truth.stiffness * truth.mass[0]).sqrt();
        let stretched = self.stretch + speed * STEP;
        let trial = truth.stiffness * stretched + damping * speed;
        let held = friction * if self.slides { truth.sliding } else { 1.0 } * self.normal;
        self.slides = trial.abs() > held;
        if self.slides {
            self.shear = trial.signum() * friction * truth.sliding * self.normal;
            self.stretch = self.shear / truth.stiffness;
        } else {
            self.shear = trial;
            self.stretch = stretched;
        }
        self.slid += stretched - self.stretch;
        let (knock, at, lasts) = truth.knock;
        let phase = ((self.time - at) / lasts).clamp(0.0, 1.0);
        let knock = knock * std::f64::consts::FRAC_PI_2 / lasts * (std::f64::consts::PI * phase).sin();
        self.velocity += STEP * (self.shear / mass - GRAVITY - knock);
        self.height += self.velocity * STEP;
        if self.height <= 0.0 && self.velocity < 0.0 {
            (self.height, self.velocity) = (0.0, 0.0);
        }
        self.time += STEP;
    }

    /// The map of a picture taken now.
    pub(crate) fn picture(&mut self) -> ForceMap {
        // A sum of four draws is near enough to a normal one.
        let mut noisy = |value: f64, gain: f64| {
            let sum: f64 = (0..4).map(|_| self.rng.random_range(-1.0..1.0)).sum();
            value * gain * (1.0 + self.truth.noise * sum * 0.866)
        };
        let [of_normal, of_shear] = self.truth.gains;
        let normal = noisy(self.normal, of_normal);
        let shear = noisy(self.shear, of_shear);
        contact_map(
            normal,
            shear,
            self.normal,
            self.shear,
            self.truth.sliding_at(self.time),
            self.slides,
        )
    }

    /// The grip that this moment needs: the greater of present shear and weight over sticking friction.
    pub(crate) fn needed(&self) -> f64 {
        self.shear.max(self.truth.weight_at(self.time)) / self.truth.friction_at(self.time)
    }

    /// The load as a controller that knows everything sees it.
    pub(crate) fn load(&self) -> f64 {
        if self.height > 1e-5 {
            self.shear.max(self.truth.weight_at(self.time))
        } else {
            self.shear
        }
    }
}

/// The map of a round contact: `normal` and `shear` as measured, their distribution as the true ones make it.
pub(crate) fn contact_map(
    normal: f64,
    shear: f64,
    true_normal: f64,
    true_shear: f64,
    friction: f64,
    slides: bool,
) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    if true_normal < 0.01 {
        return map;
    }
    let radius = 2.0 + 2.0 * true_normal.cbrt();
    let used = (true_shear.abs() / (friction * true_normal)).min(1.0);
    let stuck = if slides { 0.0 } else { radius * (1.0 - used).cbrt() };
    let centre = (SIDE as f64 - 1.0) / 2.0;
    let dome = |square: f64, radius: f64| {
        if radius > 0.0 {
            (1.0 - square / (radius * radius)).max(0.0).sqrt()
        } else {
            0.0
        }
    };
    let places = || (0..SIDE * SIDE).map(|n| ((n % SIDE) as f64 - centre, (n / SIDE) as f64 - centre));
    let pressure: Vec<f64> = places().map(|(x, y)| dome(x * x + y * y, radius)).collect();
    let traction: Vec<f64> = places()
        .map(|(x, y)| {
            let square = x * x + y * y;
            dome(square, radius) - stuck / radius * dome(square, stuck)
        })
        .collect();
    let sums = [
        pressure.iter().sum::<f64>(),
        traction.iter().sum::<f64>().max(1e-9),
    ];
    let unit = f64::from(LSB_PER_NEWTON);
    for ((taxel, p), t) in map.taxels.iter_mut().zip(pressure).zip(traction) {
        *taxel = TaxelForce {
            x: 0,
            y: (shear * t / sums[1] * unit).round() as i16,
            z: (normal * p / sums[0] * unit).round() as i16,
        };
    }
    map
}
