//! `POST /control`: a request with the token becomes a request to the loop, and its answer a status and JSON.

use gripline_control::{Answer, Handle, Request, Why};

use crate::response::Response;

/// Answers a request; waits for the loop's answer if the loop must act.
pub(crate) fn control(body: &[u8], given: Option<&str>, token: &str, handle: &Handle) -> Response {
    if !is_token(given, token) {
        return no_token(given);
    }
    match Request::from_json(body) {
        Ok(request) => {
            let answer = handle.ask(&request);
            Response::json(status(&answer), &answer)
        }
        Err(error) => Response::message(400, error),
    }
}

/// Whether it is the token. Takes the same time for any wrong one of the same length, so that the timing reveals nothing.
pub(crate) fn is_token(given: Option<&str>, token: &str) -> bool {
    let (given, token) = (given.unwrap_or_default().as_bytes(), token.as_bytes());
    let difference = given.iter().zip(token).fold(0, |difference, (one, other)| {
        std::hint::black_box(difference | (one ^ other))
    });
    // An empty token is none.
    !token.is_empty() && given.len() == token.len() && difference == 0
}

fn no_token(given: Option<&str>) -> Response {
    let found = if given.is_none() { "none" } else { "another one" };
    Response::message(
        401,
        format_args!(
            "token: found {found}, expected the one of the token file as `Authorization: Bearer TOKEN`; the run says at its start \
             where it is"
        ),
    )
}

fn status(answer: &Answer) -> u16 {
    match answer.why() {
        None => 200,
        Some(Why::LinkLost(_) | Why::Busy | Why::Ended) => 503,
        Some(Why::NotConfirmed(_)) => 504,
        Some(_) => 409,
    }
}

#[cfg(test)]
mod tests {
    use gripline_control::{Outcome, channel};

    use super::*;

    const HOLD: &[u8] = br#"{"client":"cell-3","request":7,"action":"hold"}"#;

    /// A loop that answers so.
    fn answered(outcome: &Outcome, body: &[u8], token: Option<&str>) -> Response {
        let (handle, inbox) = channel();
        std::thread::scope(|scope| {
            let asks = scope.spawn(|| {
                let response = control(body, token, "0123abcd", &handle);
                drop(handle);
                response
            });
            while !asks.is_finished() {
                if let Some(asked) = inbox.next() {
                    asked.answer(Answer::to(&asked.request, outcome.clone(), None, 1.0));
                }
                std::thread::yield_now();
            }
            asks.join().unwrap()
        })
    }

    fn json(response: &Response) -> serde_json::Value {
        serde_json::from_str(&response.body).unwrap()
    }

    #[test]
    fn without_the_right_token_nothing_is_asked() {
        for token in [
            None,
            Some(""),
            Some("0123abce"),
            Some("0123abcd0"),
            Some("0123abc"),
        ] {
            let (handle, inbox) = channel();
            let response = control(HOLD, token, "0123abcd", &handle);
            assert_eq!(response.status, 401, "{token:?}");
            assert!(json(&response)["message"].as_str().unwrap().contains("expected"));
            assert!(inbox.next().is_none());
        }
        // A server without a token obeys nobody.
        assert!(!is_token(Some(""), "") && !is_token(None, ""));
    }

    #[test]
    fn every_outcome_has_its_status() {
        let refusals = [
            (Why::Inhibited, 409),
            (Why::Holding, 409),
            (Why::Latched(vec!["LINK LOST"]), 409),
            (Why::NoCamera, 409),
            (Why::Overtaken, 409),
            (Why::LinkLost("cable".to_owned()), 503),
            (Why::Busy, 503),
            (Why::Ended, 503),
            (Why::NotConfirmed("STALE".to_owned()), 504),
        ];
        let done = answered(&Outcome::Done, HOLD, Some("0123abcd"));
        assert_eq!(
            (done.status, json(&done)["outcome"].as_str()),
            (200, Some("done"))
        );
        for (why, expected) in refusals {
            let name = why.name();
            let response = answered(&Outcome::Refused(why), HOLD, Some("0123abcd"));
            assert_eq!(response.status, expected, "{name}");
            assert_eq!(json(&response)["why"], name);
        }
    }

    #[test]
    fn a_body_that_is_no_request_is_told_what_it_lacks() {
        for body in [
            &b""[..],
            b"[]",
            b"{}",
            b"\xff",
            br#"{"client":"a","request":1,"action":"open"}"#,
        ] {
            let response = answered(&Outcome::Done, body, Some("0123abcd"));
            assert_eq!(response.status, 400);
            assert!(json(&response)["message"].as_str().unwrap().contains("expected"));
        }
    }
}
