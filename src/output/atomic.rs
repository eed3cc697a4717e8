//! Files that appear whole or not at all.

use crate::error::{Error, Result};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file that gets its name only when it is complete.
///
/// What is written goes to a temporary file in the target's folder, so that taking the name is a rename within one
/// file system. Until [`commit`](Self::commit) an older file of that name is untouched; dropped without it, nothing
/// remains. Writing is buffered.
#[derive(Debug)]
pub struct AtomicFile {
    target: PathBuf,
    file: BufWriter<NamedTempFile>,
}

impl AtomicFile {
    /// Starts a file, creating its folder where it does not exist.
    ///
    /// # Errors
    /// [`Error::Io`] when the folder cannot be created or written, or when the target is a folder.
    pub fn create(target: impl Into<PathBuf>) -> Result<Self> {
        let target = target.into();
        if target.is_dir() {
            return Err(Error::io(target, io::ErrorKind::IsADirectory.into()));
        }
        let folder = match target.parent() {
            Some(parent) if parent != Path::new("") => parent,
            _ => Path::new("."),
        };
        if folder.exists() && !folder.is_dir() {
            return Err(Error::io(folder, io::ErrorKind::NotADirectory.into()));
        }
        std::fs::create_dir_all(folder).map_err(|source| Error::io(folder, source))?;
        let file = temporary().tempfile_in(folder).map_err(|source| Error::io(folder, source))?;
        Ok(Self { target, file: BufWriter::with_capacity(1 << 16, file) })
    }

    /// Writes a whole file.
    ///
    /// # Errors
    /// [`Error::Io`] as [`create`](Self::create), or with what `content` returned; the target is then as it was.
    pub fn write(target: impl Into<PathBuf>, content: impl FnOnce(&mut Self) -> io::Result<()>) -> Result<()> {
        let mut file = Self::create(target)?;
        match content(&mut file) {
            Ok(()) => file.commit(),
            Err(source) => Err(Error::io(file.target, source)),
        }
    }

    /// The name that the file will have.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Completes the file: it takes its name, replacing an older file in one move.
    ///
    /// # Errors
    /// [`Error::Io`] when the last bytes cannot be written or the file cannot be renamed.
    pub fn commit(self) -> Result<()> {
        let Self { target, file } = self;
        let outcome = file.into_inner().map_err(io::IntoInnerError::into_error);
        let outcome = outcome.and_then(|file| file.persist(&target).map_err(|failed| failed.error));
        outcome.map(drop).map_err(|source| Error::io(target, source))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Temporary files are made readable by their owner alone; results get the permissions of any other new file.
fn temporary() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".sprung-").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}
