//! One shard file: safetensors with a manifest in its metadata. Images in grey levels, forces in newtons per taxel.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use gripline_network::constants::{IMAGE_SIDE, MAP_SIDE, TAXELS};
use gripline_network::image::Image88;
use gripline_network::tracked::{GRID_CHANNELS, GRID_NODES, GRID_SIDE, Grid};
use gripline_simulation::contact_world::CellState;
use gripline_simulation::{Counts, Sample, Split};
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};
use serde_json::{Value, json};

use crate::constants::{DATA_VERSION, GRID_STEPS, SHARD_SAMPLES};
use crate::dataset::Dataset;
use crate::error::{TrainingError, at};

/// A sample and its grid of motions, tracked at full resolution.
pub(crate) struct TrackedSample {
    pub(crate) sample: Sample,
    pub(crate) grid: Box<Grid>,
}

/// A shard: where its file lies and what has to be in it.
pub(crate) struct Shard<'a> {
    pub(crate) path: PathBuf,
    /// Fingerprint of the world.
    pub(crate) world: &'a str,
    pub(crate) split: Split,
    pub(crate) seed: u32,
    pub(crate) number: usize,
}

impl Shard<'_> {
    pub(crate) fn write(&self, samples: &[TrackedSample], counts: Counts) -> Result<(), TrainingError> {
        let mut names: Vec<&str> = samples.iter().map(|tracked| tracked.sample.shape).collect();
        names.sort_unstable();
        names.dedup();
        let mut rest: Vec<(u64, &Image88)> = Vec::new();
        let mut columns = Columns::default();
        for tracked in samples {
            let sample = &tracked.sample;
            if rest.last().is_none_or(|(sensor, _)| *sensor != sample.sensor) {
                rest.push((sample.sensor, &sample.rest));
            }
            columns.push(tracked, rest.len() - 1, &names);
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
        for TrackedSample { sample, .. } in samples {
            *per_shape.entry(sample.shape).or_default() += 1;
        }
        let manifest = json!({
            "version": DATA_VERSION,
            "world": self.world,
            "split": self.split.name(),
            "seed": self.seed,
            "shard": self.number,
            "samples": n,
            "shape_names": names,
            "samples_of_shape": per_shape,
            "histories": counts.histories,
            "steps": counts.steps,
            "rejected_unsolved": counts.unsolved,
            "rejected_off_surface": counts.off_surface,
            "rejected_overstrained": counts.overstrained,
        });
        // One entry: the order of several differs from run to run.
        let manifest = HashMap::from([("manifest".to_owned(), manifest.to_string())]);
        let bytes = serialize(views, Some(manifest)).expect("every view was checked");
        replace(&self.path, &bytes)
    }

    /// The manifest in the file, if the file is this shard.
    pub(crate) fn manifest(&self) -> Result<Value, TrainingError> {
        use std::io::Read;
        let path = &self.path;
        let wrong = |problem: String| TrainingError::Data {
            path: path.clone(),
            problem,
        };
        let mut file = std::fs::File::open(path).map_err(at(path))?;
        let mut length = [0; 8];
        file.read_exact(&mut length).map_err(at(path))?;
        let mut header = Vec::new();
        file.take(u64::from_le_bytes(length).min(1 << 20))
            .read_to_end(&mut header)
            .map_err(at(path))?;
        let header: Value = serde_json::from_slice(&header).map_err(|error| wrong(error.to_string()))?;
        let text = header["__metadata__"]["manifest"].as_str().unwrap_or_default();
        let found: Value = serde_json::from_str(text).map_err(|_| wrong("no manifest in it".to_owned()))?;
        for (key, expected) in [
            ("version", json!(DATA_VERSION)),
            ("world", json!(self.world)),
            ("split", json!(self.split.name())),
            ("seed", json!(self.seed)),
            ("shard", json!(self.number)),
            ("samples", json!(SHARD_SAMPLES)),
        ] {
            if found[key] != expected {
                return Err(wrong(format!("`{key}` is {}, expected {expected}", found[key])));
            }
        }
        Ok(found)
    }

    /// Appends the samples to a set.
    pub(crate) fn read_into(&self, set: &mut Dataset) -> Result<(), TrainingError> {
        let path = &self.path;
        let wrong = |problem: String| TrainingError::Data {
            path: path.clone(),
            problem,
        };
        let manifest = self.manifest()?;
        let bytes = std::fs::read(path).map_err(at(path))?;
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
    fn push(&mut self, TrackedSample { sample, grid }: &TrackedSample, rest: usize, names: &[&str]) {
        // NaN without contact.
        let value = |value: Option<f64>| value.map_or(f32::NAN, |value| value as f32).to_le_bytes();
        self.rest_of.extend((rest as u32).to_le_bytes());
        self.now.extend(sample.now);
        self.grid.extend(stored_grid(grid));
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

/// The bytes of a grid as a shard holds it, in steps of 1/[`GRID_STEPS`]; saturates at 2 mm, a third of the elastic layer.
pub(crate) fn stored_grid(grid: &Grid) -> impl Iterator<Item = u8> {
    let steps = |value: &f32| (value * GRID_STEPS).round() as i16;
    grid.as_flattened().iter().map(steps).flat_map(i16::to_le_bytes)
}

/// Writes a file atomically: under another name first.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<(), TrainingError> {
    let part = path.with_extension("part");
    std::fs::write(&part, bytes).map_err(at(&part))?;
    std::fs::rename(&part, path).map_err(at(path))
}
