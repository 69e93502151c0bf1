//! `gripline infer` as other programs see it: pictures of a simulated press in, force maps out that say how hard.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use gripline_recording::maps_file::MapsFile;

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
press_n = 3.0
at_mm = [3.0, -2.0]
"#;

/// A folder of its own for every test, with the scene played in it.
fn folder(test: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("infer").join(test);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    fs::write(path.join("scene.toml"), SCENE).unwrap();
    let played = gripline(&path, &["simulate", "scene.toml", "--out", "scene"]);
    assert!(
        played.status.success(),
        "{}",
        String::from_utf8_lossy(&played.stderr)
    );
    path
}

fn gripline(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
}

fn infer(folder: &Path, frames: &str, more: &[&str]) -> Output {
    let arguments = [
        "infer",
        "--rest",
        "scene/rest.png",
        "--frames",
        frames,
        "--out",
        "found.npy",
    ];
    gripline(folder, &[&arguments[..], more].concat())
}

/// Total normal force of every map of a file, newtons.
fn normal_n(path: &Path) -> Vec<f64> {
    let mut file = MapsFile::open(path).unwrap();
    let (mut totals, mut frame) = (Vec::new(), [[0.0; 3]; 400]);
    while file.read_frame(&mut frame).unwrap() {
        totals.push(frame.iter().map(|force| force[2]).sum());
    }
    totals
}

#[test]
fn both_networks_and_both_engines_find_the_force_of_a_simulated_press() {
    let folder = folder("press");
    let truth = normal_n(&folder.join("scene/maps.npy"));
    for network in ["tracked", "unet"] {
        let mut maps = Vec::new();
        for engine in ["dense", "skip"] {
            let output = infer(
                &folder,
                "scene/frames",
                &["--network", network, "--engine", engine],
            );
            assert!(
                output.status.success(),
                "{}",
                String::from_utf8_lossy(&output.stderr)
            );
            let said = String::from_utf8(output.stdout).unwrap();
            assert!(said.contains(network), "{said}");
            maps.push(fs::read(folder.join("found.npy")).unwrap());
        }
        assert!(maps[0] == maps[1], "{network}: skipping changed a map");
        let found = normal_n(&folder.join("found.npy"));
        assert_eq!(found.len(), truth.len());
        let (found, truth) = (found[found.len() - 1], truth[truth.len() - 1]);
        assert!(
            truth > 2.5 && (found / truth - 1.0).abs() < 0.2,
            "{network}: {found} N of {truth} N"
        );
    }
}

#[test]
fn what_cannot_be_used_is_an_error_that_names_the_file() {
    let folder = folder("errors");
    fs::write(folder.join("bad.png"), b"no picture").unwrap();
    fs::create_dir(folder.join("empty")).unwrap();
    write_png(&folder.join("odd.png"), [320, 240], png::ColorType::Grayscale);
    write_png(&folder.join("small.png"), [88, 88], png::ColorType::Grayscale);
    write_png(&folder.join("colour.png"), [440, 440], png::ColorType::Rgb);
    let whole = fs::read(folder.join("scene/rest.png")).unwrap();
    fs::write(folder.join("cut.png"), &whole[..whole.len() / 2]).unwrap();
    let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("../network/weights");
    let tracked = weights.join("tracked.safetensors");
    let tracked = tracked.to_str().unwrap();
    let mut damaged = fs::read(weights.join("unet.safetensors")).unwrap();
    let last = damaged.len() - 1;
    damaged[last] ^= 1;
    fs::write(folder.join("damaged.safetensors"), damaged).unwrap();
    for (frames, more, expected) in [
        ("missing", &[][..], "missing"),
        ("empty", &[], "found no *.png"),
        ("bad.png", &[], "bad.png"),
        (
            "odd.png",
            &["--network", "unet"],
            "odd.png: found 320×240 pixels, expected 640×480 or 440×440 or 88×88",
        ),
        (
            "small.png",
            &[],
            "small.png: found 88×88 pixels, expected 640×480 or 440×440",
        ),
        (
            "colour.png",
            &[],
            "colour.png: found Rgb of 8 bits, expected grey of 8 bits",
        ),
        ("cut.png", &[], "cut.png: found no good PNG"),
        ("scene/frames", &["--weights", "scene.toml"], "scene.toml"),
        (
            "scene/frames",
            &["--weights", "damaged.safetensors"],
            "damaged.safetensors: checksum is",
        ),
        (
            "scene/frames",
            &["--network", "unet", "--weights", tracked],
            "`architecture` is `tracked`, expected `unet`",
        ),
    ] {
        let output = infer(&folder, frames, more);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            said.contains(expected) && said.trim_end().lines().count() == 1,
            "{said}"
        );
        assert!(!folder.join("found.npy").exists());
    }
    for wrong in [["--network", "resnet"], ["--instructions", "sve"]] {
        let output = infer(&folder, "scene/frames", &wrong);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.code() == Some(2) && said.contains(wrong[1]),
            "{said}"
        );
    }
}

/// A calibration of the gel for weights of this name, as `gripline calibrate gel` writes it.
fn gel_calibration(model: &str) -> String {
    format!(
        r#"
[gel]
date = "2026-11-21T14:00:00Z"
device = "finger 3"
sensor = "particle-fingertip.1"
model = "{model}"
normal_gain = 0.5
normal_interval = [0.45, 0.55]
shear_gain = 2.0
shear_interval = [1.9, 2.1]
shear_was_measured = true
young_mpa = 0.1
young_interval_mpa = [0.09, 0.11]
confidence = 0.9
presses = 12
held_out_share = 0.04
"#
    )
}

#[test]
fn the_fingertips_gains_scale_its_maps_and_those_of_other_weights_are_refused() {
    let folder = folder("gain");
    let network = gripline_network::Network::embedded(gripline_network::Architecture::Tracked).unwrap();
    let named = format!("tracked {}", network.checksum());
    fs::write(folder.join("tip.toml"), gel_calibration(&named)).unwrap();
    fs::write(folder.join("other.toml"), gel_calibration("tracked 01234567")).unwrap();
    fs::write(folder.join("none.toml"), "").unwrap();
    let read = |more: &[&str]| {
        let output = infer(&folder, "scene/frames", more);
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let mut file = MapsFile::open(&folder.join("found.npy")).unwrap();
        let (mut maps, mut frame) = (Vec::new(), [[0.0; 3]; 400]);
        while file.read_frame(&mut frame).unwrap() {
            maps.push(frame);
        }
        maps
    };
    let (plain, scaled) = (read(&[]), read(&["--calibration", "tip.toml"]));
    assert!(plain.as_flattened().iter().any(|force| force[2] > 0.01));
    for (plain, scaled) in plain.as_flattened().iter().zip(scaled.as_flattened()) {
        let expected = [2.0 * plain[0], 2.0 * plain[1], 0.5 * plain[2]];
        assert_eq!(scaled.map(f64::to_bits), expected.map(f64::to_bits));
    }
    for (file, expected) in [
        (
            "other.toml",
            format!("gel.model: found tracked 01234567, expected {named}"),
        ),
        ("none.toml", "none.toml: found no section gel".to_owned()),
        ("missing.toml", "missing.toml".to_owned()),
    ] {
        let output = infer(&folder, "scene/frames", &["--calibration", file]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && said.contains(&expected), "{said}");
    }
}

fn write_png(path: &Path, [width, height]: [u32; 2], colour: png::ColorType) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), width, height);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    let pixels = vec![0; (width * height) as usize * colour.samples()];
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
}

#[test]
fn a_black_picture_has_a_map_of_zeros_and_is_named() {
    let folder = folder("black");
    write_png(&folder.join("black.png"), [440, 440], png::ColorType::Grayscale);
    for network in ["tracked", "unet"] {
        let output = infer(&folder, "black.png", &["--network", network]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(3), "{said}");
        assert!(said.contains("black.png") && said.contains("too dark"), "{said}");
        assert_eq!(normal_n(&folder.join("found.npy")), [0.0], "{network}");
    }
}
