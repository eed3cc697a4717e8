//! Sources of scenes: a file that rank 0 reads and distributes, a split scene, or a formula.

use crate::agreed::agreed;
use crate::slab::{self, Header, Slab};
use crate::{Stop, files, ready};
use sprung::scene::Scene;
use std::path::PathBuf;

/// The scene that a command works on.
#[derive(Debug, clap::Args)]
pub struct Source {
    /// The scene: a TOML or JSON file, which rank 0 reads, or a folder that `sprung-mpi split` wrote, of which every rank reads its
    /// share
    #[arg(value_name = "SCENE", required_unless_present = "ready")]
    path: Option<PathBuf>,

    /// In place of a file a ready cloth or lattice, of which every rank makes its share; needs --size
    #[arg(long, value_name = "KIND", requires = "size", conflicts_with = "path")]
    ready: Option<ready::Kind>,

    /// Size of a ready scene, see `sprung new`; here there is no largest one
    #[arg(long, value_name = "N")]
    size: Option<u64>,
}

impl Source {
    /// This rank's share of the scene, and what all know of it. The matrix may have so many rows at most.
    ///
    /// # Errors
    /// What is wrong with it, on all ranks.
    pub fn load(&self, most: u64) -> Result<(Header, Slab), Stop> {
        if let (Some(kind), Some(size)) = (self.ready, self.size) {
            return ready::make(kind, size, most).map_err(Stop::Unusable);
        }
        let path = self.path.clone().unwrap_or_default();
        if agreed(|| Ok(path.is_dir()))? {
            return files::read(&path, most);
        }
        let mut whole = None;
        agreed(|| {
            let scene = Scene::load(&path).map_err(|error| error.to_string())?;
            let (system, state) = scene.build().map_err(|error| error.in_file(&path).to_string())?;
            slab::check_rows(system.particles() as u64, system.dimension(), most)?;
            whole = Some(slab::whole(&scene, &scene.time, &system, &state));
            Ok(true)
        })?;
        Ok(slab::share_out(whole))
    }

    /// The folder of results that nobody named.
    pub fn folder(&self, header: &Header) -> PathBuf {
        PathBuf::from("out").join(header.name.split_whitespace().collect::<Vec<_>>().join("-"))
    }
}
