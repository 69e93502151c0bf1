//! `gripline-latency --image FILE.elf [--json]`: measures, bounds, prints; exit code 1 when a number of the design does
//! not hold, 2 for wrong usage.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use gripline_latency::image::Image;
use gripline_latency::measure::{Bench, DOUBTFUL, Way, map_of};
use gripline_latency::{Error, bound};

/// Bounds of the design.
const PATH_CYCLES: u64 = 4_200;
const DENSE_INSTRUCTIONS: u64 = 10_000;
const TAXEL_INSTRUCTIONS: f64 = 24.0;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (image, is_json) = match arguments.as_slice() {
        [option, image] if option == "--image" => (image, false),
        [option, image, json] if option == "--image" && json == "--json" => (image, true),
        found => {
            eprintln!("gripline-latency: expected --image FILE.elf [--json], found {found:?}");
            return ExitCode::from(2);
        }
    };
    match report(image, is_json) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("gripline-latency: {error}");
            ExitCode::FAILURE
        }
    }
}

fn report(path: &str, is_json: bool) -> Result<bool, Error> {
    let elf = std::fs::read(path).map_err(|error| Error::Image(format!("{path}: {error}")))?;
    let image = Image::read(&elf)?;
    let mut bench = Bench::new(&image, &elf)?;
    bench.map(&map_of(400, 1), |_, _| {})?;
    bench.instructions_in(&[]);
    bench.map(&map_of(400, 2), |_, _| {})?;
    let dense = bench.instructions_in(&["kernel::add_pairs", "kernel::Dsp"]);
    let mut quiet = Way::default();
    for contacts in (0..=400).step_by(13).chain(391..400) {
        let way = bench.map(&map_of(contacts, contacts as u32), |_, _| {})?;
        if way.cycles > quiet.cycles {
            quiet = way;
        }
    }
    // Every branch of a map's end: doubtful, replayed, from another fingertip.
    bench.map(&map_of(9, 3), |info, _| info.health = DOUBTFUL)?;
    bench.map(&map_of(9, 3), |info, _| info.sequence = 1)?;
    bench.map(&map_of(9, 3), |info, _| info.sensor = 1)?;
    // Statuses, requests on the control endpoint and ticks at every phase between the packets.
    for round in 0..60_u64 {
        bench.ask();
        bench.run(37_000 * round % 1_000_000)?;
        bench.map(&map_of(59, round as u32), |_, _| {})?;
    }
    let packet = image
        .functions_named("control::Control::packet")
        .find(|one| !one.name.contains("Thunk"));
    let bound = packet
        .map(|function| bound::of(&image, function))
        .unwrap_or_default();
    let per_taxel = dense as f64 / 400.0;
    let holds = bench.worst.cycles <= PATH_CYCLES
        && dense <= DENSE_INSTRUCTIONS
        && per_taxel <= TAXEL_INSTRUCTIONS
        && bound.findings.is_empty();
    let jitter = bench.tick.1.saturating_sub(bench.tick.0);
    if is_json {
        println!(
            "{{\"bound_cycles\": {}, \"measured_worst_cycles\": {}, \"masked_worst_cycles\": {}, \"jitter_cycles\": {jitter}, \
             \"instructions_per_taxel\": {per_taxel:.2}, \"dense_map_instructions\": {dense}, \
             \"f32_dense_map_instructions\": null, \"flash_bytes\": {}, \"ram_bytes\": {}, \"stack_worst_bytes\": {}, \
             \"findings\": {:?}}}",
            bound.cycles,
            bench.worst.cycles,
            bench.masked_worst,
            image.flash_bytes,
            image.ram_bytes,
            bound.stack,
            bound.findings.iter().collect::<Vec<_>>(),
        );
    } else {
        let instructions = bench.worst.instructions;
        println!("map's last packet in the FIFO to the line   {quiet:?} at most with nothing else to do");
        println!(
            "the same under every interruption found      {} cycles, {instructions} instructions (bound {PATH_CYCLES} cycles)",
            bench.worst.cycles
        );
        println!(
            "static bound of Control::packet               {} cycles, {} bytes of stack",
            bound.cycles, bound.stack
        );
        for finding in &bound.findings {
            println!("  stands against it: {finding}");
        }
        println!(
            "interrupts masked at most                     {} cycles",
            bench.masked_worst
        );
        println!(
            "path held off by the tick at most             {} cycles",
            bench.held_off_worst
        );
        println!(
            "timer to the tick's line                      {:?} cycles, jitter {jitter}",
            bench.tick
        );
        println!(
            "dense map                                     {dense} instructions, {per_taxel:.2} a taxel"
        );
        println!("flash {} ram {}", image.flash_bytes, image.ram_bytes);
    }
    Ok(holds)
}
