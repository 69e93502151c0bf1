//! Random contacts on random units: markers before and after, and the true force map. Everything follows from split and seed.

use std::sync::Arc;

use gripline_sensor::Sensor;

use super::PrintedGel;
use super::unit::{PrintedUnit, UnitRange};
use crate::error::SimulationError;
use crate::field::DisplacementField;
use crate::force_map::ForceMap;
use crate::random::Random;
use crate::sample::{Counts, History, Range, Split};

/// Purpose of a stream's random numbers; the split is added.
const CONTACTS: u64 = 48;
/// Load histories on one gel before the next is drawn; every sample sees its own markers and lens over it.
const HISTORIES_PER_GEL: u64 = 40;
/// Normal loads, log-uniform, N; the strain limit cuts them for slender shapes.
const NORMAL_N: [f64; 2] = [0.1, 10.0];

/// One state.
#[derive(Debug, Clone)]
pub struct PrintedSample {
    /// The unit.
    pub unit: Arc<PrintedUnit>,
    /// Where its markers show at rest, mm.
    pub rest_mm: Vec<[f64; 2]>,
    /// Where they show now, and whether each is seen.
    pub now_mm: Vec<([f64; 2], bool)>,
    /// The true map, N per taxel.
    pub forces: ForceMap,
    /// Name of the indenter.
    pub shape: &'static str,
}

/// An endless stream of random contacts on random units of one sensor.
#[derive(Debug)]
pub struct PrintedContacts {
    sensor: Sensor,
    range: UnitRange,
    split: Split,
    looks: usize,
    random: Random,
    /// How much closer the pictures of this gel are cropped.
    zoom: f64,
    gel: Option<PrintedGel>,
    history: Option<History>,
    field: Option<DisplacementField>,
    /// Looks at the state in the field that are left.
    left: usize,
    counts: Counts,
}

impl PrintedContacts {
    /// The stream that follows from `split` and `seed`; streams with others differ in everything. Each state is seen by `looks`
    /// units that share a gel: that is cheap, and markers lie differently on each.
    #[must_use]
    pub fn new(sensor: &Sensor, range: UnitRange, split: Split, seed: u64, looks: usize) -> Self {
        Self {
            sensor: sensor.clone(),
            range,
            split,
            looks,
            random: Random::new(seed, CONTACTS + split as u64),
            zoom: range.zoom[0],
            gel: None,
            history: None,
            field: None,
            left: 0,
            counts: Counts::default(),
        }
    }

    /// What became of the load histories so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// A new unit; without a gel to lie on, on its own.
    fn unit(&mut self, gel: Option<PrintedGel>) -> Result<PrintedUnit, SimulationError> {
        let own = self.split.own_number(&mut self.random);
        let mut random = Random::new(own, CONTACTS);
        let range = UnitRange {
            zoom: [self.zoom; 2],
            ..self.range
        };
        match gel {
            Some(gel) => Ok(PrintedUnit::with_gel(&self.sensor, &range, gel, &mut random)),
            None => PrintedUnit::draw(&self.sensor, &range, &mut random),
        }
    }

    /// Goes to the next state of a contact and computes its field.
    fn advance(&mut self) -> Result<(), SimulationError> {
        loop {
            if let (Some(history), Some(gel)) = (&mut self.history, &self.gel)
                && let Some(truth) = history.advance(&mut self.random, &mut self.counts)
            {
                self.field.get_or_insert_with(|| gel.field()).load(truth);
                self.left = self.looks;
                return Ok(());
            }
            if self.counts.histories.is_multiple_of(HISTORIES_PER_GEL) {
                let [min, max] = self.range.zoom;
                self.zoom = if self.random.unit() < 0.5 {
                    min
                } else {
                    self.random.uniform(min, max)
                };
                self.gel = Some(self.unit(None)?.gel().clone());
                self.field = None;
            }
            self.counts.histories += 1;
            let Some(gel) = &self.gel else { continue };
            let (scale, scaled) = (gel.scale, gel.scaled_gel());
            let range = Range {
                normal_n: NORMAL_N.map(|n| n * scale * scale),
                half_mm: self
                    .sensor
                    .view
                    .field_mm
                    .map(|side| 0.5 * side * scale / self.zoom),
            };
            self.history = History::draw(&mut self.random, self.split, &gel.surfaces, &scaled, range).ok();
        }
    }
}

impl Iterator for PrintedContacts {
    type Item = PrintedSample;

    /// The next state; `None` only when a unit cannot be made.
    fn next(&mut self) -> Option<PrintedSample> {
        if self.left == 0 {
            self.advance().ok()?;
        }
        self.left -= 1;
        let gel = self.gel.clone()?;
        let unit = Arc::new(self.unit(Some(gel)).ok()?);
        let history = self.history.as_ref()?;
        let now_mm = unit.track(self.field.as_ref()?, &mut self.random);
        let modulus = unit.modulus() as f32;
        let forces = unit.gel().forces_n(history.truth());
        Some(PrintedSample {
            rest_mm: unit.rest_mm(),
            now_mm,
            forces: forces.map(|taxel| taxel.map(|force| force * modulus)),
            shape: history.shape(),
            unit,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn a_stream_repeats_by_seed_and_its_markers_tell_of_the_load() {
        let sensor = Sensor::named(Path::new("gelsight-mini")).unwrap();
        let range = UnitRange::of(&sensor);
        let take = |seed| {
            PrintedContacts::new(&sensor, range, Split::Train, seed, 1)
                .take(20)
                .collect::<Vec<_>>()
        };
        let (first, again, other) = (take(1), take(1), take(2));
        for (a, b) in first.iter().zip(&again) {
            assert_eq!((&a.now_mm, a.forces), (&b.now_mm, b.forces));
        }
        assert_ne!(first[0].now_mm, other[0].now_mm);
        for sample in &first {
            let count = sample.rest_mm.len();
            assert!((20..=90).contains(&count), "{count} markers");
            let load_n: f32 = sample.forces.iter().map(|force| force[2]).sum();
            let moves = sample.rest_mm.iter().zip(&sample.now_mm);
            let farthest = moves
                .map(|(rest, (now, _))| libm::hypot(now[0] - rest[0], now[1] - rest[1]))
                .fold(0.0, f64::max);
            assert!(
                farthest > 0.002 && farthest < 3.0,
                "{farthest} mm under {load_n} N"
            );
        }
    }
}
