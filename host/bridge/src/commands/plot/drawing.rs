//! A recording as a figure: traces, strips and force maps. Pure.

use gripline_chart::{
    Axis, BLUE, Chart, Colour, FAINT, Figure, GREEN, GREY, INK, Legend, Map, Mark, Note, ORANGE, Panel,
    Series, VERMILION,
};

use super::series::{ForceMapAt, Moment, Traces};

/// Who said slip.
type Says = fn(&Moment) -> bool;

const WIDTH: u32 = 1_000;
/// Height of each row: stick ratio, strips of slip, forces, maps, a line of text.
const HEIGHTS: [u32; 5] = [270, 120, 220, 260, 30];
/// A taxel that sticks, and one that slips, at full scale.
const STICKS: Colour = Colour(0, 80, 160);
const SLIPS: Colour = Colour(200, 60, 20);
/// Taxels along a side of a map.
const SIDE: usize = 20;

/// The whole figure.
pub(super) fn figure(traces: &Traces) -> Figure {
    let peaks = traces
        .maps
        .iter()
        .flat_map(|at| at.map.iter().map(|force| force[2]));
    let full_n = peaks.fold(0.02, f32::max);
    let maps: Vec<Panel> = traces
        .maps
        .iter()
        .zip('a'..)
        .map(|(at, name)| Panel::Map(force_map(traces, at, name, full_n)))
        .collect();
    let text = if maps.is_empty() {
        "nothing touched".to_owned()
    } else {
        let friction = traces.friction;
        format!(
            "blue: sticks, red: slips (f_T > {friction:.2} f_z); darkest: {full_n:.2} N a taxel; arrows: shear"
        )
    };
    let [ratio, strips, forces, map_row, text_row] = HEIGHTS;
    // A single map does not fill the row.
    let blank = maps.len()..4;
    let maps = maps.into_iter().chain(blank.map(|_| Panel::Text(String::new())));
    Figure {
        width: WIDTH,
        rows: vec![
            (ratio, vec![Panel::Chart(stick_ratio_chart(traces))]),
            (strips, vec![Panel::Chart(slip_chart(traces))]),
            (forces, vec![Panel::Chart(force_chart(traces))]),
            (map_row, maps.collect()),
            (text_row, vec![Panel::Text(text)]),
        ],
    }
}

/// From the first frame to the last.
fn time(traces: &Traces, label: &str) -> Axis {
    let first = traces.moments.first().map_or(0.0, |moment| moment.t_s);
    let last = traces.moments.last().map_or(1.0, |moment| moment.t_s);
    Axis {
        ticks: 12,
        has_grid: false,
        ..Axis::new(label, [first, last.max(first + 1e-3)])
    }
}

/// A trace, broken where there is no value; the first piece carries the label.
fn trace(
    traces: &Traces,
    label: &str,
    colour: Colour,
    width: u32,
    value: impl Fn(&Moment) -> Option<f64>,
) -> Vec<Series> {
    let lines = traces.lines(value).into_iter().enumerate();
    lines
        .map(|(piece, line)| {
            let label = if piece == 0 { label } else { "" };
            Series::new(label, colour, Mark::Line(width), line)
        })
        .collect()
}

fn stick_ratio_chart(traces: &Traces) -> Chart {
    let note = |at, text: String, offset, colour| Note {
        at,
        text,
        offset: Some(offset),
        colour,
    };
    let x = Axis {
        ticks: 0,
        ..time(traces, "")
    };
    let [start_s, end_s] = x.range;
    let mut series = Vec::new();
    let mut notes = Vec::new();
    for (t_s, phase) in traces.phases().into_iter().filter(|(_, phase)| !phase.is_empty()) {
        series.push(Series::new(
            "",
            FAINT,
            Mark::Line(1),
            vec![(t_s, 0.0), (t_s, 1.05)],
        ));
        notes.push(note((t_s, 0.0), phase.to_owned(), (4, -16), GREY));
    }
    let threshold = traces.threshold;
    let limit = vec![(start_s, threshold), (end_s, threshold)];
    series.push(Series::new("", VERMILION, Mark::Dashed, limit));
    notes.push(note(
        (end_s, threshold),
        format!("slip below {threshold:.2}"),
        (-95, -15),
        VERMILION,
    ));
    series.extend(trace(traces, "world", GREY, 1, |moment| moment.true_stick_ratio));
    series.extend(trace(traces, "detector", BLUE, 2, |moment| moment.stick_ratio));
    for (at, name) in traces.maps.iter().zip('a'..) {
        let moment = &traces.moments[at.moment];
        let point = (moment.t_s, moment.stick_ratio.unwrap_or(0.0));
        series.push(Series::new("", BLUE, Mark::Dots(4), vec![point]));
        notes.push(note(point, name.to_string(), (-3, 7), INK));
    }
    Chart {
        title: String::new(),
        x,
        y: Axis::new("stick ratio", [0.0, 1.05]),
        legend: Legend::Above,
        series,
        notes,
    }
}

/// When each of them said slip.
fn slip_chart(traces: &Traces) -> Chart {
    let known = traces.moments.iter().any(|moment| moment.true_slip.is_some());
    let rows: [(&str, Colour, Says); 3] = [
        ("SR slips", BLUE, |moment| moment.slip),
        ("Coulomb", ORANGE, |moment| moment.coulomb_slip),
        (if known { "truth" } else { "truth: ?" }, VERMILION, |moment| {
            moment.true_slip == Some(true)
        }),
    ];
    let x = time(traces, "s");
    let start_s = x.range[0];
    let mut series = Vec::new();
    let mut notes = Vec::new();
    for ((name, colour, says), bottom) in rows.into_iter().zip([2.12, 1.12, 0.12]) {
        let top = bottom + 0.76;
        let corners = traces.spans(says).into_iter();
        let corners = corners.flat_map(|(from, to)| [(from, bottom), (to, top)]);
        series.push(Series::new("", colour, Mark::Boxes, corners.collect()));
        notes.push(Note {
            at: (start_s, top),
            text: name.to_owned(),
            offset: Some((-64, 0)),
            colour: INK,
        });
    }
    Chart {
        title: String::new(),
        x,
        y: Axis {
            ticks: 0,
            has_grid: false,
            ..Axis::new("", [0.0, 3.0])
        },
        legend: Legend::None,
        series,
        notes,
    }
}

fn force_chart(traces: &Traces) -> Chart {
    let forces = traces
        .moments
        .iter()
        .map(|moment| moment.normal_n.max(moment.shear_n).max(moment.line_n));
    let highest_n = forces.fold(1.0, f64::max);
    let mut series = trace(traces, "normal force", BLUE, 2, |moment| Some(moment.normal_n));
    series.extend(trace(traces, "shear force", ORANGE, 2, |moment| {
        Some(moment.shear_n)
    }));
    series.extend(trace(traces, "grip-force line", GREEN, 2, |moment| {
        Some(moment.line_n)
    }));
    Chart {
        title: String::new(),
        x: time(traces, ""),
        y: Axis::new("N", [0.0, 1.05 * highest_n]),
        legend: Legend::Above,
        series,
        notes: Vec::new(),
    }
}

/// The colour says whether a taxel sticks, its strength the normal force up to `full_n`.
fn force_map(traces: &Traces, at: &ForceMapAt, name: char, full_n: f32) -> Map {
    let moment = &traces.moments[at.moment];
    let ratio = moment
        .stick_ratio
        .map_or("–".to_owned(), |ratio| format!("{ratio:.2}"));
    let touches = |force: &[f32; 3]| f64::from(force[2]) > traces.contact_min_n;
    let colour = |force: &[f32; 3]| {
        if !touches(force) {
            return Colour(255, 255, 255);
        }
        let sticks = f64::from(force[0].hypot(force[1])) <= traces.friction * f64::from(force[2]);
        let full = if sticks { STICKS } else { SLIPS };
        let share = 0.15 + 0.85 * (force[2] / full_n).min(1.0);
        let mix = |channel: u8| (255.0 + (f32::from(channel) - 255.0) * share) as u8;
        Colour(mix(full.0), mix(full.1), mix(full.2))
    };
    // Row 0 of a force map is the lowest.
    let rows = at.map.chunks(SIDE).rev();
    // The longest arrow is as long as two taxels.
    let shears = at.map.iter().map(|force| force[0].hypot(force[1]));
    let scale = 2.0 / f64::from(shears.fold(1e-3, f32::max));
    let arrows = at.map.iter().enumerate().filter(|(taxel, force)| {
        // Every second taxel, so that the arrows can be told apart.
        touches(force) && (taxel % SIDE + taxel / SIDE).is_multiple_of(2)
    });
    Map {
        title: format!(
            "{name}  {:.2} s  SR {ratio}  {:.1} N",
            moment.t_s, moment.normal_n
        ),
        side: SIDE,
        cells: rows.flatten().map(colour).collect(),
        half_mm: None,
        bar: None,
        key: Vec::new(),
        arrows: arrows
            .map(|(taxel, [x, y, _])| {
                let foot = [taxel % SIDE, SIDE - 1 - taxel / SIDE].map(|place| place as f64 + 0.5);
                (foot, [f64::from(*x) * scale, -f64::from(*y) * scale])
            })
            .collect(),
    }
}
