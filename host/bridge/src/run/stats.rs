//! Distributions of stage times in bounded memory, however long the run: median, 99th and 99.9th percentile.
//! Units: microseconds; resolution three digits. Limits: times above one minute count as one minute.

use hdrhistogram::Histogram;

const MAX_NS: u64 = 60_000_000_000;

/// A distribution of times.
#[derive(Debug, Clone)]
pub(crate) struct Times(Option<Histogram<u32>>);

impl Default for Times {
    fn default() -> Self {
        // The bounds are constants that the library accepts; `None` can only come from another version of it.
        Self(Histogram::new_with_max(MAX_NS, 3).ok())
    }
}

impl Times {
    /// Adds a time in microseconds.
    pub(crate) fn push(&mut self, us: f64) {
        if let Some(histogram) = &mut self.0 {
            histogram.saturating_record((us * 1e3) as u64);
        }
    }

    /// How many there are.
    #[must_use]
    pub(crate) fn count(&self) -> u64 {
        self.0.as_ref().map_or(0, Histogram::len)
    }

    /// The time that a share `quantile` (0 to 1) does not exceed, in microseconds; 0 when there are none.
    #[must_use]
    pub(crate) fn quantile_us(&self, quantile: f64) -> f64 {
        self.0.as_ref().map_or(0.0, |histogram| {
            histogram.value_at_quantile(quantile) as f64 / 1e3
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_sorted_times() {
        let mut times = Times::default();
        for us in 1..=1_000 {
            times.push(f64::from(us));
        }
        assert_eq!(times.count(), 1_000);
        assert!((times.quantile_us(0.5) - 500.0).abs() < 1.0);
        assert!((times.quantile_us(0.999) - 999.0).abs() < 1.0);
        assert!((Times::default().quantile_us(0.5)).abs() < f64::EPSILON);
    }
}
