//! Point clouds that commands read.

use std::io::{self, Read};
use std::path::Path;

use chladni::cloud::reader::{self, Format, Limits, ReadOptions, read};
use chladni::cloud::{NonFinite, PointCloud};
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::Failure;
use super::output::is_standard;

/// How a cloud is read.
#[derive(Debug, clap::Args)]
pub(super) struct CloudArgs {
    /// Format of the cloud, where neither extension nor content tell
    #[arg(long, value_parser = formats())]
    format: Option<Format>,

    /// For tables: the first so many columns are the coordinates
    #[arg(long, value_name = "D")]
    coordinates: Option<usize>,

    /// For files of several scans (E57, PTX): which one, counting from 0; all of them by default
    #[arg(long, value_name = "N")]
    scan: Option<usize>,

    /// Rows with a non-finite coordinate: refuse the cloud, or drop the rows
    #[arg(long, default_value = "reject", value_parser = policies())]
    nonfinite: NonFinite,
}

fn formats() -> impl TypedValueParser<Value = Format> {
    PossibleValuesParser::new(Format::ALL.map(Format::name))
        .try_map(|name| Format::from_name(&name).ok_or("unknown"))
}

fn policies() -> impl TypedValueParser<Value = NonFinite> {
    PossibleValuesParser::new(["reject", "drop"])
        .map(|name| if name == "drop" { NonFinite::Drop } else { NonFinite::Reject })
}

impl CloudArgs {
    /// Reads a file; `-` is standard input.
    pub(super) fn read(&self, path: &Path) -> Result<PointCloud, Failure> {
        let shown = shown(path);
        let bytes = bytes(path)?;
        let format =
            self.format.or_else(|| Format::of_file(path.file_name().and_then(|name| name.to_str()), &bytes));
        let Some(format) = format else {
            if let Some(error) = reader::foreign(&bytes) {
                return Err(Failure::Input(format!("{shown}: {error}")));
            }
            let names = Format::ALL.map(Format::name).join(", ");
            return Err(Failure::Input(format!("{shown}: unknown format; name it with --format ({names})")));
        };
        // The service's limits protect it from strangers; here the caller's own machine is the limit.
        let limits = Limits {
            points_max: u32::MAX as usize,
            faces_max: u32::MAX as usize,
            fields_max: usize::MAX,
            ..Limits::default()
        };
        let options =
            ReadOptions { policy: self.nonfinite, dimension: self.coordinates, scan: self.scan, limits };
        read(&bytes, format, &options).map_err(|error| Failure::Input(format!("{shown}: {error}")))
    }
}

/// The whole of a file; of standard input for `-`.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, Failure> {
    let read = if is_standard(path) {
        let mut bytes = Vec::new();
        io::stdin().lock().read_to_end(&mut bytes).map(|_| bytes)
    } else {
        std::fs::read(path)
    };
    read.map_err(|error| Failure::Input(format!("{}: {error}", shown(path))))
}

/// How messages name a file.
fn shown(path: &Path) -> String {
    if is_standard(path) { "standard input".to_owned() } else { path.display().to_string() }
}
