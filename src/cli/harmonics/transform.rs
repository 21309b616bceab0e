//! `chladni coefficients` and `chladni synthesis`: the manifold harmonic transform and back.

use std::path::{Path, PathBuf};

use chladni::harmonics::filtered::Target;
use chladni::harmonics::functions::{first_nonfinite, rows_without_result};
use chladni::harmonics::{Energy, Function, transform};
use serde_json::{Map, Value, json};

use super::{Failure, Output, Results, Writing, output, results, write_json, write_npy};

/// Transform coordinates and fields of an analyzed cloud, or functions of your own.
#[derive(Debug, clap::Args)]
pub(crate) struct CoefficientsArgs {
    /// Directory that `chladni analyze` filled
    results: PathBuf,

    /// Functions in place of the cloud's own: an npy file of n or n × m numbers
    #[arg(long, value_name = "FILE")]
    functions: Option<PathBuf>,

    /// Number of bands of consecutive modes into which energies are summed
    #[arg(long, default_value_t = 10)]
    bands: usize,

    /// File to write, json or npy; standard output (`-`) when absent
    #[arg(long, short, value_name = "FILE", default_value = "-")]
    output: PathBuf,

    #[command(flatten)]
    writing: Writing,
}

/// Make functions from coefficients: the inverse of the transform.
#[derive(Debug, clap::Args)]
pub(crate) struct SynthesisArgs {
    /// Directory that `chladni analyze` filled
    results: PathBuf,

    /// Coefficients: an npy file of k or k × m numbers, or JSON as `chladni coefficients` writes it
    coefficients: PathBuf,

    /// File to write; its extension chooses the format: npy, ply or json; `-` is standard output
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    #[command(flatten)]
    writing: Writing,
}

/// Reads, transforms, writes.
pub(crate) fn coefficients(args: &CoefficientsArgs) -> Result<(), Failure> {
    let format = Output::of(&args.output, &args.writing, &[Output::Json, Output::Npy])?;
    let results = Results::read(&args.results)?;
    let functions = match &args.functions {
        Some(path) => posted(path, &results)?,
        None => own(&results)?,
    };
    let values: Vec<&[f64]> = functions.iter().map(|function| function.values.as_slice()).collect();
    let found = transform::total(&results.map(|block| transform::partial(block, &results.mass, &values)));
    if format == Output::Npy {
        let columns: Vec<Vec<f64>> = found.into_iter().map(|function| function.coefficients).collect();
        write_npy(&columns, false, &args.output)?;
    } else {
        let named = || functions.iter().map(|function| function.name.clone()).zip(&found);
        let fields: Map<String, Value> =
            named().map(|(name, found)| (name, found.coefficients.clone().into())).collect();
        let energy: Map<String, Value> =
            named().map(|(name, found)| (name, json!(Energy::of(found, args.bands)))).collect();
        let answer = json!({
            "points": results.mass.len(),
            "rows_without_result": rows_without_result(&results.mass),
            "eigenvalues": results.modes.eigenvalues(),
            "fields": fields,
            "energy": energy,
            "clusters": results.modes.clusters(),
        });
        write_json(&answer, &args.output)?;
    }
    if !output::is_standard(&args.output) {
        let (functions, bases) = (functions.len(), results.modes.len());
        let what = format!("{functions} functions in {bases} bases");
        args.writing.reporting.wrote(&args.output, &what, json!({ "functions": functions, "bases": bases }));
    }
    Ok(())
}

/// The coordinates, and those fields that are finite.
fn own(results: &Results) -> Result<Vec<Function>, Failure> {
    let cloud = results.cloud()?;
    let coordinates = Target::Coordinates.functions(&cloud, &results.mass).map_err(Failure::input)?;
    let field = |place| Target::Fields(vec![place]).functions(&cloud, &results.mass).ok();
    Ok(coordinates.into_iter().chain((0..cloud.fields().len()).filter_map(field).flatten()).collect())
}

fn posted(path: &Path, results: &Results) -> Result<Vec<Function>, Failure> {
    let shown = path.display();
    let named = |(i, values)| Function::new(format!("f{i}"), values);
    let functions: Vec<Function> = results::columns(path)?.into_iter().enumerate().map(named).collect();
    let rows = results.mass.len();
    for function in &functions {
        if function.values.len() != rows {
            let found = function.values.len();
            return Err(Failure::Input(format!("{shown} has {found} rows; the cloud has {rows}")));
        }
        if let Some(row) = first_nonfinite(&function.values, &results.mass) {
            return Err(Failure::Input(format!("{shown}: `{}` is not finite in row {row}", function.name)));
        }
    }
    Ok(functions)
}

/// Reads, synthesizes, writes.
pub(crate) fn synthesis(args: &SynthesisArgs) -> Result<(), Failure> {
    let format = Output::of(&args.output, &args.writing, &[Output::Npy, Output::Ply, Output::Json])?;
    let results = Results::read(&args.results)?;
    let given = lists(&args.coefficients)?;
    for list in &given {
        let (count, bases) = (list.values.len(), results.modes.len());
        if count > bases {
            return Err(Failure::Input(format!(
                "`{}` has {count} coefficients for {bases} bases",
                list.name
            )));
        }
    }
    let values: Vec<&[f64]> = given.iter().map(|list| list.values.as_slice()).collect();
    let columns = results.columns(|block| transform::synthesize(block, &values));
    match format {
        Output::Npy => write_npy(&columns, false, &args.output)?,
        Output::Ply => {
            let names: Vec<String> = given.iter().map(|list| format!("f_{}", list.name)).collect();
            results.write_ply(&names, &columns, &args.output)?;
        }
        Output::Json => {
            let names: Vec<&str> = given.iter().map(|list| list.name.as_str()).collect();
            let answer = json!({ "points": results.mass.len(), "names": names, "values": columns });
            write_json(&answer, &args.output)?;
        }
    }
    let (functions, bases) = (given.len(), results.modes.len());
    let what = format!("{functions} functions from {bases} bases");
    args.writing.reporting.wrote(&args.output, &what, json!({ "functions": functions, "bases": bases }));
    Ok(())
}

/// Coefficients from an array, or from the `fields` of a JSON object.
fn lists(path: &Path) -> Result<Vec<Function>, Failure> {
    if path.extension().is_none_or(|extension| extension != "json") {
        let named = |(i, values)| Function::new(format!("f{i}"), values);
        return Ok(results::columns(path)?.into_iter().enumerate().map(named).collect());
    }
    let refused = |what: &dyn std::fmt::Display| Failure::Input(format!("{}: {what}", path.display()));
    let json: Value = serde_json::from_slice(&results::file(path)?).map_err(|error| refused(&error))?;
    let fields = json.get("fields").unwrap_or(&json).as_object();
    let fields = fields.ok_or_else(|| refused(&"expected an object of lists of numbers"))?;
    fields
        .iter()
        .map(|(name, list)| {
            let values: Option<Vec<f64>> =
                list.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
            let values = values.ok_or_else(|| refused(&format!("`{name}` is not a list of numbers")))?;
            Ok(Function::new(name.clone(), values))
        })
        .collect()
}
