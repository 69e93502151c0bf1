//! From tracks to the network's input: motions in millimetres, interpolated onto a regular grid over the sensor surface,
//! near and far particles apart. The interpolation weights depend on the particles at rest only, so they are computed once.

use super::lens::Lens;
use super::particles::Particle;
use super::search::Track;

/// Nodes per side.
pub const GRID_SIDE: usize = 40;
/// Nodes.
pub const GRID_NODES: usize = GRID_SIDE * GRID_SIDE;
/// Channels: motion x, y (mm) and confidence of the near particles, then of the far ones.
pub const GRID_CHANNELS: usize = 6;
/// Distance of neighbouring nodes, mm: half a taxel.
pub const GRID_PITCH_MM: f32 = 0.8;

/// Up to this depth a particle is near, from the second on it is far, mm below the surface; in between it is partly both.
const NEAR_FAR_MM: [f32; 2] = [2.0, 4.4];
/// The nodes of a row, a bit each.
const ALL_COLUMNS: u64 = (1 << GRID_SIDE) - 1;
/// Prior weight in the mean motion and in the confidence.
const PRIOR: [f32; 2] = [0.1, 0.5];

/// The grid: `[channel][node]`, row-major, same orientation as the force map.
pub type Grid = [[f32; GRID_NODES]; GRID_CHANNELS];

/// A grid of zeros.
///
/// # Panics
/// Never.
#[must_use]
pub fn empty_grid() -> Box<Grid> {
    let channels = vec![[0.0; GRID_NODES]; GRID_CHANNELS];
    channels.try_into().expect("as many channels as a grid has")
}

/// Interpolates tracks onto the grid, for one set of particles.
#[derive(Debug, Clone)]
pub struct GridInterpolator {
    lens: Option<Lens>,
    /// Height above the centre of projection and position on the surface at rest, mm.
    positions: Vec<(f32, [f32; 2])>,
    /// Index of each node's first entry, and the number of entries.
    starts: Vec<u32>,
    /// Particle, its weight as a near one, its weight as a far one.
    entries: Vec<(u32, f32, f32)>,
    /// Nodes that a particle contributes to: first row, one past the last, and columns, a bit each.
    support: Vec<([u8; 2], u64)>,
    /// The tracks of the last grid, and their weighted motions and weights.
    tracks: Vec<Track>,
    motions_mm: Vec<[f32; 3]>,
    /// Nodes whose particles' tracks have changed, by row, a bit for each column.
    dirty: [u64; GRID_SIDE],
    grid: Box<Grid>,
}

impl Default for GridInterpolator {
    /// Without particles: the grid stays zero.
    fn default() -> Self {
        Self {
            lens: None,
            positions: Vec::new(),
            starts: Vec::new(),
            entries: Vec::new(),
            support: Vec::new(),
            tracks: Vec::new(),
            motions_mm: Vec::new(),
            dirty: [0; GRID_SIDE],
            grid: empty_grid(),
        }
    }
}

impl GridInterpolator {
    /// Computes the interpolation weights.
    #[must_use]
    pub fn new(lens: &Lens, particles: &[Particle]) -> Self {
        let positions: Vec<(f32, [f32; 2])> = particles
            .iter()
            .map(|particle| {
                let height_mm = lens.base_mm + lens.thickness_mm - particle.depth_mm;
                (height_mm, lens.on_plane(particle.at_px, height_mm))
            })
            .collect();
        let mut of_node: Vec<Vec<(u32, f32, f32)>> = vec![Vec::new(); GRID_NODES];
        let mut support = Vec::with_capacity(particles.len());
        for (index, (particle, (_, at_mm))) in particles.iter().zip(&positions).enumerate() {
            let near =
                ((NEAR_FAR_MM[1] - particle.depth_mm) / (NEAR_FAR_MM[1] - NEAR_FAR_MM[0])).clamp(0.0, 1.0);
            let place = at_mm.map(|v| v / GRID_PITCH_MM + (GRID_SIDE - 1) as f32 / 2.0);
            let nearest = place.map(f32::round);
            let first = |k: usize| (nearest[k] - 1.0).clamp(0.0, GRID_SIDE as f32) as u8;
            let end = |k: usize| (nearest[k] + 2.0).clamp(0.0, GRID_SIDE as f32) as u8;
            let columns = (1_u64 << end(0)) - (1 << first(0));
            support.push(([first(1), end(1)], columns));
            // Quadratic B-spline over three nodes.
            let weights = [0, 1].map(|k| {
                let t = place[k] - nearest[k];
                [
                    0.5 * (0.5 - t) * (0.5 - t),
                    0.75 - t * t,
                    0.5 * (0.5 + t) * (0.5 + t),
                ]
            });
            for (dy, weight_y) in weights[1].into_iter().enumerate() {
                for (dx, weight_x) in weights[0].into_iter().enumerate() {
                    let [x, y] = [nearest[0] + dx as f32 - 1.0, nearest[1] + dy as f32 - 1.0];
                    let inside = 0.0..GRID_SIDE as f32;
                    if inside.contains(&x) && inside.contains(&y) {
                        let weight = weight_x * weight_y;
                        of_node[y as usize * GRID_SIDE + x as usize].push((
                            index as u32,
                            weight * near,
                            weight * (1.0 - near),
                        ));
                    }
                }
            }
        }
        let mut starts = vec![0];
        let mut entries = Vec::new();
        for node in of_node {
            entries.extend(node);
            starts.push(entries.len() as u32);
        }
        Self {
            lens: Some(*lens),
            tracks: vec![Track::default(); particles.len()],
            motions_mm: vec![[0.0; 3]; particles.len()],
            positions,
            starts,
            entries,
            support,
            dirty: [ALL_COLUMNS; GRID_SIDE],
            grid: empty_grid(),
        }
    }

    /// The grid for the tracks of the particles given to [`Self::new`]. Recomputes only nodes whose tracks changed. No
    /// allocation.
    pub fn update(&mut self, particles: &[Particle], tracks: &[Track]) -> &Grid {
        let Some(lens) = self.lens else {
            return &self.grid;
        };
        let known = self.motions_mm.iter_mut().zip(&mut self.tracks);
        let positions = self.positions.iter().zip(particles).zip(&self.support);
        for (((motion, last), ((&(height_mm, rest_mm), particle), support)), track) in
            known.zip(positions).zip(tracks)
        {
            if last == track {
                continue;
            }
            *last = *track;
            let &([top, bottom], columns) = support;
            for row in usize::from(top)..usize::from(bottom) {
                self.dirty[row] |= columns;
            }
            *motion = [0.0; 3];
            if track.confidence > 0.0 {
                let [x, y] = [0, 1].map(|k| particle.at_px[k] + track.motion_px[k]);
                let now_mm = lens.on_plane([x, y], height_mm);
                let weight = track_weight(track.confidence);
                let [x, y] = [now_mm[0] - rest_mm[0], now_mm[1] - rest_mm[1]];
                *motion = [weight * x, weight * y, weight];
            }
        }
        for (node, range) in self.starts.windows(2).enumerate() {
            if self.dirty[node / GRID_SIDE] >> (node % GRID_SIDE) & 1 == 0 {
                continue;
            }
            let entries = &self.entries[range[0] as usize..range[1] as usize];
            let mut sums = [[0.0_f32; 3]; 2];
            for &(particle, near, far) in entries {
                let motion = self.motions_mm[particle as usize];
                for (sums, weight) in sums.iter_mut().zip([near, far]) {
                    for (sum, value) in sums.iter_mut().zip(motion) {
                        *sum += weight * value;
                    }
                }
            }
            for (class, [x, y, known]) in sums.into_iter().enumerate() {
                self.grid[3 * class][node] = x / (known + PRIOR[0]);
                self.grid[3 * class + 1][node] = y / (known + PRIOR[0]);
                self.grid[3 * class + 2][node] = known / (known + PRIOR[1]);
            }
        }
        self.dirty = [0; GRID_SIDE];
        &self.grid
    }
}

/// Weight of a track. Every tenth track with a confidence below 0.9 is far off.
fn track_weight(confidence: f32) -> f32 {
    let share = ((confidence - 0.5) / 0.5).max(0.0);
    share * share
}
