//! Results appear under their names when they are whole, or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Stdout, Write};
use std::path::{Path, PathBuf};

use signal_hook::consts::SIGPIPE;

use super::Failure;

/// Bytes that are written at once.
const BUFFER_BYTES: usize = 1 << 20;

/// Where a command writes.
pub(super) enum Out {
    /// A file.
    File(BufWriter<File>),
    /// Standard output.
    Standard(BufWriter<Stdout>),
}

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::File(out) => out.write(bytes),
            Self::Standard(out) => out.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::File(out) => out.flush(),
            Self::Standard(out) => out.flush(),
        }
    }
}

/// Whether a path stands for standard input or output.
pub(super) fn is_standard(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Writes a file beside its place, then moves it there; `-` is standard output.
pub(super) fn write_file(path: &Path, write: impl FnOnce(&mut Out) -> io::Result<()>) -> Result<(), Failure> {
    if is_standard(path) {
        let mut out = Out::Standard(BufWriter::with_capacity(BUFFER_BYTES, io::stdout()));
        return write(&mut out).and_then(|()| out.flush()).map_err(|error| match error.kind() {
            io::ErrorKind::BrokenPipe => Failure::Signal(SIGPIPE),
            _ => Failure::Other(format!("standard output: {error}")),
        });
    }
    let temporary = beside(path)?;
    let written = write_whole(&temporary, write).and_then(|()| fs::rename(&temporary, path));
    written.map_err(|error| {
        // The error that is told is the first one.
        let _ = fs::remove_file(&temporary);
        named(path, &error)
    })
}

fn write_whole(path: &Path, write: impl FnOnce(&mut Out) -> io::Result<()>) -> io::Result<()> {
    let mut out = Out::File(BufWriter::with_capacity(BUFFER_BYTES, File::create(path)?));
    write(&mut out)?;
    out.flush()
}

/// A directory of results that is moved to its place when all of them are there.
#[derive(Debug)]
pub(super) struct Directory {
    target: PathBuf,
    temporary: PathBuf,
    files: Vec<String>,
}

impl Directory {
    /// Prepares to fill `target`, which must be empty, new, or overwritten by `force`.
    pub(super) fn prepare(target: &Path, force: bool) -> Result<Self, Failure> {
        match fs::read_dir(target) {
            Ok(mut entries) => {
                if entries.next().is_some() && !force {
                    let shown = target.display();
                    return Err(Failure::Input(format!(
                        "{shown} is not empty; --force overwrites what is in it"
                    )));
                }
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(Failure::Input(format!("{}: {error}", target.display()))),
        }
        let temporary = beside(target)?;
        fs::create_dir_all(&temporary).map_err(|error| named(target, &error))?;
        Ok(Self { target: target.to_owned(), temporary, files: Vec::new() })
    }

    /// Writes one of the files.
    pub(super) fn write(
        &mut self,
        name: &str,
        write: impl FnOnce(&mut Out) -> io::Result<()>,
    ) -> Result<(), Failure> {
        let path = self.temporary.join(name);
        write_whole(&path, write).map_err(|error| named(&self.target.join(name), &error))?;
        self.files.push(name.to_owned());
        Ok(())
    }

    /// Moves all files to their place and tells their paths.
    pub(super) fn finish(self) -> Result<Vec<PathBuf>, Failure> {
        let is_whole_directory = fs::remove_dir(&self.target).is_ok() || !self.target.exists();
        let moved = if is_whole_directory {
            fs::rename(&self.temporary, &self.target)
        } else {
            self.files
                .iter()
                .try_for_each(|name| fs::rename(self.temporary.join(name), self.target.join(name)))
        };
        moved.map_err(|error| named(&self.target, &error))?;
        Ok(self.files.iter().map(|name| self.target.join(name)).collect())
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        // Gone already when it was moved.
        let _ = fs::remove_dir_all(&self.temporary);
    }
}

/// A hidden name in the same directory, so that moving is renaming.
fn beside(path: &Path) -> Result<PathBuf, Failure> {
    let name = path
        .file_name()
        .ok_or_else(|| Failure::Input(format!("`{}` is not the name of a file", path.display())))?;
    let hidden = format!(".{}.{}", name.to_string_lossy(), std::process::id());
    Ok(path.with_file_name(hidden))
}

fn named(path: &Path, error: &io::Error) -> Failure {
    Failure::Other(format!("{}: {error}", path.display()))
}
