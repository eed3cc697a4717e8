//! A scene in files of which every rank reads its own share.

use crate::load::Source;
use crate::{Stop, files, ranks};
use std::path::PathBuf;

/// Write a scene in a form of which every rank reads its share
#[derive(Debug, clap::Args)]
pub struct Split {
    #[command(flatten)]
    source: Source,

    /// Folder for the files, made where it does not exist [default: <scene name>.split]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Split {
    /// Runs the command.
    ///
    /// # Errors
    /// Why not, on all ranks.
    pub fn execute(&self) -> Result<(), Stop> {
        let (header, slab) = self.source.load(u64::MAX)?;
        let folder = self.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.split", header.name)));
        let (particles, springs) = (header.particles, header.springs);
        files::write(&folder, header, &slab)?;
        if ranks::rank() == 0 {
            println!("{}: {particles} particles, {springs} springs", folder.display());
        }
        Ok(())
    }
}
