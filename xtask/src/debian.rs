//! Debian packages, unpacked into a folder of ours without root; where a program must be installed, root does it.
//! Limits: a Debian machine with apt and dpkg-deb.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::process;

/// Whether this program may install packages.
pub(crate) fn is_root() -> bool {
    process::output(Command::new("id").arg("-u")).is_ok_and(|id| id.trim() == "0")
}

/// Installs packages, which root may; reads the machine's package lists again when they are out of date.
pub(crate) fn install(names: &[&str]) -> Result<(), Error> {
    let install = || {
        process::run(
            Command::new("apt-get")
                .env("DEBIAN_FRONTEND", "noninteractive")
                .args(["install", "--yes", "-qq", "--no-install-recommends"])
                .args(names),
        )
    };
    if install().is_ok() {
        return Ok(());
    }
    process::run(Command::new("apt-get").args(["update", "-qq"]))?;
    install()
}

/// A place to download packages to, with apt's settings for it.
pub(crate) struct Packages {
    folder: PathBuf,
    options: Vec<String>,
}

impl Packages {
    /// Packages of the machine's own suites.
    pub(crate) fn of_this_machine(home: &Path) -> Result<Self, Error> {
        Self::new(home.join("download"), Vec::new())
    }

    /// Packages of the machine's own suites, as a machine gets them on which nothing is installed.
    pub(crate) fn for_an_empty_machine(home: &Path) -> Result<Self, Error> {
        let mut packages = Self::new(home.join("download"), Vec::new())?;
        let status = home.join("nothing-installed");
        fs::write(&status, "").map_err(|source| Error::file(&status, source))?;
        packages
            .options
            .push(format!("Dir::State::status={}", status.display()));
        Ok(packages)
    }

    /// Packages of another suite of the machine's own archive, with lists of its own, so that the system's stay as they are.
    pub(crate) fn of_suite(home: &Path, suite: &str) -> Result<Self, Error> {
        let (address, key) = archive()?;
        let folder = home.join("apt").join(suite);
        for part in ["lists/partial", "cache/archives/partial"] {
            let path = folder.join(part);
            fs::create_dir_all(&path).map_err(|source| Error::file(&path, source))?;
        }
        let list = folder.join("sources.list");
        fs::write(&list, format!("deb {key}{address} {suite} main\n"))
            .map_err(|source| Error::file(&list, source))?;
        let shown = folder.display();
        let options = vec![
            format!("Dir::Etc::sourcelist={shown}/sources.list"),
            "Dir::Etc::sourceparts=/dev/null".to_owned(),
            format!("Dir::State::lists={shown}/lists"),
            format!("Dir::Cache={shown}/cache"),
        ];
        let packages = Self::new(folder.join("download"), options)?;
        packages.apt("apt-get", &["update", "-qq"])?;
        Ok(packages)
    }

    fn new(folder: PathBuf, options: Vec<String>) -> Result<Self, Error> {
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(folder.join("partial")).map_err(|source| Error::file(&folder, source))?;
        Ok(Self { folder, options })
    }

    /// Runs one of apt's programs with these settings; returns what it printed.
    pub(crate) fn apt(&self, program: &str, arguments: &[&str]) -> Result<String, Error> {
        let mut command = Command::new(program);
        command.current_dir(&self.folder).env("LC_ALL", "C");
        // A root apt would hand the download to a user who may not write here.
        command.args(["-o", "APT::Sandbox::User=root"]);
        // Only the package list is wanted, not the catalogues that desktops read.
        command.args(["-o", "Acquire::Languages=none"]);
        command.args(["-o", "Acquire::IndexTargets::deb::DEP-11::DefaultEnabled=false"]);
        for option in &self.options {
            command.args(["-o", option]);
        }
        process::output(command.args(arguments))
    }

    /// Downloads packages, as [`Self::fetch`] does, and unpacks them into `root`.
    pub(crate) fn unpack(&self, root: &Path, names: &[&str], with_dependencies: bool) -> Result<(), Error> {
        fs::create_dir_all(root).map_err(|source| Error::file(root, source))?;
        for package in self.fetch(names, with_dependencies)? {
            process::output(Command::new("dpkg-deb").arg("-x").arg(&package).arg(root))?;
        }
        let _ = fs::remove_dir_all(&self.folder);
        Ok(())
    }

    /// Downloads packages, with what the machine lacks of their dependencies if wanted; returns their files.
    /// Reads the machine's package lists again when they are out of date.
    pub(crate) fn fetch(&self, names: &[&str], with_dependencies: bool) -> Result<Vec<PathBuf>, Error> {
        if let Err(first) = self.download(names, with_dependencies) {
            eprintln!("packages: {first}; reading the package lists anew");
            self.apt("apt-get", &["update", "-qq"])?;
            self.download(names, with_dependencies)?;
        }
        let entries = fs::read_dir(&self.folder).map_err(|source| Error::file(&self.folder, source))?;
        let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        files.retain(|file| file.extension().is_some_and(|end| end == "deb"));
        files.sort();
        Ok(files)
    }

    fn download(&self, names: &[&str], with_dependencies: bool) -> Result<String, Error> {
        if !with_dependencies {
            return self.apt("apt-get", &[&["-qq", "download"], names].concat());
        }
        let archives = format!("Dir::Cache::archives={}", self.folder.display());
        let install = [
            "-qq",
            "-o",
            "Debug::NoLocking=true",
            "-o",
            &archives,
            "install",
            "--yes",
            "--download-only",
            "--no-install-recommends",
        ];
        self.apt("apt-get", &[&install[..], names].concat())
    }
}

/// Address of the machine's main archive, whose path ends in `/debian`, and the option that names its key.
fn archive() -> Result<(String, String), Error> {
    let listed = process::output(Command::new("apt-get").args([
        "indextargets",
        "--format",
        "$(REPO_URI) $(SIGNED_BY)",
        "Created-By: Packages",
    ]))?;
    main_archive(&listed).ok_or_else(|| Error::Product {
        what: "`apt-get indextargets`".to_owned(),
        found: "no Debian archive".to_owned(),
        expected: "a line with one in /etc/apt/sources.list or /etc/apt/sources.list.d".to_owned(),
    })
}

/// The first line `ADDRESS/debian KEY`; apt leaves the key's name as it is where there is none.
fn main_archive(listed: &str) -> Option<(String, String)> {
    listed.lines().find_map(|line| {
        let (address, key) = line.split_once(' ')?;
        let address = address.trim_end_matches('/');
        let option = if key.starts_with('/') {
            format!("[signed-by={key}] ")
        } else {
            String::new()
        };
        address.ends_with("/debian").then(|| (address.to_owned(), option))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_main_archive_is_taken_and_not_the_security_one() {
        let listed = "https://mirror.invalid/debian-security/ $(SIGNED_BY)\n\
                      https://mirror.invalid/debian/ $(SIGNED_BY)\n";
        let address = "https://mirror.invalid/debian".to_owned();
        assert_eq!(main_archive(listed), Some((address.clone(), String::new())));
        let signed = "https://mirror.invalid/debian /keys/debian.gpg\n";
        assert_eq!(
            main_archive(signed),
            Some((address, "[signed-by=/keys/debian.gpg] ".to_owned()))
        );
        assert_eq!(main_archive("https://mirror.invalid/other/ /key\n"), None);
    }
}
