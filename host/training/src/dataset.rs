//! Samples of the simulated world on disk and in memory. Each split has a folder of shards, one stream of the
//! simulation each, and a manifest; a shard follows from seed, split and number alone, so an interrupted
//! `generate` goes on where it stopped and ends with the same bytes. Shards of another world are refused rather
//! than silently used. Images in grey levels, forces in newtons per taxel.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use gripline_network::ForceMap;
use gripline_network::constants::{IMAGE_PIXELS, IMAGE_SIDE, MAP_SIDE, TAXELS};
use gripline_network::image::Image88;
use gripline_network::tracked::{GRID_CHANNELS, GRID_NODES, GRID_SIDE, Gather, Grid, Tracker, empty_grid};
use gripline_simulation::contact_world::CellState;
use gripline_simulation::{Counts, Sample, SampleGenerator, SampleWorld, Split};
use indicatif::{ProgressBar, ProgressStyle};
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};
use serde_json::{Value, json};

use crate::constants::{DATA_VERSION, GRID_STEPS, SHARD_SAMPLES, lens};
use crate::error::{TrainingError, at};

/// Samples in memory: images as grey levels, forces in newtons per taxel.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Dataset {
    /// One image per virtual sensor.
    rest: Vec<Image88>,
    /// Which of them belongs to each sample.
    rest_of: Vec<u32>,
    now: Vec<Image88>,
    /// Tracked motions on the grid, in steps of 1/[`GRID_STEPS`].
    grids: Vec<[i16; GRID_CHANNELS * GRID_NODES]>,
    forces_n: Vec<ForceMap>,
    shapes: Vec<String>,
    world: String,
}

impl Dataset {
    pub(crate) fn len(&self) -> usize {
        self.forces_n.len()
    }

    pub(crate) fn rest(&self, index: usize) -> &Image88 {
        &self.rest[self.rest_of[index] as usize]
    }

    pub(crate) fn now(&self, index: usize) -> &Image88 {
        &self.now[index]
    }

    /// The tracked motions as the network sees them: mm, and shares of what is known.
    pub(crate) fn grid(&self, index: usize) -> Box<Grid> {
        let mut grid = empty_grid();
        for (value, &stored) in grid.as_flattened_mut().iter_mut().zip(&self.grids[index]) {
            *value = f32::from(stored) / GRID_STEPS;
        }
        grid
    }

    /// As stored.
    pub(crate) fn stored_grid(&self, index: usize) -> &[i16; GRID_CHANNELS * GRID_NODES] {
        &self.grids[index]
    }

    pub(crate) fn forces_n(&self, index: usize) -> &ForceMap {
        &self.forces_n[index]
    }

    /// Name of the indenter, `none` where nothing touches.
    pub(crate) fn shape(&self, index: usize) -> &str {
        &self.shapes[index]
    }

    /// Fingerprint of the world that made it.
    pub(crate) fn world(&self) -> &str {
        &self.world
    }

    /// Mean and standard deviation of the rest images' grey levels.
    pub(crate) fn rest_levels(&self) -> (f64, f64) {
        let count = (self.rest.len() * IMAGE_PIXELS) as f64;
        let (mut sum, mut squares) = (0.0, 0.0);
        for &pixel in self.rest.as_flattened() {
            sum += f64::from(pixel);
            squares += f64::from(pixel) * f64::from(pixel);
        }
        let mean = sum / count;
        (mean, (squares / count - mean * mean).max(0.0).sqrt())
    }
}

/// Where a split's shards lie and what they are made from.
#[derive(Debug, Clone)]
pub(crate) struct Store {
    directory: PathBuf,
    split: Split,
    seed: u32,
    world: String,
}

impl Store {
    /// The shards of `split` under `data` for this seed and the world of `world_fingerprint`.
    pub(crate) fn new(data: &Path, split: Split, seed: u32, world: &str) -> Self {
        Self {
            directory: data.join(format!("{}-{seed}", split.name())),
            split,
            seed,
            world: world.to_owned(),
        }
    }

    fn shard_path(&self, shard: usize) -> PathBuf {
        self.directory.join(format!("{shard:05}.safetensors"))
    }

    /// Makes the shards that are missing for at least `samples` samples, on all cores, and writes the manifest.
    /// Which core makes what does not change it.
    ///
    /// # Errors
    /// When a file cannot be read or written, or an existing shard is not what its name says.
    pub(crate) fn generate(&self, samples: usize) -> Result<(), TrainingError> {
        std::fs::create_dir_all(&self.directory).map_err(at(&self.directory))?;
        let shards = samples.div_ceil(SHARD_SAMPLES);
        let mut missing = Vec::new();
        for shard in 0..shards {
            if self.shard_path(shard).exists() {
                self.manifest_of(shard)?;
            } else {
                missing.push(shard);
            }
        }
        if !missing.is_empty() {
            self.make(&missing)?;
        }
        self.write_manifest(shards)
    }

    fn make(&self, missing: &[usize]) -> Result<(), TrainingError> {
        let world = SampleWorld::new()?;
        let bar = ProgressBar::new((missing.len() * SHARD_SAMPLES) as u64)
            .with_message(format!("generating {}", self.split.name()))
            .with_style(
                ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} samples, {per_sec}, {eta} left")
                    .expect("the template is fixed"),
            );
        let next = AtomicUsize::new(0);
        let failed: Mutex<Option<TrainingError>> = Mutex::new(None);
        std::thread::scope(|scope| {
            for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
                scope.spawn(|| {
                    while let Some(&shard) = missing.get(next.fetch_add(1, Ordering::Relaxed)) {
                        let mut stream =
                            SampleGenerator::new(&world, self.split, self.stream_seed(shard)).with_crops();
                        let mut eye = Eye::new();
                        let samples: Vec<Seen> = stream
                            .by_ref()
                            .take(SHARD_SAMPLES)
                            .map(|sample| eye.see(sample))
                            .inspect(|_| bar.inc(1))
                            .collect();
                        if let Err(error) = self.write(shard, &samples, stream.counts()) {
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
        match failed.into_inner().expect("all threads have ended") {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// The seed of a shard's stream: user's seed and shard in bits of their own.
    fn stream_seed(&self, shard: usize) -> u64 {
        (u64::from(self.seed) << 32) | shard as u64
    }

    fn write(&self, shard: usize, samples: &[Seen], counts: Counts) -> Result<(), TrainingError> {
        let mut names: Vec<&str> = samples.iter().map(|seen| seen.sample.shape).collect();
        names.sort_unstable();
        names.dedup();
        let mut rest: Vec<(u64, &Image88)> = Vec::new();
        let mut columns = Columns::default();
        for seen in samples {
            let sample = &seen.sample;
            if rest.last().is_none_or(|(sensor, _)| *sensor != sample.sensor) {
                rest.push((sample.sensor, &sample.rest));
            }
            columns.push(seen, rest.len() - 1, &names);
        }
        let images: Vec<u8> = rest.iter().flat_map(|(_, image)| **image).collect();
        let (n, side) = (samples.len(), IMAGE_SIDE);
        let views = [
            ("rest", Dtype::U8, vec![rest.len(), side, side], &images),
            ("rest_of", Dtype::U32, vec![n], &columns.rest_of),
            ("now", Dtype::U8, vec![n, side, side], &columns.now),
            (
                "grid",
                Dtype::I16,
                vec![n, GRID_CHANNELS, GRID_SIDE, GRID_SIDE],
                &columns.grid,
            ),
            (
                "forces_n",
                Dtype::F32,
                vec![n, MAP_SIDE, MAP_SIDE, 3],
                &columns.forces_n,
            ),
            ("states", Dtype::U8, vec![n, MAP_SIDE, MAP_SIDE], &columns.states),
            ("friction", Dtype::F32, vec![n], &columns.friction),
            ("stick_ratio", Dtype::F32, vec![n], &columns.stick_ratio),
            ("gross_slip", Dtype::U8, vec![n], &columns.gross_slip),
            ("shape", Dtype::U8, vec![n], &columns.shape),
            ("sensor", Dtype::U64, vec![n], &columns.sensor),
        ]
        .map(|(name, dtype, shape, bytes)| {
            let view = TensorView::new(dtype, shape, bytes);
            (name, view.expect("the lengths follow from the shapes"))
        });
        let mut per_shape: BTreeMap<&str, usize> = BTreeMap::new();
        for Seen { sample, .. } in samples {
            *per_shape.entry(sample.shape).or_default() += 1;
        }
        let manifest = json!({
            "version": DATA_VERSION,
            "world": self.world,
            "split": self.split.name(),
            "seed": self.seed,
            "shard": shard,
            "samples": n,
            "shape_names": names,
            "samples_of_shape": per_shape,
            "histories": counts.histories,
            "steps": counts.steps,
            "rejected_unsolved": counts.unsolved,
            "rejected_off_surface": counts.off_surface,
            "rejected_overstrained": counts.overstrained,
        });
        // One entry: the order of several is not the same from run to run.
        let manifest = HashMap::from([("manifest".to_owned(), manifest.to_string())]);
        let bytes = serialize(views, Some(manifest)).expect("every view was checked");
        replace(&self.shard_path(shard), &bytes)
    }

    /// The manifest in a shard's file, if it is the shard that its name says.
    fn manifest_of(&self, shard: usize) -> Result<Value, TrainingError> {
        use std::io::Read;
        let path = self.shard_path(shard);
        let wrong = |problem: String| TrainingError::Data {
            path: path.clone(),
            problem,
        };
        let mut file = std::fs::File::open(&path).map_err(at(&path))?;
        let mut length = [0; 8];
        file.read_exact(&mut length).map_err(at(&path))?;
        let mut header = Vec::new();
        file.take(u64::from_le_bytes(length).min(1 << 20))
            .read_to_end(&mut header)
            .map_err(at(&path))?;
        let header: Value = serde_json::from_slice(&header).map_err(|error| wrong(error.to_string()))?;
        let text = header["__metadata__"]["manifest"].as_str().unwrap_or_default();
        let found: Value = serde_json::from_str(text).map_err(|_| wrong("no manifest in it".to_owned()))?;
        for (key, expected) in [
            ("version", json!(DATA_VERSION)),
            ("world", json!(self.world)),
            ("split", json!(self.split.name())),
            ("seed", json!(self.seed)),
            ("shard", json!(shard)),
            ("samples", json!(SHARD_SAMPLES)),
        ] {
            if found[key] != expected {
                return Err(wrong(format!("`{key}` is {}, expected {expected}", found[key])));
            }
        }
        Ok(found)
    }

    /// `manifest.json`: the sum over the first `shards` shards.
    fn write_manifest(&self, shards: usize) -> Result<(), TrainingError> {
        let mut sums: BTreeMap<String, u64> = BTreeMap::new();
        let mut per_shape: BTreeMap<String, u64> = BTreeMap::new();
        for shard in 0..shards {
            let found = self.manifest_of(shard)?;
            for key in [
                "samples",
                "histories",
                "steps",
                "rejected_unsolved",
                "rejected_off_surface",
                "rejected_overstrained",
            ] {
                *sums.entry(key.to_owned()).or_default() += found[key].as_u64().unwrap_or(0);
            }
            for (name, count) in found["samples_of_shape"].as_object().into_iter().flatten() {
                *per_shape.entry(name.clone()).or_default() += count.as_u64().unwrap_or(0);
            }
        }
        let manifest = json!({
            "version": DATA_VERSION,
            "world": self.world,
            "split": self.split.name(),
            "seed": self.seed,
            "shards": shards,
            "totals": sums,
            "samples_of_shape": per_shape,
        });
        let text = format!("{manifest:#}\n");
        replace(&self.directory.join("manifest.json"), text.as_bytes())
    }

    /// The first `samples` samples, generated if they are not there.
    ///
    /// # Errors
    /// Those of [`Self::generate`].
    pub(crate) fn load(&self, samples: usize) -> Result<Dataset, TrainingError> {
        self.generate(samples)?;
        let mut set = Dataset {
            rest: Vec::new(),
            rest_of: Vec::new(),
            now: Vec::new(),
            grids: Vec::new(),
            forces_n: Vec::new(),
            shapes: Vec::new(),
            world: self.world.clone(),
        };
        for shard in 0..samples.div_ceil(SHARD_SAMPLES) {
            self.read_into(shard, &mut set)?;
        }
        set.rest_of.truncate(samples);
        set.now.truncate(samples);
        set.grids.truncate(samples);
        set.forces_n.truncate(samples);
        set.shapes.truncate(samples);
        Ok(set)
    }

    fn read_into(&self, shard: usize, set: &mut Dataset) -> Result<(), TrainingError> {
        let path = self.shard_path(shard);
        let wrong = |problem: String| TrainingError::Data {
            path: path.clone(),
            problem,
        };
        let manifest = self.manifest_of(shard)?;
        let bytes = std::fs::read(&path).map_err(at(&path))?;
        let file = SafeTensors::deserialize(&bytes).map_err(|error| wrong(error.to_string()))?;
        // The count of rest images is the file's own.
        let tensor = |name: &str, dtype: Dtype, shape: &[usize]| match file.tensor(name) {
            Ok(view)
                if view.dtype() == dtype
                    && view.shape().len() == shape.len()
                    && view.shape()[1..] == shape[1..] =>
            {
                Ok(view.data())
            }
            Ok(view) => Err(wrong(format!(
                "`{name}` is {:?} {:?}, expected {dtype:?} {shape:?}",
                view.dtype(),
                view.shape()
            ))),
            Err(_) => Err(wrong(format!("`{name}` is missing"))),
        };
        let n = SHARD_SAMPLES;
        let images = [n, IMAGE_SIDE, IMAGE_SIDE];
        let rest = tensor("rest", Dtype::U8, &images)?.as_chunks().0;
        let now = tensor("now", Dtype::U8, &images)?.as_chunks().0;
        let grids: &[[u8; 2]] = tensor("grid", Dtype::I16, &[n, GRID_CHANNELS, GRID_SIDE, GRID_SIDE])?
            .as_chunks()
            .0;
        let rest_of: &[[u8; 4]] = tensor("rest_of", Dtype::U32, &[n])?.as_chunks().0;
        let forces = tensor("forces_n", Dtype::F32, &[n, MAP_SIDE, MAP_SIDE, 3])?;
        let forces: Vec<f32> = forces
            .as_chunks()
            .0
            .iter()
            .map(|bytes| f32::from_le_bytes(*bytes))
            .collect();
        let forces = forces.as_chunks().0.as_chunks::<TAXELS>().0;
        let shapes = tensor("shape", Dtype::U8, &[n])?;
        let grids = grids.as_chunks::<{ GRID_CHANNELS * GRID_NODES }>().0;
        if [now.len(), grids.len(), rest_of.len(), forces.len(), shapes.len()] != [n; 5] {
            return Err(wrong(format!("its tensors do not all hold {n} samples")));
        }
        let first = set.rest.len();
        for index in rest_of {
            let index = u32::from_le_bytes(*index) as usize;
            if index >= rest.len() {
                return Err(wrong(format!("`rest_of` names image {index} of {}", rest.len())));
            }
            set.rest_of.push((first + index) as u32);
        }
        for &shape in shapes {
            let name = manifest["shape_names"][usize::from(shape)].as_str();
            set.shapes.push(
                name.ok_or_else(|| wrong(format!("`shape` {shape} has no name")))?
                    .to_owned(),
            );
        }
        set.rest.extend_from_slice(rest);
        set.now.extend_from_slice(now);
        set.grids
            .extend(grids.iter().map(|grid| grid.map(i16::from_le_bytes)));
        set.forces_n.extend_from_slice(forces);
        Ok(())
    }
}

/// A sample, and what the tracker makes of it at full resolution.
struct Seen {
    sample: Sample,
    grid: Box<Grid>,
}

/// Tracker and grid of one sensor after the other.
struct Eye {
    tracker: Tracker,
    gather: Gather,
    sensor: Option<u64>,
}

impl Eye {
    fn new() -> Self {
        Self {
            tracker: Tracker::new(),
            gather: Gather::default(),
            sensor: None,
        }
    }

    /// The samples of a sensor follow each other.
    fn see(&mut self, mut sample: Sample) -> Seen {
        // Images at full resolution are two hundred times what is kept.
        let crops = sample.crops.take().expect("the stream was asked for crops");
        if self.sensor != Some(sample.sensor) {
            self.sensor = Some(sample.sensor);
            self.tracker.set_rest(&crops.rest.pixels);
            self.gather = Gather::new(&lens(), self.tracker.particles());
        }
        self.tracker.track(&crops.now.pixels);
        let grid = Box::new(*self.gather.fill(self.tracker.particles(), self.tracker.tracks()));
        Seen { sample, grid }
    }
}

/// A shard's tensors as bytes, sample by sample.
#[derive(Default)]
struct Columns {
    grid: Vec<u8>,
    rest_of: Vec<u8>,
    now: Vec<u8>,
    forces_n: Vec<u8>,
    states: Vec<u8>,
    friction: Vec<u8>,
    stick_ratio: Vec<u8>,
    gross_slip: Vec<u8>,
    shape: Vec<u8>,
    sensor: Vec<u8>,
}

impl Columns {
    fn push(&mut self, Seen { sample, grid }: &Seen, rest: usize, names: &[&str]) {
        // Not a number where nothing touches.
        let value = |value: Option<f64>| value.map_or(f32::NAN, |value| value as f32).to_le_bytes();
        self.rest_of.extend((rest as u32).to_le_bytes());
        self.now.extend(sample.now);
        // Saturates at 2 mm, a third of the skin.
        let stored = grid
            .as_flattened()
            .iter()
            .map(|value| (value * GRID_STEPS).round() as i16);
        self.grid.extend(stored.flat_map(i16::to_le_bytes));
        let forces = sample.forces.as_flattened();
        self.forces_n
            .extend(forces.iter().flat_map(|force| force.to_le_bytes()));
        self.states.extend(sample.states.map(|state| match state {
            CellState::Free => 0,
            CellState::Stick => 1,
            CellState::Slip => 2,
        }));
        self.friction.extend(value(sample.friction));
        self.stick_ratio.extend(value(sample.true_stick_ratio));
        self.gross_slip.push(u8::from(sample.gross_slip));
        let shape = names.iter().position(|name| *name == sample.shape);
        self.shape
            .push(shape.expect("the names are those of the samples") as u8);
        self.sensor.extend(sample.sensor.to_le_bytes());
    }
}

/// CRC-32 of a few samples of a fixed stream: changes whenever the world does.
///
/// # Errors
/// When the world cannot be made.
pub(crate) fn world_fingerprint() -> Result<String, TrainingError> {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut digest = crc.digest();
    let world = SampleWorld::new()?;
    for sample in SampleGenerator::new(&world, Split::Test, 0x0677_2069).take(8) {
        digest.update(&sample.rest);
        digest.update(&sample.now);
        for value in sample.forces.as_flattened() {
            digest.update(&value.to_le_bytes());
        }
    }
    Ok(format!("{:08x}", digest.finalize()))
}

/// Writes under another name first, so that an interrupted run leaves no half file.
fn replace(path: &Path, bytes: &[u8]) -> Result<(), TrainingError> {
    let part = path.with_extension("part");
    std::fs::write(&part, bytes).map_err(at(&part))?;
    std::fs::rename(&part, path).map_err(at(path))
}

#[cfg(test)]
impl Dataset {
    /// Random images and no forces.
    pub(crate) fn noise(samples: usize) -> Self {
        let mut dice = crate::dice::Dice::new(1);
        let mut image = || std::array::from_fn(|_| dice.below(256) as u8);
        Self {
            rest: (0..samples).map(|_| image()).collect(),
            rest_of: (0..samples as u32).collect(),
            now: (0..samples).map(|_| image()).collect(),
            grids: (0..samples)
                .map(|sample| std::array::from_fn(|i| ((i * 7919 + sample * 104_729) % 4001) as i16 - 2000))
                .collect(),
            forces_n: vec![[[0.0; 3]; TAXELS]; samples],
            shapes: vec!["none".to_owned(); samples],
            world: "noise".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interrupted_set_is_completed_to_the_same_bytes_and_another_worlds_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::new(directory.path(), Split::Test, 3, "0123abcd");
        let samples = SHARD_SAMPLES + 10;
        let set = store.load(samples).unwrap();
        assert_eq!(set.len(), samples);
        assert!(set.rest.len() < samples / 4, "{} sensors", set.rest.len());

        let second = store.shard_path(1);
        let bytes = std::fs::read(&second).unwrap();
        let manifest = std::fs::read(store.directory.join("manifest.json")).unwrap();
        std::fs::remove_file(&second).unwrap();
        std::fs::write(second.with_extension("part"), &bytes[..1000]).unwrap();
        assert_eq!(store.load(samples).unwrap(), set);
        assert_eq!(std::fs::read(&second).unwrap(), bytes);
        assert_eq!(
            std::fs::read(store.directory.join("manifest.json")).unwrap(),
            manifest
        );
        let manifest: Value = serde_json::from_slice(&manifest).unwrap();
        assert_eq!(manifest["totals"]["samples"], json!(2 * SHARD_SAMPLES));
        assert_eq!(manifest["totals"]["rejected_unsolved"], json!(0));

        let other = Store::new(directory.path(), Split::Test, 3, "0123abce");
        let error = other.load(10).unwrap_err().to_string();
        assert!(
            error.contains("0123abcd") && error.contains("0123abce") && !error.contains('\n'),
            "{error}"
        );
        std::fs::write(&second, &bytes[..bytes.len() / 2]).unwrap();
        let error = store.load(samples).unwrap_err().to_string();
        assert!(error.contains("00001.safetensors"), "{error}");
    }

    #[test]
    fn a_loaded_sample_is_the_streams() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::new(directory.path(), Split::Calibration, 2, "world");
        let set = store.load(SHARD_SAMPLES).unwrap();
        let world = SampleWorld::new().unwrap();
        let stream = SampleGenerator::new(&world, Split::Calibration, store.stream_seed(0));
        for (i, sample) in stream.take(60).enumerate() {
            assert!(*set.rest(i) == sample.rest && *set.now(i) == sample.now);
            assert!(*set.forces_n(i) == sample.forces && set.shape(i) == sample.shape);
        }
    }
}
