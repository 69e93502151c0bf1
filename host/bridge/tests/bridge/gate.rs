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

/// What a gate did over the scene, and what its maps made the detector say otherwise than those of every frame.
#[derive(Default)]
struct Compared {
    frames: u32,
    skipped: u32,
    flips: u32,
    missed: u32,
    slip_frames: u32,
    ratio_difference_max: f64,
    ratio_difference_sum: f64,
    force_difference_max_n: f64,
}

/// Both gates beside each other on the same pictures, so that those are rendered once; with so many rest pictures.
fn skipping_saves_frames_and_changes_hardly_a_decision(rest_pictures: usize) {
    let kinds = [GateKind::Network, GateKind::Difference];
    let mut compared = kinds.map(|_| Compared::default());
    for (seed, follows) in [(11, true), (12, false)] {
        let mut source = SimulatedSource::new(seed, 60.0);
        let rest = source.rest(rest_pictures);
        let mut every = Chain::new(&rest, GateKind::Off);
        let mut gated = kinds.map(|kind| Chain::new(&rest, kind));
        for sequence in 0..720 {
            let line = every
                .session
                .status()
                .filter(|_| follows)
                .map(|status| status.line);
            let line_n = line.map_or(2.5, |line| f64::from(line) / f64::from(LSB_PER_NEWTON));
            let picture = source.next(line_n).unwrap();
            let mode = picture.requested_mode.unwrap();
            let full = every.frame(sequence, &picture.crop, mode);
            for (chain, found) in gated.iter_mut().zip(&mut compared) {
                let gate = chain.frame(sequence, &picture.crop, mode);
                let touched = picture.truth.as_ref().is_some_and(|truth| truth.normal_n >= 0.2);
                found.frames += 1;
                found.skipped += u32::from(gate.0 != GateDecision::Infer);
                found.missed += u32::from(gate.0 == GateDecision::NoContact && touched);
                found.flips += u32::from(full.2 != gate.2);
                found.slip_frames += u32::from(full.2);
                let difference = (full.1.unwrap_or(1.0) - gate.1.unwrap_or(1.0)).abs();
                found.ratio_difference_max = found.ratio_difference_max.max(difference);
                found.ratio_difference_sum += difference;
                found.force_difference_max_n = found.force_difference_max_n.max((full.3 - gate.3).abs());
            }
        }
    }
    for (kind, found) in kinds.iter().zip(&compared) {
        let Compared {
            frames,
            skipped,
            flips,
            missed,
            ..
        } = *found;
        let mean_ratio = found.ratio_difference_sum / f64::from(frames);
        println!(
            "{kind}, {rest_pictures} at rest: {skipped} of {frames} frames skipped; {flips} slip decisions differ ({} slip \
             frames), stick ratio by {mean_ratio:.4} on average and {:.3} at most, F_N by {:.3} N at most; {missed} touches \
             missed",
            found.slip_frames, found.ratio_difference_max, found.force_difference_max_n
        );
        assert_eq!(
            missed, 0,
            "{kind}: a touch of 0.2 N or more was taken for no contact"
        );
        assert!(
            skipped * 3 > frames,
            "{kind}: the gate saved little: {skipped} of {frames}"
        );
        assert!(
            flips * 200 <= frames,
            "{kind}: {flips} of {frames} decisions differ"
        );
        assert!(
            mean_ratio < 0.02,
            "{kind}: stick ratios differ by {mean_ratio:.4} on average"
        );
    }
}

/// Only `cargo xtask test --all` runs these: whole scenes, each through three pipelines. Of the quick tests, `skip::tests` in
/// `gripline-evaluation` look at the decisions that skipping may change.
mod slow {
    use super::*;

    #[test]
    fn skipping_by_either_gate_saves_frames_and_changes_hardly_a_decision() {
        skipping_saves_frames_and_changes_hardly_a_decision(16);
    }

    #[test]
    fn with_one_rest_picture_both_gates_find_the_noise_themselves_and_skip_as_well() {
        skipping_saves_frames_and_changes_hardly_a_decision(1);
    }
}
