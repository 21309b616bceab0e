//! `chladni sample`.

use std::path::PathBuf;

use chladni::cloud::reader::Format;
use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::cloud::writer;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::{Failure, output};

/// Write a sample shape with known geometry.
#[derive(Debug, clap::Args)]
pub(crate) struct SampleArgs {
    /// The shape
    #[arg(value_parser = shapes())]
    shape: Shape,

    /// Number of points; grids take the nearest number that they can have
    #[arg(long, short = 'n', default_value_t = 10_000)]
    points: usize,

    /// How points are spread: well spaced, independent, independent and tenfold denser along x, or a grid with faces
    #[arg(long, default_value = "uniform", value_parser = samplings())]
    sampling: Sampling,

    /// Standard deviation of Gaussian noise along every axis, in units of the shape
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    noise: f64,

    /// Seed of the random numbers; the same seed gives the same file
    #[arg(long, default_value_t = 0)]
    seed: u64,

    /// Fold of the square along its middle, in degrees
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    angle: f64,

    /// File to write; its extension chooses the format: ply, obj, off, xyz, csv, npy, las or laz
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
}

fn shapes() -> impl TypedValueParser<Value = Shape> {
    PossibleValuesParser::new(Shape::ALL.map(Shape::name))
        .try_map(|name| Shape::from_name(&name).ok_or("not a shape"))
}

fn samplings() -> impl TypedValueParser<Value = Sampling> {
    PossibleValuesParser::new(Sampling::ALL.map(Sampling::name))
        .try_map(|name| Sampling::from_name(&name).ok_or("not a sampling"))
}

/// Draws the sample and writes it.
#[allow(clippy::print_stdout)] // what was written is the command's output
pub(crate) fn run(args: &SampleArgs) -> Result<(), Failure> {
    let &SampleArgs { shape, points, sampling, noise, seed, angle, ref output } = args;
    let extension = output.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let format = Format::from_extension(extension).filter(|format| Format::WRITTEN.contains(format));
    let format = format.ok_or_else(|| {
        let names = Format::WRITTEN.map(Format::name).join(", ");
        Failure::Input(format!(
            "{}: the extension chooses the format; {names} are possible",
            output.display()
        ))
    })?;
    if shape.ambient_dimension() > 3
        && matches!(format, Format::Obj | Format::Off | Format::Las | Format::Laz)
    {
        let message = format!(
            "{format} holds points of 3 coordinates; {} has {}",
            shape.name(),
            shape.ambient_dimension()
        );
        return Err(Failure::Input(message));
    }
    let request = SampleRequest { shape, points, sampling, noise, seed, angle };
    let cloud = sample(&request).map_err(Failure::input)?;
    output::write_file(output, |out| writer::write(&cloud, format, out))?;
    println!(
        "{}: {} points of {} ({}, seed {seed}), {} triangles",
        output.display(),
        cloud.len(),
        shape.name(),
        sampling.name(),
        cloud.faces().len()
    );
    Ok(())
}
