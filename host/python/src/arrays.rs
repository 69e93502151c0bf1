//! What every class asks of an array before it reads one, and arrays for Python. Errors name what was found and expected.
//! Arrays are read where they lie, whatever their strides are; nothing is converted.

use numpy::ndarray::{ArrayView3, ArrayView4, Axis};
use numpy::{
    Element, PyArray, PyArray4, PyArrayMethods, PyReadonlyArray, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyList;

use gripline_protocol::{SIDE, TAXELS};
use gripline_recording::maps_file::FrameForces;

/// Fails where NumPy is not installed; to be called before anything else of it.
pub(crate) fn require_numpy(py: Python<'_>) -> PyResult<()> {
    py.import("numpy").map(drop)
}

/// `object` as an array of this many dimensions that can be read in place. `expected` is its shape and unit in words.
pub(crate) fn array_of<'a, 'py>(
    name: &str,
    object: &'a Bound<'py, PyAny>,
    dimensions: usize,
    expected: &str,
) -> PyResult<&'a Bound<'py, PyUntypedArray>> {
    require_numpy(object.py())?;
    let Ok(array) = object.cast::<PyUntypedArray>() else {
        let found = object.get_type();
        return Err(PyTypeError::new_err(format!(
            "{name}: found {}, expected a NumPy array of shape {expected}: convert it with numpy.asarray",
            found.name()?
        )));
    };
    if array.ndim() != dimensions {
        return Err(PyValueError::new_err(format!(
            "{name}: found shape {}, expected {expected}: reshape the array",
            shape_text(array.shape())
        )));
    }
    if !array.is_aligned() {
        return Err(PyValueError::new_err(format!(
            "{name}: found numbers at addresses that are not multiples of their size, expected an aligned array: copy it \
             with {name}.copy()"
        )));
    }
    Ok(array)
}

/// `array` with numbers of type `T`; `expected` are the types that are taken.
pub(crate) fn typed<'py, T: Element, D: numpy::ndarray::Dimension>(
    name: &str,
    array: &Bound<'py, PyUntypedArray>,
    expected: &str,
) -> PyResult<PyReadonlyArray<'py, T, D>> {
    let Ok(typed) = array.cast::<PyArray<T, D>>() else {
        return Err(PyTypeError::new_err(format!(
            "{name}: found dtype {}, expected {expected}",
            array.dtype()
        )));
    };
    typed.try_readonly().map_err(|_| {
        PyValueError::new_err(format!(
            "{name}: found an array that is being written, expected one that is not"
        ))
    })
}

/// As Python writes it.
pub(crate) fn shape_text(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        many => format!("{many:?}").replace('[', "(").replace(']', ")"),
    }
}

/// Room for this many numbers, or Python's `MemoryError`.
pub(crate) fn room<T>(count: usize) -> PyResult<Vec<T>> {
    let mut room = Vec::new();
    room.try_reserve_exact(count)
        .map_err(|_| PyMemoryError::new_err(format!("found no memory for {count} numbers")))?;
    Ok(room)
}

/// Force maps (T, 3, R, C), float32 or float64, R and C up to 20.
pub(crate) enum Maps<'py> {
    /// float32.
    Single(PyReadonlyArray<'py, f32, numpy::Ix4>),
    /// float64.
    Double(PyReadonlyArray<'py, f64, numpy::Ix4>),
}

const MAPS: &str = "(T, 3, R, C), force maps in newtons with channels x, y, z and R and C up to 20";

impl<'py> Maps<'py> {
    /// Checks everything but the numbers themselves.
    pub(crate) fn of(object: &Bound<'py, PyAny>) -> PyResult<Self> {
        let array = array_of("maps", object, 4, MAPS)?;
        let shape = array.shape();
        let wrong = |what: String| {
            let shape = shape_text(shape);
            Err(PyValueError::new_err(format!(
                "maps: found shape {shape}: {what}"
            )))
        };
        if shape[1] != 3 {
            let advice = if shape[3] == 3 {
                "move them with numpy.moveaxis(maps, -1, 1)"
            } else {
                "give x, y and z"
            };
            return wrong(format!(
                "found {} channels on axis 1, expected 3; {advice}",
                shape[1]
            ));
        }
        for (name, found) in [("rows", shape[2]), ("columns", shape[3])] {
            if !(1..=SIDE).contains(&found) {
                return wrong(format!(
                    "found {found} {name}, expected 1 to {SIDE}; cut or bin the grid"
                ));
            }
        }
        if array.cast::<PyArray4<f64>>().is_ok() {
            return typed("maps", array, "").map(Self::Double);
        }
        let expected =
            "float32 or float64 of this machine's byte order: convert it with maps.astype(numpy.float32)";
        typed("maps", array, expected).map(Self::Single)
    }

    /// Frames in it.
    pub(crate) fn frames(&self) -> usize {
        match self {
            Self::Single(array) => array.shape()[0],
            Self::Double(array) => array.shape()[0],
        }
    }

    /// Its numbers, for reading detached from Python. None where there is no frame.
    pub(crate) fn view(&self) -> Option<MapsView<'_>> {
        (self.frames() > 0).then(|| match self {
            Self::Single(array) => MapsView::Single(array.as_array()),
            Self::Double(array) => MapsView::Double(array.as_array()),
        })
    }
}

/// The numbers of [`Maps`].
#[derive(Clone, Copy)]
pub(crate) enum MapsView<'a> {
    Single(ArrayView4<'a, f32>),
    Double(ArrayView4<'a, f64>),
}

impl MapsView<'_> {
    /// The forces of one frame; a smaller grid sits in the corner of an empty map.
    ///
    /// # Errors
    /// Python's `ValueError` for a number that is NaN or infinite, with frame and taxel.
    pub(crate) fn frame(&self, frame: usize) -> PyResult<FrameForces> {
        match self {
            Self::Single(maps) => forces_of(&maps.index_axis(Axis(0), frame), frame),
            Self::Double(maps) => forces_of(&maps.index_axis(Axis(0), frame), frame),
        }
    }
}

fn forces_of<T: Copy + Into<f64>>(map: &ArrayView3<'_, T>, frame: usize) -> PyResult<FrameForces> {
    let mut forces = [[0.0; 3]; TAXELS];
    let mut is_finite = true;
    for (axis, plane) in map.outer_iter().enumerate() {
        for (row, line) in plane.outer_iter().enumerate() {
            for (force, number) in forces[row * SIDE..].iter_mut().zip(line) {
                let number: f64 = (*number).into();
                is_finite &= number.is_finite();
                force[axis] = number;
            }
        }
    }
    if is_finite {
        return Ok(forces);
    }
    let found = (0..3 * TAXELS)
        .map(|place| (place / TAXELS, place % TAXELS))
        .find(|(axis, taxel)| !forces[*taxel][*axis].is_finite());
    let (axis, taxel) = found.unwrap_or_default();
    Err(PyValueError::new_err(format!(
        "maps: found {} in frame {frame} at row {}, column {}, {}; expected finite forces: repair or leave out the frame",
        forces[taxel][axis],
        taxel / SIDE,
        taxel % SIDE,
        ['x', 'y', 'z'][axis]
    )))
}

/// The planes x, y and z of a map, as they lie in an array (3, 20, 20).
pub(crate) fn planes(map: &[[f32; 3]; TAXELS]) -> impl Iterator<Item = f32> + '_ {
    (0..3).flat_map(move |axis| map.iter().map(move |force| force[axis]))
}

/// Texts as a NumPy array of text.
pub(crate) fn texts<S: AsRef<str>>(
    py: Python<'_>,
    texts: impl IntoIterator<Item = S>,
) -> PyResult<Bound<'_, PyAny>> {
    let list = PyList::empty(py);
    for text in texts {
        list.append(text.as_ref())?;
    }
    py.import("numpy")?.call_method1("array", (list, "U"))
}

/// Numbers as an array of this shape, whose product is their count.
pub(crate) fn shaped<T: Element, D: numpy::ndarray::IntoDimension>(
    py: Python<'_>,
    numbers: Vec<T>,
    shape: D,
) -> PyResult<Bound<'_, PyArray<T, D::Dim>>> {
    PyArray::from_vec(py, numbers).reshape(shape)
}

/// A number where there is one, else NaN.
pub(crate) fn or_nan(number: Option<f64>) -> f64 {
    number.unwrap_or(f64::NAN)
}
