//! What the whole view shows, against golden files. `GRIPLINE_BLESS=1` rewrites them; look at the difference then.

use std::path::PathBuf;

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::{Buffer, Cell};

use super::View;
use gripline_protocol::SensorId;
use gripline_protocol::message::{FingertipGeometry, MapSums};
use gripline_recording::telemetry::{FrameReport, Limits, STAGES, Truth, WitnessReport};
use gripline_recording::units::Load;

pub(super) const LIMITS: Limits = Limits {
    friction: 0.45,
    slip_threshold: 0.5,
    contact_min_n: 0.0,
    floor_n: 1.0,
    ceiling_n: 30.0,
};

/// A frame of a 50 Hz run in which nothing touches.
pub(crate) fn report(frame: u64) -> FrameReport {
    FrameReport {
        frame,
        sensor: SensorId::FIRST,
        t_s: frame as f64 / 50.0,
        gate: "no_contact",
        health: Vec::new(),
        normal_n: 0.0,
        shear_x_n: 0.0,
        shear_y_n: 0.0,
        shear_n: 0.0,
        moment_nmm: 0.0,
        centre_of_pressure_mm: None,
        load: Load::of(&MapSums::default(), SensorId::FIRST, &FingertipGeometry::DEFAULT),
        contact: 0,
        stick: 0,
        stick_ratio: None,
        coulomb_slip: false,
        state: "NO_CONTACT",
        slip_evidence: 0.0,
        witnesses: WitnessReport::default(),
        time_to_slip_ms: None,
        line_n: 1.0,
        latency_us: 190.0 + (frame % 10) as f64,
        stages_us: [0.0, 150.0 + (frame % 10) as f64, 30.0, 0.0, 0.0, 4.0],
        faults: Vec::new(),
        late: None,
        wire_bytes: 72,
        markers: None,
        truth: None,
    }
}

/// A round contact of `radius` taxels about (9.5, 9.5): sticks within `stick_radius`, slips outside, pulled to +x +y.
fn contact(radius: f32, stick_radius: f32) -> ([[f32; 3]; 400], u16, u16) {
    let mut map = [[0.0; 3]; 400];
    let (mut contacts, mut sticks) = (0, 0);
    for (index, force) in map.iter_mut().enumerate() {
        let (x, y) = ((index % 20) as f32 - 9.5, (index / 20) as f32 - 9.5);
        let distance_square = x * x + y * y;
        if distance_square < radius * radius {
            let normal_n = 0.08 * (1.0 - distance_square / (radius * radius)).sqrt();
            let sticks_here = distance_square < stick_radius * stick_radius;
            let shear_n = normal_n * if sticks_here { 0.2 } else { 0.5 };
            *force = [0.8 * shear_n, 0.6 * shear_n, normal_n];
            contacts += 1;
            sticks += u16::from(sticks_here);
        }
    }
    (map, contacts, sticks)
}

/// A frame with such a contact in it.
fn report_of(frame: u64, map: &[[f32; 3]; 400], contacts: u16, sticks: u16) -> FrameReport {
    let sum = |axis: usize| map.iter().map(|force| f64::from(force[axis])).sum::<f64>();
    let ratio = f64::from(sticks) / f64::from(contacts);
    FrameReport {
        gate: "network",
        health: Vec::new(),
        normal_n: sum(2),
        shear_x_n: sum(0),
        shear_y_n: sum(1),
        shear_n: sum(0).hypot(sum(1)),
        moment_nmm: -12.34,
        contact: contacts,
        stick: sticks,
        stick_ratio: Some(ratio),
        state: "STICK",
        line_n: 8.0 + (frame % 100) as f64 / 50.0,
        latency_us: 1_500.0 + (frame % 100) as f64,
        stages_us: [0.0, 150.0, 30.0, 1_250.0 + (frame % 100) as f64, 40.0, 25.0],
        wire_bytes: 2_704,
        markers: None,
        truth: Some(Truth {
            phase: "hold".into(),
            normal_n: 11.0,
            shear_n: 2.3,
            stick_ratio: Some((ratio - 0.1).max(0.0)),
            gross_slip: false,
            slip_mm: 0.0,
        }),
        ..report(frame)
    }
}

#[test]
fn of_two_fingertips_the_one_that_sticks_less_is_drawn_and_marked_and_a_silent_one_is_not() {
    let text = |view: &View| {
        let cells = view.cells(80, 24);
        cells.content.iter().map(Cell::symbol).collect::<String>()
    };
    let (map, contacts, sticks) = contact(8.0, 7.6);
    let mut view = View::new(LIMITS);
    view.push(&report_of(0, &map, contacts, sticks), &map);
    assert!(!text(&view).contains("fingertip"), "there is only one");
    let second = |frame: u64, sticks: u16| FrameReport {
        sensor: SensorId::SECOND,
        ..report_of(frame, &map, contacts, sticks)
    };
    view.push(&second(1, sticks - 40), &map);
    assert!(text(&view).contains("fingertip 2 of 2"), "{}", text(&view));
    view.push(&second(2, sticks + 1), &map);
    assert!(text(&view).contains("fingertip 1 of 2"), "{}", text(&view));
    // The first one's camera is away for half a second.
    view.push(&second(25, sticks + 1), &map);
    assert!(
        text(&view).contains("fingertip 2 of 2, other silent"),
        "{}",
        text(&view)
    );
}

fn view_without_contact() -> View {
    let mut view = View::new(LIMITS);
    for frame in 0..100 {
        view.push(&report(frame), &[[0.0; 3]; 400]);
    }
    view
}

fn view_that_sticks() -> View {
    let mut view = view_without_contact();
    for frame in 100..400 {
        let (map, contacts, sticks) = contact(8.0, 7.6);
        view.push(&report_of(frame, &map, contacts, sticks), &map);
    }
    view
}

fn view_that_slips_with_a_fault() -> View {
    let mut view = view_that_sticks();
    for frame in 400..=600_u64 {
        let (map, contacts, sticks) = contact(8.0, 7.6 - (frame - 400) as f32 * 0.02);
        let mut report = report_of(frame, &map, contacts, sticks);
        if frame > 500 {
            report.state = "SLIP";
            report.time_to_slip_ms = Some(35);
            report.line_n = 30.0;
            report.faults = vec!["LINE AT CEILING", "MAPS LOST", "DEADLINE MISSED"];
            let truth = report.truth.as_mut().unwrap();
            (truth.phase, truth.gross_slip, truth.slip_mm) = ("pull".into(), true, 1.234);
        }
        view.push(&report, &map);
    }
    view
}

fn drawn(view: &View, width: u16, height: u16) -> Buffer {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| view.draw(frame)).unwrap();
    terminal.backend().buffer().clone()
}

fn text(buffer: &Buffer) -> String {
    buffer
        .content
        .chunks(buffer.area.width.into())
        .map(|cells| {
            cells
                .iter()
                .map(ratatui::buffer::Cell::symbol)
                .collect::<String>()
        })
        .map(|line| line.trim_end().to_owned() + "\n")
        .collect()
}

fn assert_golden(name: &str, buffer: &Buffer) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/view/{name}.txt"));
    let found = text(buffer);
    if std::env::var_os("GRIPLINE_BLESS").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &found).unwrap();
    }
    let expected = std::fs::read_to_string(&path)
        .unwrap_or_default()
        .replace("\r\n", "\n");
    assert!(
        found == expected,
        "tests/golden/view/{name}.txt expects\n{expected}\nbut the view shows\n{found}\n\
         If the new picture is right, rewrite the file with GRIPLINE_BLESS=1."
    );
}

#[test]
fn without_contact_the_skin_is_dark_and_the_ratio_has_no_trace() {
    assert_golden("no_contact", &drawn(&view_without_contact(), 80, 24));
}

#[test]
fn a_sticking_contact_shows_single_arrows_inside_a_slipping_rim() {
    assert_golden("stick", &drawn(&view_that_sticks(), 80, 24));
}

#[test]
fn a_slipping_contact_shows_its_fault_and_the_fall_of_the_ratio() {
    assert_golden("slip_with_fault", &drawn(&view_that_slips_with_a_fault(), 80, 24));
}

#[test]
fn a_larger_screen_has_a_larger_skin_and_longer_traces() {
    assert_golden(
        "slip_with_fault_132x50",
        &drawn(&view_that_slips_with_a_fault(), 132, 50),
    );
}

#[test]
fn a_screen_that_is_too_small_says_what_it_needs() {
    let view = view_that_slips_with_a_fault();
    let say = "terminal too small, need 80x24";
    assert!(text(&drawn(&view, 79, 24)).starts_with(say));
    assert!(text(&drawn(&view, 80, 23)).starts_with(say));
    assert_eq!(text(&drawn(&view, 12, 3)), "terminal too\nsmall, need\n80x24\n");
    assert_eq!(text(&drawn(&view, 1, 1)), "t\n");
}

#[test]
fn no_size_and_no_number_makes_it_panic() {
    let mut views = [
        View::new(LIMITS),
        view_without_contact(),
        view_that_slips_with_a_fault(),
        View::new(LIMITS),
    ];
    let mut odd = report_of(7, &[[f32::NAN; 3]; 400], 400, 0);
    odd.t_s = f64::NAN;
    odd.stages_us = [f64::INFINITY; STAGES.len()];
    views[3].push(&odd, &[[f32::NAN; 3]; 400]);
    odd.t_s = -1e300;
    odd.line_n = f64::NAN;
    odd.stick_ratio = Some(f64::INFINITY);
    odd.time_to_slip_ms = Some(u16::MAX);
    odd.faults = vec!["A FAULT WITH A NAME THAT IS LONGER THAN THE COLUMN"; 40];
    odd.state = "SOMETHING NEW";
    views[3].push(&odd, &[[f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY]; 400]);
    odd.t_s = 1e300;
    (odd.normal_n, odd.line_n, odd.wire_bytes) = (1e300, -1e300, usize::MAX);
    views[3].push(&odd, &[[f32::MAX; 3]; 400]);
    for view in &views {
        for width in [
            0, 1, 2, 3, 10, 39, 40, 41, 79, 80, 81, 119, 120, 160, 161, 255, 400,
        ] {
            for height in [0, 1, 2, 3, 10, 23, 24, 25, 43, 44, 45, 100, 255] {
                drawn(view, width, height);
            }
        }
    }
}
