//! Rendered training samples a second on two threads, best of several runs, and where the time goes.

use std::time::{Duration, Instant};

use gripline_simulation::{Costs, Counts, SampleGenerator, SampleWorld, Split};

use crate::failure::Failure;
use crate::report::{Bound, Report};
use crate::world::THREADS;

const RUNS: u64 = 4;
const SAMPLES_A_RUN: usize = 800;

/// Key, words and cost of a stage.
type Stage = (&'static str, &'static str, fn(&Costs) -> Duration);

pub(crate) fn run(report: &mut Report) -> Result<(), Failure> {
    let world = SampleWorld::new()?;
    let draw = |seed: u64, count: usize| {
        let mut generator = SampleGenerator::new(&world, Split::Train, seed);
        generator.by_ref().take(count).for_each(|sample| {
            std::hint::black_box(sample);
        });
        (generator.costs(), generator.counts())
    };
    // Spectra for boxes of the usual sizes are made once.
    draw(0, 100);
    let (mut best, mut costs) = (0.0, Vec::new());
    for run in 0..RUNS {
        let start = Instant::now();
        let spent: Vec<(Costs, Counts)> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..THREADS as u64)
                .map(|thread| scope.spawn(move || draw(1 + run * THREADS as u64 + thread, SAMPLES_A_RUN)))
                .collect();
            threads
                .into_iter()
                .map(std::thread::ScopedJoinHandle::join)
                .collect::<Result<_, _>>()
        })
        .map_err(|_| "a stream of samples panicked")?;
        let rate = (THREADS * SAMPLES_A_RUN) as f64 / start.elapsed().as_secs_f64();
        eprintln!("   run {}: {rate:.0} a second", run + 1);
        if rate > best {
            (best, costs) = (rate, spent);
        }
    }
    report.row(
        "speed",
        "rendered training samples a second, 2 threads, best of 4 runs",
        "issue's bound on 2 cores",
        Bound::AtLeast(300.0),
        (best, "/s"),
        "",
    );
    let stages: [Stage; 4] = [
        ("speed_solver_ms", "of it, contact solver", |c| c.solver),
        ("speed_sensors_ms", "of it, new virtual sensors", |c| c.sensors),
        ("speed_picture_ms", "of it, field, drawing and exposure", |c| {
            c.picture
        }),
        ("speed_downsample_ms", "of it, 440 × 440 to 88 × 88", |c| {
            c.downsample
        }),
    ];
    for (key, measure, pick) in stages {
        let spent: f64 = costs.iter().map(|(c, _)| pick(c).as_secs_f64()).sum();
        let each = 1e3 * spent / (THREADS * SAMPLES_A_RUN) as f64;
        report.row(
            key,
            measure,
            "one core, a sample",
            Bound::Reported,
            (each, "ms"),
            "",
        );
    }
    Ok(())
}
