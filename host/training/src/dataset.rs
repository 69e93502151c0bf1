//! Samples of the simulated world, generated once per split and seed and kept in a file, because rendering
//! would otherwise compete with training for the same cores. The file's manifest holds a fingerprint of the
//! world: when the simulation changes, the file is refused rather than silently used.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use gripline_network::ForceMap;
use gripline_network::constants::{IMAGE_PIXELS, IMAGE_SIDE, MAP_SIDE, TAXELS};
use gripline_network::image::Image88;
use gripline_simulation::{Sample, SampleGenerator};
use indicatif::{ProgressBar, ProgressStyle};
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};

use crate::error::{TrainingError, at};

/// Samples drawn from one stream of the simulation; streams run on different cores.
const STREAM_SAMPLES: usize = 250;

/// What a set of samples is for. No two share a stream of the simulation, so no particle pattern either.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Split {
    /// Gradient steps.
    Train,
    /// Early stopping.
    Validation,
    /// The detector's thresholds.
    Calibration,
    /// What is reported.
    Test,
}

impl Split {
    fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Calibration => "calibration",
            Self::Test => "test",
        }
    }

    /// The seed of a stream: user's seed, split and stream in bits of their own.
    fn stream_seed(self, seed: u32, stream: usize) -> u64 {
        (u64::from(seed) << 32) | ((self as u64) << 28) | stream as u64
    }
}

/// Samples in memory: images as grey levels, forces in newtons per taxel.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Dataset {
    rest: Vec<Image88>,
    now: Vec<Image88>,
    forces_n: Vec<ForceMap>,
    world: String,
}

impl Dataset {
    pub(crate) fn len(&self) -> usize {
        self.forces_n.len()
    }

    pub(crate) fn rest(&self, index: usize) -> &Image88 {
        &self.rest[index]
    }

    pub(crate) fn now(&self, index: usize) -> &Image88 {
        &self.now[index]
    }

    pub(crate) fn forces_n(&self, index: usize) -> &ForceMap {
        &self.forces_n[index]
    }

    /// Fingerprint of the world that made it.
    pub(crate) fn world(&self) -> &str {
        &self.world
    }

    /// Mean and standard deviation of the rest images' grey levels.
    pub(crate) fn rest_levels(&self) -> (f64, f64) {
        let count = (self.len() * IMAGE_PIXELS) as f64;
        let (mut sum, mut squares) = (0.0, 0.0);
        for &pixel in self.rest.as_flattened() {
            sum += f64::from(pixel);
            squares += f64::from(pixel) * f64::from(pixel);
        }
        let mean = sum / count;
        (mean, (squares / count - mean * mean).max(0.0).sqrt())
    }

    fn from_samples(samples: impl IntoIterator<Item = Sample>, world: String) -> Self {
        let mut set = Self {
            rest: Vec::new(),
            now: Vec::new(),
            forces_n: Vec::new(),
            world,
        };
        for sample in samples {
            set.rest.push(sample.rest);
            set.now.push(sample.now);
            set.forces_n.push(sample.forces);
        }
        set
    }
}

/// The split's samples: from the file in `directory` if it is there, generated (and kept there) otherwise.
///
/// # Errors
/// When the file cannot be read or written, or holds something else.
pub(crate) fn load_or_generate(
    directory: &Path,
    split: Split,
    seed: u32,
    samples: usize,
) -> Result<Dataset, TrainingError> {
    let path = directory.join(format!("{}-{seed}-{samples}.safetensors", split.name()));
    let world = world_fingerprint();
    if path.exists() {
        return read(&path, &world, samples);
    }
    std::fs::create_dir_all(directory).map_err(at(directory))?;
    let set = generate(split, seed, samples, world);
    write(&path, &set, split, seed)?;
    Ok(set)
}

/// Draws samples on all cores; which core draws what does not change them.
fn generate(split: Split, seed: u32, samples: usize, world: String) -> Dataset {
    let streams = samples.div_ceil(STREAM_SAMPLES);
    let bar = ProgressBar::new(samples as u64)
        .with_message(format!("generating {}", split.name()))
        .with_style(
            ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} samples, {per_sec}, {eta} left")
                .expect("the template is fixed"),
        );
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<Option<Vec<Sample>>>> = Mutex::new((0..streams).map(|_| None).collect());
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                loop {
                    let stream = next.fetch_add(1, Ordering::Relaxed);
                    if stream >= streams {
                        break;
                    }
                    let count = STREAM_SAMPLES.min(samples - stream * STREAM_SAMPLES);
                    let drawn = SampleGenerator::new(split.stream_seed(seed, stream))
                        .take(count)
                        .inspect(|_| bar.inc(1))
                        .collect();
                    done.lock().expect("no thread panics while it holds the lock")[stream] = Some(drawn);
                }
            });
        }
    });
    bar.finish_and_clear();
    let done = done.into_inner().expect("all threads have ended");
    Dataset::from_samples(done.into_iter().flatten().flatten(), world)
}

/// CRC-32 of a few samples of a fixed stream: changes whenever the world does.
fn world_fingerprint() -> String {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut digest = crc.digest();
    for sample in SampleGenerator::new(0x0677_2069).take(4) {
        digest.update(&sample.rest);
        digest.update(&sample.now);
        for value in sample.forces.as_flattened() {
            digest.update(&value.to_le_bytes());
        }
    }
    format!("{:08x}", digest.finalize())
}

fn write(path: &Path, set: &Dataset, split: Split, seed: u32) -> Result<(), TrainingError> {
    let forces: Vec<u8> = set
        .forces_n
        .as_flattened()
        .as_flattened()
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let images = vec![set.len(), IMAGE_SIDE, IMAGE_SIDE];
    let maps = vec![set.len(), MAP_SIDE, MAP_SIDE, 3];
    let views = [
        (
            "rest",
            TensorView::new(Dtype::U8, images.clone(), set.rest.as_flattened()),
        ),
        ("now", TensorView::new(Dtype::U8, images, set.now.as_flattened())),
        ("forces_n", TensorView::new(Dtype::F32, maps, &forces)),
    ]
    .map(|(name, view)| (name, view.expect("the lengths follow from the shapes")));
    let manifest = [
        ("world", set.world.clone()),
        ("split", split.name().to_owned()),
        ("seed", seed.to_string()),
        ("samples", set.len().to_string()),
    ];
    let manifest: HashMap<String, String> = manifest
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value))
        .collect();
    let bytes = serialize(views, Some(manifest)).expect("every view was checked");
    // Under another name first, so that an interrupted run leaves no half file.
    let part = path.with_extension("part");
    std::fs::write(&part, bytes).map_err(at(&part))?;
    std::fs::rename(&part, path).map_err(at(path))
}

fn read(path: &Path, world: &str, samples: usize) -> Result<Dataset, TrainingError> {
    let wrong = |problem: String| TrainingError::Data {
        path: PathBuf::from(path),
        problem,
    };
    let bytes = std::fs::read(path).map_err(at(path))?;
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|error| wrong(error.to_string()))?;
    let found = header
        .metadata()
        .as_ref()
        .and_then(|manifest| manifest.get("world"))
        .cloned();
    if found.as_deref() != Some(world) {
        return Err(wrong(format!("made by world {found:?}, expected {world}")));
    }
    let file = SafeTensors::deserialize(&bytes).map_err(|error| wrong(error.to_string()))?;
    let tensor = |name: &str, dtype: Dtype, shape: &[usize]| match file.tensor(name) {
        Ok(view) if view.dtype() == dtype && view.shape() == shape => Ok(view.data()),
        Ok(view) => Err(wrong(format!(
            "`{name}` is {:?} {:?}, expected {dtype:?} {shape:?}",
            view.dtype(),
            view.shape()
        ))),
        Err(_) => Err(wrong(format!("`{name}` is missing"))),
    };
    let images = [samples, IMAGE_SIDE, IMAGE_SIDE];
    let forces = tensor("forces_n", Dtype::F32, &[samples, MAP_SIDE, MAP_SIDE, 3])?;
    let forces: Vec<f32> = forces
        .as_chunks()
        .0
        .iter()
        .map(|bytes| f32::from_le_bytes(*bytes))
        .collect();
    Ok(Dataset {
        rest: tensor("rest", Dtype::U8, &images)?.as_chunks().0.to_vec(),
        now: tensor("now", Dtype::U8, &images)?.as_chunks().0.to_vec(),
        forces_n: forces.as_chunks().0.as_chunks::<TAXELS>().0.to_vec(),
        world: world.to_owned(),
    })
}

#[cfg(test)]
impl Dataset {
    /// Random images and no forces.
    pub(crate) fn noise(samples: usize) -> Self {
        let mut dice = crate::dice::Dice::new(1);
        let mut image = || std::array::from_fn(|_| dice.below(256) as u8);
        Self {
            rest: (0..samples).map(|_| image()).collect(),
            now: (0..samples).map(|_| image()).collect(),
            forces_n: vec![[[0.0; 3]; TAXELS]; samples],
            world: "noise".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_set_reads_back_and_another_worlds_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("test-1-3.safetensors");
        let set = Dataset::from_samples(SampleGenerator::new(1).take(3), "0123abcd".to_owned());
        write(&path, &set, Split::Test, 1).unwrap();
        assert_eq!(read(&path, "0123abcd", 3).unwrap(), set);
        let error = read(&path, "0123abce", 3).unwrap_err().to_string();
        assert!(
            error.contains("0123abcd") && error.contains("0123abce") && !error.contains('\n'),
            "{error}"
        );
        let error = read(&path, "0123abcd", 4).unwrap_err().to_string();
        assert!(
            error.contains("[3, 88, 88]") || error.contains("[3, 20, 20, 3]"),
            "{error}"
        );
    }

    #[test]
    fn no_two_splits_share_a_stream_of_the_simulation() {
        let splits = [Split::Train, Split::Validation, Split::Calibration, Split::Test];
        let mut seeds = Vec::new();
        for split in splits {
            for seed in 0..3 {
                seeds.extend((0..400).map(|stream| split.stream_seed(seed, stream)));
            }
        }
        let count = seeds.len();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), count);
    }
}
