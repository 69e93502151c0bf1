//! How fast and how good the force networks are. Time: by instruction set, against onnxruntime and tract with the same
//! weights on one thread, against this processor's own limit, what skipping saves, what a frame costs that the gate
//! skips. Error: on shapes and sensors of the test world that none was trained on. Run by `cargo xtask bench network`.
//!
//! All contestants take turns, a few frames each, so that what else the machine does falls on all of them.

mod accuracy;
mod models;
mod onnx;
mod peers;
mod pictures;
mod plot;
mod question;
mod report;
mod timing;

use std::hint::black_box;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

use gripline_network::image::Image88;
use gripline_network::scene::{GateKind, Scene, Verdict, mean_of};
use gripline_network::tracked::{Precision as Numbers, TrackedNetwork, TrackedWeights, empty_grid};
use gripline_network::weights::Weights;
use gripline_network::{Evaluation, ForceMap, ForceNetwork, InstructionSet, downsample_440_to_88, spin};
use gripline_simulation::constants::REST_PICTURES;

use accuracy::Rounded;
use models::Model;
use onnx::Precision;
use peers::{OnnxRuntime, Tract};
use pictures::Film;
use question::{Eye, Question, small};
use report::Report;
use timing::Contestant;

/// Whatever stops the measurement; it is printed and nothing else.
type Failure = Box<dyn std::error::Error>;

const UNET: &[u8] = include_bytes!("../../../weights/unet.safetensors");
const TRACKED: &[u8] = include_bytes!("../../../weights/tracked.safetensors");

/// Largest difference between two engines' forces, in shares of the largest force: else they do not run the
/// same network.
const SAME: f32 = 1e-4;

/// Rounds of multiply-adds per measurement of the limit: some 20 to 100 µs.
const SPIN_ROUNDS: usize = 30_000;

/// Shares of the image's area that change between frames in the measurement of skipping, and what they are called.
const CHANGED: [(f64, &str); 2] = [(0.1, "10 %"), (0.3, "30 %")];

/// Makes a network's graph for other engines.
type Graph<'a> = &'a dyn Fn(Precision) -> Vec<u8>;

struct Arguments {
    onnxruntime: PathBuf,
    weights: Vec<PathBuf>,
    plot: Option<PathBuf>,
    json: bool,
    rounds: usize,
    samples: usize,
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
        weights: Vec::new(),
        plot: None,
        json: false,
        rounds: 150,
        samples: 1500,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word}: expected a value after it"));
        let number = |text: String, least: usize| -> Result<usize, Failure> {
            let number = text.parse().ok().filter(|&number| number >= least);
            Ok(number.ok_or(format!(
                "{word}: found `{text}`, expected a number from {least} on"
            ))?)
        };
        match word.as_str() {
            "--onnxruntime" => arguments.onnxruntime = value()?.into(),
            "--weights" => arguments.weights.push(value()?.into()),
            "--plot" => arguments.plot = Some(value()?.into()),
            "--rounds" => arguments.rounds = number(value()?, 1)?,
            "--samples" => arguments.samples = number(value()?, 500)?,
            "--json" => arguments.json = true,
            _ => {
                return Err(format!(
                    "argument `{word}` is unknown, expected --onnxruntime LIBRARY, --weights FILE, --plot FILE, --rounds N, --samples N or --json"
                )
                .into());
            }
        }
    }
    Ok(arguments)
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let models = models::all(&arguments.weights)?;
    let (unet_weights, tracked_weights) = (Weights::parse(UNET)?, TrackedWeights::parse(TRACKED)?);
    let environment = peers::environment(&arguments.onnxruntime)?;
    // In the order of `models`, whose first two have these weights.
    let mut eyes = [Eye::unet(&unet_weights), Eye::tracked(&tracked_weights)];
    let graphs: [Graph; 2] = [&|precision| onnx::unet(&unet_weights, precision), &|precision| {
        onnx::tracked(&tracked_weights, precision)
    }];
    let mut rounded = Vec::new();
    for (model, (eye, graph)) in eyes.iter().zip(graphs).enumerate() {
        rounded.push(Rounded {
            model,
            eye: eye.clone(),
            engine: Arc::new(Mutex::new(peers::int8(&environment, eye.clone(), graph)?)),
        });
    }

    eprintln!(
        "{} samples of the test world (shapes and sensors that no network was trained on), made here ...",
        arguments.samples
    );
    let accuracies = accuracy::measure(&models, &rounded, arguments.samples)?;

    let widest = InstructionSet::widest();
    let sets: Vec<InstructionSet> = InstructionSet::ALL
        .into_iter()
        .filter(|set| set.is_available())
        .collect();
    eprintln!("taking turns ...");
    let mut contestants = vec![Contestant::new("limit", move || {
        black_box(spin(widest, black_box(SPIN_ROUNDS)));
    })];
    let (rest, now) = (pictures::picture(0.0), pictures::picture(6.0));
    let questions = eyes.each_mut().map(|eye| {
        eye.set_rest(&rest);
        eye.question(&now)
    });
    let (forces_of_unet, of_unet) = unet(&unet_weights, &sets)?;
    let (forces_of_tracked, of_tracked) = tracked(&tracked_weights)?;
    contestants.extend(of_unet);
    contestants.extend(of_tracked);
    let ours = [forces_of_unet, forces_of_tracked];
    for (model, (question, ours)) in questions.into_iter().zip(ours).enumerate() {
        let graph = graphs[model](Precision::Float);
        let shape = eyes[model].shape();
        let engines = Engines {
            onnxruntime: OnnxRuntime::new(&environment, &graph, shape)?,
            tract: Tract::new(&graph, shape)?,
            int8: Arc::clone(&rounded[model].engine),
        };
        contestants.extend(engines.contestants(&models[model].name, &question, &ours)?);
    }
    for model in &models {
        contestants.extend(frames(model));
    }
    contestants.push(gated()?);
    let times = timing::take_turns(&mut contestants, arguments.rounds);

    let report = Report {
        widest,
        sets,
        multiply_adds: ForceNetwork::from_weights(&unet_weights)?.multiply_adds(),
        limit_multiply_adds: spin(widest, SPIN_ROUNDS),
        allocations_per_frame: models.iter().map(allocations).max().unwrap_or(0),
        load: std::fs::read_to_string("/proc/loadavg").unwrap_or_default(),
        rounded: rounded.iter().map(|of| of.model).collect(),
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

const NOTHING: ForceMap = [[0.0; 3]; 400];

/// The encoder–decoder alone, from small image to forces, with every instruction set; and the forces.
fn unet(weights: &Weights, sets: &[InstructionSet]) -> Result<(ForceMap, Vec<Contestant>), Failure> {
    let (rest, now) = (small(&pictures::picture(0.0)), small(&pictures::picture(6.0)));
    let mut contestants = Vec::new();
    let mut ours = NOTHING;
    for &set in sets {
        let mut network = ForceNetwork::from_weights(weights)?
            .with_instructions(set)?
            .with_evaluation(Evaluation::Dense);
        network.set_rest(&rest);
        network.infer(&now, &mut ours);
        contestants.push(Contestant::new(&set.to_string(), move || {
            network.infer(black_box(&now), black_box(&mut NOTHING.clone()));
        }));
    }
    Ok((ours, contestants))
}

/// The network behind the tracker alone, from the grid of motions to forces, as it is by default and in f32; and the
/// forces in f32 for the picture that the others see.
fn tracked(weights: &TrackedWeights) -> Result<(ForceMap, [Contestant; 2]), Failure> {
    let network = TrackedNetwork::from_weights(weights)?;
    let mut single = network.clone().with_precision(Numbers::Single);
    let mut ours = NOTHING;
    single.set_rest(&pictures::picture(0.0));
    single.infer(&pictures::picture(6.0), &mut ours);
    let contestant = |name: &str, mut network: TrackedNetwork| {
        // Numbers do not matter to its time.
        let grid = empty_grid();
        Contestant::new(name, move || {
            network.infer_grid(black_box(&grid), black_box(&mut NOTHING.clone()));
        })
    };
    let contestants = [
        contestant(report::BEHIND_TRACKER, network),
        contestant(report::BEHIND_TRACKER_F32, single),
    ];
    Ok((ours, contestants))
}

/// Other engines with one network's weights.
struct Engines {
    onnxruntime: OnnxRuntime,
    tract: Tract,
    int8: Arc<Mutex<OnnxRuntime>>,
}

impl Engines {
    /// Those in f32 have to agree with our forces.
    fn contestants(
        self,
        name: &str,
        question: &Question,
        ours: &ForceMap,
    ) -> Result<Vec<Contestant>, Failure> {
        let Self {
            mut onnxruntime,
            tract,
            int8,
        } = self;
        same("onnxruntime", ours, &onnxruntime.run(question)?)?;
        same("tract", ours, &tract.run(question)?)?;
        let [float, rounded, other] = [(); 3].map(|()| question.clone());
        Ok(vec![
            Contestant::new(&report::engine(name, "onnxruntime"), move || {
                black_box(onnxruntime.run(black_box(&float)).is_ok());
            }),
            Contestant::new(&report::engine(name, report::INT8), move || {
                let mut int8 = int8.lock().unwrap_or_else(PoisonError::into_inner);
                black_box(int8.run(black_box(&rounded)).is_ok());
            }),
            Contestant::new(&report::engine(name, "tract"), move || {
                black_box(tract.run(black_box(&other)).is_ok());
            }),
        ])
    }
}

/// Whole frames from the camera's crop to forces: computed in full, the same again, and with parts changed.
fn frames(model: &Model) -> Vec<Contestant> {
    let Model { name, network } = model;
    let on = |evaluation| {
        let mut network = network.clone().with_evaluation(evaluation);
        network.set_rest(&pictures::picture(0.0));
        network
    };
    let now = pictures::picture(6.0);
    let (mut dense, shown) = (on(Evaluation::Dense), now.clone());
    let mut contestants = vec![Contestant::new(name, move || {
        dense.infer(black_box(&shown), black_box(&mut NOTHING.clone()));
    })];
    let mut skip = on(Evaluation::Skip);
    contestants.push(Contestant::new(&report::part(name, "same"), move || {
        skip.infer(black_box(&now), black_box(&mut NOTHING.clone()));
    }));
    for (share, part) in CHANGED {
        let (mut skip, mut film) = (on(Evaluation::Skip), Film::new(share));
        contestants.push(Contestant::new(&report::part(name, part), move || {
            skip.infer(black_box(film.next()), black_box(&mut NOTHING.clone()));
        }));
    }
    contestants
}

/// A frame without touch or change as the gate skips it: from the camera's crop to the verdict.
fn gated() -> Result<Contestant, Failure> {
    let rest = pictures::picture(0.0);
    let crops: Vec<Vec<u8>> = (0..REST_PICTURES)
        .map(|number| pictures::noisy(&rest, number.into()))
        .collect();
    let frames: Vec<Image88> = crops.iter().map(|crop| small(crop)).collect();
    let mut scene = Scene::new(GateKind::default(), &mean_of(&frames), &frames);
    for frame in &frames {
        let (verdict, health) = scene.look(frame);
        if verdict != Verdict::NoContact {
            return Err(format!(
                "the gate says `{}` ({health}) to a picture at rest, expected `no contact`",
                verdict.name()
            )
            .into());
        }
    }
    // Two that take turns stay in the cache, as the one picture of a full frame does; so does the camera's, just written.
    let (mut now, mut frame) = (frames[0], 0);
    Ok(Contestant::new(report::GATED, move || {
        downsample_440_to_88(black_box(&crops[frame % 2]), &mut now);
        frame += 1;
        black_box(scene.look(&now));
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
    network.set_rest(&pictures::picture(0.0));
    let (mut now, mut forces_n) = (pictures::picture(6.0), NOTHING);
    let mut worst = 0;
    for flip in [0, 0, 0x40] {
        now[44_220] ^= flip;
        let counted = allocation_counter::measure(|| network.infer(&now, &mut forces_n));
        worst = worst.max(counted.count_total);
    }
    worst
}
