//! Every judgement in every state, with the numbers of simulated faults.

use gripline_network::InstructionSet;
use gripline_protocol::message::Hello;
use gripline_simulation::{CameraFault, Fingertip, FingertipParams, GripScene, Image};

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

fn assert_state(check: &Check, state: State, found: &str, advice: &str) {
    assert_eq!(check.state, state, "{check:?}");
    assert!(
        check.found.contains(found) && check.advice.contains(advice),
        "{check:?}"
    );
    assert_eq!(check.state == State::Ok, check.advice.is_empty(), "{check:?}");
}

#[test]
fn a_sound_camera_is_ok_in_everything() {
    let figures = Figures::of(&rest_pictures(1));
    let rest_of = calibrated(&figures);
    let change = Change::between(&figures.mean, &Figures::of(&rest_pictures(1)).mean);
    for check in [
        light(&figures),
        focus(&figures, Some(&rest_of)),
        noise(&figures, &rest_of),
        rest(Some(&change)),
    ] {
        assert_state(&check, State::Ok, "", "");
    }
}

#[test]
fn light_that_is_missing_or_too_much_is_told() {
    let good = rest_pictures(1);
    let of = |fault| light(&Figures::of(&with(fault, &good)));
    assert_state(
        &of(CameraFault::Black),
        State::Fail,
        "mean level",
        "switch the lamps on",
    );
    assert_state(
        &of(CameraFault::White),
        State::Fail,
        "100.0 % saturated",
        "expose shorter",
    );
    assert_state(
        &of(CameraFault::Unplugged),
        State::Fail,
        "mean level 128",
        "expose shorter",
    );
    assert_state(
        &of(CameraFault::OverExposed),
        State::Warn,
        "% saturated",
        "expose shorter",
    );
}

#[test]
fn a_lens_that_lost_some_or_all_of_its_focus_is_told() {
    let good = rest_pictures(1);
    let figures = Figures::of(&good);
    let blurred = Figures::of(&with(CameraFault::Defocused, &good));
    assert_state(
        &focus(&blurred, None),
        State::Fail,
        "sharpness 0.0",
        "focus the lens",
    );
    // Sharper once: a quarter of it is gone.
    let mut once = calibrated(&figures);
    once.sharpness = figures.sharpness / 0.75;
    assert_state(
        &focus(&figures, Some(&once)),
        State::Warn,
        "sharpness",
        "focus the lens",
    );
    assert_state(&focus(&figures, None), State::Ok, "", "");
}

#[test]
fn noise_beyond_the_calibrated_is_told() {
    let figures = Figures::of(&rest_pictures(1));
    let mut quiet = calibrated(&figures);
    quiet.noise_levels = 1.0;
    assert_state(&noise(&figures, &quiet), State::Warn, "2.0", "less gain");
}

#[test]
fn a_rest_picture_that_is_missing_moved_dented_dimmed_or_anothers_is_told() {
    assert_state(&rest(None), State::Warn, "no calibrated one", "calibrate rest");
    let good = rest_pictures(1);
    let before = Figures::of(&good).mean;
    let of = |now: &[u8]| rest(Some(&Change::between(&before, now)));
    let other = Figures::of(&rest_pictures(2)).mean;
    assert_state(
        &of(&other),
        State::Fail,
        "% of the particles gone",
        "not the skin that was calibrated",
    );
    let half = Figures::of(&with(CameraFault::HalfCovered, &good)).mean;
    assert_eq!(of(&half).state, State::Fail);
    let shifted: Vec<u8> = (0..before.len()).map(|at| before[at.saturating_sub(1)]).collect();
    assert_state(&of(&shifted), State::Warn, "1.00 px aside", "fasten them");
    let dimmed: Vec<u8> = before
        .iter()
        .map(|&level| (f64::from(level) * 0.85) as u8)
        .collect();
    assert_state(&of(&dimmed), State::Warn, "% light", "lamps and exposure");
    let dark: Vec<u8> = before
        .iter()
        .map(|&level| (f64::from(level) * 0.7) as u8)
        .collect();
    assert_state(&of(&dark), State::Fail, "% light", "lamps and exposure");
    let mut scene = GripScene::new(4);
    let before = scene.rest_image().pixels;
    while !scene.step(0.02, 0.5).unwrap().touching {}
    let touched = scene.step(0.1, 0.5).unwrap().image.pixels;
    let dented = rest(Some(&Change::between(&before, &touched)));
    assert_state(&dented, State::Warn, "px more", "something touches the skin");
}

#[test]
fn pictures_that_come_too_seldom_or_not_at_all_are_told() {
    let every = |step: f64| (0..60).map(|k| f64::from(k) * step).collect::<Vec<_>>();
    assert_state(
        &frame_rate(&every(1.0 / 60.0), 60.0),
        State::Ok,
        "60.0/s, 0 late",
        "",
    );
    assert_state(
        &frame_rate(&every(1.0 / 50.0), 60.0),
        State::Warn,
        "50.0/s",
        "shorter exposure",
    );
    assert_state(
        &frame_rate(&every(1.0 / 25.0), 60.0),
        State::Fail,
        "25.0/s",
        "shorter exposure",
    );
    let mut one_missing = every(1.0 / 60.0);
    one_missing.remove(30);
    assert_state(
        &frame_rate(&one_missing, 60.0),
        State::Warn,
        "1 late or missing of 58",
        "USB port",
    );
    assert_state(&frame_rate(&[], 60.0), State::Fail, "0.0/s", "");
}

#[test]
fn firmware_of_another_version_is_told() {
    let hello = Hello::of_this_build(0, 1);
    assert_state(&firmware(&hello, hello.build), State::Ok, "speaks our schema", "");
    assert_state(
        &firmware(&hello, [9, 0, 0]),
        State::Warn,
        "on ",
        "cargo xtask flash",
    );
}

#[test]
fn a_device_that_is_not_there_or_not_the_only_one_is_told() {
    let device = |serial: &str, place: &str| Attached {
        serial: Some(serial.to_owned()),
        place: place.to_owned(),
    };
    let two = [device("A1", "1-2"), device("B7", "1-3")];
    assert_state(&usb(&two[..1], None), State::Ok, "1-2", "");
    assert_state(&usb(&two, Some("B7")), State::Ok, "1-3", "");
    assert_state(&usb(&[], None), State::Fail, "no device 1209:0001", "plug it in");
    assert_state(&usb(&two, None), State::Fail, "A1", "plug it in");
    assert_state(&usb(&two, Some("C3")), State::Fail, "B7", "plug it in");
}

#[test]
fn faults_and_another_table_are_told() {
    assert_state(&faults(&[]), State::Ok, "none", "");
    assert_state(
        &faults(&["MAPS LOST", "WATCHDOG RESET"]),
        State::Warn,
        "MAPS LOST, WATCHDOG RESET",
        "safety.md",
    );
    assert_state(&line_table(true), State::Ok, "", "");
    assert_state(
        &line_table(false),
        State::Warn,
        "another",
        "calibrate line --store",
    );
}

#[test]
fn a_processor_without_wide_vectors_or_that_may_not_use_them_is_told() {
    use InstructionSet::{Avx2, Avx512, Portable};
    assert_state(&processor(Avx512, Avx512), State::Ok, "uses", "");
    assert_state(&processor(Avx2, Avx2), State::Ok, "uses", "");
    assert_state(
        &processor(Portable, Avx2),
        State::Warn,
        "has avx2",
        "leave network.instructions",
    );
    assert_state(
        &processor(Portable, Portable),
        State::Warn,
        "has portable",
        "with AVX2",
    );
}

#[test]
fn a_machine_that_is_too_slow_is_told() {
    assert_state(&latency(&mut [1.0, 1.2, 1.1]), State::Ok, "median 1.10 ms", "");
    assert_state(
        &latency(&mut [1.0, 1.2, 5.0]),
        State::Warn,
        "longest of 3 5.00 ms",
        "release build",
    );
    assert_state(
        &latency(&mut [2.0; 5]),
        State::Warn,
        "median 2.00 ms",
        "release build",
    );
    assert_state(&latency(&mut [6.0; 5]), State::Fail, "median 6.00 ms", "unet");
    assert_state(&latency(&mut []), State::Fail, "inf", "");
}

#[test]
fn missing_rights_are_a_warning_or_a_failure_when_they_are_wanted() {
    let lacks = ["no real time: locked memory: not permitted".to_owned()];
    assert_state(&realtime(&[], true), State::Ok, "SCHED_FIFO", "");
    assert_state(
        &realtime(&lacks, false),
        State::Warn,
        "not permitted",
        "gripline.service",
    );
    assert_state(
        &realtime(&lacks, true),
        State::Fail,
        "not permitted",
        "CAP_SYS_NICE",
    );
}

#[test]
fn a_missing_ffmpeg_fails_where_the_source_is_a_clip_and_else_warns() {
    let missing = || Err(CaptureError::NoFfmpeg { program: "ffmpeg" });
    assert_eq!(ffmpeg(Ok("ffmpeg version 5".to_owned()), true).state, State::Ok);
    assert_eq!(ffmpeg(missing(), true).state, State::Fail);
    let check = ffmpeg(missing(), false);
    assert_eq!(check.state, State::Warn);
    assert!(check.found.contains("apt-get install ffmpeg"), "{}", check.found);
}
