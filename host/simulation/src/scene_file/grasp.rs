//! The sections of a scene of kind `grasp`: object, gripper, arm, pulls, phases, and who sets the grip force.

use std::borrow::Cow;

use super::error::SceneError;
use super::named_file::Load;
use super::press::{check_length, check_name};
use super::section::Section;
use super::sensor::Sensor;
use super::{indenter, keys};
use crate::contact_world::production_cells;
use crate::fingertip::FingertipParams;
use crate::grasp::{
    ArmMotion, Course, GraspScene, Gripper, OBJECTS, Object, Patch, Phase, Pull, Stroke, Table,
};

/// Who sets the grip-force line.
#[derive(Debug, Clone, PartialEq)]
pub enum Policy {
    /// Always this force, N.
    Fixed(f64),
    /// Forces over time, N.
    Schedule(Course),
    /// Gripline's own network, detector and controller, with this least grip, N.
    Gripline {
        /// The least grip.
        floor_n: f64,
    },
}

/// A grasp and what is known beside it.
#[derive(Debug, Clone)]
pub struct GraspFile {
    /// The scene; its seed is the file's until it is played.
    pub scene: GraspScene,
    /// How long it is, s.
    pub seconds: f64,
    /// Who sets the grip force.
    pub policy: Policy,
    /// Line of `[grasp]` in the file, from 1.
    pub line: usize,
}

/// Slowest frames with which the microcontroller's safety does not see stale maps, Hz.
const GRIPLINE_RATE_HZ: f64 = 20.0;

/// Reads the sections of a grasp under the file's head.
pub(super) fn read(
    head: &Section,
    rate_hz: f64,
    sensor: &Sensor,
    load: &mut Load,
) -> Result<GraspFile, SceneError> {
    let grasp = head.required("grasp")?;
    let seconds = grasp.number(&keys::GRASP_SECONDS)?;
    check_length(&grasp, keys::GRASP_SECONDS.name, seconds, rate_hz)?;
    if rate_hz < 10.0 {
        return Err(head.problem(
            keys::FRAMES_PER_SECOND.name,
            &rate_hz.to_string(),
            "at least 10 Hz in a grasp",
            "raise it: the object moves on between frames",
        ));
    }
    let mut scene = GraspScene::new(object(head, load)?);
    let held_until_s = grasp.number(&keys::HELD_UNTIL)?;
    (scene.table, scene.held_until_s) = match grasp.text(&keys::START)? {
        "hand" => (None, held_until_s),
        _ => (Some(Table::default()), 0.0),
    };
    scene.grip_point_mm = grasp.numbers_if(&keys::GRIP_POINT)?.unwrap_or_default();
    scene.turn_rad = grasp.number(&keys::GRASP_TURN)?.to_radians();
    scene.drop_mm = grasp.number(&keys::DROP)?;
    if let Some(course) = grasp.course_if(&keys::GRAVITY)? {
        let knots = course.iter().map(|[time, angle]| [*time, angle.to_radians()]);
        scene.gravity_turn_rad = Course::smooth(knots.collect());
    }
    grasp.finish("this section")?;
    scene.gripper = gripper(head)?;
    scene.arm = ArmMotion {
        strokes: head
            .sections_if("arm")?
            .iter()
            .map(stroke)
            .collect::<Result<_, _>>()?,
    };
    scene.pulls = head
        .sections_if("pull")?
        .iter()
        .map(pull)
        .collect::<Result<_, _>>()?;
    scene.phases = phases(head)?;
    let second = sensor.unit.map_or(sensor.params, |unit| FingertipParams {
        jpeg_quality: sensor.params.jpeg_quality,
        brightness_motion: sensor.params.brightness_motion,
        gel: sensor.params.gel,
        ..FingertipParams::of_sensor(unit + 1)
    });
    scene.fingertips = [sensor.params, second];
    let policy = policy(head, rate_hz)?;
    let peak_n = match &policy {
        Policy::Fixed(force) => *force,
        // From its least grip on it grips harder.
        Policy::Gripline { floor_n } => *floor_n,
        Policy::Schedule(course) => (0..1000)
            .map(|k| course.at(seconds * f64::from(k) / 1000.0))
            .fold(0.0, f64::max),
    };
    scene.cells = production_cells(peak_n);
    Ok(GraspFile {
        scene,
        seconds,
        policy,
        line: grasp.line,
    })
}

fn object(head: &Section, load: &mut Load) -> Result<Object, SceneError> {
    let section = head.required("object")?;
    let name = section.text(&keys::OBJECT_NAME)?;
    let patch = match head.section("indenter")? {
        Some(section) => Some(indenter::read(&section, load)?),
        None => None,
    };
    let known = OBJECTS
        .iter()
        .find(|object| object.name.split(',').next() == Some(name));
    let mass_g = section.number_if(&keys::MASS)?;
    let size_mm = section.numbers_if::<3>(&keys::SIZE)?;
    let inertia_g_mm2 = section.number_if(&keys::INERTIA)?;
    let centre_mm = section.numbers_if::<2>(&keys::CENTRE)?;
    let patch_turn_rad = section.number_if(&keys::PATCH_TURN)?.map(f64::to_radians);
    let own = " with name = \"own\"";
    let mass = |known: Option<f64>| mass_g.or(known).ok_or_else(|| section.missing(&keys::MASS, own));
    let size = |known: Option<[f64; 3]>| size_mm.or(known).ok_or_else(|| section.missing(&keys::SIZE, own));
    let mut object = if let Some(known) = known {
        known.clone()
    } else {
        let Some(patch) = &patch else {
            return Err(head.problem(
                "indenter",
                &format!("nothing{own}"),
                "a section [indenter] with the patch that the fingers touch",
                "begin it with a line [indenter]",
            ));
        };
        Object {
            name: Cow::Borrowed("own"),
            mass_g: mass(None)?,
            inertia_g_mm2: 0.0,
            centre_of_mass_mm: [0.0; 2],
            size_mm: size(None)?,
            patch: Patch::Any(patch.shape.clone()),
            patch_turn_rad: 0.0,
            friction: [patch.friction; 2],
        }
    };
    let same = known.is_some() && mass_g.is_none() && size_mm.is_none();
    object.mass_g = mass(Some(object.mass_g))?;
    object.size_mm = size(Some(object.size_mm))?;
    object.inertia_g_mm2 = match inertia_g_mm2 {
        Some(given) => given,
        None if same => object.inertia_g_mm2,
        None => object.mass_g * (object.size_mm[0].powi(2) + object.size_mm[1].powi(2)) / 12.0,
    };
    object.centre_of_mass_mm = centre_mm.unwrap_or(object.centre_of_mass_mm);
    object.patch_turn_rad = patch_turn_rad.unwrap_or(object.patch_turn_rad);
    if let Some(patch) = patch {
        object.patch = Patch::Any(patch.shape);
        object.friction = [patch.friction; 2];
    }
    section.finish("this section")?;
    Ok(object)
}

fn gripper(head: &Section) -> Result<Gripper, SceneError> {
    let Some(section) = head.section("gripper")? else {
        return Ok(Gripper::default());
    };
    let gripper = Gripper {
        dead_time_s: section.number(&keys::DEAD_TIME)?,
        lag_s: section.number(&keys::LAG)?,
        rate_n_per_s: section.number(&keys::RATE)?,
        min_n: section.number(&keys::MIN_FORCE)?,
        max_n: section.number(&keys::MAX_FORCE)?,
        ..Gripper::default()
    };
    if gripper.max_n <= gripper.min_n {
        let found = gripper.max_n.to_string();
        let expected = format!("more than min_n, {}", gripper.min_n);
        return Err(section.problem(keys::MAX_FORCE.name, &found, &expected, "raise it"));
    }
    section.finish("this section")?;
    Ok(gripper)
}

fn stroke(section: &Section) -> Result<Stroke, SceneError> {
    let kind = section.text(&keys::STROKE)?;
    let from_s = section.number(&keys::ARM_FROM)?;
    let duration_s = section.number(&keys::ARM_SECONDS)?;
    let by_mm = section.numbers_if(&keys::ARM_BY)?.unwrap_or_default();
    let by = format!("stroke = \"{kind}\"");
    let needed = |key| -> Result<f64, SceneError> {
        section
            .number_if(key)?
            .ok_or_else(|| section.missing(key, &format!(" with {by}")))
    };
    let stroke = match kind {
        "dash" => {
            let stop_s = needed(&keys::STOP)?;
            if stop_s >= duration_s {
                let expected = format!("less than seconds, {duration_s}");
                return Err(section.problem(keys::STOP.name, &stop_s.to_string(), &expected, "stop faster"));
            }
            Stroke::Dash {
                from_s,
                duration_s,
                by_mm,
                stop_s,
            }
        }
        "shake" => {
            let frequency_hz = needed(&keys::FREQUENCY)?;
            let min_s = 2.0 / frequency_hz;
            if duration_s < min_s - 1e-9 {
                let expected = format!("at least two periods, {min_s} s");
                let found = duration_s.to_string();
                return Err(section.problem(
                    keys::ARM_SECONDS.name,
                    &found,
                    &expected,
                    "shake longer or faster",
                ));
            }
            Stroke::Shake {
                from_s,
                duration_s,
                amplitude_mm: by_mm,
                frequency_hz,
            }
        }
        _ => Stroke::Move {
            from_s,
            duration_s,
            by_mm,
        },
    };
    section.finish(&by)?;
    Ok(stroke)
}

fn pull(section: &Section) -> Result<Pull, SceneError> {
    let course = section.course_if(&keys::PULL_COURSE)?.unwrap_or_default();
    Ok(Pull {
        force_n: section.numbers_if(&keys::PULL_FORCE)?.unwrap_or_default(),
        torsional_moment_nmm: section.number(&keys::PULL_MOMENT)?,
        at_mm: section.numbers_if(&keys::PULL_AT)?.unwrap_or_default(),
        course: Course::smooth(course),
    })
}

fn phases(head: &Section) -> Result<Vec<Phase>, SceneError> {
    let mut phases: Vec<Phase> = Vec::new();
    for section in head.sections_if("phase")? {
        let name = section.text(&keys::PHASE_NAME)?;
        check_name(&section, keys::PHASE_NAME.name, name)?;
        let from_s = section.number(&keys::PHASE_FROM)?;
        let from_us = (from_s * 1e6).round() as u64;
        if phases.last().is_some_and(|last| last.from_us >= from_us) {
            return Err(section.problem(
                keys::PHASE_FROM.name,
                &from_s.to_string(),
                "a time after the phase before",
                "put the phases in order",
            ));
        }
        phases.push(Phase {
            name: Cow::Owned(name.to_owned()),
            from_us,
        });
    }
    Ok(phases)
}

fn policy(head: &Section, rate_hz: f64) -> Result<Policy, SceneError> {
    let section = head.required("policy")?;
    let kind = section.text(&keys::POLICY)?;
    let with = format!("kind = \"{kind}\"");
    let force = || {
        section
            .number_if(&keys::POLICY_FORCE)?
            .ok_or_else(|| section.missing(&keys::POLICY_FORCE, &format!(" with {with}")))
    };
    let policy = match kind {
        "schedule" => {
            let course = section
                .course_if(&keys::POLICY_COURSE)?
                .ok_or_else(|| section.missing(&keys::POLICY_COURSE, &format!(" with {with}")))?;
            Policy::Schedule(Course::linear(course))
        }
        "gripline" => {
            if rate_hz < GRIPLINE_RATE_HZ {
                return Err(section.problem(
                    keys::POLICY.name,
                    &format!("\"gripline\" at {rate_hz} Hz"),
                    "at least 20 Hz, below which its maps count as stale",
                    "raise frames_per_second",
                ));
            }
            Policy::Gripline { floor_n: force()? }
        }
        _ => Policy::Fixed(force()?),
    };
    section.finish(&with)?;
    Ok(policy)
}
