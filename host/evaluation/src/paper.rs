//! The command `gripline evaluate paper`: arguments, the runs, what is printed and written. Touches the world.

use std::io::{self, Write};

use gripline_network::Network;

pub use super::arguments::PaperArgs;
use super::chain::{Chain, Recorded, in_parallel};
use super::document::write_section;
use super::plan::{Amount, Planned, Purpose, plan};
use super::progress::Progress;
use super::report::{NOISE_LEVELS, Report};
use crate::error::EvaluationError;
use gripline_pipeline::settings_for;
use gripline_recording::error::Completion;

/// Runs the command.
///
/// # Errors
/// [`EvaluationError`] when the network cannot be loaded or a file not be written.
pub fn run(args: &PaperArgs) -> Result<Completion, EvaluationError> {
    let report = measure(args)?;
    let mut text = Vec::new();
    if args.json {
        serde_json::to_writer(&mut text, &report)?;
        text.push(b'\n');
    } else {
        text.extend_from_slice(report.markdown().as_bytes());
    }
    io::stdout().write_all(&text)?;
    if let Some(path) = &args.out {
        write_section(path, "gripline evaluate paper", &report.markdown())?;
    }
    match report.unsolved.first() {
        None => Ok(Completion::Whole),
        Some(first) => Ok(Completion::WithLoss(format!(
            "done with loss: {} runs ended early because the contact had no solution; the first: {first}",
            report.unsolved.len()
        ))),
    }
}

fn measure(args: &PaperArgs) -> Result<Report, EvaluationError> {
    let network = Network::embedded(args.network)?;
    let ours = settings_for(&network);
    let chain = Chain::new(network, args.quick)?;
    let amount = if args.quick {
        Amount {
            runs: 1,
            short: true,
            hold_s: 3.0,
        }
    } else {
        Amount {
            runs: args.runs,
            short: false,
            hold_s: 24.0,
        }
    };
    let mut planned = plan(args.data, args.seed, amount);
    planned.retain(|planned| planned.object < args.objects.into());
    let progress = Progress::new("runs", planned.len());
    let mut noisy = NOISE_LEVELS.map(|_| Vec::new());
    let played = in_parallel(&planned, args.threads.into(), |planned| {
        let recorded = play(&chain, planned, args.quick);
        progress.step();
        recorded
    });
    progress.finish();
    let mut recorded = Vec::with_capacity(planned.len());
    for (planned, played) in planned.iter().zip(played) {
        let mut played = played?.into_iter();
        recorded.extend(played.next());
        for (noisy, recorded) in noisy.iter_mut().zip(played) {
            noisy.push((planned.clone(), recorded));
        }
    }
    Ok(Report::new(args, &planned, &recorded, &noisy, &ours))
}

/// A run as its sensor sees it; an object's first one also with more and less noise.
fn play(chain: &Chain, planned: &Planned, quick: bool) -> Result<Vec<Recorded>, EvaluationError> {
    let mut noise = vec![None];
    if planned.purpose == Purpose::Sequence && planned.run == 0 && !quick {
        noise.extend(NOISE_LEVELS.map(Some));
    }
    chain.play(&planned.trial, &noise)
}
