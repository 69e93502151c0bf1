//! `cargo xtask bench outside`: what readers cost the loop, and how long a request takes until the microcontroller confirms it. The
//! program runs as it is shipped, on a recording of the simulated fingertip (whose contact takes longer to solve than a frame where
//! it shears), in turns alone and with everybody reading: ten HTTP streams, a stream that is never read, a standard output that
//! stands still until the end, and two readers of another DDS, which take every message as a node's callback does. All of them share
//! the processor with the run.

use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use serde_json::{Value, json};

use crate::error::{Error, value_of};
use crate::{emulator, firmware, process, ros2};

/// Streams that are read.
const STREAMS: usize = 10;
const DDS_READERS: usize = 2;
/// DDS domain of the two readers: one that nothing else here uses.
const DOMAIN: &str = "83";
/// Requests of each kind of microcontroller, twice: hold and release in turn. The emulator translates code when it first meets it, and all
/// again when its memory for that is full, which takes up to 0.1 s and no board does: what it takes is reported, and `bench requests`
/// judges it by the board's own clock.
const REQUESTS: u64 = 100;

/// Who reads.
const READERS: [&str; 2] = ["alone", "everybody reads"];
/// Whether a run asks for real time: as by hand, and as the service of the package.
const KINDS: [bool; 2] = [false, true];

/// How much the 99.9th percentile of frame to link may grow.
const GROWTH_MAX: f64 = 1.1;
/// Until a request is confirmed, in process and on the emulated board, ms, where the wall clock can judge it.
const CONFIRMED_MS_MAX: [(&str, Option<f64>); 2] = [("embedded", Some(20.0)), ("emulator", None)];

/// Growth and lateness of both kinds of run, and requests in process.
const CHECKS: usize = 5;

/// `cargo xtask bench outside [--rounds N] [--seconds S] [--json]`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let (mut rounds, mut seconds, mut is_json) = (5, 20, false);
    let mut rest = arguments.iter();
    while let Some(option) = rest.next() {
        let mut number = || {
            let text = value_of(option, &mut rest)?;
            let number = text.parse::<u64>().ok().filter(|number| *number > 0);
            number.ok_or_else(|| Error::usage(option, text, "a number from 1 on"))
        };
        match option.as_str() {
            "--rounds" => rounds = number()?,
            "--seconds" => seconds = number()?,
            "--json" => is_json = true,
            _ => {
                return Err(Error::usage(
                    "bench outside",
                    option,
                    "--rounds N, --seconds S or --json",
                ));
            }
        }
    }
    let program = build()?;
    let python = ros2::ensure()?;
    let source = record(&program, seconds)?;
    let mut kinds = KINDS.map(|is_realtime| Kind {
        is_realtime,
        turns: [Vec::new(), Vec::new()],
    });
    for round in 0..rounds {
        for kind in &mut kinds {
            for (place, who) in READERS.into_iter().enumerate() {
                let readers = (place == 1).then_some(python.as_path());
                eprintln!("round {}: {}, {who}, {seconds} s ...", round + 1, kind.name());
                let turn = one_run(&program, &source, (seconds, kind.is_realtime), readers)?;
                kind.turns[place].push(turn);
            }
        }
    }
    let image = firmware::build(emulator::BOARD)?.0;
    let board = emulator::build()?;
    let mut waits = Vec::new();
    for (mcu, max_ms) in CONFIRMED_MS_MAX {
        eprintln!("{REQUESTS} requests, {mcu} ...");
        let mut run = Command::new(&program);
        run.env("GRIPLINE_EMULATOR", &board).env("GRIPLINE_IMAGE", &image);
        waits.push(Wait {
            mcu,
            max_ms,
            took_ms: requests(run, &source, mcu)?,
        });
    }
    let report = Report { kinds, waits };
    if is_json {
        println!("{}", report.json());
    } else {
        print!("{}", report.text());
    }
    let failed = report.misses();
    if failed == 0 {
        return Ok(());
    }
    Err(Error::Checks { failed, of: CHECKS })
}

/// The program with ROS 2.
fn build() -> Result<PathBuf, Error> {
    let package = ["--package", "gripline", "--features", "ros2"];
    process::run(process::cargo().args(["build", "--release"]).args(package))?;
    Ok(process::build_dir().join("release").join("gripline"))
}

/// A recording with every picture; returns it as a source.
fn record(program: &Path, seconds: u64) -> Result<String, Error> {
    let path = process::products().join("bench-outside.mcap");
    let _ = std::fs::remove_file(&path);
    process::output(
        Command::new(program)
            .args(["run", "--unpaced", "--record-pictures", "full", "--seconds"])
            .arg(seconds.to_string())
            .arg("--record")
            .arg(&path),
    )?;
    Ok(format!("mcap:{}", path.display()))
}

/// What one run said at its end.
#[derive(Debug, Clone, Copy)]
struct RunTimes {
    median_us: f64,
    p999_us: f64,
    late: u64,
}

fn one_run(
    program: &Path,
    source: &str,
    (seconds, is_realtime): (u64, bool),
    python: Option<&Path>,
) -> Result<RunTimes, Error> {
    let mut command = Command::new(program);
    command.args([
        "run",
        "--json",
        "--seconds",
        &seconds.to_string(),
        "--source",
        source,
    ]);
    if is_realtime {
        command.arg("--realtime");
    }
    if python.is_some() {
        command.args(["--ros2-name", "bench", "--ros2-domain", DOMAIN]);
    }
    let mut run = Run::start(command)?;
    let is_over = Arc::new(AtomicBool::new(false));
    let mut readers = Vec::new();
    if python.is_some() {
        for number in 0..STREAMS {
            let path = ["/frames", "/events"][number % 2];
            readers.push(run.stream(path, true, &is_over)?);
        }
        readers.push(run.stream("/frames", false, &is_over)?);
    }
    let dds: Vec<Child> = (0..DDS_READERS)
        .filter_map(|_| python)
        .map(dds_reader)
        .collect::<Result<_, _>>()?;
    let out = run.out.take();
    if python.is_some() {
        // It stands still for the whole run except for the end, which is where the figures are.
        thread::sleep(Duration::from_secs(seconds).saturating_sub(Duration::from_secs(1)));
    }
    let summary = out.and_then(|out| {
        let lines = BufReader::new(out).lines().map_while(Result::ok);
        lines.filter(|line| line.contains("\"summary\":true")).last()
    });
    is_over.store(true, Ordering::Relaxed);
    let messages: Vec<u64> = dds.into_iter().map(messages_read).collect::<Result<_, _>>()?;
    drop(run);
    for reader in readers {
        let _ = reader.join();
    }
    let summary: Value = serde_json::from_str(&summary.unwrap_or_default()).unwrap_or_default();
    let number = |key: &str| summary[key].as_f64().ok_or_else(|| no_product(key, &summary));
    // Python needs a second or two until it reads.
    let expected = number("frames")? / 2.0;
    if messages.iter().any(|read| (*read as f64) < expected) {
        return Err(no_product(
            &format!("{expected} messages of each topic read"),
            &json!(messages),
        ));
    }
    Ok(RunTimes {
        median_us: number("frame_to_link_us_median")?,
        p999_us: number("frame_to_link_us_p999")?,
        late: (number("maps_late")? + number("pictures_late")?) as u64,
    })
}

fn no_product(expected: &str, found: &Value) -> Error {
    Error::Product {
        what: "the run's answer".to_owned(),
        found: found.to_string(),
        expected: expected.to_owned(),
    }
}

/// Reads forces, maps and slip until its input ends.
fn dds_reader(python: &Path) -> Result<Child, Error> {
    let topics: Vec<[String; 2]> = ["wrench", "force_map", "slip"]
        .map(|topic| [topic.to_owned(), format!("/bench/fingertip_0/{topic}")])
        .into();
    let domain: u16 = DOMAIN.parse().unwrap_or_default();
    let job = json!({"job": "follow", "domain": domain, "topics": topics});
    Command::new(python)
        .arg(process::root().join("host/ros2/tests/peer.py"))
        .arg(job.to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|source| Error::Start {
            program: python.display().to_string(),
            source,
        })
}

/// Ends a reader; returns how many messages it read of the topic of which it read the fewest.
fn messages_read(mut reader: Child) -> Result<u64, Error> {
    drop(reader.stdin.take());
    let output = reader.wait_with_output().map_err(|source| Error::Start {
        program: "the DDS reader".to_owned(),
        source,
    })?;
    let read: Vec<u64> = serde_json::from_slice(&output.stdout).unwrap_or_default();
    read.into_iter().min().ok_or_else(|| {
        no_product(
            "numbers of messages",
            &json!(String::from_utf8_lossy(&output.stdout)),
        )
    })
}

/// How long each request took until the microcontroller confirmed it, ms: the first hundred and the second.
fn requests(mut command: Command, source: &str, mcu: &str) -> Result<[Vec<f64>; 2], Error> {
    command.args(["run", "--json", "--source", source, "--mcu", mcu]);
    let mut run = Run::start(command)?;
    let mut out = BufReader::new(run.out.take().ok_or_else(|| no_product("frames", &Value::Null))?);
    let mut line = String::new();
    let _ = out.read_line(&mut line);
    thread::spawn(move || out.lines().map_while(Result::ok).for_each(drop));
    let mut took_ms = [Vec::new(), Vec::new()];
    for number in 1..=2 * REQUESTS {
        // At every moment of a frame: steps of the golden section of one.
        thread::sleep(Duration::from_micros(20_000 + number * 10_301 % 16_667));
        let action = if number % 2 == 0 { "release" } else { "hold" };
        let body = json!({"client": "bench", "request": number, "action": action}).to_string();
        let answer = run.ask(&body)?;
        let found = answer["took_ms"].as_f64().filter(|_| answer["outcome"] == "done");
        took_ms[usize::from(number > REQUESTS)]
            .push(found.ok_or_else(|| no_product("a request that is done", &answer))?);
    }
    Ok(took_ms)
}

/// A run that serves, until it is dropped.
struct Run {
    child: Child,
    out: Option<ChildStdout>,
    address: String,
    token: String,
}

impl Run {
    fn start(mut command: Command) -> Result<Self, Error> {
        let token_file = process::products().join("bench-outside-token");
        let mut child = command
            .args(["--serve", "127.0.0.1:0", "--token-file"])
            .arg(&token_file)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|source| Error::Start {
                program: "gripline".to_owned(),
                source,
            })?;
        let mut said = BufReader::new(
            child
                .stderr
                .take()
                .ok_or_else(|| no_product("words", &Value::Null))?,
        )
        .lines()
        .map_while(Result::ok);
        let mut heard = Vec::new();
        let address = said.by_ref().find_map(|line| {
            let address = line
                .split_once("http://")
                .and_then(|(_, rest)| rest.split(['/', ' ']).next().map(str::to_owned));
            heard.push(line);
            address
        });
        thread::spawn(move || said.for_each(drop));
        let address = address.ok_or_else(|| no_product("the address that it serves", &json!(heard)))?;
        let token =
            std::fs::read_to_string(&token_file).map_err(|source| Error::file(&token_file, source))?;
        Ok(Self {
            out: child.stdout.take(),
            child,
            address,
            token: token.trim().to_owned(),
        })
    }

    fn connect(&self) -> Result<TcpStream, Error> {
        TcpStream::connect(&self.address).map_err(|source| Error::file(Path::new(&self.address), source))
    }

    /// A stream that is open until then, and read or not.
    fn stream(
        &self,
        path: &str,
        is_read: bool,
        is_over: &Arc<AtomicBool>,
    ) -> Result<thread::JoinHandle<()>, Error> {
        let mut stream = self.connect()?;
        let host = &self.address;
        let asked = write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n");
        asked.map_err(|source| Error::file(Path::new(host), source))?;
        let is_over = Arc::clone(is_over);
        Ok(thread::spawn(move || {
            let mut bytes = vec![0; 1 << 16];
            while !is_over.load(Ordering::Relaxed) {
                if !is_read {
                    thread::sleep(Duration::from_millis(100));
                } else if !stream.read(&mut bytes).is_ok_and(|length| length > 0) {
                    return;
                }
            }
        }))
    }

    fn ask(&self, body: &str) -> Result<Value, Error> {
        let mut stream = self.connect()?;
        let mut text = String::new();
        write!(
            stream,
            "POST /control HTTP/1.1\r\nHost: {}\r\nContent-Length: {}\r\nAuthorization: Bearer {}\r\n\r\n{body}",
            self.address,
            body.len(),
            self.token
        )
        .and_then(|()| stream.read_to_string(&mut text))
        .map_err(|source| Error::file(Path::new(&self.address), source))?;
        let answer = text.split_once("\r\n\r\n").map_or("", |(_, body)| body);
        serde_json::from_str(answer).map_err(|_| no_product("an answer in JSON", &json!(text)))
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs in one setting.
struct Kind {
    is_realtime: bool,
    /// Of each of [`READERS`].
    turns: [Vec<RunTimes>; 2],
}

struct Report {
    kinds: [Kind; 2],
    waits: Vec<Wait>,
}

/// How long requests took, all ms.
struct Wait {
    mcu: &'static str,
    /// The most that is wanted, where the wall clock can judge it.
    max_ms: Option<f64>,
    /// The first and the second hundred.
    took_ms: [Vec<f64>; 2],
}

impl Wait {
    fn spreads(&self) -> [[f64; 3]; 2] {
        self.took_ms
            .each_ref()
            .map(|took_ms| spread(took_ms.iter().copied()))
    }
}

/// Lowest, median and highest.
fn spread(values: impl Iterator<Item = f64>) -> [f64; 3] {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    match values[..] {
        [] => [f64::NAN; 3],
        _ => [values[0], values[values.len() / 2], values[values.len() - 1]],
    }
}

impl Kind {
    const fn name(&self) -> &'static str {
        if self.is_realtime {
            "--realtime, as the service"
        } else {
            "ordinary priority"
        }
    }

    const fn key(&self) -> &'static str {
        if self.is_realtime { "realtime" } else { "ordinary" }
    }

    fn spreads(&self, value: impl Fn(&RunTimes) -> f64) -> [[f64; 3]; 2] {
        self.turns
            .each_ref()
            .map(|turns| spread(turns.iter().map(&value)))
    }

    fn growth(&self) -> f64 {
        let [alone, all] = self.spreads(|turn| turn.p999_us);
        all[1] / alone[1]
    }

    fn late(&self) -> [u64; 2] {
        self.turns
            .each_ref()
            .map(|turns| turns.iter().map(|turn| turn.late).sum())
    }
}

impl Report {
    fn misses(&self) -> usize {
        let is_too_long = |wait: &&Wait| wait.max_ms.is_some_and(|max_ms| wait.spreads()[1][2] > max_ms);
        let grown = self.kinds.iter().filter(|kind| kind.growth() > GROWTH_MAX);
        let late = self.kinds.iter().filter(|kind| kind.late()[1] > 0);
        self.waits.iter().filter(is_too_long).count() + grown.count() + late.count()
    }

    fn text(&self) -> String {
        let mut text = "frame to link, µs: median of the rounds (lowest to highest)\n".to_owned();
        for kind in &self.kinds {
            let (p999, medians) = (
                kind.spreads(|turn| turn.p999_us),
                kind.spreads(|turn| turn.median_us),
            );
            let _ = writeln!(text, "  {}", kind.name());
            for (place, who) in READERS.into_iter().enumerate() {
                let ([low, middle, high], median) = (p999[place], medians[place][1]);
                let late = kind.late()[place];
                let _ = writeln!(
                    text,
                    "    {who:<16} median {median:.0}, 99.9th percentile {middle:.0} ({low:.0} to {high:.0}), {late} too late"
                );
            }
            let _ = writeln!(
                text,
                "    ratio of the 99.9th percentiles: {:.2} (at most {GROWTH_MAX} wanted, none too late)",
                kind.growth()
            );
        }
        for wait in &self.waits {
            let [first, then] = wait.spreads();
            let wanted = wait.max_ms.map_or_else(
                || "by the wall clock; `bench requests` has the board's".to_owned(),
                |max_ms| format!("at most {max_ms} wanted"),
            );
            let _ = writeln!(
                text,
                "request until confirmed, {}, ms: median {:.1}, longest {:.1} of {REQUESTS} ({wanted}); of the {REQUESTS} before, \
                 {:.1} and {:.1}",
                wait.mcu, then[1], then[2], first[1], first[2],
            );
        }
        text
    }

    fn json(&self) -> Value {
        let waits: serde_json::Map<String, Value> = self
            .waits
            .iter()
            .map(|wait| {
                let [first, then] = wait.spreads();
                (
                    wait.mcu.to_owned(),
                    json!({"median_ms": then[1], "longest_ms": then[2], "first_longest_ms": first[2]}),
                )
            })
            .collect();
        let mut found = serde_json::Map::new();
        for kind in &self.kinds {
            let (p999, late) = (kind.spreads(|turn| turn.p999_us), kind.late());
            let values = json!({
                "p999_us_alone": p999[0][1],
                "p999_us_alone_spread": [p999[0][0], p999[0][2]],
                "p999_us_all": p999[1][1],
                "p999_us_all_spread": [p999[1][0], p999[1][2]],
                "p999_all_vs_alone": kind.growth(),
                "late_alone": late[0],
                "late_all": late[1],
            });
            found.insert(kind.key().to_owned(), values);
        }
        found.insert("request".to_owned(), Value::Object(waits));
        Value::Object(found)
    }
}
