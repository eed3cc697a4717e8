//! Which methods are run with which matrix, and what a refused step is.

use super::*;
use crate::spring::Spring;
use crate::system::SystemBuilder;
use nalgebra::Vector3;

/// A particle of 1 kg, 1 m from a held one, on a spring that is 4 m long at rest: across it `k (1/l0 − 1/l)` is −75 N/m, more than
/// 1/dt² can hold.
fn pushed() -> Subject {
    let mut builder = SystemBuilder::new();
    let (anchor, bob) = (builder.particle([0.0; 3], 1.0), builder.particle([1.0, 0.0, 0.0], 1.0));
    builder.spring(anchor, bob, Spring { stiffness: 100.0, rest_length: 4.0, damping: 0.0 });
    builder.hold(anchor);
    let (system, state) = builder.build().unwrap();
    Subject { name: "pushed".into(), system, state, dt: 1.0 }
}

#[test]
fn every_method_is_run_and_linear_ones_under_every_option() {
    let names: Vec<String> = Way::of(&pushed()).map(Way::name).collect();
    let mut expected = Vec::new();
    for method in Method::ALL {
        if ["linear-backward-euler", "bdf2", "w2"].contains(&method.name()) {
            expected
                .extend(["full", "tension", "axial", "on-demand"].map(|option| format!("{}, {option}", method.name())));
        } else {
            expected.push(method.name().to_owned());
        }
    }
    assert_eq!(names, expected);
    let nonlinear: Vec<&str> =
        Way::of(&pushed()).filter(|way| way.is_nonlinear()).map(|way| way.method.name()).collect();
    assert_eq!(nonlinear, ["backward-euler", "implicit-midpoint"]);
}

/// Of more than ten thousand coordinates one implicit way and one explicit one.
#[test]
fn large_subjects_are_run_by_two_methods() {
    let names = |particles: usize| {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        (0..particles).for_each(|n| {
            builder.particle([n as f64, 0.0, 0.0], 1.0);
        });
        let (system, state) = builder.build().unwrap();
        Way::of(&Subject { name: "large".into(), system, state, dt: 1.0 }).map(Way::name).collect::<Vec<_>>()
    };
    assert_eq!(names(10_001), ["linear-backward-euler, tension", "verlet"]);
    assert!(names(10_000).len() > 2);
}

/// Explicit methods take no longer a step than resolves all motion: here `ω² ≤ 2 · 100`.
#[test]
fn explicit_methods_take_short_steps() {
    let way = |method| Way { method, stiffness: StiffnessPolicy::OnDemand };
    let (long, short) = (pushed(), Subject { dt: 1e-3, ..pushed() });
    assert_eq!([way(Method::BackwardEuler).step(&long), way(Method::Verlet).step(&short)], [1.0, 1e-3]);
    assert_eq!(way(Method::Verlet).step(&long), long.resolving_step());
    assert!((long.resolving_step() - 0.5 / 200f64.sqrt()).abs() < 1e-15);
}

#[test]
fn steps_may_be_refused_under_the_full_stiffness_only() {
    let refused = |method, stiffness| Way { method, stiffness }.may_be_refused();
    let always = StiffnessPolicy::Always;
    assert!(refused(Method::LinearBackwardEuler, always(Stiffness::Full)));
    assert!(refused(Method::Rodas4, StiffnessPolicy::OnDemand));
    assert!(!refused(Method::LinearBackwardEuler, always(Stiffness::Tension)));
    assert!(!refused(Method::LinearBackwardEuler, StiffnessPolicy::OnDemand));
}

/// An indefinite matrix ends a run that may end so; a state that is no number ends every run with that as the reason.
#[test]
fn only_indefinite_matrices_are_refusals() {
    let subject = pushed();
    let run = |option, subject: &Subject| Way::notes(option).run(subject, direct(), subject.dt, 2);
    assert!(run(Stiffness::Full, &subject).unwrap().is_none());
    assert_eq!(run(Stiffness::Tension, &subject).unwrap().map(|states| states.len()), Some(3));
    let mut broken = Subject { dt: 0.01, ..pushed() };
    broken.state.velocities[1].x = f64::NAN;
    assert!(run(Stiffness::Full, &broken).is_err() && run(Stiffness::Tension, &broken).is_err());
    assert_eq!(direct().solver, SolverChoice::Llt);
}

/// Plus and minus zero are the same number, NaN is itself; runs of different lengths, or of which one was refused, differ in everything.
#[test]
fn differences_are_counted_in_bits() {
    let states = |numbers: &[f64]| {
        let vectors = |sign: f64| numbers.iter().map(|&x| Vector3::new(x, sign * x, 1.0)).collect();
        Some(vec![State { time: 0.0, positions: vectors(1.0), velocities: vectors(-1.0) }])
    };
    assert_eq!(differences(&states(&[0.0, 2.0]), &states(&[-0.0, 2.0])), 0.0);
    assert_eq!(differences(&states(&[1.0, 2.0]), &states(&[1.5, 2.0])), 4.0);
    assert_eq!(differences(&states(&[1.0]), &states(&[1.0, 2.0])), f64::INFINITY);
    assert_eq!(
        [differences(&None, &None), differences(&None, &states(&[])), differences(&states(&[]), &None)],
        [0.0, f64::INFINITY, f64::INFINITY]
    );
}
