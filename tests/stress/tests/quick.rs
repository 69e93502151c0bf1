//! A small run of every sweep, overflow checks on: the numbers of `cargo xtask stress` must hold in every build.

use gripline_stress::{Effort, run};

#[test]
fn every_bound_of_the_stress_sweeps_holds_in_a_small_run_of_each() {
    let sweeps = run(
        Effort {
            seed: 1,
            is_quick: true,
        },
        |_| {},
    );
    assert_eq!(sweeps.len(), 13);
    for sweep in &sweeps {
        println!("{}", sweep.text());
        assert!(
            !sweep.checks.is_empty() && !sweep.rows.is_empty(),
            "{} asks nothing",
            sweep.name
        );
    }
    let missed: Vec<&str> = sweeps
        .iter()
        .filter(|sweep| !sweep.holds())
        .map(|sweep| sweep.name)
        .collect();
    assert_eq!(missed, Vec::<&str>::new());
}
