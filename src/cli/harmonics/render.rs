//! `chladni render`: pictures of clouds and bases, plots of spectra.

use std::io::Write as _;
use std::path::PathBuf;

use chladni::cloud::PointCloud;
use chladni::harmonics::Neighborhoods;
use chladni::harmonics::features::{self as salient, PERSISTENCE_MIN, RADIUS_IN_EPSILON};
use chladni::picture::{Legend, Paint, Picture, Spectrum, View, legend_of_basis, plot_spectrum};
use rayon::prelude::*;
use serde_json::json;

use super::{Failure, Results, Writing, output, results};
use crate::cli::flags::Flags;
use crate::cli::input::CloudArgs;

/// Draw a cloud, a basis, or feature points; plot a spectrum.
#[derive(Debug, clap::Args)]
pub(crate) struct RenderArgs {
    /// Directory that `chladni analyze` filled, or a point cloud
    input: PathBuf,

    /// Color by this basis of the directory, counting from 0
    #[arg(long, value_name = "INDEX", conflicts_with = "field")]
    basis: Option<usize>,

    /// Color by this field of the cloud
    #[arg(long, value_name = "NAME")]
    field: Option<String>,

    /// Mark this number of the most persistent feature points of the directory
    #[arg(long, value_name = "COUNT")]
    features: Option<usize>,

    #[command(flatten)]
    view: Flags<View>,

    #[command(flatten)]
    cloud: CloudArgs,

    /// File to write: png for a picture, svg for a plot of the directory's spectrum; `-` is standard output
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    #[command(flatten)]
    writing: Writing,
}

/// Reads, draws, writes.
pub(crate) fn render(args: &RenderArgs) -> Result<(), Failure> {
    let draw: fn(&RenderArgs) -> Result<(), Failure> =
        args.writing.choice(&args.output, &[("png", picture as _), ("svg", plot as _)])?;
    draw(args)
}

fn picture(args: &RenderArgs) -> Result<(), Failure> {
    let results = if args.input.is_dir() { Some(Results::read(&args.input)?) } else { None };
    let cloud = match &results {
        Some(results) => results.cloud()?,
        None => args.cloud.read(&args.input)?,
    };
    let of_results = |option: &str| {
        results.as_ref().ok_or_else(|| {
            let shown = args.input.display();
            Failure::Input(format!(
                "--{option} needs a directory that `chladni analyze` filled; {shown} is a file"
            ))
        })
    };
    let paint = match (args.basis, &args.field) {
        (Some(index), _) => Paint::Diverging(basis(of_results("basis")?, index)?),
        (None, Some(name)) => Paint::Sequential(field(&cloud, name)?),
        (None, None) => Paint::Plain,
    };
    let marks = match args.features {
        Some(count) => marks(of_results("features")?, &cloud, count)?,
        None => Vec::new(),
    };
    let view = args.view.0;
    let mut picture = Picture::draw(&cloud, &paint, &marks, &view);
    if view.legend {
        let (title, unit) = legend(args, results.as_ref());
        picture.add_legend(&Legend { title: &title, unit }, &paint, view.background);
    }
    let title = args.input.display().to_string();
    let bytes = picture.to_png(&title).map_err(Failure::other)?;
    output::write_file(&args.output, |out| out.write_all(&bytes))?;
    let (width, height, points) = (picture.width, picture.height, cloud.len());
    let what = format!("{width} × {height} pixels, {points} points");
    let facts = json!({ "width": width, "height": height, "points": points });
    args.writing.reporting.wrote(&args.output, &what, facts);
    Ok(())
}

/// What the colors stand for, and its unit.
fn legend(args: &RenderArgs, results: Option<&Results>) -> (String, &'static str) {
    let Some(index) = args.basis else { return (args.field.clone().unwrap_or_default(), "") };
    let spectrum = results.and_then(|results| results.report.spectrum.as_ref());
    let eigenvalue = spectrum.and_then(|spectrum| spectrum.eigenvalues.get(index).copied().flatten());
    (legend_of_basis(index, eigenvalue), "1/length")
}

fn basis(results: &Results, index: usize) -> Result<&[f64], Failure> {
    let bases = results.bases();
    bases.get(index).map(Vec::as_slice).ok_or_else(|| {
        Failure::Input(format!("--basis {index}: the directory has bases 0 to {}", bases.len() - 1))
    })
}

fn field<'a>(cloud: &'a PointCloud, name: &str) -> Result<&'a [f64], Failure> {
    let found = cloud.fields().iter().find(|field| field.name == name);
    found.map(|field| &*field.values).ok_or_else(|| {
        let names: Vec<_> = cloud.fields().iter().map(|field| field.name.as_str()).collect();
        Failure::Input(format!("--field {name}: the cloud has the fields {}", names.join(", ")))
    })
}

/// The rows of the most persistent feature points.
fn marks(results: &Results, cloud: &PointCloud, count: usize) -> Result<Vec<usize>, Failure> {
    let radius = RADIUS_IN_EPSILON * results.report.sampling.epsilon;
    let neighborhoods = Neighborhoods::find(cloud, &results.mass, radius).map_err(Failure::input)?;
    let area: f64 = results.mass.iter().filter(|mass| !mass.is_nan()).sum();
    let first = results.modes.zero_modes().min(results.modes.len());
    let bases = &results.bases()[first..];
    let extrema: Vec<_> =
        bases.par_iter().map(|basis| salient::extrema(basis, &neighborhoods, area)).collect();
    let places = salient::features(&extrema, first, &neighborhoods, PERSISTENCE_MIN);
    Ok(places.iter().take(count).map(|place| place.in_cloud(&neighborhoods, cloud).index).collect())
}

fn plot(args: &RenderArgs) -> Result<(), Failure> {
    let directory = &args.input;
    let report = results::report(directory)?;
    let Some(spectrum) = &report.spectrum else {
        let shown = directory.display();
        return Err(Failure::Input(format!("{shown} holds an operator without a spectrum")));
    };
    let title = format!("{} eigenvalues, operator {}", spectrum.eigenvalues.len(), report.operator.name());
    let svg = plot_spectrum(&Spectrum {
        eigenvalues: &spectrum.eigenvalues,
        clusters: &spectrum.clusters,
        area: report.is_of_surface().then_some(report.sampling.area),
        title: &title,
    });
    output::write_file(&args.output, |out| out.write_all(svg.as_bytes()))?;
    let facts = json!({ "eigenvalues": spectrum.eigenvalues.len(), "operator": report.operator.name() });
    args.writing.reporting.wrote(&args.output, &title, facts);
    Ok(())
}
