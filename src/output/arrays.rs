//! Arrays of a `trajectory.npz` that is read.

use npyz::{Deserialize, NpyFile};
use std::fs::File;
use std::io::{self, BufReader};
use zip::ZipArchive;
use zip::read::ZipFile;

/// The file.
pub type Archive = ZipArchive<BufReader<File>>;

/// The array of a name, to be read as a stream.
pub fn array<'a>(archive: &'a mut Archive, name: &str) -> io::Result<NpyFile<BufReader<ZipFile<'a, BufReader<File>>>>> {
    let entry = archive.by_name(&format!("{name}.npy")).map_err(|error| wrong(&format!("{name}: {error}")))?;
    NpyFile::new(BufReader::with_capacity(1 << 18, entry))
}

/// The numbers of an array.
pub fn list<T: Deserialize>(archive: &mut Archive, name: &str) -> io::Result<Vec<T>> {
    array(archive, name)?.into_vec()
}

/// What is wrong with the file.
pub fn wrong(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}
