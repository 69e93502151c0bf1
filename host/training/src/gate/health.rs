//! The health metrics of clean pictures, of faulty cameras and of other sensors, and how often the check raises a flag.

use std::collections::BTreeMap;

use gripline_network::image::Image88;
use gripline_network::scene::{GateKind, Health, HealthMetrics, Scene, mean_of};

use super::data::Sensor;

/// Metrics and flags of one kind of pictures.
#[derive(Default)]
struct Kind {
    metrics: Vec<HealthMetrics>,
    flagged: BTreeMap<String, usize>,
}

impl Kind {
    fn add(&mut self, scene: &mut Scene, image: &Image88) {
        self.metrics.push(scene.health_metrics(image));
        let (_, health) = scene.decide(image);
        if health != Health::GOOD {
            *self.flagged.entry(health.to_string()).or_default() += 1;
        }
    }

    /// 0.1 %, 50 % and 99.9 % quantile of a metric.
    fn range(&self, figure: impl Fn(&HealthMetrics) -> f32) -> String {
        let mut values: Vec<f32> = self.metrics.iter().map(figure).collect();
        values.sort_by(f32::total_cmp);
        let at = |share: f32| values[((values.len() - 1) as f32 * share).round() as usize];
        format!("{:.3}/{:.3}/{:.3}", at(0.001), at(0.5), at(0.999))
    }
}

/// Prints a line for each kind of pictures.
pub(super) fn print_report(calibration: &[Sensor], report: &[Sensor]) {
    for (name, sensors) in [("calibration", calibration), ("unseen", report)] {
        println!(
            "health, {name} sensors: 0.1 %/median/99.9 % of brightness, overexposed, faded, matching, unevenness"
        );
        let mut kinds: BTreeMap<&str, Kind> = BTreeMap::new();
        for (number, sensor) in sensors.iter().enumerate() {
            let mut scene = Scene::new(GateKind::Network, &mean_of(&sensor.rest), &sensor.rest);
            for picture in &sensor.pictures {
                kinds.entry("clean").or_default().add(&mut scene, &picture.image);
            }
            for (fault, image) in &sensor.faulty {
                kinds.entry(fault.name()).or_default().add(&mut scene, image);
            }
            let other = &sensors[(number + 1) % sensors.len()];
            for picture in other.pictures.iter().step_by(16) {
                kinds
                    .entry("other sensor")
                    .or_default()
                    .add(&mut scene, &picture.image);
            }
        }
        for (name, kind) in kinds {
            let flagged: usize = kind.flagged.values().sum();
            println!(
                "  {name:<13} {flagged:>5} of {:>5} reported  {}  {}  {}  {}  {}",
                kind.metrics.len(),
                kind.range(|metrics| metrics.brightness),
                kind.range(|metrics| metrics.overexposed),
                kind.range(|metrics| metrics.faded),
                kind.range(|metrics| metrics.matching),
                kind.range(|metrics| metrics.unevenness),
            );
            for (flags, count) in kind.flagged {
                println!("    {count:>5} {flags}");
            }
        }
    }
}
