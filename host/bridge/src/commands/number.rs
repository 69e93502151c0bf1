//! Numbers of the command line.

/// Reads a number between `min` and `max`; for value parsers.
///
/// # Errors
/// A line with what was found and what was expected.
pub(crate) fn number_in(text: &str, min: f64, max: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (min..=max).contains(&value) => Ok(value),
        _ => Err(format!("found {text}, expected a number from {min} to {max}")),
    }
}
