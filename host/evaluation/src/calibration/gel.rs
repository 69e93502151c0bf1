//! How stiff a gel really is, from a ball pressed with known forces: gains of normal force and shear, modulus, offset, creep. Pure.
//! Newtons, seconds, mm.
//!
//! A linear gel that is softer than its description by a factor shows forces too large by that factor, everywhere and at any load;
//! one that is thinner, by a factor for shear and another for pressure. So two gains bring a model's maps to newtons. Each press
//! counts once: its frames are not independent. Intervals are Student's t over presses; errors are of presses (of days, where there
//! are several) that the gains were not fitted to. Limits: presses up to what the model's world has, a fifth of the thickness for a
//! third of them; what a gain cannot mend (distortion of the lens) stays.

use gripline_protocol::{SIDE, TAXELS};

use super::friction::student_t;

/// Minimum number of presses: fewer give no interval.
pub const PRESSES_MIN: usize = 4;
/// Minimum normal force of a contact as the model has it, N.
const NORMAL_MIN_N: f64 = 0.1;
/// Minimum number of maps of a press.
const FRAMES_MIN: usize = 4;
/// A press is steady from this share of its maximum on.
const STEADY: f64 = 0.8;
/// Taxels count for the place from this share of the maximum normal force on.
const LOADED: f64 = 0.2;
/// Added to a force that errors are relative to, N.
const FLOOR_N: f64 = 0.1;
/// Smallest shear that tells of its gain, share of the normal force.
const SHEAR_MIN: f64 = 0.1;
/// Seconds by which a log of forces may be early or late, and the steps of the search.
const LAG_MAX_S: f64 = 5.0;
const LAG_STEP_S: f64 = 0.02;
/// Least correlation of the log's normal force with the maps'.
const LIKENESS_MIN: f64 = 0.8;
/// Gains that no gel has.
const GAIN: [f64; 2] = [0.1, 10.0];
/// Largest error of held-out presses, median share: more means that readings and presses do not belong together.
pub const ERROR_MAX: f64 = 0.3;

/// What a map says before the calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// When, s.
    pub t_s: f64,
    /// ΣF, N: x, y, normal.
    pub raw_n: [f64; 3],
    /// Centre of pressure of the loaded taxels, taxels from the map's centre.
    pub place: [f64; 2],
}

impl Moment {
    /// From a map, newtons per taxel.
    #[must_use]
    pub fn of(t_s: f64, map: &[[f64; 3]; TAXELS]) -> Self {
        let peak = map.iter().map(|force| force[2]).fold(0.0, f64::max);
        let middle = (SIDE as f64 - 1.0) / 2.0;
        let (mut raw_n, mut place, mut loaded) = ([0.0; 3], [0.0; 2], 0.0);
        for (taxel, force) in map.iter().enumerate() {
            raw_n = [0, 1, 2].map(|axis| raw_n[axis] + force[axis]);
            if force[2] > 0.0 && force[2] >= LOADED * peak {
                let at = [taxel % SIDE, taxel / SIDE].map(|at| at as f64 - middle);
                place = [0, 1].map(|axis| place[axis] + force[2] * at[axis]);
                loaded += force[2];
            }
        }
        Self {
            t_s,
            raw_n,
            place: place.map(|sum| if loaded > 0.0 { sum / loaded } else { 0.0 }),
        }
    }
}

/// One press, steady for a while.
#[derive(Debug, Clone, PartialEq)]
pub struct Press {
    /// From its first steady map to its last, s.
    pub span_s: [f64; 2],
    /// Steady maps.
    pub frames: usize,
    /// Mean ΣF of them before the calibration, N.
    pub raw_n: [f64; 3],
    /// Mean place, taxels from the map's centre.
    pub place: [f64; 2],
    /// Growth of the normal force from the first quarter of the steady maps to the last, share per decade of time since the
    /// touch; `None` of a short one.
    pub creep: Option<f64>,
    /// Which recording.
    pub day: usize,
}

/// The presses of a recording, in order of time.
#[must_use]
pub fn presses(moments: &[Moment], day: usize) -> Vec<Press> {
    moments
        .split(|moment| moment.raw_n[2] < NORMAL_MIN_N)
        .filter_map(|contact| {
            let peak = contact.iter().map(|moment| moment.raw_n[2]).fold(0.0, f64::max);
            let is_steady = |moment: &&Moment| moment.raw_n[2] >= STEADY * peak;
            let steady: Vec<&Moment> = contact.iter().filter(is_steady).collect();
            let (first, last) = (steady.first()?, steady.last()?);
            let mean = |of: &dyn Fn(&Moment) -> f64, among: &[&Moment]| {
                among.iter().map(|moment| of(moment)).sum::<f64>() / among.len() as f64
            };
            let quarter = steady.len() / 4;
            let creep = (quarter >= FRAMES_MIN).then(|| {
                let touched_s = contact[0].t_s;
                let [early, late] = [&steady[..quarter], &steady[steady.len() - quarter..]];
                let time = |among: &[&Moment]| mean(&|moment| moment.t_s - touched_s, among).max(1e-3);
                let force = |among: &[&Moment]| mean(&|moment| moment.raw_n[2], among);
                (force(late) / force(early) - 1.0) / (time(late) / time(early)).log10().max(1e-3)
            });
            (steady.len() >= FRAMES_MIN).then(|| Press {
                span_s: [first.t_s, last.t_s],
                frames: steady.len(),
                raw_n: [0, 1, 2].map(|axis| mean(&|moment| moment.raw_n[axis], &steady)),
                place: [0, 1].map(|axis| mean(&|moment| moment.place[axis], &steady)),
                creep,
                day,
            })
        })
        .collect()
}

/// A force-torque sensor's log: when, and the force on the gel along its own x, y, z, N.
pub type ForceLog = [(f64, [f64; 3])];

/// How a log stands to the maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// How much later its clock is, s.
    pub lag_s: f64,
    /// Which of its axes (0 to 2 for x to z) is the gel's normal; it may point into the gel or out of it.
    pub normal: usize,
    /// What it shows while nothing presses, N: its own offset, and what the mount weighs.
    pub tare_n: [f64; 3],
}

/// Finds how a log stands to the maps: the gel's normal is the axis along which its force changes most, and its clock is where that
/// force rises and falls with the maps' normal force. `lag_s` is the clock, where it is known.
///
/// # Errors
/// Says so when it does nowhere.
pub fn align(moments: &[Moment], log: &ForceLog, lag_s: Option<f64>) -> Result<Alignment, String> {
    let (Some(first), Some(last)) = (moments.first(), moments.last()) else {
        return Err("found no maps".to_owned());
    };
    let span = last.t_s - first.t_s;
    // A pull along the gel is less than the press that holds it.
    let spread = |axis: usize| {
        let mean = log.iter().map(|(_, force)| force[axis]).sum::<f64>() / log.len().max(1) as f64;
        log.iter()
            .map(|(_, force)| (force[axis] - mean).powi(2))
            .sum::<f64>()
    };
    let normal = (0..3)
        .max_by(|a, b| spread(*a).total_cmp(&spread(*b)))
        .unwrap_or_default();
    let likeness = |lag: f64| {
        let steps = (span / LAG_STEP_S).ceil().clamp(1.0, 20_000.0) as usize;
        let mut sums = [0.0; 6];
        for step in 0..steps {
            let t = first.t_s + span * step as f64 / steps as f64;
            let (a, Some(force)) = (at(moments, t), force_at(log, t + lag)) else {
                continue;
            };
            let b = force[normal];
            for (sum, value) in sums.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
                *sum += value;
            }
        }
        let [n, a, b, aa, bb, ab] = sums;
        let spread = ((aa - a * a / n) * (bb - b * b / n)).sqrt();
        let common = n * LAG_STEP_S / span;
        if common >= 0.5 && spread > 0.0 {
            (((ab - a * b / n) / spread).abs(), common.min(1.0))
        } else {
            (0.0, 0.0)
        }
    };
    // Clocks may begin anywhere: first brought to the same start.
    let start = log.first().map_or(0.0, |(t, _)| *t) - first.t_s;
    let steps = (LAG_MAX_S / LAG_STEP_S) as i32;
    let around = |lag: f64| (-steps..=steps).map(move |step| lag + f64::from(step) * LAG_STEP_S);
    let lags: Vec<f64> = lag_s.map_or_else(|| around(start).chain(around(0.0)).collect(), |lag| vec![lag]);
    // Presses follow each other evenly, so a few of them fit many lags: the more of the recording a lag explains, the better.
    let best = lags
        .into_iter()
        .map(|lag| (likeness(lag), lag))
        .max_by(|(a, _), (b, _)| (a.0 * a.1).total_cmp(&(b.0 * b.1)))
        .map(|((found, _), lag)| (found, lag));
    match best {
        Some((found, lag_s)) if found > LIKENESS_MIN => Ok(Alignment {
            lag_s,
            normal,
            tare_n: tare(moments, log, lag_s),
        }),
        found => Err(format!(
            "no force of the log follows the maps' normal force: a correlation of {:.2} at best, expected above {LIKENESS_MIN}: is it \
             of this recording, and newtons along x, y and z?",
            found.map_or(0.0, |(found, _)| found)
        )),
    }
}

/// Median of the log's forces while the maps show nothing, N.
fn tare(moments: &[Moment], log: &ForceLog, lag_s: f64) -> [f64; 3] {
    let empty: Vec<[f64; 3]> = moments
        .iter()
        .filter(|moment| moment.raw_n[2] < NORMAL_MIN_N)
        .filter_map(|moment| force_at(log, moment.t_s + lag_s))
        .collect();
    if empty.is_empty() {
        return [0.0; 3];
    }
    [0, 1, 2].map(|axis| median(empty.iter().map(|force| force[axis]).collect()))
}

fn at(moments: &[Moment], t: f64) -> f64 {
    let after = moments.partition_point(|moment| moment.t_s < t);
    moments[after.min(moments.len() - 1)].raw_n[2]
}

fn force_at(log: &ForceLog, t: f64) -> Option<[f64; 3]> {
    let after = log.partition_point(|(time, _)| *time < t);
    let ((t0, a), (t1, b)) = (log.get(after.checked_sub(1)?)?, log.get(after)?);
    let part = (t - t0) / (t1 - t0).max(1e-9);
    Some([0, 1, 2].map(|axis| a[axis] + part * (b[axis] - a[axis])))
}

/// What the log says of each press, in the maps' frame: without its tare, its normal axis as z into the gel, and turned about it so
/// that shears agree. Returns the forces and the turn, rad.
///
/// # Errors
/// Names a press that the log does not cover.
pub fn logged(
    presses: &[Press],
    log: &ForceLog,
    alignment: &Alignment,
) -> Result<(Vec<[f64; 3]>, f64), String> {
    let Alignment {
        lag_s,
        normal,
        tare_n,
    } = *alignment;
    let mut forces = Vec::new();
    for (number, press) in presses.iter().enumerate() {
        let [from, to] = press.span_s.map(|t| t + lag_s);
        let inside: Vec<&[f64; 3]> = log
            .iter()
            .filter(|(t, _)| (from..=to).contains(t))
            .map(|(_, force)| force)
            .collect();
        if inside.is_empty() {
            return Err(format!(
                "press {}: the log has no line from {from:.2} to {to:.2} s",
                number + 1
            ));
        }
        let mean = |axis: usize| inside.iter().map(|force| force[axis]).sum::<f64>() / inside.len() as f64;
        // In the round, so that a right-handed frame stays one.
        forces.push([1, 2, 3].map(|step| {
            let axis = (normal + step) % 3;
            mean(axis) - tare_n[axis]
        }));
    }
    let down: f64 = forces.iter().map(|force| force[2]).sum();
    if down < 0.0 {
        // Looking the other way along x: a right-handed frame stays one.
        for force in &mut forces {
            *force = [force[0], -force[1], -force[2]];
        }
    }
    let (mut along, mut across) = (0.0, 0.0);
    for (press, force) in presses.iter().zip(&forces) {
        along += force[0] * press.raw_n[0] + force[1] * press.raw_n[1];
        across += force[0] * press.raw_n[1] - force[1] * press.raw_n[0];
    }
    let turn = across.atan2(along);
    let (sin, cos) = turn.sin_cos();
    for force in &mut forces {
        *force = [
            cos * force[0] - sin * force[1],
            sin * force[0] + cos * force[1],
            force[2],
        ];
    }
    Ok((forces, turn))
}

/// A number and its interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The best value.
    pub value: f64,
    /// Lower and upper end.
    pub interval: [f64; 2],
}

/// The gel.
#[derive(Debug, Clone, PartialEq)]
pub struct GelFit {
    /// Factor on normal force.
    pub normal: Measured,
    /// Factor on shear; `None` where no press had any.
    pub shear: Option<Measured>,
    /// What the calibrated normal force is too large by where nothing presses, N.
    pub offset_n: Measured,
    /// Growth per decade of time under a load that stays, share; `None` where no press is long enough.
    pub creep: Option<Measured>,
    /// Confidence of the intervals.
    pub confidence: f64,
    /// Error of each press's normal force with gains fitted to the others (the other days), N.
    pub held_out_n: Vec<f64>,
    /// The same of shear, where it was measured, N.
    pub held_out_shear_n: Vec<Option<f64>>,
}

impl GelFit {
    /// Median of the held-out errors over the forces, share.
    #[must_use]
    pub fn held_out_share(&self, truth: &[[f64; 3]]) -> f64 {
        let shares = self.held_out_n.iter().zip(truth);
        median(shares.map(|(error, truth)| error / truth[2]).collect())
    }

    /// Factors on shear and normal force, as a model takes them. Without measured shear it is taken for as soft as pressure.
    #[must_use]
    pub fn gains(&self) -> [f64; 2] {
        [
            self.shear.map_or(self.normal.value, |shear| shear.value),
            self.normal.value,
        ]
    }
}

/// Fits presses to what truly pressed; a truth without shear has zeros and `has_shear` false.
///
/// # Errors
/// Says what is wrong: too few presses, other presses than forces, or a gel that no gain explains.
pub fn fit(
    presses: &[Press],
    truth: &[[f64; 3]],
    has_shear: bool,
    confidence: f64,
) -> Result<GelFit, String> {
    if presses.len() != truth.len() {
        let loads: Vec<String> = presses
            .iter()
            .map(|press| format!("{:.2}", press.raw_n[2]))
            .collect();
        return Err(format!(
            "found {} presses (before the calibration {} N), expected {}, one for each reading: each must be held for a second \
             and released; leave out readings of presses that are not there",
            presses.len(),
            loads.join(", "),
            truth.len()
        ));
    }
    if presses.len() < PRESSES_MIN {
        return Err(format!(
            "found {} presses, expected at least {PRESSES_MIN}",
            presses.len()
        ));
    }
    let normal: Vec<(f64, f64)> = presses
        .iter()
        .zip(truth)
        .map(|(press, truth)| (press.raw_n[2], truth[2]))
        .collect();
    let gain = measured(&normal, confidence);
    if !(GAIN[0]..=GAIN[1]).contains(&gain.value) {
        return Err(format!(
            "found a normal force {:.2} times the maps', expected {} to {}: are the readings newtons (--unit)?",
            gain.value, GAIN[0], GAIN[1]
        ));
    }
    let sheared: Vec<bool> = truth
        .iter()
        .map(|[x, y, z]| has_shear && x.hypot(*y) >= SHEAR_MIN * z)
        .collect();
    // Along the true shear, so that noise across it does not count.
    let along = |press: &Press, [x, y, _]: &[f64; 3]| {
        let length = x.hypot(*y);
        ((press.raw_n[0] * x + press.raw_n[1] * y) / length, length)
    };
    let shears = |wanted: &dyn Fn(usize) -> bool| -> Vec<(f64, f64)> {
        let all = presses.iter().zip(truth).enumerate();
        all.filter(|(at, _)| sheared[*at] && wanted(*at))
            .map(|(_, (press, truth))| along(press, truth))
            .collect()
    };
    let every = shears(&|_| true);
    let shear = (every.len() >= PRESSES_MIN).then(|| measured(&every, confidence));
    let has_days = presses.iter().any(|press| press.day != presses[0].day);
    let group = |at: usize| if has_days { presses[at].day } else { at };
    let without = |pairs: &[(usize, (f64, f64))], own: usize| {
        slope(
            pairs
                .iter()
                .filter(|(at, _)| group(*at) != own)
                .map(|(_, pair)| *pair),
        )
    };
    let numbered: Vec<(usize, (f64, f64))> = normal.iter().copied().enumerate().collect();
    let numbered_shear: Vec<(usize, (f64, f64))> = (0..presses.len())
        .filter(|at| sheared[*at])
        .map(|at| (at, along(&presses[at], &truth[at])))
        .collect();
    let held_out_n = (0..presses.len())
        .map(|at| (without(&numbered, group(at)) * normal[at].0 - normal[at].1).abs())
        .collect();
    let held_out_shear_n = (0..presses.len())
        .map(|at| {
            (shear.is_some() && sheared[at]).then(|| {
                let gain = without(&numbered_shear, group(at));
                let [x, y, _] = presses[at].raw_n;
                (gain * x - truth[at][0]).hypot(gain * y - truth[at][1])
            })
        })
        .collect();
    let fit = GelFit {
        normal: gain,
        shear,
        offset_n: offset(&normal, confidence),
        creep: mean_of(
            &presses.iter().filter_map(|press| press.creep).collect::<Vec<_>>(),
            confidence,
        ),
        confidence,
        held_out_n,
        held_out_shear_n,
    };
    let share = fit.held_out_share(truth);
    if share > ERROR_MAX {
        return Err(format!(
            "presses that were left out are off by {:.0} % in the median, expected at most {:.0} %: do presses and forces belong \
             together, in this order?",
            100.0 * share,
            100.0 * ERROR_MAX
        ));
    }
    Ok(fit)
}

/// Errors of presses that nothing was fitted to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOut {
    /// Median, N.
    pub median_n: f64,
    /// Largest, N.
    pub largest_n: f64,
    /// Median of the errors over the normal forces.
    pub median_share: f64,
}

impl HeldOut {
    /// Of some presses' errors, N.
    #[must_use]
    pub fn of(errors_n: &[f64], truth: &[[f64; 3]], presses: &[usize]) -> Self {
        let errors = || presses.iter().map(|at| errors_n[*at]);
        Self {
            median_n: median(errors().collect()),
            largest_n: errors().fold(0.0, f64::max),
            median_share: median(presses.iter().map(|at| errors_n[*at] / truth[*at][2]).collect()),
        }
    }
}

/// Places nearer to the middle than this are its inner half, taxels.
const INNER: f64 = 4.0;

/// Names of the groups that errors are given for, by load, place and recording, and the presses in each; none is empty.
#[must_use]
pub fn groups(presses: &[Press], truth: &[[f64; 3]]) -> Vec<(String, Vec<usize>)> {
    let mut loads: Vec<f64> = truth.iter().map(|force| force[2]).collect();
    loads.sort_by(f64::total_cmp);
    let Some(third) = loads.get(loads.len() / 3) else {
        return Vec::new();
    };
    let two_thirds = loads[2 * loads.len() / 3];
    let among =
        |wanted: &dyn Fn(usize) -> bool| (0..presses.len()).filter(|at| wanted(*at)).collect::<Vec<_>>();
    let off = |at: usize| presses[at].place[0].hypot(presses[at].place[1]);
    let mut groups = vec![
        (
            format!("load below {third:.2} N"),
            among(&|at| truth[at][2] < *third),
        ),
        (
            format!("load {third:.2} to {two_thirds:.2} N"),
            among(&|at| (*third..two_thirds).contains(&truth[at][2])),
        ),
        (
            format!("load from {two_thirds:.2} N"),
            among(&|at| truth[at][2] >= two_thirds),
        ),
        ("place: inner half".to_owned(), among(&|at| off(at) < INNER)),
        ("place: outer half".to_owned(), among(&|at| off(at) >= INNER)),
    ];
    let days = presses.iter().map(|press| press.day).max().unwrap_or(0) + 1;
    if days > 1 {
        let of = |day: usize| {
            (
                format!("recording {}", day + 1),
                among(&|at| presses[at].day == day),
            )
        };
        groups.extend((0..days).map(of));
    }
    groups.retain(|(_, members)| !members.is_empty());
    groups
}

/// The slope through the origin that makes relative errors small.
fn slope(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut top, mut bottom) = (0.0, 0.0);
    for (raw, truth) in pairs {
        let weight = (truth + FLOOR_N).powi(-2);
        top += weight * raw * truth;
        bottom += weight * raw * raw;
    }
    top / bottom.max(1e-12)
}

fn measured(pairs: &[(f64, f64)], confidence: f64) -> Measured {
    let value = slope(pairs.iter().copied());
    let (mut squares, mut bottom) = (0.0, 0.0);
    for (raw, truth) in pairs {
        let weight = (truth + FLOOR_N).powi(-2);
        squares += weight * (truth - value * raw).powi(2);
        bottom += weight * raw * raw;
    }
    let degrees = (pairs.len() - 1).max(1) as f64;
    let reach = student_t(0.5 + 0.5 * confidence, degrees) * (squares / degrees / bottom.max(1e-12)).sqrt();
    Measured {
        value,
        interval: [value - reach, value + reach],
    }
}

/// Where a straight line through the presses meets no force; raw forces over it are too large.
fn offset(pairs: &[(f64, f64)], confidence: f64) -> Measured {
    let mut sums = [0.0; 5];
    for (raw, truth) in pairs {
        let weight = (truth + FLOOR_N).powi(-2);
        for (sum, value) in sums.iter_mut().zip([1.0, *raw, *truth, raw * raw, raw * truth]) {
            *sum += weight * value;
        }
    }
    let [n, x, y, xx, xy] = sums;
    let spread = (n * xx - x * x).max(1e-12);
    let (gain, value) = ((n * xy - x * y) / spread, (y * xx - x * xy) / spread);
    let squares: f64 = pairs
        .iter()
        .map(|(raw, truth)| ((truth - value - gain * raw) / (truth + FLOOR_N)).powi(2))
        .sum();
    let degrees = (pairs.len() - 2).max(1) as f64;
    let reach = student_t(0.5 + 0.5 * confidence, degrees) * (squares / degrees * xx / spread).sqrt();
    Measured {
        value: -value,
        interval: [-value - reach, -value + reach],
    }
}

fn mean_of(values: &[f64], confidence: f64) -> Option<Measured> {
    let count = values.len() as f64;
    if values.len() < 3 {
        return None;
    }
    let value = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|other| (other - value).powi(2)).sum::<f64>() / (count - 1.0);
    let reach = student_t(0.5 + 0.5 * confidence, count - 1.0) * (variance / count).sqrt();
    Some(Measured {
        value,
        interval: [value - reach, value + reach],
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten presses whose model is wrong by known gains; `creep` per decade.
    fn recording(gains: [f64; 2], creep: f64) -> (Vec<Moment>, Vec<[f64; 3]>) {
        let (mut moments, mut truth) = (Vec::new(), Vec::new());
        let mut t_s = 0.0;
        for press in 0..10 {
            let normal = 0.4 + 0.3 * f64::from(press);
            let force = [
                0.3 * normal,
                if press % 2 == 0 { 0.1 } else { -0.1 } * normal,
                normal,
            ];
            truth.push(force);
            let wrong = 1.0 + 0.02 * (f64::from(press) * 2.4).sin();
            for step in 0..60 {
                let since: f64 = 0.05 * f64::from(step);
                let on = if (5..50).contains(&step) { 1.0 } else { 0.0 };
                let grown = 1.0 + creep * (since / 0.3).max(1.0).log10();
                moments.push(Moment {
                    t_s,
                    raw_n: [
                        on * wrong * force[0] / gains[0],
                        on * wrong * force[1] / gains[0],
                        on * wrong * grown * force[2] / gains[1],
                    ],
                    place: [f64::from(press) - 4.0, 1.0],
                });
                t_s += 0.05;
            }
        }
        (moments, truth)
    }

    #[test]
    fn gains_are_found_with_intervals_that_hold_them_and_errors_of_what_was_left_out() {
        let (moments, truth) = recording([0.6, 0.45], 0.0);
        let presses = presses(&moments, 0);
        assert_eq!(presses.len(), 10);
        let fit = fit(&presses, &truth, true, 0.9).unwrap();
        for (found, expected) in [(fit.normal, 0.45), (fit.shear.unwrap(), 0.6)] {
            assert!((found.value / expected - 1.0).abs() < 0.02, "{found:?}");
            assert!(
                found.interval[0] < expected && expected < found.interval[1],
                "{found:?}"
            );
        }
        assert!(fit.held_out_share(&truth) < 0.03);
        assert!(
            fit.offset_n.interval[0] < 0.0 && fit.offset_n.interval[1] > 0.0,
            "{:?}",
            fit.offset_n
        );
    }

    #[test]
    fn a_recording_alone_is_left_out_press_by_press_whatever_its_number() {
        let (moments, truth) = recording([0.6, 0.45], 0.0);
        let of = |day| fit(&presses(&moments, day), &truth, true, 0.9);
        assert_eq!(of(1), of(0));
    }

    #[test]
    fn creep_is_growth_under_a_load_that_stays() {
        let (moments, truth) = recording([1.0, 1.0], 0.05);
        let creep = fit(&presses(&moments, 0), &truth, true, 0.9)
            .unwrap()
            .creep
            .unwrap();
        assert!((creep.value - 0.05).abs() < 0.02, "{creep:?}");
    }

    #[test]
    fn a_log_with_another_clock_and_another_frame_is_brought_to_the_maps() {
        let (moments, truth) = recording([0.5, 0.5], 0.0);
        // The log turned by 90°, looking up, 1.3 s late.
        let log: Vec<(f64, [f64; 3])> = moments
            .iter()
            .enumerate()
            .map(|(at, moment)| {
                let force = if moment.raw_n[2] > 0.0 {
                    truth[at / 60]
                } else {
                    [0.0; 3]
                };
                (moment.t_s + 1.3, [force[1], force[0], -force[2]])
            })
            .collect();
        let alignment = align(&moments, &log, None).unwrap();
        assert!((alignment.lag_s - 1.3).abs() < 0.05, "{alignment:?}");
        assert_eq!(align(&moments, &log, Some(1.3)).unwrap().normal, 2);
        let presses = presses(&moments, 0);
        let agrees = |log: &ForceLog, alignment: &Alignment| {
            let (forces, _) = logged(&presses, log, alignment).unwrap();
            for (found, expected) in forces.iter().zip(&truth) {
                assert!(
                    (0..3).all(|axis| (found[axis] - expected[axis]).abs() < 0.08),
                    "{found:?} {expected:?}"
                );
            }
        };
        agrees(&log, &alignment);
        // A sensor that lies on its side, and carries the weight of its mount.
        let aside: Vec<(f64, [f64; 3])> = log
            .iter()
            .map(|(t, [x, y, z])| (*t, [z + 4.0, x - 1.5, y + 0.5]))
            .collect();
        let found = align(&moments, &aside, None).unwrap();
        assert_eq!(found.normal, 0);
        assert!((found.tare_n[0] - 4.0).abs() < 1e-6, "{found:?}");
        agrees(&aside, &found);
        // Presses alike except for the last: a log that is shifted by some of them fits half of the recording as well.
        let even: Vec<Moment> = moments
            .iter()
            .map(|moment| Moment {
                raw_n: moment
                    .raw_n
                    .map(|force| if moment.t_s < 24.0 { force.signum() } else { force }),
                ..*moment
            })
            .collect();
        let even_log: Vec<(f64, [f64; 3])> = even
            .iter()
            .map(|moment| (moment.t_s + 0.4, moment.raw_n))
            .collect();
        let found = align(&even, &even_log, None).unwrap();
        assert!((found.lag_s - 0.4).abs() < 0.05, "{found:?}");
        let other: Vec<(f64, [f64; 3])> = log
            .iter()
            .map(|(t, _)| (*t, [0.0, 0.0, (t * 7.0).sin()]))
            .collect();
        assert!(
            align(&moments, &other, None)
                .unwrap_err()
                .contains("expected above 0.8")
        );
    }

    #[test]
    fn readings_that_do_not_belong_to_the_presses_are_refused() {
        let (moments, truth) = recording([1.0, 1.0], 0.0);
        let presses = presses(&moments, 0);
        let said = |truth: &[[f64; 3]]| fit(&presses, truth, false, 0.9).unwrap_err();
        assert!(said(&truth[..7]).contains("found 10 presses"));
        let backwards: Vec<[f64; 3]> = truth.iter().rev().copied().collect();
        assert!(said(&backwards).contains("belong together"));
        let grams: Vec<[f64; 3]> = truth.iter().map(|force| force.map(|n| n * 102.0)).collect();
        assert!(said(&grams).contains("newtons"));
    }
}
