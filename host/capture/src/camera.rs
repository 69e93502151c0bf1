//! A camera as a source of pictures: a thread of its own takes the newest buffer, makes a crop of it and leaves it in a
//! mailbox of one. A camera that goes away is opened again as soon as it is back. Nothing waits in a queue: what comes
//! too late is counted.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::constants::{PATIENCE, POLL, RATE, REOPEN_EVERY, SILENCE};
use super::convert::Converter;
use super::device::{Driver, Port, Ready, Stream};
use super::error::CameraError;
use super::negotiate::{CameraSettings, Negotiated, open};
use super::sequence::Sequence;
use crate::mailbox::{Mailbox, Taken};
use gripline_recording::error::Failure;

/// What became of the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Counts {
    /// Pictures that came, good or not.
    pub came: u64,
    /// Pictures that the driver numbered and that never came.
    pub missed: u64,
    /// Pictures that a newer one overtook before they were looked at.
    pub overtaken: u64,
    /// Pictures that could not be decoded.
    pub damaged: u64,
    /// How often the camera went away.
    pub lost: u64,
    /// How often it came back.
    pub returned: u64,
    /// The longest time without it, s.
    pub longest_absence_s: f64,
}

impl Counts {
    /// Of two cameras together.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            came: self.came + other.came,
            missed: self.missed + other.missed,
            overtaken: self.overtaken + other.overtaken,
            damaged: self.damaged + other.damaged,
            lost: self.lost + other.lost,
            returned: self.returned + other.returned,
            longest_absence_s: self.longest_absence_s.max(other.longest_absence_s),
        }
    }
}

/// A crop and its history.
#[derive(Debug)]
pub struct Shot {
    /// 440×440 grey levels.
    pub crop: Vec<u8>,
    /// When its bytes came.
    pub came: Instant,
    /// What it took to make the crop, µs.
    pub decode_us: f64,
}

/// A camera at work.
#[derive(Debug)]
pub struct Camera {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    told: String,
    rate: f64,
}

/// What the two threads share.
#[derive(Debug, Default)]
struct Shared {
    newest: Mailbox<Shot>,
    log: Mutex<Log>,
    stop: AtomicBool,
}

#[derive(Debug, Default)]
struct Log {
    counts: Counts,
    /// What happened, for people.
    news: Vec<String>,
}

impl Shared {
    fn log(&self) -> MutexGuard<'_, Log> {
        // Numbers and texts: nothing in there can be half done.
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn count(&self, what: impl FnOnce(&mut Counts)) {
        what(&mut self.log().counts);
    }

    /// The same line twice in a row says nothing new.
    fn tell(&self, news: String) {
        let mut log = self.log();
        if log.news.last() != Some(&news) {
            log.news.push(news);
        }
    }

    fn is_wanted(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }
}

impl Camera {
    /// Opens and sets the camera; what is wrong with it now is told now.
    ///
    /// # Errors
    /// [`CameraError`].
    pub fn start<P: Port>(port: P, wanted: CameraSettings) -> Result<Self, CameraError>
    where
        <P::Driver as Driver>::Stream: Send,
    {
        let first = open(&port, &wanted)?;
        let shared = Arc::new(Shared::default());
        let (told, rate) = (first.told.clone(), first.rate.unwrap_or(RATE));
        let theirs = Arc::clone(&shared);
        let thread = thread::spawn(move || watch(&port, &wanted, first, &theirs));
        Ok(Self {
            shared,
            thread: Some(thread),
            told,
            rate,
        })
    }

    /// What it was set to, for people.
    pub fn told(&self) -> &str {
        &self.told
    }

    /// Frames a second that it promised.
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// The newest picture, if there is one within `wait` that was not handed out before.
    pub fn next(&self, wait: Duration) -> Option<Shot> {
        match self.shared.newest.take(wait) {
            Taken::New(shot) => Some(shot),
            Taken::Nothing | Taken::Closed => None,
        }
    }

    /// So many pictures, one after the other.
    ///
    /// # Errors
    /// [`Failure`] when the camera stops sending.
    pub fn several(&self, count: usize) -> Result<Vec<Shot>, Failure> {
        let mut shots = Vec::with_capacity(count);
        let mut last = Instant::now();
        while shots.len() < count {
            if let Some(shot) = self.next(POLL) {
                shots.push(shot);
                last = Instant::now();
            } else if last.elapsed() > 3 * SILENCE {
                let counts = self.counts();
                return Err(Failure::failed(format!(
                    "{}: found {} good pictures in {} s ({} damaged), expected {count} of the untouched fingertip; {}",
                    self.told,
                    shots.len(),
                    (3 * SILENCE).as_secs(),
                    counts.damaged,
                    self.take_news()
                        .pop()
                        .unwrap_or_else(|| "check cable and format".to_owned()),
                )));
            }
        }
        Ok(shots)
    }

    /// What became of the pictures so far.
    pub fn counts(&self) -> Counts {
        let mut counts = self.shared.log().counts;
        counts.overtaken += self.shared.newest.overtaken();
        counts
    }

    /// What happened since it was last asked.
    pub fn take_news(&self) -> Vec<String> {
        std::mem::take(&mut self.shared.log().news)
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in there has been printed.
            let _ = thread.join();
        }
    }
}

/// Keeps the camera open and the mailbox fresh, until nobody wants it any more.
fn watch<P: Port>(
    port: &P,
    wanted: &CameraSettings,
    first: Negotiated<<P::Driver as Driver>::Stream>,
    shared: &Shared,
) {
    let mut open_now = first;
    while shared.is_wanted() {
        let gone = stream(&mut open_now, shared);
        // The device file is of a camera that is gone: it must be closed before the next one gets its name.
        drop(open_now);
        let Err(found) = gone else {
            return;
        };
        let lost = Instant::now();
        shared.count(|counts| counts.lost += 1);
        shared.tell(
            CameraError::Gone {
                camera: port.path(),
                found,
            }
            .to_string(),
        );
        open_now = loop {
            if !shared.is_wanted() {
                return;
            }
            match open(port, wanted) {
                Ok(opened) => break opened,
                Err(CameraError::Missing { .. } | CameraError::Gone { .. }) => {}
                Err(other) => shared.tell(other.to_string()),
            }
            thread::sleep(REOPEN_EVERY);
        };
        let absence_s = lost.elapsed().as_secs_f64();
        shared.count(|counts| {
            counts.returned += 1;
            counts.longest_absence_s = counts.longest_absence_s.max(absence_s);
        });
        shared.tell(format!("back after {absence_s:.1} s: {}", open_now.told));
    }
}

/// Takes pictures until nobody wants them or the camera is gone; then the reason.
fn stream<S: Stream>(camera: &mut Negotiated<S>, shared: &Shared) -> Result<(), String> {
    let mut converter = Converter::new(camera.format, camera.stride);
    let mut sequence = Sequence::default();
    let mut crop = Vec::new();
    let mut last = Instant::now();
    while shared.is_wanted() {
        if !camera
            .stream
            .ready()
            .within(PATIENCE)
            .map_err(|error| error.to_string())?
        {
            if last.elapsed() > SILENCE {
                return Err(format!("no picture for {} s", SILENCE.as_secs()));
            }
            continue;
        }
        let ready = camera.stream.ready();
        let buffer = camera.stream.take().map_err(|error| error.to_string())?;
        let came = Instant::now();
        last = came;
        let missed = sequence.came(buffer.sequence);
        // A newer one is there already: this one need not be decoded.
        let is_overtaken = ready.within(Duration::ZERO).map_err(|error| error.to_string())?;
        shared.count(|counts| {
            counts.came += 1;
            counts.missed += missed;
            counts.overtaken += u64::from(is_overtaken && !buffer.is_damaged);
            counts.damaged += u64::from(buffer.is_damaged);
        });
        if is_overtaken || buffer.is_damaged {
            continue;
        }
        match converter.crop(buffer.bytes, &mut crop) {
            Ok(()) => {
                let overtaken = shared.newest.put(Shot {
                    crop: std::mem::take(&mut crop),
                    came,
                    decode_us: came.elapsed().as_secs_f64() * 1e6,
                });
                // Its memory serves the next one.
                crop = overtaken.map_or_else(Vec::new, |overtaken| overtaken.crop);
            }
            Err(_) => shared.count(|counts| counts.damaged += 1),
        }
    }
    Ok(())
}
