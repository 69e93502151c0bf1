//! Every finding at every level, with the numbers of simulated faults.

use gripline_network::InstructionSet;
use gripline_protocol::message::Hello;
use gripline_simulation::{CameraFault, Fingertip, FingertipParams, GripScene, Image};

use super::Level::{Fail, Ok, Warn};
use super::*;

fn rest_pictures(seed: u64) -> Vec<Vec<u8>> {
    let mut fingertip = Fingertip::new(seed, FingertipParams::default()).unwrap();
    (0..4).map(|_| fingertip.rest_image().pixels).collect()
}

fn with(fault: CameraFault, pictures: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let faulty = |(number, pixels): (usize, &Vec<u8>)| {
        let mut image = Image::crop();
        image.pixels.clone_from(pixels);
        fault.of(&image, number as u64).pixels
    };
    pictures.iter().enumerate().map(faulty).collect()
}

fn calibrated(figures: &Figures) -> Rest {
    Rest {
        date: String::new(),
        device: String::new(),
        pictures: "a".into(),
        mean: "b".into(),
        count: 4,
        mean_level: figures.mean_level,
        saturated_share: figures.saturated_share,
        particles: figures.particles,
        sharpness: figures.sharpness,
        noise_levels: figures.noise_levels,
        residual_px: figures.moved_px,
    }
}

fn assert_finding(finding: &Finding, level: Level, found: &str, fix: &str) {
    assert_eq!(finding.level, level, "{finding:?}");
    assert!(
        finding.found.contains(found) && finding.fix.contains(fix),
        "{finding:?}"
    );
    assert_eq!(level == Ok, finding.fix.is_empty(), "{finding:?}");
}

#[test]
fn a_sound_camera_is_ok_in_everything() {
    let figures = Figures::of(&rest_pictures(1));
    let rest_of = calibrated(&figures);
    let change = Change::between(&figures.mean, &Figures::of(&rest_pictures(1)).mean);
    for finding in [
        light(&figures),
        focus(&figures, Some(&rest_of)),
        noise(&figures, &rest_of),
        rest(Some(&change)),
    ] {
        assert_finding(&finding, Ok, "", "");
    }
}

#[test]
fn light_that_is_missing_or_too_much_is_reported() {
    let good = rest_pictures(1);
    let of = |fault| light(&Figures::of(&with(fault, &good)));
    assert_finding(&of(CameraFault::Black), Fail, "mean level", "switch the lamps on");
    assert_finding(
        &of(CameraFault::White),
        Fail,
        "100.0 % saturated",
        "expose shorter",
    );
    assert_finding(
        &of(CameraFault::Unplugged),
        Fail,
        "mean level 128",
        "expose shorter",
    );
    assert_finding(
        &of(CameraFault::OverExposed),
        Warn,
        "% saturated",
        "expose shorter",
    );
}

#[test]
fn a_lens_that_lost_some_or_all_of_its_focus_is_reported() {
    let good = rest_pictures(1);
    let figures = Figures::of(&good);
    let blurred = Figures::of(&with(CameraFault::Defocused, &good));
    assert_finding(&focus(&blurred, None), Fail, "sharpness 0.0", "focus the lens");
    // Sharper once: a quarter of it is gone.
    let mut once = calibrated(&figures);
    once.sharpness = figures.sharpness / 0.75;
    assert_finding(&focus(&figures, Some(&once)), Warn, "sharpness", "focus the lens");
    assert_finding(&focus(&figures, None), Ok, "", "");
}

#[test]
fn noise_beyond_the_calibrated_is_reported() {
    let figures = Figures::of(&rest_pictures(1));
    let mut quiet = calibrated(&figures);
    quiet.noise_levels = 1.0;
    assert_finding(&noise(&figures, &quiet), Warn, "2.0", "less gain");
}

#[test]
fn a_rest_picture_that_is_missing_moved_dented_dimmed_or_anothers_is_reported() {
    assert_finding(&rest(None), Warn, "no calibrated one", "calibrate rest");
    let good = rest_pictures(1);
    let before = Figures::of(&good).mean;
    let of = |now: &[u8]| rest(Some(&Change::between(&before, now)));
    let other = Figures::of(&rest_pictures(2)).mean;
    assert_finding(
        &of(&other),
        Fail,
        "% of the particles gone",
        "not the sensor surface that was calibrated",
    );
    let half = Figures::of(&with(CameraFault::HalfCovered, &good)).mean;
    assert_eq!(of(&half).level, Fail);
    let shifted: Vec<u8> = (0..before.len()).map(|at| before[at.saturating_sub(1)]).collect();
    assert_finding(&of(&shifted), Warn, "1.00 px aside", "fasten them");
    let dimmed: Vec<u8> = before
        .iter()
        .map(|&level| (f64::from(level) * 0.85) as u8)
        .collect();
    assert_finding(&of(&dimmed), Warn, "% light", "lamps and exposure");
    let dark: Vec<u8> = before
        .iter()
        .map(|&level| (f64::from(level) * 0.7) as u8)
        .collect();
    assert_finding(&of(&dark), Fail, "% light", "lamps and exposure");
    let mut scene = GripScene::new(4);
    let before = scene.rest_image().pixels;
    while !scene.step(0.02, 0.5).unwrap().touching {}
    let touched = scene.step(0.1, 0.5).unwrap().image.pixels;
    let dented = rest(Some(&Change::between(&before, &touched)));
    assert_finding(&dented, Warn, "px more", "something touches the sensor surface");
}

#[test]
fn pictures_that_come_too_seldom_or_not_at_all_are_reported() {
    let every = |step: f64| (0..60).map(|k| f64::from(k) * step).collect::<Vec<_>>();
    assert_finding(&frame_rate(&every(1.0 / 60.0), 60.0), Ok, "60.0/s, 0 late", "");
    assert_finding(
        &frame_rate(&every(1.0 / 50.0), 60.0),
        Warn,
        "50.0/s",
        "shorter exposure",
    );
    assert_finding(
        &frame_rate(&every(1.0 / 25.0), 60.0),
        Fail,
        "25.0/s",
        "shorter exposure",
    );
    let mut one_missing = every(1.0 / 60.0);
    one_missing.remove(30);
    assert_finding(
        &frame_rate(&one_missing, 60.0),
        Warn,
        "1 late or missing of 58",
        "USB port",
    );
    assert_finding(&frame_rate(&[], 60.0), Fail, "0.0/s", "");
}

#[test]
fn firmware_of_another_version_is_reported() {
    let hello = Hello::of_this_build(0, 1);
    assert_finding(&firmware(&hello, hello.build), Ok, "speaks our schema", "");
    assert_finding(&firmware(&hello, [9, 0, 0]), Warn, "on ", "cargo xtask flash");
}

#[test]
fn a_chip_in_its_bootloader_is_reported_with_the_way_out() {
    assert_eq!(bootloader(&[]), None);
    let finding = bootloader(&["1-2", "3-1.4"]).unwrap();
    assert_finding(&finding, Warn, "at 1-2, 3-1.4", "gripline flash --usb");
}

#[test]
fn a_device_that_is_not_there_or_not_the_only_one_is_reported() {
    let device = |serial: &str, place: &str| Attached {
        serial: Some(serial.to_owned()),
        place: place.to_owned(),
    };
    let two = [device("A1", "1-2"), device("B7", "1-3")];
    assert_finding(&usb(&two[..1], None), Ok, "1-2", "");
    assert_finding(&usb(&two, Some("B7")), Ok, "1-3", "");
    assert_finding(&usb(&[], None), Fail, "no device 1209:0001", "plug it in");
    assert_finding(&usb(&two, None), Fail, "A1", "plug it in");
    assert_finding(&usb(&two, Some("C3")), Fail, "B7", "plug it in");
}

#[test]
fn faults_and_another_table_are_reported() {
    assert_finding(&faults(&[]), Ok, "none", "");
    assert_finding(
        &faults(&["MAPS LOST", "WATCHDOG RESET"]),
        Warn,
        "MAPS LOST, WATCHDOG RESET",
        "safety.md",
    );
    assert_finding(&line_table(true), Ok, "", "");
    assert_finding(&line_table(false), Warn, "another", "calibrate line --store");
}

#[test]
fn a_processor_without_wide_vectors_or_that_may_not_use_them_is_reported() {
    use InstructionSet::{Avx2, Avx512, Neon, Portable};
    assert_finding(&processor(Avx512, Avx512), Ok, "uses", "");
    assert_finding(&processor(Avx2, Avx2), Ok, "uses", "");
    assert_finding(&processor(Neon, Neon), Ok, "uses", "");
    assert_finding(
        &processor(Portable, Avx2),
        Warn,
        "has avx2",
        "leave network.instructions",
    );
    assert_finding(&processor(Portable, Portable), Warn, "has portable", "with AVX2");
}

#[test]
fn a_machine_that_is_too_slow_is_reported() {
    assert_finding(&latency(&mut [1.0, 1.2, 1.1]), Ok, "median 1.10 ms", "");
    assert_finding(
        &latency(&mut [1.0, 1.2, 5.0]),
        Warn,
        "longest of 3 5.00 ms",
        "release build",
    );
    assert_finding(&latency(&mut [2.0; 5]), Warn, "median 2.00 ms", "release build");
    assert_finding(&latency(&mut [6.0; 5]), Fail, "median 6.00 ms", "unet");
    assert_finding(&latency(&mut []), Fail, "inf", "");
    let markers = |times_ms: f64, rate_hz| marker_latency(&mut [times_ms; 5], rate_hz);
    assert_finding(&markers(2.9, 25.0), Ok, "median 2.90 ms", "");
    assert_finding(&markers(12.0, 25.0), Warn, "median 12.00 ms", "release build");
    // Before the next picture comes, of a camera that is faster.
    assert_finding(&markers(12.0, 60.0), Fail, "median 12.00 ms", "release build");
}

#[test]
fn missing_rights_are_a_warning_or_a_failure_when_they_are_wanted() {
    let lacks = ["no real time: locked memory: not permitted".to_owned()];
    assert_finding(&realtime(&[], true), Ok, "SCHED_FIFO", "");
    assert_finding(
        &realtime(&lacks, false),
        Warn,
        "not permitted",
        "gripline.service",
    );
    assert_finding(&realtime(&lacks, true), Fail, "not permitted", "CAP_SYS_NICE");
}

#[test]
fn a_missing_ffmpeg_fails_where_the_source_is_a_clip_and_else_warns() {
    let missing = || Err(CaptureError::NoFfmpeg { program: "ffmpeg" });
    assert_eq!(
        ffmpeg(Result::Ok("ffmpeg version 5".to_owned()), true).level,
        Level::Ok
    );
    assert_eq!(ffmpeg(missing(), true).level, Level::Fail);
    let finding = ffmpeg(missing(), false);
    assert_eq!(finding.level, Level::Warn);
    assert!(
        finding.found.contains("apt-get install ffmpeg"),
        "{}",
        finding.found
    );
}
