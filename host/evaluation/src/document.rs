//! The document that evaluations write themselves into, each its own section between two marks; the rest stays as it is.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use super::metrics::Scores;
use crate::error::EvaluationError;

/// What a document starts with.
const HEAD: &str = "# Evidence\n\nWritten by `gripline evaluate`; every section says which command made it. Do not edit: run the command again.\n";

/// Puts `body` into the section `name` of the document at `path`, in place of what it was or at the end.
///
/// # Errors
/// A file that cannot be read or written.
pub fn write_section(path: &Path, name: &str, body: &str) -> Result<(), EvaluationError> {
    let before = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => HEAD.to_owned(),
        Err(error) => {
            return Err(EvaluationError::File {
                file: path.display().to_string(),
                found: format!("cannot be read ({error})"),
                expected: "a document in UTF-8 or none: choose another file",
            });
        }
    };
    fs::write(path, with_section(&before, name, body)).map_err(|error| EvaluationError::File {
        file: path.display().to_string(),
        found: format!("cannot be written ({error})"),
        expected: "a file in a folder that exists: choose another place",
    })
}

/// `document` with `body` as its section `name`.
#[must_use]
pub fn with_section(document: &str, name: &str, body: &str) -> String {
    let (begin, end) = (format!("<!-- {name}: begin -->"), format!("<!-- {name}: end -->"));
    let section = format!("{begin}\n{}\n{end}", body.trim_end());
    if let (Some(from), Some(to)) = (document.find(&begin), document.find(&end))
        && from < to
    {
        return format!("{}{section}{}", &document[..from], &document[to + end.len()..]);
    }
    format!("{}\n\n{section}\n", document.trim_end())
}

/// A table in Markdown: its columns and its rows.
#[must_use]
pub fn table(columns: &[&str], rows: &[Vec<String>]) -> String {
    let line =
        |cells: &mut dyn Iterator<Item = &str>| format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "));
    let mut text = line(&mut columns.iter().copied());
    text += &line(&mut columns.iter().map(|_| "---"));
    for row in rows {
        text += &line(&mut row.iter().map(String::as_str));
    }
    text
}

/// Accuracy, precision and recall in a cell.
#[must_use]
pub fn scores_cell(scores: &Scores) -> String {
    [scores.accuracy, scores.precision, scores.recall]
        .map(|share| number(share, 1))
        .join(" / ")
}

/// A number with this many digits after the point; a dash for none.
#[must_use]
pub fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_is_added_once_and_replaced_afterwards() {
        let first = with_section(HEAD, "paper", "one\n");
        let both = with_section(&first, "real", "two");
        let again = with_section(&both, "paper", "three");
        assert!(
            first.starts_with("# Evidence")
                && first.contains("<!-- paper: begin -->\none\n<!-- paper: end -->")
        );
        assert!(both.contains("one") && both.contains("two"));
        assert!(!again.contains("one") && again.contains("three") && again.contains("two"));
        assert_eq!(with_section(&again, "paper", "three"), again);
    }

    #[test]
    fn a_table_has_a_line_for_its_head_one_for_its_rule_and_one_a_row() {
        let text = table(&["a", "b"], &[vec!["1".into(), "2".into()]]);
        assert_eq!(text, "| a | b |\n| --- | --- |\n| 1 | 2 |\n");
    }

    #[test]
    fn what_is_not_there_is_a_dash() {
        let scores = Scores {
            accuracy: Some(99.96),
            precision: None,
            recall: Some(50.0),
        };
        assert_eq!(scores_cell(&scores), "100.0 / – / 50.0");
    }
}
