//! Springs without a rest length, spring laws, and external forces with derivatives: forces against matrices, and motions of several methods against
//! exact ones and each other.

use super::fixtures::{scene, stepper};
use super::*;
use crate::force::{Energy, Reactions, set_total_force};
use crate::spring::{LawValue, Spring, SpringLaw, Stiffness, Tension};
use crate::system::fixtures::tethered;
use crate::system::{Axes, Constraint, Derivatives, ExternalForce, Motion, StateView};
use nalgebra::{DMatrix, Matrix3};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A penalty force that pushes up below y = `height`, damped.
#[derive(Debug)]
struct Floor {
    height: f64,
    stiffness: f64,
    damping: f64,
}

impl ExternalForce for Floor {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        for ((f, x), v) in force.iter_mut().zip(at.positions).zip(at.velocities) {
            if x.y < self.height {
                f.y += self.stiffness * (self.height - x.y) - self.damping * v.y;
            }
        }
    }

    fn has_derivatives(&self) -> bool {
        true
    }

    fn add_derivatives(&self, at: &StateView<'_>, derivatives: &mut [Derivatives]) {
        for (derivatives, _) in derivatives.iter_mut().zip(at.positions).filter(|(_, x)| x.y < self.height) {
            derivatives.stiffness[(1, 1)] -= self.stiffness;
            derivatives.damping[(1, 1)] -= self.damping;
        }
    }
}

/// A patch of 4 × 4 particles that falls on a stiff floor.
fn falling() -> (System, State) {
    let places = (0..16).map(|p| [f64::from(p / 4), f64::from(p % 4)]);
    let particles: Vec<_> = places.map(|[i, j]| ([0.1 * i, 0.05 + 0.01 * i, 0.1 * j], 0.01)).collect();
    let pairs = (0..16).filter(|p| p % 4 < 3).map(|p| (p, p + 1)).chain((0..12).map(|p| (p, p + 4)));
    let springs: Vec<_> = pairs.map(|(i, j)| (i, j, [5.0, 0.1, 0.01])).collect();
    let (system, start) = scene(&particles, &springs).gravity(0.0, -9.81, 0.0).clone().build().unwrap();
    (system.with_external_force(Floor { height: 0.0, stiffness: 2e3, damping: 2.0 }), start)
}

fn force(system: &System, state: &State) -> Vec<f64> {
    let mut force = vec![Vector3::zeros(); system.particles()];
    set_total_force(system, &state.moment(), &mut force).unwrap();
    force.iter().flatten().copied().collect()
}

/// The step of central differences: truncation and rounding are both near 1e-9 of the third derivatives and the forces.
const STEP: f64 = 1e-5;

/// Central differences of the force by the entries that `entry` returns.
fn differences(system: &System, state: &State, entry: impl Fn(&mut State, usize) -> &mut f64) -> DMatrix<f64> {
    let n = 3 * system.particles();
    let mut matrix = DMatrix::zeros(n, n);
    for column in 0..n {
        let at = |step: f64| {
            let mut moved = state.clone();
            *entry(&mut moved, column) += step;
            force(system, &moved)
        };
        let (above, below) = (at(STEP), at(-STEP));
        (0..n).for_each(|row| matrix[(row, column)] = (above[row] - below[row]) / (2.0 * STEP));
    }
    matrix
}

fn nearly(a: &DMatrix<f64>, b: &DMatrix<f64>) -> bool {
    (a - b).amax() < 1e-5 * (1.0 + b.amax())
}

/// K and G are the derivatives of the forces. K is compared at rest, as it lacks the derivative of damping forces of springs that turn.
#[test]
fn matrices_are_derivatives_of_forces() {
    let (system, mut state) = falling();
    for (p, (x, v)) in state.positions.iter_mut().zip(&mut state.velocities).enumerate() {
        x.y -= 0.065;
        *v = Vector3::new(0.3, 0.2 - 0.1 * p as f64, 0.1 * (p * p) as f64);
    }
    let matrices = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1).unwrap();
    let [k, g] = [&matrices.k, &matrices.g].map(|matrix| DMatrix::from(&matrix.to_csc()));
    let by_velocity = differences(&system, &state, |state, at| &mut state.velocities[at / 3][at % 3]);
    assert!(nearly(&g, &by_velocity), "{}", g - by_velocity);
    let mut still = state.clone();
    still.velocities.fill(Vector3::zeros());
    let by_position = differences(&system, &still, |state, at| &mut state.positions[at / 3][at % 3]);
    assert!(nearly(&k, &by_position), "{}", k - by_position);
}

/// A particle on a spring without a rest length, 4 N/m and 1 kg, that starts where it is held at 1 m/s: x = sin(2t)/2, through zero after π/2.
#[test]
fn springs_without_a_rest_length_pass_through_zero() {
    let (system, mut start) = tethered(0.0, 1.0, Spring { stiffness: 4.0, rest_length: 0.0, damping: 0.0 });
    start.velocities[1] = Vector3::new(0.6, 0.0, 0.8);
    // Errors of about h, h² and h⁴ times some powers of ω = 2/s.
    for (method, steps, most) in [
        (Method::LinearBackwardEuler, 1000, 2e-2),
        (Method::Bdf2, 1000, 1e-4),
        (Method::W2, 1000, 1e-4),
        (Method::Verlet, 1000, 1e-4),
        (Method::Rodas4, 1000, 1e-10),
        (Method::Dop853, 100, 1e-10),
    ] {
        let (mut state, mut stepper) = (start.clone(), stepper(method, &system, &start));
        (0..steps).for_each(|_| stepper.step(&mut state, 2.0 / f64::from(steps)).unwrap());
        let error = (state.positions[1] - Vector3::new(0.6, 0.0, 0.8) * (0.5 * 4.0_f64.sin())).norm();
        assert!(error < most, "{}: {error:e}", method.name());
    }
}

/// With its derivatives all methods agree on a stiff floor, with steps that are long against its own period of 14 ms.
#[test]
fn a_stiff_floor_is_the_same_to_all_methods() {
    let (system, start) = falling();
    let run = |method: Method, dt: f64| {
        let (mut state, mut stepper) = (start.clone(), stepper(method, &system, &start));
        (0..(0.25 / dt).round() as u32).for_each(|_| stepper.step(&mut state, dt).unwrap());
        state.positions
    };
    let exact = run(Method::Verlet, 1e-5);
    let errors = [Method::LinearBackwardEuler, Method::Bdf2, Method::W2, Method::Rodas4].map(|method| {
        let found = run(method, 1e-3);
        found.iter().zip(&exact).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    });
    // The patch is 0.3 m wide. Contact begins within a step, where the floor's damping jumps, which costs every method an error of first order in it.
    assert!(errors.iter().all(|&error| error < 1e-2), "{errors:?}");
}

/// A force with an indefinite derivative: `full` has all of it, `tension` the stable part.
#[derive(Debug)]
struct Saddle;

impl ExternalForce for Saddle {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        for (f, x) in force.iter_mut().zip(at.positions) {
            *f += Vector3::new(50.0 * x.y, 50.0 * x.x, 0.0);
        }
    }

    fn has_derivatives(&self) -> bool {
        true
    }

    fn add_derivatives(&self, _: &StateView<'_>, derivatives: &mut [Derivatives]) {
        let block = Matrix3::new(0.0, 50.0, 0.0, 50.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        derivatives.iter_mut().for_each(|derivatives| derivatives.stiffness += block);
    }
}

#[test]
fn options_keep_the_stable_part_of_forces_from_outside() {
    let (system, state) = scene(&[([0.1, 0.2, 0.0], 1.0)], &[]).build().unwrap();
    let system = system.with_external_force(Saddle);
    let k = |option| DMatrix::from(&StepMatrices::assemble(&system, &state, option, 1.0).unwrap().k.to_csc());
    assert_eq!((k(Stiffness::Full)[(1, 0)], k(Stiffness::Full)[(0, 0)]), (50.0, 0.0));
    let stable = k(Stiffness::Tension);
    assert!((stable[(0, 0)] + 25.0).abs() < 1e-12 && (stable[(1, 0)] - 25.0).abs() < 1e-12, "{stable}");
    // 1/dt² = 1 is less than 50: the default takes the stable part.
    let mut moved = state.clone();
    stepper(Method::LinearBackwardEuler, &system, &state).step(&mut moved, 1.0).unwrap();
    assert!(moved.is_finite());
}

/// Springs that stiffen with the cube of their strain, each by another coefficient.
#[derive(Debug)]
struct Cubic;

impl SpringLaw for Cubic {
    fn tension(&self, number: usize, spring: &Spring, length: f64) -> Tension {
        let (k, strain, c) = (spring.stiffness, length / spring.rest_length - 1.0, 1.0 + number as f64);
        let slope = k * (1.0 + 3.0 * c * strain * strain) / spring.rest_length;
        Tension { force: k * (strain + c * strain.powi(3)), slope }
    }

    fn energy(&self, number: usize, spring: &Spring, length: f64) -> f64 {
        let (strain, c) = (length / spring.rest_length - 1.0, 1.0 + number as f64);
        spring.stiffness * spring.rest_length * (strain.powi(2) / 2.0 + c * strain.powi(4) / 4.0)
    }
}

/// The same, evaluated for all springs at once only.
#[derive(Debug)]
struct AtOnce(Arc<AtomicUsize>);

impl SpringLaw for AtOnce {
    fn tension(&self, number: usize, _: &Spring, _: f64) -> Tension {
        unreachable!("spring {number} was evaluated alone")
    }

    fn energy(&self, number: usize, _: &Spring, _: f64) -> f64 {
        unreachable!("spring {number} was evaluated alone")
    }

    fn is_asked_at_once(&self) -> bool {
        true
    }

    fn values(&self, springs: &[Spring], lengths: &[f64]) -> Vec<LawValue> {
        self.0.fetch_add(1, Ordering::Relaxed);
        Cubic.values(springs, lengths)
    }
}

/// A damped chain with one end held and the other on a path with a kink; the last spring is between prescribed particles.
fn chain() -> (System, State) {
    let numbers = std::array::from_fn::<_, 8, _>(|p| p as f64);
    let particles = numbers.map(|p| ([p, 0.1 * p * p, 0.3 * (p % 3.0)], 1.0 + 0.2 * p));
    let springs = numbers.map(|p| (p as usize, p as usize + 1, [150.0 + p, 0.9 + 0.05 * p, 0.2 * (p % 2.0)]));
    let mut builder = scene(&particles, &springs[..7]);
    builder.gravity(0.0, -9.81, 0.0).hold(0);
    let offsets = [0.0, 0.02, 0.01].map(Vector3::repeat).into();
    let motion = Motion::Path { times: vec![0.0, 0.013, 0.03], offsets };
    builder.constrain(Constraint { particles: vec![6, 7], axes: Axes::first(3), motion });
    builder.build().unwrap()
}

/// A law evaluated for all springs at once gives the same motions, energies and accounts, to the bit, as evaluated one by one.
#[test]
fn laws_are_evaluated_at_once() {
    let calls = Arc::new(AtomicUsize::new(0));
    let (plain, start) = chain();
    let systems = [plain.clone().with_spring_law(Cubic), plain.with_spring_law(AtOnce(calls.clone()))];
    let moment = start.moment();
    let [one, all] = systems.each_ref().map(|system| {
        let reactions = Reactions::at(system, &start).unwrap().forces;
        (Energy::of(system, &start), reactions, system.springs_at(&moment))
    });
    assert_eq!(one, all);
    assert_eq!(calls.swap(0, Ordering::Relaxed), 3);
    for method in Method::ALL {
        let [one, all] = systems.each_ref().map(|system| {
            let (mut state, mut stepper) = (start.clone(), stepper(method, system, &start));
            let mut monitor = Monitor::new(system, &state, MonitorOptions::default()).unwrap();
            for step in 1..=10 {
                stepper.step(&mut state, 2e-3).unwrap();
                monitor.enter(step, &state, 2e-3).unwrap();
            }
            let balance = monitor.balance();
            (state, monitor.energy(), [balance.work, balance.dissipated], stepper.statistics().work)
        });
        assert_eq!(one, all, "{method:?}");
        let evaluations = all.3.force_evaluations as usize;
        // For forces and their derivatives at each configuration, and for the energies at the end of a step.
        let found = calls.swap(0, Ordering::Relaxed);
        assert!(found <= 2 * evaluations + 3 * 10 + 5, "{method:?}: {found} times in {evaluations} evaluations");
    }
}
