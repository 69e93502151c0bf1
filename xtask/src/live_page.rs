//! A run that serves its live page, and `cargo xtask bench page`: how long a browser on this machine takes until the page's first picture,
//! and until it has drawn a frame that the loop handed over. What the page shows is checked by its tests, beside which other
//! tests run.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use gripline_browser::{Browser, BrowserError, Screen};
use serde_json::{Value, json};

use crate::error::Error;
use crate::process;
use crate::programs::CHROMIUM;

/// Loads of the page, and the frames that are drawn after the last: the page keeps the delays of the newest 1,000.
const LOADS: usize = 5;
const FRAMES: u32 = 600;
const PAGE: &str = "the live page";
const PATIENCE: Duration = Duration::from_mins(2);
const SCREEN: Screen = Screen {
    size: (1_280, 900),
    is_phone: false,
    is_light: false,
};

/// `cargo xtask bench page [--json]`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let is_json = match arguments {
        [] => false,
        [one] if one == "--json" => true,
        [other, ..] => return Err(Error::usage("bench page", other, "nothing or --json")),
    };
    CHROMIUM.ensure()?;
    process::run(process::cargo().args(["build", "--release", "--package", "gripline"]))?;
    let run = Run::start()?;
    let times = measured(&run.address).map_err(|error| Error::product(PAGE, &error, "the page of a run"))?;
    if is_json {
        println!("{times}");
    } else {
        let ms = |name: &str| times[name].as_f64().unwrap_or(f64::NAN);
        println!(
            "first picture {:.0} ms after the load began (median of {LOADS} loads), {:.0} ms at most\n\
             frames drawn {:.0} ms after the loop had them (median of {}), {:.0} ms at the 99th percentile",
            ms("first_picture_ms_median"),
            ms("first_picture_ms_longest"),
            ms("drawn_ms_median"),
            times["frames"],
            ms("drawn_ms_p99")
        );
    }
    Ok(())
}

/// Times until the first picture and until a frame is drawn, ms.
fn measured(address: &str) -> Result<Value, BrowserError> {
    let browser = Browser::start()?;
    browser.show_on(SCREEN)?;
    let mut first_ms = Vec::new();
    for _ in 0..LOADS {
        browser.open(address)?;
        first_ms.push(browser.wait_for("return window.gripline?.firstPictureMs", PATIENCE)?);
    }
    let enough = format!("return gripline.delaysMs.length >= {FRAMES} && gripline.delaysMs");
    let drawn_ms = sorted(
        browser
            .wait_for(&enough, PATIENCE)?
            .as_array()
            .into_iter()
            .flatten(),
    );
    let first_ms = sorted(first_ms.iter());
    Ok(json!({
        "first_picture_ms_median": first_ms[first_ms.len() / 2],
        "first_picture_ms_longest": first_ms.last(),
        "frames": drawn_ms.len(),
        "drawn_ms_median": drawn_ms[drawn_ms.len() / 2],
        "drawn_ms_p99": drawn_ms[drawn_ms.len() * 99 / 100],
    }))
}

fn sorted<'a>(values: impl Iterator<Item = &'a Value>) -> Vec<f64> {
    let mut values: Vec<f64> = values.filter_map(Value::as_f64).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// A run that serves its page until this is dropped.
pub(crate) struct Run {
    child: Child,
    pub(crate) address: String,
}

impl Run {
    /// Of the program as `cargo build --release` left it.
    pub(crate) fn start() -> Result<Self, Error> {
        let program = process::build_dir().join(format!("release/gripline{}", std::env::consts::EXE_SUFFIX));
        let mut child = Command::new(&program)
            .args(["run", "--seconds", "60", "--serve", "127.0.0.1:0", "--token-file"])
            .arg(process::products().join("live-page.token"))
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
            Error::product(
                PAGE,
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
