//! The folder of results: what belongs into it, whether it belongs to this scene, and files that appear whole or not
//! at all. Touches the world.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::Error;
use gripline_evaluation::play::truth::named;

/// Counts up when the simulated world changes what a scene gives; results of another version are not mixed.
pub(super) const WORLD_VERSION: u32 = 2;
/// The file that says what made the folder.
const MANIFEST: &str = "manifest.toml";

/// What made a folder, and how far it came.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// The scene's file name.
    pub(super) scene: String,
    /// CRC-64 of its text and of the files that it names.
    pub(super) scene_crc64: String,
    pub(super) kind: String,
    pub(super) seed: u64,
    /// `full` or `crop`.
    pub(super) frame_size: String,
    pub(super) world_version: u32,
    pub(super) gripline_version: String,
    /// Whether everything is there.
    pub(super) complete: bool,
    /// Frames that are there once it is complete.
    pub(super) frames: usize,
    pub(super) fingers: usize,
    /// Frames whose indenter is deeper than the linear layer is right for.
    pub(super) too_deep: usize,
    /// Frames that were left out because their contact did not converge.
    pub(super) unsolved: Vec<Unsolved>,
}

/// A frame that was left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Unsolved {
    pub(super) time_s: f64,
    pub(super) phase: String,
    /// The residual, and what would help.
    pub(super) why: String,
}

/// A folder of results.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
}

fn unwritable(path: &Path, error: &io::Error) -> Error {
    Error::failed(format!(
        "{}: cannot be written ({error}), expected a folder that may be written on a disk with room: choose another \
         --out or make room",
        path.display()
    ))
}

fn unreadable(path: &Path, error: &io::Error) -> Error {
    Error::failed(format!(
        "{}: cannot be read ({error}), expected a file of an earlier run: choose another --out",
        path.display()
    ))
}

impl Folder {
    /// Opens or makes the folder for `wanted`; the manifest of an earlier run of the same scene comes back.
    ///
    /// # Errors
    /// Wrong usage when the folder holds something else.
    pub(super) fn open(path: &Path, wanted: &Manifest) -> Result<(Self, Option<Manifest>), Error> {
        let folder = Self {
            path: path.to_owned(),
        };
        let shown = path.display();
        let manifest = path.join(MANIFEST);
        let found = match fs::read_to_string(&manifest) {
            Ok(text) => {
                let found: Manifest = toml::from_str(&text).map_err(|error| {
                    let why = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
                    Error::usage(format!(
                        "--out {shown}: found a {MANIFEST} of another program ({why}), expected one of this scene: \
                         choose another folder"
                    ))
                })?;
                belongs(path, &found, wanted)?;
                Some(found)
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                match fs::read_dir(path) {
                    Ok(mut entries) => {
                        if entries.next().is_some() {
                            return Err(Error::usage(format!(
                                "--out {shown}: found other files, expected an empty folder or results of this \
                                 scene: choose another folder"
                            )));
                        }
                    }
                    Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                    Err(error) => return Err(unwritable(path, &error)),
                }
                None
            }
            Err(error) if path.is_dir() => return Err(unreadable(&manifest, &error)),
            Err(_) => {
                return Err(Error::usage(format!(
                    "--out {shown}: found a file, expected a folder: choose another name"
                )));
            }
        };
        for finger in 0..wanted.fingers {
            let frames = path.join(named("frames", finger));
            fs::create_dir_all(&frames).map_err(|error| unwritable(&frames, &error))?;
        }
        Ok((folder, found))
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a file: it appears whole or not at all.
    pub(super) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), Error> {
        let target = self.path.join(name);
        let partial = target.with_added_extension("partial");
        fs::write(&partial, bytes)
            .and_then(|()| fs::rename(&partial, &target))
            .map_err(|error| unwritable(&target, &error))
    }

    pub(super) fn read(&self, name: &str) -> Result<Vec<u8>, Error> {
        let path = self.path.join(name);
        fs::read(&path).map_err(|error| unreadable(&path, &error))
    }

    pub(super) fn holds(&self, name: &str) -> bool {
        self.path.join(name).is_file()
    }

    pub(super) fn write_manifest(&self, manifest: &Manifest) -> Result<(), Error> {
        let text = toml::to_string(manifest)?;
        let text = format!(
            "# What made this folder; gripline simulate goes on from here when it was interrupted.\n{text}"
        );
        self.write(MANIFEST, text.as_bytes())
    }

    /// Frames that an earlier run has finished, from the first on without a gap.
    pub(super) fn finished(&self, fingers: usize) -> usize {
        let there = |number: usize| (0..fingers).all(|finger| self.holds(&frame_name(number, finger)));
        let mut count = 0;
        while there(count) {
            count += 1;
        }
        count
    }
}

/// Name of a frame's picture.
pub(super) fn frame_name(number: usize, finger: usize) -> String {
    format!("{}/{number:06}.png", named("frames", finger))
}

/// A manifest's identity against the wanted one.
fn belongs(path: &Path, found: &Manifest, wanted: &Manifest) -> Result<(), Error> {
    let pairs = [
        ("scene", &found.scene_crc64, &wanted.scene_crc64),
        ("seed", &found.seed.to_string(), &wanted.seed.to_string()),
        ("frame size", &found.frame_size, &wanted.frame_size),
        (
            "world version",
            &found.world_version.to_string(),
            &wanted.world_version.to_string(),
        ),
    ];
    for (what, found_value, wanted_value) in pairs {
        if found_value != wanted_value {
            let found_value = if what == "scene" {
                format!("{} ({found_value})", found.scene)
            } else {
                found_value.clone()
            };
            return Err(Error::usage(format!(
                "--out {}: found results with {what} {found_value}, expected {wanted_value}: choose another folder",
                path.display()
            )));
        }
    }
    Ok(())
}
