//! `gripline doctor` as a program: what it says of the simulated world, and its exit code.

use std::path::Path;
use std::process::{Command, Output};

fn gripline(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// The checks by name: state and what was found.
fn checks(output: &Output) -> Vec<(String, String, String)> {
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let text = |check: &serde_json::Value, key: &str| check[key].as_str().unwrap().to_owned();
    let list = json["checks"].as_array().unwrap();
    list.iter()
        .map(|check| (text(check, "name"), text(check, "state"), text(check, "found")))
        .collect()
}

fn state_of(checks: &[(String, String, String)], name: &str) -> String {
    let check = checks.iter().find(|check| check.0 == name);
    check
        .unwrap_or_else(|| panic!("{name} is missing in {checks:?}"))
        .1
        .clone()
}

#[test]
fn the_simulated_fingertip_is_well_once_it_is_calibrated() {
    let folder = tempfile::tempdir().unwrap();
    let before = checks(&gripline(folder.path(), &["doctor", "--json"]));
    assert_eq!(state_of(&before, "rest picture"), "warn");
    assert!(gripline(folder.path(), &["calibrate", "rest"]).status.success());
    let doctor = |arguments: &[&str]| {
        let all = [
            &["doctor", "--json", "--calibration", "calibration.toml"],
            arguments,
        ]
        .concat();
        gripline(folder.path(), &all)
    };
    let after = checks(&doctor(&[]));
    // Latency, processor and rights are this machine's.
    for name in [
        "camera",
        "frame rate",
        "light",
        "focus",
        "noise",
        "rest picture",
        "firmware",
        "faults",
        "network",
    ] {
        assert_eq!(state_of(&after, name), "ok", "{after:?}");
    }
    for name in ["processor", "latency", "real time"] {
        state_of(&after, name);
    }
    // Another fingertip than the calibrated one.
    let other = doctor(&["--seed", "9"]);
    assert_eq!(state_of(&checks(&other), "rest picture"), "fail");
    assert_eq!(other.status.code(), Some(1));
    let slow = checks(&doctor(&["--instructions", "portable"]));
    assert_eq!(state_of(&slow, "processor"), "warn");
    std::fs::write(folder.path().join("calibration-rest.npy"), "no array").unwrap();
    assert_eq!(state_of(&checks(&doctor(&[])), "rest picture"), "fail");
}

#[test]
fn a_microcontroller_or_weights_that_are_not_there_fail_and_the_rest_is_still_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [
        "doctor",
        "--json",
        "--mcu",
        "serial:/dev/none",
        "--weights",
        "none.safetensors",
    ];
    let output = gripline(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(1));
    let found = checks(&output);
    assert_eq!(state_of(&found, "firmware"), "fail");
    assert_eq!(state_of(&found, "network"), "fail");
    state_of(&found, "real time");
    let output = gripline(folder.path(), &["doctor", "--mcu", "serial:/dev/none"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.contains("FAIL firmware") && text.contains("udev rule"),
        "{text}"
    );
    let end = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(end.contains("not fit: firmware"), "{end}");
    let blind = gripline(folder.path(), &["doctor", "--json", "--source", "dir:none"]);
    assert_eq!(state_of(&checks(&blind), "camera"), "fail");
    assert_eq!(
        (
            state_of(&checks(&blind), "firmware").as_str(),
            blind.status.code()
        ),
        ("ok", Some(1))
    );
    let wrong = gripline(folder.path(), &["doctor", "--mcu", "pigeon"]);
    assert_eq!(wrong.status.code(), Some(2));
}

#[test]
fn of_two_fingertips_each_is_calibrated_and_looked_at_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let rest = |more: &[&str]| {
        let arguments = [&["calibrate", "rest", "--yes", "--pictures", "8"][..], more].concat();
        gripline(folder.path(), &arguments)
    };
    let refused = rest(&["--fingertip", "2"]);
    let why = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        refused.status.code() == Some(2) && why.contains("camera.second_source"),
        "{why}"
    );
    for (fingertip, file) in [("1", "first.toml"), ("2", "second.toml")] {
        let output = rest(&["--fingertip", fingertip, "--source", "sim", "--out", file]);
        assert!(output.status.success(), "{output:?}");
    }
    let doctor = |first: &str, second: &str| {
        let arguments = ["doctor", "--json", "--second-source", "sim"];
        let files = ["--calibration", first, "--second-calibration", second];
        checks(&gripline(folder.path(), &[&arguments[..], &files].concat()))
    };
    let found = doctor("first.toml", "second.toml");
    for name in ["camera", "second camera", "rest picture", "second rest picture"] {
        assert_eq!(state_of(&found, name), "ok", "{name}");
    }
    let swapped = doctor("first.toml", "first.toml");
    assert_eq!(state_of(&swapped, "rest picture"), "ok");
    assert_eq!(state_of(&swapped, "second rest picture"), "fail");
}

/// The value of `KEY=value` or `KEY="value"` in a file of the folder docs.
fn value_of(file: &str, key: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../docs")
        .join(file);
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let mut words = lines.flat_map(|line| line.split(", "));
    let found = words.find_map(|word| word.strip_prefix(key)?.strip_prefix('='));
    found
        .unwrap_or_else(|| panic!("{key} is missing in {file}"))
        .trim_matches('"')
        .to_owned()
}

#[test]
fn the_service_runs_in_the_group_that_the_udev_rule_gives_the_device_to() {
    let group = value_of("70-gripline.rules", "GROUP");
    assert_eq!(value_of("gripline.service", "Group"), group);
    assert_eq!(value_of("70-gripline.rules", "MODE"), "0660");
    assert_eq!(value_of("70-gripline.rules", "TAG+"), "uaccess");
}
