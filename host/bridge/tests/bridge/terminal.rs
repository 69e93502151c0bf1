//! The live view on a pseudo-terminal.

use std::io::{Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use nix::fcntl::{FcntlArg, FdFlag, fcntl};
use nix::pty::{OpenptyResult, Winsize, openpty};

/// How long the program may take to start, or to end.
const PATIENCE: Duration = Duration::from_secs(30);

/// A window of 120×40 characters and what runs in it.
fn run_in_window() -> (OwnedFd, Child) {
    let size = Winsize {
        ws_row: 40,
        ws_col: 120,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    let OpenptyResult { master, slave } = openpty(&size, None).expect("a pseudo-terminal");
    // No program holds its own window open.
    fcntl(&master, FcntlArg::F_SETFD(FdFlag::FD_CLOEXEC)).expect("it is ours");
    let end = || Stdio::from(slave.try_clone().expect("its end"));
    let run = Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["run", "--seconds", "600"])
        .stdin(end())
        .stdout(end())
        .stderr(end())
        .spawn()
        .expect("the program starts");
    (master, run)
}

#[test]
fn a_run_whose_window_is_closed_ends_instead_of_standing_still() {
    let (window, mut run) = run_in_window();
    // It draws, and somebody reads it.
    let mut screen = std::fs::File::from(window.try_clone().expect("the window"));
    let mut drawn = vec![0; 1 << 16];
    let mut count = 0;
    while count < 1 << 16 {
        let size = screen.read(&mut drawn).expect("a picture of the view");
        // The view asks where the cursor is.
        if drawn[..size].windows(4).any(|part| part == b"\x1b[6n") {
            screen.write_all(b"\x1b[1;1R").expect("an answer");
        }
        count += size;
    }
    drop((window, screen));
    let end = Instant::now() + PATIENCE;
    let ended = loop {
        if let Some(ended) = run.try_wait().expect("its state") {
            break ended;
        }
        if Instant::now() > end {
            run.kill().expect("it is ours");
            panic!("still running {PATIENCE:?} after its window was closed");
        }
        thread::sleep(Duration::from_millis(20));
    };
    // The window takes no summary any more; that is told, not a panic.
    assert_eq!(ended.code(), Some(1));
}
