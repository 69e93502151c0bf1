//! `cargo xtask vm`: boots a Debian kernel in qemu, without KVM, and runs `gripline` in it against a virtual camera (vivid)
//! and virtual microcontrollers on USB (dummy_hcd); see tests/vm for the checks.
//!
//! What the machine lacks is fetched as Debian packages with the machine's own apt settings, unpacked under
//! `target/gripline/vm` and used from there; nothing is installed. Limits: a Linux host of the x86-64 kind with Debian's
//! apt, or with qemu installed and a Debian kernel unpacked there.

mod modules;
pub(crate) mod package;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use self::modules::KERNEL;
use crate::cpio::Archive;
use crate::debian::Packages;
use crate::error::Error;
use crate::process;

const QEMU: &str = "qemu-system-x86_64";
/// The kernel hands it to the first process, which reads it there.
const ONLY: &str = "GRIPLINE_ONLY";
/// Memory of the virtual machine; the image lies in it twice while it boots.
const MEMORY_MIB: &str = "1536";
/// The whole has to be over by then: it takes four minutes, more on a busy machine.
const PATIENCE: Duration = Duration::from_mins(12);

/// `cargo xtask vm`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let mut profile = "release";
    let mut only = None;
    let mut rest = arguments.iter();
    while let Some(option) = rest.next() {
        match (option.as_str(), rest.next()) {
            ("--profile", Some(value)) => profile = value,
            ("--only", Some(value)) if is_word(value) => only = Some(value.as_str()),
            ("--only", Some(value)) => {
                return Err(Error::usage("--only", value, "a word of checks' names"));
            }
            _ => {
                return Err(Error::usage(
                    "argument",
                    option,
                    "--profile PROFILE, --only WORD or none",
                ));
            }
        }
    }
    run(profile, only)
}

/// What can stand in the kernel's command line as it is.
fn is_word(text: &str) -> bool {
    !text.is_empty() && text.chars().all(char::is_alphanumeric)
}

/// Builds what is needed with this profile, boots and judges: every check, or only those with this word in their name.
pub(crate) fn run(profile: &str, only: Option<&str>) -> Result<(), Error> {
    let built = build(profile)?;
    let home = process::products().join("vm");
    let tools = Tools::ensure(&home)?;
    let scene = home.join("scene.mcap");
    record_scene(&built, &scene)?;
    take_rest_pictures(&built, &home.join(REST[0]))?;
    let image = home.join("image.cpio");
    write_image(&image, &built, &scene, &tools)?;
    let lines = boot(&tools, &image, &format!("{ONLY}={}", only.unwrap_or_default()))?;
    judge(&lines)
}

/// Builds our programs; returns their folder.
fn build(profile: &str) -> Result<PathBuf, Error> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return Err(Error::Product {
            what: "this machine".to_owned(),
            found: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            expected: "Linux on x86-64: the virtual machine runs programs that are built here".to_owned(),
        });
    }
    process::build(
        profile,
        &[("gripline", "gripline"), ("gripline-vm", "gripline-vm")],
    )
}

/// What is needed beside our own programs.
struct Tools {
    /// Where packages were unpacked; an installed qemu needs none of it.
    root: PathBuf,
    qemu: PathBuf,
    kernel: PathBuf,
    /// Folder of the kernel's modules.
    modules: PathBuf,
    busybox: PathBuf,
}

impl Tools {
    /// Finds or fetches everything.
    fn ensure(home: &Path) -> Result<Self, Error> {
        let root = home.join("root");
        let installed = process::word_of(Command::new("which").arg(QEMU))
            .ok()
            .map(PathBuf::from);
        let unpacked = root.join("usr/bin").join(QEMU);
        if installed.is_none() && !unpacked.is_file() {
            eprintln!("vm: no {QEMU} here; fetching Debian's");
            Packages::of_this_machine(home)?.unpack(&root, &["qemu-system-x86"], true)?;
        }
        let busybox = root.join("bin/busybox");
        if !busybox.is_file() {
            Packages::of_this_machine(home)?.unpack(&root, &["busybox-static"], false)?;
        }
        let kernel = || newest(&root.join("boot"), "vmlinuz-");
        if kernel().is_none() {
            let output = process::word_of(Command::new("apt-cache").args(["depends", KERNEL]))?;
            let name = output.lines().find_map(|line| {
                line.trim()
                    .strip_prefix("Depends: ")
                    .filter(|name| name.starts_with("linux-image-"))
            });
            let name = name.ok_or_else(|| Error::Product {
                what: format!("`apt-cache depends {KERNEL}`"),
                found: "no kernel".to_owned(),
                expected: "the package of one: run `apt-get update` as root".to_owned(),
            })?;
            eprintln!("vm: fetching {name} (about 70 MB)");
            Packages::of_this_machine(home)?.unpack(&root, &[name], false)?;
        }
        let missing = |what: &str| Error::Product {
            what: what.to_owned(),
            found: format!("none in {}", root.display()),
            expected: "one from Debian's packages: delete the folder and run again".to_owned(),
        };
        let kernel = kernel().ok_or_else(|| missing("kernel"))?;
        let release = kernel
            .file_name()
            .and_then(|name| name.to_str()?.strip_prefix("vmlinuz-").map(str::to_owned));
        let modules = root
            .join("lib/modules")
            .join(release.unwrap_or_default())
            .join("kernel");
        let qemu = installed.unwrap_or(unpacked);
        for (what, path) in [
            ("qemu", &qemu),
            ("kernel modules", &modules),
            ("busybox", &busybox),
        ] {
            if !path.exists() {
                return Err(missing(what));
            }
        }
        Ok(Self {
            root,
            qemu,
            kernel,
            modules,
            busybox,
        })
    }
}

/// The file in `folder` whose name begins so and comes last.
fn newest(folder: &Path, start: &str) -> Option<PathBuf> {
    let found = fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    found
        .filter(|path| {
            path.file_name()
                .is_some_and(|name| name.to_string_lossy().starts_with(start))
        })
        .max()
}

/// The scripted scene, as the small network sees it: to play the simulated fingertip itself takes too long in there.
fn record_scene(built: &Path, scene: &Path) -> Result<(), Error> {
    let _ = fs::remove_file(scene);
    let mut command = Command::new(built.join("gripline"));
    command
        .args([
            "run",
            "--source",
            "sim",
            "--network",
            "unet",
            "--seconds",
            "1.7",
            "--unpaced",
        ])
        .args(["--record-pictures", "small", "--record"]);
    process::output(command.arg(scene)).map(drop)
}

/// The calibration with rest pictures of the simulated fingertip: the file that names the others comes first.
const REST: [&str; 3] = ["rest.toml", "rest-rest.npy", "rest-rest.png"];

fn take_rest_pictures(built: &Path, calibration: &Path) -> Result<(), Error> {
    // What an earlier run has left would be compared with.
    let _ = fs::remove_file(calibration);
    let mut command = Command::new(built.join("gripline"));
    command
        .args(["calibrate", "rest", "--source", "sim", "--yes", "--out"])
        .arg(calibration);
    process::output(&mut command).map(drop)
}

/// Our programs with their shared libraries, busybox, the scene, and the modules: the machine's first and only file system.
fn write_image(image: &Path, built: &Path, scene: &Path, tools: &Tools) -> Result<(), Error> {
    let read = |path: &Path| fs::read(path).map_err(|source| Error::file(path, source));
    let home = image.parent().unwrap_or(built);
    let mut archive = Archive::default();
    for folder in ["bin", "dev", "modules"] {
        archive.folder(folder);
    }
    // The first words are said before there are devices.
    archive.device("dev/console", [5, 1]);
    archive.program("init", &stripped(built, "gripline-vm", home)?);
    archive.program("bin/gripline", &stripped(built, "gripline", home)?);
    archive.program("bin/busybox", &read(&tools.busybox)?);
    archive.file("scene.mcap", &read(scene)?);
    for name in REST {
        archive.file(name, &read(&scene.with_file_name(name))?);
    }
    for library in libraries(&[&built.join("gripline-vm"), &built.join("gripline")])? {
        // Programs look for them where they were found here.
        let place = library.display().to_string();
        archive.program(place.trim_start_matches('/'), &read(&library)?);
    }
    modules::add(&mut archive, &tools.modules)?;
    fs::write(image, archive.finish()).map_err(|source| Error::file(image, source))
}

/// A program of ours as a package has it: what a debugger wants is most of the file.
fn stripped(built: &Path, name: &str, home: &Path) -> Result<Vec<u8>, Error> {
    let smaller = home.join(name);
    process::output(
        Command::new("strip")
            .arg("--strip-debug")
            .arg("-o")
            .arg(&smaller)
            .arg(built.join(name)),
    )?;
    fs::read(&smaller).map_err(|source| Error::file(&smaller, source))
}

/// The shared libraries of programs, the loader among them.
fn libraries(programs: &[&Path]) -> Result<Vec<PathBuf>, Error> {
    let mut found = Vec::new();
    for program in programs {
        let output = process::word_of(Command::new("ldd").arg(program))?;
        // `name => /path (address)` or `/path (address)`.
        let paths = output
            .lines()
            .filter_map(|line| line.split_whitespace().find(|word| word.starts_with('/')));
        found.extend(paths.map(PathBuf::from));
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// Boots, with these words to the kernel, and returns what the checks said.
fn boot(tools: &Tools, image: &Path, words: &str) -> Result<Vec<String>, Error> {
    let mut command = Command::new(&tools.qemu);
    // An installed one finds its own.
    if tools.qemu.starts_with(&tools.root) {
        command.env("LD_LIBRARY_PATH", library_folders(&tools.root));
    }
    for folder in ["usr/share/qemu", "usr/share/seabios"] {
        command.arg("-L").arg(tools.root.join(folder));
    }
    command
        .args([
            "-machine",
            "q35",
            "-accel",
            "tcg,thread=multi",
            "-cpu",
            "max",
            "-smp",
            "2",
            "-m",
            MEMORY_MIB,
        ])
        .args([
            "-nodefaults",
            "-no-user-config",
            "-display",
            "none",
            "-serial",
            "stdio",
            "-no-reboot",
        ])
        .arg("-kernel")
        .arg(&tools.kernel)
        .arg("-initrd")
        .arg(image)
        .arg("-append")
        .arg(format!(
            "console=ttyS0 loglevel=1 panic=-1 mitigations=off {words}"
        ));
    eprintln!("$ {}", process::shown(&command));
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|source| Error::Start {
            program: QEMU.to_owned(),
            source,
        })?;
    let Some(console) = child.stdout.take() else {
        return Ok(Vec::new());
    };
    let (sender, lines) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        for line in BufReader::new(console).split(b'\n').map_while(Result::ok) {
            if sender
                .send(String::from_utf8_lossy(&line).trim().to_owned())
                .is_err()
            {
                return;
            }
        }
    });
    let started = Instant::now();
    let mut said = Vec::new();
    while let Ok(line) = lines.recv_timeout(PATIENCE.saturating_sub(started.elapsed())) {
        println!("{line}");
        said.push(line);
    }
    // It has powered off, or its time is up.
    let _ = child.kill();
    let _ = child.wait();
    eprintln!("vm: {:.0} s", started.elapsed().as_secs_f64());
    Ok(said)
}

/// Where the unpacked packages have shared libraries.
fn library_folders(root: &Path) -> String {
    let folders = ["usr/lib/x86_64-linux-gnu", "lib/x86_64-linux-gnu"]
        .map(|folder| root.join(folder).display().to_string());
    folders.join(":")
}

/// Every check has to have said that it is right, and the last word has to have come.
fn judge(lines: &[String]) -> Result<(), Error> {
    let failed: Vec<&str> = lines
        .iter()
        .filter_map(|line| line.strip_prefix("VM FAILED "))
        .collect();
    let right = lines.iter().filter(|line| line.starts_with("VM ok ")).count();
    if failed.is_empty() && right > 0 && lines.iter().any(|line| line == "VM end") {
        println!("{right} checks passed in the virtual machine");
        return Ok(());
    }
    Err(Error::Product {
        what: "virtual machine".to_owned(),
        found: if failed.is_empty() {
            format!("{right} checks and no end: it hung or crashed; its console is above")
        } else {
            format!("{} checks failed: {}", failed.len(), failed.join("; "))
        },
        expected: "every check right, and the end".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_check_a_missing_end_and_silence_are_failures() {
        let judged = |lines: &[&str]| judge(&lines.iter().map(|line| (*line).to_owned()).collect::<Vec<_>>());
        assert!(judged(&["noise", "VM ok a: b (1.0 s)", "VM end"]).is_ok());
        let error = judged(&["VM ok a: b", "VM FAILED c: d", "VM end"])
            .unwrap_err()
            .to_string();
        assert!(error.contains("1 checks failed: c: d"), "{error}");
        for lines in [&["VM ok a: b"][..], &["VM end"], &[]] {
            assert!(
                judged(lines).unwrap_err().to_string().contains("no end"),
                "{lines:?}"
            );
        }
    }
}
