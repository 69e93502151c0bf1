//! Makes this machine able to compile for another target: a core library for the microcontroller, a standard library for
//! 64-bit ARM.
//!
//! Three ways, the first that works is taken: the installed compiler has the target already; rustup adds it; or the
//! libraries are built once from sources of exactly the compiler's version (rustup's `rust-src`, an unpacked
//! `/usr/src/rustc-VERSION`, or Debian's `rust-src` from the machine's own archive, read through private lists that leave
//! the system's alone). Limits: the last source needs a Debian machine.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use crate::debian::Packages;
use crate::error::Error;
use crate::process;

/// A target that is compiled for, and the libraries that it needs.
pub(crate) struct Target {
    pub(crate) triple: &'static str,
    /// Short name, for the folder of libraries built here.
    name: &'static str,
    /// What cargo builds, with these features.
    crates: &'static str,
    features: &'static [&'static str],
    /// What a panic does in the libraries.
    panic: &'static str,
    /// Libraries that have to come out.
    libraries: &'static [&'static str],
}

/// The Cortex-M4 with its floating-point unit.
pub(crate) const MCU: Target = Target {
    triple: "thumbv7em-none-eabihf",
    name: "thumb",
    crates: "core,alloc",
    features: &["-Zbuild-std-features=compiler-builtins-mem"],
    panic: "abort",
    libraries: &["core", "alloc", "compiler_builtins"],
};

/// Linux on 64-bit ARM.
pub(crate) const ARM: Target = Target {
    triple: "aarch64-unknown-linux-gnu",
    name: "aarch64",
    crates: "std,panic_unwind,test,proc_macro",
    features: &[],
    panic: "unwind",
    libraries: &["core", "alloc", "std", "panic_unwind", "test", "proc_macro"],
};

/// The suites of a Debian archive that may hold the sources, smallest first. Relative names, so that they stay right
/// when a release becomes old: for a machine on `oldstable`, `stable-backports` is its successor's.
const SUITES: [&str; 6] = [
    "stable-backports",
    "oldstable-backports",
    "oldoldstable-backports",
    "stable",
    "testing",
    "unstable",
];

/// A target's libraries, which match the compiler.
pub(crate) struct Libraries {
    target: &'static Target,
    /// Where it lies when it is not in the compiler's own folder.
    sysroot: Option<PathBuf>,
}

impl Libraries {
    /// What cargo has to be told beyond `--target`; adds to the flags in `.cargo/config.toml`.
    pub(crate) fn cargo_arguments(&self) -> Vec<String> {
        self.sysroot.as_ref().map_or_else(Vec::new, |sysroot| {
            let flag = format!("--sysroot={}", sysroot.display());
            vec![
                "--config".to_owned(),
                format!("target.{}.rustflags=[{}]", self.target.triple, toml_string(&flag)),
            ]
        })
    }
}

/// The compiler, as far as libraries have to match it.
struct Compiler {
    /// Everything `rustc -vV` says; cached libraries with another text are rebuilt.
    identity: String,
    release: String,
    sysroot: PathBuf,
}

impl Compiler {
    fn installed() -> Result<Self, Error> {
        let identity = process::word_of(process::rustc().arg("-vV"))?;
        let release = identity
            .lines()
            .find_map(|line| line.strip_prefix("release: "))
            .unwrap_or("unknown")
            .to_owned();
        let sysroot = PathBuf::from(process::word_of(process::rustc().args(["--print", "sysroot"]))?);
        Ok(Self {
            identity,
            release,
            sysroot,
        })
    }
}

/// `cargo xtask toolchain`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let (mut target, mut from_sources) = (&MCU, false);
    for argument in arguments {
        match argument.as_str() {
            "--arm" => target = &ARM,
            "--from-sources" => from_sources = true,
            found => return Err(Error::usage("argument", found, "--arm, --from-sources or none")),
        }
    }
    let libraries = ensure(target, from_sources)?;
    match libraries.sysroot {
        None => println!("sysroot {}", Compiler::installed()?.sysroot.display()),
        Some(sysroot) => println!("sysroot {}", sysroot.display()),
    }
    Ok(())
}

/// Finds or makes a target's libraries. `from_sources` passes over the ways that need no building.
pub(crate) fn ensure(target: &'static Target, from_sources: bool) -> Result<Libraries, Error> {
    let compiler = Compiler::installed()?;
    let triple = target.triple;
    let found = |sysroot| Ok(Libraries { target, sysroot });
    let mut tried = Vec::new();
    if !from_sources {
        if has_libraries(&compiler.sysroot, target) {
            eprintln!("toolchain: rustc {} has {triple}", compiler.release);
            return found(None);
        }
        eprintln!(
            "toolchain: rustc {} has no {triple}; asking rustup for it",
            compiler.release
        );
        match process::output(
            Command::new("rustup")
                .current_dir(process::root())
                .args(["target", "add", triple]),
        ) {
            Ok(_) if has_libraries(&compiler.sysroot, target) => {
                eprintln!("toolchain: rustup added {triple}");
                return found(None);
            }
            Ok(_) => tried.push(note(
                "rustup target add",
                "added it to another toolchain than the one in use",
            )),
            Err(error) => tried.push(note("rustup target add", &error.to_string())),
        }
    }
    let home = process::products().join(format!("{}-{}", target.name, compiler.release));
    let sysroot = home.join("sysroot");
    if has_libraries(&sysroot, target)
        && fs::read_to_string(sysroot.join("rustc")).is_ok_and(|built_for| built_for == compiler.identity)
    {
        eprintln!(
            "toolchain: using the libraries built earlier, {}",
            sysroot.display()
        );
        return found(Some(sysroot));
    }
    match library_sources(&compiler, &mut tried) {
        Some(library) => {
            build(target, &compiler, &library, &home, &sysroot)?;
            found(Some(sysroot))
        }
        None => Err(Error::NoTarget {
            target: triple,
            tried,
            rustc: compiler.release,
        }),
    }
}

fn note(way: &str, end: &str) -> (String, String) {
    eprintln!("toolchain: {way}: {end}");
    (way.to_owned(), end.to_owned())
}

fn has_libraries(sysroot: &Path, target: &Target) -> bool {
    let folder = sysroot.join("lib/rustlib").join(target.triple).join("lib");
    let Ok(files) = fs::read_dir(folder) else {
        return false;
    };
    let names: Vec<String> = files
        .flatten()
        .map(|file| file.file_name().to_string_lossy().into_owned())
        .collect();
    target.libraries.iter().all(|library| {
        let start = format!("lib{library}-");
        names.iter().any(|name| name.starts_with(&start))
    })
}

/// The folder `library` of the compiler's own version, from this machine or from the distribution's archive.
fn library_sources(compiler: &Compiler, tried: &mut Vec<(String, String)>) -> Option<PathBuf> {
    let release = &compiler.release;
    let home = process::products().join(format!("rust-src-{release}"));
    let unpacked = home.join("source");
    for (way, library) in [
        (
            "rustup's rust-src",
            compiler.sysroot.join("lib/rustlib/src/rust/library"),
        ),
        (
            "sources in /usr/src",
            PathBuf::from(format!("/usr/src/rustc-{release}/library")),
        ),
        (
            "sources unpacked earlier",
            unpacked.join(format!("usr/src/rustc-{release}/library")),
        ),
    ] {
        if library.join("core/src/lib.rs").is_file() {
            eprintln!("toolchain: {way}: {}", library.display());
            return Some(library);
        }
        tried.push(note(way, &format!("no {}", library.display())));
    }
    let library = unpacked.join(format!("usr/src/rustc-{release}/library"));
    for suite in SUITES {
        match debian_sources(suite, release, &home, &unpacked) {
            Ok(()) if library.join("core/src/lib.rs").is_file() => return Some(library),
            Ok(()) => tried.push(note(
                &format!("Debian's rust-src from {suite}"),
                "holds no library/core",
            )),
            Err(why) => tried.push(note(&format!("Debian's rust-src from {suite}"), &why.to_string())),
        }
    }
    None
}

/// Fetches the sources of exactly `release` from one suite of the machine's archive and unpacks them.
fn debian_sources(suite: &str, release: &str, home: &Path, unpacked: &Path) -> Result<(), Error> {
    eprintln!("toolchain: reading the package list of {suite}");
    let packages = Packages::of_suite(home, suite)?;
    let listed = packages.apt("apt-cache", &["madison", "rust-src"])?;
    let versions = versions_of(&listed);
    let Some(version) = versions.iter().find(|version| upstream(version) == release) else {
        return Err(Error::Product {
            what: format!("rust-src in {suite}"),
            found: if versions.is_empty() {
                "none".to_owned()
            } else {
                versions.join(", ")
            },
            expected: release.to_owned(),
        });
    };
    eprintln!("toolchain: downloading rust-src {version} (about 45 MB)");
    packages.unpack(unpacked, &[&format!("rust-src={version}")], false)
}

/// The versions in the table that `apt-cache madison` prints: `package | version | where`.
fn versions_of(table: &str) -> Vec<String> {
    table
        .lines()
        .filter_map(|line| Some(line.split('|').nth(1)?.trim().to_owned()))
        .collect()
}

/// The upstream version in a Debian one: `1.95.0+dfsg1-2~bpo13+1` is 1.95.0.
fn upstream(version: &str) -> &str {
    let end = version
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(version.len());
    &version[..end]
}

/// Compiles the libraries and lays them out as a sysroot, as one step.
fn build(
    target: &Target,
    compiler: &Compiler,
    library: &Path,
    home: &Path,
    sysroot: &Path,
) -> Result<(), Error> {
    let started = Instant::now();
    let build = home.join(format!("build-{}", std::process::id()));
    let write = |name: &str, text: &str| {
        let path = build.join(name);
        fs::write(&path, text).map_err(|source| Error::file(&path, source))
    };
    fs::create_dir_all(build.join("src")).map_err(|source| Error::file(&build, source))?;
    // An empty crate with its own workspace: what is wanted is only what it stands on.
    write(
        "Cargo.toml",
        &format!(
            "[workspace]\n[package]\nname = \"empty\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\
             [profile.release]\nopt-level = 3\ndebug = 1\npanic = \"{}\"\ncodegen-units = 16\n",
            target.panic
        ),
    )?;
    write("src/lib.rs", "#![no_std]\n")?;
    let target_dir = build.join("target");
    // Bitcode, because the image is linked with fat LTO; the same path prefix as in released libraries. The
    // compiler accepts its own version's unstable library sources only when told that it builds itself.
    let flags = [
        "-Cembed-bitcode=yes",
        "-Cforce-frame-pointers=no",
        &format!("--remap-path-prefix={}=/rustc/library", library.display()),
    ]
    .join("\u{1f}");
    process::run(
        process::cargo()
            .current_dir(&build)
            .args(["build", "--quiet", "--release", "--target", target.triple])
            .arg(format!("-Zbuild-std={}", target.crates))
            .args(target.features)
            .env("CARGO_TARGET_DIR", &target_dir)
            .env("CARGO_ENCODED_RUSTFLAGS", flags)
            .env("RUSTC_BOOTSTRAP", "1")
            .env("__CARGO_TESTS_ONLY_SRC_ROOT", library)
            .env_remove("RUSTFLAGS"),
    )?;
    let partial = home.join(format!("sysroot-{}", std::process::id()));
    let destination = partial.join("lib/rustlib").join(target.triple).join("lib");
    fs::create_dir_all(&destination).map_err(|source| Error::file(&destination, source))?;
    let built = target_dir.join(target.triple).join("release/deps");
    for file in fs::read_dir(&built)
        .map_err(|source| Error::file(&built, source))?
        .flatten()
    {
        let name = file.file_name().to_string_lossy().into_owned();
        if !name.starts_with("libempty-") && file.path().extension().is_some_and(|end| end == "rlib") {
            fs::copy(file.path(), destination.join(&name))
                .map_err(|source| Error::file(&file.path(), source))?;
        }
    }
    if !has_libraries(&partial, target) {
        return Err(Error::Product {
            what: format!("libraries in {}", built.display()),
            found: "not all of them".to_owned(),
            expected: target.libraries.join(", "),
        });
    }
    let stamp = partial.join("rustc");
    fs::write(&stamp, &compiler.identity).map_err(|source| Error::file(&stamp, source))?;
    let _ = fs::remove_dir_all(sysroot);
    fs::rename(&partial, sysroot).map_err(|source| Error::file(sysroot, source))?;
    let _ = fs::remove_dir_all(&build);
    eprintln!(
        "toolchain: built {} in {:.0} s",
        sysroot.display(),
        started.elapsed().as_secs_f64()
    );
    Ok(())
}

/// A TOML basic string; paths may hold backslashes or quotes.
fn toml_string(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_upstream_version_is_read_exactly() {
        assert_eq!(upstream("1.95.0+dfsg1-2~bpo13+1"), "1.95.0");
        assert_eq!(upstream("1.95.0-1"), "1.95.0");
        assert_ne!(upstream("1.95.01-1"), "1.95.0");
        assert_eq!(upstream("1.96.1~beta"), "1.96.1");
    }

    #[test]
    fn the_versions_on_offer_are_read_from_the_table() {
        let table = "  rust-src | 1.96.1+dfsg1-2 | somewhere\n  rust-src | 1.95.0+dfsg1-2 | somewhere\n";
        assert_eq!(versions_of(table), ["1.96.1+dfsg1-2", "1.95.0+dfsg1-2"]);
    }

    #[test]
    fn a_path_with_quotes_and_backslashes_stays_one_string() {
        assert_eq!(toml_string(r#"a\b"c"#), r#""a\\b\"c""#);
    }
}
