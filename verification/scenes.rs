//! The checks that run on any scene, on the suite's scenes.

use crate::collect::{Collector, slug};
use libtest_mimic::Trial;
use sprung::Scene;
use sprung::scene::builtin::cloth;
use sprung::verify::{FAMILIES, TestCase, built_in};
use std::path::Path;
use std::sync::Arc;

/// One test for every family and every scene that it applies to.
pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let subjects: Vec<Arc<TestCase>> = subjects().into_iter().map(Arc::new).collect();
    let mut trials = Vec::new();
    for family in FAMILIES {
        for subject in subjects.iter().filter(|subject| (family.applies)(subject)) {
            let name = format!("{}::{}::{}", family.claim.id().replace('-', "_"), family.name, slug(&subject.name));
            let subject = subject.clone();
            trials.push(collector.trial(family.claim, name, move || family.check(&subject)));
        }
    }
    let large = Arc::new(large());
    for family in FAMILIES.iter().filter(|family| ["assembly", "repeated"].contains(&family.name)) {
        let name = format!("{}::{}::{}", family.claim.id(), family.name, slug(&large.name));
        let large = large.clone();
        trials.push(collector.trial(family.claim, name, move || family.check(&large)));
    }
    trials
}

/// A cloth of 4096 particles and 24 000 springs: large enough for work to be shared out among threads.
fn large() -> TestCase {
    let cloth = cloth(64).and_then(|scene| TestCase::of_scene(&scene)).expect("a usable scene");
    TestCase { name: "large cloth".into(), ..cloth }
}

/// The scenes that the program carries, and one too large to be carried.
fn subjects() -> Vec<TestCase> {
    let bunny = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/bunny.toml");
    let bunny = Scene::load(bunny).and_then(|scene| TestCase::of_scene(&scene));
    let mut subjects = built_in().expect("usable scenes");
    subjects.push(bunny.expect("a usable scene"));
    subjects
}
