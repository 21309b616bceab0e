//! `chladni features`: salient feature points.

use std::path::PathBuf;

use chladni::harmonics::Neighborhoods;
use chladni::harmonics::features::{self as salient, Feature, FeatureRequest};
use rayon::prelude::*;
use serde_json::json;

use super::{Failure, Output, Results, Writing, output, write_json};
use crate::cli::flags::Flags;

/// Find salient feature points: extrema that consecutive bases share.
#[derive(Debug, clap::Args)]
pub(crate) struct FeaturesArgs {
    /// Directory that `chladni analyze` filled
    results: PathBuf,

    #[command(flatten)]
    wanted: Flags<FeatureRequest>,

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
    let wanted = &args.wanted.0;
    let radius = wanted.radius(results.report.sampling.epsilon);
    let neighborhoods = Neighborhoods::find(&cloud, &results.mass, radius).map_err(Failure::input)?;
    let area: f64 = results.mass.iter().filter(|mass| !mass.is_nan()).sum();
    let count = wanted.modes(results.modes.len());
    let first = results.modes.zero_modes().min(count);
    let bases = &results.bases()[first..count];
    let extrema: Vec<_> =
        bases.par_iter().map(|basis| salient::extrema(basis, &neighborhoods, area)).collect();
    let mut places = salient::features(&extrema, first, &neighborhoods, wanted.persistence);
    places.truncate(wanted.limit.unwrap_or(usize::MAX));
    let found: Vec<Feature> = places.iter().map(|place| place.in_cloud(&neighborhoods, &cloud)).collect();
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
