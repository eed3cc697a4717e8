//! Which families apply to which subjects, and what is said of those that find nothing.

use super::*;
use crate::spring::Spring;
use crate::system::SystemBuilder;

/// Two particles in a plane, joined or not, the first one held or both.
fn pair(joined: bool, held: &[usize]) -> TestCase {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let ends = [builder.particle([0.0; 3], 1.0), builder.particle([1.5, 0.5, 0.0], 2.0)];
    if joined {
        builder.spring(ends[0], ends[1], Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.1 });
    }
    held.iter().for_each(|&particle| {
        builder.hold(particle);
    });
    let (system, state) = builder.build().unwrap();
    TestCase { name: "pair".into(), system, state, dt: 0.01 }
}

fn applying(subject: &TestCase) -> Vec<&'static str> {
    FAMILIES.iter().filter(|family| (family.applies)(subject)).map(|family| family.name).collect()
}

/// Between held particles a spring neither pulls nor moves anything; without one there is nothing to differentiate.
#[test]
fn families_apply_where_there_is_something_to_check() {
    let lacks = |subject: &TestCase, names: &[&str]| names.iter().all(|name| !applying(subject).contains(name));
    let moving =
        ["assembly", "solvers", "linear_steps", "other_steps", "always_definite", "on_demand", "inertia", "ledger"];
    let pulled = ["jacobian", "dropped_terms", "derivatives", "conjugate_gradients", "broken_states"];
    let jointed = ["work_energy", "options"];
    let free = pair(true, &[0]);
    let both = ["rigid_motion"];
    assert!([&moving[..], &pulled, &jointed, &both].concat().iter().all(|name| applying(&free).contains(name)));
    let stuck = pair(true, &[0, 1]);
    assert!(lacks(&stuck, &moving) && lacks(&stuck, &pulled) && lacks(&stuck, &both));
    assert!(jointed.iter().all(|name| applying(&stuck).contains(name)) && verify(&stuck).all_passed());
    let apart = pair(false, &[0]);
    assert!(lacks(&apart, &pulled) && lacks(&apart, &jointed) && lacks(&apart, &both) && lacks(&apart, &["ledger"]));
    // Where there is nothing there is nothing to find wrong.
    let (system, state) = SystemBuilder::new().build().unwrap();
    let empty = TestCase { name: "empty".into(), system, state, dt: 0.01 };
    assert!(lacks(&empty, &["equilibrium", "rigid_motion"]) && verify(&empty).all_passed());
    assert!(moving[..7].iter().all(|name| applying(&apart).contains(name)));
    // One coordinate alone is no system of equations.
    let mut single = pair(true, &[0]);
    single.system = {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        let ends = [builder.particle([0.0; 3], 1.0), builder.particle([1.5, 0.0, 0.0], 2.0)];
        builder.spring(ends[0], ends[1], Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.1 });
        builder.hold(ends[0]);
        builder.build().unwrap().0
    };
    assert!(lacks(&single, &["conjugate_gradients", "broken_states"]));
}

/// A plane is flat, and so is a line; space is not.
#[test]
fn flat_scenes_are_compared_with_their_twins_in_space() {
    let flat = pair(true, &[0]);
    assert!(applying(&flat).contains(&"in_space") && !applying(&flat.in_space().unwrap()).contains(&"in_space"));
}

/// Free particles can turn in a plane and in space, and not along a line.
#[test]
fn nothing_turns_along_a_line() {
    let turns = |dimension: usize| {
        let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
        let ends = [builder.particle([0.0; 3], 1.0), builder.particle([1.5, 0.0, 0.0], 2.0)];
        builder.spring(ends[0], ends[1], Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.1 });
        let (system, state) = builder.build().unwrap();
        applying(&TestCase { name: "pair".into(), system, state, dt: 0.01 }).contains(&"angular_momentum")
    };
    assert_eq!([turns(1), turns(2), turns(3)], [false, true, true]);
}

#[test]
fn a_family_that_measures_nothing_fails() {
    let nothing = family(Claim::Solvers, "nothing", always, of_steps, |_| Ok(Vec::new()));
    let checks = nothing.check(&pair(true, &[0]));
    assert_eq!((checks.len(), checks[0].why.as_str(), checks[0].passed()), (1, "nothing was measured", false));
    let broken = family(Claim::Solvers, "broken", always, of_steps, |_| {
        Err(crate::error::Error::Unsupported("not here".into()).into())
    });
    assert!(broken.check(&pair(true, &[0]))[0].why.starts_with("could not be carried out: "));
}

#[test]
fn a_pendulum_passes_every_family_that_applies() {
    let subject = pair(true, &[0]);
    let results = verify(&subject);
    assert!(results.all_passed(), "{:?}", results.failures().map(|check| &check.name).collect::<Vec<_>>());
    let claims = results.by_claim();
    assert!(claims.iter().any(|(claim, _)| *claim == Claim::Jacobian) && claims.len() > 5);
}

/// A step that reports its failure is no accusation of anybody; scenes of the suite's own are all judged.
#[test]
fn reported_failures_are_not_judged() {
    let reported =
        family(Claim::Solvers, "reported", always, of_steps, |_| Err(crate::integrate::StepFailure::NonFinite.into()));
    let checks = reported.check(&pair(true, &[0]));
    assert!(!checks[0].is_judged && checks[0].why.contains("said so"), "{}", checks[0].why);
}

#[cfg(feature = "scene")]
#[test]
fn the_suite_has_no_scene_beyond_judgement() {
    for subject in crate::verify::built_in().unwrap() {
        assert_eq!(of_steps(&subject), None, "{}", subject.name);
    }
}
