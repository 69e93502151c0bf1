//! Do the values of a description fit each other? Pure.

use crate::description::{Lens, MarkerKind, Sensor};
use crate::table::Section;

/// Scales along x and y may differ by this factor.
const SQUARE: f64 = 1.1;
/// A force map covers the field within this factor.
const COVERS: f64 = 1.5;
/// The number of markers that are seen fits pitch and field within this factor.
const COUNTS: f64 = 1.6;
/// Smallest diameter of a printed marker that has a centre, pixels.
const DIAMETER_MIN_PX: f64 = 4.0;

/// Notes what does not fit. `sections` in the order of the file: capture, view, gel, markers, taxels, health.
pub(crate) fn check(sensor: &Sensor, sections: &[Section<'_>; 6]) {
    let [capture, view, _, markers, taxels, _] = sections;
    let ([left, top, width, height], [columns, rows]) = (sensor.capture.crop_px, sensor.capture.size_px);
    if width < 16 || height < 16 || left + width > columns || top + height > rows {
        capture.note(
            "crop_px",
            &format!("[{left}, {top}, {width}, {height}]"),
            &format!("a part of at least 16×16 inside size_px, {columns}×{rows}"),
            "first column, first row, columns, rows",
        );
        return;
    }
    let [x, y] = sensor.px_per_mm();
    if sensor.view.lens == Lens::Flat && !(1.0 / SQUARE..=SQUARE).contains(&(x / y)) {
        view.note(
            "field_mm",
            &format!("{x:.1} pixels a millimetre along x, {y:.1} along y"),
            &format!("the same within {:.0} %", (SQUARE - 1.0) * 100.0),
            "width, height; or mend crop_px",
        );
    }
    let [field_x, field_y] = sensor.view.field_mm;
    if let (MarkerKind::Plane, Some([min, max])) = (sensor.markers.kind, sensor.markers.pitch_mm) {
        if sensor.markers.diameter_mm[1] >= 0.8 * min {
            markers.note(
                "diameter_mm",
                &format!("up to {} at a pitch of {min}", sensor.markers.diameter_mm[1]),
                "less than four fifths of the pitch, so that markers do not touch",
                "measure both",
            );
        }
        if sensor.diameter_px()[0] < DIAMETER_MIN_PX {
            markers.note(
                "diameter_mm",
                &format!("{:.1} pixels", sensor.diameter_px()[0]),
                &format!("at least {DIAMETER_MIN_PX} pixels"),
                "mend it, field_mm or size_px",
            );
        }
        let seen = |pitch: f64, zoom: f64| field_x * field_y / (pitch * zoom).powi(2);
        let possible = [
            seen(max, sensor.view.zoom[1]) / COUNTS,
            seen(min, sensor.view.zoom[0]) * COUNTS,
        ];
        let [fewest, largest] = sensor.markers.count.map(|count| count as f64);
        if largest < possible[0] || fewest > possible[1] {
            markers.note(
                "count",
                &format!("[{fewest}, {largest}]"),
                &format!(
                    "a part of {:.0} to {:.0}, as pitch and field say",
                    possible[0], possible[1]
                ),
                "count the markers of a picture, or mend pitch_mm or field_mm",
            );
        }
    }
    if sensor.markers.depth_mm[1] > sensor.gel.thickness_mm {
        markers.note(
            "depth_mm",
            &format!("up to {} mm", sensor.markers.depth_mm[1]),
            &format!("at most the gel's thickness, {} mm", sensor.gel.thickness_mm),
            "measure from the surface",
        );
    }
    let covered = sensor.taxels.grid[0] as f64 * sensor.taxels.pitch_mm;
    if !(1.0 / COVERS..=COVERS).contains(&(covered / field_x)) {
        taxels.note(
            "pitch_mm",
            &format!("{covered:.1} mm over all columns"),
            &format!("about the field's width, {field_x} mm"),
            "mend it, grid or field_mm",
        );
    }
}
