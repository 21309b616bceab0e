//! `chladni analyze`: a file in, a directory of results out.

mod results;
mod run;
mod summary;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use chladni::analysis::{self, AnalysisError, JobKind, Parameters};
use chladni::cloud::reader::read_columns;
use chladni::operator::{Distance, OperatorKind, Parameterization};
use clap::builder::{PossibleValuesParser, TypedValueParser};

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
    #[arg(long, value_parser = kinds())]
    kind: Option<JobKind>,

    /// Apply the operator to functions, an npy file of n or n × m numbers, and write laplacian.npy
    #[arg(long, value_name = "FILE")]
    apply: Option<PathBuf>,

    #[command(flatten)]
    reading: CloudArgs,

    /// Threads that compute, 0 for one per processor
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,

    #[command(flatten)]
    reporting: Reporting,

    #[command(flatten)]
    parameters: ParameterArgs,
}

/// The analysis's parameters; what is not given is derived from the cloud.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Parameters of the analysis")]
struct ParameterArgs {
    /// Discrete Laplace-Beltrami operator
    #[arg(long, default_value = OperatorKind::default().name(), value_parser = operators())]
    operator: OperatorKind,

    /// Intrinsic dimension: 1 for curves, 2 for surfaces, 3 for volumes
    #[arg(long, value_name = "K", default_value_t = Parameters::default().dimension)]
    dimension: usize,

    /// Number of eigenpairs, the zero modes included [default: 100, or what a small cloud allows]
    #[arg(long, short = 'k', value_name = "K")]
    bases: Option<usize>,

    /// Largest relative residual of an eigenpair
    #[arg(long = "tol", alias = "tolerance", value_name = "RESIDUAL", default_value_t = Parameters::default().tolerance)]
    tolerance: f64,

    /// Time of the heat kernel, in squared units of the cloud
    #[arg(long)]
    t: Option<f64>,

    /// The same as a multiple of the squared covering radius
    #[arg(long, value_name = "FACTOR")]
    t_factor: Option<f64>,

    /// Cut-off radius of the heat kernel, or length of a graph's edges, in units of the cloud
    #[arg(long)]
    delta: Option<f64>,

    /// The same as a multiple of √(2t); of the covering radius for graph operators
    #[arg(long, value_name = "FACTOR")]
    delta_factor: Option<f64>,

    /// Covering radius, in units of the cloud, instead of the estimate
    #[arg(long)]
    epsilon: Option<f64>,

    /// Distance in the Gaussian of pcd
    #[arg(long, value_parser = distances())]
    distance: Option<Distance>,

    /// How pcd chooses t, delta and its simplices
    #[arg(long, value_parser = parameterizations())]
    parameterization: Option<Parameterization>,

    /// Exactly the paper's operator: all additions below are off unless they are set
    #[arg(long)]
    paper: bool,

    /// Measure cells by true distances; on surfaces in the triangles around every point
    #[arg(long, value_name = "BOOL")]
    isometric_cells: Option<bool>,

    /// Make up for the Gaussian's share beyond the cut-off
    #[arg(long, value_name = "BOOL")]
    truncation_compensation: Option<bool>,

    /// Couple only neighbors on the same sheet of the surface
    #[arg(long, value_name = "BOOL")]
    sheet_aware: Option<bool>,

    /// Measure distances in the kernel along the surface
    #[arg(long, value_name = "BOOL")]
    surface_distances: Option<bool>,

    /// Scale the kernel so that its second moment is right around every point
    #[arg(long, value_name = "BOOL")]
    moment_calibration: Option<bool>,

    /// Report λ = −ln(1−tμ)/t beside the raw μ
    #[arg(long, value_name = "BOOL")]
    heat_correction: Option<bool>,
}

impl ParameterArgs {
    fn parameters(&self) -> Parameters {
        Parameters {
            operator: self.operator,
            dimension: self.dimension,
            bases: self.bases.unwrap_or(Parameters::default().bases),
            tolerance: self.tolerance,
            t: self.t,
            t_factor: self.t_factor,
            delta: self.delta,
            delta_factor: self.delta_factor,
            epsilon: self.epsilon,
            distance: self.distance,
            parameterization: self.parameterization,
            paper: self.paper,
            isometric_cells: self.isometric_cells,
            truncation_compensation: self.truncation_compensation,
            sheet_aware: self.sheet_aware,
            surface_distances: self.surface_distances,
            moment_calibration: self.moment_calibration,
            heat_correction: self.heat_correction,
        }
    }
}

fn distances() -> impl TypedValueParser<Value = Distance> {
    PossibleValuesParser::new(["ambient", "projected"]).map(|name| match name.as_str() {
        "ambient" => Distance::Ambient,
        _ => Distance::Projected,
    })
}

fn parameterizations() -> impl TypedValueParser<Value = Parameterization> {
    PossibleValuesParser::new(["covering-radius", "nearest-ten"]).map(|name| match name.as_str() {
        "covering-radius" => Parameterization::CoveringRadius,
        _ => Parameterization::NearestTen,
    })
}

fn operators() -> impl TypedValueParser<Value = OperatorKind> {
    let find = |name: String| OperatorKind::ALL.into_iter().find(|kind| kind.name() == name);
    PossibleValuesParser::new(OperatorKind::ALL.map(OperatorKind::name))
        .try_map(move |name| find(name).ok_or("unknown"))
}

fn kinds() -> impl TypedValueParser<Value = JobKind> {
    PossibleValuesParser::new(["eigen", "operator"])
        .map(|name| if name == "operator" { JobKind::Operator } else { JobKind::Eigen })
}

/// Reads, analyses, writes, and prints a summary.
pub(crate) fn run(args: &AnalyzeArgs) -> Result<(), Failure> {
    let parameters = args.parameters.parameters();
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
    let admitted = match args.parameters.bases {
        None => analysis::admit_lowered(&cloud, &mut parameters),
        Some(_) => analysis::admit(&cloud, &parameters),
    };
    admitted.map_err(|error| of_analysis(&error))?;
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
