//! The formulas of the ledger against integrals by hand.

use super::driven::Drive;
use super::particles::Particles;
use super::springs::{Springs, resolved_step};
use super::{Figures, Monitor, MonitorOptions, Warning, percent};
use crate::integrate::{ImplicitOptions, Method, Schedule, StiffnessPolicy, run_monitored};
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;
use std::ops::ControlFlow;

/// Two particles on the x axis, joined by a spring of given damping.
pub(super) fn pair(damping: f64) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([1.0, 0.0, 0.0], 3.0);
    builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 0.5, damping });
    builder.build().unwrap()
}

fn at(start: &State, x: f64, v: f64) -> State {
    let mut state = start.clone();
    state.positions[1].x = x;
    state.velocities[1].x = v;
    state
}

/// l = 1 + r₀t + r₁t²/2 + r₂t³/3: its rate is a parabola, and the integral of its square is exact.
#[test]
fn a_rate_that_is_a_parabola_is_integrated_exactly() {
    let (system, start) = pair(0.7);
    let [r0, r1, r2, h] = [0.3, -2.0, 5.0, 0.02];
    let rate = |t: f64| r0 + r1 * t + r2 * t * t;
    let mut springs = Springs::new(&system, &at(&start, 1.0, r0), std::iter::empty(), true);
    let sums = springs.enter(&at(&start, 1.0 + h * (r0 + h * (r1 / 2.0 + h * r2 / 3.0)), rate(h)), h);
    // ∫ (r₀ + r₁t + r₂t²)² dt.
    let integral =
        h * (r0 * r0 + h * (r0 * r1 + h * ((r1 * r1 + 2.0 * r0 * r2) / 3.0 + h * (r1 * r2 / 2.0 + h * r2 * r2 / 5.0))));
    approx::assert_relative_eq!(sums.dissipated, 0.7 * integral, max_relative = 1e-9);
    let mean = r0 + h * (r1 / 2.0 + h * r2 / 3.0);
    approx::assert_relative_eq!(sums.certain, 0.7 * h * mean * mean, max_relative = 1e-9);
    assert!(sums.certain < sums.dissipated);
}

/// Where steps do not resolve a spring only what is certain counts. Its own times: 1/sqrt(k/(l0 μ)) and μ/b, μ = 6/5 kg.
#[test]
fn unresolved_springs_dissipate_what_is_certain() {
    let (system, start) = pair(0.7);
    let longest = resolved_step(&system, 0);
    approx::assert_relative_eq!(longest, (0.5 * 1.2 / 6.0f64).sqrt(), max_relative = 1e-14);
    approx::assert_relative_eq!(resolved_step(&pair(70.0).0, 0), 1.2 / 70.0, max_relative = 1e-14);
    for (h, is_resolved) in [(0.999 * longest, true), (1.001 * longest, false)] {
        let mut springs = Springs::new(&system, &at(&start, 1.0, 0.3), std::iter::empty(), true);
        let sums = springs.enter(&at(&start, 1.05, -0.2), h);
        assert_eq!(sums.dissipated > sums.certain, is_resolved, "{h}");
    }
}

/// A turn across the spring of angle θ = h v⊥/l stretches it by l θ²/2.
#[test]
fn turning_is_measured_across_springs() {
    let (system, start) = pair(0.0);
    let mut state = start.clone();
    state.velocities[1] = Vector3::new(0.4, 3.0, 0.0);
    let sums = Springs::new(&system, &start, std::iter::empty(), true).enter(&state, 0.1);
    let lift = 0.5 * 0.3 * 0.3;
    let energy = 0.5 * 12.0 * lift * lift;
    approx::assert_relative_eq!(sums.lifted, energy, max_relative = 1e-12);
    // Over ½ μ v⊥², μ = 6/5 kg.
    approx::assert_relative_eq!(sums.lifted_twice, energy * energy / (0.6 * 9.0), max_relative = 1e-12);
    approx::assert_relative_eq!(sums.reach, 0.01 * (9.0 + 0.16), max_relative = 1e-12);
    // Along the spring nothing turns.
    let sums = Springs::new(&system, &start, std::iter::empty(), true).enter(&at(&start, 1.0, 7.0), 0.1);
    assert!(sums.lifted.abs() < 1e-12 && sums.lifted_twice.abs() < 1e-12);
}

/// A spring between a held particle and one that is led straight away from it: T = κ(l − l0) + b u, and the work is
/// `∫ T u dt`, elastic energy gained and dissipation.
#[test]
fn a_led_particle_does_the_work_that_its_spring_takes() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([1.0, 0.0, 0.0], 3.0);
    builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 0.5, damping: 0.7 });
    builder.hold(0);
    let motion = Motion::Velocity(Vector3::new(0.3, 0.0, 0.0));
    builder.constrain(Constraint { particles: vec![1], axes: Axes::of(&[0]), motion });
    let (system, mut state) = builder.build().unwrap();
    state.prescribe(&system);
    let mut drive = Drive::new(&system, &state);
    assert_eq!(drive.springs().collect::<Vec<_>>(), [0]);
    approx::assert_relative_eq!(drive.energy(&state).kinetic, 0.5 * 3.0 * 0.09, max_relative = 1e-14);
    let h = 0.05;
    state.time = h;
    // What the state says of the velocity after the step is another matter.
    state.prescribe(&system);
    state.velocities[1].x = 99.0;
    let exchange = drive.pass(&state, h);
    let elastic = |l: f64| 0.5 * 12.0 * (l - 0.5) * (l - 0.5);
    let dissipated = 0.7 * 0.09 * h;
    approx::assert_relative_eq!(exchange.dissipated, dissipated, max_relative = 1e-12);
    approx::assert_relative_eq!(exchange.certain, dissipated, max_relative = 1e-12);
    approx::assert_relative_eq!(exchange.work, elastic(1.015) - elastic(1.0) + dissipated, max_relative = 1e-12);
}

/// Norms over free coordinates only, and second differences with their ratio of steps.
#[test]
fn changes_of_velocity_are_measured_on_free_coordinates() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([1.0, 0.0, 0.0], 3.0);
    builder.constrain(Constraint { axes: Axes::of(&[1]), ..Constraint::hold([1]) });
    let (system, start) = builder.build().unwrap();
    let mut particles = Particles::new(&system, &start, true);
    let mut state = start.clone();
    state.velocities = vec![Vector3::new(0.0, 0.0, 2.0), Vector3::new(1.0, 50.0, 2.0)];
    let force = [Vector3::new(0.0, 0.0, 38.0), Vector3::new(30.0, 7.0, 60.0)];
    let sums = particles.pass(&state, 0.1, Some(&force));
    approx::assert_relative_eq!(sums.change, 4.0 + 1.0 + 4.0, max_relative = 1e-14);
    assert_eq!(sums.bend, 0.0);
    // M Δv/h is (0, 0, 40) and (30, ·, 60).
    approx::assert_relative_eq!(sums.defect, 4.0, max_relative = 1e-12);
    approx::assert_relative_eq!(sums.inertia, 1600.0 + 900.0 + 3600.0, max_relative = 1e-12);
    // x stays, so that it lags h (v + v')/2 behind.
    approx::assert_relative_eq!(sums.slip, 0.0025 * 9.0, max_relative = 1e-12);
    for v in &mut state.velocities {
        v.z += 5.0;
    }
    let sums = particles.pass(&state, 0.2, None);
    // Δv = (0, 0, 5), after twice the step: less 2 (0, 0, 2) and 2 (1, ·, 2).
    approx::assert_relative_eq!(sums.bend, 1.0 + 4.0 + 1.0, max_relative = 1e-12);
    assert_eq!(sums.defect, 0.0);
}

/// The sums of many blocks are those of one thread, to the bit.
#[test]
fn sums_do_not_depend_on_threads() {
    let (system, start) = crate::scene::builtin::cloth(60).unwrap().build().unwrap();
    assert!(system.springs().len() > 2 * 4096);
    let figures = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let options = MonitorOptions { forces: true, stops_unstable: false, ..MonitorOptions::default() };
            let mut monitor = Monitor::new(&system, &start, options).unwrap();
            let mut state = start.clone();
            for step in 1..=3 {
                for (p, v) in state.velocities.iter_mut().enumerate() {
                    *v += Vector3::new((p as f64).sin(), 0.3 * (p as f64).cos(), 0.1);
                }
                for (x, v) in state.positions.iter_mut().zip(&state.velocities) {
                    *x += v * 1e-3;
                }
                monitor.enter(step, &state, 1e-3, None).unwrap();
            }
            (monitor.figures(&state), monitor.balance())
        })
    };
    assert_eq!(figures(1), figures(3));
}

/// Every particle is moved, and moves, in another way.
pub(super) fn disturb(state: &mut State) {
    for (p, (x, v)) in state.positions.iter_mut().zip(&mut state.velocities).enumerate() {
        *v = Vector3::new((p as f64).sin(), 0.3 * (p as f64).cos(), 0.1);
        *x += *v * 1e-3;
    }
}

/// What a method's indicators are made of is looked at, and what is not asked for stays zero.
#[test]
fn figures_of_a_method_are_those_that_its_indicators_need() {
    let (system, mut start) = crate::scene::builtin::cloth(5).unwrap().build().unwrap();
    disturb(&mut start);
    for method in Method::ALL {
        let needed = MonitorOptions::of(method, StiffnessPolicy::OnDemand);
        let all = MonitorOptions { forces: needed.forces, ..MonitorOptions::default() };
        let [of_method, of_all] = [needed, all].map(|options| {
            let mut state = start.clone();
            let options = MonitorOptions { stops_unstable: false, ..options };
            let mut monitor = Monitor::new(&system, &state, options).unwrap();
            let mut stepper = method.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
            let schedule = Schedule::steps(2e-4, 40);
            run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
            monitor.figures(&state)
        });
        assert!(of_method.estimate(method).is_some_and(|estimate| estimate > 0.0 || method == Method::Dop853));
        assert_eq!(of_method.estimate(method), of_all.estimate(method), "{}", method.name());
        assert_eq!(of_method.warnings(method, None), of_all.warnings(method, None), "{}", method.name());
        assert!([of_all.lifted, of_all.third, of_all.slip].iter().all(|&figure| figure > 0.0));
        assert_eq!([of_method.lifted, of_method.lifted_twice].map(|figure| figure > 0.0), [needed.turning; 2]);
        assert_eq!([of_method.third, of_method.slip].map(|figure| figure > 0.0), [needed.paths; 2]);
    }
}

/// Where a stiff rod turns in long steps, what these brake is most of the estimate of the methods that do.
#[test]
fn methods_that_brake_look_at_springs_that_turn() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 1e6, rest_length: 1.0, damping: 0.0 });
    let (system, mut start) = builder.build().unwrap();
    start.velocities = vec![Vector3::new(0.0, -1.0, 0.0), Vector3::new(0.0, 1.0, 0.0)];
    for method in [Method::W2, Method::Rodas4] {
        let options = MonitorOptions::of(method, StiffnessPolicy::OnDemand);
        let mut state = start.clone();
        let mut monitor = Monitor::new(&system, &state, options).unwrap();
        let mut stepper = method.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
        let schedule = Schedule::steps(0.02, 20);
        run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
        let figures = monitor.figures(&state);
        let unseen = Figures { lifted: 0.0, lifted_twice: 0.0, ..figures };
        assert!(figures.estimate(method) > unseen.estimate(method), "{}: {figures:?}", method.name());
    }
}

/// Figures of a run of ten steps in which nothing is wrong.
fn harmless() -> Figures {
    Figures { steps: 10, duration: 1.0, extent: 1.0, exchanged: 1.0, ..Figures::default() }
}

#[test]
fn estimates_follow_the_truncation_errors_of_the_methods() {
    let figures = Figures {
        change: 0.1,
        bend: 0.06,
        third: 0.048,
        slip: 0.001,
        start: 0.5,
        defect: 9.0,
        embedded: 0.7,
        ..harmless()
    };
    for (method, estimate) in [
        (Method::ForwardEuler, 0.1),
        (Method::BackwardEuler, 0.1),
        (Method::LinearBackwardEuler, 0.3),
        // ωh = 0.3, ωT = 3.
        (Method::SymplecticEuler, 0.5 / 3.0 + 0.002),
        (Method::W2, 0.0025),
        (Method::Bdf2, 0.001),
        (Method::ImplicitMidpoint, 0.0025),
    ] {
        approx::assert_relative_eq!(figures.estimate(method).unwrap(), estimate, max_relative = 1e-12);
    }
    // Orders above two: the sum of the method's own estimates.
    assert_eq!([Method::Rodas4, Method::Dop853].map(|method| figures.estimate(method)), [Some(0.7); 2]);
    // Methods with directions from the step's start lag by a quarter of the way times what turning springs took, all of it at most.
    let turning = Figures { lifted: 2.0, lifted_twice: 1.0, way: 8.0, ..figures };
    approx::assert_relative_eq!(turning.estimate(Method::W2).unwrap(), 2.0 * 0.293 * 2.0, max_relative = 1e-12);
    approx::assert_relative_eq!(turning.estimate(Method::Rodas4).unwrap(), 2.0 * 0.4, max_relative = 1e-12);
    assert_eq!(Figures { lifted: 9.0, ..turning }.estimate(Method::W2), Some(2.0));
    assert_eq!([Method::Dop853, Method::Bdf2].map(|method| turning.estimate(method)), [Some(0.7), Some(0.001)]);
    // Linearising is no help, even where it leaves out next to nothing; steps that do not resolve what rings make it no worse.
    assert_eq!(Figures { defect: 0.01, ..figures }.estimate(Method::LinearBackwardEuler), Some(0.1));
    let ringing = Figures { bend: 0.4, ..figures };
    approx::assert_relative_eq!(ringing.estimate(Method::ImplicitMidpoint).unwrap(), 0.4 / 24.0 / 16.0);
    // A number that is none is no estimate.
    assert_eq!(Figures { change: f64::INFINITY, ..figures }.estimate(Method::BackwardEuler), None);
    assert_eq!(Figures { change: f64::NAN, ..figures }.estimate(Method::BackwardEuler), None);
}

/// A pair that turns and vibrates; nothing holds it.
fn figures_in_flight(velocity: Vector3<f64>, gravity: Vector3<f64>) -> Figures {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([1.0, 0.0, 0.0], 3.0);
    builder.spring(0, 1, Spring { stiffness: 600.0, rest_length: 0.9, damping: 0.0 });
    builder.gravity(gravity.x, gravity.y, gravity.z);
    let (system, mut state) = builder.build().unwrap();
    state.velocities = vec![velocity + Vector3::new(0.0, -0.3, 0.0), velocity + Vector3::new(0.1, 0.4, 0.2)];
    let mut stepper = Method::BackwardEuler.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
    let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
    let schedule = Schedule::steps(0.01, 50);
    run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
    monitor.figures(&state)
}

/// A scene that nothing holds moves the same wherever it flies, and its figures say so.
#[test]
fn figures_are_those_about_the_centre_of_mass() {
    let still = figures_in_flight(Vector3::zeros(), Vector3::zeros());
    assert!(still.way > 0.1 && still.exchanged > 0.1 && still.lost > 0.01 * still.exchanged && still.lost_way > 0.1);
    let flying = figures_in_flight(Vector3::new(30.0, -20.0, 10.0), Vector3::new(0.0, -9.8, 1.0));
    // Energies of 3500 J, rounded, and forces that are met to 1e-10.
    for (still, flying) in [
        (still.way, flying.way),
        (still.exchanged, flying.exchanged),
        (still.lost, flying.lost),
        (still.lost_way, flying.lost_way),
        (still.lifted, flying.lifted),
    ] {
        approx::assert_relative_eq!(still, flying, max_relative = 1e-6);
    }
}

#[test]
fn warnings_name_the_cause() {
    let warnings = |figures: Figures, method| figures.warnings(method, None);
    assert_eq!(warnings(harmless(), Method::LinearBackwardEuler), []);
    let wrong = Figures { change: 0.04, ..harmless() };
    assert_eq!(warnings(wrong, Method::BackwardEuler), [Warning::Wrong(0.04)]);
    assert_eq!(warnings(wrong, Method::SymplecticEuler), []);
    let turning = Figures { defect: 100.0, lost: 0.5, ..wrong };
    assert_eq!(warnings(turning, Method::LinearBackwardEuler), [Warning::Wrong(0.4), Warning::Turning(100.0)]);
    let damped = Warning::Damped { lost: 0.5, exchanged: 1.0 };
    assert_eq!(warnings(turning, Method::BackwardEuler), [Warning::Wrong(0.04), damped]);
    // What is damped away matters of itself only where it could have moved something.
    let damped = Figures { change: 0.005, lost: 0.7, lost_way: 0.9, can_fold: true, ..harmless() };
    let warning = Warning::Damped { lost: 0.7, exchanged: 1.0 };
    assert_eq!([Method::BackwardEuler, Method::W2].map(|m| warnings(damped, m)), [[warning], [warning]].map(Vec::from));
    assert_eq!(warnings(Figures { can_fold: false, ..damped }, Method::BackwardEuler), []);
    assert_eq!(warnings(Figures { lost_way: 0.7, ..damped }, Method::BackwardEuler), []);
    assert_eq!(damped.warnings(Method::BackwardEuler, Some(1e-2)), []);
    // Braking has an estimate of its own, and is the cause that is named.
    let braked = Figures { lifted: 1.0, way: 2.0, lost: 0.3, ..harmless() };
    let estimate = 0.5 * 0.293;
    assert_eq!(warnings(braked, Method::W2), [Warning::Wrong(estimate), Warning::Braked(0.293)]);
    assert_eq!(warnings(Figures { lifted: 0.1, ..braked }, Method::W2), []);
    // Where the ends of springs pass each other and all goes round and round, local errors grow.
    let crumpled = Figures { way: 9.0, reach: 1.5, embedded: 2e-3, ..harmless() };
    let warning = |more| Warning::Crumpled { way: 9.0, more };
    assert_eq!(warnings(crumpled, Method::Rodas4), [warning(10.0), Warning::Long(1.5)]);
    assert_eq!(crumpled.warnings(Method::Dop853, Some(1e-2)).first(), Some(&warning(1000.0)));
    assert_eq!(warnings(crumpled, Method::Bdf2), []);
    for calm in
        [Figures { way: 7.0, ..crumpled }, Figures { reach: 0.2, ..crumpled }, Figures { embedded: 9e-4, ..crumpled }]
    {
        assert_eq!(warnings(calm, Method::Rodas4), []);
    }
    // What the motion has made of errors counts where it is known, and is named, and doubted earlier, where it is ten times what they were.
    let carried = Figures { carried: 0.375, embedded: 1e-3, slip: 1e-3, bend: 1e-3, ..harmless() };
    let magnified = [Warning::Wrong(0.125), Warning::Magnified(0.125 / 1e-3)];
    assert_eq!(warnings(carried, Method::Rodas4), magnified);
    let doubts = |rtol| carried.warnings(Method::Rodas4, Some(rtol));
    assert_eq!((doubts(0.06), doubts(0.065)), (magnified.to_vec(), vec![]));
    assert_eq!(Figures { embedded: 0.02, ..carried }.warnings(Method::Rodas4, Some(0.02)), []);
    for method in [Method::Bdf2, Method::W2, Method::Dop853] {
        assert_eq!((warnings(carried, method), carried.warnings(method, Some(4e-4))), (vec![], vec![]));
    }
    // Bends of paths count for methods that step over them.
    let bent = Figures { aside: 0.2, slip: 0.05, ..harmless() };
    assert_eq!(warnings(bent, Method::Bdf2), [Warning::Wrong(0.2), Warning::Bent(0.2)]);
    assert_eq!(warnings(Figures { aside: 0.01, ..bent }, Method::Bdf2), [Warning::Wrong(0.05)]);
    for method in [Method::Verlet, Method::Rodas4, Method::Dop853] {
        assert_eq!(warnings(bent, method), []);
    }
    let gained = Warning::Gained { gained: 2.1, exchanged: 1.0 };
    let gaining = Figures { gained: 2.1, reach: 1.5, third: 0.0031 * 24.0, ..harmless() };
    assert_eq!(warnings(gaining, Method::SymplecticEuler), [gained, Warning::Long(1.5)]);
    assert_eq!(warnings(Figures { gained: 1.9, ..gaining }, Method::SymplecticEuler), []);
    let made = Figures { gained: 0.1, gained_way: 2.1, ..harmless() };
    assert_eq!(warnings(made, Method::Bdf2), [Warning::Gained { gained: 0.1, exchanged: 1.0 }]);
    assert_eq!(warnings(Figures { gained_way: 1.9, ..made }, Method::Bdf2), []);
    // Vibrations that gain without moving anything far are no harm.
    assert_eq!(warnings(Figures { third: 0.0, start: 0.0, ..gaining }, Method::SymplecticEuler), []);
    // Steps that keep to a tolerance are held to it.
    let slipping = Figures { slip: 0.03, can_fold: true, ..harmless() };
    let doubts = |rtol| slipping.warnings(Method::W2, Some(rtol));
    assert_eq!((doubts(1e-2), doubts(1e-3).first()), (Vec::new(), Some(&Warning::Wrong(0.03))));
    // Of a run without numbers nothing good is said.
    let undefined = Figures { change: f64::NAN, ..harmless() };
    assert_eq!(warnings(undefined, Method::BackwardEuler), [Warning::Wrong(f64::INFINITY)]);
}

#[test]
fn errors_are_told_to_people_in_percent() {
    let texts = [1.9, 0.957, 0.123, 0.0345, 0.00072, 1.23e-7, 1e3].map(percent);
    assert_eq!(texts, ["190 %", "100 %", "12 %", "3.5 %", "0.07 %", "1e-5 %", "more than 9990 %"]);
}

/// A hundred bytes for each of two springs, four hundred and fifty for each of three particles.
#[test]
fn memory_is_asked_for_springs_and_particles() {
    let (system, state) = crate::system::fixtures::row(3);
    let new = || Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
    assert_eq!(crate::memory::watch::asked("what accompanies a run", new).1, 2 * 100 + 3 * 450);
}
