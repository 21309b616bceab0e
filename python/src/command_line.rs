//! The command line, the same as the program's.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs a command, named by `arguments` (the program's name first), and gives the exit code.
#[pyfunction]
pub(crate) fn run_command_line(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| chladni::cli::run(arguments))
}
