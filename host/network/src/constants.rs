//! Sizes and limits of the force network, each with unit and source.

use std::ops::RangeInclusive;

/// Rows and columns of the camera crop, pixels (the paper's 440×440 out of 640×480).
pub const CROP_SIDE: usize = 440;

/// Rows and columns of the network's input images, pixels (the paper).
pub const IMAGE_SIDE: usize = 88;

/// Crop pixels per input pixel and axis: 440 / 88.
pub const DOWNSAMPLING: usize = CROP_SIDE / IMAGE_SIDE;

/// Bytes of an input image.
pub const IMAGE_PIXELS: usize = IMAGE_SIDE * IMAGE_SIDE;

/// Rows and columns of the force map, taxels (the paper).
pub const MAP_SIDE: usize = 20;

/// Taxels of the force map.
pub const TAXELS: usize = MAP_SIDE * MAP_SIDE;

/// Largest weights file that is read, bytes. The built-in ones stay below 4 MiB; the limit bounds the cost of a wrong path.
pub const WEIGHTS_FILE_MAX_BYTES: u64 = 64 << 20;

/// Largest width (channels) of a layer in a weights file: four times the paper-sized network's.
pub const WIDTH_MAX: usize = 512;

/// Widths in a weights file are multiples of this: the lanes of the narrowest vector of the kernels.
pub const WIDTH_STEP: usize = 8;

/// Added to the variance in batch norm: the training framework's default, part of the architecture.
pub const NORM_EPSILON: f64 = 1e-5;

/// Side of a block of the scene gate, pixels of the 88×88 image: 2.9 mm of sensor surface, about what the lightest relevant
/// touch moves.
pub const BLOCK_SIDE: usize = 8;

/// Blocks per side of the image.
pub const BLOCKS_PER_SIDE: usize = IMAGE_SIDE / BLOCK_SIDE;

/// Blocks of the image.
pub const BLOCKS: usize = BLOCKS_PER_SIDE * BLOCKS_PER_SIDE;

/// Pixels of a block.
pub const BLOCK_PIXELS: usize = BLOCK_SIDE * BLOCK_SIDE;

/// Friction coefficient of the paper's detector, for the trainer's loss and for the true stick ratio.
pub const DETECTOR_FRICTION: f32 = 0.45;

/// Contact thresholds that calibration chooses from, newtons per taxel (REFERENCES: 0.01–0.03 is needed).
pub const CONTACT_MINS_N: [f32; 5] = [0.01, 0.015, 0.02, 0.025, 0.03];

/// Fewest taxels in contact for which a stick ratio is scored (prototype).
pub const SCORED_TAXELS: usize = 8;

/// Factors on shear or normal force that a fingertip's calibration may have.
pub const GAINS: RangeInclusive<f64> = 0.05..=20.0;

/// Smallest total normal force for a relative error to be scored, newtons.
pub const SCORED_NORMAL_N: f32 = 0.5;

/// Smallest shear for its relative error to be scored, newtons (prototype).
pub const SCORED_SHEAR_N: f32 = 0.2;

/// Largest share of lost or doubtful particles in a healthy picture. Clean pictures of unseen sensors and shapes up to
/// 15 N lose at most 0.11, pictures of another sensor at least 0.51 (880 samples of the test world).
pub const LOST_MAX: f32 = 0.3;
