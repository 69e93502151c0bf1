//! Arguments of the experiments.

use std::path::PathBuf;

use clap::Args;
use gripline_network::Architecture;
use gripline_simulation::grasp::ContactModel;

use crate::grasps::policy::Policy;
use crate::plan::Data;

/// The arguments of `gripline evaluate paper`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct PaperArgs {
    /// Print the figures as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Everything random follows from it.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=99))]
    pub seed: u64,
    /// Runs of the sequence T-T-R-T-T per object.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=50))]
    pub runs: u64,
    /// Only the first N of the five objects: a quick look, no evidence.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=5))]
    pub objects: u8,
    /// One short run of each kind per object on the coarse grid: a look at it, no evidence.
    #[arg(long)]
    pub quick: bool,
    /// Which data: what is reported, or what the settings were chosen on.
    #[arg(long, value_enum, default_value_t)]
    pub data: Data,
    /// Force network instead of the default one: unet or tracked.
    #[arg(long, value_name = "NAME", default_value_t)]
    pub network: Architecture,
    /// Threads.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub threads: u8,
    /// Write the figures as a section of this document.
    #[arg(long, value_name = "FILE.md")]
    pub out: Option<PathBuf>,
}

/// The world that grasps happen in.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum World {
    /// One friction, good pictures, forces as the network gives them.
    #[default]
    Nominal,
    /// Friction that drops and differs, loads that surprise, forces that are off, pictures that fail, a poor gripper.
    Adverse,
}

/// How the contact of grasps is computed.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum GelModel {
    /// The gel as an elastic layer.
    #[default]
    Layer,
    /// The gel as springs, one a cell: rough, and many times faster.
    Brush,
}

impl GelModel {
    /// The simulation's name of it.
    #[must_use]
    pub const fn model(self) -> ContactModel {
        match self {
            Self::Layer => ContactModel::Layer,
            Self::Brush => ContactModel::Brush,
        }
    }
}

/// The arguments of `gripline evaluate grasps`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct GraspsArgs {
    /// Print the figures as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// The world that they happen in.
    #[arg(long, value_enum, default_value_t)]
    pub world: World,
    /// How the contact is computed: `layer` as everywhere else, `brush` for many grasps in little time.
    #[arg(long, value_enum, default_value_t)]
    pub contact: GelModel,
    /// How many grasps.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub grasps: u64,
    /// Only these policies, with commas between; a bound that needs another is not judged. `fixed` needs gripline and oracle, by which
    /// it is chosen.
    #[arg(long, value_enum, value_name = "NAMES", value_delimiter = ',', default_values_t = Policy::all(), hide_default_value = true)]
    pub policies: Vec<Policy>,
    /// Everything random follows from it.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=99))]
    pub seed: u64,
    /// Hold each object this long, s, after what disturbs it and before it is put down.
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=3_600), conflicts_with = "out")]
    pub hold: u32,
    /// Friction falls evenly to this share of itself while the object is held longer, percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 100, value_parser = clap::value_parser!(u8).range(5..=100), requires = "hold")]
    pub fade: u8,
    /// Force network instead of the default one: unet or tracked.
    #[arg(long, value_name = "NAME", default_value_t)]
    pub network: Architecture,
    /// Threads.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub threads: u8,
    /// Draw drops against margin, a point a policy.
    #[arg(long, value_name = "FILE.png")]
    pub plot: Option<PathBuf>,
    /// Keep every outcome in this file, one JSON object a line, and go on where an interrupted run of the same program stopped.
    #[arg(long, value_name = "FILE.jsonl")]
    pub results: Option<PathBuf>,
    /// Write the figures as a section of this document, and grasps.png beside it.
    #[arg(long, value_name = "FILE.md")]
    pub out: Option<PathBuf>,
}
