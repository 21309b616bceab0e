//! `chladni signatures` and `chladni distances`: numbers for every point.

use std::path::{Path, PathBuf};

use chladni::arguments::Arguments;
use chladni::harmonics::{Distance, DistanceRequest, Signature, SignatureRequest};
use serde_json::json;

use super::{Failure, Output, Results, Writing, write_json, write_npy};
use crate::cli::flags::Flags;

/// Results, and what is computed of every row by an argument struct of the library.
#[derive(Debug, clap::Args)]
pub(crate) struct PerRowArgs<R: Arguments + Send + Sync + Clone + 'static> {
    /// Directory that `chladni analyze` filled
    results: PathBuf,

    /// File to write; its extension chooses the format: npy, ply or json; `-` is standard output
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    #[command(flatten)]
    writing: Writing,

    #[command(flatten)]
    request: Flags<R>,
}

pub(crate) type SignaturesArgs = PerRowArgs<SignatureRequest>;
pub(crate) type DistancesArgs = PerRowArgs<DistanceRequest>;

const FORMATS: [Output; 3] = [Output::Npy, Output::Ply, Output::Json];

/// Reads, computes, writes.
pub(crate) fn signatures(args: &SignaturesArgs) -> Result<(), Failure> {
    let format = Output::of(&args.output, &args.writing, &FORMATS)?;
    let results = Results::read(&args.results)?;
    let SignatureRequest { kind, count, .. } = args.request.0;
    let signature = Signature::of(args.request.0, &results.modes).ok_or_else(|| no_scale(&args.results))?;
    let columns = results.columns(|block| signature.values(block));
    match format {
        Output::Npy => write_npy(&columns, false, &args.output)?,
        Output::Json => {
            let answer = json!({ "kind": kind, "scales": signature.scales, "values": columns });
            write_json(&answer, &args.output)?;
        }
        Output::Ply => {
            let names: Vec<String> = (0..count).map(|scale| format!("{}_{scale}", kind.name())).collect();
            results.write_ply(&names, &columns, &args.output)?;
        }
    }
    let what = format!("{} at {count} scales", kind.name());
    let facts = json!({ "kind": kind, "scales": count, "points": results.mass.len() });
    args.writing.reporting.wrote(&args.output, &what, facts);
    Ok(())
}

/// Reads, computes, writes.
pub(crate) fn distances(args: &DistancesArgs) -> Result<(), Failure> {
    let format = Output::of(&args.output, &args.writing, &FORMATS)?;
    let DistanceRequest { from, kind, time } = args.request.0;
    args.request.0.check().map_err(|error| Failure::Input(error.to_string()))?;
    let results = Results::read(&args.results)?;
    let rows = results.mass.len();
    if from >= rows || results.mass[from].is_nan() {
        return Err(Failure::Input(format!(
            "--from {}: expected a row with a result, from 0 to {}",
            from,
            rows - 1
        )));
    }
    let origin = results.bases().iter().map(|basis| basis[from]).collect();
    let distance =
        Distance::from(kind, origin, time, &results.modes).ok_or_else(|| no_scale(&args.results))?;
    let columns = results.columns(|block| vec![distance.values(block)]);
    match format {
        Output::Npy => write_npy(&columns, true, &args.output)?,
        Output::Ply => results.write_ply(&["distance".to_owned()], &columns, &args.output)?,
        Output::Json => {
            let answer = json!({
                "from": from,
                "kind": kind,
                "time": distance.time,
                "values": columns[0],
            });
            write_json(&answer, &args.output)?;
        }
    }
    let what = format!("{} distances from row {from}", kind.name());
    let facts = json!({ "kind": kind, "from": from, "points": rows });
    args.writing.reporting.wrote(&args.output, &what, facts);
    Ok(())
}

fn no_scale(results: &Path) -> Failure {
    let shown = results.display();
    Failure::Input(format!("{shown} has no mode with an eigenvalue above 0; analyze with more bases"))
}
