//! The Python package of `host/python`: `cargo xtask wheel` builds it, `cargo xtask test --all` runs its tests on the wheel that
//! it built. What that needs from PyPI lives in an environment of its own beside the other products.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::{process, venv};

/// What the environment holds: the builder, the package's dependency, the tests' runner, the judge of its types, and what an
/// example draws with.
const PACKAGES: [&str; 5] = [
    "maturin==1.16.0",
    "numpy==2.4.6",
    "pytest==9.2.0",
    "mypy==2.4.1",
    "matplotlib==3.11.2",
];

/// Largest wheel, bytes, weights included.
const WHEEL_MAX: u64 = 15 << 20;

/// `cargo xtask wheel [--bench [--json]]`.
pub(crate) fn wheel(arguments: &[String]) -> Result<(), Error> {
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let bench = match words.as_slice() {
        [] => None,
        ["--bench"] => Some(None),
        ["--bench", json @ "--json"] => Some(Some(json)),
        [other, ..] => return Err(Error::usage("wheel", other, "nothing, --bench or --bench --json")),
    };
    let python = Environment::ensure()?;
    let wheel = python.build("release")?;
    if let Some(option) = bench {
        python.install(&wheel)?;
        let speed = package().join("checks/speed.py");
        process::run(
            python
                .python()
                .arg(speed)
                .arg(command_line("release")?)
                .arg(&wheel)
                .args(option),
        )?;
    }
    Ok(())
}

/// Builds the wheel, installs it and runs the package's tests. They compare with the command line, which is built for that.
pub(crate) fn check() -> Result<(), Error> {
    let python = Environment::ensure()?;
    // As the other tests are built, so that nothing is compiled again.
    let wheel = python.build("dev")?;
    python.install(&wheel)?;
    let program = command_line("dev")?;
    process::run(
        python
            .python()
            .args(["-m", "pytest", "-p", "no:cacheprovider"])
            .current_dir(package())
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env("GRIPLINE", program),
    )
}

/// The program `gripline`, built as the wheel.
fn command_line(profile: &str) -> Result<PathBuf, Error> {
    Ok(process::build(profile, &[("gripline", "gripline")])?.join("gripline"))
}

fn package() -> PathBuf {
    process::root().join("host").join("python")
}

/// A virtual environment with [`PACKAGES`].
struct Environment(PathBuf);

impl Environment {
    fn ensure() -> Result<Self, Error> {
        venv::ensure("python", &PACKAGES).map(Self)
    }

    fn python(&self) -> Command {
        Command::new(self.0.join("bin").join("python"))
    }

    /// Builds the wheel, checks the size of the one that ships and returns its path.
    fn build(&self, profile: &str) -> Result<PathBuf, Error> {
        let folder = process::build_dir().join("wheels");
        // An older wheel would be taken for the new one.
        let _ = fs::remove_dir_all(&folder);
        process::run(
            self.python()
                .args([
                    "-m",
                    "maturin",
                    "build",
                    "--profile",
                    profile,
                    "--locked",
                    "--out",
                ])
                .arg(&folder)
                .arg("--interpreter")
                .arg(self.0.join("bin").join("python"))
                .arg("--manifest-path")
                .arg(package().join("Cargo.toml"))
                .env("CARGO_INCREMENTAL", "0")
                .current_dir(process::root()),
        )?;
        let wheel = only_wheel(&folder)?;
        let size = fs::metadata(&wheel)
            .map_err(|source| Error::file(&wheel, source))?
            .len();
        println!("{}: {size} bytes", wheel.display());
        if profile == "release" && size > WHEEL_MAX {
            return Err(Error::Product {
                what: wheel.display().to_string(),
                found: format!("{size} bytes"),
                expected: format!("at most {WHEEL_MAX}"),
            });
        }
        Ok(wheel)
    }

    fn install(&self, wheel: &Path) -> Result<(), Error> {
        process::run(
            self.python()
                .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"])
                .args(["--no-deps", "--force-reinstall"])
                .arg(wheel),
        )
    }
}

fn only_wheel(folder: &Path) -> Result<PathBuf, Error> {
    let files = fs::read_dir(folder).map_err(|source| Error::file(folder, source))?;
    let mut wheels = files.flatten().map(|file| file.path());
    wheels
        .find(|path| path.extension().is_some_and(|end| end == "whl"))
        .ok_or_else(|| Error::Product {
            what: folder.display().to_string(),
            found: "no wheel".to_owned(),
            expected: "the one that maturin said it built".to_owned(),
        })
}
