//! Reads one section of a scene file by the list of keys, with the line of everything. Pure.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use super::error::SceneError;
use super::keys::{Absent, KEYS, Key, Kind, SECTIONS};

/// Characters of a value that a message shows.
const SHOWN_MAX: usize = 40;

/// Former names, which scene files may still use, and the current ones.
const FORMER: [(&str, &str); 1] = [("twist_nmm", "moment_nmm")];

/// The key's current name.
fn current(name: &str) -> &str {
    FORMER
        .iter()
        .find(|(former, _)| *former == name)
        .map_or(name, |(_, current)| current)
}

/// The text of a scene file.
#[derive(Debug)]
pub(super) struct Source<'a> {
    pub(super) file: PathBuf,
    pub(super) text: &'a str,
}

impl Source<'_> {
    /// Line of a byte, from 1.
    pub(super) fn line(&self, byte: usize) -> usize {
        let before = self.text.get(..byte).unwrap_or(self.text);
        1 + before.matches('\n').count()
    }
}

/// One section under reading.
#[derive(Debug)]
pub(super) struct Section<'a> {
    source: &'a Source<'a>,
    table: &'a DeTable<'a>,
    /// The section in the list of keys.
    id: &'static str,
    /// What messages put before a key: `path[2].`.
    prefix: String,
    /// Line of its heading.
    pub(super) line: usize,
    used: RefCell<BTreeSet<&'static str>>,
}

impl<'a> Section<'a> {
    /// The section `id` in `table`; every key must be on the list.
    pub(super) fn new(
        source: &'a Source<'a>,
        table: &'a DeTable<'a>,
        id: &'static str,
        prefix: String,
        line: usize,
    ) -> Result<Self, SceneError> {
        let section = Self {
            source,
            table,
            id,
            prefix,
            line,
            used: RefCell::default(),
        };
        let mut unknown: Vec<_> = table
            .keys()
            .filter(|name| !section.names().any(|known| known == current(name.get_ref())))
            .collect();
        unknown.sort_by_key(|name| name.span().start);
        match unknown.first() {
            None => Ok(section),
            Some(name) => {
                let line = source.line(name.span().start);
                Err(section.unknown(name.get_ref(), line))
            }
        }
    }

    /// Keys of this section, and the sections under the head.
    fn names(&self) -> impl Iterator<Item = &'static str> {
        let id = self.id;
        let below = SECTIONS
            .iter()
            .filter(move |_| id.is_empty())
            .map(|(name, _)| *name);
        KEYS.iter()
            .filter(move |key| key.section == id)
            .map(|key| key.name)
            .chain(below)
    }

    fn unknown(&self, name: &str, line: usize) -> SceneError {
        let near = self
            .names()
            .map(|known| (distance(name, known), known))
            .min()
            .filter(|(distance, known)| {
                *distance <= 1 + known.len() / 3 || known.split('_').next() == name.split('_').next()
            });
        let elsewhere = KEYS.iter().find(|key| key.name == name);
        let advice = match (near, elsewhere) {
            (_, Some(key)) if key.section.is_empty() => {
                format!("move {name} to the head of the file, above the first [section]")
            }
            (_, Some(key)) => format!("move {name} to [{}]", key.section),
            (Some((_, near)), None) => format!("did you mean {near}?"),
            (None, None) => "remove it".to_owned(),
        };
        let names: Vec<_> = self.names().collect();
        let expected = if names.len() > 16 {
            "a key of this section".to_owned()
        } else {
            format!("one of {}", names.join(", "))
        };
        self.problem_at(line, name, "a key that is not known here", &expected, &advice)
    }

    /// A problem with `name`, where it stands or where it should.
    pub(super) fn problem(&self, name: &str, found: &str, expected: &str, advice: &str) -> SceneError {
        let line = self
            .table
            .get_key_value(name)
            .map_or(self.line, |(key, _)| self.source.line(key.span().start));
        self.problem_at(line, name, found, expected, advice)
    }

    fn problem_at(&self, line: usize, name: &str, found: &str, expected: &str, advice: &str) -> SceneError {
        SceneError {
            file: self.source.file.as_path().into(),
            line,
            key: format!("{}{name}: ", self.prefix).into(),
            found: found.into(),
            expected: expected.into(),
            advice: advice.into(),
        }
    }

    /// What stands at a span, in one short line.
    fn shown(&self, value: &toml::Spanned<DeValue<'a>>) -> String {
        let text = self.source.text.get(value.span()).unwrap_or_default();
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        let cut: String = text.chars().take(SHOWN_MAX).collect();
        if cut.len() < text.len() {
            format!("{cut}…")
        } else {
            cut
        }
    }

    fn wrong(&self, key: &Key, value: &toml::Spanned<DeValue<'a>>) -> SceneError {
        let found = self.shown(value);
        let advice = match (&key.kind, value.get_ref()) {
            (Kind::Number(..) | Kind::Whole(..) | Kind::Numbers(..), DeValue::String(_)) => {
                "write the number without quotes and unit".to_owned()
            }
            (Kind::Numbers(count, ..), _) => {
                format!("write {} = [{}]", key.name, vec!["0.0"; *count].join(", "))
            }
            (Kind::Text | Kind::Choice(_), DeValue::String(_)) => "choose one of these".to_owned(),
            (Kind::Text | Kind::Choice(_), _) => "write it between quotes".to_owned(),
            _ => "change it".to_owned(),
        };
        self.problem(key.name, &found, &key.kind.expected(), &advice)
    }

    fn value(&self, key: &'static Key) -> Result<Option<&'a toml::Spanned<DeValue<'a>>>, SceneError> {
        debug_assert_eq!(key.section, self.id, "{}", key.name);
        self.used.borrow_mut().insert(key.name);
        let value = self.table.get(key.name).or_else(|| {
            let mut given = self.table.iter();
            given.find_map(|(name, value)| (current(name.get_ref()) == key.name).then_some(value))
        });
        match (value, &key.absent) {
            (None, Absent::Required) => Err(self.missing(key, "")),
            (value, _) => Ok(value),
        }
    }

    /// The error of a key that has to be given; `why` says when.
    pub(super) fn missing(&self, key: &Key, why: &str) -> SceneError {
        let heading = if self.prefix.is_empty() {
            "the head of the file"
        } else {
            "this section"
        };
        self.problem(
            key.name,
            &format!("nothing{why}"),
            &key.kind.expected(),
            &format!("add {} to {heading}", key.name),
        )
    }

    /// Where files that the scene names are looked for.
    pub(super) fn directory(&self) -> &Path {
        self.source.file.parent().unwrap_or(Path::new(""))
    }

    /// A number, where it is given.
    pub(super) fn number_if(&self, key: &'static Key) -> Result<Option<f64>, SceneError> {
        let Some(value) = self.value(key)? else {
            return Ok(None);
        };
        let Kind::Number(_, min, max) = key.kind else {
            unreachable!("{} is no number", key.name)
        };
        in_range(value.get_ref(), min, max)
            .map(Some)
            .ok_or_else(|| self.wrong(key, value))
    }

    /// A number with a default, or one that has to be given.
    pub(super) fn number(&self, key: &'static Key) -> Result<f64, SceneError> {
        match (self.number_if(key)?, &key.absent) {
            (Some(found), _) => Ok(found),
            (None, Absent::Number(default)) => Ok(*default),
            (None, _) => Err(self.missing(key, "")),
        }
    }

    /// Numbers, where they are given.
    pub(super) fn numbers_if<const N: usize>(
        &self,
        key: &'static Key,
    ) -> Result<Option<[f64; N]>, SceneError> {
        let Some(value) = self.value(key)? else {
            return Ok(None);
        };
        let Kind::Numbers(count, _, min, max) = key.kind else {
            unreachable!("{} are no numbers", key.name)
        };
        debug_assert_eq!(count, N);
        let numbers = value.get_ref().as_array().filter(|array| array.len() == N);
        let mut out = [0.0; N];
        for (place, out) in out.iter_mut().enumerate() {
            *out = numbers
                .and_then(|array| in_range(array.get(place)?.get_ref(), min, max))
                .ok_or_else(|| self.wrong(key, value))?;
        }
        Ok(Some(out))
    }

    /// A course over time, where it is given: pairs of time and value, at least one, times not falling.
    pub(super) fn course_if(&self, key: &'static Key) -> Result<Option<Vec<[f64; 2]>>, SceneError> {
        let Some(value) = self.value(key)? else {
            return Ok(None);
        };
        let Kind::Course(_, min, max) = key.kind else {
            unreachable!("{} is no course", key.name)
        };
        let pair = |pair: &DeValue<'_>| -> Option<[f64; 2]> {
            let pair = pair.as_array().filter(|pair| pair.len() == 2)?;
            let time_s = in_range(pair.first()?.get_ref(), 0.0, f64::MAX)?;
            Some([time_s, in_range(pair.get(1)?.get_ref(), min, max)?])
        };
        value
            .get_ref()
            .as_array()
            .and_then(|array| array.iter().map(|entry| pair(entry.get_ref())).collect())
            .filter(|course: &Vec<[f64; 2]>| {
                !course.is_empty() && course.windows(2).all(|pair| pair[0][0] <= pair[1][0])
            })
            .map(Some)
            .ok_or_else(|| self.wrong(key, value))
    }

    /// A whole number, where it is given.
    pub(super) fn whole_if(&self, key: &'static Key) -> Result<Option<u64>, SceneError> {
        let Some(value) = self.value(key)? else {
            return Ok(None);
        };
        let Kind::Whole(min, max) = key.kind else {
            unreachable!("{} is no whole number", key.name)
        };
        value
            .get_ref()
            .as_integer()
            .and_then(|number| u64::from_str_radix(number.as_str(), number.radix()).ok())
            .filter(|number| (min..=max).contains(number))
            .map(Some)
            .ok_or_else(|| self.wrong(key, value))
    }

    /// A whole number with a default.
    pub(super) fn whole(&self, key: &'static Key) -> Result<u64, SceneError> {
        match (self.whole_if(key)?, &key.absent) {
            (Some(found), _) => Ok(found),
            (None, Absent::Whole(default)) => Ok(*default),
            (None, _) => Err(self.missing(key, "")),
        }
    }

    /// A text, where it is given; of a choice, one of its names.
    pub(super) fn text_if(&self, key: &'static Key) -> Result<Option<&'a str>, SceneError> {
        let Some(value) = self.value(key)? else {
            return Ok(None);
        };
        let text = value.get_ref().as_str().ok_or_else(|| self.wrong(key, value))?;
        match key.kind {
            Kind::Choice(names) if !names.contains(&text) => Err(self.wrong(key, value)),
            _ => Ok(Some(text)),
        }
    }

    /// A text with a default, or one that has to be given.
    pub(super) fn text(&self, key: &'static Key) -> Result<&'a str, SceneError> {
        match (self.text_if(key)?, &key.absent) {
            (Some(found), _) => Ok(found),
            (None, Absent::Text(default)) => Ok(default),
            (None, _) => Err(self.missing(key, "")),
        }
    }

    /// The section `id` under this one, empty where it is not given.
    pub(super) fn section(&self, id: &'static str) -> Result<Option<Section<'a>>, SceneError> {
        self.used.borrow_mut().insert(id);
        let Some((name, value)) = self.table.get_key_value(id) else {
            return Ok(None);
        };
        let line = self.source.line(name.span().start);
        let table = value.get_ref().as_table().ok_or_else(|| {
            let found = self.shown(value);
            self.problem(
                id,
                &found,
                &format!("a section [{id}]"),
                &format!("begin it with a line [{id}]"),
            )
        })?;
        Section::new(self.source, table, id, format!("{id}."), line).map(Some)
    }

    /// The sections `[[id]]` under this one, in order; there may be none.
    pub(super) fn sections_if(&self, id: &'static str) -> Result<Vec<Section<'a>>, SceneError> {
        if self.table.contains_key(id) {
            self.sections(id)
        } else {
            self.used.borrow_mut().insert(id);
            Ok(Vec::new())
        }
    }

    /// The section `id`, which has to be there.
    pub(super) fn required(&self, id: &'static str) -> Result<Section<'a>, SceneError> {
        self.section(id)?.ok_or_else(|| {
            self.problem(
                id,
                "nothing",
                &format!("a section [{id}]"),
                &format!("begin it with a line [{id}]"),
            )
        })
    }

    /// The sections `[[id]]` under this one, in order; at least one.
    pub(super) fn sections(&self, id: &'static str) -> Result<Vec<Section<'a>>, SceneError> {
        self.used.borrow_mut().insert(id);
        let expected = format!("one or more sections [[{id}]]");
        let advice = format!("begin each with a line [[{id}]]");
        let Some(value) = self.table.get(id) else {
            return Err(self.problem(id, "nothing", &expected, &advice));
        };
        let wrong = || self.problem(id, &self.shown(value), &expected, &advice);
        let array = value
            .get_ref()
            .as_array()
            .filter(|array| !array.is_empty())
            .ok_or_else(wrong)?;
        array
            .iter()
            .enumerate()
            .map(|(place, value)| {
                let table = value.get_ref().as_table().ok_or_else(wrong)?;
                let line = self.source.line(value.span().start);
                Section::new(self.source, table, id, format!("{id}[{}].", place + 1), line)
            })
            .collect()
    }

    /// Ends reading: a key that was not read belongs to another choice of `by`.
    pub(super) fn finish(&self, by: &str) -> Result<(), SceneError> {
        let used = self.used.borrow();
        let mut left: Vec<_> = self
            .table
            .keys()
            .filter(|name| !used.contains(current(name.get_ref())))
            .collect();
        left.sort_by_key(|name| name.span().start);
        let Some(name) = left.first() else {
            return Ok(());
        };
        let known: Vec<_> = used.iter().copied().collect();
        Err(self.problem(
            name.get_ref(),
            &format!("a key that {by} does not use"),
            &format!("one of {}", known.join(", ")),
            "remove it",
        ))
    }
}

/// A finite number of the range; whole ones may be written without a point.
fn in_range(value: &DeValue<'_>, min: f64, max: f64) -> Option<f64> {
    let number: f64 = match value {
        DeValue::Float(float) => float.as_str().parse().ok()?,
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix()).ok()? as f64,
        _ => return None,
    };
    (min..=max).contains(&number).then_some(number)
}

/// Levenshtein's distance.
fn distance(one: &str, other: &str) -> usize {
    let other: Vec<char> = other.chars().collect();
    let mut row: Vec<usize> = (0..=other.len()).collect();
    for (i, a) in one.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, b) in other.iter().enumerate() {
            let replaced = diagonal + usize::from(a != *b);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[other.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_between_words_counts_letters_to_change() {
        for (one, other, expected) in [
            ("", "abc", 3),
            ("radius_mm", "radius_mm", 0),
            ("raduis_mm", "radius_mm", 2),
            ("radius", "radius_mm", 3),
            ("kitten", "sitting", 3),
        ] {
            assert_eq!(distance(one, other), expected, "{one} {other}");
            assert_eq!(distance(other, one), expected, "{one} {other}");
        }
    }
}
