//! Files that appear whole or not at all.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};

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
        let folder = folder_of(&target);
        if is_something_else(folder) {
            return Err(Error::io(folder, io::ErrorKind::NotADirectory.into()));
        }
        std::fs::create_dir_all(folder).map_err(|source| Error::io(folder, source))?;
        let file = temporary().tempfile_in(folder).map_err(|source| Error::io(folder, source))?;
        Ok(Self { target, file: BufWriter::with_capacity(1 << 16, file) })
    }

    /// As [`create`](Self::create), with a fixed name for as long as the file is unfinished: what was written stays when the
    /// process ends before it is complete, and [`resume`](Self::resume) can go on with it.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn create_resumable(target: impl Into<PathBuf>) -> Result<Self> {
        // What create looks at: the folder and the name.
        let Self { target, .. } = Self::create(target)?;
        let unfinished = unfinished(&target);
        let file = File::create(&unfinished).map_err(|source| Error::io(&unfinished, source))?;
        Self::unfinished_at(target, unfinished.clone(), file).map_err(|source| Error::io(unfinished, source))
    }

    /// Goes on with a file behind its first `length` bytes, which `is_right` accepts: those of one that was left unfinished, or
    /// else of the complete one.
    ///
    /// # Errors
    /// [`Error::Io`] when neither is there with these bytes.
    pub fn resume(target: impl Into<PathBuf>, length: u64, is_right: impl Fn(&[u8]) -> bool) -> Result<Self> {
        let target = target.into();
        let unfinished = unfinished(&target);
        let right = |path: &Path| read_first(path, length).ok().filter(|bytes| is_right(bytes));
        let file = if right(&unfinished).is_some() {
            File::options().write(true).open(&unfinished).and_then(|mut file| {
                file.set_len(length)?;
                file.seek(SeekFrom::End(0))?;
                Ok(file)
            })
        } else if let Some(bytes) = right(&target) {
            File::create(&unfinished).and_then(|mut file| file.write_all(&bytes).map(|()| file))
        } else {
            let missing = "what the checkpoint goes on from is not there any more";
            return Err(Error::io(target, io::Error::new(io::ErrorKind::NotFound, missing)));
        };
        file.and_then(|file| Self::unfinished_at(target, unfinished.clone(), file))
            .map_err(|source| Error::io(unfinished, source))
    }

    fn unfinished_at(target: PathBuf, unfinished: PathBuf, file: File) -> io::Result<Self> {
        let mut path = TempPath::try_from_path(unfinished)?;
        path.disable_cleanup(true);
        Ok(Self { target, file: BufWriter::with_capacity(1 << 16, NamedTempFile::from_parts(file, path)) })
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

    /// The name that the file has as long as it is unfinished.
    pub(super) fn unfinished(&self) -> &Path {
        self.file.get_ref().path()
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

/// The folder of a file: of a name alone, the one that the process is in.
fn folder_of(target: &Path) -> &Path {
    match target.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    }
}

/// Whether there is something at a path that is no folder: one look, for what is there may go away.
pub(super) fn is_something_else(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| !found.is_dir())
}

/// The name of an unfinished file that can be gone on with.
fn unfinished(target: &Path) -> PathBuf {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    target.with_file_name(format!("{PREFIX}{name}{SUFFIX}"))
}

/// The first bytes of a file that has at least so many.
fn read_first(path: &Path, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(length).read_to_end(&mut bytes)?;
    if bytes.len() as u64 == length { Ok(bytes) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}

/// How the names of unfinished files begin and end.
const PREFIX: &str = ".sprung-";
const SUFFIX: &str = ".part";

/// How the names of those begin that cannot be gone on with, whose rest is random.
const TEMPORARY: &str = ".sprung-~";

/// Whether a name is that of an unfinished file.
pub(super) fn is_part(name: &str) -> bool {
    name.starts_with(PREFIX) && name.ends_with(SUFFIX)
}

/// Whether such a file is one that nobody can go on with.
pub(super) fn is_temporary(name: &str) -> bool {
    name.starts_with(TEMPORARY) && is_part(name)
}

/// Temporary files are made readable by their owner alone; results get the permissions of any other new file.
fn temporary() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY).suffix(SUFFIX);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}

#[cfg(test)]
mod tests {
    use super::folder_of;
    use std::path::Path;

    #[test]
    fn a_name_alone_is_in_the_folder_of_the_process() {
        for (file, folder) in [("a.txt", "."), ("b/a.txt", "b"), ("/a.txt", "/"), ("/b/c/a.txt", "/b/c"), ("", ".")] {
            assert_eq!(folder_of(Path::new(file)), Path::new(folder), "{file}");
        }
    }
}
