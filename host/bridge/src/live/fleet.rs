//! Frames of many grippers in one place, over zenoh: every frame's report as JSON under `gripline/NAME/frame`, what the run is
//! under `gripline/NAME/about`, once a second. docs/zenoh.md has keys and payloads. The feature `zenoh` adds the library; without
//! it the configuration keys exist, and using them is an error that explains how to build it.
//!
//! The loop never waits: it queues frames for a separate thread, and drops and counts them when the queue is full.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};

use crate::error::Error;
use gripline_recording::telemetry::FrameReport;

/// Frames that wait for the network.
const WAITING: usize = 64;
/// Frames from one `about` to the next: a second's.
const ABOUT_EVERY: u64 = 60;
/// Prefix of every gripper's name.
const PREFIX: &str = "gripline";

/// Its configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct FleetSettings {
    /// The gripper's name, part of every key.
    pub name: String,
    /// Where another peer or a router listens, such as `tcp/192.0.2.1:7447`.
    pub connect: Option<String>,
    /// Where this one listens.
    pub listen: Option<String>,
}

/// A publisher, as long as the run lives.
pub(crate) struct Fleet {
    sender: Option<SyncSender<FrameReport>>,
    worker: Option<JoinHandle<()>>,
    /// Frames dropped because the queue was full.
    dropped: u64,
}

impl Fleet {
    /// Joins the network. `about` is what the run is, as JSON.
    ///
    /// # Errors
    /// [`Error`] when an endpoint cannot be used, or this program was built without zenoh.
    pub(crate) fn start(settings: &FleetSettings, about: String) -> Result<Self, Error> {
        let put = open(settings)?;
        Ok(Self::with(&settings.name, about, put))
    }

    /// The same with any function that puts bytes under a key.
    fn with(name: &str, about: String, mut put: impl FnMut(&str, &str) + Send + 'static) -> Self {
        let (sender, frames): (_, Receiver<FrameReport>) = sync_channel(WAITING);
        let [about_key, frame_key] = ["about", "frame"].map(|part| format!("{PREFIX}/{name}/{part}"));
        let worker = thread::spawn(move || {
            for (number, report) in (0_u64..).zip(frames) {
                if number.is_multiple_of(ABOUT_EVERY) {
                    put(&about_key, &about);
                }
                if let Ok(text) = serde_json::to_string(&report) {
                    put(&frame_key, &text);
                }
            }
        });
        Self {
            sender: Some(sender),
            worker: Some(worker),
            dropped: 0,
        }
    }

    /// Leaves a frame for the network, if there is room.
    pub(crate) fn publish(&mut self, report: &FrameReport) {
        let Some(sender) = &self.sender else {
            return;
        };
        if let Err(TrySendError::Full(_)) = sender.try_send(report.clone()) {
            self.dropped += 1;
        }
    }
}

impl Drop for Fleet {
    fn drop(&mut self) {
        self.sender = None;
        if let Some(worker) = self.worker.take() {
            // A worker that panicked has said so.
            let _ = worker.join();
        }
        if self.dropped > 0 {
            tracing::warn!("{} frames found no room on their way to zenoh", self.dropped);
        }
    }
}

/// A gripper's name: parts of a key, joined by slashes.
pub(crate) fn check_name(text: &str) -> Result<(), String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if text.len() <= 100
        && text
            .split('/')
            .all(|part| !part.is_empty() && part.chars().all(plain))
    {
        return Ok(());
    }
    Err(format!(
        "found {text}, expected a name of letters, digits, - _ and ., in parts joined by /, such as cell-3/left"
    ))
}

/// An endpoint of zenoh: only TCP is built in.
pub(crate) fn check_endpoint(text: &str) -> Result<(), String> {
    let port = text
        .strip_prefix("tcp/")
        .and_then(|address| address.rsplit_once(':'))
        .filter(|(host, _)| !host.is_empty())
        .and_then(|(_, port)| port.parse::<u16>().ok());
    match port {
        Some(_) => Ok(()),
        None => Err(format!(
            "found {text}, expected an endpoint such as tcp/192.0.2.1:7447"
        )),
    }
}

#[cfg(not(feature = "zenoh"))]
fn open(_settings: &FleetSettings) -> Result<impl FnMut(&str, &str) + Send + 'static, Error> {
    Err::<fn(&str, &str), _>(Error::usage(
        "zenoh.name (--zenoh-name): this gripline was built without zenoh, expected one that has it: `cargo build --release \
         --features zenoh`",
    ))
}

#[cfg(feature = "zenoh")]
fn open(settings: &FleetSettings) -> Result<impl FnMut(&str, &str) + Send + 'static, Error> {
    use zenoh::Wait as _;
    use zenoh::bytes::Encoding;
    use zenoh::qos::CongestionControl;

    let session = session(settings)?;
    Ok(move |key: &str, text: &str| {
        // Nobody listens, or the network is gone: the next frame comes in a moment.
        let _ = session
            .put(key, text)
            .encoding(Encoding::APPLICATION_JSON)
            .congestion_control(CongestionControl::Drop)
            .wait();
    })
}

/// A peer that never waits. Without an endpoint it finds others of its network by multicast.
#[cfg(feature = "zenoh")]
fn session(settings: &FleetSettings) -> Result<zenoh::Session, Error> {
    use zenoh::Wait as _;

    let failed = |error: zenoh::Error| {
        Error::failed(format!(
            "zenoh: {error}, expected endpoints of this machine (zenoh.listen) that no other program listens on"
        ))
    };
    let alone = settings.connect.is_none() && settings.listen.is_none();
    let list = |endpoint: &Option<String>| serde_json::json!(endpoint.iter().collect::<Vec<_>>()).to_string();
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"peer\"".to_owned()),
        ("scouting/multicast/enabled", alone.to_string()),
        ("connect/endpoints", list(&settings.connect)),
        ("connect/exit_on_failure", "false".to_owned()),
        ("connect/timeout_ms", "0".to_owned()),
        ("listen/endpoints", list(&settings.listen)),
    ] {
        config.insert_json5(key, &value).map_err(failed)?;
    }
    zenoh::open(config).wait().map_err(failed)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;
    use crate::view::tests::report;

    #[test]
    fn a_slow_network_costs_frames_and_never_time() {
        let (entered, inside) = channel();
        let (go, gate) = channel::<()>();
        let mut fleet = Fleet::with("a", "{}".to_owned(), move |_, _| {
            let _ = entered.send(());
            // Stands still until the test lets it go.
            let _ = gate.recv();
        });
        fleet.publish(&report(0));
        inside.recv().unwrap();
        for frame in 1..=200 {
            fleet.publish(&report(frame));
        }
        assert_eq!(fleet.dropped, 200 - WAITING as u64);
        drop(go);
    }

    #[test]
    fn frames_go_out_in_order_under_the_grippers_name_with_about_once_a_second() {
        let (sent, put) = channel();
        let mut fleet = Fleet::with("cell-3/left", "{\"gripline\":1}".to_owned(), move |key, text| {
            sent.send((key.to_owned(), text.to_owned())).unwrap();
        });
        let mut all = Vec::new();
        for frame in 0..61 {
            fleet.publish(&report(frame));
            // One at a time, so that none finds the way full.
            loop {
                let (key, text) = put.recv().unwrap();
                let is_frame = key == "gripline/cell-3/left/frame";
                all.push((key, text));
                if is_frame {
                    break;
                }
            }
        }
        let abouts = all
            .iter()
            .filter(|(key, text)| key == "gripline/cell-3/left/about" && text == "{\"gripline\":1}");
        assert_eq!((abouts.count(), all.len()), (2, 63));
        let last: serde_json::Value = serde_json::from_str(&all[62].1).unwrap();
        assert_eq!(last["frame"], 60);
    }

    #[test]
    fn names_and_endpoints_that_cannot_be_used_are_refused() {
        for name in ["left", "cell-3/left", "a.b_c/1"] {
            assert_eq!(check_name(name), Ok(()));
        }
        for name in ["", "/left", "left/", "a//b", "*", "a/**", "ä", "a b"] {
            assert!(check_name(name).unwrap_err().contains("cell-3/left"), "{name}");
        }
        for endpoint in ["tcp/192.0.2.1:7447", "tcp/[::1]:7447", "tcp/router:1"] {
            assert_eq!(check_endpoint(endpoint), Ok(()));
        }
        for endpoint in [
            "192.0.2.1:7447",
            "udp/192.0.2.1:7447",
            "tcp/:7447",
            "tcp/a",
            "tcp/a:99999",
        ] {
            assert!(
                check_endpoint(endpoint)
                    .unwrap_err()
                    .contains("tcp/192.0.2.1:7447"),
                "{endpoint}"
            );
        }
    }

    #[cfg(feature = "zenoh")]
    #[test]
    fn frames_of_two_grippers_arrive_at_one_subscriber_over_tcp() {
        use std::collections::HashMap;
        use std::net::TcpListener;
        use std::time::{Duration, Instant};

        use zenoh::Wait as _;

        // A port that was free a moment ago.
        let port = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port();
        let endpoint = format!("tcp/127.0.0.1:{port}");
        let settings = |name: &str, connect: Option<&str>, listen: Option<&str>| FleetSettings {
            name: name.to_owned(),
            connect: connect.map(str::to_owned),
            listen: listen.map(str::to_owned),
        };
        let place = session(&settings("place", None, Some(&endpoint))).unwrap();
        let subscriber = place.declare_subscriber("gripline/**").wait().unwrap();
        let mut left = Fleet::start(
            &settings("cell/left", Some(&endpoint), None),
            "{\"side\":\"left\"}".into(),
        )
        .unwrap();
        let mut right = Fleet::start(&settings("cell/right", Some(&endpoint), None), "{}".into()).unwrap();
        let mut newest: HashMap<String, serde_json::Value> = HashMap::new();
        let end = Instant::now() + Duration::from_secs(20);
        let wanted = ["left/frame", "left/about", "right/frame", "right/about"]
            .map(|key| format!("gripline/cell/{key}"));
        let mut frame = 0;
        // The first frames find nobody who listens yet.
        while !wanted.iter().all(|key| newest.contains_key(key)) {
            assert!(Instant::now() < end, "only {:?} came", newest.keys());
            left.publish(&report(frame));
            right.publish(&report(frame));
            frame += 1;
            if let Ok(Some(sample)) = subscriber.recv_timeout(Duration::from_millis(5)) {
                let text = sample.payload().try_to_string().unwrap().into_owned();
                assert_eq!(sample.encoding(), &zenoh::bytes::Encoding::APPLICATION_JSON);
                newest.insert(
                    sample.key_expr().to_string(),
                    serde_json::from_str(&text).unwrap(),
                );
            }
        }
        assert_eq!(newest["gripline/cell/left/about"]["side"], "left");
        let report = &newest["gripline/cell/right/frame"];
        assert_eq!(
            (report["state"].as_str(), report["fn"].as_f64()),
            (Some("NO_CONTACT"), Some(0.0))
        );
    }

    #[cfg(not(feature = "zenoh"))]
    #[test]
    fn without_the_feature_it_says_how_to_build_it() {
        let settings = FleetSettings {
            name: "left".to_owned(),
            connect: None,
            listen: None,
        };
        let error = Fleet::start(&settings, String::new()).err().unwrap().to_string();
        assert!(error.contains("--features zenoh"), "{error}");
    }
}
