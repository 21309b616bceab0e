//! `chladni filter`: the cloud with its coordinates, or some of its fields, filtered.

use std::io::Write;
use std::path::PathBuf;

use chladni::cloud::reader::Format;
use chladni::cloud::writer::{PlyEncoding, write, write_annotated_ply};
use chladni::harmonics::collapse::collapse;
use chladni::harmonics::filtered::{self, Target};
use chladni::harmonics::functions::rows_without_result;
use chladni::harmonics::{Filter, FilterKind, Scale, Transfer, transform};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde_json::json;

use super::{Failure, Output, Results, Writing, output, write_json, write_npy};

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

    /// What the filter does
    #[arg(long, default_value = FilterKind::default().name(), value_parser = kinds())]
    filter: FilterKind,

    /// In what edges are given: number of a mode, √λ, or 2π/√λ in units of the cloud
    #[arg(long, default_value = Scale::default().name(), value_parser = scales())]
    by: Scale,

    /// The edge of low-pass and high-pass; for heat, where the gain has fallen to 1/e
    #[arg(long)]
    cutoff: Option<f64>,

    /// Lower edge of a band, itself inside
    #[arg(long)]
    from: Option<f64>,

    /// Upper edge of a band, itself outside
    #[arg(long)]
    to: Option<f64>,

    /// Factor on the band of enhance
    #[arg(long)]
    gain: Option<f64>,

    /// Time of heat, in squared units of the cloud
    #[arg(long)]
    time: Option<f64>,

    /// Width of the transition around every edge, as a share of its frequency
    #[arg(long, default_value_t = 0.0)]
    taper: f64,

    /// Factor on what lies outside of the span of the bases
    #[arg(long)]
    outside: Option<f64>,

    /// Gains of the modes in place of a filter: a list such as 1,1,0.5
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["filter", "by", "cutoff", "from", "to", "gain", "time", "taper"])]
    gains: Vec<f64>,

    /// Filter these fields in place of the coordinates
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    field: Vec<String>,

    /// Write PLY as text
    #[arg(long)]
    ascii: bool,
}

fn kinds() -> impl TypedValueParser<Value = FilterKind> {
    PossibleValuesParser::new(FilterKind::ALL.map(FilterKind::name))
        .try_map(|name| FilterKind::from_name(&name).ok_or("not a filter"))
}

fn scales() -> impl TypedValueParser<Value = Scale> {
    PossibleValuesParser::new(Scale::ALL.map(Scale::name))
        .try_map(|name| Scale::from_name(&name).ok_or("not a scale"))
}

impl FilterArgs {
    fn filter(&self) -> Filter {
        let &Self { filter: kind, by, cutoff, from, to, gain, time, taper, outside, .. } = self;
        Filter { kind, by, cutoff, from, to, gain, time, taper, outside }
    }
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
        let filter = args.filter();
        (filter.transfer(&results.modes).map_err(Failure::input)?, filter.describe())
    } else {
        let outside = args.outside.unwrap_or(0.0);
        let transfer = Transfer::from_gains(args.gains.clone(), outside, &results.modes);
        (transfer.map_err(Failure::input)?, "gains as given".to_owned())
    };
    let cloud = results.cloud()?;
    let names: Vec<&str> = args.field.iter().map(String::as_str).collect();
    let target = Target::named(&cloud, &names).map_err(Failure::input)?;
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
            let encoding = if args.ascii { PlyEncoding::Ascii } else { PlyEncoding::BinaryLittleEndian };
            let filtered = target.replaced(&cloud, &columns).map_err(Failure::other)?;
            let comment = format!("chladni: {description}; outside of the bases x {}", transfer.outside);
            output::write_file(&args.output, |out| {
                write_annotated_ply(&filtered, encoding, &[comment], out)
            })?;
        }
    }
    let points = cloud.len();
    let what = format!("{description}, {points} points, {lost} of them unchanged for want of a result");
    let warnings: Vec<String> = warning.into_iter().collect();
    args.writing.reporting.warn(&warnings);
    let facts =
        json!({ "filter": description, "points": points, "rows_without_result": lost, "warnings": warnings });
    args.writing.reporting.wrote(&args.output, &what, facts);
    Ok(())
}
