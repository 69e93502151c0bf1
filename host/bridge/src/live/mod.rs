//! Live values for other programs, over HTTP on an address of one's choice (nothing is served unless asked for): `/metrics` for
//! Prometheus, `/frames` as newline JSON, one object a frame as in `run --json`.
//!
//! The loop never waits: it leaves its values behind where nobody is looking at that moment, and a reader who is too slow
//! misses frames. Limits: eight readers at a time, GET only, no encryption: keep it on the machine or behind a proxy.

pub(crate) mod fleet;
mod metrics;
pub(crate) mod ros2;

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use gripline_protocol::SENSORS;

pub(crate) use self::metrics::{QUANTILES, Values};
use crate::error::Failure;
use gripline_recording::telemetry::FrameReport;

/// Readers at a time.
const READERS: usize = 8;
/// Frames that wait for a reader.
const WAITING: usize = 64;
/// The longest request that is read, bytes.
const REQUEST_BYTES: u64 = 4_096;
/// How long a reader may take to ask, or to take what it asked for.
const PATIENCE: Duration = Duration::from_secs(5);

/// What the loop and the readers share.
#[derive(Default)]
struct Shared {
    values: Mutex<Values>,
    readers: Mutex<Vec<SyncSender<Arc<str>>>>,
    serving: AtomicUsize,
}

/// The endpoint, as long as the run lives.
pub(crate) struct Live {
    shared: Arc<Shared>,
    address: SocketAddr,
}

impl Live {
    /// Listens at `address`.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be had.
    pub(crate) fn start(address: SocketAddr) -> Result<Self, Failure> {
        let failed = |error: io::Error| {
            Failure::failed(format!(
                "serve.listen {address}: {error}, expected an address of this machine that no other program listens on"
            ))
        };
        let listener = TcpListener::bind(address).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let shared = Arc::new(Shared::default());
        let its = Arc::clone(&shared);
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let shared = Arc::clone(&its);
                if shared.serving.fetch_add(1, Ordering::Relaxed) >= READERS {
                    shared.serving.fetch_sub(1, Ordering::Relaxed);
                    let _ = answer(
                        &stream,
                        "503 Service Unavailable",
                        "text/plain",
                        "eight readers are served already\n",
                    );
                    continue;
                }
                thread::spawn(move || {
                    // A reader that goes away is no failure.
                    let _ = serve(&stream, &shared);
                    shared.serving.fetch_sub(1, Ordering::Relaxed);
                });
            }
        });
        Ok(Self { shared, address })
    }

    /// Where it listens, with the port that the system chose for port 0.
    pub(crate) const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Leaves a frame for whoever wants it.
    pub(crate) fn publish(&self, report: &FrameReport, fill: impl FnOnce(&mut Values)) {
        // Where a reader is looking just now, the next frame comes in a moment.
        if let Ok(mut values) = self.shared.values.try_lock() {
            fill(&mut values);
            values.newest[usize::from(report.sensor) % SENSORS] = Some(report.clone());
        }
        let Ok(mut readers) = self.shared.readers.try_lock() else {
            return;
        };
        if readers.is_empty() {
            return;
        }
        if let Ok(line) = serde_json::to_string(report) {
            let line: Arc<str> = (line + "\n").into();
            readers.retain(|reader| {
                !matches!(
                    reader.try_send(Arc::clone(&line)),
                    Err(TrySendError::Disconnected(_))
                )
            });
        }
    }
}

/// One request.
fn serve(stream: &TcpStream, shared: &Shared) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = String::new();
    let mut lines = BufReader::new(stream.take(REQUEST_BYTES));
    lines.read_line(&mut request)?;
    // The rest of the request says nothing that matters, but closing before it is read would be an error for the reader.
    let mut line = String::new();
    while lines.read_line(&mut line)? > 0 && !line.trim().is_empty() {
        line.clear();
    }
    let mut words = request.split_whitespace();
    match (words.next(), words.next()) {
        (Some("GET"), Some("/metrics")) => {
            let values = shared
                .values
                .lock()
                .map(|values| values.clone())
                .unwrap_or_default();
            answer(stream, "200 OK", "text/plain; version=0.0.4", &values.text())
        }
        (Some("GET"), Some("/frames")) => {
            let (sender, frames) = sync_channel(WAITING);
            if let Ok(mut readers) = shared.readers.lock() {
                readers.push(sender);
            }
            stream_frames(stream, &frames)
        }
        (Some("GET"), Some("/")) => answer(stream, "200 OK", "text/plain", "/metrics\n/frames\n"),
        (Some("GET"), _) => answer(
            stream,
            "404 Not Found",
            "text/plain",
            "expected /metrics or /frames\n",
        ),
        _ => answer(stream, "405 Method Not Allowed", "text/plain", "expected GET\n"),
    }
}

fn stream_frames(mut stream: &TcpStream, frames: &Receiver<Arc<str>>) -> io::Result<()> {
    stream
        .write_all(b"HTTP/1.1 200 OK\r\nContent-Type: application/x-ndjson\r\nConnection: close\r\n\r\n")?;
    while let Ok(line) = frames.recv() {
        stream.write_all(line.as_bytes())?;
    }
    Ok(())
}

fn answer(mut stream: &TcpStream, status: &str, kind: &str, body: &str) -> io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )
}
