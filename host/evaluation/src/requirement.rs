//! What an evaluation must show, and whether it does: a row of its page's table and of its JSON.

use serde::Serialize;

use super::document::table;

/// A measure, what is wanted of it, and what was found; a figure that is not there holds nothing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Requirement {
    /// What is measured, with its unit.
    pub measure: String,
    /// What is wanted of it.
    pub bound: String,
    /// What was found.
    pub figure: String,
    /// Whether it held.
    pub held: bool,
}

impl Requirement {
    /// A row.
    #[must_use]
    pub fn new(measure: &str, bound: impl Into<String>, figure: String, held: bool) -> Self {
        Self {
            measure: measure.to_owned(),
            bound: bound.into(),
            figure,
            held,
        }
    }
}

/// All of them in Markdown.
#[must_use]
pub fn requirements_table(requirements: &[Requirement]) -> String {
    let rows: Vec<Vec<String>> = requirements
        .iter()
        .map(|row| {
            let verdict = if row.held { "held" } else { "**missed**" };
            vec![
                row.measure.clone(),
                row.bound.clone(),
                row.figure.clone(),
                verdict.to_owned(),
            ]
        })
        .collect();
    table(&["measure", "bound", "figure", ""], &rows)
}
