//! What a picture is compared with: the picture at rest and the last one that the force network processed.
//! Units: grey levels. Blocks of 8×8 pixels, row-major.

use gripline_kernels::InstructionSet;

use super::block_sums::{BlockSums, Pattern, PerBlock};
use crate::constants::{BLOCK_PIXELS, BLOCK_SIDE, BLOCKS, BLOCKS_PER_SIDE, IMAGE_SIDE};
use crate::image::Image88;

/// Added to the mean square gradient, (levels per two pixels)²: blocks without structure say nothing about motion.
const GRADIENT_FLOOR: f32 = 1.0;

/// A picture compared with both references, block by block.
#[derive(Debug, Clone)]
pub(super) struct Comparison {
    pub(super) sums: BlockSums,
    pub(super) rest: Box<Reference>,
    pub(super) processed: Box<Reference>,
}

/// An image to compare with.
#[derive(Debug, Clone)]
pub(super) struct Reference {
    pub(super) pattern: Pattern,
    /// Sums of its levels and of their squares.
    pub(super) levels: PerBlock<i32>,
    pub(super) squares: PerBlock<i32>,
    /// Projection of the x and y gradient onto the image: Σ image·gradient / Σ image².
    pub(super) projection: [PerBlock<f32>; 2],
    /// Inverse structure tensor of the gradients without that projection: xx, xy, yy.
    pub(super) inverse: [PerBlock<f32>; 3],
}

impl Reference {
    pub(super) fn new(image: &Image88) -> Self {
        let mut reference = Self {
            pattern: Pattern::new(image),
            levels: [0; BLOCKS],
            squares: [0; BLOCKS],
            projection: [[0.0; BLOCKS]; 2],
            inverse: [[0.0; BLOCKS]; 3],
        };
        reference.fill();
        reference
    }

    /// Computes everything but the pattern.
    fn fill(&mut self) {
        let mut sums = BlockSums::ZERO;
        sums.compute(
            InstructionSet::widest(),
            &self.pattern.image,
            [&self.pattern, &self.pattern],
        );
        self.levels = sums.levels;
        self.squares = sums.squares;
        for block in 0..BLOCKS {
            let square = sums.squares[block].max(1) as f32;
            let [x, y] = [1, 2].map(|k| sums.products[0][k][block] as f32);
            let [mut xx, mut xy, mut yy] = self.structure_tensor(block).map(|sum| sum as f32);
            (xx, xy, yy) = (xx - x * x / square, xy - x * y / square, yy - y * y / square);
            let floor = GRADIENT_FLOOR * BLOCK_PIXELS as f32;
            (xx, yy) = (xx + floor, yy + floor);
            let determinant = xx * yy - xy * xy;
            (self.projection[0][block], self.projection[1][block]) = (x / square, y / square);
            for (inverse, entry) in self.inverse.iter_mut().zip([yy, -xy, xx]) {
                inverse[block] = entry / determinant;
            }
        }
    }

    fn structure_tensor(&self, block: usize) -> [i32; 3] {
        let corner = block / BLOCKS_PER_SIDE * BLOCK_SIDE * IMAGE_SIDE + block % BLOCKS_PER_SIDE * BLOCK_SIDE;
        let mut sums = [0; 3];
        for row in 0..BLOCK_SIDE {
            let line = corner + row * IMAGE_SIDE..corner + row * IMAGE_SIDE + BLOCK_SIDE;
            let gradients = self.pattern.gradient_x[line.clone()]
                .iter()
                .zip(&self.pattern.gradient_y[line]);
            for (&x, &y) in gradients {
                let (x, y) = (i32::from(x), i32::from(y));
                sums = [sums[0] + x * x, sums[1] + x * y, sums[2] + y * y];
            }
        }
        sums
    }
}

impl Comparison {
    pub(super) fn new(rest: &Image88) -> Self {
        Self {
            sums: BlockSums::ZERO,
            rest: Box::new(Reference::new(rest)),
            processed: Box::new(Reference::new(rest)),
        }
    }

    pub(super) fn compare(&mut self, instructions: InstructionSet, now: &Image88) {
        self.sums
            .compute(instructions, now, [&self.rest.pattern, &self.processed.pattern]);
    }

    /// Makes `now` the processed picture.
    pub(super) fn set_processed(&mut self, now: &Image88) {
        self.processed.pattern = Pattern::new(now);
        self.processed.fill();
    }
}
