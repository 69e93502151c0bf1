//! What skipping does to decisions: the same pictures of the scene through the pipeline with and without the gate,
//! each with a detector of its own. Once the gripper follows the one without, once it does nothing against slip.

use gripline::source::SimulatedSource;
use gripline_firmware::sums::TaxelRule;
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;
use gripline_network::scene::{GateDecision, GateKind};
use gripline_network::{Architecture, Network};
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;
use gripline_protocol::message::{Command, GripMode};
use gripline_protocol::{LSB_PER_NEWTON, MapInfo};

struct Chain {
    pipeline: Pipeline,
    session: Session,
    mode: Option<GripMode>,
}

impl Chain {
    fn new(rest: &[Vec<u8>], gate: GateKind) -> Self {
        let network = Network::embedded(Architecture::default()).unwrap();
        let settings = settings_for(&network);
        let session = Session::open(Box::new(EmbeddedLink::new()), settings).unwrap();
        Self {
            pipeline: Pipeline::new(network, rest, gate, TaxelRule::of(&settings)),
            session,
            mode: None,
        }
    }

    /// Verdict, stick ratio, slip by the threshold, total normal force in newtons.
    fn frame(
        &mut self,
        sequence: u32,
        crop: &[u8],
        requested_mode: GripMode,
    ) -> (GateDecision, Option<f64>, bool, f64) {
        if self.mode != Some(requested_mode) {
            let command = if requested_mode == GripMode::Hold {
                Command::Hold
            } else {
                Command::Release
            };
            self.session.command(command).unwrap();
            self.mode = Some(requested_mode);
        }
        let processed = self.pipeline.process(crop).unwrap();
        let info = MapInfo {
            sequence,
            capture_us: self.session.now_us() as u32,
            ..MapInfo::default()
        };
        self.session.send_map(&info, processed.map).unwrap();
        let verdict = processed.gate;
        self.session.run_until(self.session.now_us() + 16_667).unwrap();
        let sums = self.session.status().unwrap().sums;
        let ratio = (sums.contact > 0).then(|| f64::from(sums.stick) / f64::from(sums.contact));
        (
            verdict,
            ratio,
            ratio.is_some_and(|ratio| ratio < 0.5),
            f64::from(sums.force[2]) / f64::from(LSB_PER_NEWTON),
        )
    }
}

#[test]
fn skipping_by_the_learned_gate_saves_frames_and_changes_hardly_a_decision() {
    skipping_saves_frames_and_changes_hardly_a_decision(GateKind::Network, 16);
}

#[test]
fn skipping_by_the_plain_gate_saves_frames_and_changes_hardly_a_decision() {
    skipping_saves_frames_and_changes_hardly_a_decision(GateKind::Difference, 16);
}

fn skipping_saves_frames_and_changes_hardly_a_decision(kind: GateKind, rest_pictures: usize) {
    let (mut frames, mut skipped, mut flips, mut missed, mut slip_frames) = (0, 0, 0, 0, 0);
    let (mut worst_ratio, mut mean_ratio, mut worst_force_n) = (0.0_f64, 0.0, 0.0_f64);
    for (seed, follows) in [(11, true), (12, false)] {
        let mut source = SimulatedSource::new(seed, 60.0);
        let rest = source.rest(rest_pictures);
        let (mut every, mut gated) = (Chain::new(&rest, GateKind::Off), Chain::new(&rest, kind));
        for sequence in 0..720 {
            let line = every
                .session
                .status()
                .filter(|_| follows)
                .map(|status| status.line);
            let line_n = line.map_or(2.5, |line| f64::from(line) / f64::from(LSB_PER_NEWTON));
            let picture = source.next(line_n).unwrap();
            let full = every.frame(sequence, &picture.crop, picture.requested_mode.unwrap());
            let gate = gated.frame(sequence, &picture.crop, picture.requested_mode.unwrap());
            frames += 1;
            skipped += u32::from(gate.0 != GateDecision::Infer);
            missed += u32::from(
                gate.0 == GateDecision::NoContact && picture.truth.is_some_and(|truth| truth.normal_n >= 0.2),
            );
            flips += u32::from(full.2 != gate.2);
            slip_frames += u32::from(full.2);
            let difference = (full.1.unwrap_or(1.0) - gate.1.unwrap_or(1.0)).abs();
            worst_ratio = worst_ratio.max(difference);
            mean_ratio += difference;
            worst_force_n = worst_force_n.max((full.3 - gate.3).abs());
        }
    }
    mean_ratio /= f64::from(frames);
    println!(
        "{kind}, {rest_pictures} at rest: {skipped} of {frames} frames skipped; {flips} slip decisions differ ({slip_frames} slip frames), stick ratio by \
         {mean_ratio:.4} on average and {worst_ratio:.3} at most, F_N by {worst_force_n:.3} N at most; {missed} touches missed"
    );
    assert_eq!(missed, 0, "a touch of 0.2 N or more was taken for no contact");
    assert!(
        skipped * 3 > frames,
        "the gate saved little: {skipped} of {frames}"
    );
    assert!(flips * 200 <= frames, "{flips} of {frames} decisions differ");
    assert!(
        mean_ratio < 0.02,
        "stick ratios differ by {mean_ratio:.4} on average"
    );
}

/// Only `cargo xtask test --all` runs these.
mod slow {
    use super::*;

    #[test]
    fn with_one_rest_picture_the_plain_gate_finds_the_noise_itself_and_skips_as_well() {
        skipping_saves_frames_and_changes_hardly_a_decision(GateKind::Difference, 1);
    }

    #[test]
    fn with_one_rest_picture_the_learned_gate_finds_the_noise_itself_and_skips_as_well() {
        skipping_saves_frames_and_changes_hardly_a_decision(GateKind::Network, 1);
    }
}
