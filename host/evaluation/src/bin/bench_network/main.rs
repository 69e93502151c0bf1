//! `cargo xtask bench network`: speed and error of the force networks. Speed: by instruction set, against onnxruntime,
//! tract and rten with the same weights on one thread, against the processor's peak, with skipping, and with the gate. Error: on
//! shapes and sensors of the test world never trained on.
//!
//! With `--instructions avx2` the other engines too see a processor with AVX2 and nothing wider, where it lets itself be limited.
//! All contestants take turns, a few frames each, so that other load on the machine affects all of them alike.

mod accuracy;
mod failure;
mod load_cell;
mod models;
mod onnx;
mod peers;
mod pictures;
mod plot;
mod preprocessing;
mod processor;
mod report;
mod timing;

use std::cell::RefCell;
use std::hint::black_box;
use std::path::PathBuf;
use std::process::ExitCode;
use std::rc::Rc;
use std::sync::{Arc, Mutex, PoisonError};

use clap::Parser;
use clap::builder::RangedU64ValueParser;
use gripline_network::image::Image88;
use gripline_network::scene::{GateDecision, GateKind, Scene, mean_of};
use gripline_network::tracked::{TrackedNetwork, TrackedWeights, empty_grid};
use gripline_network::unet::{UnetNetwork, UnetWeights};
use gripline_network::{
    Evaluation, ForceMap, Frame, InstructionSet, NO_FORCES, Precision as NetworkPrecision, peak_multiply_adds,
};
use gripline_simulation::constants::REST_PICTURES;

use accuracy::Quantised;
use failure::Failure;
use models::Model;
use onnx::Precision;
use peers::{OnnxRuntime, Rten, Tract};
use pictures::{Film, Shown, noisy, picture};
use preprocessing::{NetworkInput, Preprocessor, small};
use report::{CHANGED, Report, WITH_NOISE};
use timing::Contestant;

const UNET: &[u8] = include_bytes!("../../../../network/weights/unet.safetensors");
const TRACKED: &[u8] = include_bytes!("../../../../network/weights/tracked.safetensors");

/// Largest difference between two engines' forces, relative to the largest force, if they run the same network.
const SAME: f32 = 1e-4;

/// Rounds of multiply-adds per measurement of the peak: 20 to 100 µs.
const PEAK_ROUNDS: usize = 30_000;

/// Pictures of a film with noise, after which it begins again: twice the film's own round.
const NOISY_PICTURES: u64 = 36;

/// Makes a network's graph for other engines.
type Graph<'a> = &'a dyn Fn(Precision) -> Vec<u8>;

/// Speed and error of the force networks, beside other inference engines
#[derive(Parser)]
struct Arguments {
    /// The shared library of onnxruntime
    #[arg(long, value_name = "LIBRARY")]
    onnxruntime: PathBuf,
    /// Use this instruction set; with avx2 the other engines find nothing wider where the processor lets itself be limited [default: the widest]
    #[arg(long, value_name = "SET")]
    instructions: Option<InstructionSet>,
    /// Measure the network with these weights too; may be given several times
    #[arg(long, value_name = "FILE")]
    weights: Vec<PathBuf>,
    /// Plot run time against error into this file
    #[arg(long, value_name = "FILE.png")]
    plot: Option<PathBuf>,
    /// Print the figures as one JSON object
    #[arg(long)]
    json: bool,
    /// Turns that every contestant takes
    #[arg(long, value_name = "N", default_value_t = 150, value_parser = RangedU64ValueParser::<usize>::new().range(1..=100_000))]
    rounds: usize,
    /// Samples of the test world that errors are measured on
    #[arg(long, value_name = "N", default_value_t = 1_500, value_parser = RangedU64ValueParser::<usize>::new().range(500..=100_000))]
    samples: usize,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("bench-network: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    // Before anything asks what the processor can do.
    let limited = arguments.instructions == Some(InstructionSet::Avx2) && processor::show_no_more_than_avx2();
    let instructions = arguments
        .instructions
        .map_or(Ok(InstructionSet::widest()), InstructionSet::checked)?;
    let models = models::all(&arguments.weights, instructions)?;
    let (unet_weights, tracked_weights) = (UnetWeights::parse(UNET)?, TrackedWeights::parse(TRACKED)?);
    let environment = peers::environment(&arguments.onnxruntime)?;
    // In the order of `models`, whose first two have these weights.
    let mut preprocessors = [
        Preprocessor::unet(&unet_weights),
        Preprocessor::tracked(&tracked_weights),
    ];
    let graphs: [Graph; 2] = [&|precision| onnx::unet(&unet_weights, precision), &|precision| {
        onnx::tracked(&tracked_weights, precision)
    }];
    let mut quantised = Vec::new();
    for (model, (preprocessor, graph)) in preprocessors.iter().zip(graphs).enumerate() {
        quantised.push(Quantised {
            model,
            preprocessor: preprocessor.clone(),
            engine: Arc::new(Mutex::new(peers::int8(
                &environment,
                preprocessor.clone(),
                graph,
            )?)),
        });
    }

    eprintln!(
        "{} samples of the test world (shapes and sensors that no network was trained on), made here ...",
        arguments.samples
    );
    let accuracies = accuracy::measure(&models, &quantised, arguments.samples)?;

    let sets: Vec<InstructionSet> = InstructionSet::ALL
        .into_iter()
        .filter(|set| set.is_available())
        .collect();
    eprintln!("taking turns ...");
    let mut contestants = vec![Contestant::new("limit", move || {
        black_box(peak_multiply_adds(instructions, black_box(PEAK_ROUNDS)));
    })];
    let (rest, now) = (picture(Shown::Rest), picture(Shown::Dragged));
    let inputs = preprocessors.each_mut().map(|preprocessor| {
        preprocessor.set_rest(rest);
        preprocessor.prepare(now)
    });
    let (forces_of_unet, of_unet) = unet(&unet_weights, &sets)?;
    let (forces_of_tracked, of_tracked) = tracked(&tracked_weights, instructions)?;
    contestants.extend(of_unet);
    contestants.extend(of_tracked);
    let ours = [forces_of_unet, forces_of_tracked];
    for (model, (input, ours)) in inputs.into_iter().zip(ours).enumerate() {
        let graph = graphs[model](Precision::Float);
        let shape = preprocessors[model].shape();
        let engines = Engines {
            onnxruntime: OnnxRuntime::new(&environment, &graph, shape)?,
            tract: Tract::new(&graph, shape)?,
            rten: Rten::new(graph, shape)?,
            int8: Arc::clone(&quantised[model].engine),
        };
        contestants.extend(engines.contestants(&models[model].name, &input, &ours)?);
    }
    for model in &models {
        contestants.extend(frames(model));
    }
    contestants.push(gated(instructions)?);
    let times = timing::take_turns(&mut contestants, arguments.rounds);

    let report = Report {
        instructions,
        limited,
        sets,
        multiply_adds: UnetNetwork::from_weights(&unet_weights)?.multiply_adds(),
        limit_multiply_adds: peak_multiply_adds(instructions, PEAK_ROUNDS),
        allocations_per_frame: models.iter().map(allocations).max().unwrap_or(0),
        load: std::fs::read_to_string("/proc/loadavg").unwrap_or_default(),
        rounded: quantised.iter().map(|of| of.model).collect(),
        models: models.into_iter().map(|model| model.name).collect(),
        accuracies,
        times,
    };
    if arguments.json {
        println!("{:#}", report.json());
    } else {
        print!("{}", report.table());
    }
    if let Some(path) = &arguments.plot {
        plot::draw(path, &report.points())?;
        eprintln!("wrote {}", path.display());
    }
    Ok(())
}

/// The encoder–decoder alone, from small image to forces, with every instruction set; and the forces.
fn unet(weights: &UnetWeights, sets: &[InstructionSet]) -> Result<(ForceMap, Vec<Contestant>), Failure> {
    let (rest, now) = (small(picture(Shown::Rest)), small(picture(Shown::Dragged)));
    let mut contestants = Vec::new();
    let mut ours = NO_FORCES;
    for &set in sets {
        let mut network = UnetNetwork::from_weights(weights)?
            .with_instructions(set)?
            .with_evaluation(Evaluation::Dense);
        network.set_rest(&rest);
        network.infer(&now, &mut ours);
        contestants.push(Contestant::new(&set.to_string(), move || {
            network.infer(black_box(&now), black_box(&mut NO_FORCES.clone()));
        }));
    }
    Ok((ours, contestants))
}

/// The network after the tracker alone, from the grid of motions to forces, as it is by default and in f32; and the
/// forces in f32 for the picture that the others see.
fn tracked(
    weights: &TrackedWeights,
    instructions: InstructionSet,
) -> Result<(ForceMap, [Contestant; 2]), Failure> {
    let network = TrackedNetwork::from_weights(weights)?.with_instructions(instructions)?;
    let mut single = network.clone().with_precision(NetworkPrecision::F32);
    let mut ours = NO_FORCES;
    single.set_rest(picture(Shown::Rest));
    single.infer(picture(Shown::Dragged), &mut ours);
    let contestant = |name: &str, mut network: TrackedNetwork| {
        // The time does not depend on the values.
        let grid = empty_grid();
        Contestant::new(name, move || {
            network.infer_grid(black_box(&grid), black_box(&mut NO_FORCES.clone()));
        })
    };
    let contestants = [
        contestant(report::AFTER_TRACKER, network),
        contestant(report::AFTER_TRACKER_F32, single),
    ];
    Ok((ours, contestants))
}

/// Other engines with one network's weights.
struct Engines {
    onnxruntime: OnnxRuntime,
    tract: Tract,
    rten: Rten,
    int8: Arc<Mutex<OnnxRuntime>>,
}

impl Engines {
    /// Those in f32 have to agree with our forces.
    fn contestants(
        self,
        name: &str,
        input: &NetworkInput,
        ours: &ForceMap,
    ) -> Result<Vec<Contestant>, Failure> {
        let Self {
            mut onnxruntime,
            tract,
            rten,
            int8,
        } = self;
        same("onnxruntime", ours, &onnxruntime.run(input)?)?;
        same("tract", ours, &tract.run(input)?)?;
        same("rten", ours, &rten.run(input)?)?;
        let [float, quantised, for_tract, for_rten] = [(); 4].map(|()| input.clone());
        Ok(vec![
            Contestant::new(&report::engine(name, "onnxruntime"), move || {
                black_box(onnxruntime.run(black_box(&float)).is_ok());
            }),
            Contestant::new(&report::engine(name, report::INT8), move || {
                let mut int8 = int8.lock().unwrap_or_else(PoisonError::into_inner);
                black_box(int8.run(black_box(&quantised)).is_ok());
            }),
            Contestant::new(&report::engine(name, "tract"), move || {
                black_box(tract.run(black_box(&for_tract)).is_ok());
            }),
            Contestant::new(&report::engine(name, "rten"), move || {
                black_box(rten.run(black_box(&for_rten)).is_ok());
            }),
        ])
    }
}

/// Whole frames from the camera's crop to forces: computed in full, the same again, and with parts changed.
fn frames(model: &Model) -> Vec<Contestant> {
    let Model { name, network } = model;
    let on = |evaluation| {
        let mut network = network.clone().with_evaluation(evaluation);
        network.set_rest(picture(Shown::Rest));
        network
    };
    let now = picture(Shown::Dragged);
    let (mut dense, shown) = (on(Evaluation::Dense), now);
    let mut contestants = vec![Contestant::new(name, move || {
        dense.infer(black_box(shown), black_box(&mut NO_FORCES.clone()));
    })];
    let mut skip = on(Evaluation::Skip);
    contestants.push(Contestant::new(&report::part(name, "same"), move || {
        skip.infer(black_box(now), black_box(&mut NO_FORCES.clone()));
    }));
    for (share, part) in CHANGED {
        let (mut skip, mut film) = (on(Evaluation::Skip), Film::new(share));
        // The camera has just written its picture, so the cache has it, as it has the picture of a full frame.
        let picture = Rc::new(RefCell::new(film.next().to_vec()));
        let written = Rc::clone(&picture);
        contestants.push(Contestant::after(
            &report::part(name, part),
            move || written.borrow_mut().copy_from_slice(film.next()),
            move || skip.infer(black_box(&picture.borrow()), black_box(&mut NO_FORCES.clone())),
        ));
    }
    // Of a camera: the noise of its pictures at rest is known, and each picture of the film has another.
    let rest = picture(Shown::Rest);
    let rests: Vec<Vec<u8>> = (0..REST_PICTURES)
        .map(|number| noisy(rest, number.into()))
        .collect();
    for ((share, _), part) in CHANGED.into_iter().zip(WITH_NOISE) {
        let mut skip = on(Evaluation::SkipNoise);
        skip.learn_noise(&rests);
        let mut film = Film::new(share);
        let shown: Vec<Vec<u8>> = (0..NOISY_PICTURES)
            .map(|number| noisy(film.next(), 1_000 + number))
            .collect();
        let picture = Rc::new(RefCell::new(shown[0].clone()));
        let (written, mut index) = (Rc::clone(&picture), 0);
        contestants.push(Contestant::after(
            &report::part(name, part),
            move || {
                written.borrow_mut().copy_from_slice(&shown[index % shown.len()]);
                index += 1;
            },
            move || skip.infer(black_box(&picture.borrow()), black_box(&mut NO_FORCES.clone())),
        ));
    }
    contestants
}

/// A frame without touch or change as the gate skips it: from the camera's crop to the decision.
fn gated(instructions: InstructionSet) -> Result<Contestant, Failure> {
    let rest = picture(Shown::Rest);
    let crops: Vec<Vec<u8>> = (0..REST_PICTURES)
        .map(|number| noisy(rest, number.into()))
        .collect();
    let frames: Vec<Image88> = crops.iter().map(|crop| small(crop)).collect();
    let mut scene =
        Scene::new(GateKind::default(), &mean_of(&frames), &frames).with_instructions(instructions);
    for frame in &frames {
        let (decision, health) = scene.decide(frame);
        if decision != GateDecision::NoContact {
            return Err(format!(
                "the gate says `{}` ({health}) to a picture at rest, expected `no contact`",
                decision.name()
            )
            .into());
        }
    }
    // Two alternating pictures stay in the cache, as a full frame's picture does and the camera's, just written.
    let (mut now, mut index) = (frames[0], 0);
    Ok(Contestant::new(report::GATED, move || {
        let frame = Frame::new(black_box(&crops[index % 2]), &mut now);
        index += 1;
        black_box(scene.decide(frame.small()));
    }))
}

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
fn allocations(model: &Model) -> u64 {
    let mut network = model.network.clone().with_evaluation(Evaluation::Skip);
    network.set_rest(picture(Shown::Rest));
    let (mut now, mut forces_n) = (picture(Shown::Dragged).to_vec(), NO_FORCES);
    let mut worst = 0;
    for flip in [0, 0, 0x40] {
        now[44_220] ^= flip;
        let counted = allocation_counter::measure(|| network.infer(&now, &mut forces_n));
        worst = worst.max(counted.count_total);
    }
    worst
}
