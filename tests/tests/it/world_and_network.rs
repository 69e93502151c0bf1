//! The simulated world against the network that was trained in it, on patterns and contacts it has never seen, and
//! the two crates' views of the same picture. The bounds are about a quarter above what the committed weights reach
//! (`gripline-training evaluate` prints the figures); they guard against a broken world, network or weights file.

use gripline_network::unet::UnetNetwork;
use gripline_network::{Architecture, ForceMap, Network, downsample_440_to_88};
use gripline_simulation::{Image, SampleGenerator, SampleWorld, Split, block_mean_88};

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

/// A sample, and what the networks make of its camera images, in the order of [`Architecture::ALL`].
struct Seen {
    truth: ForceMap,
    found: Vec<ForceMap>,
}

/// Samples with at least half a newton of normal force.
fn seen() -> Vec<Seen> {
    let mut networks = Architecture::ALL.map(|architecture| Network::embedded(architecture).unwrap());
    let mut seen = Vec::new();
    let mut sensor = None;
    for sample in unseen(UNSEEN_SEED).with_crops().take(SAMPLES) {
        let crops = sample.crops.unwrap();
        let fresh = sensor.replace(sample.sensor) != Some(sample.sensor);
        let find = |network: &mut Network| {
            let mut map = [[0.0; 3]; 400];
            if fresh {
                network.set_rest(&crops.rest.pixels);
            }
            network.infer(&crops.now.pixels, &mut map);
            map
        };
        let found: Vec<ForceMap> = networks.iter_mut().map(find).collect();
        if totals(&sample.forces)[2] >= 0.5 {
            seen.push(Seen {
                truth: sample.forces,
                found,
            });
        }
    }
    assert!(seen.len() > SAMPLES / 2);
    seen
}

#[test]
fn the_committed_networks_find_total_forces_in_pictures_they_have_never_seen() {
    let seen = seen();
    for (index, (architecture, max_normal, max_shear)) in [
        (Architecture::Unet, 0.07, 0.16),
        (Architecture::Tracked, 0.04, 0.1),
    ]
    .into_iter()
    .enumerate()
    {
        let pairs = || {
            seen.iter()
                .map(|seen| (totals(&seen.truth), totals(&seen.found[index])))
        };
        let normal = median(
            pairs()
                .map(|(truth, found)| (found[2] - truth[2]).abs() / truth[2])
                .collect(),
        );
        let shear = median(
            pairs()
                .filter(|([x, y, z], _)| x.hypot(*y) > 0.1 * z)
                .map(|(truth, found)| {
                    (found[0] - truth[0]).hypot(found[1] - truth[1]) / truth[0].hypot(truth[1])
                })
                .collect(),
        );
        println!(
            "{architecture}: F_N error {:.1} % median, F_T vector error {:.1} % median",
            normal * 100.0,
            shear * 100.0
        );
        assert!(
            normal < max_normal,
            "{architecture}: normal force is off by {:.1} %",
            normal * 100.0
        );
        assert!(
            shear < max_shear,
            "{architecture}: shear is off by {:.1} %",
            shear * 100.0
        );
    }
}

#[test]
fn a_picture_without_contact_is_a_map_without_force() {
    let mut network = UnetNetwork::embedded().unwrap();
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
