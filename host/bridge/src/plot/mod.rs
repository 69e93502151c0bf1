//! `gripline plot`: a recording as a picture. Above, the stick ratio with its threshold, and beneath it when the detector, the
//! Coulomb baseline and the world said slip (the paper's Fig. 4); then the forces with the grip-force line; below, the force
//! maps of a few moments. With --view the terminal view of one moment instead. PNG or SVG, by the file's name.

mod drawing;
mod screen;
mod series;

pub(crate) use drawing::register_fonts;

use std::fmt::Display;
use std::path::{Path, PathBuf};

use clap::Args;
use plotters::prelude::{BitMapBackend, IntoDrawingArea as _, SVGBackend};

use self::series::{Panel, Series};
use crate::config::settings_from_text;
use crate::error::Failure;
use crate::recording::{Ending, Reader, RecordedFrame};
use crate::run::limits;
use crate::units::{newtons, ratio};
use crate::view::View;

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
    /// Whose stick ratio, forces and maps, where the recording has two fingertips.
    #[arg(long, value_name = "1|2", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2), conflicts_with = "view")]
    fingertip: u8,
    /// Times of the force maps, seconds. By default the moments of least stick ratio, spread over the contact.
    #[arg(long, value_name = "S,S,...", value_delimiter = ',')]
    maps: Vec<f64>,
    /// Draw the terminal view as it was at this time, seconds, instead.
    #[arg(
        long,
        value_name = "S",
        conflicts_with = "maps",
        allow_negative_numbers = true
    )]
    view: Option<f64>,
    /// Columns and lines of the terminal, at least 80x24.
    #[arg(long, value_name = "COLUMNSxLINES", default_value = "80x24", requires = "view", value_parser = screen_size)]
    size: (u16, u16),
}

/// Largest screen, columns or lines.
const SCREEN_MAX: u16 = 400;

fn screen_size(text: &str) -> Result<(u16, u16), String> {
    let read = || {
        let (columns, lines) = text.split_once('x')?;
        Some((columns.parse().ok()?, lines.parse().ok()?))
    };
    match read() {
        Some((columns @ 80..=SCREEN_MAX, lines @ 24..=SCREEN_MAX)) => Ok((columns, lines)),
        _ => Err(format!(
            "found {text}, expected 80x24 to {SCREEN_MAX}x{SCREEN_MAX}"
        )),
    }
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
    if let Some(t_s) = args.view {
        return draw_view(args, t_s, kind == Some("svg"));
    }
    let (series, ending) = read(args)?;
    let failed = unwritable(&args.out);
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

fn unwritable(path: &Path) -> impl Fn(&dyn Display) -> Failure {
    let shown = path.display().to_string();
    move |error| Failure::failed(format!("{shown}: {error}, expected a file that can be written"))
}

/// The screen of a run at `t_s`, with the traces that lead to it.
fn draw_view(args: &PlotArgs, t_s: f64, svg: bool) -> Result<(), Failure> {
    let mut reader = Reader::open(&args.recording)?;
    let settings = settings_from_text(&reader.about.settings)
        .map_err(|error| Failure::failed(format!("{}: {error}", args.recording.display())))?;
    let mut view = View::new(limits(&settings));
    let mut at_s = None;
    while let Some(frame) = reader.next_frame()? {
        if frame.status.t_s > t_s && at_s.is_some() {
            break;
        }
        at_s = Some(frame.status.t_s);
        view.push(&frame.status.report(&settings), &frame.map.dequantise());
    }
    let cells = view.cells(args.size.0, args.size.1);
    let failed = unwritable(&args.out);
    std::fs::File::create(&args.out).map_err(|error| failed(&error))?;
    screen::register_font().map_err(Failure::failed)?;
    let size = screen::size(&cells);
    if svg {
        screen::draw(&SVGBackend::new(&args.out, size).into_drawing_area(), &cells)
            .map_err(|e| failed(&e))?;
    } else {
        screen::draw(&BitMapBackend::new(&args.out, size).into_drawing_area(), &cells)
            .map_err(|e| failed(&e))?;
    }
    println!(
        "the view at {:.2} s: wrote {}",
        at_s.unwrap_or_default(),
        args.out.display()
    );
    Ok(())
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
    let is_its = |frame: &RecordedFrame| frame.status.sensor + 1 == args.fingertip;
    while let Some(frame) = reader.next_frame()? {
        if is_its(&frame) {
            series
                .moments
                .push(series::Moment::of(&frame.status, series.threshold));
        }
    }
    let ending = reader.ending();
    if series.moments.is_empty() {
        return Err(Failure::usage(format!(
            "--fingertip {}: found no frame of it in {}, expected one of those that the recording has",
            args.fingertip,
            args.recording.display()
        )));
    }
    let wanted = if args.maps.is_empty() {
        series.telling(PANELS)
    } else {
        args.maps.iter().map(|t_s| series.nearest(*t_s)).collect()
    };
    let mut reader = Reader::open(&args.recording)?;
    let mut place = 0;
    while let Some(frame) = reader.next_frame()? {
        if !is_its(&frame) {
            continue;
        }
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
