//! Texts with measured values in them: `{/pointer}` or `{/pointer:DECIMALS}`, `{/pointer*FACTOR:DECIMALS}`; `,` behind the decimals
//! groups thousands.

use std::collections::BTreeMap;

use serde_json::Value;

/// Pointer to value. A value may be a list or an object; pointers lead into it.
pub(super) type Values = BTreeMap<String, Value>;

/// A place for a value in a text.
pub(super) struct Field {
    /// As it stands in the text, braces included.
    text: String,
    pub(super) pointer: String,
    factor: f64,
    decimals: Option<usize>,
    groups_thousands: bool,
}

/// The places for values in a text.
pub(super) fn fields(text: &str) -> Vec<Field> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find("{/") {
        let Some(end) = rest[start..].find('}') else { break };
        let inner = &rest[start + 1..start + end];
        let (inner, format) = inner.split_once(':').unwrap_or((inner, ""));
        let (pointer, factor) = match inner.split_once('*') {
            Some((pointer, factor)) => (pointer, factor.parse().unwrap_or(1.0)),
            None => (inner, 1.0),
        };
        found.push(Field {
            text: rest[start..=start + end].to_owned(),
            pointer: pointer.to_owned(),
            factor,
            decimals: format.trim_end_matches(',').parse().ok(),
            groups_thousands: format.ends_with(','),
        });
        rest = &rest[start + end + 1..];
    }
    found
}

/// The text with the values in their places, `not measured` where there is none.
pub(super) fn filled(text: &str, values: &Values) -> String {
    let mut filled = text.to_owned();
    for field in fields(text) {
        let value = value_at(values, &field.pointer)
            .map_or_else(|| "not measured".to_owned(), |value| field.shown(value));
        filled = filled.replace(&field.text, &value);
    }
    filled
}

/// The value there, or in the list or object that stands on the way.
fn value_at<'a>(values: &'a Values, pointer: &str) -> Option<&'a Value> {
    // An empty pointer leads to the value itself.
    values
        .iter()
        .find_map(|(parent, value)| value.pointer(pointer.strip_prefix(parent.as_str())?))
}

impl Field {
    fn shown(&self, value: &Value) -> String {
        match value {
            Value::Number(number) => {
                let number = number.as_f64().unwrap_or(f64::NAN) * self.factor;
                let decimals = self.decimals;
                let digits =
                    decimals.map_or_else(|| number.to_string(), |decimals| format!("{number:.decimals$}"));
                if self.groups_thousands {
                    grouped(&digits)
                } else {
                    digits
                }
            }
            Value::String(text) => text.clone(),
            other => other.to_string(),
        }
    }
}

/// A number with a comma before every third digit of its whole part.
fn grouped(number: &str) -> String {
    let whole = number.split_once('.').map_or(number, |(whole, _)| whole);
    let digits = whole.trim_start_matches('-').len();
    let first = whole.len() - digits;
    let mut text = String::new();
    for (at, character) in number.char_indices() {
        let before_end = whole.len().saturating_sub(at);
        if at > first && before_end > 0 && before_end.is_multiple_of(3) {
            text.push(',');
        }
        text.push(character);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_in_their_places_with_decimals_factor_and_thousands() {
        let values = Values::from([
            ("/a".to_owned(), serde_json::json!(1_234_567)),
            ("/b".to_owned(), serde_json::json!([{"c": "all"}])),
        ]);
        for (text, expected) in [
            ("{/a:,} of {/b/0/c}", "1,234,567 of all"),
            ("{/a*-0.001:2,}", "-1,234.57"),
            ("{/a*0.0001:0,}, {/a*0.1:0}", "123, 123457"),
            ("{/d}, {/b/1/c}, {/a", "not measured, not measured, {/a"),
        ] {
            assert_eq!(filled(text, &values), expected);
        }
    }
}
