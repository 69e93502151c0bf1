//! Random training samples from the contact world: pairs of 88 x 88 images at rest and under an indenter, with the
//! true force map, along random load histories, seen by ever new virtual sensors. Every sample follows from split
//! and seed alone. Units: mm, N, N·mm. Limits: see `history`; states beyond the strain limit are never shown.

mod history;
mod shapes;
mod split;

use std::sync::Arc;
use std::time::{Duration, Instant};

pub use history::{Counts, STRAIN_LIMIT};
pub(crate) use history::{GelSurfaces, History, Range};
pub use split::Split;

use crate::constants::{NETWORK_PX, REST_PICTURES, TAXEL_COUNT, TAXELS};
use crate::contact_world::{CellState, Truth};
use crate::error::SimulationError;
use crate::field::LayerKernels;
use crate::fingertip::{Fingertip, FingertipParams};
use crate::force_map::ForceMap;
use crate::gel::Gel;
use crate::image::{Image, block_mean_88};
use crate::random::Random;

/// Purpose of a stream's random numbers; the split is added.
const SAMPLES: u64 = 16;
/// Load histories on one virtual sensor before the next is drawn.
const HISTORIES_PER_SENSOR: u32 = 3;
/// Share of histories before which a sample shows the gel untouched; about one sample in twenty-five.
const UNTOUCHED: f64 = 0.25;
/// Largest change of the light between the image at rest and those under load, share.
const BRIGHTNESS_DRIFT: f64 = 0.03;

/// One sample.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The fingertip at rest, 88 x 88, of the mean of [`REST_PICTURES`].
    pub rest: [u8; NETWORK_PX * NETWORK_PX],
    /// The same fingertip under load, 88 x 88.
    pub now: [u8; NETWORK_PX * NETWORK_PX],
    /// Both at full resolution, if the generator was asked for them.
    pub crops: Option<Crops>,
    /// What presses on it, N per taxel.
    pub forces: ForceMap,
    /// True friction of the contact; none when nothing touches.
    pub friction: Option<f64>,
    /// True share of the contact area that sticks; none when nothing touches.
    pub true_stick_ratio: Option<f64>,
    /// What every taxel does: what at least half of its cells in contact do.
    pub states: [CellState; TAXEL_COUNT],
    /// Whether the contact slides as a whole.
    pub gross_slip: bool,
    /// Name of the indenter: a built-in shape, `rough`, `blob`, or `none`.
    pub shape: &'static str,
    /// The virtual sensor ([`FingertipParams::of_sensor`]).
    pub sensor: u64,
    /// The stream's seed.
    pub seed: u64,
}

/// The 440 x 440 images of a sample.
#[derive(Debug, Clone)]
pub struct Crops {
    /// At rest.
    pub rest: Arc<Image>,
    /// Under load.
    pub now: Image,
}

/// Time that a generator has spent, by stage.
#[derive(Debug, Clone, Copy, Default)]
pub struct Costs {
    /// Load histories: shapes, contact solves.
    pub solver: Duration,
    /// New virtual sensors.
    pub sensors: Duration,
    /// Field inside the gel, particles and exposure.
    pub picture: Duration,
    /// 440 x 440 to 88 x 88.
    pub downsample: Duration,
}

/// What all streams share: the gel at its two resolutions and the field inside it, which take longer to make than
/// hundreds of samples.
#[derive(Debug, Clone)]
pub struct SampleWorld {
    gel: Gel,
    surfaces: GelSurfaces,
    kernels: Arc<LayerKernels>,
}

impl SampleWorld {
    /// The default gel.
    ///
    /// # Errors
    /// A gel constant outside its range.
    pub fn new() -> Result<Self, SimulationError> {
        let gel = Gel::default();
        Ok(Self {
            gel,
            surfaces: GelSurfaces::new(&gel)?,
            kernels: Arc::new(LayerKernels::new(&gel)),
        })
    }
}

/// An endless stream of random samples. Streams with another seed or split differ in everything.
#[derive(Debug)]
pub struct SampleGenerator {
    world: SampleWorld,
    split: Split,
    seed: u64,
    random: Random,
    history: Option<History>,
    histories_on_sensor: u32,
    sensor: Option<Sensor>,
    with_crops: bool,
    crop: Image,
    counts: Counts,
    costs: Costs,
}

/// A fingertip in use, and its image at rest.
#[derive(Debug)]
struct Sensor {
    unit: u64,
    fingertip: Fingertip,
    brightness: f64,
    rest: [u8; NETWORK_PX * NETWORK_PX],
    rest_crop: Option<Arc<Image>>,
}

impl SampleGenerator {
    /// The stream that follows from `split` and `seed`.
    #[must_use]
    pub fn new(world: &SampleWorld, split: Split, seed: u64) -> Self {
        Self {
            world: world.clone(),
            split,
            seed,
            random: Random::new(seed, SAMPLES + split as u64),
            history: None,
            histories_on_sensor: 0,
            sensor: None,
            with_crops: false,
            crop: Image::crop(),
            counts: Counts::default(),
            costs: Costs::default(),
        }
    }

    /// The same stream with the 440 x 440 images in every sample.
    #[must_use]
    pub fn with_crops(self) -> Self {
        Self {
            with_crops: true,
            ..self
        }
    }

    /// What became of the load histories so far, failed solves included.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Where the time went so far.
    #[must_use]
    pub fn costs(&self) -> Costs {
        self.costs
    }

    /// The next solved state without its picture, for those who need no more than forces; none where a sample
    /// without contact stands.
    pub fn next_contact(&mut self) -> Option<&Truth> {
        let start = Instant::now();
        let shown = self.advance();
        self.costs.solver += start.elapsed();
        shown
            .then_some(self.history.as_ref())
            .flatten()
            .map(History::truth)
    }

    /// Goes to the next state; whether it is one of a contact.
    fn advance(&mut self) -> bool {
        loop {
            if let Some(history) = &mut self.history {
                if history.advance(&mut self.random, &mut self.counts).is_some() {
                    return true;
                }
                self.history = None;
            }
            if self.histories_on_sensor == HISTORIES_PER_SENSOR {
                self.histories_on_sensor = 0;
                self.sensor = None;
            }
            let drawn = History::draw(
                &mut self.random,
                self.split,
                &self.world.surfaces,
                &self.world.gel,
                Range::default(),
            );
            // The ranges drawn from are the constants of this module: every one of them is a good parameter.
            self.history = drawn.ok();
            self.histories_on_sensor += 1;
            self.counts.histories += 1;
            if self.random.unit() < UNTOUCHED {
                return false;
            }
        }
    }

    /// A new virtual sensor with its image at rest.
    fn draw_sensor(&mut self) -> Result<Sensor, SimulationError> {
        let unit = self.split.own_number(&mut self.random);
        let params = FingertipParams::of_sensor(unit);
        let kernels = Arc::clone(&self.world.kernels);
        let mut fingertip = Fingertip::with_kernels(unit, params, kernels)?;
        let rest = fingertip.mean_rest_image(REST_PICTURES);
        Ok(Sensor {
            unit,
            fingertip,
            brightness: params.brightness,
            rest: block_mean_88(&rest.pixels),
            rest_crop: self.with_crops.then(|| Arc::new(rest)),
        })
    }

    fn sample(&mut self) -> Result<Sample, SimulationError> {
        let touched = self.next_contact().is_some();
        let start = Instant::now();
        let mut sensor = match self.sensor.take() {
            Some(sensor) => sensor,
            None => self.draw_sensor()?,
        };
        self.costs.sensors += start.elapsed();

        let start = Instant::now();
        let drift = 1.0 + self.random.uniform(-BRIGHTNESS_DRIFT, BRIGHTNESS_DRIFT);
        sensor.fingertip.set_brightness(sensor.brightness * drift)?;
        let history = self.history.as_ref().filter(|_| touched);
        match history {
            Some(history) => sensor.fingertip.render(history.truth(), &mut self.crop),
            None => self.crop = sensor.fingertip.rest_image(),
        }
        self.costs.picture += start.elapsed();
        let start = Instant::now();
        let now = block_mean_88(&self.crop.pixels);
        self.costs.downsample += start.elapsed();

        let truth = history.map(History::truth);
        let sample = Sample {
            rest: sensor.rest,
            now,
            crops: sensor.rest_crop.as_ref().map(|rest| Crops {
                rest: Arc::clone(rest),
                now: self.crop.clone(),
            }),
            forces: truth.map_or([[0.0; 3]; TAXEL_COUNT], Truth::force_map),
            friction: history.map(History::friction),
            true_stick_ratio: truth.and_then(Truth::stick_ratio),
            states: truth.map_or([CellState::Free; TAXEL_COUNT], taxel_states),
            gross_slip: truth.is_some_and(Truth::gross_slip),
            shape: history.map_or("none", History::shape),
            sensor: sensor.unit,
            seed: self.seed,
        };
        self.sensor = Some(sensor);
        Ok(sample)
    }
}

impl Iterator for SampleGenerator {
    type Item = Sample;

    /// The next sample; never none. A contact that does not solve is counted and another is drawn.
    fn next(&mut self) -> Option<Sample> {
        loop {
            if let Ok(sample) = self.sample() {
                return Some(sample);
            }
        }
    }
}

/// What at least half of each taxel's cells in contact do.
fn taxel_states(truth: &Truth) -> [CellState; TAXEL_COUNT] {
    let per_taxel = truth.cells() / TAXELS;
    let mut votes = [[0_u32; 2]; TAXEL_COUNT];
    for (cell, state) in truth.states().iter().enumerate() {
        let taxel = cell / truth.cells() / per_taxel * TAXELS + cell % truth.cells() / per_taxel;
        match state {
            CellState::Free => {}
            CellState::Stick => votes[taxel][0] += 1,
            CellState::Slip => votes[taxel][1] += 1,
        }
    }
    votes.map(|[stick, slip]| match (stick, slip) {
        (0, 0) => CellState::Free,
        _ if stick >= slip => CellState::Stick,
        _ => CellState::Slip,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(split: Split, seed: u64) -> SampleGenerator {
        SampleGenerator::new(&SampleWorld::new().unwrap(), split, seed)
    }

    #[test]
    fn the_stream_repeats_by_seed_and_differs_between_seeds_and_splits() {
        let take = |split, seed| stream(split, seed).take(25).collect::<Vec<_>>();
        let (first, again) = (take(Split::Train, 4), take(Split::Train, 4));
        for (a, b) in first.iter().zip(&again) {
            assert!(a.rest == b.rest && a.now == b.now && a.forces == b.forces && a.states == b.states);
        }
        for other in [take(Split::Train, 5), take(Split::Test, 4)] {
            assert!(first[0].rest != other[0].rest && first[0].sensor != other[0].sensor);
        }
        // One sensor serves a few histories, with one image at rest.
        let changes = first.windows(2).filter(|pair| pair[0].sensor != pair[1].sensor);
        assert!((1..=3).contains(&changes.count()));
        assert!(
            first
                .windows(2)
                .all(|pair| (pair[0].sensor == pair[1].sensor) == (pair[0].rest == pair[1].rest))
        );
    }

    #[test]
    fn full_resolution_is_there_on_request_and_shrinks_to_the_sample() {
        let mut with = stream(Split::Train, 8).with_crops();
        for plain in stream(Split::Train, 8).take(4) {
            let sample = with.next().unwrap();
            let crops = sample.crops.unwrap();
            assert!(plain.crops.is_none() && plain.now == sample.now);
            assert!(block_mean_88(&crops.now.pixels) == sample.now);
            assert!(block_mean_88(&crops.rest.pixels) == sample.rest);
        }
    }

    /// Only `cargo xtask test --all` runs these.
    mod slow {
        use super::*;

        #[test]
        fn sensors_of_a_split_are_its_own() {
            for split in Split::ALL {
                let sensors = stream(split, 1).take(30).map(|sample| sample.sensor >> 60);
                assert!(sensors.into_iter().all(|bits| bits == split as u64));
            }
        }

        #[test]
        fn samples_cover_what_the_network_has_to_learn_and_every_map_obeys_friction() {
            let mut stream = stream(Split::Train, 11);
            let samples: Vec<Sample> = stream.by_ref().take(300).collect();
            let share = |f: &dyn Fn(&Sample) -> bool| samples.iter().filter(|s| f(s)).count() as f64 / 300.0;
            let normal_n = |s: &Sample| s.forces.iter().map(|force| f64::from(force[2])).sum::<f64>();
            let empty = share(&|s| s.true_stick_ratio.is_none());
            assert!(empty > 0.01 && empty < 0.1, "{empty} without contact");
            assert!((share(&|s| s.shape == "none") - empty).abs() < 1e-12);
            let gross = share(&|s| s.gross_slip);
            assert!(gross > 0.02 && gross < 0.25, "{gross} in gross slip");
            let partial = share(&|s| s.true_stick_ratio.is_some_and(|r| r > 0.02 && r < 0.6));
            assert!(partial > 0.15, "{partial} with a true stick ratio below 0.6");
            assert!(share(&|s| normal_n(s) > 5.0) > 0.08 && share(&|s| normal_n(s) < 0.5) > 0.15);
            let surfaces = ["rough", "blob", "heap", "facets", "corrugated"];
            let random = share(&|s| surfaces.contains(&s.shape));
            assert!(random > 0.3 && random < 0.65, "{random} on random surfaces");

            let [mut beyond, mut loaded] = [0.0; 2];
            for sample in &samples {
                for (force, state) in sample.forces.iter().zip(&sample.states) {
                    let [x, y, z] = force.map(f64::from);
                    // Friction's share is at most μz; the pressure's is z times the slope, which counts up to 1 along x and y.
                    let max = sample.friction.unwrap_or(0.0) + std::f64::consts::SQRT_2;
                    assert!(z >= 0.0 && x.hypot(y) <= max * z * (1.0 + 1e-5) + 1e-9);
                    beyond +=
                        f64::from(x.hypot(y) > sample.friction.unwrap_or(0.0) * z * (1.0 + 1e-5) + 1e-9);
                    loaded += f64::from(z > 0.0);
                    assert_eq!(z > 0.0, *state != CellState::Free);
                }
            }
            println!(
                "{:.3} of the loaded taxels carry more than friction's share",
                beyond / loaded
            );
            assert!(beyond < 0.3 * loaded);
            let counts = stream.counts();
            assert!(counts.steps > 500 && counts.unsolved == 0, "{counts:?}");
            assert!(counts.off_surface < counts.histories / 10, "{counts:?}");
        }
    }
}
