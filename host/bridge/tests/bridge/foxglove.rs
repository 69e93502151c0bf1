//! Foxglove's WebSocket as another program sees it: a Python client, without the SDK that serves it. Needs the feature `foxglove`
//! and the Python that `cargo xtask test --all` and `--foxglove` make (`FOXGLOVE_TEST_PYTHON`).

use crate::program::{ends, gripline};

#[test]
fn an_address_without_a_port_is_reported() {
    let said = ends(
        &gripline(&["run", "--seconds", "0.1", "--foxglove", "localhost"]),
        2,
    );
    assert!(said.contains("--foxglove") && said.contains("a port"), "{said}");
}

#[cfg(not(feature = "foxglove"))]
#[test]
fn a_build_without_it_says_how_to_get_it() {
    let output = gripline(&["run", "--seconds", "0.1", "--foxglove", "127.0.0.1:0"]);
    let said = ends(&output, 2);
    assert!(said.contains("--features foxglove"), "{said}");
}

#[cfg(feature = "foxglove")]
mod live {
    use std::collections::BTreeMap;
    use std::fs::{self, File};
    use std::io::{BufRead as _, BufReader};
    use std::path::Path;
    use std::process::{Child, ChildStderr, Command, Stdio};
    use std::thread::{self, JoinHandle};

    use serde_json::{Value, json};

    use super::*;

    const PEER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/foxglove_peer.py");
    const SECONDS: &str = "8";
    const FRAMES: usize = 480;

    /// A run of the simulated scene that serves Foxglove.
    struct Run {
        child: Child,
        address: String,
        said: JoinHandle<Vec<String>>,
        folder: tempfile::TempDir,
    }

    impl Run {
        fn start(arguments: &[&str]) -> Self {
            let folder = tempfile::tempdir().unwrap();
            let lines = File::create(folder.path().join("lines.json")).unwrap();
            let mut child = Command::new(env!("CARGO_BIN_EXE_gripline"))
                .args(["run", "--json", "--seconds", SECONDS])
                .args(["--foxglove", "127.0.0.1:0"])
                .args(arguments)
                .current_dir(folder.path())
                .stdout(lines)
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            let mut said = BufReader::new(child.stderr.take().unwrap());
            let address = Self::address(&mut said);
            let said = thread::spawn(move || said.lines().map_while(Result::ok).collect());
            Self {
                child,
                address,
                said,
                folder,
            }
        }

        fn address(said: &mut BufReader<ChildStderr>) -> String {
            let mut line = String::new();
            while said.read_line(&mut line).unwrap() > 0 {
                if let Some((_, address)) = line.split_once("Foxglove at ws://") {
                    return address.trim().to_owned();
                }
                line.clear();
            }
            panic!("it does not say where it listens");
        }

        /// Its frames, its summary and what it said, when it is over.
        fn ended(mut self) -> (Vec<Value>, Value, String, tempfile::TempDir) {
            let status = self.child.wait().unwrap();
            let said = self.said.join().unwrap().join("\n");
            assert!([Some(0), Some(3)].contains(&status.code()), "{status}: {said}");
            let text = fs::read_to_string(self.folder.path().join("lines.json")).unwrap();
            let mut lines: Vec<Value> = text
                .lines()
                .map(|line| serde_json::from_str(line).unwrap())
                .collect();
            let summary = lines.pop().unwrap();
            (lines, summary, said, self.folder)
        }
    }

    fn peer(arguments: &[&str]) -> Child {
        let python = std::env::var_os("FOXGLOVE_TEST_PYTHON")
            .expect("FOXGLOVE_TEST_PYTHON names a Python with websockets and protobuf: run `cargo xtask test --foxglove`");
        Command::new(python)
            .arg(PEER)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap()
    }

    fn seen_by(peer: Child) -> Value {
        let output = peer.wait_with_output().unwrap();
        assert!(output.status.success(), "the client failed, see above");
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Topic, encoding, schema and its text, as a recording has them.
    fn channels_of(recording: &Path) -> BTreeMap<String, Value> {
        let bytes = fs::read(recording).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let channels = summary.channels.values().map(|channel| {
            let schema = channel.schema.as_ref().unwrap();
            let described = json!({
                "topic": channel.topic, "encoding": channel.message_encoding, "schema_name": schema.name,
                "schema": schema.data,
            });
            (channel.topic.clone(), described)
        });
        channels.collect()
    }

    /// Times and bodies of a topic's messages.
    fn messages<'a>(seen: &'a Value, topic: &str) -> Vec<(u64, &'a Value)> {
        let list = seen["seen"][topic].as_array().unwrap();
        list.iter()
            .map(|message| (message[0].as_u64().unwrap(), &message[1]))
            .collect()
    }

    #[test]
    #[ignore = "needs a Python with websockets: cargo xtask test --foxglove"]
    fn a_viewer_sees_the_channels_of_a_recording_and_the_values_of_json() {
        let run = Run::start(&["--record", "run.mcap"]);
        let viewer = peer(&[&run.address]);
        // Nobody else can listen there meanwhile.
        let taken = gripline(&["run", "--seconds", "0.1", "--foxglove", &run.address]);
        let said = ends(&taken, 1);
        assert!(
            said.contains(&format!("foxglove.listen {}", run.address)) && said.contains("no other program"),
            "{said}"
        );
        let seen = seen_by(viewer);
        let (lines, _, said, folder) = run.ended();
        assert_eq!(lines.len(), FRAMES, "{said}");

        // It can be read, and nothing else.
        assert_eq!(seen["info"]["capabilities"], json!([]), "{}", seen["info"]);
        let described: BTreeMap<_, _> = seen["channels"]
            .as_array()
            .unwrap()
            .iter()
            .map(|channel| (channel["topic"].as_str().unwrap().to_owned(), channel.clone()))
            .collect();
        assert_eq!(described, channels_of(&folder.path().join("run.mcap")));
        for (topic, schema) in [
            ("/rest", "foxglove.RawImage"),
            ("/picture", "foxglove.RawImage"),
            ("/force_map", "foxglove.Grid"),
            ("/events", "foxglove.Log"),
            ("/status", "gripline.Status"),
        ] {
            assert_eq!(described[topic]["schema_name"], schema);
            let times: Vec<u64> = messages(&seen, topic).iter().map(|(time, _)| *time).collect();
            assert!(!times.is_empty() && times.is_sorted(), "{topic}: {times:?}");
        }

        // Those who come late see the pictures at rest too.
        assert_eq!(messages(&seen, "/rest").len(), 16);
        let statuses = messages(&seen, "/status");
        assert!(statuses.len() > FRAMES / 2, "{} of {FRAMES}", statuses.len());
        let mut touched = 0;
        for (time_ns, status) in &statuses {
            let line = &lines[status["frame"].as_u64().unwrap() as usize];
            for (key, value) in line.as_object().unwrap() {
                assert_eq!(&status[key], value, "{key} of {line}");
            }
            let start_ns = *time_ns as f64 - line["t_s"].as_f64().unwrap() * 1e9;
            assert!((start_ns - statuses[0].0 as f64).abs() < 10e9, "{start_ns}");
            touched += usize::from(line["contact"].as_u64() > Some(0));
        }
        assert!(touched > FRAMES / 4, "{touched}");
        agree(&messages(&seen, "/force_map"), &statuses);
        for (time_ns, picture) in messages(&seen, "/picture") {
            assert_eq!(
                (&picture["stamp"], &picture["size"], &picture["encoding"]),
                (
                    &json!(time_ns),
                    &json!([440, 440, 440, 440 * 440]),
                    &json!("mono8")
                )
            );
            assert!(picture["mean"].as_f64() > Some(10.0), "{picture}");
        }
        let (_, event) = messages(&seen, "/events")[0];
        assert!(
            event["message"].as_str().is_some_and(|text| !text.is_empty()),
            "{event}"
        );
    }

    /// Maps add up to what the microcontroller made of them.
    fn agree(maps: &[(u64, &Value)], statuses: &[(u64, &Value)]) {
        let statuses: BTreeMap<_, _> = statuses.iter().copied().collect();
        let mut compared = 0;
        for (time_ns, map) in maps {
            assert_eq!(
                (&map["stamp"], &map["cells"]),
                (&json!(time_ns), &json!(400)),
                "{map}"
            );
            // A map that came late was not sent.
            let Some(status) = statuses.get(time_ns).filter(|status| status["late"].is_null()) else {
                continue;
            };
            for (axis, key) in ["fx", "fy", "fn"].into_iter().enumerate() {
                let [sum, reported] = [&map["sum"][axis], &status[key]].map(|value| value.as_f64().unwrap());
                assert!(
                    (sum - reported).abs() < 1e-6,
                    "{key}: {sum} and {reported} in {status}"
                );
            }
            compared += usize::from(status["contact"].as_u64() > Some(0));
        }
        assert!(compared > FRAMES / 4, "{compared}");
    }

    fn late(summary: &Value) -> u64 {
        ["pictures_late", "maps_late"]
            .iter()
            .map(|key| summary[key].as_u64().unwrap())
            .sum()
    }

    #[test]
    #[ignore = "needs a Python with websockets: cargo xtask test --foxglove"]
    fn a_viewer_that_stalls_holds_up_neither_the_loop_nor_another_viewer() {
        let (_, alone, ..) = Run::start(&[]).ended();
        let run = Run::start(&[]);
        let mut stalled = peer(&[&run.address, "stall"]);
        let mut ready = String::new();
        BufReader::new(stalled.stdout.as_mut().unwrap())
            .read_line(&mut ready)
            .unwrap();
        let seen = seen_by(peer(&[&run.address]));
        let (lines, summary, said, _) = run.ended();
        let _ = stalled.kill();
        let _ = stalled.wait();

        // The server had to drop what the first viewer does not read.
        assert!(said.contains("outbox for client"), "{said}");
        assert_eq!(lines.len(), FRAMES, "{said}");
        assert!(
            late(&summary) <= late(&alone) + FRAMES as u64 / 20,
            "{summary}, alone {alone}"
        );
        let statuses = messages(&seen, "/status");
        let last = statuses.last().unwrap().1["frame"].as_u64().unwrap() as usize;
        assert!(
            last + 10 > FRAMES && statuses.len() > FRAMES / 4,
            "{last}, {}",
            statuses.len()
        );
    }
}
