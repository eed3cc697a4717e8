//! The library's errors as Python's.

use pyo3::exceptions::{PyMemoryError, PyOSError, PyValueError};
use pyo3::types::PyAnyMethods;
use pyo3::{PyErr, Python};
use sprung::Error;
use sprung::error::Invalid;
use std::io::ErrorKind;

/// `OSError` (of the kind that the system's number says) for files, `MemoryError` for what does not fit, `Breakdown` for a step that broke
/// down, `ValueError` for all else.
pub fn raised(error: Error) -> PyErr {
    match error {
        Error::Io { path, source } if source.kind() != ErrorKind::InvalidData => match source.raw_os_error() {
            Some(number) => {
                let message = source.to_string();
                let message = message.strip_suffix(&format!(" (os error {number})")).unwrap_or(&message).to_owned();
                PyOSError::new_err((number, message, path.display().to_string()))
            }
            None => PyOSError::new_err(format!("{}: {source}", path.display())),
        },
        Error::Breakdown { status, .. } => Python::attach(|py| {
            let made = py
                .import("sprung._errors")
                .and_then(|errors| errors.call_method1("Breakdown", (error.to_string(), status)));
            made.map_or_else(|raised| raised, PyErr::from_value)
        }),
        Error::TooLarge { .. } => PyMemoryError::new_err(error.to_string()),
        other => PyValueError::new_err(other.to_string()),
    }
}

/// As [`raised`], for a value that was given as an argument: its name is the last part of the scene's key.
pub fn of_argument(error: Error) -> PyErr {
    raised(match error {
        Error::Invalid(invalid) => {
            let key = ["particles.", "springs."].iter().find_map(|table| invalid.key.strip_prefix(table));
            let key = key.unwrap_or(&invalid.key).replace("drag.coefficient", "drag");
            // The scene's table of forces, which are loads here.
            let key = if key == "forces" { "loads".into() } else { key };
            Error::Invalid(Invalid { key, ..invalid })
        }
        other => other,
    })
}

/// A `ValueError` for a value that breaks a rule.
pub fn invalid(invalid: Invalid) -> PyErr {
    raised(Error::Invalid(invalid))
}
