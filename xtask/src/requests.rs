//! `cargo xtask bench requests`: how long a request takes until the microcontroller confirms it, by the microcontroller's own clock, over a
//! whole cable and over one that loses packets. A test holds the bounds and prints what it found; this only reads it. The wall clock,
//! in which the emulator translates code, is that of `bench outside`.

use std::fmt::Write as _;
use std::process::Stdio;

use serde_json::{Value, json};

use crate::error::Error;
use crate::{emulator, firmware, process};

/// In process and on the emulated board, each over two cables.
const LINES: usize = 4;

/// `cargo xtask bench requests [--json]`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let is_json = match arguments {
        [] => false,
        [one] if one == "--json" => true,
        [other, ..] => return Err(Error::usage("bench requests", other, "nothing or --json")),
    };
    let image = firmware::build(emulator::BOARD)?.0;
    let board = emulator::build()?;
    let mut test = process::cargo();
    test.args(["test", "--quiet", "--package", "gripline-pipeline"])
        .args(["--test", "request_time", "--", "--include-ignored", "--nocapture"])
        .args(["--test-threads", "1"])
        .env("GRIPLINE_EMULATOR", &board)
        .env("GRIPLINE_IMAGE", &image)
        .stderr(Stdio::inherit());
    let output = test.output().map_err(|source| Error::Start {
        program: "cargo".to_owned(),
        source,
    })?;
    let said = String::from_utf8_lossy(&output.stdout);
    let lines: Vec<Value> = said.lines().filter_map(read).collect();
    if is_json {
        println!("{}", all(&lines));
    } else {
        print!("{}", text(&lines));
    }
    if output.status.success() && lines.len() == LINES {
        return Ok(());
    }
    Err(Error::Failed {
        command: process::shown(&test),
        status: output.status.to_string(),
        said: said.into_owned(),
    })
}

/// The object in a line of the test, behind what the test runner says.
fn read(line: &str) -> Option<Value> {
    serde_json::from_str(line.get(line.find('{')?..)?).ok()
}

/// Of each microcontroller (`embedded`, `emulator`) over each cable (`whole`, `lossy`): median and longest, ms.
fn all(lines: &[Value]) -> Value {
    let mut found = json!({});
    for line in lines {
        let is_emulated = line["mcu"]
            .as_str()
            .is_some_and(|mcu| mcu.starts_with("emulated"));
        let mcu = if is_emulated { "emulator" } else { "embedded" };
        let cable = if line["lost_per_mille"] == 0 {
            "whole"
        } else {
            "lossy"
        };
        found[mcu][cable] = json!({"median_ms": ms(line, "median_us"), "longest_ms": ms(line, "longest_us")});
    }
    found
}

fn ms(line: &Value, key: &str) -> f64 {
    line[key].as_f64().unwrap_or(f64::NAN) / 1e3
}

fn text(lines: &[Value]) -> String {
    let mut text = "request until confirmed, of 100, by the microcontroller's clock\n".to_owned();
    for line in lines {
        let _ = writeln!(
            text,
            "  {}, {} of 1,000 packets lost: median {:.1} ms, longest {:.1} ms",
            line["mcu"].as_str().unwrap_or_default(),
            line["lost_per_mille"],
            ms(line, "median_us"),
            ms(line, "longest_us")
        );
    }
    text
}
