//! The node as another implementation of DDS sees it: Eclipse Cyclone DDS from Python, over the loopback interface. Needs the Python
//! that `cargo xtask test --ros2` makes (`ROS2_TEST_PYTHON`).

use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use gripline_control::{Action, Answer, Client, Inbox, Outcome, Request, Why, channel};
use gripline_protocol::{ForceMap, SensorId, TaxelForce};
use gripline_recording::ros2::{Namespace, Range, Rmw, Sample};
use gripline_recording::telemetry::{FrameReport, STAGES, WitnessReport};
use gripline_recording::units::Load;
use gripline_ros2::{Ros2Node, Settings};
use serde_json::{Value, json};

/// What Python says to a job.
fn peer(job: &Value) -> Value {
    let python = std::env::var_os("ROS2_TEST_PYTHON")
        .expect("ROS2_TEST_PYTHON names a Python with cyclonedds: run `cargo xtask test --ros2`");
    let said = Command::new(python)
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peer.py"))
        .arg(job.to_string())
        .output()
        .unwrap();
    assert!(
        said.status.success(),
        "{job}: {}",
        String::from_utf8_lossy(&said.stderr)
    );
    serde_json::from_slice(&said.stdout).unwrap()
}

/// A name that no other run of these tests uses at the same time.
fn namespace(name: &str) -> Namespace {
    format!("p{}/{name}", std::process::id()).parse().unwrap()
}

fn settings(namespace: &Namespace, domain: u16) -> Settings {
    Settings {
        namespace: namespace.clone(),
        domain,
        range: Range::Localhost,
        rmw: Rmw::FastRtps,
        control: true,
        fingertips: 2,
    }
}

fn sample(fingertip: SensorId, frame: u64) -> Sample {
    let mut map = Box::new(ForceMap::EMPTY);
    map.taxels[3 * 20 + 12] = TaxelForce {
        x: 4_096,
        y: -2_048,
        z: 8_192,
    };
    Sample {
        captured_ns: 1_700_000_000_000_000_000 + frame * 16_000_000,
        map,
        pitch_mm: 1.6,
        report: FrameReport {
            frame,
            sensor: fingertip,
            t_s: 0.25,
            gate: "network",
            health: vec!["too_dark"],
            normal_n: 2.0,
            shear_x_n: 1.0,
            shear_y_n: -0.5,
            shear_n: 1.118,
            moment_nmm: 0.0,
            centre_of_pressure_mm: None,
            load: Load {
                force_n: [0.0; 3],
                moment_nmm: 0.0,
                centre_of_pressure_mm: None,
            },
            contact: 300,
            stick: 75,
            stick_ratio: Some(0.25),
            coulomb_slip: true,
            state: "SLIP",
            slip_evidence: 0.75,
            witnesses: WitnessReport {
                stick_ratio: 0.5,
                unrest: 0.25,
                shear_follows: 0.125,
                motion: 0.0625,
            },
            time_to_slip_ms: Some(120),
            line_n: 6.5 + f64::from(fingertip.number()),
            latency_us: 900.0,
            stages_us: [0.0; STAGES.len()],
            faults: vec!["LINE AT CEILING", "MAPS LOST"],
            late: None,
            wire_bytes: 64,
            markers: None,
            truth: None,
        },
    }
}

/// A loop beside a node: frames at 100 Hz, requests answered and remembered.
struct Loop {
    is_over: Arc<AtomicBool>,
    asked: Arc<Mutex<Vec<Request>>>,
    worker: Option<JoinHandle<()>>,
}

impl Loop {
    /// The owner is whoever asks with `take_over`, else `somebody`.
    fn start(node: Ros2Node, inbox: Inbox) -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        let asked = Arc::new(Mutex::new(Vec::new()));
        let (its_over, its_asked) = (Arc::clone(&is_over), Arc::clone(&asked));
        let worker = thread::spawn(move || {
            let owner: Client = "somebody".parse().unwrap();
            let mut frame = 0;
            while !its_over.load(Ordering::Relaxed) {
                for fingertip in SensorId::ALL {
                    node.publish(sample(fingertip, frame));
                }
                frame += 1;
                while let Some(asked) = inbox.next() {
                    let request = asked.request.clone();
                    its_asked.lock().unwrap().push(request.clone());
                    let answer = if request.take_over {
                        Answer::to(&request, Outcome::Done, Some(&request.client), 12.5)
                    } else {
                        let why = Why::WrongOwner(owner.clone());
                        Answer::to(&request, Outcome::Refused(why), Some(&owner), 12.5)
                    };
                    asked.answer(answer);
                }
                inbox.publish(|status| {
                    status.mode = Some("hold");
                    status.frames = frame;
                    status.is_connected = true;
                    status.line_n = frame as f64;
                });
                thread::sleep(Duration::from_millis(10));
            }
        });
        Self {
            is_over,
            asked,
            worker: Some(worker),
        }
    }

    fn asked(&self) -> Vec<Request> {
        self.asked.lock().unwrap().clone()
    }
}

impl Drop for Loop {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(worker) = self.worker.take() {
            let _ = worker.join();
        }
    }
}

fn started(settings: &Settings) -> Loop {
    let (handle, inbox) = channel();
    let node = Ros2Node::start(settings, &handle).unwrap();
    Loop::start(node, inbox)
}

#[test]
#[ignore = "needs a Python with cyclonedds: cargo xtask test --ros2"]
fn another_dds_reads_every_value_and_the_time_of_capture() {
    let name = namespace("one");
    let _running = started(&settings(&name, 61));
    let topics = ["wrench", "force_map", "slip"]
        .map(|kind| json!([kind, name.fingertip_topic(SensorId::SECOND, kind)]));
    let read = peer(&json!({"job": "read", "domain": 61, "topics": topics, "count": 5}));
    let [wrenches, maps, slips] = [0, 1, 2].map(|place| read["found"][place].as_array().unwrap().clone());
    // The topics were found one after the other: a frame of which all three came.
    let is_in = |samples: &[Value], header: &Value| samples.iter().any(|sample| sample["header"] == *header);
    let wrench = wrenches
        .iter()
        .find(|wrench| is_in(&maps, &wrench["header"]) && is_in(&slips, &wrench["header"]))
        .expect("a frame of which wrench, map and slip came");
    let frame = (wrench["header"]["stamp"]["nanosec"].as_u64().unwrap()
        + 1_000_000_000 * (wrench["header"]["stamp"]["sec"].as_u64().unwrap() - 1_700_000_000))
        / 16_000_000;
    assert_eq!(
        wrench["header"]["frame_id"],
        json!(name.frame_id(SensorId::SECOND))
    );
    for (vector, expected) in [("force", [1.0, -0.5, -2.0]), ("torque", [0.0208, 0.008, 0.0084])] {
        for (axis, expected) in ["x", "y", "z"].into_iter().zip(expected) {
            let found = wrench["wrench"][vector][axis].as_f64().unwrap();
            assert!((found - expected).abs() < 1e-12, "{vector} {axis}: {found}");
        }
    }
    // The three messages of one frame have one stamp.
    let same = |samples: &[Value]| {
        samples
            .iter()
            .find(|sample| sample["header"] == wrench["header"])
            .cloned()
    };
    let map = same(&maps).expect("the map of the same frame");
    assert_eq!(
        [
            &map["height"],
            &map["width"],
            &map["encoding"],
            &map["step"],
            &map["is_bigendian"]
        ],
        [&json!(20), &json!(20), &json!("32FC3"), &json!(240), &json!(0)]
    );
    let bytes = map["data"].as_str().unwrap();
    assert_eq!(bytes.len(), 2 * 4_800);
    let taxel = 2 * (3 * 20 + 12) * 12;
    // 1, -0.5 and 2 as f32, little-endian.
    assert_eq!(&bytes[taxel..taxel + 24], "0000803f000000bf00000040");
    let slip = same(&slips).expect("what the same frame says of slip");
    for (field, expected) in [
        ("fingertip", json!(1)),
        ("frame", json!(frame)),
        ("state", json!(3)),
        ("slip_evidence", json!(0.75)),
        ("stick_ratio", json!(0.25)),
        ("contact", json!(300)),
        ("stick", json!(75)),
        ("witness_stick_ratio", json!(0.5)),
        ("witness_unrest", json!(0.25)),
        ("witness_shear_follows", json!(0.125)),
        ("witness_motion", json!(0.0625)),
        ("time_to_slip", json!(0.12)),
        ("line", json!(7.5)),
        ("health", json!(["too_dark"])),
        ("faults", json!(["LINE AT CEILING", "MAPS LOST"])),
    ] {
        assert_eq!(slip[field], expected, "{field}");
    }
    // Newer frames follow, none twice.
    let frames: Vec<_> = slips.iter().map(|slip| slip["frame"].as_u64().unwrap()).collect();
    assert!(frames.is_sorted_by(|one, next| one < next), "{frames:?}");
}

#[test]
#[ignore = "needs a Python with cyclonedds: cargo xtask test --ros2"]
fn who_joins_late_gets_the_diagnostics_that_were_said_before() {
    let name = namespace("late");
    let _running = started(&settings(&name, 62));
    // Said at the start and then once a second: without what was kept, a reader would wait for the next.
    thread::sleep(Duration::from_millis(1_500));
    let early = (0..5).any(|_| {
        let read = peer(
            &json!({"job": "read", "domain": 62, "topics": [["diagnostics", "/diagnostics"]], "count": 1}),
        );
        let joined = read["joined"].as_f64().unwrap();
        let said = |array: &&Value| {
            let stamp = &array["header"]["stamp"];
            stamp["sec"].as_f64().unwrap() + stamp["nanosec"].as_f64().unwrap() / 1e9
        };
        let arrays = read["found"][0].as_array().unwrap();
        // Of what was said before it joined, the newest.
        let Some(kept) = arrays.iter().rfind(|array| said(array) < joined) else {
            return false;
        };
        let names: Vec<_> = kept["status"]
            .as_array()
            .unwrap()
            .iter()
            .map(|status| {
                (
                    status["name"].as_str().unwrap().to_owned(),
                    status["level"].as_u64().unwrap(),
                )
            })
            .collect();
        let part = |part: &str, level| (format!("{name}: {part}"), level);
        assert_eq!(
            names,
            [
                part("gripper", 0),
                part("microcontroller", 0),
                part("faults", 0),
                part("fingertip 0", 1),
                part("fingertip 1", 1)
            ]
        );
        true
    });
    assert!(
        early,
        "five times nothing came that was said before the reader had joined"
    );
}

#[test]
#[ignore = "needs a Python with cyclonedds: cargo xtask test --ros2"]
fn two_grippers_in_two_namespaces_keep_their_topics_apart() {
    let names = ["left", "right"].map(namespace);
    let _running = names.each_ref().map(|name| started(&settings(name, 63)));
    let topics: Vec<_> = names
        .iter()
        .flat_map(|name| {
            SensorId::ALL.map(|fingertip| json!(["slip", name.fingertip_topic(fingertip, "slip")]))
        })
        .collect();
    let read = peer(&json!({"job": "read", "domain": 63, "topics": topics, "count": 3}));
    for (place, (name, fingertip)) in names
        .iter()
        .flat_map(|name| SensorId::ALL.map(|fingertip| (name, fingertip)))
        .enumerate()
    {
        for slip in read["found"][place].as_array().unwrap() {
            assert_eq!(slip["header"]["frame_id"], json!(name.frame_id(fingertip)));
            assert_eq!(slip["line"], json!(6.5 + f64::from(fingertip.number())));
        }
    }
}

/// Every service once, as the owner and as somebody else, and two requests that are none.
fn calls_every_service(rmw: Rmw, domain: u16) {
    let name = namespace("called");
    let running = started(&Settings {
        rmw,
        ..settings(&name, domain)
    });
    let actions = ["hold", "release", "acknowledge", "rezero", "take_over", "yield"];
    let mut calls: Vec<_> = (1..)
        .zip(actions)
        .map(|(number, action)| {
            let take_over = number % 2 == 0;
            json!([name.topic(action), {"client": "cell-3", "request": number, "take_over": take_over}])
        })
        .collect();
    calls.push(json!([name.topic("set_floor"), {"client": "cell-3", "request": 7, "take_over": true, "floor": 4.25}]));
    calls.push(json!([name.topic("hold"), {"client": "two words", "request": 8, "take_over": true}]));
    calls.push(json!([name.topic("hold"), {"client": "", "request": 9, "take_over": true}]));
    let mapping = rmw.to_string();
    let answers = peer(&json!({"job": "call", "domain": domain, "mapping": mapping, "calls": calls}));
    let answers = answers.as_array().unwrap();
    for (number, (answer, action)) in (1_u64..).zip(
        answers
            .iter()
            .zip(actions.into_iter().chain(["set_floor 4.25 N"])),
    ) {
        let is_owner = number % 2 == 0 || number == 7;
        let (why, owner) = if is_owner {
            ("", "cell-3")
        } else {
            ("wrong_owner", "somebody")
        };
        assert_eq!(
            [
                &answer["done"],
                &answer["why"],
                &answer["owner"],
                &answer["client"],
                &answer["request"]
            ],
            [
                &json!(is_owner),
                &json!(why),
                &json!(owner),
                &json!("cell-3"),
                &json!(number)
            ],
            "{answer}"
        );
        assert_eq!(answer["took"], json!(0.0125));
        assert!(
            answer["message"]
                .as_str()
                .unwrap()
                .starts_with(&format!("cell-3: {action} ")),
            "{answer}"
        );
    }
    for (answer, number) in answers[7..].iter().zip([8, 9]) {
        assert_eq!(
            [&answer["done"], &answer["why"], &answer["request"]],
            [&json!(false), &json!("bad_request"), &json!(number)]
        );
    }
    // Nothing but the seven reached the loop, in their order.
    let asked: Vec<_> = running
        .asked()
        .into_iter()
        .map(|request| (request.number, request.action, request.client.to_string()))
        .collect();
    let expected = [
        Action::Hold,
        Action::Release,
        Action::Acknowledge,
        Action::Rezero,
        Action::TakeOver,
        Action::Yield,
        Action::SetFloor { newtons: 4.25 },
    ];
    let expected: Vec<_> = (1..)
        .zip(expected)
        .map(|(number, action)| (number, action, "cell-3".to_owned()))
        .collect();
    assert_eq!(asked, expected);
}

#[test]
#[ignore = "needs a Python with cyclonedds: cargo xtask test --ros2"]
fn services_answer_clients_of_the_standard_mapping() {
    calls_every_service(Rmw::FastRtps, 64);
}

#[test]
#[ignore = "needs a Python with cyclonedds: cargo xtask test --ros2"]
fn services_answer_clients_of_cyclones_mapping() {
    calls_every_service(Rmw::CycloneDds, 65);
}

#[test]
#[ignore = "needs a Python with cyclonedds: cargo xtask test --ros2"]
fn what_is_no_request_moves_nothing_and_stops_nothing() {
    let name = namespace("garbage");
    let seconds = std::env::var("ROS2_TEST_GARBAGE_S").map_or(3.0, |seconds| seconds.parse().unwrap());
    for (rmw, domain) in [(Rmw::FastRtps, 66), (Rmw::CycloneDds, 67)] {
        let running = started(&Settings {
            rmw,
            ..settings(&name, domain)
        });
        let job = json!({
            "job": "garbage", "domain": domain, "control": name.topic("hold"), "set_floor": name.topic("set_floor"),
            "seconds": seconds, "seed": domain,
        });
        let sent = peer(&job)["sent"].as_u64().unwrap();
        assert!(sent > 1_000, "{sent}");
        assert_eq!(running.asked(), []);
        // It still works.
        let call = json!([name.topic("hold"), {"client": "cell-3", "request": 1, "take_over": true}]);
        let mapping = rmw.to_string();
        let answers = peer(&json!({"job": "call", "domain": domain, "mapping": mapping, "calls": [call]}));
        assert_eq!(answers[0]["done"], json!(true));
        assert_eq!(running.asked().len(), 1);
        let topics = json!([["slip", name.fingertip_topic(SensorId::FIRST, "slip")]]);
        peer(&json!({"job": "read", "domain": domain, "topics": topics, "count": 2}));
        println!("{rmw}: {sent} pieces of garbage in {seconds} s");
    }
}
