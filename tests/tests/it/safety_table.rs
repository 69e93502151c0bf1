//! `docs/safety.md` says what the code does, fault by fault, and names tests that exist.

use gripline_firmware::Fault;
use gripline_firmware::grip::Guard;

const PAGE: &str = include_str!("../../../docs/safety.md");
const SOURCES: [&str; 6] = [
    include_str!("../../emulator/tests/gripper.rs"),
    include_str!("hardware.rs"),
    include_str!("safety.rs"),
    include_str!("emulated_board.rs"),
    include_str!("../../../firmware/tests/it/program.rs"),
    include_str!("../../../firmware/tests/it/bad_moments.rs"),
];

/// The cells of every row whose first cell is a number.
fn rows() -> Vec<Vec<&'static str>> {
    PAGE.lines()
        .map(|line| {
            line.trim_matches('|')
                .split('|')
                .map(str::trim)
                .collect::<Vec<_>>()
        })
        .filter(|cells| cells[0].parse::<u8>().is_ok())
        .collect()
}

#[test]
fn the_table_has_every_fault_with_its_number_name_demand_and_latching() {
    let documented: Vec<_> = rows()
        .into_iter()
        .map(|cells| {
            let [number, name, cause, after, line, latches, cleared, _] = cells[..] else {
                panic!("eight cells: {cells:?}");
            };
            assert!(
                !cause.is_empty() && !after.is_empty() && !cleared.is_empty(),
                "{name}"
            );
            (number.to_owned(), name, line, latches)
        })
        .collect();
    let coded: Vec<_> = Fault::ALL
        .into_iter()
        .map(|fault| {
            let line = match fault.guard() {
                Guard::Free => "free",
                Guard::Hold => "holds",
                Guard::FailSafe => "tightens",
            };
            let latches = if fault.latches() { "yes" } else { "no" };
            ((fault as u8).to_string(), fault.name(), line, latches)
        })
        .collect();
    assert_eq!(documented, coded);
}

#[test]
fn every_fault_names_tests_that_exist() {
    for cells in rows() {
        let names: Vec<_> = cells[7].split(", ").map(|name| name.trim_matches('`')).collect();
        assert!(!names[0].is_empty(), "{}", cells[1]);
        for name in names {
            let found = SOURCES
                .iter()
                .any(|source| source.contains(&format!("fn {name}(")));
            assert!(found, "{}: no test {name}", cells[1]);
        }
    }
}

#[test]
fn the_times_in_the_table_are_those_of_the_default_settings() {
    let settings = gripline_protocol::message::Configuration::DEFAULT;
    for documented in [
        format!("`stale_ms` ({})", settings.stale_ms),
        format!("`link_lost_ms` ({})", settings.link_lost_ms),
    ] {
        assert!(PAGE.contains(&documented), "the page does not say {documented}");
    }
}
