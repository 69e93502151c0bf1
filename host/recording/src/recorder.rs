//! Writes a recording in a thread of its own. The loop puts frames into a bounded queue and never waits: when it is full, pictures
//! are dropped first, then frames; both are counted.
//!
//! A killed process loses at most the queue and the current chunk ([`FLUSH`]): under a second while the disk keeps up. A power cut
//! loses up to [`SYNC`] more. A disk that fails ends the recording, not the run; one that fails at the start leaves no file. Dropping
//! the recorder waits for the end of its file; a file without a frame is removed.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mcap::McapError;
use serde::Serialize;

use crate::error::RecordingError;
use crate::event::Event;
use crate::image::Image;
use crate::metadata::Metadata;
use crate::status::Frame;
use crate::writer::RecordingWriter;

/// Frames that wait for the disk.
const QUEUE_FRAMES: usize = 40;
/// How many of them may have a picture.
const QUEUE_PICTURES: usize = 30;
/// A chunk is closed and passed to the system this often.
const FLUSH: Duration = Duration::from_millis(500);
/// The file is synced to the disk this often.
const SYNC: Duration = Duration::from_secs(1);

/// What was recorded, and what was dropped.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct RecordingSummary {
    /// Frames in the file, with or without a picture.
    pub frames: u64,
    /// Frames whose picture was left out because the disk was too slow.
    pub pictures_dropped: u64,
    /// Frames that are missing altogether.
    pub frames_dropped: u64,
    /// Why the recording ended early.
    pub failed: Option<String>,
}

enum Item {
    Frame(Box<Frame>),
    Event(f64, Event),
}

/// A recording in progress.
pub struct Recorder {
    path: PathBuf,
    /// There is a file at `path`, not a pipe or a device.
    is_file: bool,
    queue: Option<SyncSender<Item>>,
    pictures_waiting: Arc<AtomicUsize>,
    thread: Option<JoinHandle<Outcome>>,
    pace: Pace,
    /// Frames passed in, recorded or not.
    offered: u64,
    summary: RecordingSummary,
}

/// What happens when the queue is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// The loop must not wait: frames are dropped.
    RealTime,
    /// The loop may wait.
    AsFastAsPossible,
}

/// How the writing thread ended.
struct Outcome {
    frames: u64,
    result: Result<(), McapError>,
}

impl Recorder {
    /// Starts a recording at `path`, which must not be there yet, with the pictures at rest of each fingertip.
    ///
    /// # Errors
    /// [`RecordingError`] when the file cannot be made or its beginning cannot be written.
    pub fn start(
        path: &Path,
        metadata: &Metadata,
        rest: &[Vec<Image>],
        pace: Pace,
    ) -> Result<Self, RecordingError> {
        let file = create(path)?;
        let is_file = is_file(&file);
        let begin = || {
            let on_disk = file.try_clone()?;
            let mut writer = RecordingWriter::new(BufWriter::new(file), metadata, rest.len(), wall_ns())?;
            for (sensor, pictures) in rest.iter().enumerate() {
                writer.rest(sensor, pictures)?;
            }
            writer.flush()?;
            Ok((writer, on_disk))
        };
        let (writer, on_disk) = begin().map_err(|error| {
            if is_file {
                // What cannot be removed is no worse than the failure.
                let _ = std::fs::remove_file(path);
            }
            failed(path, error)
        })?;
        Ok(Self::on(path, writer, pace, Some(on_disk)))
    }

    /// In place of a recording at `path` that could not start: every frame counts as dropped.
    #[must_use]
    pub fn unstarted(path: &Path, why: &RecordingError) -> Self {
        Self {
            path: path.to_owned(),
            is_file: false,
            queue: None,
            pictures_waiting: Arc::default(),
            thread: None,
            pace: Pace::RealTime,
            offered: 0,
            summary: RecordingSummary {
                failed: Some(why.to_string()),
                ..RecordingSummary::default()
            },
        }
    }

    /// Starts a recording into `out`, which is never read back nor synced; `path` names it in messages.
    ///
    /// # Errors
    /// [`RecordingError`] when its beginning cannot be written.
    pub fn onto<W: Write + Send + 'static>(
        path: &Path,
        out: W,
        metadata: &Metadata,
        fingertips: usize,
        pace: Pace,
    ) -> Result<Self, RecordingError> {
        let writer = RecordingWriter::new(out, metadata, fingertips, wall_ns());
        let writer = writer.map_err(|error| failed(path, error))?;
        Ok(Self::on(path, writer, pace, None))
    }

    fn on<W: Write + Send + 'static>(
        path: &Path,
        mut writer: RecordingWriter<W>,
        pace: Pace,
        on_disk: Option<File>,
    ) -> Self {
        let (queue, frames) = sync_channel(QUEUE_FRAMES);
        let is_file = on_disk.as_ref().is_some_and(is_file);
        let pictures_waiting = Arc::new(AtomicUsize::new(0));
        let waiting = Arc::clone(&pictures_waiting);
        let thread = thread::spawn(move || {
            let (stop, stopped) = sync_channel::<()>(1);
            // On its own: a disk that takes seconds to sync must not hold up what is only handed over.
            let syncer = on_disk.map(|file| thread::spawn(move || sync_until(&stopped, &file)));
            let result = record(&mut writer, &frames, &waiting);
            drop(stop);
            // Panics end with the process; there is nothing to add.
            let _ = syncer.map(JoinHandle::join);
            Outcome {
                frames: writer.kept,
                result,
            }
        });
        Self {
            path: path.to_owned(),
            is_file,
            queue: Some(queue),
            pictures_waiting,
            thread: Some(thread),
            pace,
            offered: 0,
            summary: RecordingSummary::default(),
        }
    }

    /// Queues a frame; in real time it never waits.
    pub fn offer(&mut self, mut frame: Frame) {
        self.offered += 1;
        if self.queue.is_none() {
            self.summary.frames_dropped += 1;
            return;
        }
        if self.pace == Pace::RealTime
            && frame.picture.is_some()
            && self.pictures_waiting.load(Ordering::Relaxed) >= QUEUE_PICTURES
        {
            frame.picture = None;
            self.summary.pictures_dropped += 1;
            self.note_drops(frame.report.t_s);
        }
        let waiting = usize::from(frame.picture.is_some());
        self.pictures_waiting.fetch_add(waiting, Ordering::Relaxed);
        match self.hand_over(Item::Frame(Box::new(frame))) {
            Ok(()) => {}
            Err(TrySendError::Full(())) => {
                self.pictures_waiting.fetch_sub(waiting, Ordering::Relaxed);
                self.summary.frames_dropped += 1;
            }
            Err(TrySendError::Disconnected(())) => {
                self.summary.frames_dropped += 1;
                self.end();
                if let Some(why) = &self.summary.failed {
                    // Reported when it happens: the run may go on for days.
                    tracing::warn!("{why}; the run goes on without a recording");
                }
            }
        }
    }

    fn hand_over(&self, item: Item) -> Result<(), TrySendError<()>> {
        let Some(queue) = &self.queue else {
            return Err(TrySendError::Disconnected(()));
        };
        match self.pace {
            Pace::RealTime => queue.try_send(item).map_err(|error| match error {
                TrySendError::Full(_) => TrySendError::Full(()),
                TrySendError::Disconnected(_) => TrySendError::Disconnected(()),
            }),
            Pace::AsFastAsPossible => queue.send(item).map_err(|_| TrySendError::Disconnected(())),
        }
    }

    /// Queues a log line; it is dropped when there is no room.
    pub fn note(&self, t_s: f64, text: &str) {
        let _ = self.hand_over(Item::Event(t_s, Event::warning(text)));
    }

    /// Logs an event occasionally, not for every picture.
    fn note_drops(&self, t_s: f64) {
        let count = self.summary.pictures_dropped;
        if count.is_power_of_two() {
            let text = format!("{count} pictures dropped so far: the disk is slower than the camera");
            // Where there is no room for it, the summary still says so.
            let _ = self.hand_over(Item::Event(t_s, Event::warning(text)));
        }
    }

    /// Pictures and frames that were left out so far.
    #[must_use]
    pub const fn dropped(&self) -> [u64; 2] {
        [self.summary.pictures_dropped, self.summary.frames_dropped]
    }

    /// Writes the queue and closes the file.
    #[must_use]
    pub fn finish(mut self) -> RecordingSummary {
        self.end();
        // Those that waited when the disk failed are lost too.
        self.summary.frames_dropped = self.offered - self.summary.frames;
        self.summary.clone()
    }

    fn end(&mut self) {
        self.queue = None;
        let Some(thread) = self.thread.take() else {
            return;
        };
        match thread.join() {
            Ok(Outcome { frames, result }) => {
                self.summary.frames = frames;
                if let Err(error) = result {
                    self.summary.failed = Some(failed(&self.path, error).to_string());
                }
            }
            Err(_) => self.summary.failed = Some(format!("{}: the recorder panicked", self.path.display())),
        }
        // A program that is started again and again must not fill the disk with files that say nothing.
        if self.is_file && self.summary.frames == 0 && std::fs::remove_file(&self.path).is_ok() {
            tracing::info!("{}: removed, not one frame was recorded", self.path.display());
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.end();
    }
}

/// Creates a file that was not there, so that no recording is overwritten. Devices and pipes exist already.
fn create(path: &Path) -> Result<File, RecordingError> {
    if path.is_file() {
        return Err(RecordingError::Exists(path.to_owned()));
    }
    File::create(path).map_err(|error| failed(path, error.into()))
}

/// Not a pipe or a device.
fn is_file(file: &File) -> bool {
    file.metadata().is_ok_and(|metadata| metadata.is_file())
}

fn failed(path: &Path, error: McapError) -> RecordingError {
    let advice = match &error {
        McapError::Io(error) if error.kind() == io::ErrorKind::StorageFull => "make room or record elsewhere",
        McapError::Io(_) => "check the folder and its permissions",
        _ => "report this defect",
    };
    RecordingError::Record {
        path: path.to_owned(),
        error,
        advice,
    }
}

fn wall_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| since.as_nanos() as u64)
}

/// Syncs the file to the disk, once every [`SYNC`] and at the end.
fn sync_until(stopped: &Receiver<()>, file: &File) {
    // What cannot be synced (a pipe, a device) is no worse for it; writing tells of full disks.
    while stopped.recv_timeout(SYNC) == Err(RecvTimeoutError::Timeout) {
        let _ = file.sync_data();
    }
    let _ = file.sync_data();
}

/// Runs until the queue's other end is gone; then finishes the file.
fn record<W: Write>(
    writer: &mut RecordingWriter<W>,
    queue: &Receiver<Item>,
    pictures_waiting: &AtomicUsize,
) -> Result<(), McapError> {
    let mut flushed = Instant::now();
    loop {
        let left = FLUSH.saturating_sub(flushed.elapsed());
        match queue.recv_timeout(left) {
            Ok(Item::Frame(frame)) => {
                let pictured = usize::from(frame.picture.is_some());
                writer.frame(&frame)?;
                pictures_waiting.fetch_sub(pictured, Ordering::Relaxed);
            }
            Ok(Item::Event(t_s, event)) => writer.event(t_s, &event)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return writer.finish();
            }
        }
        if flushed.elapsed() >= FLUSH {
            writer.flush()?;
            flushed = Instant::now();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use gripline_protocol::message::{FingertipGeometry, GripMode, Status};
    use gripline_protocol::{ForceMap, SensorId};

    use super::*;
    use crate::reader::{Completeness, Reader};
    use crate::status::{status_bytes, status_schema};
    use crate::telemetry::{FrameReport, STAGES, WitnessReport};
    use crate::units::Load;

    fn frame(number: u64) -> Frame {
        let report = FrameReport {
            frame: number,
            sensor: SensorId::FIRST,
            t_s: number as f64 / 60.0,
            gate: "network",
            health: Vec::new(),
            normal_n: 0.0,
            shear_x_n: 0.0,
            shear_y_n: 0.0,
            shear_n: 0.0,
            moment_nmm: 0.0,
            centre_of_pressure_mm: None,
            load: Load::of(
                &Status::default().sums,
                SensorId::FIRST,
                &FingertipGeometry::DEFAULT,
            ),
            contact: 0,
            stick: 0,
            stick_ratio: None,
            coulomb_slip: false,
            state: "NO_CONTACT",
            slip_evidence: 0.0,
            witnesses: WitnessReport::default(),
            time_to_slip_ms: None,
            line_n: 0.0,
            latency_us: 0.0,
            stages_us: [0.0; STAGES.len()],
            faults: Vec::new(),
            late: None,
            wire_bytes: 0,
            markers: None,
            truth: None,
        };
        Frame {
            report,
            sequence: number as u32,
            capture_us: 0,
            begun_us: 0,
            until_us: 0,
            requested_mode: Some(GripMode::Hold),
            floor_lsb: 0,
            health_bits: 0,
            motion_bits: 0,
            wire: Status::default(),
            map: Box::new(ForceMap::EMPTY),
            pitch_um: 1600,
            picture: Some(Image::grey(88, vec![0; 88 * 88])),
        }
    }

    #[test]
    fn a_recorder_that_is_dropped_by_an_error_leaves_a_whole_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dropped.mcap");
        let mut recorder =
            Recorder::start(&path, &Metadata::default(), &[Vec::new()], Pace::RealTime).unwrap();
        for number in 0..5 {
            recorder.offer(frame(number));
        }
        drop(recorder);
        let mut reader = Reader::open(&path).unwrap();
        let mut frames = 0;
        while reader.next_frame().unwrap().is_some() {
            frames += 1;
        }
        assert_eq!((frames, reader.completeness()), (5, Completeness::Whole));
    }

    #[test]
    fn a_recording_without_a_frame_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty.mcap");
        let start = || Recorder::start(&path, &Metadata::default(), &[Vec::new()], Pace::RealTime).unwrap();
        let recorder = start();
        recorder.note(0.0, "the camera is gone");
        assert!(path.exists(), "nobody else can take the name meanwhile");
        assert_eq!(recorder.finish().frames, 0);
        assert!(!path.exists());
        drop(start());
        assert!(!path.exists());
    }

    /// A disk in memory that takes nothing while the test holds its lock, and tells when it is asked.
    #[derive(Clone)]
    struct Disk {
        bytes: Arc<Mutex<Vec<u8>>>,
        asked: SyncSender<()>,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _ = self.asked.try_send(());
            self.bytes.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_disk_that_stands_still_never_holds_up_the_loop_and_every_drop_is_counted() {
        let (asked, is_asked) = sync_channel(1);
        let disk = Disk {
            bytes: Arc::default(),
            asked,
        };
        let writer = RecordingWriter::new(disk.clone(), &Metadata::default(), 1, 0).unwrap();
        let held = disk.bytes.lock().unwrap();
        while is_asked.try_recv().is_ok() {}
        let mut recorder = Recorder::on(Path::new("still"), writer, Pace::RealTime, None);
        recorder.offer(frame(0));
        // From here on the writer stands still with the first frame in its hands.
        is_asked.recv().unwrap();
        for number in 1..=200 {
            recorder.offer(frame(number));
        }
        assert_eq!(recorder.summary.pictures_dropped, 200 - QUEUE_PICTURES as u64);
        drop(held);
        let recorded = recorder.finish();
        assert_eq!(recorded.frames + recorded.frames_dropped, 201, "{recorded:?}");
        assert_eq!(recorded.failed, None);

        let bytes = disk.bytes.lock().unwrap().clone();
        let mut reader = Reader::new(Path::new("still"), &bytes[..]).unwrap();
        let (mut frames, mut pictures) = (0, 0);
        while let Some(frame) = reader.next_frame().unwrap() {
            assert_eq!(frame.status.frame, frames, "the first that came are there");
            frames += 1;
            pictures += u64::from(frame.picture.is_some());
        }
        assert_eq!((frames, pictures), (recorded.frames, 1 + QUEUE_PICTURES as u64));
        assert_eq!(reader.completeness(), Completeness::Whole);
    }

    /// A disk with this many bytes left.
    struct Small(usize);

    impl Write for Small {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if bytes.len() > self.0 {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.0 -= bytes.len();
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_ends_the_recording_and_not_the_run() {
        let mut recorder = Recorder::onto(
            Path::new("full.mcap"),
            Small(100_000),
            &Metadata::default(),
            1,
            Pace::AsFastAsPossible,
        )
        .unwrap();
        let mut offered = 0;
        while recorder.summary.failed.is_none() {
            recorder.offer(frame(offered));
            offered += 1;
        }
        recorder.offer(frame(offered));
        let recorded = recorder.finish();
        let why = recorded.failed.unwrap();
        assert!(
            why.starts_with("full.mcap: recording failed: ") && why.contains("make room"),
            "{why}"
        );
        assert!(
            recorded.frames_dropped >= 2,
            "the one that found out and the one after it"
        );
    }

    /// Where the lengths of the records of a file stand, those inside chunks too.
    fn lengths(bytes: &[u8]) -> Vec<usize> {
        const CHUNK: u8 = 6;
        let length = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
        let (mut at, mut found) = (mcap::MAGIC.len(), Vec::new());
        while at + 9 < bytes.len() - mcap::MAGIC.len() {
            found.push(at + 1);
            // The records of a chunk follow its head: 40 bytes without the name of a compression.
            at += 9 + if bytes[at] == CHUNK { 40 } else { length(at + 1) };
        }
        found
    }

    #[test]
    fn a_corrupt_length_is_reported_by_name_and_allocates_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("good.mcap");
        let mut recorder =
            Recorder::start(&path, &Metadata::default(), &[Vec::new()], Pace::AsFastAsPossible).unwrap();
        for number in 0..20 {
            recorder.offer(frame(number));
        }
        assert_eq!(recorder.finish().frames, 20);
        let good = std::fs::read(&path).unwrap();
        let places = lengths(&good);
        assert!(places.len() > 60, "{}", places.len());
        for place in places {
            for length in [u64::MAX, 1 << 60] {
                let mut bytes = good.clone();
                bytes[place..place + 8].copy_from_slice(&length.to_le_bytes());
                let path = folder.path().join("corrupt.mcap");
                std::fs::write(&path, bytes).unwrap();
                let said = match Reader::open(&path) {
                    Err(error) => error.to_string(),
                    Ok(mut reader) => {
                        while reader.next_frame().unwrap().is_some() {}
                        let Completeness::Truncated(why) = reader.completeness() else {
                            panic!("the length at {place} was not noticed");
                        };
                        why
                    }
                };
                assert!(said.contains("length"), "length at {place}: {said}");
                let whole = folder.path().join("whole.mcap");
                crate::export::copy_whole(&path, &whole).unwrap();
                std::fs::remove_file(&whole).unwrap();
            }
        }
    }

    #[test]
    fn a_status_has_the_keys_of_its_schema() {
        let status = status_bytes(&frame(3)).unwrap();
        let status: serde_json::Map<String, serde_json::Value> = serde_json::from_slice(&status).unwrap();
        let schema: serde_json::Value = serde_json::from_slice(&status_schema()).unwrap();
        let properties = schema["properties"].as_object().unwrap();
        for key in status.keys() {
            assert!(properties.contains_key(key), "{key} is not in the schema");
        }
        // What the simulated world knows is there only when it plays, markers only where the sensor has them.
        assert!(
            properties
                .keys()
                .all(|key| ["markers", "truth"].contains(&key.as_str()) || status.contains_key(key))
        );
    }
}
