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
        encoder.set_compression(png::Compression::Fast);
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

/// The scene of twelve presses of a ball on a simulated fingertip with particles, and their loads, N.
fn presses(unit: u64) -> (String, Vec<f64>) {
    let mut text = format!(
        "kind = \"press\"\nframes_per_second = 30\nframes = \"crop\"\n[sensor]\nunit = {unit}\n[indenter]\nshape = \"sphere\"\n\
         radius_mm = 6.0\n[[path]]\nseconds = 0.1\ndepth_mm = -1.0\nat_mm = [0.0, 0.0]\n"
    );
    let loads: Vec<f64> = (0..12)
        .map(|press| 0.6 + 0.2 * f64::from(press * 5 % 12))
        .collect();
    for (press, load) in (0..).zip(&loads) {
        let at_mm = [f64::from(press % 4) * 3.0 - 4.5, f64::from(press / 4) * 4.0 - 4.0];
        for (seconds, press_n) in [(0.1, 0.0), (0.1, *load), (0.2, *load), (0.1, 0.0)] {
            let step = format!("[[path]]\nseconds = {seconds}\npress_n = {press_n}\nat_mm = {at_mm:?}\n");
            text += &step;
        }
    }
    (text, loads)
}

/// Plays a folder of the particle fingertip; the pictures' normal forces.
fn run_particles(folder: &Path, more: &[&str]) -> Vec<f64> {
    let arguments = [
        "run",
        "--sensor",
        "particle-fingertip",
        "--source",
        "dir:presses/frames",
        "--unpaced",
        "--json",
    ];
    let frames = json(&gripline(folder, &[&arguments, more].concat()));
    frames.iter().filter_map(|frame| frame["fn"].as_f64()).collect()
}

/// The calibration with another gain, so that a test sees which fingertip has whose.
fn with_gain(folder: &Path, name: &str, gain: f64) {
    let text = std::fs::read_to_string(folder.join("calibration.toml")).unwrap();
    let mut table: toml::Table = text.parse().unwrap();
    let gel = table["gel"].as_table_mut().unwrap();
    for axis in ["shear", "normal"] {
        gel.insert(format!("{axis}_gain"), gain.into());
        gel.insert(format!("{axis}_interval"), vec![0.9 * gain, 1.1 * gain].into());
    }
    std::fs::write(folder.join(name), table.to_string()).unwrap();
}

/// Each fingertip's normal forces in a run of two that see the same pictures.
fn run_both(folder: &Path, first: &str, second: &str) -> [Vec<f64>; 2] {
    let pictures = "dir:presses/frames";
    let arguments = [
        ["run", "--source", pictures, "--second-source", pictures],
        [
            "--calibration",
            first,
            "--second-calibration",
            second,
            "--unpaced",
        ],
    ];
    let frames = json(&gripline(
        folder,
        &[arguments.as_flattened(), &["--json"]].concat(),
    ));
    let mut of: std::collections::BTreeMap<u64, Vec<f64>> = std::collections::BTreeMap::new();
    for frame in &frames {
        if let (Some(sensor), Some(force)) = (frame["sensor"].as_u64(), frame["fn"].as_f64()) {
            of.entry(sensor).or_default().push(force);
        }
    }
    let both: Vec<Vec<f64>> = of.into_values().collect();
    both.try_into().unwrap()
}

#[test]
fn a_particle_fingertip_comes_to_newtons_with_a_ball_and_a_scale() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (scene, loads) = presses(1);
    std::fs::write(folder.join("presses.toml"), scene).unwrap();
    let played = gripline(folder, &["simulate", "presses.toml", "--out", "presses"]);
    assert!(played.status.success(), "{}", said(&played));

    let raw = run_particles(folder, &["--record", "raw.mcap"]);
    let readings: Vec<String> = loads.iter().map(ToString::to_string).collect();
    let readings = readings.join(" ");
    let calibrate = |more: &[&str]| {
        let arguments = ["calibrate", "gel", "--readings", &readings, "--json", "raw.mcap"];
        gripline(folder, &[&arguments, more].concat())
    };
    let another = calibrate(&[]);
    assert!(
        said(&another).contains("found a recording of sensor particle-fingertip"),
        "{}",
        said(&another)
    );
    let gel = &json(&calibrate(&["--sensor", "particle-fingertip"]))[0];
    assert!(gel["model"].as_str().unwrap().starts_with("tracked "), "{gel}");
    let gain = gel["normal_gain"]["value"].as_f64().unwrap();
    assert!((1.02..1.12).contains(&gain), "{gel}");
    assert!(gel["held_out_share"].as_f64().unwrap() <= 0.05, "{gel}");

    // With it the scale is right, in a replay too, which needs no file.
    let calibrated = run_particles(
        folder,
        &["--calibration", "calibration.toml", "--record", "calibrated.mcap"],
    );
    assert_eq!(raw.len(), calibrated.len());
    let truth = truth_of(&folder.join("presses/truth.csv"));
    let off = |found: &[f64]| {
        let pressed = found.iter().zip(&truth).filter(|(_, truth)| **truth > 0.5);
        let mut errors: Vec<f64> = pressed
            .map(|(found, truth)| (found / truth - 1.0).abs())
            .collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    };
    println!(
        "normal force off by {:.3}, calibrated {:.3}",
        off(&raw),
        off(&calibrated)
    );
    assert!(
        off(&calibrated) < 0.025 && off(&raw) > 0.04,
        "{} {}",
        off(&raw),
        off(&calibrated)
    );
    let replayed = gripline(folder, &["replay", "calibrated.mcap"]);
    assert!(replayed.status.success(), "{}", said(&replayed));
    // Calibrating the calibrated maps finds the same gain, not the one that is left.
    let again = gripline(
        folder,
        &[
            "calibrate",
            "gel",
            "calibrated.mcap",
            "--sensor",
            "particle-fingertip",
            "--readings",
            &readings,
            "--json",
            "--out",
            "again.toml",
        ],
    );
    let again = json(&again)[0]["normal_gain"]["value"].as_f64().unwrap();
    assert!((again / gain - 1.0).abs() < 0.01, "{again} after {gain}");

    // Gains of other weights are refused, and maps of two networks together.
    run_particles(folder, &["--network", "unet", "--record", "unet.mcap"]);
    let refused = calibrate(&["unet.mcap", "--sensor", "particle-fingertip"]);
    assert!(
        said(&refused).contains("unet.mcap: recorded with the forces of unet"),
        "{}",
        said(&refused)
    );
    let refused = gripline(
        folder,
        &[
            "run",
            "--source",
            "dir:presses/frames",
            "--network",
            "unet",
            "--calibration",
            "calibration.toml",
        ],
    );
    assert!(
        said(&refused).contains("these gains are of other weights"),
        "{}",
        said(&refused)
    );

    // Each fingertip has its own.
    with_gain(folder, "one.toml", 1.0);
    with_gain(folder, "half.toml", 0.5);
    let [one, half] = run_both(folder, "one.toml", "half.toml");
    let peak = |forces: &[f64]| forces.iter().copied().fold(0.0, f64::max);
    // Taxels below the contact threshold do not travel, so it is a little less than half.
    let share = peak(&half) / peak(&one);
    assert!((0.4..=0.505).contains(&share), "{share}");
}

/// The normal forces of a simulated scene, N.
fn truth_of(file: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(file).unwrap();
    let mut lines = text.lines();
    let column = lines
        .next()
        .unwrap()
        .split(',')
        .position(|name| name == "fn")
        .unwrap();
    lines
        .map(|line| line.split(',').nth(column).unwrap().parse().unwrap())
        .collect()
}
