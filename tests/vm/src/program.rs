//! The program under test: started, watched while it runs, ended, and what it said.

use std::io::{self, BufRead, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

const PROGRAM: &str = "/bin/gripline";
/// A run that is not over by then never ends.
const ENDS_WITHIN: Duration = Duration::from_mins(2);

/// How a run ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub code: Option<i32>,
    /// Everything on standard error.
    pub said: String,
    /// One object a line of standard output.
    pub lines: Vec<Value>,
}

impl Ended {
    /// The summary, which comes last.
    pub(crate) fn summary(&self) -> Result<&Value, String> {
        let last = self.lines.last().filter(|line| line["summary"] == true);
        last.ok_or_else(|| {
            format!(
                "no summary; it ended with {:?} and said: {}",
                self.code,
                self.said.trim()
            )
        })
    }

    /// A number of the summary, by its JSON pointer.
    pub(crate) fn number(&self, pointer: &str) -> Result<f64, String> {
        let summary = self.summary()?;
        let number = summary.pointer(pointer).and_then(Value::as_f64);
        number.ok_or_else(|| format!("no number {pointer} in {summary}"))
    }

    /// Fails unless it ended with this code and said all of this.
    pub(crate) fn expect(&self, code: i32, parts: &[&str]) -> Result<(), String> {
        if self.code != Some(code) {
            return Err(format!(
                "ended with {:?}, expected {code}; said: {}",
                self.code,
                self.said.trim()
            ));
        }
        match parts.iter().find(|part| !self.said.contains(*part)) {
            Some(part) => Err(format!("{part:?} is missing in: {}", self.said.trim())),
            None => Ok(()),
        }
    }
}

/// A process that ends with whoever watches it: one that a failed check leaves behind would keep the camera from the next.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        // Both do nothing to one that is over.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A run under way; dropped, it is killed.
pub(crate) struct Running {
    child: Guarded,
    /// Lines of standard error, as they come.
    news: Receiver<String>,
    said: String,
    /// Lines of standard output so far.
    frames_seen: Arc<AtomicUsize>,
    output: thread::JoinHandle<Vec<Value>>,
}

/// A command of the program.
pub(crate) fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// Starts it.
pub(crate) fn start(command: &mut Command) -> io::Result<Running> {
    let mut child = Guarded(command.spawn()?);
    let (sender, news) = channel();
    let (Some(out), Some(err)) = (child.0.stdout.take(), child.0.stderr.take()) else {
        return Err(io::Error::other("no pipes"));
    };
    thread::spawn(move || {
        for line in BufReader::new(err).lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    let frames_seen = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&frames_seen);
    let output = thread::spawn(move || {
        // What was cut off by a kill is not there.
        BufReader::new(out)
            .lines()
            .map_while(Result::ok)
            .inspect(|_| {
                counter.fetch_add(1, Ordering::Relaxed);
            })
            .filter_map(|line| serde_json::from_str(&line).ok())
            .collect()
    });
    Ok(Running {
        child,
        news,
        said: String::new(),
        frames_seen,
        output,
    })
}

impl Running {
    /// Waits until it says something with all of these parts on standard error. Returns how long that took.
    pub(crate) fn until_it_says(&mut self, parts: &[&str], patience: Duration) -> Result<Duration, String> {
        let start = Instant::now();
        loop {
            let left = patience.saturating_sub(start.elapsed());
            match self.news.recv_timeout(left) {
                Ok(line) => {
                    self.said += &line;
                    self.said.push('\n');
                    if parts.iter().all(|part| line.contains(part)) {
                        return Ok(start.elapsed());
                    }
                }
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    return Err(format!(
                        "{parts:?} not said within {:.1} s; said: {}",
                        start.elapsed().as_secs_f64(),
                        self.said.trim()
                    ));
                }
            }
        }
    }

    /// Waits until it has reported so many frames, counted from its start.
    pub(crate) fn until_frames(&mut self, frames: usize, patience: Duration) -> Result<(), String> {
        let start = Instant::now();
        loop {
            let frames_seen = self.frames_seen();
            if frames_seen >= frames {
                return Ok(());
            }
            let status = self.child.0.try_wait().map_err(|error| error.to_string())?;
            if status.is_some() || start.elapsed() > patience {
                let news: Vec<String> = self.news.try_iter().collect();
                return Err(format!(
                    "{frames_seen} frames after {:.1} s, expected {frames}; it ended with {status:?}; said: {}{}",
                    start.elapsed().as_secs_f64(),
                    self.said,
                    news.join(" | ")
                ));
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Frames it has reported so far.
    pub(crate) fn frames_seen(&self) -> usize {
        self.frames_seen.load(Ordering::Relaxed)
    }

    /// Ends it at once, as `kill -9` does.
    pub(crate) fn kill(mut self) -> Result<Ended, String> {
        self.child.0.kill().map_err(|error| error.to_string())?;
        self.wait()
    }

    /// Ends it as Ctrl-C does.
    pub(crate) fn interrupt(self) -> Result<Ended, String> {
        kill(Pid::from_raw(self.child.0.id() as i32), Signal::SIGINT).map_err(|error| error.to_string())?;
        self.wait()
    }

    fn status(&mut self) -> io::Result<Option<ExitStatus>> {
        let start = Instant::now();
        while start.elapsed() < ENDS_WITHIN {
            if let Some(status) = self.child.0.try_wait()? {
                return Ok(Some(status));
            }
            thread::sleep(Duration::from_millis(20));
        }
        self.child.0.kill()?;
        self.child.0.wait()?;
        Ok(None)
    }

    /// Waits for its end.
    pub(crate) fn wait(mut self) -> Result<Ended, String> {
        let status = self.status().map_err(|error| error.to_string())?;
        while let Ok(line) = self.news.recv() {
            self.said += &line;
            self.said.push('\n');
        }
        let lines = self.output.join();
        let lines = lines.map_err(|_| "its output could not be read".to_owned())?;
        let Some(status) = status else {
            return Err(format!(
                "not over after {} s; {} lines, the last {:?}; said: {}",
                ENDS_WITHIN.as_secs(),
                lines.len(),
                lines.last(),
                self.said.trim()
            ));
        };
        Ok(Ended {
            code: status.code(),
            said: self.said,
            lines,
        })
    }
}

/// Runs it to its end.
pub(crate) fn run(arguments: &[&str]) -> Result<Ended, String> {
    start(&mut command(arguments))
        .map_err(|error| error.to_string())?
        .wait()
}
