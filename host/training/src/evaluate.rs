//! Scores of a weights file on shapes and sensors never trained on, computed by the inference engine, not by the training
//! framework.

use std::collections::BTreeMap;
use std::path::Path;

use gripline_network::metrics::{Pair, Scores};
use gripline_network::{Architecture, Calibration};
use gripline_simulation::Split;
use serde_json::json;

use crate::dataset::Dataset;
use crate::error::TrainingError;
use crate::store::{Store, world_fingerprint};
use crate::weights::Engine;

/// Prints the scores of the weights in a file, or of the built-in ones.
pub(crate) fn evaluate(
    architecture: Architecture,
    weights: Option<&Path>,
    data: &Path,
    seed: u32,
    samples: usize,
    as_json: bool,
) -> Result<(), TrainingError> {
    let mut engine = Engine::open(architecture, weights)?;
    let set = Store::new(data, Split::Test, seed, &world_fingerprint()?).load(samples)?;
    let pairs = predict(&mut engine, &set);
    let scores = Scores::new(&pairs, engine.calibration());
    let mut of_shape: BTreeMap<&str, Vec<Pair>> = BTreeMap::new();
    for (sample, pair) in pairs.into_iter().enumerate() {
        of_shape.entry(set.shape(sample)).or_default().push(pair);
    }
    of_shape.remove("none");
    let of_shape: BTreeMap<&str, Scores> = of_shape
        .into_iter()
        .map(|(shape, pairs)| (shape, Scores::new(&pairs, engine.calibration())))
        .collect();
    let Calibration {
        contact_min_n,
        friction,
    } = engine.calibration();
    if as_json {
        let report = json!({
            "network": architecture.name(),
            "contact_min_n": contact_min_n,
            "friction": friction,
            "manifest": engine.manifest(),
            "scores": scores,
            "scores_of_shape": of_shape,
        });
        println!("{report}");
    } else {
        println!("network {}", architecture.name());
        println!("contact above {contact_min_n} N per taxel, friction {friction:.4}");
        println!("trained: {}", engine.manifest());
        print!("{}", scores.to_table());
        println!("by shape      {}", Scores::LINE_HEADER);
        for (shape, scores) in of_shape {
            println!("  {shape:12}{}", scores.to_line());
        }
    }
    Ok(())
}

/// Predicted and true maps of a whole set.
pub(crate) fn predict(engine: &mut Engine, set: &Dataset) -> Vec<Pair> {
    (0..set.len())
        .map(|sample| Pair {
            predicted: engine.infer(set, sample),
            truth: *set.forces_n(sample),
        })
        .collect()
}
