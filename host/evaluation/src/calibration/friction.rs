//! Friction from recorded slides. Pure. Newtons, seconds.
//!
//! While the whole contact slides, every taxel carries f_T = μ f_z along the slide, so |ΣF_T| / ΣF_N is μ. A slide is an
//! interval in which that ratio stays near its maximum over the contact, in one direction, and the centre of the contact
//! carries as much as its rim: a sticking contact carries less there (Cattaneo–Mindlin). Every slide gives one estimate, the
//! median of its frames. The confidence interval is Student's t over the slides' logarithms, widened by the error that all
//! slides of one sensor share. Frames of one slide are not independent.
//! Limits: straight slides only; a rotation about the contact has no direction.

use gripline_protocol::TAXELS;

/// Minimum number of slides.
pub const SLIDES_MIN: usize = 4;
/// Minimum normal force of a contact, N.
const NORMAL_MIN_N: f64 = 0.5;
/// Taxels count from this share of the maximum normal force: below it the network's errors are as large as the force.
const LOADED: f64 = 0.2;
/// Taxels from this share of the maximum normal force are the centre of the contact.
const MIDDLE: f64 = 0.85;
/// Minimum ratio at the centre while everything slides, as a share of the whole contact's ratio.
const MIDDLE_SLIDES: f64 = 0.8;
/// A frame may slide from this share of the maximum ratio.
const NEAR: f64 = 0.9;
/// Between two slides the ratio falls below this share of the maximum.
const APART: f64 = 0.6;
/// Minimum number of frames of a slide.
const FRAMES_MIN: usize = 4;
/// Cosine of the maximum change of direction within a slide, 30°.
const STRAIGHT: f64 = 0.866;
/// Relative error of the method itself, standard deviation: on a round object the pressure tilts, and taxels cut the rim.
/// Spheres of 8 to 20 mm with exact maps give 1.1 to 1.9 % too much.
const METHOD: f64 = 0.015;
/// The detector's coefficient as a share of the interval's lower end: slipping taxels sit exactly at the true coefficient.
pub const DETECTOR_SHARE: f64 = 1.0 / 1.2;

/// What one force map tells about friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// When, s.
    pub t_s: f64,
    /// ΣF_N of the loaded taxels, N.
    pub normal_n: f64,
    /// |ΣF_T| / ΣF_N over the loaded taxels.
    pub ratio: f64,
    /// The same over the centre of the contact, along the direction of the whole.
    pub middle: f64,
    /// Unit vector of ΣF_T.
    pub direction: [f64; 2],
}

/// An interval in which the whole contact slides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slide {
    /// Its first frame, s.
    pub from_s: f64,
    /// Its last frame, s.
    pub to_s: f64,
    /// How many frames it has.
    pub frames: usize,
    /// Mean normal force, N.
    pub normal_n: f64,
    /// Median |ΣF_T| / ΣF_N.
    pub ratio: f64,
}

/// The estimate from all slides.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The friction coefficient.
    pub friction: f64,
    /// Lower end of its interval.
    pub low: f64,
    /// Upper end of its interval.
    pub high: f64,
    /// Confidence of the interval.
    pub confidence: f64,
    /// Standard deviation of the slides' estimates.
    pub between_slides: f64,
    /// Coefficient that the detector should use.
    pub detector: f64,
}

impl Moment {
    /// From a map, newtons per taxel.
    pub fn of(t_s: f64, map: &[[f64; 3]; TAXELS]) -> Self {
        let peak = map.iter().map(|force| force[2]).fold(0.0, f64::max);
        let sums = |share: f64| {
            let loaded = map
                .iter()
                .filter(|force| force[2] > 0.0 && force[2] >= share * peak);
            loaded.fold([0.0; 3], |sums, force| {
                [0, 1, 2].map(|axis| sums[axis] + force[axis])
            })
        };
        let [x, y, loaded_n] = sums(LOADED);
        let shear = x.hypot(y);
        let direction = if shear > 0.0 {
            [x / shear, y / shear]
        } else {
            [0.0; 2]
        };
        let [middle_x, middle_y, middle_n] = sums(MIDDLE);
        let over = |force: f64, normal: f64| if normal > 0.0 { force / normal } else { 0.0 };
        Self {
            t_s,
            normal_n: map.iter().map(|force| force[2]).sum(),
            ratio: over(shear, loaded_n),
            middle: over(middle_x * direction[0] + middle_y * direction[1], middle_n),
            direction,
        }
    }

    fn touches(&self) -> bool {
        self.normal_n >= NORMAL_MIN_N
    }
}

/// The slides in a recording; `moments` in order of time.
pub fn slides(moments: &[Moment]) -> Vec<Slide> {
    moments
        .chunk_by(|a, b| a.touches() == b.touches())
        .filter(|contact| contact[0].touches())
        .flat_map(slides_of_contact)
        .collect()
}

fn slides_of_contact(contact: &[Moment]) -> Vec<Slide> {
    let mut ratios: Vec<f64> = contact.iter().map(|moment| moment.ratio).collect();
    ratios.sort_by(f64::total_cmp);
    // Not the maximum: one bad map would decide.
    let greatest = ratios[(ratios.len() - 1) * 9 / 10];
    let mut slides = Vec::new();
    let mut at = 0;
    while at < contact.len() {
        if contact[at].ratio < NEAR * greatest {
            at += 1;
            continue;
        }
        let start = at;
        while at < contact.len()
            && contact[at].ratio >= APART * greatest
            && follows(&contact[start], &contact[at])
        {
            at += 1;
        }
        slides.extend(slide(&contact[start..at], greatest));
        at = at.max(start + 1);
    }
    slides
}

/// Whether two moments pull in the same direction.
fn follows(a: &Moment, b: &Moment) -> bool {
    a.direction[0] * b.direction[0] + a.direction[1] * b.direction[1] >= STRAIGHT
}

fn slide(stretch: &[Moment], greatest: f64) -> Option<Slide> {
    let sliding: Vec<&Moment> = stretch
        .iter()
        .filter(|moment| moment.ratio >= NEAR * greatest && moment.middle >= MIDDLE_SLIDES * moment.ratio)
        .collect();
    let (first, last) = (sliding.first()?, sliding.last()?);
    let mut ratios: Vec<f64> = sliding.iter().map(|moment| moment.ratio).collect();
    (ratios.len() >= FRAMES_MIN).then(|| Slide {
        from_s: first.t_s,
        to_s: last.t_s,
        frames: sliding.len(),
        normal_n: sliding.iter().map(|moment| moment.normal_n).sum::<f64>() / sliding.len() as f64,
        ratio: median(&mut ratios),
    })
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len().is_multiple_of(2) {
        0.5 * (values[half - 1] + values[half])
    } else {
        values[half]
    }
}

/// Friction from slides, with its confidence interval. `systematic` is the relative error that all slides share, standard
/// deviation; 0 for true maps.
///
/// # Errors
/// What was found and what was expected, when there are too few slides.
pub fn estimate(slides: &[Slide], confidence: f64, systematic: f64) -> Result<Estimate, String> {
    if slides.len() < SLIDES_MIN {
        return Err(format!(
            "found {} slides, expected at least {SLIDES_MIN}: press with 1 N or more, drag straight until everything slides, \
             lift, and again at another place",
            slides.len()
        ));
    }
    let count = slides.len() as f64;
    let logarithms: Vec<f64> = slides.iter().map(|slide| slide.ratio.ln()).collect();
    let mean = logarithms.iter().sum::<f64>() / count;
    let variance = logarithms.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let of_mean = variance / count;
    // Welch–Satterthwaite: the systematic part is known independently, with practically infinite degrees of freedom.
    let total = of_mean + systematic * systematic + METHOD * METHOD;
    let degrees = if of_mean > 0.0 {
        (count - 1.0) * (total / of_mean).powi(2)
    } else {
        f64::INFINITY
    };
    let reach = student_t(0.5 + 0.5 * confidence, degrees) * total.sqrt();
    let low = (mean - reach).exp();
    Ok(Estimate {
        friction: mean.exp(),
        low,
        high: (mean + reach).exp(),
        confidence,
        between_slides: variance.sqrt() * mean.exp(),
        detector: low * DETECTOR_SHARE,
    })
}

/// Quantile of Student's t, 0.5 < p < 1: the normal quantile with the Cornish–Fisher correction (Abramowitz and Stegun
/// 26.7.5), within one percent from three degrees of freedom.
pub(super) fn student_t(p: f64, degrees: f64) -> f64 {
    let z = normal_quantile(p);
    let powers: [f64; 5] = [1, 3, 5, 7, 9].map(|power| z.powi(power));
    let [z1, z3, z5, z7, z9] = powers;
    let terms = [
        (z3 + z1) / 4.0,
        (5.0 * z5 + 16.0 * z3 + 3.0 * z1) / 96.0,
        (3.0 * z7 + 19.0 * z5 + 17.0 * z3 - 15.0 * z1) / 384.0,
        (79.0 * z9 + 776.0 * z7 + 1_482.0 * z5 - 1_920.0 * z3 - 945.0 * z1) / 92_160.0,
    ];
    let series = terms.iter().rev().fold(0.0, |sum, term| (sum + term) / degrees);
    z + series
}

/// Quantile of the normal distribution, 0.5 < p < 1 (Abramowitz and Stegun 26.2.23, to 0.00045).
fn normal_quantile(p: f64) -> f64 {
    let t = (-2.0 * (1.0 - p).ln()).sqrt();
    let above = 2.515_517 + t * (0.802_853 + t * 0.010_328);
    let below = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
    t - above / below
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A round contact, pulled along x with this share of the friction limit (Cattaneo–Mindlin).
    fn contact(normal_n: f64, friction: f64, share: f64) -> [[f64; 3]; TAXELS] {
        let radius = 5.0_f64;
        let stick = radius * (1.0 - share).max(0.0).cbrt();
        let bell = |r: f64, of: f64| {
            if r < of {
                (1.0 - (r / of).powi(2)).sqrt()
            } else {
                0.0
            }
        };
        let mut map: [[f64; 3]; TAXELS] = std::array::from_fn(|at| {
            let r = ((at % 20) as f64 - 9.5).hypot((at / 20) as f64 - 9.5);
            let pressure = bell(r, radius);
            [
                friction * (pressure - stick / radius * bell(r, stick)),
                0.0,
                pressure,
            ]
        });
        let sum: f64 = map.iter().map(|force| force[2]).sum();
        for force in &mut map {
            *force = force.map(|part| part * normal_n / sum);
        }
        map
    }

    /// Repeats: press, pull until it slides and further, release.
    fn recording(friction: f64, slides: usize, max: f64) -> Vec<Moment> {
        let mut moments = Vec::new();
        for _ in 0..slides {
            for frame in 0..40 {
                let share = (f64::from(frame) / 20.0).min(max);
                let normal_n = if frame < 38 { 3.0 } else { 0.0 };
                let t_s = moments.len() as f64 / 60.0;
                moments.push(Moment::of(t_s, &contact(normal_n, friction, share)));
            }
        }
        moments
    }

    #[test]
    fn slides_are_found_and_their_ratio_is_the_friction() {
        let found = slides(&recording(0.6, 5, 1.0));
        assert_eq!(found.len(), 5, "{found:?}");
        for slide in &found {
            assert!((slide.ratio - 0.6).abs() < 0.003, "{slide:?}");
            assert!(
                (slide.normal_n - 3.0).abs() < 0.01 && slide.frames >= 16,
                "{slide:?}"
            );
        }
        let estimate = estimate(&found, 0.9, 0.0).unwrap();
        // Only the method's own error is left: 1.645 times 1.5 % to each side.
        assert!(
            (estimate.friction - 0.6).abs() < 0.003 && (estimate.high - estimate.low - 0.0296).abs() < 0.003
        );
        assert!((estimate.detector - estimate.low / 1.2).abs() < 1e-12);
    }

    #[test]
    fn a_pull_that_friction_holds_is_no_slide() {
        // A long pull at 85 % of the friction limit: F_T / F_N has a plateau, but the centre sticks.
        assert_eq!(slides(&recording(0.6, 5, 0.85)), []);
        assert_eq!(slides(&recording(0.6, 5, 0.5)), []);
        let error = estimate(&[], 0.9, 0.0).unwrap_err();
        assert!(
            error.starts_with("found 0 slides, expected at least 4"),
            "{error}"
        );
    }

    #[test]
    fn to_and_fro_in_one_contact_are_two_slides() {
        let mut moments = recording(0.5, 1, 1.0);
        moments.truncate(36);
        let back = moments.iter().rev().map(|moment| Moment {
            direction: moment.direction.map(|part| -part),
            ..*moment
        });
        let both: Vec<_> = moments.iter().copied().chain(back).collect();
        assert_eq!(slides(&both).len(), 2);
    }

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (p, degrees, expected) in [
            (0.95, f64::INFINITY, 1.6449),
            (0.975, f64::INFINITY, 1.9600),
            (0.95, 3.0, 2.3534),
            (0.95, 5.0, 2.0150),
            (0.975, 4.0, 2.7764),
            (0.975, 9.0, 2.2622),
        ] {
            let found = student_t(p, degrees);
            assert!((found / expected - 1.0).abs() < 0.012, "{p} {degrees}: {found}");
        }
    }

    #[test]
    fn the_interval_holds_the_truth_as_often_as_it_says() {
        // Slides that differ by 5 %, sensors by 3 %, the method by its own: 4,000 calibrations, normal by the sum of twelve.
        let mut state = 1_u64;
        let mut normal = || -> f64 {
            (0..12)
                .map(|_| {
                    state = state
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    (state >> 33) as f64 / f64::from(1_u32 << 31)
                })
                .sum::<f64>()
                - 6.0
        };
        for (slides, confidence, systematic) in [(4, 0.9, 0.0_f64), (6, 0.9, 0.03), (8, 0.95, 0.03)] {
            let mut held = 0;
            for _ in 0..4_000 {
                let sensor = systematic.hypot(METHOD) * normal();
                let made: Vec<Slide> = (0..slides)
                    .map(|_| Slide {
                        from_s: 0.0,
                        to_s: 1.0,
                        frames: 10,
                        normal_n: 3.0,
                        ratio: 0.65 * (sensor + 0.05 * normal()).exp(),
                    })
                    .collect();
                let estimate = estimate(&made, confidence, systematic).unwrap();
                held += u32::from(estimate.low <= 0.65 && 0.65 <= estimate.high);
            }
            let share = f64::from(held) / 4_000.0;
            // Three standard deviations of the count are 0.014.
            assert!(
                (share - confidence).abs() < 0.02,
                "{slides} slides: {share}, not {confidence}"
            );
        }
    }
}
