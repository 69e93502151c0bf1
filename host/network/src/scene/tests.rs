//! Both gates on pictures made here, and the learned one against LiteRT's outputs.

use gripline_kernels::InstructionSet;
use safetensors::SafeTensors;

use super::learned::run;
use super::*;
use crate::constants::{BLOCKS, IMAGE_PIXELS};
use crate::image::Image88;

static MODEL: &[u8] = include_bytes!("../../weights/gate.tflite");
static GOLDEN: &[u8] = include_bytes!("../../golden/gate.safetensors");

/// Output steps of the model's file, logits.
const OUTPUT_STEP: f32 = 0.1;

#[test]
fn microflow_answers_as_litert_does() {
    let (_, header) = SafeTensors::read_metadata(GOLDEN).unwrap();
    let made_for = &header.metadata().as_ref().unwrap()["model_crc32"];
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(MODEL);
    assert_eq!(
        *made_for,
        format!("{crc:08x}"),
        "the golden file is another model's: run checks/gate_golden.py"
    );
    let tensors = SafeTensors::deserialize(GOLDEN).unwrap();
    let of = |name: &str| -> Vec<i8> {
        tensors
            .tensor(name)
            .unwrap()
            .data()
            .iter()
            .map(|&b| b as i8)
            .collect()
    };
    let (inputs, outputs) = (of("inputs"), of("outputs"));
    let (mut equal, mut count, mut worst) = (0, 0, 0);
    for (steps, answer) in inputs.chunks_exact(2 * BLOCKS).zip(outputs.chunks_exact(2)) {
        let grid: GateInputs = std::array::from_fn(|block| [steps[2 * block], steps[2 * block + 1]]);
        for (found, &expected) in run(&grid).into_iter().zip(answer) {
            let found = (found / OUTPUT_STEP).round() as i32;
            // LiteRT multiplies by fixed-point factors, microflow by floats: a last digit of the first layer's hundred
            // outputs may differ, and what follows adds them up.
            worst = worst.max((found - i32::from(expected)).abs());
            equal += usize::from(found == i32::from(expected));
            count += 1;
        }
    }
    assert!(count >= 384);
    println!("{equal} of {count} answers are the same, the others differ by at most {worst} steps");
    assert!(worst <= 2, "answers differ by {worst} steps");
    assert!(
        equal * 100 >= count * 90,
        "{equal} of {count} answers are the same"
    );
}

#[test]
fn the_golden_answers_are_on_both_sides_of_every_decision() {
    let tensors = SafeTensors::deserialize(GOLDEN).unwrap();
    let outputs = tensors.tensor("outputs").unwrap();
    for output in 0..2 {
        let yes = outputs
            .data()
            .iter()
            .skip(output)
            .step_by(2)
            .filter(|&&step| step as i8 > 0);
        let (yes, all) = (yes.count(), outputs.data().len() / 2);
        assert!(yes * 10 > all && yes * 10 < 9 * all, "{yes} of {all}");
    }
}

/// A stream of random numbers.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Nearly normal, variance 2/3.
    fn noise(&mut self) -> f32 {
        let bits = self.bits();
        (0..4)
            .map(|n| ((bits >> (16 * n) & 0xFFFF) as f32 / 65_536.0) - 0.5)
            .sum::<f32>()
            * 1.414
    }
}

/// A picture of bright particles, moved by `shift` pixels along x inside `moved`, at this brightness.
fn surface(seed: u64, light: f32, shift: f32, moved: impl Fn(f32, f32) -> bool) -> Image88 {
    let mut places = Random(77);
    let mut light_at = vec![14.0_f32; IMAGE_PIXELS];
    for _ in 0..1_500 {
        let bits = places.bits();
        let (mut x, y) = (
            (bits & 0xFFFF) as f32 / 744.7,
            (bits >> 16 & 0xFFFF) as f32 / 744.7,
        );
        if moved(x, y) {
            x += shift;
        }
        let (left, top) = (x as usize, y as usize);
        for row in top.saturating_sub(2)..(top + 3).min(88) {
            for column in left.saturating_sub(2)..(left + 3).min(88) {
                let away = (column as f32 - x).powi(2) + (row as f32 - y).powi(2);
                light_at[row * 88 + column] += 60.0 * (-away).exp();
            }
        }
    }
    let mut random = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    std::array::from_fn(|pixel| {
        (light * light_at[pixel] + 0.6 * random.noise() + 0.5).clamp(0.0, 255.0) as u8
    })
}

fn at_rest(seed: u64) -> Image88 {
    surface(seed, 1.0, 0.0, |_, _| false)
}

/// As under a small indenter: 2.5 blocks around (30, 40).
fn touched(seed: u64, shift: f32) -> Image88 {
    surface(seed, 1.0, shift, |x, y| (x - 30.0).hypot(y - 40.0) < 10.0)
}

fn scene(kind: GateKind) -> Scene {
    let frames: Vec<Image88> = (1..=16).map(at_rest).collect();
    Scene::new(kind, &mean_of(&frames), &frames)
}

const GATES: [GateKind; 2] = [GateKind::Network, GateKind::Difference];

#[test]
fn nearly_all_of_a_thousand_noisy_pictures_at_rest_are_no_contact() {
    for kind in GATES {
        let mut scene = scene(kind);
        let inferred = (100..1_100).filter(|&seed| scene.decide(&at_rest(seed)).0 != GateDecision::NoContact);
        let inferred = inferred.count();
        assert!(
            inferred <= 20,
            "{kind}: {inferred} of 1,000 pictures at rest were taken for a touch"
        );
    }
}

#[test]
fn a_touch_is_inferred_once_and_then_again_only_when_it_changes() {
    for kind in GATES {
        let mut scene = scene(kind);
        assert_eq!(scene.decide(&touched(300, 0.5)).0, GateDecision::Infer, "{kind}");
        let same = (301..401).filter(|&seed| scene.decide(&touched(seed, 0.5)).0 == GateDecision::Unchanged);
        let same = same.count();
        assert!(
            same >= 95,
            "{kind}: only {same} of 100 unchanged pictures were skipped"
        );
        assert_eq!(scene.decide(&touched(402, 0.9)).0, GateDecision::Infer, "{kind}");
        assert_eq!(
            scene.decide(&touched(402, 0.9)).0,
            GateDecision::Unchanged,
            "{kind}"
        );
        scene.force_inference();
        assert_eq!(scene.decide(&touched(402, 0.9)).0, GateDecision::Infer, "{kind}");
        assert_eq!(scene.decide(&at_rest(403)).0, GateDecision::NoContact, "{kind}");
        // The touch is over: the same picture as before is a new one.
        assert_eq!(scene.decide(&touched(402, 0.9)).0, GateDecision::Infer, "{kind}");
    }
}

#[test]
fn a_slow_creep_is_inferred_again_and_again() {
    for kind in GATES {
        let mut scene = scene(kind);
        let steps = (0..100_u16).filter(|&step| {
            let picture = touched(500 + u64::from(step), 0.5 + 0.01 * f32::from(step));
            scene.decide(&picture).0 == GateDecision::Infer
        });
        // One pixel in steps of a hundredth, every one of which is small against the noise of a pair.
        let inferred = steps.count();
        assert!(
            inferred >= 4,
            "{kind}: a creep of a pixel was inferred {inferred} times"
        );
    }
}

#[test]
fn a_change_of_brightness_opens_the_difference_gate_only() {
    let brighter = |seed: u64| surface(seed, 1.03, 0.0, |_, _| false);
    assert_eq!(
        scene(GateKind::Network).decide(&brighter(600)).0,
        GateDecision::NoContact
    );
    assert_eq!(
        scene(GateKind::Difference).decide(&brighter(600)).0,
        GateDecision::Infer
    );
}

#[test]
fn off_infers_every_healthy_picture() {
    let mut scene = scene(GateKind::Off);
    assert_eq!(scene.decide(&at_rest(700)), (GateDecision::Infer, Health::GOOD));
}

#[test]
fn a_camera_without_noise_is_gated_too() {
    let rest = at_rest(1);
    for kind in GATES {
        let mut scene = Scene::new(kind, &rest, &vec![rest; 4]);
        assert_eq!(scene.decide(&rest).0, GateDecision::NoContact, "{kind}");
        assert_eq!(scene.decide(&touched(1, 0.6)).0, GateDecision::Infer, "{kind}");
    }
}

/// With one picture at rest, so that the noise is found in the pictures of the run.
fn scene_of_one(kind: GateKind) -> Scene {
    let rest = at_rest(1);
    Scene::new(kind, &rest, std::slice::from_ref(&rest))
}

#[test]
fn the_noise_is_found_without_allocation() {
    for kind in GATES {
        let mut scene = scene_of_one(kind);
        let pictures: Vec<Image88> = (1_000..1_040).map(at_rest).collect();
        let counted = allocation_counter::measure(|| {
            for picture in &pictures {
                scene.decide(picture);
            }
        });
        assert_eq!(counted.count_total, 0, "{kind}");
    }
}

/// How many of 261 pictures are no contact, then unchanged in a touch, and again, with one picture at rest. The camera may stop before,
/// between and after, and show the same picture again and again.
fn skipped(kind: GateKind, stops: bool) -> [usize; 4] {
    let mut scene = scene_of_one(kind);
    let stop = |scene: &mut Scene, picture: Image88| {
        for _ in 0..if stops { 48 } else { 0 } {
            scene.decide(&picture);
        }
    };
    stop(&mut scene, at_rest(2));
    for seed in 1_100..1_139 {
        scene.decide(&at_rest(seed));
    }
    std::array::from_fn(|round| {
        let (picture, expected): (fn(u64) -> Image88, _) = if round % 2 == 0 {
            (at_rest, GateDecision::NoContact)
        } else {
            (|seed| touched(seed, 0.5), GateDecision::Unchanged)
        };
        let count = (1_139..1_400)
            .filter(|seed| scene.decide(&picture(*seed)).0 == expected)
            .count();
        stop(&mut scene, picture(3));
        count
    })
}

#[test]
fn a_camera_that_stops_for_a_while_leaves_the_noise_as_it_was() {
    for kind in GATES {
        let [with, without] = [true, false].map(|stops| skipped(kind, stops));
        println!("{kind}: {with:?} of 261, {without:?} without stops");
        // The difference gate skips less where there is one picture at rest, with stops or without.
        let least = if kind == GateKind::Network { 248 } else { 0 };
        for (with, without) in with.into_iter().zip(without) {
            assert!(
                5 * with >= 4 * without && with >= least,
                "{kind}: {with}, {without}"
            );
        }
    }
}

#[test]
fn every_instruction_set_sees_the_same() {
    let picture = touched(800, 0.3);
    let sets = InstructionSet::ALL.into_iter().filter(|set| set.is_available());
    let inputs: Vec<GateInputs> = sets
        .map(|set| scene(GateKind::Network).with_instructions(set).inputs(&picture))
        .collect();
    assert!(inputs.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn pictures_that_cannot_be_trusted_are_unhealthy_and_ignored() {
    let mut scene = scene(GateKind::Network);
    assert_eq!(
        scene.decide(&touched(900, 0.5)),
        (GateDecision::Infer, Health::GOOD)
    );
    let faulty: Vec<(Image88, Health)> = vec![
        ([0; IMAGE_PIXELS], Health::TOO_DARK),
        ([255; IMAGE_PIXELS], Health::TOO_BRIGHT),
        ([128; IMAGE_PIXELS], Health::PARTICLES_LOST),
        (surface(901, 0.5, 0.0, |_, _| false), Health::TOO_DARK),
        // Every particle elsewhere: another sensor.
        (surface(902, 1.0, 9.0, |_, _| true), Health::UNLIKE_TRAINING),
    ];
    for (picture, flag) in &faulty {
        let (decision, health) = scene.decide(picture);
        assert_eq!(decision, GateDecision::Unhealthy, "{health}");
        assert!(health.has(*flag), "{health}");
    }
    // What was processed before still counts.
    assert_eq!(scene.decide(&touched(903, 0.5)).0, GateDecision::Unchanged);
}

#[test]
fn a_picture_at_rest_without_particles_makes_all_that_follow_unhealthy() {
    for level in [0, 128, 255] {
        let rest = [level; IMAGE_PIXELS];
        let mut scene = Scene::new(GateKind::Network, &rest, &vec![rest; 4]);
        let (decision, health) = scene.decide(&rest);
        assert_eq!(decision, GateDecision::Unhealthy);
        assert!(health.has(Health::PARTICLES_LOST), "{level}: {health}");
        assert_eq!(scene.decide(&at_rest(1)).0, GateDecision::Unhealthy);
    }
}
