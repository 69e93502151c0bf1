//! The live view on a pseudo-terminal.

use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use nix::fcntl::{FcntlArg, FdFlag, fcntl};
use nix::pty::{OpenptyResult, Winsize, openpty};
use serde_json::{Value, json};

use crate::control::Serving;

/// How long the program may take to start, or to end.
const PATIENCE: Duration = Duration::from_secs(30);

/// A window of 120×40 characters: its own end, and that of what runs in it.
fn window() -> (OwnedFd, OwnedFd) {
    let size = Winsize {
        ws_row: 40,
        ws_col: 120,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    let OpenptyResult { master, slave } = openpty(&size, None).expect("a pseudo-terminal");
    // No program holds its own window open.
    fcntl(&master, FcntlArg::F_SETFD(FdFlag::FD_CLOEXEC)).expect("it is ours");
    (master, slave)
}

fn run_in_window() -> (OwnedFd, Child) {
    let (window, inside) = window();
    let end = || Stdio::from(inside.try_clone().expect("its end"));
    let run = Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["run", "--seconds", "600"])
        .stdin(end())
        .stdout(end())
        .stderr(end())
        .spawn()
        .expect("the program starts");
    (window, run)
}

/// Reads what is drawn next; returns how many bytes. The view asks where the cursor is, and a terminal answers.
fn read(screen: &mut File) -> io::Result<usize> {
    let mut drawn = vec![0; 1 << 16];
    let size = screen.read(&mut drawn)?;
    if drawn[..size].windows(4).any(|part| part == b"\x1b[6n") {
        screen.write_all(b"\x1b[1;1R")?;
    }
    Ok(size)
}

/// Reads the window until the view has drawn for a while.
fn watch(window: &OwnedFd) -> File {
    let mut screen = File::from(window.try_clone().expect("the window"));
    let mut count = 0;
    while count < 1 << 16 {
        count += read(&mut screen).expect("a picture of the view");
    }
    screen
}

/// Waits for the end.
fn ended(run: &mut Child) -> ExitStatus {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(ended) = run.try_wait().expect("its state") {
            return ended;
        }
        if Instant::now() > end {
            run.kill().expect("it is ours");
            panic!("still running after {PATIENCE:?}");
        }
        thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_run_whose_window_is_open_but_stopped_goes_on_and_is_shown_again_when_somebody_reads() {
    let (window, inside) = window();
    let end = || Stdio::from(inside.try_clone().expect("its end"));
    let (input, output) = (end(), end());
    let mut run = thread::scope(|scope| {
        let seen = scope.spawn(|| watch(&window));
        let run = Serving::drawn(&[], input, output);
        seen.join().expect("the view is drawn");
        run
    });
    drop(inside);
    // From now on nobody reads. A window takes a few pictures of the view; after two seconds it is full.
    let before = run.status()["frames"].as_u64();
    let before = before.expect("a number of frames");
    run.wait_for("120 frames more", |status| {
        status["frames"].as_u64() >= Some(before + 120)
    });
    let mut screen = watch(&window);
    screen.write_all(b"q").expect("a key");
    let reader = thread::spawn(move || {
        // Fails when the run has ended and closed its end.
        let mut drawn = vec![0; 1 << 16];
        while screen.read(&mut drawn).is_ok_and(|size| size > 0) {}
    });
    // The pictures that nobody read were left out, which the summary counts.
    assert_eq!(ended(&mut run.child).code(), Some(3));
    reader.join().expect("no panic");
}

#[test]
fn a_run_whose_window_is_closed_ends_instead_of_standing_still() {
    let (window, mut run) = run_in_window();
    let screen = watch(&window);
    drop((window, screen));
    let ended = ended(&mut run);
    // The window takes no summary any more; that is reported, not a panic.
    assert_eq!(ended.code(), Some(1));
}

#[test]
fn the_keys_of_the_view_are_requests_of_one_client_among_others() {
    let (window, inside) = window();
    let end = || Stdio::from(inside.try_clone().expect("its end"));
    let mut keys = File::from(window.try_clone().expect("the window"));
    let mut screen = File::from(window);
    let (input, output) = (end(), end());
    thread::spawn(move || while read(&mut screen).is_ok_and(|size| size > 0) {});
    let run = Serving::drawn(&["--source", "sim", "--mcu", "embedded"], input, output);
    drop(inside);
    run.wait_for("picture", |status| status["frames"].as_u64() > Some(0));
    let mut press = |key: &str| keys.write_all(key.as_bytes()).expect("the window takes keys");

    press("r");
    let is = |owner: Value, mode: &'static str| {
        move |status: &Value| {
            (&status["owner"], &status["mode"], &status["requested"]) == (&owner, &json!(mode), &json!(mode))
        }
    };
    run.wait_for("open gripper", is(json!("terminal"), "released"));
    press("h");
    let status = run.wait_for("grip", is(json!("terminal"), "hold"));
    let (code, answer) = run.ask("arm", "release");
    assert_eq!((code, &answer["why"]), (409, &json!("wrong_owner")), "{answer}");
    let floor_n = status["floor_n"].as_f64().expect("a number");
    press("+");
    run.wait_for("higher floor", |status| status["floor_n"] == floor_n + 0.5);
    press("-");
    run.wait_for("lower floor", |status| status["floor_n"] == floor_n);
    press("y");
    run.wait_for("owner who yields", is(Value::Null, "hold"));
    assert_eq!(run.ask("arm", "hold").0, 200);
    press("t");
    run.wait_for("owner who takes over", is(json!("terminal"), "hold"));
    press("r");
    run.wait_for("open gripper", is(json!("terminal"), "released"));
}
