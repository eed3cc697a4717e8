//! Some scenes of the page on equilibria, mechanisms and modes, and its closed forms.

use crate::statics::{answers, equilibria, frameworks, scenes, vibrations};

/// No verdict is contradicted by a second method, and nearly all searches arrive.
#[test]
fn equilibria_of_random_scenes() {
    let records = equilibria::records(0..60, 60);
    let wrong: Vec<_> = records.iter().filter(|record| !record.wrong.is_empty()).map(|r| (r.seed, &r.wrong)).collect();
    assert!(wrong.is_empty(), "{wrong:?}");
    assert!(records.iter().filter(|record| record.is_unfinished()).count() <= 1);
    let kinds: std::collections::BTreeSet<_> = records.iter().map(|record| record.kind).collect();
    assert_eq!(kinds.len(), scenes::KINDS.len());
    let judged = records.iter().filter(|record| record.motion.is_some()).count();
    assert!(judged > 20, "{judged} damped motions");
}

/// Ranks, motions, self-stresses and added springs.
#[test]
fn frameworks_have_the_rank_of_their_singular_values() {
    let all = frameworks::all(0..60, false);
    let mut undecided = 0;
    for (seed, judged) in &all {
        let judged = judged.as_ref().unwrap();
        assert!(judged.wrong.is_empty(), "{seed}: {:?}", judged.wrong);
        undecided += usize::from(!judged.decided);
    }
    assert!((1..10).contains(&undecided), "{undecided} undecided");
    for known in frameworks::known() {
        let (found, is_right) = frameworks::is_right(&known).unwrap();
        assert!(is_right, "{}: rank {}, {:?}", known.name, found.rank, found.prestress_stable);
    }
}

#[test]
fn modes_of_planted_scenes() {
    for (seed, judged) in vibrations::all(0..60) {
        let judged = judged.unwrap();
        assert!(judged.wrong.is_empty(), "{seed}: {:?}", judged.wrong);
    }
}

#[test]
fn closed_forms() {
    let section = answers::section();
    assert_eq!(section.failures, 0, "{}", section.text);
}
