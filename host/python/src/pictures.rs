//! Pictures from Python, (T, H, W) uint8, as the crop that a network looks at: pure.

use gripline_capture::geometry::{CROP, CROP_SIDE, SMALL_SIDE};
use gripline_sensor::{Flip, MarkerKind, Sensor};
use numpy::ndarray::ArrayView2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::failed;

/// How pictures of a sensor become the 440×440 crop.
#[derive(Debug, Clone)]
pub(crate) struct Cropper {
    /// Columns and rows of a whole picture.
    size: [usize; 2],
    /// First column and row of the crop in it.
    corner: [usize; 2],
    flip: Flip,
    /// Whether pictures of 88×88 will do.
    small: bool,
}

impl Cropper {
    /// Of a sensor whose forces the network can know.
    ///
    /// # Errors
    /// Python's `GriplineError` for a sensor of another kind or crop.
    pub(crate) fn of(sensor: &Sensor, small: bool) -> PyResult<Self> {
        if sensor.markers.kind != MarkerKind::Volume {
            return Err(failed(format!(
                "sensor {}: found printed markers, expected particles in the gel: the force network knows no other sensor yet",
                sensor.identity()
            )));
        }
        let [left, top, width, height] = sensor.capture.crop_px;
        if [width, height] != [CROP_SIDE; 2] {
            return Err(failed(format!(
                "sensor {}: found a crop of {width}×{height} pixels, expected {CROP}: change capture.crop_px",
                sensor.identity()
            )));
        }
        Ok(Self {
            size: sensor.capture.size_px,
            corner: [left, top],
            flip: sensor.capture.flip,
            small,
        })
    }

    /// Refuses pictures of another size.
    pub(crate) fn check(&self, name: &str, rows: usize, columns: usize) -> PyResult<()> {
        let [width, height] = self.size;
        let small = self.small && [columns, rows] == [SMALL_SIDE; 2];
        if [columns, rows] == self.size || [columns, rows] == [CROP_SIDE; 2] || small {
            return Ok(());
        }
        let or_small = if self.small { " or 88×88" } else { "" };
        Err(PyValueError::new_err(format!(
            "{name}: found pictures of {rows} rows and {columns} columns, expected {height} and {width}, or {CROP}{or_small}: \
             crop or scale them"
        )))
    }

    /// Writes the crop of a picture whose size was checked.
    pub(crate) fn apply(&self, picture: &ArrayView2<'_, u8>, crop: &mut Vec<u8>) {
        crop.clear();
        let columns = picture.ncols();
        if columns == SMALL_SIDE && self.small {
            let step = CROP_SIDE / SMALL_SIDE;
            crop.extend((0..CROP.pixels()).map(|i| picture[[i / CROP_SIDE / step, i % CROP_SIDE / step]]));
            return;
        }
        let is_crop = [columns, picture.nrows()] == [CROP_SIDE; 2] && self.size != [CROP_SIDE; 2];
        let [left, top] = if is_crop { [0, 0] } else { self.corner };
        // A crop is taken as the view from outside already.
        let flip = if is_crop { Flip::None } else { self.flip };
        let (turn_rows, turn_columns) = match flip {
            Flip::None => (false, false),
            Flip::Horizontal => (false, true),
            Flip::Vertical => (true, false),
            Flip::Both => (true, true),
        };
        let place = |at: usize, turned: bool| if turned { CROP_SIDE - 1 - at } else { at };
        for row in 0..CROP_SIDE {
            let line = picture.row(top + place(row, turn_rows));
            crop.extend((0..CROP_SIDE).map(|column| line[left + place(column, turn_columns)]));
        }
    }
}
