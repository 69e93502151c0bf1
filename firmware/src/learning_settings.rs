//! The three settings that the estimators need, copied while the map-to-line path is blocked.

use gripline_protocol::message::Configuration;

/// Units as in [`Configuration`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LearningSettings {
    pub(crate) friction: u16,
    pub(crate) friction_max: u16,
    pub(crate) margin: u16,
}

impl LearningSettings {
    /// Those of the settings in force.
    pub(crate) const fn of(settings: &Configuration) -> Self {
        Self {
            friction: settings.friction,
            friction_max: settings.friction_max,
            margin: settings.margin,
        }
    }

    /// As [`Configuration::learns`].
    pub(crate) const fn learns(self) -> bool {
        self.friction_max > self.friction
    }
}
