//! `cargo xtask screenshots`: the pictures of view and plot that the README shows, from a fresh run of the scripted scene.

use std::fs;

use crate::error::Error;
use crate::process;

/// The moment of the view, seconds: the pull, just before the grip has followed.
const VIEW_S: &str = "6.0";
/// (arguments of `gripline plot`, picture).
const PICTURES: [(&[&str], &str); 2] = [
    (&["--view", VIEW_S, "--size", "100x30"], "docs/view.png"),
    (&[], "docs/plot.png"),
];

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
    eprintln!("look at docs/view.png and docs/plot.png before they are committed");
    Ok(())
}

fn gripline(arguments: &[&str]) -> Result<(), Error> {
    process::run(
        process::cargo()
            .args(["run", "--release", "--package", "gripline", "--"])
            .args(arguments),
    )
}
