//! The pictures: charts of curves and maps of cells, as PNG files of a stated size.

use std::path::{Path, PathBuf};

use plotters::prelude::*;

use crate::Failure;

/// Width of a picture in one column of panels, pixels.
const PANEL: [u32; 2] = [560, 380];
const FONT: &str = "sans-serif";

/// One curve of a chart.
#[derive(Debug, Clone)]
pub(crate) struct Curve {
    label: String,
    colour: usize,
    line: bool,
    dots: bool,
    points: Vec<(f64, f64)>,
}

impl Curve {
    pub(crate) fn line(label: &str, colour: usize, points: Vec<(f64, f64)>) -> Self {
        Self {
            label: label.to_owned(),
            colour,
            line: true,
            dots: false,
            points,
        }
    }

    pub(crate) fn dots(label: &str, colour: usize, points: Vec<(f64, f64)>) -> Self {
        Self {
            label: label.to_owned(),
            colour,
            line: false,
            dots: true,
            points,
        }
    }

    pub(crate) fn both(label: &str, colour: usize, points: Vec<(f64, f64)>) -> Self {
        Self {
            dots: true,
            ..Self::line(label, colour, points)
        }
    }
}

/// Axes with curves.
#[derive(Debug, Clone)]
pub(crate) struct Chart<'a> {
    pub(crate) title: &'a str,
    pub(crate) x: &'a str,
    pub(crate) y: &'a str,
    pub(crate) x_range: [f64; 2],
    pub(crate) y_range: [f64; 2],
    /// Whether the curves rise to the right: the legend stands where they do not.
    pub(crate) rising: bool,
    pub(crate) curves: Vec<Curve>,
}

/// How values become colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Scale {
    /// White at 0 to dark red at this.
    Heat(f64),
    /// Blue at minus this, white at 0, red at plus this.
    Signed(f64),
    /// 0 free, 1 stick, 2 slip.
    Slip,
    /// Grey levels, 0 to 255.
    Grey,
}

/// A square map.
#[derive(Debug, Clone)]
pub(crate) struct Panel {
    pub(crate) title: String,
    /// Values along one side; row-major.
    pub(crate) side: usize,
    /// From the middle to the edge, mm; 0 for a camera image, which has no axes.
    pub(crate) half_mm: f64,
    pub(crate) values: Vec<f64>,
    pub(crate) scale: Scale,
}

/// Side of a map, pixels, and what stands around it: above, left, right, below.
const MAP: u32 = 220;
const AROUND: [u32; 4] = [28, 34, 52, 34];

impl Scale {
    fn colour(self, value: f64) -> RGBColor {
        let mix = |to: [f64; 3], part: f64| {
            let c = to.map(|to| (255.0 + (to - 255.0) * part.clamp(0.0, 1.0)) as u8);
            RGBColor(c[0], c[1], c[2])
        };
        match self {
            // Through orange, so that steps show at both ends.
            Self::Heat(most) if value < 0.5 * most => mix([253.0, 174.0, 97.0], 2.0 * value / most),
            Self::Heat(most) => {
                let part = (2.0 * value / most - 1.0).clamp(0.0, 1.0);
                let c = [(253.0, 128.0), (174.0, 0.0), (97.0, 38.0)].map(|(a, b)| (a + (b - a) * part) as u8);
                RGBColor(c[0], c[1], c[2])
            }
            Self::Signed(most) if value < 0.0 => mix([33.0, 102.0, 172.0], -value / most),
            Self::Signed(most) => mix([178.0, 24.0, 43.0], value / most),
            Self::Slip if value < 0.5 => RGBColor(245, 245, 245),
            Self::Slip if value < 1.5 => COLOURS[0],
            Self::Slip => COLOURS[4],
            Self::Grey => {
                // In steps: noise-like pictures grow large.
                let level = ((value / 17.0).round() * 17.0).clamp(0.0, 255.0) as u8;
                RGBColor(level, level, level)
            }
        }
    }

    /// Ends of the colour bar, if there is one.
    fn ends(self) -> Option<[f64; 2]> {
        match self {
            Self::Heat(most) => Some([0.0, most]),
            Self::Signed(most) => Some([-most, most]),
            Self::Slip | Self::Grey => None,
        }
    }
}

/// Colours that stay apart for the colour-blind (Okabe and Ito 2008); 7 is black, 8 a light grey.
const COLOURS: [RGBColor; 9] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 110, 0),
    RGBColor(0, 0, 0),
    RGBColor(190, 190, 190),
];

/// Where pictures go, if anywhere.
#[derive(Debug)]
pub(crate) struct Pictures {
    folder: Option<PathBuf>,
}

impl Pictures {
    /// Makes the folder.
    pub(crate) fn new(folder: Option<PathBuf>) -> Result<Self, Failure> {
        if let Some(folder) = &folder {
            std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
            // The same letters on every machine.
            for style in [
                plotters::style::FontStyle::Normal,
                plotters::style::FontStyle::Bold,
            ] {
                plotters::style::register_font(FONT, style, epaint_default_fonts::UBUNTU_LIGHT)
                    .map_err(|_| "the built-in font cannot be read")?;
            }
        }
        Ok(Self { folder })
    }

    /// The file of a picture; none when pictures are not wanted.
    pub(crate) fn file(&self, name: &str) -> Option<PathBuf> {
        self.folder
            .as_ref()
            .map(|folder| folder.join(format!("{name}.png")))
    }

    /// Charts side by side.
    pub(crate) fn charts(&self, name: &str, charts: &[Chart]) -> Result<(), Failure> {
        self.file(name).map_or(Ok(()), |file| draw_charts(&file, charts))
    }

    /// Rows of maps.
    pub(crate) fn panels(&self, name: &str, rows: &[Vec<Panel>]) -> Result<(), Failure> {
        self.file(name).map_or(Ok(()), |file| draw_panels(&file, rows))
    }
}

fn draw_panels(file: &Path, rows: &[Vec<Panel>]) -> Result<(), Failure> {
    let [above, left, right, below] = AROUND;
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let one = (left + MAP + right, above + MAP + below);
    let area = BitMapBackend::new(file, (columns * one.0, rows.len() as u32 * one.1)).into_drawing_area();
    area.fill(&WHITE)?;
    let areas = area.split_evenly((rows.len(), columns as usize));
    for (r, row) in rows.iter().enumerate() {
        for (panel, area) in row.iter().zip(&areas[r * columns as usize..]) {
            draw_panel(area, panel)?;
        }
    }
    area.present()?;
    Ok(())
}

fn draw_panel(
    area: &DrawingArea<BitMapBackend, plotters::coord::Shift>,
    panel: &Panel,
) -> Result<(), Failure> {
    let [above, left, ..] = AROUND.map(|v| v as i32);
    let map = MAP as i32;
    let small = (FONT, 13).into_font();
    area.draw(&Text::new(panel.title.clone(), (left, 7), (FONT, 14).into_font()))?;
    for y in 0..map {
        for x in 0..map {
            let at = |pixel: i32| (pixel as usize * panel.side / map as usize).min(panel.side - 1);
            // Rows of cells run along +y, upwards; rows of an image downwards.
            let row = if panel.half_mm > 0.0 {
                at(map - 1 - y)
            } else {
                at(y)
            };
            let value = panel.values[row * panel.side + at(x)];
            area.draw_pixel((left + x, above + y), &panel.scale.colour(value))?;
        }
    }
    let frame = [(left - 1, above - 1), (left + map, above + map)];
    area.draw(&Rectangle::new(frame, BLACK.stroke_width(1)))?;
    if panel.half_mm > 0.0 {
        for part in [-1.0, 0.0, 1.0] {
            let value = format!("{:.0}", part * panel.half_mm);
            let way = (0.5 * (1.0 + part) * f64::from(map)) as i32;
            let wide = 3 * value.len() as i32;
            area.draw(&Text::new(
                value.clone(),
                (left + way - wide, above + map + 4),
                small.clone(),
            ))?;
            area.draw(&Text::new(
                value,
                (left - 8 - 2 * wide, above + map - way - 7),
                small.clone(),
            ))?;
        }
        area.draw(&Text::new(
            "x, mm",
            (left + map / 2 + 18, above + map + 16),
            small.clone(),
        ))?;
    }
    if let Some([low, high]) = panel.scale.ends() {
        for y in 0..map {
            let value = high + (low - high) * f64::from(y) / f64::from(map - 1);
            let colour = panel.scale.colour(value);
            area.draw(&Rectangle::new(
                [(left + map + 6, above + y), (left + map + 15, above + y + 1)],
                colour.filled(),
            ))?;
        }
        for (value, y) in [(high, 0), (0.5 * (low + high), map / 2), (low, map)] {
            area.draw(&Text::new(
                format!("{value:.0}"),
                (left + map + 19, above + y - 7),
                small.clone(),
            ))?;
        }
    }
    if panel.scale == Scale::Slip {
        for (word, value, x) in [("sticks", 1.0, 0), ("slips", 2.0, 60)] {
            let from = (left + x, above + map + 20);
            area.draw(&Rectangle::new(
                [from, (from.0 + 10, from.1 + 10)],
                panel.scale.colour(value).filled(),
            ))?;
            area.draw(&Text::new(word, (from.0 + 14, from.1 - 2), small.clone()))?;
        }
    }
    Ok(())
}

fn draw_charts(file: &Path, charts: &[Chart]) -> Result<(), Failure> {
    let size = (PANEL[0] * charts.len() as u32, PANEL[1]);
    let area = BitMapBackend::new(file, size).into_drawing_area();
    area.fill(&WHITE)?;
    for (area, chart) in area.split_evenly((1, charts.len())).iter().zip(charts) {
        let [x0, x1] = chart.x_range;
        let [y0, y1] = chart.y_range;
        let mut axes = ChartBuilder::on(area)
            .caption(chart.title, (FONT, 17))
            .margin(10)
            .x_label_area_size(44)
            .y_label_area_size(60)
            .build_cartesian_2d(x0..x1, y0..y1)?;
        axes.configure_mesh()
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(225, 225, 225))
            .x_desc(chart.x)
            .y_desc(chart.y)
            .axis_desc_style((FONT, 16))
            .label_style((FONT, 14))
            .draw()?;
        let mut labelled = false;
        for curve in &chart.curves {
            let colour = COLOURS[curve.colour % COLOURS.len()];
            let width = if curve.colour == 8 { 1 } else { 2 };
            if curve.line {
                let drawn = axes.draw_series(LineSeries::new(
                    curve.points.iter().copied(),
                    colour.stroke_width(width),
                ))?;
                if !curve.label.is_empty() {
                    drawn.label(&curve.label).legend(move |(x, y)| {
                        PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(2))
                    });
                    labelled = true;
                }
            }
            if curve.dots {
                let drawn =
                    axes.draw_series(curve.points.iter().map(|at| Circle::new(*at, 3, colour.filled())))?;
                if !curve.label.is_empty() && !curve.line {
                    drawn
                        .label(&curve.label)
                        .legend(move |(x, y)| Circle::new((x + 9, y), 3, colour.filled()));
                    labelled = true;
                }
            }
        }
        if labelled {
            axes.configure_series_labels()
                .position(if chart.rising {
                    SeriesLabelPosition::LowerRight
                } else {
                    SeriesLabelPosition::UpperRight
                })
                .label_font((FONT, 14))
                .background_style(WHITE.mix(0.85))
                .border_style(RGBColor(200, 200, 200))
                .draw()?;
        }
    }
    area.present()?;
    Ok(())
}
