//! Files that appear whole or not at all, and the folder that a command writes into.

use crate::error::{Error, Result};
use serde::Serialize;
use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};

/// A file that gets its name only when it is complete: a buffered temporary file in the target's folder, renamed by [`commit`](Self::commit). Until
/// then an older file of that name is untouched; dropped without it, nothing remains.
#[derive(Debug)]
pub struct AtomicFile {
    pub(super) target: PathBuf,
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
            return Err(Error::io(target, ErrorKind::IsADirectory.into()));
        }
        let folder = folder_of(&target);
        create_folder(folder)?;
        let file = temporary().tempfile_in(folder).map_err(|source| Error::io(folder, source))?;
        Ok(Self { target, file: BufWriter::with_capacity(1 << 16, file) })
    }

    /// As [`create`](Self::create), with a fixed name until it is finished, so that [`resume`](Self::resume) can continue it when the process ends early.
    pub fn create_resumable(target: impl Into<PathBuf>) -> Result<Self> {
        let Self { target, .. } = Self::create(target)?;
        let unfinished = unfinished(&target);
        let file = File::create(&unfinished).map_err(|source| Error::io(&unfinished, source))?;
        Self::unfinished_at(target, unfinished.clone(), file).map_err(|source| Error::io(unfinished, source))
    }

    /// Continues a file after its first `length` bytes, which `is_right` accepts: an unfinished one, or else the complete one.
    ///
    /// # Errors
    /// [`Error::Io`] when neither has these bytes.
    pub fn resume(target: impl Into<PathBuf>, length: u64, is_right: impl Fn(&[u8]) -> bool) -> Result<Self> {
        let target = target.into();
        let unfinished = unfinished(&target);
        let right = |path: &Path| read_first(path, length).ok().filter(|bytes| is_right(bytes));
        let file = if right(&unfinished).is_some() {
            truncated(&unfinished, length)
        } else if let Some(bytes) = right(&target) {
            File::create(&unfinished).and_then(|mut file| file.write_all(&bytes).map(|()| file))
        } else {
            return Err(Error::io(target, io::Error::new(ErrorKind::NotFound, MISSING)));
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
    /// [`Error::Io`] as [`create`](Self::create), or with the error of `content`; the target is then unchanged.
    pub fn write(target: impl Into<PathBuf>, content: impl FnOnce(&mut Self) -> io::Result<()>) -> Result<()> {
        let mut file = Self::create(target)?;
        match content(&mut file) {
            Ok(()) => file.commit(),
            Err(source) => Err(Error::io(file.target, source)),
        }
    }

    /// Writes a whole file of text.
    pub fn write_text(target: impl Into<PathBuf>, text: &str) -> Result<()> {
        Self::write(target, |file| file.write_all(text.as_bytes()))
    }

    /// Writes a whole file of JSON in one line.
    pub fn write_json(target: impl Into<PathBuf>, value: &impl Serialize) -> Result<()> {
        Self::write(target, |file| {
            serde_json::to_writer(&mut *file, value)?;
            file.write_all(b"\n")
        })
    }

    /// Writes a whole file of indented JSON.
    pub fn write_indented_json(target: impl Into<PathBuf>, value: &impl Serialize) -> Result<()> {
        Self::write(target, |file| {
            serde_json::to_writer_pretty(&mut *file, value)?;
            file.write_all(b"\n")
        })
    }

    pub(super) fn unfinished(&self) -> &Path {
        self.file.get_ref().path()
    }

    /// Completes the file: it takes its name, replacing an older file atomically.
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

fn folder_of(target: &Path) -> &Path {
    target.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

/// Creates a folder and those around it; where one cannot be created, none is left behind.
fn create_folder(folder: &Path) -> Result<()> {
    check_folder(folder)?;
    let missing: Vec<&Path> = folder.ancestors().take_while(|folder| folder.metadata().is_err()).collect();
    std::fs::create_dir_all(folder).map_err(|source| {
        missing.into_iter().for_each(|folder| _ = std::fs::remove_dir(folder));
        Error::io(folder, source)
    })
}

fn check_folder(folder: &Path) -> Result<()> {
    match folder.metadata() {
        Ok(found) if !found.is_dir() => Err(Error::io(folder, ErrorKind::NotADirectory.into())),
        _ => Ok(()),
    }
}

fn unfinished(target: &Path) -> PathBuf {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    target.with_file_name(format!("{PREFIX}{name}{SUFFIX}"))
}

pub(super) const MISSING: &str = "what the checkpoint goes on from is not there any more";

/// A file that is open for writing after its first `length` bytes.
pub(super) fn truncated(path: &Path, length: u64) -> io::Result<File> {
    let mut file = File::options().read(true).write(true).open(path)?;
    if file.metadata()?.len() < length {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    file.set_len(length)?;
    file.seek(SeekFrom::End(0))?;
    Ok(file)
}

fn read_first(path: &Path, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(length).read_to_end(&mut bytes)?;
    if bytes.len() as u64 == length { Ok(bytes) } else { Err(ErrorKind::UnexpectedEof.into()) }
}

/// The start and end of names of unfinished files.
const PREFIX: &str = ".sprung-";
const SUFFIX: &str = ".part";

/// The start of names of unfinished files that cannot be continued; the rest is random.
const TEMPORARY: &str = ".sprung-~";

fn is_unfinished(name: &str) -> bool {
    name.starts_with(PREFIX) && name.ends_with(SUFFIX)
}

fn is_temporary(name: &str) -> bool {
    name.starts_with(TEMPORARY) && is_unfinished(name)
}

/// Temporary files are private by default; results get the permissions of any other new file.
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

/// A locked output folder, which keeps the files of two commands apart. The lock goes with the value, or with the process, however that ends.
/// Finished files of an earlier command stay until others take their place: a run that fails early leaves the last results whole.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// Open as long as the lock is held; `None` where the system has no locks on folders.
    _lock: Option<File>,
}

impl OutputFolder {
    /// Creates the folder where it does not exist, locks it, and removes unfinished files of a killed process; `goes_on` keeps those that can be continued.
    ///
    /// # Errors
    /// [`Error::Io`] when the folder cannot be created, or when another process is at work in it.
    pub fn claim(path: &Path, goes_on: bool) -> Result<Self> {
        create_folder(path)?;
        let lock = match File::open(path).map(|folder| (folder.try_lock(), folder)) {
            Ok((Ok(()), folder)) => Some(folder),
            Ok((Err(TryLockError::WouldBlock), _)) => {
                let busy = io::Error::new(ErrorKind::WouldBlock, "another run is using this folder");
                return Err(Error::io(path, busy));
            }
            // Some systems cannot open or lock a folder; there the user keeps runs apart.
            Ok((Err(TryLockError::Error(_)), _)) | Err(_) => None,
        };
        let folder = Self { path: path.to_path_buf(), _lock: lock };
        folder.sweep(if goes_on { is_temporary } else { is_unfinished });
        Ok(folder)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Fails where something else than a folder has the name of an inner folder.
    pub fn check_inside(&self, folder: &str) -> Result<()> {
        check_folder(&self.path.join(folder))
    }

    /// Removes a file of an earlier command, if it exists.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder of that name, or a file that cannot be removed.
    pub fn remove(&self, name: impl AsRef<Path>) -> Result<()> {
        let file = self.path.join(name);
        if file.is_dir() {
            return Err(Error::io(file, ErrorKind::IsADirectory.into()));
        }
        or_absent(std::fs::remove_file(&file)).map_err(|source| Error::io(file, source))
    }

    /// Renames a file, if it exists, replacing one of that name.
    pub fn rename(&self, from: &str, to: &str) -> Result<()> {
        let file = self.path.join(from);
        or_absent(std::fs::rename(&file, self.path.join(to))).map_err(|source| Error::io(file, source))
    }

    /// Removes the files of an inner folder whose names a test accepts, and the folder if it is then empty.
    pub fn remove_inside(&self, folder: &str, is_ours: impl Fn(&str) -> bool) -> Result<()> {
        let path = self.path.join(folder);
        for name in names(&path).iter().filter(|name| is_ours(name)) {
            self.remove(Path::new(folder).join(name))?;
        }
        // Fails, as it should, where something else is in it.
        let _ = std::fs::remove_dir(path);
        Ok(())
    }

    /// Removes all unfinished files, here and in the folders of results, once nothing will be continued.
    pub fn tidy(&self) {
        self.sweep(is_unfinished);
    }

    fn sweep(&self, is_unfinished: fn(&str) -> bool) {
        if self._lock.is_none() {
            return;
        }
        for folder in ["", "frames", "failure", "chart"].map(|name| self.path.join(name)) {
            for name in names(&folder).iter().filter(|name| is_unfinished(name)) {
                // A file that cannot be removed does no harm.
                let _ = std::fs::remove_file(folder.join(name));
            }
        }
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

fn or_absent(outcome: io::Result<()>) -> io::Result<()> {
    match outcome {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bare_name_is_in_the_current_folder() {
        assert_eq!(
            ["a.txt", "b/a.txt", "/a.txt", ""].map(|file| folder_of(Path::new(file))),
            [".", "b", "/", "."].map(Path::new)
        );
    }

    /// One of two claims succeeds; unfinished files go, those of others stay.
    #[test]
    fn a_folder_has_one_owner_and_no_unfinished_files() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("a/b");
        let exists = |name: &str| path.join(name).exists();
        let put = |name: &str| {
            let file = path.join(name);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, "").unwrap();
        };
        let ours = ["frames/frame_000001.vtp", "final.json"];
        let others = [".sprung-x1.part", "frames/.sprung-x2.part", "notes.part", "frames/mine.txt"];
        others.iter().chain(&ours).for_each(|name| put(name));
        let folder = OutputFolder::claim(&path, false).unwrap();
        assert_eq!(others.map(exists), [false, false, true, true]);
        assert!(exists(ours[0]));
        #[cfg(target_os = "linux")]
        {
            let error = OutputFolder::claim(&path, false).unwrap_err().to_string();
            assert!(error.ends_with("a/b: another run is using this folder"), "{error}");
        }
        folder.remove("final.json").unwrap();
        folder.remove_inside("frames", |name| name.ends_with(".vtp")).unwrap();
        assert!(!ours.into_iter().any(exists) && exists("frames/mine.txt"));
        folder.remove_inside("frames", |_| true).unwrap();
        assert!(!exists("frames"));
        drop(folder);
        // A continued run needs the file with the name of its target, and no other.
        put(".sprung-energy.csv.part");
        put(".sprung-~x3.part");
        let folder = OutputFolder::claim(&path, true).unwrap();
        assert!(exists(".sprung-energy.csv.part") && !exists(".sprung-~x3.part"));
        folder.tidy();
        assert!(!exists(".sprung-energy.csv.part"));
        put(".sprung-energy.csv.part");
        drop(folder);
        OutputFolder::claim(&path, false).unwrap();
        assert!(!exists(".sprung-energy.csv.part"));
    }
}
