//! The networks that are measured: the built-in ones, `tracked` with f32 throughout, those in `weights/bench`, and
//! files of the user's.

use std::path::{Path, PathBuf};

use gripline_network::tracked::TrackedNetwork;
use gripline_network::{Architecture, InstructionSet, Network, Precision};

use crate::failure::Failure;

/// Further committed weights, with other widths.
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../network/weights/bench");

/// A network and what it is called in tables.
#[derive(Clone)]
pub(crate) struct Model {
    pub(crate) name: String,
    pub(crate) network: Network,
}

/// All of them; the first two are the built-in ones, by the names of their architectures.
pub(crate) fn all(files: &[PathBuf], instructions: InstructionSet) -> Result<Vec<Model>, Failure> {
    let mut models = Vec::new();
    for architecture in Architecture::ALL {
        models.push(Model {
            name: architecture.name().to_owned(),
            network: Network::embedded(architecture)?.with_instructions(instructions)?,
        });
    }
    models.push(Model {
        name: format!("{} in f32", Architecture::Tracked),
        network: TrackedNetwork::embedded()?
            .with_instructions(instructions)?
            .with_precision(Precision::F32)
            .into(),
    });
    let mut paths = committed()?;
    paths.extend_from_slice(files);
    for path in paths {
        let stem = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy();
        let taken = models
            .iter()
            .filter(|model| model.name.starts_with(&*stem))
            .count();
        let name = if taken == 0 {
            stem.into_owned()
        } else {
            format!("{stem}-{}", taken + 1)
        };
        let network = Network::from_file(&path, None)?.with_instructions(instructions)?;
        models.push(Model { name, network });
    }
    Ok(models)
}

/// What the models are called.
pub(crate) fn names(models: &[Model]) -> impl Iterator<Item = &str> {
    models.iter().map(|model| model.name.as_str())
}

/// Which of these models is the default one.
pub(crate) fn default_of<'a>(mut names: impl Iterator<Item = &'a str>) -> usize {
    let default = Architecture::default().name();
    names.position(|name| name == default).unwrap_or(0)
}

fn committed() -> Result<Vec<PathBuf>, Failure> {
    let folder = Path::new(FOLDER);
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path
            .extension()
            .is_some_and(|extension| extension == "safetensors")
        {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
