//! Point clouds that commands read.

use std::io::{self, Read};
use std::path::Path;

use chladni::cloud::PointCloud;
use chladni::cloud::reader::{self, Format, Limits, ReadRequest, read};

use super::Failure;
use super::flags::Flags;
use super::output::is_standard;

/// How a cloud is read.
#[derive(Debug, clap::Args)]
pub(super) struct CloudArgs {
    #[command(flatten)]
    reading: Flags<ReadRequest>,
}

impl CloudArgs {
    /// Reads a file; `-` is standard input.
    pub(super) fn read(&self, path: &Path) -> Result<PointCloud, Failure> {
        let shown = shown(path);
        let bytes = bytes(path)?;
        let reading = &self.reading.0;
        let format = reading
            .format
            .or_else(|| Format::of_file(path.file_name().and_then(|name| name.to_str()), &bytes));
        let Some(format) = format else {
            if let Some(error) = reader::foreign(&bytes) {
                return Err(Failure::Input(format!("{shown}: {error}")));
            }
            let names = Format::ALL.map(Format::name).join(", ");
            return Err(Failure::Input(format!("{shown}: unknown format; name it with --format ({names})")));
        };
        let options = reading.options(Limits::OF_THE_MACHINE);
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
