//! Requests from outside: reading, owning, repeating, answering.

use gripline_control::{
    Action, Answer, Arbiter, Client, Handle, Inbox, Outcome, Request, Step, Why, channel,
};
use proptest::prelude::*;

fn request(client: &str, number: u64, action: Action) -> Request {
    Request {
        client: client.parse().unwrap(),
        number,
        action,
        take_over: false,
    }
}

/// A client that asks in a thread of its own; the loop's part is `serve`.
fn ask(handle: &Handle, request: Request) -> std::thread::JoinHandle<Answer> {
    let handle = handle.clone();
    std::thread::spawn(move || handle.ask(&request))
}

/// Takes the next request to the arbiter.
fn next(inbox: &Inbox, arbiter: &mut Arbiter) -> Option<Step> {
    let until = std::time::Instant::now() + std::time::Duration::from_secs(2);
    arbiter.take(inbox.next_until(until).expect("a request within two seconds"))
}

#[test]
fn who_asks_first_owns_and_others_read_until_they_take_over() {
    let ((handle, inbox), mut arbiter) = (channel(), Arbiter::new());
    let first = ask(&handle, request("first", 1, Action::Hold));
    assert_eq!(next(&inbox, &mut arbiter), Some(Step::Hold));
    arbiter.close(Step::Hold, &Outcome::Done);
    assert!(first.join().unwrap().is_done());

    let second = ask(&handle, request("second", 1, Action::Release));
    assert_eq!(next(&inbox, &mut arbiter), None, "nothing moves");
    let answer = second.join().unwrap();
    assert_eq!(answer.why(), Some(&Why::WrongOwner("first".parse().unwrap())));
    assert!(answer.to_string().contains("owned by first"), "{answer}");

    let taken = ask(
        &handle,
        Request {
            take_over: true,
            ..request("second", 1, Action::Release)
        },
    );
    // The same number as the one that was not listened to.
    assert_eq!(next(&inbox, &mut arbiter), Some(Step::Release));
    arbiter.close(Step::Release, &Outcome::Done);
    assert_eq!(taken.join().unwrap().owner, Some("second".parse().unwrap()));
    assert!(
        arbiter
            .take_news()
            .iter()
            .any(|news| news.text == "second took the gripper over from first")
    );

    let gone = ask(&handle, request("second", 2, Action::Yield));
    assert_eq!(next(&inbox, &mut arbiter), None);
    assert_eq!(gone.join().unwrap().owner, None);
}

#[test]
fn a_repeated_request_is_answered_again_and_not_carried_out_again() {
    let ((handle, inbox), mut arbiter) = (channel(), Arbiter::new());
    let asked = request("arm", 7, Action::Hold);
    let both = [ask(&handle, asked.clone()), ask(&handle, asked.clone())];
    assert_eq!(next(&inbox, &mut arbiter), Some(Step::Hold));
    assert_eq!(next(&inbox, &mut arbiter), None, "it is under way");
    arbiter.close(Step::Hold, &Outcome::Done);
    assert!(both.into_iter().all(|asked| asked.join().unwrap().is_done()));
    let third = ask(&handle, asked);
    assert_eq!(next(&inbox, &mut arbiter), None, "it was done");
    assert!(third.join().unwrap().is_done());
    let other = ask(&handle, request("arm", 8, Action::Hold));
    assert_eq!(next(&inbox, &mut arbiter), Some(Step::Hold));
    arbiter.close(Step::Hold, &Outcome::Refused(Why::Restarted));
    assert_eq!(other.join().unwrap().why(), Some(&Why::Restarted));
}

#[test]
fn a_newer_request_overtakes_the_older_one_and_both_are_answered() {
    let ((handle, inbox), mut arbiter) = (channel(), Arbiter::new());
    let release = ask(&handle, request("arm", 1, Action::Release));
    assert_eq!(next(&inbox, &mut arbiter), Some(Step::Release));
    let hold = ask(&handle, request("arm", 2, Action::Hold));
    assert_eq!(next(&inbox, &mut arbiter), Some(Step::Hold));
    assert_eq!(release.join().unwrap().why(), Some(&Why::Overtaken));
    let floor = ask(&handle, request("arm", 3, Action::SetFloor { newtons: 4.0 }));
    assert_eq!(next(&inbox, &mut arbiter), Some(Step::SetFloor(4.0)));
    assert!(arbiter.waits_for(Step::Hold), "another kind overtakes nothing");
    arbiter.close(Step::Hold, &Outcome::Done);
    arbiter.close(Step::SetFloor(0.0), &Outcome::Done);
    assert!(hold.join().unwrap().is_done() && floor.join().unwrap().is_done());
}

#[test]
fn a_run_that_is_over_answers_so() {
    let (handle, inbox) = channel();
    drop(inbox);
    let answer = handle.ask(&request("arm", 1, Action::Hold));
    assert_eq!(answer.why(), Some(&Why::Ended));
    let json = serde_json::to_value(&answer).unwrap();
    assert_eq!(
        (json["outcome"].as_str(), json["why"].as_str()),
        (Some("refused"), Some("ended"))
    );
}

#[test]
fn every_action_is_read_as_it_is_written() {
    for name in Action::NAMES {
        let floor = if name == "set_floor" {
            r#","floor_n":2.5"#
        } else {
            ""
        };
        let text = format!(r#"{{"client":"cell-3","request":1,"action":"{name}"{floor}}}"#);
        let request = Request::from_json(text.as_bytes()).unwrap();
        assert_eq!(request.action.name(), name);
        assert_eq!(request.client, "cell-3".parse::<Client>().unwrap());
    }
}

#[test]
fn what_cannot_be_read_names_key_found_and_expected() {
    for (text, parts) in [
        ("", ["found no JSON", "expected an object"]),
        ("[1]", ["found an array", "expected an object"]),
        (
            r#"{"request":1,"action":"hold"}"#,
            ["client: found nothing", "a string"],
        ),
        (
            r#"{"client":"a b","request":1,"action":"hold"}"#,
            ["client: found \"a b\"", "expected 1 to 64"],
        ),
        (
            r#"{"client":"a","request":-1,"action":"hold"}"#,
            ["request: found -1", "whole number"],
        ),
        (
            r#"{"client":"a","request":1,"action":"open"}"#,
            ["action: found open", "one of hold, release"],
        ),
        (
            r#"{"client":"a","request":1,"action":"set_floor"}"#,
            ["floor_n: found nothing", "newtons"],
        ),
        (
            r#"{"client":"a","request":1,"action":"hold","floor_n":1}"#,
            ["floor_n: found it beside action hold", "set_floor only"],
        ),
        (
            r#"{"client":"a","request":1,"action":"hold","take_over":1}"#,
            ["take_over: found 1", "true or false"],
        ),
        (
            r#"{"client":"a","request":1,"action":"hold","force":1}"#,
            ["force: found a key", "one of client"],
        ),
    ] {
        let error = Request::from_json(text.as_bytes()).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{text}: {error}");
    }
}

proptest! {
    #[test]
    fn no_bytes_make_a_panic_and_what_is_read_is_within_bounds(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        if let Ok(request) = Request::from_json(&bytes) {
            prop_assert!((1..=64).contains(&request.client.name().len()));
        }
    }

    #[test]
    fn nor_do_almost_right_requests(
        client in ".{0,70}",
        number in any::<i64>(),
        action in "hold|release|set_floor|yield|[a-z]{0,12}",
        floor in prop::option::of(any::<f64>()),
    ) {
        let mut value = serde_json::json!({"client": client, "request": number, "action": action});
        if let Some(floor) = floor {
            value["floor_n"] = serde_json::json!(floor);
        }
        match Request::from_json(value.to_string().as_bytes()) {
            Ok(request) => {
                prop_assert!(number >= 0);
                if let Action::SetFloor { newtons } = request.action {
                    prop_assert!(newtons.is_finite());
                }
            }
            Err(error) => prop_assert!(error.to_string().contains("expected")),
        }
    }
}
