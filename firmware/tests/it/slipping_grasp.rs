//! Grasps whose friction nobody knows: the program against an oracle that knows the sliding friction of the moment.

use std::collections::VecDeque;

use gripline_protocol::message::{Command, Configuration, Hello, Message};
use gripline_protocol::{ForceMap, LSB_PER_NEWTON};

use crate::bench::Bench;
use crate::grasp_world::{DELAY_STEPS, Grasp, LOST, PICTURE_STEPS, STEP, Truth};

/// Whoever asks for a grip force.
trait Policy {
    /// A map of this grasp, as it was when the picture was taken.
    fn map(&mut self, map: &ForceMap, load: f64, friction: f64);
    /// What it asks for now, N.
    fn ask(&mut self, time: f64) -> f64;
}

/// The program with its shipped settings.
struct Ours {
    bench: Bench,
    start_us: u64,
}

impl Ours {
    fn new() -> Self {
        let mut bench = Bench::cold();
        bench.message(Message::Hello(Hello::of_this_build(0, 1)));
        bench.command(Command::Configure(Configuration::DEFAULT));
        bench.command(Command::Hold);
        let start_us = bench.now_us;
        Self { bench, start_us }
    }
}

impl Policy for Ours {
    fn map(&mut self, map: &ForceMap, _: f64, _: f64) {
        self.bench.map(map);
        self.bench.reports.clear();
    }

    fn ask(&mut self, time: f64) -> f64 {
        let until_us = self.start_us + (time * 1e6) as u64;
        while self.bench.now_us + 1_000 <= until_us {
            self.bench.now_us += 1_000;
            let _ = self.bench.device.tick(self.bench.now_us);
        }
        f64::from(self.bench.device.program.line().lsb()) / f64::from(LSB_PER_NEWTON)
    }
}

/// Holds 1.3 times the load over the true sliding friction, with the same delays and gripper.
#[derive(Default)]
struct Oracle {
    before: f64,
    wanted: f64,
    line: f64,
    at: f64,
}

impl Policy for Oracle {
    fn map(&mut self, _: &ForceMap, load: f64, friction: f64) {
        let rate = ((load - self.before) * 60.0).clamp(0.0, 10.0);
        self.before = load;
        self.wanted = (1.3 * (load + 0.12 * rate) / friction).clamp(1.0, 30.0);
    }

    fn ask(&mut self, time: f64) -> f64 {
        let passed = time - self.at;
        self.at = time;
        let max = self.line + 100.0 * passed;
        let min = self.line - (3.0_f64).max(7.2 * (self.line - self.wanted)) * passed;
        self.line = self.wanted.clamp(min.min(max), max);
        self.line
    }
}

/// How a grasp went.
#[derive(Debug, Clone, Default)]
struct Course {
    /// Slid at most, mm.
    slid_mm: f64,
    /// Median margin over the needed force, from 2 s on while it stuck.
    margin: f64,
    mean_force: f64,
    /// Maps at which the line fell later than 42 ms after sliding began.
    late_falls: usize,
    /// From the start of sliding to a rising line, s; 9.9 where it never rose and the object slid half a millimetre.
    rises: Vec<f64>,
}

fn play(truth: Truth, seed: u64, policy: &mut dyn Policy) -> Course {
    let mut grasp = Grasp::new(truth, seed);
    let mut waiting: VecDeque<(usize, ForceMap, f64, f64)> = VecDeque::new();
    let (mut course, mut margins, mut forces) = (Course::default(), Vec::new(), Vec::new());
    let mut line_at_map: f64 = 0.0;
    let mut line: f64;
    // A slide under way: when it began, where, whether the line has risen since; how long it has been at rest.
    let mut slide: Option<(f64, f64, bool)> = None;
    let mut quiet = 0;
    for step in 0..(6.0 / STEP) as usize {
        if step % PICTURE_STEPS == 0 {
            let map = grasp.picture();
            waiting.push_back((step, map, grasp.load(), grasp.truth.sliding_at(grasp.time)));
        }
        if waiting
            .front()
            .is_some_and(|(taken, ..)| taken + DELAY_STEPS <= step)
        {
            let (_, map, load, friction) = waiting.pop_front().unwrap();
            line = policy.ask(grasp.time);
            let fell = line < line_at_map - 1e-3;
            if let Some((began, _, risen)) = &mut slide {
                let is_late = grasp.time - *began > 0.042 && quiet == 0;
                course.late_falls += usize::from(fell && is_late);
                if !*risen && line > line_at_map + 1e-3 {
                    *risen = true;
                    course.rises.push(grasp.time - *began);
                }
            }
            line_at_map = line;
            policy.map(&map, load, friction);
        }
        line = policy.ask(grasp.time).max(0.0);
        let before = grasp.slid;
        grasp.step(line);
        let moved = (grasp.slid - before).abs();
        course.slid_mm = course.slid_mm.max(grasp.slid.abs() * 1e3);
        if grasp.slid.abs() >= LOST {
            break;
        }
        if moved > 1e-3 * STEP {
            quiet = 0;
            if slide.is_none() {
                slide = Some((grasp.time, before, line > line_at_map + 1e-3));
            }
        } else {
            quiet += 1;
        }
        if quiet > 96
            && let Some((_, from, risen)) = slide.take()
            && !risen
            && (grasp.slid - from).abs() > 0.5e-3
        {
            course.rises.push(9.9);
        }
        if grasp.time > 2.0 {
            forces.push(grasp.normal);
            if !grasp.slides {
                margins.push(grasp.normal / grasp.needed() - 1.0);
            }
        }
    }
    course.margin = quantile(&mut margins, 0.5);
    course.mean_force = forces.iter().sum::<f64>() / forces.len().max(1) as f64;
    course
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let place = (share * values.len() as f64) as usize;
    values
        .get(place.min(values.len().saturating_sub(1)))
        .copied()
        .unwrap_or(f64::NAN)
}

/// Many grasps together.
#[derive(Debug)]
struct Summary {
    lost: usize,
    far: usize,
    slid_p99_mm: f64,
    margin: f64,
    mean_force: f64,
    late_falls: usize,
    rise_ms: [f64; 2],
}

fn summary(courses: &[Course]) -> Summary {
    let all = |of: fn(&Course) -> f64| courses.iter().map(of).collect::<Vec<_>>();
    let mut rises: Vec<f64> = courses.iter().flat_map(|course| course.rises.clone()).collect();
    Summary {
        lost: courses
            .iter()
            .filter(|course| course.slid_mm >= LOST * 1e3)
            .count(),
        far: courses.iter().filter(|course| course.slid_mm >= 6.0).count(),
        slid_p99_mm: quantile(&mut all(|course| course.slid_mm), 0.99),
        margin: quantile(&mut all(|course| course.margin), 0.5),
        mean_force: all(|course| course.mean_force).iter().sum::<f64>() / courses.len() as f64,
        late_falls: courses.iter().map(|course| course.late_falls).sum(),
        rise_ms: [0.5, 0.99].map(|share| quantile(&mut rises, share) * 1e3),
    }
}

fn play_all(is_adverse: bool, grasps: u64) -> [Summary; 2] {
    let play_with = |policy: &dyn Fn() -> Box<dyn Policy>| {
        let courses: Vec<Course> = (0..grasps)
            .map(|seed| play(Truth::random(seed, is_adverse), seed, policy().as_mut()))
            .collect();
        summary(&courses)
    };
    let found = [
        play_with(&|| Box::new(Ours::new())),
        play_with(&|| Box::new(Oracle::default())),
    ];
    let [ours, oracle] = &found;
    println!("adverse {is_adverse}: ours {ours:?}\n oracle {oracle:?}");
    found
}

#[test]
fn the_usual_world_loses_nothing() {
    let [ours, oracle] = play_all(false, 100);
    assert_eq!((ours.lost, ours.far, ours.late_falls), (0, 0, 0), "{ours:?}");
    assert!(ours.slid_p99_mm < 1.0, "{ours:?}");
    assert!(ours.rise_ms[0] < 45.0 && ours.rise_ms[1] < 200.0, "{ours:?}");
    // One who knows friction holds with 30 %.
    assert!(ours.margin < 0.8, "{ours:?}");
    assert!(ours.mean_force < 1.5 * oracle.mean_force, "{ours:?} {oracle:?}");
}

#[test]
fn the_adverse_world_loses_hardly_more_than_to_one_who_knows_friction() {
    let [ours, oracle] = play_all(true, 100);
    assert!(ours.lost <= oracle.lost + 5, "{ours:?} {oracle:?}");
    assert!(ours.rise_ms[1] < 300.0, "{ours:?}");
    assert!(ours.margin < 0.95, "{ours:?}");
}
