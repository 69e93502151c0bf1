//! What the health's figures are on clean pictures, on those of faulty cameras and on another sensor's, and how often it
//! speaks up.

use std::collections::BTreeMap;

use gripline_network::image::Image88;
use gripline_network::scene::{Figures, GateKind, Health, Scene, mean_of};

use super::data::Sensor;

/// Figures and verdicts of one kind of pictures.
#[derive(Default)]
struct Kind {
    figures: Vec<Figures>,
    flagged: BTreeMap<String, usize>,
}

impl Kind {
    fn add(&mut self, scene: &mut Scene, image: &Image88) {
        self.figures.push(scene.figures(image));
        let (_, health) = scene.look(image);
        if health != Health::GOOD {
            *self.flagged.entry(health.to_string()).or_default() += 1;
        }
    }

    /// Smallest, middle and largest of a figure, to a thousandth from either end.
    fn range(&self, figure: impl Fn(&Figures) -> f32) -> String {
        let mut values: Vec<f32> = self.figures.iter().map(figure).collect();
        values.sort_by(f32::total_cmp);
        let at = |share: f32| values[((values.len() - 1) as f32 * share).round() as usize];
        format!("{:.3}/{:.3}/{:.3}", at(0.001), at(0.5), at(0.999))
    }
}

/// Prints a line for each kind of pictures.
pub(super) fn print_report(calibration: &[Sensor], report: &[Sensor]) {
    for (name, sensors) in [("calibration", calibration), ("unseen", report)] {
        println!("health, {name} sensors: 0.1 %/median/99.9 % of light, glaring, faded, familiar, uneven");
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
                kind.figures.len(),
                kind.range(|figures| figures.light),
                kind.range(|figures| figures.glaring),
                kind.range(|figures| figures.faded),
                kind.range(|figures| figures.familiar),
                kind.range(|figures| figures.uneven),
            );
            for (flags, count) in kind.flagged {
                println!("    {count:>5} {flags}");
            }
        }
    }
}
