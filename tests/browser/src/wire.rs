//! One request to the driver and its answer.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use serde_json::Value;

use crate::error::BrowserError;

/// The browser's start is the slowest of all commands.
const PATIENCE: Duration = Duration::from_mins(1);

/// How a command is sent.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Method {
    Get,
    Post,
    Delete,
}

/// The value that the driver answers with.
pub(crate) fn ask(port: u16, method: Method, path: &str, body: &Value) -> Result<Value, BrowserError> {
    let failed = |what: &dyn std::fmt::Display| BrowserError(format!("{path}: {what}"));
    let (name, body) = match method {
        Method::Get => ("GET", String::new()),
        Method::Delete => ("DELETE", String::new()),
        Method::Post => ("POST", body.to_string()),
    };
    let answer = exchange(port, name, path, &body).map_err(|error| failed(&error))?;
    let mut answer: Value = serde_json::from_slice(&answer)
        .map_err(|error| failed(&format!("found an answer that is no JSON ({error})")))?;
    let value = answer["value"].take();
    match value["error"].as_str() {
        Some(error) => Err(failed(&format!(
            "{error}: {}",
            value["message"].as_str().unwrap_or_default()
        ))),
        None => Ok(value),
    }
}

/// The body of the answer.
fn exchange(port: u16, method: &str, path: &str, body: &str) -> std::io::Result<Vec<u8>> {
    let mut stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.set_read_timeout(Some(PATIENCE))?;
    let head = format!(
        "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\
         Connection: close\r\n\r\n",
        body.len()
    );
    stream.write_all((head + body).as_bytes())?;
    let mut answer = Vec::new();
    let mut some = [0; 8_192];
    // The driver may keep the connection open: the length says when the answer is whole.
    loop {
        if let Some((start, length)) = body_of(&answer)
            && answer.len() >= start + length
        {
            return Ok(answer[start..start + length].to_vec());
        }
        match stream.read(&mut some)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            count => answer.extend_from_slice(&some[..count]),
        }
    }
}

/// Where the body starts and how long it is, once the head is there.
fn body_of(answer: &[u8]) -> Option<(usize, usize)> {
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n")?;
    let head = std::str::from_utf8(&answer[..end]).ok()?;
    let length = head.lines().find_map(|line| {
        let (name, value) = line.split_once(':')?;
        name.eq_ignore_ascii_case("content-length")
            .then(|| value.trim().parse().ok())
            .flatten()
    })?;
    Some((end + 4, length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_body_is_where_the_head_ends_and_as_long_as_it_says() {
        let answer = b"HTTP/1.1 200 OK\r\ncontent-length: 3\r\n\r\n{}\n";
        assert_eq!(body_of(answer), Some((38, 3)));
        assert_eq!(body_of(&answer[..36]), None);
    }
}
