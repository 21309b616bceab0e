//! `chladni signatures` and `chladni distances`: numbers for every point.

use std::path::{Path, PathBuf};

use chladni::harmonics::{Distance, DistanceKind, Signature, SignatureKind};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde_json::json;

use super::{Failure, Output, Results, Writing, write_json, write_npy};

/// Compute heat or wave kernel signatures of every point.
#[derive(Debug, clap::Args)]
pub(crate) struct SignaturesArgs {
    /// Directory that `chladni analyze` filled
    results: PathBuf,

    /// File to write; its extension chooses the format: npy, ply or json; `-` is standard output
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    #[command(flatten)]
    writing: Writing,

    /// Heat or wave kernel signature
    #[arg(long, default_value = "hks", value_parser = signature_kinds())]
    kind: SignatureKind,

    /// Number of scales
    #[arg(long, default_value_t = 16)]
    count: usize,

    /// Divide every scale of the heat kernel signature by its integral over the surface
    #[arg(long)]
    scaled: bool,
}

/// Compute distances from one point to all others.
#[derive(Debug, clap::Args)]
pub(crate) struct DistancesArgs {
    /// Directory that `chladni analyze` filled
    results: PathBuf,

    /// File to write; its extension chooses the format: npy, ply or json; `-` is standard output
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    #[command(flatten)]
    writing: Writing,

    /// Row of the cloud to measure from, counting from 0
    #[arg(long, default_value_t = 0)]
    from: usize,

    /// Which distance
    #[arg(long, default_value = "biharmonic", value_parser = distance_kinds())]
    kind: DistanceKind,

    /// Time of the diffusion, in squared units of the cloud
    #[arg(long)]
    time: Option<f64>,
}

fn signature_kinds() -> impl TypedValueParser<Value = SignatureKind> {
    PossibleValuesParser::new(["hks", "wks"])
        .map(|name| if name == "wks" { SignatureKind::Wks } else { SignatureKind::Hks })
}

fn distance_kinds() -> impl TypedValueParser<Value = DistanceKind> {
    PossibleValuesParser::new(["biharmonic", "diffusion"])
        .map(|name| if name == "diffusion" { DistanceKind::Diffusion } else { DistanceKind::Biharmonic })
}

const FORMATS: [Output; 3] = [Output::Npy, Output::Ply, Output::Json];

/// Reads, computes, writes.
pub(crate) fn signatures(args: &SignaturesArgs) -> Result<(), Failure> {
    let format = Output::of(&args.output, &args.writing, &FORMATS)?;
    let results = Results::read(&args.results)?;
    let signature =
        Signature::new(args.kind, args.count, &results.modes).ok_or_else(|| no_scale(&args.results))?;
    let signature = if args.scaled { signature.scaled() } else { signature };
    let columns = results.columns(|block| signature.values(block));
    match format {
        Output::Npy => write_npy(&columns, false, &args.output)?,
        Output::Json => {
            let answer = json!({ "kind": args.kind, "scales": signature.scales, "values": columns });
            write_json(&answer, &args.output)?;
        }
        Output::Ply => {
            let names: Vec<String> =
                (0..args.count).map(|scale| format!("{}_{scale}", args.kind.name())).collect();
            results.write_ply(&names, &columns, &args.output)?;
        }
    }
    let what = format!("{} at {} scales", args.kind.name(), args.count);
    let facts = json!({ "kind": args.kind, "scales": args.count, "points": results.mass.len() });
    args.writing.reporting.wrote(&args.output, &what, facts);
    Ok(())
}

/// Reads, computes, writes.
pub(crate) fn distances(args: &DistancesArgs) -> Result<(), Failure> {
    let format = Output::of(&args.output, &args.writing, &FORMATS)?;
    if args.time.is_some_and(|time| !(time.is_finite() && time > 0.0)) {
        return Err(Failure::Input("--time: a number above 0 is expected".to_owned()));
    }
    let results = Results::read(&args.results)?;
    let rows = results.mass.len();
    if args.from >= rows || results.mass[args.from].is_nan() {
        return Err(Failure::Input(format!(
            "--from {}: a row with a result is expected, of those from 0 to {}",
            args.from,
            rows - 1
        )));
    }
    let origin = results.bases().iter().map(|basis| basis[args.from]).collect();
    let distance = Distance::from(args.kind, origin, args.time, &results.modes)
        .ok_or_else(|| no_scale(&args.results))?;
    let columns = results.columns(|block| vec![distance.values(block)]);
    match format {
        Output::Npy => write_npy(&columns, true, &args.output)?,
        Output::Ply => results.write_ply(&["distance".to_owned()], &columns, &args.output)?,
        Output::Json => {
            let answer = json!({
                "from": args.from,
                "kind": args.kind,
                "time": distance.time,
                "values": columns[0],
            });
            write_json(&answer, &args.output)?;
        }
    }
    let what = format!("{} distances from row {}", args.kind.name(), args.from);
    let facts = json!({ "kind": args.kind, "from": args.from, "points": rows });
    args.writing.reporting.wrote(&args.output, &what, facts);
    Ok(())
}

fn no_scale(results: &Path) -> Failure {
    let shown = results.display();
    Failure::Input(format!("{shown} has no mode with an eigenvalue above 0; analyze with more bases"))
}
