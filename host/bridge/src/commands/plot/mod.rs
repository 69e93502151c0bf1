//! `gripline plot`: a recording as a figure. From the top: the stick ratio with its threshold; when the detector, the Coulomb
//! baseline and the world said slip (the paper's Fig. 4); the forces with the grip-force line; force maps of a few moments.
//! With --view the terminal view at one moment instead. PNG or SVG, by the file's name.

mod drawing;
pub(super) mod report;
mod screen;
mod series;

use std::path::PathBuf;

use clap::Args;
use gripline_chart::Format;
use gripline_protocol::message::Configuration;

use self::report::report_of;
use self::series::{ForceMapAt, Traces};
use crate::config::settings_from_text;
use crate::error::{Completion, Error};
use crate::view::View;
use gripline_recording::telemetry::Limits;
use gripline_recording::units::{newtons, ratio};
use gripline_recording::{Completeness, Reader, RecordedFrame};

/// Force maps.
const MAPS: usize = 4;

/// Arguments of `gripline plot`.
#[derive(Debug, Clone, Args)]
pub struct PlotArgs {
    /// The recording.
    #[arg(value_name = "REC.mcap")]
    recording: PathBuf,
    /// The picture: .png or .svg.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The fingertip to draw, if the recording has two.
    #[arg(long, value_name = "1|2", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2), conflicts_with = "view")]
    fingertip: u8,
    /// Times of the force maps, seconds. By default those of lowest stick ratio, spread over the contact.
    #[arg(long, value_name = "S,S,...", value_delimiter = ',')]
    maps: Vec<f64>,
    /// Draw the terminal view at this time, seconds, instead.
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
/// [`Error`] that names the file which cannot be read, written, or is neither .png nor .svg.
pub fn run(args: &PlotArgs) -> Result<Completion, Error> {
    let shown = args.out.display();
    Format::of(&args.out).map_err(Error::usage)?;
    if let Some(t_s) = args.view {
        draw_view(args, t_s)?;
        return Ok(Completion::Whole);
    }
    let (traces, completeness) = read(args)?;
    drawing::figure(&traces).save(&args.out)?;
    println!(
        "{} frames, {} maps: wrote {shown}",
        traces.moments.len(),
        traces.maps.len()
    );
    match completeness {
        Completeness::Whole => Ok(Completion::Whole),
        Completeness::Truncated(why) => Ok(Completion::WithLoss(format!(
            "{}: a recording cut short after {} frames ({why}); what is there was drawn",
            args.recording.display(),
            traces.moments.len()
        ))),
    }
}

/// The screen of a run at `t_s`, with the traces that lead to it.
fn draw_view(args: &PlotArgs, t_s: f64) -> Result<(), Error> {
    let mut reader = Reader::open(&args.recording)?;
    let settings = settings_from_text(&reader.metadata.settings, &Configuration::DEFAULT)
        .map_err(|error| Error::failed(format!("{}: {error}", args.recording.display())))?;
    let mut view = View::new(Limits::of(&settings));
    let mut at_s = None;
    while let Some(frame) = reader.next_frame()? {
        if frame.status.t_s > t_s && at_s.is_some() {
            break;
        }
        at_s = Some(frame.status.t_s);
        view.push(&report_of(&frame.status, &settings), &frame.map.dequantise());
    }
    screen::figure(&view.cells(args.size.0, args.size.1)).save(&args.out)?;
    println!(
        "the view at {:.2} s: wrote {}",
        at_s.unwrap_or_default(),
        args.out.display()
    );
    Ok(())
}

/// Reads the numbers first, then the maps at the times chosen from them.
fn read(args: &PlotArgs) -> Result<(Traces, Completeness), Error> {
    let mut reader = Reader::open(&args.recording)?;
    let settings = settings_from_text(&reader.metadata.settings, &Configuration::DEFAULT)
        .map_err(|error| Error::failed(format!("{}: {error}", args.recording.display())))?;
    let mut traces = Traces {
        threshold: ratio(settings.slip_threshold),
        friction: ratio(settings.friction),
        contact_min_n: newtons(settings.contact_min.into()),
        moments: Vec::new(),
        maps: Vec::new(),
    };
    let is_its = |frame: &RecordedFrame| frame.status.sensor.number() + 1 == args.fingertip;
    while let Some(frame) = reader.next_frame()? {
        if is_its(&frame) {
            traces
                .moments
                .push(series::Moment::of(&frame.status, traces.threshold));
        }
    }
    let completeness = reader.completeness();
    if traces.moments.is_empty() {
        return Err(Error::usage(format!(
            "--fingertip {}: found no frame of it in {}, expected one of those that the recording has",
            args.fingertip,
            args.recording.display()
        )));
    }
    let wanted = if args.maps.is_empty() {
        traces.lowest_stick_ratios(MAPS)
    } else {
        args.maps.iter().map(|t_s| traces.nearest(*t_s)).collect()
    };
    let mut reader = Reader::open(&args.recording)?;
    let mut place = 0;
    while let Some(frame) = reader.next_frame()? {
        if !is_its(&frame) {
            continue;
        }
        if wanted.contains(&place) {
            traces.maps.push(ForceMapAt {
                moment: place,
                map: frame.map.dequantise(),
            });
        }
        place += 1;
    }
    Ok((traces, completeness))
}
