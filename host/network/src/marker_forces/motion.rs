//! What a force model takes of a picture: how far each marker has moved. Units: mm.

/// A marker in one picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MarkerMotion {
    /// How far it is from where it is at rest, mm.
    pub moved_mm: [f32; 2],
    /// Whether the picture shows it; else its neighbours' motion stands for its own.
    pub is_seen: bool,
}
