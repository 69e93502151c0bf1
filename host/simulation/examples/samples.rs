//! What random samples cost and hold on this machine: `cargo run --release -p gripline-simulation --example samples
//! [COUNT]`. Two threads, one stream each.

use std::collections::BTreeMap;
use std::time::Instant;

use gripline_simulation::{Costs, Counts, Sample, SampleGenerator, SampleWorld, Split};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    const THREADS: u64 = 2;
    let count: usize = std::env::args().nth(1).map_or(Ok(1000), |text| text.parse())?;
    let world = SampleWorld::new()?;
    let draw = |seed: u64, count: usize| {
        let mut generator = SampleGenerator::new(&world, Split::Train, seed);
        let samples: Vec<Sample> = generator.by_ref().take(count).collect();
        (samples, generator.counts(), generator.costs())
    };
    // Spectra for boxes of the usual sizes are made once.
    draw(0, 100);
    let start = Instant::now();
    let drawn: Vec<(Vec<Sample>, Counts, Costs)> = std::thread::scope(|scope| {
        let threads: Vec<_> = (1..=THREADS)
            .map(|seed| scope.spawn(move || draw(seed, count)))
            .collect();
        threads
            .into_iter()
            .map(|thread| thread.join().expect("a stream does not panic"))
            .collect()
    });
    let wall_s = start.elapsed().as_secs_f64();
    let made = count * THREADS as usize;
    println!(
        "{made} samples in {wall_s:.2} s on {THREADS} threads: {:.0} per second",
        made as f64 / wall_s
    );
    let each_ms = |pick: fn(&Costs) -> std::time::Duration| {
        drawn
            .iter()
            .map(|(_, _, costs)| pick(costs).as_secs_f64())
            .sum::<f64>()
            * 1e3
            / made as f64
    };
    println!(
        "ms of one core per sample: solver {:.2}, sensors {:.2}, picture {:.2}, downsample {:.2}",
        each_ms(|c| c.solver),
        each_ms(|c| c.sensors),
        each_ms(|c| c.picture),
        each_ms(|c| c.downsample)
    );
    let mut counts = Counts::default();
    let mut shapes: BTreeMap<&str, [usize; 3]> = BTreeMap::new();
    let mut loads: Vec<f64> = Vec::new();
    let mut ratios = [0; 6];
    for (samples, more, _) in &drawn {
        counts += *more;
        for sample in samples {
            let entry = shapes.entry(sample.shape).or_default();
            entry[0] += 1;
            entry[1] += usize::from(sample.gross_slip);
            entry[2] += usize::from(sample.true_stick_ratio.is_some_and(|ratio| ratio < 0.5));
            if let Some(ratio) = sample.true_stick_ratio {
                ratios[(ratio * 5.0) as usize] += 1;
                loads.push(sample.forces.iter().map(|f| f64::from(f[2])).sum());
            }
        }
    }
    println!("{counts:?}");
    println!("shape: samples, in gross slip, true stick ratio below one half");
    for (name, numbers) in shapes {
        println!("  {name:12} {numbers:?}");
    }
    loads.sort_by(f64::total_cmp);
    let at = |share: f64| loads[((loads.len() - 1) as f64 * share) as usize];
    println!(
        "loads, N: 5 % {:.2}, 25 % {:.2}, median {:.2}, 75 % {:.2}, 95 % {:.2}, most {:.2}",
        at(0.05),
        at(0.25),
        at(0.5),
        at(0.75),
        at(0.95),
        at(1.0)
    );
    println!("true stick ratio in fifths: {ratios:?}");
    Ok(())
}
