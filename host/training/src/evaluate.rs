//! How good a weights file is on samples whose particle patterns and contacts were never trained on,
//! computed by the engine that runs it, not by the training framework.

use std::path::Path;

use gripline_network::{Calibration, ForceNetwork};
use serde_json::json;

use crate::dataset::{Dataset, Split, load_or_generate};
use crate::error::TrainingError;
use crate::metrics::{Pair, Scores};

/// Prints the scores of the weights in `weights`, or of those that the engine carries.
pub(crate) fn evaluate(
    weights: Option<&Path>,
    data: &Path,
    seed: u32,
    samples: usize,
    as_json: bool,
) -> Result<(), TrainingError> {
    let mut engine = match weights {
        Some(path) => ForceNetwork::from_file(path)?,
        None => ForceNetwork::embedded()?,
    };
    let set = load_or_generate(data, Split::Test, seed, samples)?;
    let scores = Scores::new(&predict(&mut engine, &set), engine.calibration());
    let Calibration {
        contact_min_n,
        friction,
    } = engine.calibration();
    if as_json {
        let report = json!({
            "contact_min_n": contact_min_n,
            "friction": friction,
            "manifest": engine.manifest(),
            "scores": scores.to_json(),
        });
        println!("{report}");
    } else {
        println!("contact above {contact_min_n} N per taxel, friction {friction:.4}");
        println!("trained: {}", engine.manifest());
        print!("{}", scores.to_table());
    }
    Ok(())
}

/// Predicted and true maps of a whole set.
pub(crate) fn predict(engine: &mut ForceNetwork, set: &Dataset) -> Vec<Pair> {
    (0..set.len())
        .map(|sample| {
            let mut predicted = [[0.0; 3]; 400];
            engine.set_rest(set.rest(sample));
            engine.infer(set.now(sample), &mut predicted);
            Pair {
                predicted,
                truth: *set.forces_n(sample),
            }
        })
        .collect()
}
