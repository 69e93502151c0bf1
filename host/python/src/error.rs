//! Python's `GriplineError`: the one exception of the package, beside Python's own for wrong arguments.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    gripline,
    GriplineError,
    PyException,
    "Something that Gripline was asked for cannot be done: what was found, what was expected and what to do."
);

/// The line of an error as Python's [`GriplineError`].
pub(crate) fn failed(error: impl std::fmt::Display) -> PyErr {
    GriplineError::new_err(error.to_string())
}
