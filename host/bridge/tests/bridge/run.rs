//! `gripline run` as a program: its output, its exit codes, its links.

use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::serial_board::{Line, SerialBoard};
use serde_json::Value;

fn gripline(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .output()
        .expect("the program starts")
}

/// Frames and summary of a run with `--json`.
fn reports(output: &Output) -> (Vec<Value>, Value) {
    let text = String::from_utf8(output.stdout.clone()).expect("JSON is UTF-8");
    let mut lines: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).expect("every line is JSON"))
        .collect();
    let summary = lines.pop().expect("a summary comes last");
    assert_eq!(summary["summary"], true);
    (lines, summary)
}

/// One line on standard error that holds all of `parts`, and this exit code.
#[track_caller]
fn assert_refused(arguments: &[&str], code: i32, parts: &[&str]) {
    let output = gripline(arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    for part in parts {
        assert!(
            error.contains(part),
            "{arguments:?}: {part:?} is missing in: {error}"
        );
    }
    assert_eq!(error.trim_end().lines().count(), 1, "{error}");
}

#[test]
fn json_has_an_object_a_frame_and_a_summary_last() {
    let output = gripline(&["run", "--seconds", "2", "--unpaced", "--json"]);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let (frames, summary) = reports(&output);
    assert_eq!(frames.len(), 120);
    let keys = [
        "frame",
        "t_s",
        "gate",
        "fn",
        "ft",
        "mz",
        "contact",
        "stick",
        "stick_ratio",
        "state",
        "line_n",
        "latency_us",
    ];
    for (number, frame) in frames.iter().enumerate() {
        assert_eq!(frame["frame"], number);
        assert!(keys.iter().all(|key| frame.get(key).is_some()), "{frame}");
    }
    for key in [
        "stages",
        "frame_to_link_us_median",
        "frame_to_link_us_p999",
        "shadow_mismatches",
        "frames_per_second",
    ] {
        assert!(summary.get(key).is_some(), "{key} is missing in {summary}");
    }
    assert_eq!(
        (&summary["shadow_mismatches"], &summary["maps_unanswered"]),
        (&0.into(), &0.into())
    );
    assert_eq!(summary["answers_checked"].as_u64(), Some(120));
    // The library in this process knows no commit.
    assert_eq!(
        summary["firmware"],
        concat!(env!("CARGO_PKG_VERSION"), " on host")
    );
    assert_eq!(summary["stages"].as_array().map(Vec::len), Some(6));
    assert!(summary["stages"][0]["median_us"].is_f64() && summary["stages"][0]["p99_us"].is_f64());
}

/// What a frame says besides times.
fn decisions(frames: &[Value]) -> Vec<String> {
    let keys = [
        "frame", "gate", "fn", "ft", "mz", "contact", "stick", "state", "line_n", "faults", "truth",
    ];
    frames
        .iter()
        .map(|frame| keys.map(|key| frame[key].to_string()).join(" "))
        .collect()
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_seed_another() {
    let run = |seed| {
        reports(&gripline(&[
            "run",
            "--seconds",
            "3",
            "--unpaced",
            "--json",
            "--seed",
            seed,
        ]))
        .0
    };
    let (one, again, other) = (run("4"), run("4"), run("5"));
    assert_eq!(decisions(&one), decisions(&again));
    assert_ne!(decisions(&one), decisions(&other));
}

#[test]
fn wrong_usage_ends_with_code_2_and_says_what_was_expected() {
    assert_refused(
        &["run", "--mcu", "can0"],
        2,
        &[
            "can0",
            "expected embedded, emulator, emulator:uart, usb, usb:SERIAL or serial:PORT",
        ],
    );
    assert_refused(&["run", "--source", "webcam"], 2, &["webcam", "expected sim"]);
    assert_refused(
        &["run", "--seconds", "0"],
        2,
        &["found 0, expected a number from 0.1"],
    );
    assert_refused(&["run", "--seconds", "NaN"], 2, &["found NaN"]);
    assert_refused(&["run", "--gate", "maybe"], 2, &["maybe"]);
    assert_refused(
        &["run", "--unpaced", "--mcu", "usb"],
        2,
        &["--unpaced", "expected embedded or emulator"],
    );
    assert_refused(&["grip"], 2, &["grip"]);
}

#[test]
fn unknown_weights_end_with_code_1_and_name_the_file() {
    assert_refused(
        &["run", "--weights", "no/such/file.safetensors"],
        1,
        &["no/such/file.safetensors"],
    );
    let garbage = scratch("garbage.safetensors");
    std::fs::write(&garbage, b"these are no weights").unwrap();
    let path = garbage.to_str().unwrap();
    assert_refused(
        &["run", "--weights", path],
        1,
        &["garbage.safetensors", "safetensors"],
    );
}

fn scratch(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    folder.join(format!("{}-{name}", std::process::id()))
}

#[test]
fn a_missing_port_and_a_missing_emulator_end_with_code_1() {
    assert_refused(
        &["run", "--mcu", "serial:/dev/gripline-none"],
        1,
        &["/dev/gripline-none", "not found"],
    );
    assert_refused(
        &["run", "--mcu", "usb:none-has-this"],
        1,
        &["none-has-this", "not found"],
    );
    let output = Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["run", "--mcu", "emulator"])
        .env("GRIPLINE_EMULATOR", "/gripline/no-emulator")
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(
        error.contains("/gripline/no-emulator") && error.contains("cargo xtask emulator"),
        "{error}"
    );
}

#[test]
fn a_port_that_another_program_has_is_busy() {
    let line = Line::new();
    let path = line.name();
    let _another_program = serialport::new(&path, 921_600).open().expect("the port is free");
    assert_refused(
        &["run", "--mcu", &format!("serial:{path}")],
        1,
        &[&path, "busy", "close the other program"],
    );
}

#[test]
fn a_port_where_nobody_answers_is_no_microcontroller() {
    let line = Line::new();
    let path = line.name();
    assert_refused(
        &["run", "--mcu", &format!("serial:{path}")],
        1,
        &[&path, "no answer to the handshake"],
    );
}

/// The serial link and the COBS framing as a real board would use them.
#[test]
fn a_microcontroller_on_a_serial_port_answers_every_map_as_the_shadow_does() {
    let mut line = Line::new();
    let path = line.name();
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    let board = std::thread::spawn(move || {
        SerialBoard::new(0).serve(&mut line, |_| stopped.load(Ordering::Relaxed));
    });
    let output = gripline(&[
        "run",
        "--seconds",
        "3",
        "--json",
        "--hold",
        "--mcu",
        &format!("serial:{path}"),
    ]);
    stop.store(true, Ordering::Relaxed);
    board.join().expect("the board did not panic");
    let (frames, summary) = reports(&output);
    // A busy machine may answer a map late (exit code 3, done with loss); wrong it may never be.
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert_eq!(frames.len(), 180);
    assert_eq!(summary["shadow_mismatches"], 0);
    // Every map was answered, late or not; the last one's answer may come after the end.
    assert!(summary["answers_checked"].as_u64() >= Some(179), "{summary}");
    // A frame that shows the answer to the map before counts as unanswered. How many answers come in time depends on the machine; some do.
    assert!(summary["maps_unanswered"].as_u64() < Some(179), "{summary}");
}

/// A USB adapter that is pulled out and put in again, into another pseudo terminal under the same name.
#[cfg(unix)]
#[test]
fn a_serial_port_that_goes_away_and_comes_back_is_taken_up_again() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("by-id");
    let mut line = Line::plug(&name);
    let (stop, its_name) = (Arc::new(AtomicBool::new(false)), name.clone());
    let stopped = Arc::clone(&stop);
    let board = std::thread::spawn(move || {
        let mut board = SerialBoard::new(0);
        let is_over = || stopped.load(Ordering::Relaxed);
        // Pulled out in the middle of the run, when the host holds.
        board.serve(&mut line, |board| {
            is_over() || board.board.program().status().maps >= 60
        });
        drop(line);
        let away = Instant::now();
        while away.elapsed() < Duration::from_millis(400) {
            board.live();
            std::thread::sleep(Duration::from_millis(1));
        }
        let mut line = Line::plug(&its_name);
        board.serve(&mut line, |_| is_over());
    });
    let path = format!("serial:{}", name.display());
    let output = gripline(&["run", "--seconds", "4", "--json", "--hold", "--mcu", &path]);
    stop.store(true, Ordering::Relaxed);
    board.join().expect("the board did not panic");
    let error = String::from_utf8_lossy(&output.stderr);
    let (frames, summary) = reports(&output);
    assert_eq!(output.status.code(), Some(3), "{error}");
    assert!(
        error.contains("is gone (") && error.contains("is back"),
        "{error}{summary}"
    );
    assert_eq!(frames.len(), 240, "the pictures went on");
    let is_away = |frame: &Value| frame["faults"].as_array().unwrap().contains(&"NO DEVICE".into());
    let away = frames.iter().filter(|frame| is_away(frame)).count();
    assert!(away > 0 && !is_away(&frames[239]), "{away} frames without it");
    assert_eq!(
        (
            &summary["link_losses"],
            &summary["microcontroller_restarts"],
            &summary["shadow_mismatches"]
        ),
        (&1.into(), &0.into(), &0.into()),
        "{summary}"
    );
    // The map under way when the plug was pulled was still taken; none of them was answered, and that is counted.
    let count = |name: &str| summary[name].as_u64().expect("a count");
    assert!(count("maps_not_taken") > 0, "{summary}");
    assert!(
        count("maps_unanswered") + count("maps_late") >= away as u64,
        "{away} frames without it: {summary}"
    );
    assert!(summary["answers_checked"].as_u64() >= Some(90), "{summary}");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn the_emulated_board_closes_the_loop_through_the_whole_scene() {
    let (frames, summary) = reports(&gripline(&[
        "run",
        "--seconds",
        "12",
        "--unpaced",
        "--json",
        "--mcu",
        "emulator",
    ]));
    assert_eq!(frames.len(), 720);
    assert_eq!(
        (&summary["shadow_mismatches"], &summary["gross_slip_frames"]),
        (&0.into(), &0.into())
    );
    assert!(summary["answers_checked"].as_u64() >= Some(700), "{summary}");
}

/// What a program over there answers to a request, up to this many bytes.
fn asked(address: &str, path: &str, bytes: u64) -> String {
    let mut stream = std::net::TcpStream::connect(address).expect("somebody listens");
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let mut text = String::new();
    stream.take(bytes).read_to_string(&mut text).unwrap();
    text
}

#[test]
fn live_values_are_served_to_prometheus_and_as_newline_json() {
    let state = tempfile::tempdir().unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_gripline"))
        .env("XDG_STATE_HOME", state.path())
        .args(["run", "--seconds", "60", "--serve", "127.0.0.1:0"])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = String::new();
    std::io::BufRead::read_line(
        &mut std::io::BufReader::new(child.stderr.take().unwrap()),
        &mut said,
    )
    .unwrap();
    let address = said.trim().rsplit('/').next().unwrap().to_owned();
    let frames = asked(&address, "/frames", 20_000);
    let metrics = asked(&address, "/metrics", 1 << 20);
    let other = asked(&address, "/secrets", 1 << 20);
    // Whoever asks with something else than HTTP is not served and harms nobody.
    let mut rude = std::net::TcpStream::connect(&address).unwrap();
    rude.write_all(&[0xFF; 9_000]).unwrap();
    drop(rude);
    let again = asked(&address, "/metrics", 1 << 20);
    let taken = gripline(&["run", "--seconds", "1", "--serve", &address]);
    child.kill().unwrap();
    child.wait().unwrap();

    let (head, body) = frames.split_once("\r\n\r\n").unwrap();
    assert!(
        head.starts_with("HTTP/1.1 200 OK") && head.contains("x-ndjson"),
        "{head}"
    );
    let mut numbers = body.lines().rev().skip(1).map(|line| {
        serde_json::from_str::<Value>(line).unwrap()["frame"]
            .as_u64()
            .unwrap()
    });
    let newest = numbers.next().unwrap();
    assert!(
        numbers.zip(1..).all(|(number, before)| number == newest - before),
        "{body}"
    );

    let count = |text: &str| {
        let line = text
            .lines()
            .find(|line| line.starts_with("gripline_frames_total "))
            .unwrap();
        line.rsplit(' ').next().unwrap().parse::<u64>().unwrap()
    };
    assert!(
        metrics.contains("text/plain; version=0.0.4") && count(&metrics) > newest,
        "{metrics}"
    );
    assert!(count(&again) >= count(&metrics));
    assert!(other.starts_with("HTTP/1.1 404"), "{other}");
    let error = String::from_utf8_lossy(&taken.stderr);
    assert_eq!(taken.status.code(), Some(1), "{error}");
    assert!(
        error.contains(&format!("serve.listen {address}")) && error.contains("no other program"),
        "{error}"
    );
}

#[test]
fn real_time_tells_what_it_lacks_and_the_run_goes_on() {
    // No machine has this core; whether the rest is allowed depends on the machine.
    let output = gripline(&[
        "run",
        "--seconds",
        "0.2",
        "--json",
        "--realtime",
        "--realtime-core",
        "1023",
    ]);
    let (frames, summary) = reports(&output);
    assert_eq!(frames.len(), 12);
    let lacks: Vec<&str> = summary["realtime_lacks"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(Value::as_str)
        .collect();
    assert!(
        lacks
            .iter()
            .any(|lack| lack.contains("core 1023: ") && lack.contains("realtime.core")),
        "{lacks:?}"
    );
    let said = String::from_utf8_lossy(&output.stderr);
    for lack in lacks {
        assert!(
            lack.contains(", expected ") && said.contains(lack),
            "{lack} is missing in {said}"
        );
    }
    for stage in summary["stages"].as_array().unwrap() {
        assert!(stage["deadline_us"].is_f64() && stage["late"].is_u64(), "{stage}");
    }
    assert_refused(
        &["run", "--unpaced", "--realtime"],
        2,
        &["--unpaced", "--realtime", "expected one of them"],
    );
}

/// Only `cargo xtask test --all` runs these.
mod slow {
    use super::*;

    #[test]
    fn the_line_rises_before_gross_slip_in_two_rounds_of_the_scene() {
        let (frames, summary) = reports(&gripline(&["run", "--seconds", "24", "--unpaced", "--json"]));
        assert_eq!(
            summary["gross_slip_frames"], 0,
            "the object slid {} mm",
            summary["slip_mm"]
        );
        // Where the script only holds, the grip is what it closed with, more or less; in the pull it rises well above.
        let line = |phase: &str, frame: &Value| {
            (frame["truth"]["phase"] == phase).then(|| frame["line_n"].as_f64().unwrap())
        };
        let max = |phase: &str| {
            frames
                .iter()
                .filter_map(|frame| line(phase, frame))
                .fold(0.0, f64::max)
        };
        assert!(
            max("pull") > max("hold") + 1.0,
            "hold {} N, pull {} N",
            max("hold"),
            max("pull")
        );
        // Skipping cost no touch: whatever presses with 0.2 N or more is looked at.
        for frame in &frames {
            let pressed = frame["truth"]["normal_n"].as_f64().unwrap() >= 0.2;
            assert!(
                !(pressed && frame["gate"] == "no_contact"),
                "a touch was missed: {frame}"
            );
        }
    }

    #[test]
    fn a_reader_that_takes_nothing_never_holds_up_the_loop_and_what_it_misses_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("all.mcap");
        let mut child = Command::new(env!("CARGO_BIN_EXE_gripline"))
            .args([
                "run",
                "--json",
                "--seconds",
                "11",
                "--record-pictures",
                "off",
                "--record",
            ])
            .arg(&recording)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Nobody reads the lines: a pipe holds 64 kB, and a line a frame has more than 1 kB.
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(1), "{said}");
        assert!(
            said.contains("standard output: found nobody who reads it"),
            "{said}"
        );
        let mut lines = String::new();
        child.stdout.take().unwrap().read_to_string(&mut lines).unwrap();
        assert!(lines.lines().count() > 10);
        // The loop has gone on all the time.
        let output = Command::new(env!("CARGO_BIN_EXE_gripline"))
            .args(["replay", "--json"])
            .arg(&recording)
            .output()
            .unwrap();
        let replayed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(replayed["frames"], 660, "{replayed}");
    }

    /// The line reached 30 N where a growing load, or what a map shows of the normal force as shear, was taken for a slide.
    #[test]
    fn a_pull_of_3_n_and_a_twist_are_held_with_less_than_25_n() {
        let peak_n = |seed: u32| {
            let seed = seed.to_string();
            let output = gripline(&["run", "--seconds", "12", "--unpaced", "--json", "--seed", &seed]);
            let (frames, _) = reports(&output);
            assert_eq!(frames.len(), 720, "seed {seed}");
            assert!(
                frames.iter().all(|frame| frame["truth"]["gross_slip"] == false),
                "seed {seed} lost the object"
            );
            let lines = frames.iter().filter_map(|frame| frame["line_n"].as_f64());
            lines.fold(0.0, f64::max)
        };
        let peaks: Vec<f64> = (1..=8).map(peak_n).collect();
        println!("highest line of each seed, N: {peaks:.1?}");
        assert!(peaks.iter().all(|peak| *peak < 25.0), "{peaks:.1?}");
        let firm = peaks.iter().filter(|peak| **peak > 20.0).count();
        assert!(firm <= 2, "{firm} of 8 above 20 N: {peaks:.1?}");
    }
}
