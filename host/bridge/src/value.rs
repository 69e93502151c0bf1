//! What people type: numbers within a range, and suggestions for misspelt names.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// A value parser of numbers within a range; its error says what was found and what was expected.
pub(crate) fn number_in(
    range: RangeInclusive<f64>,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    within(range, "a number")
}

/// The same for whole numbers.
pub(crate) fn whole_in<T: FromStr + PartialOrd + Display + Clone + Send + Sync>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync {
    within(range, "a whole number")
}

fn within<T: FromStr + PartialOrd + Display + Clone + Send + Sync>(
    range: RangeInclusive<T>,
    what: &'static str,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync {
    move |text: &str| {
        let value = text.parse().ok().filter(|value| range.contains(value));
        value.ok_or_else(|| {
            format!(
                "found {text}, expected {what} from {} to {}",
                range.start(),
                range.end()
            )
        })
    }
}

/// The likely intended name for `found`.
pub(crate) fn nearest<'a>(found: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    /// A letter wrong, missing or swapped in a name of ordinary length.
    const SIMILAR: f64 = 0.7;
    names
        .into_iter()
        .map(|name| (strsim::normalized_damerau_levenshtein(found, name), name))
        .filter(|(similarity, _)| *similarity >= SIMILAR)
        .max_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_name_finds_the_nearest_and_a_foreign_one_finds_none() {
        let names = ["camera.source", "network.weights", "seed", "gate"];
        assert_eq!(nearest("camera.sorce", names), Some("camera.source"));
        assert_eq!(nearest("network.wieghts", names), Some("network.weights"));
        assert_eq!(nearest("sead", names), Some("seed"));
        assert_eq!(nearest("camera.brightness", names), None);
    }

    #[test]
    fn a_number_outside_its_range_is_refused_with_the_range() {
        let share = number_in(0.0..=1.0);
        assert_eq!(share("0.5"), Ok(0.5));
        for text in ["1.5", "NaN", "much", ""] {
            let expected = format!("found {text}, expected a number from 0 to 1");
            assert_eq!(share(text), Err(expected));
        }
        assert_eq!(whole_in(0..=9)("7"), Ok(7));
        assert_eq!(
            whole_in(0..=9)("1.5"),
            Err("found 1.5, expected a whole number from 0 to 9".to_owned())
        );
    }
}
