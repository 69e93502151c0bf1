//! `cargo xtask screenshots`: the pictures of view, plot and live page in the README and the manual, from fresh runs of the scripted scene,
//! and the view of a real GelSight Mini, from a shared recording.

use std::fs;
use std::path::Path;
use std::time::Duration;

use gripline_browser::{Browser, BrowserError, Screen};

use crate::error::Error;
use crate::live_page::Run;
use crate::process;
use crate::programs::CHROMIUM;

/// The moment of the view, seconds: the pull, just before the grip has followed.
const VIEW_S: &str = "6.0";
/// (arguments of `gripline plot`, picture).
const PICTURES: [(&[&str], &str); 2] = [
    (&["--view", VIEW_S, "--size", "100x30"], "docs/view.png"),
    (&[], "docs/plot.png"),
];

/// A trial of a real GelSight Mini among the shared recordings, the pictures of its open hand, the moment of its view (a shake while
/// it is held), and the picture.
const RECORDINGS: &str = "GRIPLINE_RECORDINGS";
const CLIP: &str = "gelsight-mini/tin_box__exp_num_3__c614f8/camera_0.avi";
const CLIP_REST: &str = "12..20";
const CLIP_VIEW_S: &str = "4.2";
const CLIP_PICTURE: &str = "docs/view-gelsight-mini.png";

/// The live page: a frame of the pull, the largest file that belongs into the repository, and (screen, picture).
const PAGE_FRAME: u32 = 370;
const PAGE_BYTES_MAX: usize = 300_000;
const PAGES: [(Screen, &str); 3] = [
    (desktop(true), "docs/page.png"),
    (desktop(false), "docs/page-dark.png"),
    (
        Screen {
            size: (390, 1_056),
            is_phone: true,
            is_light: false,
        },
        "docs/page-phone.png",
    ),
];

const fn desktop(is_light: bool) -> Screen {
    Screen {
        size: (1_280, 884),
        is_phone: false,
        is_light,
    }
}

/// Plays, records and draws.
pub(crate) fn run() -> Result<(), Error> {
    let folder = process::products();
    fs::create_dir_all(&folder).map_err(|error| Error::file(&folder, error))?;
    let recording = recorded(&folder.join("screenshots.mcap"), &["--seconds", "12"])?;
    for (arguments, picture) in PICTURES {
        plot(&recording, picture, arguments)?;
    }
    match std::env::var(RECORDINGS) {
        Ok(recordings) => clip(&folder, &recordings)?,
        Err(_) => eprintln!("{CLIP_PICTURE} stays: set {RECORDINGS} to the folder of the shared recordings"),
    }
    CHROMIUM.ensure()?;
    for (screen, picture) in PAGES {
        page(screen, picture)?;
    }
    eprintln!(
        "look at docs/view.png, docs/plot.png, {CLIP_PICTURE} and docs/page*.png before they are committed"
    );
    Ok(())
}

/// The view of a real sensor's clip.
fn clip(folder: &Path, recordings: &str) -> Result<(), Error> {
    let source = format!("file:{recordings}/{CLIP}");
    let arguments = [
        "--sensor",
        "gelsight-mini",
        "--source",
        &source,
        "--rest",
        CLIP_REST,
        "--hold",
        "--unpaced",
    ];
    let recording = recorded(&folder.join("screenshots-clip.mcap"), &arguments)?;
    plot(
        &recording,
        CLIP_PICTURE,
        &["--view", CLIP_VIEW_S, "--size", "100x30"],
    )
}

/// Runs with these arguments and records it without pictures; the recording's path.
fn recorded(recording: &Path, arguments: &[&str]) -> Result<String, Error> {
    // A recording is never written over.
    if recording.exists() {
        fs::remove_file(recording).map_err(|error| Error::file(recording, error))?;
    }
    let path = recording.to_string_lossy().into_owned();
    let records = ["run", "--record", &path, "--record-pictures", "off"];
    gripline(&[&records, arguments].concat())?;
    Ok(path)
}

fn plot(recording: &str, picture: &str, arguments: &[&str]) -> Result<(), Error> {
    let to = ["plot", recording, "--out", picture];
    gripline(&[&to, arguments].concat())
}

fn gripline(arguments: &[&str]) -> Result<(), Error> {
    process::run(
        process::cargo()
            .args(["run", "--release", "--package", "gripline", "--"])
            .args(arguments),
    )
}

/// The page over a run of its own.
fn page(screen: Screen, to: &str) -> Result<(), Error> {
    let run = Run::start()?;
    let picture =
        pictured(&run.address, screen).map_err(|error| Error::product(to, &error, "the page of a run"))?;
    if picture.len() > PAGE_BYTES_MAX {
        let expected = format!("at most {PAGE_BYTES_MAX} bytes");
        return Err(Error::product(to, &format!("{} bytes", picture.len()), &expected));
    }
    let to = process::root().join(to);
    fs::write(&to, picture).map_err(|source| Error::file(&to, source))
}

fn pictured(address: &str, screen: Screen) -> Result<Vec<u8>, BrowserError> {
    let browser = Browser::start()?;
    browser.show_on(screen)?;
    browser.open(address)?;
    let script = format!("return Number(document.getElementById('frame').textContent) >= {PAGE_FRAME}");
    browser.wait_for(&script, Duration::from_mins(1))?;
    browser.screenshot()
}
