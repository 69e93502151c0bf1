//! Pixels against a picture that is known, and a camera that is made up: what it offers, what it sends, when it goes.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use crate::constants::CROP_SIDE;
use proptest::prelude::*;

use super::camera::{Camera, Shot};
use super::constants::{CROP_LEFT, CROP_TOP};
use super::convert::Converter;
use super::device::{Buffer, Control, Driver, EXPOSURE_MANUAL, Port, Ready, Set, Stream};
use super::error::CameraError;
use super::format::{Offer, PixelFormat, Wanted};
use super::jpeg::JpegCrop;
use super::negotiate::{CameraSettings, open};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;

/// A smooth picture whose every region differs.
fn grey_frame() -> Vec<u8> {
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            (110.0 + 60.0 * (x / 37.0).sin() + 50.0 * (y / 23.0).cos()) as u8
        })
        .collect()
}

/// The middle of a frame, pixel by pixel.
fn middle(frame: &[u8]) -> Vec<u8> {
    (0..CROP_SIDE * CROP_SIDE)
        .map(|i| frame[(i / CROP_SIDE + CROP_TOP) * WIDTH + i % CROP_SIDE + CROP_LEFT])
        .collect()
}

#[test]
fn grey_and_yuyv_give_the_very_pixels_of_the_middle() {
    let frame = grey_frame();
    let yuyv: Vec<u8> = frame.iter().flat_map(|y| [*y, 77]).collect();
    let mut crop = Vec::new();
    Converter::new(PixelFormat::Grey, 0)
        .crop(&frame, &mut crop)
        .unwrap();
    assert_eq!(crop, middle(&frame));
    Converter::new(PixelFormat::Yuyv, 1280)
        .crop(&yuyv, &mut crop)
        .unwrap();
    assert_eq!(crop, middle(&frame));
}

proptest! {
    #[test]
    fn gaps_between_rows_and_what_lies_below_the_crop_change_nothing(
        gap in 0_usize..70, cut in 0_usize..20 * WIDTH, yuyv in any::<bool>(), filler in any::<u8>(),
    ) {
        let frame = grey_frame();
        let (format, bytes) = if yuyv { (PixelFormat::Yuyv, 2) } else { (PixelFormat::Grey, 1) };
        let mut rows = Vec::new();
        for row in frame.chunks(WIDTH) {
            rows.extend(row.iter().flat_map(|y| [*y, filler].into_iter().take(bytes)));
            rows.extend(vec![filler; gap]);
        }
        rows.truncate(rows.len() - cut * bytes);
        let mut crop = Vec::new();
        Converter::new(format, WIDTH * bytes + gap).crop(&rows, &mut crop).unwrap();
        prop_assert_eq!(crop, middle(&frame));
    }

    #[test]
    fn no_bytes_at_all_bring_a_converter_down(bytes in prop::collection::vec(any::<u8>(), 0..600), format in 0_usize..3) {
        let mut crop = Vec::new();
        let _ = Converter::new(PixelFormat::ALL[format], 0).crop(&bytes, &mut crop);
        // With the beginning of a JPEG the parser gets further.
        let file: Vec<u8> = [&[0xff, 0xd8][..], &bytes].concat();
        prop_assert!(JpegCrop::default().decode(&file, &mut crop).is_err());
    }
}

#[test]
fn frames_that_are_too_short_are_told() {
    let error = Converter::new(PixelFormat::Yuyv, 0)
        .crop(&[0; 1000], &mut Vec::new())
        .unwrap_err();
    assert_eq!(error, "found 1000 bytes, expected at least 588800");
}

/// What the made-up camera does next.
#[derive(Debug, Clone)]
enum Deed {
    /// Fills so many buffers with these numbers at once.
    Send(Vec<u32>),
    /// Fills one that cannot be decoded.
    Garbage(u32),
    /// Fills one and says that it is damaged.
    Flagged(u32),
    /// Nothing for this long.
    Silence(Duration),
    /// Goes away, and cannot be opened so often.
    Unplug(u32),
}

#[derive(Debug)]
struct World {
    offers: Vec<Offer>,
    controls: Vec<(Control, i64)>,
    /// The camera takes no other value than that for a control.
    stubborn: Option<Control>,
    deeds: VecDeque<Deed>,
    /// Filled buffers that nobody took.
    filled: VecDeque<(Vec<u8>, u32, bool)>,
    absent_for: u32,
    opened: u32,
    /// How it can be opened at all.
    refuses: Option<fn() -> CameraError>,
    /// The driver makes of every format this one.
    insists_on: Option<[u8; 4]>,
}

#[derive(Debug, Clone)]
struct FakeCamera(Arc<Mutex<World>>);

impl FakeCamera {
    fn new(code: [u8; 4], deeds: Vec<Deed>) -> Self {
        Self(Arc::new(Mutex::new(World {
            offers: vec![Offer {
                code,
                size: [640, 480],
                rates: vec![30.0, 60.0],
            }],
            controls: vec![
                (Control::ExposureMode, 3),
                (Control::ExposureTime, 157),
                (Control::GainMode, 1),
                (Control::Gain, 8),
            ],
            stubborn: None,
            deeds: deeds.into(),
            filled: VecDeque::new(),
            absent_for: 0,
            opened: 0,
            refuses: None,
            insists_on: None,
        })))
    }

    fn with(self, change: impl FnOnce(&mut World)) -> Self {
        change(&mut self.0.lock().unwrap());
        self
    }
}

impl Port for FakeCamera {
    type Driver = Self;

    fn path(&self) -> String {
        "/dev/video7".to_owned()
    }

    fn open(&self) -> Result<Self, CameraError> {
        let mut world = self.0.lock().unwrap();
        if let Some(refuses) = world.refuses {
            return Err(refuses());
        }
        if world.absent_for > 0 {
            world.absent_for -= 1;
            return Err(CameraError::Missing {
                camera: self.path(),
                present: "none".to_owned(),
            });
        }
        world.opened += 1;
        Ok(self.clone())
    }
}

impl Driver for FakeCamera {
    type Stream = Self;

    fn card(&self) -> String {
        "made up".to_owned()
    }

    fn offers(&self) -> Vec<Offer> {
        self.0.lock().unwrap().offers.clone()
    }

    fn set_mode(&self, code: [u8; 4], size: [u32; 2], rate: Option<f64>) -> io::Result<Set> {
        let code = self.0.lock().unwrap().insists_on.unwrap_or(code);
        Ok(Set {
            code,
            size,
            stride: 0,
            rate,
        })
    }

    fn control(&self, control: Control) -> Option<i64> {
        let world = self.0.lock().unwrap();
        world
            .controls
            .iter()
            .find(|(known, _)| *known == control)
            .map(|(_, value)| *value)
    }

    fn set_control(&self, control: Control, value: i64) -> io::Result<()> {
        let mut world = self.0.lock().unwrap();
        if world.stubborn == Some(control) {
            return Ok(());
        }
        let known = world.controls.iter_mut().find(|(known, _)| *known == control);
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

    fn ready(&self) -> Self {
        self.clone()
    }

    fn take(&mut self) -> io::Result<Buffer<'_>> {
        let mut world = self.0.lock().unwrap();
        let Some((bytes, sequence, is_damaged)) = world.filled.pop_front() else {
            return Err(io::Error::from_raw_os_error(19));
        };
        Ok(Buffer {
            bytes: bytes.leak(),
            sequence,
            is_damaged,
        })
    }
}

impl Ready for FakeCamera {
    fn within(&self, wait: Duration) -> io::Result<bool> {
        let mut world = self.0.lock().unwrap();
        if !world.filled.is_empty() {
            return Ok(true);
        }
        // Only who has nothing to look at lets time pass.
        if wait.is_zero() {
            return Ok(false);
        }
        match world.deeds.pop_front() {
            Some(Deed::Send(numbers)) => {
                for number in numbers {
                    // The number can be read off the picture.
                    world
                        .filled
                        .push_back((vec![number as u8; WIDTH * HEIGHT], number, false));
                }
            }
            Some(Deed::Garbage(number)) => world.filled.push_back((vec![1, 2, 3], number, false)),
            Some(Deed::Flagged(number)) => world.filled.push_back((vec![0; WIDTH * HEIGHT], number, true)),
            Some(Deed::Unplug(times)) => {
                world.absent_for = times;
                return Ok(true);
            }
            Some(Deed::Silence(time)) => {
                drop(world);
                thread::sleep(time);
                return Ok(false);
            }
            None => {
                drop(world);
                thread::sleep(Duration::from_millis(2));
                return Ok(false);
            }
        }
        Ok(true)
    }
}

fn settings() -> CameraSettings {
    CameraSettings {
        mode: Wanted {
            format: None,
            rate: 60.0,
        },
        exposure_ms: None,
        gain: None,
    }
}

/// Takes pictures until this number came; all of them.
fn until(camera: &Camera, last: u8) -> Vec<u8> {
    let end = Instant::now() + Duration::from_secs(30);
    let mut numbers = Vec::new();
    while numbers.last() != Some(&last) {
        assert!(Instant::now() < end, "picture {last} never came: {numbers:?}");
        if let Some(Shot { crop, .. }) = camera.next(Duration::from_millis(5)) {
            assert!(crop.iter().all(|grey| *grey == crop[0]));
            numbers.push(crop[0]);
        }
    }
    numbers
}

#[test]
fn gaps_in_the_drivers_numbers_stale_buffers_and_damage_are_all_counted() {
    let deeds = vec![
        Deed::Send(vec![3]),
        // 4 and 5 never came.
        Deed::Send(vec![6]),
        // Three at once: only the newest is looked at.
        Deed::Send(vec![7, 8, 9]),
        Deed::Garbage(10),
        Deed::Flagged(11),
        Deed::Send(vec![12]),
    ];
    let camera = Camera::start(FakeCamera::new(*b"GREY", deeds), settings()).unwrap();
    let numbers = until(&camera, 12);
    let counts = camera.counts();
    assert_eq!(
        (counts.came, counts.missed, counts.damaged),
        (8, 2, 2),
        "{counts:?}"
    );
    assert!(!numbers.contains(&7) && !numbers.contains(&8), "{numbers:?}");
    // Every picture that came was handed out, overtaken or damaged.
    assert_eq!(
        counts.came,
        numbers.len() as u64 + counts.overtaken + counts.damaged,
        "{counts:?} {numbers:?}"
    );
    assert_eq!((counts.lost, counts.returned), (0, 0));
}

#[test]
fn a_camera_that_goes_is_opened_again_told_and_counted_and_its_numbers_begin_anew() {
    let deeds = vec![
        Deed::Send(vec![100]),
        Deed::Unplug(3),
        Deed::Send(vec![0]),
        Deed::Unplug(0),
        Deed::Send(vec![1]),
    ];
    let fake = FakeCamera::new(*b"GREY", deeds);
    let camera = Camera::start(fake.clone(), settings()).unwrap();
    until(&camera, 1);
    let counts = camera.counts();
    assert_eq!(
        (counts.lost, counts.returned, counts.missed),
        (2, 2, 0),
        "{counts:?}"
    );
    assert!(counts.longest_absence_s > 0.0);
    let news = camera.take_news();
    assert_eq!(news.len(), 4, "{news:?}");
    for (line, part) in news.iter().zip(["gone", "back after", "gone", "back after"]) {
        assert!(line.contains(part) && line.contains("/dev/video7"), "{line}");
    }
    assert_eq!(fake.0.lock().unwrap().opened, 3);
    assert!(camera.take_news().is_empty());
}

#[test]
fn a_camera_that_falls_silent_is_opened_anew() {
    let silence = Deed::Silence(Duration::from_millis(1_100));
    let camera = Camera::start(
        FakeCamera::new(*b"GREY", vec![Deed::Send(vec![1]), silence, Deed::Send(vec![2])]),
        settings(),
    )
    .unwrap();
    until(&camera, 2);
    assert_eq!((camera.counts().lost, camera.counts().returned), (1, 1));
    assert!(camera.take_news()[0].contains("no picture for 1 s"));
}

#[test]
fn a_camera_without_a_good_picture_says_so_instead_of_waiting_for_ever() {
    let camera = Camera::start(FakeCamera::new(*b"GREY", vec![Deed::Garbage(0)]), settings()).unwrap();
    let error = camera.several(4).unwrap_err().to_string();
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
fn exposure_and_gain_are_fixed_and_told_with_format_and_rate() {
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
        opened.told,
        "camera /dev/video7 (made up): 640×480 mjpeg at 60 frames/s, exposure 4 ms, gain 20"
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
fn what_the_camera_chooses_by_itself_and_a_rate_it_does_not_have_are_told() {
    let wanted = CameraSettings {
        mode: Wanted {
            format: None,
            rate: 120.0,
        },
        ..CameraSettings::default()
    };
    let told = open(&FakeCamera::new(*b"YUYV", Vec::new()), &wanted)
        .unwrap()
        .told;
    for part in [
        "60 frames/s (asked for 120)",
        "exposure automatic",
        "camera.exposure_ms",
        "gain automatic",
    ] {
        assert!(told.contains(part), "{part:?} is missing in: {told}");
    }
    let bare = FakeCamera::new(*b"YUYV", Vec::new()).with(|world| world.controls.clear());
    let told = open(&bare, &settings()).unwrap().told;
    assert!(
        told.ends_with("exposure not settable, gain not settable"),
        "{told}"
    );
}

#[test]
fn what_a_camera_cannot_do_names_what_was_found_and_what_to_do() {
    let fake = || FakeCamera::new(*b"YUYV", Vec::new());
    let fixed = CameraSettings {
        exposure_ms: Some(4.0),
        gain: Some(20),
        ..settings()
    };
    let without = |control| fake().with(|world| world.controls.retain(|(known, _)| *known != control));
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
            fake().with(|world| world.stubborn = Some(Control::ExposureTime)),
            &["camera.exposure_ms: found 4", "15.7 ms instead"],
        ),
        (
            fake().with(|world| world.offers[0].size = [1280, 720]),
            &["no usable format", "YUYV 1280×720 at 30, 60", "640×480"],
        ),
        (
            fake().with(|world| world.insists_on = Some(*b"RGB3")),
            &["found RGB3 640×480", "expected YUYV 640×480"],
        ),
        (
            fake().with(|world| {
                world.refuses = Some(|| CameraError::Permission {
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
