//! How fast the force network runs: by instruction set, against onnxruntime and tract with the same weights on
//! one thread, against this processor's own limit, and what skipping saves. Run by `cargo xtask bench network`.
//!
//! All contestants take turns, a few frames each, so that what else the machine does falls on all of them.

mod onnx;
mod peers;
mod report;
mod timing;
mod tracked;

use std::hint::black_box;
use std::path::PathBuf;
use std::process::ExitCode;

use gripline_network::image::Image88;
use gripline_network::weights::Weights;
use gripline_network::{Evaluation, ForceMap, ForceNetwork, InstructionSet, downsample_440_to_88, spin};
use safetensors::SafeTensors;

use peers::{OnnxRuntime, Tract};
use report::Report;
use timing::{Contestant, Times};

/// Whatever stops the measurement; it is printed and nothing else.
type Failure = Box<dyn std::error::Error>;

const WEIGHTS: &[u8] = include_bytes!("../../../weights/unet.safetensors");
/// Image pairs and forces of the embedded weights.
const GOLDEN: &[u8] = include_bytes!("../../../golden/unet.safetensors");

/// Largest difference between two engines' forces, in shares of the largest force: else they do not run the
/// same network.
const SAME: f32 = 1e-4;

/// Rounds of multiply-adds per measurement of the limit: some 20 to 100 µs.
const SPIN_ROUNDS: usize = 30_000;

/// Shares of the image's area that change between frames in the measurement of skipping.
const CHANGED: [(f64, &str); 2] = [(0.1, "10 % changed"), (0.3, "30 % changed")];

/// Positions of the changed square that take turns.
const POSITIONS: usize = 9;

struct Arguments {
    onnxruntime: PathBuf,
    weights: Option<PathBuf>,
    json: bool,
    rounds: usize,
}

fn main() -> ExitCode {
    match arguments().and_then(|arguments| run(&arguments)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("bench-network: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn arguments() -> Result<Arguments, Failure> {
    let mut arguments = Arguments {
        onnxruntime: PathBuf::new(),
        weights: None,
        json: false,
        rounds: 150,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word}: expected a value after it"));
        match word.as_str() {
            "--onnxruntime" => arguments.onnxruntime = value()?.into(),
            "--weights" => arguments.weights = Some(value()?.into()),
            "--rounds" => {
                let text = value()?;
                let rounds = text.parse().ok().filter(|&rounds| rounds > 0);
                arguments.rounds =
                    rounds.ok_or(format!("--rounds: found `{text}`, expected a number above 0"))?;
            }
            "--json" => arguments.json = true,
            _ => {
                return Err(format!(
                    "argument `{word}` is unknown, expected --onnxruntime LIBRARY, --weights FILE, --rounds N or --json"
                )
                .into());
            }
        }
    }
    Ok(arguments)
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let weights = match &arguments.weights {
        None => Weights::parse(WEIGHTS)?,
        Some(path) => Weights::from_file(path)?,
    };
    let golden = SafeTensors::deserialize(GOLDEN)?;
    let image = |name: &str| -> Result<Image88, Failure> {
        let images = golden.tensor(name)?.data().as_chunks::<7744>().0;
        images
            .first()
            .copied()
            .ok_or_else(|| format!("no image `{name}`").into())
    };
    let (rest, now) = (image("rest")?, image("now")?);
    let crop: Vec<u8> = (0..440 * 440)
        .map(|i| now[i / 440 / 5 * 88 + i % 440 / 5])
        .collect();

    let model = onnx::model(&weights);
    let mut onnxruntime = OnnxRuntime::new(&arguments.onnxruntime, &model)?;
    let tract = Tract::new(&model)?;
    let (input, scaling) = (peers::input(&rest, &now, weights.scaling), weights.scaling);

    let sets: Vec<InstructionSet> = InstructionSet::ALL
        .into_iter()
        .filter(|set| set.is_available())
        .collect();
    let widest = InstructionSet::widest();
    let on = |set, evaluation| -> Result<ForceNetwork, Failure> {
        let mut network = ForceNetwork::from_weights(&weights)?
            .with_instructions(set)?
            .with_evaluation(evaluation);
        network.set_rest(&rest);
        Ok(network)
    };

    let mut ours = NOTHING;
    on(widest, Evaluation::Dense)?.infer(&now, &mut ours);
    for (name, theirs) in [
        ("onnxruntime", onnxruntime.run(&input, scaling)?),
        ("tract", tract.run(&input, scaling)?),
    ] {
        same(name, &ours, &theirs)?;
    }
    let allocations_per_frame = allocations(on(widest, Evaluation::Skip)?, &crop, &now);

    let mut contestants: Vec<Contestant> = Vec::new();
    contestants.push(Contestant::new("limit", move || {
        black_box(spin(widest, black_box(SPIN_ROUNDS)));
    }));
    for &set in &sets {
        let mut network = on(set, Evaluation::Dense)?;
        contestants.push(Contestant::new(&set.to_string(), move || {
            network.infer(black_box(&now), black_box(&mut NOTHING.clone()));
        }));
    }
    let theirs = input.clone();
    contestants.push(Contestant::new("onnxruntime", move || {
        black_box(onnxruntime.run(black_box(&theirs), scaling).is_ok());
    }));
    contestants.push(Contestant::new("tract", move || {
        black_box(tract.run(black_box(&input), scaling).is_ok());
    }));
    let (mut network, mut small) = (on(widest, Evaluation::Dense)?, now);
    contestants.push(Contestant::new("whole frame", move || {
        downsample_440_to_88(black_box(&crop), &mut small);
        network.infer(&small, black_box(&mut NOTHING.clone()));
    }));
    let mut network = on(widest, Evaluation::Skip)?;
    contestants.push(Contestant::new("unchanged", move || {
        network.infer(black_box(&now), black_box(&mut NOTHING.clone()));
    }));
    for (share, name) in CHANGED {
        let mut network = on(widest, Evaluation::Skip)?;
        let images: Vec<Image88> = (0..POSITIONS)
            .map(|position| patched(&now, share, position))
            .collect();
        let mut frame = 0;
        // Each frame differs from the last by one patch: the one before it stays where it is.
        let mut shown = now;
        contestants.push(Contestant::new(name, move || {
            let position = frame % POSITIONS;
            toggle(&mut shown, &images[position], &now);
            frame += 1;
            network.infer(black_box(&shown), black_box(&mut NOTHING.clone()));
        }));
    }

    contestants.extend(tracked::contestants(POSITIONS)?);

    let times = timing::take_turns(&mut contestants, arguments.rounds);
    let report = Report {
        widest,
        sets,
        multiply_adds: on(widest, Evaluation::Dense)?.multiply_adds(),
        limit_multiply_adds: spin(widest, SPIN_ROUNDS),
        allocations_per_frame: allocations_per_frame.max(tracked::allocations()?),
        load: std::fs::read_to_string("/proc/loadavg").unwrap_or_default(),
        times,
    };
    if arguments.json {
        println!("{:#}", report.json());
    } else {
        print!("{}", report.table());
    }
    Ok(())
}

const NOTHING: ForceMap = [[0.0; 3]; 400];

/// Fails when two engines' forces differ by more than rounding.
fn same(name: &str, ours: &ForceMap, theirs: &ForceMap) -> Result<(), Failure> {
    let forces = ours.as_flattened();
    let largest = forces
        .iter()
        .fold(0f32, |largest, force| largest.max(force.abs()));
    let pairs = forces.iter().zip(theirs.as_flattened());
    let difference = pairs.fold(0f32, |difference, (a, b)| difference.max((a - b).abs()));
    if difference <= SAME * largest {
        Ok(())
    } else {
        Err(format!(
            "{name}'s forces differ from ours by up to {difference} N, expected at most {SAME} of {largest} N"
        )
        .into())
    }
}

/// Heap allocations of a frame, the worst of three: full, unchanged, changed in one pixel.
fn allocations(mut network: ForceNetwork, crop: &[u8], now: &Image88) -> u64 {
    let (mut small, mut forces_n) = (*now, NOTHING);
    let mut count = |small: &mut Image88, flip: bool| {
        let counted = allocation_counter::measure(|| {
            downsample_440_to_88(crop, small);
            small[4000] ^= u8::from(flip);
            network.infer(small, &mut forces_n);
        });
        counted.count_total
    };
    [false, false, true]
        .map(|flip| count(&mut small, flip))
        .into_iter()
        .max()
        .unwrap_or(0)
}

/// The image with a brighter square that covers a share of it, at one of the nine positions of a 3×3 raster.
fn patched(image: &Image88, share: f64, position: usize) -> Image88 {
    let side = (share.sqrt() * 88.0).round() as usize;
    let offset = |index: usize| index * (88 - side) / 2;
    let (top, left) = (offset(position / 3), offset(position % 3));
    std::array::from_fn(|i| {
        let inside = (top..top + side).contains(&(i / 88)) && (left..left + side).contains(&(i % 88));
        image[i] ^ if inside { 0x20 } else { 0 }
    })
}

/// Flips the patched pixels: on when they are off, off when they are on.
fn toggle(shown: &mut Image88, patched: &Image88, plain: &Image88) {
    for ((shown, patched), plain) in shown.iter_mut().zip(patched).zip(plain) {
        *shown ^= patched ^ plain;
    }
}
