//! `chladni analyze`: a file in, a directory of results out.

mod results;
mod run;
mod summary;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use chladni::analysis::{AnalysisError, Examined, JobKind, Parameters, Task};
use chladni::app::{Settings, bytes, threads};
use chladni::cloud::reader::{Format, read_columns};

use super::flags::Flags;
use super::input::{self, CloudArgs};
use super::interrupt::Interrupt;
use super::reporting::Reporting;
use super::{Failure, output};

/// Analyze a point cloud and write the results into a directory.
#[derive(Debug, clap::Args)]
pub(crate) struct AnalyzeArgs {
    #[arg(help = help_of_cloud())]
    cloud: PathBuf,

    /// Directory for the results
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,

    /// Write into a directory that is not empty
    #[arg(long)]
    force: bool,

    #[command(flatten)]
    task: Flags<Task>,

    /// Apply the operator to functions, an npy file of n or n × m numbers, and write laplacian.npy; implies `--kind operator`
    #[arg(long, value_name = "FILE")]
    apply: Option<PathBuf>,

    #[command(flatten)]
    reading: CloudArgs,

    /// Threads that compute, 0 for one per processor
    #[arg(long, value_name = "N", value_parser = threads, default_value_t = 0)]
    threads: usize,

    /// Bytes of memory that the analysis may be estimated to take, 0 for half of what there is; larger clouds are
    /// solved on a sample and extended to all points, in a temporary file if need be
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value_t = 0)]
    memory: u64,

    #[command(flatten)]
    reporting: Reporting,

    #[command(flatten, next_help_heading = "Parameters of the analysis")]
    parameters: Flags<Parameters>,
}

fn help_of_cloud() -> String {
    let extensions: Vec<_> = Format::extensions().collect();
    format!("Point cloud ({}); `-` reads standard input", extensions.join(", "))
}

/// Reads, analyzes, writes, and prints a summary.
pub(crate) fn run(args: &AnalyzeArgs) -> Result<(), Failure> {
    let parameters = args.parameters.0.clone();
    parameters.check().map_err(Failure::input)?;
    let kind = kind(args)?;
    let directory = output::Directory::prepare(&args.output, args.force)?;
    let budget = Settings { memory_budget: args.memory, ..Settings::default() }.memory_budget();
    let watch = run::Watch::new(args.reporting.quiet, budget, directory.path());
    let interrupt = Interrupt::cancels(Arc::clone(&watch.progress))?;
    interrupt.outcome(analyze_into(directory, args, kind, &parameters, budget, &watch))
}

/// The directory is gone when this ends early.
fn analyze_into(
    directory: output::Directory,
    args: &AnalyzeArgs,
    kind: JobKind,
    parameters: &Parameters,
    budget: u64,
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
    let (points, faces) = (cloud.len() as u64, cloud.faces().len() as u64);
    let parameters = parameters.fitted(points, cloud.dimension(), faces, kind, budget);
    let ran = run::with_progress(&cloud, kind, &parameters, args.threads, watch)?;
    let files = results::write(directory, &cloud, kind, functions.as_deref(), &ran)?;
    summary::print(&ran, &files, args.reporting);
    Ok(())
}

/// What is computed: bases and the operator do not come together, because the operator is used up by its bases.
fn kind(args: &AnalyzeArgs) -> Result<JobKind, Failure> {
    let kind = args.task.0.kind;
    match &args.apply {
        None => Ok(kind),
        Some(_) if args.task.is_given("kind") && kind == JobKind::Eigen => Err(Failure::Input(
            "--apply needs the operator itself: leave --kind out or say --kind operator".into(),
        )),
        Some(_) => Ok(JobKind::Operator),
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
        AnalysisError::Numerical(_) | AnalysisError::Scratch(_) | AnalysisError::Canceled(_) => {
            Failure::other(error)
        }
    }
}
