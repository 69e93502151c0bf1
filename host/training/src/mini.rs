#![allow(dead_code)]
mod constants;
mod error;
mod markers;
mod rng;
mod shard {
    use crate::error::{TrainingError, at};
    use std::path::Path;
    pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<(), TrainingError> {
        std::fs::write(path, bytes).map_err(at(path))
    }
}
use clap::Parser;
use std::path::PathBuf;
#[derive(Parser)]
struct Arguments {
    #[arg(long, global = true, default_value = "/tmp/i20/data")]
    data: PathBuf,
    #[arg(long, global = true, default_value_t = 1)]
    seed: u32,
    #[arg(long, global = true, default_value_t = 3000)]
    held_out: u32,
    #[command(subcommand)]
    command: markers::Command,
}
fn main() {}
#[test]
fn go() {
    let Ok(text) = std::env::var("MINI") else { return };
    let a = Arguments::parse_from(std::iter::once("mini").chain(text.split(' ')));
    if let Err(error) = markers::run(&a.command, &a.data, a.seed, a.held_out) {
        panic!("gripline-training: {error}");
    }
}
