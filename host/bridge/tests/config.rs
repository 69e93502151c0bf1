//! `gripline config mcu` as a program: what it prints, what it refuses and with which exit code.

use std::process::{Command, Output};

fn config(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["config", "mcu", "--mcu", "embedded"])
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

#[test]
fn the_settings_in_force_are_printed_as_toml_and_as_json() {
    let toml = config(&[]);
    assert!(toml.status.success(), "{}", text(&toml.stderr));
    assert!(
        text(&toml.stdout).contains("friction = 0.45\n"),
        "{}",
        text(&toml.stdout)
    );
    let json = config(&["--json"]);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(json["ceiling_n"], 30.0);
    assert_eq!(json["line"]["points"][4]["code"], 4_095);
}

#[test]
fn a_file_sets_what_it_says_and_a_wrong_one_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mcu.toml");
    let file = path.to_str().unwrap();
    std::fs::write(&path, "friction = 0.4\nmargin = 0.25\n").unwrap();
    let set = config(&["--write", file, "--volatile"]);
    assert!(set.status.success(), "{}", text(&set.stderr));
    assert!(text(&set.stdout).contains("friction = 0.4\n"));
    // The microcontroller in this process has no flash to keep them in.
    let kept = config(&["--write", file]);
    assert_eq!(kept.status.code(), Some(1));
    assert!(text(&kept.stderr).contains("flash"), "{}", text(&kept.stderr));
    std::fs::write(&path, "floor_n = 45.0\n").unwrap();
    let refused = config(&["--write", file]);
    assert_eq!(refused.status.code(), Some(1));
    let said = text(&refused.stderr);
    assert!(
        said.contains("mcu.toml: floor_n: found 45.0, expected 0.0 to 30.0"),
        "{said}"
    );
    assert_eq!(config(&["--volatile"]).status.code(), Some(2));
}
