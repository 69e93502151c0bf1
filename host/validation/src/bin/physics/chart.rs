//! The pictures: charts of curves and maps of cells, as PNG files of a stated size.

use std::path::PathBuf;

use gripline_chart::{Axis, BLUE, Colour, Figure, INK, Legend, Map, Mark, ORANGE, Series};

use crate::failure::Failure;

/// Width and height of a chart, and of a map with what stands around it, pixels.
const CHART: [u32; 2] = [560, 380];
const MAP: [u32; 2] = [306, 282];
const FREE: Colour = Colour(245, 245, 245);

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

/// Colours of the curves: those of the charts, then olive, black and a light grey.
fn colour(number: usize) -> Colour {
    match number {
        6 => Colour(120, 110, 0),
        7 => INK,
        8 => Colour(190, 190, 190),
        _ => gripline_chart::COLOURS[number % gripline_chart::COLOURS.len()],
    }
}

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
        let panels = charts
            .iter()
            .map(|chart| gripline_chart::Panel::Chart(chart.drawn()));
        let width = CHART[0] * charts.len() as u32;
        self.save(name, width, vec![(CHART[1], panels.collect())])
    }

    /// Rows of maps.
    pub(crate) fn panels(&self, name: &str, rows: &[Vec<Panel>]) -> Result<(), Failure> {
        let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
        let rows = rows.iter().map(|row| {
            let maps = row.iter().map(|panel| gripline_chart::Panel::Map(panel.drawn()));
            // A short row keeps the width of its maps.
            let blank = (row.len()..columns).map(|_| gripline_chart::Panel::Text(String::new()));
            (MAP[1], maps.chain(blank).collect())
        });
        self.save(name, MAP[0] * columns as u32, rows.collect())
    }

    fn save(
        &self,
        name: &str,
        width: u32,
        rows: Vec<(u32, Vec<gripline_chart::Panel>)>,
    ) -> Result<(), Failure> {
        match self.file(name) {
            Some(file) => Ok(Figure { width, rows }.save(&file)?),
            None => Ok(()),
        }
    }
}

impl Chart<'_> {
    fn drawn(&self) -> gripline_chart::Chart {
        let mut series = Vec::new();
        for curve in &self.curves {
            let (colour, points) = (colour(curve.colour), &curve.points);
            let width = if curve.colour == 8 { 1 } else { 2 };
            if curve.line {
                series.push(Series::new(
                    curve.label.clone(),
                    colour,
                    Mark::Line(width),
                    points.clone(),
                ));
            }
            if curve.dots {
                let label = if curve.line { "" } else { &curve.label };
                series.push(Series::new(label, colour, Mark::Dots(3), points.clone()));
            }
        }
        gripline_chart::Chart {
            title: self.title.to_owned(),
            x: Axis::new(self.x, self.x_range),
            y: Axis::new(self.y, self.y_range),
            legend: if self.rising {
                Legend::LowerRight
            } else {
                Legend::UpperRight
            },
            series,
            notes: Vec::new(),
        }
    }
}

impl Panel {
    fn drawn(&self) -> Map {
        let bar = match self.scale {
            Scale::Heat(max) => Some(gripline_chart::Scale::Heat(max)),
            Scale::Signed(max) => Some(gripline_chart::Scale::Signed(max)),
            Scale::Slip | Scale::Grey => None,
        };
        let is_slip = self.scale == Scale::Slip;
        let colour = |value: f64| match bar {
            Some(scale) => scale.colour(value),
            None if is_slip && value < 0.5 => FREE,
            None if is_slip && value < 1.5 => BLUE,
            None if is_slip => ORANGE,
            None => {
                // In steps: noise-like pictures grow large.
                let level = ((value / 17.0).round() * 17.0).clamp(0.0, 255.0) as u8;
                Colour(level, level, level)
            }
        };
        let rows = self.values.chunks(self.side);
        let has_axes = self.half_mm > 0.0;
        // Rows of cells run along +y, upwards; rows of an image downwards.
        let values: Vec<f64> = if has_axes {
            rows.rev().flatten().copied().collect()
        } else {
            self.values.clone()
        };
        Map {
            title: self.title.clone(),
            side: self.side,
            cells: values.into_iter().map(colour).collect(),
            half_mm: has_axes.then_some(self.half_mm),
            bar,
            key: if is_slip {
                vec![("sticks", BLUE), ("slips", ORANGE)]
            } else {
                Vec::new()
            },
            arrows: Vec::new(),
        }
    }
}
