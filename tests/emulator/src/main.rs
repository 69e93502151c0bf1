//! `gripline-emulator --image FILE.elf`: the emulated board behind a pipe (see [`gripline_emulator::wire`]).
//! Standard input and output carry the pipe; what a person should read goes to standard error.
//! Exit code 0 when the parent closes the pipe, 1 failed, 2 wrong usage.
#![forbid(unsafe_code)]

use std::io::{BufReader, BufWriter, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use gripline_emulator::wire::{LineWrite, Reply, Request, WireError, write_greeting};
use gripline_emulator::{Board, EmulatorError};

const USAGE: &str = "\
usage: gripline-emulator --image FILE.elf [--settings FILE] [--log FILE] [--gaps]

  --image FILE.elf   the firmware image to run (`cargo xtask firmware --board stm32f427vi`)
  --settings FILE    where the settings lie while the power is off: read at the start if it is there,
                     written whenever the firmware has changed them
  --log FILE         at the end write the raw RTT log there, for `defmt-print -e FILE.elf`
  --gaps             at the end list on standard error what the emulated part has no model for

Standard input and output carry the pipe of the README; a parent process drives it.
Exit code: 0 done, 1 failed, 2 wrong usage.
";

/// Why the program ends with an exit code other than 0.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("{0}\n\n{USAGE}")]
    Usage(String),
    #[error("image: cannot read {}: {source}; expected an ELF file", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: {source}", path.display())]
    Boot { path: PathBuf, source: EmulatorError },
    #[error("settings: cannot use {}: {source}", path.display())]
    Settings { path: PathBuf, source: std::io::Error },
    #[error("log: cannot write {}: {source}", path.display())]
    Log { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Run(#[from] EmulatorError),
    #[error(transparent)]
    Wire(#[from] WireError),
}

struct Options {
    image: PathBuf,
    settings: Option<PathBuf>,
    log: Option<PathBuf>,
    gaps: bool,
}

fn main() -> ExitCode {
    match options(std::env::args().skip(1)).and_then(|options| serve(&options)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("gripline-emulator: {failure}");
            ExitCode::from(if matches!(failure, Failure::Usage(_)) {
                2
            } else {
                1
            })
        }
    }
}

fn options(mut arguments: impl Iterator<Item = String>) -> Result<Options, Failure> {
    let (mut image, mut settings, mut log, mut gaps) = (None, None, None, false);
    while let Some(argument) = arguments.next() {
        let mut file = || {
            let value = arguments.next().map(PathBuf::from);
            value
                .ok_or_else(|| Failure::Usage(format!("{argument}: expected a file after it, found nothing")))
        };
        match argument.as_str() {
            "--image" => image = Some(file()?),
            "--settings" => settings = Some(file()?),
            "--log" => log = Some(file()?),
            "--gaps" => gaps = true,
            unknown => return Err(Failure::Usage(format!("expected an option, found {unknown}"))),
        }
    }
    let image =
        image.ok_or_else(|| Failure::Usage("--image: expected a firmware image, found none".into()))?;
    if std::io::stdin().is_terminal() {
        return Err(Failure::Usage(
            "standard input: expected a pipe from a parent process, found a terminal".into(),
        ));
    }
    Ok(Options {
        image,
        settings,
        log,
        gaps,
    })
}

fn serve(options: &Options) -> Result<(), Failure> {
    let path = &options.image;
    let elf = std::fs::read(path).map_err(|source| Failure::Read {
        path: path.clone(),
        source,
    })?;
    let settings = match &options.settings {
        Some(path) if path.exists() => std::fs::read(path).map_err(|source| Failure::Settings {
            path: path.clone(),
            source,
        })?,
        _ => Vec::new(),
    };
    let mut board = Board::boot_with_settings(&elf, &settings).map_err(|source| Failure::Boot {
        path: path.clone(),
        source,
    })?;
    let talked = talk(&mut board, options.settings.as_deref());
    // The log is wanted most when the talk went wrong.
    if let Some(path) = &options.log {
        std::fs::write(path, board.log()).map_err(|source| Failure::Log {
            path: path.clone(),
            source,
        })?;
    }
    if options.gaps {
        for gap in board.gaps() {
            eprintln!("gripline-emulator: {gap}");
        }
    }
    talked
}

/// Answers requests until the parent closes the pipe.
fn talk(board: &mut Board, settings: Option<&Path>) -> Result<(), Failure> {
    let mut requests = BufReader::new(std::io::stdin().lock());
    let mut replies = BufWriter::new(std::io::stdout().lock());
    write_greeting(&mut replies)?;
    while let Some(request) = Request::read(&mut requests)? {
        board.uart_send(&request.uart_bytes);
        board.usb_cable(request.cable);
        for packet in &request.usb_packets {
            board.usb_send(packet);
        }
        for (setup, data) in &request.usb_controls {
            board.usb_control(*setup, data);
        }
        if let Some((fault, address)) = request.fault {
            board.inject_fault(fault, address);
        }
        for &disturbance in &request.disturbances {
            board.disturb(disturbance);
        }
        let resets_before = board.resets().len();
        let (packets_before, transfers_before) = (board.usb_packets().len(), board.usb_transfers().len());
        let writes_before = board.dac_writes().len();
        board.run_for(request.advance_ns)?;
        if let (Some(path), Some(bytes)) = (settings, board.take_settings()) {
            std::fs::write(path, bytes).map_err(|source| Failure::Settings {
                path: path.to_owned(),
                source,
            })?;
        }
        let line_writes = board.dac_writes()[writes_before..]
            .iter()
            .filter(|write| write.channel == 1)
            .map(|write| LineWrite {
                at_ns: write.at_ns,
                code: write.code,
            })
            .collect();
        let reply = Reply {
            now_ns: board.now_ns(),
            instructions: board.instructions(),
            resets: board.resets().len() as u32,
            dac_code: board.dac_code(1).unwrap_or(0),
            uart_bytes: board.uart_take(),
            line_writes,
            usb_state: board.usb_state(),
            usb_enumerations: board.usb_enumerations() as u32,
            usb_waiting: board.usb_waiting() as u32,
            usb_packets: board.usb_packets()[packets_before..].to_vec(),
            usb_transfers: board.usb_transfers()[transfers_before..].to_vec(),
            resets_ns: board.resets()[resets_before..]
                .iter()
                .map(|reset| reset.at_ns)
                .collect(),
            fault_output: board.fault_output(),
        };
        reply.write(&mut replies)?;
    }
    Ok(())
}
