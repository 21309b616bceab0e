//! `chladni analyze`: a file in, a directory of results out.

mod results;
mod run;
mod summary;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use chladni::analysis::{AnalysisError, Examined, JobKind, Parameters};
use chladni::app::{Settings, bytes};
use chladni::cloud::reader::read_columns;

use super::flags::{Flags, word};
use super::input::{self, CloudArgs};
use super::interrupt::Interrupt;
use super::reporting::Reporting;
use super::{Failure, output};

/// Analyze a point cloud and write the results into a directory.
#[derive(Debug, clap::Args)]
pub(crate) struct AnalyzeArgs {
    /// Point cloud: PLY, OBJ, OFF, STL, XYZ, CSV, NPY, PCD, LAS, LAZ or E57; `-` reads standard input
    cloud: PathBuf,

    /// Directory for the results
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,

    /// Write into a directory that is not empty
    #[arg(long)]
    force: bool,

    /// Operator and mass only, or eigenpairs too; eigenpairs unless functions are to be applied
    #[arg(long, value_parser = word::<JobKind>(&JobKind::ALL.map(JobKind::name)))]
    kind: Option<JobKind>,

    /// Apply the operator to functions, an npy file of n or n × m numbers, and write laplacian.npy
    #[arg(long, value_name = "FILE")]
    apply: Option<PathBuf>,

    #[command(flatten)]
    reading: CloudArgs,

    /// Threads that compute, 0 for one per processor
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,

    /// Bytes of memory that the analysis may be estimated to take, 0 for half of what there is; of larger clouds a part is
    /// solved, and its bases are brought to all points
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value_t = 0)]
    memory: u64,

    #[command(flatten)]
    reporting: Reporting,

    #[command(flatten, next_help_heading = "Parameters of the analysis")]
    parameters: Flags<Parameters>,
}

/// Reads, analyses, writes, and prints a summary.
pub(crate) fn run(args: &AnalyzeArgs) -> Result<(), Failure> {
    let parameters = args.parameters.0.clone();
    parameters.check().map_err(Failure::input)?;
    let kind = kind(args)?;
    let directory = output::Directory::prepare(&args.output, args.force)?;
    let watch = run::Watch::new(args.reporting.quiet);
    let interrupt = Interrupt::cancels(Arc::clone(&watch.progress))?;
    interrupt.outcome(analyze_into(directory, args, kind, &parameters, &watch))
}

/// The directory is gone when this ends early.
fn analyze_into(
    directory: output::Directory,
    args: &AnalyzeArgs,
    kind: JobKind,
    parameters: &Parameters,
    watch: &run::Watch,
) -> Result<(), Failure> {
    let cloud = args.reading.read(&args.cloud)?;
    let functions = args.apply.as_deref().map(|path| functions(path, cloud.len())).transpose()?;
    let mut parameters = parameters.clone();
    let examined = Examined::of(&cloud);
    let admitted = if args.parameters.is_given("bases") {
        examined.admit(&parameters)
    } else {
        examined.admit_lowered(&mut parameters)
    };
    admitted.map_err(|error| of_analysis(&error))?;
    let budget = Settings { memory_budget: args.memory, ..Settings::default() }.memory_budget();
    let (points, faces) = (cloud.len() as u64, cloud.faces().len() as u64);
    let parameters = parameters.fitted(points, cloud.dimension(), faces, kind, budget);
    let ran = run::with_progress(&cloud, kind, &parameters, args.threads, watch)?;
    let files = results::write(directory, &cloud, kind, functions.as_deref(), &ran)?;
    summary::print(&ran, &files, args.reporting);
    Ok(())
}

/// What is computed: bases and the operator do not come together, because the operator is used up by its bases.
fn kind(args: &AnalyzeArgs) -> Result<JobKind, Failure> {
    match (args.kind, &args.apply) {
        (Some(JobKind::Eigen), Some(_)) => Err(Failure::Input(
            "--apply needs the operator itself: leave --kind out or say --kind operator".into(),
        )),
        (None, Some(_)) => Ok(JobKind::Operator),
        (kind, None) => Ok(kind.unwrap_or_default()),
        (Some(kind), _) => Ok(kind),
    }
}

/// One value per row of the cloud for every function.
fn functions(path: &Path, rows: usize) -> Result<Vec<Vec<f64>>, Failure> {
    let shown = path.display();
    let bytes = input::bytes(path)?;
    let columns = read_columns(&bytes).map_err(|error| Failure::Input(format!("{shown}: {error}")))?;
    match columns.first() {
        Some(column) if column.len() == rows => Ok(columns),
        found => {
            let found = found.map_or(0, Vec::len);
            Err(Failure::Input(format!("{shown} has {found} rows; the cloud has {rows}")))
        }
    }
}

/// A cloud or parameter that the analysis refuses is the caller's; a numerical failure is ours.
fn of_analysis(error: &AnalysisError) -> Failure {
    match error {
        AnalysisError::Parameter { .. } | AnalysisError::Cloud(_) | AnalysisError::Unsupported(_) => {
            Failure::input(error)
        }
        AnalysisError::Numerical(_) | AnalysisError::Canceled(_) => Failure::other(error),
    }
}
