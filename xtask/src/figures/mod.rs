//! `cargo xtask figures`: measures and writes `docs/figures.md`.
//!
//! `docs/figures.toml` says which command measures what, where each figure stands in the JSON that the command prints, and what
//! is wanted. `docs/figures.json` keeps the values that were printed, each measurement with its date, commit and processor, so that
//! one measurement can be made again without the others. The page is written from both and from nothing else. Other pages copy some
//! figures; a test and the command fail where one says another value than the one that was measured last.

mod copies;
mod template;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use self::copies::Copied;
use self::template::{Values, fields, filled};
use crate::error::Error;
use crate::process;

/// `docs/figures.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Plan {
    measurement: Vec<Measurement>,
    /// Where other pages say what was measured.
    #[serde(default)]
    copy: Vec<Copied>,
}

/// One command and the figures that it prints.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measurement {
    name: String,
    title: String,
    /// As a reader types it.
    command: String,
    /// The command before it, where it needs a file, and that file: it is made anew.
    #[serde(default)]
    makes: Option<Made>,
    #[serde(default)]
    figure: Vec<Figure>,
    /// Lists of bounds that the command judges itself.
    #[serde(default)]
    table: Vec<Table>,
}

/// What a command makes for the next.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Made {
    file: String,
    command: String,
}

/// A list in the JSON, an object a row.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    /// Pointer of the list.
    at: String,
    /// Keys of a row: what it is, what was found, what was wanted, and whether that holds (true or false).
    what: String,
    found: String,
    wanted: String,
    held: String,
}

/// One row of the page.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Figure {
    what: String,
    /// Text with values in it, see [`template`].
    shows: String,
    /// What is wanted, in words.
    #[serde(default)]
    wanted: String,
    /// Pointer of the value that is judged, with the bounds that it has to keep.
    judged: Option<String>,
    max: Option<f64>,
    min: Option<f64>,
    /// Why a bound is missed, or what else has to be known.
    #[serde(default)]
    note: String,
}

/// What one run of a command printed.
#[derive(Serialize, Deserialize)]
struct Measured {
    date: String,
    commit: String,
    processor: String,
    values: Values,
}

type Kept = BTreeMap<String, Measured>;

const PLAN: &str = "docs/figures.toml";
const KEPT: &str = "docs/figures.json";
const PAGE: &str = "docs/figures.md";

/// Measures what is named (`all`: everything), and writes the page. Without a name it only writes the page. Fails when another page copies a
/// figure that has changed.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let (plan, mut kept) = plan_and_kept()?;
    let names: Vec<&str> = plan
        .measurement
        .iter()
        .map(|measurement| measurement.name.as_str())
        .collect();
    if let Some(unknown) = arguments
        .iter()
        .find(|name| *name != "all" && !names.contains(&name.as_str()))
    {
        return Err(Error::usage(
            "measurement",
            unknown,
            &format!("all, {}", names.join(", ")),
        ));
    }
    for measurement in &plan.measurement {
        if arguments
            .iter()
            .any(|name| *name == "all" || *name == measurement.name)
        {
            if let Some(made) = &measurement.makes {
                make(made)?;
            }
            let printed = measure(&measurement.command)?;
            let values = measurement.values(&printed)?;
            let measured = Measured {
                date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string()[..10].to_owned(),
                commit: commit()?,
                processor: processor(),
                values,
            };
            kept.insert(measurement.name.clone(), measured);
            // A later command that fails loses nothing.
            let text =
                serde_json::to_string_pretty(&kept).map_err(|error| wrong(KEPT, &error.to_string()))?;
            write(KEPT, &(text + "\n"))?;
        }
    }
    kept.retain(|name, _| names.contains(&name.as_str()));
    write(PAGE, &page(&plan, &kept)?)?;
    check_copies(&plan, &kept)
}

/// What there is to measure, and what was measured last: nothing where no file keeps it.
fn plan_and_kept() -> Result<(Plan, Kept), Error> {
    let plan = toml::from_str(&read(PLAN)?).map_err(|error| wrong(PLAN, &error.to_string()))?;
    let kept = if path(KEPT).exists() {
        serde_json::from_str(&read(KEPT)?).map_err(|error| wrong(KEPT, &error.to_string()))?
    } else {
        Kept::new()
    };
    Ok((plan, kept))
}

/// Fails when a page does not say what was measured.
fn check_copies(plan: &Plan, kept: &Kept) -> Result<(), Error> {
    let of_all: Values = kept
        .iter()
        .flat_map(|(name, measured)| {
            let values = measured.values.iter();
            values.map(move |(pointer, value)| (format!("/{name}{pointer}"), value.clone()))
        })
        .collect();
    let mut outdated = Vec::new();
    for copied in &plan.copy {
        if let Some(expected) = copied.missing_in(&read(&copied.page)?, &of_all) {
            outdated.push(format!("{}: {expected}", copied.page));
        }
    }
    if outdated.is_empty() {
        return Ok(());
    }
    Err(Error::Product {
        what: "pages that copy figures".to_owned(),
        found: format!("{} that do not say what was measured", outdated.len()),
        expected: outdated.join("\n"),
    })
}

fn path(name: &str) -> PathBuf {
    process::root().join(name)
}

fn read(name: &str) -> Result<String, Error> {
    fs::read_to_string(path(name)).map_err(|source| Error::file(&path(name), source))
}

fn write(name: &str, text: &str) -> Result<(), Error> {
    fs::write(path(name), text).map_err(|source| Error::file(&path(name), source))
}

fn wrong(what: &str, found: &str) -> Error {
    Error::Product {
        what: what.to_owned(),
        found: found.to_owned(),
        expected: format!("what {} describes", file!()),
    }
}

/// A command as it stands in the plan.
fn parse(line: &str) -> Result<Command, Error> {
    let mut words = line.split_whitespace();
    let mut command = match words.next() {
        Some("cargo") => process::cargo(),
        Some(program) => Command::new(program),
        None => return Err(wrong("command", "nothing")),
    };
    command.current_dir(process::root()).args(words);
    Ok(command)
}

/// Makes the file anew.
fn make(made: &Made) -> Result<(), Error> {
    let file = path(&made.file);
    let prepared = if file.exists() {
        fs::remove_file(&file)
    } else {
        fs::create_dir_all(file.with_file_name(""))
    };
    prepared.map_err(|source| Error::file(&file, source))?;
    process::run(&mut parse(&made.command)?)
}

/// Runs a command; the last JSON value that it prints.
fn measure(line: &str) -> Result<Value, Error> {
    eprintln!("$ {line}");
    // A missed bound ends some commands with code 1, and is what the page is for.
    let output = parse(line)?
        .stderr(std::process::Stdio::inherit())
        .output()
        .map_err(|source| Error::Start {
            program: line.to_owned(),
            source,
        })?;
    let text = String::from_utf8_lossy(&output.stdout);
    last_json(&text).ok_or_else(|| Error::Failed {
        command: line.to_owned(),
        status: output.status.to_string(),
        said: "printed no JSON".to_owned(),
    })
}

/// The whole text as one value, or its last line that is an object.
fn last_json(text: &str) -> Option<Value> {
    serde_json::from_str(text).ok().or_else(|| {
        let objects = text.lines().rev().filter(|line| line.starts_with('{'));
        objects.flat_map(serde_json::from_str).next()
    })
}

impl Measurement {
    /// Every value that its figures show or judge.
    fn values(&self, printed: &Value) -> Result<Values, Error> {
        let mut values = Values::new();
        for figure in &self.figure {
            let shown = fields(&figure.shows).into_iter().map(|field| field.pointer);
            for pointer in shown.chain(figure.judged.clone()) {
                let value = printed.pointer(&pointer).ok_or_else(|| {
                    wrong(&format!("`{}`", self.command), &format!("no value at {pointer}"))
                })?;
                values.insert(pointer, value.clone());
            }
        }
        for table in &self.table {
            let list = printed.pointer(&table.at).filter(|list| list.is_array());
            let list = list.ok_or_else(|| {
                wrong(
                    &format!("`{}`", self.command),
                    &format!("no list at {}", table.at),
                )
            })?;
            values.insert(table.at.clone(), list.clone());
        }
        Ok(values)
    }
}

impl Figure {
    /// `held`, `missed`, or nothing where nothing is judged.
    fn verdict(&self, values: &Values) -> &'static str {
        let Some(value) = self
            .judged
            .as_ref()
            .and_then(|pointer| values.get(pointer))
            .and_then(Value::as_f64)
        else {
            return "";
        };
        let holds = self.max.is_none_or(|max| value <= max) && self.min.is_none_or(|min| value >= min);
        judged(holds)
    }
}

fn judged(holds: bool) -> &'static str {
    if holds { "held" } else { "**missed**" }
}

/// A value of a row; numbers with at most four digits behind the point.
fn cell(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => {
            let rounded = (number.as_f64().unwrap_or(f64::NAN) * 1e4).round() / 1e4;
            rounded.to_string()
        }
        other => other.to_string(),
    }
}

fn page(plan: &Plan, kept: &Kept) -> Result<String, Error> {
    let mut text = String::from(
        "# Figures\n\nWritten by `cargo xtask figures` from what the commands below print; do not edit. `cargo xtask figures NAME` \
         measures one section anew, `all` every one.\n",
    );
    for measurement in &plan.measurement {
        let values = kept.get(&measurement.name);
        let made = values.map_or_else(
            || "not measured yet".to_owned(),
            |measured| {
                format!(
                    "{}, commit {}, {}",
                    measured.date, measured.commit, measured.processor
                )
            },
        );
        let none = Values::new();
        let values = values.map_or(&none, |measured| &measured.values);
        write!(
            text,
            "\n## {}\n\n{}`{}` (`{}`; {made})\n\n| what | figure | wanted | |\n|---|---|---|---|\n",
            measurement.title,
            measurement
                .makes
                .as_ref()
                .map_or(String::new(), |made| format!("`{}`, then ", made.command)),
            measurement.command,
            measurement.name
        )
        .map_err(|error| wrong(PAGE, &error.to_string()))?;
        for figure in &measurement.figure {
            let verdict = figure.verdict(values);
            let note = [verdict, figure.note.as_str()]
                .into_iter()
                .filter(|part| !part.is_empty())
                .collect::<Vec<_>>()
                .join("; ");
            writeln!(
                text,
                "| {} | {} | {} | {note} |",
                figure.what,
                filled(&figure.shows, values),
                figure.wanted
            )
            .map_err(|error| wrong(PAGE, &error.to_string()))?;
        }
        for table in &measurement.table {
            let rows = values.get(&table.at).and_then(Value::as_array);
            for row in rows.into_iter().flatten() {
                let verdict = judged(row[&table.held].as_bool().unwrap_or(false));
                let [what, found, wanted] =
                    [&table.what, &table.found, &table.wanted].map(|key| cell(&row[key]));
                writeln!(text, "| {what} | {found} | {wanted} | {verdict} |")
                    .map_err(|error| wrong(PAGE, &error.to_string()))?;
            }
        }
    }
    Ok(text)
}

/// The commit that is checked out; `+` behind it: with changes.
fn commit() -> Result<String, Error> {
    process::word_of(Command::new("git").current_dir(process::root()).args([
        "describe",
        "--always",
        "--abbrev=10",
        "--dirty=+",
        "--exclude",
        "*",
    ]))
}

/// The processor's own name.
fn processor() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find(|line| line.starts_with("model name"));
    name.and_then(|line| line.split_once(": "))
        .map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(shows: &str) -> Figure {
        Figure {
            what: "a figure".to_owned(),
            shows: shows.to_owned(),
            wanted: String::new(),
            judged: Some("/a/0".to_owned()),
            max: Some(2.0),
            min: None,
            note: String::new(),
        }
    }

    #[test]
    fn values_are_taken_by_their_pointers_and_shown_with_factor_and_decimals() {
        let measurement = Measurement {
            name: "m".to_owned(),
            title: "M".to_owned(),
            command: "c".to_owned(),
            makes: None,
            figure: vec![figure("{/a/0*100:1} % of {/b}, {/a/0}")],
            table: Vec::new(),
        };
        let printed = serde_json::json!({"a": [0.5], "b": "all"});
        let values = measurement
            .values(&printed)
            .expect("every pointer leads somewhere");
        assert_eq!(
            filled(&measurement.figure[0].shows, &values),
            "50.0 % of all, 0.5"
        );
        assert_eq!(measurement.figure[0].verdict(&values), "held");
        let missing = measurement.values(&serde_json::json!({"a": [3]}));
        assert!(missing.expect_err("b is missing").to_string().contains("/b"));
    }

    #[test]
    fn a_value_beyond_its_bound_is_called_missed() {
        let values = Values::from([("/a/0".to_owned(), serde_json::json!(2.5))]);
        assert_eq!(figure("{/a/0:1}").verdict(&values), "**missed**");
    }

    #[test]
    fn every_page_that_copies_figures_says_what_was_measured() {
        let (plan, kept) = plan_and_kept().unwrap();
        assert!(!plan.copy.is_empty());
        check_copies(&plan, &kept).unwrap();
    }

    #[test]
    fn the_last_object_of_a_stream_counts_and_text_before_it_does_not() {
        assert_eq!(
            last_json("{\"a\":1}\n{\"a\":2}\ndone"),
            Some(serde_json::json!({"a": 2}))
        );
        assert_eq!(last_json("{\n\"a\": 1\n}\n"), Some(serde_json::json!({"a": 1})));
        assert_eq!(last_json("nothing"), None);
    }
}
