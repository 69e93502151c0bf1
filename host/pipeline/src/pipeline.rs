//! From a picture to a force map in the wire's units: downsample, gate and health, network, contact threshold, quantise.
//! Pure: no camera, no link, no allocation per frame.
//! Units: newtons per taxel in, 1/4096 N out; stage times in microseconds.

use std::time::Instant;

use gripline_firmware::sums::{TaxelRule, stick_ratio_below};
use gripline_link::shadow::Judgement;
use gripline_network::image::Image88;
use gripline_network::scene::{self, GateDecision, GateKind, Scene};
use gripline_network::{Frame, Network, downsample_440_to_88};
use gripline_protocol::{ForceMap, Health, NotFinite, Saturated, TAXELS};

/// Pixels of the 440×440 crop.
pub const CROP_PIXELS: usize = 440 * 440;

/// Below this stick ratio, 1/10000, every picture goes through the network, whatever the gate says: INCIPIENT begins at
/// 6,500 as shipped, and what the gate takes for unchanged moves the ratio by up to 1,900 (`cargo xtask bench gate`).
const SURE_STICK_RATIO: u16 = 8_500;

/// A picture's force map.
#[derive(Debug, Clone, Copy)]
pub struct Processed<'a> {
    /// The map as it travels.
    pub map: &'a ForceMap,
    /// The detector's sums of the map.
    pub judgement: Judgement,
    /// What the scene gate decided.
    pub gate: GateDecision,
    /// What is known against this map.
    pub health: Health,
    /// Time for downsampling, gate, and network with quantisation (0 when the gate skipped it).
    pub stages_us: [f64; 3],
}

/// The stages from picture to map.
#[derive(Debug)]
pub struct Pipeline {
    network: Network,
    scene: Scene,
    contact_min_n: f32,
    judgement: Judgement,
    now: Box<Image88>,
    /// Output of the network, believed or not.
    output: Box<[[f32; 3]; TAXELS]>,
    /// Of the last picture that could be believed: forces, and the map that they make.
    newtons: Box<[[f32; 3]; TAXELS]>,
    map: Box<ForceMap>,
    saturated: Saturated,
}

// Both sides number the picture's flags alike.
const _: () = assert!(
    Health::TOO_DARK.bits() == scene::Health::TOO_DARK.bits()
        && Health::TOO_BRIGHT.bits() == scene::Health::TOO_BRIGHT.bits()
        && Health::UNLIKE_TRAINING.bits() == scene::Health::UNLIKE_TRAINING.bits()
        && Health::PARTICLES_LOST.bits() == scene::Health::PARTICLES_LOST.bits()
);

impl Pipeline {
    /// `rest` are crops without contact, at least one; their mean is what the network compares with. `rule` is the
    /// detector's.
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
        Self {
            network,
            scene: Scene::new(gate, &mean, &frames),
            contact_min_n,
            judgement: Judgement::of(&ForceMap::EMPTY, rule),
            now: Box::new(mean),
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

    /// The last map as it travels.
    #[must_use]
    pub fn map(&self) -> &ForceMap {
        &self.map
    }

    /// The last picture at 88×88.
    #[must_use]
    pub fn small(&self) -> &Image88 {
        &self.now
    }

    /// Turns a 440×440 crop into a force map.
    ///
    /// A doubtful picture, or a doubtful output of the network, gives the last good map again, marked by its health: forces from
    /// such a picture would look real, and an empty map would look like a lost contact. The next contact picture then goes
    /// through the network, whatever the gate compares it with.
    ///
    /// # Errors
    /// [`NotFinite`] when the network's output is not a number; the last good map is kept.
    pub fn process(&mut self, crop: &[u8]) -> Result<Processed<'_>, NotFinite> {
        let start = Instant::now();
        let frame = Frame::new(crop, &mut self.now);
        let downsampled = Instant::now();
        let (gate, mut doubt) = self.scene.decide(frame.small());
        let gated = Instant::now();
        match gate {
            GateDecision::NoContact => {
                *self.map = ForceMap::EMPTY;
                *self.newtons = [[0.0; 3]; TAXELS];
                self.saturated = Saturated(0);
                self.judgement = Judgement::of(&self.map, self.judgement.rule);
            }
            GateDecision::Unhealthy => self.scene.force_inference(),
            GateDecision::Unchanged => {}
            GateDecision::Infer => {
                self.network.infer_frame(frame, &mut self.output);
                doubt = self.network.health();
                if doubt.is_good() {
                    self.accept_output()?;
                } else {
                    self.scene.force_inference();
                }
            }
        }
        let inferred = Instant::now();
        let us = |from: Instant, to: Instant| (to - from).as_secs_f64() * 1e6;
        let network_us = if gate == GateDecision::Infer {
            us(gated, inferred)
        } else {
            0.0
        };
        Ok(Processed {
            map: &self.map,
            judgement: self.judgement,
            gate,
            health: Health::from_bits(doubt.bits()).with(if self.saturated.0 > 0 {
                Health::SATURATED
            } else {
                Health::GOOD
            }),
            stages_us: [us(start, downsampled), us(downsampled, gated), network_us],
        })
    }

    /// Makes the network's output the map.
    fn accept_output(&mut self) -> Result<(), NotFinite> {
        drop_untouched(&mut self.output, self.contact_min_n);
        let quantised = ForceMap::quantise(&self.output).inspect_err(|_| self.scene.force_inference())?;
        (*self.map, self.saturated) = quantised;
        *self.newtons = *self.output;
        self.judgement = Judgement::of(&self.map, self.judgement.rule);
        if stick_ratio_below(&self.judgement.sums, SURE_STICK_RATIO) {
            self.scene.force_inference();
        }
        Ok(())
    }
}

/// What a network makes of a made-up picture, as a text: another one with other weights. `rest` is a 440×440 crop.
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

/// Takes the force from taxels that the network does not believe to be in contact: a smooth prediction has small
/// values everywhere, which would count as contact and would have to be sent.
fn drop_untouched(newtons: &mut [[f32; 3]; TAXELS], contact_min_n: f32) {
    for force in newtons.iter_mut().filter(|force| force[2] <= contact_min_n) {
        *force = [0.0; 3];
    }
}
