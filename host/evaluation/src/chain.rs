//! Trials through the whole chain: the contact world's picture of every frame with the sensor's noise and light, gate,
//! force network, quantised map. Several at once, in any order; the result of a trial follows from its numbers alone.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use gripline_firmware::sums::TaxelRule;
use gripline_network::Network;
use gripline_network::scene::GateKind;
use gripline_protocol::{ForceMap, Health};
use gripline_simulation::constants::REST_PICTURES;
use gripline_simulation::contact_world::{GelSurface, Truth, production_cells};
use gripline_simulation::{Fingertip, FingertipParams, Gel, Image};

use super::trial::{Experiment, Trial, TruthFrame};
use crate::error::EvaluationError;
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;

/// Least grip of a trial, for the choice of the contact world's grid, N.
const GRIPPED_N: f64 = 1.5;

/// A frame of a trial: what is true, what the chain makes of its picture, and what a perfect sensor would send.
#[derive(Debug, Clone)]
pub struct Frame {
    /// What is true.
    pub truth: TruthFrame,
    /// The map as it travels.
    pub seen: ForceMap,
    /// What the chain has against it.
    pub health: Health,
    /// The true map in the wire's units.
    pub exact: ForceMap,
}

/// A trial that was played.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// True friction.
    pub friction: f64,
    /// Grip, N.
    pub grip_n: f64,
    /// Its frames.
    pub frames: Vec<Frame>,
    /// Why the rest is missing, if the contact world found no solution.
    pub unsolved: Option<String>,
}

/// How trials are played.
#[derive(Debug, Clone)]
pub struct Chain {
    network: Network,
    skin: Arc<GelSurface>,
}

/// What looks at a trial: a fingertip with the chain behind it.
struct FingertipCamera {
    fingertip: Fingertip,
    pipeline: Pipeline,
    crop: Image,
}

impl FingertipCamera {
    fn new(network: &Network, trial: &Trial, noise_levels: Option<f64>) -> Result<Self, EvaluationError> {
        let mut params = FingertipParams::of_sensor(trial.sensor);
        params.noise_levels = noise_levels.unwrap_or(params.noise_levels);
        let mut fingertip = Fingertip::new(trial.sensor, params)?;
        fingertip.restart_noise(trial.seed, 0);
        let rest: Vec<Vec<u8>> = (0..REST_PICTURES)
            .map(|_| fingertip.rest_image().pixels)
            .collect();
        let rule = TaxelRule::of(&settings_for(network));
        Ok(Self {
            fingertip,
            pipeline: Pipeline::new(network.clone(), &rest, GateKind::default(), rule),
            crop: Image::crop(),
        })
    }

    fn observe(&mut self, truth: TruthFrame, contact: &Truth) -> Result<Frame, EvaluationError> {
        self.fingertip.set_time(truth.time_s);
        self.fingertip.render(contact, &mut self.crop);
        let processed = self.pipeline.process(&self.crop.pixels)?;
        let (exact, _) = ForceMap::quantise(&contact.force_map())?;
        Ok(Frame {
            truth,
            seen: processed.map.clone(),
            health: processed.health,
            exact,
        })
    }
}

impl Chain {
    /// With this network; on the contact world's grid for figures, or a coarse one for tests.
    ///
    /// # Errors
    /// Never with the built-in gel.
    pub fn new(network: Network, coarse: bool) -> Result<Self, EvaluationError> {
        let cells = if coarse { 40 } else { production_cells(GRIPPED_N) };
        let skin = GelSurface::new(&Gel::default(), cells)?;
        Ok(Self {
            network,
            skin: Arc::new(skin),
        })
    }

    /// Plays a trial, seen by a sensor for each of these noises of the camera, grey levels; none is the sensor's own.
    ///
    /// # Errors
    /// A trial that cannot begin, or forces that are no numbers.
    pub fn play(
        &self,
        trial: &Trial,
        noise_levels: &[Option<f64>],
    ) -> Result<Vec<Recorded>, EvaluationError> {
        let mut experiment = Experiment::new(trial, &self.skin)?;
        let mut cameras = Vec::with_capacity(noise_levels.len());
        for &noise in noise_levels {
            cameras.push(FingertipCamera::new(&self.network, trial, noise)?);
        }
        let nothing = Recorded {
            friction: experiment.friction(),
            grip_n: experiment.grip_n(),
            frames: Vec::new(),
            unsolved: None,
        };
        let mut recorded = vec![nothing; cameras.len()];
        loop {
            let truth = match experiment.advance() {
                Ok(Some(truth)) => truth,
                Ok(None) => break,
                Err(error) => {
                    for one in &mut recorded {
                        one.unsolved = Some(error.to_string());
                    }
                    break;
                }
            };
            for (camera, one) in cameras.iter_mut().zip(&mut recorded) {
                one.frames.push(camera.observe(truth, experiment.contact())?);
            }
        }
        Ok(recorded)
    }
}

/// `work` on every item, on this many threads; the results in the items' order.
pub fn in_parallel<T: Sync, R: Send>(items: &[T], threads: usize, work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<(usize, R)>> = Mutex::new(Vec::with_capacity(items.len()));
    thread::scope(|scope| {
        for _ in 0..threads.clamp(1, items.len().max(1)) {
            scope.spawn(|| {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(at) else { break };
                    let result = work(item);
                    results
                        .lock()
                        .unwrap_or_else(PoisonError::into_inner)
                        .push((at, result));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(at, _)| *at);
    results.into_iter().map(|(_, result)| result).collect()
}
