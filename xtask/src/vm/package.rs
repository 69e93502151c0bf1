//! `cargo xtask package --check`: the Debian package on a machine with Debian's own dpkg, systemd and udev, in the virtual
//! machine: installed, started with a camera and a microcontroller on USB, hung, stopped, removed (tests/vm, `checks/package`).
//!
//! The machine is Debian's packages unpacked side by side, with a list of what is installed: the scripts of the packages do not
//! run, so neither root nor a chroot is needed. systemd is the first process; our checks are a service of its.

use std::fmt::Write as _;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::{REST, Tools, boot, build, judge, modules, take_rest_pictures};
use crate::cpio::Archive;
use crate::debian::Packages;
use crate::error::Error;
use crate::{package, process};

/// What the machine consists of, beside what these depend on.
const PACKAGES: [&str; 21] = [
    "base-files",
    "base-passwd",
    "bash",
    "coreutils",
    "dash",
    "debianutils",
    "diffutils",
    "dpkg",
    "findutils",
    "grep",
    "gzip",
    "init-system-helpers",
    "libc-bin",
    "libgcc-s1",
    "mount",
    "perl-base",
    "sed",
    "systemd-sysv",
    "tar",
    "udev",
    "usr-is-merged",
];
/// Folders that nobody reads in there.
const LEFT_OUT: [&str; 5] = [
    "./usr/share/doc/*",
    "./usr/share/man/*",
    "./usr/share/locale/*",
    "./usr/lib/udev/hwdb.d/*",
    "./usr/share/bash-completion/*",
];
/// The service that checks. The first process starts it when the machine is up.
const CHECKS: &str = "\
[Unit]
Description=Checks of the package
After=systemd-udevd.service systemd-udev-settle.service
Wants=systemd-udev-settle.service

[Service]
ExecStart=/init package
StandardOutput=tty
StandardError=tty
TTYPath=/dev/console
";
/// systemd goes straight to the checks' target: no logins, no timers.
const TO_THE_KERNEL: &str = "rdinit=/usr/lib/systemd/systemd systemd.unit=checks.target systemd.show_status=0 \
                             systemd.log_level=warning";

/// Builds the package with this profile, boots, and judges.
pub(crate) fn run(profile: &str) -> Result<(), Error> {
    let built = build(profile)?;
    let package = package::of_program(&built.join("gripline"))?;
    let home = process::products().join("vm");
    let tools = Tools::ensure(&home)?;
    take_rest_pictures(&built, &home.join(REST[0]))?;
    let root = debian(&home.join("debian"))?;
    let image = home.join("debian.cpio");
    let mut archive = Archive::default();
    archive.tree(&root)?;
    let read = |path: &Path| fs::read(path).map_err(|source| Error::file(path, source));
    archive.program("init", &super::stripped(&built, "gripline-vm", &home)?);
    archive.file("gripline.deb", &read(&package)?);
    for name in REST {
        archive.file(name, &read(&home.join(name))?);
    }
    // A machine without one asks its owner about everything.
    archive.file("etc/machine-id", b"0123456789abcdef0123456789abcdef\n");
    archive.file("etc/systemd/system/checks.service", CHECKS.as_bytes());
    archive.file(
        "etc/systemd/system/checks.target",
        b"[Unit]\nRequires=basic.target\nAfter=basic.target\nWants=checks.service\n",
    );
    modules::add(&mut archive, &tools.modules)?;
    fs::write(&image, archive.finish()).map_err(|source| Error::file(&image, source))?;
    let lines = boot(&tools, &image, TO_THE_KERNEL)?;
    judge(&lines)
}

/// The file system of a small Debian with dpkg's list of what is installed; made once.
fn debian(home: &Path) -> Result<PathBuf, Error> {
    let root = home.join("root");
    let complete = home.join("complete");
    let wanted = PACKAGES.join(" ");
    if fs::read_to_string(&complete).is_ok_and(|made| made == wanted) {
        return Ok(root);
    }
    eprintln!("vm: unpacking a small Debian (about 40 MB of packages)");
    if root.exists() {
        fs::remove_dir_all(&root).map_err(|source| Error::file(&root, source))?;
    }
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |source| Error::file(&path, source)
    };
    // As Debian's installer does before it unpacks: the old folders are links into /usr.
    for folder in ["bin", "sbin", "lib", "lib64"] {
        let place = root.join("usr").join(folder);
        fs::create_dir_all(&place).map_err(failed(&place))?;
        symlink(format!("usr/{folder}"), root.join(folder)).map_err(failed(&root))?;
    }
    let packages = Packages::for_an_empty_machine(home)?;
    let mut status = String::new();
    for file in packages.fetch(&PACKAGES, true)? {
        unpack(&file, &root)?;
        status += &installed(&file, &root)?;
    }
    let list = root.join("var/lib/dpkg/status");
    fs::write(&list, status).map_err(failed(&list))?;
    // What the script of base-passwd does.
    for name in ["passwd", "group"] {
        let (from, to) = (
            root.join(format!("usr/share/base-passwd/{name}.master")),
            root.join("etc").join(name),
        );
        fs::copy(&from, &to).map_err(failed(&from))?;
    }
    fs::write(&complete, wanted).map_err(failed(&complete))?;
    Ok(root)
}

/// Unpacks a package's files; links to folders stay what they are.
fn unpack(package: &Path, root: &Path) -> Result<(), Error> {
    let start = |command: &mut Command| {
        command.spawn().map_err(|source| Error::Start {
            program: command.get_program().to_string_lossy().into(),
            source,
        })
    };
    let mut files = start(
        Command::new("dpkg-deb")
            .arg("--fsys-tarfile")
            .arg(package)
            .stdout(Stdio::piped()),
    )?;
    let mut tar = Command::new("tar");
    tar.args(["-x", "--keep-directory-symlink", "--no-same-owner", "-C"])
        .arg(root)
        .args(LEFT_OUT.map(|pattern| format!("--exclude={pattern}")));
    if let Some(out) = files.stdout.take() {
        tar.stdin(out);
    }
    let unpacked = start(&mut tar)?.wait().is_ok_and(|status| status.success());
    let read = files.wait().is_ok_and(|status| status.success());
    if unpacked && read {
        return Ok(());
    }
    Err(Error::Failed {
        command: format!("dpkg-deb --fsys-tarfile {} | tar -x", package.display()),
        status: "it is said above why".to_owned(),
        said: String::new(),
    })
}

/// The package as dpkg lists it once it is installed.
fn installed(package: &Path, root: &Path) -> Result<String, Error> {
    let fields = process::output(Command::new("dpkg-deb").arg("--field").arg(package))?;
    let field = |name: &str| {
        fields
            .lines()
            .find_map(|line| line.strip_prefix(&format!("{name}: ")))
    };
    let mut name = field("Package").unwrap_or_default().to_owned();
    if field("Multi-Arch") == Some("same") {
        let _ = write!(name, ":{}", field("Architecture").unwrap_or_default());
    }
    let list = root.join(format!("var/lib/dpkg/info/{name}.list"));
    fs::create_dir_all(list.parent().unwrap_or(root))
        .and_then(|()| fs::write(&list, "/.\n"))
        .map_err(|source| Error::file(&list, source))?;
    Ok(format!("{}\nStatus: install ok installed\n\n", fields.trim_end()))
}
