//! One finger: from a picture to the comparison of its imprint with earlier ones. Pure.

use std::collections::VecDeque;
use std::fmt;

use gripline_sensor::{Health, Sensor};

use crate::constants::{IMPRINT, LAGS, REST_AGREES};
use crate::error::MarkerError;
use crate::evidence::Comparison;
use crate::imprint::{Filled, Filler};
use crate::light::LightField;
use crate::motion::Motion;
use crate::tracker::{Marker, Tracker};

/// Where the picture at rest comes from, and what evidence that stands on it is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RestKind {
    /// Pictures of this very gel, untouched, shortly before.
    Own,
    /// Pictures of other days or other objects: gel and light may have changed since.
    Other,
    /// None: the regular grid of markers stands for their places, an even light for the picture. Contacts that fill the picture
    /// look like light, and damage of the gel looks like a contact.
    Grid,
}

impl RestKind {
    /// Factor on the quality: what is not known to be rest may be contact.
    const fn worth(self) -> f32 {
        match self {
            Self::Own => 1.0,
            Self::Other => 0.7,
            Self::Grid => 0.5,
        }
    }
}

impl fmt::Display for RestKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Own => "own pictures",
            Self::Other => "other pictures",
            Self::Grid => "regular grid",
        })
    }
}

/// The gel at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Rest {
    picture: Option<Filled>,
    kind: RestKind,
}

impl Rest {
    /// No picture.
    pub const GRID: Self = Self {
        picture: None,
        kind: RestKind::Grid,
    };

    /// The median of pictures at rest; [`Self::GRID`] of none.
    #[must_use]
    pub fn of(pictures: &[Filled], kind: RestKind) -> Self {
        Filled::median(pictures).map_or(Self::GRID, |picture| Self {
            picture: Some(picture),
            kind,
        })
    }

    /// Where it comes from.
    #[must_use]
    pub const fn kind(&self) -> RestKind {
        self.kind
    }
}

/// What is wrong with a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doubt {
    /// Darker than the sensor's limits.
    TooDark,
    /// Brighter, or overexposed.
    TooBright,
    /// Too many markers are hidden.
    MarkersLost,
}

impl Doubt {
    /// In words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::TooDark => "too dark",
            Self::TooBright => "too bright",
            Self::MarkersLost => "markers lost",
        }
    }
}

/// What a finger saw.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// The picture without its markers.
    pub filled: Filled,
    /// Share of the markers that are hidden, 0 to 1.
    pub lost_share: f32,
    /// What is wrong with the picture; `None` when nothing is.
    pub doubt: Option<Doubt>,
    /// Beside earlier imprints; `None` while there is no rest.
    pub comparison: Option<Comparison>,
}

/// One finger's pictures, one after the other.
#[derive(Debug, Clone)]
pub struct Finger {
    tracker: Tracker,
    health: Health,
    filler: Filler,
    light: LightField,
    rest: Option<Rest>,
    /// The newest imprints with where the markers were, the oldest first.
    past: VecDeque<(Vec<Marker>, Filled)>,
}

impl Finger {
    /// For the pictures of a sensor.
    ///
    /// # Errors
    /// As [`Tracker::new`].
    pub fn new(sensor: &Sensor) -> Result<Self, MarkerError> {
        let tracker = Tracker::new(sensor)?;
        let [width, height] = tracker.size_px();
        Ok(Self {
            tracker,
            health: sensor.health,
            filler: Filler::default(),
            light: LightField::new(width / IMPRINT, height / IMPRINT),
            rest: None,
            past: VecDeque::new(),
        })
    }

    /// The markers of the newest picture.
    #[must_use]
    pub const fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// Sets what imprints are seen against. Comparisons begin again.
    pub fn set_rest(&mut self, rest: Rest) {
        self.rest = Some(rest);
        self.past.clear();
    }

    /// Where the rest comes from; `None` while there is none.
    #[must_use]
    pub fn rest(&self) -> Option<RestKind> {
        self.rest.as_ref().map(Rest::kind)
    }

    /// Energy of a picture's imprint against a rest, squared grey levels per pixel; `None` for a rest without a picture.
    #[must_use]
    pub fn energy(&self, filled: &Filled, rest: &Rest) -> Option<f32> {
        rest.picture.as_ref()?;
        let imprint = self.imprint(filled, rest);
        Some(product(&imprint, &imprint))
    }

    /// Energy of what an even light does not explain in a picture, squared grey levels per pixel: the gel's own pattern, and a contact.
    #[must_use]
    pub fn unevenness(&self, filled: &Filled) -> f32 {
        let uneven = self.imprint(filled, &Rest::GRID);
        product(&uneven, &uneven)
    }

    /// Which of several pictures of one gel show it untouched: the least uneven one and those that agree with it. A contact that is
    /// still throughout is not reported.
    #[must_use]
    pub fn untouched(&self, pictures: &[Filled]) -> Vec<bool> {
        let min = pictures
            .iter()
            .min_by(|a, b| self.unevenness(a).total_cmp(&self.unevenness(b)));
        let Some(min) = min else {
            return Vec::new();
        };
        let rest = Rest::of(std::slice::from_ref(min), RestKind::Own);
        pictures
            .iter()
            .map(|picture| {
                self.energy(picture, &rest)
                    .is_some_and(|energy| energy <= REST_AGREES)
            })
            .collect()
    }

    /// Energy of the newest imprint in a square of the crop, squared grey levels per pixel; 0 outside and before there is one.
    #[must_use]
    pub fn energy_around(&self, centre_px: [f32; 2], half_side_px: f32) -> f32 {
        let Some((_, imprint)) = self.past.back() else {
            return 0.0;
        };
        let [columns, rows] = [imprint.channels[0].width, imprint.channels[0].height];
        let span = |centre: f32, of: usize| {
            let edge = |px: f32| (px / IMPRINT as f32).round().clamp(0.0, of as f32) as usize;
            edge(centre - half_side_px)..edge(centre + half_side_px)
        };
        let (across, down) = (span(centre_px[0], columns), span(centre_px[1], rows));
        let pixels = across.len() * down.len();
        let sum: f32 = imprint
            .channels
            .iter()
            .flat_map(|plane| down.clone().map(|y| &plane.row(y)[across.clone()]))
            .flatten()
            .map(|value| value * value)
            .sum();
        sum / pixels.max(1) as f32
    }

    /// Takes the next picture, as [`Tracker::see`].
    ///
    /// # Errors
    /// As [`Tracker::see`].
    pub fn see(&mut self, rgb: &[u8]) -> Result<Observation, MarkerError> {
        let markers = self.tracker.see(rgb)?.to_vec();
        let threshold = self.tracker.threshold().unwrap_or_default();
        let filled = self
            .filler
            .fill(&self.tracker.channels, &self.tracker.darkness, threshold);
        let lost = markers.iter().filter(|marker| !marker.seen).count();
        let lost_share = lost as f32 / markers.len().max(1) as f32;
        let doubt = self.doubt(&filled, lost_share);
        let comparison = self.rest.clone().map(|rest| {
            let imprint = self.imprint(&filled, &rest);
            self.compare(markers, imprint, lost_share, doubt.is_some(), rest.kind)
        });
        Ok(Observation {
            filled,
            lost_share,
            doubt,
            comparison,
        })
    }

    fn doubt(&self, filled: &Filled, lost_share: f32) -> Option<Doubt> {
        let level = f64::from(filled.mean_level());
        let at_rest = self.rest.as_ref().and_then(|rest| rest.picture.as_ref());
        let [min, max] = at_rest.map_or(self.health.rest_level, |rest| {
            self.health
                .brightness
                .map(|share| share * f64::from(rest.mean_level()))
        });
        let planes = filled.channels.iter();
        let (over, all) = planes.fold((0, 0), |(over, all), plane| {
            let above = plane
                .values
                .iter()
                .filter(|value| f64::from(**value) > self.health.overexposed_level);
            (over + above.count(), all + plane.values.len())
        });
        if level < min {
            Some(Doubt::TooDark)
        } else if level > max || over as f64 > self.health.overexposed_share * all as f64 {
            Some(Doubt::TooBright)
        } else if f64::from(lost_share) > self.health.lost_share {
            Some(Doubt::MarkersLost)
        } else {
            None
        }
    }

    fn imprint(&self, filled: &Filled, rest: &Rest) -> Filled {
        let mut imprint = filled.clone();
        if let Some(rest) = &rest.picture {
            for (plane, rest) in imprint.channels.iter_mut().zip(&rest.channels) {
                for (value, rest) in plane.values.iter_mut().zip(&rest.values) {
                    *value -= rest;
                }
            }
        }
        for plane in &mut imprint.channels {
            self.light.remove(&mut plane.values);
        }
        imprint
    }

    fn compare(
        &mut self,
        markers: Vec<Marker>,
        imprint: Filled,
        lost_share: f32,
        is_doubtful: bool,
        rest: RestKind,
    ) -> Comparison {
        let pitch_px = self.tracker.pitch_px().unwrap_or(1.0);
        let [columns, rows] = [imprint.channels[0].width, imprint.channels[0].height];
        let earlier = LAGS.map(|lag| {
            let (before, old) = self.past.get(self.past.len().checked_sub(lag)?)?;
            let moves: Vec<_> = before
                .iter()
                .zip(&markers)
                .filter(|(before, now)| before.seen && now.seen)
                .map(|(before, now)| (before.at_px, now.at_px))
                .collect();
            let carried = Motion::between(&moves, pitch_px, columns, rows).carry(old);
            Some([product(&carried, &imprint), product(&carried, &carried)])
        });
        let energy = product(&imprint, &imprint);
        if self.past.len() == LAGS.into_iter().max().unwrap_or_default() {
            self.past.pop_front();
        }
        self.past.push_back((markers, imprint));
        let limit = self.health.lost_share.max(1e-3) as f32;
        let seen = if is_doubtful {
            0.0
        } else {
            1.0 - 0.5 * (lost_share / limit).min(1.0)
        };
        Comparison {
            earlier,
            energy,
            quality: seen * rest.worth(),
        }
    }
}

/// Mean over pixels of the product, channels added.
fn product(a: &Filled, b: &Filled) -> f32 {
    let planes = a.channels.iter().zip(&b.channels);
    let sum: f32 = planes
        .map(|(a, b)| a.values.iter().zip(&b.values).map(|(a, b)| a * b).sum::<f32>())
        .sum();
    sum / a.channels[0].values.len() as f32
}
