//! Single values from Python: numbers within a range, and names out of a few. Errors name what was found and expected.

use std::ops::RangeInclusive;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A number within a range; NaN lies in none.
pub(crate) fn within(name: &str, value: f64, range: &RangeInclusive<f64>) -> PyResult<f64> {
    if range.contains(&value) {
        return Ok(value);
    }
    Err(PyValueError::new_err(format!(
        "{name}: found {value}, expected a number from {} to {}",
        range.start(),
        range.end()
    )))
}

/// A finite number above zero.
pub(crate) fn positive(name: &str, value: f64) -> PyResult<f64> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(PyValueError::new_err(format!(
        "{name}: found {value}, expected a positive number"
    )))
}

/// The value of a name.
pub(crate) fn named<T: Copy>(name: &str, found: &str, known: &[(&str, T)]) -> PyResult<T> {
    let value = known.iter().find(|(word, _)| *word == found);
    value.map(|(_, value)| *value).ok_or_else(|| {
        let words: Vec<String> = known.iter().map(|(word, _)| format!("'{word}'")).collect();
        PyValueError::new_err(format!(
            "{name}: found '{found}', expected {}",
            words.join(" or ")
        ))
    })
}
