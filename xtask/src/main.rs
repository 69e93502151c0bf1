//! `cargo xtask`: the commands that build, test and measure Gripline.
//!
//! Each command says what it runs, works on a machine with only the Rust toolchain and the package registries, and
//! fails when something it was asked to check cannot be checked. Products land in `target/gripline`.
#![forbid(unsafe_code)]

mod arm;
mod bench;
mod cpio;
mod debian;
mod emulator;
mod error;
mod figures;
mod firmware;
mod flash;
mod foxglove;
mod fuzz;
mod hot;
mod live_page;
mod modules;
mod option_bytes;
mod outside;
mod package;
mod physics;
mod process;
mod programs;
mod python;
mod requests;
mod ros2;
mod screenshots;
mod test;
mod test_parts;
mod toolchain;
mod venv;
mod vm;

use std::process::ExitCode;

use error::Error;
use test::Tier;

const HELP: &str = "\
cargo xtask COMMAND

  test [--all | --board [--all] | --python | --physics | --ros2 | --zenoh | --foxglove]
                                    every check that a change has to pass, in order, with a summary; --all: the slow ones
                                    too; --board: only those of images, emulator and latency; --python: only that of the Python
                                    package; --physics: only that of the test world, as the tests are built; --ros2, --zenoh,
                                    --foxglove: only those of the bridge's feature of this name, whose crates take minutes to
                                    build the first time; --ros2 and --foxglove need Python 3 with venv (they install the other
                                    end, a DDS and a WebSocket client, into the build folder)
  screenshots                       play the scripted scene and draw the README's pictures of view, plot and live page anew;
                                    the page needs Chromium, which is installed
  figures [all | NAME...]           measure anew what is named in docs/figures.toml, and write docs/figures.md
  firmware [--board BOARD] [--out FILE]
                                    build the image and print `flash N ram N` in bytes; BOARD is
                                    stm32f405rg (default) or stm32f427vi
  emulator                          build the emulator and the image it runs; print their paths
  flash [--board BOARD] [--probe VID:PID[:SERIAL]] [--log]
                                    build the image and put it on the chip with probe-rs; --log then shows the
                                    firmware's log (DEFMT_LOG says how much of it the image keeps)
  fuzz [--minutes N] [--save] [TARGET...]
                                    run the parsers and the microcontroller's program against a fuzzer, 10 minutes
                                    each or N; --save keeps what reached new code in tests/fuzz/corpus
  latency [--short] [--json] | --bless  from a map's last packet to the line on the emulated board, in instructions and in
                                    Cortex-M4 cycles at most; fails when a number of the design does not hold;
                                    --bless renews the instruction counts that the tests hold
  lint                              format, imports and lints of the workspace; `test --all` checks them too
  modules                           fail when files of a crate import each other in a circle, and say through which names
  package [--target TARGET] [--profile PROFILE] | --check
                                    build a Debian package of the bridge in target/gripline: program, man pages,
                                    completions, udev rule, systemd unit, configuration; TARGET is x86_64 or aarch64;
                                    --check installs, starts, hangs, stops and removes it in the virtual machine
  toolchain [--arm] [--from-sources]
                                    make this machine able to build for the microcontroller, or for 64-bit ARM;
                                    --from-sources passes over rustup and an installed target
  arm [build | instructions [--json]]
                                    64-bit ARM: builds with Debian's cross compiler, tests under qemu-user, the networks'
                                    bits against this processor's, instructions of a frame with NEON against portable;
                                    fetches compiler, emulator and standard library; build: only the bridge, and its
                                    path; instructions: only bits and counts
  vm [--profile PROFILE] [--only WORD]
                                    boot a Debian kernel in qemu and run `gripline` in it, built with PROFILE (release),
                                    against a virtual camera and virtual microcontrollers on USB: formats, controls,
                                    plugs pulled, programs hung and killed, disks full and slow; fetches qemu and the
                                    kernel; --only runs the checks that have WORD in their name
  bench [--json] [--frames N] [--rounds N] [--seed N] [--instructions SET] [--plot FILE]
                                    run time against error for the whole chain and each of its stages, a NumPy detector
                                    beside ours, what skipping saves by kind of scene and what it changes; tables and a
                                    plot; needs Python with pip
  bench network [--json] [--instructions SET] [--rounds N] [--samples N] [--weights FILE]... [--plot FILE]
                                    time the force networks against onnxruntime and tract and against this processor's
                                    limit; --instructions forces ours to portable, avx2, avx512 or neon, and with avx2 hides from the
                                    others what is wider; errors on N samples of the test world (1,500, made in memory in a minute);
                                    table, and a plot of time against error; --weights adds networks; needs Python
                                    with pip
  bench outside [--json] [--rounds N] [--seconds S]
                                    what readers cost the loop (ten HTTP streams, two of another DDS, some that stand still), and
                                    how long a request takes until it is confirmed; wants a quiet machine
  bench page [--json]               how long a browser takes until the live page shows its first picture, and a frame that the loop
                                    handed over; installs Chromium, wants a quiet machine
  bench requests [--json]           how long a request takes until the microcontroller confirms it, by its own clock: in process and
                                    on the emulated board, over a cable that loses packets too
  stress [--json] [--seed N] [--quick] [--docs]
                                    numerical stability of detector and controller: sweeps with exact arithmetic as the
                                    judge, a table and a verdict each; --docs writes docs/stress.md and its pictures;
                                    a quick run is part of `test`
  gate [ARGUMENTS]                  train and export the scene gate's network, and have LiteRT answer its golden file;
                                    needs Python with pip
  physics [--json] [--out DIR] [--without SECTION,...]
                                    the test world against closed forms, other programs and a finer grid; prints a
                                    table, writes pictures to DIR; wants a quiet machine (it judges speed) and
                                    Python 3 with venv (it installs tamaas into the build folder)
  train [ARGUMENTS]                 run the trainer (host/training) with these arguments
  wheel [--bench [--json]]          build the Python package into target/wheels and print its size; --bench times import and
                                    detector beside `gripline detect`; needs Python 3 with venv and PyPI

Exit code: 0 done, 1 failed, 2 wrong usage.
";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match dispatch(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: {error}");
            error.exit_code()
        }
    }
}

fn dispatch(arguments: &[String]) -> Result<(), Error> {
    let (command, rest) = match arguments.split_first() {
        None => ("help", arguments),
        Some((command, rest)) => (command.as_str(), rest),
    };
    match command {
        "help" | "--help" | "-h" => {
            print!("{HELP}");
            Ok(())
        }
        "test" if rest == ["--ros2"] => test::ros2(),
        "test" if rest == ["--zenoh"] => test::zenoh(),
        "test" if rest == ["--foxglove"] => test::foxglove(),
        "test" if rest == ["--python"] => test::python(),
        "test" if rest == ["--physics"] => test::physics(),
        "test" if rest == ["--board"] => test::board(Tier::Quick),
        "test" if rest == ["--board", "--all"] => test::board(Tier::All),
        "test" if rest == ["--all"] => test::run(Tier::All),
        "test" => no_more(rest).and_then(|()| test::run(Tier::Quick)),
        "test-part" => test_parts::command(rest),
        "screenshots" => no_more(rest).and_then(|()| screenshots::run()),
        "firmware" => firmware::command(rest),
        "flash" => flash::command(rest),
        "figures" => figures::command(rest),
        "fuzz" => fuzz::command(rest),
        "emulator" => no_more(rest).and_then(|()| emulator::command()),
        "lint" => no_more(rest).and_then(|()| test::lint()),
        "modules" => no_more(rest).and_then(|()| modules::run()),
        "latency" => emulator::latency(rest),
        "arm" => arm::command(rest),
        "toolchain" => toolchain::command(rest),
        "package" if rest == ["--check"] => vm::package::run("dev"),
        "package" => package::command(rest),
        "vm" => vm::command(rest),
        "bench" => bench::command(rest),
        "stress" => process::run(
            process::cargo()
                .args(["run", "--profile", "stress", "--package", "gripline-stress", "--"])
                .args(rest),
        ),
        "gate" => bench::train_gate(rest),
        "physics" => physics::run(rest),
        "train" => process::run(
            process::cargo()
                .args(["run", "--release", "--package", "gripline-training", "--"])
                .args(rest),
        ),
        "wheel" => python::wheel(rest),
        unknown => Err(Error::usage(
            "command",
            unknown,
            "one of those that `cargo xtask` lists",
        )),
    }
}

/// Refuses whatever follows a command that takes no arguments.
fn no_more(arguments: &[String]) -> Result<(), Error> {
    arguments
        .first()
        .map_or(Ok(()), |found| Err(Error::usage("argument", found, "none")))
}
