//! Every figure of the checks on small scenes is the one that was measured when it was looked at.
//!
//! A check that passes says that its value is below its bound; a slip in a check can leave it there. Value and bound, table, curves and
//! sentences are held to a list here: one test a family.

use crate::record::{Row, beside, hold};
use sprung::scene::{Kind, builtin};
use sprung::verify::{Check, Claim, FAMILIES, Results, Subject, built_in, verify};
use sprung::{Spring, SystemBuilder};

fn family(name: &str) {
    let family = FAMILIES.iter().find(|family| family.name == name).unwrap();
    let subjects = built_in().unwrap();
    hold(&format!("verify_{name}"), |seed| {
        let mut rows = Vec::new();
        for subject in subjects.iter().filter(|subject| (family.applies)(subject)) {
            for (number, check) in family.check(&beside(subject, seed)).iter().enumerate() {
                rows.push(Row::of(format!("{} {number}", subject.name), &serde_json::to_value(check).unwrap()));
            }
        }
        rows
    });
}

macro_rules! families {
    ($($name:ident)*) => { $(#[test] fn $name() { family(stringify!($name)); })* };
}

families!(
    jacobian dropped_terms derivatives work_energy assembly solvers linear_steps other_steps repeated options always_definite
    on_demand inertia order linear_momentum angular_momentum rigid_motion equilibrium ledger prescribed_motion in_space
    indefinite conjugate_gradients broken_states indicators
);

/// Nothing to pull, nothing that can move, ends in one place, and very many particles.
fn odd() -> Vec<Subject> {
    let chain = |name: &str, springs: bool, held: usize, apart: f64| {
        let mut builder = SystemBuilder::new();
        for p in 0..3 {
            builder.particle([apart * p as f64, 0.0, 0.1 * apart * (p * p) as f64], 1.0);
        }
        for p in (0..2).filter(|_| springs) {
            builder.spring(p, p + 1, Spring { stiffness: 10.0, rest_length: 0.9, damping: 0.1 });
        }
        for particle in 0..held {
            builder.hold(particle);
        }
        let (system, state) = builder.build().unwrap();
        Subject { name: name.into(), system, state, dt: 0.05 }
    };
    let mut broken = chain("ends in one place", true, 1, 1.0);
    broken.state.positions[2] = broken.state.positions[1];
    let large = |size| Subject::of_scene(&builtin(Kind::Cloth, size).unwrap()).unwrap();
    let all = [("no springs", false, 1), ("all held", true, 3), ("one free", true, 2), ("all free", true, 0)];
    let mut subjects: Vec<Subject> = all.map(|(name, springs, held)| chain(name, springs, held, 1.0)).into();
    subjects.extend([broken, large(12), large(30), large(60)]);
    subjects
}

/// Which families there are for a subject, and the step that resolves what it does.
#[test]
fn what_applies() {
    hold("verify_applies", |seed| {
        let subjects = odd().into_iter().chain(built_in().unwrap());
        let row = |subject: Subject| {
            let subject = beside(&subject, seed);
            let names: Vec<_> =
                FAMILIES.iter().filter(|family| (family.applies)(&subject)).map(|family| family.name).collect();
            let figures = (subject.resolving_step(), subject.extent(), subject.centre());
            Row::shown(format!("{} of {}", subject.name, subject.system.particles()), &(names, figures))
        };
        subjects.map(row).collect()
    });
}

/// What cannot be carried out is a failed check.
#[test]
fn odd_subjects() {
    hold("verify_odd", |seed| {
        let mut rows = Vec::new();
        for subject in odd().iter().take(5).map(|subject| beside(subject, seed)) {
            for (number, check) in verify(&subject).checks.iter().enumerate() {
                rows.push(Row::of(format!("{} {number}", subject.name), &serde_json::to_value(check).unwrap()));
            }
        }
        rows
    });
}

#[test]
fn claims_are_told() {
    hold("verify_claims", |_| {
        let told = |claim: Claim| (claim.id(), claim.title(), claim.formula(), claim.explanation());
        Claim::ALL.map(|claim| Row::shown(claim.id(), &told(claim))).into()
    });
}

#[test]
fn results_are_counted() {
    let check = |claim, value| Check::new(claim, "name", "scene", value, 2.0, "why");
    let [good, bad, none] = [check(Claim::Refill, 1.0), check(Claim::Jacobian, 3.0), check(Claim::Jacobian, f64::NAN)];
    let mut results: Results = [good.clone()].into_iter().collect();
    assert_eq!((results.passed(), results.failed(), results.all_passed()), (1, 0, true));
    results.extend([bad.clone(), none, bad.clone()]);
    assert_eq!((results.passed(), results.failed(), results.all_passed()), (1, 3, false));
    assert_eq!(results.failures().count(), 3);
    let claims: Vec<(Claim, usize)> = results.by_claim().iter().map(|(claim, checks)| (*claim, checks.len())).collect();
    assert_eq!(claims, [(Claim::Jacobian, 3), (Claim::Refill, 1)]);
    assert!(!Results::default().all_passed() && Results::default().by_claim().is_empty());
    assert_eq!((good.share(), bad.share()), (0.5, 1.5));
    let exact = |value| Check { bound: 0.0, ..check(Claim::Refill, value) };
    assert_eq!((exact(0.0).share(), exact(1e-300).share()), (0.0, f64::INFINITY));
    assert!(exact(0.0).passed() && !exact(1e-300).passed() && check(Claim::Refill, 2.0).passed());
    assert!(check(Claim::Refill, f64::NAN).share().is_nan());
    assert!(Check { bound: f64::NAN, ..good.clone() }.share().is_nan());
    for (value, bound) in
        [(f64::INFINITY, f64::INFINITY), (1.0, f64::INFINITY), (f64::NEG_INFINITY, 1.0), (1.0, f64::NAN)]
    {
        assert!(!Check { value, bound, ..good.clone() }.passed(), "{value} {bound}");
    }
}
