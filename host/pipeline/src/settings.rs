//! The microcontroller's settings that follow from a network.

use gripline_network::Network;
use gripline_protocol::message::Configuration;
use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT};

/// The grip with which the scripted scene's object is held, newtons.
pub const SCENE_INITIAL_GRIP_N: f64 = 2.5;

/// The default settings with what the network was calibrated for, and the grip with which the scene's object is held.
#[must_use]
pub fn settings_for(network: &Network) -> Configuration {
    let calibration = network.calibration();
    Configuration {
        friction: (calibration.friction * PER_UNIT as f32).round() as u16,
        contact_min: (calibration.contact_min_n * LSB_PER_NEWTON as f32) as i16,
        floor: (SCENE_INITIAL_GRIP_N * f64::from(LSB_PER_NEWTON)) as i32,
        ..Configuration::DEFAULT
    }
}
