//! From a picture to a force map in the wire's units: downsample, gate and health, network, contact threshold, quantise. For
//! printed markers, [`markers`](crate::markers) replaces all but the last two. Pure: no camera, no link, no allocation per frame.
//! Units: newtons per taxel in, 1/4096 N out; stage times in microseconds. Limits that say what the network takes for noise are
//! about `Evaluation::SkipNoise`, which only benchmarks choose: with `Evaluation::Skip`, which ships, it takes nothing for noise,
//! and they only decide which pictures go through it.

use std::borrow::Cow;
use std::ops::RangeInclusive;
use std::time::Instant;

use gripline_firmware::constants::TREND_MAPS;
use gripline_firmware::slip::SlipDetector;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below};
use gripline_firmware::{DeviceMicros, Friction, HostMicros};
use gripline_link::shadow::Judgement;
use gripline_network::image::Image88;
use gripline_network::scene::{self, GateDecision, GateKind, Scene};
use gripline_network::{Frame, Network, downsample_440_to_88};
use gripline_protocol::message::{Configuration, MapSums};
use gripline_protocol::{ForceMap, Health, Motion, NotFinite, Saturated, TAXELS};

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

/// From there to [`SURE_STICK_RATIO`], and at an unsure contact, it takes nothing for noise when the gate sees a change, and in every
/// fifth picture otherwise: after 83 ms at 60 frames a second, at a fifth of the cost of a whole frame.
const UNSURE_REFRESH: u32 = 5;

/// While the stick ratio falls so fast that it would be at the threshold of SLIP within fewer maps, the network takes nothing for noise
/// either: what it overlooked would make a slow fall a step, which the detector's trend takes for a fast one. Its window three times,
/// and at 60 maps a second four times its horizon of 100 ms.
const FALLING_MAPS: u16 = 3 * TREND_MAPS as u16;

/// While a component of the force changes by more than one of so many parts of the normal force from map to map, the network takes nothing
/// for noise either: most of the picture moves, and what it overlooked would stay in the detector's trend, and in how the contact's reach
/// and load grew, by which it tells contacts apart. At 60 maps a second that is a change of the whole in 1.7 s.
const CHANGING_PART: i32 = 100;
/// Smallest such change, in the wire's 1/4096 N: 10 mN, a third of what a taxel needs to count as contact. Without it a minute of light
/// touches costs 0.54 instead of 0.51, with the same decisions (`evaluate skip --only "light touches"`, one picture at rest).
const CHANGING_MIN: i32 = 41;

/// Taxels of a sheared contact whose slip decision may differ between pictures that the gate considers unchanged, whatever the ratio:
/// in a contact of ten, two of them are all between sticking and [`SURE_STICK_RATIO`].
const UNSURE_TAXELS: u16 = 2;

/// A contact counts as sheared from one of so many parts of the shear at which all of it would slip by the detector's friction.
const SHEARED_PART: u16 = 10;

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
    /// The detector with the settings that ship, for its trend: it is told of a map every millisecond, so its milliseconds are maps.
    detector: SlipDetector,
    maps: u32,
    /// In how many maps SLIP would begin, while the stick ratio falls.
    maps_to_slip: Option<u16>,
    /// The total force of the last map, 1/4096 N, and whether it had changed much.
    force: [i32; 3],
    is_changing: bool,
    /// Pictures since the network last took nothing for noise.
    since_refresh: u32,
    /// Whether the network has not seen the last picture.
    skipped: bool,
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
        network.learn_noise(rest);
        let mean = small(&crop);
        let contact_min_n = network.calibration().contact_min_n;
        let stage = ParticleStage {
            network,
            scene: Scene::new(gate, &mean, &frames),
            now: Box::new(mean),
            unsure: None,
            detector: SlipDetector::new(),
            maps: 0,
            maps_to_slip: None,
            force: [0; 3],
            is_changing: false,
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
                self.follow();
            }
            GateDecision::Infer if doubt.is_good() => self.accept_output()?,
            GateDecision::Infer | GateDecision::Unhealthy => self.compare_afresh(),
            GateDecision::Unchanged => self.follow(),
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
        let strongest_n = self.output.iter().fold(0.0_f32, |max, force| max.max(force[2]));
        drop_untouched(&mut self.output, self.contact_min_n);
        let quantised = ForceMap::quantise(&self.output).inspect_err(|_| self.compare_afresh())?;
        (*self.map, self.saturated) = quantised;
        *self.newtons = *self.output;
        self.judgement = Judgement::of(&self.map, self.judgement.rule);
        self.follow();
        // Markers are looked at in every picture.
        if let Stage::Particles(stage) = &mut self.stage {
            stage.unsure = stage.refresh_every(&self.judgement, strongest_n / self.contact_min_n);
        }
        Ok(())
    }

    /// Tells the detector of the map, as of every one that is sent and not doubtful.
    fn follow(&mut self) {
        if let Stage::Particles(stage) = &mut self.stage {
            stage.maps = stage.maps.wrapping_add(1);
            let at = u64::from(stage.maps) * 1_000;
            let decision = stage.detector.update(
                &self.judgement.sums,
                HostMicros(at as u32),
                DeviceMicros(at),
                &Configuration::DEFAULT,
            );
            stage.maps_to_slip = decision.time_to_slip_ms;
            let force = self.judgement.sums.force;
            let least = (force[2] / CHANGING_PART).max(CHANGING_MIN);
            let mut changes = stage
                .force
                .iter()
                .zip(&force)
                .map(|(before, now)| (now - before).abs());
            stage.is_changing = changes.any(|change| change > least);
            stage.force = force;
        }
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
    /// Whether a picture that the gate takes for unchanged after this map may be decided otherwise ([`Self::unsure`]). `contact` is the
    /// strongest taxel's normal force over the contact threshold.
    fn refresh_every(&self, judgement: &Judgement, contact: f32) -> Option<u32> {
        let Judgement { rule, sums } = judgement;
        let [x, y, normal] = sums.force;
        let part = Friction::clamped(rule.friction.per_unit() / SHEARED_PART);
        let is_sheared = part.exceeded_by([x, y], normal);
        let unsure_taxels = if is_sheared { UNSURE_TAXELS } else { 0 };
        let fewer_stick = MapSums {
            stick: sums.stick.saturating_sub(unsure_taxels),
            ..*sums
        };
        let is_close = CLOSE_CONTACT.contains(&contact)
            || stick_ratio_below(sums, CLOSE_STICK_RATIO)
            || stick_ratio_below(&fewer_stick, Configuration::DEFAULT.incipient_threshold)
            || self.is_changing
            || self.maps_to_slip.is_some_and(|maps| maps < FALLING_MAPS);
        if is_close {
            Some(1)
        } else if stick_ratio_below(&fewer_stick, SURE_STICK_RATIO) || UNSURE_CONTACT.contains(&contact) {
            Some(UNSURE_REFRESH)
        } else {
            None
        }
    }

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
            self.scene.set_processed(frame.small());
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
    use gripline_network::Architecture;
    use gripline_simulation::{Fingertip, FingertipParams};

    use super::*;
    use crate::settings_for;

    /// Pictures without contact, each with noise of its own.
    fn rest(pictures: usize) -> Vec<Vec<u8>> {
        let mut fingertip = Fingertip::new(1, FingertipParams::default()).unwrap();
        (0..pictures).map(|_| fingertip.rest_image().pixels).collect()
    }

    fn pipeline() -> Pipeline {
        let network = Network::embedded(Architecture::default()).unwrap();
        let rule = TaxelRule::of(&settings_for(&network));
        Pipeline::new(network, &rest(8), GateKind::default(), rule)
    }

    /// Taxels in contact, those that stick, and total shear and normal force, 1/4096 N.
    fn judgement(contact: u16, stick: u16, shear: i32, normal: i32) -> Judgement {
        let rule = TaxelRule::of(&Configuration::DEFAULT);
        let sums = MapSums {
            contact,
            stick,
            force: [shear, 0, normal],
            ..MapSums::default()
        };
        Judgement { rule, sums }
    }

    fn stage(pipeline: &mut Pipeline) -> &mut ParticleStage {
        match &mut pipeline.stage {
            Stage::Particles(stage) => stage,
            Stage::Markers(_) => panic!("a fingertip with particles"),
        }
    }

    /// How often the network looks afresh after maps of these ratios, 1/100, of a contact of a hundred taxels.
    fn after(ratios: &[u16]) -> Option<u32> {
        let mut pipeline = pipeline();
        for ratio in ratios {
            pipeline.judgement = judgement(100, *ratio, 0, 40_000);
            pipeline.follow();
        }
        let judgement = pipeline.judgement;
        stage(&mut pipeline).refresh_every(&judgement, 10.0)
    }

    #[test]
    fn while_the_stick_ratio_falls_nothing_is_noise() {
        // SLIP after another nine maps; after another 43; after another 18.
        assert_eq!(after(&[100, 97, 94, 91, 88, 85, 82, 79]), Some(1));
        assert_eq!(after(&[100, 99, 98, 97, 96, 95, 94, 93]), None);
        assert_eq!(after(&[80, 79, 78, 77, 76, 75, 74, 73]), Some(1));
        // It flickers, stays, rises.
        assert_eq!(after(&[92, 95, 92, 95, 95, 92, 95, 95]), None);
        assert_eq!(after(&[80; 20]), Some(UNSURE_REFRESH));
        assert_eq!(after(&[79, 82, 85, 88, 91, 94, 97, 100]), None);
    }

    #[test]
    fn while_the_force_changes_nothing_is_noise() {
        let mut pipeline = pipeline();
        let mut after = |shear, normal| {
            pipeline.judgement = judgement(100, 100, shear, normal);
            pipeline.follow();
            let judgement = pipeline.judgement;
            stage(&mut pipeline).refresh_every(&judgement, 10.0)
        };
        assert_eq!(after(0, 40_000), Some(1), "from nothing");
        assert_eq!(after(0, 40_000), None);
        assert_eq!(after(390, 40_390), None);
        assert_eq!(after(0, 40_800), Some(1), "pressed");
        assert_eq!(after(0, 40_300), Some(1), "let go");
        assert_eq!(after(-410, 40_300), Some(1), "pulled");
        assert_eq!(after(-410, 40_300), None);
        after(0, 200);
        assert_eq!([after(0, 241), after(0, 200)], [None; 2], "a light touch");
        assert_eq!(after(0, 242), Some(1), "a light touch that is pressed");
    }

    #[test]
    fn two_taxels_of_a_small_contact_decide_only_where_it_is_sheared() {
        let mut pipeline = pipeline();
        let mut of = |contact, stick, shear| {
            stage(&mut pipeline).refresh_every(&judgement(contact, stick, shear, 4_096), 10.0)
        };
        assert_eq!([of(10, 10, 0), of(10, 10, 1_000)], [None, Some(UNSURE_REFRESH)]);
        assert_eq!(
            [of(14, 11, 0), of(14, 11, 1_000)],
            [Some(UNSURE_REFRESH), Some(1)]
        );
        assert_eq!([of(40, 40, 0), of(40, 40, 1_000)], [None; 2]);
        assert_eq!([of(2, 2, 0), of(2, 2, 1_000)], [None, Some(1)]);
    }

    #[test]
    fn where_a_touch_begins_or_ends_nothing_is_noise() {
        let mut pipeline = pipeline();
        let mut of = |contact| stage(&mut pipeline).refresh_every(&judgement(0, 0, 0, 0), contact);
        let every = Some(UNSURE_REFRESH);
        assert_eq!([0.1, 0.5, 0.9, 1.2].map(&mut of), [None, every, Some(1), Some(1)]);
        assert_eq!([2.0, 3.9, 4.1].map(&mut of), [every, every, None]);
    }

    #[test]
    fn a_picture_without_contact_ends_the_trend() {
        let mut pipeline = pipeline();
        for ratio in [100, 97, 94, 91, 88, 85, 82, 79] {
            pipeline.judgement = judgement(100, ratio, 0, 40_000);
            pipeline.follow();
        }
        assert!(stage(&mut pipeline).maps_to_slip.is_some());
        let gate = pipeline.process(&rest(9)[8]).unwrap().gate;
        assert_eq!(gate, GateDecision::NoContact);
        assert_eq!(stage(&mut pipeline).maps_to_slip, None);
        pipeline.judgement = judgement(100, 76, 0, 40_000);
        pipeline.follow();
        assert_eq!(stage(&mut pipeline).maps_to_slip, None, "another contact");
    }

    /// A picture at rest whose middle is moved by so many pixels along its rows, as under an indenter.
    fn moved(rest: &[u8], shift_px: f32) -> Vec<u8> {
        (0..CROP_PIXELS)
            .map(|pixel| {
                let [x, y] = [pixel % 440, pixel / 440].map(|at| at as f32);
                let away = (x - 220.0).hypot(y - 220.0) / 60.0;
                let from = (x - shift_px * (-away * away).exp()).clamp(0.0, 438.9);
                let [left, part] = [from.floor(), from.fract()];
                let at = pixel / 440 * 440 + left as usize;
                let level = (1.0 - part) * f32::from(rest[at]) + part * f32::from(rest[at + 1]);
                level.round() as u8
            })
            .collect()
    }

    #[test]
    fn the_gate_compares_with_the_picture_that_the_map_came_from() {
        let rest = rest(9);
        let network = Network::embedded(Architecture::default()).unwrap();
        let rule = TaxelRule::of(&settings_for(&network));
        let new = || Pipeline::new(network.clone(), &rest[..8], GateKind::default(), rule);
        let shown = |pipeline: &mut Pipeline, shift_px| {
            let processed = pipeline.process(&moved(&rest[8], shift_px)).unwrap();
            assert_eq!(processed.health, Health::GOOD, "{shift_px} pixels");
            processed.gate
        };
        let touch_px = 4.0;
        let mut pipeline = new();
        let changes = |pipeline: &mut Pipeline, by_px: f32| {
            pipeline.compare_afresh();
            shown(pipeline, touch_px);
            stage(pipeline).unsure = None;
            shown(pipeline, touch_px + by_px) == GateDecision::Infer
        };
        let mut steps = (1..100_u8).map(|step| 0.02 * f32::from(step));
        let least_px = steps.find(|by_px| changes(&mut pipeline, *by_px) && changes(&mut pipeline, -by_px));
        let least_px = least_px.unwrap();
        println!("{least_px} pixels are a change");

        let mut pipeline = new();
        assert_eq!(shown(&mut pipeline, touch_px), GateDecision::Infer);
        stage(&mut pipeline).unsure = Some(1);
        assert_eq!(
            shown(&mut pipeline, touch_px + 0.8 * least_px),
            GateDecision::Infer
        );
        stage(&mut pipeline).unsure = None;
        assert_eq!(
            shown(&mut pipeline, touch_px - 0.8 * least_px),
            GateDecision::Infer
        );
    }
}
