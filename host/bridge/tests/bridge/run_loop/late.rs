//! What is too old is dropped, counted and reported, and leaves no gap behind. The pictures' ages are made up: no test depends on
//! how busy the machine is.

use std::time::{Duration, Instant};

use gripline_firmware::sums::TaxelRule;
use gripline_network::scene::GateKind;
use gripline_network::{Architecture, Network};
use gripline_protocol::SensorId;
use gripline_protocol::message::GripMode;

use gripline::run::{Pacing, Run};
use gripline::source::SimulatedSource;
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;
use gripline_pipeline::control_loop::{FrameRequest, Late, Lateness};
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;
use gripline_recording::telemetry::{FrameReport, LATE};

struct Scene {
    run: Run,
    source: SimulatedSource,
    pipeline: Pipeline,
}

impl Scene {
    fn new() -> Self {
        let network = Network::embedded(Architecture::Unet).unwrap();
        let settings = settings_for(&network);
        let mut source = SimulatedSource::new(1, 60.0);
        let rule = TaxelRule::of(&settings);
        let pipeline = Pipeline::new(network, &source.rest(4), GateKind::Off, rule);
        let session = Session::open(Box::new(EmbeddedLink::new()), settings).unwrap();
        let run = Run::new(session, Pacing::None, 60.0);
        Self {
            run,
            source,
            pipeline,
        }
    }

    /// The next picture, taken so long ago where anybody looks at that.
    fn frame(&mut self, pacing: Pacing, age: Duration) -> FrameReport {
        let mut picture = self.source.next(2.5).unwrap();
        picture.came = Instant::now().checked_sub(age).unwrap();
        self.run.pacing = pacing;
        self.run
            .frame(&mut self.pipeline, SensorId::FIRST, picture)
            .unwrap()
    }
}

#[test]
fn a_picture_that_is_too_old_when_its_turn_comes_is_dropped_counted_and_reported() {
    let mut scene = Scene::new();
    for _ in 0..3 {
        assert_eq!(scene.frame(Pacing::None, Duration::ZERO).late, None);
    }
    let late = scene.frame(Pacing::Wall, Duration::from_millis(21));
    assert_eq!((late.late, late.wire_bytes), (Some("picture"), 0));
    assert!(late.faults.contains(&LATE), "{late:?}");
    let next = scene.frame(Pacing::None, Duration::ZERO);
    assert!(next.late.is_none() && next.faults.is_empty(), "{next:?}");
    let summary = scene.run.summary();
    assert_eq!(
        (summary.frames, summary.pictures_late, summary.maps_late),
        (5, 1, 0)
    );
    assert_eq!((summary.maps_unanswered, summary.answers_checked), (0, 4));
    assert!(
        summary
            .losses()
            .iter()
            .any(|loss| loss.starts_with("1 of 5 pictures were too old")),
        "{:?}",
        summary.losses()
    );
}

#[test]
fn a_map_that_is_too_old_to_be_sent_is_dropped_and_the_next_one_takes_its_number() {
    let mut scene = Scene::new();
    scene.frame(Pacing::None, Duration::ZERO);
    let crop = scene.source.next(2.5).unwrap().crop;
    let at = |until_us| FrameRequest {
        mode: Some(GripMode::Hold),
        ..FrameRequest::of_now(SensorId::FIRST, until_us)
    };
    let control = &mut scene.run.control;
    let late = Lateness::Recorded(Some(Late::Map));
    let dropped = control
        .frame(&mut scene.pipeline, &crop, late, at(50_000))
        .unwrap();
    assert_eq!((dropped.late, dropped.answered), (Some(Late::Map), false));
    assert!(dropped.stages_us[3] > 0.0, "the network had looked at it");
    let sent = control
        .frame(&mut scene.pipeline, &crop, Lateness::Never, at(66_000))
        .unwrap();
    assert_eq!((sent.late, sent.answered), (None, true));
    assert_eq!(sent.sequence, dropped.sequence, "no gap");
    scene.run.count(&dropped);
    assert_eq!(scene.run.summary.maps_late, 1);
}
