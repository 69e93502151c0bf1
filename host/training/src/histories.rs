//! What errors along load histories depend on, on shapes and sensors never trained on: whether more pictures of the same state, other
//! fingertips on the same state, or the states before could remove them. Units: N; errors as shares.

use gripline_network::metrics::{Pair, Scores, percentile, stick_ratio, total};
use gripline_network::{Architecture, ForceMap, NO_FORCES, Network};
use gripline_simulation::constants::REST_PICTURES;
use gripline_simulation::contact_world::Truth;
use gripline_simulation::{Fingertip, FingertipParams, Image, SampleGenerator, SampleWorld, Split};

use crate::constants::DETECTOR_FRICTION;
use crate::error::TrainingError;

/// Fingertips that touch every state.
const FINGERTIPS: usize = 6;
/// Pictures that the first of them takes of every state, each with noise of its own.
const PICTURES: usize = 8;
/// Normal load from which errors along a history count, N.
const SCORED_N: f64 = 0.5;
/// States between those whose errors are correlated.
const LAGS: [usize; 3] = [1, 2, 4];

/// Errors of one state: stick ratio, normal force over the true one, shear along x over the true normal force.
type Errors = [f64; 3];
const ERRORS: [&str; 3] = ["stick ratio", "F_N", "F_x"];

/// Plays `histories` load histories and prints the scores and what is constant in the errors.
///
/// # Errors
/// When the world or a fingertip cannot be made, or the weights cannot be used.
pub(crate) fn measure(seed: u32, histories: usize) -> Result<(), TrainingError> {
    let world = SampleWorld::new()?;
    let mut stream = SampleGenerator::new(&world, Split::Test, u64::from(seed) << 32 | 1 << 31);
    let mut fingertips = (0..FINGERTIPS as u64)
        .map(|number| Sensor::new((Split::Test as u64) << 60 | u64::from(seed) << 32 | number))
        .collect::<Result<Vec<_>, _>>()?;
    let calibration = fingertips[0].network.calibration();
    let [mut one, mut pictures, mut others] = [const { Vec::new() }; 3];
    let mut along: Vec<Vec<Errors>> = Vec::new();
    let mut gains: Vec<Vec<f64>> = vec![Vec::new(); FINGERTIPS];
    let mut begun = stream.counts().histories;
    loop {
        let Some(state) = stream.next_contact().cloned() else {
            continue;
        };
        if stream.counts().histories != begun {
            if along.len() == histories {
                break;
            }
            begun = stream.counts().histories;
            along.push(Vec::new());
        }
        let truth = state.force_map();
        let normal_n = total(&truth)[2];
        let pair = |predicted| Pair { predicted, truth };
        let maps: Vec<ForceMap> = fingertips.iter_mut().map(|sensor| sensor.sees(&state)).collect();
        one.push(pair(maps[0]));
        others.push(pair(mean(&maps)));
        let first = &mut fingertips[0];
        let again: Vec<ForceMap> = (1..PICTURES)
            .map(|_| first.sees(&state))
            .chain([maps[0]])
            .collect();
        pictures.push(pair(mean(&again)));
        if normal_n < SCORED_N {
            continue;
        }
        for (map, gains) in maps.iter().zip(&mut gains) {
            gains.push(total(map)[2] / normal_n - 1.0);
        }
        let ratio = |map: &ForceMap, friction| stick_ratio(map, calibration.contact_min_n, friction).0;
        let predicted = ratio(&maps[0], calibration.friction).unwrap_or(0.0);
        if let (Some(true_ratio), Some(errors)) = (ratio(&truth, DETECTOR_FRICTION), along.last_mut()) {
            let [x, _, z] = [0, 1, 2].map(|k| (total(&maps[0])[k] - total(&truth)[k]) / normal_n);
            errors.push([predicted - true_ratio, z, x]);
        }
    }
    println!(
        "{} states of {histories} histories\n{:26}{}",
        one.len(),
        "",
        Scores::LINE_HEADER
    );
    for (name, pairs) in [
        ("one picture".to_owned(), &one),
        (format!("mean of {PICTURES} pictures"), &pictures),
        (format!("mean of {FINGERTIPS} fingertips"), &others),
    ] {
        println!("{name:26}{}", Scores::new(pairs, calibration).to_line());
    }
    for (error, name) in ERRORS.into_iter().enumerate() {
        let steady = Steadiness::of(&along, error);
        println!(
            "error of {name}: RMS {:.3}, correlation with that {} states before {}, its history's mean explains {:.0} %",
            steady.rms,
            LAGS.map(|lag| lag.to_string()).join(", "),
            steady.correlations.map(|value| format!("{value:.2}")).join(", "),
            100.0 * steady.share_of_mean,
        );
    }
    for (number, gains) in gains.into_iter().enumerate() {
        let gain = gains.iter().sum::<f64>() / gains.len() as f64;
        let left = gains.iter().map(|off| ((1.0 + off) / (1.0 + gain) - 1.0).abs());
        println!(
            "fingertip {number}: F_N off by {:+.1} % on average; median error {:.1} %, without that gain {:.1} %",
            100.0 * gain,
            100.0 * percentile(gains.iter().map(|off| off.abs()).collect(), 0.5),
            100.0 * percentile(left.collect(), 0.5),
        );
    }
    Ok(())
}

/// A virtual fingertip with a network of its own.
struct Sensor {
    fingertip: Fingertip,
    network: Network,
    crop: Image,
}

impl Sensor {
    fn new(unit: u64) -> Result<Self, TrainingError> {
        let mut fingertip = Fingertip::new(unit, FingertipParams::of_sensor(unit))?;
        let mut network = Network::embedded(Architecture::Tracked)?;
        network.set_rest(&fingertip.mean_rest_image(REST_PICTURES).pixels);
        Ok(Self {
            fingertip,
            network,
            crop: Image::crop(),
        })
    }

    /// The map of a new picture of this state, N per taxel.
    fn sees(&mut self, state: &Truth) -> ForceMap {
        self.fingertip.render(state, &mut self.crop);
        let mut map = NO_FORCES;
        self.network.infer(&self.crop.pixels, &mut map);
        map
    }
}

/// How much of an error stays along the histories of two states and more.
struct Steadiness {
    /// Root mean square, a share as the error itself.
    rms: f64,
    /// With the error [`LAGS`] states before, over the mean square: 1 stays, 0 comes anew.
    correlations: [f64; LAGS.len()],
    /// Share of the mean square that the means over the histories explain: 1 stays, one over the states of a history comes anew.
    share_of_mean: f64,
}

impl Steadiness {
    fn of(along: &[Vec<Errors>], error: usize) -> Self {
        let histories: Vec<Vec<f64>> = along
            .iter()
            .filter(|history| history.len() > 1)
            .map(|history| history.iter().map(|errors| errors[error]).collect())
            .collect();
        let count = histories.iter().map(Vec::len).sum::<usize>() as f64;
        let square = histories.iter().flatten().map(|off| off * off).sum::<f64>() / count;
        let correlations = LAGS.map(|lag| {
            let products: Vec<f64> = histories
                .iter()
                .flat_map(|history| history.iter().zip(history.iter().skip(lag)).map(|(a, b)| a * b))
                .collect();
            products.iter().sum::<f64>() / products.len() as f64 / square
        });
        let of_means: f64 = histories
            .iter()
            .map(|history| history.iter().sum::<f64>().powi(2) / history.len() as f64)
            .sum();
        Self {
            rms: square.sqrt(),
            correlations,
            share_of_mean: of_means / count / square,
        }
    }
}

/// Taxel by taxel, N.
fn mean(maps: &[ForceMap]) -> ForceMap {
    std::array::from_fn(|taxel| {
        [0, 1, 2].map(|k| maps.iter().map(|map| map[taxel][k]).sum::<f32>() / maps.len() as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_that_stays_is_told_from_one_that_comes_anew_with_every_state() {
        let alike: Vec<Vec<Errors>> = (0..200)
            .map(|history| vec![[if history % 2 == 0 { 0.1 } else { -0.1 }; 3]; 8])
            .collect();
        let stays = Steadiness::of(&alike, 0);
        assert!((stays.rms - 0.1).abs() < 1e-12 && (stays.share_of_mean - 1.0).abs() < 1e-12);
        assert!(stays.correlations.iter().all(|value| (value - 1.0).abs() < 1e-12));
        // Drawn once: the test repeats.
        let mut rng = crate::rng::Rng::new(3);
        let signs: Vec<Vec<Errors>> = (0..200)
            .map(|_| {
                (0..8)
                    .map(|_| [if rng.below(2) == 0 { 0.1 } else { -0.1 }; 3])
                    .collect()
            })
            .collect();
        let anew = Steadiness::of(&signs, 0);
        assert!(anew.share_of_mean < 0.3, "{}", anew.share_of_mean);
        assert!(
            anew.correlations.iter().all(|value| value.abs() < 0.2),
            "{:?}",
            anew.correlations
        );
    }
}
