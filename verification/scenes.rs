//! The checks that run on any scene, on the suite's scenes.

use crate::collect::{Collector, slug};
use libtest_mimic::Trial;
use sprung::Scene;
use sprung::verify::{FAMILIES, Subject, built_in};
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

/// The scenes that the program carries, and one too large to be carried.
fn subjects() -> Vec<Subject> {
    let bunny = Path::new(env!("CARGO_MANIFEST_DIR")).join("verification/scenes/bunny.toml");
    let bunny = Scene::load(bunny).and_then(|scene| Subject::of_scene(&scene));
    let mut subjects = built_in().expect("usable scenes");
    subjects.push(bunny.expect("a usable scene"));
    subjects
}
