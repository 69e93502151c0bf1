//! `gripline flash`: puts a firmware image on the microcontroller over USB, through the chip's own bootloader: no probe, no tool.
//! This file joins link, image and bootloader; each knows nothing of the others.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use gripline_flash::dfu::{Dfu, Wire};
use gripline_flash::error::FlashError;
use gripline_flash::image::{FLASH, Image, board_name};
use gripline_flash::update::{Progress, Step, update};
use gripline_flash::usb as bootloader;
use gripline_link::session::Session;
use gripline_link::usb::{Attached, attached, choose};
use gripline_link::{Target, bootloader as way};
use gripline_protocol::message::{BOARDS, Hello};
use indicatif::{ProgressBar, ProgressStyle};

use crate::error::Error;

/// How long the bootloader may take to appear on the bus.
const BOOTLOADER_WITHIN: Duration = Duration::from_secs(15);
/// How long the board may take to come back.
const BOARD_WITHIN: Duration = Duration::from_secs(15);
const POLL_PERIOD: Duration = Duration::from_millis(100);

/// Arguments of `gripline flash`.
#[derive(Debug, Clone, Args)]
pub struct FlashArgs {
    /// Over USB, through the chip's own bootloader. With a probe: `cargo xtask flash`.
    #[arg(long, required = true)]
    usb: bool,
    /// The image: an ELF file of `cargo xtask firmware`, or a binary of the flash from its start.
    image: PathBuf,
    /// Which board, when several are plugged in.
    #[arg(long, value_name = "SERIAL")]
    serial: Option<String>,
    /// The board that is already in its bootloader, after BOOT0 or a failed update: the bootloader does not know its board.
    #[arg(long, value_name = "BOARD", value_parser = board_number)]
    board: Option<u8>,
}

fn board_number(name: &str) -> Result<u8, String> {
    let boards = &BOARDS[1..];
    let place = boards.iter().position(|board| *board == name);
    place
        .map(|place| place as u8 + 1)
        .ok_or_else(|| format!("expected {}", boards.join(" or ")))
}

/// The device to flash.
#[derive(Debug, PartialEq, Eq)]
enum Plugged {
    /// A running board, a place in the list.
    Board(usize),
    /// A chip in its bootloader, a place in the list, and which board it is.
    Bootloader(usize, u8),
}

/// Flashes the image.
///
/// # Errors
/// [`Error`] that says what was found, and whether the board still has its image.
pub fn run(args: &FlashArgs) -> Result<(), Error> {
    let image = read(&args.image)?;
    println!(
        "image {}: {}, {} bytes",
        args.image.display(),
        image.identity,
        image.length()
    );
    let boards = attached().map_err(Error::failed)?;
    let chips = bootloader::attached()?;
    let places: Vec<&str> = chips.iter().map(|chip| chip.place.as_str()).collect();
    match plugged(&boards, args.serial.as_deref(), &places, args.board)? {
        Plugged::Bootloader(number, board) => {
            check(args, &image, board)?;
            write(&chips[number], &image)?;
            println!(
                "written and verified; set BOOT0 low if you had set it high, and reset the board: it starts {}",
                image.identity
            );
            Ok(())
        }
        Plugged::Board(number) => {
            let board = &boards[number];
            let serial = board.serial.clone();
            let mut link = Target::Usb(serial.clone()).open()?;
            let who = way::identify(&mut *link, session())?;
            println!("board at {}: {who}", board.place);
            check(args, &image, who.board)?;
            way::enter(&mut *link, &who)?;
            drop(link);
            let chip = wait_for("its bootloader", &board.place, BOOTLOADER_WITHIN, || {
                let chips = bootloader::attached()?;
                Ok(chips.into_iter().find(|chip| chip.place == board.place))
            })?;
            let mut dfu = write(&chip, &image)?;
            dfu.start(FLASH)?;
            drop(dfu);
            wait_for("the board", &board.place, BOARD_WITHIN, || {
                let boards = attached().map_err(Error::failed)?;
                Ok(boards.into_iter().find(|found| found.place == board.place))
            })?;
            shake_hands(serial, &image)
        }
    }
}

fn read(path: &Path) -> Result<Image, Error> {
    let file = path.display();
    let bytes =
        std::fs::read(path).map_err(|error| Error::failed(format!("{file}: {error}, expected an image")))?;
    Image::read(&bytes).map_err(|error| Error::failed(format!("{file}: {error}")))
}

fn check(args: &FlashArgs, image: &Image, board: u8) -> Result<(), Error> {
    let file = args.image.display();
    image
        .check(board)
        .map_err(|error| Error::failed(format!("{file}: {error}; nothing was changed")))
}

/// A number that the last session is unlikely to have had.
fn session() -> u32 {
    std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(1, |time| time.subsec_nanos() | 1)
}

/// Chooses among the connected devices: a running board before one in its bootloader.
fn plugged(
    boards: &[Attached],
    serial: Option<&str>,
    chips: &[&str],
    board: Option<u8>,
) -> Result<Plugged, Error> {
    if serial.is_some() || board.is_none() && !boards.is_empty() {
        return Ok(Plugged::Board(choose("USB device", boards, serial)?));
    }
    match (chips, board) {
        ([_], Some(board)) => Ok(Plugged::Bootloader(0, board)),
        ([place], None) => Err(Error::usage(format!(
            "--board: found none, and a chip in its bootloader at {place}; expected the name of its board: {}",
            BOARDS[1..].join(" or ")
        ))),
        ([], Some(board)) => Err(Error::failed(format!(
            "USB: found no chip in its bootloader, expected one of {}; leave --board out for a board that runs, or set BOOT0 high and \
             reset it",
            board_name(board)
        ))),
        ([], None) => Ok(Plugged::Board(choose("USB device", boards, serial)?)),
        (several, _) => Err(Error::failed(format!(
            "USB: found {} chips in their bootloaders, at {}; expected one: unplug the others",
            several.len(),
            several.join(", ")
        ))),
    }
}

/// Waits until it appears.
fn wait_for<T>(
    what: &str,
    place: &str,
    within: Duration,
    mut look: impl FnMut() -> Result<Option<T>, Error>,
) -> Result<T, Error> {
    let since = Instant::now();
    loop {
        if let Some(found) = look()? {
            return Ok(found);
        }
        if since.elapsed() > within {
            return Err(Error::failed(format!(
                "USB at {place}: {what} did not show up within {} s; reset the board, and if it stays away set BOOT0 high, reset it and \
                 run this again with --board",
                within.as_secs()
            )));
        }
        thread::sleep(POLL_PERIOD);
    }
}

/// Erases, writes and verifies, with its progress on standard error.
fn write(chip: &bootloader::Attached, image: &Image) -> Result<Dfu<bootloader::Usb>, Error> {
    // The system gives the file of a new device its rights a moment after the device is there.
    let since = Instant::now();
    let (mut dfu, sectors) = loop {
        match chip.open() {
            Err(FlashError::Forbidden { .. }) if since.elapsed() < Duration::from_secs(2) => {
                thread::sleep(POLL_PERIOD);
            }
            opened => break opened?,
        }
    };
    write_with(&mut dfu, &sectors, image)?;
    Ok(dfu)
}

fn write_with<W: Wire>(
    dfu: &mut Dfu<W>,
    sectors: &[gripline_flash::layout::Sector],
    image: &Image,
) -> Result<(), Error> {
    let bar = if std::io::stderr().is_terminal() {
        ProgressBar::new(0)
    } else {
        ProgressBar::hidden()
    };
    // The template is this program's own.
    if let Ok(style) = ProgressStyle::with_template("{prefix:8} {wide_bar} {bytes}/{total_bytes}") {
        bar.set_style(style);
    }
    let done = update(dfu, sectors, image, &mut |Progress { step, done, total }| {
        bar.set_prefix(match step {
            Step::Erase => "erasing",
            Step::Write => "writing",
            Step::Verify => "checking",
        });
        bar.set_length(total.into());
        bar.set_position(done.into());
    });
    bar.finish_and_clear();
    Ok(done?)
}

/// The new firmware must answer.
fn shake_hands(serial: Option<String>, image: &Image) -> Result<(), Error> {
    let session = Session::connect(Target::Usb(serial).open()?)?;
    let Some(found) = session.firmware() else {
        return Err(Error::failed("the board does not say who it is, expected it to"));
    };
    let known = |hello: &Hello| (hello.board, hello.build, hello.revision);
    if known(found) != known(&image.identity) {
        return Err(Error::failed(format!(
            "the board runs {found}, expected {}; reset it and look again with `gripline doctor`",
            image.identity
        )));
    }
    println!("written, verified and running: {found}");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(serial: &str) -> Attached {
        Attached {
            serial: Some(serial.to_owned()),
            place: format!("1-{serial}"),
        }
    }

    #[test]
    fn a_board_that_runs_is_taken_and_one_in_its_bootloader_needs_its_name() {
        let two = [board("1"), board("2")];
        assert_eq!(plugged(&two[..1], None, &[], None).unwrap(), Plugged::Board(0));
        assert_eq!(plugged(&two, Some("2"), &[], None).unwrap(), Plugged::Board(1));
        assert_eq!(
            plugged(&two[..1], None, &["1-9"], None).unwrap(),
            Plugged::Board(0)
        );
        assert_eq!(
            plugged(&two[..1], None, &["1-9"], Some(2)).unwrap(),
            Plugged::Bootloader(0, 2)
        );
        assert_eq!(
            plugged(&[], None, &["1-9"], Some(1)).unwrap(),
            Plugged::Bootloader(0, 1)
        );
        for (boards, serial, chips, board, words) in [
            (&two[..], None, &[][..], None, "found 2"),
            (&[], None, &["1-9"], None, "stm32f405rg or stm32f427vi"),
            (&[], None, &["1-9", "1-8"], Some(1), "unplug the others"),
            (&[], None, &[], Some(1), "set BOOT0 high"),
            (&[], None, &[], None, "no device"),
            (&two[..1], Some("7"), &[], None, "name one that is there"),
        ] {
            let text = plugged(boards, serial, chips, board).unwrap_err().to_string();
            assert!(text.contains(words), "{words}: {text}");
        }
    }

    #[test]
    fn boards_have_names() {
        assert_eq!(
            (board_number("stm32f405rg"), board_number("stm32f427vi")),
            (Ok(1), Ok(2))
        );
        for wrong in ["host", "stm32", ""] {
            assert!(
                board_number(wrong)
                    .unwrap_err()
                    .contains("stm32f405rg or stm32f427vi")
            );
        }
    }
}
