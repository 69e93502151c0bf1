//! `gripline simulate` as other programs see it: the built binary, its folder, its messages, its exit codes.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

const SCENE: &str = r#"kind = "press"
frames_per_second = 20
frames = "crop"

[sensor]
unit = 4

[indenter]
shape = "sphere"
friction = 0.6

[[path]]
name = "press"
seconds = 0.3
press_n = 2.0
at_mm = [3.0, -2.0]

[[path]]
name = "drag"
seconds = 0.3
at_mm = [4.0, -2.0]
"#;

/// A folder of its own for every test, with the scene in it.
fn folder(test: &str, scene: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("simulate").join(test);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    fs::write(path.join("scene.toml"), scene).unwrap();
    path
}

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gripline"));
    command
        .current_dir(folder)
        .args(["simulate", "scene.toml"])
        .args(arguments);
    command
}

fn simulate(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().unwrap()
}

fn done(folder: &Path, arguments: &[&str]) -> String {
    let output = simulate(folder, arguments);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// The last line on standard error of a run that must fail.
fn refused(folder: &Path, arguments: &[&str], code: i32) -> String {
    let output = simulate(folder, arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
    assert_eq!(output.stdout, b"", "{arguments:?}");
    text.lines().last().unwrap_or_default().to_owned()
}

/// Every file under a folder, by its name in it.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                found.insert(
                    path.strip_prefix(folder).unwrap().to_owned(),
                    fs::read(&path).unwrap(),
                );
            }
        }
    }
    found
}

/// The rows of a table: column name to text.
fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            assert_eq!(cells.len(), names.len(), "{line}");
            names
                .iter()
                .zip(cells)
                .map(|(name, cell)| ((*name).to_owned(), cell.to_owned()))
                .collect()
        })
        .collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column]
        .parse()
        .unwrap_or_else(|_| panic!("{column}: {:?}", row[column]))
}

/// Shape and numbers of a C-ordered little-endian float32 file.
fn npy(path: &Path) -> (String, Vec<f32>) {
    let bytes = fs::read(path).unwrap();
    let length = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8(bytes[10..length].to_vec()).unwrap();
    assert!(
        header.contains("'descr': '<f4'") && header.contains("'fortran_order': False"),
        "{header}"
    );
    let shape = header[header.find("'shape': ").unwrap() + 9..=header.rfind(')').unwrap()].to_owned();
    let numbers = bytes[length..]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect();
    (shape, numbers)
}

#[test]
fn maps_truth_and_frames_belong_together_and_are_in_balance() {
    let folder = folder("balance", SCENE);
    let summary: serde_json::Value =
        serde_json::from_str(&done(&folder, &["--out", "out", "--json"])).unwrap();
    assert_eq!(
        (&summary["frames"], &summary["unsolved"]),
        (&12.into(), &0.into())
    );
    let (shape, numbers) = npy(&folder.join("out/maps.npy"));
    assert_eq!(shape.replace(' ', "").replace(",)", ")"), "(12,3,20,20)");
    let rows = rows(&folder.join("out/truth.csv"));
    assert_eq!(rows.len(), 12);
    for (frame, row) in rows.iter().enumerate() {
        assert_eq!(row["frame"], frame.to_string());
        assert!((number(row, "time_s") - 0.05 * (frame + 1) as f64).abs() < 1e-9);
        assert_eq!(row["phase"], if frame < 6 { "press" } else { "drag" });
        let map = &numbers[frame * 1200..(frame + 1) * 1200];
        let sums: Vec<f64> = map
            .chunks_exact(400)
            .map(|axis| axis.iter().map(|v| f64::from(*v)).sum())
            .collect();
        for (column, sum) in ["fx", "fy", "fn"].into_iter().zip(&sums) {
            assert!(
                (number(row, column) - sum).abs() < 1e-9,
                "{column} of frame {frame}"
            );
        }
        // The load that the scene asks for, within 0.1 %; the shear never beyond friction.
        let asked = 2.0 * ((frame + 1) as f64 / 6.0).min(1.0);
        assert!(
            (sums[2] / asked - 1.0).abs() < 1e-3,
            "{} N instead of {asked}",
            sums[2]
        );
        // Pressure leans with the sphere's slope: at its rim by up to a third, over all of it hardly.
        assert!(sums[0].hypot(sums[1]) <= 0.6 * sums[2] * 1.02);
        for taxel in 0..400 {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(map[axis * 400 + taxel]));
            assert!(
                x.hypot(y) <= (0.6 + 0.33) * z + 1e-6,
                "frame {frame}, taxel {taxel}"
            );
        }
        // A sphere of 12 mm under 2 N is 0.9 mm deep.
        assert!(number(row, "indentation") > 0.02 && number(row, "indentation") < 0.2);
        let ratio = number(row, "stick_ratio");
        assert!((0.0..=1.0).contains(&ratio) && number(row, "area_mm2") > 0.0);
    }
    let last = &rows[11];
    assert!(
        number(last, "x_mm") > 3.99 && number(last, "fx") > 0.9,
        "{last:?}"
    );
    assert!(number(last, "stick_ratio") < 0.3 && number(&rows[4], "stick_ratio") > 0.9);
    // Pictures: as many, of the asked size, and the detector takes the maps.
    for frame in 0..12 {
        let png = fs::read(folder.join(format!("out/frames/{frame:06}.png"))).unwrap();
        let info = png::Decoder::new(std::io::Cursor::new(png))
            .read_info()
            .unwrap()
            .info()
            .clone();
        assert_eq!(
            (info.width, info.height, info.color_type),
            (440, 440, png::ColorType::Grayscale)
        );
    }
    assert!(!folder.join("out/frames/000012.png").exists());
    let detected = Command::new(env!("CARGO_BIN_EXE_gripline"))
        .current_dir(&folder)
        .args(["detect", "out/maps.npy", "--csv", "detected.csv"])
        .output()
        .unwrap();
    assert!(
        detected.status.success(),
        "{}",
        String::from_utf8_lossy(&detected.stderr)
    );
    for (truth, found) in rows.iter().zip(self::rows(&folder.join("detected.csv"))) {
        // Every taxel is rounded to 1/4096 N.
        for column in ["fn", "fx", "fy"] {
            assert!(
                (number(truth, column) - number(&found, column)).abs() < 0.02,
                "{column}"
            );
        }
        assert!((number(truth, "mz") - number(&found, "mz")).abs() < 0.2);
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_another_noise_over_the_same_forces() {
    let folder = folder("seeds", SCENE);
    done(&folder, &["--out", "a", "--clip"]);
    done(&folder, &["--out", "b", "--clip", "--seed", "1"]);
    done(
        &folder,
        &["--out", "c", "--clip", "--seed", "2", "--frames", "full"],
    );
    let [a, b, c] = ["a", "b", "c"].map(|out| files(&folder.join(out)));
    assert_eq!(a.len(), 12 + 6, "{:?}", a.keys());
    assert!(a == b);
    assert_eq!(a[Path::new("maps.npy")], c[Path::new("maps.npy")]);
    assert_eq!(a[Path::new("truth.csv")], c[Path::new("truth.csv")]);
    assert_ne!(
        a[Path::new("frames/000000.png")],
        c[Path::new("frames/000000.png")]
    );
    let info = png::Decoder::new(std::io::Cursor::new(&c[Path::new("rest.png")]))
        .read_info()
        .unwrap()
        .info()
        .clone();
    assert_eq!((info.width, info.height), (640, 480));
    assert!(a[Path::new("clip.gif")].starts_with(b"GIF89a"));
    let manifest = fs::read_to_string(folder.join("c/manifest.toml")).unwrap();
    for line in [
        "scene = \"scene.toml\"",
        "seed = 2",
        "frame_size = \"full\"",
        "complete = true",
        "frames = 12",
    ] {
        assert!(manifest.contains(line), "{manifest}");
    }
}

#[test]
fn a_folder_that_holds_something_else_is_refused_and_left_as_it_is() {
    let folder = folder("others", SCENE);
    done(&folder, &["--out", "out"]);
    let before = files(&folder.join("out"));
    let crc = |text: &str| {
        let line = text.lines().find(|line| line.starts_with("scene_crc64")).unwrap();
        line.split('"').nth(1).unwrap().to_owned()
    };
    let old = crc(&String::from_utf8(before[Path::new("manifest.toml")].clone()).unwrap());
    assert_eq!(
        refused(&folder, &["--out", "out", "--seed", "9"], 2),
        "gripline: --out out: found results with seed 1, expected 9: choose another folder"
    );
    assert_eq!(
        refused(&folder, &["--out", "out", "--frames", "full"], 2),
        "gripline: --out out: found results with frame size crop, expected full: choose another folder"
    );
    fs::write(folder.join("scene.toml"), SCENE.replace("4.0", "4.5")).unwrap();
    done(&folder, &["--out", "new"]);
    let new = crc(&fs::read_to_string(folder.join("new/manifest.toml")).unwrap());
    assert_eq!(
        refused(&folder, &["--out", "out"], 2),
        format!(
            "gripline: --out out: found results with scene scene.toml ({old}), expected {new}: choose another folder"
        )
    );
    assert!(files(&folder.join("out")) == before);
    fs::create_dir(folder.join("photos")).unwrap();
    fs::write(folder.join("photos/cat.jpg"), "cat").unwrap();
    assert_eq!(
        refused(&folder, &["--out", "photos"], 2),
        "gripline: --out photos: found other files, expected an empty folder or results of this scene: choose \
         another folder"
    );
    assert_eq!(
        refused(&folder, &["--out", "scene.toml"], 2),
        "gripline: --out scene.toml: found a file, expected a folder: choose another name"
    );
    // Frames of another version of the world.
    fs::copy(
        folder.join("new/frames/000003.png"),
        folder.join("new/frames/000011.png"),
    )
    .unwrap();
    assert_eq!(
        refused(&folder, &["--out", "new"], 2),
        "gripline: --out new: found a frames/000011.png that differs from what this program makes, expected one of \
         the same version: choose another folder"
    );
}

#[test]
fn what_is_wrong_with_scene_or_arguments_is_said_in_one_line_with_its_code() {
    let folder = folder("wrong", &SCENE.replace("friction = 0.6", "fricton = 0.6"));
    assert_eq!(
        refused(&folder, &["--out", "out"], 1),
        "gripline: scene.toml:10: indenter.fricton: found a key that is not known here, expected a key of this \
         section: did you mean friction?"
    );
    assert!(!folder.join("out").exists());
    assert!(refused(&folder, &[], 2).contains("--out <DIR>"));
    assert!(refused(&folder, &["--out", "out", "--seed=-1"], 2).contains("--seed"));
    assert!(
        refused(&folder, &["--out", "out", "--frames", "half"], 2).contains("possible values: crop, full")
    );
    fs::write(folder.join("scene.toml"), [0xff, 0xfe]).unwrap();
    assert_eq!(
        refused(&folder, &["--out", "out"], 1),
        "gripline: scene.toml: found bytes that are no text, expected a scene in TOML: check the path"
    );
    fs::remove_file(folder.join("scene.toml")).unwrap();
    assert_eq!(
        refused(&folder, &["--out", "out"], 1),
        "gripline: scene.toml: found no such file, expected a scene file: check the path"
    );
    fs::create_dir(folder.join("scene.toml")).unwrap();
    assert_eq!(
        refused(&folder, &["--out", "out"], 1),
        "gripline: scene.toml: found a folder, expected a scene file: check the path"
    );
}

#[test]
fn an_indenter_that_leaves_the_sensor_on_its_way_stops_the_scene_at_its_line() {
    let scene = SCENE
        .replace("at_mm = [3.0, -2.0]", "at_mm = [11.0, -2.0]")
        .replace("at_mm = [4.0, -2.0]", "at_mm = [15.0, -2.0]");
    let folder = folder("leaves", &scene);
    let line = refused(&folder, &["--out", "out"], 1);
    let start =
        "gripline: scene.toml:18: found an indenter whose contact reaches the edge of the sensor, at (1";
    let end = " s, expected contact inside ±16 mm: move the indenter inwards or press less in this step";
    assert!(line.starts_with(start) && line.ends_with(end), "{line}");
    let manifest = fs::read_to_string(folder.join("out/manifest.toml")).unwrap();
    assert!(manifest.contains("complete = false") && !folder.join("out/maps.npy").exists());
}

const GRASP: &str = r#"kind = "grasp"
frames_per_second = 20
frames = "crop"

[grasp]
seconds = 0.5

[object]
name = "AA cell"

[policy]
kind = "fixed"
force_n = 2.0
"#;

#[test]
fn a_grasp_has_two_fingers_that_press_alike_and_comes_out_the_same_twice() {
    let folder = folder("grasp", GRASP);
    let summary: serde_json::Value = serde_json::from_str(&done(&folder, &["--out", "a", "--json"])).unwrap();
    assert_eq!(
        (&summary["frames"], &summary["fingers"], &summary["kind"]),
        (&10.into(), &2.into(), &"grasp".into())
    );
    done(&folder, &["--out", "b"]);
    let found = files(&folder.join("a"));
    assert!(found == files(&folder.join("b")));
    assert_ne!(
        found[Path::new("frames/000009.png")],
        found[Path::new("frames_1/000009.png")]
    );
    let last = rows(&folder.join("a/truth.csv")).pop().unwrap();
    assert!(
        (number(&last, "fn") - 2.0).abs() < 0.02 && (number(&last, "fn_1") - 2.0).abs() < 0.02,
        "{last:?}"
    );
    assert!((number(&last, "line_n") - 2.0).abs() < 1e-12 && last["slip"] == "0" && last["dropped"] == "0");
    for (maps, column) in [("maps.npy", "fn"), ("maps_1.npy", "fn_1")] {
        let (shape, numbers) = npy(&folder.join("a").join(maps));
        assert_eq!(shape.replace(' ', "").replace(",)", ")"), "(10,3,20,20)");
        let normal: f64 = numbers[9 * 1200 + 800..].iter().map(|v| f64::from(*v)).sum();
        assert!((normal - number(&last, column)).abs() < 1e-9);
    }
}

#[test]
fn gripline_in_the_loop_grips_harder_before_a_pull_that_its_first_grip_cannot_hold() {
    let scene = GRASP
        .replace("frames_per_second = 20", "frames_per_second = 60")
        .replace("AA cell", "golf ball")
        .replace("seconds = 0.5", "seconds = 1.0")
        .replace("\"fixed\"", "\"gripline\"")
        + "[[pull]]\nforce_n = [2.4, 0.0]\ncourse = [[0.4, 0.0], [0.7, 1.0]]\n";
    let folder = folder("gripline", &scene);
    done(&folder, &["--out", "out"]);
    let rows = rows(&folder.join("out/truth.csv"));
    assert_eq!(rows.len(), 60);
    assert!((number(&rows[22], "line_n") - 2.0).abs() < 0.3, "{:?}", rows[22]);
    let highest = rows.iter().map(|row| number(row, "line_n")).fold(0.0, f64::max);
    assert!(highest > 2.5, "{highest}");
}

/// Only `cargo xtask test --all` runs these.
mod slow {
    use super::*;

    #[test]
    fn killed_at_any_moment_it_goes_on_to_the_same_bits_and_makes_no_frame_twice() {
        let slow = SCENE.replace("frames_per_second = 20", "frames_per_second = 200");
        let folder = folder("killed", &slow);
        done(&folder, &["--out", "whole", "--clip"]);
        let whole = files(&folder.join("whole"));
        let mut kept = 0;
        for at_least in [1, 9, 40] {
            let mut child = command(&folder, &["--out", "cut", "--clip"])
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            let there = folder.join(format!("cut/frames/{:06}.png", at_least - 1));
            while !there.exists() && child.try_wait().unwrap().is_none() {
                sleep(Duration::from_millis(1));
            }
            child.kill().unwrap();
            child.wait().unwrap();
            let manifest = fs::read_to_string(folder.join("cut/manifest.toml")).unwrap();
            assert!(manifest.contains("complete = false") && there.exists());
            for (name, bytes) in files(&folder.join("cut")) {
                // What stands under its name is whole.
                if name.starts_with("frames") && name.extension().is_some_and(|end| end == "png") {
                    assert_eq!(bytes, whole[&name], "{}", name.display());
                    kept += 1;
                }
            }
        }
        assert!(kept >= 50, "{kept}");
        let first = folder.join("cut/frames/000000.png");
        let made = fs::metadata(&first).unwrap().modified().unwrap();
        let summary: serde_json::Value =
            serde_json::from_str(&done(&folder, &["--out", "cut", "--clip", "--json"])).unwrap();
        assert!(summary["resumed"].as_u64().unwrap() >= 40, "{summary}");
        assert_eq!(fs::metadata(&first).unwrap().modified().unwrap(), made);
        let mut cut = files(&folder.join("cut"));
        // A picture that the kill left half-written stands beside its place.
        cut.retain(|name, _| name.extension().is_none_or(|end| end != "partial"));
        assert!(cut == whole);
        // Once more: all there.
        let summary: serde_json::Value =
            serde_json::from_str(&done(&folder, &["--out", "cut", "--json"])).unwrap();
        assert_eq!(
            (&summary["resumed"], &summary["frames"]),
            (&120.into(), &120.into())
        );
    }
}
