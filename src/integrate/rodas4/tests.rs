use super::*;
use crate::integrate::Status;
use crate::integrate::fixtures::scene;
use crate::linear::{Definiteness, LdltSolver, PreparedMatrix, Solution, Solved, SolverChoice, SolverOptions, norm};
use crate::operator::SystemOperator;
use crate::spring::{Spring, Stiffness};
use crate::system::fixtures::tethered;
use crate::work::Work;
use nalgebra::{Complex, SMatrix, SVector};
use std::sync::{Arc, Mutex};

type Matrix = SMatrix<f64, STAGES, STAGES>;
type Vector = SVector<f64, STAGES>;

/// The coefficients of the method as it is usually written: α, Γ and the weights of the formula and of the embedded one.
fn standard() -> (Matrix, Matrix, Vector, Vector) {
    let rows = |rows: &[Row; STAGES]| Matrix::from_fn(|i, j| rows[i][j]);
    let gamma = (Matrix::identity() / GAMMA - rows(&C)).try_inverse().unwrap();
    let weights = |row: &Row| (Vector::from_row_slice(row).transpose() * gamma).transpose();
    let mut embedded = B;
    embedded[STAGES - 1] -= 1.0;
    (rows(&A) * gamma, gamma, weights(&B), weights(&embedded))
}

/// The residuals of the order conditions of Rosenbrock methods with the exact Jacobian, by order (Hairer and Wanner, IV.7).
fn conditions(b: &Vector) -> [Vec<f64>; 4] {
    let (alpha, gamma, ..) = standard();
    let beta = alpha + gamma;
    let (a, s) = (alpha.column_sum(), beta.column_sum());
    let power = |exponent: i32| a.map(|a| a.powi(exponent));
    [
        vec![b.sum() - 1.0],
        vec![b.dot(&s) - 1.0 / 2.0],
        vec![b.dot(&power(2)) - 1.0 / 3.0, b.dot(&(beta * s)) - 1.0 / 6.0],
        vec![
            b.dot(&power(3)) - 1.0 / 4.0,
            b.component_mul(&a).dot(&(alpha * s)) - 1.0 / 8.0,
            b.dot(&(beta * power(2))) - 1.0 / 12.0,
            b.dot(&(beta * beta * s)) - 1.0 / 24.0,
        ],
    ]
}

#[test]
fn coefficients_meet_the_order_conditions() {
    let (alpha, gamma, b, embedded) = standard();
    let largest = |errors: &[f64]| errors.iter().fold(0.0f64, |largest, error| largest.max(error.abs()));
    for (order, errors) in conditions(&b).iter().enumerate() {
        assert!(largest(errors) < 1e-14, "order {}: {errors:?}", order + 1);
    }
    let [one, two, three, four] = conditions(&embedded);
    assert!([one, two, three].iter().all(|errors| largest(errors) < 1e-14));
    assert!(largest(&four) > 1e-3, "{four:?}");
    assert!((alpha.column_sum() - Vector::from(TIMES)).amax() < 1e-14);
    assert!((gamma.column_sum() - Vector::from(RATES)).amax() < 1e-14);
}

/// `|1 + z bᵀ(I − z(α + Γ))⁻¹ 1| ≤ 1` for imaginary z, and zero in the limit.
#[test]
fn it_is_a_stable_and_l_stable() {
    let (alpha, gamma, b, _) = standard();
    let size = |z: Complex<f64>| {
        let beta = (alpha + gamma).map(Complex::from);
        let system = SMatrix::<Complex<f64>, STAGES, STAGES>::identity() - beta * z;
        let stages = system.lu().solve(&SVector::<Complex<f64>, STAGES>::from_element(Complex::from(1.0))).unwrap();
        (Complex::from(1.0) + z * b.map(Complex::from).dot(&stages)).norm()
    };
    for exponent in -30..=40 {
        let y = 10f64.powf(0.1 * f64::from(exponent));
        assert!(size(Complex::new(0.0, y)) <= 1.0 + 1e-13, "{y}");
    }
    assert!(size(Complex::new(0.0, 1e7)) < 1e-5 && size(Complex::new(-1e7, 0.0)) < 1e-5);
}

/// A particle of 1 kg between two compressed springs across which nothing holds it: A(γh) is indefinite beyond
/// `γ²h² 2c = m` with c = k (1/l − 1/l0) = 10 N/m.
fn compressed() -> (System, State) {
    let springs = [(0, 1, [20.0, 2.0, 0.0]), (1, 2, [20.0, 2.0, 0.0])];
    let mut builder = scene(&[-1.0, 0.0, 1.0].map(|x| ([x, 0.0, 0.0], 1.0)), &springs);
    builder.hold(0).hold(2);
    let (system, mut state) = builder.build().unwrap();
    state.velocities[1].y = 1e-3;
    (system, state)
}

/// With every option and solver, tried steps beyond the limit are refused as indefinite, and fixed ones cut.
#[test]
fn matrices_are_never_regularized() {
    let (system, start) = compressed();
    let limit = (1.0 / 20.0f64).sqrt() / GAMMA;
    for stiffness in [Stiffness::Full, Stiffness::Tension, Stiffness::Axial] {
        for solver in [SolverChoice::Llt, SolverChoice::Ldlt, SolverChoice::Cg] {
            let linear = SolverOptions { solver, ..SolverOptions::default() };
            let options = ImplicitOptions { stiffness: stiffness.into(), linear };
            let mut stepper = Rodas4::new(&system, &start, &options).unwrap();
            let refused = stepper.try_step(&start, 1.01 * limit).unwrap_err();
            assert_eq!(refused.status(), Status::Indefinite, "{stiffness:?} {solver:?}");
            assert!(stepper.try_step(&start, 0.99 * limit).is_ok());
            let mut state = start.clone();
            stepper.step(&mut state, 1.1 * limit).unwrap();
            let statistics = stepper.statistics();
            assert_eq!((statistics.softened_solves, statistics.indefinite_solves), (0, 0));
            assert_eq!((statistics.rejected_steps, statistics.work.force_evaluations % 6), (1, 0));
            assert_eq!(state.time, 1.1 * limit);
            let grown = 1e-3 / 20f64.sqrt() * (20f64.sqrt() * state.time).sinh();
            assert!((state.positions[1].y / grown - 1.0).abs() < 0.01, "{} {grown}", state.positions[1].y);
        }
    }
}

/// A step of fixed length is cut in quarters, and again, but no part is shorter than a 1024th of it.
#[test]
fn steps_are_cut_five_times_at_most() {
    let (system, start) = compressed();
    let limit = (1.0 / 20.0f64).sqrt() / GAMMA;
    let mut stepper = Rodas4::new(&system, &start, &ImplicitOptions::default()).unwrap();
    let mut state = start.clone();
    let failure = stepper.step(&mut state, 1.1 * 1024.0 * limit).unwrap_err();
    assert_eq!((failure.status(), stepper.statistics().rejected_steps), (Status::Indefinite, 5));
    assert_eq!(state, start);
}

/// A particle of 4 kg on 400 N/m, 0.3 m from rest.
fn pulled() -> (System, State) {
    tethered(1.3, 4.0, Spring { stiffness: 400.0, rest_length: 1.0, damping: 0.0 })
}

/// The error of the last step stands for this one's, by the fourth power of the ratio of lengths; for a longer one unchanged.
#[test]
fn shorter_steps_are_solved_more_accurately() {
    let (system, start) = pulled();
    for (last, expected) in [(0.2, 3.0 / 16.0), (0.1, 3.0), (0.05, 3.0)] {
        let mut stepper = Rodas4::new(&system, &start, &ImplicitOptions::default()).unwrap();
        stepper.last = Some((last, 3.0));
        stepper.try_step(&start, 0.1).unwrap();
        // A ten-thousandth of it, for the root of 4 kg and 1600/s², of 10⁴ N.
        let (asked, part) = (stepper.linear.adaptive_tolerance.next(1e4, 1600.0), 1e-4 * expected * 2.0 * 1600.0 / 1e4);
        assert!((asked / part - 1.0).abs() < 1e-12, "{last}: {asked:e} {part:e}");
    }
}

/// `0.4 Σ U²/K_s / K` with `U = ½ κ L²`, `L = (h v⊥)²/(2 l)` and `K_s = ½ μ v⊥²`, of two springs, the first between particles of 2 kg and
/// 3 kg, 1.5 m long and passed at 4 m/s across, the second from there to a held one, 2 m long and passed at 1 m/s.
#[test]
fn turning_springs_lose_energy() {
    let particles = [([0.0; 3], 2.0), ([1.5, 0.0, 0.0], 3.0), ([1.5, 0.0, 2.0], 5.0)];
    let mut builder = scene(&particles, &[(0, 1, [6.0, 0.5, 0.0]), (1, 2, [10.0, 2.0, 0.0])]);
    let (system, mut state) = builder.hold(2).clone().build().unwrap();
    state.velocities[0] = Vector3::new(7.0, 4.0, 0.0);
    state.velocities[1] = Vector3::new(1.0, 0.0, -2.0);
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let h = 0.25;
    let share = |kappa: f64, length: f64, square: f64, mass: f64| {
        let lift = h * h * square / (2.0 * length);
        let energy = 0.5 * kappa * lift * lift;
        energy * energy / (0.5 * mass * square)
    };
    // Across the first spring 4 m/s along y and 2 m/s along z; the second turns about what is held, with all of 3 kg.
    let taken = share(12.0, 1.5, 20.0, 6.0 / 5.0) + share(5.0, 2.0, 1.0, 3.0);
    let kinetic = 0.5 * (2.0 * 65.0 + 3.0 * 5.0);
    let found = rotational_damping(&system, &extensions, &state.velocities, h);
    assert!((found / (0.4 * taken / kinetic) - 1.0).abs() < 1e-12, "{found}");
    let mut stepper = Rodas4::new(&system, &state, &ImplicitOptions::default()).unwrap();
    state.time = 8.0;
    stepper.try_step(&state, h).unwrap();
    assert!((stepper.rotational_damping() / found - 1.0).abs() < 1e-12, "{} {found}", stepper.rotational_damping());
    // Along springs nothing turns, and where nothing moves there is nothing to take from.
    state.velocities = vec![Vector3::x(), Vector3::zeros(), Vector3::zeros()];
    assert_eq!(rotational_damping(&system, &extensions, &state.velocities, h), 0.0);
    assert_eq!(rotational_damping(&system, &extensions, &[Vector3::zeros(); 3], h), 0.0);
}

/// Reports this relative residual for its solutions; records the largest norm of a right-hand side.
struct Inaccurate {
    solver: LdltSolver,
    residual_and_largest: Arc<Mutex<[f64; 2]>>,
}

impl LinearSolver for Inaccurate {
    fn name(&self) -> &'static str {
        "inaccurate"
    }

    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        self.solver.update(a, work)
    }

    fn solve(&mut self, a: PreparedMatrix, b: &[f64], x: &mut [f64], work: &mut Work) -> Solved {
        self.solver.solve(a, b, x, work)?;
        let mut shared = self.residual_and_largest.lock().unwrap();
        shared[1] = shared[1].max(norm(b));
        Ok(Solution { relative_residual: shared[0] })
    }
}

/// A residual may cause a thousandth of the step's error, `‖r‖ ≤ 10⁻³ ‖E‖ √m/(γh)²`; with more the step is computed again, twice at most.
#[test]
fn inaccurate_steps_are_computed_again() {
    let (system, start) = pulled();
    let residual_and_largest = Arc::new(Mutex::new([0.0; 2]));
    let solver = LdltSolver::new(&system, faer::Par::Seq, &mut Work::default()).unwrap();
    let solver = Box::new(Inaccurate { solver, residual_and_largest: residual_and_largest.clone() });
    let mut stepper = Rodas4::with_solver(&system, &start, &ImplicitOptions::default(), solver).unwrap();
    let h = 0.1;
    stepper.try_step(&start, h).unwrap();
    let (_, error) = stepper.last.unwrap();
    let enough = 1e-3 * error * 2.0 / (GAMMA * h).powi(2);
    let [_, largest] = *residual_and_largest.lock().unwrap();
    for (part, times) in [(0.99, 1), (1.01, 3)] {
        residual_and_largest.lock().unwrap()[0] = part * enough / largest;
        let before = stepper.statistics().work.force_evaluations;
        stepper.try_step(&start, h).unwrap();
        assert_eq!(stepper.statistics().work.force_evaluations - before, times * STAGES as u64, "{part}");
    }
}
