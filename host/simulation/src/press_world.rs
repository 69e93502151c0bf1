//! Plays a scene of kind `press`: an indenter follows its path over one gel, looked at frame by frame. Units: mm,
//! N, s, rad. Between frames the path is cut into steps that the contact solver likes: at most half a cell of
//! sliding, an eighth of the press. Limits: those of the contact world; the mount is rigid.

use std::sync::Arc;

use crate::contact_world::{Contact, Drive, GelSurface, Mount, Press, Truth, production_cells};
use crate::error::SimulationError;
use crate::gel::Gel;
use crate::scene_file::{PathStep, PressScene};

/// Steps that a press from nothing to its force is made in.
const STEPS_PER_PRESS: f64 = 8.0;
/// Deepening in one step, mm.
const STEP_DEPTH_MM: f64 = 0.05;
/// Sliding in one step, cells.
const STEP_SLIDE_CELLS: f64 = 0.5;
/// Tilting in one step, rad.
const STEP_TILT_RAD: f64 = 0.01;
/// Where a turn counts as sliding, mm from the origin: a usual contact's rim.
const RIM_MM: f64 = 6.0;
/// Depth that surely needs [`FIRM_N`]: a 12 mm ball on the default layer does.
const FIRM_MM: f64 = 0.5;
/// Force from which the grid may be coarse, N.
const FIRM_N: f64 = 1.5;
/// Steps of a pull at most; one that friction cannot hold is found on the way.
const MAX_PULLS: f64 = 64.0;
/// How much smaller steps are when the first try does not converge.
const SMALLER: u32 = 4;
/// Times this close are one, s.
const SAME_S: f64 = 1e-9;

/// A scene in progress.
#[derive(Debug)]
pub struct PressWorld {
    contact: Contact,
    pitch_mm: f64,
    path: Vec<PathStep>,
    frame_s: f64,
    frames: usize,
    frame: usize,
    /// The step in progress, when it began and what held then.
    step: usize,
    began_s: f64,
    from: Drive,
    /// What pulled when it began.
    from_load: [f64; 3],
    time_s: f64,
    drive: Drive,
}

/// One instant of the scene.
#[derive(Debug)]
pub struct PressFrame<'a> {
    /// Its number, from 0.
    pub frame: usize,
    /// Time since the start, s.
    pub time_s: f64,
    /// The step of the path that leads here.
    pub step: &'a PathStep,
    /// The pressing force that the path asks for, N; none where it asks for a depth.
    pub load_n: Option<f64>,
    /// The contact.
    pub truth: &'a Truth,
}

/// A frame that could not be reached.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("at {time_s:.3} s, in {phase}: {error}")]
pub struct PressProblem {
    /// The frame's time, s.
    pub time_s: f64,
    /// Line of the path's step in the scene file.
    pub line: usize,
    /// Its name.
    pub phase: String,
    /// What the contact world says.
    #[source]
    pub error: SimulationError,
}

impl PressWorld {
    /// The scene at its start: nothing touches.
    ///
    /// # Errors
    /// A gel or friction outside its range.
    pub fn new(scene: &PressScene, gel: &Gel, frames_per_second: f64) -> Result<Self, SimulationError> {
        let peak_n = scene
            .path
            .iter()
            .map(|step| match step.press {
                Some(Press::Force(force)) => force,
                // What a depth needs is known only when it is solved; so deep even a ball carries a newton and a half.
                Some(Press::Depth(depth)) if depth >= FIRM_MM => FIRM_N,
                Some(Press::Depth(_)) | None => 0.0,
            })
            .fold(0.0, f64::max);
        let surface = Arc::new(GelSurface::new(gel, production_cells(peak_n))?);
        let pitch_mm = surface.pitch_mm();
        let indenter = &scene.indenter;
        let contact = Contact::new(
            surface,
            Arc::clone(&indenter.shape),
            indenter.friction,
            Mount::default(),
        )?;
        let first = scene.path.first();
        let start = Drive {
            press: Press::Force(0.0),
            at_mm: first.and_then(|step| step.at_mm).unwrap_or_default(),
            turn_rad: first.and_then(|step| step.turn_rad).unwrap_or_default(),
            tilt_rad: first.and_then(|step| step.tilt_rad).unwrap_or_default(),
        };
        let mut world = Self {
            contact,
            pitch_mm,
            path: scene.path.clone(),
            frame_s: 1.0 / frames_per_second,
            frames: (scene.seconds() * frames_per_second).round() as usize,
            frame: 0,
            step: 0,
            began_s: 0.0,
            from: start,
            from_load: [0.0; 3],
            time_s: 0.0,
            drive: start,
        };
        world.begin(0);
        Ok(world)
    }

    /// Frames of the whole scene.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The contact now.
    #[must_use]
    pub fn truth(&self) -> &Truth {
        self.contact.truth()
    }

    /// Goes to the next frame; none after the last. After a problem the contact stays where it was solved last,
    /// and the next call goes on from there.
    ///
    /// # Errors
    /// [`PressProblem`] with the error of the contact world.
    pub fn advance(&mut self) -> Result<Option<PressFrame<'_>>, PressProblem> {
        if self.frame == self.frames {
            return Ok(None);
        }
        let frame = self.frame;
        self.frame += 1;
        let time_s = self.frame as f64 * self.frame_s;
        self.go_to(time_s).map_err(|error| PressProblem {
            time_s,
            line: self.path[self.step].line,
            phase: self.path[self.step].name.clone(),
            error,
        })?;
        Ok(Some(PressFrame {
            frame,
            time_s,
            step: &self.path[self.step],
            load_n: match self.drive.press {
                Press::Force(load_n) => Some(load_n),
                Press::Depth(_) => None,
            },
            truth: self.contact.truth(),
        }))
    }

    fn go_to(&mut self, time_s: f64) -> Result<(), SimulationError> {
        loop {
            let step = &self.path[self.step];
            let (seconds, end_s) = (step.seconds, self.began_s + step.seconds);
            let to_s = time_s.min(end_s);
            let last = self.step + 1 == self.path.len();
            if to_s > self.time_s + SAME_S {
                let part = ((to_s - self.began_s) / seconds).min(1.0);
                let target = self.target(part);
                let load = step
                    .load
                    .map(|to| [0, 1, 2].map(|k| self.from_load[k] + (to[k] - self.from_load[k]) * part));
                // Kept even if it is not reached, so that the scene goes on by the clock.
                self.time_s = to_s;
                match load {
                    Some(load) => self.pull_to(target, load)?,
                    None => self.move_to(target)?,
                }
            }
            if last || time_s <= end_s + SAME_S {
                return Ok(());
            }
            self.began_s = end_s;
            self.begin(self.step + 1);
        }
    }

    /// Starts a step of the path from where the last one has led.
    fn begin(&mut self, step: usize) {
        self.step = step;
        let truth = self.contact.truth();
        self.from = self.drive;
        self.from_load = pulled(truth);
        self.from.press = match (self.path[step].press, self.drive.press) {
            (Some(Press::Force(_)), Press::Depth(_)) => Press::Force(truth.force_n()[2]),
            (Some(Press::Depth(_)), Press::Force(_)) => Press::Depth(truth.pose().depth_mm.max(0.0)),
            (_, press) => press,
        };
    }

    /// Where the step in progress is after `part` of its time.
    fn target(&self, part: f64) -> Drive {
        let step = &self.path[self.step];
        let between = |a: f64, b: f64| a + (b - a) * part;
        let pair = |from: [f64; 2], to: Option<[f64; 2]>| {
            to.map_or(from, |to| [between(from[0], to[0]), between(from[1], to[1])])
        };
        Drive {
            press: match (self.from.press, step.press) {
                (Press::Force(a), Some(Press::Force(b))) => Press::Force(between(a, b)),
                (Press::Depth(a), Some(Press::Depth(b))) => Press::Depth(between(a, b)),
                (press, _) => press,
            },
            at_mm: pair(self.from.at_mm, step.at_mm),
            turn_rad: step
                .turn_rad
                .map_or(self.from.turn_rad, |to| between(self.from.turn_rad, to)),
            tilt_rad: pair(self.from.tilt_rad, step.tilt_rad),
        }
    }

    fn move_to(&mut self, target: Drive) -> Result<(), SimulationError> {
        let steps = self.steps_to(&target);
        self.drive = target;
        match self.contact.go_to(target, steps) {
            Err(SimulationError::ContactUnsolved { .. }) => {
                self.contact.go_to(target, steps * SMALLER).map(|_| ())
            }
            other => other.map(|_| ()),
        }
    }

    /// To a load along the gel in steps of an eighth of what friction holds.
    fn pull_to(&mut self, target: Drive, load: [f64; 3]) -> Result<(), SimulationError> {
        let (from, before) = (self.drive, pulled(self.contact.truth()));
        let normal = self.contact.truth().force_n()[2].max(f64::MIN_POSITIVE);
        let max_n = self.contact.friction() * normal;
        let jump =
            libm::hypot(load[0] - before[0], load[1] - before[1]).max((load[2] - before[2]).abs() / RIM_MM);
        let by_load = (STEPS_PER_PRESS * jump / max_n).min(MAX_PULLS).ceil() as u32;
        let steps = self.steps_to(&target).max(by_load);
        for step in 1..=steps {
            let part = f64::from(step) / f64::from(steps);
            let between = |a: f64, b: f64| a + (b - a) * part;
            let press = match (from.press, target.press) {
                (Press::Force(a), Press::Force(b)) => Press::Force(between(a, b)),
                (Press::Depth(a), Press::Depth(b)) => Press::Depth(between(a, b)),
                (_, press) => press,
            };
            let tilt = [0, 1].map(|k| between(from.tilt_rad[k], target.tilt_rad[k]));
            let load = [0, 1, 2].map(|k| between(before[k], load[k]));
            let pose = self.contact.pull(press, tilt, load)?.pose();
            self.drive = Drive {
                press,
                at_mm: pose.at_mm,
                turn_rad: pose.turn_rad,
                tilt_rad: tilt,
            };
        }
        Ok(())
    }

    /// Steps of the solver from where the drive is now.
    fn steps_to(&self, target: &Drive) -> u32 {
        let press = match (self.drive.press, target.press) {
            (Press::Force(a), Press::Force(b)) => {
                let end = match self.path[self.step].press {
                    Some(Press::Force(end)) => end,
                    _ => b,
                };
                STEPS_PER_PRESS * (b - a).abs() / end.max(a).max(b).max(f64::MIN_POSITIVE)
            }
            (Press::Depth(a), Press::Depth(b)) => (b - a).abs() / STEP_DEPTH_MM,
            // A change of kind begins where the contact is.
            _ => STEPS_PER_PRESS,
        };
        let distance = |from: [f64; 2], to: [f64; 2]| libm::hypot(to[0] - from[0], to[1] - from[1]);
        let slide = distance(self.drive.at_mm, target.at_mm)
            .max(RIM_MM * (target.turn_rad - self.drive.turn_rad).abs())
            / (STEP_SLIDE_CELLS * self.pitch_mm);
        let tilt = distance(self.drive.tilt_rad, target.tilt_rad) / STEP_TILT_RAD;
        press.max(slide).max(tilt).ceil().max(1.0) as u32
    }
}

/// Force along x and y, N, and moment about where the indenter stands, N·mm, that it takes to hold the indenter.
fn pulled(truth: &Truth) -> [f64; 3] {
    let [x, y, _] = truth.force_n();
    [x, y, truth.torsional_moment_nmm(truth.footprint_mm())]
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::path::Path;

    use super::*;
    use crate::scene_file::{Scene, SceneFile};

    fn world(path: &str) -> PressWorld {
        let text = format!("kind = \"press\"\n[indenter]\nshape = \"sphere\"\n{path}");
        let nothing = &mut |_: &Path| Err(io::ErrorKind::NotFound.into());
        let file = SceneFile::parse(Path::new("scene.toml"), &text, nothing).unwrap();
        let Scene::Press(scene) = file.scene else {
            panic!("no press")
        };
        PressWorld::new(&scene, &Gel::default(), 20.0).unwrap()
    }

    #[test]
    fn a_step_by_load_ends_with_that_load_and_one_beyond_friction_is_refused() {
        let mut world = world(
            "[[path]]\nname = \"press\"\nseconds = 0.2\npress_n = 2.0\n\
             [[path]]\nname = \"pull\"\nseconds = 0.4\npull_n = [0.5, -0.3]\nmoment_nmm = 0.4\n\
             [[path]]\nname = \"let go\"\nseconds = 0.2\npull_n = [0, 0]\n\
             [[path]]\nname = \"too much\"\nseconds = 0.2\npull_n = [3, 0]\n",
        );
        let mut loads = Vec::new();
        let problem = loop {
            match world.advance() {
                Ok(Some(frame)) => loads.push((frame.step.name.clone(), pulled(frame.truth))),
                Ok(None) => panic!("held"),
                Err(problem) => break problem,
            }
        };
        let off = |frame: usize, asked: [f64; 3]| {
            let (_, found) = &loads[frame];
            (0..3).map(|k| (found[k] - asked[k]).abs()).fold(0.0, f64::max)
        };
        assert_eq!(loads[7].0, "pull");
        assert!(off(5, [0.125, -0.075, 0.1]) < 1e-3 && off(7, [0.25, -0.15, 0.2]) < 1e-3);
        assert!(off(11, [0.5, -0.3, 0.4]) < 1e-3, "{:?}", loads[11]);
        assert!(off(15, [0.0; 3]) < 1e-3, "{:?}", loads[15]);
        assert_eq!(problem.phase, "too much");
        assert!(
            problem.to_string().contains("slides the indenter away"),
            "{problem}"
        );
    }

    #[test]
    fn the_path_is_followed_step_by_step_and_ends_lifted() {
        let mut world = world(
            "[[path]]\nname = \"press\"\nseconds = 0.4\npress_n = 2.0\nat_mm = [1, 0]\n\
             [[path]]\nname = \"deeper\"\nseconds = 0.2\ndepth_mm = 0.7\n\
             [[path]]\nname = \"drag\"\nseconds = 0.4\nat_mm = [1.4, 0]\nturn_deg = 3\n\
             [[path]]\nname = \"lift\"\nseconds = 0.2\npress_n = 0\n",
        );
        assert_eq!(world.frames(), 24);
        let (mut frames, mut drag) = (Vec::new(), None);
        while let Some(frame) = world.advance().unwrap() {
            let force = frame.truth.force_n();
            assert!((frame.time_s - 0.05 * (frames.len() + 1) as f64).abs() < 1e-9);
            if frame.step.name == "drag" {
                drag = Some((
                    frame.truth.pose(),
                    force[0],
                    frame.truth.torsional_moment_nmm([1.0, 0.0]),
                ));
            }
            frames.push((frame.step.name.clone(), force[2], frame.truth.pose().depth_mm));
        }
        let names: Vec<&str> = frames.iter().map(|frame| &*frame.0).collect();
        assert_eq!(
            names,
            [
                ["press"; 8].as_slice(),
                &["deeper"; 4],
                &["drag"; 8],
                &["lift"; 4]
            ]
            .concat()
        );
        for (k, frame) in frames[..8].iter().enumerate() {
            assert!(
                (frame.1 - 0.25 * (k + 1) as f64).abs() < 1e-3,
                "{k}: {} N",
                frame.1
            );
        }
        assert!(frames[8].2 > frames[7].2 && (frames[11].2 - 0.7).abs() < 1e-9);
        let (pose, pull, torsion) = drag.unwrap();
        assert!((pose.at_mm[0] - 1.4).abs() < 1e-9 && (pose.turn_rad - 3.0_f64.to_radians()).abs() < 1e-9);
        // The gel is taken along: forces and moment in the direction of the motion.
        assert!(pull > 0.1 && torsion > 0.1, "{pull} N, {torsion} N·mm");
        assert!(frames[20].1 < frames[19].1 && frames[23].1 == 0.0);
    }

    #[test]
    fn what_leaves_the_sensor_on_the_way_is_reported_with_time_and_line_and_the_contact_stays() {
        let mut world = world(
            "[[path]]\nname = \"press\"\nseconds = 0.2\npress_n = 2\nat_mm = [9, 0]\n\
             [[path]]\nname = \"drag\"\nseconds = 1\nat_mm = [16, 0]\n",
        );
        let mut last = 0.0;
        let problem = loop {
            match world.advance() {
                Ok(Some(frame)) => last = frame.truth.footprint_mm()[0],
                Ok(None) => panic!("stayed inside at {last} mm"),
                Err(problem) => break problem,
            }
        };
        assert!(last > 9.5, "{last}");
        assert_eq!((problem.line, &*problem.phase), (9, "drag"));
        assert!(
            matches!(problem.error, SimulationError::OffSurface { .. }),
            "{problem}"
        );
        let text = problem.to_string();
        assert!(
            text.starts_with("at ") && text.contains("in drag: the contact of the indenter"),
            "{text}"
        );
    }
}
