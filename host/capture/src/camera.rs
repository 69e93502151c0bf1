//! A camera as a source of pictures: a thread of its own takes the newest buffer, crops it and puts it into a mailbox of
//! one. A camera that goes away is opened again as soon as it is back. Nothing queues: pictures that are too late are counted.

use std::any::Any;
use std::collections::VecDeque;
use std::ops::Add;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use serde::Serialize;
use tracing::{debug, info, warn};

use crate::colour::ColourConverter;
use crate::constants::{
    BLACK_LEVEL, DEFAULT_RATE, POLL, REOPEN_EVERY, SETTLING, SILENCE, SILENCE_AT_START, STEADY_LIGHT,
    STOP_CHECK,
};
use crate::convert::Converter;
use crate::driver::{Driver, Port, Ready, Stream};
use crate::error::{CaptureError, PictureError};
use crate::mailbox::{Mailbox, Taken};
use crate::negotiate::{CameraSettings, Negotiated, open};
use crate::sequence::Sequence;

/// What became of the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Counts {
    /// Pictures that arrived, good or not.
    #[serde(rename = "came")]
    pub received: u64,
    /// Pictures that the driver numbered and never delivered.
    pub missed: u64,
    /// Pictures that a newer one replaced before they were used.
    pub overtaken: u64,
    /// Pictures that could not be decoded.
    pub damaged: u64,
    /// How often the camera went away.
    #[serde(rename = "lost")]
    pub disconnects: u64,
    /// How often it came back.
    #[serde(rename = "returned")]
    pub reconnects: u64,
    /// The longest time without it, s.
    pub longest_absence_s: f64,
}

impl Add for Counts {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            received: self.received + other.received,
            missed: self.missed + other.missed,
            overtaken: self.overtaken + other.overtaken,
            damaged: self.damaged + other.damaged,
            disconnects: self.disconnects + other.disconnects,
            reconnects: self.reconnects + other.reconnects,
            longest_absence_s: self.longest_absence_s.max(other.longest_absence_s),
        }
    }
}

/// A crop, when it was taken and when it arrived.
#[derive(Debug)]
pub struct CameraFrame {
    /// 440×440 grey levels, or the sensor's colour crop.
    pub crop: Vec<u8>,
    /// When it was taken: the driver's time stamp, or when its bytes arrived where the driver gives none.
    pub taken_at: Instant,
    /// When its bytes arrived: at the latest one frame interval after the time stamp, then it has waited in the driver's
    /// queue.
    pub received_at: Instant,
    /// Time to make the crop, µs.
    pub decode_us: f64,
}

/// A camera at work.
#[derive(Debug)]
pub struct Camera {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    name: String,
    description: String,
    rate: f64,
}

/// What the two threads share.
#[derive(Debug, Default)]
struct Shared {
    newest: Mailbox<CameraFrame>,
    state: Mutex<State>,
    stop: AtomicBool,
}

#[derive(Debug, Default)]
struct State {
    counts: Counts,
    last_error: Option<String>,
    /// What the panic said that ended the thread.
    panic: Option<String>,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        // Numbers and a text: nothing in there can be half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn count(&self, change: impl FnOnce(&mut Counts)) {
        change(&mut self.state().counts);
    }

    /// Logs an error unless it is the same as the one before.
    fn report(&self, error: &CaptureError) {
        let text = error.to_string();
        let mut state = self.state();
        if state.last_error.as_ref() != Some(&text) {
            warn!("{text}");
            state.last_error = Some(text);
        }
    }

    fn is_running(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }
}

impl Camera {
    /// Opens and sets the camera, and starts its thread.
    ///
    /// # Errors
    /// [`CaptureError`] when the camera cannot be used now.
    pub fn start<P: Port>(port: P, settings: CameraSettings) -> Result<Self, CaptureError>
    where
        <P::Driver as Driver>::Stream: Send,
    {
        Self::start_with(port, settings, || {})
    }

    /// The same; `begin` runs first in the thread that takes and decodes pictures, which may ask for a priority.
    ///
    /// # Errors
    /// [`CaptureError`] when the camera cannot be used now.
    pub fn start_with<P: Port>(
        port: P,
        settings: CameraSettings,
        begin: impl FnOnce() + Send + 'static,
    ) -> Result<Self, CaptureError>
    where
        <P::Driver as Driver>::Stream: Send,
    {
        let first = open(&port, &settings)?;
        let shared = Arc::new(Shared::default());
        let (description, rate) = (first.description.clone(), first.rate.unwrap_or(DEFAULT_RATE));
        let name = first.name.clone();
        let of_thread = Arc::clone(&shared);
        let thread = thread::spawn(move || {
            begin();
            // What both threads share is whole whenever its lock is free.
            let ended = catch_unwind(AssertUnwindSafe(|| {
                keep_open(&port, &settings, first, &of_thread);
            }));
            if let Err(panic) = ended {
                of_thread.state().panic = Some(message_of(panic.as_ref()));
            }
            of_thread.newest.close();
        });
        Ok(Self {
            shared,
            thread: Some(thread),
            name,
            description,
            rate,
        })
    }

    /// The camera without its settings: its place and what it calls itself.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The camera and all its settings, for people.
    #[must_use]
    pub fn description(&self) -> &str {
        &self.description
    }

    /// Frames a second that it promised.
    #[must_use]
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// The newest picture, if one arrives within `wait` that was not handed out before.
    ///
    /// # Errors
    /// [`CaptureError::ThreadPanicked`] when there can be no more.
    pub fn next(&self, wait: Duration) -> Result<Option<CameraFrame>, CaptureError> {
        match self.shared.newest.take(wait) {
            Taken::New(frame) => Ok(Some(frame)),
            Taken::Nothing => Ok(None),
            // Its thread ends before its owner by a panic only.
            Taken::Closed => Err(CaptureError::ThreadPanicked {
                camera: self.description.clone(),
                said: self.shared.state().panic.clone().unwrap_or_default(),
            }),
        }
    }

    /// Takes `count` pictures, one after the other, from when their light is steady: the first pictures of a camera may be dark. A
    /// light that does not become steady within two seconds is taken as it is.
    ///
    /// # Errors
    /// [`CaptureError::NoPictures`] when the camera stops sending; as [`Self::next`].
    pub fn take_frames(&self, count: usize) -> Result<Vec<CameraFrame>, CaptureError> {
        // The camera falls silent, is opened again, and begins.
        let patience = SILENCE + SILENCE_AT_START;
        let mut frames = VecDeque::with_capacity(count);
        let mut settling_until = None;
        let mut last = Instant::now();
        while frames.len() < count {
            if let Some(frame) = self.next(POLL)? {
                last = Instant::now();
                let until = *settling_until.get_or_insert(last + SETTLING);
                frames.push_back((mean_level(&frame.crop), frame));
                while last < until && !is_steady(frames.iter().map(|(level, _)| *level)) {
                    frames.pop_front();
                }
            } else if last.elapsed() > patience {
                let state = self.shared.state();
                return Err(CaptureError::NoPictures {
                    camera: self.description.clone(),
                    found: frames.len(),
                    seconds: patience.as_secs(),
                    damaged: state.counts.damaged,
                    expected: count,
                    advice: state
                        .last_error
                        .clone()
                        .unwrap_or_else(|| "check cable and format".to_owned()),
                });
            }
        }
        Ok(frames.into_iter().map(|(_, frame)| frame).collect())
    }

    /// What became of the pictures so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let mut counts = self.shared.state().counts;
        counts.overtaken += self.shared.newest.overtaken();
        counts
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in the thread has been caught.
            let _ = thread.join();
        }
    }
}

fn mean_level(crop: &[u8]) -> f64 {
    let sum: u64 = crop.iter().map(|level| u64::from(*level)).sum();
    sum as f64 / crop.len().max(1) as f64
}

/// Whether pictures with these mean levels are lit, and alike.
fn is_steady(levels: impl Iterator<Item = f64>) -> bool {
    let range = levels.fold(None, |range, level| {
        let [min, max]: [f64; 2] = range.unwrap_or([level; 2]);
        Some([min.min(level), max.max(level)])
    });
    range.is_none_or(|[min, max]| min >= BLACK_LEVEL && max <= STEADY_LIGHT * min)
}

/// What a panic said.
fn message_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    text.unwrap_or("no message").to_owned()
}

/// Keeps the camera open and the mailbox fresh until the camera is dropped.
fn keep_open<P: Port>(
    port: &P,
    settings: &CameraSettings,
    first: Negotiated<<P::Driver as Driver>::Stream>,
    shared: &Shared,
) {
    let mut camera = first;
    while shared.is_running() {
        let ended = stream(&mut camera, settings, shared);
        // Closes the device, or the next camera could not get its name.
        drop(camera);
        let Err(found) = ended else {
            return;
        };
        let lost_at = Instant::now();
        shared.count(|counts| counts.disconnects += 1);
        shared.report(&CaptureError::Gone {
            camera: port.path(),
            found,
        });
        camera = loop {
            if !shared.is_running() {
                return;
            }
            match open(port, settings) {
                Ok(opened) => break opened,
                Err(CaptureError::Missing { .. } | CaptureError::Gone { .. }) => {}
                Err(other) => shared.report(&other),
            }
            thread::sleep(REOPEN_EVERY);
        };
        let absence_s = lost_at.elapsed().as_secs_f64();
        shared.count(|counts| {
            counts.reconnects += 1;
            counts.longest_absence_s = counts.longest_absence_s.max(absence_s);
        });
        shared.state().last_error = None;
        info!("back after {absence_s:.1} s: {}", camera.description);
    }
}

/// What makes crops of a camera's frames.
enum Cropper {
    Grey(Converter),
    Colour(Box<ColourConverter>),
}

impl Cropper {
    fn of<S>(camera: &Negotiated<S>, settings: &CameraSettings) -> Self {
        let Negotiated {
            format, size, stride, ..
        } = *camera;
        match &settings.colour {
            None => Self::Grey(Converter::new(format, stride)),
            Some(capture) => Self::Colour(Box::new(ColourConverter::new(format, size, stride, capture))),
        }
    }

    fn crop(&mut self, frame: &[u8], crop: &mut Vec<u8>) -> Result<(), PictureError> {
        match self {
            Self::Grey(converter) => converter.crop(frame, crop),
            Self::Colour(converter) => converter.crop(frame, crop),
        }
    }
}

/// Takes pictures until the camera is dropped, or is gone: then the reason.
fn stream<S: Stream>(
    camera: &mut Negotiated<S>,
    settings: &CameraSettings,
    shared: &Shared,
) -> Result<(), String> {
    let mut converter = Cropper::of(camera, settings);
    let mut sequence = Sequence::default();
    let mut crop = Vec::new();
    let (mut last, mut patience) = (Instant::now(), SILENCE_AT_START);
    let interval = Duration::from_secs_f64(1.0 / camera.rate.unwrap_or(DEFAULT_RATE));
    while shared.is_running() {
        let waiting = camera.stream.ready();
        if !waiting.within(STOP_CHECK).map_err(|error| error.to_string())? {
            if last.elapsed() > patience {
                return Err(format!("no picture for {} s", patience.as_secs()));
            }
            continue;
        }
        let buffer = camera.stream.take().map_err(|error| error.to_string())?;
        let dequeued_at = Instant::now();
        (last, patience) = (dequeued_at, SILENCE);
        let taken_at = buffer.taken_at.unwrap_or(dequeued_at).min(dequeued_at);
        let missed = sequence.next(buffer.sequence);
        // With a newer picture there already, this one is not worth decoding.
        let is_overtaken = waiting
            .within(Duration::ZERO)
            .map_err(|error| error.to_string())?;
        shared.count(|counts| {
            counts.received += 1;
            counts.missed += missed;
            counts.overtaken += u64::from(is_overtaken && !buffer.is_damaged);
            counts.damaged += u64::from(buffer.is_damaged);
        });
        if is_overtaken || buffer.is_damaged {
            debug!(
                picture = buffer.sequence,
                missed,
                "dropped: {}",
                if buffer.is_damaged { "damaged" } else { "overtaken" }
            );
            continue;
        }
        match converter.crop(buffer.bytes, &mut crop) {
            Ok(()) => {
                let overtaken = shared.newest.put(CameraFrame {
                    crop: std::mem::take(&mut crop),
                    taken_at,
                    received_at: dequeued_at.min(taken_at + interval),
                    decode_us: dequeued_at.elapsed().as_secs_f64() * 1e6,
                });
                // Its memory serves the next picture.
                crop = overtaken.map_or_else(Vec::new, |overtaken| overtaken.crop);
            }
            Err(error) => {
                debug!(picture = buffer.sequence, "dropped: {error}");
                shared.count(|counts| counts.damaged += 1);
            }
        }
    }
    Ok(())
}
