//! From tracks to what the network sees: motions in millimetres on a regular grid over the skin, near and far
//! particles apart. Where a particle lies at rest decides which nodes hear it, so that is worked out once.

use super::particles::Particle;
use super::search::Track;
use super::weights::Lens;

/// Nodes a side.
pub const GRID_SIDE: usize = 40;
/// Nodes.
pub const GRID_NODES: usize = GRID_SIDE * GRID_SIDE;
/// Channels: motion x, y in mm and how much is known, of near particles, then of far ones.
pub const GRID_CHANNELS: usize = 6;
/// From one node to the next, mm: two to a taxel.
pub const GRID_PITCH_MM: f32 = 0.8;

/// Where a particle counts as near and as far only, mm under the surface; between them as both.
const NEAR_FAR_MM: [f32; 2] = [2.0, 4.4];
/// Weight of knowing nothing, in the mean and in how much is known.
const NOTHING: [f32; 2] = [0.1, 0.5];
/// Steepest ray, rad.
const STEEPEST_RAD: f32 = 1.3;

/// What the network sees: channel by channel, each row-major, nodes as taxels with twice the resolution.
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

/// Which particles each node hears, and what they say.
#[derive(Debug, Clone)]
pub struct Gather {
    lens: Option<Lens>,
    /// Over the centre of projection at rest, and place on the skin at rest, mm.
    places: Vec<(f32, [f32; 2])>,
    /// Where each node's entries start; one more than there are nodes.
    starts: Vec<u32>,
    /// Particle, weight as a near one, weight as a far one.
    entries: Vec<(u32, f32, f32)>,
    /// Nodes that hear each particle: the first row and column, and those after the last.
    heard: Vec<[u8; 4]>,
    /// The tracks of the last grid, and what each of them came to.
    tracks: Vec<Track>,
    motions_mm: Vec<[f32; 3]>,
    /// Nodes that hear a particle whose track is another than the last time; all, before there is a last time.
    stale: Vec<bool>,
    grid: Box<Grid>,
}

impl Default for Gather {
    /// Hears nothing.
    fn default() -> Self {
        Self {
            lens: None,
            places: Vec::new(),
            starts: Vec::new(),
            entries: Vec::new(),
            heard: Vec::new(),
            tracks: Vec::new(),
            motions_mm: Vec::new(),
            stale: Vec::new(),
            grid: empty_grid(),
        }
    }
}

impl Gather {
    /// Works out what can be said before anything moves.
    #[must_use]
    pub fn new(lens: &Lens, particles: &[Particle]) -> Self {
        let places: Vec<(f32, [f32; 2])> = particles
            .iter()
            .map(|particle| {
                let height_mm = lens.base_mm + lens.thickness_mm - particle.depth_mm;
                (height_mm, lens.on_plane(particle.at_px, height_mm))
            })
            .collect();
        let mut of_node: Vec<Vec<(u32, f32, f32)>> = vec![Vec::new(); GRID_NODES];
        let mut heard = Vec::with_capacity(particles.len());
        for (index, (particle, (_, at_mm))) in particles.iter().zip(&places).enumerate() {
            let near =
                ((NEAR_FAR_MM[1] - particle.depth_mm) / (NEAR_FAR_MM[1] - NEAR_FAR_MM[0])).clamp(0.0, 1.0);
            let place = at_mm.map(|v| v / GRID_PITCH_MM + (GRID_SIDE - 1) as f32 / 2.0);
            let nearest = place.map(f32::round);
            let first = |k: usize| (nearest[k] - 1.0).clamp(0.0, GRID_SIDE as f32) as u8;
            let end = |k: usize| (nearest[k] + 2.0).clamp(0.0, GRID_SIDE as f32) as u8;
            heard.push([first(1), first(0), end(1), end(0)]);
            // A quadratic spline over three nodes.
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
            places,
            starts,
            entries,
            heard,
            stale: vec![true; GRID_NODES],
            grid: empty_grid(),
        }
    }

    /// The grid from the tracks of the particles that [`Self::new`] saw. Only the nodes that hear one that goes
    /// otherwise than the last time are worked out. No allocation.
    pub fn fill(&mut self, particles: &[Particle], tracks: &[Track]) -> &Grid {
        let Some(lens) = self.lens else {
            return &self.grid;
        };
        let known = self.motions_mm.iter_mut().zip(&mut self.tracks);
        let places = self.places.iter().zip(particles).zip(&self.heard);
        for (((motion, last), ((&(height_mm, rest_mm), particle), heard)), track) in
            known.zip(places).zip(tracks)
        {
            if last == track {
                continue;
            }
            *last = *track;
            let [top, left, bottom, right] = heard.map(usize::from);
            for row in top..bottom {
                self.stale[row * GRID_SIDE + left..row * GRID_SIDE + right].fill(true);
            }
            *motion = [0.0; 3];
            if track.confidence > 0.0 {
                let [x, y] = [0, 1].map(|k| particle.at_px[k] + track.motion_px[k]);
                let now_mm = lens.on_plane([x, y], height_mm);
                let trust = trust(track.confidence);
                let [x, y] = [now_mm[0] - rest_mm[0], now_mm[1] - rest_mm[1]];
                *motion = [trust * x, trust * y, trust];
            }
        }
        for (node, (range, stale)) in self.starts.windows(2).zip(&mut self.stale).enumerate() {
            if !std::mem::take(stale) {
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
                self.grid[3 * class][node] = x / (known + NOTHING[0]);
                self.grid[3 * class + 1][node] = y / (known + NOTHING[0]);
                self.grid[3 * class + 2][node] = known / (known + NOTHING[1]);
            }
        }
        &self.grid
    }
}

/// What a track counts for: of those that explain less than nine tenths of the patch, every tenth is wrong by far.
fn trust(confidence: f32) -> f32 {
    let share = ((confidence - 0.5) / 0.5).max(0.0);
    share * share
}

impl Lens {
    /// Where the ray of a place in the crop meets the plane at `height_mm` over the centre of projection, mm.
    fn on_plane(&self, at_px: [f32; 2], height_mm: f32) -> [f32; 2] {
        let [u, v] = [at_px[0] - self.centre_px[0], at_px[1] - self.centre_px[1]];
        let radius = (u * u + v * v).sqrt();
        let angle = (radius / self.focal_px_per_rad).min(STEEPEST_RAD);
        let scale = if radius > 1e-3 {
            height_mm * angle.tan() / radius
        } else {
            height_mm / self.focal_px_per_rad
        };
        [u * scale, v * scale]
    }
}
