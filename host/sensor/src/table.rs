//! One section of a description under reading: takes keys by type and range, and notes what is wrong. Pure.

use std::cell::RefCell;
use std::ops::RangeInclusive;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::Problem;

/// Characters of a value that a message shows.
const SHOWN_MAX: usize = 40;
/// From this likeness on a key is taken for a slip of the pen.
const LIKE: f64 = 0.6;

/// Line of a byte, from 1.
pub(crate) fn line_of(text: &str, byte: usize) -> usize {
    1 + text.get(..byte).unwrap_or(text).matches('\n').count()
}

/// A section under reading. Reading never fails: it notes a problem and goes on with a value that is in range.
#[derive(Debug)]
pub(crate) struct Section<'a> {
    text: &'a str,
    table: Option<&'a DeTable<'a>>,
    name: &'static str,
    line: usize,
    known: RefCell<Vec<&'static str>>,
    problems: &'a RefCell<Vec<Problem>>,
}

impl<'a> Section<'a> {
    /// The head of the file.
    pub(crate) fn head(text: &'a str, table: &'a DeTable<'a>, problems: &'a RefCell<Vec<Problem>>) -> Self {
        Self {
            text,
            table: Some(table),
            name: "",
            line: 1,
            known: RefCell::default(),
            problems,
        }
    }

    /// The section `name` under this one.
    pub(crate) fn section(&self, name: &'static str) -> Self {
        self.known.borrow_mut().push(name);
        let found = self.table.and_then(|table| table.get_key_value(name));
        let table = found.and_then(|(_, value)| value.get_ref().as_table());
        if table.is_none() {
            self.note(name, "no such section", &format!("[{name}]"), "add it");
        }
        Self {
            text: self.text,
            table,
            name,
            line: found.map_or(1, |(key, _)| line_of(self.text, key.span().start)),
            known: RefCell::default(),
            problems: self.problems,
        }
    }

    /// Whether anything was noted so far.
    pub(crate) fn has_problems(&self) -> bool {
        !self.problems.borrow().is_empty()
    }

    /// Notes every key that was not read.
    pub(crate) fn finish(&self) {
        let known = self.known.borrow();
        for key in self.table.into_iter().flat_map(DeTable::keys) {
            let name: &str = key.get_ref();
            if known.contains(&name) {
                continue;
            }
            let near = known
                .iter()
                .map(|known| (strsim::normalized_damerau_levenshtein(name, known), known))
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|(likeness, _)| *likeness >= LIKE);
            let advice = near.map_or_else(
                || "remove it".to_owned(),
                |(_, near)| format!("did you mean {near}?"),
            );
            self.note(
                name,
                "an unknown key",
                &format!("one of {}", known.join(", ")),
                &advice,
            );
        }
    }

    /// Notes a problem with `key`, where it stands or where it should.
    pub(crate) fn note(&self, key: &str, found: &str, expected: &str, advice: &str) {
        let line = self
            .table
            .and_then(|table| table.get_key_value(key))
            .map_or(self.line, |(key, _)| line_of(self.text, key.span().start));
        let point = if self.name.is_empty() { "" } else { "." };
        self.problems.borrow_mut().push(Problem {
            line,
            key: format!("{}{point}{key}", self.name),
            found: found.to_owned(),
            expected: expected.to_owned(),
            advice: advice.to_owned(),
        });
    }

    /// A number in `range`.
    pub(crate) fn number(&self, key: &'static str, range: RangeInclusive<f64>) -> f64 {
        let expected = format!("a number from {} to {}", range.start(), range.end());
        self.read(key, &expected, *range.start(), |value| number(value, &range))
    }

    /// So many numbers in `range`.
    pub(crate) fn numbers<const N: usize>(&self, key: &'static str, range: RangeInclusive<f64>) -> [f64; N] {
        let expected = format!("{N} numbers from {} to {}", range.start(), range.end());
        self.read(key, &expected, [*range.start(); N], |value| {
            array(value, |value| number(value, &range))
        })
    }

    /// Least and most, both in `range`.
    pub(crate) fn span(&self, key: &'static str, range: RangeInclusive<f64>) -> [f64; 2] {
        let [min, max] = self.numbers(key, range);
        if min > max {
            self.note(key, &format!("[{min}, {max}]"), "least and most", "swap the two");
        }
        [min, max]
    }

    /// So many whole numbers in `range`.
    pub(crate) fn wholes<const N: usize>(
        &self,
        key: &'static str,
        range: RangeInclusive<usize>,
    ) -> [usize; N] {
        let expected = format!("{N} whole numbers from {} to {}", range.start(), range.end());
        self.read(key, &expected, [*range.start(); N], |value| {
            array(value, |value| whole(value, &range))
        })
    }

    /// A whole number in `range`.
    pub(crate) fn whole(&self, key: &'static str, range: RangeInclusive<usize>) -> usize {
        let expected = format!("a whole number from {} to {}", range.start(), range.end());
        self.read(key, &expected, *range.start(), |value| whole(value, &range))
    }

    /// A text that `accepts`.
    pub(crate) fn text(&self, key: &'static str, expected: &str, accepts: impl Fn(&str) -> bool) -> String {
        self.read(key, expected, String::new(), |value| {
            value.as_str().filter(|text| accepts(text)).map(str::to_owned)
        })
    }

    /// One of these texts, as what it stands for.
    pub(crate) fn choice<T: Copy>(&self, key: &'static str, choices: &[(&str, T)]) -> T {
        let names: Vec<_> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
        self.read(key, &names.join(" or "), choices[0].1, |value| {
            let found = value.as_str()?;
            choices
                .iter()
                .find_map(|(name, choice)| (*name == found).then_some(*choice))
        })
    }

    fn read<T>(
        &self,
        key: &'static str,
        expected: &str,
        otherwise: T,
        take: impl Fn(&DeValue<'_>) -> Option<T>,
    ) -> T {
        self.known.borrow_mut().push(key);
        // What a missing section should hold is in a message of its own.
        let Some(table) = self.table else {
            return otherwise;
        };
        let Some(value) = table.get(key) else {
            self.note(key, "no such key", expected, "add it");
            return otherwise;
        };
        take(value.get_ref()).unwrap_or_else(|| {
            self.note(key, &self.shown(value), expected, "change the value");
            otherwise
        })
    }

    /// What stands there, in one short line.
    fn shown(&self, value: &Spanned<DeValue<'_>>) -> String {
        let text = self.text.get(value.span()).unwrap_or_default();
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        match text.char_indices().nth(SHOWN_MAX) {
            Some((end, _)) => format!("{}…", &text[..end]),
            None => text,
        }
    }
}

fn number(value: &DeValue<'_>, range: &RangeInclusive<f64>) -> Option<f64> {
    let text = match value {
        DeValue::Integer(integer) => integer.as_str(),
        DeValue::Float(float) => float.as_str(),
        _ => return None,
    };
    let number = text.replace('_', "").parse().ok()?;
    range.contains(&number).then_some(number)
}

fn whole(value: &DeValue<'_>, range: &RangeInclusive<usize>) -> Option<usize> {
    let number = value.as_integer()?.as_str().replace('_', "").parse().ok()?;
    range.contains(&number).then_some(number)
}

fn array<T, const N: usize>(value: &DeValue<'_>, take: impl Fn(&DeValue<'_>) -> Option<T>) -> Option<[T; N]> {
    let values: Option<Vec<T>> = value
        .as_array()?
        .iter()
        .map(|value| take(value.get_ref()))
        .collect();
    values?.try_into().ok()
}
