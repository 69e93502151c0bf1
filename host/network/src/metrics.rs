//! How good predicted maps are, as the detector and the reports see them; for training and benchmarks. Pure arithmetic over
//! pairs of maps in newtons. Taxel errors and stick ratios count samples of at least half a newton.

use serde::Serialize;

use crate::constants::{
    CONTACT_MINS_N, DETECTOR_FRICTION, SCORED_NORMAL_N, SCORED_SHEAR_N, SCORED_TAXELS, TAXELS,
};
use crate::force_map::{Calibration, ForceMap};

/// Predicted and true map of one sample.
#[derive(Debug, Clone)]
pub struct Pair {
    /// The network's map, newtons per taxel.
    pub predicted: ForceMap,
    /// The true map, newtons per taxel.
    pub truth: ForceMap,
}

/// The paper's stick ratio with a contact threshold, |{f_T ≤ μ f_z}| / |{f_z > contact_min}| (`None` without contact), and
/// the number of taxels in contact.
#[must_use]
pub fn stick_ratio(map: &ForceMap, contact_min_n: f32, friction: f32) -> (Option<f64>, usize) {
    let (mut contact, mut stick) = (0, 0);
    for [x, y, z] in map {
        if *z > contact_min_n {
            contact += 1;
            stick += usize::from(x * x + y * y <= friction * friction * z * z);
        }
    }
    ((contact > 0).then(|| stick as f64 / contact as f64), contact)
}

/// Stick ratios (predicted, true) of the pairs whose true map has enough taxels in contact. The true map uses the paper's
/// friction; a predicted map without contact has ratio 0.
fn stick_ratios<'a>(
    pairs: impl IntoIterator<Item = &'a Pair>,
    contact_min_n: f32,
    friction: f32,
) -> Vec<(f64, f64)> {
    pairs
        .into_iter()
        .filter_map(|pair| {
            let (truth, contact) = stick_ratio(&pair.truth, contact_min_n, DETECTOR_FRICTION);
            let (predicted, _) = stick_ratio(&pair.predicted, contact_min_n, friction);
            truth
                .filter(|_| contact >= SCORED_TAXELS)
                .map(|truth| (predicted.unwrap_or(0.0), truth))
        })
        .collect()
}

/// The pairs of at least half a newton.
fn loaded(pairs: &[Pair]) -> Vec<&Pair> {
    let strong = |pair: &&Pair| total(&pair.truth)[2] >= f64::from(SCORED_NORMAL_N);
    pairs.iter().filter(strong).collect()
}

/// Chooses the detector's contact threshold and friction: for every threshold the friction that removes the bias of the
/// stick ratio, then the threshold with the smallest error.
#[must_use]
pub fn calibrate(pairs: &[Pair]) -> Calibration {
    let loaded = loaded(pairs);
    let mut best = (
        f64::INFINITY,
        Calibration {
            contact_min_n: 0.02,
            friction: DETECTOR_FRICTION,
        },
    );
    for contact_min_n in CONTACT_MINS_N {
        let scored = |friction: f32| stick_ratios(loaded.iter().copied(), contact_min_n, friction);
        let bias = |ratios: &[(f64, f64)]| mean(ratios.iter().map(|(predicted, truth)| predicted - truth));
        // The ratio grows with the friction, so the bias has one zero; steps of 0.0025 around 0.45.
        let Some((friction, ratios)) = (140..=200)
            .map(|step| step as f32 * 0.0025)
            .map(|friction| (friction, scored(friction)))
            .min_by(|(_, a), (_, b)| bias(a).abs().total_cmp(&bias(b).abs()))
        else {
            continue;
        };
        let error = mean(ratios.iter().map(|(predicted, truth)| (predicted - truth).abs()));
        if error < best.0 {
            best = (
                error,
                Calibration {
                    contact_min_n,
                    friction,
                },
            );
        }
    }
    best.1
}

/// Scores of a network. Serialises to JSON under the field names; a mean over no samples is NaN (`null`).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scores {
    /// Pairs scored.
    pub samples: usize,
    /// Σ(error²)/Σ(truth²) per sample, mean over samples in contact.
    pub relative_squared_error: f64,
    /// RMSE of x, y, z over samples of at least half a newton, newtons per taxel.
    pub rmse_n: [f64; 3],
    /// The same relative to the 99th percentile of the component's magnitude.
    pub rmse_of_p99: [f64; 3],
    /// Relative error of the total normal force: median.
    pub total_normal_error_median: f64,
    /// The same: 95th percentile.
    pub total_normal_error_p95: f64,
    /// Error of the total shear vector relative to its length: median.
    pub shear_error_median: f64,
    /// The same: 95th percentile.
    pub shear_error_p95: f64,
    /// Mean absolute error of the stick ratio with the calibrated threshold and friction.
    pub stick_ratio_mae: f64,
    /// Mean error of the stick ratio; positive predicts more sticking than there is.
    pub stick_ratio_bias: f64,
    /// Mean absolute error of the stick ratio without calibrated friction.
    pub stick_ratio_mae_uncalibrated: f64,
    /// Share of samples whose decision SR < 0.5 equals the true map's.
    pub slip_agreement: f64,
    /// The same without calibrated friction.
    pub slip_agreement_uncalibrated: f64,
    /// Share of samples whose true map slips.
    pub slip_share: f64,
    /// Mean absolute total normal force of samples without contact, newtons.
    pub untouched_normal_n: f64,
}

impl Scores {
    /// Scores of these pairs with this calibration.
    #[must_use]
    pub fn new(pairs: &[Pair], calibration: Calibration) -> Self {
        let Calibration {
            contact_min_n,
            friction,
        } = calibration;
        let (mut relative, mut normal, mut shear, mut untouched) = (vec![], vec![], vec![], vec![]);
        for pair in pairs {
            let (truth, predicted) = (total(&pair.truth), total(&pair.predicted));
            if pair.truth.as_flattened().iter().all(|&force| force == 0.0) {
                untouched.push(predicted[2].abs());
                continue;
            }
            relative.push(squares(differences(pair)) / squares(pair.truth.as_flattened().iter().copied()));
            if truth[2] > f64::from(SCORED_NORMAL_N) {
                normal.push((predicted[2] - truth[2]).abs() / truth[2]);
                let length = truth[0].hypot(truth[1]);
                if length > f64::from(SCORED_SHEAR_N) {
                    shear.push((predicted[0] - truth[0]).hypot(predicted[1] - truth[1]) / length);
                }
            }
        }
        let loaded = loaded(pairs);
        let component = |component: usize| {
            let taxels = || {
                loaded
                    .iter()
                    .flat_map(move |pair| pair.truth.iter().zip(&pair.predicted))
            };
            let error = taxels().map(|(truth, predicted)| predicted[component] - truth[component]);
            let rmse = (squares(error) / (loaded.len() * TAXELS) as f64).sqrt();
            let magnitudes = taxels()
                .map(|(truth, _)| f64::from(truth[component].abs()))
                .collect();
            (rmse, rmse / percentile(magnitudes, 0.99))
        };
        let components = [0, 1, 2].map(component);
        let ratios = stick_ratios(loaded.iter().copied(), contact_min_n, friction);
        let uncalibrated = stick_ratios(loaded.iter().copied(), contact_min_n, DETECTOR_FRICTION);
        let absolute =
            |ratios: &[(f64, f64)]| mean(ratios.iter().map(|(predicted, truth)| (predicted - truth).abs()));
        let share = |ratios: &[(f64, f64)], on: fn(&(f64, f64)) -> bool| {
            ratios.iter().filter(|ratios| on(ratios)).count() as f64 / ratios.len() as f64
        };
        let agrees = |(predicted, truth): &(f64, f64)| (*predicted < 0.5) == (*truth < 0.5);
        Self {
            samples: pairs.len(),
            relative_squared_error: mean(relative.into_iter()),
            rmse_n: components.map(|(rmse, _)| rmse),
            rmse_of_p99: components.map(|(_, share)| share),
            total_normal_error_median: percentile(normal.clone(), 0.5),
            total_normal_error_p95: percentile(normal, 0.95),
            shear_error_median: percentile(shear.clone(), 0.5),
            shear_error_p95: percentile(shear, 0.95),
            stick_ratio_mae: absolute(&ratios),
            stick_ratio_bias: mean(ratios.iter().map(|(predicted, truth)| predicted - truth)),
            stick_ratio_mae_uncalibrated: absolute(&uncalibrated),
            slip_agreement: share(&ratios, agrees),
            slip_agreement_uncalibrated: share(&uncalibrated, agrees),
            slip_share: share(&ratios, |(_, truth)| *truth < 0.5),
            untouched_normal_n: mean(untouched.into_iter()),
        }
    }

    /// The main scores in a line, under [`Self::LINE_HEADER`].
    #[must_use]
    pub fn to_line(&self) -> String {
        format!(
            "{:7} {:7.1} % {:7.1} % {:9.3} {:8.1} %",
            self.samples,
            100.0 * self.total_normal_error_median,
            100.0 * self.shear_error_median,
            self.stick_ratio_mae,
            100.0 * self.slip_agreement
        )
    }

    /// The column heads of [`Self::to_line`].
    pub const LINE_HEADER: &str = "samples       F_N       F_T  SR error  SR < 0.5";

    /// The scores as a table, one measure a line.
    #[must_use]
    pub fn to_table(&self) -> String {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let pair = |median, p95| format!("{} median, {} p95", percent(median), percent(p95));
        let milli = self.rmse_n.map(|rmse| format!("{:.2}", 1e3 * rmse)).join(", ");
        let shares = self.rmse_of_p99.map(percent).join(", ");
        [
            ("samples", self.samples.to_string()),
            (
                "relative squared error",
                format!("{:.4}", self.relative_squared_error),
            ),
            (
                "taxel RMSE x, y, z",
                format!("{milli} mN ({shares} of the 99th percentile)"),
            ),
            (
                "total normal force error",
                pair(self.total_normal_error_median, self.total_normal_error_p95),
            ),
            (
                "total shear vector error",
                pair(self.shear_error_median, self.shear_error_p95),
            ),
            (
                "stick ratio error",
                format!("{:.3} mean absolute", self.stick_ratio_mae),
            ),
            ("  bias", format!("{:+.3}", self.stick_ratio_bias)),
            (
                "  with friction 0.45",
                format!("{:.3} mean absolute", self.stick_ratio_mae_uncalibrated),
            ),
            ("SR < 0.5 as the true map", percent(self.slip_agreement)),
            ("  with friction 0.45", percent(self.slip_agreement_uncalibrated)),
            ("  samples that slip", percent(self.slip_share)),
            (
                "untouched normal force",
                format!("{:.3} N mean absolute", self.untouched_normal_n),
            ),
        ]
        .map(|(name, value)| format!("{name:26}{value}\n"))
        .concat()
    }
}

/// The sum of a map's forces along x, y, z, N.
#[must_use]
pub fn total(map: &ForceMap) -> [f64; 3] {
    [0, 1, 2].map(|component| map.iter().map(|force| f64::from(force[component])).sum())
}

fn differences(pair: &Pair) -> impl Iterator<Item = f32> {
    pair.predicted
        .as_flattened()
        .iter()
        .zip(pair.truth.as_flattened())
        .map(|(predicted, truth)| predicted - truth)
}

fn squares(values: impl Iterator<Item = f32>) -> f64 {
    values.map(|value| f64::from(value) * f64::from(value)).sum()
}

/// NaN for nothing.
fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

/// The value below which the share `q`, 0 to 1, lies (nearest rank); NaN for nothing.
#[must_use]
pub fn percentile(mut values: Vec<f64>, q: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let rank = ((values.len() - 1) as f64 * q).round() as usize;
    *values.select_nth_unstable_by(rank, f64::total_cmp).1
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "zeros and ratios of counts are exact")]
mod tests {
    use super::*;

    const CALIBRATION: Calibration = Calibration {
        contact_min_n: 0.02,
        friction: 0.45,
    };

    /// 100 loaded taxels, the first `sliding` of them beyond friction 0.45.
    fn map(sliding: usize, scale: f32) -> ForceMap {
        std::array::from_fn(|i| match i {
            i if i >= 100 => [0.0; 3],
            i if i < sliding => [0.06 * scale, 0.0, 0.1 * scale],
            _ => [0.02 * scale, 0.0, 0.1 * scale],
        })
    }

    #[test]
    fn perfect_maps_score_perfectly() {
        let pairs = [0, 40, 60].map(|n| Pair {
            predicted: map(n, 1.0),
            truth: map(n, 1.0),
        });
        let scores = Scores::new(&pairs, CALIBRATION);
        assert_eq!(scores.relative_squared_error, 0.0);
        assert_eq!([scores.total_normal_error_p95, scores.shear_error_p95], [0.0; 2]);
        assert_eq!([scores.stick_ratio_mae, scores.slip_agreement], [0.0, 1.0]);
        assert!((scores.slip_share - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_map_ten_percent_too_strong_errs_by_ten_percent_and_keeps_its_stick_ratio() {
        let pairs = [Pair {
            predicted: map(30, 1.1),
            truth: map(30, 1.0),
        }];
        let scores = Scores::new(&pairs, CALIBRATION);
        for median in [scores.total_normal_error_median, scores.shear_error_median] {
            assert!((median - 0.1).abs() < 1e-5, "{median}");
        }
        assert!((scores.relative_squared_error - 0.01).abs() < 1e-6);
        assert_eq!(scores.stick_ratio_mae, 0.0);
    }

    #[test]
    fn too_little_predicted_sliding_is_a_positive_bias_that_calibration_removes() {
        // A taxel beyond 0.45 in truth is predicted at 0.44: friction must go below that.
        let smooth = |map: ForceMap| map.map(|[x, y, z]| [x.min(0.44 * z), y, z]);
        let pairs: Vec<Pair> = (10..90)
            .map(|n| Pair {
                predicted: smooth(map(n, 1.0)),
                truth: map(n, 1.0),
            })
            .collect();
        let before = Scores::new(&pairs, CALIBRATION);
        assert!(before.stick_ratio_bias > 0.4);
        let calibration = calibrate(&pairs);
        assert!(calibration.friction < 0.44, "{calibration:?}");
        let after = Scores::new(&pairs, calibration);
        assert_eq!([after.stick_ratio_bias, after.stick_ratio_mae], [0.0, 0.0]);
        assert_eq!(after.stick_ratio_mae_uncalibrated, before.stick_ratio_mae);
    }

    #[test]
    fn an_untouched_sample_is_scored_by_the_force_it_invents() {
        let pairs = vec![
            Pair {
                predicted: map(0, 0.01),
                truth: [[0.0; 3]; 400],
            },
            Pair {
                predicted: map(0, 1.0),
                truth: map(0, 1.0),
            },
        ];
        assert!((Scores::new(&pairs, CALIBRATION).untouched_normal_n - 0.1).abs() < 1e-6);
    }
}
