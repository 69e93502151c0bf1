//! Sizes and levels that hold for every printed gel, each with unit and reason. What differs between sensors stands in their files.

/// Full pixels a side of a working pixel, in which markers are found: a marker is at least five of them wide.
pub(crate) const WORKING: usize = 2;
/// Full pixels a side of a pixel of the imprint: about a quarter of a millimetre, half of the smallest marker.
pub(crate) const IMPRINT: usize = 4;
/// Colour channels.
pub(crate) const CHANNELS: usize = 3;

/// Side of the square that closes markers over, pitches: wider than a marker, narrower than the gap between two.
pub(crate) const CLOSING_PITCHES: f32 = 0.62;
/// A pixel belongs to a marker, or to its edge, from this share of the threshold on: it is filled in.
pub(crate) const EDGE: f32 = 0.5;
/// Darkness above this share of the threshold draws a centre, the more the darker: what lies below is noise. In proportion, so
/// that a pixel which a marker covers by half counts half, and the centre moves evenly with the marker.
pub(crate) const CENTRE_EDGE: f32 = 0.2;
/// Smallest threshold on darkness, share of the light around: less is noise.
pub(crate) const THRESHOLD_MIN: f32 = 0.08;
/// Areas of blobs that may be markers, shares of the smallest and of the largest marker's.
pub(crate) const AREA: [f32; 2] = [0.3, 2.0];
/// Longest side of a blob over its shortest: a marker pressed askew stays below.
pub(crate) const ASPECT_MAX: f32 = 2.2;

/// A blob belongs to a node of the grid within this distance, pitches; gels under contact have moved by up to 0.3.
pub(crate) const NODE_REACH: f32 = 0.35;
/// From one picture to the next a marker moves at most so far relative to its neighbours, pitches.
pub(crate) const STEP_REACH: f32 = 0.3;
/// Neighbours that tell where a hidden marker went lie within this distance, pitches.
pub(crate) const NEIGHBOURHOOD: f32 = 1.6;

/// Reach (sigma) of a marker's motion over the gel, pitches.
pub(crate) const MOTION_SIGMA: f32 = 0.8;
/// Imprints are compared with those of this many pictures ago: the short lag sees a jerk, the long one a creep.
pub const LAGS: [usize; 2] = [2, 5];
/// Energy of an imprint that is noise, squared grey levels per pixel and finger, channels added: twice what the rest pictures of
/// an untouched gel differ by.
pub(crate) const NOISE_ENERGY: f32 = 4.0;
/// Pictures of one rest that differ by more energy do not both show the untouched gel, squared grey levels per pixel; those of still
/// recorded gels differ by 3 at most.
pub(crate) const REST_AGREES: f32 = 8.0;
/// Pictures whose median is the score.
pub(crate) const SCORE_PICTURES: usize = 3;
/// Pictures whose median is the imprint's energy.
pub(crate) const ENERGY_PICTURES: usize = 5;
