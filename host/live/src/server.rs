//! Connections: accepted, read with a deadline, answered by a thread each.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use socket2::SockRef;

use crate::request::{BadHead, Head, parse};
use crate::response::Response;
use crate::routes;
use crate::site::Site;

/// Connections at a time, streams among them.
pub const CONNECTIONS: usize = 48;
/// How long a client may take to send its request, and a reader to accept data.
const PATIENCE: Duration = Duration::from_secs(5);
/// Bytes buffered in the kernel for a reader, about two pictures. With more, a slow page would show old data.
const SEND_BYTES: usize = 131_072;
/// How long, and how many bytes, are still read from a refused client, so that it can read the reason.
const PARTING: (Duration, usize) = (Duration::from_millis(500), 65_536);

/// Serves every connection until the process ends.
pub(crate) fn start(listener: TcpListener, site: Arc<Site>) {
    let serving = Arc::new(AtomicUsize::new(0));
    thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(stream) = stream else {
                // Out of file descriptors, most likely: it is better in a moment.
                thread::sleep(Duration::from_millis(20));
                continue;
            };
            let place = Place::take(&serving);
            let site = Arc::clone(&site);
            let serve = move || {
                // A reader that goes away is no failure.
                let _ = match place {
                    Some(_) => serve(&stream, &site),
                    None => refuse(&stream),
                };
                drop(place);
            };
            // Without a thread to be had the connection is closed.
            let _ = thread::Builder::new().spawn(serve);
        }
    });
}

/// One of the connections at a time.
struct Place(Arc<AtomicUsize>);

impl Place {
    fn take(serving: &Arc<AtomicUsize>) -> Option<Self> {
        let place = Self(Arc::clone(serving));
        (serving.fetch_add(1, Ordering::Relaxed) < CONNECTIONS).then_some(place)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

fn refuse(stream: &TcpStream) -> io::Result<()> {
    stream.set_write_timeout(Some(PATIENCE))?;
    let text = format!("found {CONNECTIONS} connections served already, expected fewer: close some");
    Response::text(503, text).write(stream)
}

/// One request.
fn serve(stream: &TcpStream, site: &Site) -> io::Result<()> {
    stream.set_write_timeout(Some(PATIENCE))?;
    // An event is small and wanted at once.
    stream.set_nodelay(true)?;
    SockRef::from(stream).set_send_buffer_size(SEND_BYTES)?;
    match read(stream, Instant::now() + PATIENCE) {
        Ok((request, body)) => routes::answer(stream, &request, &body, site),
        Err(Unread::Bad(error)) => {
            let status = match error {
                BadHead::BodyTooLong(_) => 413,
                BadHead::TooLong => 431,
                BadHead::NotHttp(_) | BadHead::Header { .. } => 400,
            };
            Response::message(status, error).write(stream)?;
            part(stream)
        }
        Err(Unread::Late) => Response::message(
            408,
            format_args!(
                "request: found none within {} s, expected a whole one",
                PATIENCE.as_secs()
            ),
        )
        .write(stream),
        Err(Unread::Gone) => Ok(()),
    }
}

/// Why there is no request.
enum Unread {
    Bad(BadHead),
    Late,
    Gone,
}

impl From<io::Error> for Unread {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::TimedOut => Self::Late,
            _ => Self::Gone,
        }
    }
}

/// Reads the whole request, head and body, until then.
fn read(mut stream: &TcpStream, until: Instant) -> Result<(Head, Vec<u8>), Unread> {
    let mut bytes = Vec::new();
    let (head, head_bytes) = loop {
        if let Some(read) = parse(&bytes).map_err(Unread::Bad)? {
            break read;
        }
        read_more(stream, &mut bytes, until)?;
    };
    if head.expects_continue {
        stream.write_all(b"HTTP/1.1 100 Continue\r\n\r\n")?;
    }
    while bytes.len() < head_bytes + head.body_bytes {
        read_more(stream, &mut bytes, until)?;
    }
    let body = bytes[head_bytes..head_bytes + head.body_bytes].to_vec();
    Ok((head, body))
}

fn read_more(mut stream: &TcpStream, bytes: &mut Vec<u8>, until: Instant) -> Result<(), Unread> {
    let left = until.saturating_duration_since(Instant::now());
    if left.is_zero() {
        return Err(Unread::Late);
    }
    stream.set_read_timeout(Some(left))?;
    let mut some = [0; 2_048];
    match stream.read(&mut some) {
        Ok(0) => Err(Unread::Gone),
        Ok(count) => {
            bytes.extend_from_slice(&some[..count]);
            Ok(())
        }
        Err(error) if error.kind() == ErrorKind::Interrupted => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// Reads the rest from a refused client: closing earlier would discard the answer.
fn part(stream: &TcpStream) -> io::Result<()> {
    stream.shutdown(Shutdown::Write)?;
    let (patience, bytes_max) = PARTING;
    let until = Instant::now() + patience;
    let mut bytes = Vec::new();
    while bytes.len() < bytes_max && read_more(stream, &mut bytes, until).is_ok() {}
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both ends of a connection.
    fn connected() -> (TcpStream, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        (client, listener.accept().unwrap().0)
    }

    #[test]
    fn a_request_in_pieces_is_read_whole() {
        let (mut client, server) = connected();
        let writes = thread::spawn(move || {
            for piece in [
                "POST /control HT",
                "TP/1.1\r\nContent-",
                "Length: 4\r\n\r\nab",
                "cd, and more",
            ] {
                client.write_all(piece.as_bytes()).unwrap();
                thread::yield_now();
            }
            client
        });
        let Ok((head, body)) = read(&server, Instant::now() + PATIENCE) else {
            panic!("expected a request");
        };
        assert_eq!((head.path.as_str(), body.as_slice()), ("/control", &b"abcd"[..]));
        writes.join().unwrap();
    }

    #[test]
    fn a_client_that_sends_letter_by_letter_is_given_up_at_the_deadline() {
        let (mut client, server) = connected();
        let writes = thread::spawn(move || {
            // Each letter comes well before any time limit of a single read.
            while client.write_all(b"G").is_ok() {
                thread::sleep(Duration::from_millis(5));
            }
        });
        let until = Instant::now() + Duration::from_millis(200);
        assert!(matches!(read(&server, until), Err(Unread::Late)));
        drop(server);
        writes.join().unwrap();
    }
}
