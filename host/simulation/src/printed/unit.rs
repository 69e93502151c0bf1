//! One unit of a sensor: its gel, where its markers are printed, its lens, and what its tracker makes of a displacement.

use gripline_sensor::Sensor;

use super::PrintedGel;
use crate::error::SimulationError;
use crate::field::DisplacementField;
use crate::gel::Gel;
use crate::random::Random;

/// Turn of a printed grid against the picture, rad (assumed: a gel is glued in to two degrees).
const TURN_RAD: f64 = 0.035;
/// Sigma of a marker's place in its grid, mm (assumed).
const PRINT_MM: f64 = 0.02;
/// Whole markers are seen from this distance of the crop's border on, mm.
const BORDER_MM: f64 = 0.4;
/// Largest share of the markers that a damaged gel lacks (recordings: 36 to 80 are seen).
const MISSING: f64 = 0.15;
/// Share of the markers that are not seen in a picture, on top.
const HIDDEN: f64 = 0.02;
/// Sigma of a marker's centre under noise, pixels: still gels of the recordings, `gripline evaluate real` (0.014 median).
const NOISE_PX: f64 = 0.014;
/// Sigma of a centre's error under light that changed, share of the displacement (assumed: imprints shade markers).
const SHADE: f64 = 0.005;

/// What differs between units. Pairs are least and most; each unit draws its own, evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitRange {
    /// Thickness, mm.
    pub thickness_mm: [f64; 2],
    /// Poisson's ratio.
    pub poisson: [f64; 2],
    /// Young's modulus over the file's.
    pub modulus: [f64; 2],
    /// Distance of the lens's centre from the surface as it appears, mm.
    pub distance_mm: [f64; 2],
    /// What the picture's scale is off by from what is known of it, share.
    pub scale_error: [f64; 2],
    /// Displacement along the radius at the field's corner by distortion that is not known, share of the corner's radius.
    pub distortion: [f64; 2],
    /// How much closer the picture is cropped; half of the gels have the least.
    pub zoom: [f64; 2],
}

impl UnitRange {
    /// Units of a sensor as a maker's tolerances have it and a calibrated camera: thickness ± 0.2 mm, a scale known to one in a
    /// hundred, the modulus of the file. The distance is assumed: lenses of its field's width have 15 to 30 mm.
    #[must_use]
    pub fn of(sensor: &Sensor) -> Self {
        let h = sensor.gel.thickness_mm;
        Self {
            thickness_mm: [h - 0.2, h + 0.2],
            poisson: [
                (sensor.gel.poisson - 0.01).max(0.0),
                (sensor.gel.poisson + 0.005).min(0.499),
            ],
            modulus: [1.0; 2],
            distance_mm: [17.0, 27.0],
            scale_error: [-0.01, 0.01],
            distortion: [-0.01, 0.01],
            zoom: sensor.view.zoom,
        }
    }
}

/// One unit.
#[derive(Debug, Clone)]
pub struct PrintedUnit {
    gel: PrintedGel,
    modulus: f64,
    /// The part of the surface that the picture shows, mm.
    field_mm: [f64; 2],
    distance_mm: f64,
    scale: f64,
    distortion: f64,
    /// Pixels of the crop per millimetre.
    px_per_mm: f64,
    noise_mm: f64,
    diameter_mm: f64,
    /// True places at rest, mm.
    markers_mm: Vec<[f64; 2]>,
}

impl PrintedUnit {
    /// A unit of `sensor` drawn from `range`.
    ///
    /// # Errors
    /// A gel constant outside its range.
    pub fn draw(sensor: &Sensor, range: &UnitRange, random: &mut Random) -> Result<Self, SimulationError> {
        let between = |random: &mut Random, [min, max]: [f64; 2]| random.uniform(min, max);
        let gel = Gel {
            thickness_mm: between(random, range.thickness_mm),
            young_mpa: sensor.gel.young_mpa,
            poisson: between(random, range.poisson),
        };
        let depth_mm = between(random, sensor.markers.depth_mm);
        let gel = PrintedGel::new(&gel, depth_mm, sensor.taxels.pitch_mm)?;
        Ok(Self::with_gel(sensor, range, gel, random))
    }

    /// A unit on a gel that is there already; everything else is drawn from `range`.
    #[must_use]
    pub fn with_gel(sensor: &Sensor, range: &UnitRange, gel: PrintedGel, random: &mut Random) -> Self {
        let mut between = |[min, max]: [f64; 2]| random.uniform(min, max);
        let zoom = between(range.zoom);
        let field_mm = sensor.view.field_mm.map(|side| side / zoom);
        let px_per_mm = sensor.px_per_mm()[0] * zoom;
        let mut unit = Self {
            modulus: between(range.modulus),
            field_mm,
            distance_mm: between(range.distance_mm),
            scale: 1.0 + between(range.scale_error),
            distortion: between(range.distortion),
            px_per_mm,
            noise_mm: NOISE_PX / px_per_mm,
            diameter_mm: between(sensor.markers.diameter_mm),
            markers_mm: Vec::new(),
            gel,
        };
        let pitch_mm = between(sensor.markers.pitch_mm.unwrap_or([2.0; 2]));
        unit.markers_mm = printed(pitch_mm, field_mm, random);
        unit
    }

    /// The gel.
    #[must_use]
    pub const fn gel(&self) -> &PrintedGel {
        &self.gel
    }

    /// Young's modulus over the one that contacts are solved with; forces grow with it.
    #[must_use]
    pub const fn modulus(&self) -> f64 {
        self.modulus
    }

    /// The part of the surface that the picture shows, mm.
    #[must_use]
    pub const fn field_mm(&self) -> [f64; 2] {
        self.field_mm
    }

    /// Pixels of the crop per millimetre as the sensor's file says.
    #[must_use]
    pub const fn px_per_mm(&self) -> f64 {
        self.px_per_mm
    }

    /// What the lens really has over that, in the picture's middle.
    #[must_use]
    pub const fn scale(&self) -> f64 {
        self.scale
    }

    /// Displacement along the radius at the field's corner, share of the corner's radius.
    #[must_use]
    pub const fn distortion(&self) -> f64 {
        self.distortion
    }

    /// Diameter of a marker, mm.
    #[must_use]
    pub const fn diameter_mm(&self) -> f64 {
        self.diameter_mm
    }

    /// Where the markers are printed, mm.
    #[must_use]
    pub fn printed_mm(&self) -> &[[f64; 2]] {
        &self.markers_mm
    }

    /// Where a point of the markers' plane that was at `at_mm` and moved by `by_mm` shows in the picture, in millimetres as a user
    /// of the sensor's file reads them off.
    #[must_use]
    pub fn seen_mm(&self, at_mm: [f64; 2], by_mm: [f64; 3]) -> [f64; 2] {
        // What comes closer looks larger.
        let closer = self.distance_mm / (self.distance_mm - by_mm[2]);
        let at = [0, 1].map(|axis| (at_mm[axis] + by_mm[axis]) * closer);
        let corner = 0.25 * (self.field_mm[0] * self.field_mm[0] + self.field_mm[1] * self.field_mm[1]);
        let stretch = self.scale * (1.0 + self.distortion * (at[0] * at[0] + at[1] * at[1]) / corner);
        at.map(|mm| mm * stretch)
    }

    /// Where the markers show at rest, mm.
    #[must_use]
    pub fn rest_mm(&self) -> Vec<[f64; 2]> {
        self.markers_mm
            .iter()
            .map(|at| self.seen_mm(*at, [0.0; 3]))
            .collect()
    }

    /// Where the markers show under a contact and whether each is seen, mm.
    pub(super) fn track(&self, field: &DisplacementField, random: &mut Random) -> Vec<([f64; 2], bool)> {
        let shade = SHADE * normal(random);
        let tracked = self.markers_mm.iter().map(|at_mm| {
            let by_mm = self.gel.displacement_mm(field, *at_mm);
            let rest_mm = self.seen_mm(*at_mm, [0.0; 3]);
            let seen_mm = self.seen_mm(*at_mm, by_mm);
            let moved = [0, 1].map(|axis| {
                let share = 1.0 + shade;
                rest_mm[axis] + share * (seen_mm[axis] - rest_mm[axis]) + self.noise_mm * normal(random)
            });
            (moved, random.unit() >= HIDDEN)
        });
        tracked.collect()
    }

    /// The field under a contact of this unit's gel.
    pub(super) fn new_field(&self) -> DisplacementField {
        self.gel.field()
    }
}

/// A turned grid over the field, some of it missing.
fn printed(pitch_mm: f64, [width, height]: [f64; 2], random: &mut Random) -> Vec<[f64; 2]> {
    let offset = [random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5)];
    let (sin, cos) = libm::sincos(random.uniform(-TURN_RAD, TURN_RAD));
    let missing = MISSING * random.unit();
    let reach = (0.5 * width.max(height) / pitch_mm).ceil() as i32 + 2;
    let mut markers = Vec::new();
    for row in -reach..=reach {
        for column in -reach..=reach {
            let [u, v] = [
                (f64::from(column) + offset[0]) * pitch_mm,
                (f64::from(row) + offset[1]) * pitch_mm,
            ];
            let at = [
                cos * u - sin * v + PRINT_MM * normal(random),
                sin * u + cos * v + PRINT_MM * normal(random),
            ];
            let inside = at[0].abs() < 0.5 * width - BORDER_MM && at[1].abs() < 0.5 * height - BORDER_MM;
            if random.unit() >= missing && inside {
                markers.push(at);
            }
        }
    }
    markers
}

/// A normal deviate: twelve even numbers less six.
pub(super) fn normal(random: &mut Random) -> f64 {
    (0..12).map(|_| random.unit()).sum::<f64>() - 6.0
}
