//! A set of samples in memory: images in grey levels, forces in newtons per taxel.

use gripline_network::ForceMap;
use gripline_network::constants::IMAGE_PIXELS;
use gripline_network::image::Image88;
use gripline_network::tracked::{GRID_CHANNELS, GRID_NODES, Grid, empty_grid};

use crate::constants::GRID_STEPS;

/// A set of samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Dataset {
    /// One image per virtual sensor.
    pub(crate) rest: Vec<Image88>,
    /// Index of each sample's rest image.
    pub(crate) rest_of: Vec<u32>,
    pub(crate) now: Vec<Image88>,
    /// Tracked motions on the grid, in steps of 1/[`GRID_STEPS`].
    pub(crate) grids: Vec<[i16; GRID_CHANNELS * GRID_NODES]>,
    pub(crate) forces_n: Vec<ForceMap>,
    pub(crate) shapes: Vec<String>,
    pub(crate) world: String,
}

impl Dataset {
    pub(crate) fn len(&self) -> usize {
        self.forces_n.len()
    }

    pub(crate) fn rest(&self, index: usize) -> &Image88 {
        &self.rest[self.rest_of[index] as usize]
    }

    pub(crate) fn now(&self, index: usize) -> &Image88 {
        &self.now[index]
    }

    /// The grid of tracked motions: mm, and confidences.
    pub(crate) fn grid(&self, index: usize) -> Box<Grid> {
        let mut grid = empty_grid();
        for (value, &stored) in grid.as_flattened_mut().iter_mut().zip(&self.grids[index]) {
            *value = f32::from(stored) / GRID_STEPS;
        }
        grid
    }

    /// As stored.
    pub(crate) fn stored_grid(&self, index: usize) -> &[i16; GRID_CHANNELS * GRID_NODES] {
        &self.grids[index]
    }

    pub(crate) fn forces_n(&self, index: usize) -> &ForceMap {
        &self.forces_n[index]
    }

    /// Name of the indenter, `none` where nothing touches.
    pub(crate) fn shape(&self, index: usize) -> &str {
        &self.shapes[index]
    }

    /// Fingerprint of the world that made it.
    pub(crate) fn world(&self) -> &str {
        &self.world
    }

    /// Mean and standard deviation of the rest images' grey levels.
    pub(crate) fn rest_levels(&self) -> (f64, f64) {
        let count = (self.rest.len() * IMAGE_PIXELS) as f64;
        let (mut sum, mut squares) = (0.0, 0.0);
        for &pixel in self.rest.as_flattened() {
            sum += f64::from(pixel);
            squares += f64::from(pixel) * f64::from(pixel);
        }
        let mean = sum / count;
        (mean, (squares / count - mean * mean).max(0.0).sqrt())
    }
}

#[cfg(test)]
impl Dataset {
    /// Random images and no forces.
    pub(crate) fn noise(samples: usize) -> Self {
        let mut rng = crate::rng::Rng::new(1);
        let mut image = || std::array::from_fn(|_| rng.below(256) as u8);
        Self {
            rest: (0..samples).map(|_| image()).collect(),
            rest_of: (0..samples as u32).collect(),
            now: (0..samples).map(|_| image()).collect(),
            grids: (0..samples)
                .map(|sample| std::array::from_fn(|i| ((i * 7919 + sample * 104_729) % 4001) as i16 - 2000))
                .collect(),
            forces_n: vec![gripline_network::NO_FORCES; samples],
            shapes: vec!["none".to_owned(); samples],
            world: "noise".to_owned(),
        }
    }
}
