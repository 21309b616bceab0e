//! Results appear under their names when they are whole, or not at all.

use std::fs::{self, File, Permissions};
use std::io::{self, BufWriter, Stdout, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use signal_hook::consts::SIGPIPE;
use tempfile::TempDir;

use super::Failure;

/// Bytes that are written at once.
const BUFFER_BYTES: usize = 1 << 20;

/// Permissions before the user's mask: temporary files would be readable by their owner alone.
const FILE_MODE: u32 = 0o666;
const FOLDER_MODE: u32 = 0o777;

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

/// Why standard output could not be written.
pub(super) fn not_printed(error: &io::Error) -> Failure {
    match error.kind() {
        io::ErrorKind::BrokenPipe => Failure::Signal(SIGPIPE),
        _ => Failure::Other(format!("standard output: {error}")),
    }
}

/// Writes a file beside its place, then moves it there; `-` is standard output.
pub(super) fn write_file(path: &Path, write: impl FnOnce(&mut Out) -> io::Result<()>) -> Result<(), Failure> {
    if is_standard(path) {
        let mut out = Out::Standard(BufWriter::with_capacity(BUFFER_BYTES, io::stdout()));
        return write(&mut out).and_then(|()| out.flush()).map_err(|error| not_printed(&error));
    }
    let prefix = hidden(path)?;
    let written = || {
        let temporary = tempfile::Builder::new()
            .prefix(&prefix)
            .permissions(Permissions::from_mode(FILE_MODE))
            .tempfile_in(folder(path))?;
        write_whole(temporary.as_file().try_clone()?, write)?;
        temporary.persist(path)?;
        Ok(())
    };
    written().map_err(|error| named(path, &error))
}

fn write_whole(file: File, write: impl FnOnce(&mut Out) -> io::Result<()>) -> io::Result<()> {
    let mut out = Out::File(BufWriter::with_capacity(BUFFER_BYTES, file));
    write(&mut out)?;
    out.flush()
}

/// A directory of results that is moved to its place when all of them are there.
#[derive(Debug)]
pub(super) struct Directory {
    target: PathBuf,
    temporary: TempDir,
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
        let prefix = hidden(target)?;
        let made = || {
            fs::create_dir_all(folder(target))?;
            tempfile::Builder::new()
                .prefix(&prefix)
                .permissions(Permissions::from_mode(FOLDER_MODE))
                .tempdir_in(folder(target))
        };
        let temporary = made().map_err(|error| named(target, &error))?;
        Ok(Self { target: target.to_owned(), temporary, files: Vec::new() })
    }

    /// Where the files are until all of them are there.
    pub(super) fn path(&self) -> &Path {
        self.temporary.path()
    }

    /// Writes one of the files.
    pub(super) fn write(
        &mut self,
        name: &str,
        write: impl FnOnce(&mut Out) -> io::Result<()>,
    ) -> Result<(), Failure> {
        let file = File::create(self.temporary.path().join(name));
        file.and_then(|file| write_whole(file, write))
            .map_err(|error| named(&self.target.join(name), &error))?;
        self.files.push(name.to_owned());
        Ok(())
    }

    /// Moves all files to their place and tells their paths.
    pub(super) fn finish(self) -> Result<Vec<PathBuf>, Failure> {
        let is_whole_directory = fs::remove_dir(&self.target).is_ok() || !self.target.exists();
        let moved = if is_whole_directory {
            fs::rename(self.temporary.path(), &self.target)
        } else {
            self.files
                .iter()
                .try_for_each(|name| fs::rename(self.temporary.path().join(name), self.target.join(name)))
        };
        moved.map_err(|error| named(&self.target, &error))?;
        Ok(self.files.iter().map(|name| self.target.join(name)).collect())
    }
}

/// How the hidden name begins that a path has until it is whole.
fn hidden(path: &Path) -> Result<String, Failure> {
    let name = path
        .file_name()
        .ok_or_else(|| Failure::Input(format!("`{}` is not the name of a file", path.display())))?;
    Ok(format!(".{}.", name.to_string_lossy()))
}

/// The folder that a path lies in, so that moving is renaming.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The error by the path that the caller knows, not by the hidden one.
fn named(path: &Path, error: &io::Error) -> Failure {
    let folder = folder(path);
    if error.kind() == io::ErrorKind::NotFound && !folder.exists() {
        return Failure::Input(format!("{}: there is no folder {}", path.display(), folder.display()));
    }
    // A library names the hidden path beside what the system says.
    let error = error
        .raw_os_error()
        .map_or_else(|| error.to_string(), |code| io::Error::from_raw_os_error(code).to_string());
    Failure::Other(format!("{}: {error}", path.display()))
}
