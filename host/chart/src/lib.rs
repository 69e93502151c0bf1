//! Figures as PNG or SVG: charts, maps and plain drawings, described as data and drawn by plotters.
//! Sizes are in pixels. Fonts come with the program, so a figure looks the same on every machine.
#![forbid(unsafe_code)]

mod chart;
mod labels;
mod map;
mod shapes;

use std::path::{Path, PathBuf};
use std::sync::Once;

use plotters::coord::Shift;
use plotters::prelude::*;
pub use plotters::style::RGBColor as Colour;
use plotters::style::register_font;

pub use self::chart::{Axis, Chart, Legend, Mark, Note, Series, pareto_front};
pub use self::map::{Map, Scale};
pub use self::shapes::{Shape, draw_text};

const SANS: &str = "sans-serif";
const MONO: &str = "monospace";
/// Sizes of letters.
const SMALL: u32 = 13;
const NORMAL: u32 = 14;
const TITLE: u32 = 17;

/// Text and axes.
pub const INK: Colour = RGBColor(40, 40, 40);
/// What stays in the background: grid, frames, auxiliary lines.
pub const FAINT: Colour = RGBColor(205, 205, 205);
/// A reference beside the data.
pub const GREY: Colour = RGBColor(120, 120, 120);
/// The series colour blue.
pub const BLUE: Colour = RGBColor(0, 114, 178);
/// The series colour vermilion.
pub const VERMILION: Colour = RGBColor(213, 94, 0);
/// The series colour green.
pub const GREEN: Colour = RGBColor(0, 158, 115);
/// The series colour purple.
pub const PURPLE: Colour = RGBColor(204, 121, 167);
/// The series colour orange.
pub const ORANGE: Colour = RGBColor(230, 159, 0);
/// The series colour sky blue.
pub const SKY: Colour = RGBColor(86, 180, 233);
/// Series colours that colour-blind readers tell apart (Okabe and Ito 2008).
pub const COLOURS: [Colour; 6] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY];

type Area<'a, B> = DrawingArea<B, Shift>;
type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// A figure that cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// Neither .png nor .svg.
    #[error("{}: expected a name that ends with .png or .svg", .0.display())]
    Extension(PathBuf),
    /// The drawing library failed.
    #[error("{}: cannot be drawn ({why})", path.display())]
    Drawing {
        /// The figure's file.
        path: PathBuf,
        /// The library's own words.
        why: String,
    },
    /// The file cannot be written.
    #[error("{}: {error}, expected a file that can be written: choose another place", path.display())]
    File {
        /// The figure's file.
        path: PathBuf,
        /// The system's error.
        error: std::io::Error,
    },
}

/// One part of a figure.
#[derive(Debug, Clone)]
pub enum Panel {
    /// Axes with series.
    Chart(Chart),
    /// A square grid of coloured cells.
    Map(Map),
    /// Plain shapes; the panel's upper left corner is the origin.
    Shapes(Vec<Shape>),
    /// A line of text.
    Text(String),
}

/// Rows of panels; the panels of a row share its width equally.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Width of every row.
    pub width: u32,
    /// Height and panels of each row, from the top.
    pub rows: Vec<(u32, Vec<Panel>)>,
}

/// File format of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Pixels.
    Png,
    /// Vectors.
    Svg,
}

impl Format {
    /// By the file's extension.
    ///
    /// # Errors
    /// [`ChartError::Extension`] for anything but .png and .svg.
    pub fn of(path: &Path) -> Result<Self, ChartError> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("png") => Ok(Self::Png),
            Some("svg") => Ok(Self::Svg),
            _ => Err(ChartError::Extension(path.to_owned())),
        }
    }
}

impl Figure {
    /// A figure of one panel.
    #[must_use]
    pub fn single(width: u32, height: u32, panel: Panel) -> Self {
        Self {
            width,
            rows: vec![(height, vec![panel])],
        }
    }

    /// Writes the figure; the extension chooses the format, and a missing folder is made.
    ///
    /// # Errors
    /// [`ChartError`] that names the file.
    pub fn save(&self, path: &Path) -> Result<(), ChartError> {
        let bytes = self
            .encode(Format::of(path)?)
            .map_err(|why| ChartError::Drawing {
                path: path.to_owned(),
                why,
            })?;
        std::fs::write(path, bytes).map_err(|error| ChartError::File {
            path: path.to_owned(),
            error,
        })
    }

    /// The bytes of the figure's file.
    ///
    /// # Errors
    /// The drawing library's words.
    pub fn encode(&self, format: Format) -> Result<Vec<u8>, String> {
        register_fonts();
        let height = self.rows.iter().map(|(height, _)| height).sum();
        let size = (self.width, height);
        match format {
            Format::Svg => {
                let mut text = String::new();
                self.draw(&SVGBackend::with_string(&mut text, size).into_drawing_area())
                    .map_err(|error| error.to_string())?;
                Ok(text.into_bytes())
            }
            Format::Png => {
                let mut pixels = vec![0; 3 * self.width as usize * height as usize];
                self.draw(&BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area())
                    .map_err(|error| error.to_string())?;
                encode_png(&pixels, size).map_err(|error| error.to_string())
            }
        }
    }

    fn draw<B: DrawingBackend>(&self, root: &Area<B>) -> Drawn<B> {
        root.fill(&WHITE)?;
        let mut rest = root.clone();
        for (height, panels) in &self.rows {
            let (row, below) = rest.split_vertically(*height);
            rest = below;
            for (panel, area) in panels.iter().zip(row.split_evenly((1, panels.len().max(1)))) {
                match panel {
                    Panel::Chart(chart) => chart.draw(&area)?,
                    Panel::Map(map) => map.draw(&area)?,
                    Panel::Shapes(shapes) => shapes.iter().try_for_each(|shape| shape.draw(&area))?,
                    Panel::Text(text) => area.draw(&Text::new(text.clone(), (15, 6), style(SMALL, INK)))?,
                }
            }
        }
        root.present()
    }
}

fn encode_png(pixels: &[u8], (width, height): (u32, u32)) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(pixels)?;
    Ok(bytes)
}

fn style(size: u32, colour: Colour) -> TextStyle<'static> {
    (SANS, size).into_font().color(&colour)
}

fn register_fonts() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // A font that could not be read would show as an error of the first text that is drawn.
        let _ = register_font(SANS, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
        let _ = register_font(MONO, FontStyle::Normal, epaint_default_fonts::HACK_REGULAR);
    });
}
