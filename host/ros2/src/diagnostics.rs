//! How gripper, microcontroller and fingertips are, as diagnostics. Pure.

use gripline_control::StatusReport;
use gripline_recording::ros2::{DiagnosticStatus, Level, Namespace, faults_status};
use gripline_recording::telemetry::STATUS_OLD_US;

/// What the gripper does, its link and its faults.
pub(crate) fn statuses(namespace: &Namespace, status: &StatusReport) -> Vec<DiagnosticStatus> {
    vec![
        gripper(namespace, status),
        link(namespace, status),
        faults(namespace, status),
    ]
}

fn gripper(namespace: &Namespace, status: &StatusReport) -> DiagnosticStatus {
    let how = match status.mode {
        Some(mode) => (Level::Ok, mode),
        None => (Level::Stale, "no status yet"),
    };
    let owner = status.owner.as_ref().map_or("", |owner| owner.name());
    DiagnosticStatus::new(
        format!("{namespace}: gripper"),
        how,
        &status.link,
        [
            ("owner", owner.to_owned()),
            ("requested", status.requested.unwrap_or_default().to_owned()),
            ("mode", status.mode.unwrap_or_default().to_owned()),
            ("state", status.state.to_owned()),
            ("line_n", format!("{:.3}", status.line_n)),
            ("floor_n", format!("{:.3}", status.floor_n)),
            ("ceiling_n", format!("{:.3}", status.ceiling_n)),
            ("frames", status.frames.to_string()),
        ],
    )
}

fn link(namespace: &Namespace, status: &StatusReport) -> DiagnosticStatus {
    let how = if !status.is_connected {
        (Level::Error, "away")
    } else if status.status_age_ms * 1e3 > STATUS_OLD_US as f64 {
        (Level::Stale, "connected, but its status is old")
    } else {
        (Level::Ok, "connected")
    };
    DiagnosticStatus::new(
        format!("{namespace}: microcontroller"),
        how,
        &status.link,
        [
            ("link", status.link.clone()),
            ("status_age_ms", format!("{:.0}", status.status_age_ms)),
        ],
    )
}

fn faults(namespace: &Namespace, status: &StatusReport) -> DiagnosticStatus {
    let known = status.faults.iter().map(|fault| {
        let latched = if fault.latched { "latched, " } else { "" };
        (
            fault.name,
            format!(
                "{latched}{}: {}",
                if fault.active { "there" } else { "over" },
                fault.what_to_do
            ),
        )
    });
    let host = status
        .host_faults
        .iter()
        .map(|name| (*name, "there: the host's own".to_owned()));
    faults_status(namespace, &known.chain(host).collect::<Vec<_>>())
}

/// What is worth being said at once: everything but numbers that always change.
pub(crate) fn is_the_same(one: &[DiagnosticStatus], other: &[DiagnosticStatus]) -> bool {
    let says = |status: &DiagnosticStatus| {
        let words = status
            .values
            .iter()
            .filter(|pair| ["owner", "requested", "floor_n", "ceiling_n"].contains(&pair.key.as_str()))
            .cloned()
            .collect::<Vec<_>>();
        (status.level, status.name.clone(), status.message.clone(), words)
    };
    one.iter().map(says).eq(other.iter().map(says))
}

#[cfg(test)]
mod tests {
    use gripline_control::ReportedFault;

    use super::*;

    fn report() -> StatusReport {
        StatusReport {
            mode: Some("hold"),
            state: "STICK",
            line_n: 5.0,
            link: "embedded".to_owned(),
            is_connected: true,
            ..StatusReport::default()
        }
    }

    #[test]
    fn each_part_says_how_it_is_and_a_fault_says_what_to_do() {
        let namespace = "a".parse().unwrap();
        let statuses_of = |report: &StatusReport| {
            statuses(&namespace, report)
                .into_iter()
                .map(|status| (status.name, status.level, status.message))
                .collect::<Vec<_>>()
        };
        let line = |name: &str, level, message: &str| (format!("a: {name}"), level, message.to_owned());
        assert_eq!(
            statuses_of(&report()),
            [
                line("gripper", Level::Ok, "hold"),
                line("microcontroller", Level::Ok, "connected"),
                line("faults", Level::Ok, "none"),
            ]
        );
        let bad = StatusReport {
            mode: None,
            is_connected: false,
            faults: vec![ReportedFault {
                number: 1,
                name: "LINK LOST",
                active: false,
                latched: true,
                what_to_do: "check the cable",
            }],
            host_faults: vec!["NO DEVICE"],
            ..report()
        };
        assert_eq!(
            statuses_of(&bad),
            [
                line("gripper", Level::Stale, "no status yet"),
                line("microcontroller", Level::Error, "away"),
                line("faults", Level::Error, "LINK LOST, NO DEVICE"),
            ]
        );
        let values = &statuses(&namespace, &bad)[2].values;
        assert_eq!(values[0].value, "latched, over: check the cable");
        let old = StatusReport {
            status_age_ms: 300.0,
            ..report()
        };
        assert_eq!(statuses(&namespace, &old)[1].level, Level::Stale);
    }

    #[test]
    fn news_is_what_does_not_change_with_every_frame() {
        let namespace = "a".parse().unwrap();
        let now = statuses(&namespace, &report());
        let of = |change: fn(&mut StatusReport)| {
            let mut report = report();
            change(&mut report);
            is_the_same(&now, &statuses(&namespace, &report))
        };
        assert!(of(|report| report.line_n = 6.0));
        assert!(of(|report| report.frames = 9));
        assert!(!of(|report| report.mode = Some("released")));
        assert!(!of(|report| report.owner = "cell-3".parse().ok()));
        assert!(!of(|report| report.floor_n = 3.0));
        assert!(!of(|report| report.host_faults.push("NO STATUS")));
    }
}
