//! `cargo xtask physics`: the world against closed forms, conservation laws, independent programs and itself on a
//! finer grid. Prints a table, writes pictures, exits 1 when a figure is out of bounds. Run on a quiet machine:
//! the last section judges speed.
#![allow(
    clippy::too_many_lines,
    reason = "a section reads from top to bottom: cases, figures, rows, charts"
)]

mod balance;
mod chart;
mod failure;
mod grid;
mod hertz;
mod large_strain;
mod limit;
mod maps;
mod pull;
mod report;
mod scenes;
mod speed;
mod tamaas;
mod torsion;
mod world;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use chart::Pictures;
use failure::Failure;
use report::Report;
use world::World;

const HELP: &str = "\
physics [--quick] [--json] [--out DIR] [--only SECTION,...] [--without SECTION,...]

  --quick    fewer cases in the long sections (limit, grid, balance, scenes, elements)
  --json     one JSON object on standard output instead of the table
  --out      folder for the pictures (made if absent; none are drawn without)
  --only     these sections: hertz, pull, twist, limit, grid, balance, scenes, tamaas,
             elements, pictures, speed
  --without  all sections but these
";

const SECTIONS: [&str; 11] = [
    "hertz", "pull", "twist", "limit", "grid", "balance", "scenes", "tamaas", "elements", "pictures", "speed",
];

struct Options {
    quick: bool,
    json: bool,
    out: Option<PathBuf>,
    sections: Vec<&'static str>,
}

/// The sections of a comma-separated list.
fn listed(option: &str, list: &str) -> Result<Vec<&'static str>, String> {
    list.split(',')
        .map(|name| {
            let known = SECTIONS.into_iter().find(|section| *section == name);
            known.ok_or_else(|| {
                format!(
                    "{option}: found `{name}`, expected some of {}",
                    SECTIONS.join(", ")
                )
            })
        })
        .collect()
}

fn options() -> Result<Option<Options>, String> {
    let mut options = Options {
        quick: false,
        json: false,
        out: None,
        sections: SECTIONS.to_vec(),
    };
    let mut rest = std::env::args().skip(1);
    while let Some(argument) = rest.next() {
        let mut value = || {
            rest.next()
                .ok_or_else(|| format!("{argument}: found nothing, expected a value after it"))
        };
        match argument.as_str() {
            "--quick" => options.quick = true,
            "--json" => options.json = true,
            "--out" => options.out = Some(PathBuf::from(value()?)),
            "--only" => options.sections = listed("--only", &value()?)?,
            "--without" => {
                let left_out = listed("--without", &value()?)?;
                options.sections.retain(|section| !left_out.contains(section));
            }
            "--help" | "-h" => return Ok(None),
            found => {
                return Err(format!(
                    "argument: found `{found}`, expected --quick, --json, --out DIR, --only SECTION,... or --without \
                     SECTION,..."
                ));
            }
        }
    }
    Ok(Some(options))
}

fn main() -> ExitCode {
    match options() {
        Ok(Some(options)) => measure(&options),
        Ok(None) => {
            print!("{HELP}");
            ExitCode::SUCCESS
        }
        Err(why) => {
            eprintln!("physics: {why}");
            ExitCode::from(2)
        }
    }
}

fn measure(options: &Options) -> ExitCode {
    let started = Instant::now();
    let pictures = match Pictures::new(options.out.clone()) {
        Ok(pictures) => pictures,
        Err(error) => {
            eprintln!("physics: --out: {error}");
            return ExitCode::FAILURE;
        }
    };
    let world = World::new(options.quick);
    let mut report = Report::default();
    let wanted = |name: &str| options.sections.contains(&name);
    let mut section =
        |name: &'static str, what: &str, run: &mut dyn FnMut(&mut Report) -> Result<(), Failure>| {
            if !wanted(name) {
                return;
            }
            eprintln!("{name}: {what}");
            let began = Instant::now();
            if let Err(error) = run(&mut report) {
                report.failed(name, &error.to_string());
            }
            eprintln!("   {:.1} s", began.elapsed().as_secs_f64());
        };
    // The two long ones run beside the others.
    let elements = wanted("elements").then(|| {
        let quick = options.quick;
        std::thread::spawn(move || large_strain::compare(quick))
    });
    let mut script = wanted("tamaas").then(|| tamaas::start(&world));
    section("hertz", "pressed spheres", &mut |report| {
        hertz::run(&world, report, &pictures)
    });
    section("pull", "pulled spheres", &mut |report| {
        pull::run(&world, report, &pictures)
    });
    section("twist", "twisted contacts", &mut |report| {
        torsion::run(&world, report, &pictures)
    });
    section("limit", "pull and twist together", &mut |report| {
        limit::run(&world, report, &pictures)
    });
    section(
        "grid",
        "the production grid against one twice as fine",
        &mut |report| grid::run(&world, report),
    );
    section(
        "balance",
        "random paths of every shape; residuals of all steps so far",
        &mut |report| {
            balance::walk(&world)?;
            balance::rows(&world, report);
            Ok(())
        },
    );
    section("scenes", "whole presses and grasps", &mut |report| {
        scenes::run(&world, report)
    });
    section(
        "tamaas",
        "rough and odd shapes in an independent solver",
        &mut |report| match script.take() {
            Some(running) => running?.finish(report),
            None => Ok(()),
        },
    );
    let mut elements = elements;
    section(
        "elements",
        "the layer at large strain",
        &mut |report| match elements.take() {
            Some(thread) => {
                let found = thread.join().map_err(|_| "the finite elements panicked")??;
                large_strain::rows(&found, report, &pictures)
            }
            None => Ok(()),
        },
    );
    section("pictures", "maps of tractions, slip and images", &mut |_| {
        maps::run(&world, &pictures)
    });
    section(
        "speed",
        "training samples; nothing else should run",
        &mut |report| speed::run(report),
    );

    let seconds = started.elapsed().as_secs_f64();
    if options.json {
        println!("{:#}", report.json(seconds));
    } else {
        print!("{}", report.text());
    }
    eprintln!("{seconds:.0} s in all");
    if report.ok() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
