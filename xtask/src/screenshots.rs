//! `cargo xtask screenshots`: the pictures of view, plot and live page that the README shows, from fresh runs of the scripted scene.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use gripline_browser::{Browser, BrowserError, Screen};

use crate::error::Error;
use crate::process;
use crate::programs::CHROMIUM;

/// The moment of the view, seconds: the pull, just before the grip has followed.
const VIEW_S: &str = "6.0";
/// (arguments of `gripline plot`, picture).
const PICTURES: [(&[&str], &str); 2] = [
    (&["--view", VIEW_S, "--size", "100x30"], "docs/view.png"),
    (&[], "docs/plot.png"),
];

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
    let recording = folder.join("screenshots.mcap");
    // A recording is never written over.
    if recording.exists() {
        fs::remove_file(&recording).map_err(|error| Error::file(&recording, error))?;
    }
    let recording = recording.to_string_lossy().into_owned();
    let scene = [
        "run",
        "--seconds",
        "12",
        "--record",
        &recording,
        "--record-pictures",
        "off",
    ];
    gripline(&scene)?;
    for (arguments, picture) in PICTURES {
        let to = ["plot", &recording, "--out", picture];
        gripline(&[&to, arguments].concat())?;
    }
    CHROMIUM.ensure()?;
    for (screen, picture) in PAGES {
        page(&folder, screen, picture)?;
    }
    eprintln!("look at docs/view.png, docs/plot.png and docs/page*.png before they are committed");
    Ok(())
}

fn gripline(arguments: &[&str]) -> Result<(), Error> {
    process::run(
        process::cargo()
            .args(["run", "--release", "--package", "gripline", "--"])
            .args(arguments),
    )
}

/// The page over a run of its own.
fn page(folder: &Path, screen: Screen, to: &str) -> Result<(), Error> {
    let run = Run::start(folder)?;
    let picture = pictured(&run.address, screen).map_err(|error| wrong(to, &error, "the page of a run"))?;
    if picture.len() > PAGE_BYTES_MAX {
        let expected = format!("at most {PAGE_BYTES_MAX} bytes");
        return Err(wrong(to, &format!("{} bytes", picture.len()), &expected));
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

/// A run that serves its page until this is dropped.
struct Run {
    child: Child,
    address: String,
}

impl Run {
    /// The program that the other pictures were drawn with.
    fn start(folder: &Path) -> Result<Self, Error> {
        let program = process::build_dir().join(format!("release/gripline{}", std::env::consts::EXE_SUFFIX));
        let mut child = Command::new(&program)
            .args(["run", "--seconds", "60", "--serve", "127.0.0.1:0", "--token-file"])
            .arg(folder.join("screenshots.token"))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|source| Error::file(&program, source))?;
        let said = child.stderr.take().map(BufReader::new);
        let mut lines = said
            .into_iter()
            .flat_map(|said| said.lines().map_while(Result::ok));
        let address = lines.find_map(|line| Some(format!("http://{}", line.split_once("http://")?.1.trim())));
        std::thread::spawn(move || lines.for_each(drop));
        let mut run = Self {
            child,
            address: String::new(),
        };
        run.address = address.ok_or_else(|| {
            wrong(
                "the live page",
                &"no address",
                "one on standard error of `gripline run --serve`",
            )
        })?;
        Ok(run)
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn wrong(what: &str, found: &dyn std::fmt::Display, expected: &str) -> Error {
    Error::Product {
        what: what.to_owned(),
        found: found.to_string(),
        expected: expected.to_owned(),
    }
}
