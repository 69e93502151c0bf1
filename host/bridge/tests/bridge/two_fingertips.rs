//! `gripline run` with two fingertips as a program: what it tells of each, what it records, and what it refuses.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn gripline(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

fn lines(output: &Output) -> Vec<Value> {
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let read = |line: &str| serde_json::from_str(line).expect("every line is JSON");
    text.lines().map(read).collect()
}

#[track_caller]
fn ends(output: &Output, code: i32) -> String {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{said}");
    said
}

#[test]
fn both_are_recorded_replayed_bit_for_bit_exported_and_played_again() {
    let folder = tempfile::tempdir().unwrap();
    let run = [
        "run",
        "--source",
        "sim",
        "--second-source",
        "sim",
        "--unpaced",
        "--seconds",
        "4",
        "--json",
        "--record",
        "both.mcap",
    ];
    let output = gripline(folder.path(), &run);
    ends(&output, 0);
    let mut frames = lines(&output);
    let summary = frames.pop().unwrap();
    assert_eq!(frames.len(), 480, "60 a second of each");
    for (number, frame) in frames.iter().enumerate() {
        assert_eq!(frame["sensor"], number % 2);
    }
    for fingertip in summary["fingertips"].as_array().unwrap() {
        assert_eq!(
            (
                &fingertip["source"],
                &fingertip["frames"],
                &fingertip["maps_unanswered"]
            ),
            (&"sim".into(), &240.into(), &0.into()),
            "{fingertip}"
        );
        assert!(fingertip["answers_checked"].as_u64() >= Some(240));
        assert_eq!(fingertip["shadow_mismatches"], 0);
    }

    let replayed = lines(&{
        let output = gripline(folder.path(), &["replay", "--json", "both.mcap"]);
        ends(&output, 0);
        output
    });
    for (key, expected) in [
        ("frames", 480),
        ("different", 0),
        ("not_comparable", 0),
        ("missing", 0),
    ] {
        assert_eq!(replayed[0][key], expected, "{}", replayed[0]);
    }

    ends(
        &gripline(folder.path(), &["export", "both.mcap", "--out", "out"]),
        0,
    );
    let shape = |name: &str| {
        let bytes = std::fs::read(folder.path().join("out").join(name)).unwrap();
        npyz::NpyFile::new(&bytes[..]).unwrap().shape().to_vec()
    };
    for name in ["maps.npy", "maps_1.npy"] {
        assert_eq!(shape(name), [240, 3, 20, 20], "{name}");
    }
    assert_eq!(shape("pictures_1.npy"), [240, 440, 440]);

    // The second fingertip's pictures alone are those of a first one; both again give what both gave.
    let again = gripline(
        folder.path(),
        &[
            "run",
            "--source",
            "mcap:both.mcap",
            "--second-source",
            "mcap:both.mcap",
            "--unpaced",
            "--json",
        ],
    );
    ends(&again, 0);
    let forces = |frames: &[Value]| -> Vec<Value> {
        let of =
            |frame: &Value| serde_json::json!([frame["sensor"], frame["fn"], frame["ft"], frame["contact"]]);
        frames
            .iter()
            .filter(|frame| frame.get("fn").is_some())
            .map(of)
            .collect()
    };
    assert_eq!(forces(&lines(&again)), forces(&frames));

    for fingertip in ["1", "2"] {
        let plot = ["plot", "both.mcap", "--out", "a.png", "--fingertip", fingertip];
        ends(&gripline(folder.path(), &plot), 0);
    }
}

#[test]
fn fingertips_that_do_not_belong_together_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("one.toml"),
        "[camera]\nsecond_source = \"sim\"\n[microcontroller]\nsensors = 1\n",
    )
    .unwrap();
    std::fs::write(folder.path().join("none.toml"), "").unwrap();
    for (arguments, parts) in [
        (
            ["--second-source", "dir:frames"].as_slice(),
            [
                "found dir:frames beside camera.source sim",
                "expected the simulated world for both",
            ],
        ),
        (
            &["--second-calibration", "none.toml"],
            ["without camera.second_source", "there is no second fingertip"],
        ),
        (
            &["--config", "one.toml"],
            [
                "microcontroller.sensors: found 1 with camera.second_source sim",
                "expected 2",
            ],
        ),
        (
            &["--second-source", "webcam"],
            ["--second-source: found webcam", "expected sim"],
        ),
    ] {
        let all: Vec<&str> = ["run", "--unpaced", "--seconds", "0.5"]
            .iter()
            .chain(arguments)
            .copied()
            .collect();
        let said = ends(&gripline(folder.path(), &all), 2);
        for part in parts {
            assert!(said.contains(part), "{part} is missing in {said}");
        }
    }
    // One that was recorded alone has no second fingertip to draw.
    let record = ["run", "--unpaced", "--seconds", "0.2", "--record", "one.mcap"];
    ends(&gripline(folder.path(), &record), 0);
    let said = ends(
        &gripline(
            folder.path(),
            &["plot", "one.mcap", "--out", "a.png", "--fingertip", "2"],
        ),
        2,
    );
    assert!(said.contains("found no frame of it in one.mcap"), "{said}");
}
