//! `cargo xtask bench` and `bench network`: build the measurement and run it; `cargo xtask gate` trains the scene gate.
//! onnxruntime and LiteRT come from Python packages, each in a folder of its own beside the other products; they are
//! installed on first use.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::{live_page, outside, process, requests};

/// The package that brings the shared library; the version that host/network's binding speaks.
const ONNXRUNTIME: &str = "onnxruntime==1.31.1";

/// The peer of the detector.
const NUMPY: &str = "numpy==2.4.6";

/// The package that brings LiteRT's interpreter, and what it needs.
const LITERT: [&str; 2] = ["ai-edge-litert==2.3.0", "numpy"];

/// `cargo xtask bench`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    match arguments.split_first() {
        Some((what, rest)) if what == "network" => network(rest),
        Some((what, rest)) if what == "outside" => outside::command(rest),
        Some((what, rest)) if what == "page" => live_page::command(rest),
        Some((what, rest)) if what == "requests" => requests::command(rest),
        Some((what, _)) if !what.starts_with("--") => Err(Error::usage(
            "bench",
            what,
            "`network`, `outside`, `page`, `requests`, or options alone",
        )),
        _ => chain(arguments),
    }
}

/// The whole chain and each stage, beside NumPy.
fn chain(arguments: &[String]) -> Result<(), Error> {
    let numpy = process::products().join(NUMPY.replace("==", "-"));
    if !numpy.join("numpy").is_dir() {
        process::run(
            Command::new("python3")
                .args(["-m", "pip", "install", "--quiet", "--no-deps", "--target"])
                .arg(&numpy)
                .arg(NUMPY),
        )?;
    }
    process::run(
        process::cargo()
            .args(["run", "--release", "--package", "gripline-bench", "--", "--numpy"])
            .arg(numpy)
            .arg("--plot")
            .arg(process::products().join("bench.png"))
            // The last one counts, so that these can say otherwise.
            .args(arguments),
    )
}

fn network(arguments: &[String]) -> Result<(), Error> {
    let library = onnxruntime()?;
    let plot = process::products().join("bench-network.png");
    process::run(
        process::cargo()
            .args(["run", "--release", "--package", "gripline-evaluation"])
            .args([
                "--features",
                "bench",
                "--bin",
                "bench-network",
                "--",
                "--onnxruntime",
            ])
            .arg(library)
            .arg("--plot")
            .arg(plot)
            // The last one counts, so that these can say otherwise.
            .args(arguments),
    )
}

/// `cargo xtask gate`: trains the scene gate's network, replaces the one that the engine carries, and asks LiteRT's
/// interpreter for the answers that the engine's tests are held to.
pub(crate) fn train_gate(arguments: &[String]) -> Result<(), Error> {
    process::run(
        process::cargo()
            .args(["run", "--release", "--package", "gripline-training", "--", "gate"])
            .args(arguments),
    )?;
    let folder = process::products().join(LITERT[0].replace("==", "-"));
    if !folder.join("ai_edge_litert").is_dir() {
        process::run(
            Command::new("python3")
                .args(["-m", "pip", "install", "--quiet", "--target"])
                .arg(&folder)
                .args(LITERT),
        )?;
    }
    process::run(
        Command::new("python3")
            .env("PYTHONPATH", folder)
            .arg(process::root().join("host/network/checks/gate_golden.py")),
    )
}

/// The shared library of onnxruntime, installed when it is not there yet.
fn onnxruntime() -> Result<PathBuf, Error> {
    let folder = process::products().join(ONNXRUNTIME.replace("==", "-"));
    if let Some(library) = shared_library(&folder) {
        return Ok(library);
    }
    process::run(
        Command::new("python3")
            .args(["-m", "pip", "install", "--quiet", "--no-deps", "--target"])
            .arg(&folder)
            .arg(ONNXRUNTIME),
    )?;
    shared_library(&folder).ok_or_else(|| Error::Product {
        what: format!("the Python package {ONNXRUNTIME}"),
        found: "no library named *onnxruntime.so* in onnxruntime/capi".to_owned(),
        expected: "one, for engines to be compared; is there a package for this system?".to_owned(),
    })
}

fn shared_library(folder: &Path) -> Option<PathBuf> {
    let names = ["libonnxruntime.so", "libonnxruntime.1", "onnxruntime.dll"];
    let files = std::fs::read_dir(folder.join("onnxruntime").join("capi")).ok()?;
    files.flatten().map(|file| file.path()).find(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        names.iter().any(|start| name.starts_with(start))
    })
}
