//! The command line, the same as the program's.

use std::ffi::OsString;
use std::io::Write;

use pyo3::prelude::*;

/// Runs a command, named by `arguments` (the program's name first), and gives the exit code.
#[pyfunction]
pub(crate) fn run_command_line(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| {
        let code = chladni::cli::run(arguments);
        // Rust writes what is left of standard output at the end of its own `main` only.
        let _ = std::io::stdout().flush();
        code
    })
}
