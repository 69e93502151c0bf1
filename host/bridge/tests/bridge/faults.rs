//! `gripline faults` as a program.

use std::process::{Command, Output};

fn faults(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .arg("faults")
        .args(arguments)
        .output()
        .expect("the program starts")
}

#[test]
fn a_microcontroller_without_faults_says_so_to_people_and_programs() {
    let output = faults(&["--mcu", "embedded"]);
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(
        String::from_utf8_lossy(&output.stdout),
        "released, line at 0.00 N\nno fault\n"
    );
    let output = faults(&["--mcu", "embedded", "--json", "--acknowledge", "--release"]);
    assert_eq!(output.status.code(), Some(0));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        found,
        serde_json::json!({"mode": "released", "line_n": 0.0, "faults": [], "acknowledged": []})
    );
    // To let go is to have looked first.
    assert_eq!(faults(&["--mcu", "embedded", "--release"]).status.code(), Some(2));
}
