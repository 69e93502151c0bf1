//! A request's head from bytes. Pure: no panic on any input, nothing kept beyond the limits below.

/// The longest head, bytes: browsers send up to two thousand.
pub const HEAD_MAX: usize = 8_192;
/// The longest body, bytes.
pub const BODY_MAX: usize = 4_096;
/// The most header lines.
const HEADERS_MAX: usize = 64;

/// The method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Read it.
    Get,
    /// Do it.
    Post,
    /// Any other.
    Other,
}

/// A request's head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Head {
    /// The method.
    pub method: Method,
    /// The path, without the query.
    pub path: String,
    /// The `Host` header, with the port.
    pub host: Option<String>,
    /// The token after `Bearer`.
    pub token: Option<String>,
    /// Bytes of the body, at most [`BODY_MAX`].
    pub body_bytes: usize,
    /// The client waits to be told to send the body.
    pub expects_continue: bool,
}

/// An invalid head.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BadHead {
    /// It is not HTTP.
    #[error("request: found {0}, expected a request in HTTP/1.1")]
    NotHttp(String),
    /// It does not end.
    #[error("request: found a head of more than {HEAD_MAX} bytes, expected a shorter one")]
    TooLong,
    /// An invalid header.
    #[error("{header}: found {found}, expected {expected}")]
    Header {
        /// Its name.
        header: &'static str,
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// The body is too long.
    #[error("Content-Length: found {0} bytes, expected at most {BODY_MAX}")]
    BodyTooLong(u64),
}

/// Reads a head; `None` while it is incomplete. Also returns its length in bytes: the body follows.
///
/// # Errors
/// [`BadHead`], with what was found and expected.
pub fn parse(bytes: &[u8]) -> Result<Option<(Head, usize)>, BadHead> {
    let mut lines = [httparse::EMPTY_HEADER; HEADERS_MAX];
    let mut request = httparse::Request::new(&mut lines);
    let head_bytes = match request.parse(bytes) {
        Ok(httparse::Status::Complete(head_bytes)) if head_bytes <= HEAD_MAX => head_bytes,
        Ok(httparse::Status::Partial) if bytes.len() < HEAD_MAX => return Ok(None),
        Ok(_) => return Err(BadHead::TooLong),
        Err(error) => return Err(BadHead::NotHttp(error.to_string())),
    };
    let method = match request.method {
        Some("GET") => Method::Get,
        Some("POST") => Method::Post,
        _ => Method::Other,
    };
    let target = request.path.unwrap_or_default();
    let path = target.split_once('?').map_or(target, |(path, _)| path);
    let only = |name: &'static str| only(request.headers, name);
    if let Some(found) = only("Transfer-Encoding")? {
        return Err(BadHead::Header {
            header: "Transfer-Encoding",
            found: shortened(&found),
            expected: "a Content-Length",
        });
    }
    let body_bytes = match only("Content-Length")? {
        None => 0,
        Some(found) => length(&found)?,
    };
    let head = Head {
        method,
        path: path.to_owned(),
        host: only("Host")?,
        token: only("Authorization")?.and_then(|value| bearer(&value)),
        body_bytes,
        expects_continue: only("Expect")?.is_some_and(|value| value.eq_ignore_ascii_case("100-continue")),
    };
    Ok(Some((head, head_bytes)))
}

/// A header that may appear only once.
fn only(headers: &[httparse::Header<'_>], name: &'static str) -> Result<Option<String>, BadHead> {
    let mut of_name = headers
        .iter()
        .filter(|header| header.name.eq_ignore_ascii_case(name));
    let first = of_name.next();
    if of_name.next().is_some() {
        return Err(BadHead::Header {
            header: name,
            found: "it more than once".to_owned(),
            expected: "it once",
        });
    }
    Ok(first.map(|header| String::from_utf8_lossy(header.value).trim().to_owned()))
}

fn length(text: &str) -> Result<usize, BadHead> {
    let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    match text.parse::<u64>() {
        Ok(bytes) if digits && bytes <= BODY_MAX as u64 => Ok(bytes as usize),
        Ok(bytes) if digits => Err(BadHead::BodyTooLong(bytes)),
        // More digits than any length has.
        Err(_) if digits => Err(BadHead::BodyTooLong(u64::MAX)),
        _ => Err(BadHead::Header {
            header: "Content-Length",
            found: shortened(text),
            expected: "a number of bytes",
        }),
    }
}

fn bearer(value: &str) -> Option<String> {
    let (scheme, token) = value.split_once(' ')?;
    scheme
        .eq_ignore_ascii_case("Bearer")
        .then(|| token.trim().to_owned())
}

/// Received text may be long, and may contain control characters.
fn shortened(text: &str) -> String {
    let text: String = text.chars().take(64).collect();
    text.escape_default().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(text: &str) -> Result<Head, BadHead> {
        parse(text.as_bytes()).map(|read| read.expect("a whole head").0)
    }

    #[test]
    fn a_head_is_read_once_it_is_whole() {
        let text = "POST /control?x=1 HTTP/1.1\r\nhost: cell:9617\r\nAUTHORIZATION: bearer  abc \r\ncontent-length: 12\r\n\r\n";
        for end in 0..text.len() {
            assert_eq!(parse(&text.as_bytes()[..end]), Ok(None), "{end} bytes");
        }
        let (read, bytes) = parse(format!("{text}and more").as_bytes()).unwrap().unwrap();
        assert_eq!(bytes, text.len());
        assert_eq!(
            read,
            Head {
                method: Method::Post,
                path: "/control".to_owned(),
                host: Some("cell:9617".to_owned()),
                token: Some("abc".to_owned()),
                body_bytes: 12,
                expects_continue: false,
            }
        );
    }

    #[test]
    fn lengths_that_cannot_be_are_refused() {
        let of = |lines: &str| head(&format!("POST / HTTP/1.1\r\n{lines}\r\n\r\n"));
        assert_eq!(of("Content-Length: 4096").unwrap().body_bytes, BODY_MAX);
        assert_eq!(of("Content-Length: 4097"), Err(BadHead::BodyTooLong(4_097)));
        assert!(matches!(
            of("Content-Length: 99999999999999999999999"),
            Err(BadHead::BodyTooLong(_))
        ));
        for bad in ["-1", "+1", "1 1", "0x10", "", "1,1"] {
            let error = of(&format!("Content-Length: {bad}")).unwrap_err().to_string();
            assert!(error.contains("Content-Length: found"), "{bad}: {error}");
        }
        for twice in ["Content-Length: 1\r\nContent-Length: 1", "Host: a\r\nHost: b"] {
            assert!(of(twice).unwrap_err().to_string().contains("more than once"));
        }
        assert!(
            of("Transfer-Encoding: chunked")
                .unwrap_err()
                .to_string()
                .contains("chunked")
        );
    }

    #[test]
    fn a_head_that_does_not_end_is_refused_at_the_limit() {
        let mut text = b"GET / HTTP/1.1\r\nX: ".to_vec();
        text.resize(HEAD_MAX, b'a');
        assert_eq!(parse(&text), Err(BadHead::TooLong));
        assert!(matches!(parse(&[0xFF; 100]), Err(BadHead::NotHttp(_))));
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..300)) {
            if let Ok(Some((head, taken))) = parse(&bytes) {
                proptest::prop_assert!(taken <= bytes.len() && head.body_bytes <= BODY_MAX);
            }
        }

        #[test]
        fn any_header_values_are_read_or_refused(
            name in "(?i)(content-length|host|authorization|expect|transfer-encoding|x)",
            value in "[\\x20-\\x7e]{0,40}",
            more in "[\\x00-\\xff]{0,40}",
        ) {
            let text = format!("POST /control HTTP/1.1\r\n{name}: {value}\r\n{more}\r\n\r\n");
            if let Ok(Some((head, taken))) = parse(text.as_bytes()) {
                proptest::prop_assert!(taken <= text.len() && head.body_bytes <= BODY_MAX);
            }
        }
    }
}
