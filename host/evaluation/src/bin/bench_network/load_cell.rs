//! A fingertip's gain, as `gripline calibrate gel` finds it: a ball is pressed at twelve places, and a scale tells the forces.

use std::io::ErrorKind;
use std::path::Path;

use gripline_evaluation::calibration::gel::{self, Moment, Press};
use gripline_network::{NO_FORCES, Network};
use gripline_simulation::constants::REST_PICTURES;
use gripline_simulation::scene_file::{Scene, SceneFile};
use gripline_simulation::{Fingertip, FingertipParams, Image, PressWorld, Random};

use crate::failure::Failure;

const PRESSES: usize = 12;
const BALL_MM: f64 = 6.0;
/// Loads, N, and how far from the middle, mm.
const LOAD_N: [f64; 2] = [0.5, 3.0];
const PLACE_MM: f64 = 5.0;
/// Pictures a second: one at the end of each of a press's three steps, which go over the place, press and lift; the second counts.
const RATE_HZ: f64 = 10.0;
const CONFIDENCE: f64 = 0.9;
/// Of the random numbers, beside those that make the fingertip.
const PURPOSE: u64 = 0x6C6F_6164;

/// The factors on shear and normal force for this network's maps of a virtual fingertip.
pub(crate) fn gain(unit: u64, network: &Network) -> Result<[f32; 2], Failure> {
    let mut random = Random::new(unit, PURPOSE);
    let mut text = format!(
        "kind = \"press\"\n[indenter]\nshape = \"sphere\"\nradius_mm = {BALL_MM:.1}\nfriction = 0.65\n"
    );
    let mut loads = Vec::new();
    for _ in 0..PRESSES {
        let [x, y] = [0, 1].map(|_| random.uniform(-PLACE_MM, PLACE_MM));
        let load = random.uniform(LOAD_N[0], LOAD_N[1]);
        loads.push(load);
        for press_n in [0.0, load, 0.0] {
            let step = format!("[[path]]\nseconds = 0.1\npress_n = {press_n:.6}\nat_mm = [{x:.6}, {y:.6}]\n");
            text += &step;
        }
    }
    let nothing = &mut |_: &Path| Err(ErrorKind::NotFound.into());
    let Scene::Press(scene) = SceneFile::parse(Path::new("presses.toml"), &text, nothing)?.scene else {
        return Err("the presses are another scene".into());
    };
    let params = FingertipParams::of_sensor(unit);
    let mut fingertip = Fingertip::new(unit, params)?;
    let mut network = network.clone();
    network.set_rest(&fingertip.mean_rest_image(REST_PICTURES).pixels);
    let mut world = PressWorld::new(&scene, &params.gel, RATE_HZ)?;
    let (mut picture, mut map) = (Image::crop(), NO_FORCES);
    let mut presses = Vec::new();
    let mut number = 0;
    while let Some(frame) = world.advance()? {
        number += 1;
        if number % 3 != 2 {
            continue;
        }
        fingertip.render(frame.truth, &mut picture);
        network.infer(&picture.pixels, &mut map);
        let moment = Moment::of(
            f64::from(number) / RATE_HZ,
            &map.map(|force| force.map(f64::from)),
        );
        presses.push(Press {
            span_s: [moment.t_s; 2],
            frames: 1,
            raw_n: moment.raw_n,
            place: moment.place,
            creep: None,
            day: 0,
        });
    }
    let truth: Vec<[f64; 3]> = loads.iter().map(|load| [0.0, 0.0, *load]).collect();
    let fit = gel::fit(&presses, &truth, false, CONFIDENCE)?;
    Ok(fit.gains().map(|gain| gain as f32))
}
