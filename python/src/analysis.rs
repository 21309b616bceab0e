//! The analysis on threads of its own, so that Python can interrupt it.

use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use chladni::analysis::{self, Analysis, AnalysisError, Examined, JobKind, Parameters, SparseMatrix};
use chladni::cloud::PointCloud;
use chladni::progress::Progress;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::arguments::{self, called};
use crate::cloud::Cloud;
use crate::refused;
use crate::threads::{guarded, pool};

pyo3::create_exception!(
    chladni._chladni,
    NumericalError,
    PyRuntimeError,
    "The eigensolver or a factorization failed numerically."
);

/// Between two looks at signals and progress.
const LOOK: Duration = Duration::from_millis(50);

/// Bases that are copied together: a cache line of a row.
const COLUMNS: usize = 8;

/// What [`analyze`] hands to Python: report as JSON, mass, bases (n × k) or the matrix Q by rows.
type Results<'py> = (
    String,
    Bound<'py, PyArray1<f64>>,
    Option<Bound<'py, PyArray2<f64>>>,
    Option<(Bound<'py, PyArray1<u64>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>)>,
);

/// The same before it becomes Python's.
struct Computed {
    report: String,
    mass: Vec<f64>,
    vectors: Option<(Vec<f64>, usize)>,
    matrix: Option<SparseMatrix>,
}

/// Analyzes a cloud. `kind` is `eigen` or `operator`; without `bases` among the parameters there are as many as the command
/// line takes. `progress` is called with the share that is done and the name of the phase.
#[pyfunction]
#[pyo3(signature = (cloud, kind, parameters, threads, progress))]
pub(crate) fn analyze<'py>(
    py: Python<'py>,
    cloud: &Bound<'py, Cloud>,
    kind: &str,
    parameters: &Bound<'py, PyDict>,
    threads: usize,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Results<'py>> {
    let kind = if kind == "operator" { JobKind::Operator } else { JobKind::Eigen };
    let asked: Parameters = arguments::read(parameters)?;
    asked.check().map_err(failed)?;
    let names_bases = !parameters.get_item("bases")?.is_none_or(|bases| bases.is_none());
    let cloud = Arc::clone(&cloud.get().inner);
    let shared = Arc::new(Progress::new());
    let (done, mut waiting) = channel::<()>();
    let computing = std::thread::spawn({
        let shared = Arc::clone(&shared);
        move || {
            let result = guarded(|| compute(&cloud, kind, asked, names_bases, threads, &shared));
            drop(done);
            result
        }
    });
    let tell = |share: f64| match &progress {
        Some(told) => told.call1((share, shared.phase().name())).map(drop),
        None => Ok(()),
    };
    loop {
        let waited;
        (waited, waiting) = py.detach(move || (waiting.recv_timeout(LOOK), waiting));
        if waited != Err(RecvTimeoutError::Timeout) {
            break;
        }
        if let Err(error) = py.check_signals().and_then(|()| tell(shared.fraction())) {
            shared.cancel();
            let _ = py.detach(|| computing.join());
            return Err(error);
        }
    }
    let computed =
        py.detach(|| computing.join()).unwrap_or_else(|_| Err(PyRuntimeError::new_err("panic")))?;
    tell(1.0)?;
    into_python(py, computed)
}

fn compute(
    cloud: &PointCloud,
    kind: JobKind,
    mut parameters: Parameters,
    names_bases: bool,
    threads: usize,
    progress: &Progress,
) -> PyResult<Computed> {
    pool(threads)?.install(|| {
        let examined = Examined::of(cloud);
        let admitted =
            if names_bases { examined.admit(&parameters) } else { examined.admit_lowered(&mut parameters) };
        admitted.map_err(failed)?;
        let analysis = analysis::analyze(cloud, kind, &parameters, progress).map_err(failed)?;
        let report = serde_json::to_string(&analysis.report).map_err(refused)?;
        let vectors = (kind == JobKind::Eigen).then(|| (by_rows(&analysis, cloud.len()), analysis.bases()));
        Ok(Computed { report, mass: analysis.mass(), vectors, matrix: analysis.operator_matrix() })
    })
}

/// The bases, n × k, row by row.
fn by_rows(analysis: &Analysis, rows: usize) -> Vec<f64> {
    let count = analysis.bases();
    let mut vectors = vec![0.0; rows * count];
    for first in (0..count).step_by(COLUMNS) {
        let columns: Vec<Vec<f64>> =
            (first..count.min(first + COLUMNS)).into_par_iter().map(|j| analysis.basis(j)).collect();
        vectors.par_chunks_exact_mut(count).enumerate().with_min_len(4096).for_each(|(row, values)| {
            values[first..].iter_mut().zip(&columns).for_each(|(value, column)| *value = column[row]);
        });
    }
    vectors
}

fn into_python(py: Python<'_>, computed: Computed) -> PyResult<Results<'_>> {
    let Computed { report, mass, vectors, matrix } = computed;
    let rows = mass.len();
    let vectors =
        vectors.map(|(values, count)| PyArray1::from_vec(py, values).reshape([rows, count])).transpose()?;
    let matrix = matrix.map(|SparseMatrix { offsets, columns, values }| {
        (PyArray1::from_vec(py, offsets), PyArray1::from_vec(py, columns), PyArray1::from_vec(py, values))
    });
    Ok((report, PyArray1::from_vec(py, mass), vectors, matrix))
}

fn failed(error: AnalysisError) -> PyErr {
    match error {
        AnalysisError::Numerical(message) => NumericalError::new_err(message),
        AnalysisError::Canceled(_) => PyKeyboardInterrupt::new_err(()),
        AnalysisError::Parameter { name, reason } => {
            refused(AnalysisError::Parameter { name: called(name), reason })
        }
        other => refused(other),
    }
}
