//! `gripline sensor check` as its users see it: the built binary, its words, its exit codes.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn check(file: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["sensor", "check", file])
        .output()
        .unwrap()
}

#[test]
fn shipped_sensors_are_described_and_found_whole() {
    for name in ["particle-fingertip", "gelsight-mini"] {
        let output = check(name);
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{output:?}");
        assert!(text.starts_with(&format!("{name}.1: ")), "{text}");
        assert!(text.contains("nothing is missing"), "{text}");
    }
}

#[test]
fn every_problem_of_a_users_file_is_named_with_file_line_and_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    let shipped = include_str!("../../../sensors/gelsight-mini.toml");
    let text = shipped
        .replace("rate_hz = 25.0\n", "")
        .replace("young_mpa = 0.43", "young_mpa = 430");
    std::fs::write(&path, text).unwrap();
    let output = check(path.to_str().unwrap());
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    for part in [
        "mine.toml:",
        "capture.rate_hz: found no such key",
        "gel.young_mpa: found 430, expected a number from 0.005 to 10",
        "found 2 problems",
    ] {
        assert!(errors.contains(part), "{part}: {errors}");
    }
}

#[test]
fn a_name_that_is_neither_file_nor_sensor_is_reported_with_those_that_are() {
    let output = check("gelsight-maxi");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(
        errors.contains("gelsight-maxi") && errors.contains("particle-fingertip, gelsight-mini"),
        "{errors}"
    );
}

fn gripline(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .output()
        .unwrap()
}

fn run_clip(clip: &Path, more: &[&str]) -> Output {
    let source = format!("file:{}", clip.display());
    let mut arguments = vec![
        "run",
        "--sensor",
        "gelsight-mini",
        "--unpaced",
        "--json",
        "--source",
        &source,
    ];
    arguments.extend(more);
    gripline(&arguments)
}

/// A recorded grasp: an object that is held, and lost at the end; `None` without the recordings.
fn recorded_grasp() -> Option<PathBuf> {
    recorded("pattern_cotton_cloth__exp_num_1__fe5294/camera_0.avi")
}

/// A clip of the recordings; `None` without them.
fn recorded(clip: &str) -> Option<PathBuf> {
    let Some(recordings) = std::env::var_os("GRIPLINE_RECORDINGS") else {
        println!("skipped: recordings not found, set GRIPLINE_RECORDINGS");
        return None;
    };
    Some(Path::new(&recordings).join("gelsight-mini").join(clip))
}

#[track_caller]
fn assert_refused(output: &Output, parts: &[&str]) {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    for part in parts {
        assert!(errors.contains(part), "{part:?} is missing in: {errors}");
    }
}

#[test]
fn a_recorded_grasp_goes_all_the_way_to_line_and_recording_and_is_replayed_bit_by_bit() {
    let Some(clip) = recorded_grasp() else { return };
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("grasp.mcap");
    let recording = recording.to_str().unwrap();
    let output = run_clip(&clip, &["--rest", "12..20", "--hold", "--record", recording]);
    let errors = String::from_utf8_lossy(&output.stderr);
    // The first picture is too dark: done with loss.
    assert_eq!(output.status.code(), Some(3), "{errors}");
    let lines: Vec<serde_json::Value> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let (summary, frames) = lines.split_last().unwrap();
    assert_eq!(frames.len(), 74);
    assert_eq!(summary["summary"], true);
    let number = |frame: &serde_json::Value, key: &str| frame[key].as_f64().unwrap();
    for frame in frames {
        assert!((0.0..=1.0).contains(&number(frame, "slip_evidence")), "{frame}");
        assert!(frame["markers"]["followed"].as_u64().unwrap() >= 24, "{frame}");
        for key in [
            "stick_ratio",
            "state",
            "line_n",
            "fn",
            "ft",
            "gate",
            "health",
            "faults",
        ] {
            assert!(frame.get(key).is_some(), "{key}: {frame}");
        }
    }
    // The open hand feels nothing; the closed one presses and the line holds.
    let at_rest = &frames[12..20];
    assert!(
        at_rest.iter().all(|frame| number(frame, "fn") < 0.2),
        "{at_rest:?}"
    );
    let held = frames.iter().filter(|frame| number(frame, "fn") > 0.5);
    assert!(held.count() > 10, "{summary}");
    assert!(frames[40..].iter().all(|frame| number(frame, "line_n") > 0.0));
    // Its evidence comes from the picture, through the microcontroller.
    let max = |key: &str| {
        frames
            .iter()
            .map(|frame| frame["witnesses"][key].as_f64().unwrap())
            .fold(0.0, f64::max)
    };
    assert!(max("motion") > 0.5, "{}", max("motion"));

    let replayed = gripline(&["replay", recording]);
    let stdout = String::from_utf8_lossy(&replayed.stdout);
    assert!(
        replayed.status.success() && stdout.contains("74 of 74 frames compared, 0 decided otherwise"),
        "{stdout} {}",
        String::from_utf8_lossy(&replayed.stderr)
    );
    let other = gripline(&[
        "run",
        "--source",
        &format!("mcap:{recording}"),
        "--unpaced",
        "--json",
    ]);
    assert_refused(
        &other,
        &[
            "recording of sensor gelsight-mini.1",
            "expected one of particle-fingertip.1",
            "--sensor",
        ],
    );
}

#[test]
fn a_rest_with_contact_is_refused_and_without_a_rest_the_cost_is_reported() {
    let Some(clip) = recorded_grasp() else { return };
    // The hand closes in these frames.
    let touched = run_clip(&clip, &["--rest", "20..50"]);
    assert_refused(
        &touched,
        &[
            "--rest 20..50",
            "a contact or a motion in pictures",
            "untouched gel",
            "nothing touches it in 20..",
        ],
    );
    let beyond = run_clip(&clip, &["--rest", "70..90"]);
    assert_refused(&beyond, &["--rest 70..90", "found 74 frames"]);
    let bare = run_clip(&clip, &[]);
    let errors = String::from_utf8_lossy(&bare.stderr);
    assert!(
        [Some(0), Some(3)].contains(&bare.status.code())
            && errors.contains("regular grid")
            && errors.contains("costs"),
        "{errors}"
    );
}

#[test]
fn a_rest_that_is_one_still_contact_is_refused_by_the_pictures_without_it_and_a_hand_that_begins_to_close_is_left_out()
 {
    let Some(clip) = recorded("plier__exp_num_3__3a0007/camera_0.avi") else {
        return;
    };
    // Held throughout, and still.
    assert_refused(
        &run_clip(&clip, &["--rest", "60..68"]),
        &[
            "--rest 60..68",
            "found an imprint",
            "gone in picture",
            "untouched gel",
        ],
    );
    let Some(clip) = recorded("tin_box__exp_num_3__c614f8/camera_0.avi") else {
        return;
    };
    let closes = run_clip(&clip, &["--rest", "12..20"]);
    let errors = String::from_utf8_lossy(&closes.stderr);
    assert!(
        closes.status.success() && errors.contains("2 of 8 pictures show a contact"),
        "{errors}"
    );
}

#[test]
fn weights_of_another_sensor_and_a_description_without_a_key_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let weights = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../network/weights/tracked.safetensors"
    );
    let clip = folder.path().join("none.avi");
    let output = run_clip(&clip, &["--weights", weights]);
    assert_refused(
        &output,
        &[
            "tracked.safetensors",
            "sensor particle-fingertip.1",
            "expected gelsight-mini.1",
        ],
    );
    let weights = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../network/weights/gelsight-mini.safetensors"
    );
    assert_refused(
        &gripline(&["run", "--weights", weights, "--seconds", "1", "--json"]),
        &["sensor gelsight-mini.1", "expected particle-fingertip.1"],
    );

    let file = folder.path().join("mine.toml");
    let shipped = include_str!("../../../sensors/gelsight-mini.toml");
    std::fs::write(&file, shipped.replace("thickness_mm = 4.25\n", "")).unwrap();
    let output = gripline(&[
        "run",
        "--sensor",
        file.to_str().unwrap(),
        "--source",
        "file:none.avi",
    ]);
    assert_refused(&output, &["mine.toml:", "gel.thickness_mm: found no such key"]);
}

#[test]
fn weights_tuned_for_another_sensor_and_those_that_do_not_fit_their_own_presses_are_refused() {
    use gripline_network::marker_forces::MarkerWeights;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tuned.safetensors");
    let shipped = include_bytes!("../../../network/weights/gelsight-mini.safetensors");
    let refused = |sensor: &str, held_out_share: f32, parts: &[&str]| {
        let tuned = MarkerWeights {
            sensor: sensor.to_owned(),
            held_out_share: Some(held_out_share),
            ..MarkerWeights::parse(shipped).unwrap()
        };
        std::fs::write(&file, tuned.to_bytes()).unwrap();
        let clip = folder.path().join("none.avi");
        assert_refused(&run_clip(&clip, &["--weights", file.to_str().unwrap()]), parts);
    };
    refused(
        "mine.1",
        0.05,
        &["tuned.safetensors", "sensor mine.1", "expected gelsight-mini.1"],
    );
    refused(
        "gelsight-mini.1",
        0.42,
        &["tuned.safetensors", "held_out_share", "0.42", "at most 0.3"],
    );
}

#[test]
fn a_clip_without_markers_is_refused_with_what_was_expected() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("grey.avi");
    let size = gripline_capture::geometry::Size::new(320, 240);
    let mut writer = gripline_capture::clip::ClipWriter::create(&clip, size, 25.0).unwrap();
    for _ in 0..3 {
        writer.push(&vec![120; size.pixels()]).unwrap();
    }
    writer.finish().unwrap();
    assert_refused(
        &run_clip(&clip, &[]),
        &[
            "grey.avi, frame 0",
            "markers in a square grid, expected at least 24",
        ],
    );
    assert_refused(
        &run_clip(&clip, &["--rest", "0..2"]),
        &["--rest 0..2", "markers in a square grid"],
    );
}
