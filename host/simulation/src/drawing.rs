//! Pictures before exposure: the lit black cover behind the gel, and discs of light over it. Pixels of the camera's
//! frame, gray levels at brightness 1. Every value depends on its place in the frame alone, so that any window of the
//! frame has the same pixels.

use std::sync::LazyLock;

use crate::camera::Camera;
use crate::constants::{
    BACKGROUND_LEVELS, CROP_CORNER_PX, CROP_PX, FRAME_PX, GEL_HALF_WIDTH_MM, LENS_BLUR_PX,
};
use crate::jpeg::BLOCK_PX;
use crate::lighting::Lamps;

/// A part of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Window {
    /// All of it.
    pub(crate) const FRAME: Self = Self {
        left: 0,
        top: 0,
        width: FRAME_PX[0],
        height: FRAME_PX[1],
    };
    /// The 440 x 440 crop.
    pub(crate) const CROP: Self = Self {
        left: CROP_CORNER_PX[0],
        top: CROP_CORNER_PX[1],
        width: CROP_PX,
        height: CROP_PX,
    };
    /// The JPEG blocks that hold the crop.
    pub(crate) const CROP_BLOCKS: Self = {
        let [x, y] = CROP_CORNER_PX;
        let (left, top) = (x - x % BLOCK_PX, y - y % BLOCK_PX);
        Self {
            left,
            top,
            width: (x + CROP_PX).next_multiple_of(BLOCK_PX) - left,
            height: (y + CROP_PX).next_multiple_of(BLOCK_PX) - top,
        }
    };

    pub(crate) const fn pixels(&self) -> usize {
        self.width * self.height
    }
}

/// What a window of the picture starts from: how much light the lens passes to each pixel, and the cover's light.
#[derive(Debug, Clone)]
pub(crate) struct Backdrop {
    pub(crate) window: Window,
    /// Share of light that the lens passes.
    pub(crate) lens: Vec<f32>,
    /// The cover, gray levels before the lens; 0 beyond the gel's sides.
    pub(crate) cover: Vec<f32>,
}

/// Pixels between the nodes at which the cover's light is computed.
const NODE_PX: usize = 16;
/// Steepest ray that is followed to the cover, rad.
const STEEPEST_RAD: f64 = 1.45;

impl Backdrop {
    /// The backdrop of `window`, with the cover `cover_mm` over the camera.
    pub(crate) fn new(window: Window, camera: &Camera, lamps: &Lamps, cover_mm: f64) -> Self {
        let nodes = Nodes::new(window, camera, lamps, cover_mm);
        let per_rad = 1.0 / camera.focal_px_per_rad;
        let lost_per_px2 = (camera.vignette_per_rad2 * per_rad * per_rad) as f32;
        let edge_px = (camera.half_field_rad * camera.focal_px_per_rad) as f32;
        let [u, v] = camera.centre_px.map(|c| c as f32);
        let mut lens = vec![0.0; window.pixels()];
        let mut cover = vec![0.0; window.pixels()];
        let rows = lens
            .chunks_exact_mut(window.width)
            .zip(cover.chunks_exact_mut(window.width));
        for (row, (lens, cover)) in (window.top..).zip(rows) {
            let dy = row as f32 + 0.5 - v;
            for (column, passed) in lens.iter_mut().enumerate() {
                let dx = (window.left + column) as f32 + 0.5 - u;
                let square = dx * dx + dy * dy;
                let inside = (edge_px - square.sqrt() + 0.5).clamp(0.0, 1.0);
                *passed = (1.0 - lost_per_px2 * square).max(0.0) * inside;
            }
            nodes.cover(row, window.left, cover);
        }
        Self { window, lens, cover }
    }
}

/// The cover at every sixteenth pixel: gray level, and pixels to the gel's nearer side along x and y.
struct Nodes {
    first: [usize; 2],
    columns: usize,
    values: Vec<[f32; 3]>,
}

impl Nodes {
    fn new(window: Window, camera: &Camera, lamps: &Lamps, cover_mm: f64) -> Self {
        let span = |from: usize, length: usize| {
            let first = from / NODE_PX;
            (first, (from + length).div_ceil(NODE_PX) + 1 - first)
        };
        let (left, columns) = span(window.left, window.width);
        let (top, rows) = span(window.top, window.height);
        let node = |i: usize| {
            let at = [left + i % columns, top + i / columns].map(|n| (n * NODE_PX) as f64 + 0.5);
            let [dx, dy] = [at[0] - camera.centre_px[0], at[1] - camera.centre_px[1]];
            let radius = (dx * dx + dy * dy).sqrt();
            let angle = (radius / camera.focal_px_per_rad).min(STEEPEST_RAD);
            let aside = if radius > 1e-6 {
                cover_mm * libm::tan(angle) / radius
            } else {
                cover_mm / camera.focal_px_per_rad
            };
            let [x, y] = [dx * aside, dy * aside];
            let cos = libm::cos(angle);
            let px_per_mm = camera.focal_px_per_rad * cos * cos / cover_mm;
            let to_side = |x: f64| ((GEL_HALF_WIDTH_MM - x.abs()) * px_per_mm) as f32;
            let level = BACKGROUND_LEVELS * lamps.plane([x, y, cover_mm]);
            [level as f32, to_side(x), to_side(y)]
        };
        Self {
            first: [left, top],
            columns,
            values: (0..columns * rows).map(node).collect(),
        }
    }

    /// The cover's gray levels along part of a row, from column `left` on.
    fn cover(&self, row: usize, left: usize, out: &mut [f32]) {
        let upper = (row / NODE_PX - self.first[1]) * self.columns;
        let way = (row % NODE_PX) as f32 / NODE_PX as f32;
        let node = |column: usize| -> [f32; 3] {
            let [above, below] = [upper, upper + self.columns].map(|at| self.values[at + column]);
            std::array::from_fn(|k| above[k] + way * (below[k] - above[k]))
        };
        let mut done = 0;
        while done < out.len() {
            let column = left + done;
            let inside = column % NODE_PX;
            let count = (NODE_PX - inside).min(out.len() - done);
            let [from, to] = [0, 1].map(|step| node(column / NODE_PX - self.first[0] + step));
            for (i, out) in out[done..done + count].iter_mut().enumerate() {
                let part = (inside + i) as f32 / NODE_PX as f32;
                let [level, side_x, side_y]: [f32; 3] =
                    std::array::from_fn(|k| from[k] + part * (to[k] - from[k]));
                *out = level * (side_x + 0.5).clamp(0.0, 1.0) * (side_y + 0.5).clamp(0.0, 1.0);
            }
            done += count;
        }
    }
}

/// Lays a disc of `radius_px` and gray level `level` over a window's picture: anti-aliased by the lens's blur, area
/// kept. What it covers is hidden.
pub(crate) fn draw_disc(
    picture: &mut [f32],
    window: &Window,
    centre_px: [f32; 2],
    radius_px: f32,
    level: f32,
) {
    let table = &*DISCS;
    let row = ((radius_px - DISC_RADII_PX[0]) / DISC_STEP_PX)
        .round()
        .clamp(0.0, (DISC_ROWS - 1) as f32);
    let nearest = DISC_RADII_PX[0] + row * DISC_STEP_PX;
    let amount = (radius_px / nearest) * (radius_px / nearest);
    let disc = &table[row as usize];
    let reach = nearest + DISC_FADE_PX;
    let [u, v] = centre_px;
    let span = |c: f32, from: usize, length: usize| {
        let (low, high) = (from as f32, (from + length) as f32);
        let first = (c - reach).clamp(low, high) as usize;
        let last = (c + reach + 1.0).clamp(low, high) as usize;
        first.min(last)..last
    };
    let columns = span(u, window.left, window.width);
    for row in span(v, window.top, window.height) {
        let dy = row as f32 + 0.5 - v;
        let start = (row - window.top) * window.width + columns.start - window.left;
        let mut dx = columns.start as f32 + 0.5 - u;
        for pixel in &mut picture[start..start + columns.len()] {
            let place = ((dx * dx + dy * dy) * DISC_PER_PX2) as usize;
            *pixel += amount * disc[place.min(DISC_PLACES - 1)] * (level - *pixel);
            dx += 1.0;
        }
    }
}

/// Radii for which blurred discs are tabulated, pixels; others take the nearest and keep their own area. Larger ones
/// are refused by the fingertip.
pub(crate) const DISC_RADII_PX: [f32; 2] = [0.5, 3.0];
const DISC_STEP_PX: f32 = 1.0 / 16.0;
const DISC_ROWS: usize = 41;
/// Beyond its radius a disc has faded out: three sigma of blur.
const DISC_FADE_PX: f32 = 3.0 * LENS_BLUR_PX as f32;
/// Table places per square pixel of squared distance.
const DISC_PER_PX2: f32 = 64.0;
/// Places up to (3.0 + 1.8)² pixels², the last one empty.
const DISC_PLACES: usize = 24 * 64;

/// Coverage over squared distance of a disc convolved with a Gaussian: ∫ g(x−d) erf(√(R²−x²)/√2σ) dx.
static DISCS: LazyLock<Vec<[f32; DISC_PLACES]>> = LazyLock::new(|| {
    const STEPS: usize = 48;
    let sigma = LENS_BLUR_PX;
    (0..DISC_ROWS)
        .map(|row| {
            let radius = f64::from(DISC_RADII_PX[0] + row as f32 * DISC_STEP_PX);
            let nodes: [(f64, f64); STEPS] = std::array::from_fn(|i| {
                let angle = (i as f64 + 0.5) / STEPS as f64 * std::f64::consts::PI;
                let (sin, cos) = libm::sincos(angle);
                let chord = libm::erf(radius * sin / (sigma * std::f64::consts::SQRT_2));
                let width = radius * sin * std::f64::consts::PI / STEPS as f64;
                (
                    radius * cos,
                    chord * width / (sigma * (std::f64::consts::TAU).sqrt()),
                )
            });
            std::array::from_fn(|place| {
                let distance = ((place as f64 + 0.5) / f64::from(DISC_PER_PX2)).sqrt();
                if distance > radius + f64::from(DISC_FADE_PX) || place + 1 == DISC_PLACES {
                    return 0.0;
                }
                let sum: f64 = nodes
                    .iter()
                    .map(|(x, weight)| weight * libm::exp(-0.5 * ((x - distance) / sigma).powi(2)))
                    .sum();
                sum as f32
            })
        })
        .collect()
});

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::lighting::Lighting;
    use crate::random::Random;

    /// Sum and centroid of the light that one disc takes.
    fn moments(centre: [f32; 2], radius: f32, level: f32) -> (f64, [f64; 2]) {
        let window = Window::CROP;
        let mut picture = vec![0.0; window.pixels()];
        draw_disc(&mut picture, &window, centre, radius, level);
        let (mut sum, mut first) = (0.0, [0.0; 2]);
        for (i, light) in picture.into_iter().map(f64::from).enumerate() {
            sum += light;
            first[0] += light * ((window.left + i % window.width) as f64 + 0.5);
            first[1] += light * ((window.top + i / window.width) as f64 + 0.5);
        }
        (sum, first.map(|f| f / sum))
    }

    #[test]
    fn a_disc_keeps_its_area_and_its_centroid_at_any_sub_pixel_place() {
        let mut worst = [0.0_f64; 2];
        for (i, radius) in [0.8_f32, 1.0, 1.27, 1.41, 1.9, 2.3].into_iter().enumerate() {
            for j in 0..60 {
                let part = j as f32 * 0.137 + i as f32 * 0.31;
                let centre = [300.0 + part % 1.0, 200.0 + (part * 3.7) % 1.0];
                let (sum, at) = moments(centre, radius, 80.0);
                let area = PI * f64::from(radius * radius);
                worst[0] = worst[0].max((sum / (80.0 * area) - 1.0).abs());
                for k in 0..2 {
                    worst[1] = worst[1].max((at[k] - f64::from(centre[k])).abs());
                }
            }
        }
        assert!(
            worst[0] < 0.01 && worst[1] < 0.01,
            "area {} centroid {} px",
            worst[0],
            worst[1]
        );
    }

    #[test]
    fn a_particles_centroid_follows_its_projection() {
        let camera = Camera::default();
        for start in [[3.0, -4.0], [-12.0, 9.0]] {
            for step in 0..40 {
                let shift = f64::from(step) * 0.007;
                let (at, scale) =
                    camera.project([start[0] + shift, start[1] - 0.5 * shift], 4.0 - 0.3 * shift);
                let (_, found) = moments(at.map(|v| v as f32), (0.08 * scale) as f32, 90.0);
                assert!((found[0] - at[0]).abs() < 0.01 && (found[1] - at[1]).abs() < 0.01);
            }
        }
    }

    #[test]
    fn a_disc_hides_what_is_behind_it() {
        let window = Window::CROP;
        let mut picture = vec![14.0; window.pixels()];
        let at = [300.5, 200.5];
        let middle = (200 - window.top) * window.width + 300 - window.left;
        draw_disc(&mut picture, &window, at, 2.9, 200.0);
        draw_disc(&mut picture, &window, at, 2.9, 50.0);
        // Keeping the area of a radius between two tabulated ones costs up to 2 % of the step.
        assert!((picture[middle] - 50.0).abs() < 3.0, "{}", picture[middle]);
    }

    #[test]
    fn any_window_of_the_frame_has_the_same_pixels() {
        let camera = Camera::default();
        let lamps = Lamps::new(&Lighting::default(), &mut Random::new(3, 1));
        let draw = |window: Window| {
            let backdrop = Backdrop::new(window, &camera, &lamps, 17.0);
            let mut picture = backdrop.cover;
            for i in 0..400 {
                let at = [100.0 + 1.13 * i as f32, 15.0 + 1.17 * i as f32];
                draw_disc(&mut picture, &window, at, 1.4, 90.0);
            }
            let pixels: Vec<u64> = picture
                .iter()
                .zip(&backdrop.lens)
                .map(|(a, b)| u64::from(a.to_bits()) << 32 | u64::from(b.to_bits()))
                .collect();
            pixels
        };
        let frame = draw(Window::FRAME);
        for window in [Window::CROP, Window::CROP_BLOCKS] {
            let part = draw(window);
            for (i, pixel) in part.iter().enumerate() {
                let (row, column) = (window.top + i / window.width, window.left + i % window.width);
                assert_eq!(*pixel, frame[row * FRAME_PX[0] + column], "{column} {row}");
            }
        }
    }

    #[test]
    fn the_cover_ends_at_the_gels_sides_and_the_lens_at_its_image_circle() {
        let camera = Camera {
            half_field_rad: 1.0,
            ..Camera::default()
        };
        let lamps = Lamps::new(&Lighting::default(), &mut Random::new(3, 1));
        let backdrop = Backdrop::new(Window::FRAME, &camera, &lamps, 17.0);
        // Along the middle row.
        let middle = |values: &[f32], column: usize| values[240 * FRAME_PX[0] + column];
        let (side, _) = camera.project([GEL_HALF_WIDTH_MM, 0.0], 17.0 - camera.to_base_mm);
        let side = side[0] as usize;
        assert!(middle(&backdrop.cover, side - 3) > 5.0 && middle(&backdrop.cover, side + 3) < 1e-6);
        assert!((middle(&backdrop.lens, 320) - 1.0).abs() < 1e-5);
        // r = f at one radian; one tenth is lost there.
        let edge = (320.0 + camera.focal_px_per_rad) as usize;
        assert!((middle(&backdrop.lens, edge - 2) - 0.9).abs() < 0.005);
        assert!(middle(&backdrop.lens, edge + 2) < 1e-6);
    }

    #[test]
    fn discs_off_the_image_change_nothing_and_do_not_panic() {
        let window = Window::CROP;
        let mut picture = vec![1.0_f32; window.pixels()];
        for at in [
            [-50.0, 10.0],
            [10.0, 1e6],
            [f32::MAX, 0.0],
            [-1e9, -1e9],
            [560.0, 480.0],
        ] {
            draw_disc(&mut picture, &window, at, 1.4, 0.9);
        }
        assert!(picture.iter().all(|&c| c.to_bits() == 1.0_f32.to_bits()));
    }
}
