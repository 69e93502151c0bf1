//! The program as tests start it, and how it ends.

use std::process::{Command, Output};

/// Runs `gripline` with these arguments to its end.
pub(crate) fn gripline(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .output()
        .expect("the program starts")
}

/// What it said on standard error; it must have ended with this exit code.
#[track_caller]
pub(crate) fn ends(output: &Output, code: i32) -> String {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{said}");
    said
}
