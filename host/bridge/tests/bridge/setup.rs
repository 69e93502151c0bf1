//! `gripline setup` as a program, without a terminal: what it writes, and that it never writes over what somebody has written.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Runs it as a user with a home of his own.
fn gripline(home: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .current_dir(home)
        .env("HOME", home)
        .env_remove("XDG_CONFIG_HOME")
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// A failed check of the doctor's is this machine's; what is asked here is that setup came to its end.
fn ended_with_doctor(output: &Output) {
    let said = said(output);
    assert!(matches!(output.status.code(), Some(0 | 3 | 1)), "{said}");
    assert!(
        said.contains("ok   rest picture") && said.contains("ok   firmware"),
        "{said}"
    );
}

#[test]
fn flags_and_defaults_make_a_configuration_and_a_calibration_that_a_run_uses_from_anywhere() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("lab/g.toml");
    let file = out.to_str().unwrap();
    let setup = ["setup", "--yes", "--camera", "sim", "--out", "lab/g.toml"];
    ended_with_doctor(&gripline(home.path(), &setup));

    let elsewhere = tempfile::tempdir().unwrap();
    let shown = gripline(elsewhere.path(), &["config", "show", "--json", "--config", file]);
    let shown: serde_json::Value = serde_json::from_slice(&shown.stdout).unwrap();
    let value = |key: &str| shown["keys"][key]["value"].as_str().unwrap().to_owned();
    assert_eq!(
        (value("camera.source"), value("link.mcu")),
        ("sim".into(), "embedded".into())
    );
    let calibration = home.path().join("lab/calibration.toml");
    assert_eq!(
        fs::canonicalize(value("calibration.file")).unwrap(),
        fs::canonicalize(calibration).unwrap()
    );
    let run = gripline(
        elsewhere.path(),
        &["run", "--config", file, "--seconds", "0.2", "--unpaced", "--json"],
    );
    assert!(said(&run).contains("\"summary\":true"), "{}", said(&run));
}

#[test]
fn a_configuration_that_says_something_is_replaced_only_with_force() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("g.toml");
    let mine = "[camera]\nsource = \"/dev/video7\"\n";
    fs::write(&out, mine).unwrap();
    let setup = [
        "setup", "--yes", "--camera", "sim", "--rest", "later", "--out", "g.toml",
    ];
    let refused = gripline(home.path(), &setup);
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    for part in ["g.toml: found a configuration", "--force replaces it"] {
        assert!(said(&refused).contains(part), "{}", said(&refused));
    }
    assert_eq!(fs::read_to_string(&out).unwrap(), mine);

    let forced = gripline(home.path(), &[&setup[..], &["--force"]].concat());
    assert!(said(&forced).contains("ok   firmware"), "{}", said(&forced));
    let text = fs::read_to_string(&out).unwrap();
    assert!(
        text.contains("source = \"sim\"") && !text.contains("calibration.file"),
        "{text}"
    );

    // The one that the package brings says nothing.
    let default = gripline(home.path(), &["config", "default"]);
    fs::write(&out, &default.stdout).unwrap();
    gripline(home.path(), &setup);
    assert_eq!(
        fs::read_to_string(&out).unwrap().lines().nth(3),
        text.lines().nth(3)
    );
}

#[test]
fn what_is_wrong_is_reported_before_anything_is_written() {
    let home = tempfile::tempdir().unwrap();
    let out = ["--out", "g.toml"];
    for (arguments, code, parts) in [
        // Without --yes nobody answers.
        (
            &["setup", "--camera", "sim"][..],
            2,
            &["--sensor: found no answer", "or --yes for"][..],
        ),
        (
            &["setup", "--yes", "--camera", "sim", "--mcu", "usb"],
            2,
            &[
                "--mcu: found usb with pictures of sim",
                "a gripper that they do not show",
            ],
        ),
        (
            &["setup", "--yes", "--camera", "/dev/video63", "--mcu", "embedded"],
            1,
            &["/dev/video63"],
        ),
        (
            &["setup", "--yes", "--camera", "sim", "--rest", "no/such.toml"],
            2,
            &["no/such.toml", "expected a calibration"],
        ),
        (
            &["setup", "--yes", "--sensor", "gelsight-mini"],
            2,
            &["--sensor: found gelsight-mini", "--source file:CLIP"],
        ),
    ] {
        let output = gripline(home.path(), &[arguments, &out].concat());
        assert_eq!(
            output.status.code(),
            Some(code),
            "{arguments:?}: {}",
            said(&output)
        );
        for part in parts {
            assert!(said(&output).contains(part), "{arguments:?}: {}", said(&output));
        }
    }
    assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
    let nowhere = gripline(
        home.path(),
        &["setup", "--yes", "--camera", "sim", "--out", "/proc/no/g.toml"],
    );
    assert!(
        said(&nowhere).contains("expected a folder that can be written"),
        "{}",
        said(&nowhere)
    );
}
