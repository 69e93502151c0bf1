//! The weights file: safetensors (f32) with text metadata that says which network this is, how its inputs
//! and outputs are scaled, how the detector should read its maps, and how it was trained.
//!
//! Reading checks everything before anything is used: format, architecture, checksum, every tensor's name,
//! shape, type and finiteness. The trainer writes with the same code, so both sides share one definition.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::path::Path;

use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};

use crate::constants::{WEIGHTS_FILE_MAX_BYTES, WIDTH_MAX, WIDTH_STEP};
use crate::network::Architecture;
use crate::unet;

/// What stands in the metadata under `format`.
pub const FORMAT: &str = "gripline-weights-1";

/// What stands in the metadata under `architecture`: the encoder–decoder of this crate.
pub const ARCHITECTURE: &str = "unet";

const CHECKSUM: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// Everything that a weights file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Channels of the network's stages.
    pub widths: Widths,
    /// How images become inputs and outputs become newtons.
    pub scaling: Scaling,
    /// How the detector should read this network's maps.
    pub calibration: Calibration,
    /// How these weights came to be: free text, one line (the trainer writes a JSON object).
    pub manifest: String,
    /// The tensors by name, as [`tensors`](crate::tensors) lists them.
    pub tensors: BTreeMap<String, Tensor>,
}

/// One tensor of a weights file, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Sizes, outermost first.
    pub shape: Vec<usize>,
    /// Values; as many as the product of `shape`.
    pub values: Vec<f32>,
}

/// Channels of the stages of the encoder–decoder, named by the rows (= columns) of their images. Each is a
/// multiple of 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Widths {
    /// After the first strided convolution, 44×44.
    pub encode44: usize,
    /// After the second strided convolution, 22×22.
    pub encode22: usize,
    /// Encoder at 20×20.
    pub encode20: usize,
    /// Encoder and decoder at 10×10.
    pub middle10: usize,
    /// Bottom of the network, 5×5.
    pub bottom5: usize,
    /// Decoder at 20×20.
    pub decode20: usize,
}

/// Fixed linear maps around the network.
///
/// Inputs: channel 0 is `(now − rest) · difference_per_level`, channel 1 is
/// `(rest − rest_level) · rest_per_level`, with images in grey levels 0–255. This recombines the paper's two
/// images without loss. Outputs: force in newtons is `output · newtons_per_output`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scaling {
    /// Input units per grey level of difference between now and rest.
    pub difference_per_level: f32,
    /// Grey level of the rest image that becomes 0.
    pub rest_level: f32,
    /// Input units per grey level of the rest image.
    pub rest_per_level: f32,
    /// Newtons per taxel and unit of output.
    pub newtons_per_output: f32,
}

/// How the slip detector should read this network's maps, found on data used for nothing else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Normal force above which a taxel counts as in contact, newtons.
    pub contact_min_n: f32,
    /// The detector's friction coefficient: below the skin's own (0.45), because predicted maps are smooth.
    pub friction: f32,
}

/// A weights file that cannot be used: which one, and why.
#[derive(Debug, thiserror::Error)]
#[error("weights {origin}: {problem}")]
pub struct WeightsError {
    /// The file's path, or "built in".
    pub origin: String,
    /// What was found and what was expected.
    pub problem: WeightsProblem,
}

/// What is wrong with a weights file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WeightsProblem {
    /// The file could not be read.
    #[error("cannot be read: {0}")]
    Read(#[from] std::io::Error),
    /// The file is larger than any weights file can be.
    #[error("{found} bytes long, expected at most {most}; is this the right file?")]
    TooLong {
        /// Its length.
        found: u64,
        /// The limit.
        most: u64,
    },
    /// The bytes are not safetensors.
    #[error("not a safetensors file ({found}); train one with `gripline-training train`")]
    NotSafetensors {
        /// What the reader met.
        found: String,
    },
    /// A metadata entry is missing.
    #[error("metadata has no entry `{key}`; expected a file written by `gripline-training train`")]
    NoMetadata {
        /// The entry.
        key: &'static str,
    },
    /// A metadata entry has a value that makes no sense.
    #[error("metadata `{key}` is `{found}`, expected {expected}")]
    Metadata {
        /// The entry.
        key: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// Tensors or metadata do not match the checksum written with them.
    #[error("checksum is {found:08x}, expected {expected:08x}; the file is damaged, copy it again")]
    Checksum {
        /// Computed from the file.
        found: u32,
        /// Stated in the file.
        expected: u32,
    },
    /// A tensor that the architecture needs is not there.
    #[error("tensor `{name}` is missing, expected shape {expected:?}")]
    MissingTensor {
        /// Its name.
        name: String,
        /// Its shape.
        expected: Vec<usize>,
    },
    /// A tensor that the architecture does not know.
    #[error("unknown tensor `{name}`; the architecture has no such part")]
    UnknownTensor {
        /// Its name.
        name: String,
    },
    /// A tensor of another shape.
    #[error("tensor `{name}` has shape {found:?}, expected {expected:?}")]
    Shape {
        /// Its name.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// The architecture's.
        expected: Vec<usize>,
    },
    /// A tensor of another type.
    #[error("tensor `{name}` has type {found}, expected F32")]
    Type {
        /// Its name.
        name: String,
        /// Its type.
        found: String,
    },
    /// A weight that is no number one can compute with.
    #[error("tensor `{name}` has {found} at index {index}, expected {expected}")]
    Value {
        /// The tensor's name.
        name: String,
        /// Position in the flattened tensor.
        index: usize,
        /// The value.
        found: f32,
        /// What it may be.
        expected: &'static str,
    },
}

impl Weights {
    /// Reads and checks a weights file.
    ///
    /// # Errors
    /// When it cannot be read or is not a complete, undamaged weights file of a known architecture.
    pub fn from_file(path: &Path) -> Result<Self, WeightsError> {
        read(path)
            .and_then(|bytes| Self::parse(&bytes))
            .map_err(|problem| WeightsError {
                origin: path.display().to_string(),
                problem,
            })
    }

    /// Checks the bytes of a weights file.
    ///
    /// # Errors
    /// The first thing that is wrong: format, architecture, metadata, checksum, then tensors.
    pub fn parse(bytes: &[u8]) -> Result<Self, WeightsProblem> {
        let opened = Opened::parse(bytes, ARCHITECTURE)?;
        let metadata = opened.metadata();
        let widths = metadata.widths()?;
        let weights = Self {
            widths,
            scaling: Scaling {
                difference_per_level: metadata.number("difference_per_level", 0.0, 100.0)?,
                rest_level: metadata.number("rest_level", -1.0, 255.0)?,
                rest_per_level: metadata.number("rest_per_level", 0.0, 100.0)?,
                newtons_per_output: metadata.number("newtons_per_output", 0.0, 100.0)?,
            },
            calibration: Calibration {
                contact_min_n: metadata.number("contact_min_n", 0.0, 1.0)?,
                friction: metadata.number("friction", 0.0, 2.0)?,
            },
            manifest: metadata.text("manifest")?.to_owned(),
            tensors: opened.tensors(&unet::tensors(widths))?,
        };
        weights.check()?;
        Ok(weights)
    }

    /// Checks that every tensor of the architecture is there, with its shape and with usable values.
    ///
    /// # Errors
    /// The first one that is not.
    pub fn check(&self) -> Result<(), WeightsProblem> {
        check_tensors(&self.tensors, unet::tensors(self.widths))
    }

    /// The bytes of a weights file that [`Self::parse`] reads back.
    ///
    /// # Panics
    /// When a tensor's values do not fill its shape, which is the trainer's own mistake.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        to_bytes(&self.tensors, self.metadata())
    }

    fn metadata(&self) -> HashMap<String, String> {
        let Widths {
            encode44,
            encode22,
            encode20,
            middle10,
            bottom5,
            decode20,
        } = self.widths;
        let widths = [encode44, encode22, encode20, middle10, bottom5, decode20].map(|w| w.to_string());
        [
            ("format", FORMAT.to_owned()),
            ("architecture", ARCHITECTURE.to_owned()),
            ("widths", widths.join(",")),
            (
                "difference_per_level",
                self.scaling.difference_per_level.to_string(),
            ),
            ("rest_level", self.scaling.rest_level.to_string()),
            ("rest_per_level", self.scaling.rest_per_level.to_string()),
            ("newtons_per_output", self.scaling.newtons_per_output.to_string()),
            ("contact_min_n", self.calibration.contact_min_n.to_string()),
            ("friction", self.calibration.friction.to_string()),
            ("manifest", self.manifest.clone()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
    }
}

/// Checks that every expected tensor is there, with its shape and with usable values.
pub(crate) fn check_tensors(
    tensors: &BTreeMap<String, Tensor>,
    expected: Vec<(String, Vec<usize>)>,
) -> Result<(), WeightsProblem> {
    for (name, expected) in expected {
        let Some(Tensor { shape, values }) = tensors.get(&name) else {
            return Err(WeightsProblem::MissingTensor { name, expected });
        };
        if *shape != expected || values.len() != expected.iter().product::<usize>() {
            return Err(WeightsProblem::Shape {
                name,
                found: shape.clone(),
                expected,
            });
        }
        let variance = name.ends_with(unet::VARIANCE);
        let bad = |value: &f32| !value.is_finite() || (variance && *value < 0.0);
        if let Some(index) = values.iter().position(bad) {
            let expected = if variance {
                "a finite number, not negative"
            } else {
                "a finite number"
            };
            return Err(WeightsProblem::Value {
                name,
                index,
                found: values[index],
                expected,
            });
        }
    }
    Ok(())
}

/// The bytes of a weights file with these tensors; the checksum is added to the metadata.
pub(crate) fn to_bytes(tensors: &BTreeMap<String, Tensor>, mut metadata: HashMap<String, String>) -> Vec<u8> {
    let data: BTreeMap<&str, (Vec<usize>, Vec<u8>)> = tensors
        .iter()
        .map(|(name, tensor)| {
            let bytes = tensor
                .values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect();
            (name.as_str(), (tensor.shape.clone(), bytes))
        })
        .collect();
    let views = || {
        data.iter().map(|(&name, (shape, bytes))| {
            let view = TensorView::new(Dtype::F32, shape.clone(), bytes);
            (name, view.expect("a tensor's values fill its shape"))
        })
    };
    let serialized = |metadata: &HashMap<String, String>| {
        serialize(views(), Some(metadata.clone())).expect("every view was checked")
    };
    // The checksum covers the tensors in file order, which the serializer chooses: write, look, write.
    let draft = serialized(&metadata);
    let (header_bytes, _) = SafeTensors::read_metadata(&draft).expect("just written");
    let crc = checksum(&metadata, &draft[8 + header_bytes..]);
    metadata.insert("crc32".to_owned(), format!("{crc:08x}"));
    serialized(&metadata)
}

/// A file's metadata and tensors, with format, architecture and checksum found right.
pub(crate) struct Opened<'a> {
    metadata: HashMap<String, String>,
    file: SafeTensors<'a>,
}

impl<'a> Opened<'a> {
    pub(crate) fn parse(bytes: &'a [u8], architecture: &str) -> Result<Self, WeightsProblem> {
        let (header_bytes, header) = SafeTensors::read_metadata(bytes).map_err(not_safetensors)?;
        let file = SafeTensors::deserialize(bytes).map_err(not_safetensors)?;
        let opened = Self {
            metadata: header.metadata().clone().unwrap_or_default(),
            file,
        };
        let metadata = opened.metadata();
        metadata.expect("format", FORMAT)?;
        metadata.expect("architecture", architecture)?;
        let stated = metadata.text("crc32")?;
        let expected = u32::from_str_radix(stated, 16).map_err(|_| WeightsProblem::Metadata {
            key: "crc32",
            found: stated.to_owned(),
            expected: "eight hexadecimal digits".to_owned(),
        })?;
        let found = checksum(metadata.0, &bytes[8 + header_bytes..]);
        if found != expected {
            return Err(WeightsProblem::Checksum { found, expected });
        }
        Ok(opened)
    }

    pub(crate) fn metadata(&self) -> Metadata<'_> {
        Metadata(&self.metadata)
    }

    /// The expected tensors, with names and types checked; any other is refused.
    pub(crate) fn tensors(
        &self,
        expected: &[(String, Vec<usize>)],
    ) -> Result<BTreeMap<String, Tensor>, WeightsProblem> {
        tensors(&self.file, expected)
    }
}

/// The bytes of a file that is not longer than any weights file.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, WeightsProblem> {
    let found = std::fs::metadata(path)?.len();
    if found > WEIGHTS_FILE_MAX_BYTES {
        return Err(WeightsProblem::TooLong {
            found,
            most: WEIGHTS_FILE_MAX_BYTES,
        });
    }
    Ok(std::fs::read(path)?)
}

/// The architecture that a file says it is for.
pub(crate) fn architecture(bytes: &[u8]) -> Result<Architecture, WeightsProblem> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(not_safetensors)?;
    let metadata = header.metadata().clone().unwrap_or_default();
    let metadata = Metadata(&metadata);
    metadata.expect("format", FORMAT)?;
    let found = metadata.text("architecture")?;
    found
        .parse()
        .map_err(|_| wrong("architecture", found, format_args!("`unet` or `tracked`")))
}

#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
fn not_safetensors(error: safetensors::SafeTensorError) -> WeightsProblem {
    WeightsProblem::NotSafetensors {
        found: error.to_string(),
    }
}

/// CRC-32 over the metadata (sorted, without the checksum itself) and the tensors' bytes.
fn checksum(metadata: &HashMap<String, String>, data: &[u8]) -> u32 {
    let mut digest = CHECKSUM.digest();
    let sorted: BTreeMap<_, _> = metadata.iter().filter(|(key, _)| *key != "crc32").collect();
    for (key, value) in sorted {
        digest.update(key.as_bytes());
        digest.update(b"=");
        digest.update(value.as_bytes());
        digest.update(b"\n");
    }
    digest.update(data);
    digest.finalize()
}

/// The metadata of a file, with errors that name the entry.
pub(crate) struct Metadata<'a>(&'a HashMap<String, String>);

impl<'a> Metadata<'a> {
    pub(crate) fn text(&self, key: &'static str) -> Result<&'a str, WeightsProblem> {
        self.0
            .get(key)
            .map(String::as_str)
            .ok_or(WeightsProblem::NoMetadata { key })
    }

    fn expect(&self, key: &'static str, expected: &str) -> Result<(), WeightsProblem> {
        let found = self.text(key)?;
        if found == expected {
            Ok(())
        } else {
            Err(wrong(key, found, format_args!("`{expected}`")))
        }
    }

    /// A finite number above `above` and at most `most`.
    pub(crate) fn number(&self, key: &'static str, above: f32, most: f32) -> Result<f32, WeightsProblem> {
        let text = self.text(key)?;
        match text.parse::<f32>() {
            Ok(number) if number > above && number <= most => Ok(number),
            _ => Err(wrong(
                key,
                text,
                format_args!("a number above {above}, at most {most}"),
            )),
        }
    }

    fn widths(&self) -> Result<Widths, WeightsProblem> {
        let [encode44, encode22, encode20, middle10, bottom5, decode20] = self.widths_of()?;
        Ok(Widths {
            encode44,
            encode22,
            encode20,
            middle10,
            bottom5,
            decode20,
        })
    }

    /// `N` widths of layers.
    pub(crate) fn widths_of<const N: usize>(&self) -> Result<[usize; N], WeightsProblem> {
        let key = "widths";
        let text = self.text(key)?;
        let usable = |width: &usize| *width > 0 && *width <= WIDTH_MAX && width.is_multiple_of(WIDTH_STEP);
        let widths: Option<Vec<usize>> = text
            .split(',')
            .map(|width| width.parse().ok().filter(usable))
            .collect();
        let widths = widths.and_then(|widths| widths.try_into().ok());
        let count = if N == 6 { "six" } else { "three" };
        widths.ok_or_else(|| {
            wrong(
                key,
                text,
                format_args!("{count} multiples of {WIDTH_STEP} from {WIDTH_STEP} to {WIDTH_MAX}"),
            )
        })
    }
}

pub(crate) fn wrong(key: &'static str, found: &str, expected: fmt::Arguments<'_>) -> WeightsProblem {
    WeightsProblem::Metadata {
        key,
        found: found.to_owned(),
        expected: expected.to_string(),
    }
}

/// The tensors of a file that the architecture knows, with their names and types checked.
fn tensors(
    file: &SafeTensors<'_>,
    expected: &[(String, Vec<usize>)],
) -> Result<BTreeMap<String, Tensor>, WeightsProblem> {
    let mut tensors = BTreeMap::new();
    for (name, view) in file.iter() {
        if !expected.iter().any(|(known, _)| known == name) {
            return Err(WeightsProblem::UnknownTensor {
                name: name.to_owned(),
            });
        }
        if view.dtype() != Dtype::F32 {
            return Err(WeightsProblem::Type {
                name: name.to_owned(),
                found: format!("{:?}", view.dtype()),
            });
        }
        let values = view
            .data()
            .as_chunks()
            .0
            .iter()
            .map(|bytes| f32::from_le_bytes(*bytes))
            .collect();
        tensors.insert(
            name.to_owned(),
            Tensor {
                shape: view.shape().to_vec(),
                values,
            },
        );
    }
    Ok(tensors)
}
