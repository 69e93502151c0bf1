//! `gripline evaluate paper` as other programs see it: the built binary, its JSON, its document, its messages.

use std::process::{Command, Output};

use serde_json::Value;

fn evaluate(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["evaluate", "paper"])
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn the_papers_experiment_prints_the_keys_that_programs_read_and_writes_its_section() {
    let folder = tempfile::tempdir().unwrap();
    let document = folder.path().join("evidence.md");
    std::fs::write(&document, "# Mine\n\nkept\n").unwrap();
    let path = document.to_str().unwrap();
    let output = evaluate(&[
        "--quick",
        "--objects",
        "1",
        "--network",
        "unet",
        "--json",
        "--out",
        path,
    ]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");

    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let objects = json["objects"].as_array().unwrap();
    assert_eq!(objects.len(), 1);
    assert_eq!(
        (objects[0]["name"].as_str(), objects[0]["mass_g"].as_f64()),
        (Some("hollow plastic ball, 11.90 g"), Some(11.9))
    );
    for place in [&objects[0], &json["translation"], &json["rotation"]] {
        for detector in ["stick_ratio", "gripline"] {
            for figure in ["accuracy", "precision", "recall"] {
                let percent = place[detector][figure].as_f64();
                assert!(
                    percent.is_some_and(|percent| (0.0..=100.0).contains(&percent)),
                    "{detector} {figure} {place}"
                );
            }
        }
        // What never says slip has no precision, so it is there and null.
        let baseline = place["baseline"].as_object().unwrap();
        assert!(
            baseline["accuracy"].is_number()
                && baseline.contains_key("precision")
                && baseline["recall"].is_number()
        );
    }
    assert!(json["lead_time_ms_median"].as_f64().unwrap() > 0.0);
    assert!(json["alarms_per_minute"].as_f64().unwrap() >= 0.0);
    assert_eq!(json["bounds"].as_array().unwrap().len(), 5);

    let written = std::fs::read_to_string(&document).unwrap();
    assert!(written.starts_with("# Mine\n\nkept\n"), "{written}");
    for part in [
        "<!-- gripline evaluate paper: begin -->",
        "### What it must show",
        "| hollow plastic ball",
        "no evidence",
    ] {
        assert!(written.contains(part), "{part}: {written}");
    }
}
