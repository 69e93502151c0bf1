//! Figures that other pages copy: the text that a page has to have, as it follows from what was measured last.

use serde::Deserialize;

use super::template::{Values, filled};

/// A copy.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Copied {
    /// The page.
    pub(super) page: String,
    /// Text with values in it; a pointer begins with the measurement's name.
    text: String,
}

impl Copied {
    /// What the page should say and does not. Where its lines break does not matter.
    pub(super) fn missing_in(&self, page: &str, measured: &Values) -> Option<String> {
        let expected = filled(&self.text, measured);
        (!says(&on_one_line(page), &on_one_line(&expected))).then_some(expected)
    }
}

/// Whether a text is in the page, and no number goes on before or behind it.
fn says(page: &str, text: &str) -> bool {
    let goes_on = |character: char| character.is_ascii_digit() || ",.".contains(character);
    page.match_indices(text).any(|(at, _)| {
        let behind = page[at + text.len()..].starts_with(|character: char| character.is_ascii_digit());
        !page[..at].ends_with(goes_on) && !behind
    })
}

fn on_one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_that_says_another_value_is_told_which_one_it_should_say() {
        let copied = Copied {
            page: "README.md".to_owned(),
            text: "{/grasps/drops} of {/grasps/all:,} dropped".to_owned(),
        };
        let measured = Values::from([
            ("/grasps/drops".to_owned(), serde_json::json!(3)),
            ("/grasps/all".to_owned(), serde_json::json!(1_000)),
        ]);
        assert_eq!(copied.missing_in("It is 3 of\n  1,000 dropped.", &measured), None);
        let missing = copied.missing_in("It is 13 of 1,000 dropped.", &measured);
        assert_eq!(missing.as_deref(), Some("3 of 1,000 dropped"));
        let other = copied.missing_in("not measured of 1,000 dropped", &Values::new());
        assert!(other.is_some_and(|text| text.contains("not measured")));
    }
}
