//! `gripline sensor check` as its users see it: the built binary, its words, its exit codes.

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
fn a_name_that_is_neither_file_nor_sensor_is_told_with_those_that_are() {
    let output = check("gelsight-maxi");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(
        errors.contains("gelsight-maxi") && errors.contains("particle-fingertip, gelsight-mini"),
        "{errors}"
    );
}

fn run_clip(clip: &std::path::Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args([
            "run",
            "--sensor",
            "gelsight-mini",
            "--unpaced",
            "--json",
            "--source",
        ])
        .arg(format!("file:{}", clip.display()))
        .args(more)
        .output()
        .unwrap()
}

#[test]
fn a_recorded_grasp_gives_health_markers_and_evidence_and_a_rest_span_with_contact_is_refused() {
    let Some(recordings) = std::env::var_os("GRIPLINE_RECORDINGS") else {
        println!("skipped: recordings not found, set GRIPLINE_RECORDINGS");
        return;
    };
    // An object that is held, and lost at the end.
    let folder =
        std::path::Path::new(&recordings).join("gelsight-mini/pattern_cotton_cloth__exp_num_1__fe5294");
    let clip = folder.join("camera_0.avi");
    let output = run_clip(&clip, &["--rest", "12..20"]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    assert!(errors.contains("no line is driven"), "{errors}");
    let lines: Vec<serde_json::Value> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let (summary, frames) = lines.split_last().unwrap();
    assert_eq!(frames.len(), 74 - 12);
    for frame in &frames[12..] {
        assert!(frame["markers"].as_u64().unwrap() >= 24, "{frame}");
        let evidence = frame["slip_evidence"].as_f64().unwrap();
        assert!((0.0..=1.0).contains(&evidence), "{frame}");
        assert_eq!(frame["rest"], "own pictures");
    }
    assert!(summary["slip_evidence_most"].as_f64().unwrap() > 0.5, "{summary}");

    // The hand closes in these frames.
    let touched = run_clip(&clip, &["--rest", "20..50"]);
    let errors = String::from_utf8_lossy(&touched.stderr);
    assert_eq!(touched.status.code(), Some(1), "{errors}");
    assert!(
        errors.contains("--rest 20..50") && errors.contains("untouched gel"),
        "{errors}"
    );

    let bare = run_clip(&clip, &[]);
    let errors = String::from_utf8_lossy(&bare.stderr);
    assert!(
        bare.status.success() && errors.contains("regular grid"),
        "{errors}"
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
    let output = run_clip(&clip, &[]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(
        errors.contains("grey.avi, frame 0")
            && errors.contains("markers in a square grid, expected at least 24"),
        "{errors}"
    );
}
