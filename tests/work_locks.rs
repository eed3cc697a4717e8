//! The work of whole runs is locked: every built-in scene with every method and solver, and with error control.
//!
//! `work_locks.txt` holds a row for each run. A change that makes runs do more, or a controller steer otherwise, shows
//! here as a changed row although all results stay within their bounds. `SPRUNG_RENEW= cargo test --test work_locks`
//! writes the table anew, `SPRUNG_RENEW=w2,cg` the rows whose names contain one of these; the difference belongs into the change that
//! makes it.

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use sprung::integrate::*;
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions};
use sprung::scene::{Kind, builtin};
use sprung::{State, Stiffness, System};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::ops::ControlFlow;

const NAMES: &str = "steps rejected forces assemblies analyses factorizations solves cg warm multigrid newton softened \
                     dropped indefinite";

/// The counts of a run, in the order of `NAMES`.
fn counts(steps: u64, of: &Statistics) -> Vec<u64> {
    let work = &of.work;
    vec![
        steps,
        of.rejected_steps,
        work.force_evaluations,
        work.assemblies,
        work.symbolic_factorizations,
        work.factorizations,
        work.solves,
        work.cg_iterations,
        work.warm_starts,
        work.multigrid_setups,
        work.newton_iterations,
        of.softened_solves,
        of.dropped_terms,
        of.indefinite_solves,
    ]
}

fn with(
    solver: SolverChoice,
    preconditioner: Option<PreconditionerKind>,
    stiffness: StiffnessPolicy,
) -> ImplicitOptions {
    ImplicitOptions { stiffness, linear: SolverOptions { solver, preconditioner, ..Default::default() } }
}

/// Twelve steps of fixed length.
fn fixed((system, start): &(System, State), method: Method, dt: f64, options: &ImplicitOptions) -> Vec<u64> {
    let mut state = start.clone();
    let mut stepper = method.stepper(system, &state, options).unwrap();
    assert_eq!((stepper.name(), stepper.linear_solver().is_some()), (method.name(), method.is_implicit()));
    let outcome = run(&mut *stepper, &mut state, &Schedule::steps(dt, 12), |_, _| ControlFlow::Continue(()));
    assert!((state.time - outcome.steps as f64 * dt).abs() < 1e-12, "{} at {}", method.name(), state.time);
    counts(outcome.steps, stepper.statistics())
}

/// A run with error control, and last the number of samples.
fn controlled(
    (system, start): &(System, State),
    method: Method,
    rtol: f64,
    sampling: Sampling,
    options: &ImplicitOptions,
) -> Vec<u64> {
    let mut state = start.clone();
    let mut stepper = method.adaptive_stepper(system, &state, options).unwrap().unwrap();
    let how = Adaptivity { duration: 0.4, rtol, first_step: Some(0.01), sampling, part_of: None };
    let mut observed = 0;
    let outcome = run_adaptive(&mut *stepper, system, &mut state, &how, |_, _| {
        observed += 1;
        ControlFlow::Continue(())
    });
    let mut counts = counts(outcome.steps, stepper.statistics());
    counts.push(observed);
    counts
}

type Run = Box<dyn Fn(&(System, State)) -> Vec<u64> + Sync + Send>;

/// What is done with every scene, with a name.
fn runs() -> Vec<(String, Run)> {
    let policies = [Stiffness::Full.into(), Stiffness::Tension.into(), StiffnessPolicy::OnDemand];
    let mut runs: Vec<(String, Run)> = Vec::new();
    for method in Method::ALL {
        for (dt, policy) in [1e-3, 0.02, 0.1].into_iter().flat_map(|dt| policies.map(|policy| (dt, policy))) {
            if method.takes_stiffness() || policy == StiffnessPolicy::OnDemand {
                let options = with(SolverChoice::Llt, None, policy);
                let name = format!("{} {dt} {policy:?}", method.name());
                runs.push((name, Box::new(move |scene| fixed(scene, method, dt, &options))));
            }
        }
    }
    for solver in [SolverChoice::Auto, SolverChoice::Ldlt, SolverChoice::Cg, SolverChoice::CgAssembled] {
        for preconditioner in [None, Some(PreconditionerKind::Jacobi), Some(PreconditionerKind::Multigrid)] {
            for method in [Method::LinearBackwardEuler, Method::BackwardEuler, Method::W2] {
                let options = with(solver, preconditioner, StiffnessPolicy::OnDemand);
                let name = format!("{} 0.02 {} {preconditioner:?}", method.name(), solver.name());
                runs.push((name, Box::new(move |scene| fixed(scene, method, 0.02, &options))));
            }
        }
    }
    for (rtol, sampling) in [1e-1, 1e-2].into_iter().flat_map(|r| [(r, Sampling::Steps), (r, Sampling::Every(0.03))]) {
        for policy in policies {
            let options = with(SolverChoice::Llt, None, policy);
            let name = format!("controlled {rtol} {sampling:?} {policy:?}");
            runs.push((name, Box::new(move |scene| controlled(scene, Method::W2, rtol, sampling, &options))));
        }
    }
    let others = Method::ALL.into_iter().filter(|&method| method.estimates_errors() && method != Method::W2);
    for (method, rtol) in others.flat_map(|method| [1e-1, 1e-2].map(|rtol| (method, rtol))) {
        let options = with(SolverChoice::Llt, None, StiffnessPolicy::OnDemand);
        let name = format!("controlled {} {rtol}", method.name());
        runs.push((name, Box::new(move |scene| controlled(scene, method, rtol, Sampling::Steps, &options))));
    }
    runs
}

/// A scene of a kind, small.
fn scene(kind: Kind) -> (System, State) {
    let size = if kind == Kind::Lattice { 4 } else { kind.default_size().min(12) };
    builtin(kind, size).unwrap().build().unwrap()
}

/// Whether counts are the same, but for an iteration: the width of the processor's vectors decides about roundings, and
/// these about an iteration now and then.
fn alike(found: &[u64], locked: &[u64]) -> bool {
    let near = |(&a, &b): (&u64, &u64)| a.abs_diff(b) <= if a.min(b) > 24 { 1 + a.max(b) / 50 } else { 0 };
    found.len() == locked.len() && found.iter().zip(locked).all(near)
}

/// The table: runs whose work disturbances of 1e-9 of the positions do not change, because roundings would decide about
/// others. Rows whose name has none of the `parts` are as in the `old` table.
fn table(parts: &str, old: &str) -> String {
    let mut text = format!("# {NAMES}\n");
    let kept: HashMap<&str, &str> = old.lines().filter_map(|line| line.split_once(": ")).collect();
    for kind in Kind::ALL {
        let scene = scene(kind);
        let disturbed = [1e-9, -1e-9, 3e-10].map(|by| {
            let (system, mut state) = scene.clone();
            for (index, position) in state.positions.iter_mut().enumerate() {
                *position *= 1.0 + by * ((index % 7) as f64 - 3.0);
            }
            state.prescribe(&system);
            (system, state)
        });
        for (name, run) in runs() {
            let full = format!("{} {name}", kind.name());
            if !parts.split(',').any(|part| full.contains(part)) {
                text.extend(kept.get(full.as_str()).map(|counts| format!("{full}: {counts}\n")));
                continue;
            }
            let counts = run(&scene);
            if disturbed.iter().all(|scene| run(scene) == counts) {
                let counts: Vec<String> = counts.iter().map(u64::to_string).collect();
                let _ = writeln!(text, "{full}: {}", counts.join(" "));
            }
        }
    }
    text
}

#[test]
fn runs_do_the_work_that_they_did() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/work_locks.txt");
    if let Ok(parts) = std::env::var("SPRUNG_RENEW") {
        let old = std::fs::read_to_string(path).unwrap();
        std::fs::write(path, table(&parts, &old)).unwrap();
    }
    let text = std::fs::read_to_string(path).unwrap();
    let locked: HashMap<&str, &str> = text.lines().filter_map(|line| line.split_once(": ")).collect();
    assert!(locked.len() > 300, "{} rows", locked.len());
    let compared: usize = Kind::ALL
        .into_par_iter()
        .map(|kind| {
            let scene = scene(kind);
            let mut compared = 0;
            for (name, run) in runs() {
                let name = format!("{} {name}", kind.name());
                let Some(locked) = locked.get(name.as_str()) else { continue };
                let locked: Vec<u64> = locked.split(' ').map(|count| count.parse().unwrap()).collect();
                let found = run(&scene);
                assert!(alike(&found, &locked), "{name}\n   now {found:?}\nlocked {locked:?}\n{NAMES}");
                compared += 1;
            }
            compared
        })
        .sum();
    assert_eq!(compared, locked.len(), "rows without a run");
}
