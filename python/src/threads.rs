//! Threads that compute while Python may go on.
//!
//! Every call has a pool of its own: the global one does not survive `fork`, by which `multiprocessing` starts its workers.

use std::panic::{AssertUnwindSafe, catch_unwind};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::ThreadPool;

/// Factorization recurses along its elimination tree.
const STACK_BYTES: usize = 16 << 20;

/// A pool of `threads` threads, 0 for one per processor.
pub(crate) fn pool(threads: usize) -> PyResult<ThreadPool> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(STACK_BYTES).build();
    pool.map_err(|error| PyRuntimeError::new_err(error.to_string()))
}

/// Does `work` on a pool; other threads of Python go on meanwhile.
pub(crate) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> PyResult<T> + Send) -> PyResult<T> {
    py.detach(|| guarded(|| pool(0)?.install(work)))
}

/// A panic is an exception that `except Exception` catches.
pub(crate) fn guarded<T>(work: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
        Err(PyRuntimeError::new_err(format!("the computation broke off, please report this: {text}")))
    })
}
