//! The command `gripline evaluate paper`: arguments, the runs, what is printed and written. Touches the world.

use std::io::{self, Write};
use std::path::PathBuf;

use clap::Args;
use gripline_network::{Architecture, Network};

use super::chain::{Chain, Recorded, in_parallel};
use super::document::write_section;
use super::plan::{Amount, Data, Planned, Purpose, plan};
use super::progress::Progress;
use super::report::{NOISE_LEVELS, Report};
use gripline_pipeline::settings_for;
use gripline_recording::error::{Completion, Failure};

/// The arguments of `gripline evaluate paper`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct PaperArgs {
    /// Print the figures as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Everything random follows from it.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=99))]
    pub seed: u64,
    /// Runs of the sequence T-T-R-T-T per object.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=50))]
    pub runs: u64,
    /// Only the first so many of the five objects: a look at it, no evidence.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=5))]
    pub objects: u8,
    /// One short run of each kind per object on the coarse grid: a look at it, no evidence.
    #[arg(long)]
    pub quick: bool,
    /// Which data: what is reported, or what the settings were chosen on.
    #[arg(long, value_enum, default_value_t)]
    pub data: Data,
    /// Force network instead of the default one: unet or tracked.
    #[arg(long, value_name = "NAME", default_value_t)]
    pub network: Architecture,
    /// Threads.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub threads: u8,
    /// Write the figures as a section of this document.
    #[arg(long, value_name = "FILE.md")]
    pub out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the network cannot be loaded or a file not be written.
pub fn run(args: &PaperArgs) -> Result<Completion, Failure> {
    let report = measure(args)?;
    let mut text = Vec::new();
    if args.json {
        serde_json::to_writer(&mut text, &report).map_err(Failure::failed)?;
        text.push(b'\n');
    } else {
        text.extend_from_slice(report.markdown().as_bytes());
    }
    io::stdout().write_all(&text).map_err(Failure::failed)?;
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

fn measure(args: &PaperArgs) -> Result<Report, Failure> {
    let network = Network::embedded(args.network).map_err(Failure::failed)?;
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
fn play(chain: &Chain, planned: &Planned, quick: bool) -> Result<Vec<Recorded>, Failure> {
    let mut noise = vec![None];
    if planned.purpose == Purpose::Sequence && planned.run == 0 && !quick {
        noise.extend(NOISE_LEVELS.map(Some));
    }
    chain.play(&planned.trial, &noise)
}
