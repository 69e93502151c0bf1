//! A fake camera: what it offers, what it sends, when it goes away.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use gripline_capture::camera::{Camera, CameraFrame};
use gripline_capture::driver::{ActualMode, Buffer, Control, Driver, EXPOSURE_MANUAL, Port, Ready, Stream};
use gripline_capture::geometry::{FRAME, Size};
use gripline_capture::mode::{Offer, PixelFormat, RequestedMode};
use gripline_capture::negotiate::open;
use gripline_capture::{CameraSettings, CaptureError};

use crate::events;

/// What the fake camera does next.
#[derive(Debug, Clone)]
enum Action {
    /// Fills a buffer for each of these numbers at once.
    Send(Vec<u32>),
    /// Fills a buffer whose driver says that it was filled so long ago.
    Stamped(u32, Duration),
    /// The driver's code has a defect.
    Panic,
    /// Fills a buffer that cannot be decoded.
    Garbage(u32),
    /// Fills a buffer and flags it as damaged.
    Flagged(u32),
    /// Sends nothing for this long.
    Silence(Duration),
    /// Goes away, and cannot be opened this many times.
    Unplug(u32),
}

#[derive(Debug)]
struct FakeState {
    offers: Vec<Offer>,
    controls: Vec<(Control, i64)>,
    /// This control keeps its value.
    stubborn: Option<Control>,
    actions: VecDeque<Action>,
    /// Filled buffers: bytes, number, time stamp, damaged.
    filled: VecDeque<(Vec<u8>, u32, Option<Instant>, bool)>,
    /// Buffers that the driver grants.
    buffers: usize,
    absent_for: u32,
    opened: u32,
    /// Opening fails with this error.
    refuses: Option<fn() -> CaptureError>,
    /// The driver sets this format whatever is requested.
    insists_on: Option<[u8; 4]>,
}

#[derive(Debug, Clone)]
struct FakeCamera(Arc<Mutex<FakeState>>, &'static str);

impl FakeCamera {
    fn new(code: [u8; 4], actions: Vec<Action>) -> Self {
        Self(
            Arc::new(Mutex::new(FakeState {
                offers: vec![Offer {
                    code,
                    size: FRAME,
                    rates: vec![30.0, 60.0],
                }],
                controls: vec![
                    (Control::ExposureMode, 3),
                    (Control::ExposureTime, 157),
                    (Control::GainMode, 1),
                    (Control::Gain, 8),
                ],
                stubborn: None,
                actions: actions.into(),
                filled: VecDeque::new(),
                buffers: 4,
                absent_for: 0,
                opened: 0,
                refuses: None,
                insists_on: None,
            })),
            "/dev/video7",
        )
    }

    fn with(self, change: impl FnOnce(&mut FakeState)) -> Self {
        change(&mut self.0.lock().unwrap());
        self
    }
}

impl Port for FakeCamera {
    type Driver = Self;

    fn path(&self) -> String {
        self.1.to_owned()
    }

    fn open(&self) -> Result<Self, CaptureError> {
        let mut state = self.0.lock().unwrap();
        if let Some(refuses) = state.refuses {
            return Err(refuses());
        }
        if state.absent_for > 0 {
            state.absent_for -= 1;
            return Err(CaptureError::Missing {
                camera: self.path(),
                present: "none".to_owned(),
            });
        }
        state.opened += 1;
        Ok(self.clone())
    }
}

impl Driver for FakeCamera {
    type Stream = Self;

    fn card(&self) -> String {
        "fake".to_owned()
    }

    fn offers(&self) -> Vec<Offer> {
        self.0.lock().unwrap().offers.clone()
    }

    fn set_mode(&self, code: [u8; 4], size: Size, rate: Option<f64>) -> io::Result<ActualMode> {
        let code = self.0.lock().unwrap().insists_on.unwrap_or(code);
        Ok(ActualMode {
            code,
            size,
            stride: 0,
            rate,
        })
    }

    fn control(&self, control: Control) -> Option<i64> {
        let state = self.0.lock().unwrap();
        state
            .controls
            .iter()
            .find(|(known, _)| *known == control)
            .map(|(_, value)| *value)
    }

    fn set_control(&self, control: Control, value: i64) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        if state.stubborn == Some(control) {
            return Ok(());
        }
        let known = state.controls.iter_mut().find(|(known, _)| *known == control);
        known
            .map(|known| known.1 = value)
            .ok_or_else(|| io::Error::from_raw_os_error(22))
    }

    fn stream(self) -> io::Result<Self> {
        Ok(self)
    }
}

impl Stream for FakeCamera {
    type Ready = Self;

    fn buffers(&self) -> usize {
        self.0.lock().unwrap().buffers
    }

    fn ready(&self) -> Self {
        self.clone()
    }

    fn take(&mut self) -> io::Result<Buffer<'_>> {
        let mut state = self.0.lock().unwrap();
        let Some((bytes, sequence, taken_at, is_damaged)) = state.filled.pop_front() else {
            return Err(io::Error::from_raw_os_error(19));
        };
        Ok(Buffer {
            bytes: bytes.leak(),
            sequence,
            taken_at,
            is_damaged,
        })
    }
}

impl Ready for FakeCamera {
    fn within(&self, wait: Duration) -> io::Result<bool> {
        let mut state = self.0.lock().unwrap();
        if !state.filled.is_empty() {
            return Ok(true);
        }
        // Time passes only for a caller that waits.
        if wait.is_zero() {
            return Ok(false);
        }
        match state.actions.pop_front() {
            Some(Action::Send(numbers)) => {
                for number in numbers {
                    // The number can be read off the picture.
                    state
                        .filled
                        .push_back((vec![number as u8; FRAME.pixels()], number, None, false));
                }
            }
            Some(Action::Stamped(number, ago)) => {
                let stamp = Instant::now().checked_sub(ago);
                let bytes = vec![number as u8; FRAME.pixels()];
                state.filled.push_back((bytes, number, stamp, false));
            }
            Some(Action::Panic) => {
                drop(state);
                panic!("made to panic");
            }
            Some(Action::Garbage(number)) => state.filled.push_back((vec![1, 2, 3], number, None, false)),
            Some(Action::Flagged(number)) => {
                let bytes = vec![0; FRAME.pixels()];
                state.filled.push_back((bytes, number, None, true));
            }
            Some(Action::Unplug(times)) => {
                state.absent_for = times;
                return Ok(true);
            }
            Some(Action::Silence(time)) => {
                drop(state);
                thread::sleep(time);
                return Ok(false);
            }
            None => {
                drop(state);
                thread::sleep(Duration::from_millis(2));
                return Ok(false);
            }
        }
        Ok(true)
    }
}

fn settings() -> CameraSettings {
    CameraSettings {
        mode: RequestedMode {
            rate: 60.0,
            ..RequestedMode::default()
        },
        ..CameraSettings::default()
    }
}

/// Takes pictures until this number arrives; returns all numbers.
fn until(camera: &Camera, last: u8) -> Vec<u8> {
    let end = Instant::now() + Duration::from_secs(30);
    let mut numbers = Vec::new();
    while numbers.last() != Some(&last) {
        assert!(Instant::now() < end, "picture {last} never arrived: {numbers:?}");
        if let Some(CameraFrame { crop, .. }) = camera.next(Duration::from_millis(5)).unwrap() {
            assert!(crop.iter().all(|grey| *grey == crop[0]));
            numbers.push(crop[0]);
        }
    }
    numbers
}

#[test]
fn gaps_in_the_drivers_numbers_overtaken_buffers_and_damage_are_all_counted() {
    let actions = vec![
        Action::Send(vec![3]),
        // 4 and 5 are missing.
        Action::Send(vec![6]),
        // Three at once: only the newest is used.
        Action::Send(vec![7, 8, 9]),
        Action::Garbage(10),
        Action::Flagged(11),
        Action::Send(vec![12]),
    ];
    let camera = Camera::start(FakeCamera::new(*b"GREY", actions), settings()).unwrap();
    let numbers = until(&camera, 12);
    let counts = camera.counts();
    assert_eq!(
        (counts.received, counts.missed, counts.damaged),
        (8, 2, 2),
        "{counts:?}"
    );
    assert!(!numbers.contains(&7) && !numbers.contains(&8), "{numbers:?}");
    // Every picture was handed out, overtaken or damaged.
    assert_eq!(
        counts.received,
        numbers.len() as u64 + counts.overtaken + counts.damaged,
        "{counts:?} {numbers:?}"
    );
    assert_eq!((counts.disconnects, counts.reconnects), (0, 0));
}

#[test]
fn what_is_to_begin_runs_in_the_cameras_own_thread_before_its_first_picture() {
    let (sender, begun) = std::sync::mpsc::channel();
    let begin = move || sender.send(std::thread::current().id()).unwrap();
    let camera = FakeCamera::new(*b"GREY", vec![Action::Send(vec![1])]);
    let camera = Camera::start_with(camera, settings(), begin).unwrap();
    assert_eq!(until(&camera, 1), [1]);
    assert_ne!(begun.try_recv().unwrap(), std::thread::current().id());
}

#[test]
fn a_camera_that_goes_away_is_opened_again_logged_and_counted_and_its_numbers_start_over() {
    let actions = vec![
        Action::Send(vec![100]),
        Action::Unplug(3),
        Action::Send(vec![0]),
        Action::Unplug(0),
        Action::Send(vec![1]),
    ];
    let mut fake = FakeCamera::new(*b"GREY", actions);
    fake.1 = "/dev/video8";
    events::record();
    let camera = Camera::start(fake.clone(), settings()).unwrap();
    until(&camera, 1);
    let counts = camera.counts();
    assert_eq!(
        (counts.disconnects, counts.reconnects, counts.missed),
        (2, 2, 0),
        "{counts:?}"
    );
    assert!(counts.longest_absence_s > 0.0);
    let lines = events::of("/dev/video8");
    assert_eq!(lines.len(), 4, "{lines:?}");
    for (line, part) in lines.iter().zip(["gone", "back after", "gone", "back after"]) {
        assert!(line.contains(part), "{line}");
    }
    assert_eq!(fake.0.lock().unwrap().opened, 3);
}

#[test]
fn a_camera_that_falls_silent_is_opened_again() {
    let silence = Action::Silence(Duration::from_millis(1_100));
    let mut fake = FakeCamera::new(
        *b"GREY",
        vec![Action::Send(vec![1]), silence, Action::Send(vec![2])],
    );
    fake.1 = "/dev/video9";
    events::record();
    let camera = Camera::start(fake, settings()).unwrap();
    until(&camera, 2);
    assert_eq!((camera.counts().disconnects, camera.counts().reconnects), (1, 1));
    assert!(events::of("/dev/video9")[0].contains("no picture for 1 s"));
}

#[test]
fn a_camera_that_needs_more_than_a_second_to_its_first_picture_is_left_to_begin() {
    let slow = Action::Silence(Duration::from_millis(1_500));
    let camera = Camera::start(
        FakeCamera::new(*b"GREY", vec![slow, Action::Send(vec![1])]),
        settings(),
    )
    .unwrap();
    assert_eq!(until(&camera, 1), [1]);
    assert_eq!(camera.counts().disconnects, 0);
}

#[test]
fn pictures_of_the_untouched_fingertip_are_taken_once_the_light_is_steady() {
    let pause = Action::Silence(Duration::from_millis(20));
    let send = |levels: &[u32]| {
        levels
            .iter()
            .flat_map(|level| [Action::Send(vec![*level]), pause.clone()])
            .collect()
    };
    // Black at first, then an exposure that finds its level.
    let levels = [0, 0, 0, 0, 0, 40, 70, 90, 100, 101, 102, 103, 104];
    let camera = Camera::start(FakeCamera::new(*b"GREY", send(&levels)), settings()).unwrap();
    let taken = camera.take_frames(4).unwrap();
    let levels: Vec<u8> = taken.iter().map(|frame| frame.crop[0]).collect();
    assert_eq!(levels, [100, 101, 102, 103]);
    // A light that is never steady is no reason to wait for ever.
    let flickering: Vec<u32> = (0..300).map(|number| 60 + 60 * (number % 2)).collect();
    let camera = Camera::start(FakeCamera::new(*b"GREY", send(&flickering)), settings()).unwrap();
    assert_eq!(camera.take_frames(4).unwrap().len(), 4);
}

#[test]
fn a_camera_without_a_good_picture_says_so_instead_of_waiting_for_ever() {
    let camera = Camera::start(FakeCamera::new(*b"GREY", vec![Action::Garbage(0)]), settings()).unwrap();
    let error = camera.take_frames(4).unwrap_err().to_string();
    for part in [
        "/dev/video7",
        "found 0 good pictures",
        "1 damaged",
        "expected 4 of the untouched fingertip",
    ] {
        assert!(error.contains(part), "{part:?} is missing in: {error}");
    }
}

#[test]
fn a_pictures_age_counts_from_the_drivers_time_stamp_and_its_arrival_ends_with_the_frame() {
    let stamped = |ago| {
        let camera = Camera::start(
            FakeCamera::new(*b"GREY", vec![Action::Stamped(1, ago)]),
            settings(),
        )
        .unwrap();
        loop {
            if let Some(frame) = camera.next(Duration::from_millis(5)).unwrap() {
                return frame;
            }
        }
    };
    // It has waited in the driver's queue: a frame takes 1/60 s to arrive.
    let waited = stamped(Duration::from_secs(3));
    assert!(waited.taken_at.elapsed() >= Duration::from_secs(3));
    assert_eq!(
        (waited.received_at - waited.taken_at).as_micros(),
        16_666,
        "the rest is waiting"
    );
    // A stamp ahead of the clock is worth nothing.
    let camera = FakeCamera::new(*b"GREY", Vec::new()).with(|state| {
        let ahead = Instant::now() + Duration::from_secs(100);
        let picture = vec![1; FRAME.pixels()];
        state.filled.push_back((picture, 1, Some(ahead), false));
    });
    let camera = Camera::start(camera, settings()).unwrap();
    let frame = loop {
        if let Some(frame) = camera.next(Duration::from_millis(5)).unwrap() {
            break frame;
        }
    };
    assert!(frame.taken_at <= Instant::now() && frame.taken_at == frame.received_at);
}

#[test]
fn a_panic_of_the_cameras_thread_is_an_error_by_name_after_the_last_picture() {
    let actions = vec![Action::Send(vec![5]), Action::Panic];
    let camera = Camera::start(FakeCamera::new(*b"GREY", actions), settings()).unwrap();
    let mut numbers = Vec::new();
    let error = loop {
        match camera.next(Duration::from_millis(5)) {
            Ok(frame) => numbers.extend(frame.map(|frame| frame.crop[0])),
            Err(error) => break error.to_string(),
        }
    };
    assert_eq!(numbers, [5]);
    for part in ["/dev/video7", "its thread panicked (made to panic)", "report"] {
        assert!(error.contains(part), "{part:?} is missing in: {error}");
    }
    // While the fingertip at rest is looked at, too.
    let camera = Camera::start(FakeCamera::new(*b"GREY", vec![Action::Panic]), settings()).unwrap();
    let error = camera.take_frames(4).unwrap_err().to_string();
    assert!(error.contains("its thread panicked (made to panic)"), "{error}");
}

#[test]
fn a_camera_that_grants_fewer_buffers_than_asked_is_used_from_two_on_and_says_so() {
    let granting = |buffers| FakeCamera::new(*b"GREY", Vec::new()).with(|state| state.buffers = buffers);
    for buffers in [2, 3] {
        let description = open(&granting(buffers), &settings()).unwrap().description;
        let said = format!("{buffers} buffers (asked for 4)");
        assert!(description.contains(&said), "{description}");
    }
    assert!(
        !open(&granting(4), &settings())
            .unwrap()
            .description
            .contains("buffers")
    );
    let error = open(&granting(1), &settings()).map(drop).unwrap_err().to_string();
    assert!(
        error.contains("found 1 buffer") && error.contains("expected at least 2"),
        "{error}"
    );
}

#[test]
fn exposure_and_gain_are_fixed_and_described_with_format_and_rate() {
    let fake = FakeCamera::new(*b"MJPG", Vec::new());
    let opened = open(
        &fake,
        &CameraSettings {
            exposure_ms: Some(4.0),
            gain: Some(20),
            ..settings()
        },
    )
    .unwrap();
    assert_eq!(
        opened.description,
        "camera /dev/video7 (fake): 640×480 mjpeg at 60 frames/s, exposure 4 ms, gain 20"
    );
    assert_eq!((opened.format, opened.rate), (PixelFormat::Mjpeg, Some(60.0)));
    let controls = fake.0.lock().unwrap().controls.clone();
    assert_eq!(
        controls,
        [
            (Control::ExposureMode, EXPOSURE_MANUAL),
            (Control::ExposureTime, 40),
            (Control::GainMode, 0),
            (Control::Gain, 20)
        ]
    );
}

#[test]
fn what_the_camera_chooses_itself_and_a_rate_it_lacks_are_described() {
    let requested = CameraSettings {
        mode: RequestedMode {
            rate: 120.0,
            ..RequestedMode::default()
        },
        ..CameraSettings::default()
    };
    let description = open(&FakeCamera::new(*b"YUYV", Vec::new()), &requested)
        .unwrap()
        .description;
    for part in [
        "60 frames/s (asked for 120)",
        "exposure automatic",
        "camera.exposure_ms",
        "gain automatic",
    ] {
        assert!(
            description.contains(part),
            "{part:?} is missing in: {description}"
        );
    }
    let bare = FakeCamera::new(*b"YUYV", Vec::new()).with(|state| state.controls.clear());
    let description = open(&bare, &settings()).unwrap().description;
    assert!(
        description.ends_with("exposure not settable, gain not settable"),
        "{description}"
    );
}

#[test]
fn errors_of_a_camera_name_what_was_found_and_what_to_do() {
    let fake = || FakeCamera::new(*b"YUYV", Vec::new());
    let fixed = CameraSettings {
        exposure_ms: Some(4.0),
        gain: Some(20),
        ..settings()
    };
    let without = |control| fake().with(|state| state.controls.retain(|(known, _)| *known != control));
    let cases: [(FakeCamera, &[&str]); 6] = [
        (
            without(Control::ExposureTime),
            &[
                "no control for the exposure time",
                "camera.exposure_ms is set",
                "take camera.exposure_ms out",
            ],
        ),
        (
            without(Control::Gain),
            &["no control for the gain", "camera.gain is set"],
        ),
        (
            fake().with(|state| state.stubborn = Some(Control::ExposureTime)),
            &["camera.exposure_ms: found 4", "15.7 ms instead"],
        ),
        (
            fake().with(|state| state.offers[0].size = Size::new(1280, 720)),
            &["no usable format", "YUYV 1280×720 at 30, 60", "640×480"],
        ),
        (
            fake().with(|state| state.insists_on = Some(*b"RGB3")),
            &["found RGB3 640×480", "expected YUYV 640×480"],
        ),
        (
            fake().with(|state| {
                state.refuses = Some(|| CaptureError::Permission {
                    camera: "/dev/video7".to_owned(),
                });
            }),
            &["permission denied", "group video"],
        ),
    ];
    for (camera, parts) in cases {
        let error = open(&camera, &fixed).map(drop).unwrap_err().to_string();
        assert!(error.starts_with("camera /dev/video7: "), "{error}");
        for part in parts {
            assert!(error.contains(part), "{part:?} is missing in: {error}");
        }
    }
}
