//! A fingertip with printed markers: from a colour picture to forces and evidence of motion. Pure.
//! Units: pixels of the crop from its upper left corner, mm from its middle with y up, newtons.
//!
//! The markers' displacement gives forces ([`MarkerForces`]); the imprint between them, shifted along with the gel, shows whether
//! the object moves ([`Hold`]): this evidence is sent in the map's head. Markers are tracked in every picture, independent of the
//! gate.

use std::time::Instant;

use gripline_markers::{Doubt, Evidence, Filled, Finger, Hold, Marker, Rest, RestKind};
use gripline_network::marker_forces::{MarkerForces, MarkerMotion};
use gripline_network::scene::{GateDecision, GateKind};
use gripline_protocol::{Health, Motion, TAXELS};
use gripline_recording::telemetry::MarkersReport;
use gripline_sensor::Sensor;

use crate::error::{MarkerProblem, PipelineError};

/// Columns of a map.
const MAP_SIDE: usize = 20;
/// Share of the rest pictures that may show a contact: a hand that begins to close. They are left out; more make the rest invalid.
const TOUCHED_AT_REST_SHARE: f64 = 0.25;
/// An imprint at rest is a contact's when later pictures of the same clip lack this much of its energy, squared grey levels per pixel,
/// and this share of it.
const REST_GONE_ENERGY: f32 = 12.0;
const REST_GONE_SHARE: f32 = 0.2;
/// This many of the clip's pictures must lack it: a single one may be torn.
const REST_GONE_PICTURES: usize = 2;
/// Their brightness may differ from that at rest by this share: the first pictures of a camera are dark.
const SAME_LIGHT_SHARE: f32 = 0.15;
/// Below this energy an imprint is noise, and nothing touches; that of a finger whose object is surely gone (docs/evidence.md).
const UNTOUCHED_ENERGY: f32 = 8.0;
/// Markers closer to rest than this have not moved, pixels, in the median and at most: they return to 0.15 and differ by 0.02.
const UNMOVED_PX: [f32; 2] = [0.4, 1.5];
/// The same if the regular grid replaces the rest: printed dots deviate from it.
const UNMOVED_FROM_GRID_PX: [f32; 2] = [1.0, 3.0];
/// A taxel is touched from this energy on, and from this share of the most touched one's.
const TOUCHED_ENERGY: f32 = 16.0;
const TOUCHED_SHARE: f32 = 0.05;
/// This many consecutive untouched pictures end a hold.
const HOLD_ENDS: u32 = 25;
/// Evidence of the imprint, and what share of the head's evidence it becomes; straight lines between. Even at the threshold that
/// classifies most recorded trials correctly (0.71; `gripline evaluate real --json`); holds stay below 0.4 in most of them, and an
/// emptied hand is near 0.72.
const EVIDENCE: [[f32; 2]; 5] = [[0.0, 0.0], [0.4, 0.1], [0.7, 0.5], [0.85, 0.9], [1.0, 1.0]];
/// Quality of evidence at which each level of the head's quality begins.
const QUALITY_FROM: [f32; Motion::QUALITY_MAX as usize] = [0.15, 0.55, 0.8];
/// In the first well-lit picture after stored rest pictures this many markers must be at their stored places.
const SAME_GEL_SHARE: f32 = 0.5;

/// The reference for the untouched gel.
#[derive(Debug, Clone)]
pub struct MarkerRest {
    /// Colour crops; none if the regular grid replaces them.
    pub pictures: Vec<Vec<u8>>,
    /// Where they come from.
    pub kind: RestKind,
    /// Their name in messages, such as `--rest 12..20`.
    pub named: String,
    /// Number of the first of them in what they are taken from, for messages.
    pub first: usize,
    /// Some pictures from the whole clip, if there is one, with their numbers: they show whether an imprint at rest is ever
    /// missing.
    pub clip: Vec<(usize, Vec<u8>)>,
}

impl MarkerRest {
    /// Nothing is known.
    #[must_use]
    pub fn grid() -> Self {
        Self {
            pictures: Vec::new(),
            kind: RestKind::Grid,
            named: "the regular grid".to_owned(),
            first: 0,
            clip: Vec::new(),
        }
    }

    /// What a recording says stood for rest: the name of its kind, and the fingertip's pictures.
    ///
    /// # Errors
    /// [`MarkerProblem::RecordedRest`] when the kind is not one of those that recordings name.
    pub fn recorded(kind: &str, pictures: &[Vec<u8>]) -> Result<Self, PipelineError> {
        let kinds = [RestKind::Own, RestKind::Other, RestKind::Grid];
        let kind = kinds
            .into_iter()
            .find(|known| known.to_string() == kind)
            .ok_or_else(|| MarkerProblem::RecordedRest {
                found: kind.to_owned(),
            })?;
        Ok(Self {
            pictures: pictures.to_vec(),
            kind,
            named: "the recording's rest".to_owned(),
            first: 0,
            clip: Vec::new(),
        })
    }
}

/// The result of a picture.
pub(crate) struct Seen {
    pub gate: GateDecision,
    pub health: Health,
    pub motion: Motion,
    /// Time for downsampling, gate, and markers with imprint and forces, µs.
    pub stages_us: [f64; 3],
}

/// From pixels of the crop to mm from its middle, y up.
#[derive(Debug, Clone, Copy)]
struct ToMm {
    middle_px: [f32; 2],
    mm_per_px: f32,
    distortion_per_mm2: f32,
}

impl ToMm {
    fn at(self, [x, y]: [f32; 2]) -> [f32; 2] {
        let shown = [
            (x - self.middle_px[0]) * self.mm_per_px,
            (self.middle_px[1] - y) * self.mm_per_px,
        ];
        // Undoes the lens's bend; a third round would change less than a thousandth of the first.
        (0..2).fold(shown, |[u, v], _| {
            let stretch = 1.0 + self.distortion_per_mm2 * (u * u + v * v);
            shown.map(|mm| mm / stretch)
        })
    }
}

/// The stage for one fingertip's pictures.
#[derive(Debug, Clone)]
pub struct MarkerStage {
    sensor: Sensor,
    finger: Finger,
    rest: Rest,
    /// Where each marker is at rest, pixels; none before the first picture without rest pictures.
    places_px: Option<Vec<[f32; 2]>>,
    forces: MarkerForces,
    gate: GateKind,
    hold: Hold,
    /// Consecutive untouched pictures.
    untouched: u32,
    /// No picture with enough light has come.
    is_first: bool,
    motions: Vec<MarkerMotion>,
    mm_per_px: f32,
    evidence: Option<Evidence>,
    touched_at_rest: Vec<usize>,
}

impl MarkerStage {
    /// For the pictures of a sensor, compared with `rest`.
    ///
    /// # Errors
    /// [`PipelineError::Markers`] when the sensor has no printed markers, or the rest shows none, or a touch.
    pub fn new(
        sensor: &Sensor,
        forces: MarkerForces,
        rest: &MarkerRest,
        gate: GateKind,
    ) -> Result<Self, PipelineError> {
        let finger = Finger::new(sensor).map_err(MarkerProblem::Markers)?;
        let mut stage = Self {
            sensor: sensor.clone(),
            finger,
            rest: Rest::GRID,
            places_px: None,
            forces,
            gate,
            hold: Hold::default(),
            untouched: 0,
            is_first: true,
            motions: Vec::new(),
            mm_per_px: 0.0,
            evidence: None,
            touched_at_rest: Vec::new(),
        };
        stage.take_rest(rest)?;
        Ok(stage)
    }

    pub(crate) fn contact_min_n(&self) -> f32 {
        self.forces.calibration().contact_min_n
    }

    /// Columns and rows of the crop.
    pub(crate) fn size_px(&self) -> [usize; 2] {
        self.finger.tracker().size_px()
    }

    /// The markers of the newest picture.
    #[must_use]
    pub fn markers(&self) -> &[Marker] {
        self.finger.tracker().markers()
    }

    /// The result of the newest picture.
    #[must_use]
    pub fn report(&self) -> MarkersReport {
        let markers = self.markers();
        let evidence = self.evidence.as_ref();
        MarkersReport {
            followed: markers.len(),
            hidden: markers.iter().filter(|marker| !marker.seen).count(),
            imprint_slip: evidence.map(|evidence| evidence.slip),
            imprint_quality: evidence.map(|evidence| evidence.quality),
            imprint_lost: evidence.map(|evidence| evidence.loss),
        }
    }

    /// The evidence of the imprints in the newest picture; `None` for the first.
    #[must_use]
    pub const fn evidence(&self) -> Option<Evidence> {
        self.evidence
    }

    /// How far each marker has moved from its place at rest, in the order of [`Self::places_mm`].
    #[must_use]
    pub fn motions(&self) -> &[MarkerMotion] {
        &self.motions
    }

    /// Where the markers are at rest, mm from the middle of the crop; none before the first picture without rest pictures.
    #[must_use]
    pub fn places_mm(&self) -> Vec<[f32; 2]> {
        let places = self.places_px.as_deref().unwrap_or_default();
        places.iter().map(|place| self.in_mm(*place)).collect()
    }

    /// Numbers of the rest pictures that show a contact and were left out.
    #[must_use]
    pub fn touched_at_rest(&self) -> &[usize] {
        &self.touched_at_rest
    }

    fn take_rest(&mut self, rest: &MarkerRest) -> Result<(), MarkerProblem> {
        if rest.pictures.is_empty() {
            self.finger.set_rest(Rest::GRID);
            return Ok(());
        }
        let unseen = |number: usize, problem| MarkerProblem::Rest {
            rest: format!("{}, picture {number}", rest.named),
            problem,
        };
        let (mut filled, mut places): (Vec<Filled>, Vec<Vec<Marker>>) = (Vec::new(), Vec::new());
        for (number, picture) in rest.pictures.iter().enumerate() {
            if rest.kind == RestKind::Other {
                // Pictures of other days need not follow each other.
                self.finger = Finger::new(&self.sensor).map_err(MarkerProblem::Markers)?;
            }
            let seen = self.finger.see(picture);
            filled.push(
                seen.map_err(|problem| unseen(rest.first + number, problem))?
                    .filled,
            );
            places.push(self.markers().to_vec());
        }
        let untouched = self.finger.untouched(&filled);
        self.leave_out(rest, &untouched)?;
        let mut keep = untouched.iter().copied();
        filled.retain(|_| keep.next() == Some(true));
        if rest.kind == RestKind::Other {
            // Each numbers its markers anew, so those of one picture stand for all.
            let first = untouched.iter().position(|is| *is).unwrap_or_default();
            self.finger = Finger::new(&self.sensor).map_err(MarkerProblem::Markers)?;
            self.finger
                .see(&rest.pictures[first])
                .map_err(|problem| unseen(rest.first + first, problem))?;
            places = vec![self.markers().to_vec()];
        } else {
            let mut keep = untouched.into_iter();
            places.retain(|_| keep.next() == Some(true));
        }
        self.rest = Rest::of(&filled, rest.kind);
        self.compare_with_clip(rest, &filled)?;
        let count = places.first().map_or(0, Vec::len);
        let middle = |marker: usize, axis: usize| {
            let seen = places.iter().map(|places| places[marker]);
            let mut values: Vec<f32> = seen
                .clone()
                .filter(|marker| marker.seen)
                .chain(seen.take(1))
                .map(|marker| marker.at_px[axis])
                .collect();
            values.sort_by(f32::total_cmp);
            values[values.len() / 2]
        };
        let places: Vec<[f32; 2]> = (0..count)
            .map(|marker| [middle(marker, 0), middle(marker, 1)])
            .collect();
        self.finger.set_rest(self.rest.clone());
        self.begin(places);
        Ok(())
    }

    /// Notes which pictures show a contact; refuses a rest with more than a few of them.
    fn leave_out(&mut self, rest: &MarkerRest, untouched: &[bool]) -> Result<(), MarkerProblem> {
        let of = |wanted: bool| -> Vec<usize> {
            let chosen = untouched.iter().enumerate().filter(|(_, is)| **is == wanted);
            chosen.map(|(number, _)| rest.first + number).collect()
        };
        let (still, touched) = (of(true), of(false));
        if touched.len() as f64 > TOUCHED_AT_REST_SHARE * untouched.len() as f64 {
            return Err(MarkerProblem::RestTouched {
                rest: rest.named.clone(),
                touched: spans(&touched),
                untouched: spans(&still),
            });
        }
        self.touched_at_rest = touched;
        Ok(())
    }

    /// Refuses a rest whose imprint is missing in other pictures of the clip: it is that of a contact.
    fn compare_with_clip(&self, rest: &MarkerRest, filled: &[Filled]) -> Result<(), MarkerProblem> {
        let Some(at_rest) = Filled::median(filled) else {
            return Ok(());
        };
        let (found, level) = (self.finger.unevenness(&at_rest), at_rest.mean_level());
        let limit = (found - REST_GONE_ENERGY).min((1.0 - REST_GONE_SHARE) * found);
        let mut without: Vec<(f32, usize)> = rest
            .clip
            .iter()
            .filter_map(|(number, picture)| {
                let seen = if rest.kind == RestKind::Other {
                    // Another gel, or another zoom, has another pattern.
                    let mut finger = self.finger.clone();
                    let seen = finger.see(picture).ok()?;
                    (seen.lost_share <= SAME_GEL_SHARE).then_some(seen)?
                } else {
                    Finger::new(&self.sensor)
                        .and_then(|mut finger| finger.see(picture))
                        .ok()?
                };
                let light = seen.filled.mean_level() / level;
                let is_alike = (light - 1.0).abs() <= SAME_LIGHT_SHARE;
                let energy = self.finger.unevenness(&seen.filled) / (light * light);
                (is_alike && energy < limit).then_some((energy, *number))
            })
            .collect();
        without.sort_by(|a, b| a.0.total_cmp(&b.0));
        match without.get(REST_GONE_PICTURES - 1) {
            None => Ok(()),
            Some((energy, picture)) => Err(MarkerProblem::RestGone {
                rest: rest.named.clone(),
                found,
                picture: *picture,
                there: *energy,
            }),
        }
    }

    /// From now on the markers are at rest here.
    fn begin(&mut self, places_px: Vec<[f32; 2]>) {
        self.mm_per_px = self.scale();
        let places_mm: Vec<_> = places_px.iter().map(|place| self.in_mm(*place)).collect();
        self.forces.set_rest(&places_mm);
        self.motions = vec![MarkerMotion::default(); places_px.len()];
        self.places_px = Some(places_px);
    }

    /// mm per pixel: the description's, scaled by the measured distance of the markers, within its zoom range.
    fn scale(&self) -> f32 {
        let [x, y] = self.sensor.px_per_mm();
        let nominal = 0.5 * (x + y);
        let pitch_mm = self
            .sensor
            .markers
            .pitch_mm
            .map_or(1.0, |[min, max]| 0.5 * (min + max));
        let found = self.finger.tracker().pitch_px().map_or(nominal, f64::from) / pitch_mm;
        let [min, max] = self.sensor.view.zoom;
        (1.0 / (nominal * (found / nominal).clamp(min, max))) as f32
    }

    /// From pixels of the crop to mm from its middle.
    fn in_mm(&self, at_px: [f32; 2]) -> [f32; 2] {
        self.to_mm().at(at_px)
    }

    fn to_mm(&self) -> ToMm {
        ToMm {
            middle_px: self.size_px().map(|side| 0.5 * side as f32),
            mm_per_px: self.mm_per_px,
            distortion_per_mm2: self.sensor.view.distortion_per_mm2 as f32,
        }
    }

    /// Takes the next picture; writes forces to `newtons` if the gate needs them.
    pub(crate) fn process(
        &mut self,
        crop: &[u8],
        newtons: &mut [[f32; 3]; TAXELS],
    ) -> Result<Seen, PipelineError> {
        let start = Instant::now();
        let seen = self.look(crop)?;
        let looked = Instant::now();
        let evidence = seen
            .comparison
            .and_then(|comparison| self.hold.step(&[comparison]));
        self.evidence = evidence;
        self.move_markers();
        let energy = seen.comparison.map_or(0.0, |comparison| comparison.energy);
        let is_untouched = self.is_untouched(energy);
        let gate = match seen.doubt {
            Some(_) => GateDecision::Unhealthy,
            None if is_untouched && self.gate != GateKind::Off => GateDecision::NoContact,
            None => GateDecision::Infer,
        };
        self.untouched = if is_untouched { self.untouched + 1 } else { 0 };
        let gated = Instant::now();
        if gate == GateDecision::Infer {
            let touched = self.touched();
            self.forces.infer(&self.motions, touched.as_ref(), newtons);
        }
        let us = |from: Instant, to: Instant| (to - from).as_secs_f64() * 1e6;
        let motion = evidence.map_or(Motion::UNKNOWN, |evidence| motion_of(&evidence));
        if self.untouched >= HOLD_ENDS {
            self.hold = Hold::default();
        }
        Ok(Seen {
            gate,
            health: seen.doubt.map_or(Health::GOOD, health_of),
            motion,
            // Nothing is downsampled; following markers is the network's part, as following particles is.
            stages_us: [
                0.0,
                us(looked, gated),
                us(start, looked) + us(gated, Instant::now()),
            ],
        })
    }

    fn look(&mut self, crop: &[u8]) -> Result<gripline_markers::Observation, PipelineError> {
        let mut seen = self.finger.see(crop).map_err(MarkerProblem::Markers)?;
        // Too dark or too bright a picture does not show whose gel it is.
        let is_lit = !matches!(seen.doubt, Some(Doubt::TooDark | Doubt::TooBright));
        let is_first = is_lit && std::mem::take(&mut self.is_first);
        if is_first && self.rest.kind() == RestKind::Other && seen.lost_share > SAME_GEL_SHARE {
            // Another gel, or another zoom: its own grid stands for its places, the pictures only for the light.
            self.finger = Finger::new(&self.sensor).map_err(MarkerProblem::Markers)?;
            self.finger.set_rest(self.rest.clone());
            seen = self.finger.see(crop).map_err(MarkerProblem::Markers)?;
            self.places_px = None;
        }
        if self.places_px.is_none() {
            let regular = self.markers().iter().map(|marker| marker.regular_px).collect();
            self.begin(regular);
        }
        Ok(seen)
    }

    fn move_markers(&mut self) {
        let to_mm = self.to_mm();
        let places = self.places_px.as_deref().unwrap_or_default();
        let markers = self.finger.tracker().markers();
        for ((motion, marker), place) in self.motions.iter_mut().zip(markers).zip(places) {
            let [now, rest] = [marker.at_px, *place].map(|at| to_mm.at(at));
            *motion = MarkerMotion {
                moved_mm: [now[0] - rest[0], now[1] - rest[1]],
                is_seen: marker.seen,
            };
        }
    }

    /// Neither an imprint nor moved markers.
    fn is_untouched(&self, energy: f32) -> bool {
        let has_picture = self.rest.kind() != RestKind::Grid;
        let limits = if has_picture {
            UNMOVED_PX
        } else {
            UNMOVED_FROM_GRID_PX
        };
        let mut far_px: Vec<f32> = self
            .motions
            .iter()
            .filter(|motion| motion.is_seen)
            .map(|motion| motion.moved_mm[0].hypot(motion.moved_mm[1]) / self.mm_per_px)
            .collect();
        far_px.sort_by(f32::total_cmp);
        let middle = far_px.get(far_px.len() / 2).copied().unwrap_or_default();
        // One marker beside a damage may be anywhere.
        let max_px = far_px
            .get(far_px.len().saturating_sub(3))
            .copied()
            .unwrap_or_default();
        (!has_picture || energy < UNTOUCHED_ENERGY) && middle < limits[0] && max_px < limits[1]
    }

    /// The taxels in which the newest imprint shows contact; `None` without a picture at rest.
    #[must_use]
    pub fn touched(&self) -> Option<[bool; TAXELS]> {
        if self.rest.kind() == RestKind::Grid {
            return None;
        }
        let [columns, rows] = self.sensor.taxels.grid;
        let pitch_px = self.sensor.taxels.pitch_mm as f32 / self.mm_per_px;
        let [width, height] = self.finger.tracker().size_px().map(|side| side as f32);
        let energies: [f32; TAXELS] = std::array::from_fn(|taxel| {
            let (column, row) = (taxel % MAP_SIDE, taxel / MAP_SIDE);
            if column >= columns || row >= rows {
                return 0.0;
            }
            let from_middle = |at: usize, of: usize| (at as f32 + 0.5 - 0.5 * of as f32) * pitch_px;
            let centre = [
                0.5 * width + from_middle(column, columns),
                0.5 * height - from_middle(row, rows),
            ];
            self.finger.energy_around(centre, 0.5 * pitch_px)
        });
        let max = energies.iter().copied().fold(0.0, f32::max);
        let limit = TOUCHED_ENERGY.max(TOUCHED_SHARE * max);
        let is_strong = |taxel: usize| energies[taxel] >= limit;
        // A flat face shows only at its edge, so what lies beside a touched taxel counts too.
        Some(std::array::from_fn(|taxel| {
            let (column, row) = (taxel % MAP_SIDE, taxel / MAP_SIDE);
            let near = |at: usize| at.saturating_sub(1)..(at + 2).min(MAP_SIDE);
            near(row).any(|row| near(column).any(|column| is_strong(row * MAP_SIDE + column)))
        }))
    }
}

/// Numbers in rising order as spans, the last of each not among them: 3..6, 9..10.
fn spans(numbers: &[usize]) -> String {
    let spans: Vec<String> = numbers
        .chunk_by(|before, after| before + 1 == *after)
        .map(|span| format!("{}..{}", span[0], span[span.len() - 1] + 1))
        .collect();
    spans.join(", ")
}

const fn health_of(doubt: Doubt) -> Health {
    match doubt {
        Doubt::TooDark => Health::TOO_DARK,
        Doubt::TooBright => Health::TOO_BRIGHT,
        Doubt::MarkersLost => Health::PARTICLES_LOST,
    }
}

/// Evidence of the imprint in the map's head.
fn motion_of(evidence: &Evidence) -> Motion {
    let slip = evidence.slip.clamp(0.0, 1.0);
    let share = EVIDENCE
        .windows(2)
        .find(|pair| slip <= pair[1][0])
        .map_or(1.0, |pair| {
            let [[from, low], [to, high]] = [pair[0], pair[1]];
            low + (high - low) * (slip - from) / (to - from)
        });
    // The regular grid (0.5) never decides by itself, pictures of other days (0.7) and own ones do.
    let quality = QUALITY_FROM
        .iter()
        .filter(|from| evidence.quality >= **from)
        .count();
    Motion::new(
        (share * f32::from(Motion::EVIDENCE_MAX)).round() as u8,
        quality as u8,
    )
}

/// Fingerprint of a model: its output for synthetic motions, as text. It differs with other weights or another gel.
#[must_use]
pub fn fingerprint(forces: &MarkerForces) -> String {
    let mut forces = forces.clone();
    let place = |marker: u8| {
        [
            2.0 * (f32::from(marker % 8) - 3.5),
            2.0 * (f32::from(marker / 8) - 2.5),
        ]
    };
    let places: Vec<[f32; 2]> = (0..48).map(place).collect();
    forces.set_rest(&places);
    // Pushed outwards from one place and sheared.
    let motions: Vec<MarkerMotion> = places
        .iter()
        .map(|[x, y]| {
            let near = (-0.1 * ((x - 1.0).powi(2) + (y - 0.5).powi(2))).exp();
            MarkerMotion {
                moved_mm: [0.1 * near * (x + 1.0), 0.1 * near * (y - 1.5)],
                is_seen: true,
            }
        })
        .collect();
    let mut newtons = [[0.0; 3]; TAXELS];
    forces.infer(&motions, None, &mut newtons);
    let bytes: Vec<u8> = newtons
        .iter()
        .flatten()
        .flat_map(|force| force.to_le_bytes())
        .collect();
    format!(
        "{:08x}",
        crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes)
    )
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use gripline_simulation::printed::{PrintedBench, UnitRange};

    use super::*;

    fn evidence(slip: f32, quality: f32) -> Motion {
        motion_of(&Evidence {
            slip,
            loss: 0.0,
            energy: 100.0,
            quality,
        })
    }

    #[test]
    fn a_held_imprint_shows_rest_a_lost_one_motion_and_one_at_the_threshold_neither() {
        assert!(evidence(0.15, 1.0).shows_rest() && evidence(0.9, 1.0).shows_motion());
        let half = evidence(0.7, 1.0);
        assert!(!half.shows_rest() && !half.shows_motion());
        let mut before = 0;
        for step in 0..=100_u8 {
            let now = evidence(f32::from(step) / 100.0, 1.0).evidence();
            assert!(now >= before);
            before = now;
        }
        assert_eq!(before, Motion::EVIDENCE_MAX);
    }

    #[test]
    fn only_a_picture_that_is_light_enough_shows_that_the_gel_is_another() {
        let sensor = Sensor::named(Path::new("gelsight-mini")).unwrap();
        let bench = |unit, zoom| {
            let range = UnitRange {
                zoom: [zoom; 2],
                ..UnitRange::of(&sensor)
            };
            PrintedBench::play(&sensor, &range, 0, 1.0, [unit, 1]).unwrap()
        };
        let (same, other) = (bench(7, 1.0), bench(8, 1.3));
        let rest = MarkerRest {
            pictures: same.rest,
            kind: RestKind::Other,
            ..MarkerRest::grid()
        };
        let dark = vec![0; same.pictures[0].len()];
        let after_dark_ones = |picture: &[u8]| {
            let forces = MarkerForces::for_sensor(&sensor, None).unwrap();
            let mut stage = MarkerStage::new(&sensor, forces, &rest, GateKind::default()).unwrap();
            let stored = stage.places_mm();
            let mut newtons = [[0.0; 3]; TAXELS];
            for _ in 0..2 {
                let seen = stage.process(&dark, &mut newtons).unwrap();
                assert_eq!(seen.health, Health::TOO_DARK);
                assert_eq!(stage.places_mm(), stored);
            }
            stage.process(picture, &mut newtons).unwrap();
            (stage.places_mm(), stored)
        };
        let (places, stored) = after_dark_ones(&same.pictures[0]);
        assert_eq!(places, stored);
        let (places, stored) = after_dark_ones(&other.pictures[0]);
        assert_ne!(places, stored);
    }

    #[test]
    fn every_kind_of_rest_is_found_again_in_a_recording() {
        for kind in [RestKind::Own, RestKind::Other, RestKind::Grid] {
            assert_eq!(MarkerRest::recorded(&kind.to_string(), &[]).unwrap().kind, kind);
        }
        let refused = MarkerRest::recorded("", &[]).unwrap_err().to_string();
        assert!(refused.contains("record it again"), "{refused}");
    }

    #[test]
    fn numbers_are_reported_as_the_spans_that_rest_takes() {
        assert_eq!(spans(&[3, 4, 5, 9]), "3..6, 9..10");
        assert_eq!(spans(&[]), "");
    }

    #[test]
    fn the_regular_grid_never_decides_and_an_empty_hand_says_nothing() {
        assert_eq!(evidence(0.9, 0.5).quality(), 1);
        assert_eq!(evidence(0.9, 0.7).quality(), 2);
        assert_eq!(evidence(0.9, 0.95).quality(), 3);
        assert_eq!(evidence(0.9, 0.1), Motion::UNKNOWN);
    }
}
