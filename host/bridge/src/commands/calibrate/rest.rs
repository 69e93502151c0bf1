//! `gripline calibrate rest`: pictures of the untouched sensor surface, checked before they are written.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::common::{Common, wrote};
use super::guide;
use crate::calibration::{Calibration, Rest};
use crate::config::{Overrides, Settings};
use crate::error::Error;
use crate::rest::{save, unfit};
use crate::source::{Source, SourceSettings};
use gripline_capture::picture;
use gripline_evaluation::calibration::surface::{Change, Figures, limit, mean};

/// Arguments of `gripline calibrate rest`.
#[derive(Debug, Clone, Args)]
pub(super) struct RestArgs {
    #[command(flatten)]
    common: Common,
    /// How many pictures.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u64).range(8..=256))]
    pictures: u64,
    /// Which fingertip; each has its own file (calibration.file, calibration.second_file).
    #[arg(long, value_name = "1|2", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    fingertip: u8,
    /// Where pictures come from. By default the configuration's camera.source, for the second fingertip camera.second_source.
    #[arg(long)]
    source: Option<Source>,
    /// Use pictures taken before: a folder, or one file (*.png, *.jpg, in the order of their names).
    #[arg(long, value_name = "DIR|FILE", conflicts_with = "source")]
    frames: Option<PathBuf>,
    /// Do not compare with the rest pictures in the file: the gel or the camera was replaced.
    #[arg(long)]
    anew: bool,
    /// Configuration file that names the camera.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

/// Takes, checks and writes.
///
/// # Errors
/// [`Error`] that lists everything that is wrong with the pictures.
pub(super) fn run(args: &RestArgs) -> Result<(), Error> {
    // A calibration that cannot be read is reported before anybody is asked for anything.
    Calibration::load_or_new(&args.common.out)?;
    let (pictures, source) = pictures(args)?;
    let device = args.common.device.clone().unwrap_or(source);
    let rest = keep(&args.common.out, &pictures, device, args.anew)?;
    if args.common.json {
        println!("{}", json!(rest));
    } else {
        println!("{}", summary(&rest));
    }
    wrote(&args.common);
    Ok(())
}

/// Checks pictures, 440×440 each, and writes them beside the calibration `out`, whose section `[rest]` they become. Unless `anew`,
/// they must agree with the earlier ones.
///
/// # Errors
/// [`Error`] that lists everything that is wrong with the pictures; nothing is written then.
pub(in crate::commands) fn keep(
    out: &Path,
    pictures: &[Vec<u8>],
    device: String,
    anew: bool,
) -> Result<Rest, Error> {
    let mut calibration = Calibration::load_or_new(out)?;
    let figures = Figures::of(pictures);
    let mut problems = wrong(&figures);
    if let (false, Some(before)) = (anew, calibration.rest_pictures()?) {
        let change = Change::between(&mean(&before), &figures.mean);
        problems.extend(changed(&change, &out.display().to_string()));
    }
    if !problems.is_empty() {
        return Err(Error::failed(format!(
            "nothing was written: {}",
            problems.join("; ")
        )));
    }
    save(&mut calibration, pictures, &figures, device)
}

/// What was written, for people.
pub(in crate::commands) fn summary(rest: &Rest) -> String {
    format!(
        "{} pictures of {}: mean level {:.1}, {:.2} % saturated, {} particles, sharpness {:.3}, noise {:.2} levels, moved \
         {:.3} px at most",
        rest.count,
        rest.device,
        rest.mean_level,
        100.0 * rest.saturated_share,
        rest.particles,
        rest.sharpness,
        rest.noise_levels,
        rest.residual_px
    )
}

/// The pictures and their device.
fn pictures(args: &RestArgs) -> Result<(Vec<Vec<u8>>, String), Error> {
    if let Some(path) = &args.frames {
        let files = picture::list(path)?;
        let pictures: Result<Vec<_>, _> = files.iter().map(|file| picture::crop(file, false)).collect();
        let pictures = pictures?;
        if pictures.len() < 2 {
            return Err(Error::failed(format!(
                "{}: found {} picture, expected at least 2: one says nothing about noise",
                path.display(),
                pictures.len()
            )));
        }
        return Ok((pictures, path.display().to_string()));
    }
    let settings = Settings::load(&Overrides::of_file(args.config.as_deref()))?;
    let configured = match args.fingertip {
        1 => Some(&settings.source),
        _ => settings.second_source.as_ref(),
    };
    let source = args.source.as_ref().or(configured).ok_or_else(|| {
        Error::usage(
            "--fingertip: found 2 without a camera.second_source, expected one in the configuration: name it there, or say \
             --source",
        )
    })?;
    let wanted = settings.source_settings(usize::from(args.fingertip) - 1);
    let pictures = take(source, &wanted, args.pictures as usize, args.common.asks())?;
    Ok((pictures, source.to_string()))
}

/// Looks at the untouched fingertip `count` times, 440×440 each; `asks`: a person is present and gets instructions.
///
/// # Errors
/// [`Error`] when the source gives none, or the device does not answer.
pub(in crate::commands) fn take(
    source: &Source,
    wanted: &SourceSettings,
    count: usize,
    asks: bool,
) -> Result<Vec<Vec<u8>>, Error> {
    let mut camera = source.open(wanted)?;
    if !asks {
        return Ok(camera.rest(count)?.crops);
    }
    guide::ask(1, &guide::REST[0])?;
    let mut pictures = camera.rest(count.div_ceil(2))?.crops;
    guide::ask(2, &guide::REST[1])?;
    pictures.extend(camera.rest(count / 2)?.crops);
    Ok(pictures)
}

/// Problems of the pictures themselves.
fn wrong(figures: &Figures) -> Vec<String> {
    let mut problems: Vec<String> = unfit(figures).iter().map(ToString::to_string).collect();
    if figures.saturated_share > limit::SATURATED {
        problems.push(format!(
            "found {:.1} % of the pixels saturated, expected at most {:.0} %: expose shorter, look for reflections",
            100.0 * figures.saturated_share,
            100.0 * limit::SATURATED
        ));
    }
    if figures.sharpness < limit::SHARPNESS {
        problems.push(format!(
            "found a sharpness of {:.2}, expected at least {}: focus the lens on the particles",
            figures.sharpness,
            limit::SHARPNESS
        ));
    }
    if figures.moved_px > limit::STILL_PX {
        problems.push(format!(
            "found parts of the sensor surface that moved by {:.2} pixels meanwhile, expected at most {}: take everything off it, \
             keep hands and table still, and wait until the gel has settled",
            figures.moved_px,
            limit::STILL_PX
        ));
    }
    problems
}

/// Differences from the earlier pictures in `file`.
fn changed(change: &Change, file: &str) -> Option<String> {
    if change.lost > limit::LOST {
        return Some(format!(
            "found {:.0} % of the particles of {file} missing, expected at most {:.0} %: uncover the sensor surface; for another \
             gel or camera use --anew",
            100.0 * change.lost,
            100.0 * limit::LOST
        ));
    }
    if change.dent_px > limit::STILL_PX {
        return Some(format!(
            "found a part of the sensor surface {:.2} pixels from its place in {file}, expected at most {}: something touches it; \
             remove it, or use --anew if the surface has changed for good",
            change.dent_px,
            limit::STILL_PX
        ));
    }
    if change.drift_px > limit::DRIFT_PX {
        return Some(format!(
            "found the sensor surface {:.2} pixels from its place in {file}, expected at most {}: fasten camera and gel, and use \
             --anew if they are now where they will stay",
            change.drift_px,
            limit::DRIFT_PX
        ));
    }
    None
}
