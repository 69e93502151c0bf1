//! A network as a list of steps over preallocated planes. Each plane knows which of its pixels changed since the last
//! run (the dirty region); a step recomputes only the pixels that see one of them. A pixel's bits do not depend on what
//! is computed with it, so the result equals that of computing everything.

use super::convolution::Convolution;
use super::direct::convolve;
use super::int16::Int16Convolution;
use super::plane::Plane;
use super::pool;
use super::region::Region;

/// One of a plan's planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlaneId(usize);

#[derive(Debug, Clone)]
enum Step {
    Convolve {
        convolution: Convolution,
        /// Where the sums start instead of at the convolution's bias.
        start: Option<PlaneId>,
        from: PlaneId,
        to: PlaneId,
        channel: usize,
    },
    /// The same in int16: all of it when anything changed.
    ConvolveInt16 {
        convolution: Box<Int16Convolution>,
        from: PlaneId,
        to: PlaneId,
        channel: usize,
    },
    Pool {
        from: PlaneId,
        channel: usize,
        to: PlaneId,
    },
    Copy {
        from: PlaneId,
        to: PlaneId,
        channel: usize,
    },
}

/// A network: planes, steps in the order in which they run, and each plane's dirty region.
#[derive(Debug, Clone, Default)]
pub struct Plan {
    planes: Vec<Plane>,
    dirty: Vec<Region>,
    steps: Vec<Step>,
}

impl Plan {
    /// Adds a plane of zeros.
    pub fn plane(&mut self, height: usize, width: usize, channels: usize) -> PlaneId {
        self.planes.push(Plane::new(height, width, channels));
        // Nothing is computed yet.
        self.dirty.push(Region::whole(height, width));
        PlaneId(self.planes.len() - 1)
    }

    /// Adds a convolution that writes `to`'s channels from `channel` on.
    pub fn convolve(&mut self, convolution: Convolution, from: PlaneId, to: PlaneId, channel: usize) {
        self.steps.push(Step::Convolve {
            convolution,
            start: None,
            from,
            to,
            channel,
        });
    }

    /// Adds a convolution whose sums start at the values of another plane of the output's size, with its channels rounded
    /// up to [`LANES_MAX`](crate::simd::LANES_MAX).
    pub fn convolve_onto(&mut self, convolution: Convolution, start: PlaneId, from: PlaneId, to: PlaneId) {
        self.steps.push(Step::Convolve {
            convolution,
            start: Some(start),
            from,
            to,
            channel: 0,
        });
    }

    /// Adds a convolution that writes a new plane.
    pub fn convolved(&mut self, convolution: Convolution, from: PlaneId) -> PlaneId {
        let (height, width) = convolution.out_size(self.planes[from.0].size());
        let to = self.plane(height, width, convolution.out_channels());
        self.convolve(convolution, from, to, 0);
        to
    }

    /// Adds an int16 convolution that writes `to`'s channels from `channel` on. Its scale depends on its largest input, so
    /// it computes everything when anything changed.
    pub fn convolve_int16(
        &mut self,
        convolution: Int16Convolution,
        from: PlaneId,
        to: PlaneId,
        channel: usize,
    ) {
        let convolution = Box::new(convolution);
        self.steps.push(Step::ConvolveInt16 {
            convolution,
            from,
            to,
            channel,
        });
    }

    /// The same to a new plane.
    pub fn convolved_int16(&mut self, convolution: Int16Convolution, from: PlaneId) -> PlaneId {
        let (height, width) = convolution.convolution().out_size(self.planes[from.0].size());
        let to = self.plane(height, width, convolution.convolution().out_channels());
        self.convolve_int16(convolution, from, to, 0);
        to
    }

    /// Adds a 2×2 maximum over some of a plane's channels.
    pub fn pooled(&mut self, from: PlaneId, channel: usize, channels: usize) -> PlaneId {
        let (height, width) = self.planes[from.0].size();
        let to = self.plane(height / 2, width / 2, channels);
        self.steps.push(Step::Pool { from, channel, to });
        to
    }

    /// Copies a plane to `to`'s channels from `channel` on.
    pub fn copy(&mut self, from: PlaneId, to: PlaneId, channel: usize) {
        self.steps.push(Step::Copy { from, to, channel });
    }

    /// A plane's values.
    #[must_use]
    pub fn values(&self, plane: PlaneId) -> &Plane {
        &self.planes[plane.0]
    }

    /// A plane to write an input to. Call [`Self::mark_dirty`] with the region that was written.
    pub fn values_mut(&mut self, plane: PlaneId) -> &mut Plane {
        &mut self.planes[plane.0]
    }

    /// Marks a region of an input plane as changed.
    pub fn mark_dirty(&mut self, plane: PlaneId, region: &Region) {
        self.dirty[plane.0] = self.dirty[plane.0].union(region);
    }

    /// Brings every plane up to date with the inputs. No allocation.
    pub fn run(&mut self) {
        for step in &mut self.steps {
            match *step {
                Step::Convolve {
                    ref convolution,
                    start,
                    from,
                    to,
                    channel,
                } => {
                    let size = self.planes[to.0].size();
                    let mut region = convolution.affected(&self.dirty[from.0], size);
                    if let Some(start) = start {
                        region = region.union(&self.dirty[start.0]);
                    }
                    if region.is_empty() {
                        continue;
                    }
                    // Taken out for the call, so that the others can be borrowed; an empty plane owns no memory.
                    let mut output = std::mem::take(&mut self.planes[to.0]);
                    let start = start.map(|start| &self.planes[start.0]);
                    convolve(
                        convolution,
                        start,
                        &self.planes[from.0],
                        &mut output,
                        channel,
                        &region,
                    );
                    self.planes[to.0] = output;
                    self.dirty[to.0] = self.dirty[to.0].union(&region);
                }
                Step::ConvolveInt16 {
                    ref mut convolution,
                    from,
                    to,
                    channel,
                } => {
                    if self.dirty[from.0].is_empty() {
                        continue;
                    }
                    let mut output = std::mem::take(&mut self.planes[to.0]);
                    convolution.run(&self.planes[from.0], &mut output, channel);
                    self.dirty[to.0] = Region::whole(output.height(), output.width());
                    self.planes[to.0] = output;
                }
                Step::Pool { from, channel, to } => {
                    let region = pool::affected(&self.dirty[from.0], self.planes[to.0].size());
                    let mut output = std::mem::take(&mut self.planes[to.0]);
                    pool::max_pool(&self.planes[from.0], channel, &mut output, &region);
                    self.planes[to.0] = output;
                    self.dirty[to.0] = self.dirty[to.0].union(&region);
                }
                Step::Copy { from, to, channel } => {
                    let region = self.dirty[from.0].clone();
                    let mut output = std::mem::take(&mut self.planes[to.0]);
                    output.copy(&self.planes[from.0], channel, &region);
                    self.planes[to.0] = output;
                    self.dirty[to.0] = self.dirty[to.0].union(&region);
                }
            }
        }
        self.dirty.fill(Region::EMPTY);
    }

    /// Multiply-adds of a run in which all of `input` changed and nothing else did.
    #[must_use]
    pub fn multiply_adds(&self, input: PlaneId) -> usize {
        let mut reached = vec![false; self.planes.len()];
        reached[input.0] = true;
        let mut sum = 0;
        for step in &self.steps {
            match *step {
                Step::Convolve {
                    ref convolution,
                    from,
                    to,
                    ..
                } if reached[from.0] => {
                    reached[to.0] = true;
                    sum += convolution.multiply_adds(self.planes[to.0].size());
                }
                Step::ConvolveInt16 {
                    ref convolution,
                    from,
                    to,
                    ..
                } if reached[from.0] => {
                    reached[to.0] = true;
                    sum += 2 * convolution.convolution().multiply_adds(self.planes[to.0].size());
                }
                Step::Pool { from, to, .. } | Step::Copy { from, to, .. } if reached[from.0] => {
                    reached[to.0] = true;
                }
                _ => {}
            }
        }
        sum
    }
}
