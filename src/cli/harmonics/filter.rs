//! `chladni filter`: the cloud with its coordinates, or some of its fields, filtered.

use std::io::Write;
use std::path::PathBuf;

use chladni::arguments::Arguments;
use chladni::cloud::reader::Format;
use chladni::cloud::writer::{PlyEncoding, write, write_annotated_ply};
use chladni::harmonics::collapse::collapse;
use chladni::harmonics::filtered::{self, Named, Target};
use chladni::harmonics::functions::rows_without_result;
use chladni::harmonics::{Filter, Transfer, transform};
use serde_json::json;

use super::{Failure, Output, Results, Writing, output, write_json, write_npy};
use crate::cli::flags::Flags;

/// Filter the coordinates of an analyzed cloud, or some of its fields.
#[derive(Debug, clap::Args)]
pub(crate) struct FilterArgs {
    /// Directory that `chladni analyze` filled
    results: PathBuf,

    /// File to write; its extension chooses the format: ply, npy, json, or one of obj, off, stl, xyz, csv, pcd, las, laz;
    /// `-` is standard output
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    #[command(flatten)]
    writing: Writing,

    #[command(flatten)]
    filter: Flags<Filter>,

    /// Gains of the modes in place of a filter: a list such as 1,1,0.5
    #[arg(long, value_delimiter = ',', conflicts_with_all = shaping())]
    gains: Vec<f64>,

    #[command(flatten)]
    named: Flags<Named>,

    /// Write PLY as text
    #[arg(long)]
    ascii: bool,
}

/// The arguments that gains take the place of: all but what becomes of the rest.
fn shaping() -> impl Iterator<Item = &'static str> {
    Filter::table().into_iter().map(|argument| argument.name).filter(|name| *name != "outside")
}

/// What a filtered cloud is written as.
#[derive(Debug, Clone, Copy)]
enum Form {
    /// As other results are.
    Result(Output),
    /// As another file of points.
    Cloud(Format),
}

/// PLY first; then arrays and numbers; then what else clouds are written as.
fn offered() -> Vec<(&'static str, Form)> {
    let others = Format::WRITTEN.into_iter().filter(|format| !matches!(format, Format::Ply | Format::Npy));
    let results =
        [Output::Ply, Output::Npy, Output::Json].map(|output| (output.name(), Form::Result(output)));
    results.into_iter().chain(others.map(|format| (format.name(), Form::Cloud(format)))).collect()
}

/// Reads, filters, writes.
pub(crate) fn filter(args: &FilterArgs) -> Result<(), Failure> {
    let format = args.writing.choice(&args.output, &offered())?;
    let results = Results::read(&args.results)?;
    let (transfer, description) = if args.gains.is_empty() {
        let filter = &args.filter.0;
        (filter.transfer(&results.modes).map_err(Failure::input)?, filter.describe())
    } else {
        let outside = args.filter.0.outside.unwrap_or(0.0);
        let transfer = Transfer::from_gains(args.gains.clone(), outside, &results.modes);
        (transfer.map_err(Failure::input)?, "gains as given".to_owned())
    };
    let cloud = results.cloud()?;
    let target = Target::named(&cloud, &args.named.0.field).map_err(Failure::input)?;
    let functions = target.functions(&cloud, &results.mass).map_err(Failure::input)?;
    let values: Vec<&[f64]> = functions.iter().map(|function| function.values.as_slice()).collect();
    let found = transform::total(&results.map(|block| transform::partial(block, &results.mass, &values)));
    let columns = results.columns(|block| filtered::rows(block, &functions, &found, &transfer));
    let lost = rows_without_result(&results.mass);
    let warning = if target == Target::Coordinates { collapse(&values, &columns) } else { None };
    match format {
        Form::Result(Output::Npy) => write_npy(&columns, false, &args.output)?,
        Form::Result(Output::Json) => {
            let fields: serde_json::Map<String, serde_json::Value> =
                functions.iter().zip(columns).map(|(f, column)| (f.name.clone(), column.into())).collect();
            let answer = json!({
                "points": cloud.len(),
                "rows_without_result": lost,
                "gains": transfer.gains,
                "outside": transfer.outside,
                "fields": fields,
            });
            write_json(&answer, &args.output)?;
        }
        Form::Cloud(format) => {
            let filtered = target.replaced(&cloud, &columns).map_err(Failure::other)?;
            let mut bytes = Vec::new();
            write(&filtered, format, &mut bytes).map_err(Failure::input)?;
            output::write_file(&args.output, |out| out.write_all(&bytes))?;
        }
        Form::Result(Output::Ply) => {
            let encoding = if args.ascii { PlyEncoding::Ascii } else { PlyEncoding::Binary };
            let filtered = target.replaced(&cloud, &columns).map_err(Failure::other)?;
            let comment = format!("chladni: {description}; outside of the bases x {}", transfer.outside);
            output::write_file(&args.output, |out| {
                write_annotated_ply(&filtered, encoding, &[comment], out)
            })?;
        }
    }
    let points = cloud.len();
    let what =
        format!("{description}, {points} points, {lost} of them unchanged because they have no result");
    let warnings: Vec<String> = warning.into_iter().collect();
    args.writing.reporting.warn(&warnings);
    let facts =
        json!({ "filter": description, "points": points, "rows_without_result": lost, "warnings": warnings });
    args.writing.reporting.wrote(&args.output, &what, facts);
    Ok(())
}
