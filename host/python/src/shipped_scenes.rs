//! The scenes that come with the package, so that one can begin without a file.

use std::io;
use std::path::Path;

/// Name and text, as in `host/simulation/scenes`.
pub(crate) const SHIPPED: [(&str, &str); 4] = [
    (
        "grasp_lift_pull",
        include_str!("../../simulation/scenes/grasp_lift_pull.toml"),
    ),
    (
        "press_and_drag",
        include_str!("../../simulation/scenes/press_and_drag.toml"),
    ),
    ("slides", include_str!("../../simulation/scenes/slides.toml")),
    (
        "twist_stamp",
        include_str!("../../simulation/scenes/twist_stamp.toml"),
    ),
];

/// The files that shipped scenes name.
const FILES: [(&str, &[u8]); 1] = [("stamp.png", include_bytes!("../../simulation/scenes/stamp.png"))];

/// A file that a shipped scene names.
pub(crate) fn load(path: &Path) -> io::Result<Vec<u8>> {
    let file = FILES.iter().find(|(name, _)| path.ends_with(name));
    file.map(|(_, bytes)| bytes.to_vec())
        .ok_or_else(|| io::ErrorKind::NotFound.into())
}
