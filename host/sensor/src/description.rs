//! The description itself. Pairs are x and y, or least and most, as each says. Pure.

/// A fingertip. [`Sensor::named`] and [`Sensor::from_toml`] give checked ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// What weights, calibrations and recordings call it: lower-case letters, digits and hyphens.
    pub name: String,
    /// Counts changes that make weights and calibrations of earlier ones useless.
    pub revision: u32,
    /// One line for people.
    pub summary: String,
    /// The pictures.
    pub capture: Capture,
    /// What they show.
    pub view: View,
    /// The soft body.
    pub gel: Gel,
    /// What is tracked.
    pub markers: Markers,
    /// The force map.
    pub taxels: Taxels,
    /// When a picture can be trusted.
    pub health: Health,
    /// What makes forces of it.
    pub forces: Forces,
}

impl Sensor {
    /// Name and revision in one word, `gelsight-mini.1`: what another sensor's weights are refused by.
    #[must_use]
    pub fn identity(&self) -> String {
        format!("{}.{}", self.name, self.revision)
    }

    /// The same with what a calibration of the very camera found: the field of the whole crop, mm, and the lens's bend. Then nothing is
    /// guessed from the markers' distance any more.
    pub fn see_as(&mut self, field_mm: [f64; 2], distortion_per_mm2: f64) {
        self.view.field_mm = field_mm;
        self.view.distortion_per_mm2 = distortion_per_mm2;
        self.view.zoom = [1.0; 2];
    }

    /// Pixels of the crop per millimetre along x and y, where nothing is zoomed.
    #[must_use]
    pub fn px_per_mm(&self) -> [f64; 2] {
        let [.., width, height] = self.capture.crop_px;
        [
            width as f64 / self.view.field_mm[0],
            height as f64 / self.view.field_mm[1],
        ]
    }

    /// Least and most distance of neighbouring printed markers in the crop, pixels, over all zooms; `None` for particles.
    #[must_use]
    pub fn pitch_px(&self) -> Option<[f64; 2]> {
        let pitch_mm = self.markers.pitch_mm?;
        Some(self.in_pixels(pitch_mm))
    }

    /// Minimum and maximum diameter of a marker in the crop, pixels, over all zooms.
    #[must_use]
    pub fn diameter_px(&self) -> [f64; 2] {
        self.in_pixels(self.markers.diameter_mm)
    }

    fn in_pixels(&self, [min_mm, max_mm]: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.px_per_mm();
        [
            min_mm * x.min(y) * self.view.zoom[0],
            max_mm * x.max(y) * self.view.zoom[1],
        ]
    }
}

/// The pictures that the sensor gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capture {
    /// Columns and rows of the camera itself.
    pub camera_px: [usize; 2],
    /// Columns and rows of the pictures that are worked on; others are scaled to them.
    pub size_px: [usize; 2],
    /// Pictures a second.
    pub rate_hz: f64,
    /// Channels.
    pub colour: Colour,
    /// First column, first row, columns and rows of the part that is used.
    pub crop_px: [usize; 4],
    /// What turns a picture into the view from outside.
    pub flip: Flip,
}

/// Channels of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// One channel.
    Grey,
    /// Red, green, blue.
    Rgb,
}

/// How a picture is mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flip {
    /// Not at all.
    None,
    /// Left and right change places.
    Horizontal,
    /// Top and bottom change places.
    Vertical,
    /// Both: turned by half a turn.
    Both,
}

/// What a crop shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Width and height of the part of the surface that the whole crop shows, mm.
    pub field_mm: [f64; 2],
    /// Least and most factor by which the field may be smaller than that.
    pub zoom: [f64; 2],
    /// The projection.
    pub lens: Lens,
    /// How a flat lens bends: a place r mm from the middle shows 1 + this · r² times as far off. None in a description; a
    /// calibration of the very camera sets it.
    pub distortion_per_mm2: f64,
}

/// A projection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lens {
    /// The surface is flat in the picture: one scale everywhere.
    Flat,
    /// Equidistant: distance from the middle grows with the angle.
    Fisheye,
}

/// The soft body, one elastic layer on a rigid base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gel {
    /// Width and height of the pad, mm.
    pub pad_mm: [f64; 2],
    /// Thickness, mm.
    pub thickness_mm: f64,
    /// Young's modulus, MPa.
    pub young_mpa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
}

/// What is tracked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Markers {
    /// Where it is.
    pub kind: MarkerKind,
    /// Against its surroundings.
    pub polarity: Polarity,
    /// Least and most distance of neighbours in the printed grid, mm; `None` for particles.
    pub pitch_mm: Option<[f64; 2]>,
    /// Minimum and maximum diameter, mm.
    pub diameter_mm: [f64; 2],
    /// Least and most depth under the surface, mm.
    pub depth_mm: [f64; 2],
    /// Fewest and most that are in the gel (particles) or seen at once (printed).
    pub count: [usize; 2],
}

/// Where markers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkerKind {
    /// Particles throughout the gel.
    Volume,
    /// A square grid of dots printed in a plane.
    Plane,
}

/// Markers against their surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Polarity {
    /// Darker.
    Dark,
    /// Brighter.
    Bright,
}

/// The grid of the force map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Taxels {
    /// Columns and rows.
    pub grid: [usize; 2],
    /// Side of a square taxel, mm.
    pub pitch_mm: f64,
}

/// When a picture can be trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// Least and most mean level over that at rest.
    pub brightness: [f64; 2],
    /// Least and most mean level of a picture at rest, grey levels.
    pub rest_level: [f64; 2],
    /// Above this something is overexposed, grey levels.
    pub overexposed_level: f64,
    /// Largest share that may be.
    pub overexposed_share: f64,
    /// Largest share of lost markers.
    pub lost_share: f64,
}

/// What makes forces of displacements.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Forces {
    /// A model's name, or a weights file: beside the description, or shipped.
    pub weights: String,
}
