//! Clips through ffmpeg: written, read, cut, damaged, of other formats. These tests need ffmpeg, and say so when it is missing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use gripline_capture::CaptureError;
use gripline_capture::Playback;
use gripline_capture::clip::{ClipReader, ClipWriter, ffmpeg_version};
use gripline_capture::geometry::{FRAME, Size};

use crate::{greatest_difference, middle, smooth_frame};

const PICTURES: usize = 24;

/// Frame `number` of the test clip: the smooth frame, which moves.
fn frame(number: usize) -> Vec<u8> {
    let mut frame = smooth_frame();
    frame.rotate_left(3 * number);
    frame
}

fn write_clip(path: &Path) {
    if let Err(missing) = ffmpeg_version() {
        panic!("{missing}");
    }
    let mut clip = ClipWriter::create(path, FRAME, 59.94).unwrap();
    for number in 0..PICTURES {
        clip.push(&frame(number)).unwrap();
    }
    clip.finish().unwrap();
}

fn ffmpeg(arguments: &[&str], out: &Path) {
    let status = Command::new("ffmpeg")
        .args(["-v", "error", "-nostdin", "-y"])
        .args(arguments)
        .arg(out)
        .status()
        .unwrap();
    assert!(status.success());
}

fn in_folder(folder: &tempfile::TempDir, name: &str) -> PathBuf {
    folder.path().join(name)
}

/// Where the pictures of an AVI begin, and how long they are.
fn pictures_in(avi: &[u8]) -> Vec<(usize, usize)> {
    let mut at = avi.windows(4).position(|name| name == b"movi").unwrap() + 4;
    let mut found = Vec::new();
    while avi[at..].starts_with(b"00dc") {
        let length = u32::from_le_bytes(avi[at + 4..at + 8].try_into().unwrap()) as usize;
        found.push((at + 8, length));
        at += 8 + length + length % 2;
    }
    found
}

#[test]
fn a_clip_reads_back_as_it_was_written_and_appears_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = in_folder(&folder, "clip.avi");
    write_clip(&path);
    assert!(!in_folder(&folder, "clip.avi.partial").exists());
    let mut clip = ClipReader::open(&path).unwrap();
    assert!((clip.rate() - 59.94).abs() < 0.001, "{}", clip.rate());
    for number in 0..PICTURES {
        let difference = greatest_difference(&clip.next_picture().unwrap(), &middle(&frame(number)));
        assert!(difference <= 6, "picture {number}: {difference} levels");
    }
    assert_eq!(clip.next_picture(), None);
    clip.finish().unwrap();
}

#[test]
fn clips_of_other_formats_give_every_picture_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = in_folder(&folder, "clip.avi");
    write_clip(&path);
    for (name, codec) in [
        ("clip.mp4", "mpeg4"),
        ("clip.mkv", "ffv1"),
        ("colour.avi", "mjpeg"),
    ] {
        let other = in_folder(&folder, name);
        ffmpeg(
            &["-i", path.to_str().unwrap(), "-c:v", codec, "-q:v", "2"],
            &other,
        );
        let mut clip = ClipReader::open(&other).unwrap();
        assert!((clip.rate() - 59.94).abs() < 0.01, "{name}: {}", clip.rate());
        assert_eq!(
            std::iter::from_fn(|| clip.next_picture()).count(),
            PICTURES,
            "{name}"
        );
        clip.finish().unwrap();
    }
}

#[test]
fn a_clip_that_is_cut_anywhere_or_has_a_bad_picture_plays_the_others_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = in_folder(&folder, "clip.avi");
    write_clip(&path);
    let bytes = fs::read(&path).unwrap();
    let pictures = pictures_in(&bytes);
    assert_eq!(pictures.len(), PICTURES);
    let (start, length) = pictures[9];
    let mut bad = bytes.clone();
    for byte in &mut bad[start + length / 2..start + length / 2 + 40] {
        *byte = 0xff;
    }
    bad[start + length / 2 + 41] = 0xd9;
    let cases: [(&str, &[u8], usize); 3] = [
        ("in_a_picture.avi", &bytes[..start + length / 2], 9),
        ("between_pictures.avi", &bytes[..start - 8], 9),
        ("bad_picture.avi", &bad, PICTURES - 1),
    ];
    for (name, bytes, good) in cases {
        let path = in_folder(&folder, name);
        fs::write(&path, bytes).unwrap();
        let mut clip = ClipReader::open(&path).unwrap();
        assert_eq!(std::iter::from_fn(|| clip.next_picture()).count(), good, "{name}");
        let error = clip.finish().unwrap_err().to_string();
        for part in [name, &format!("found {good} pictures, expected {PICTURES}")] {
            assert!(error.contains(part), "{part:?} is missing in: {error}");
        }
        let mut playback = Playback::clip(&path).unwrap();
        assert_eq!(std::iter::from_fn(|| playback.next_picture()).count(), good);
        let counts = playback.counts();
        assert_eq!(
            (counts.received, counts.damaged),
            (PICTURES as u64, (PICTURES - good) as u64)
        );
    }
}

#[test]
fn files_that_are_no_clips_are_refused_with_ffmpegs_last_line_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let clip = in_folder(&folder, "clip.avi");
    write_clip(&clip);
    fs::write(in_folder(&folder, "wrong.avi"), b"GIF89a is no clip").unwrap();
    fs::write(in_folder(&folder, "empty.avi"), b"").unwrap();
    fs::write(in_folder(&folder, "-option.mp4"), fs::read(&clip).unwrap()).unwrap();
    let large = in_folder(&folder, "large.avi");
    ffmpeg(&["-i", clip.to_str().unwrap(), "-vf", "scale=1280:720"], &large);
    let cases: [(&str, &[&str]); 4] = [
        (
            "wrong.avi",
            &["wrong.avi: ff", "says \"", "expected a clip with pictures"],
        ),
        (
            "empty.avi",
            &["Invalid data found", "expected a clip with pictures"],
        ),
        ("nowhere.avi", &["No such file", "check the path"]),
        (
            "large.avi",
            &[
                "found 1280×720 pixels",
                "expected 640×480 or 440×440",
                "-vf scale=640:480",
            ],
        ),
    ];
    for (name, parts) in cases {
        let error = ClipReader::open(&in_folder(&folder, name))
            .unwrap_err()
            .to_string();
        for part in parts {
            assert!(error.contains(part), "{part:?} is missing in: {error}");
        }
    }
    assert!(ClipReader::open(&in_folder(&folder, "-option.mp4")).is_ok());
}

#[test]
fn a_clip_that_cannot_be_written_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let mut clip =
        ClipWriter::create(&in_folder(&folder, "nowhere/clip.avi"), Size::new(440, 440), 30.0).unwrap();
    let error = loop {
        if let Err(error) = clip.push(&vec![0; 440 * 440]) {
            break error;
        }
    };
    assert!(matches!(error, CaptureError::Clip { .. }));
    let error = error.to_string();
    assert!(
        error.contains("No such file") && error.contains("clip.avi"),
        "{error}"
    );
}

/// Processes of this one that run or wait to be reaped, Linux.
#[cfg(target_os = "linux")]
fn has_child(path: &Path) -> bool {
    let name = path.display().to_string();
    fs::read_dir("/proc").unwrap().flatten().any(|entry| {
        let line = fs::read(entry.path().join("cmdline")).unwrap_or_default();
        line.starts_with(b"ffmpeg") && String::from_utf8_lossy(&line).contains(&name)
    })
}

#[cfg(target_os = "linux")]
#[test]
fn ffmpeg_ends_when_its_reader_is_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let path = in_folder(&folder, "clip.avi");
    write_clip(&path);
    let mut clip = ClipReader::open(&path).unwrap();
    clip.next_picture().unwrap();
    assert!(has_child(&path));
    drop(clip);
    assert!(!has_child(&path));
}
