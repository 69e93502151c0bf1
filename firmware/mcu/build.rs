//! Tells the linker where the repository's memory.x lies, adds hot.x and identity.x to the image, and puts the commit that the image is
//! built from into its environment.

use std::path::Path;
use std::process::Command;

/// What goes into the image, seen from the repository.
const SOURCES: [&str; 6] = [
    "firmware",
    "protocol",
    "Cargo.toml",
    "Cargo.lock",
    "memory.x",
    ".cargo",
];

fn main() {
    println!("cargo:rerun-if-changed=../../memory.x");
    println!("cargo:rerun-if-changed=hot.x");
    println!("cargo:rerun-if-changed=identity.x");
    println!("cargo:rerun-if-changed=build.rs");
    if std::env::var_os("CARGO_FEATURE_SILICON").is_none() {
        return;
    }
    let here = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets this for every build script");
    let repository = Path::new(&here)
        .ancestors()
        .nth(2)
        .expect("the firmware lies in the repository");
    println!("cargo:rustc-link-search={}", repository.display());
    // First come, first served: what hot.x places must not be link.x's any more.
    println!("cargo:rustc-link-arg-bin=gripline-mcu=-T{here}/hot.x");
    println!("cargo:rustc-link-arg-bin=gripline-mcu=-T{here}/identity.x");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");

    // Without git, or outside a repository, the image does not know its commit.
    let git = |arguments: &[&str]| {
        let output = Command::new("git")
            .args(arguments)
            .current_dir(repository)
            .output()
            .ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    // This log grows with every commit, checkout and rebase.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={}", repository.join(log).display());
    }
    for source in SOURCES {
        println!("cargo:rerun-if-changed={}", repository.join(source).display());
    }
    let commit = git(&["rev-parse", "--short=8", "HEAD"]).filter(|commit| commit.len() >= 8);
    let changes = git(&[&["status", "--porcelain", "--"], &SOURCES[..]].concat());
    println!(
        "cargo:rustc-env=GRIPLINE_COMMIT={}",
        commit.as_deref().map_or("", |commit| &commit[..8])
    );
    let clean = changes.is_some_and(|changes| changes.is_empty());
    println!("cargo:rustc-env=GRIPLINE_CLEAN={}", u8::from(clean));
}
