//! Linear systems solved as exactly as the motion needs: what that changes, and what it saves.

use crate::pair::{METHODS, Pair, pairs};
use crate::study::cases::WRONG;
use crate::study::store::Store;
use rayon::prelude::*;
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, TimeStepper};
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions, Tolerance};
use sprung::scene::builtin;
use std::path::Path;

/// A sample of `verification/exactness.md`: no run ends otherwise, differences are small parts of errors, and iterations are saved.
#[test]
fn what_solves_leave_does_not_show() {
    let store = Store::open(&Path::new(env!("CARGO_TARGET_TMPDIR")).join("references")).unwrap();
    let found: Vec<Pair> = (0..12u64).into_par_iter().flat_map(|i| pairs(20 * i + i % 2, &store).unwrap()).collect();
    for method in METHODS {
        let of_method: Vec<&Pair> = found.iter().filter(|pair| pair.method == method).collect();
        assert!(of_method.len() >= 30, "{}: {}", method.name(), of_method.len());
        for pair in &of_method {
            assert_eq!(pair.strict.status, pair.needed.status, "{}", pair.line());
            // Errors below 10⁻⁷ of the extent are nobody's concern.
            let error = pair.strict.error().max(1e-7);
            assert!(!pair.is_completed() || error > WRONG || pair.difference < error, "{}", pair.line());
        }
        let total = |i: usize| of_method.iter().map(|pair| pair.iterations[i]).sum::<u64>() as f64;
        assert!(total(1) < 0.8 * total(0), "{}: {} {}", method.name(), total(0), total(1));
        let mut shares: Vec<f64> =
            of_method.iter().filter(|p| p.is_completed()).map(|p| p.difference / p.strict.error().max(1e-7)).collect();
        shares.sort_by(f64::total_cmp);
        assert!(shares[shares.len() / 2] < 2e-3, "{}: {}", method.name(), shares[shares.len() / 2]);
    }
}

/// A lattice that is let go: the residuals asked for follow the errors of the steps, and a tolerance that is given stays.
#[test]
fn tolerances_follow_the_motion_or_stay() {
    let (system, start) = builtin::lattice(6).unwrap().build().unwrap();
    let run = |tolerance| {
        let (solver, preconditioner) = (SolverChoice::Cg, Some(PreconditionerKind::Multigrid));
        let linear = SolverOptions { solver, preconditioner, tolerance, ..SolverOptions::default() };
        let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
        let mut stepper = LinearBackwardEuler::new(&system, &start, &options).unwrap();
        let mut state = start.clone();
        (0..20).for_each(|_| stepper.step(&mut state, 0.01).unwrap());
        *stepper.statistics()
    };
    let (fixed, follows) = (run(Tolerance::Fixed(1e-9)), run(Tolerance::Adaptive));
    assert_eq!(fixed.max_tolerance, 1e-9);
    assert!((1e-6..=1e-4).contains(&follows.max_tolerance), "{}", follows.max_tolerance);
    assert!(follows.max_relative_residual <= follows.max_tolerance && follows.max_relative_residual > 1e-9);
    assert!(3 * follows.work.cg_iterations < 2 * fixed.work.cg_iterations);
}
