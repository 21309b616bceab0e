//! The numbers of chladni for Python: thin functions on arrays. `chladni/__init__.py` is what users see.

mod analysis;
mod arguments;
mod bases_ply;
mod cloud;
mod command_line;
mod modes;
mod picture;
mod sample;
mod threads;

use pyo3::prelude::*;

/// Compiled part of the package `chladni`.
#[pymodule]
mod _chladni {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::analysis::analyze;
    #[pymodule_export]
    use super::cloud::Cloud;
    #[pymodule_export]
    use super::command_line::run_command_line;
    #[pymodule_export]
    use super::modes::Modes;
    #[pymodule_export]
    use super::picture::draw;
    #[pymodule_export]
    use super::sample::sample;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("NumericalError", module.py().get_type::<super::analysis::NumericalError>())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

/// An error of the caller: Python's `ValueError`, with the library's own words.
fn refused(error: impl std::fmt::Display) -> PyErr {
    pyo3::exceptions::PyValueError::new_err(error.to_string())
}
