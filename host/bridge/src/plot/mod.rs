//! `gripline plot`: a recording as a picture. Above, the stick ratio with its threshold, and beneath it when the detector, the
//! Coulomb baseline and the world said slip (the paper's Fig. 4); then the forces with the grip-force line; below, the force
//! maps of a few moments. PNG or SVG, by the file's name.

mod drawing;
mod series;

use std::path::PathBuf;

use clap::Args;
use plotters::prelude::{BitMapBackend, IntoDrawingArea as _, SVGBackend};

use self::series::{Panel, Series};
use crate::config::settings_from_text;
use crate::error::Failure;
use crate::recording::{Ending, Reader};
use crate::units::{newtons, ratio};

/// Width and height, pixels.
const SIZE: (u32, u32) = (1_000, 900);
/// Force maps.
const PANELS: usize = 4;

/// Arguments of `gripline plot`.
#[derive(Debug, Clone, Args)]
pub struct PlotArgs {
    /// The recording.
    #[arg(value_name = "REC.mcap")]
    recording: PathBuf,
    /// The picture: .png or .svg.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Times of the force maps, seconds. By default the moments of least stick ratio, spread over the contact.
    #[arg(long, value_name = "S,S,...", value_delimiter = ',')]
    maps: Vec<f64>,
}

/// Draws.
///
/// # Errors
/// [`Failure`] that names the file which cannot be read, written, or is neither .png nor .svg.
pub fn run(args: &PlotArgs) -> Result<(), Failure> {
    let shown = args.out.display();
    let kind = args.out.extension().and_then(|extension| extension.to_str());
    if !matches!(kind, Some("png" | "svg")) {
        return Err(Failure::usage(format!(
            "{shown}: expected a name that ends with .png or .svg"
        )));
    }
    let (series, ending) = read(args)?;
    let failed = |error: &dyn std::fmt::Display| {
        Failure::failed(format!("{shown}: {error}, expected a file that can be written"))
    };
    // The libraries' own errors say less, and say it late.
    std::fs::File::create(&args.out).map_err(|error| failed(&error))?;
    drawing::register_fonts().map_err(Failure::failed)?;
    if kind == Some("svg") {
        drawing::draw(&SVGBackend::new(&args.out, SIZE).into_drawing_area(), &series)
            .map_err(|e| failed(&e))?;
    } else {
        drawing::draw(&BitMapBackend::new(&args.out, SIZE).into_drawing_area(), &series)
            .map_err(|e| failed(&e))?;
    }
    println!(
        "{} frames, {} maps: wrote {shown}",
        series.moments.len(),
        series.panels.len()
    );
    match ending {
        Ending::Whole => Ok(()),
        Ending::Cut(why) => Err(Failure::loss(format!(
            "{}: a recording cut short after {} frames ({why}); what is there was drawn",
            args.recording.display(),
            series.moments.len()
        ))),
    }
}

/// What is to be drawn: numbers first, then the maps of the moments that they choose.
fn read(args: &PlotArgs) -> Result<(Series, Ending), Failure> {
    let mut reader = Reader::open(&args.recording)?;
    let settings = settings_from_text(&reader.about.settings)
        .map_err(|error| Failure::failed(format!("{}: {error}", args.recording.display())))?;
    let mut series = Series {
        threshold: ratio(settings.slip_threshold),
        friction: ratio(settings.friction),
        contact_min_n: newtons(settings.contact_min.into()),
        moments: Vec::new(),
        panels: Vec::new(),
    };
    while let Some(frame) = reader.next_frame()? {
        series
            .moments
            .push(series::Moment::of(&frame.status, series.threshold));
    }
    let ending = reader.ending();
    let wanted = if args.maps.is_empty() {
        series.telling(PANELS)
    } else {
        args.maps.iter().map(|t_s| series.nearest(*t_s)).collect()
    };
    let mut reader = Reader::open(&args.recording)?;
    let mut place = 0;
    while let Some(frame) = reader.next_frame()? {
        if wanted.contains(&place) {
            series.panels.push(Panel {
                moment: place,
                map: frame.map.dequantise(),
            });
        }
        place += 1;
    }
    Ok((series, ending))
}
