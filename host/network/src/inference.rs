//! Pictures to maps without gate, detector or link: the network over one picture after the other.

use crate::constants::{CROP_SIDE, IMAGE_PIXELS};
use crate::force_map::{ForceMap, NO_FORCES};
use crate::image::{Frame, Image88, downsample_440_to_88};
use crate::network::Network;
use crate::scene::{GateKind, Health, Scene};

/// A network and the picture of the untouched fingertip.
#[derive(Debug)]
pub struct Inference {
    network: Network,
    scene: Scene,
    small: Box<Image88>,
}

impl Inference {
    /// With the 440×440 picture of the untouched fingertip.
    ///
    /// # Panics
    /// When `rest` is not 440×440 bytes.
    #[must_use]
    pub fn new(mut network: Network, rest: &[u8]) -> Self {
        network.set_rest(rest);
        let mut small = Box::new([0; IMAGE_PIXELS]);
        downsample_440_to_88(rest, &mut small);
        // One picture says nothing about noise: the gate stays out of it.
        let scene = Scene::new(GateKind::Off, &small, std::slice::from_ref(&*small));
        Self {
            network,
            scene,
            small,
        }
    }

    /// Pixels a side of the pictures that it takes.
    pub const SIDE: usize = CROP_SIDE;

    /// The forces of a 440×440 picture, newtons per taxel, and what is known against it: where anything is, the map is of
    /// zeros.
    ///
    /// # Panics
    /// When `crop` is not 440×440 bytes.
    pub fn infer(&mut self, crop: &[u8], map: &mut ForceMap) -> Health {
        let frame = Frame::new(crop, &mut self.small);
        let (_, mut health) = self.scene.decide(frame.small());
        if health.is_good() {
            self.network.infer_frame(frame, map);
            health = self.network.health();
        }
        if !health.is_good() {
            *map = NO_FORCES;
        }
        health
    }

    /// The network.
    #[must_use]
    pub fn network(&self) -> &Network {
        &self.network
    }
}
