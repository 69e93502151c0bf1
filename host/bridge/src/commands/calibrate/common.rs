//! What every calibration takes and says.

use std::path::PathBuf;
use std::time::SystemTime;

use clap::Args;

/// What every calibration takes.
#[derive(Debug, Clone, Args)]
pub(super) struct Common {
    /// Calibration file; sections that are there already stay.
    #[arg(long, value_name = "FILE.toml", default_value = "calibration.toml")]
    pub(super) out: PathBuf,
    /// What was calibrated, for the file: a name or serial number.
    #[arg(long, value_name = "NAME")]
    pub(super) device: Option<String>,
    /// Do not ask for anything.
    #[arg(long)]
    pub(super) yes: bool,
    /// Print what was found as one JSON object; asks for nothing.
    #[arg(long)]
    pub(super) json: bool,
}

impl Common {
    /// Whether somebody is there who can be asked.
    pub(super) fn asks(&self) -> bool {
        use std::io::IsTerminal as _;
        !self.yes && !self.json && std::io::stdin().is_terminal()
    }
}

/// Now, as the file says it.
pub(super) fn date() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}

/// Says what was written, and how it is used the first time.
pub(super) fn wrote(common: &Common) {
    if !common.json {
        println!(
            "wrote {}; `gripline run --calibration {}` uses it, or the key calibration.file",
            common.out.display(),
            common.out.display()
        );
    }
}
