//! The checks that run on any scene, on the suite's scenes.

use crate::collect::{Collector, slug};
use libtest_mimic::Trial;
use sprung::Scene;
use sprung::verify::{FAMILIES, Subject};
use std::path::Path;
use std::sync::Arc;

/// One test for every family and every scene that it applies to.
pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let subjects: Vec<Arc<Subject>> = subjects().into_iter().map(Arc::new).collect();
    let mut trials = Vec::new();
    for family in FAMILIES {
        for subject in subjects.iter().filter(|subject| (family.applies)(subject)) {
            let name = format!("{}::{}::{}", family.claim.id().replace('-', "_"), family.name, slug(&subject.name));
            let subject = subject.clone();
            trials.push(collector.trial(family.claim, name, move || family.check(&subject)));
        }
    }
    trials
}

/// Every scene file beside this one, by name.
fn subjects() -> Vec<Subject> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("verification/scenes");
    let mut files: Vec<_> = folder
        .read_dir()
        .expect("the folder of scenes")
        .map(|entry| entry.expect("an entry of the folder of scenes").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    files.sort();
    let subject = |file| Subject::of_scene(&Scene::load(file)?);
    files.iter().map(|file| subject(file).expect("a usable scene")).collect()
}
