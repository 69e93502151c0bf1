//! Requests to a run from outside, over HTTP and against a board that keeps its own time: who may ask, what is answered, what moves.
#![cfg(unix)]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::serial_board::{Line, SerialBoard};
use gripline_firmware::{Fault, FaultSet, ResetCause};
use serde_json::{Value, json};

/// What an answer may take on a board that is a process of its own, beside tests that keep the machine busy.
const PATIENCE: Duration = Duration::from_secs(10);

/// A run that serves.
pub(crate) struct Serving {
    pub(crate) child: Child,
    address: String,
    token: String,
    number: AtomicU64,
    folder: tempfile::TempDir,
}

impl Serving {
    fn start(arguments: &[&str]) -> Self {
        let mut run = Self::spawned("127.0.0.1:0", arguments, Stdio::null(), Stdio::null());
        let mut said = BufReader::new(run.child.stderr.take().unwrap()).lines();
        run.address = said
            .by_ref()
            .map_while(Result::ok)
            .find_map(|line| Some(line.split_once("http://")?.1.split(['/', ' ']).next()?.to_owned()))
            .expect("the address is printed");
        std::thread::spawn(move || said.for_each(drop));
        run.with_token()
    }

    /// With this standard input and output. A run that draws shows its address in the view only: it is chosen here.
    pub(crate) fn drawn(arguments: &[&str], input: Stdio, output: Stdio) -> Self {
        let free = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr());
        let address = free.expect("a free port").to_string();
        let run = Self::spawned(&address, arguments, input, output);
        let begun = Instant::now();
        while TcpStream::connect(&run.address).is_err() {
            assert!(begun.elapsed() < PATIENCE, "nothing serves at {address}");
            std::thread::sleep(Duration::from_millis(20));
        }
        run.with_token()
    }

    fn spawned(address: &str, arguments: &[&str], input: Stdio, output: Stdio) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_gripline"))
            .args(["run", "--seconds", "120", "--serve", address, "--token-file"])
            .arg(folder.path().join("token"))
            .args(arguments)
            .stdin(input)
            .stdout(output)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Self {
            child,
            address: address.to_owned(),
            token: String::new(),
            number: AtomicU64::new(1),
            folder,
        }
    }

    fn with_token(mut self) -> Self {
        let token = std::fs::read_to_string(self.folder.path().join("token")).unwrap();
        token.trim().clone_into(&mut self.token);
        self
    }

    fn http(&self, head: &str, body: &str) -> (u16, Value) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(
            stream,
            "{head} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\nAuthorization: Bearer {}\r\n\r\n{body}",
            body.len(),
            self.token
        )
        .unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").expect("a head and a body");
        let code = head.split(' ').nth(1).unwrap().parse().unwrap();
        (code, serde_json::from_str(body).unwrap_or_else(|_| json!(body)))
    }

    pub(crate) fn status(&self) -> Value {
        self.http("GET /status", "").1
    }

    /// Asks under a new number.
    pub(crate) fn ask(&self, client: &str, action: &str) -> (u16, Value) {
        self.ask_with(client, action, &json!({}))
    }

    fn ask_with(&self, client: &str, action: &str, more: &Value) -> (u16, Value) {
        let number = self.number.fetch_add(1, Ordering::Relaxed);
        let mut body = json!({"client": client, "request": number, "action": action});
        for (key, value) in more.as_object().unwrap() {
            body[key] = value.clone();
        }
        self.http("POST /control", &body.to_string())
    }

    /// Waits until the status says so.
    #[track_caller]
    pub(crate) fn wait_for(&self, what: &str, is_there: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let status = self.status();
            if is_there(&status) {
                return status;
            }
            assert!(begun.elapsed() < PATIENCE, "no {what}: {status}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A board in a thread of its own, in a world that its test changes.
struct Board {
    path: String,
    /// The world as the test wants it, and as the board lives in it.
    worlds: Arc<Mutex<[World; 2]>>,
    thread: Option<JoinHandle<()>>,
}

/// What surrounds a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct World {
    is_over: bool,
    /// The plug is pulled: the board goes on without a host.
    is_unplugged: bool,
    /// The robot forbids a release.
    inhibits_release: bool,
    /// Faults that the board's pins report.
    faults: FaultSet,
    /// Power cuts so far.
    power_cuts: u32,
}

impl Board {
    fn start(lost_per_mille: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("port");
        let path = format!("serial:{}", port.display());
        let worlds = Arc::new(Mutex::new([World::default(); 2]));
        let its_worlds = Arc::clone(&worlds);
        let mut line = Some(Line::plug(&port));
        let thread = std::thread::spawn(move || {
            let _folder = folder;
            let mut board = SerialBoard::new(lost_per_mille);
            let wanted = || its_worlds.lock().unwrap()[0];
            let mut power_cuts = 0;
            while !wanted().is_over {
                let world = wanted();
                if world.power_cuts != power_cuts {
                    board.board.reset(ResetCause::PowerOn, 0);
                    power_cuts = world.power_cuts;
                }
                let program = &mut board.board.device.program;
                program.inhibit_release(world.inhibits_release);
                program.note_board(world.faults);
                if world.is_unplugged {
                    line = None;
                } else if line.is_none() {
                    // What was said into an open line is lost.
                    board.board.replies.clear();
                    line = Some(Line::plug(&port));
                }
                its_worlds.lock().unwrap()[1] = world;
                match &mut line {
                    Some(line) => board.serve(line, |_| wanted() != world),
                    None => {
                        while wanted() == world {
                            board.live();
                            std::thread::sleep(Duration::from_millis(1));
                        }
                    }
                }
            }
        });
        Self {
            path,
            worlds,
            thread: Some(thread),
        }
    }

    /// Changes its world; returns when the board lives in the new one.
    fn change(&self, change: impl FnOnce(&mut World)) {
        change(&mut self.worlds.lock().unwrap()[0]);
        loop {
            let [wanted, lived] = *self.worlds.lock().unwrap();
            if wanted == lived {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.worlds.lock().unwrap()[0].is_over = true;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Released, with the line at 0 N.
#[track_caller]
fn assert_released(status: &Value) {
    assert_eq!(
        (&status["mode"], &status["line_n"]),
        (&json!("released"), &json!(0.0)),
        "{status}"
    );
}

#[test]
fn nothing_moves_until_somebody_asks_and_then_as_asked() {
    let board = Board::start(0);
    let run = Serving::start(&["--mcu", &board.path]);
    let status = run.wait_for("picture", |status| status["frames"].as_u64() > Some(60));
    assert_released(&status);
    assert_eq!(
        (&status["owner"], &status["requested"]),
        (&Value::Null, &Value::Null)
    );

    let (code, answer) = run.ask("arm", "hold");
    assert_eq!((code, &answer["outcome"]), (200, &json!("done")), "{answer}");
    let status = run.wait_for("grip", |status| status["line_n"].as_f64() > Some(0.5));
    assert_eq!(
        (&status["mode"], &status["owner"]),
        (&json!("hold"), &json!("arm"))
    );

    let (code, answer) = run.ask("other", "release");
    assert_eq!((code, &answer["why"]), (409, &json!("wrong_owner")), "{answer}");
    assert!(
        answer["message"].as_str().unwrap().contains("owned by arm"),
        "{answer}"
    );
    assert_eq!(run.status()["mode"], "hold");

    let (code, answer) = run.ask_with("arm", "set_floor", &json!({"floor_n": 6.0}));
    assert_eq!(code, 200, "{answer}");
    assert_eq!(run.status()["floor_n"], 6.0);
    run.wait_for("line at the new floor", |status| {
        status["line_n"].as_f64() >= Some(6.0)
    });
    let (code, answer) = run.ask_with("arm", "set_floor", &json!({"floor_n": 1000.0}));
    assert_eq!((code, &answer["why"]), (409, &json!("out_of_range")), "{answer}");
    let (code, answer) = run.ask("arm", "rezero");
    assert_eq!((code, &answer["why"]), (409, &json!("holding")), "{answer}");

    let (code, answer) = run.ask_with("other", "release", &json!({"take_over": true}));
    assert_eq!((code, &answer["owner"]), (200, &json!("other")), "{answer}");
    run.wait_for("open gripper", |status| {
        status["mode"] == "released" && status["line_n"].as_f64() == Some(0.0)
    });
    // As long as the gel still settles it is refused.
    let begun = Instant::now();
    loop {
        let (code, answer) = run.ask("other", "rezero");
        if code == 200 {
            break;
        }
        assert!(code == 409 && answer["why"] == "touched", "{answer}");
        assert!(begun.elapsed() < PATIENCE, "{answer}");
    }
}

#[test]
fn a_rezero_is_refused_when_a_hold_begins_before_its_pictures_are_taken() {
    let board = Board::start(0);
    let run = Serving::start(&["--mcu", &board.path]);
    run.wait_for("picture", |status| status["frames"].as_u64() > Some(60));
    let begun = Instant::now();
    // On a busy machine the pictures may be there before the hold.
    loop {
        let (code, answer) = std::thread::scope(|scope| {
            let rezero = scope.spawn(|| run.ask("arm", "rezero"));
            run.wait_for("owner", |status| status["owner"] == "arm");
            assert_eq!(run.ask("arm", "hold").0, 200);
            rezero.join().unwrap()
        });
        if answer["why"] == "holding" {
            assert_eq!(code, 409, "{answer}");
            assert!(
                answer["message"]
                    .as_str()
                    .unwrap()
                    .contains("expected it released"),
                "{answer}"
            );
            break;
        }
        assert!(code == 200 || answer["why"] == "touched", "{code} {answer}");
        assert!(begun.elapsed() < PATIENCE, "{answer}");
        assert_eq!(run.ask("arm", "release").0, 200);
        assert_eq!(run.ask("arm", "yield").0, 200);
    }
    // Released again, the next one is taken up anew.
    assert_eq!(run.ask("arm", "release").0, 200);
    let begun = Instant::now();
    while run.ask("arm", "rezero").0 != 200 {
        assert!(begun.elapsed() < PATIENCE);
    }
}

#[test]
fn a_release_waits_for_the_acknowledgement_of_a_latched_fault() {
    let board = Board::start(0);
    let run = Serving::start(&["--mcu", &board.path, "--hold"]);
    run.wait_for("grip", |status| status["line_n"].as_f64() > Some(0.5));
    // The host falls silent for longer than link_lost_ms.
    let signal = |name: &str| {
        let pid = run.child.id().to_string();
        assert!(
            Command::new("kill")
                .args([name, &pid])
                .status()
                .unwrap()
                .success()
        );
    };
    signal("-STOP");
    std::thread::sleep(Duration::from_millis(900));
    signal("-CONT");
    let latched = |status: &Value| {
        let faults = status["faults"].as_array().unwrap();
        faults
            .iter()
            .any(|fault| fault["name"] == "LINK LOST" && fault["latched"] == true)
    };
    let status = run.wait_for("latched fault", latched);
    assert!(status["faults"][0]["what_to_do"].as_str().unwrap().contains(": "));
    let (code, answer) = run.ask("arm", "release");
    assert_eq!((code, &answer["why"]), (409, &json!("latched")), "{answer}");
    assert!(
        answer["message"].as_str().unwrap().contains("LINK LOST"),
        "{answer}"
    );
    assert_eq!(run.ask("arm", "acknowledge").0, 200);
    // What was refused is not done later by itself.
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(run.status()["mode"], "hold");
    assert_eq!(run.ask("arm", "release").0, 200);
}

#[test]
fn what_is_asked_while_the_board_is_away_is_refused_and_not_done_when_it_is_back() {
    let board = Board::start(0);
    let run = Serving::start(&["--mcu", &board.path]);
    run.wait_for("status", |status| status["mode"] == "released");
    assert_eq!(run.ask("arm", "hold").0, 200);
    run.wait_for("grip", |status| status["line_n"].as_f64() > Some(0.5));

    board.change(|world| world.is_unplugged = true);
    let (code, answer) = run.ask("arm", "release");
    let why = answer["why"].as_str().unwrap();
    assert!(
        matches!((code, why), (503, "link_lost") | (504, "not_confirmed")),
        "{code} {answer}"
    );
    assert!(
        answer["message"].as_str().unwrap().contains("microcontroller"),
        "{answer}"
    );
    run.wait_for("lost link", |status| status["is_connected"] == false);
    let (code, answer) = run.ask("arm", "release");
    assert_eq!((code, &answer["why"]), (503, &json!("link_lost")), "{answer}");

    board.change(|world| world.is_unplugged = false);
    run.wait_for("board that is back", |status| {
        status["is_connected"] == true && status["status_age_ms"].as_f64() < Some(200.0)
    });
    std::thread::sleep(Duration::from_millis(500));
    let status = run.status();
    assert_eq!(
        (&status["mode"], status["line_n"].as_f64() > Some(0.5)),
        (&json!("hold"), true),
        "{status}"
    );
    // A new request opens it; where the host was away for long enough, after a person has looked.
    let (code, answer) = run.ask("arm", "release");
    if answer["why"] == "latched" {
        assert_eq!(run.ask("arm", "acknowledge").0, 200);
        assert_eq!(run.ask("arm", "release").0, 200);
    } else {
        assert_eq!(code, 200, "{answer}");
    }
    run.wait_for("open gripper", |status| status["line_n"].as_f64() == Some(0.0));
}

#[test]
fn a_board_that_lost_its_power_stays_released_until_somebody_asks_again() {
    let board = Board::start(0);
    let run = Serving::start(&["--mcu", &board.path]);
    run.wait_for("status", |status| status["mode"] == "released");
    assert_eq!(run.ask("arm", "release").0, 200);
    board.change(|world| world.is_unplugged = true);
    run.wait_for("lost link", |status| status["is_connected"] == false);
    let (code, answer) = run.ask("arm", "hold");
    assert_eq!((code, &answer["why"]), (503, &json!("link_lost")), "{answer}");
    board.change(|world| world.power_cuts += 1);
    board.change(|world| world.is_unplugged = false);
    run.wait_for("board that is back", |status| {
        status["is_connected"] == true && status["status_age_ms"].as_f64() < Some(200.0)
    });
    std::thread::sleep(Duration::from_millis(500));
    let status = run.status();
    assert_released(&status);
    assert_eq!(run.ask("arm", "hold").0, 200);
}

#[test]
fn an_input_that_forbids_a_release_and_a_fault_that_lasts_are_named() {
    let board = Board::start(0);
    let run = Serving::start(&["--mcu", &board.path, "--hold"]);
    run.wait_for("grip", |status| status["line_n"].as_f64() > Some(0.5));
    board.change(|world| world.inhibits_release = true);
    let (code, answer) = run.ask("arm", "release");
    assert_eq!((code, &answer["why"]), (409, &json!("inhibited")), "{answer}");
    assert!(
        answer["message"]
            .as_str()
            .unwrap()
            .contains("release-inhibit input"),
        "{answer}"
    );
    board.change(|world| world.inhibits_release = false);
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(run.status()["mode"], "hold", "what was refused is not done later");

    board.change(|world| world.faults.set(Fault::Undervoltage, true));
    run.wait_for("latched fault", |status| {
        let faults = status["faults"].as_array().unwrap();
        faults.iter().any(|fault| fault["latched"] == true)
    });
    let (code, answer) = run.ask("arm", "acknowledge");
    assert_eq!((code, &answer["why"]), (409, &json!("still_active")), "{answer}");
    assert!(
        answer["message"].as_str().unwrap().contains("UNDERVOLTAGE"),
        "{answer}"
    );
    let (code, answer) = run.ask("arm", "release");
    assert_eq!((code, &answer["why"]), (409, &json!("latched")), "{answer}");
    board.change(|world| world.faults = FaultSet::EMPTY);
    assert_eq!(run.ask("arm", "acknowledge").0, 200);
    assert_eq!(run.ask("arm", "release").0, 200);
}

#[test]
fn who_has_no_token_or_sends_rubbish_moves_nothing_and_is_told_what_was_expected() {
    let mut run = Serving::start(&["--source", "sim", "--mcu", "embedded"]);
    let (code, answer) = run.http("POST /control", "{\"client\":\"arm\"}");
    assert_eq!(code, 400);
    assert!(
        answer["message"].as_str().unwrap().contains("expected"),
        "{answer}"
    );
    let token = std::mem::replace(&mut run.token, "wrong".to_owned());
    let (code, answer) = run.ask("arm", "release");
    assert_eq!(code, 401, "{answer}");
    assert!(answer["message"].as_str().unwrap().contains("token"), "{answer}");
    run.token = token;
    assert_eq!(run.status()["owner"], Value::Null);
    assert_eq!(run.ask("arm", "release").0, 200);
    // Who was answered finds it in the status, before the next frame.
    let status = run.status();
    assert_eq!(
        (&status["owner"], &status["requested"], &status["mode"]),
        (&json!("arm"), &json!("released"), &json!("released")),
        "{status}"
    );
    run.wait_for("open gripper", |status| status["line_n"].as_f64() == Some(0.0));
}

#[test]
fn requests_are_confirmed_although_a_twentieth_of_the_packets_is_lost() {
    let board = Board::start(50);
    let run = Serving::start(&["--mcu", &board.path]);
    run.wait_for("status", |status| status["mode"] == "released");
    let mut took_ms = Vec::new();
    for _ in 0..20 {
        for action in ["hold", "release"] {
            let (code, answer) = run.ask("arm", action);
            assert_eq!(code, 200, "{answer}");
            took_ms.push(answer["took_ms"].as_f64().unwrap());
        }
    }
    took_ms.sort_by(f64::total_cmp);
    // How long they take is for a quiet machine to say; that every one is confirmed is for every machine.
    println!(
        "40 requests over a serial line that loses 5 %: median {:.1} ms, longest {:.1} ms",
        took_ms[took_ms.len() / 2],
        took_ms[took_ms.len() - 1]
    );
}
