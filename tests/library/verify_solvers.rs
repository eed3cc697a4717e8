//! The checks of the solvers pass on right solutions, up to condition numbers of 1e12, and fail on planted faults.

use crate::faulty::Faulty;
use nalgebra_sparse::CscMatrix;
use sprung::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix};
use sprung::force::SpringGeometry;
use sprung::integrate::StepMatrices;
use sprung::linear::{CgSolver, Cholesky, PreconditionerKind, Prepare};
use sprung::operator::{Combination, SystemOperator};
use sprung::scene::{Kind, builtin};
use sprung::verify::*;
use sprung::work::Work;
use sprung::{Scene, Spring, State, Stiffness, System, SystemBuilder};
use std::sync::Arc;

fn family(name: &str) -> &'static Family {
    FAMILIES.iter().find(|family| family.name == name).unwrap()
}

fn report(check: &Check) {
    println!("{:45} {:60} {:10.3e} {:10.3e}", check.scene, check.name, check.value, check.bound);
}

/// A free, stretched chain of unequal links: at a long step its condition number is about `k dt²/(l0 m)`.
fn free_chain(mass_ratio: f64) -> (System, State) {
    let mut b = SystemBuilder::new();
    for p in 0..12 {
        let mass = if p % 2 == 0 { 1.0 } else { mass_ratio };
        b.particle(
            [1.2 * p as f64, 0.1 * ((p * p) % 5) as f64, 0.07 * ((p * 3) % 4) as f64],
            mass * (1.0 + 0.1 * p as f64),
        );
    }
    for i in 1..12 {
        b.spring(i - 1, i, Spring { stiffness: 100.0 + 13.0 * i as f64, rest_length: 0.9, damping: 0.2 });
    }
    b.spring(0, 4, Spring { stiffness: 60.0, rest_length: 2.0, damping: 0.0 });
    b.gravity(0.3, -9.81, 0.1);
    b.build().unwrap()
}

fn scenes() -> Vec<(String, System, State, f64)> {
    let mut all = Vec::new();
    for kind in Kind::ALL {
        let scene = builtin(kind, kind.default_size()).unwrap();
        let (system, state) = scene.build().unwrap();
        let dt = scene.time.dt.unwrap_or(0.01);
        all.push((kind.name().to_owned(), system.clone(), state.clone(), dt));
        all.push((format!("{} at 10 dt", kind.name()), system, state, 10.0 * dt));
    }
    let folders = ["src/verify/scenes", "verification/scenes"].map(|folder| std::fs::read_dir(folder).unwrap());
    let mut files: Vec<_> = folders.into_iter().flatten().map(|file| file.unwrap().path()).collect();
    files.sort();
    for file in files.into_iter().filter(|file| file.extension().is_some_and(|end| end == "toml")) {
        let scene = Scene::load(&file).unwrap();
        let (system, state) = scene.build().unwrap();
        let dt = scene.time.dt.unwrap_or(0.01);
        all.push((file.file_stem().unwrap().to_string_lossy().into_owned(), system, state, dt));
    }
    for (name, mass_ratio, dt) in
        [("free chain, far dt", 1.0, 3e4), ("free chain, mass ratio", 1e-10, 1.0), ("both", 1e-5, 1e3)]
    {
        let (system, state) = free_chain(mass_ratio);
        all.push((name.to_owned(), system, state, dt));
    }
    for TestCase { name, system, state, .. } in hard_states().unwrap() {
        all.push((name, system, state, 0.01));
    }
    all
}

#[test]
fn every_solver_agrees_with_every_other_on_every_scene() {
    let mut failures = Vec::new();
    for (scene, system, state, dt) in scenes() {
        let subject = TestCase { name: scene.clone(), system, state, dt, loaded: None };
        let checks = family("solvers").check(&subject);
        // A check that is not judged is the only one.
        assert!(checks.len() >= 8 || checks.iter().any(|check| !check.is_judged), "{scene}");
        for check in checks.into_iter().chain(family("assembly").check(&subject)) {
            report(&check);
            if !check.passed() {
                failures.push(check);
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// One step's system and its Cholesky solution.
struct Step {
    system: System,
    state: State,
    a: CscMatrix<f64>,
    b: Vec<f64>,
    x: Vec<f64>,
    factor: Cholesky,
}

const DT: f64 = 0.02;

fn step() -> Step {
    let (system, state) = free_chain(0.3);
    let StepMatrices { a, b, .. } = StepMatrices::assemble(&system, &state, Stiffness::Full, DT).unwrap();
    let mut factor = Cholesky::analyse(a.pattern(), faer::Par::Seq).unwrap();
    factor.factor(&a).unwrap();
    let mut x = b.clone();
    factor.solve_in_place(&mut x).unwrap();
    Step { system, state, a: a.to_csc(), b, x, factor }
}

impl Step {
    fn backward(&self, x: &[f64], promise: Promise) -> Vec<Check> {
        let solved = Solved { method: "solver", x, promise };
        backward_errors(&self.a, &self.b, &solved, "free chain").unwrap()
    }

    fn agree(&mut self, x: &[f64], promise: Promise) -> Check {
        let solved = Solved { method: "solver", x, promise };
        let reference = Solved { method: "Cholesky", x: &self.x, promise: Promise::Stable };
        let factor = &mut self.factor;
        let solve = &mut |x: &mut [f64]| factor.solve_in_place(x).unwrap();
        solutions_agree(&self.a, &self.b, &solved, &reference, solve, "free chain").unwrap()
    }

    fn operator(&self, extensions: &SpringGeometry, option: Stiffness, dt: f64) -> SystemOperator<'_> {
        SystemOperator::new(&self.system, extensions, option, Combination::step(dt))
    }
}

#[test]
fn wrong_solutions_are_caught() {
    let mut step = step();
    let exact = step.x.clone();
    assert!(step.backward(&exact, Promise::Stable).iter().all(Check::passed));
    assert!(step.agree(&exact, Promise::Stable).passed());
    let n = exact.len();
    let mut permuted = exact.clone();
    permuted.rotate_right(3);
    let mut swapped = exact.clone();
    swapped.swap(4, 5);
    let mut one_off = exact.clone();
    one_off[7] *= 1.0 + 1e-12;
    let mut not_a_number = exact.clone();
    not_a_number[n - 1] = f64::NAN;
    let faults = [
        ("the transposed permutation", permuted),
        ("two rows swapped", swapped),
        ("32 bits", exact.iter().map(|&x| f64::from(x as f32)).collect()),
        ("one component off by 1e-12", one_off),
        ("the sign", exact.iter().map(|x| -x).collect()),
        ("dt for dt^2", exact.iter().map(|x| x / DT).collect()),
        ("nothing", vec![0.0; n]),
        ("not a number", not_a_number),
    ];
    for (name, x) in &faults {
        assert!(step.backward(x, Promise::Stable).iter().any(|check| !check.passed()), "{name}");
        assert!(!step.agree(x, Promise::Stable).passed(), "{name}");
        assert!(!step.backward(x, Promise::Tolerance(1e-14))[0].passed(), "{name}");
    }
    for (name, x) in faults.iter().filter(|(name, _)| !name.contains("1e-12")) {
        assert!(!indefinite_backward_error(&step.a, &step.b, x, "solver", "").unwrap().passed(), "{name}");
    }
    let long = Solved { method: "solver", x: &vec![0.0; n + 1], promise: Promise::Stable };
    assert!(backward_errors(&step.a, &step.b, &long, "").is_err());
    // The solution of another matrix: one entry off by one per cent.
    let mut other = step.a.clone();
    other.values_mut()[5] *= 1.01;
    let dense = nalgebra::DMatrix::from(&other).lu();
    let x = dense.solve(&nalgebra::DVector::from_column_slice(&step.b)).unwrap();
    assert!(step.backward(x.as_slice(), Promise::Stable).iter().any(|check| !check.passed()));
}

#[test]
fn an_iteration_that_stops_early_is_caught() {
    let mut step = step();
    let solve = |tolerance: f64| {
        let extensions = SpringGeometry::at(&step.system, &step.state.positions).unwrap();
        let operator = step.operator(&extensions, Stiffness::Full, DT);
        let mut cg = CgSolver::matrix_free(&step.system, PreconditionerKind::Jacobi, tolerance).unwrap();
        let mut work = Work::default();
        let mut x = vec![0.0; step.b.len()];
        cg.prepare(&operator, &mut work).unwrap().solve(&step.b, &mut x, &mut work).unwrap();
        x
    };
    let (early, late) = (solve(1e-4), solve(1e-10));
    let [early_residual, late_residual] =
        [&early, &late].map(|x| step.backward(x, Promise::Tolerance(1e-10)).swap_remove(0));
    assert!(late_residual.passed() && !early_residual.passed() && early_residual.value > 1e-8);
    assert!(step.agree(&late, Promise::Tolerance(1e-10)).passed());
    assert!(step.agree(&early, Promise::Tolerance(1e-4)).passed());
    assert!(!step.agree(&early, Promise::Tolerance(1e-10)).passed());
    assert!(!step.agree(&late, Promise::Stable).passed(), "1e-10 is not 30 u");
}

#[test]
fn wrong_products_are_caught() {
    let step = step();
    let extensions = SpringGeometry::at(&step.system, &step.state.positions).unwrap();
    let operator = step.operator(&extensions, Stiffness::Full, DT);
    let check = |fault: fn(usize, usize, f64) -> f64| {
        let mut a = step.a.clone();
        a.triplet_iter_mut().for_each(|(row, column, value)| *value = fault(row, column, *value));
        products_agree(&operator, &Faulty(a), "free chain").unwrap()
    };
    let right = check(|_, _, a| a);
    assert!(right.passed() && right.table.iter().all(|entry| entry.verdict == "agrees"), "{right:?}");
    assert!(!check(|_, _, a| -a).passed());
    assert!(!check(|r, c, a| if r / 3 == 2 && c / 3 == 3 { 0.0 } else { a }).passed());
    assert!(!check(|r, c, a| if (r, c) == (4, 4) { a * (1.0 + 1e-13) } else { a }).passed());
    assert!(!check(|r, c, a| if (r, c) == (4, 3) { 1.01 * a } else { a }).passed());
    assert!(!check(|_, _, a| f64::from(a as f32)).passed());
    assert!(!check(|r, c, a| if (r, c) == (0, 0) { f64::NAN } else { a }).passed());
    assert!(products_agree(&operator, &Faulty(CscMatrix::zeros(2, 2)), "").is_err());
    // Another option, another step, another mass are other matrices.
    for (option, dt) in [(Stiffness::Axial, DT), (Stiffness::Full, 2.0 * DT)] {
        assert!(!products_agree(&operator, &step.operator(&extensions, option, dt), "").unwrap().passed());
    }
}

#[test]
fn a_single_bit_left_over_in_a_refill_is_caught() {
    let step = step();
    let extensions = SpringGeometry::at(&step.system, &step.state.positions).unwrap();
    let operator = step.operator(&extensions, Stiffness::Full, DT);
    let pattern = Arc::new(SpringPattern::of_stiffness(&step.system).unwrap());
    let fresh = || SystemMatrix::assemble(pattern.clone(), &operator);
    let check = |operator: &SystemOperator, matrix: &SymmetricMatrix| refill_is_fresh(operator, matrix, "").unwrap();
    let right = check(&operator, fresh().matrix());
    assert!(right.value == 0.0 && right.passed());
    let mut left_over = fresh().into_matrix();
    left_over.add_to_diagonal(3, 1e-9);
    let wrong = check(&operator, &left_over);
    assert_eq!(wrong.value, 3.0);
    assert!(!wrong.passed() && wrong.table[0].row == 9);
    let empty = SystemMatrix::zeros(pattern.clone());
    assert!(!check(&operator, empty.matrix()).passed());
    let other = step.operator(&extensions, Stiffness::Axial, DT);
    assert!(!check(&other, fresh().matrix()).passed());
    let nan = SystemOperator::new(&step.system, &extensions, Stiffness::Full, Combination::step(f64::NAN));
    let not_a_number = SystemMatrix::assemble(pattern.clone(), &nan);
    assert!(!check(&nan, not_a_number.matrix()).passed());
    // A pattern that lacks the springs without damping lacks their blocks.
    let lacking = SystemMatrix::assemble(Arc::new(SpringPattern::of_damping(&step.system).unwrap()), &operator);
    let wrong = check(&operator, lacking.matrix());
    assert!(wrong.table.iter().any(|entry| entry.verdict == "missing"), "{wrong:?}");
}

#[test]
fn condition_numbers_up_to_1e12_are_met_and_estimated() {
    let mut largest = 0.0_f64;
    for (scene, system, state, dt) in scenes().into_iter().filter(|(_, system, ..)| system.dofs().len() <= 400) {
        let Ok(StepMatrices { a, .. }) = StepMatrices::assemble(&system, &state, Stiffness::Tension, dt) else {
            continue;
        };
        let mut factor = Cholesky::analyse(a.pattern(), faer::Par::Seq).unwrap();
        factor.factor(&a).unwrap();
        let condition = condition_estimate(&a.to_csc(), &mut |x| factor.solve_in_place(x).unwrap());
        println!("{scene}: {condition:.2e}");
        assert!(condition_is_right(&a.to_csc(), condition, &scene).passed(), "{scene}");
        if condition < 1e13 {
            largest = largest.max(condition);
        }
        for factor in [0.1, 10.0] {
            let check = condition_is_right(&a.to_csc(), factor * condition, &scene);
            assert!(!check.passed() || !check.is_judged, "{scene}");
        }
    }
    assert!(largest > 1e11, "{largest:e}");
}

#[test]
fn what_cannot_be_run_fails_with_the_reason() {
    let subject = |(system, state), dt| TestCase { name: "free chain".into(), system, state, dt, loaded: None };
    let (system, mut state) = free_chain(1.0);
    state.positions[1] = state.positions[0];
    let degenerate = subject((system, state), DT);
    for check in family("solvers").check(&degenerate).iter().chain(&family("assembly").check(&degenerate)) {
        assert!(!check.is_judged || !check.passed() && check.why.contains("spring 0"), "{check:?}");
    }
    let unusable = family("solvers").check(&subject(free_chain(1.0), f64::NAN));
    assert!(unusable.iter().any(|check| !check.passed() || !check.is_judged));
    // K alone does not depend on the step.
    let assembled = family("assembly").check(&subject(free_chain(1.0), f64::NAN));
    assert!(assembled.iter().all(|check| !check.is_judged || check.passed() == check.scene.ends_with(", K")));
}
