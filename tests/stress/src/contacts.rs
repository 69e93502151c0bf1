//! Contacts in closed form: Hertz's pressure with Cattaneo and Mindlin's shear under a pull, and the like under a torsional moment.
//! Units: newtons, millimetres, radians. Limits: pull and torsional moment are mixed by direction only; as test loads that is enough.

use std::f64::consts::TAU;

use gripline_protocol::constants::TAXEL_PITCH_MM;
use gripline_protocol::{SIDE, TAXELS};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Forces on every taxel, newtons.
pub(crate) type Newtons = [[f64; 3]; TAXELS];

/// A round contact under load.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contact {
    pub(crate) centre_mm: [f64; 2],
    pub(crate) radius_mm: f64,
    /// On the taxel in the middle.
    pub(crate) peak_n: f64,
    /// The skin's.
    pub(crate) friction: f64,
    /// Load over the load that makes it slip: from 1 on it slips as a whole.
    pub(crate) share: f64,
    /// Of the pull.
    pub(crate) way_rad: f64,
    /// 0: a pull, 1: a torsional moment.
    pub(crate) torsion_share: f64,
}

impl Contact {
    /// Somewhere, of some size, loaded somehow.
    pub(crate) fn random(random: &mut Pcg64Mcg) -> Self {
        let radius_mm = random.random_range(2.0..12.0);
        let room = 15.0 - radius_mm;
        Self {
            centre_mm: [
                random.random_range(-room..=room),
                random.random_range(-room..=room),
            ],
            radius_mm,
            peak_n: 0.02 * 100.0_f64.powf(random.random_range(0.0..1.0)),
            friction: random.random_range(0.5..1.0),
            share: random.random_range(0.0..1.05),
            way_rad: random.random_range(0.0..TAU),
            torsion_share: if random.random_bool(0.5) {
                0.0
            } else {
                random.random_range(0.0..1.0)
            },
        }
    }

    /// Its forces.
    pub(crate) fn newtons(&self) -> Newtons {
        let mut newtons = [[0.0; 3]; TAXELS];
        // Radius of what sticks, over the contact's.
        let stuck = (1.0 - self.share.min(1.0)).cbrt();
        for (taxel, force) in newtons.iter_mut().enumerate() {
            let [x, y] = at_mm(taxel);
            let (x, y) = (x - self.centre_mm[0], y - self.centre_mm[1]);
            let r = x.hypot(y) / self.radius_mm;
            if r >= 1.0 {
                continue;
            }
            let pressure = (1.0 - r * r).sqrt();
            let held = if r < stuck {
                stuck * (1.0 - (r / stuck).powi(2)).sqrt()
            } else {
                0.0
            };
            let shear_n = self.friction * self.peak_n * (pressure - held);
            let round = y.atan2(x) + TAU / 4.0;
            let pull = [
                (1.0 - self.torsion_share) * self.way_rad.cos(),
                (1.0 - self.torsion_share) * self.way_rad.sin(),
            ];
            let way = [
                pull[0] + self.torsion_share * round.cos(),
                pull[1] + self.torsion_share * round.sin(),
            ];
            let length = way[0].hypot(way[1]).max(1e-12);
            *force = [
                shear_n * way[0] / length,
                shear_n * way[1] / length,
                self.peak_n * pressure,
            ];
        }
        newtons
    }
}

/// Where a taxel's centre is.
pub(crate) fn at_mm(taxel: usize) -> [f64; 2] {
    let middle = (SIDE as f64 - 1.0) / 2.0;
    [
        ((taxel % SIDE) as f64 - middle) * TAXEL_PITCH_MM,
        ((taxel / SIDE) as f64 - middle) * TAXEL_PITCH_MM,
    ]
}

/// `count` taxels in contact with random forces near the friction cone, the middle ones first.
pub(crate) fn of_size(count: usize, peak_n: f64, friction: f64, random: &mut Pcg64Mcg) -> Newtons {
    let mut order: Vec<usize> = (0..TAXELS).collect();
    order.sort_by(|one, other| {
        let far = |taxel: usize| at_mm(taxel)[0].hypot(at_mm(taxel)[1]);
        far(*one).total_cmp(&far(*other))
    });
    let mut newtons = [[0.0; 3]; TAXELS];
    for taxel in order.into_iter().take(count) {
        let z = peak_n * random.random_range(0.2..1.0);
        let shear = friction * z * random.random_range(0.6..1.4);
        let way = random.random_range(0.0..TAU);
        newtons[taxel] = [shear * way.cos(), shear * way.sin(), z];
    }
    newtons
}
