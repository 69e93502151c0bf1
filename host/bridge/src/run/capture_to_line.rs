//! From the driver's time stamp of a camera's picture to the grip-force line, part by part. Only cameras give the time of a
//! picture. Units: microseconds. Limits: what a camera does before its driver stamps the picture (exposure, and transfer where the
//! driver stamps afterwards) is not included.

use std::time::Duration;

use gripline_live::CAPTURE_PARTS;
use gripline_protocol::message::Stage;
use serde::Serialize;

use super::stats::Times;

/// Core cycles of the microcontroller in a microsecond.
const CYCLES_PER_US: f64 = 168.0;

/// Distributions of [`CAPTURE_PARTS`].
#[derive(Debug, Clone, Default)]
pub(super) struct CaptureToLine([Times; CAPTURE_PARTS.len()]);

/// Quantiles of a part.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PartQuantiles {
    /// Median, µs.
    pub median_us: f64,
    /// 99th percentile, µs.
    pub p99_us: f64,
    /// 99.9th percentile, µs.
    pub p999_us: f64,
}

/// The whole, for the summary.
#[derive(Debug, Serialize)]
pub struct CaptureToLineSummary {
    /// Pictures whose maps were sent.
    pub pictures: u64,
    /// From the driver's time stamp until the picture's bytes arrived.
    pub driver: PartQuantiles,
    /// From the end of decoding until the loop takes the picture.
    pub hand_over: PartQuantiles,
    /// From the time stamp until the link has the map's last packet: both of these, decoding and the loop's stages.
    pub to_link: PartQuantiles,
    /// Longest time from a map's last packet to the line, measured by the microcontroller, µs.
    pub microcontroller_us_worst: f64,
    /// From the time stamp to the line: `to_link` and that.
    pub to_line: PartQuantiles,
}

impl CaptureToLine {
    /// Adds a picture: from the time stamp to its bytes, from those to the loop, of that decoding, and from the bytes to the link.
    pub(super) fn push(&mut self, driver: Duration, waited: Duration, decode_us: f64, latency_us: f64) {
        let [driver_us, waited_us] = [driver, waited].map(|time| time.as_secs_f64() * 1e6);
        let parts = [
            driver_us,
            (waited_us - decode_us).max(0.0),
            driver_us + latency_us,
        ];
        for (times, us) in self.0.iter_mut().zip(parts) {
            times.push(us);
        }
    }

    /// `quantiles` of every part.
    pub(super) fn quantiles_us(&self, quantiles: [f64; 3]) -> [[f64; 3]; CAPTURE_PARTS.len()] {
        std::array::from_fn(|part| quantiles.map(|quantile| self.0[part].quantile_us(quantile)))
    }

    /// `None` without a camera's picture. `worst_cycles` are those of the microcontroller's newest status.
    pub(super) fn summary(&self, worst_cycles: [u32; 4]) -> Option<CaptureToLineSummary> {
        let pictures = self.0[0].count();
        let [driver, hand_over, to_link] = self.quantiles_us([0.5, 0.99, 0.999]).map(PartQuantiles::of);
        let cycles = worst_cycles[Stage::Decide as usize] + worst_cycles[Stage::Line as usize];
        let worst_us = f64::from(cycles) / CYCLES_PER_US;
        (pictures > 0).then_some(CaptureToLineSummary {
            pictures,
            driver,
            hand_over,
            to_link,
            microcontroller_us_worst: worst_us,
            to_line: PartQuantiles {
                median_us: to_link.median_us + worst_us,
                p99_us: to_link.p99_us + worst_us,
                p999_us: to_link.p999_us + worst_us,
            },
        })
    }
}

impl PartQuantiles {
    fn of([median_us, p99_us, p999_us]: [f64; 3]) -> Self {
        Self {
            median_us,
            p99_us,
            p999_us,
        }
    }

    /// One line for people.
    pub(super) fn text(&self, name: &str) -> String {
        format!(
            "{name:>12}  median {:7.1} µs  p99 {:7.1} µs  p99.9 {:7.1} µs",
            self.median_us, self.p99_us, self.p999_us
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_picture_add_up_to_the_line() {
        let mut times = CaptureToLine::default();
        assert!(times.summary([0; 4]).is_none());
        let us = Duration::from_micros;
        for _ in 0..10 {
            // Stamped 3 ms before its bytes came, decoded in 0.4 of the 0.5 ms that it waited, sent 2 ms after it came.
            times.push(us(3_000), us(500), 400.0, 2_000.0);
        }
        let summary = times.summary([9, 3_360, 840, 9]).unwrap();
        let near =
            |found: f64, wanted: f64| assert!((found - wanted).abs() < 0.01 * wanted, "{found} for {wanted}");
        near(summary.driver.median_us, 3_000.0);
        near(summary.hand_over.p99_us, 100.0);
        near(summary.to_link.median_us, 5_000.0);
        near(summary.microcontroller_us_worst, 25.0);
        near(summary.to_line.p999_us, 5_025.0);
        assert_eq!(summary.pictures, 10);
    }
}
