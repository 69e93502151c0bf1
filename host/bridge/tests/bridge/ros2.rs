//! ROS 2 as other programs see it: a bag read by the Python package rosbags, and (with the feature `ros2`) a run read and asked by
//! another implementation of DDS. Needs the Python that `cargo xtask test --all` and `--ros2` make (`ROS2_TEST_PYTHON`).

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::program::{ends, gripline};

fn text(path: &Path) -> &str {
    path.to_str().expect("paths of tests are UTF-8")
}

/// What Python prints, as JSON.
fn python(arguments: &[&str]) -> Value {
    let python = std::env::var_os("ROS2_TEST_PYTHON")
        .expect("ROS2_TEST_PYTHON names a Python with cyclonedds and rosbags: run `cargo xtask test --ros2`");
    let output = Command::new(python).args(arguments).output().unwrap();
    ends(&output, 0);
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn names_domains_and_values_that_ros_does_not_allow_are_refused() {
    for (arguments, words) in [
        (["--ros2-name", "cell-3/left"], "cell_3/left"),
        (["--ros2-domain", "233"], "0 to 232"),
        (["--ros2-range", "world"], "localhost or subnet"),
        (["--ros2-rmw", "zenoh"], "fastrtps or cyclonedds"),
    ] {
        let output = gripline(&["run", "--seconds", "0.1", arguments[0], arguments[1]]);
        let said = ends(&output, 2);
        assert!(said.contains(words), "{said}");
    }
}

mod slow {
    use super::*;

    /// Reads a bag with its own definitions, and holds it against the arrays and the table of the same recording.
    const BAG: &str = r#"
import csv, json, sys
import numpy as np
from pathlib import Path
from rosbags.highlevel import AnyReader
bag, arrays = map(Path, sys.argv[1:])
maps = np.load(arrays / "maps.npy")
rows = list(csv.DictReader(open(arrays / "frames.csv")))
counts, stamps, wrong = {}, [], []
read = {}
with AnyReader([bag]) as reader:
    for connection, time, raw in reader.messages():
        message = reader.deserialize(raw, connection.msgtype)
        counts[connection.topic] = counts.get(connection.topic, 0) + 1
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == time, (connection.topic, time)
        read.setdefault(connection.topic, []).append(message)
    types = {c.topic: c.msgtype for c in reader.connections}
tip = "/cell_3/left/fingertip_0/"
places = (np.arange(20) - 9.5) * 1.6e-3
x, y = np.meshgrid(places, places)
for wrench, image, slip, expected, row in zip(read[tip + "wrench"], read[tip + "force_map"], read[tip + "slip"], maps, rows, strict=True):
    assert wrench.header == image.header == slip.header
    assert image.header.frame_id == "cell_3/left/fingertip_0" and image.encoding == "32FC3"
    forces = image.data.view("<f4").reshape(image.height, image.width, 3)
    assert image.step == 12 * image.width
    assert np.array_equal(forces, expected.transpose(1, 2, 0))
    fx, fy, fz = (forces[..., axis].astype(float) for axis in range(3))
    force, torque = wrench.wrench.force, wrench.wrench.torque
    for found, wanted in [
        (force.x, fx.sum()), (force.y, fy.sum()), (force.z, -fz.sum()),
        (torque.x, -(y * fz).sum()), (torque.y, (x * fz).sum()), (torque.z, (x * fy - y * fx).sum()),
    ]:
        assert abs(found - wanted) < 1e-9, (found, wanted)
    assert slip.frame == int(row["frame"]) and slip.line == float(row["line_n"])
    assert [slip.NO_CONTACT, slip.STICK, slip.INCIPIENT, slip.SLIP].index(slip.state) == ["NO_CONTACT", "STICK", "INCIPIENT", "SLIP"].index(row["state"])
    assert slip.slip_evidence == float(row["slip_evidence"])
    assert np.isnan(slip.stick_ratio) if row["stick_ratio"] == "" else slip.stick_ratio == float(row["stick_ratio"])
    assert (slip.contact, slip.stick) == (int(row["contact"]), int(row["stick"]))
picture = read[tip + "picture"][0]
assert (picture.encoding, picture.width, picture.step, len(picture.data)) == ("mono8", 440, 440, 440 * 440)
names = [status.name for status in read["/diagnostics"][0].status]
touched = int(sum(abs(m).max() > 0 for m in maps))
print(json.dumps({"counts": counts, "types": types, "names": names, "touched": touched}))
"#;

    #[test]
    #[ignore = "needs a Python with rosbags: cargo xtask test --ros2"]
    fn a_bag_says_what_the_arrays_of_the_same_recording_say() {
        let folder = tempfile::tempdir().unwrap();
        let [recording, bag, arrays] = ["run.mcap", "bag", "arrays"].map(|name| folder.path().join(name));
        let run = ["run", "--unpaced", "--seconds", "4", "--record", text(&recording)];
        ends(&gripline(&run), 0);
        let export = [
            "export",
            text(&recording),
            "--out",
            text(&arrays),
            "--ros2",
            text(&bag),
            "--ros2-name",
            "cell_3/left",
        ];
        let said = gripline(&export);
        ends(&said, 0);
        // It is not written over.
        let again = ends(&gripline(&["export", text(&recording), "--ros2", text(&bag)]), 1);
        assert!(again.contains(text(&bag)), "{again}");
        let read = python(&["-c", BAG, text(&bag), text(&arrays)]);
        for (topic, kind) in [
            ("wrench", "geometry_msgs/msg/WrenchStamped"),
            ("force_map", "sensor_msgs/msg/Image"),
            ("slip", "gripline_msgs/msg/Slip"),
            ("picture", "sensor_msgs/msg/Image"),
        ] {
            let topic = format!("/cell_3/left/fingertip_0/{topic}");
            assert_eq!(
                (&read["counts"][&topic], &read["types"][&topic]),
                (&240.into(), &kind.into()),
                "{read}"
            );
        }
        assert_eq!(
            read["types"]["/diagnostics"],
            "diagnostic_msgs/msg/DiagnosticArray"
        );
        assert!(read["counts"]["/diagnostics"].as_u64() >= Some(4), "{read}");
        assert_eq!(read["names"][0], "cell_3/left: faults");
        assert!(read["touched"].as_u64() >= Some(60), "{read}");
    }
}

#[cfg(feature = "ros2")]
mod live {
    use std::fs;
    use std::io::{BufRead as _, BufReader};
    use std::process::{Child, Stdio};
    use std::sync::{Arc, Mutex};
    use std::thread;

    use gripline::source::SimulatedSource;
    use serde_json::json;

    use super::*;

    const PEER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../ros2/tests/peer.py");
    const DOMAIN: u16 = 68;

    /// A run over pictures of an untouched fingertip, in which nothing moves by itself; ends when it is dropped.
    struct Running {
        child: Child,
        lines_n: Arc<Mutex<Vec<f64>>>,
        _folder: tempfile::TempDir,
    }

    impl Running {
        fn start(name: &str) -> Self {
            let folder = tempfile::tempdir().unwrap();
            let rest = folder.path().join("rest.png");
            let mut encoder = png::Encoder::new(fs::File::create(&rest).unwrap(), 440, 440);
            encoder.set_color(png::ColorType::Grayscale);
            let crop = SimulatedSource::new(3, 60.0).rest(1).remove(0);
            encoder.write_header().unwrap().write_image_data(&crop).unwrap();
            let frames = folder.path().join("frames");
            fs::create_dir(&frames).unwrap();
            // Two minutes at 20 Hz; it is stopped long before.
            for number in 0..2_400 {
                fs::hard_link(&rest, frames.join(format!("{number:06}.png"))).unwrap();
            }
            let mut child = Command::new(env!("CARGO_BIN_EXE_gripline"))
                .args(["run", "--json", "--frames-per-second", "20", "--ros2-control"])
                .args(["--source", &format!("dir:{}", folder.path().display())])
                .args(["--ros2-name", name, "--ros2-domain", &DOMAIN.to_string()])
                .stdout(Stdio::piped())
                .spawn()
                .unwrap();
            let output = BufReader::new(child.stdout.take().unwrap());
            let lines_n = Arc::new(Mutex::new(Vec::new()));
            let its = Arc::clone(&lines_n);
            thread::spawn(move || {
                for line in output.lines().map_while(Result::ok) {
                    let frame: Value = serde_json::from_str(&line).unwrap();
                    its.lock().unwrap().extend(frame["line_n"].as_f64());
                }
            });
            Self {
                child,
                lines_n,
                _folder: folder,
            }
        }

        fn lines_n(&self) -> Vec<f64> {
            self.lines_n.lock().unwrap().clone()
        }
    }

    impl Drop for Running {
        fn drop(&mut self) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }

    fn peer(job: &Value) -> Value {
        python(&[PEER, &job.to_string()])
    }

    #[test]
    #[ignore = "needs a Python with cyclonedds: cargo xtask test --ros2"]
    fn nothing_moves_until_a_service_asks_for_it_and_only_its_owner_is_listened_to() {
        let name = format!("p{}/run", std::process::id());
        let running = Running::start(&name);
        let garbage = json!({
            "job": "garbage", "domain": DOMAIN, "control": format!("/{name}/hold"), "set_floor": format!("/{name}/set_floor"),
            "seconds": 2, "seed": 1,
        });
        peer(&garbage);
        let before = running.lines_n();
        assert!(
            !before.is_empty() && before.iter().all(|line_n| *line_n == 0.0),
            "{before:?}"
        );
        let call = |service: &str, client: &str, number: u64| json!([format!("/{name}/{service}"), {"client": client, "request": number, "take_over": false}]);
        let calls = [call("hold", "cell-3", 1), call("release", "cell-4", 1)];
        let answers = peer(&json!({"job": "call", "domain": DOMAIN, "mapping": "fastrtps", "calls": calls}));
        assert_eq!(
            [&answers[0]["done"], &answers[0]["owner"]],
            [&json!(true), &json!("cell-3")],
            "{answers}"
        );
        assert_eq!(
            [&answers[1]["why"], &answers[1]["owner"]],
            [&json!("wrong_owner"), &json!("cell-3")],
            "{answers}"
        );
        let topics = json!([
            ["slip", format!("/{name}/fingertip_0/slip")],
            ["diagnostics", "/diagnostics"]
        ]);
        let read = peer(&json!({"job": "read", "domain": DOMAIN, "topics": topics, "count": 2}));
        let slip = read["found"][0].as_array().unwrap().last().unwrap();
        assert!(slip["line"].as_f64() > Some(0.0), "{slip}");
        // The system's clock, not the run's.
        let stamp = slip["header"]["stamp"]["sec"].as_f64().unwrap();
        assert!((stamp - read["joined"].as_f64().unwrap()).abs() < 30.0, "{slip}");
        let diagnostics = &read["found"][1].as_array().unwrap().last().unwrap()["status"][0];
        assert_eq!(
            [&diagnostics["name"], &diagnostics["message"]],
            [&json!(format!("{name}: gripper")), &json!("hold")]
        );
        let owner = diagnostics["values"]
            .as_array()
            .unwrap()
            .iter()
            .find(|pair| pair["key"] == "owner");
        assert_eq!(owner.unwrap()["value"], "cell-3");
    }
}
