//! The folder that a command writes into: its own for as long as it runs.
//!
//! Files appear whole (see [`AtomicFile`](super::AtomicFile)), but a folder has several. So that those of two commands never mix, a
//! command locks its folder, and a second one is refused. What an earlier command left behind unfinished is removed when the
//! folder is locked, for then nobody is at work on it. What it left behind *finished* is removed by the owner of the names when
//! something takes its place, not before: a run that fails early leaves the results of the last one whole.

use super::atomic::{is_part, is_something_else, is_temporary};
use crate::error::{Error, Result};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

/// A locked folder. The lock goes with the value, or with the process, however that ends.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// Open for as long as the lock is to be held; none where the system has no locks on folders.
    _lock: Option<File>,
}

impl OutputFolder {
    /// Makes the folder where it does not exist, locks it, and removes unfinished files that a killed process left in it, but those
    /// that are to be gone on with.
    ///
    /// # Errors
    /// [`Error::Io`] when the folder cannot be made, or when another process is at work in it.
    pub fn claim(path: &Path, goes_on: bool) -> Result<Self> {
        if is_something_else(path) {
            return Err(Error::io(path, std::io::ErrorKind::NotADirectory.into()));
        }
        std::fs::create_dir_all(path).map_err(|source| Error::io(path, source))?;
        let lock = match File::open(path).map(|folder| (folder.try_lock(), folder)) {
            Ok((Ok(()), folder)) => Some(folder),
            Ok((Err(TryLockError::WouldBlock), _)) => {
                let busy = std::io::Error::new(std::io::ErrorKind::WouldBlock, "another run is at work in this folder");
                return Err(Error::io(path, busy));
            }
            // Some systems cannot open or lock a folder; there, two runs have to be kept apart by their user.
            Ok((Err(TryLockError::Error(_)), _)) | Err(_) => None,
        };
        let folder = Self { path: path.to_path_buf(), _lock: lock };
        if folder._lock.is_some() {
            folder.sweep(if goes_on { is_temporary } else { is_part });
        }
        Ok(folder)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes a file of an earlier command that nothing takes the place of; that it is not there is no error.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be removed.
    pub fn remove(&self, name: impl AsRef<Path>) -> Result<()> {
        remove(&self.path.join(name))
    }

    /// Gives a file another name, in place of one that has it; that it is not there is no error.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be renamed.
    pub fn rename(&self, from: &str, to: &str) -> Result<()> {
        match std::fs::rename(self.path.join(from), self.path.join(to)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::io(self.path.join(from), error)),
            _ => Ok(()),
        }
    }

    /// Removes those files of a folder inside this one whose names a test accepts, and the folder itself if nothing is left.
    ///
    /// # Errors
    /// [`Error::Io`] when a file cannot be removed.
    pub fn remove_inside(&self, folder: &str, is_ours: impl Fn(&str) -> bool) -> Result<()> {
        let folder = self.path.join(folder);
        for name in names(&folder).iter().filter(|name| is_ours(name)) {
            remove(&folder.join(name))?;
        }
        // Fails, as it should, where something else is in it.
        let _ = std::fs::remove_dir(folder);
        Ok(())
    }

    /// Removes what killed processes left unfinished, here and in the folders that results have: once everything is written that
    /// was gone on with, nobody needs it any more.
    pub fn tidy(&self) {
        if self._lock.is_some() {
            self.sweep(is_part);
        }
    }

    fn sweep(&self, is_unfinished: fn(&str) -> bool) {
        for folder in ["", "frames", "failure", "chart"].map(|name| self.path.join(name)) {
            for name in names(&folder).iter().filter(|name| is_unfinished(name)) {
                // One that cannot be removed does no harm.
                let _ = std::fs::remove_file(folder.join(name));
            }
        }
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

fn remove(file: &Path) -> Result<()> {
    match std::fs::remove_file(file) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::io(file, error)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::OutputFolder;
    use crate::output::AtomicFile;

    /// Of two that claim a folder one gets it; unfinished files go, those of others stay.
    #[test]
    fn a_folder_has_one_owner_and_no_unfinished_files() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("a/b");
        let put = |name: &str| {
            let file = path.join(name);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, "").unwrap();
        };
        let ours = ["frames/frame_000001.vtp", "final.json"];
        [".sprung-x1.part", "frames/.sprung-x2.part", "notes.part", "frames/mine.txt"]
            .iter()
            .chain(&ours)
            .for_each(|n| put(n));
        let folder = OutputFolder::claim(&path, false).unwrap();
        let exists = |name: &str| path.join(name).exists();
        assert!(
            !exists(".sprung-x1.part") && !exists("frames/.sprung-x2.part") && exists("notes.part") && exists(ours[0])
        );
        #[cfg(target_os = "linux")]
        {
            let error = OutputFolder::claim(&path, false).unwrap_err().to_string();
            assert!(error.ends_with("a/b: another run is at work in this folder"), "{error}");
        }
        folder.remove("final.json").unwrap();
        folder.remove("final.json").unwrap();
        folder.remove_inside("frames", |name| name.ends_with(".vtp")).unwrap();
        assert!(!ours.into_iter().any(exists) && exists("frames/mine.txt"));
        std::fs::remove_file(path.join("frames/mine.txt")).unwrap();
        folder.remove_inside("frames", |_| true).unwrap();
        assert!(!exists("frames"));
        drop(folder);
        // A run that goes on needs the file that has the name of what it will be, and no other.
        put(".sprung-energy.csv.part");
        put(".sprung-~x3.part");
        let folder = OutputFolder::claim(&path, true).unwrap();
        assert!(exists(".sprung-energy.csv.part") && !exists(".sprung-~x3.part"));
        drop(folder);
        OutputFolder::claim(&path, false).unwrap();
        assert!(!exists(".sprung-energy.csv.part"));
        // Once what it went on with is complete nobody needs it any more.
        put(".sprung-energy.csv.part");
        OutputFolder::claim(&path, true).unwrap().tidy();
        assert!(!exists(".sprung-energy.csv.part"));
    }

    /// A file can neither be claimed nor hold other files, and that is said in one way.
    #[test]
    fn a_file_is_no_folder() {
        let parent = tempfile::tempdir().unwrap();
        let file = parent.path().join("file");
        std::fs::write(&file, "").unwrap();
        let claimed = OutputFolder::claim(&file, false).map(|_| ()).unwrap_err();
        let written = AtomicFile::create(file.join("inside")).map(|_| ()).unwrap_err();
        assert_eq!(
            [claimed, written].map(|error| error.to_string()),
            [(); 2].map(|()| format!("{}: not a directory", file.display()))
        );
    }

    /// A file that is not there is removed already; one that cannot be removed is an error.
    #[test]
    fn what_cannot_be_removed_is_an_error() {
        let parent = tempfile::tempdir().unwrap();
        std::fs::create_dir(parent.path().join("final.json")).unwrap();
        let folder = OutputFolder::claim(parent.path(), false).unwrap();
        assert!(folder.remove("absent").is_ok() && folder.remove("final.json").is_err());
    }
}
