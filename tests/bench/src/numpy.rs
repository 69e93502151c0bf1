//! The NumPy detector as a process of its own that answers in turns with ours, one thread, the same maps in its memory.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT, TAXELS};
use npyz::WriterBuilder as _;
use serde_json::Value;

use crate::failure::Failure;
use crate::rule::{BLOCK, CONTACT_MIN, Decision, FRICTION, THRESHOLD};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/numpy_detector.py");

/// How it is called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Call {
    /// All maps at once.
    Batch,
    /// One call a map.
    Frames,
}

/// The process.
pub(crate) struct Numpy {
    child: Child,
    words: ChildStdin,
    answers: BufReader<ChildStdout>,
    /// Its version.
    pub(crate) version: String,
    _folder: tempfile::TempDir,
}

impl Numpy {
    /// Starts it on these maps; `packages` is the folder with the package.
    pub(crate) fn start(packages: &Path, maps: &[[[f32; 3]; TAXELS]]) -> Result<Self, Failure> {
        let folder = tempfile::tempdir()?;
        let file = folder.path().join("maps.npy");
        write(&file, maps)?;
        let share = |value: u16| (f64::from(value) / f64::from(PER_UNIT)).to_string();
        let mut child = Command::new("python3")
            .arg(SCRIPT)
            .arg(&file)
            .args([share(FRICTION), share(THRESHOLD)])
            .arg((f64::from(CONTACT_MIN) / f64::from(LSB_PER_NEWTON)).to_string())
            .env("PYTHONPATH", packages)
            .envs(["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"].map(|name| (name, "1")))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("`python3` cannot be started: {error}; install Python 3 with pip"))?;
        let words = child
            .stdin
            .take()
            .ok_or("the NumPy detector has no standard input")?;
        let answers = child
            .stdout
            .take()
            .ok_or("the NumPy detector has no standard output")?;
        let mut numpy = Self {
            child,
            words,
            answers: BufReader::new(answers),
            version: String::new(),
            _folder: folder,
        };
        numpy.version = text(&numpy.ask("decide")?["numpy"]);
        // Once for the caches.
        numpy.ask(&format!("frames {BLOCK}"))?;
        Ok(numpy)
    }

    fn ask(&mut self, word: &str) -> Result<Value, Failure> {
        writeln!(self.words, "{word}")?;
        let mut line = String::new();
        self.answers.read_line(&mut line)?;
        if line.is_empty() {
            return Err("the NumPy detector ended; what it said stands above".into());
        }
        Ok(serde_json::from_str(&line)?)
    }

    /// Seconds for all maps, in blocks where each has a call of its own.
    pub(crate) fn seconds(&mut self, call: Call) -> Result<Vec<f64>, Failure> {
        let word = match call {
            Call::Batch => "batch".to_owned(),
            Call::Frames => format!("frames {BLOCK}"),
        };
        let answer = self.ask(&word)?;
        let seconds = answer["seconds"]
            .as_array()
            .ok_or("the NumPy detector printed no time")?;
        Ok(seconds.iter().filter_map(Value::as_f64).collect())
    }

    /// What it decides about every map; forces are not asked for.
    pub(crate) fn decide(&mut self) -> Result<Vec<Decision>, Failure> {
        let answer = self.ask("decide")?;
        let list = |name: &str| answer[name].as_array().cloned().unwrap_or_default();
        let number = |value: &Value| value.as_u64().unwrap_or(u64::MAX) as u16;
        Ok(list("contact")
            .iter()
            .zip(&list("stick"))
            .zip(&list("slip"))
            .map(|((contact, stick), slip)| Decision {
                contact: number(contact),
                stick: number(stick),
                slips: slip.as_bool().unwrap_or(false),
                force_n: [f64::NAN; 3],
            })
            .collect())
    }
}

impl Drop for Numpy {
    fn drop(&mut self) {
        // Nothing is lost with it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or("of unknown version").to_owned()
}

fn write(path: &Path, maps: &[[[f32; 3]; TAXELS]]) -> Result<(), Failure> {
    let file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut writer = npyz::WriteOptions::<f32>::new()
        .default_dtype()
        .shape(&[maps.len() as u64, 3, 20, 20])
        .writer(file)
        .begin_nd()?;
    for map in maps {
        for axis in 0..3 {
            writer.extend(map.iter().map(|force| force[axis]))?;
        }
    }
    writer.finish()?;
    Ok(())
}
