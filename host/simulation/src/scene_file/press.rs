//! The sections of a scene of kind `press`: an indenter and its path over one fingertip. Angles are degrees in
//! the file and radians here.

use super::error::SceneError;
use super::indenter::{self, Indenter};
use super::keys;
use super::named_file::Load;
use super::section::Section;
use crate::constants::HALF_SURFACE_MM;
use crate::contact_world::Press;

/// Most frames of a scene: their force maps stay in memory until they are written.
const FRAMES_MAX: f64 = 100_000.0;
/// Distance of the points at which the indenter's lowest plane is looked for, mm.
const LOOK_MM: f64 = 0.4;
/// Heights under this belong to the lowest plane, mm.
const LOWEST_MM: f64 = 1e-6;
/// The outermost cell of the coarsest grid of the gel, mm.
const EDGE_MM: f64 = 0.8;

/// One indenter and what it does.
#[derive(Debug, Clone)]
pub struct PressScene {
    /// What presses.
    pub indenter: Indenter,
    /// The steps of the path, at least one.
    pub path: Vec<PathStep>,
}

/// One step of the path; what is not given stays as it was.
#[derive(Debug, Clone, PartialEq)]
pub struct PathStep {
    /// The phase's name.
    pub name: String,
    /// Line of the step in its file, from 1.
    pub line: usize,
    /// How long it takes, s.
    pub seconds: f64,
    /// How it presses at its end.
    pub press: Option<Press>,
    /// Where the indenter's origin is at its end, mm.
    pub at_mm: Option<[f64; 2]>,
    /// Its turn at the end, rad.
    pub turn_rad: Option<f64>,
    /// Force along x and y, N, and moment about z, N·mm, that act on it at the end, instead of a place.
    pub load: Option<[f64; 3]>,
    /// Its tilt at the end, rad.
    pub tilt_rad: Option<[f64; 2]>,
}

impl PressScene {
    /// Time of the whole path, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.path.iter().map(|step| step.seconds).sum()
    }
}

/// Reads `[indenter]` and `[[path]]` under the file's head.
pub(super) fn read(head: &Section, rate_hz: f64, load: &mut Load) -> Result<PressScene, SceneError> {
    let indenter = indenter::read(&head.required("indenter")?, load)?;
    let sections = head.sections("path")?;
    let mut path = Vec::with_capacity(sections.len());
    let (mut at_mm, mut turn_rad, mut tilt_rad, mut pressed) = ([0.0; 2], 0.0, [0.0; 2], false);
    let mut seconds = 0.0;
    for (place, section) in sections.iter().enumerate() {
        let step = step(section, place)?;
        let stays = place == 0 || step.at_mm.is_none_or(|to| same(to, at_mm));
        at_mm = step.at_mm.unwrap_or(at_mm);
        turn_rad = step.turn_rad.unwrap_or(turn_rad);
        tilt_rad = step.tilt_rad.unwrap_or(tilt_rad);
        let presses = step.press.map_or(pressed, |press| match press {
            Press::Force(force) => force > 0.0,
            Press::Depth(depth) => depth > 0.0,
        });
        if presses && !pressed && stays && same(tilt_rad, [0.0; 2]) {
            stays_on_the_skin(section, &indenter, at_mm, turn_rad)?;
        }
        pressed = presses;
        seconds += step.seconds;
        if seconds * rate_hz >= 0.5 || place + 1 == sections.len() {
            check_length(section, keys::SECONDS.name, seconds, rate_hz)?;
        }
        path.push(step);
    }
    Ok(PressScene { indenter, path })
}

/// Whether two pairs say the same.
fn same(one: [f64; 2], other: [f64; 2]) -> bool {
    one.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-9)
}

/// A name that can stand in a cell of truth.csv.
pub(super) fn check_name(section: &Section, key: &str, name: &str) -> Result<(), SceneError> {
    let plain = |c: char| c.is_ascii_alphanumeric() || " -_".contains(c);
    if !name.is_empty() && name.len() <= 40 && name.chars().all(plain) {
        return Ok(());
    }
    Err(section.problem(
        key,
        &format!("{name:?}"),
        "1 to 40 letters, digits, spaces, - or _",
        "it becomes a cell of truth.csv: choose another name",
    ))
}

/// The error of a scene without or with too many frames, at the key that says how long it is.
pub(super) fn check_length(
    section: &Section,
    key: &str,
    seconds: f64,
    rate_hz: f64,
) -> Result<(), SceneError> {
    if seconds * rate_hz > FRAMES_MAX {
        return Err(section.problem(
            key,
            &format!("{} frames up to here", (seconds * rate_hz) as u64),
            &format!("at most {FRAMES_MAX} in a scene"),
            "shorten it or lower frames_per_second",
        ));
    }
    if seconds * rate_hz < 0.5 {
        return Err(section.problem(
            key,
            &format!("a scene of {seconds} s at {rate_hz} Hz"),
            "at least one frame",
            "lengthen it or raise frames_per_second",
        ));
    }
    Ok(())
}

fn step(section: &Section, place: usize) -> Result<PathStep, SceneError> {
    let name = section
        .text_if(&keys::PATH_NAME)?
        .map_or_else(|| format!("step {}", place + 1), ToOwned::to_owned);
    check_name(section, keys::PATH_NAME.name, &name)?;
    let press = match (section.number_if(&keys::PRESS)?, section.number_if(&keys::DEPTH)?) {
        (Some(_), Some(_)) => {
            return Err(section.problem(
                keys::DEPTH.name,
                "a depth beside press_n",
                "one of press_n and depth_mm",
                "remove one of them",
            ));
        }
        (Some(force), None) => Some(Press::Force(force)),
        (None, Some(depth)) => Some(Press::Depth(depth)),
        (None, None) => None,
    };
    let at_mm = section.numbers_if(&keys::AT)?;
    let turn_rad = section.number_if(&keys::TURN)?.map(f64::to_radians);
    let tilt_rad = section.numbers_if::<2>(&keys::TILT)?;
    let load = match (
        section.numbers_if::<2>(&keys::PULL)?,
        section.number_if(&keys::MOMENT)?,
    ) {
        (None, None) => None,
        (pull, torsion) => {
            let [x, y] = pull.unwrap_or_default();
            Some([x, y, torsion.unwrap_or_default()])
        }
    };
    for (key, given) in [
        (keys::AT.name, at_mm.is_some()),
        (keys::TURN.name, turn_rad.is_some()),
    ] {
        if given && load.is_some() {
            return Err(section.problem(
                key,
                "a place beside a pull or moment",
                "a step that goes by place or by load",
                "remove one of them",
            ));
        }
    }
    Ok(PathStep {
        name,
        line: section.line,
        seconds: section.number(&keys::SECONDS)?,
        press,
        at_mm,
        turn_rad,
        load,
        tilt_rad: tilt_rad.map(|tilt| tilt.map(f64::to_radians)),
    })
}

/// An indenter without tilt that is set down touches with its whole lowest plane: none of it may lie at the edge of
/// the gel or beyond. What slides there later is found when it happens.
fn stays_on_the_skin(
    section: &Section,
    indenter: &Indenter,
    at_mm: [f64; 2],
    turn_rad: f64,
) -> Result<(), SceneError> {
    let (sin, cos) = libm::sincos(turn_rad);
    let steps = (HALF_SURFACE_MM / LOOK_MM) as i32;
    let beyond = (-steps..=steps)
        .flat_map(|row| (-steps..=steps).map(move |column| [column, row]))
        .map(|place| place.map(|v| LOOK_MM * f64::from(v)))
        .filter(|place| indenter.shape.height_mm(*place) < LOWEST_MM)
        .map(|[x, y]| [at_mm[0] + cos * x - sin * y, at_mm[1] + sin * x + cos * y])
        .find(|place| place.iter().any(|v| v.abs() > HALF_SURFACE_MM - EDGE_MM));
    match beyond {
        None => Ok(()),
        Some([x, y]) => Err(section.problem(
            keys::AT.name,
            &format!("an indenter that touches at ({x:.1}, {y:.1}) mm"),
            "contact inside ±16 mm, the sensing surface",
            "move the indenter inwards or take a smaller one",
        )),
    }
}
