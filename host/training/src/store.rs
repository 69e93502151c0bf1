//! Sets of samples on disk: a folder of shards per split, each from one random stream of the simulation, and a manifest. A
//! shard depends on seed, split and number alone, so an interrupted `generate` continues and ends with the same bytes.
//! Shards of another world are refused.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use gripline_network::tracked::{GridInterpolator, Tracker};
use gripline_simulation::{Sample, SampleGenerator, SampleWorld, Split};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use crate::constants::{DATA_VERSION, SHARD_SAMPLES, lens};
use crate::dataset::Dataset;
use crate::error::{TrainingError, at};
use crate::shard::{Shard, TrackedSample, replace, stored_grid};

/// The shards of one split on disk.
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

    fn shard(&self, number: usize) -> Shard<'_> {
        Shard {
            path: self.directory.join(format!("{number:05}.safetensors")),
            world: &self.world,
            split: self.split,
            seed: self.seed,
            number,
        }
    }

    /// Generates the missing shards for at least `samples` samples on all cores, and writes the manifest. The bytes do not
    /// depend on the number of cores.
    ///
    /// # Errors
    /// When a file cannot be read or written, or an existing shard is of another world, seed or layout.
    pub(crate) fn generate(&self, samples: usize) -> Result<(), TrainingError> {
        std::fs::create_dir_all(&self.directory).map_err(at(&self.directory))?;
        let shards = samples.div_ceil(SHARD_SAMPLES);
        let mut missing = Vec::new();
        for shard in 0..shards {
            if self.shard(shard).path.exists() {
                self.shard(shard).manifest()?;
            } else {
                missing.push(shard);
            }
        }
        if !missing.is_empty() {
            self.generate_missing(&missing)?;
        }
        self.write_manifest(shards)
    }

    fn generate_missing(&self, missing: &[usize]) -> Result<(), TrainingError> {
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
                        let mut tracker = SampleTracker::new();
                        let samples: Vec<TrackedSample> = stream
                            .by_ref()
                            .take(SHARD_SAMPLES)
                            .map(|sample| tracker.track(sample))
                            .inspect(|_| bar.inc(1))
                            .collect();
                        if let Err(error) = self.shard(shard).write(&samples, stream.counts()) {
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

    /// The seed of a shard's random stream.
    fn stream_seed(&self, shard: usize) -> u64 {
        (u64::from(self.seed) << 32) | shard as u64
    }

    /// `manifest.json`: the sum over the first `shards` shards.
    fn write_manifest(&self, shards: usize) -> Result<(), TrainingError> {
        let mut sums: BTreeMap<String, u64> = BTreeMap::new();
        let mut per_shape: BTreeMap<String, u64> = BTreeMap::new();
        for shard in 0..shards {
            let found = self.shard(shard).manifest()?;
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

    /// The first `samples` samples, generated if missing.
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
            self.shard(shard).read_into(&mut set)?;
        }
        set.rest_of.truncate(samples);
        set.now.truncate(samples);
        set.grids.truncate(samples);
        set.forces_n.truncate(samples);
        set.shapes.truncate(samples);
        Ok(set)
    }
}

/// Tracks the samples of one sensor after the other.
struct SampleTracker {
    tracker: Tracker,
    interpolator: GridInterpolator,
    sensor: Option<u64>,
}

impl SampleTracker {
    fn new() -> Self {
        Self {
            tracker: Tracker::new(),
            interpolator: GridInterpolator::default(),
            sensor: None,
        }
    }

    /// Samples of the same sensor must follow each other.
    fn track(&mut self, mut sample: Sample) -> TrackedSample {
        // Full-resolution images are two hundred times larger than what is kept.
        let crops = sample.crops.take().expect("the stream was asked for crops");
        if self.sensor != Some(sample.sensor) {
            self.sensor = Some(sample.sensor);
            self.tracker.set_rest(&crops.rest.pixels);
            self.interpolator = GridInterpolator::new(&lens(), self.tracker.particles());
        }
        self.tracker.track(&crops.now.pixels);
        let grid = Box::new(
            *self
                .interpolator
                .update(self.tracker.particles(), self.tracker.tracks()),
        );
        TrackedSample { sample, grid }
    }
}

/// Fingerprint of what makes a shard, the simulated world and the tracker: CRC-32 of a few samples of a fixed stream.
///
/// # Errors
/// When the world cannot be made.
pub(crate) fn world_fingerprint() -> Result<String, TrainingError> {
    let world = SampleWorld::new()?;
    let stream = SampleGenerator::new(&world, Split::Test, 0x0677_2069).with_crops();
    let mut tracker = SampleTracker::new();
    Ok(fingerprint(stream.take(8).map(|sample| tracker.track(sample))))
}

fn fingerprint(samples: impl Iterator<Item = TrackedSample>) -> String {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut digest = crc.digest();
    for tracked in samples {
        digest.update(&tracked.sample.rest);
        digest.update(&tracked.sample.now);
        for value in tracked.sample.forces.as_flattened() {
            digest.update(&value.to_le_bytes());
        }
        digest.update(&stored_grid(&tracked.grid).collect::<Vec<u8>>());
    }
    format!("{:08x}", digest.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    #[test]
    fn an_interrupted_set_is_completed_to_the_same_bytes_and_another_worlds_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::new(directory.path(), Split::Test, 3, "0123abcd");
        let samples = SHARD_SAMPLES + 10;
        let set = store.load(samples).unwrap();
        assert_eq!(set.len(), samples);
        assert!(set.rest.len() < samples / 4, "{} sensors", set.rest.len());

        let second = store.shard(1).path;
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
    fn a_fingerprint_tells_worlds_and_trackers_apart() {
        let world = SampleWorld::new().unwrap();
        let of = |change: fn(&mut TrackedSample)| {
            let stream = SampleGenerator::new(&world, Split::Test, 7).with_crops();
            let mut tracker = SampleTracker::new();
            fingerprint(stream.take(2).map(|sample| {
                let mut tracked = tracker.track(sample);
                change(&mut tracked);
                tracked
            }))
        };
        let same = of(|_| ());
        assert_eq!(of(|_| ()), same);
        assert_ne!(of(|tracked| tracked.sample.now[0] ^= 1), same);
        assert_ne!(of(|tracked| tracked.sample.forces[7][2] += 1.0), same);
        assert_ne!(
            of(|tracked| tracked.grid[0][500] += 0.001),
            same,
            "another tracker"
        );
    }

    #[test]
    fn a_loaded_sample_is_that_of_the_stream() {
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
