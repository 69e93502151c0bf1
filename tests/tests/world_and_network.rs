//! The simulated world against the network that was trained in it, on patterns and contacts it has never seen, and
//! the two crates' views of the same picture. The bounds are about a quarter above what the committed weights reach
//! (`gripline-training evaluate` prints the figures); they guard against a broken world, network or weights file.

use gripline_network::{ForceNetwork, downsample_440_to_88};
use gripline_simulation::{Image, Sample, SampleGenerator, SampleWorld, Split, block_mean_88};

/// A stream that no report of the trainer uses: those have the user's seed in the upper 32 bits.
const UNSEEN_SEED: u64 = 0x7E57_0000_0000;
const SAMPLES: usize = 400;

/// Shapes and sensors that the committed weights were not trained on.
fn unseen(seed: u64) -> SampleGenerator {
    SampleGenerator::new(&SampleWorld::new().unwrap(), Split::Test, seed)
}

fn totals(map: &[[f32; 3]; 400]) -> [f64; 3] {
    map.iter().fold([0.0; 3], |sum, force| {
        core::array::from_fn(|axis| sum[axis] + f64::from(force[axis]))
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// (true, predicted) for samples with at least half a newton of normal force.
fn predictions() -> Vec<(Sample, Box<[[f32; 3]; 400]>)> {
    let mut network = ForceNetwork::embedded().unwrap();
    let mut out = Vec::new();
    for sample in unseen(UNSEEN_SEED).take(SAMPLES) {
        let mut map = Box::new([[0.0; 3]; 400]);
        network.set_rest(&sample.rest);
        network.infer(&sample.now, &mut map);
        if totals(&sample.forces)[2] >= 0.5 {
            out.push((sample, map));
        }
    }
    assert!(out.len() > SAMPLES / 2);
    out
}

#[test]
fn the_committed_network_finds_total_forces_in_pictures_it_has_never_seen() {
    let predictions = predictions();
    let normal = median(
        predictions
            .iter()
            .map(|(sample, map)| {
                let (truth, found) = (totals(&sample.forces)[2], totals(map)[2]);
                (found - truth).abs() / truth
            })
            .collect(),
    );
    let shear = median(
        predictions
            .iter()
            .filter_map(|(sample, map)| {
                let ([tx, ty, tz], [x, y, _]) = (totals(&sample.forces), totals(map));
                let truth = tx.hypot(ty);
                (truth > 0.1 * tz).then(|| (x - tx).hypot(y - ty) / truth)
            })
            .collect(),
    );
    println!(
        "F_N error {:.1} % median, F_T vector error {:.1} % median",
        normal * 100.0,
        shear * 100.0
    );
    assert!(normal < 0.07, "normal force is off by {:.1} %", normal * 100.0);
    assert!(shear < 0.16, "shear is off by {:.1} %", shear * 100.0);
}

#[test]
fn a_picture_without_contact_is_a_map_without_force() {
    let mut network = ForceNetwork::embedded().unwrap();
    let contact_min_n = network.calibration().contact_min_n;
    let untouched = unseen(UNSEEN_SEED + 1).filter(|sample| totals(&sample.forces)[2] == 0.0);
    for sample in untouched.take(10) {
        let mut map = [[0.0; 3]; 400];
        network.set_rest(&sample.rest);
        network.infer(&sample.now, &mut map);
        let contact = map.iter().filter(|force| force[2] > contact_min_n).count();
        assert!(contact <= 1, "{contact} taxels in contact where nothing touches");
    }
}

#[test]
fn both_crates_downsample_the_same_picture_alike() {
    let mut picture = Image::crop();
    for (n, pixel) in picture.pixels.iter_mut().enumerate() {
        *pixel = (n * n % 251 + n / 440 % 5) as u8;
    }
    let mut small = [0; 88 * 88];
    downsample_440_to_88(&picture.pixels, &mut small);
    assert_eq!(block_mean_88(&picture.pixels)[..], small[..]);
}
