//! Scenes with names: hard cases from files, and ready scenes.

use sprung::Scene;
use sprung::scene::{Kind, builtin};
use std::path::Path;

/// The hard cases of `verification/scenes/hard` and ready scenes small enough to be run hundreds of times.
///
/// # Errors
/// A file that cannot be read.
pub fn scenes() -> sprung::Result<Vec<Scene>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/hard");
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .map_err(|source| sprung::Error::Io { path: folder, source })?
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml" || extension == "json"))
        .collect();
    files.sort();
    let mut scenes: Vec<Scene> = files.iter().map(Scene::load).collect::<Result<_, _>>()?;
    let ready = [
        (Kind::Lattice, &[2, 3, 4, 5][..]),
        (Kind::Cloth, &[4, 6, 10]),
        (Kind::Chain, &[3, 10]),
        (Kind::Column, &[5, 9]),
        (Kind::Pendulum, &[1, 2]),
        (Kind::String, &[7, 31]),
        (Kind::Network, &[20]),
    ];
    for (kind, sizes) in ready {
        for &size in sizes {
            let mut scene = builtin(kind, size)?;
            scene.name = format!("{}-of-{size}", kind.name());
            scenes.push(scene);
        }
    }
    for scene in &mut scenes {
        scene.time.dt = None;
    }
    Ok(scenes)
}
