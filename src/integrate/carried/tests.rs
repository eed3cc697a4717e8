use super::CarriedErrors;
use crate::force::Extensions;
use crate::integrate::implicit::LinearSystem;
use crate::integrate::oscillator::{Oscillator, Way};
use crate::integrate::{AdaptiveStepper, ImplicitOptions, Rodas4, TimeStepper};
use crate::linear::{Definiteness, Held, LinearSolver, Solution, SolveFailure};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use crate::work::Work;
use nalgebra::{Complex, Vector3};

/// Of one particle among two, along an axis.
fn difference(axis: usize, [x, v]: [f64; 2]) -> CarriedErrors {
    let along = |value: f64| vec![Vector3::zeros(), Vector3::ith(axis, value)];
    CarriedErrors { positions: along(x), velocities: along(v) }
}

/// Carries over a step of h seconds from a state, with a solver of its own where one is given.
fn carry(
    system: &System,
    state: &State,
    h: f64,
    errors: &mut CarriedErrors,
    solver: Option<Box<dyn LinearSolver>>,
) -> u64 {
    let options = ImplicitOptions::default();
    let linear = match solver {
        None => LinearSystem::new(system, state, &options),
        Some(solver) => LinearSystem::with_solver(system, state, &options, solver),
    };
    let mut linear = linear.unwrap();
    linear.set_extensions(&state.positions).unwrap();
    linear.prepare_whole(Combination::step(0.25 * h)).unwrap();
    let [mut force, mut middle] = [(); 2].map(|()| vec![Vector3::repeat(7.0); system.particles()]);
    errors.carry(&mut linear, 0.25 * h, [&mut force, &mut middle]);
    linear.statistics.work.solves
}

/// What moves as `Re(a)` becomes `Re(R(hλ) a)`, R being that of two steps of the midpoint rule.
#[test]
fn differences_go_on_as_the_linearised_motion_does() {
    for (way, damping, axis) in [(Way::Along, 0.0, 0), (Way::Along, 1.5, 0), (Way::Across, 0.0, 1)] {
        let oscillator = Oscillator::new(way, damping, 1.25);
        let a = Complex::new(0.07, -0.04);
        for h in [0.1, 3.0, 1e4] {
            let mut errors = difference(axis, oscillator.motion(a));
            assert_eq!(carry(&oscillator.system, &oscillator.start, h, &mut errors, None), 2);
            let z = oscillator.lambda * h;
            let factor = ((1.0 + z / 4.0) / (1.0 - z / 4.0)).powi(2);
            let [x, v] = oscillator.motion(factor * a);
            let found = [errors.positions[1][axis], errors.velocities[1][axis]];
            assert!((found[0] - x).abs() < 1e-10 && (found[1] - v).abs() < 1e-10, "{way:?} {h}: {found:?} {x} {v}");
            assert!(way == Way::Across || errors.positions[0] == Vector3::zeros());
        }
    }
}

/// A chain of three links that swings and turns over, let go a little beside where it is: what is carried along one motion is the difference of the two, the
/// better the shorter the steps.
#[test]
fn what_is_carried_is_the_difference_of_two_motions() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    for p in 0..4 {
        builder.particle([f64::from(p), 0.0, 0.0], 1.0);
    }
    for p in 0..3 {
        builder.spring(p, p + 1, Spring { stiffness: 300.0, rest_length: 1.0, damping: 0.0 });
    }
    builder.hold(0);
    let (system, start) = builder.build().unwrap();
    let (aside, part) = (Vector3::new(0.002, 0.008, 0.004), 1e-4);
    let error = |h: f64, steps: u32| {
        let [mut motion, mut beside] = [start.clone(), start.clone()];
        beside.positions[3] += aside * part;
        let mut first = CarriedErrors::none(&system);
        first.positions[3] = aside;
        for (state, carries) in [(&mut motion, true), (&mut beside, false)] {
            let mut stepper = Rodas4::new(&system, state, &ImplicitOptions::default()).unwrap();
            if carries {
                stepper.carry_errors(first.clone());
            }
            for _ in 0..steps {
                stepper.step(state, h).unwrap();
            }
            if let Some(errors) = stepper.carried_errors() {
                first.clone_from(errors);
            }
        }
        let differences = beside.positions.iter().zip(&motion.positions).map(|(a, b)| (a - b) / part);
        let wrong: f64 = differences.zip(&first.positions).map(|(d, carried)| (d - carried).norm_squared()).sum();
        wrong.sqrt() / first.norm(&system)
    };
    let [coarse, fine] = [error(0.01, 200), error(0.005, 400)];
    assert!(fine < 0.05 && coarse > 1.7 * fine, "{coarse} {fine}");
}

/// Steps add their own errors: after the first there is nothing else.
#[test]
fn errors_of_steps_are_added() {
    let Oscillator { system, start, .. } = Oscillator::new(Way::Along, 0.3, 1.25);
    let mut stepper = Rodas4::new(&system, &start, &ImplicitOptions::default()).unwrap();
    assert!(stepper.carried_errors().is_none());
    stepper.carry_errors(CarriedErrors::none(&system));
    let mut state = start.clone();
    stepper.step(&mut state, 0.2).unwrap();
    let error = stepper.local_error().unwrap();
    let norm = |stepper: &Rodas4| stepper.carried_errors().unwrap().norm(&system);
    assert!(error > 1e-9 && (norm(&stepper) / error - 1.0).abs() < 1e-12);
    // A step that is tried does nothing to them as long as it is not accepted.
    stepper.try_step(&state, 0.2).unwrap();
    assert!((norm(&stepper) / error - 1.0).abs() < 1e-12);
    stepper.accept(&mut state);
    assert!((norm(&stepper) / error - 1.0).abs() > 0.1);
}

/// When a run begins matters to nothing: steps of 1/16 s are exact from second 128 on as they are from the beginning.
#[test]
fn errors_are_carried_by_the_length_of_the_step() {
    let (system, start) = crate::system::fixtures::oscillator();
    let [from_zero, later] = [0.0, 128.0].map(|time| {
        let mut state = State { time, ..start.clone() };
        let mut stepper = Rodas4::new(&system, &state, &ImplicitOptions::default()).unwrap();
        stepper.carry_errors(CarriedErrors::none(&system));
        for _ in 0..4 {
            stepper.try_step(&state, 0.0625).unwrap();
            stepper.accept(&mut state);
        }
        stepper.carried_errors().unwrap().norm(&system)
    });
    assert!(from_zero > 0.0 && from_zero == later, "{from_zero:e} {later:e}");
}

/// Steps that err by nothing, as where nothing moves.
#[test]
fn no_errors_are_carried_where_there_are_none() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    let (system, mut state) = builder.build().unwrap();
    let mut stepper = Rodas4::new(&system, &state, &ImplicitOptions::default()).unwrap();
    stepper.carry_errors(CarriedErrors::none(&system));
    stepper.step(&mut state, 0.1).unwrap();
    assert_eq!(stepper.carried_errors(), Some(&CarriedErrors::none(&system)));
}

/// Takes any matrix, and solves nothing.
struct Refusing;

impl LinearSolver for Refusing {
    fn name(&self) -> &'static str {
        "refusing"
    }

    fn take(&mut self, _: &SystemOperator, _: &mut Work) -> Result<Definiteness, SolveFailure> {
        Ok(Definiteness::Positive)
    }

    fn solve(&mut self, _: Held<'_>, _: &[f64], _: &mut [f64], _: &mut Work) -> Result<Solution, SolveFailure> {
        Err(SolveFailure::NonFinite)
    }
}

#[test]
fn differences_that_cannot_be_carried_stay_as_they_are() {
    let Oscillator { system, start, .. } = Oscillator::new(Way::Along, 0.3, 1.25);
    let nothing = difference(0, [0.0; 2]);
    for (given, solver) in
        [(difference(0, [1.0, 2.0]), Some(Box::new(Refusing) as Box<dyn LinearSolver>)), (nothing, None)]
    {
        let mut errors = given.clone();
        assert_eq!(carry(&system, &start, 0.1, &mut errors, solver), 0);
        assert_eq!(errors, given);
    }
    // A velocity alone moves.
    let mut errors = difference(0, [0.0, 1.0]);
    carry(&system, &start, 0.1, &mut errors, None);
    assert!((errors.positions[1].x / 0.1 - 1.0).abs() < 0.1);
}

#[test]
fn what_was_kept_goes_on_in_the_same_system_only() {
    let Oscillator { system, .. } = Oscillator::new(Way::Along, 0.3, 1.25);
    let errors = difference(2, [0.3, -0.1]);
    let mut kept = errors.kept();
    assert_eq!(CarriedErrors::of(&system, &kept), errors);
    kept[1].pop();
    assert_eq!(CarriedErrors::of(&system, &kept), CarriedErrors::none(&system));
}

/// Springs of 0.5 m, pressed to half of it, and of 1 m, drawn to twice of it, between particles of 1, 3 and 3 kg, the last of which is free along y
/// alone. What is apart too far is drawn together, by masses and velocities alike, one spring after the other; what is within the limit, or moves as
/// a whole, is not.
#[test]
fn ends_of_springs_differ_by_half_their_length_at_most() {
    let mut builder = SystemBuilder::new();
    for (x, mass) in [(0.25, 1.0), (0.5, 3.0), (2.5, 3.0)] {
        builder.particle([x, 0.0, 0.0], mass);
    }
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 0.5, damping: 0.0 });
    builder.spring(1, 2, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0, 2]), motion: Motion::Held });
    let (system, state) = builder.build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let limited = |positions: [[f64; 3]; 3], velocities: [[f64; 3]; 3]| {
        let mut errors = CarriedErrors::of(&system, &[positions.to_vec(), velocities.to_vec()]);
        errors.limit(&system, &extensions);
        errors.kept().map(|rows| <[[f64; 3]; 3]>::try_from(rows).unwrap())
    };
    let still = [[0.0; 3]; 3];
    let near = [[0.125, 0.0, 0.0], [-0.125, 0.0, 0.0], [0.0; 3]];
    let as_a_whole = [[0.0, 7.0, 0.0], [0.0, 7.25, 0.0], [0.0, 7.5, 0.0]];
    for within in [near, as_a_whole] {
        assert_eq!(limited(within, as_a_whole), [within, as_a_whole]);
    }
    // Half a metre apart where a quarter is the most: half is taken off, three parts of four of it by the lighter end; and of 8 m/s.
    let found = limited([[0.0, 0.5, 0.0], [0.0; 3], [0.0; 3]], [[8.0, 0.0, 0.0], [0.0; 3], [0.0; 3]]);
    let expected = [[0.0, 0.5 - 0.1875, 0.0], [0.0, 0.0625, 0.0], [0.0; 3]];
    assert_eq!(found, [expected, [[8.0 - 3.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]]]);
    // Four times as much is made that first.
    let found = limited([[0.0, 2.0, 0.0], [0.0; 3], [0.0; 3]], [[32.0, 0.0, 0.0], [0.0; 3], [0.0; 3]]);
    assert_eq!(found, [expected, [[8.0 - 3.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]]]);
    // Two metres where one is the most: each end goes halfway, but along axes that are prescribed.
    for (given, expected) in [([0.0, 2.0, 0.0], [0.0, 0.5, 0.0]), ([0.0, 0.0, 2.0], [0.0; 3])] {
        let found = limited([given, given, [0.0; 3]], still)[0];
        assert_eq!(found, [given, given.map(|x: f64| 0.75 * x), expected]);
    }
}

/// Ten metres long, so that half of it is more than a metre or two.
#[test]
fn both_ends_of_a_long_spring_give_way() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([10.0, 0.0, 0.0], 2.0);
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 10.0, damping: 0.0 });
    let (system, state) = builder.build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let along = |[i, j]: [f64; 2]| vec![[i, 0.0, 0.0], [j, 0.0, 0.0]];
    let mut errors = CarriedErrors::of(&system, &[along([3.0, -3.0]), along([1.0, -5.0])]);
    errors.limit(&system, &extensions);
    let expected = CarriedErrors::of(&system, &[along([2.5, -2.5]), along([0.5, -4.5])]);
    errors.add(-1.0, &expected.positions, &expected.velocities);
    assert!(errors.norm(&system) < 1e-14 && errors.velocities.iter().all(|v| v.norm() < 1e-14), "{errors:?}");
}

#[test]
fn what_is_added_has_its_sign() {
    let mut errors = difference(1, [0.5, -0.25]);
    let [x, v] = [1.0, 2.0].map(|value| vec![Vector3::zeros(), Vector3::y() * value]);
    errors.add(0.25, &x, &v);
    assert_eq!(errors, difference(1, [0.75, 0.25]));
}
