//! Paths and their handlers.

use std::io::{self, ErrorKind, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use crate::control::{control, is_token};
use crate::event;
use crate::host_name::is_local;
use crate::page;
use crate::request::{Head, Method};
use crate::response::{Response, head};
use crate::site::Site;

/// Streams (`/frames` and `/events`) at a time.
pub const STREAMS: usize = 16;
/// Lines that wait for a reader of `/frames`: a second's.
const LINES_WAITING: usize = 64;
/// Events that wait for a page: older ones are useless to it.
const EVENTS_WAITING: usize = 4;
/// While nothing is written, a stream looks this often whether its client is still there.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// A page that lost its connection reconnects after this time, milliseconds.
const RETRY: &str = "retry: 1000\n\n";

/// Answers a request over its connection; a stream lasts as long as its client reads.
pub(crate) fn answer(stream: &TcpStream, request: &Head, body: &[u8], site: &Site) -> io::Result<()> {
    match (request.method, request.path.as_str()) {
        (Method::Get, "/frames") => streamed(stream, site, |stream, site| {
            let Some(lines) = site.lines.join(LINES_WAITING) else {
                return Ok(());
            };
            stream_all(stream, "application/x-ndjson", "", &lines)
        }),
        (Method::Get, "/events") if may_ask(request, site) => streamed(stream, site, |stream, site| {
            let Some(events) = site.events.join(EVENTS_WAITING) else {
                return Ok(());
            };
            site.has_new_page.store(true, Ordering::Relaxed);
            let first = RETRY.to_owned() + &event::status(&site.handle.status());
            stream_all(stream, "text/event-stream", &first, &events)
        }),
        _ => response(request, body, site).write(stream),
    }
}

/// The answer to any path that is not a stream.
fn response(request: &Head, body: &[u8], site: &Site) -> Response {
    let path = request.path.as_str();
    if path != "/metrics" && !may_ask(request, site) {
        return Response::message(
            403,
            format_args!(
                "Host: found {:?}, expected localhost or an address: this run serves its own machine only",
                request.host.as_deref().unwrap_or_default()
            ),
        );
    }
    let file = page::FILES.iter().find(|(name, ..)| *name == path);
    match (request.method, path) {
        (Method::Post, "/control") => control(body, request.token.as_deref(), &site.token, &site.handle),
        (Method::Get, "/status") => Response::json(200, &site.handle.status()),
        (Method::Get, "/metrics") => {
            let values = site
                .values
                .lock()
                .map(|values| values.clone())
                .unwrap_or_default();
            Response::of(200, "text/plain; version=0.0.4", values.text())
        }
        (_, "/control") => Response::text(405, "expected POST"),
        (Method::Get, _) if file.is_some() => file.map_or_else(
            || Response::text(404, ""),
            |(_, kind, text)| Response::of(200, kind, *text),
        ),
        (_, "/status" | "/metrics" | "/frames" | "/events") => Response::text(405, "expected GET"),
        _ if file.is_some() => Response::text(405, "expected GET"),
        _ => Response::text(404, "expected /, /events, /status, /control, /metrics or /frames"),
    }
}

/// A run on a loopback address accepts only its own host names; a client with the token may use any.
fn may_ask(request: &Head, site: &Site) -> bool {
    !site.is_loopback
        || request.host.as_deref().is_none_or(is_local)
        || is_token(request.token.as_deref(), &site.token)
}

/// Counts a stream while it lasts.
fn streamed(
    stream: &TcpStream,
    site: &Site,
    serve: impl FnOnce(&TcpStream, &Site) -> io::Result<()>,
) -> io::Result<()> {
    let served = if site.streams.fetch_add(1, Ordering::Relaxed) < STREAMS {
        serve(stream, site)
    } else {
        Response::text(
            503,
            format_args!("found {STREAMS} streams served already, expected fewer: close one"),
        )
        .write(stream)
    };
    site.streams.fetch_sub(1, Ordering::Relaxed);
    served
}

fn stream_all(mut stream: &TcpStream, kind: &str, first: &str, texts: &Receiver<Arc<str>>) -> io::Result<()> {
    stream.write_all((head(200, kind, None) + first).as_bytes())?;
    loop {
        match texts.recv_timeout(LOOK_EVERY) {
            Ok(text) => stream.write_all(text.as_bytes())?,
            Err(RecvTimeoutError::Timeout) if is_gone(stream)? => return Ok(()),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
    }
}

/// Whether the client has closed the connection.
fn is_gone(stream: &TcpStream) -> io::Result<bool> {
    stream.set_nonblocking(true)?;
    let seen = stream.peek(&mut [0]);
    stream.set_nonblocking(false)?;
    match seen {
        Ok(count) => Ok(count == 0),
        Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(false),
        Err(error) => Err(error),
    }
}
