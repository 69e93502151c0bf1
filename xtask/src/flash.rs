//! `cargo xtask flash`: builds a board's image and puts it on the chip with probe-rs.
//!
//! Only the sectors of the image are erased: the stored settings stay. Then it sets brown-out level 3 in the option bytes. Limits: one probe, or one named by `--probe`.

use std::process::Command;

use crate::error::{Error, value_of};
use crate::firmware::{self, Board};
use crate::{option_bytes, process};

/// `cargo xtask flash`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let (mut board, mut probe, mut log) = (Board::Stm32f405rg, None, false);
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        match argument.as_str() {
            "--board" => board = Board::named(value_of("--board", &mut rest)?)?,
            "--probe" => probe = Some(value_of("--probe", &mut rest)?),
            "--log" => log = true,
            unknown => {
                return Err(Error::usage(
                    "argument",
                    unknown,
                    "--board BOARD, --probe VID:PID[:SERIAL] or --log",
                ));
            }
        }
    }
    // Before the build, which takes longer.
    if process::output(Command::new("probe-rs").arg("--version")).is_err() {
        return Err(Error::Product {
            what: "probe-rs".to_owned(),
            found: "no such program".to_owned(),
            expected: "it on the PATH: `cargo install probe-rs-tools --locked`".to_owned(),
        });
    }
    let (elf, size) = firmware::build(board)?;
    size.check(board)?;
    println!("image {}\n{size}", elf.display());
    let tool = |verb: &str| {
        let mut tool = Command::new("probe-rs");
        tool.args([verb, "--chip", board.chip()]);
        if let Some(probe) = probe {
            tool.args(["--probe", probe]);
        }
        tool
    };
    process::run(tool("download").arg("--verify").arg(&elf))?;
    option_bytes::set_brown_out_level(tool)?;
    process::run(&mut tool("reset"))?;
    if log {
        process::run(tool("attach").arg(&elf))?;
    }
    Ok(())
}
