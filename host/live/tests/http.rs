//! The server as its clients see it: over TCP, with a loop that publishes and one that answers.

use std::cell::Cell;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use gripline_control::{Answer, Inbox, Outcome, channel};
use gripline_live::{FrameView, Live, STREAMS};
use gripline_protocol::message::{Configuration, FingertipGeometry, MapSums};
use gripline_protocol::{SensorId, TAXELS};
use gripline_recording::telemetry::{FrameReport, STAGES, WitnessReport};
use gripline_recording::units::Load;

const TOKEN: &str = "0123456789abcdef";
const HOLD: &str = r#"{"client":"cell-3","request":7,"action":"hold"}"#;

fn started() -> (Live, Inbox) {
    let (handle, inbox) = channel();
    let live = Live::start("127.0.0.1:0".parse().unwrap(), handle, TOKEN.to_owned()).unwrap();
    (live, inbox)
}

fn report(frame: u64) -> FrameReport {
    FrameReport {
        frame,
        sensor: SensorId::FIRST,
        t_s: frame as f64 / 60.0,
        gate: "network",
        health: Vec::new(),
        normal_n: 2.0,
        shear_x_n: 0.5,
        shear_y_n: 0.0,
        shear_n: 0.5,
        moment_nmm: 0.0,
        centre_of_pressure_mm: None,
        load: Load::of(&MapSums::default(), SensorId::FIRST, &FingertipGeometry::DEFAULT),
        contact: 0,
        stick: 0,
        stick_ratio: None,
        coulomb_slip: false,
        state: "STICK",
        slip_evidence: 0.0,
        witnesses: WitnessReport::default(),
        time_to_slip_ms: None,
        line_n: 3.0,
        latency_us: 200.0,
        stages_us: [0.0; STAGES.len()],
        faults: Vec::new(),
        late: None,
        wire_bytes: 72,
        markers: None,
        truth: None,
    }
}

/// A frame, with a picture of the size that the loop has.
fn publish(live: &Live, frame: u64, looks: &Cell<u64>) {
    let (newtons, picture) = ([[0.01; 3]; TAXELS], vec![100; 440 * 440]);
    live.publish(
        &report(frame),
        |values| values.frames = frame + 1,
        || {
            looks.set(looks.get() + 1);
            FrameView {
                newtons: &newtons,
                picture: &picture,
                settings: &Configuration::DEFAULT,
            }
        },
    );
}

fn connected(address: SocketAddr, text: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream.write_all(text.as_bytes()).unwrap();
    stream
}

fn asked(live: &Live, text: &str) -> String {
    let mut answer = String::new();
    connected(live.address(), text)
        .read_to_string(&mut answer)
        .unwrap();
    answer
}

fn get(live: &Live, path: &str) -> String {
    asked(live, &format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n"))
}

fn post(live: &Live, headers: &str, body: &str) -> String {
    let length = body.len();
    asked(
        live,
        &format!("POST /control HTTP/1.1\r\n{headers}Content-Length: {length}\r\n\r\n{body}"),
    )
}

/// A loop that says done to everything, until it is told to end.
fn obedient(inbox: Inbox) -> (Arc<AtomicBool>, JoinHandle<u32>) {
    let is_over = Arc::new(AtomicBool::new(false));
    let its = Arc::clone(&is_over);
    let answers = thread::spawn(move || {
        let mut count = 0;
        while !its.load(Ordering::Relaxed) {
            if let Some(asked) = inbox.next() {
                asked.answer(Answer::to(&asked.request, Outcome::Done, None, 1.0));
                count += 1;
            }
            thread::sleep(Duration::from_millis(1));
        }
        count
    });
    (is_over, answers)
}

#[test]
fn the_page_and_the_values_are_served_and_nothing_else() {
    let (live, _inbox) = started();
    publish(&live, 4, &Cell::new(0));
    for (path, kind, has) in [
        ("/", "text/html", "<title>Gripline"),
        ("/page.js", "text/javascript", "listen("),
        ("/style.css", "text/css", "prefers-color-scheme"),
        ("/status", "application/json", "\"is_connected\":false"),
        ("/metrics", "text/plain; version=0.0.4", "gripline_frames_total 5"),
    ] {
        let answer = get(&live, path);
        assert!(answer.starts_with("HTTP/1.1 200 "), "{path}: {answer}");
        assert!(
            answer.contains(&format!("Content-Type: {kind}")) && answer.contains(has),
            "{path}: {answer}"
        );
    }
    assert!(get(&live, "/../Cargo.toml").starts_with("HTTP/1.1 404 "));
    assert!(get(&live, "/control").starts_with("HTTP/1.1 405 "));
    assert!(asked(&live, "POST /status HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 405 "));
}

#[test]
fn a_request_with_the_token_is_answered_and_any_other_moves_nothing() {
    let (live, inbox) = started();
    let (is_over, loop_) = obedient(inbox);
    let bearer = format!("Authorization: Bearer {TOKEN}\r\n");
    for (headers, body, status) in [
        ("", HOLD, 401),
        ("Authorization: Bearer 0123456789abcdee\r\n", HOLD, 401),
        ("Authorization: Basic 0123456789abcdef\r\n", HOLD, 401),
        ("Host: gripper.example.org\r\n", HOLD, 403),
        (bearer.as_str(), "{}", 400),
        (
            bearer.as_str(),
            "{\"client\":\"a b\",\"request\":1,\"action\":\"hold\"}",
            400,
        ),
        (bearer.as_str(), "not JSON", 400),
    ] {
        let answer = post(&live, headers, body);
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {status} ")),
            "{headers}{body}: {answer}"
        );
        assert!(
            answer.contains("{\"message\":") && answer.contains("expected"),
            "{answer}"
        );
    }
    let long = post(&live, &bearer, &"x".repeat(4_097));
    assert!(long.starts_with("HTTP/1.1 413 "), "{long}");
    let endless = asked(&live, &format!("GET /{} HTTP/1.1\r\n\r\n", "a".repeat(20_000)));
    assert!(endless.starts_with("HTTP/1.1 431 "), "{endless}");
    let foreign = format!("{bearer}Host: gripper.example.org\r\n");
    for headers in [bearer.as_str(), foreign.as_str()] {
        let answer = post(&live, headers, HOLD);
        assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
        let (_, body) = answer.split_once("\r\n\r\n").unwrap();
        let json: serde_json::Value = serde_json::from_str(body).unwrap();
        assert_eq!(
            (json["outcome"].as_str(), json["request"].as_u64()),
            (Some("done"), Some(7))
        );
    }
    is_over.store(true, Ordering::Relaxed);
    assert_eq!(
        loop_.join().unwrap(),
        2,
        "only what bore the token reached the loop"
    );
}

/// Data of the next event of this name.
fn event(events: &mut impl Iterator<Item = String>, name: &str) -> serde_json::Value {
    events.find(|line| line == &format!("event: {name}")).unwrap();
    serde_json::from_str(events.next().unwrap().strip_prefix("data: ").unwrap()).unwrap()
}

#[test]
fn ten_pages_are_served_beside_requests_and_a_stalled_reader_delays_nobody() {
    let (live, _inbox) = started();
    let looks = Cell::new(0);
    publish(&live, 0, &looks);
    assert_eq!(looks.get(), 0, "nobody looks");
    let mut pages: Vec<_> = (0..10)
        .map(|_| {
            let stream = connected(live.address(), "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n");
            BufReader::new(stream).lines().map_while(Result::ok)
        })
        .collect();
    for page in &mut pages {
        // The first word is what the gripper does, so that all are joined from here on.
        assert_eq!(event(page, "status")["is_connected"], false);
    }
    // Nobody ever reads these.
    let _stalled = connected(live.address(), "GET /frames HTTP/1.1\r\n\r\n");
    let _stalled_page = connected(live.address(), "GET /events HTTP/1.1\r\n\r\n");
    let mut slowest = Duration::ZERO;
    for frame in 1..=300 {
        let begun = Instant::now();
        publish(&live, frame, &looks);
        slowest = slowest.max(begun.elapsed());
        thread::sleep(Duration::from_millis(2));
    }
    assert!((1..=60).contains(&looks.get()), "{} looks", looks.get());
    for page in &mut pages {
        let first = event(page, "frame");
        assert!(
            first["picture"].is_string(),
            "the first frame of a page has its picture"
        );
        assert!(event(page, "frame")["report"]["frame"].as_u64() > first["report"]["frame"].as_u64());
    }
    assert!(get(&live, "/status").starts_with("HTTP/1.1 200 "));
    println!("slowest publish {slowest:?}");
}

#[test]
fn no_more_than_thirty_frames_and_ten_pictures_a_second_are_sent() {
    let (live, _inbox) = started();
    let stream = connected(live.address(), "GET /events HTTP/1.1\r\nHost: [::1]:80\r\n\r\n");
    let mut events = BufReader::new(stream).lines().map_while(Result::ok);
    event(&mut events, "status");
    let reader = thread::spawn(move || {
        let (mut frames, mut pictures) = (0, 0);
        for line in events.filter(|line| line.contains("\"report\"")) {
            frames += 1;
            pictures += u32::from(line.contains("\"picture\""));
        }
        (frames, pictures)
    });
    let begun = Instant::now();
    let mut frame = 0;
    while begun.elapsed() < Duration::from_secs(1) {
        publish(&live, frame, &Cell::new(0));
        frame += 1;
        thread::sleep(Duration::from_millis(1));
    }
    let seconds = begun.elapsed().as_secs_f64();
    // The end of the run ends the stream.
    drop(live);
    let (frames, pictures) = reader.join().unwrap();
    let max = |per_second: f64| (per_second * seconds).ceil() as u32 + 1;
    assert!(
        (5..=max(30.0)).contains(&frames),
        "{frames} frames in {seconds} s"
    );
    assert!(
        (2..=max(10.0)).contains(&pictures),
        "{pictures} pictures in {seconds} s"
    );
}

#[test]
fn one_stream_too_many_is_reported() {
    let (live, _inbox) = started();
    let pages: Vec<_> = (0..STREAMS)
        .map(|_| {
            let stream = connected(live.address(), "GET /events HTTP/1.1\r\n\r\n");
            let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
            event(&mut lines, "status");
            lines
        })
        .collect();
    let refused = asked(&live, "GET /frames HTTP/1.1\r\n\r\n");
    assert!(
        refused.starts_with("HTTP/1.1 503 ") && refused.contains("expected fewer"),
        "{refused}"
    );
    drop(pages);
}

#[test]
fn readers_that_are_gone_give_their_places_back_while_no_frames_come() {
    for path in ["/frames", "/events"] {
        let (live, _inbox) = started();
        let read = |_| {
            let mut reader = connected(live.address(), &format!("GET {path} HTTP/1.1\r\n\r\n"));
            let mut head = [0; 12];
            reader.read_exact(&mut head).unwrap();
            (reader, head == *b"HTTP/1.1 200")
        };
        let readers: Vec<_> = (0..STREAMS).map(read).collect();
        assert!(readers.iter().all(|(_, is_served)| *is_served), "{path}");
        assert!(!read(STREAMS).1, "{path}");
        drop(readers);
        let begun = Instant::now();
        while !read(0).1 {
            assert!(begun.elapsed() < Duration::from_secs(10), "{path}");
            thread::sleep(Duration::from_millis(100));
        }
    }
}

#[test]
fn bytes_of_any_kind_do_no_harm() {
    let (live, _inbox) = started();
    for bytes in [
        &[0xFF; 9_000][..],
        b"\r\n\r\n",
        b"GET",
        b"GET / HTTP/9.9\r\n\r\n",
        b"\0\0\0\0\r\n\r\n",
    ] {
        let mut stream = TcpStream::connect(live.address()).unwrap();
        stream.write_all(bytes).unwrap();
        drop(stream);
    }
    assert!(get(&live, "/status").starts_with("HTTP/1.1 200 "));
}
