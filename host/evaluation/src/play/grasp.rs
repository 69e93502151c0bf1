//! A scene of kind `grasp` frame by frame, and who sets its grip force. A grasp whose contact does not
//! converge is no evidence from there on: all frames after it count as left out.

use gripline_firmware::sums::TaxelRule;
use gripline_network::scene::GateKind;
use gripline_network::{Architecture, Network};
use gripline_protocol::MapInfo;
use gripline_protocol::message::{Command, Configuration};
use gripline_protocol::{LSB_PER_NEWTON, SensorId};
use gripline_simulation::constants::REST_PICTURES;
use gripline_simulation::grasp::GraspWorld;
use gripline_simulation::scene_file::{FrameSize, GraspFile, Policy, SceneFile};
use gripline_simulation::{Image, SimulationError};

use super::moment::{FingerMoment, Moment, Play, PlayError, REST};
use crate::error::EvaluationError;
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;

/// Names of the columns that only a grasp has.
const GRASP_COLUMNS: [&str; 10] = [
    "line_n",
    "grip_n",
    "object_x_mm",
    "object_y_mm",
    "object_turn_deg",
    "object_vx_mm_per_s",
    "object_vy_mm_per_s",
    "slip_mm_per_s",
    "on_table",
    "dropped",
];

/// A grasp under way.
pub(super) struct GraspPlay {
    file: SceneFile,
    grasp: GraspFile,
    seed: u64,
    world: GraspWorld,
    gripline: Option<Gripline>,
    frame: usize,
    time_s: f64,
    /// Why nothing after a failed step counts.
    lost: Option<String>,
}

impl GraspPlay {
    pub(super) fn new(file: &SceneFile, grasp: &GraspFile, seed: u64) -> Result<Self, EvaluationError> {
        let mut scene = grasp.scene.clone();
        scene.seed = file.sensor.unit.unwrap_or(seed);
        let world = GraspWorld::new(&scene).map_err(|error| {
            let advice = "correct the sections of the grasp";
            file.problem(grasp.line, &error.to_string(), "a grasp that can be", advice)
        })?;
        let mut play = Self {
            file: file.clone(),
            grasp: grasp.clone(),
            seed,
            world,
            gripline: None,
            frame: 0,
            time_s: 0.0,
            lost: None,
        };
        if let Policy::Gripline { floor_n } = grasp.policy {
            let mut rest = Vec::with_capacity(REST_PICTURES.into());
            for picture in 0..REST_PICTURES {
                rest.push(
                    play.rest_number(0, REST + 1 + usize::from(picture), FrameSize::Crop)
                        .pixels,
                );
            }
            play.gripline = Some(Gripline::new(&rest, floor_n)?);
        }
        Ok(play)
    }

    /// The line for the frame that begins now.
    fn line_n(&mut self) -> Result<f64, EvaluationError> {
        Ok(match &self.grasp.policy {
            Policy::Fixed(force) => *force,
            Policy::Schedule(course) => course.at(self.time_s),
            Policy::Gripline { .. } => {
                // What it sees is the frame before this one, as it stands in the folder.
                let picture = match self.frame.checked_sub(1) {
                    Some(number) => self.render(0, number, FrameSize::Crop),
                    None => self.rest_number(0, REST, FrameSize::Crop),
                };
                let frame_s = 1.0 / self.file.frames_per_second;
                match &mut self.gripline {
                    Some(gripline) => gripline.line_n(&picture, self.frame, frame_s)?,
                    None => 0.0,
                }
            }
        })
    }

    /// A picture with the noise of `number`.
    fn picture(&mut self, finger: usize, number: usize, size: FrameSize, touched: bool) -> Image {
        let truth = self.world.truth(finger).clone();
        let (seed, time_s) = (self.seed.wrapping_mul(2).wrapping_add(finger as u64), self.time_s);
        // The parameters were checked when the world was made.
        let Ok(fingertip) = self.world.fingertip(finger) else {
            return Image::crop();
        };
        fingertip.restart_noise(seed, number as u64);
        fingertip.set_time(time_s);
        let mut image = Image::new(0, 0);
        match (size, touched) {
            (FrameSize::Crop, true) => fingertip.render(&truth, &mut image),
            (FrameSize::Full, true) => fingertip.render_frame(&truth, &mut image),
            (FrameSize::Crop, false) => image = fingertip.rest_image(),
            (FrameSize::Full, false) => image = fingertip.rest_frame(),
        }
        image
    }

    fn rest_number(&mut self, finger: usize, number: usize, size: FrameSize) -> Image {
        self.picture(finger, number, size, false)
    }
}

impl Play for GraspPlay {
    fn kind(&self) -> &'static str {
        "grasp"
    }

    fn frames(&self) -> usize {
        (self.grasp.seconds * self.file.frames_per_second).round() as usize
    }

    fn fingers(&self) -> usize {
        2
    }

    fn extra_columns(&self) -> &'static [&'static str] {
        &GRASP_COLUMNS
    }

    /// The middles of the phases, where what they are named after happens, and the last frame; without phases six
    /// moments evenly.
    fn highlights(&self) -> Vec<usize> {
        let frames = self.frames();
        let phases = &self.grasp.scene.phases;
        let starts = phases.iter().map(|phase| phase.from_us as f64 * 1e-6);
        let mut times: Vec<f64> = if phases.is_empty() {
            (0..=5).map(|k| self.grasp.seconds * f64::from(k) / 5.0).collect()
        } else {
            starts.chain([self.grasp.seconds]).collect()
        };
        times.retain(|time_s| *time_s <= self.grasp.seconds);
        let middles = times.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
        let mut chosen: Vec<usize> = middles
            .map(|time_s| ((time_s * self.file.frames_per_second) as usize).min(frames - 1))
            .chain([frames - 1])
            .collect();
        chosen.dedup();
        chosen
    }

    fn advance(&mut self) -> Result<Option<Moment>, PlayError> {
        if self.frame == self.frames() {
            return Ok(None);
        }
        let frame_s = 1.0 / self.file.frames_per_second;
        let unsolved = |time_s: f64, phase: String, why: String| PlayError::Unsolved { time_s, phase, why };
        let next_s = (self.frame + 1) as f64 * frame_s;
        let phase = self.grasp.scene.phase(next_s).into_owned();
        if let Some(why) = &self.lost {
            self.frame += 1;
            return Err(unsolved(next_s, phase, why.clone()));
        }
        let line_n = self.line_n()?;
        self.frame += 1;
        self.time_s = next_s;
        let frame = match self.world.step(frame_s, line_n) {
            Ok(frame) => frame.clone(),
            Err(SimulationError::OffSurface { x_mm, y_mm }) => {
                return Err(PlayError::from(EvaluationError::Scene(self.file.problem(
                    self.grasp.line,
                    &format!(
                        "an object whose contact reaches the edge of the sensor, at ({x_mm:.1}, {y_mm:.1}) mm after \
                         {next_s:.3} s"
                    ),
                    "contact inside ±16 mm",
                    "move grip_point_mm inwards, grip less hard or lower drop_mm",
                ))));
            }
            Err(error @ SimulationError::OutOfRange { .. }) => {
                return Err(PlayError::from(EvaluationError::Step {
                    time_s: next_s,
                    error,
                }));
            }
            Err(error) => {
                let why = format!("no evidence since {next_s:.3} s: {error}");
                self.lost = Some(why.clone());
                return Err(unsolved(next_s, phase, why));
            }
        };
        let object = frame.object;
        let speed = frame
            .fingers
            .iter()
            .map(|finger| finger.slip_speed_mm_per_s)
            .fold(0.0, f64::max);
        let flag = |truth: bool| f64::from(u8::from(truth));
        let fingers = frame
            .fingers
            .iter()
            .enumerate()
            .map(|(finger, truth)| FingerMoment {
                forces: truth.forces,
                stick_ratio: truth.stick_ratio,
                gross_slip: truth.gross_slip,
                slip_mm: truth.slip_mm,
                indentation: self
                    .world
                    .truth(finger)
                    .indentation_share(&self.world.scene().fingertips[finger].gel),
                states: self.world.truth(finger).states().to_vec(),
            });
        Ok(Some(Moment {
            time_s: next_s,
            phase,
            slip: frame.slip,
            fingers: fingers.collect(),
            extra: vec![
                frame.line_n,
                frame.grip_n,
                object.at_mm[0],
                object.at_mm[1],
                object.turn_rad.to_degrees(),
                object.velocity_mm_per_s[0],
                object.velocity_mm_per_s[1],
                speed,
                flag(frame.on_table),
                flag(frame.dropped),
            ],
        }))
    }

    fn render(&mut self, finger: usize, number: usize, size: FrameSize) -> Image {
        self.picture(finger, number, size, true)
    }

    fn rest(&mut self, finger: usize, size: FrameSize) -> Image {
        self.rest_number(finger, REST, size)
    }
}

/// Gripline itself in the loop: pictures through gate and network to the firmware library, its line back.
struct Gripline {
    pipeline: Pipeline,
    session: Session,
}

impl Gripline {
    fn new(rest: &[Vec<u8>], floor_n: f64) -> Result<Self, EvaluationError> {
        let network = Network::embedded(Architecture::default())?;
        let settings = Configuration {
            floor: (floor_n * f64::from(LSB_PER_NEWTON)) as i32,
            ..settings_for(&network)
        };
        let link = Box::new(EmbeddedLink::new());
        let mut session = Session::open(link, settings)?;
        session.command(Command::Hold)?;
        Ok(Self {
            pipeline: Pipeline::new(network, rest, GateKind::default(), TaxelRule::of(&settings)),
            session,
        })
    }

    /// The line after the microcontroller has had this picture for a frame's time.
    fn line_n(&mut self, picture: &Image, frame: usize, frame_s: f64) -> Result<f64, EvaluationError> {
        let processed = self.pipeline.process(&picture.pixels)?;
        let info = MapInfo {
            sensor: SensorId::FIRST,
            sequence: frame as u32,
            capture_us: self.session.capture_us(),
            health: processed.health,
            ..MapInfo::default()
        };
        self.session.send_map(&info, processed.map)?;
        let until_us = self.session.now_us() + (frame_s * 1e6).round() as u64;
        self.session.run_until(until_us)?;
        Ok(self.session.line_n())
    }
}
