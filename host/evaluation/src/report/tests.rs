use clap::Parser;
use gripline_network::{Architecture, Network};
use gripline_protocol::SensorId;
use serde_json::Value;

use super::*;
use crate::chain::Chain;
use crate::plan::{Amount, Data, plan};
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;
use gripline_pipeline::settings_for;

#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    paper: PaperArgs,
}

fn arguments() -> PaperArgs {
    let arguments = Arguments::try_parse_from(["paper", "--quick", "--network", "unet"]);
    arguments.unwrap().paper
}

/// One object's short runs on the coarse grid.
fn played() -> (Vec<Planned>, Vec<Recorded>, Configuration) {
    let network = Network::embedded(Architecture::Unet).unwrap();
    let ours = settings_for(&network);
    let chain = Chain::new(network, true).unwrap();
    let amount = Amount {
        runs: 1,
        short: true,
        hold_s: 1.0,
    };
    let planned: Vec<Planned> = plan(Data::Tuning, 3, amount)
        .into_iter()
        .filter(|planned| planned.object == 0)
        .collect();
    let recorded = planned
        .iter()
        .map(|planned| chain.play(&planned.trial, &[None]).unwrap().remove(0))
        .collect();
    (planned, recorded, ours)
}

#[test]
fn a_short_evaluation_finds_every_slip_and_has_the_keys_that_programs_read() {
    let (planned, recorded, ours) = played();
    assert!(recorded.iter().all(|run| run.unsolved.is_none()));
    let noisy = NOISE_LEVELS.map(|_| Vec::new());
    let report = Report::new(&arguments(), &planned, &recorded, &noisy, &ours);
    let json: Value = serde_json::to_value(&report).unwrap();
    let object = &json["objects"][0];
    assert_eq!(object["name"], "golf ball");
    for detector in ["baseline", "stick_ratio", "gripline"] {
        for place in [object, &json["translation"], &json["rotation"]] {
            assert!(place[detector]["accuracy"].is_number(), "{detector} {place}");
        }
    }
    assert!(json["lead_time_ms_median"].as_f64().unwrap() > 0.0);
    assert!(json["alarms_per_minute"].is_number());
    // Total forces cannot see a rotation; the stick ratio can.
    assert_eq!(json["rotation"]["baseline"]["recall"], 0.0);
    assert!(json["rotation"]["stick_ratio"]["recall"].as_f64().unwrap() > 50.0);
    let notice = &report.slips["all"].gripline;
    assert_eq!((notice.slips, notice.noticed), (5, 5));
    let page = report.markdown();
    assert!(page.contains("| golf ball |"));
    // One object, rotation, baseline, lead, alarms.
    let bounds = json["bounds"].as_array().unwrap();
    assert_eq!(bounds.len(), 5);
    for bound in bounds {
        let row = format!(
            "| {} | {} |",
            bound["measure"].as_str().unwrap(),
            bound["bound"].as_str().unwrap()
        );
        assert!(page.contains(&row), "{row}");
    }
    assert_eq!(bounds[3]["held"], true, "{}", bounds[3]);
}

#[test]
fn the_detector_that_is_evaluated_says_what_the_whole_microcontroller_says() {
    use gripline_protocol::message::Command as Message;
    use gripline_protocol::{Health, MapInfo};

    let (_, recorded, ours) = played();
    let run = &recorded[2];
    let states = crate::detectors::states(run, Sight::Seen, &ours);
    let mut session = Session::open(Box::new(EmbeddedLink::new()), ours).unwrap();
    session.command(Message::Hold).unwrap();
    let start_us = session.now_us();
    let mut seen = Vec::new();
    for (number, frame) in run.frames.iter().enumerate() {
        let now_us = start_us + (frame.truth.time_s * 1e6).round() as u64;
        session.run_until(now_us).unwrap();
        let info = MapInfo {
            sensor: SensorId::FIRST,
            sequence: number as u32,
            capture_us: now_us as u32,
            health: Health::GOOD,
            ..MapInfo::default()
        };
        session.send_map(&info, &frame.seen).unwrap();
        session.run_until(now_us).unwrap();
        seen.push(session.status().unwrap().state);
    }
    assert_eq!(states, seen);
    assert!(states.contains(&gripline_protocol::message::SlipState::Slip));
}
