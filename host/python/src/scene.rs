//! `gripline.Scene`: a scene of the simulated world, frame by frame, as `gripline simulate` plays it.

use std::fs;
use std::path::{Path, PathBuf};

use gripline_evaluation::play::truth::{self, Cell};
use gripline_evaluation::play::{self, Moment, Play, PlayError};
use gripline_simulation::Image;
use gripline_simulation::scene_file::{FrameSize, SceneFile};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{or_nan, planes, require_numpy, shaped};
use crate::error::failed;
use crate::shipped_scenes::{SHIPPED, load};
use crate::values::named;
use crate::worker::Worker;

/// The names of the scenes that come with the package.
#[pyfunction]
pub(crate) fn scenes() -> Vec<&'static str> {
    SHIPPED.iter().map(|(name, _)| *name).collect()
}

/// A scene of the simulated world, played frame by frame: iterate over it once.
///
/// scene: the name of a shipped scene (see scenes()) or a TOML file.
/// seed: instead of the scene's.
/// size: 'crop' for pictures of 440x440, 'full' for 640x480; by default what the scene says.
/// pictures: False leaves the pictures out, which is much faster.
///
/// A frame is a dict: truth (by name as in truth.csv; NaN where nothing touches), maps, (F, 3, 20, 20) float32 newtons,
/// and pictures, (F, H, W) uint8 or None; F is the number of fingers. Raises GriplineError for a scene that cannot be
/// read or played. Frames whose contact cannot be solved are left out and listed in unsolved.
#[pyclass(frozen, module = "gripline")]
pub(crate) struct Scene {
    playing: Worker<Playing>,
    /// Names of the truth's values.
    names: Vec<String>,
    /// Frames of the whole scene.
    #[pyo3(get)]
    frames: usize,
    /// Fingers that look.
    #[pyo3(get)]
    fingers: usize,
    /// Frames a second.
    #[pyo3(get)]
    frames_per_second: f64,
    /// The seed.
    #[pyo3(get)]
    seed: u64,
}

/// A scene under way, on its own thread.
struct Playing {
    play: Box<dyn Play>,
    /// Each finger before the first frame.
    rest: Vec<Image>,
    size: FrameSize,
    pictures: bool,
    /// Frames that were solved.
    number: usize,
    unsolved: Vec<(f64, String, String)>,
}

/// What a frame gives, before it is Python's.
struct Shown {
    moment: Moment,
    number: usize,
    pictures: Option<Vec<Image>>,
}

impl Playing {
    fn next(&mut self) -> PyResult<Option<Shown>> {
        loop {
            match self.play.advance() {
                Ok(None) => return Ok(None),
                Ok(Some(moment)) => {
                    let (number, size) = (self.number, self.size);
                    self.number += 1;
                    let fingers = 0..self.play.fingers();
                    let pictures = self
                        .pictures
                        .then(|| fingers.map(|finger| self.play.render(finger, number, size)));
                    let pictures = pictures.map(Iterator::collect);
                    return Ok(Some(Shown {
                        moment,
                        number,
                        pictures,
                    }));
                }
                Err(PlayError::Unsolved { time_s, phase, why }) => self.unsolved.push((time_s, phase, why)),
                Err(PlayError::Impossible(error)) => return Err(failed(error)),
            }
        }
    }
}

/// The scene of this name, else of this file.
fn read(scene: &Path) -> PyResult<SceneFile> {
    let shipped = SHIPPED.iter().find(|(name, _)| Path::new(name) == scene);
    if let Some((name, text)) = shipped {
        return SceneFile::parse(Path::new(&format!("{name}.toml")), text, &mut load).map_err(failed);
    }
    let text = fs::read_to_string(scene).map_err(|error| {
        failed(format!(
            "{}: {error}, expected a scene file in TOML or one of {}",
            scene.display(),
            scenes().join(", ")
        ))
    })?;
    SceneFile::parse(scene, &text, &mut |path: &Path| fs::read(path)).map_err(failed)
}

/// Pictures of one size as an array (F, H, W).
fn stacked(py: Python<'_>, pictures: Vec<Image>) -> PyResult<Bound<'_, PyAny>> {
    let (count, size) = (
        pictures.len(),
        pictures.first().map_or([0, 0], |one| [one.height, one.width]),
    );
    let pixels: Vec<u8> = pictures.into_iter().flat_map(|one| one.pixels).collect();
    Ok(shaped(py, pixels, [count, size[0], size[1]])?.into_any())
}

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (scene, *, seed=None, size=None, pictures=true))]
    fn new(
        py: Python<'_>,
        scene: PathBuf,
        seed: Option<u64>,
        size: Option<&str>,
        pictures: bool,
    ) -> PyResult<Self> {
        require_numpy(py)?;
        let sizes = [("crop", FrameSize::Crop), ("full", FrameSize::Full)];
        let size = size.map(|size| named("size", size, &sizes)).transpose()?;
        if let Some(seed) = seed.filter(|seed| i64::try_from(*seed).is_err()) {
            return Err(PyValueError::new_err(format!(
                "seed: found {seed}, expected at most {}",
                i64::MAX
            )));
        }
        py.detach(move || {
            let file = read(&scene)?;
            let (seed, size) = (seed.unwrap_or(file.seed), size.unwrap_or(file.frames));
            let frames_per_second = file.frames_per_second;
            let playing = Worker::start(move || {
                let mut play = play::open(&file, seed).map_err(failed)?;
                // Before the first frame: the light changes with time.
                let rest = (0..play.fingers())
                    .map(|finger| play.rest(finger, size))
                    .collect();
                Ok(Playing {
                    play,
                    rest,
                    size,
                    pictures,
                    number: 0,
                    unsolved: Vec::new(),
                })
            })?;
            let (frames, fingers, names) = playing.call(|playing| {
                let play = &playing.play;
                let names = truth::names(play.fingers(), play.extra_columns());
                (play.frames(), play.fingers(), names)
            })?;
            Ok(Self {
                playing,
                names,
                frames,
                fingers,
                frames_per_second,
                seed,
            })
        })
    }

    /// Pictures before the first frame, when nothing touches, (F, H, W) uint8.
    #[getter]
    fn rest<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let pictures = py.detach(|| self.playing.call(|playing| playing.rest.clone()))?;
        stacked(py, pictures)
    }

    /// Frames that were left out so far: time (s), phase and why.
    #[getter]
    fn unsolved(&self, py: Python<'_>) -> PyResult<Vec<(f64, String, String)>> {
        py.detach(|| self.playing.call(|playing| playing.unsolved.clone()))
    }

    fn __len__(&self) -> usize {
        self.frames
    }

    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(shown) = py.detach(|| self.playing.call(Playing::next))?? else {
            return Ok(None);
        };
        let truth = PyDict::new(py);
        for (name, cell) in self.names.iter().zip(truth::row(shown.number, &shown.moment)) {
            match cell {
                Cell::Count(count) => truth.set_item(name, count)?,
                Cell::Number(number) => truth.set_item(name, or_nan(number))?,
                Cell::Flag(flag) => truth.set_item(name, flag)?,
                Cell::Text(text) => truth.set_item(name, text)?,
            }
        }
        let fingers = &shown.moment.fingers;
        let maps: Vec<f32> = fingers.iter().flat_map(|finger| planes(&finger.forces)).collect();
        let frame = PyDict::new(py);
        frame.set_item("truth", truth)?;
        frame.set_item("maps", shaped(py, maps, [fingers.len(), 3, 20, 20])?)?;
        let pictures = shown.pictures.map(|pictures| stacked(py, pictures)).transpose()?;
        frame.set_item("pictures", pictures)?;
        Ok(Some(frame))
    }
}
