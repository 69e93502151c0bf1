//! Which microcontroller a command talks to: the flags `--mcu` and `--config`.

use std::path::PathBuf;

use clap::Args;

use crate::config::{Overrides, Settings};
use crate::error::Error;
use gripline_link::Target;
use gripline_link::session::Session;

#[derive(Debug, Clone, Args)]
pub(crate) struct DeviceArgs {
    /// Which microcontroller: usb, usb:SERIAL, serial:PORT, emulator or embedded. By default the configuration's link.mcu.
    #[arg(long, value_name = "MCU")]
    mcu: Option<Target>,
    /// Configuration file that names the microcontroller.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

impl DeviceArgs {
    /// Opens the link and does the handshake.
    ///
    /// # Errors
    /// [`Error`] when the configuration is wrong, or the device does not answer.
    pub(crate) fn connect(&self) -> Result<Session, Error> {
        let target = match &self.mcu {
            Some(target) => target.clone(),
            None => Settings::load(&Overrides::of_file(self.config.as_deref()))?.mcu,
        };
        Ok(Session::connect(target.open()?)?)
    }
}
