//! `chladni features`: salient feature points.

use std::path::PathBuf;

use chladni::harmonics::Surroundings;
use chladni::harmonics::features::{self as salient, Feature, PERSISTENCE_MIN, RADIUS_IN_EPSILON};
use rayon::prelude::*;
use serde_json::json;

use super::{Failure, Output, Results, Writing, output, write_json};

/// Find salient feature points: extrema that consecutive bases share.
#[derive(Debug, clap::Args)]
pub(crate) struct FeaturesArgs {
    /// Directory that `chladni analyze` filled
    results: PathBuf,

    /// Look at the first so many modes only
    #[arg(long)]
    modes: Option<usize>,

    /// Least persistence of an extremum, as a multiple of a basis' root mean square
    #[arg(long, default_value_t = PERSISTENCE_MIN)]
    persistence: f64,

    /// Radius of the neighborhoods, in units of the cloud; twice the covering radius when absent
    #[arg(long)]
    radius: Option<f64>,

    /// Only the so many most persistent ones
    #[arg(long)]
    limit: Option<usize>,

    /// File to write, json or ply; standard output (`-`) when absent
    #[arg(long, short, value_name = "FILE", default_value = "-")]
    output: PathBuf,

    #[command(flatten)]
    writing: Writing,
}

/// Reads, looks, writes.
pub(crate) fn features(args: &FeaturesArgs) -> Result<(), Failure> {
    let format = Output::of(&args.output, &args.writing, &[Output::Json, Output::Ply])?;
    let results = Results::read(&args.results)?;
    let cloud = results.cloud()?;
    let radius = args.radius.unwrap_or(RADIUS_IN_EPSILON * results.report.sampling.epsilon);
    if !(radius.is_finite() && radius > 0.0) {
        return Err(Failure::Input(format!("--radius {radius}: a number above 0 is expected")));
    }
    let surroundings = Surroundings::find(&cloud, &results.mass, radius).map_err(Failure::input)?;
    let area: f64 = results.mass.iter().filter(|mass| !mass.is_nan()).sum();
    let count = args.modes.unwrap_or(usize::MAX).min(results.modes.len());
    let first = results.modes.zero_modes().min(count);
    let bases = &results.bases()[first..count];
    let extrema: Vec<_> =
        bases.par_iter().map(|basis| salient::extrema(basis, &surroundings, area)).collect();
    let mut places = salient::features(&extrema, first, &surroundings, args.persistence);
    places.truncate(args.limit.unwrap_or(usize::MAX));
    let found: Vec<Feature> = places.iter().map(|place| place.in_cloud(&surroundings, &cloud)).collect();
    if format == Output::Ply {
        let ply = salient::as_ply(&found, &cloud);
        output::write_file(&args.output, |out| std::io::Write::write_all(out, &ply))?;
    } else {
        let answer = json!({
            "points": cloud.len(),
            "modes": count,
            "radius": radius,
            "clusters": results.modes.clusters(),
            "features": found,
        });
        write_json(&answer, &args.output)?;
    }
    if !output::is_standard(&args.output) {
        let what = format!("{} feature points", found.len());
        args.writing.reporting.wrote(&args.output, &what, json!({ "features": found.len() }));
    }
    Ok(())
}
