//! Multigrid: few iterations whatever the size, a symmetric positive definite preconditioner whatever the system, and an
//! indefinite or broken matrix reported, never passed over.

use crate::systems::{descriptions, systems, test_vector};
use nalgebra::{DMatrix, DVector, Rotation3, Unit, Vector3};
use proptest::prelude::*;
use sprung::assembly::{SpringPattern, SystemMatrix};
use sprung::force::SpringGeometry;
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, StiffnessPolicy, TimeStepper};
use sprung::linear::*;
use sprung::multigrid::{Multigrid, SetupFailure};
use sprung::operator::{Combination, SystemOperator};
use sprung::scene::{Kind, builtin};
use sprung::work::Work;
use sprung::{Scene, State, Stiffness, System};
use std::sync::Arc;

const DT: f64 = 0.01;
const TOLERANCE: f64 = 1e-10;
const UNIT_ROUNDOFF: f64 = 0.5 * f64::EPSILON;

/// A ready scene without damping, `stiffer` times as stiff, every coordinate moved by up to 3 % of the spacing.
fn noisy(scene: &Scene, spacing: f64, stiffer: f64) -> (System, State) {
    let mut builder = scene.builder().unwrap();
    for spring in &mut builder.springs {
        spring.damping = 0.0;
        spring.stiffness *= stiffer;
    }
    let mut seed = 1u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    for x in &mut builder.positions {
        *x += Vector3::from_fn(|_, _| 0.03 * spacing * (2.0 * random() - 1.0));
    }
    builder.build().unwrap()
}

fn cloth(n: usize, stiffer: f64) -> (System, State) {
    noisy(&builtin::cloth(n).unwrap(), 0.05, stiffer)
}

fn lattice(n: usize, stiffer: f64) -> (System, State) {
    noisy(&builtin::lattice(n).unwrap(), 0.01, stiffer)
}

fn operator<'s>((system, state): &'s (System, State), option: Stiffness, dt: f64) -> SystemOperator<'s> {
    let extensions = SpringGeometry::at(system, &state.positions).unwrap();
    SystemOperator::new(system, &extensions, option, Combination::step(dt))
}

/// Solves one system of a step; returns the solution and the iterations.
fn solve(scene: &(System, State), option: Stiffness) -> (Vec<f64>, u64) {
    let a = operator(scene, option, DT);
    let b = test_vector(scene.0.dofs().len(), 1);
    let mut x = vec![0.0; b.len()];
    let mut work = Work::default();
    let mut solver = CgSolver::matrix_free(&scene.0, PreconditionerKind::Multigrid, TOLERANCE).unwrap();
    solver.set_positions(&scene.1.positions);
    let solution = solver.prepare(&a, &mut work).unwrap().solve(&b, &mut x, &mut work).unwrap();
    assert!(solution.relative_residual <= TOLERANCE);
    assert_eq!((work.multigrid_setups, work.factorizations), (1, 0));
    (x, work.cg_iterations)
}

#[test]
fn iterations_hardly_grow_with_the_size() {
    let count = |scene| solve(&scene, Stiffness::Tension).1;
    let cloths = [32, 64, 100].map(|n| count(cloth(n, 1.0)));
    let lattices = [10, 16].map(|n| count(lattice(n, 1.0)));
    for (counts, most) in [(&cloths[..], 35), (&lattices[..], 20)] {
        let (fewest, largest) = (*counts.iter().min().unwrap(), *counts.iter().max().unwrap());
        assert!(largest <= most && 2 * largest <= 3 * fewest, "{counts:?}");
    }
}

#[test]
fn a_hundredfold_stiffness_or_none_across_the_springs_costs_few_iterations() {
    let counts = [
        solve(&cloth(64, 100.0), Stiffness::Tension).1,
        solve(&lattice(16, 100.0), Stiffness::Tension).1,
        solve(&cloth(64, 1.0), Stiffness::Axial).1,
        solve(&cloth(64, 100.0), Stiffness::Axial).1,
    ];
    // A hundredfold stiffness costs half as many again as `iterations_hardly_grow_with_the_size` allows; without the terms across,
    // which hold a cloth in shape, three times as many.
    assert!(counts[..3].iter().all(|&count| count <= 40) && counts[3] <= 80, "{counts:?}");
}

#[test]
fn every_level_is_much_smaller_than_the_one_above() {
    for (system, _) in [cloth(64, 1.0), lattice(16, 1.0)] {
        let levels = Multigrid::new(&system).unwrap().levels();
        assert!(levels.len() >= 2);
        for pair in levels.windows(2) {
            assert!(pair[1].nodes * 5 < pair[0].nodes, "{levels:?}");
        }
        let entries: usize = levels.iter().map(|level| level.entries).sum();
        assert!((entries as f64) < 1.6 * levels[0].entries as f64, "{levels:?}");
    }
}

/// Two domains of the smoother. Across a cloth that is hardly stretched it is thousands of times softer than along it, which the border between them
/// must not forget where the cloth is not parallel to the axes.
#[test]
fn turning_a_cloth_does_not_cost_iterations() {
    let [flat, turned] = [0.0, 0.5].map(|angle| {
        let mut builder = builtin::cloth(130).unwrap().builder().unwrap();
        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(Vector3::new(1.0, 2.0, 3.0)), angle);
        for spring in &mut builder.springs {
            (spring.damping, spring.stiffness) = (0.0, 100.0 * spring.stiffness);
        }
        for x in &mut builder.positions {
            *x = turn * (1.0001 * *x);
        }
        solve(&builder.build().unwrap(), Stiffness::Tension).1
    });
    assert!(flat.abs_diff(turned) <= 2 && flat < 30, "{flat} {turned}");
}

/// Twice the rows that one domain of the smoother has at least: more than one domain, and rows for several threads.
#[test]
fn results_are_the_same_to_the_bit_for_any_number_of_threads() {
    let scene = cloth(150, 1.0);
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| solve(&scene, Stiffness::Tension))
    };
    let (one, iterations) = with_threads(1);
    assert!(iterations <= 30, "{iterations}");
    for threads in [1, 2, 5] {
        let (x, count) = with_threads(threads);
        assert_eq!(count, iterations);
        assert!(x.iter().zip(&one).all(|(x, one)| x.to_bits() == one.to_bits()), "{threads} threads");
    }
}

/// B as a dense matrix.
fn dense(multigrid: &mut Multigrid, order: usize) -> DMatrix<f64> {
    let mut b = DMatrix::zeros(order, order);
    for (k, mut column) in b.column_iter_mut().enumerate() {
        let mut unit = vec![0.0; order];
        unit[k] = 1.0;
        multigrid.apply(&unit, column.as_mut_slice());
    }
    b
}

/// A as a dense matrix.
fn dense_matrix(scene: &(System, State), a: &SystemOperator) -> DMatrix<f64> {
    let pattern = Arc::new(SpringPattern::of_stiffness(&scene.0).unwrap());
    DMatrix::from(&SystemMatrix::assemble(pattern, a).matrix().to_coo())
}

/// In ascending order.
fn eigenvalues(matrix: &DMatrix<f64>) -> Vec<f64> {
    let mut values = match matrix.nrows() {
        0 => Vec::new(),
        _ => matrix.symmetric_eigenvalues().iter().copied().collect(),
    };
    values.sort_by(f64::total_cmp);
    values
}

/// The least |1 − 2λ/3| of the eigenvalues λ of D⁻¹A, D the diagonal blocks of A.
fn least_smoothed(system: &System, a: &DMatrix<f64>) -> f64 {
    let mut d = DMatrix::zeros(a.nrows(), a.ncols());
    for rows in (0..system.particles()).map(|p| system.dofs().rows(p)) {
        let (start, size) = ((rows.start, rows.start), (rows.len(), rows.len()));
        d.view_mut(start, size).copy_from(&a.view(start, size));
    }
    let inverse = d.cholesky().unwrap().l().try_inverse().unwrap();
    let smoothed =
        eigenvalues(&(&inverse * a * inverse.transpose())).into_iter().map(|value| (1.0 - value / 1.5).abs());
    smoothed.fold(f64::INFINITY, f64::min)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// One to three dimensions, prescribed axes, isolated particles, disconnected parts; coarsened as far as can be.
    ///
    /// Scaled by A to order one, where rounding B to single precision makes errors of about 6e-8 ‖A‖‖A⁻¹‖. Where an eigenvalue
    /// λ of D⁻¹A has 1 − 2λ/3 near zero the smoothed prolongation of a motion may vanish, and errors are (1 − 2λ/3)⁻² times as
    /// large, see `prolongator.rs`. B must be definite wherever they are less than one. The λ of coarser levels are not at hand:
    /// of three steps one must keep the bound.
    #[test]
    fn the_preconditioner_is_symmetric_and_positive_definite(
        scene in systems(), dt in crate::systems::log_uniform(1e-3, 0.1), largest_dense in 0usize..20, placed in any::<bool>(),
    ) {
        let mut excess = f64::INFINITY;
        for dt in [dt, 1.1 * dt, 1.3 * dt] {
            let a = operator(&scene, Stiffness::Tension, dt);
            let mut multigrid = Multigrid::down_to(&scene.0, largest_dense).unwrap();
            if placed {
                multigrid.set_positions(&scene.1.positions);
            }
            multigrid.refill(&a).unwrap();
            multigrid.rebuild(&a).unwrap();
            let order = scene.0.dofs().len();
            let b = dense(&mut multigrid, order);
            let matrix = dense_matrix(&scene, &a);
            let values = eigenvalues(&matrix);
            let condition = values.last().unwrap_or(&1.0) / values.first().unwrap_or(&1.0);
            prop_assume!(condition < 1e5);
            let vanishing = least_smoothed(&scene.0, &matrix).min(1.0).powi(2);
            let rounding = 10.0 * 0.5 * f64::from(f32::EPSILON) * condition / vanishing;
            let cholesky = matrix.clone().cholesky().unwrap();
            let scaled = cholesky.l().transpose() * &b * cholesky.l();
            let asymmetry = (&scaled - scaled.transpose()).norm();
            let values = eigenvalues(&((&scaled + scaled.transpose()) * 0.5));
            prop_assert!(rounding > 1.0 || values.iter().all(|&value| value > 0.0), "{values:?}");
            let above_one = values.last().map_or(0.0, |largest| largest - 1.0);
            excess = excess.min(asymmetry.max(above_one) / rounding);
        }
        prop_assert!(excess <= 1.0, "{excess} times the bound of asymmetry or of eigenvalues above one");
    }

    #[test]
    fn the_solution_is_that_of_cholesky(scene in systems(), dt in crate::systems::log_uniform(1e-3, 1.0)) {
        let a = operator(&scene, Stiffness::Tension, dt);
        let b = test_vector(scene.0.dofs().len(), 3);
        let matrix = dense_matrix(&scene, &a);
        let values = eigenvalues(&matrix);
        let condition = values.last().unwrap_or(&1.0) / values.first().unwrap_or(&1.0);
        let mut x = vec![0.0; b.len()];
        let mut work = Work::default();
        let mut solver = CgSolver::matrix_free(&scene.0, PreconditionerKind::Multigrid, TOLERANCE).unwrap();
        solver.set_positions(&scene.1.positions);
        solver.prepare(&a, &mut work).unwrap().solve(&b, &mut x, &mut work).unwrap();
        let expected = matrix.cholesky().unwrap().solve(&DVector::from_column_slice(&b));
        let difference = (DVector::from_column_slice(&x) - &expected).norm();
        let bound = condition * (TOLERANCE + 30.0 * UNIT_ROUNDOFF) * expected.norm();
        prop_assert!(difference <= bound, "{difference:e} > {bound:e}, condition {condition:e}");
    }

    /// The whole stiffness at any step: either a preconditioner that is definite, or evidence that A is not.
    #[test]
    fn an_indefinite_matrix_is_refused_only_if_it_is_one(
        scene in systems(), dt in crate::systems::log_uniform(1e-3, 1e3), largest_dense in 0usize..20,
    ) {
        let a = operator(&scene, Stiffness::Full, dt);
        let mut multigrid = Multigrid::down_to(&scene.0, largest_dense).unwrap();
        multigrid.set_positions(&scene.1.positions);
        let order = scene.0.dofs().len();
        match multigrid.refill(&a).and_then(|()| multigrid.rebuild(&a)) {
            Ok(()) => {
                let b = dense(&mut multigrid, order);
                prop_assert!(b.iter().all(|entry| entry.is_finite()));
            }
            Err(SetupFailure::NonFinite) => prop_assert!(false, "a finite matrix"),
            Err(_) => {
                let values = eigenvalues(&dense_matrix(&scene, &a));
                prop_assert!(values[0] < 1e-12 * values[order - 1], "{values:?}");
            }
        }
    }

    #[test]
    fn numbers_of_any_size_are_solved(description in descriptions(), exponent in -80i32..80) {
        let mut description = description;
        let factor = 2f64.powi(exponent);
        description.springs.iter_mut().for_each(|spring| {
            spring.stiffness *= factor;
            spring.damping *= factor;
        });
        description.masses.iter_mut().for_each(|mass| *mass *= factor);
        let scene = description.build().unwrap();
        let a = operator(&scene, Stiffness::Tension, 0.1);
        let b: Vec<f64> = test_vector(scene.0.dofs().len(), 3).iter().map(|b| b / factor).collect();
        let mut x = vec![0.0; b.len()];
        let mut solver = CgSolver::matrix_free(&scene.0, PreconditionerKind::Multigrid, TOLERANCE).unwrap();
        let work = &mut Work::default();
        solver.prepare(&a, work).unwrap().solve(&b, &mut x, work).unwrap();
    }
}

#[test]
fn a_matrix_that_is_not_finite_is_reported_as_such() {
    for (scene, dt) in [(cloth(20, 1.0), f64::NAN), (cloth(3, 1.0), f64::NAN), (cloth(20, 1.0), 1e-200)] {
        let a = operator(&scene, Stiffness::Tension, dt);
        let mut solver = CgSolver::matrix_free(&scene.0, PreconditionerKind::Multigrid, TOLERANCE).unwrap();
        assert_eq!(solver.prepare(&a, &mut Work::default()).err(), Some(SolveFailure::NonFinite));
    }
}

/// A block squeezed evenly: its springs' transverse terms are negative, and the more particles move together sideways
/// the less stands against it, so the diagonal blocks see nothing while a coarse level does.
#[test]
fn a_coarse_level_sees_what_no_diagonal_block_does() {
    let mut builder = builtin::lattice(12).unwrap().builder().unwrap();
    builder.positions.iter_mut().for_each(|x| *x *= 0.8);
    let scene = builder.build().unwrap();
    let a = operator(&scene, Stiffness::Full, DT);
    let mut multigrid = Multigrid::new(&scene.0).unwrap();
    multigrid.set_positions(&scene.1.positions);
    multigrid.refill(&a).unwrap();
    let Err(SetupFailure::CoarseLevel { level: 1, dof }) = multigrid.rebuild(&a) else { panic!("not refused") };
    assert!(dof.particle < scene.0.particles());
    let mut solver = CgSolver::matrix_free(&scene.0, PreconditionerKind::Multigrid, TOLERANCE).unwrap();
    solver.set_positions(&scene.1.positions);
    let refused = solver.prepare(&a, &mut Work::default()).err();
    assert_eq!(refused, Some(SolveFailure::Indefinite(Evidence::CoarseLevel { level: 1, dof })));
    // Cholesky agrees.
    let pattern = Arc::new(SpringPattern::of_stiffness(&scene.0).unwrap());
    let matrix = SystemMatrix::assemble(pattern, &a);
    assert!(Cholesky::analyse(matrix.matrix().pattern(), faer::Par::Seq).unwrap().factor(matrix.matrix()).is_err());
    // And after the refusal a definite matrix is taken.
    let definite = operator(&scene, Stiffness::Tension, DT);
    let (b, work) = (test_vector(scene.0.dofs().len(), 1), &mut Work::default());
    solver.prepare(&definite, work).unwrap().solve(&b, &mut vec![0.0; b.len()], work).unwrap();
}

fn run(scene: &(System, State), preconditioner: Option<PreconditionerKind>, dt: f64, steps: usize) -> (&str, Work) {
    let linear = SolverOptions { solver: SolverChoice::Cg, preconditioner, ..Default::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Tension.into(), linear };
    let mut state = scene.1.clone();
    let mut stepper = LinearBackwardEuler::new(&scene.0, &state, &options).unwrap();
    for _ in 0..steps {
        stepper.step(&mut state, dt).unwrap();
    }
    (stepper.linear_solver().and_then(|solver| solver.preconditioner()).unwrap(), stepper.statistics().work)
}

#[test]
fn a_smooth_motion_gives_good_first_guesses() {
    let scene = builtin::lattice(10).unwrap().build().unwrap();
    let iterations = |steps| {
        let (_, work) = run(&scene, Some(PreconditionerKind::BlockJacobi), 0.002, steps);
        assert_eq!(work.warm_starts, work.solves - 1);
        work.cg_iterations
    };
    // The first step, which starts from nothing, and the twentieth.
    assert_eq!((iterations(1), iterations(20) - iterations(19)), (39, 33));
}

#[test]
fn coarse_levels_are_kept_as_long_as_they_serve() {
    let scene = cloth(40, 1.0);
    let (_, work) = run(&scene, Some(PreconditionerKind::Multigrid), DT, 30);
    assert!(work.solves == 30 && work.multigrid_setups <= 20, "{work:?}");
}

/// Falling flat takes an iteration or two in the first solve and as many as ever in the second: that is no reason to renew coarse levels for
/// ever.
#[test]
fn an_easy_first_solve_does_not_cost_coarse_levels_in_every_step() {
    let scene = builtin::cloth(40).unwrap().build().unwrap();
    let (_, work) = run(&scene, Some(PreconditionerKind::Multigrid), 0.001, 40);
    assert!(work.solves == 40 && work.multigrid_setups <= 6, "{work:?}");
}

/// A random network in long steps: with its whole stiffness the matrix of nearly every step is refused, by conjugate gradients, and coarse levels are made for
/// the softer one alone. They were made for both, 38 in all.
#[test]
fn matrices_that_are_refused_step_after_step_take_no_coarse_levels() {
    let (system, mut state) = builtin(Kind::Network, 1000).unwrap().build().unwrap();
    let preconditioner = Some(PreconditionerKind::Multigrid);
    let linear = SolverOptions { solver: SolverChoice::Cg, preconditioner, ..Default::default() };
    let options =
        ImplicitOptions { stiffness: StiffnessPolicy::OnDemand, linear: linear.with_tolerance(1e-7).unwrap() };
    let mut stepper = LinearBackwardEuler::new(&system, &state, &options).unwrap();
    for _ in 0..30 {
        stepper.step(&mut state, 0.1).unwrap();
    }
    let work = stepper.statistics().work;
    assert!(work.assemblies >= 55 && work.iterative_solves >= 50, "{work:?}");
    assert!(work.multigrid_setups <= 24, "{work:?}");
}

#[test]
fn the_automatic_choice_takes_multigrid_where_block_jacobi_is_slow() {
    let scene = cloth(40, 1.0);
    let (slow, work) = run(&scene, None, DT, 3);
    assert_eq!(slow, "multigrid");
    assert!(work.multigrid_setups >= 1 && work.cg_iterations < 150 + 3 * 30, "{work:?}");
    let (quick, work) = run(&scene, None, 1e-4, 3);
    assert_eq!((quick, work.multigrid_setups), ("block-jacobi", 0));
}
