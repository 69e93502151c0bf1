//! The encoder–decoder: skipping against computing everything, over frames in which random rectangles change; the
//! instruction sets against each other; allocations.

use gripline_network::image::Image88;
use gripline_network::unet::UnetNetwork;
use gripline_network::{Evaluation, ForceMap, InstructionSet, NO_FORCES, downsample_440_to_88};

use crate::{Rng, UNET_GOLDEN, bits, golden_tensor, sets};

const SIDE: usize = 88;

/// Copies a rectangle, from one pixel to everything, from a real image.
fn change(rng: &mut Rng, image: &mut Image88) {
    let pressed = images("now");
    let from = &pressed[rng.below(pressed.len())];
    let (top, left) = (rng.below(SIDE), rng.below(SIDE));
    let (rows, columns) = (1 + rng.below(SIDE - top), 1 + rng.below(SIDE - left));
    for row in top..top + rows {
        let pixels = row * SIDE + left..row * SIDE + left + columns;
        image[pixels.clone()].copy_from_slice(&from[pixels]);
    }
}

/// `rest` or `now` of the golden samples.
fn images(name: &str) -> Vec<Image88> {
    golden_tensor(UNET_GOLDEN, name).as_chunks::<7744>().0.to_vec()
}

fn on(set: InstructionSet, evaluation: Evaluation) -> UnetNetwork {
    let network = UnetNetwork::embedded().unwrap().with_evaluation(evaluation);
    network.with_instructions(set).unwrap()
}

#[test]
fn skipping_changes_no_bit_of_any_force() {
    let (mut rng, rests) = (Rng(1), images("rest"));
    for set in sets() {
        let (mut dense, mut skip) = (on(set, Evaluation::Dense), on(set, Evaluation::Skip));
        let (mut now, mut before, mut moved) = (rests[0], NO_FORCES, 0);
        for frame in 0..60 {
            if frame % 20 == 5 {
                let rest = &rests[rng.below(rests.len())];
                dense.set_rest(rest);
                skip.set_rest(rest);
            }
            for _ in 0..[0, 1, 1, 2][frame % 4] {
                change(&mut rng, &mut now);
            }
            let (mut expected, mut got) = (NO_FORCES, [[7.0; 3]; 400]);
            dense.infer(&now, &mut expected);
            skip.infer(&now, &mut got);
            assert!(bits(&got) == bits(&expected), "{set}, frame {frame}");
            moved += usize::from(got != before);
            before = got;
        }
        assert!(
            moved > 40,
            "{set}: the forces hardly ever changed ({moved} times)"
        );
    }
}

#[test]
fn a_new_rest_image_counts_even_when_the_frame_stays() {
    let (rests, now) = (images("rest"), images("now")[0]);
    let mut skip = on(InstructionSet::widest(), Evaluation::Skip);
    let (mut before, mut after) = (NO_FORCES, NO_FORCES);
    skip.set_rest(&rests[0]);
    skip.infer(&now, &mut before);
    skip.set_rest(&rests[1]);
    skip.infer(&now, &mut after);
    assert!(before != after);
}

#[test]
fn instruction_sets_agree_to_1e_5_of_the_largest_force() {
    let mut networks: Vec<UnetNetwork> = sets().map(|set| on(set, Evaluation::Dense)).collect();
    for (rest, now) in images("rest").iter().zip(&images("now")) {
        let maps: Vec<ForceMap> = networks
            .iter_mut()
            .map(|network| {
                let mut forces_n = NO_FORCES;
                network.set_rest(rest);
                network.infer(now, &mut forces_n);
                forces_n
            })
            .collect();
        let largest = maps[0]
            .as_flattened()
            .iter()
            .fold(0f32, |largest, force| largest.max(force.abs()));
        for map in &maps {
            for (a, b) in map.as_flattened().iter().zip(maps[0].as_flattened()) {
                assert!((a - b).abs() <= 1e-5 * largest, "{a} and {b} N of {largest} N");
            }
        }
        // The wide ones compute the very same.
        assert!(
            maps.iter()
                .skip(1)
                .all(|map| bits(map) == bits(&maps[maps.len() - 1]))
        );
    }
}

#[test]
fn a_frame_allocates_nothing() {
    let crop: Vec<u8> = (0..440 * 440).map(|i| (i % 251) as u8).collect();
    let (mut now, mut forces_n) = ([0; 7744], NO_FORCES);
    for set in InstructionSet::ALL.into_iter().filter(|set| set.is_available()) {
        for evaluation in [Evaluation::Dense, Evaluation::Skip] {
            let build = || {
                let network = UnetNetwork::embedded().unwrap().with_evaluation(evaluation);
                network.with_instructions(set).unwrap()
            };
            let mut network = build();
            let counted = allocation_counter::measure(|| {
                network.set_rest(&[30; 7744]);
                downsample_440_to_88(&crop, &mut now);
                network.infer(&now, &mut forces_n);
                network.infer(&now, &mut forces_n);
                now[4000] ^= 1;
                network.infer(&now, &mut forces_n);
            });
            assert_eq!(counted.count_total, 0, "{set}, {evaluation:?}");
            // The counter counts: building the network allocates.
            assert!(allocation_counter::measure(|| drop(build())).count_total > 0);
        }
    }
}
