//! From a picture to a force map in the wire's units: downsample, gate and health, network, contact threshold, quantise. For
//! printed markers, [`markers`](crate::markers) replaces all but the last two. Pure: no camera, no link, no allocation per frame.
//! Units: newtons per taxel in, 1/4096 N out; stage times in microseconds.

use std::borrow::Cow;
use std::ops::RangeInclusive;
use std::time::Instant;

use gripline_firmware::constants::TREND_MAPS;
use gripline_firmware::sums::{TaxelRule, stick_ratio, stick_ratio_below, total_shear};
use gripline_link::shadow::Judgement;
use gripline_network::image::Image88;
use gripline_network::scene::{self, GateDecision, GateKind, Scene};
use gripline_network::{Frame, Network, downsample_440_to_88};
use gripline_protocol::message::{Configuration, MapSums};
use gripline_protocol::{ForceMap, Health, Motion, NotFinite, PER_UNIT, Saturated, TAXELS};

use crate::PipelineError;
use crate::markers::MarkerStage;

/// Pixels of the 440×440 crop.
pub const CROP_PIXELS: usize = 440 * 440;

/// Below this stick ratio, 1/10000, every picture goes through the network, whatever the gate says: INCIPIENT begins at 6,500 by
/// default, and the ratio of a picture that the gate considers unchanged may differ by up to 2,100 (`gripline evaluate skip`).
const SURE_STICK_RATIO: u16 = 9_000;

/// So it does while the strongest taxel carries this many times the contact threshold: whether anything touches may differ between
/// pictures that the gate considers unchanged.
const UNSURE_CONTACT: RangeInclusive<f32> = 0.4..=4.0;

/// So many times, and the network takes nothing for noise in any picture: whether anything touches depends on a few percent.
const CLOSE_CONTACT: RangeInclusive<f32> = 0.7..=1.5;

/// Below this stick ratio, 1/10000, the network takes nothing for noise in any picture: one taxel of a contact of seventeen above
/// the 6,500 at which INCIPIENT begins.
const CLOSE_STICK_RATIO: u16 = 7_100;

/// So it does while the stick ratio falls so fast that it would be at the threshold of SLIP within so many maps: the detector's
/// window three times, and four times its horizon of 100 ms at 60 maps a second.
const FALLING_MAPS: u32 = 3 * TREND_MAPS as u32;

/// Taxels of a sheared contact whose slip decision may differ between pictures that the gate considers unchanged, beside what the ratio
/// says: in a contact of ten, two of them are all between sticking and [`SURE_STICK_RATIO`].
const UNSURE_TAXELS: u16 = 2;

/// From there to [`SURE_STICK_RATIO`], and at an unsure contact, it takes nothing for noise when the gate sees a change, and in every
/// fifth picture otherwise: after 83 ms at 60 frames a second, at a fifth of the cost of a whole frame.
const UNSURE_REFRESH: u32 = 5;

/// A picture's force map.
#[derive(Debug, Clone, Copy)]
pub struct Processed<'a> {
    /// The map in the wire's units.
    pub map: &'a ForceMap,
    /// The detector's sums of the map.
    pub judgement: Judgement,
    /// What the scene gate decided.
    pub gate: GateDecision,
    /// Doubts about this map.
    pub health: Health,
    /// Whether the object moves, if the sensor can show it.
    pub motion: Option<Motion>,
    /// Time for downsampling, gate, and network with quantisation (0 when the gate skipped it).
    pub stages_us: [f64; 3],
}

/// The stages from picture to map.
#[derive(Debug)]
pub struct Pipeline {
    stage: Stage,
    contact_min_n: f32,
    judgement: Judgement,
    /// Output of the network, plausible or not.
    output: Box<[[f32; 3]; TAXELS]>,
    /// From the last plausible picture: forces, and their map.
    newtons: Box<[[f32; 3]; TAXELS]>,
    map: Box<ForceMap>,
    saturated: Saturated,
}

/// The stage that processes the pictures.
#[derive(Debug)]
enum Stage {
    Particles(Box<ParticleStage>),
    Markers(Box<MarkerStage>),
}

/// Scene gate and network of a fingertip with particles.
#[derive(Debug)]
struct ParticleStage {
    network: Network,
    scene: Scene,
    now: Box<Image88>,
    /// Set while a picture that the gate takes for unchanged may be decided otherwise. The network then sees all pictures, and takes
    /// nothing for noise in one of so many of them.
    unsure: Option<u32>,
    ratios: RecentRatios,
    /// Pictures since the network last took nothing for noise.
    since_refresh: u32,
    /// Whether the network has not seen the last picture.
    skipped: bool,
}

/// Stick ratios of the last maps, 1/10000, the newest last.
#[derive(Debug, Default)]
struct RecentRatios {
    ratios: [u16; TREND_MAPS],
    filled: usize,
}

impl RecentRatios {
    /// `None` is a map without contact: what comes behind it is another contact.
    fn push(&mut self, ratio: Option<u16>) {
        let Some(ratio) = ratio else {
            self.filled = 0;
            return;
        };
        self.ratios.rotate_left(1);
        self.ratios[TREND_MAPS - 1] = ratio;
        self.filled = TREND_MAPS.min(self.filled + 1);
    }

    /// Whether the newer half lies so far below the older one that the ratio comes to the threshold of SLIP within [`FALLING_MAPS`].
    fn are_falling(&self) -> bool {
        const HALF: usize = TREND_MAPS / 2;
        let sum = |ratios: &[u16]| ratios.iter().map(|ratio| u32::from(*ratio)).sum::<u32>();
        let (older, newer) = self.ratios.split_at(HALF);
        let (fall, now) = (sum(older).saturating_sub(sum(newer)), self.ratios[TREND_MAPS - 1]);
        let left = u32::from(now.saturating_sub(Configuration::DEFAULT.slip_threshold));
        // The means of the halves lie HALF maps apart, and each is a sum over HALF.
        self.filled == TREND_MAPS && fall > 0 && left * (HALF * HALF) as u32 <= fall * FALLING_MAPS
    }
}

// Both sides number the picture's flags alike.
const _: () = assert!(
    Health::TOO_DARK.bits() == scene::Health::TOO_DARK.bits()
        && Health::TOO_BRIGHT.bits() == scene::Health::TOO_BRIGHT.bits()
        && Health::UNLIKE_TRAINING.bits() == scene::Health::UNLIKE_TRAINING.bits()
        && Health::PARTICLES_LOST.bits() == scene::Health::PARTICLES_LOST.bits()
);

impl Pipeline {
    /// `rest` are crops without contact, at least one; their mean is the network's reference. `rule` is the detector's.
    ///
    /// # Panics
    /// When `rest` is empty or a crop is not 440×440: the sources of pictures see to both.
    #[must_use]
    pub fn new(mut network: Network, rest: &[Vec<u8>], gate: GateKind, rule: TaxelRule) -> Self {
        assert!(!rest.is_empty(), "the pipeline needs a picture at rest");
        let frames: Vec<Image88> = rest.iter().map(|crop| small(crop)).collect();
        let count = rest.len() as u32;
        let crop: Vec<u8> = (0..CROP_PIXELS)
            .map(|pixel| {
                let sum: u32 = rest.iter().map(|crop| u32::from(crop[pixel])).sum();
                ((sum + count / 2) / count) as u8
            })
            .collect();
        network.set_rest(&crop);
        let mean = small(&crop);
        let contact_min_n = network.calibration().contact_min_n;
        let stage = ParticleStage {
            network,
            scene: Scene::new(gate, &mean, &frames),
            now: Box::new(mean),
            unsure: None,
            ratios: RecentRatios::default(),
            since_refresh: 0,
            skipped: false,
        };
        Self::of(Stage::Particles(Box::new(stage)), contact_min_n, rule)
    }

    /// For a fingertip with printed markers. `rule` is the detector's.
    #[must_use]
    pub fn of_markers(stage: MarkerStage, rule: TaxelRule) -> Self {
        let contact_min_n = stage.contact_min_n();
        Self::of(Stage::Markers(Box::new(stage)), contact_min_n, rule)
    }

    fn of(stage: Stage, contact_min_n: f32, rule: TaxelRule) -> Self {
        Self {
            stage,
            contact_min_n,
            judgement: Judgement::of(&ForceMap::EMPTY, rule),
            output: Box::new([[0.0; 3]; TAXELS]),
            newtons: Box::new([[0.0; 3]; TAXELS]),
            map: Box::new(ForceMap::EMPTY),
            saturated: Saturated(0),
        }
    }

    /// The last map in newtons per taxel, for the view.
    #[must_use]
    pub fn newtons(&self) -> &[[f32; 3]; TAXELS] {
        &self.newtons
    }

    /// The last map in the wire's units.
    #[must_use]
    pub fn map(&self) -> &ForceMap {
        &self.map
    }

    /// The last picture at 88×88; `None` for a sensor with printed markers.
    #[must_use]
    pub fn small(&self) -> Option<&Image88> {
        match &self.stage {
            Stage::Particles(stage) => Some(&stage.now),
            Stage::Markers(_) => None,
        }
    }

    /// The stage for printed markers, if the sensor has them.
    #[must_use]
    pub fn markers(&self) -> Option<&MarkerStage> {
        match &self.stage {
            Stage::Particles(_) => None,
            Stage::Markers(stage) => Some(stage),
        }
    }

    /// Columns and rows of the crop.
    #[must_use]
    pub fn crop_px(&self) -> [usize; 2] {
        match &self.stage {
            Stage::Particles(_) => [440, 440],
            Stage::Markers(stage) => stage.size_px(),
        }
    }

    /// A crop as a square of grey levels, for the page: that of printed markers gets black bars above and below.
    #[must_use]
    pub fn square<'a>(&self, crop: &'a [u8]) -> Cow<'a, [u8]> {
        let [width, height] = self.crop_px();
        if crop.len() == width * height {
            return crop.into();
        }
        // An even side: the page shows every second pixel.
        let side = width.max(height).next_multiple_of(2);
        let [left, top] = [(side - width) / 2, (side - height) / 2];
        let mut square = vec![0; side * side];
        for (row, pixels) in crop.chunks_exact(3 * width).enumerate() {
            let to = &mut square[(top + row) * side + left..][..width];
            for (to, rgb) in to.iter_mut().zip(pixels.as_chunks::<3>().0) {
                *to = (rgb.iter().map(|level| u16::from(*level)).sum::<u16>() / 3) as u8;
            }
        }
        square.into()
    }

    /// Turns a crop into a force map: 440×440 grey levels of particles, the sensor's crop in colour of printed markers.
    ///
    /// A doubtful picture, or a doubtful output of the network, gives the last good map again, marked by its health: forces from
    /// such a picture would look real, and an empty map would look like a lost contact. The next contact picture then goes through
    /// the network, independent of the gate.
    ///
    /// # Errors
    /// [`PipelineError`] when the network's output is not a number (the last good map is kept), or the first picture shows no markers.
    pub fn process(&mut self, crop: &[u8]) -> Result<Processed<'_>, PipelineError> {
        let (gate, doubt, motion, stages_us) = match &mut self.stage {
            Stage::Particles(stage) => {
                let (gate, doubt, stages_us) = stage.process(crop, &mut self.output);
                (gate, Health::from_bits(doubt.bits()), None, stages_us)
            }
            Stage::Markers(stage) => {
                let seen = stage.process(crop, &mut self.output)?;
                (seen.gate, seen.health, Some(seen.motion), seen.stages_us)
            }
        };
        let accepting = Instant::now();
        match gate {
            GateDecision::NoContact => {
                *self.map = ForceMap::EMPTY;
                *self.newtons = [[0.0; 3]; TAXELS];
                self.saturated = Saturated(0);
                self.judgement = Judgement::of(&self.map, self.judgement.rule);
            }
            GateDecision::Infer if doubt.is_good() => self.accept_output()?,
            GateDecision::Infer | GateDecision::Unhealthy => self.compare_afresh(),
            GateDecision::Unchanged => {
                if let Stage::Particles(stage) = &mut self.stage {
                    stage.ratios.push(stick_ratio(&self.judgement.sums));
                }
            }
        }
        let [downsample_us, gate_us, mut network_us] = stages_us;
        if gate == GateDecision::Infer {
            network_us += accepting.elapsed().as_secs_f64() * 1e6;
        }
        Ok(Processed {
            map: &self.map,
            judgement: self.judgement,
            gate,
            health: doubt.with(if self.saturated.0 > 0 {
                Health::SATURATED
            } else {
                Health::GOOD
            }),
            motion,
            stages_us: [downsample_us, gate_us, network_us],
        })
    }

    /// Converts the network's output to the map.
    fn accept_output(&mut self) -> Result<(), NotFinite> {
        let strongest_n = self.output.iter().fold(0.0_f32, |most, force| most.max(force[2]));
        drop_untouched(&mut self.output, self.contact_min_n);
        let quantised = ForceMap::quantise(&self.output).inspect_err(|_| self.compare_afresh())?;
        (*self.map, self.saturated) = quantised;
        *self.newtons = *self.output;
        self.judgement = Judgement::of(&self.map, self.judgement.rule);
        // Markers are looked at in every picture.
        if let Stage::Particles(stage) = &mut self.stage {
            let sums = &self.judgement.sums;
            stage.ratios.push(stick_ratio(sums));
            let unsure_taxels = if is_sheared(sums, self.judgement.rule) {
                UNSURE_TAXELS
            } else {
                0
            };
            let fewer_stick = MapSums {
                stick: sums.stick.saturating_sub(unsure_taxels),
                ..*sums
            };
            let contact = strongest_n / self.contact_min_n;
            let is_close = CLOSE_CONTACT.contains(&contact)
                || stick_ratio_below(sums, CLOSE_STICK_RATIO)
                || stick_ratio_below(&fewer_stick, Configuration::DEFAULT.incipient_threshold);
            stage.unsure = if is_close || stage.ratios.are_falling() {
                Some(1)
            } else if stick_ratio_below(&fewer_stick, SURE_STICK_RATIO) || UNSURE_CONTACT.contains(&contact) {
                Some(UNSURE_REFRESH)
            } else {
                None
            };
        }
        Ok(())
    }

    /// Forces inference on the next contact picture, as if it were the first.
    fn compare_afresh(&mut self) {
        if let Stage::Particles(stage) = &mut self.stage {
            stage.scene.force_inference();
            stage.skipped = true;
        }
    }
}

impl ParticleStage {
    /// The gate's decision, the doubts, and the times of downsampling, gate and network (0 when the gate skipped it).
    fn process(
        &mut self,
        crop: &[u8],
        output: &mut [[f32; 3]; TAXELS],
    ) -> (GateDecision, scene::Health, [f64; 3]) {
        let start = Instant::now();
        let frame = Frame::new(crop, &mut self.now);
        let downsampled = Instant::now();
        let (mut gate, mut doubt) = self.scene.decide(frame.small());
        let has_changed = gate == GateDecision::Infer;
        if gate == GateDecision::Unchanged && self.unsure.is_some() {
            gate = GateDecision::Infer;
        }
        let gated = Instant::now();
        let us = |from: Instant, to: Instant| (to - from).as_secs_f64() * 1e6;
        let mut network_us = 0.0;
        if gate == GateDecision::Infer {
            // What the network has not seen may differ everywhere by less than the noise.
            self.since_refresh += 1;
            let is_due = |pictures| has_changed || self.since_refresh >= pictures;
            if self.skipped || self.unsure.is_some_and(is_due) {
                self.network.refresh_next();
                self.since_refresh = 0;
            }
            self.network.infer_frame(frame, output);
            doubt = self.network.health();
            network_us = us(gated, Instant::now());
        }
        self.skipped = gate != GateDecision::Infer;
        (
            gate,
            doubt,
            [us(start, downsampled), us(downsampled, gated), network_us],
        )
    }
}

/// Whether the whole contact carries a tenth of the shear at which all of it slips by the detector's friction, or more.
fn is_sheared(sums: &MapSums, rule: TaxelRule) -> bool {
    let limit = i64::from(sums.force[2]) * i64::from(rule.friction.per_unit()) / i64::from(PER_UNIT);
    10 * i64::from(total_shear(sums)) >= limit
}

/// Fingerprint of a network: its output for a synthetic picture, as text. It differs with other weights. `rest` is a 440×440 crop.
#[must_use]
pub fn fingerprint(network: &Network, rest: &[u8]) -> String {
    let mut network = network.clone();
    network.set_rest(rest);
    // Dents of many widths: the rest picture, moved by up to three pixels along its rows.
    let moved: Vec<u8> = (0..CROP_PIXELS)
        .map(|pixel| rest[(pixel + pixel / 440 % 4).min(CROP_PIXELS - 1)])
        .collect();
    let mut newtons = [[0.0; 3]; TAXELS];
    network.infer(&moved, &mut newtons);
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

fn small(crop: &[u8]) -> Image88 {
    assert_eq!(crop.len(), CROP_PIXELS, "a crop has 440×440 pixels");
    let mut out = [0; 88 * 88];
    downsample_440_to_88(crop, &mut out);
    out
}

/// Removes the force from taxels below the contact threshold: a smooth prediction has small values everywhere, which would count as
/// contact and would have to be sent.
fn drop_untouched(newtons: &mut [[f32; 3]; TAXELS], contact_min_n: f32) {
    for force in newtons.iter_mut().filter(|force| force[2] <= contact_min_n) {
        *force = [0.0; 3];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn are_falling(ratios: &[u16]) -> bool {
        let mut recent = RecentRatios::default();
        for ratio in ratios {
            recent.push(Some(*ratio));
        }
        recent.are_falling()
    }

    #[test]
    fn a_ratio_that_comes_to_slip_within_a_few_windows_falls() {
        // 0.03 a map: SLIP after another 9 of them.
        let steep: Vec<u16> = (0..8).map(|map| 10_000 - 300 * map).collect();
        assert!(are_falling(&steep));
        // 0.01 a map: after another 43.
        let flat: Vec<u16> = (0..8).map(|map| 10_000 - 100 * map).collect();
        assert!(!are_falling(&flat));
        assert!(are_falling(
            &flat.iter().map(|ratio| ratio - 2_500).collect::<Vec<_>>()
        ));
        // One taxel of 24 that flickers, a steady ratio, and one that rises.
        assert!(!are_falling(&[
            8_333, 7_917, 8_333, 7_917, 7_917, 8_333, 7_917, 7_917
        ]));
        assert!(!are_falling(&[5_000; 8]));
        assert!(!are_falling(&steep.iter().rev().copied().collect::<Vec<_>>()));
    }

    #[test]
    fn another_contact_begins_another_window() {
        let mut recent = RecentRatios::default();
        for map in 0..8 {
            recent.push(Some(10_000 - 600 * map));
        }
        assert!(recent.are_falling());
        recent.push(None);
        for map in 0..7 {
            recent.push(Some(9_000 - 500 * map));
            assert!(!recent.are_falling(), "after {map} maps");
        }
        recent.push(Some(5_500));
        assert!(recent.are_falling());
    }
}
