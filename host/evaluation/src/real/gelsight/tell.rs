//! The figures as a section of a document. Pure.

use super::judge::{Figures, Witness};
use crate::document::{number, table};

/// Bounds: area pooled and stratified, sensitivity, early warning.
const BOUNDS: [f64; 4] = [0.96, 0.95, 0.85, 0.82];
/// Bounds: deviation of still markers, distance from rest after release, pixels.
const MARKER_BOUNDS_PX: [f64; 2] = [0.05, 0.3];

/// Bounds and tables.
pub(in crate::real) fn markdown(figures: &Figures) -> String {
    let mut rows = Vec::new();
    for found in &figures.witnesses {
        let pair = |a, b| format!("{} / {}", number(a, 3), number(b, 3));
        rows.push(vec![
            match found.witness {
                Witness::Imprint => "imprint in the gel's frame",
                Witness::ImprintWithoutRest => "the same without a rest picture",
                Witness::Energy => "energy of the imprint alone",
                Witness::MarkerStep => "marker step alone",
            }
            .to_owned(),
            pair(found.pooled, found.stratified),
            pair(
                found.pooled_without_wrong_label,
                found.stratified_without_wrong_label,
            ),
            number(found.accuracy, 3),
            number(found.sensitivity, 3),
            format!(
                "{} at {}",
                number(found.sensitivity_left_out, 3),
                number(found.alarms_per_minute_left_out, 2)
            ),
            number(found.early_warning, 3),
            number(found.lead_frames, 0),
        ]);
    }
    // `evaluate real` does not run it: measured once, with OpenCV, on the windows and rest pictures of this report.
    for (name, area, without, warning) in [
        (
            "prototype, on the same windows and rests (run by hand, not by this command)",
            "0.957 / 0.945",
            "0.967 / 0.960",
            "",
        ),
        (
            "prototype, as its notes say, on windows of its own",
            "0.97 / 0.96",
            "",
            "0.82",
        ),
    ] {
        rows.push(
            [name, area, without, "", "", "", warning, ""]
                .map(str::to_owned)
                .to_vec(),
        );
    }
    let columns = [
        "witness",
        "AUC pooled / stratified",
        "without the wrong label",
        "accuracy",
        "sensitivity at 0.3 alarms a minute",
        "the same, left out, at alarms a minute",
        "early warning AUC",
        "lead, frames",
    ];
    let [trials, slips] = figures.trials;
    let [fewest, max] = figures.markers;
    format!(
        "### GelSight Mini, 130 trials of a two-finger gripper\n\n{trials} trials of {} objects (amitparag/Incipient-Slip-Detection, \
         BSD 2-Clause), {slips} in which the object was lost at some time, and {:.1} minutes of hold. A trial's score is its largest \
         evidence in the window: frames 11 to 188 of clips that are in contact throughout (rest: other objects' first pictures of the \
         most similar gels), 45 to 188 of those that show the open hand (rest: those of frames 12 to 20 that show no contact; in 18 \
         clips some do). Accuracy and what is left out: thresholds chosen \
         on the other objects. An alarm ends after a second below its threshold. \
         Early warning: the largest score up to 8 frames before less than 0.3 of the imprint's energy is left, against as many first frames of \
         each hold; {} trials were held at first and lost it.\n\n{}\n{}\n\
         Markers: {fewest} to {max} a gel; still they deviate by {} pixels (median over gels; largest {}), after release they are {} \
         pixels from rest (median; largest {}).\n\n\
         What is not proven: labels are of whole trials, so no frame is known to slip; there are no newtons, so no stick ratio stands \
         beside; the recordings have about 7 frames a second, so nothing is said of latency. One trial labelled 0 (pattern_cotton_cloth, \
         number 11) visibly loses its object; figures without it stand beside. No constant was chosen on single trials; lags, energy of noise and \
         degree of the light's field lie on a plateau (pooled 0.95 to 0.96 for lags of 1 to 5 and noise of 2 to 8 a finger).\n",
        figures.objects,
        figures.hold_minutes,
        figures.warned_trials,
        bounds(figures),
        table(&columns, &rows),
        number(figures.still_px[0], 3),
        number(figures.still_px[1], 3),
        number(figures.return_px[0], 2),
        number(figures.return_px[1], 2),
    )
}

fn bounds(figures: &Figures) -> String {
    let imprint = figures
        .witnesses
        .iter()
        .find(|found| found.witness == Witness::Imprint);
    let of = |value: fn(&super::judge::WitnessFigures) -> Option<f64>| imprint.and_then(value);
    let min = [
        ("AUC pooled", BOUNDS[0], of(|found| found.pooled)),
        (
            "AUC stratified by session",
            BOUNDS[1],
            of(|found| found.stratified),
        ),
        (
            "sensitivity at ≤ 0.3 false alarms a minute",
            BOUNDS[2],
            of(|found| found.sensitivity),
        ),
        ("early warning, AUC", BOUNDS[3], of(|found| found.early_warning)),
    ];
    let max = [
        (
            "still markers deviate, px",
            MARKER_BOUNDS_PX[0],
            figures.still_px[0],
        ),
        (
            "markers' distance from rest after release, px",
            MARKER_BOUNDS_PX[1],
            figures.return_px[0],
        ),
    ];
    let row = |measure: &str, sign: &str, bound: f64, figure: Option<f64>, held: bool| {
        let verdict = if held { "held" } else { "**missed**" };
        [
            measure.to_owned(),
            format!("{sign} {bound}"),
            number(figure, 3),
            verdict.to_owned(),
        ]
        .to_vec()
    };
    let rows: Vec<_> = min
        .iter()
        .map(|(measure, bound, figure)| {
            row(
                measure,
                "≥",
                *bound,
                *figure,
                figure.is_some_and(|figure| figure >= *bound),
            )
        })
        .chain(max.iter().map(|(measure, bound, figure)| {
            row(
                measure,
                "≤",
                *bound,
                *figure,
                figure.is_some_and(|figure| figure <= *bound),
            )
        }))
        .collect();
    table(&["measure", "bound", "figure", ""], &rows)
}
