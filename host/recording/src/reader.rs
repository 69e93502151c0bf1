//! Reads a recording, frame by frame, in memory that does not grow with the file. A truncated one is read to its last complete
//! frame.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

use gripline_protocol::{ForceMap, SENSORS};
use mcap::McapError;
use mcap::io::MessageReader;
use mcap::sans_io::LinearReaderOptions;

use crate::error::RecordingError;
use crate::force_map::map_of;
use crate::image::{Image, image_of};
use crate::metadata::Metadata;
use crate::status::RecordedStatus;
use crate::topics::{FORCE_MAP, PICTURE, REST, STATUS, fingertip_of};

/// Maximum size of a record, bytes: ours are under 0.2 MB, and a chunk closes at 2 MB.
const RECORD_MAX: u64 = 64 << 20;

/// A frame of a recording.
#[derive(Debug)]
pub struct RecordedFrame {
    /// Its time, nanoseconds since 1970.
    pub at_ns: u64,
    /// Its status.
    pub status: RecordedStatus,
    /// The map in the wire's units.
    pub map: Box<ForceMap>,
    /// The picture, when it was recorded.
    pub picture: Option<Image>,
}

/// Whether a recording was closed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Completeness {
    /// Its writer closed it.
    Whole,
    /// Truncated by a killed process or a full disk.
    Truncated(String),
}

/// A recording that is being read.
pub struct Reader<R = BufReader<File>> {
    path: PathBuf,
    messages: MessageReader<R>,
    /// Its metadata.
    pub metadata: Metadata,
    /// Pictures without contact of each fingertip; none of the second if there is only one.
    pub rest: [Vec<Vec<u8>>; SENSORS],
    /// Already read to find the beginning.
    first: Option<RecordedFrame>,
    completeness: Option<Completeness>,
}

impl Reader {
    /// Opens a recording and reads up to its first frame.
    ///
    /// # Errors
    /// [`RecordingError`] when the file cannot be read, is not MCAP, is of another program, or has no frame.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let file = File::open(path).map_err(|error| RecordingError::Read {
            path: path.to_owned(),
            expected: "a recording",
            error,
        })?;
        Self::begin(path, messages_of(file))
    }
}

/// The messages of a file. A length in it that is greater than the file is an error and allocates nothing.
pub(crate) fn messages_of(file: File) -> MessageReader<BufReader<File>> {
    // A pipe or a device has no size.
    let size = file.metadata().ok().filter(std::fs::Metadata::is_file);
    let size = size.map_or(RECORD_MAX, |metadata| metadata.len());
    messages(BufReader::new(file), size)
}

fn messages<R: Read>(source: R, size: u64) -> MessageReader<R> {
    let limit = size.min(RECORD_MAX) as usize;
    MessageReader::new_with_options(
        source,
        LinearReaderOptions::default().with_record_length_limit(limit),
    )
}

impl<R: Read> Reader<R> {
    /// Reads from anywhere; `path` is for messages.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn new(path: &Path, source: R) -> Result<Self, RecordingError> {
        Self::begin(path, messages(source, RECORD_MAX))
    }

    fn begin(path: &Path, messages: MessageReader<R>) -> Result<Self, RecordingError> {
        let mut reader = Self {
            path: path.to_owned(),
            messages,
            metadata: Metadata::default(),
            rest: [Vec::new(), Vec::new()],
            first: None,
            completeness: None,
        };
        reader.first = reader.read()?;
        if reader.first.is_some() {
            return Ok(reader);
        }
        let found = match &reader.completeness {
            Some(Completeness::Truncated(why)) => format!("not one frame ({why})"),
            _ => "not one frame".to_owned(),
        };
        Err(reader.content_error(found, "a recording of `gripline run --record`"))
    }

    fn content_error(&self, found: String, expected: &'static str) -> RecordingError {
        RecordingError::Content {
            path: self.path.clone(),
            found,
            expected,
        }
    }

    /// The next frame; `None` at the end, which [`Self::completeness`] then describes.
    ///
    /// # Errors
    /// [`RecordingError`] when a message is not what this program writes, or the file cannot be read.
    pub fn next_frame(&mut self) -> Result<Option<RecordedFrame>, RecordingError> {
        match self.first.take() {
            Some(first) => Ok(Some(first)),
            None => self.read(),
        }
    }

    /// Whether the file was closed; [`Completeness::Whole`] until the end was read.
    pub fn completeness(&self) -> Completeness {
        self.completeness.clone().unwrap_or(Completeness::Whole)
    }

    fn read(&mut self) -> Result<Option<RecordedFrame>, RecordingError> {
        let (mut picture, mut map) = (None, None);
        if self.completeness.is_some() {
            return Ok(None);
        }
        loop {
            let message = match self.messages.next() {
                None => {
                    self.completeness = Some(Completeness::Whole);
                    return Ok(None);
                }
                Some(Ok(message)) => message,
                Some(Err(McapError::Io(error))) if error.kind() != ErrorKind::UnexpectedEof => {
                    return Err(RecordingError::Read {
                        path: self.path.clone(),
                        expected: "a file that can be read",
                        error,
                    });
                }
                Some(Err(error)) => {
                    self.completeness = Some(Completeness::Truncated(error.to_string()));
                    return Ok(None);
                }
            };
            let wrong = |topic: &str| {
                let found = format!("a message on {topic} that cannot be read");
                self.content_error(found, concat!("one of gripline ", env!("CARGO_PKG_VERSION")))
            };
            let (topic, sensor) = fingertip_of(&message.channel.topic);
            match topic {
                REST => {
                    let image = image_of(&message.data).ok_or_else(|| wrong(REST))?;
                    self.rest[sensor].push(image.into_crop());
                }
                PICTURE => picture = Some(image_of(&message.data).ok_or_else(|| wrong(PICTURE))?),
                FORCE_MAP => map = Some(map_of(&message.data).ok_or_else(|| wrong(FORCE_MAP))?),
                STATUS => {
                    let status: RecordedStatus =
                        serde_json::from_slice(&message.data).map_err(|_| wrong(STATUS))?;
                    let map = map.ok_or_else(|| wrong(STATUS))?;
                    if self.metadata == Metadata::default() {
                        let metadata = Metadata::from_map(&message.channel.metadata);
                        self.metadata = metadata.ok_or_else(|| wrong(STATUS))?;
                    }
                    return Ok(Some(RecordedFrame {
                        at_ns: message.log_time,
                        status,
                        map,
                        picture,
                    }));
                }
                _ => {}
            }
        }
    }
}
