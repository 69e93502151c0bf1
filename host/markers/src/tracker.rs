//! Follows every marker of a gel through a clip. Pure; pixels of the crop.

use gripline_sensor::{Polarity, Sensor};

use crate::blobs::{Blob, BlobFinder, darkness, threshold};
use crate::constants::{AREA, CHANNELS, CLOSING_PITCHES, IMPRINT, NEIGHBOURHOOD, STEP_REACH, WORKING};
use crate::error::MarkerError;
use crate::grid::{Grid, Node, distance, median};
use crate::plane::{Plane, Scratch};

/// A marker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Marker {
    /// Its place in the printed grid: the same through the whole clip.
    pub node: Node,
    /// Where it is, pixels of the crop.
    pub at_px: [f32; 2],
    /// Whether this picture shows it whole. Else `at_px` is where its neighbours' motion takes it.
    pub seen: bool,
    /// Where it would be in a regular grid, pixels of the crop: fitted to the first picture.
    pub regular_px: [f32; 2],
}

/// Finds a gel's markers in the first picture and follows them from there.
#[derive(Debug, Clone)]
pub struct Tracker {
    sensor: String,
    size_px: [usize; 2],
    polarity: Polarity,
    /// Least and most, full pixels.
    pitch_px: [f64; 2],
    diameter_px: [f64; 2],
    fewest: usize,
    grid: Option<MarkerGrid>,
    /// Red, green and blue, and their mean; working pixels.
    pub(crate) channels: [Plane; CHANNELS],
    grey: Plane,
    around: Plane,
    pub(crate) darkness: Plane,
    scratch: Scratch,
    finder: BlobFinder,
    blobs: Vec<Blob>,
}

/// What the first picture showed.
#[derive(Debug, Clone)]
struct MarkerGrid {
    pitch_px: f32,
    threshold: f32,
    markers: Vec<Marker>,
}

impl Tracker {
    /// For the pictures of a sensor.
    ///
    /// # Errors
    /// [`MarkerError::Sensor`] when it has no printed markers, or its crop is no multiple of four pixels.
    pub fn new(sensor: &Sensor) -> Result<Self, MarkerError> {
        let refuse = |found: String, expected| MarkerError::Sensor {
            sensor: sensor.identity(),
            found,
            expected,
        };
        let Some(pitch_px) = sensor.pitch_px() else {
            return Err(refuse("particles in the volume".to_owned(), "printed markers"));
        };
        let [_, _, width, height] = sensor.capture.crop_px;
        if width % IMPRINT != 0 || height % IMPRINT != 0 {
            return Err(refuse(
                format!("a crop of {width}×{height} pixels"),
                "columns and rows in multiples of four",
            ));
        }
        let plane = Plane::new(width / WORKING, height / WORKING);
        Ok(Self {
            sensor: sensor.identity(),
            size_px: [width, height],
            polarity: sensor.markers.polarity,
            pitch_px,
            diameter_px: sensor.diameter_px(),
            fewest: sensor.markers.count[0],
            grid: None,
            channels: [plane.clone(), plane.clone(), plane.clone()],
            grey: plane.clone(),
            around: plane.clone(),
            darkness: plane,
            scratch: Scratch::default(),
            finder: BlobFinder::default(),
            blobs: Vec::new(),
        })
    }

    /// The sensor's identity.
    #[must_use]
    pub fn sensor(&self) -> &str {
        &self.sensor
    }

    /// Columns and rows of the crop.
    #[must_use]
    pub const fn size_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// The markers of the newest picture, in the order of the first; none before it.
    #[must_use]
    pub fn markers(&self) -> &[Marker] {
        self.grid.as_ref().map_or(&[], |found| &found.markers)
    }

    /// Distance of neighbours that the first picture showed, pixels; `None` before it.
    #[must_use]
    pub fn pitch_px(&self) -> Option<f32> {
        self.grid.as_ref().map(|found| found.pitch_px)
    }

    /// Darkness from which a pixel belongs to a marker; `None` before the first picture.
    pub(crate) fn threshold(&self) -> Option<f32> {
        self.grid.as_ref().map(|found| found.threshold)
    }

    /// Takes the next picture: red, green, blue of every pixel of the crop, rows from the top.
    ///
    /// # Errors
    /// [`MarkerError`] for another size, or a first picture without a grid of markers.
    pub fn see(&mut self, rgb: &[u8]) -> Result<&[Marker], MarkerError> {
        self.split(rgb)?;
        match self.grid.take() {
            None => {
                let found = self.find()?;
                self.grid = Some(found);
            }
            Some(mut found) => {
                self.follow(&mut found);
                self.grid = Some(found);
            }
        }
        Ok(self.markers())
    }

    /// Means over working pixels.
    fn split(&mut self, rgb: &[u8]) -> Result<(), MarkerError> {
        let [width, height] = self.size_px;
        let expected = width * height * CHANNELS;
        if rgb.len() != expected {
            return Err(MarkerError::Size {
                found: rgb.len(),
                expected,
            });
        }
        let columns = width / WORKING;
        let [red, green, blue] = &mut self.channels;
        for (y, rows) in rgb.chunks_exact(WORKING * width * CHANNELS).enumerate() {
            let (upper, lower) = rows.split_at(width * CHANNELS);
            let at = y * columns;
            let planes = red.values[at..][..columns]
                .iter_mut()
                .zip(&mut green.values[at..][..columns])
                .zip(&mut blue.values[at..][..columns])
                .zip(&mut self.grey.values[at..][..columns]);
            let blocks = upper
                .chunks_exact(WORKING * CHANNELS)
                .zip(lower.chunks_exact(WORKING * CHANNELS));
            for ((((red, green), blue), grey), (upper, lower)) in planes.zip(blocks) {
                let sum = |channel: usize| {
                    u16::from(upper[channel])
                        + u16::from(upper[channel + CHANNELS])
                        + u16::from(lower[channel])
                        + u16::from(lower[channel + CHANNELS])
                };
                let sums = [sum(0), sum(1), sum(2)];
                [*red, *green, *blue] = sums.map(|sum| 0.25 * f32::from(sum));
                *grey = f32::from(sums[0] + sums[1] + sums[2]) / (4 * CHANNELS) as f32;
            }
        }
        Ok(())
    }

    fn find_blobs(&mut self, pitch_px: f32, known: Option<f32>) -> f32 {
        // Odd, so that it has a middle.
        let side = (CLOSING_PITCHES * pitch_px / WORKING as f32) as usize | 1;
        darkness(
            &mut self.grey,
            self.polarity,
            side,
            &mut self.scratch,
            &mut self.around,
            &mut self.darkness,
        );
        let threshold = known.unwrap_or_else(|| threshold(&self.darkness));
        let working = WORKING as f32;
        let disc = |diameter_px: f64| std::f32::consts::FRAC_PI_4 * (diameter_px as f32 / working).powi(2);
        let area = [
            AREA[0] * disc(self.diameter_px[0]),
            AREA[1] * disc(self.diameter_px[1]),
        ];
        self.finder.find(&self.darkness, threshold, area, &mut self.blobs);
        for blob in &mut self.blobs {
            blob.centre = blob.centre.map(|value| value * working);
        }
        threshold
    }

    /// The first picture: pitch and grid.
    fn find(&mut self) -> Result<MarkerGrid, MarkerError> {
        let range = self.pitch_px.map(|value| value as f32);
        let grey = self.grey.clone();
        // The square of the widest grid first; then that of the grid that was found.
        let mut pitch_px = range[1];
        let mut grid = None;
        let mut level = 0.0;
        for _ in 0..2 {
            self.grey.clone_from(&grey);
            level = self.find_blobs(pitch_px, None);
            self.blobs.retain(|blob| !blob.cut);
            let points: Vec<_> = self.blobs.iter().map(|blob| blob.centre).collect();
            if let Some(found) = Grid::find(&points, range)
                && (range[0] * 0.9..=range[1] * 1.1).contains(&found.pitch)
            {
                pitch_px = found.pitch;
                grid = Some((found, points));
            }
        }
        let none = |found| MarkerError::NoMarkers {
            found,
            expected: self.fewest,
            pitch_px: self.pitch_px,
        };
        let (grid, points) = grid.ok_or_else(|| none(0))?;
        if grid.members.len() < self.fewest {
            return Err(none(grid.members.len()));
        }
        let regular = grid.regular(&points).ok_or_else(|| none(grid.members.len()))?;
        let mut markers: Vec<_> = grid
            .members
            .iter()
            .map(|(node, index)| Marker {
                node: *node,
                at_px: points[*index],
                seen: true,
                regular_px: regular.at(*node),
            })
            .collect();
        markers.sort_by_key(|marker| (marker.node.row, marker.node.column));
        Ok(MarkerGrid {
            pitch_px,
            threshold: level,
            markers,
        })
    }

    /// A later picture: every marker goes to the blob that it and its neighbours agree on.
    fn follow(&mut self, found: &mut MarkerGrid) {
        self.find_blobs(found.pitch_px, Some(found.threshold));
        let reach = STEP_REACH * found.pitch_px;
        let before: Vec<_> = found.markers.iter().map(|marker| marker.at_px).collect();
        let mut steps = vec![[0.0; 2]; before.len()];
        // First each for itself within half a pitch, then where the neighbours went, twice.
        let mut within = 0.5 * found.pitch_px;
        for _ in 0..3 {
            let matched = self.matches(&before, &steps, within);
            steps = neighbours_steps(
                &before,
                &matched,
                &self.blobs,
                NEIGHBOURHOOD * found.pitch_px,
                &steps,
            );
            within = reach;
        }
        let mut matched = self.matches(&before, &steps, reach);
        // The grid repeats itself, so a jerk of half a pitch can shift all markers by a whole one. No gel is sheared so far: where
        // most are half a pitch from the regular grid, they are looked for there.
        let regular: Vec<_> = found.markers.iter().map(|marker| marker.regular_px).collect();
        let shift = median_step(steps_of(&regular, &matched, &self.blobs).map(|(_, step)| step));
        if shift.is_some_and(|shift| distance(shift, [0.0; 2]) > 0.5 * found.pitch_px) {
            let back: Vec<_> = regular
                .iter()
                .zip(&before)
                .map(|(regular, before)| [regular[0] - before[0], regular[1] - before[1]])
                .collect();
            let anchored = self.matches(&before, &back, 0.5 * found.pitch_px);
            if anchored.iter().flatten().count() * 2 > anchored.len() {
                matched = anchored;
                steps = back;
            }
        }
        for (index, marker) in found.markers.iter_mut().enumerate() {
            let blob = matched[index]
                .map(|blob| self.blobs[blob])
                .filter(|blob| !blob.cut);
            marker.seen = blob.is_some();
            marker.at_px = blob.map_or_else(
                || [0, 1].map(|axis| before[index][axis] + steps[index][axis]),
                |blob| blob.centre,
            );
        }
    }

    /// For every marker the blob that is nearest to where its step takes it, if it is that blob's nearest marker too.
    fn matches(&self, before: &[[f32; 2]], steps: &[[f32; 2]], within: f32) -> Vec<Option<usize>> {
        let mut nearest = vec![(within, None); self.blobs.len()];
        let mut best = vec![(within, None); before.len()];
        for (marker, (from, step)) in before.iter().zip(steps).enumerate() {
            let expected = [from[0] + step[0], from[1] + step[1]];
            for (index, blob) in self.blobs.iter().enumerate() {
                let far = distance(expected, blob.centre);
                if far < best[marker].0 {
                    best[marker] = (far, Some(index));
                }
                if far < nearest[index].0 {
                    nearest[index] = (far, Some(marker));
                }
            }
        }
        best.into_iter()
            .enumerate()
            .map(|(marker, (_, blob))| blob.filter(|blob| nearest[*blob].1 == Some(marker)))
            .collect()
    }
}

/// How far each marker's blob lies from where the marker was; not those that the border cuts.
fn steps_of<'a>(
    before: &'a [[f32; 2]],
    matched: &'a [Option<usize>],
    blobs: &'a [Blob],
) -> impl Iterator<Item = ([f32; 2], [f32; 2])> + 'a {
    before.iter().zip(matched).filter_map(|(from, blob)| {
        let blob = blobs[(*blob)?];
        (!blob.cut).then(|| (*from, [blob.centre[0] - from[0], blob.centre[1] - from[1]]))
    })
}

/// The median along each axis.
fn median_step(steps: impl Iterator<Item = [f32; 2]>) -> Option<[f32; 2]> {
    let (mut x, mut y): (Vec<f32>, Vec<f32>) = steps.map(|[x, y]| (x, y)).unzip();
    (x.len() >= 3).then(|| [median(&mut x), median(&mut y)])
}

/// Where the markers around each one went: the median of their steps, its own among them.
fn neighbours_steps(
    before: &[[f32; 2]],
    matched: &[Option<usize>],
    blobs: &[Blob],
    reach: f32,
    otherwise: &[[f32; 2]],
) -> Vec<[f32; 2]> {
    let steps: Vec<_> = steps_of(before, matched, blobs).collect();
    let around = |at: [f32; 2], reach: f32| {
        let near = steps.iter().filter(move |(from, _)| distance(*from, at) < reach);
        median_step(near.map(|(_, step)| *step))
    };
    before
        .iter()
        .zip(otherwise)
        .map(|(at, otherwise)| {
            around(*at, reach)
                .or_else(|| around(*at, 2.0 * reach))
                .unwrap_or(*otherwise)
        })
        .collect()
}
