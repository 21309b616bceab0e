//! `chladni similarity` and `chladni invariants`: what spectra say of whole shapes.

use std::path::{Path, PathBuf};

use chladni::analysis::Report;
use chladni::harmonics::{
    Modes,
    invariants::measure,
    shape_dna::{self, Comparison},
};

use super::{Failure, results, write_json};
use crate::cli::flags::Flags;

/// Compare two shapes by their spectra (ShapeDNA).
#[derive(Debug, clap::Args)]
pub(crate) struct SimilarityArgs {
    /// Directory that `chladni analyze` filled
    first: PathBuf,

    /// Another one
    second: PathBuf,

    #[command(flatten)]
    comparison: Flags<Comparison>,
}

/// Read area, boundary length and Euler characteristic off a spectrum.
#[derive(Debug, clap::Args)]
pub(crate) struct InvariantsArgs {
    /// Directory that `chladni analyze` filled
    results: PathBuf,
}

/// Compares and prints JSON.
pub(crate) fn similarity(args: &SimilarityArgs) -> Result<(), Failure> {
    let (first, first_modes) = shape(&args.first)?;
    let (second, second_modes) = shape(&args.second)?;
    let areas = [first.sampling.area, second.sampling.area];
    let found = shape_dna::compare(
        [&first_modes, &second_modes],
        areas,
        args.comparison.0.sized,
        args.comparison.0.modes,
    );
    let found =
        found.ok_or_else(|| Failure::Input("one of the spectra has no eigenvalue above 0".to_owned()))?;
    write_json(&found, Path::new("-"))
}

/// Computes and prints JSON.
pub(crate) fn invariants(args: &InvariantsArgs) -> Result<(), Failure> {
    let (report, modes) = shape(&args.results)?;
    if !report.is_of_surface() {
        let shown = args.results.display();
        return Err(Failure::Input(format!(
            "{shown} holds no spectrum of a surface; graphs, curves and volumes have other heat traces"
        )));
    }
    write_json(&measure(&modes, &report.sampling), Path::new("-"))
}

fn shape(directory: &Path) -> Result<(Report, Modes), Failure> {
    let report = results::report(directory)?;
    let modes = report.spectrum.as_ref().map(Modes::of).ok_or_else(|| {
        Failure::Input(format!("{} holds an operator without a spectrum", directory.display()))
    })?;
    Ok((report, modes))
}
