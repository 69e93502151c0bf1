//! The microcontroller's settings that follow from a network, and the named settings of the grip.

use gripline_network::{Calibration, Network};
use gripline_protocol::message::Configuration;
use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT};

/// The grip with which the scripted scene's object is held, newtons.
pub const SCENE_INITIAL_GRIP_N: f64 = 2.5;

/// The default settings with the network's calibration, and the grip for the scene's object.
#[must_use]
pub fn settings_for(network: &Network) -> Configuration {
    settings_of(network.calibration())
}

/// The same for any model's calibration.
#[must_use]
pub fn settings_of(calibration: Calibration) -> Configuration {
    Configuration {
        friction: (calibration.friction * PER_UNIT as f32).round() as u16,
        contact_min: (calibration.contact_min_n * LSB_PER_NEWTON as f32) as i16,
        floor: (SCENE_INITIAL_GRIP_N * f64::from(LSB_PER_NEWTON)) as i32,
        ..Configuration::DEFAULT
    }
}

/// Minimum force of [`GripSetting::Secure`], 1/4096 N: 10 N. A light object's load hardly shows, nor does its slide. Of 3,500 adverse grasps
/// (`evaluate grasps --contact brush`, seeds 1 to 5) none is dropped; with 8 N one is whose friction falls to 0.08 (seed 2, grasp 57).
const SECURE_FLOOR: i32 = 10 * LSB_PER_NEWTON;

/// A named setting of the grip: the force reserve. It trades drops against force: only a reserve survives friction that falls to
/// half.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GripSetting {
    /// Little force: 15 % above the needed one, for fragile, dry objects.
    Sparing,
    /// The default settings.
    #[default]
    Normal,
    /// High force: holds when friction falls to 0.3 of the proven one, grips with at least 10 N, and keeps what a test
    /// added for long.
    Secure,
}

impl GripSetting {
    /// All of them, with their names.
    pub const ALL: [(&str, Self); 3] = [
        ("sparing", Self::Sparing),
        ("normal", Self::Normal),
        ("secure", Self::Secure),
    ];

    /// The one of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let found = Self::ALL.iter().find(|(known, _)| *known == name);
        found.map(|(_, setting)| *setting)
    }

    /// `settings` with this grip: margin, what friction may be learnt, how fast the line falls by plan, and for [`Self::Secure`] a floor of
    /// at least 10 N, as far as the fail-safe force allows.
    #[must_use]
    pub fn apply(self, settings: Configuration) -> Configuration {
        let normal = Configuration {
            margin: Configuration::DEFAULT.margin,
            friction_max: Configuration::DEFAULT.friction_max,
            relax_rate: Configuration::DEFAULT.relax_rate,
            ..settings
        };
        match self {
            Self::Sparing => Configuration {
                margin: 1_500,
                ..normal
            },
            Self::Normal => normal,
            Self::Secure => Configuration {
                // 1 / 0.3, for a drop to a half whose sliding friction is 0.6 of the sticking one.
                margin: 23_000,
                friction_max: 8_000,
                relax_rate: LSB_PER_NEWTON as u16 / 10,
                floor: normal.floor.max(SECURE_FLOOR.min(normal.fail_safe)),
                ..normal
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn named_settings_are_accepted_keep_what_is_not_the_grip_and_normal_is_the_default() {
        let other = Configuration {
            floor: 5 * LSB_PER_NEWTON,
            stale_ms: 77,
            margin: 1,
            ..Configuration::DEFAULT
        };
        let mut margins = Vec::new();
        for (name, setting) in GripSetting::ALL {
            assert_eq!(GripSetting::named(name), Some(setting));
            let settings = setting.apply(other);
            settings.check().unwrap();
            assert_eq!(settings.stale_ms, 77);
            let floor = match setting {
                GripSetting::Secure => 10 * LSB_PER_NEWTON,
                GripSetting::Sparing | GripSetting::Normal => other.floor,
            };
            assert_eq!(settings.floor, floor, "{name}");
            margins.push(settings.margin);
        }
        assert!(margins.is_sorted() && GripSetting::named("safe").is_none());
        assert_eq!(
            GripSetting::default().apply(Configuration::DEFAULT),
            Configuration::DEFAULT
        );
    }

    #[test]
    fn the_secure_floor_is_no_less_than_the_own_and_no_more_than_the_fail_safe_force() {
        for (floor_n, fail_safe_n, expected_n) in [(10, 12, 10), (2, 5, 5), (5, 5, 5), (2, 20, 10)] {
            let settings = GripSetting::Secure.apply(Configuration {
                floor: floor_n * LSB_PER_NEWTON,
                fail_safe: fail_safe_n * LSB_PER_NEWTON,
                ..Configuration::DEFAULT
            });
            settings.check().unwrap();
            assert_eq!(settings.floor, expected_n * LSB_PER_NEWTON);
        }
    }
}
