//! Reads a recording, frame by frame, in memory that does not grow with the file. One that was cut short is read to its
//! last whole frame.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

use gripline_protocol::{ForceMap, SENSORS};
use mcap::McapError;
use mcap::io::MessageReader;

use super::messages::{
    About, FORCE_MAP, Image, PICTURE, REST, STATUS, Stored, fingertip_of, image_of, map_of,
};
use crate::error::Failure;

/// A frame as it lies in the file.
#[derive(Debug)]
pub struct RecordedFrame {
    /// Its status.
    pub status: Stored,
    /// The map as it travelled.
    pub map: Box<ForceMap>,
    /// The picture, when it was recorded.
    pub picture: Option<Image>,
}

/// How a recording ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// As its writer closed it.
    Whole,
    /// Cut short, by a kill or a full disk.
    Cut(String),
}

/// A recording that is being read.
pub struct Reader<R = BufReader<File>> {
    path: PathBuf,
    messages: MessageReader<R>,
    /// What holds for all of it.
    pub about: About,
    /// Pictures without contact of each fingertip; none of the second where there is only one.
    pub rest: [Vec<Vec<u8>>; SENSORS],
    /// Read already while looking for the beginning.
    first: Option<RecordedFrame>,
    ending: Option<Ending>,
}

impl Reader {
    /// Opens a recording and reads up to its first frame.
    ///
    /// # Errors
    /// [`Failure`] when the file cannot be read, is no MCAP, is of another program, or has not one frame.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let file = File::open(path)
            .map_err(|error| Failure::failed(format!("{}: {error}, expected a recording", path.display())))?;
        Self::new(path, BufReader::new(file))
    }
}

impl<R: Read> Reader<R> {
    /// Reads from anywhere; `path` is for messages.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn new(path: &Path, source: R) -> Result<Self, Failure> {
        let mut reader = Self {
            path: path.to_owned(),
            messages: MessageReader::new(source),
            about: About::default(),
            rest: [Vec::new(), Vec::new()],
            first: None,
            ending: None,
        };
        reader.first = reader.read()?;
        if reader.first.is_some() {
            return Ok(reader);
        }
        let found = match &reader.ending {
            Some(Ending::Cut(why)) => format!("found not one frame ({why})"),
            _ => "found not one frame".to_owned(),
        };
        Err(reader.failure(&format!(
            "{found}, expected a recording of `gripline run --record`"
        )))
    }

    fn failure(&self, what: &str) -> Failure {
        Failure::failed(format!("{}: {what}", self.path.display()))
    }

    /// The next frame; `None` at the end, which [`Self::ending`] then tells.
    ///
    /// # Errors
    /// [`Failure`] when a message is not what this program writes, or the file cannot be read.
    pub fn next_frame(&mut self) -> Result<Option<RecordedFrame>, Failure> {
        match self.first.take() {
            Some(first) => Ok(Some(first)),
            None => self.read(),
        }
    }

    /// How it ended; [`Ending::Whole`] while it has not.
    pub fn ending(&self) -> Ending {
        self.ending.clone().unwrap_or(Ending::Whole)
    }

    fn read(&mut self) -> Result<Option<RecordedFrame>, Failure> {
        let (mut picture, mut map) = (None, None);
        if self.ending.is_some() {
            return Ok(None);
        }
        loop {
            let message = match self.messages.next() {
                None => {
                    self.ending = Some(Ending::Whole);
                    return Ok(None);
                }
                Some(Ok(message)) => message,
                Some(Err(McapError::Io(error))) if error.kind() != ErrorKind::UnexpectedEof => {
                    return Err(self.failure(&format!("{error}, expected a file that can be read")));
                }
                Some(Err(error)) => {
                    self.ending = Some(Ending::Cut(error.to_string()));
                    return Ok(None);
                }
            };
            let wrong = |topic: &str| {
                self.failure(&format!(
                    "found a message on {topic} that cannot be read, expected one of gripline {}",
                    env!("CARGO_PKG_VERSION")
                ))
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
                    let status: Stored = serde_json::from_slice(&message.data).map_err(|_| wrong(STATUS))?;
                    if usize::from(status.sensor) >= SENSORS {
                        return Err(wrong(STATUS));
                    }
                    let map = map.ok_or_else(|| wrong(STATUS))?;
                    if self.about == About::default() {
                        let about = About::from_metadata(&message.channel.metadata);
                        self.about = about.ok_or_else(|| wrong(STATUS))?;
                    }
                    return Ok(Some(RecordedFrame { status, map, picture }));
                }
                _ => {}
            }
        }
    }
}
