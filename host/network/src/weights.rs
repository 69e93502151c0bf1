//! The weights file: safetensors (f32) with text metadata: architecture, scaling, calibration, and how it was trained.
//!
//! Reading checks everything first: format, architecture, checksum, and every tensor's name, shape, type and finiteness.
//! The trainer writes with the same code.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors, serialize};

use crate::constants::{WEIGHTS_FILE_MAX_BYTES, WIDTH_MAX, WIDTH_STEP};
use crate::error::NetworkError;
use crate::force_map::Calibration;
use crate::options::Architecture;

/// Identity of the sensor that weights are for which name none.
pub(crate) const PARTICLE_FINGERTIP: &str = "particle-fingertip.1";

/// Metadata entry `format`.
const FORMAT: &str = "gripline-weights-1";

/// End of the name of tensors that hold variances, which cannot be negative.
const VARIANCE: &str = ".variance";

const CHECKSUM: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// One tensor of a weights file, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Sizes, outermost first.
    pub shape: Vec<usize>,
    /// Values; as many as the product of `shape`.
    pub values: Vec<f32>,
}

/// Checks that every expected tensor is there, with its shape and with usable values.
pub(crate) fn check_tensors(
    tensors: &BTreeMap<String, Tensor>,
    expected: Vec<(String, Vec<usize>)>,
) -> Result<(), NetworkError> {
    for (name, expected) in expected {
        let Some(Tensor { shape, values }) = tensors.get(&name) else {
            return Err(NetworkError::MissingTensor { name, expected });
        };
        if *shape != expected || values.len() != expected.iter().product::<usize>() {
            return Err(NetworkError::Shape {
                name,
                found: shape.clone(),
                expected,
            });
        }
        let variance = name.ends_with(VARIANCE);
        let bad = |value: &f32| !value.is_finite() || (variance && *value < 0.0);
        if let Some(index) = values.iter().position(bad) {
            let expected = if variance {
                "a finite number, not negative"
            } else {
                "a finite number"
            };
            return Err(NetworkError::Value {
                name,
                index,
                found: values[index],
                expected,
            });
        }
    }
    Ok(())
}

/// The bytes of a weights file.
///
/// # Panics
/// When a tensor's values do not fill its shape.
pub(crate) fn to_bytes(
    architecture: &str,
    sensor: Option<&str>,
    widths: &[usize],
    numbers: &[(&str, f32)],
    calibration: Calibration,
    manifest: &str,
    tensors: &BTreeMap<String, Tensor>,
) -> Vec<u8> {
    let widths: Vec<String> = widths.iter().map(ToString::to_string).collect();
    let mut metadata: HashMap<String, String> = [
        ("format", FORMAT.to_owned()),
        ("architecture", architecture.to_owned()),
        ("widths", widths.join(",")),
        ("contact_min_n", calibration.contact_min_n.to_string()),
        ("friction", calibration.friction.to_string()),
        ("manifest", manifest.to_owned()),
    ]
    .into_iter()
    .chain(sensor.map(|sensor| ("sensor", sensor.to_owned())))
    .chain(numbers.iter().map(|&(key, value)| (key, value.to_string())))
    .map(|(key, value)| (key.to_owned(), value))
    .collect();
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
pub(crate) struct WeightsFile<'a> {
    metadata: HashMap<String, String>,
    tensors: SafeTensors<'a>,
}

impl<'a> WeightsFile<'a> {
    pub(crate) fn parse(bytes: &'a [u8], architecture: Architecture) -> Result<Self, NetworkError> {
        of_particles(&metadata_of(bytes)?)?;
        Self::parse_named(bytes, architecture.name())
    }

    /// The same for an architecture of this name and any sensor.
    pub(crate) fn parse_named(bytes: &'a [u8], architecture: &str) -> Result<Self, NetworkError> {
        let (header_bytes, header) = SafeTensors::read_metadata(bytes).map_err(not_safetensors)?;
        let file = Self {
            metadata: header.metadata().clone().unwrap_or_default(),
            tensors: SafeTensors::deserialize(bytes).map_err(not_safetensors)?,
        };
        let metadata = file.metadata();
        metadata.expect("format", FORMAT)?;
        metadata.expect("architecture", architecture)?;
        let stated = metadata.text("crc32")?;
        let expected = u32::from_str_radix(stated, 16)
            .map_err(|_| NetworkError::metadata("crc32", stated, "eight hexadecimal digits"))?;
        let found = checksum(metadata.0, &bytes[8 + header_bytes..]);
        if found != expected {
            return Err(NetworkError::Checksum { found, expected });
        }
        Ok(file)
    }

    pub(crate) fn metadata(&self) -> Metadata<'_> {
        Metadata(&self.metadata)
    }

    /// The expected tensors, with names and types checked; others are refused.
    pub(crate) fn tensors(
        &self,
        expected: &[(String, Vec<usize>)],
    ) -> Result<BTreeMap<String, Tensor>, NetworkError> {
        let mut tensors = BTreeMap::new();
        for (name, view) in self.tensors.iter() {
            if !expected.iter().any(|(known, _)| known == name) {
                return Err(NetworkError::UnknownTensor {
                    name: name.to_owned(),
                });
            }
            if view.dtype() != Dtype::F32 {
                return Err(NetworkError::Type {
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
}

/// The bytes of a file that is not longer than any weights file.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, NetworkError> {
    let found = std::fs::metadata(path)?.len();
    if found > WEIGHTS_FILE_MAX_BYTES {
        return Err(NetworkError::TooLong {
            found,
            max: WEIGHTS_FILE_MAX_BYTES,
        });
    }
    Ok(std::fs::read(path)?)
}

/// The metadata of a weights file, unchecked except for its format.
pub(crate) fn metadata_of(bytes: &[u8]) -> Result<HashMap<String, String>, NetworkError> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(not_safetensors)?;
    let metadata = header.metadata().clone().unwrap_or_default();
    Metadata(&metadata).expect("format", FORMAT)?;
    Ok(metadata)
}

/// The checksum that a weights file of ours states.
pub(crate) fn checksum_of(bytes: &[u8]) -> String {
    metadata_of(bytes)
        .ok()
        .and_then(|mut metadata| metadata.remove("crc32"))
        .unwrap_or_default()
}

/// Refuses weights of a sensor without particles, before anything else of them is looked at.
fn of_particles(metadata: &HashMap<String, String>) -> Result<(), NetworkError> {
    match metadata.get("sensor") {
        Some(found) if found != PARTICLE_FINGERTIP => Err(NetworkError::OtherSensor {
            found: found.clone(),
            expected: PARTICLE_FINGERTIP.to_owned(),
        }),
        _ => Ok(()),
    }
}

/// The architecture in a file's metadata.
pub(crate) fn architecture(bytes: &[u8]) -> Result<Architecture, NetworkError> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(not_safetensors)?;
    let metadata = header.metadata().clone().unwrap_or_default();
    let metadata = Metadata(&metadata);
    metadata.expect("format", FORMAT)?;
    of_particles(metadata.0)?;
    let found = metadata.text("architecture")?;
    found
        .parse()
        .map_err(|_| NetworkError::metadata("architecture", found, "`unet` or `tracked`"))
}

#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
fn not_safetensors(error: SafeTensorError) -> NetworkError {
    NetworkError::NotSafetensors {
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
    pub(crate) fn text(&self, key: &'static str) -> Result<&'a str, NetworkError> {
        self.0
            .get(key)
            .map(String::as_str)
            .ok_or(NetworkError::NoMetadata { key })
    }

    fn expect(&self, key: &'static str, expected: &str) -> Result<(), NetworkError> {
        let found = self.text(key)?;
        if found == expected {
            Ok(())
        } else {
            Err(NetworkError::metadata(key, found, format_args!("`{expected}`")))
        }
    }

    /// A finite number above `above` and at most `max`.
    pub(crate) fn number(&self, key: &'static str, above: f32, max: f32) -> Result<f32, NetworkError> {
        let text = self.text(key)?;
        match text.parse::<f32>() {
            Ok(number) if number > above && number <= max => Ok(number),
            _ => Err(NetworkError::metadata(
                key,
                text,
                format_args!("a number above {above}, at most {max}"),
            )),
        }
    }

    /// As [`Self::number`]; `None` where there is none.
    pub(crate) fn optional(
        &self,
        key: &'static str,
        above: f32,
        max: f32,
    ) -> Result<Option<f32>, NetworkError> {
        let is_there = self.0.contains_key(key);
        is_there.then(|| self.number(key, above, max)).transpose()
    }

    pub(crate) fn calibration(&self) -> Result<Calibration, NetworkError> {
        Ok(Calibration {
            contact_min_n: self.number("contact_min_n", 0.0, 1.0)?,
            friction: self.number("friction", 0.0, 2.0)?,
        })
    }

    /// `N` widths of layers.
    pub(crate) fn widths<const N: usize>(&self) -> Result<[usize; N], NetworkError> {
        let key = "widths";
        let text = self.text(key)?;
        let usable = |width: &usize| *width > 0 && *width <= WIDTH_MAX && width.is_multiple_of(WIDTH_STEP);
        let widths: Option<Vec<usize>> = text
            .split(',')
            .map(|width| width.parse().ok().filter(usable))
            .collect();
        let widths = widths.and_then(|widths| widths.try_into().ok());
        let count = match N {
            6 => "six",
            3 => "three",
            _ => "two",
        };
        widths.ok_or_else(|| {
            NetworkError::metadata(
                key,
                text,
                format_args!("{count} multiples of {WIDTH_STEP} from {WIDTH_STEP} to {WIDTH_MAX}"),
            )
        })
    }
}
