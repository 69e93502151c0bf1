//! The camera and the elastic layer above it.

/// Largest angle of a ray to the axis, rad.
const ANGLE_MAX_RAD: f32 = 1.3;

/// The camera (an equidistant fisheye) and the elastic layer above it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Focal length, pixels per radian from the axis.
    pub focal_px_per_rad: f32,
    /// Principal point in the 440×440 crop, pixels; pixel (0, 0) is centred on (0.5, 0.5).
    pub centre_px: [f32; 2],
    /// Distance from the centre of projection to the rigid base of the layer, mm.
    pub base_mm: f32,
    /// Thickness of the layer, mm.
    pub thickness_mm: f32,
}

impl Lens {
    /// Where the ray of a pixel meets the plane at `height_mm` above the centre of projection, mm.
    pub(super) fn on_plane(&self, at_px: [f32; 2], height_mm: f32) -> [f32; 2] {
        let [u, v] = [at_px[0] - self.centre_px[0], at_px[1] - self.centre_px[1]];
        let radius = (u * u + v * v).sqrt();
        let angle = (radius / self.focal_px_per_rad).min(ANGLE_MAX_RAD);
        let scale = if radius > 1e-3 {
            // Plain Rust: the C library rounds it differently on ARM and on x86.
            height_mm * libm::tanf(angle) / radius
        } else {
            height_mm / self.focal_px_per_rad
        };
        [u * scale, v * scale]
    }
}
