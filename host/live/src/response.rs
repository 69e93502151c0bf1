//! Responses: status, content type and body, and how they are written.

use std::io::{self, Write};

/// An answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Response {
    /// The number, such as 200.
    pub(crate) status: u16,
    /// The kind of the body.
    pub(crate) kind: &'static str,
    /// The body.
    pub(crate) body: String,
}

/// The kind of plain texts.
const TEXT: &str = "text/plain; charset=utf-8";

impl Response {
    /// A body of this kind.
    pub(crate) fn of(status: u16, kind: &'static str, body: impl Into<String>) -> Self {
        Self {
            status,
            kind,
            body: body.into(),
        }
    }

    /// A line for people.
    pub(crate) fn text(status: u16, line: impl std::fmt::Display) -> Self {
        Self::of(status, TEXT, format!("{line}\n"))
    }

    /// JSON for programs.
    pub(crate) fn json(status: u16, value: &impl serde::Serialize) -> Self {
        // What is serialised here has no maps with keys that are no texts, the only thing that fails.
        let body = serde_json::to_string(value).unwrap_or_default();
        Self::of(status, "application/json", body + "\n")
    }

    /// JSON with nothing but a message.
    pub(crate) fn message(status: u16, message: impl std::fmt::Display) -> Self {
        Self::json(status, &serde_json::json!({ "message": message.to_string() }))
    }

    /// Writes the whole response.
    pub(crate) fn write(&self, mut to: impl Write) -> io::Result<()> {
        let head = head(self.status, self.kind, Some(self.body.len()));
        to.write_all(&[head.as_bytes(), self.body.as_bytes()].concat())
    }
}

/// The head of an answer; of a stream where the length is not known.
pub(crate) fn head(status: u16, kind: &str, body_bytes: Option<usize>) -> String {
    let length = body_bytes.map_or_else(String::new, |bytes| format!("Content-Length: {bytes}\r\n"));
    let challenge = if status == 401 {
        "WWW-Authenticate: Bearer\r\n"
    } else {
        ""
    };
    format!(
        "HTTP/1.1 {status} {}\r\nContent-Type: {kind}\r\n{length}{challenge}Connection: close\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nX-Frame-Options: DENY\r\n\
         Content-Security-Policy: default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\r\n",
        reason(status)
    )
}

const fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        400 => "Bad Request",
        401 => "Unauthorized",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        409 => "Conflict",
        413 => "Content Too Large",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        504 => "Gateway Timeout",
        _ => "Answer",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_has_its_length_and_ends_the_connection() {
        let mut written = Vec::new();
        Response::message(401, "no token").write(&mut written).unwrap();
        let text = String::from_utf8(written).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        assert!(head.starts_with("HTTP/1.1 401 Unauthorized\r\n"), "{head}");
        assert!(
            head.contains("\r\nConnection: close\r\n") && head.contains("\r\nWWW-Authenticate: Bearer\r\n"),
            "{head}"
        );
        assert!(head.contains(&format!("\r\nContent-Length: {}\r\n", body.len())));
        assert_eq!(body, "{\"message\":\"no token\"}\n");
    }
}
