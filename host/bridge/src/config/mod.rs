//! The configuration of a run: one TOML file, overridden by environment variables and flags, and the microcontroller's own settings
//! as TOML.
//!
//! [`Settings`] is the table of keys, and what the rest of the program sees. `key` reads it, `layers` combines file, environment
//! and flags with it, `device` translates the microcontroller's settings, `show` prints both.

mod device;
mod key;
mod layers;
mod overrides;
mod settings;
mod show;

pub(crate) use self::device::{settings_from_text, settings_text};
pub(crate) use self::layers::Effective;
pub use self::overrides::Overrides;
pub use self::settings::Settings;
pub(crate) use self::show::{default_file, shown, shown_json};
