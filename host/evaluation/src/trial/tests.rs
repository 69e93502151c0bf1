use gripline_simulation::contact_world::GelSurface;
use gripline_simulation::grasp::OBJECTS;

use super::*;

fn frames(script: Script, seed: u64) -> (Vec<TruthFrame>, Experiment) {
    let skin = Arc::new(GelSurface::new(&Gel::default(), 40).unwrap());
    let trial = Trial {
        object: OBJECTS[5].clone(),
        script,
        seed,
        sensor: 1,
    };
    let mut experiment = Experiment::new(&trial, &skin).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = experiment.advance().unwrap() {
        frames.push(frame);
    }
    (frames, experiment)
}

#[test]
fn every_slip_of_the_script_slides_in_its_pull_and_nowhere_else() {
    let (frames, experiment) = frames(Script::Slips(vec![Kind::Translation, Kind::Rotation]), 5);
    for slip in 0..2 {
        let pull = frames.iter().filter(|frame| frame.part == Part::Pull(slip));
        let sliding = pull.clone().filter(|frame| frame.gross_slip).count() as f64 / FRAMES_PER_SECOND;
        assert!(
            (SLIDE_S[0] - 0.05..=SLIDE_S[1] + 0.05).contains(&sliding),
            "{sliding} s"
        );
        // It sticks when the hand begins, and slides to the end.
        assert!(
            !pull.clone().next().unwrap().gross_slip
                && pull
                    .max_by(|a, b| a.time_s.total_cmp(&b.time_s))
                    .unwrap()
                    .gross_slip
        );
    }
    assert!(
        frames
            .iter()
            .all(|frame| !frame.gross_slip || matches!(frame.part, Part::Pull(_)))
    );
    let share = |frame: &TruthFrame| frame.force_n[0].hypot(frame.force_n[1]) / frame.force_n[2];
    let max = frames.iter().map(share).fold(0.0, f64::max);
    // The pressure's own share along the slope comes on top of friction, except for a few percent.
    assert!((max / experiment.friction() - 1.0).abs() < 0.05, "{max}");
}

#[test]
fn at_rest_only_half_of_the_weight_pulls() {
    let (frames, _) = frames(Script::Slips(vec![Kind::Translation]), 6);
    let last = frames.last().unwrap();
    assert_eq!(last.part, Part::Rest);
    let [x, y, _] = last.force_n;
    let half_n = 0.5 * OBJECTS[5].weight_n();
    assert!(
        x.abs() < 0.02 * half_n && (y + half_n).abs() < 0.02 * half_n,
        "{x} {y}"
    );
}

#[test]
fn a_hold_never_slips_and_keeps_its_shear_within_what_the_controller_keeps() {
    let (frames, _) = frames(Script::Hold(2.0), 7);
    let steady: Vec<&TruthFrame> = frames.iter().filter(|frame| frame.part == Part::Rest).collect();
    assert!(steady.len() > 60);
    for frame in steady {
        let share = frame.force_n[0].hypot(frame.force_n[1]) / frame.force_n[2];
        assert!(share > 0.08 && share < 0.35, "{share}");
        assert!(!frame.gross_slip && frame.stick_ratio.unwrap() > 0.5);
    }
}
