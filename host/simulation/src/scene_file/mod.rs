//! Scene files: what `gripline simulate` plays, in TOML. Text in, scene out; every problem names the key, its line,
//! what was found and expected, and what to do. Units are in the keys' names (mm, N, s, degrees).
//!
//! `keys` lists every key, `section` reads by that list, `sensor`, `indenter`, `press` and `grasp` make the
//! scene.
//! `scenes/README.md` is the reference for people.

mod error;
mod grasp;
mod indenter;
pub mod keys;
mod named_file;
mod press;
mod section;
mod sensor;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use toml::de::DeTable;

pub use error::SceneError;
pub use grasp::{GraspFile, Policy};
pub use indenter::Indenter;
pub use named_file::Load;
pub use press::{PathStep, PressScene};
pub use sensor::Sensor;

use section::{Section, Source};

/// A scene and how it is to be seen.
#[derive(Debug, Clone)]
pub struct SceneFile {
    /// The file.
    pub file: PathBuf,
    /// What is random follows from it.
    pub seed: u64,
    /// Frames a second.
    pub frames_per_second: f64,
    /// Which part of the picture is kept.
    pub frames: FrameSize,
    /// The fingertip; in a grasp, the first one.
    pub sensor: Sensor,
    /// What happens.
    pub scene: Scene,
}

/// Which part of the camera's picture is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameSize {
    /// All of it, 640×480.
    Full,
    /// The middle, 440×440.
    Crop,
}

/// What happens in a scene.
#[derive(Debug, Clone)]
pub enum Scene {
    /// One indenter on one fingertip.
    Press(PressScene),
    /// An object between two fingertips.
    Grasp(Box<GraspFile>),
}

impl SceneFile {
    /// Reads the text of a scene `file`; files that it names are loaded relative to it.
    ///
    /// # Errors
    /// [`SceneError`] for the first problem.
    pub fn parse(file: &Path, text: &str, load: &mut Load) -> Result<Self, SceneError> {
        let source = Source {
            file: file.to_owned(),
            text,
        };
        let document = DeTable::parse(text).map_err(|error| {
            let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
            SceneError {
                file: file.into(),
                line: source.line(error.span().map_or(0, |span| span.start)),
                key: "".into(),
                found: format!("what TOML does not allow ({message})").into(),
                expected: "key = value, [section] or [[section]]".into(),
                advice: "correct this line".into(),
            }
        })?;
        let head = Section::new(&source, document.get_ref(), "", String::new(), 1)?;
        let kind = head.text(&keys::KIND)?;
        let rate_hz = head.number(&keys::FRAMES_PER_SECOND)?;
        let seed = head.whole(&keys::SEED)?;
        let frames = match head.text(&keys::FRAMES)? {
            "crop" => FrameSize::Crop,
            _ => FrameSize::Full,
        };
        let sensor = sensor::read(&head, load)?;
        let scene = match kind {
            "grasp" => Scene::Grasp(Box::new(grasp::read(&head, rate_hz, &sensor, load)?)),
            _ => Scene::Press(press::read(&head, rate_hz, load)?),
        };
        head.finish(&format!("kind = \"{kind}\""))?;
        Ok(Self {
            file: file.to_owned(),
            seed,
            frames_per_second: rate_hz,
            frames,
            sensor,
            scene,
        })
    }

    /// A problem of the scene that shows when it is played, with the line of what asked for it.
    #[must_use]
    pub fn problem(&self, line: usize, found: &str, expected: &str, advice: &str) -> SceneError {
        SceneError {
            file: self.file.as_path().into(),
            line,
            key: "".into(),
            found: found.into(),
            expected: expected.into(),
            advice: advice.into(),
        }
    }
}
