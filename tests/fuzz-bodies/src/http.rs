//! Any bytes on a connection: the head is read or refused and takes no more than there is, and a body becomes a request within its
//! limits or an error that says what was expected.

use gripline_control::{Action, Request};
use gripline_live::request::{BODY_MAX, HEAD_MAX, parse};

/// Panics when something does not hold for this input.
pub fn check(input: &[u8]) {
    match parse(input) {
        Ok(Some((head, taken))) => {
            assert!(
                taken <= input.len().min(HEAD_MAX),
                "{taken} bytes of {}",
                input.len()
            );
            assert!(head.body_bytes <= BODY_MAX, "a body of {} bytes", head.body_bytes);
            assert_eq!(
                parse(&input[..taken]),
                Ok(Some((head, taken))),
                "what follows changes nothing"
            );
            request(&input[taken..]);
        }
        Ok(None) => assert!(input.len() < HEAD_MAX, "{} bytes without an end", input.len()),
        Err(error) => assert!(error.to_string().contains("expected"), "{error}"),
    }
    request(input);
}

fn request(body: &[u8]) {
    match Request::from_json(body) {
        Ok(request) => {
            assert!(
                (1..=64).contains(&request.client.name().len()),
                "{}",
                request.client
            );
            if let Action::SetFloor { newtons } = request.action {
                assert!(newtons.is_finite(), "{newtons} N");
            }
        }
        Err(error) => assert!(error.to_string().contains("expected"), "{error}"),
    }
}
