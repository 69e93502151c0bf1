//! The live view on a pseudo-terminal.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::OwnedFd;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use nix::fcntl::{FcntlArg, FdFlag, fcntl};
use nix::pty::{OpenptyResult, Winsize, openpty};

/// How long the program may take to start, or to end.
const PATIENCE: Duration = Duration::from_secs(30);

/// A window of 120×40 characters and what runs in it.
fn run_in_window(arguments: &[&str]) -> (OwnedFd, Child) {
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
        .args(arguments)
        .stdin(end())
        .stdout(end())
        .stderr(end())
        .spawn()
        .expect("the program starts");
    (master, run)
}

/// Reads the window until the view has drawn for a while.
fn watch(window: &OwnedFd) -> File {
    let mut screen = File::from(window.try_clone().expect("the window"));
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

/// Pictures that the run has processed, by its status page.
fn frames(address: SocketAddr) -> u64 {
    let mut stream = TcpStream::connect(address).expect("its page");
    stream
        .write_all(b"GET /status HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .expect("a request");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let (_, body) = answer.split_once("\r\n\r\n").expect("a head and a body");
    let status: serde_json::Value = serde_json::from_str(body).expect("a status");
    status["frames"].as_u64().expect("a number of frames")
}

#[test]
fn a_run_whose_window_is_open_but_stopped_goes_on_and_is_shown_again_when_somebody_reads() {
    let folder = tempfile::tempdir().expect("a folder");
    let token = folder.path().join("token");
    let address = TcpListener::bind("127.0.0.1:0")
        .and_then(|free| free.local_addr())
        .expect("a free port");
    let (window, mut run) = run_in_window(&[
        "--serve",
        &address.to_string(),
        "--token-file",
        token.to_str().expect("a name"),
    ]);
    let _screen = watch(&window);
    // From now on nobody reads. A window takes a few pictures of the view; after two seconds it is full.
    let before = frames(address);
    let end = Instant::now() + PATIENCE;
    while frames(address) < before + 120 {
        assert!(
            Instant::now() < end,
            "found {} frames, expected more than {}",
            frames(address),
            before + 120
        );
        thread::sleep(Duration::from_millis(20));
    }
    let mut screen = watch(&window);
    screen.write_all(b"q").expect("a key");
    let reader = thread::spawn(move || {
        // Fails when the run has ended and closed its end.
        let mut drawn = vec![0; 1 << 16];
        while screen.read(&mut drawn).is_ok_and(|size| size > 0) {}
    });
    // The pictures that nobody read were left out, which the summary counts.
    assert_eq!(ended(&mut run).code(), Some(3));
    reader.join().expect("no panic");
}

#[test]
fn a_run_whose_window_is_closed_ends_instead_of_standing_still() {
    let (window, mut run) = run_in_window(&[]);
    let screen = watch(&window);
    drop((window, screen));
    let ended = ended(&mut run);
    // The window takes no summary any more; that is told, not a panic.
    assert_eq!(ended.code(), Some(1));
}
