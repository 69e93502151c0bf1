//! Skipping against computing everything, over frames in which random rectangles change; and the
//! instruction sets against each other, on the whole network.

use gripline_network::image::Image88;
use gripline_network::{Evaluation, ForceMap, ForceNetwork, InstructionSet};
use safetensors::SafeTensors;

const GOLDEN: &[u8] = include_bytes!("../golden/unet.safetensors");
const SIDE: usize = 88;
const NOTHING: ForceMap = [[0.0; 3]; 400];

/// Whole numbers below `below`, without a pattern (an LCG's upper bits).
struct Dice(u64);

impl Dice {
    fn below(&mut self, below: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % below
    }

    /// Copies a rectangle, from one pixel to everything, from a real image.
    fn change(&mut self, image: &mut Image88) {
        let pressed = images("now");
        let from = &pressed[self.below(pressed.len())];
        let (top, left) = (self.below(SIDE), self.below(SIDE));
        let (rows, columns) = (1 + self.below(SIDE - top), 1 + self.below(SIDE - left));
        for row in top..top + rows {
            let pixels = row * SIDE + left..row * SIDE + left + columns;
            image[pixels.clone()].copy_from_slice(&from[pixels]);
        }
    }
}

/// `rest` or `now` of the golden samples.
fn images(name: &str) -> Vec<Image88> {
    let file = SafeTensors::deserialize(GOLDEN).unwrap();
    file.tensor(name).unwrap().data().as_chunks::<7744>().0.to_vec()
}

fn sets() -> impl Iterator<Item = InstructionSet> {
    InstructionSet::ALL.into_iter().filter(|set| set.is_available())
}

fn on(set: InstructionSet, evaluation: Evaluation) -> ForceNetwork {
    let network = ForceNetwork::embedded().unwrap().with_evaluation(evaluation);
    network.with_instructions(set).unwrap()
}

fn bits(forces_n: &ForceMap) -> Vec<u32> {
    forces_n
        .as_flattened()
        .iter()
        .map(|force| force.to_bits())
        .collect()
}

#[test]
fn skipping_changes_no_bit_of_any_force() {
    let (mut dice, rests) = (Dice(1), images("rest"));
    for set in sets() {
        let (mut dense, mut skip) = (on(set, Evaluation::Dense), on(set, Evaluation::Skip));
        let (mut now, mut before, mut moved) = (rests[0], NOTHING, 0);
        for frame in 0..60 {
            if frame % 20 == 5 {
                let rest = &rests[dice.below(rests.len())];
                dense.set_rest(rest);
                skip.set_rest(rest);
            }
            for _ in 0..[0, 1, 1, 2][frame % 4] {
                dice.change(&mut now);
            }
            let (mut expected, mut got) = (NOTHING, [[7.0; 3]; 400]);
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
    let (mut before, mut after) = (NOTHING, NOTHING);
    skip.set_rest(&rests[0]);
    skip.infer(&now, &mut before);
    skip.set_rest(&rests[1]);
    skip.infer(&now, &mut after);
    assert!(before != after);
}

#[test]
fn instruction_sets_agree_to_1e_5_of_the_largest_force() {
    let mut networks: Vec<ForceNetwork> = sets().map(|set| on(set, Evaluation::Dense)).collect();
    for (rest, now) in images("rest").iter().zip(&images("now")) {
        let maps: Vec<ForceMap> = networks
            .iter_mut()
            .map(|network| {
                let mut forces_n = NOTHING;
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
