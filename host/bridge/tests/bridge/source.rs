//! Sources of pictures that need no camera, as a person uses them: a folder, a recording, and what is wrong with either.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use gripline::source::SimulatedSource;
use serde_json::Value;

fn gripline(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["run", "--json", "--unpaced", "--network", "unet"])
        .args(arguments)
        .output()
        .expect("the program starts")
}

fn summary(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(text.lines().last().expect("a summary comes last")).expect("it is JSON")
}

#[track_caller]
fn assert_says(output: &Output, code: i32, parts: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{error}");
    for part in parts {
        assert!(error.contains(part), "{part:?} is missing in: {error}");
    }
}

fn write_png(path: &Path, crop: &[u8]) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), 440, 440);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(crop).unwrap();
}

fn write_jpeg(path: &Path, crop: &[u8]) {
    let encoder = jpeg_encoder::Encoder::new_file(path, 95).unwrap();
    encoder
        .encode(crop, 440, 440, jpeg_encoder::ColorType::Luma)
        .unwrap();
}

#[test]
fn a_folder_is_played_in_the_order_of_names_and_a_damaged_picture_is_passed_over_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let frames = folder.path().join("frames");
    fs::create_dir(&frames).unwrap();
    let mut source = SimulatedSource::new(3, 60.0);
    write_png(&folder.path().join("rest.png"), &source.rest(1)[0]);
    for number in 0..12 {
        let crop = source.next(2.5).unwrap().crop;
        let path = |ending| frames.join(format!("{number:06}.{ending}"));
        match number {
            5 => fs::write(path("jpg"), [0xff, 0xd8, 1, 2, 3]).unwrap(),
            n if n % 2 == 0 => write_jpeg(&path("jpg"), &crop),
            _ => write_png(&path("png"), &crop),
        }
    }
    let recording = folder.path().join("run.mcap");
    let from = format!("dir:{}", folder.path().display());
    let output = gripline(&["--source", &from, "--record", recording.to_str().unwrap()]);
    assert_says(
        &output,
        3,
        &[
            "000005.jpg: found a damaged JPEG",
            "1 pictures were damaged and passed over",
        ],
    );
    // The loss is an event of the recording.
    let recorded = fs::read(&recording).unwrap();
    let event = b"1 pictures lost so far: 0 never came, 0 were overtaken by newer ones, 1 were damaged";
    assert!(recorded.windows(event.len()).any(|bytes| bytes == event));
    let summary = summary(&output);
    assert_eq!(summary["frames"], 11);
    assert_eq!(
        (&summary["pictures"]["came"], &summary["pictures"]["damaged"]),
        (&12.into(), &1.into())
    );
    assert_eq!(summary["shadow_mismatches"], 0);
    let decode = &summary["stages"][0];
    assert_eq!(
        (&decode["stage"], &decode["frames"]),
        (&"decode".into(), &11.into())
    );
}

#[test]
fn a_recordings_pictures_played_again_give_the_forces_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let first = gripline(&["--seconds", "2", "--record", file.to_str().unwrap()]);
    assert_says(&first, 0, &[]);
    let second = gripline(&["--camera", &format!("mcap:{}", file.display())]);
    assert_says(&second, 0, &["pictures of "]);
    let forces = |output: &Output| -> Vec<Value> {
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let lines = text
            .lines()
            .map(|line| serde_json::from_str::<Value>(line).unwrap());
        lines
            .filter(|line| line.get("fn").is_some())
            .map(|line| {
                serde_json::json!([line["gate"], line["fn"], line["ft"], line["mz"], line["contact"]])
            })
            .collect()
    };
    assert_eq!(forces(&first).len(), 120);
    assert_eq!(forces(&first), forces(&second));
}

#[test]
fn what_is_wrong_with_a_source_is_reported_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path().display().to_string();
    fs::write(folder.path().join("a.png"), [0; 20]).unwrap();
    fs::create_dir(folder.path().join("empty")).unwrap();
    let cases: [(&[&str], i32, &[&str]); 6] = [
        (
            &["--source", &format!("dir:{here}/nowhere")],
            1,
            &[
                "nowhere: No such file",
                "expected a picture or a folder",
                "check the path",
            ],
        ),
        (
            &["--source", &format!("dir:{here}")],
            1,
            &["found no rest.png", "gripline calibrate rest"],
        ),
        (
            &["--source", &format!("dir:{here}/empty")],
            1,
            &["found no *.png"],
        ),
        (
            &["--source", &format!("mcap:{here}/a.png")],
            1,
            &["a.png: found not one frame"],
        ),
        (
            &["--camera", "webcam"],
            2,
            &["found webcam, expected sim, /dev/videoN"],
        ),
        (
            &["--camera", "/dev/video0"],
            2,
            &["run.unpaced", "a camera keeps its own time"],
        ),
    ];
    for (arguments, code, parts) in cases {
        assert_says(&gripline(arguments), code, parts);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_camera_that_is_not_there_is_reported_with_those_that_are() {
    let output = Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(["run", "--camera", "/dev/video-of-nobody"])
        .output()
        .unwrap();
    assert_says(
        &output,
        1,
        &["camera /dev/video-of-nobody: not found", "plug it in"],
    );
}

/// A ball pressed on a fingertip and dragged, as a folder of pictures and as a clip.
const SCENE: &str = r#"kind = "press"
frames_per_second = 30
frames = "full"
[sensor]
unit = 4
[indenter]
shape = "sphere"
friction = 0.6
[[path]]
name = "press"
seconds = 0.4
press_n = 2.0
at_mm = [1.0, -1.0]
[[path]]
name = "drag"
seconds = 0.4
at_mm = [2.0, -1.0]
"#;

#[test]
fn a_clip_of_simulate_plays_as_its_pictures_do_and_a_cut_or_wrong_one_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let here = |name: &str| folder.path().join(name).display().to_string();
    fs::write(here("scene.toml"), SCENE).unwrap();
    let program = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_gripline"))
            .args(arguments)
            .output()
            .unwrap()
    };
    let made = program(&["simulate", &here("scene.toml"), "--out", &here("out"), "--video"]);
    assert_says(&made, 0, &[]);
    let clip = format!("file:{}", here("out/clip.avi"));
    let played = gripline(&["--source", &clip]);
    assert_says(&played, 0, &["clip.avi, 30.0 a second"]);
    let pictures = gripline(&["--source", &format!("dir:{}", here("out"))]);
    let forces = |output: &Output| -> Vec<f64> {
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let lines = text
            .lines()
            .map(|line| serde_json::from_str::<Value>(line).unwrap());
        lines.filter_map(|line| line["fn"].as_f64()).collect()
    };
    let (played, pictures) = (forces(&played), forces(&pictures));
    assert_eq!((played.len(), pictures.len()), (24, 24));
    // As good as the camera's own compression: a few hundredths of the load.
    for (number, (clip, picture)) in played.iter().zip(&pictures).enumerate() {
        assert!(
            (clip - picture).abs() < 0.15,
            "picture {number}: {clip} and {picture} N"
        );
    }
    assert!(played.iter().any(|force| *force > 1.0), "{played:?}");

    let infer = |frames: &str, code: i32, parts: &[&str]| {
        let output = program(&[
            "infer",
            "--rest",
            &here("out/rest.png"),
            "--frames",
            frames,
            "--out",
            &here("maps.npy"),
            "--json",
        ]);
        assert_says(&output, code, parts);
        output
    };
    let output = infer(&here("out/clip.avi"), 0, &[]);
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["frames"], 24);

    // Cut in its second half, where a picture ends no more.
    let bytes = fs::read(here("out/clip.avi")).unwrap();
    fs::copy(here("out/rest.png"), here("rest.png")).unwrap();
    fs::write(here("cut.avi"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    let cut = gripline(&["--source", &format!("file:{}", here("cut.avi"))]);
    assert_says(
        &cut,
        3,
        &["cut.avi: damaged or cut short: found 1", "pictures, expected 24"],
    );
    assert!((12..20).contains(&forces(&cut).len()), "{}", forces(&cut).len());
    infer(&here("cut.avi"), 3, &["cut short", "maps written"]);

    fs::write(here("wrong.avi"), b"GIF89a is no clip").unwrap();
    for (source, expected) in [
        ("wrong.avi", "expected a clip with pictures"),
        ("nowhere.avi", "check the path"),
    ] {
        let output = gripline(&["--source", &format!("file:{}", here(source))]);
        assert_says(&output, 1, &[source, expected]);
        infer(&here(source), 1, &[source, expected]);
    }
}
