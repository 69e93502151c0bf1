//! Two fingertips of one gripper through the loop: both are looked at, the worse one decides, and one that falls silent
//! holds the line. Virtual time, real code.

use gripline_firmware::sums::TaxelRule;
use gripline_network::scene::GateKind;
use gripline_network::{Architecture, Network};
use gripline_protocol::message::{Command, Configuration};
use gripline_protocol::{ForceMap, Health, LSB_PER_NEWTON, MapInfo, SensorId, TaxelForce};

use gripline::run::{Pacing, Run};
use gripline::source::SimulatedSource;
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;
use gripline_recording::telemetry::FrameReport;

/// Pictures a second of both together.
const RATE: f64 = 60.0;

struct Both {
    run: Run,
    sources: [SimulatedSource; 2],
    pipelines: [Pipeline; 2],
    /// Pictures so far, lost ones included.
    number: u64,
}

impl Both {
    fn new() -> Self {
        let network = Network::embedded(Architecture::Unet).unwrap();
        let settings = Configuration {
            sensors: 2,
            ..settings_for(&network)
        };
        let mut sources = SimulatedSource::pair(1, RATE / 2.0);
        let rule = TaxelRule::of(&settings);
        let pipelines = sources
            .each_mut()
            .map(|source| Pipeline::new(network.clone(), &source.rest(4), GateKind::default(), rule));
        let session = Session::open(Box::new(EmbeddedLink::new()), settings).unwrap();
        Self {
            run: Run::new(session, Pacing::None, RATE),
            sources,
            pipelines,
            number: 0,
        }
    }

    /// The next picture of the one whose turn it is; `None` where its camera is away.
    fn next(&mut self, is_away: impl Fn(SensorId) -> bool) -> Option<FrameReport> {
        let sensor = SensorId::ALL[self.number as usize % 2];
        self.number += 1;
        let line_n = self.run.control.session.line_n();
        let picture = self.sources[sensor.index()].next(line_n).unwrap();
        if is_away(sensor) {
            self.run
                .control
                .idle((self.number as f64 * 1e6 / RATE) as u64)
                .unwrap();
            self.run.frame += 1;
            return None;
        }
        let pipeline = &mut self.pipelines[sensor.index()];
        Some(self.run.frame(pipeline, sensor, picture).unwrap())
    }

    fn until(&mut self, t_s: f64) -> Vec<FrameReport> {
        let mut reports = Vec::new();
        while (self.number as f64) < t_s * RATE {
            reports.extend(self.next(|_| false));
        }
        reports
    }
}

#[test]
fn both_fingertips_are_answered_checked_and_told_apart() {
    let mut both = Both::new();
    let reports = both.until(3.4);
    for sensor in SensorId::ALL {
        let its: Vec<_> = reports.iter().filter(|report| report.sensor == sensor).collect();
        assert_eq!(its.len(), 102);
        let held = its.last().unwrap();
        assert!(held.contact > 10 && held.normal_n > 1.0, "{held:?}");
        // What the object weighs hangs down on both.
        assert!(held.shear_y_n.abs() > 0.1, "{held:?}");
        let [checked, wrong] = both.run.control.session.shadow().of(sensor);
        assert!(checked >= 102 && wrong == 0, "{checked} checked, {wrong} wrong");
    }
    assert!(reports.iter().all(|report| report.faults.is_empty()));
    assert_eq!(both.run.summary.maps_unanswered, 0);
}

#[test]
fn a_fingertip_whose_camera_goes_away_holds_the_line_until_it_is_back() {
    let mut both = Both::new();
    both.until(3.0);
    let held_n = both.run.control.session.line_n();
    let stale = |report: &FrameReport| report.faults.contains(&"STALE MAPS");
    let mut reported_s = None;
    let mut line_n = held_n;
    // Into the pull and out of it: alone, the first fingertip would let the line fall by plan.
    while both.number < (7.4 * RATE) as u64 {
        let Some(report) = both.next(|sensor| sensor == SensorId::SECOND) else {
            continue;
        };
        assert_eq!(report.sensor, SensorId::FIRST);
        // Until the fault is there, the line may fall by plan.
        let was_reported = reported_s.is_some();
        reported_s = reported_s.or(stale(&report).then_some(report.t_s));
        assert!(
            report.line_n >= line_n || !was_reported,
            "{} after {line_n} N at {} s",
            report.line_n,
            report.t_s
        );
        line_n = report.line_n;
    }
    let reported_s = reported_s.expect("a fingertip is silent and nobody says so");
    // 100 ms, and a frame until it is reported.
    assert!((3.1..3.2).contains(&reported_s), "{reported_s} s");
    assert!(
        line_n > held_n,
        "the one that is there goes on deciding: {line_n} N"
    );
    let reports = both.until(7.6);
    assert!(!stale(reports.last().unwrap()), "it is back");
    assert_eq!(both.run.control.session.shadow().mismatches(), 0);
}

/// The line after a while in which both touch with 40 taxels, and these of them drag at more than friction holds.
fn line_n_with(slips: [bool; 2]) -> f64 {
    let network = Network::embedded(Architecture::Unet).unwrap();
    let settings = Configuration {
        sensors: 2,
        ..settings_for(&network)
    };
    let mut session = Session::open(Box::new(EmbeddedLink::new()), settings).unwrap();
    assert!(session.command(Command::Hold).unwrap());
    for sequence in 1..=30 {
        for (sensor, is_slipping) in SensorId::ALL.into_iter().zip(slips) {
            let newton = LSB_PER_NEWTON as i16 / 4;
            let mut map = ForceMap::EMPTY;
            map.taxels[180..220].fill(TaxelForce {
                x: if is_slipping { 2 * newton } else { newton / 20 },
                y: 0,
                z: newton,
            });
            let info = MapInfo {
                sensor,
                sequence,
                capture_us: session.capture_us(),
                health: Health::GOOD,
                ..MapInfo::default()
            };
            session.send_map(&info, &map).unwrap();
            session.run_until(session.now_us() + 8_000).unwrap();
        }
    }
    assert_eq!(session.shadow().mismatches(), 0);
    session.line_n()
}

#[test]
fn the_fingertip_that_slips_decides_whichever_of_the_two_it_is() {
    let held_n = line_n_with([false, false]);
    let both_n = line_n_with([true, true]);
    for slips in [[true, false], [false, true]] {
        let line_n = line_n_with(slips);
        assert!(
            line_n > held_n + 1.0 && (line_n - both_n).abs() < 0.1 * both_n,
            "{line_n} N, {held_n} N where both hold, {both_n} N where both slip"
        );
    }
}
