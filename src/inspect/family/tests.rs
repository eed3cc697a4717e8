//! Bounds and directions by hand.

use super::Family;
use crate::assembly::SpringPattern;
use crate::force::Extensions;
use crate::inspect::CriticalSteps;
use crate::inspect::Property::{Definite, Stable};
use crate::inspect::fixtures::{Pin, pin, pinned};
use crate::inspect::tests::chain;
use crate::integrate::StepMatrices;
use crate::linear::Ldlt;
use crate::spring::{Spring, Stiffness};
use crate::system::{State, System, SystemBuilder};
use crate::work::Work;
use faer::Par;
use nalgebra::DMatrix;

const FULL: Stiffness = Stiffness::Full;

fn family((system, state): &(System, State)) -> Family<'_> {
    Family::new(system, Extensions::at(system, &state.positions).unwrap())
}

fn analysed(system: &System) -> Ldlt {
    Ldlt::analyse(SpringPattern::of_stiffness(system).unwrap().pattern(), Par::Seq).unwrap()
}

/// 2 kg between two springs each, of 40 N/m along and −10 N/m across.
#[test]
fn bounds_are_those_by_hand() {
    let held = chain(3, 1.25);
    let mut family = family(&held);
    for (requirement, of_masses, definite_from) in [(Definite, 18.0, 20f64), (Stable, 72.0, 5.0)] {
        family.set(requirement, FULL, 0.0);
        assert!((family.norm_bound(3.0, requirement) - of_masses - 160.0).abs() < 1e-12);
        let expected = definite_from.sqrt() * 1.000001;
        assert!((family.surely_definite(requirement) / expected - 1.0).abs() < 1e-14);
    }
}

/// Walls of 1 kg weigh nothing in P(2) = diag(4·10⁻³ − 2): their rows are not in it. Its block has a norm of 2 N/m.
#[test]
fn what_is_held_has_no_norm() {
    let held = pinned(&[pin(1e-3, 2.0)]);
    let mut family = family(&held);
    family.set(Definite, FULL, 0.0);
    assert!((family.norm_bound(2.0, Definite) - 4.004).abs() < 1e-12);
}

/// P(3) is diag(24, 6) for 4 kg and 1 kg: of (1, 2) what is left is (12, 12), weighted, of a motion of 18 times (2, 2).
#[test]
fn residuals_are_those_by_hand() {
    let held = pinned(&[pin(4.0, 12.0), pin(1.0, 3.0)]);
    let mut family = family(&held);
    family.set(Definite, FULL, 3.0);
    assert!((family.residual(&[1.0, 2.0]) - 1.0 / 3.0).abs() < 1e-14);
}

/// Where all other eigenvalues are equal, what is told is how far the square of the root is short of that of the limit, exactly.
#[test]
fn how_far_the_limit_is_can_be_told() {
    let mass = |p: usize| 1.0 + (p % 3) as f64;
    let pins: Vec<Pin> = (0..20).map(|p| pin(mass(p), mass(p) * if p == 0 { 4.0 } else { 1.0 })).collect();
    let held = pinned(&pins);
    let mut family = family(&held);
    let mut factorization = analysed(&held.0);
    for (requirement, limit) in [(Definite, 4.0), (Stable, 1.0)] {
        let part = |p: usize| if p == 0 { 1.0 } else { 0.06 };
        let mut u: Vec<f64> = (0..20).map(|p| part(p) / mass(p).sqrt()).collect();
        let mut work = Work::default();
        let told = family.soften(requirement, FULL, &mut factorization, &mut u, 1e9, &mut work);
        let s = family.curvature(requirement, FULL, &u).root().unwrap();
        assert!((told / ((limit - s * s) / (2.0 * s * s)) - 1.0).abs() < 1e-9, "{told} {s}");
        assert!(told > 1e-4 && work == Work::default());
    }
}

/// Of a long chain of light and heavy particles the lowest eigenvalues lie too close for a search of twelve steps, but one that begins with the
/// eigenvector ends there.
#[test]
fn a_search_may_begin_with_what_is_known() {
    let (free, mass) = (120, |p: usize| if p.is_multiple_of(2) { 4.0 } else { 1.0 });
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for p in 0..free + 2 {
        builder.particle([p as f64, 0.0, 0.0], mass(p));
    }
    for p in 0..=free {
        builder.spring(p, p + 1, Spring { stiffness: 50.0, rest_length: 1.25, damping: 0.0 });
    }
    builder.hold(0);
    builder.hold(free + 1);
    let held = builder.build().unwrap();
    // −10 N/m across every spring, weighted by the masses.
    let weighted = DMatrix::from_fn(free, free, |r, c| {
        let stiffness = [-20.0, 10.0].get(r.abs_diff(c)).copied().unwrap_or(0.0);
        stiffness / (mass(r + 1) * mass(c + 1)).sqrt()
    });
    let eigen = weighted.symmetric_eigen();
    let lowest = eigen.eigenvalues.imin();
    let mut start = vec![0.0; 2 * free];
    for p in 0..free {
        start[2 * p + 1] = eigen.eigenvectors[(p, lowest)] / mass(p + 1).sqrt();
    }
    let mut family = family(&held);
    let mut quotient = |start: &[f64]| {
        family.set(Definite, FULL, 0.0);
        let found = family.softest_direction(start);
        let along = family.curvature(Definite, FULL, &found);
        along.constant / along.mass / eigen.eigenvalues[lowest]
    };
    assert!((quotient(&start) - 1.0).abs() < 1e-12);
    assert!(quotient(&[]) < 1.0 - 1e-9);
}

/// From a direction, with P a little above the limit factored: how far it is told to be, the root, as a part of the limit, and the solves.
fn softened(held: &(System, State), start: Option<Vec<f64>>, enough: f64) -> (f64, f64, u64) {
    let mut steps = CriticalSteps::new(&held.0, &held.1, Par::Seq).unwrap();
    let limit = steps.largest_step(Definite, FULL).dt().unwrap();
    let a = StepMatrices::assemble(&held.0, &held.1, FULL, 0.96 * limit).unwrap().a;
    let mut factorization = analysed(&held.0);
    factorization.factor(&a).unwrap();
    let mut family = family(held);
    family.set(Definite, FULL, 0.0);
    let mut u = start.unwrap_or_else(|| family.softest_direction(&[]));
    let mut work = Work::default();
    let told = family.soften(Definite, FULL, &mut factorization, &mut u, enough, &mut work);
    (told, limit * family.curvature(Definite, FULL, &u).root().unwrap(), work.solves)
}

/// Sixty eigenvalues, a hundredth apart: how many solves bring the root to the limit.
#[test]
fn a_few_solves_bring_the_root_to_the_limit() {
    let pins: Vec<Pin> = (0..60).map(|p| pin(1.0, 4.0 - 0.04 * p as f64)).collect();
    let (told, root, solves) = softened(&pinned(&pins), Some(vec![1.0; 60]), 1e-13);
    assert!(told <= 1e-13 && (root - 1.0).abs() < 1e-12, "{told:e} {root}");
    assert_eq!(solves, 36);
}

/// A crooked chain whose springs are ten million times as stiff along as across: the rounding of what is along hides how near the root is, but it
/// rises no more.
#[test]
fn a_root_that_rises_no_more_is_there() {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let mut at = [0.0, 0.0];
    for p in 0..42 {
        builder.particle([at[0], at[1], 0.0], 1.0 + (p % 3) as f64);
        let angle = 0.05 * ((3 * p) % 7) as f64;
        at = [at[0] + f64::cos(angle), at[1] + f64::sin(angle)];
    }
    for p in 0..41 {
        builder.spring(p, p + 1, Spring { stiffness: 1e8, rest_length: 1.0 + 1e-7, damping: 0.0 });
    }
    builder.hold(0);
    builder.hold(41);
    let (told, root, solves) = softened(&builder.build().unwrap(), None, 1e-10);
    assert!(told == 1e-10 && (root - 1.0).abs() < 1e-8 && solves < 30, "{told:e} {root} {solves}");
}
