//! `chladni sample`.

use std::path::PathBuf;

use chladni::cloud::reader::Format;
use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::cloud::writer;
use serde_json::json;

use super::flags::word;
use super::reporting::Reporting;
use super::{Failure, output};

/// Write a sample shape with known geometry.
#[derive(Debug, clap::Args)]
pub(crate) struct SampleArgs {
    /// The shape
    #[arg(value_parser = word::<Shape>(&Shape::ALL.map(Shape::name)))]
    shape: Shape,

    /// Number of points; grids take the nearest number that they can have
    #[arg(long, short = 'n', default_value_t = 10_000)]
    points: usize,

    /// How points are spread: well spaced, independent, independent and tenfold denser along x, or a grid with faces
    #[arg(long, default_value = Sampling::default().name(), value_parser = word::<Sampling>(&Sampling::ALL.map(Sampling::name)))]
    sampling: Sampling,

    /// Standard deviation of Gaussian noise along every axis, in units of the shape
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    noise: f64,

    /// Seed of the random numbers, 0 when not given; well spaced samples are shifted or turned by it. The same seed gives the
    /// same file
    #[arg(long)]
    seed: Option<u64>,

    /// Fold of the square along its middle, in degrees
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    angle: f64,

    /// File to write; its extension chooses the format: ply, obj, off, stl, xyz, csv, npy, pcd, las or laz. `-` is standard output
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,

    /// Format in place of the one that the extension names; ply for standard output
    #[arg(long, value_name = "FORMAT", value_parser = word::<Format>(&Format::WRITTEN.map(Format::name)))]
    output_format: Option<Format>,

    #[command(flatten)]
    reporting: Reporting,
}

/// Draws the sample and writes it.
pub(crate) fn run(args: &SampleArgs) -> Result<(), Failure> {
    let &SampleArgs { shape, points, sampling, noise, seed, angle, ref output, .. } = args;
    let format = format(args)?;
    if shape.ambient_dimension() > 3
        && matches!(format, Format::Obj | Format::Off | Format::Stl | Format::Las | Format::Laz)
    {
        let message = format!(
            "{format} holds points of 3 coordinates; {} has {}",
            shape.name(),
            shape.ambient_dimension()
        );
        return Err(Failure::Input(message));
    }
    if seed.is_some() && sampling == Sampling::Grid && noise == 0.0 {
        let message = "--seed changes nothing about a grid without noise; leave it out, add --noise, or choose another --sampling";
        return Err(Failure::Input(message.to_owned()));
    }
    let seed = seed.unwrap_or_default();
    let request = SampleRequest { shape, points, sampling, noise, seed, angle };
    let cloud = sample(&request).map_err(Failure::input)?;
    if format == Format::Stl && cloud.faces().is_empty() {
        let message = "STL holds triangles, and this cloud has none; `--sampling grid` makes them";
        return Err(Failure::Input(message.to_owned()));
    }
    output::write_file(output, |out| writer::write(&cloud, format, out))?;
    let (points, triangles) = (cloud.len(), cloud.faces().len());
    let what = format!(
        "{points} points of {} ({}, seed {seed}), {triangles} triangles",
        shape.name(),
        sampling.name()
    );
    let facts = json!({
        "format": format.name(),
        "shape": shape.name(),
        "sampling": sampling.name(),
        "seed": seed,
        "points": points,
        "triangles": triangles,
    });
    args.reporting.wrote(output, &what, facts);
    Ok(())
}

/// The format that is asked for, or that the file's extension names.
fn format(args: &SampleArgs) -> Result<Format, Failure> {
    let extension = args.output.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let named = Format::from_extension(extension).filter(|format| Format::WRITTEN.contains(format));
    let default = output::is_standard(&args.output).then_some(Format::Ply);
    args.output_format.or(named).or(default).ok_or_else(|| {
        let names = Format::WRITTEN.map(Format::name).join(", ");
        let shown = args.output.display();
        Failure::Input(format!("{shown}: the extension chooses the format; {names} are possible"))
    })
}
