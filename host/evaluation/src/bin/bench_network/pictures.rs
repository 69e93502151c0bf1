//! Pictures to time with: a simulated fingertip at rest, under a ball that is pressed and dragged, and dragged a little further; and
//! squares in which one of them changes into the other. Without noise, which is added.

use std::io::ErrorKind;
use std::path::Path;
use std::sync::OnceLock;

use gripline_network::constants::{CROP_SIDE, DOWNSAMPLING};
use gripline_simulation::constants::SENSOR_NOISE_LEVELS;
use gripline_simulation::scene_file::{Scene, SceneFile};
use gripline_simulation::{Fingertip, FingertipParams, Image, PressWorld};

use crate::failure::Failure;

/// Positions of the changed square that take turns.
const POSITIONS: usize = 9;
/// A ball pressed with 3 N, dragged by most of a millimetre, and by a pixel or two more.
const SCENE: &str = "kind = \"press\"
[indenter]
shape = \"sphere\"
radius_mm = 6.0
friction = 0.65
[[path]]
seconds = 0.1
press_n = 3.0
at_mm = [0.0, 0.0]
[[path]]
seconds = 0.1
press_n = 3.0
at_mm = [0.8, 0.0]
[[path]]
seconds = 0.1
press_n = 3.0
at_mm = [0.9, 0.0]
";
/// Pictures a second: one at the end of each step.
const RATE_HZ: f64 = 10.0;

/// What a picture shows.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shown {
    /// Nothing touches.
    Rest,
    /// A ball holds on to the gel.
    Dragged,
    /// The same ball, a pixel or two further.
    DraggedOn,
}

/// The camera's crop, [`CROP_SIDE`] by [`CROP_SIDE`] gray levels, row-major. The first call solves the scene.
pub(crate) fn picture(shown: Shown) -> &'static [u8] {
    static PICTURES: OnceLock<[Vec<u8>; 3]> = OnceLock::new();
    let pictures = PICTURES.get_or_init(|| rendered().expect("the scene above is one that the world solves"));
    &pictures[shown as usize]
}

fn rendered() -> Result<[Vec<u8>; 3], Failure> {
    let nothing = &mut |_: &Path| Err(ErrorKind::NotFound.into());
    let Scene::Press(scene) = SceneFile::parse(Path::new("drag.toml"), SCENE, nothing)?.scene else {
        return Err("the press is another scene".into());
    };
    let params = FingertipParams {
        noise_levels: 0.0,
        ..FingertipParams::default()
    };
    let mut world = PressWorld::new(&scene, &params.gel, RATE_HZ)?;
    let mut fingertip = Fingertip::new(5, params)?;
    let rest = fingertip.rest_image().pixels;
    let mut touched = Vec::new();
    while let Some(frame) = world.advance()? {
        let mut picture = Image::crop();
        fingertip.render(frame.truth, &mut picture);
        touched.push(picture.pixels);
    }
    match <[Vec<u8>; 3]>::try_from(touched) {
        Ok([_, dragged, on]) => Ok([rest, dragged, on]),
        Err(other) => Err(format!("the scene has {} pictures, expected 3", other.len()).into()),
    }
}

/// Whole numbers below 2²⁰ as shares, without a pattern (an LCG's upper bits).
fn unit(state: &mut u64) -> f32 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 44) as f32 / (1 << 20) as f32
}

/// The same picture with a camera's noise, another with every number.
pub(crate) fn noisy(picture: &[u8], number: u64) -> Vec<u8> {
    let mut state = number;
    picture
        .iter()
        .map(|&level| {
            // Nearly normal: twelve shares have the variance 1.
            let normal = (0..12).map(|_| unit(&mut state)).sum::<f32>() - 6.0;
            (f32::from(level) + SENSOR_NOISE_LEVELS as f32 * normal).round() as u8
        })
        .collect()
}

/// A film in which each picture differs from the one before in a square that covers a share of it, at the nine
/// positions of a 3×3 raster in turn: in the square, every pixel becomes the other picture's.
pub(crate) struct Film {
    shown: Vec<u8>,
    /// What the two pictures differ by, bit for bit.
    difference: Vec<u8>,
    side: usize,
    frame: usize,
}

impl Film {
    pub(crate) fn new(share: f64) -> Self {
        // Whole pixels of the small image too.
        let side = (share.sqrt() * (CROP_SIDE / DOWNSAMPLING) as f64).round() as usize * DOWNSAMPLING;
        let [shown, other] = [Shown::Dragged, Shown::DraggedOn].map(picture);
        let difference = shown.iter().zip(other).map(|(a, b)| a ^ b).collect();
        Self {
            shown: shown.to_vec(),
            difference,
            side,
            frame: 0,
        }
    }

    pub(crate) fn next(&mut self) -> &[u8] {
        let position = self.frame % POSITIONS;
        self.frame += 1;
        let offset = |index: usize| index * (CROP_SIDE - self.side) / 2 / DOWNSAMPLING * DOWNSAMPLING;
        let (top, left) = (offset(position / 3), offset(position % 3));
        for row in top..top + self.side {
            let pixels = row * CROP_SIDE + left..row * CROP_SIDE + left + self.side;
            for (shown, difference) in self.shown[pixels.clone()]
                .iter_mut()
                .zip(&self.difference[pixels])
            {
                *shown ^= difference;
            }
        }
        &self.shown
    }
}
