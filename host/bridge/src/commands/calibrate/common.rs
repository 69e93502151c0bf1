//! Arguments that every calibration takes, and what all of them print.

use std::path::PathBuf;
use std::time::SystemTime;

use clap::Args;

/// Arguments of every calibration.
#[derive(Debug, Clone, Args)]
pub(super) struct Common {
    /// Calibration file; its other sections are kept.
    #[arg(long, value_name = "FILE.toml", default_value = "calibration.toml")]
    pub out: PathBuf,
    /// Name or serial number of the calibrated device, for the file.
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// Ask nothing.
    #[arg(long)]
    pub yes: bool,
    /// Print the result as one JSON object; asks nothing.
    #[arg(long)]
    pub json: bool,
}

impl Common {
    /// Whether questions can be asked.
    pub(super) fn asks(&self) -> bool {
        use std::io::IsTerminal as _;
        !self.yes && !self.json && std::io::stdin().is_terminal()
    }
}

/// The present time in the file's format.
pub(in crate::commands) fn date() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}

/// Prints what was written and how to use it.
pub(super) fn wrote(common: &Common) {
    if !common.json {
        println!(
            "wrote {}; `gripline run --calibration {}` uses it, or the key calibration.file",
            common.out.display(),
            common.out.display()
        );
    }
}
