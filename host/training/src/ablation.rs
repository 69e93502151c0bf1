//! Ablation: each part of the loss and of the augmentation can be left out to measure what it is worth.

use clap::ValueEnum;

/// A part of training that can be left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Part {
    /// Errors relative to the sample's force; without, all samples of a batch share one weight.
    Relative,
    /// Shear's errors weigh more than normal's.
    Shear,
    /// The error of f_T − μ f_z in loaded taxels.
    Cone,
    /// The error of the summed force.
    Total,
    /// The eight symmetries of the square (`unet`; those of `tracked` are in its layers).
    Symmetries,
    /// Salt and pepper on the images (`unet`).
    SaltAndPepper,
    /// Changes of the light on the images (`unet`).
    Brightness,
}

/// The parts that training leaves out.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ablation {
    pub(crate) without: Vec<Part>,
}

impl Ablation {
    pub(crate) fn uses(&self, part: Part) -> bool {
        !self.without.contains(&part)
    }

    /// The names of what is left out, as on the command line.
    pub(crate) fn left_out(&self) -> Vec<String> {
        let names = self.without.iter().filter_map(ValueEnum::to_possible_value);
        names.map(|value| value.get_name().to_owned()).collect()
    }
}
