//! References on disk: a scene's is computed once.

use super::force::Model;
use super::reference::Reference;
use serde::{Deserialize, Serialize};
use sprung::Scene;
use std::path::{Path, PathBuf};

/// A folder of references by the content of their scenes.
#[derive(Debug, Clone)]
pub struct Store {
    folder: PathBuf,
}

/// A file of the folder.
#[derive(Serialize, Deserialize)]
struct Entry {
    /// The whole text that the reference belongs to: no two scenes are confused.
    scene: String,
    reference: Option<Reference>,
}

/// To be changed with anything that changes references.
const VERSION: &str = "2";

impl Store {
    /// In a folder, which is made.
    pub fn open(folder: &Path) -> std::io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        Ok(Self { folder: folder.into() })
    }

    /// The reference of a scene, from disk or computed; `None` where there is none.
    ///
    /// # Errors
    /// A scene that does not build.
    pub fn reference(&self, scene: &Scene, duration: f64) -> sprung::Result<Option<Reference>> {
        let text = format!("{VERSION} {duration:e} {}", scene.to_json());
        let file = self.folder.join(format!("{:016x}.json", fingerprint(&text)));
        let kept = std::fs::read_to_string(&file).ok().and_then(|kept| serde_json::from_str::<Entry>(&kept).ok());
        if let Some(entry) = kept.filter(|entry| entry.scene == text) {
            return Ok(entry.reference);
        }
        let (system, start) = scene.build()?;
        let reference = Reference::compute(&Model::new(&system, &start), system.springs().len(), duration);
        let entry = Entry { scene: text, reference };
        // A reference that cannot be kept is computed again next time.
        if let Ok(json) = serde_json::to_string(&entry) {
            let _ = std::fs::write(&file, json);
        }
        Ok(entry.reference)
    }
}

/// FNV-1a: the same on every machine and with every version of the compiler.
pub fn fingerprint(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
