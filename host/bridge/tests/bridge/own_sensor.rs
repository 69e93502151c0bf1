//! From an unknown gel and camera to newtons, as docs/own-sensor.md has it, with the program itself on a simulated stranger: a GelSight
//! Mini whose gel is softer than described and whose lens shows and bends more.

use std::path::Path;
use std::process::{Command, Output};

use gripline_sensor::Sensor;
use gripline_simulation::printed::{PrintedBench, UnitRange};
use serde_json::Value;

const SOFTNESS: f64 = 0.6;
const SCALE: f64 = 1.06;

fn gripline(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn json(output: &Output) -> Vec<Value> {
    assert!(output.status.success(), "{}", said(output));
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn pictures(folder: &Path, name: &str, pictures: &[Vec<u8>]) {
    let to = folder.join(name);
    std::fs::create_dir(&to).unwrap();
    for (number, picture) in pictures.iter().enumerate() {
        let file = std::fs::File::create(to.join(format!("{number:04}.png"))).unwrap();
        let mut encoder = png::Encoder::new(file, 320, 240);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(picture).unwrap();
    }
}

/// A rest that something touches is refused, with these words.
fn assert_touched(folder: &Path, rest: &str, parts: &[&str]) {
    let refused = gripline(
        folder,
        &[
            "run",
            "--sensor",
            "gelsight-mini",
            "--source",
            "dir:monday-presses",
            "--rest",
            rest,
            "--unpaced",
        ],
    );
    assert_eq!(refused.status.code(), Some(1), "{}", said(&refused));
    for part in parts {
        assert!(said(&refused).contains(part), "{part}: {}", said(&refused));
    }
}

/// Pictures with contact do not stand for rest: beside each other, or beside those that are played.
fn assert_contact_is_no_rest(folder: &Path) {
    let parts = [
        "--rest monday-presses",
        "a contact or a motion in pictures 4..",
        "nothing touches it in",
    ];
    assert_touched(folder, "monday-presses", &parts);
    let parts = [
        "--rest monday-presses/0010.png",
        "found an imprint",
        "gone in picture",
        "untouched gel",
    ];
    assert_touched(folder, "monday-presses/0010.png", &parts);
}

/// Two days' pictures and logs.
fn bench(folder: &Path) -> [PrintedBench; 2] {
    let mut sensor = Sensor::named(Path::new("gelsight-mini")).unwrap();
    sensor.markers.pitch_mm = Some([1.9; 2]);
    let stranger = UnitRange {
        modulus: [SOFTNESS; 2],
        scale_error: [SCALE - 1.0; 2],
        distortion: [0.02; 2],
        zoom: [1.0; 2],
        ..UnitRange::of(&sensor)
    };
    [("monday", 1), ("tuesday", 2)].map(|(name, seed)| {
        let bench = PrintedBench::play(&sensor, &stranger, 8, 0.9, [7, seed]).unwrap();
        pictures(folder, &format!("{name}-rest"), &bench.rest);
        pictures(folder, &format!("{name}-presses"), &bench.pictures);
        std::fs::write(folder.join(format!("{name}.csv")), bench.csv()).unwrap();
        bench
    })
}

/// Plays a day; the pictures' normal forces.
fn run(folder: &Path, day: &str, more: &[&str]) -> Vec<f64> {
    let (source, rest) = (format!("dir:{day}-presses"), format!("{day}-rest"));
    let mut arguments = vec![
        "run",
        "--sensor",
        "gelsight-mini",
        "--source",
        &source,
        "--rest",
        &rest,
    ];
    arguments.extend(["--unpaced", "--json", "--calibration", "calibration.toml"]);
    arguments.extend(more);
    let frames = json(&gripline(folder, &arguments));
    frames.iter().filter_map(|frame| frame["fn"].as_f64()).collect()
}

#[test]
fn a_softer_gel_behind_another_lens_comes_to_newtons() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let days = bench(folder);

    let camera = gripline(
        folder,
        &[
            "calibrate",
            "camera",
            "monday-rest",
            "--pitch-mm",
            "1.9",
            "--json",
        ],
    );
    let camera = &json(&camera)[0];
    let scale = camera["px_per_mm"].as_f64().unwrap() / camera["described_px_per_mm"].as_f64().unwrap();
    println!(
        "scale {scale:.4} of the description's, bend {}",
        camera["distortion_per_mm2"]
    );
    assert!((scale / SCALE - 1.0).abs() < 0.01, "{camera}");

    for day in ["monday", "tuesday"] {
        run(folder, day, &["--record", &format!("{day}.mcap")]);
    }
    let gel = gripline(
        folder,
        &[
            "calibrate",
            "gel",
            "monday.mcap",
            "tuesday.mcap",
            "--forces",
            "monday.csv",
            "--forces",
            "tuesday.csv",
            "--json",
        ],
    );
    let gel = &json(&gel)[0];
    println!("{gel}");
    assert_eq!(gel["presses"], 16);
    assert!(gel["held_out_share"].as_f64().unwrap() <= 0.1, "{gel}");

    // With the calibration the picture's forces are those of the log.
    for (day, bench) in ["monday", "tuesday"].into_iter().zip(&days) {
        let found = run(folder, day, &[]);
        assert_eq!(found.len(), bench.log.len());
        let mut errors: Vec<f64> = found
            .iter()
            .zip(&bench.log)
            .filter(|(_, (_, force))| force[2] > 0.2)
            .map(|(found, (_, force))| (found / force[2] - 1.0).abs())
            .collect();
        errors.sort_by(f64::total_cmp);
        let median = errors[errors.len() / 2];
        println!("{day}: normal force off by {:.1} % in the median", 100.0 * median);
        assert!(median <= 0.1, "{day}: {median}");
    }

    assert_contact_is_no_rest(folder);

    // Another sensor's calibration, and gains of other weights.
    let file = folder.join("calibration.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    for (from, to, expected) in [
        (
            "gelsight-mini.1",
            "other.3",
            "found other.3, expected gelsight-mini.1",
        ),
        (
            "model = \"markers",
            "model = \"elastic-layer",
            "these gains are of other weights",
        ),
    ] {
        std::fs::write(&file, text.replace(from, to)).unwrap();
        let refused = gripline(
            folder,
            &[
                "run",
                "--sensor",
                "gelsight-mini",
                "--source",
                "dir:monday-presses",
                "--rest",
                "monday-rest",
                "--unpaced",
                "--calibration",
                "calibration.toml",
            ],
        );
        assert!(
            !refused.status.success() && said(&refused).contains(expected),
            "{}",
            said(&refused)
        );
    }
}

#[test]
fn what_a_bench_got_wrong_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let none = gripline(folder, &["calibrate", "gel"]);
    assert!(
        said(&none).contains("kitchen scale") && said(&none).contains("found no recording"),
        "{}",
        said(&none)
    );
    std::fs::write(folder.join("log.csv"), "t,fx,fy,fz\n0,0,0,0\n").unwrap();
    let missing = gripline(folder, &["calibrate", "gel", "maps.npy", "--forces", "log.csv"]);
    assert!(said(&missing).contains("maps.npy"), "{}", said(&missing));
    let particles = gripline(
        folder,
        &["calibrate", "camera", "x.png", "--sensor", "particle-fingertip"],
    );
    assert!(
        said(&particles).contains("expected printed markers"),
        "{}",
        said(&particles)
    );
}
