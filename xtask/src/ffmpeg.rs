//! The program ffmpeg, which clips are read and written with: installed with apt where it is missing and this is root's.

use std::process::Command;

use crate::debian;
use crate::error::Error;
use crate::process;

/// Makes sure that ffmpeg and ffprobe can be started.
pub(crate) fn ensure() -> Result<(), Error> {
    let missing = || {
        let mut programs = ["ffmpeg", "ffprobe"].into_iter();
        programs.find(|program| process::output(Command::new(program).arg("-version")).is_err())
    };
    let Some(program) = missing() else {
        return Ok(());
    };
    if debian::is_root() {
        eprintln!("no {program} here; installing Debian's package ffmpeg");
        debian::install("ffmpeg")?;
    }
    missing().map_or(Ok(()), |program| {
        Err(Error::Product {
            what: program.to_owned(),
            found: "no such program on the search path".to_owned(),
            expected: "the one of Debian's package ffmpeg: run `apt-get install ffmpeg` as root".to_owned(),
        })
    })
}
