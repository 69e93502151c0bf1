//! The tracking network: its forces against the training framework's, skipping against computing everything, allocations,
//! and weights files. Pictures are dots drawn here: this crate knows no simulation.

use gripline_network::scene::Health;
use gripline_network::tracked::{
    GRID_CHANNELS, GRID_NODES, Lens, Track, TrackedNetwork, TrackedWeights, Tracker, empty_grid,
};
use gripline_network::unet::UnetWeights;
use gripline_network::{
    Architecture, Evaluation, InstructionSet, NO_FORCES, Network, NetworkError, Precision,
};

use crate::{
    Rng, TRACKED, TRACKED_GOLDEN, UNET, bits, golden_forces, golden_tensor, relative_difference, sets,
};

/// Steps of a golden grid per millimetre.
const GRID_STEPS: f32 = 16_384.0;
const SIDE: usize = 440;

/// Dots on a dark ground with a little noise. Where `push` is not 0 they are moved: most in the middle of the image, by
/// so many pixels, and there more or less by their depth.
fn picture(dots: usize, push: [f32; 2], noise_seed: u64) -> Vec<u8> {
    let mut levels = vec![14.0_f32; SIDE * SIDE];
    let mut rng = Rng(5);
    for _ in 0..dots {
        let [x, y] = [0, 1].map(|_| rng.unit() * SIDE as f32);
        let (share, level) = (0.2 + 0.6 * rng.unit(), 70.0 + 80.0 * rng.unit());
        let far = ((x - 230.0).powi(2) + (y - 200.0).powi(2)) / (2.0 * 60.0 * 60.0);
        let [u, v] = push.map(|push| push * share * (-far).exp());
        let (x, y) = (x + u, y + v);
        for row in (y - 5.0).max(0.0) as usize..((y + 5.0) as usize).min(SIDE) {
            for column in (x - 5.0).max(0.0) as usize..((x + 5.0) as usize).min(SIDE) {
                let [dx, dy] = [column as f32 + 0.5 - x, row as f32 + 0.5 - y];
                let cover = (-(dx * dx + dy * dy) / (2.0 * 1.2 * 1.2)).exp();
                let pixel = &mut levels[row * SIDE + column];
                *pixel += cover * (level - *pixel).max(0.0);
            }
        }
    }
    let mut rng = Rng(noise_seed);
    levels
        .into_iter()
        .map(|level| (level + 4.0 * (rng.unit() - 0.5)).round() as u8)
        .collect()
}

fn embedded() -> TrackedNetwork {
    TrackedNetwork::embedded().unwrap()
}

#[test]
fn the_embedded_network_agrees_with_the_training_framework_on_every_instruction_set() {
    let grids: Vec<i16> = golden_tensor(TRACKED_GOLDEN, "grid")
        .as_chunks()
        .0
        .iter()
        .map(|b| i16::from_le_bytes(*b))
        .collect();
    let forces = golden_forces(TRACKED_GOLDEN);
    let samples = grids.chunks_exact(GRID_CHANNELS * GRID_NODES).zip(&forces);
    assert!(samples.len() >= 4);
    for set in sets() {
        let mut network = embedded().with_instructions(set).unwrap();
        for (precision, bound) in [(Precision::F32, 1e-4), (Precision::Int16, 1e-3)] {
            network = network.with_precision(precision);
            let mut most = 0.0_f32;
            for (sample, (stored, expected)) in samples.clone().enumerate() {
                let mut grid = empty_grid();
                for (value, &step) in grid.as_flattened_mut().iter_mut().zip(stored) {
                    *value = f32::from(step) / GRID_STEPS;
                }
                let mut out = NO_FORCES;
                network.infer_grid(&grid, &mut out);
                let off = relative_difference(&out, expected);
                assert!(off <= bound, "{set}, {precision:?}, sample {sample}: {off}");
                most = most.max(off);
            }
            println!("{set}, {precision:?}: off by {most:.2e} of the largest force at most");
        }
    }
}

#[test]
fn skipping_gives_the_same_bits_as_computing_everything_wherever_the_picture_changes() {
    let rest = picture(2500, [0.0; 2], 1);
    let pressed = [
        picture(2500, [3.0, 1.0], 2),
        picture(2500, [11.0, -6.0], 3),
        rest.clone(),
    ];
    let mut skip = embedded().with_evaluation(Evaluation::Skip);
    let mut dense = embedded().with_evaluation(Evaluation::Dense);
    skip.set_rest(&rest);
    dense.set_rest(&rest);
    let mut shown = rest.clone();
    let mut rng = Rng(17);
    let mut different = 0;
    let mut before = NO_FORCES;
    for frame in 0..60 {
        // A rectangle from one pixel to everything, from one of the pictures; now and then nothing.
        if frame % 10 != 9 {
            let from = &pressed[rng.below(3)];
            let (top, left) = (rng.below(SIDE), rng.below(SIDE));
            let (rows, columns) = (1 + rng.below(SIDE - top), 1 + rng.below(SIDE - left));
            for row in top..top + rows {
                let pixels = row * SIDE + left..row * SIDE + left + columns;
                shown[pixels.clone()].copy_from_slice(&from[pixels]);
            }
        }
        let (mut skipped, mut full) = (NO_FORCES, NO_FORCES);
        skip.infer(&shown, &mut skipped);
        dense.infer(&shown, &mut full);
        assert!(bits(&skipped) == bits(&full), "frame {frame}");
        assert_eq!(skip.particles(), dense.particles(), "frame {frame}");
        different += usize::from(bits(&full) != bits(&before));
        before = full;
    }
    assert!(different > 40, "only {different} frames changed anything");
}

#[test]
fn the_threads_of_a_pool_share_a_picture_and_find_the_same_bits() {
    let rest = picture(2500, [0.0; 2], 1);
    let small = {
        let (mut changed, from) = (rest.clone(), picture(2500, [3.0, 1.0], 2));
        changed[200 * SIDE..240 * SIDE].copy_from_slice(&from[200 * SIDE..240 * SIDE]);
        changed
    };
    let shown = [
        picture(2500, [3.0, 1.0], 2),
        small,
        picture(2500, [11.0, -6.0], 3),
    ];
    let forces = || {
        let mut network = embedded();
        network.set_rest(&rest);
        let infer = |now: &Vec<u8>| {
            let mut out = NO_FORCES;
            network.infer(now, &mut out);
            (bits(&out), network.particles())
        };
        shown.iter().map(infer).collect::<Vec<_>>()
    };
    let alone = forces();
    assert!(alone[0] != alone[1] && alone[1] != alone[2]);
    for threads in [1, 2, 5] {
        let pool = rayon_core::ThreadPoolBuilder::new().num_threads(threads).build();
        assert!(pool.unwrap().install(forces) == alone, "{threads} threads");
    }
}

#[test]
fn single_changed_pixels_anywhere_are_not_missed() {
    let rest = picture(2500, [0.0; 2], 1);
    let mut shown = picture(2500, [6.0, 2.0], 2);
    let mut rng = Rng(3);
    let (mut skip, mut dense) = (Tracker::new(), Tracker::new());
    skip.set_rest(&rest);
    dense.set_rest(&rest);
    for _ in 0..40 {
        // A spot that outshines what was there.
        let (row, column) = (1 + rng.below(SIDE - 2), 1 + rng.below(SIDE - 2));
        for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            shown[(row + dy) * SIDE + column + dx] ^= 0xC0;
        }
        skip.track(&shown);
        dense.invalidate();
        dense.track(&shown);
        assert!(skip.tracks() == dense.tracks(), "({row}, {column})");
    }
}

#[test]
fn a_small_part_that_changes_among_large_motions_is_followed_as_if_everything_were() {
    let rest = picture(2500, [0.0; 2], 1);
    let moved = [[0.4, 0.1], [3.0, 1.0], [7.0, -9.0], [-14.0, 4.0]].map(|push| picture(2500, push, 2));
    let mut shown = moved[1].clone();
    let mut rng = Rng(29);
    let (mut skip, mut dense) = (Tracker::new(), Tracker::new());
    skip.set_rest(&rest);
    dense.set_rest(&rest);
    for frame in 0..80 {
        let from = &moved[rng.below(4)];
        let (rows, columns) = (1 + rng.below(70), 1 + rng.below(70));
        let (top, left) = (rng.below(SIDE - rows), rng.below(SIDE - columns));
        for row in top..top + rows {
            let pixels = row * SIDE + left..row * SIDE + left + columns;
            shown[pixels.clone()].copy_from_slice(&from[pixels]);
        }
        skip.track(&shown);
        dense.invalidate();
        dense.track(&shown);
        assert!(
            skip.tracks() == dense.tracks(),
            "frame {frame}: {rows} rows from {top}, {columns} columns from {left}"
        );
    }
}

#[test]
fn every_instruction_set_follows_particles_alike_bit_by_bit() {
    let rest = picture(2500, [0.0; 2], 1);
    let mut trackers: Vec<Tracker> = sets()
        .map(|set| Tracker::new().with_instructions(set).unwrap())
        .collect();
    for (push, noise_seed) in [
        ([0.0; 2], 2),
        ([3.0, -1.0], 3),
        ([11.0, 14.0], 4),
        ([-25.0, 3.0], 5),
    ] {
        let now = picture(2500, push, noise_seed);
        for tracker in &mut trackers {
            tracker.set_rest(&rest);
            tracker.track(&now);
        }
        let (first, others) = trackers.split_first().unwrap();
        assert!(first.tracks().iter().any(|track| track.confidence > 0.0));
        for other in others {
            assert!(other.tracks() == first.tracks(), "pushed by {push:?}");
        }
    }
}

#[test]
fn dots_that_do_not_move_are_found_where_they_were_and_moved_ones_where_they_went() {
    let rest = picture(1200, [0.0; 2], 1);
    let mut tracker = Tracker::new();
    tracker.set_rest(&rest);
    assert!(
        (700..1200).contains(&tracker.particles().len()),
        "{}",
        tracker.particles().len()
    );
    assert!(tracker.track(&picture(1200, [0.0; 2], 2)));
    for track in tracker.tracks() {
        let [x, y] = track.motion_px;
        assert!(track.confidence > 0.9 && x.hypot(y) < 0.2, "{track:?}");
    }
    // The whole picture two pixels to the right and one down.
    let moved: Vec<u8> = (0..SIDE * SIDE)
        .map(|i| rest[(i / SIDE).saturating_sub(1) * SIDE + (i % SIDE).saturating_sub(2)])
        .collect();
    tracker.track(&moved);
    let kept = tracker.tracks().iter().filter(|track| track.confidence > 0.0);
    let right = |t: &&Track| (t.motion_px[0] - 2.0).hypot(t.motion_px[1] - 1.0) < 0.05;
    assert!(kept.clone().count() > tracker.particles().len() * 95 / 100);
    assert!(kept.clone().filter(right).count() == kept.count());
}

#[test]
fn a_black_picture_loses_every_particle_and_a_black_rest_image_has_none() {
    let mut network = embedded();
    network.set_rest(&picture(2500, [0.0; 2], 1));
    let mut out = NO_FORCES;
    network.infer(&vec![0; SIDE * SIDE], &mut out);
    let (particles, lost) = network.particles();
    assert!(particles > 1000 && lost == particles, "{lost} of {particles}");
    assert_eq!(network.health(), Health::PARTICLES_LOST);
    network.infer(&picture(2500, [3.0, 1.0], 2), &mut out);
    assert_eq!(network.health(), Health::GOOD);
    network.set_rest(&vec![0; SIDE * SIDE]);
    network.infer(&picture(2500, [0.0; 2], 1), &mut out);
    assert_eq!(network.particles(), (0, 0));
    assert_eq!(network.health(), Health::PARTICLES_LOST);
    assert!(out.as_flattened().iter().all(|force| force.is_finite()));
}

#[test]
fn a_frame_allocates_nothing() {
    let rest = picture(2500, [0.0; 2], 1);
    let mut now = picture(2500, [4.0, 2.0], 2);
    for evaluation in [Evaluation::Dense, Evaluation::Skip] {
        let mut network = embedded().with_evaluation(evaluation);
        network.set_rest(&rest);
        let mut out = NO_FORCES;
        let counted = allocation_counter::measure(|| {
            network.infer(&now, &mut out);
            network.infer(&now, &mut out);
            now[40_000] ^= 1;
            network.infer(&now, &mut out);
        });
        assert_eq!(counted.count_total, 0, "{evaluation:?}");
    }
}

#[test]
#[should_panic(expected = "the camera crop has 7744 bytes, expected 440 x 440")]
fn a_picture_of_another_size_is_refused() {
    embedded().infer(&[0; 7744], &mut NO_FORCES.clone());
}

#[test]
fn a_written_file_reads_back_the_same_and_is_small() {
    let good = TrackedWeights::parse(TRACKED).unwrap();
    assert_eq!(TrackedWeights::parse(&good.to_bytes()).unwrap(), good);
    assert!(TRACKED.len() < 4_000_000);
    let Lens {
        base_mm,
        thickness_mm,
        ..
    } = good.lens;
    assert!(base_mm > 0.0 && thickness_mm >= 5.5);
}

#[test]
fn files_of_the_other_architecture_damaged_files_and_bad_numbers_are_refused_by_name() {
    let message = |problem: NetworkError| {
        let text = problem.to_string();
        assert!(!text.contains('\n'), "{text}");
        text
    };
    let text = message(TrackedWeights::parse(UNET).unwrap_err());
    assert!(text.contains("`unet`") && text.contains("`tracked`"), "{text}");
    let text = message(UnetWeights::parse(TRACKED).unwrap_err());
    assert!(text.contains("`tracked`") && text.contains("`unet`"), "{text}");

    let mut damaged = TRACKED.to_vec();
    let last = damaged.len() - 1;
    damaged[last] ^= 1;
    let text = message(TrackedWeights::parse(&damaged).unwrap_err());
    assert!(text.contains("checksum"), "{text}");

    let good = TrackedWeights::parse(TRACKED).unwrap();
    let changed = |change: &dyn Fn(&mut TrackedWeights)| {
        let mut weights = good.clone();
        change(&mut weights);
        message(TrackedWeights::parse(&weights.to_bytes()).unwrap_err())
    };
    let text = changed(&|weights| weights.lens.focal_px_per_rad = f32::NAN);
    assert!(
        text.contains("focal_px_per_rad") && text.contains("NaN"),
        "{text}"
    );
    let text = changed(&|weights| weights.scaling.newtons_per_mm = -1.0);
    assert!(text.contains("newtons_per_mm") && text.contains("-1"), "{text}");
    let text = changed(&|weights| weights.tensors.get_mut("output.bias").unwrap().values[1] = f32::NAN);
    assert!(text.contains("output.bias") && text.contains("index 1"), "{text}");
    let text = changed(&|weights| drop(weights.tensors.remove("up10.weight")));
    assert!(text.contains("up10.weight"), "{text}");
}

#[test]
fn a_file_says_which_network_it_is_for_and_a_request_for_the_other_is_refused() {
    let path = std::env::temp_dir().join(format!("gripline-tracked-{}.safetensors", std::process::id()));
    std::fs::write(&path, TRACKED).unwrap();
    let network = Network::from_file(&path, None).unwrap();
    assert_eq!(network.architecture(), Architecture::Tracked);
    let error = Network::from_file(&path, Some(Architecture::Unet))
        .unwrap_err()
        .to_string();
    std::fs::remove_file(&path).unwrap();
    assert!(
        error.contains(&path.display().to_string()) && error.contains("`unet`"),
        "{error}"
    );
    for architecture in Architecture::ALL {
        assert_eq!(
            Network::embedded(architecture).unwrap().architecture(),
            architecture
        );
        assert_eq!(architecture.name().parse::<Architecture>().unwrap(), architecture);
    }
}

#[test]
fn a_gain_scales_shear_and_normal_force_and_outlives_other_choices() {
    let (rest, now) = (picture(1_200, [0.0; 2], 1), picture(1_200, [4.0, -2.0], 2));
    for architecture in Architecture::ALL {
        let mut plain = Network::embedded(architecture).unwrap();
        let mut scaled = plain.clone().with_gain([2.0, 0.5]);
        scaled = scaled.with_evaluation(Evaluation::default());
        scaled = scaled.with_instructions(InstructionSet::widest()).unwrap();
        assert_eq!(scaled.checksum(), plain.checksum());
        let [mut of_plain, mut of_scaled] = [NO_FORCES; 2];
        for (network, map) in [(&mut plain, &mut of_plain), (&mut scaled, &mut of_scaled)] {
            network.set_rest(&rest);
            network.infer(&now, map);
            // A picture in which nothing changed: what is kept of the one before is not scaled twice.
            network.infer(&now, map);
        }
        assert!(of_plain.iter().any(|force| force[2] > 0.0), "{architecture}");
        let expected = of_plain.map(|[x, y, z]| [2.0 * x, 2.0 * y, 0.5 * z]);
        assert_eq!(bits(&of_scaled), bits(&expected), "{architecture}");
    }
    let [unet, tracked] = Architecture::ALL.map(|of| Network::embedded(of).unwrap().checksum());
    assert_ne!(unet, tracked);
    assert_eq!(tracked.len(), 8);
}
