//! Pictures for the scene gate and the health check: virtual sensors at rest, pressed lightly and hard, pulled, turned and
//! released, each state with its true map; and the same with camera faults. These sensors serve nothing else.
//! Units: grey levels, N, mm, rad.

use std::sync::Arc;

use gripline_network::image::Image88;
use gripline_network::{ForceMap, NO_FORCES};
use gripline_simulation::constants::REST_PICTURES;
use gripline_simulation::contact_world::{
    Contact, Drive, GelSurface, Mount, Press, Shape, TRAINING_SHAPES, Truth, UNSEEN_SHAPES,
};
use gripline_simulation::{
    CameraFault, Fingertip, FingertipParams, Gel, Image, SimulationError, block_mean_88,
};

use crate::rng::Rng;

/// Upper four bits of these sensors' numbers: those of samples have 1 to 4, those of scenes 0.
const SENSORS: u64 = 9;
/// Pictures at rest per sensor.
const UNTOUCHED: usize = 30;
/// Touches per sensor.
const TOUCHES: usize = 4;
/// Cells per side of the sensor surface: the training grid's.
const CELLS: usize = 80;
/// Lightest force of a touch, N; then each is so much larger, up to the touch's own peak.
const LIGHTEST_N: f32 = 0.04;
const GROWTH: f32 = 1.35;
/// Peak forces, N.
const PEAK_N: [f32; 2] = [0.15, 12.0];
/// Largest relative change of brightness since rest: the world's own and more.
const DRIFT: f32 = 0.04;
/// Largest growth of the camera's noise since rest, as it warms up.
const NOISIER: f32 = 1.08;
/// Every n-th picture is also taken with every camera fault.
const FAULTY_EVERY: usize = 16;

/// What the pictures are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    Train = 1,
    Calibrate = 2,
    Report = 3,
}

/// A picture and what touches.
pub(crate) struct Picture {
    pub(crate) image: Image88,
    pub(crate) forces: ForceMap,
    /// Touches are numbered from 1; 0 is rest.
    pub(crate) touch: usize,
    /// Which state of the touch.
    pub(crate) state: usize,
}

impl Picture {
    /// Total normal force, N.
    pub(crate) fn normal_n(&self) -> f32 {
        self.forces.iter().map(|force| force[2]).sum()
    }
}

/// All pictures of one sensor.
pub(crate) struct Sensor {
    pub(crate) rest: Vec<Image88>,
    pub(crate) pictures: Vec<Picture>,
    pub(crate) faulty: Vec<(CameraFault, Image88)>,
}

/// Sensor number `number` of a purpose.
pub(crate) fn sensor(
    purpose: Purpose,
    number: u64,
    skin: &Arc<GelSurface>,
) -> Result<Sensor, SimulationError> {
    let unit = (SENSORS << 60) | ((purpose as u64) << 32) | number;
    let mut rng = Rng::new(unit);
    let params = FingertipParams::of_sensor(unit);
    let quieter = FingertipParams {
        noise_levels: params.noise_levels / f64::from(rng.between(1.0, NOISIER)),
        ..params
    };
    let mut at_rest = Fingertip::new(unit, quieter)?;
    let rest = (0..REST_PICTURES)
        .map(|_| block_mean_88(&at_rest.rest_image().pixels))
        .collect();
    let mut fingertip = Fingertip::new(unit, params)?;
    let mut camera = Camera {
        fingertip: &mut fingertip,
        brightness: params.brightness,
        rng: Rng::new(unit ^ 1),
        crop: Image::crop(),
        sensor: Sensor {
            rest,
            pictures: Vec::new(),
            faulty: Vec::new(),
        },
    };
    for state in 0..UNTOUCHED {
        camera.take(None, 0, state)?;
    }
    let shapes: Vec<Shape> = match purpose {
        Purpose::Train | Purpose::Calibrate => TRAINING_SHAPES.to_vec(),
        Purpose::Report => UNSEEN_SHAPES.to_vec(),
    };
    for touch in 1..=TOUCHES {
        // A nearly flat ball moves much of the surface a little: the touch that is hardest to detect.
        let shape = if rng.below(4) == 0 {
            Shape::Sphere {
                radius_mm: f64::from(rng.between(20.0, 60.0)),
            }
        } else {
            shapes[rng.below(shapes.len())]
        };
        let friction = f64::from(rng.between(0.4, 1.0));
        let contact = Contact::new(Arc::clone(skin), Arc::new(shape), friction, Mount::default())?;
        press(contact, touch, &mut rng, &mut camera)?;
    }
    Ok(camera.sensor)
}

/// Presses, pulls, turns and releases; takes two pictures of every state. A state without solution ends the touch.
fn press(
    mut contact: Contact,
    touch: usize,
    rng: &mut Rng,
    camera: &mut Camera<'_>,
) -> Result<(), SimulationError> {
    let mut drive = Drive {
        press: Press::Force(0.0),
        at_mm: [0, 1].map(|_| f64::from(rng.between(-13.0, 13.0))),
        turn_rad: f64::from(rng.between(0.0, std::f32::consts::TAU)),
        tilt_rad: [0.0; 2],
    };
    let peak_n = (rng.between(PEAK_N[0].ln(), PEAK_N[1].ln())).exp();
    let pull = [0, 1].map(|_| f64::from(rng.between(-0.09, 0.09)) * f64::from(peak_n).sqrt());
    let turn = f64::from(rng.between(-0.02, 0.02));
    let mut loads = vec![LIGHTEST_N];
    while loads[loads.len() - 1] * GROWTH < peak_n {
        loads.push(loads[loads.len() - 1] * GROWTH);
    }
    let pressed = loads.len();
    // Held while it is pulled and turned, then released.
    loads.extend([peak_n; 9]);
    loads.extend((1..=6).map(|step| peak_n * 0.6_f32.powi(step)));
    for (state, &load_n) in loads.iter().enumerate() {
        drive.press = Press::Force(load_n.into());
        if (pressed..pressed + 9).contains(&state) {
            drive.at_mm = [0, 1].map(|k| drive.at_mm[k] + pull[k]);
            drive.turn_rad += turn;
        }
        if contact.go_to(drive, 2).is_err() {
            return Ok(());
        }
        for _ in 0..2 {
            camera.take(Some(contact.truth()), touch, state)?;
        }
    }
    Ok(())
}

/// The camera of one sensor and its pictures.
struct Camera<'a> {
    fingertip: &'a mut Fingertip,
    brightness: f64,
    rng: Rng,
    crop: Image,
    sensor: Sensor,
}

impl Camera<'_> {
    fn take(&mut self, truth: Option<&Truth>, touch: usize, state: usize) -> Result<(), SimulationError> {
        let drift = if self.rng.below(2) == 0 {
            0.0
        } else {
            self.rng.between(-DRIFT, DRIFT)
        };
        self.fingertip
            .set_brightness(self.brightness * f64::from(1.0 + drift))?;
        match truth {
            Some(truth) => self.fingertip.render(truth, &mut self.crop),
            None => self.crop = self.fingertip.rest_image(),
        }
        if self.sensor.pictures.len().is_multiple_of(FAULTY_EVERY) {
            for fault in CameraFault::ALL {
                let shown = fault.of(&self.crop, self.sensor.pictures.len() as u64);
                self.sensor.faulty.push((fault, block_mean_88(&shown.pixels)));
            }
        }
        self.sensor.pictures.push(Picture {
            image: block_mean_88(&self.crop.pixels),
            forces: truth.map_or(NO_FORCES, Truth::force_map),
            touch,
            state,
        });
        Ok(())
    }
}

/// The sensor surface that all sensors share.
pub(crate) fn skin() -> Result<Arc<GelSurface>, SimulationError> {
    GelSurface::new(&Gel::default(), CELLS).map(Arc::new)
}
