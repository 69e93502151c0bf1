//! Sets of contacts seen by printed markers, kept on disk in shards that depend on sensor, seed, split and number alone.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use gripline_network::ForceMap;
use gripline_network::constants::TAXELS;
use gripline_network::marker_forces::{MOTION_INPUTS, MarkerMotion, MarkerWeights, MotionGrid};
use gripline_sensor::Sensor;
use gripline_simulation::Split;
use gripline_simulation::printed::{PrintedContacts, PrintedSample, UnitRange};
use indicatif::{ProgressBar, ProgressStyle};
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};

use crate::error::{TrainingError, at};
use crate::shard::replace;

/// Contacts per shard: half a minute of work.
const SHARD_CONTACTS: usize = 200;
/// Units that see each contact of training.
const LOOKS: usize = 3;
/// Counts changes of the world or the layout; shards of others are refused.
const VERSION: u32 = 1;
/// Numbers of a marker: place and motion along x and y, whether it is seen.
const PER_MARKER: usize = 5;

/// A contact seen by a unit.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    pub(super) places_mm: Vec<[f32; 2]>,
    pub(super) motions: Vec<MarkerMotion>,
    pub(super) forces: ForceMap,
    pub(super) shape: String,
    pub(super) zoom: f32,
    /// The network's input and the scale of its output.
    pub(super) input: Box<[f32; MOTION_INPUTS]>,
    pub(super) rms_mm: f32,
}

/// A set.
#[derive(Debug)]
pub(super) struct Samples {
    pub(super) all: Vec<Sample>,
}

impl Samples {
    /// The first `contacts` contacts of a split, made where they are missing, on all cores.
    pub(super) fn load(
        data: &Path,
        sensor: &Sensor,
        split: Split,
        seed: u32,
        contacts: u32,
    ) -> Result<Self, TrainingError> {
        let folder = data.join(format!("markers-{}-{}-{seed}", sensor.identity(), split.name()));
        std::fs::create_dir_all(&folder).map_err(at(&folder))?;
        let shards = (contacts as usize).div_ceil(SHARD_CONTACTS);
        let path = |shard: usize| folder.join(format!("{shard:05}.safetensors"));
        let missing: Vec<usize> = (0..shards).filter(|shard| !path(*shard).exists()).collect();
        let bar = ProgressBar::new((missing.len() * SHARD_CONTACTS) as u64)
            .with_message(format!("contacts, {}", split.name()))
            .with_style(
                ProgressStyle::with_template("{msg} {bar:30} {pos}/{len}, {per_sec}, {eta} left")
                    .expect("the template is fixed"),
            );
        let next = AtomicUsize::new(0);
        let failed: Mutex<Option<TrainingError>> = Mutex::new(None);
        std::thread::scope(|scope| {
            for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
                scope.spawn(|| {
                    while let Some(&shard) = missing.get(next.fetch_add(1, Ordering::Relaxed)) {
                        let looks = if split == Split::Train { LOOKS } else { 1 };
                        let stream = (u64::from(seed) << 32) | shard as u64;
                        let contacts =
                            PrintedContacts::new(sensor, UnitRange::of(sensor), split, stream, looks);
                        let samples: Vec<PrintedSample> = contacts
                            .take(SHARD_CONTACTS * looks)
                            .enumerate()
                            .inspect(|(number, _)| bar.inc(u64::from(number % looks == 0)))
                            .map(|(_, sample)| sample)
                            .collect();
                        if let Err(error) = replace(&path(shard), &bytes(sensor, &samples)) {
                            failed
                                .lock()
                                .expect("no thread panics while it holds the lock")
                                .get_or_insert(error);
                            next.store(missing.len(), Ordering::Relaxed);
                        }
                    }
                });
            }
        });
        bar.finish_and_clear();
        if let Some(error) = failed.into_inner().expect("all threads have ended") {
            return Err(error);
        }
        let mut set = Self { all: Vec::new() };
        for shard in 0..shards {
            set.read(&path(shard), sensor)?;
        }
        Ok(set)
    }

    fn read(&mut self, path: &Path, sensor: &Sensor) -> Result<(), TrainingError> {
        let wrong = |problem: String| TrainingError::Data {
            path: path.to_owned(),
            problem,
        };
        let bytes = std::fs::read(path).map_err(at(path))?;
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|error| wrong(error.to_string()))?;
        let found = header.metadata().as_ref().and_then(|all| all.get("made_for"));
        if found != Some(&made_for(sensor)) {
            return Err(wrong(format!(
                "made for {}, expected {}: remove the folder",
                found.map_or("nothing", String::as_str),
                made_for(sensor)
            )));
        }
        let file = SafeTensors::deserialize(&bytes).map_err(|error| wrong(error.to_string()))?;
        let numbers = |name: &str| {
            let tensor = file.tensor(name).map_err(|error| wrong(error.to_string()))?;
            let values = tensor.data().as_chunks::<4>().0.iter();
            Ok::<Vec<f32>, TrainingError>(values.map(|bytes| f32::from_le_bytes(*bytes)).collect())
        };
        let (markers, counts, zooms) = (numbers("markers")?, numbers("counts")?, numbers("zoom")?);
        let forces = numbers("forces_n")?;
        let forces = forces.as_chunks::<3>().0.as_chunks::<TAXELS>().0;
        let shapes = file.tensor("shapes").map_err(|error| wrong(error.to_string()))?;
        let shapes = String::from_utf8_lossy(shapes.data()).into_owned();
        let mut markers = markers.as_chunks::<PER_MARKER>().0.iter();
        let node_mm = MarkerWeights::node_mm(sensor.view.field_mm);
        for (((count, zoom), forces), shape) in counts.iter().zip(&zooms).zip(forces).zip(shapes.lines()) {
            let own: Vec<&[f32; PER_MARKER]> = markers.by_ref().take(*count as usize).collect();
            let places_mm: Vec<[f32; 2]> = own.iter().map(|[x, y, ..]| [*x, *y]).collect();
            let motions: Vec<MarkerMotion> = own
                .iter()
                .map(|[_, _, x, y, seen]| MarkerMotion {
                    moved_mm: [*x, *y],
                    is_seen: *seen > 0.5,
                })
                .collect();
            let mut input = Box::new([0.0; MOTION_INPUTS]);
            let rms_mm = MotionGrid::new(node_mm, &places_mm).fill(&motions, &mut input);
            self.all.push(Sample {
                places_mm,
                motions,
                forces: *forces,
                shape: shape.to_owned(),
                zoom: *zoom,
                input,
                rms_mm,
            });
        }
        Ok(())
    }
}

fn made_for(sensor: &Sensor) -> String {
    let (gel, markers) = (sensor.gel, sensor.markers);
    format!(
        "world {VERSION}, {}: gel {} mm, {} MPa, {}; field {:?} mm; markers {:?} mm, depth {:?} mm; taxels {} mm",
        sensor.identity(),
        gel.thickness_mm,
        gel.young_mpa,
        gel.poisson,
        sensor.view.field_mm,
        markers.pitch_mm,
        markers.depth_mm,
        sensor.taxels.pitch_mm
    )
}

fn bytes(sensor: &Sensor, samples: &[PrintedSample]) -> Vec<u8> {
    let mut markers: Vec<f32> = Vec::new();
    for sample in samples {
        for (rest, (now, seen)) in sample.rest_mm.iter().zip(&sample.now_mm) {
            markers.extend([rest[0], rest[1], now[0] - rest[0], now[1] - rest[1]].map(|mm| mm as f32));
            markers.push(f32::from(u8::from(*seen)));
        }
    }
    let counts: Vec<f32> = samples.iter().map(|sample| sample.rest_mm.len() as f32).collect();
    let zoom = |sample: &PrintedSample| (sensor.view.field_mm[0] / sample.unit.field_mm()[0]) as f32;
    let zooms: Vec<f32> = samples.iter().map(zoom).collect();
    let forces = samples.iter().flat_map(|sample| sample.forces.as_flattened());
    let forces: Vec<f32> = forces.copied().collect();
    let shapes: Vec<&str> = samples.iter().map(|sample| sample.shape).collect();
    let shapes = shapes.join("\n");
    let le = |values: &[f32]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let columns = [
        ("markers", le(&markers)),
        ("counts", le(&counts)),
        ("zoom", le(&zooms)),
        ("forces_n", le(&forces)),
    ];
    let mut views: Vec<(&str, TensorView<'_>)> = columns
        .iter()
        .map(|(name, bytes)| {
            let view = TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes);
            (*name, view.expect("the length follows from the bytes"))
        })
        .collect();
    let text = TensorView::new(Dtype::U8, vec![shapes.len()], shapes.as_bytes());
    views.push(("shapes", text.expect("the length follows from the bytes")));
    let metadata = HashMap::from([("made_for".to_owned(), made_for(sensor))]);
    serialize(views, Some(metadata)).expect("every view was checked")
}
