//! Every physical and geometric constant of the test world, with unit, value and source.
//! "Paper" is Griffa, Sferrazza, D'Andrea; "assumed" marks what the paper does not give.

/// Taxels along one side of the force map (paper: 20 x 20).
pub const TAXELS: usize = 20;
/// Taxels in a force map.
pub const TAXEL_COUNT: usize = TAXELS * TAXELS;
/// Side of one taxel, mm: the map covers 32 mm (paper's sensing surface).
pub const TAXEL_PITCH_MM: f64 = 1.6;
/// Half of the sensing surface, mm.
pub const HALF_SURFACE_MM: f64 = 0.5 * TAXELS as f64 * TAXEL_PITCH_MM;

/// Columns and rows of the camera's frame, pixels (paper: 640 x 480).
pub const FRAME_PX: [usize; 2] = [640, 480];
/// Side of the camera crop, pixels (paper: 440 x 440), the middle of the frame.
pub const CROP_PX: usize = 440;
/// First column and row of the crop in the frame.
pub const CROP_CORNER_PX: [usize; 2] = [(FRAME_PX[0] - CROP_PX) / 2, (FRAME_PX[1] - CROP_PX) / 2];
/// Side of the network's input, pixels (paper: 88 x 88).
pub const NETWORK_PX: usize = 88;

/// Thickness of the soft layers over the stiff base, mm (assumed; the stiff layer counts as rigid, as in
/// the paper).
pub const GEL_THICKNESS_MM: f64 = 6.0;
/// Young's modulus of the soft layers, MPa (assumed: shore 10A silicone, between 0.2 for small strain and the
/// 0.435 of a published neo-Hookean fit of a comparable gel).
pub const GEL_YOUNG_MPA: f64 = 0.4;
/// Poisson's ratio of the soft layers (silicone is nearly incompressible).
pub const GEL_POISSON: f64 = 0.49;

/// Deepest indentation, share of the thickness, up to which the linear layer stands for the gel. There, under a
/// 12 mm sphere that sticks (8.7 N), large-strain finite elements carry 4 % more force at equal depth; at equal
/// force the normal map differs by 3 %, the one with shear by 17 % (7 % once the pressure acts along the sphere's
/// normal), particles 1 mm deep move 13 % otherwise. At half of it: 0, 1, 11 (4) and 5 %. A 4 mm sphere
/// differs alike (0, 3, 21 (9) and 11 % at the limit)
/// (`cargo run --release -p gripline-validation --example finite_elements`).
pub const LARGEST_INDENTATION: f64 = 0.2;

/// Particles in the soft layer of one fingertip (project default): 0.857 per mm³ of the 36 x 36 x 4.5 mm that
/// hold them, 0.2 % of the volume.
pub const PARTICLE_COUNT: usize = 5_000;
/// Diameters of the particles, mm, smallest and largest (paper: 150 to 180 µm).
pub const PARTICLE_DIAMETER_MM: [f64; 2] = [0.150, 0.180];
/// The layer that holds the particles, mm under the surface: from the black cover (assumed 1 mm) to a little above
/// the stiff base (assumed). Whole particles lie inside, so neither cover nor base cuts one.
pub const PARTICLE_DEPTH_MM: [f64; 2] = [1.0, 5.5];
/// Half width of the gel, which holds particles up to its sides, mm (assumed: a little more than the sensing
/// surface). Beyond it the picture is dark.
pub const GEL_HALF_WIDTH_MM: f64 = 18.0;

/// Friction of the detector on the MCU (paper: fixed 0.45); stated here because the world's must lie above
/// it.
pub const DETECTOR_FRICTION: f64 = 0.45;
/// True friction of the scripted scene (assumed; silicone on dry plastic holds 0.6 to 1).
pub const SCENE_FRICTION: f64 = 0.65;
// With the detector's friction at or above the world's, slipping taxels count as sticking.
const _: () = assert!(SCENE_FRICTION > 1.2 * DETECTOR_FRICTION);
/// Radius of the scripted scene's sphere, mm (assumed).
pub const SCENE_SPHERE_RADIUS_MM: f64 = 12.0;
/// Grip that the scripted scene expects to start with, N: held there, the object slips when pulled.
pub const SCENE_INITIAL_GRIP_N: f64 = 2.5;

/// Cells along one side of the grid of displacements; two to a taxel, so taxel borders are cell borders.
pub const FIELD_CELLS: usize = 80;
/// Side of one cell, mm; the period is 64 mm, twice the surface.
pub const FIELD_PITCH_MM: f64 = 0.5 * TAXEL_PITCH_MM;
/// Depths at which the displacements are computed, evenly over [`PARTICLE_DEPTH_MM`].
pub const FIELD_LEVELS: usize = 10;

/// Sigma of the lens's and the pixel's blur together, pixels of the crop (assumed: a sharp, cheap lens).
pub const LENS_BLUR_PX: f64 = 0.6;
/// Brightness of particles, lowest and highest, relative to a white surface in the middle of the image
/// (assumed).
pub const PARTICLE_BRIGHTNESS: [f64; 2] = [0.6, 0.95];
/// Gray level of a fully bright particle over the background, middle of the image (assumed).
pub const PARTICLE_LEVELS: f64 = 215.0;
/// Gray level of the gel between particles, middle of the image (assumed).
pub const BACKGROUND_LEVELS: f64 = 14.0;
/// LEDs in the ring around the lens (assumed).
pub const LED_COUNT: usize = 8;
/// Radius of the ring of LEDs, mm (assumed: the light then falls to 3/4 in the corners of the sensing surface).
pub const LED_RING_RADIUS_MM: f64 = 15.0;
/// The ring over the centre of projection, mm (assumed: LEDs and lens on one board).
pub const LED_HEIGHT_MM: f64 = 0.0;
/// Largest difference of one LED's brightness from the mean, share (assumed: one bin of LEDs).
pub const LED_SPREAD: f64 = 0.15;
/// Slow drift of the brightness, largest share of nominal (assumed: LEDs warming up, supply).
pub const BRIGHTNESS_DRIFT: f64 = 0.01;
/// Longest period of the drift, s (assumed).
pub const BRIGHTNESS_DRIFT_PERIOD_S: f64 = 20.0;
/// Mains flicker left after one exposure, share of nominal (assumed: LEDs on a rectified supply).
pub const BRIGHTNESS_FLICKER: f64 = 0.003;
/// Mains frequency, Hz; light flickers at twice this.
pub const MAINS_HZ: f64 = 50.0;
/// Pictures at rest that a run takes before anything touches: their mean is what later ones are compared with, and their
/// differences are the camera's noise (project default: a quarter of a second at 60 a second).
pub const REST_PICTURES: u8 = 16;
/// Sigma of the sensor's noise, gray levels of the crop (assumed: a small sensor indoors).
pub const SENSOR_NOISE_LEVELS: f64 = 2.0;

/// One round of the scripted scene, s.
pub const SCENE_LOOP_S: f64 = 12.0;
/// Lag of the gripper's force behind its line, s (assumed: an electric gripper with a force loop).
pub const SCENE_GRIPPER_LAG_S: f64 = 0.04;
/// Fastest change of the gripper's force, N/s (assumed).
pub const SCENE_GRIPPER_RATE_N_PER_S: f64 = 60.0;
/// Largest force of the gripper, N (the line's full scale).
pub const SCENE_GRIPPER_MAX_N: f64 = 40.0;
/// Mass of the scripted scene's object, g (the paper's heaviest).
pub const SCENE_MASS_G: f64 = 92.66;
/// Its moment of inertia about the grip axis, g·mm² (assumed: a box of 40 x 40 mm).
pub const SCENE_INERTIA_G_MM2: f64 = 24_700.0;
/// How far the scripted scene lifts it, mm.
pub const SCENE_LIFT_MM: f64 = 20.0;
/// Largest extra pull on one finger, N: with the weight it needs a grip of about 4 N.
pub const SCENE_PULL_N: f64 = 2.2;
/// Direction of the pull, a unit vector.
pub const SCENE_PULL_DIRECTION: [f64; 2] = [0.6, -0.8];
/// Largest torsional moment on one finger, N·mm: it needs a grip of about 4.5 N.
pub const SCENE_TORSIONAL_MOMENT_NMM: f64 = 7.0;
/// Largest distance of the contact from the middle along each axis, mm.
pub const SCENE_CONTACT_OFFSET_MM: f64 = 2.5;

/// Standard acceleration of gravity, mm/s².
pub const GRAVITY_MM_PER_S2: f64 = 9_806.65;
/// Label SLIP: no cell of a contact sticks (or one in a hundred, and fresh gel that the slide reaches) while the object moves over the
/// gel faster than this, mm/s. A fiftieth of what a free object gathers in 5 ms; slow loads make less micro-slip.
pub const SLIP_SPEED_MM_PER_S: f64 = 1.0;
/// An object that has slid this far from where a gel took it has left the grip, mm (assumed: half a small patch's reach).
pub const GRASP_DROP_MM: f64 = 6.0;
/// Stiffness of the table under the object, N/mm (assumed; 1 N sinks it 0.05 mm).
pub const TABLE_STIFFNESS_N_PER_MM: f64 = 20.0;
/// Friction of the table (assumed).
pub const TABLE_FRICTION: f64 = 0.4;
/// Under this force the jaws of the default gripper are open, N (assumed).
pub const SCENE_GRIPPER_OPEN_N: f64 = 0.01;

#[cfg(test)]
mod tests {
    use std::path::Path;

    use gripline_sensor::Sensor;

    use super::*;

    #[test]
    #[expect(clippy::float_cmp, reason = "the very same numbers")]
    fn the_particle_fingertips_description_says_these_values() {
        let sensor = Sensor::named(Path::new("particle-fingertip")).unwrap();
        let [left, top] = CROP_CORNER_PX;
        assert_eq!(sensor.capture.size_px, FRAME_PX);
        assert_eq!(sensor.capture.crop_px, [left, top, CROP_PX, CROP_PX]);
        assert_eq!(sensor.view.field_mm, [2.0 * HALF_SURFACE_MM; 2]);
        assert_eq!(sensor.gel.pad_mm, [2.0 * GEL_HALF_WIDTH_MM; 2]);
        assert_eq!(
            (sensor.gel.thickness_mm, sensor.gel.young_mpa, sensor.gel.poisson),
            (GEL_THICKNESS_MM, GEL_YOUNG_MPA, GEL_POISSON)
        );
        assert_eq!(sensor.markers.diameter_mm, PARTICLE_DIAMETER_MM);
        assert_eq!(sensor.markers.depth_mm, PARTICLE_DEPTH_MM);
        assert_eq!(sensor.markers.count, [PARTICLE_COUNT; 2]);
        assert_eq!(sensor.taxels.grid, [TAXELS; 2]);
        assert_eq!(sensor.taxels.pitch_mm, TAXEL_PITCH_MM);
    }
}
