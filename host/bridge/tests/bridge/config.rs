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

/// The program with these arguments and this configuration file.
fn with_file(arguments: &[&str], toml: &str) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lab.toml");
    std::fs::write(&path, toml).unwrap();
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .args(["--config", path.to_str().unwrap()])
        .output()
        .unwrap()
}

#[test]
fn a_configuration_with_typos_ends_with_code_2_and_a_line_for_every_one() {
    let file = "[camera]\nsorce = \"sim\"\n[run]\nseconds = -1\n[microcontroller]\nfrictoin = 0.4\n";
    for command in [&["run", "--json"][..], &["config", "show"]] {
        let refused = with_file(command, file);
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(
            said.starts_with("gripline: 3 errors in the configuration\n"),
            "{said}"
        );
        for part in [
            "lab.toml: camera.sorce: no such key, did you mean camera.source?\n",
            "lab.toml: run.seconds: found -1, expected a number from 0.1 to 1000000000\n",
            "lab.toml: microcontroller.frictoin: no such setting, did you mean friction?\n",
        ] {
            assert!(said.contains(part), "{said}");
        }
        assert!(refused.stdout.is_empty());
    }
}

#[test]
fn show_says_what_is_in_force_and_where_it_comes_from() {
    let file = "[simulation]\nseed = 7\n[network]\ngate = \"off\"\n";
    let shown = with_file(&["config", "show", "--gate", "difference"], file);
    assert!(shown.status.success(), "{}", text(&shown.stderr));
    let lines: Vec<Vec<&str>> = text(&shown.stdout)
        .lines()
        .map(|line| line.split_whitespace().collect())
        .collect();
    for line in [
        "gate = \"difference\" # flag --gate",
        "seed = 7 # file",
        "mcu = \"embedded\" # default",
    ] {
        let words: Vec<&str> = line.split_whitespace().collect();
        assert!(
            lines.contains(&words),
            "{line} is missing in {}",
            text(&shown.stdout)
        );
    }
    let json = with_file(&["config", "show", "--json"], file);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(json["keys"]["simulation.seed"]["value"], 7);
    assert_eq!(json["keys"]["simulation.seed"]["from"], "file");
    assert_eq!(json["keys"]["run.seconds"]["value"], serde_json::Value::Null);
}

#[test]
fn a_run_does_what_its_file_says() {
    let run = with_file(
        &["run", "--json"],
        "[run]\nseconds = 0.5\nunpaced = true\n[network]\ngate = \"off\"\n[microcontroller]\nfloor_n = 4.0\n",
    );
    assert!(run.status.success(), "{}", text(&run.stderr));
    let summary: serde_json::Value = serde_json::from_str(text(&run.stdout).lines().last().unwrap()).unwrap();
    assert_eq!(summary["frames"], 30);
    assert_eq!(summary["gate_network"], 30);
    let refused = with_file(&["run", "--unpaced"], "[microcontroller]\nceiling_n = 41.0\n");
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        text(&refused.stderr).contains("microcontroller.ceiling_n: found 41.0, expected 0.0002 to 40.0"),
        "{}",
        text(&refused.stderr)
    );
}

#[test]
fn the_default_file_runs_and_the_shipped_unit_starts_what_there_is() {
    let default = Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["config", "default"])
        .output()
        .unwrap();
    let shown = with_file(&["config", "show"], text(&default.stdout));
    assert!(shown.status.success(), "{}", text(&shown.stderr));
    assert!(
        !text(&shown.stdout).contains("# file\n"),
        "a commented key is none"
    );

    let unit = include_str!("../../../../docs/gripline.service");
    let start = unit
        .lines()
        .find_map(|line| line.strip_prefix("ExecStart="))
        .unwrap();
    let arguments = start.split_whitespace().map(std::ffi::OsString::from);
    gripline::commands::cli::Cli::from_arguments(arguments).unwrap();
}

#[test]
fn manual_pages_and_completions_know_every_flag() {
    let folder = tempfile::tempdir().unwrap();
    let gripline = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_gripline"))
            .args(arguments)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout).to_owned()
    };
    gripline(&["man", "--out", folder.path().to_str().unwrap()]);
    let page = std::fs::read_to_string(folder.path().join("gripline-run.1")).unwrap();
    assert!(
        page.contains("\\-\\-gate") && page.contains("\\-\\-config"),
        "{page}"
    );
    assert!(
        folder.path().join("gripline.1").is_file() && folder.path().join("gripline-config-show.1").is_file()
    );
    for shell in ["bash", "zsh", "fish"] {
        assert!(gripline(&["completions", shell]).contains("unpaced"), "{shell}");
    }
}
