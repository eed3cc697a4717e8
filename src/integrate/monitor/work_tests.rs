//! The work of constraints and external forces, against integrals by hand.

use super::work::Work;
use crate::integrate::fixtures::{actuated, scene};
use crate::system::{Axes, Constraint, Curve, ExternalForce, Loads, Motion, State, StateView};
use nalgebra::Vector3;

/// Grows with time, and differs from particle to particle and from axis to axis.
#[derive(Debug)]
struct Hand;

impl ExternalForce for Hand {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        for (p, f) in force.iter_mut().enumerate() {
            *f += Vector3::new(3.0, 5.0, -4.0) * (at.time + p as f64);
        }
    }
}

/// `Σ ½ (f + f')·(x' − x)` over the free coordinates: of two particles, one of which can move along z alone.
#[test]
fn work_is_the_mean_force_times_the_way() {
    let mut builder = scene(&[([1.0, 2.0, 3.0], 1.0), ([7.0, 0.0, 0.0], 1.0)], &[]);
    builder.constrain(Constraint { axes: Axes::of(&[0, 1]), ..Constraint::hold([1]) });
    let (system, mut state) = builder.build().unwrap();
    let system = system.with_external_force(Hand);
    state.time = 1.0;
    let mut work = Work::new(&system, &state);
    let mut go = |state: &mut State, moves: [[f64; 3]; 2]| {
        let before = state.clone();
        state.time += 2.0;
        state.positions.iter_mut().zip(moves).for_each(|(x, moved)| *x += Vector3::from(moved));
        work.enter(&before, state, 2.0, false).work
    };
    // From 1 s to 3 s: the first particle is pulled by twice (3, 5, −4) in the mean, the second by three times that.
    let expected = 2.0 * (1.5 + 1.25 + 8.0) + 3.0 * -4.0 * 0.125;
    assert_eq!(go(&mut state, [[0.5, 0.25, -2.0], [9.0, 9.0, 0.125]]), expected);
    // From there to 5 s, back by half of that.
    assert_eq!(go(&mut state, [[-0.25, -0.125, 1.0], [0.0; 3]]), -4.0 * (0.75 + 0.625 + 4.0));
}

/// A spring of 6 N and 0.5 m whose rest length changes within a second. At a length that stays, `½ k (l − l0)²/l0` with l0 of 0.05 m instead of
/// 0.5 m, in a single step; while the length changes, to fourth order.
#[test]
fn rest_lengths_that_change_take_up_energy() {
    let scene = |factor| actuated(2, [6.0, 0.5, 0.0], [0.0, 1.0], factor);
    let (system, start) = scene(0.1);
    let after = State { time: 1.0, ..start.clone() };
    let work = Work::new(&system, &start).enter(&start, &after, 1.0, false).work;
    let expected = 3.0 * (0.95 * 0.95 / 0.05 - 0.25 / 0.5);
    assert!((work - expected).abs() < 1e-12 * expected, "{work} {expected}");

    let (system, start) = scene(0.4);
    let at = |time: f64| {
        let mut state = State { time, ..start.clone() };
        state.positions[1].x = 1.0 + 0.3 * (3.0 * time).sin();
        state.velocities[1].x = 0.9 * (3.0 * time).cos();
        state
    };
    let run = |steps: u32| {
        let h = 1.0 / f64::from(steps);
        let mut work = Work::new(&system, &at(0.0));
        (0..steps).map(|k| work.enter(&at(h * f64::from(k)), &at(h * f64::from(k + 1)), h, false).work).sum::<f64>()
    };
    // ∂U/∂t = −½ k (l²/l0² − 1) l0', by the midpoint rule.
    let power = |t: f64| {
        let rest = 0.5 * (1.0 - 0.6 * t);
        3.0 * ((at(t).positions[1].x / rest).powi(2) - 1.0) * 0.3
    };
    let exact = (0..100_000).map(|k| power((f64::from(k) + 0.5) * 1e-5) * 1e-5).sum::<f64>();
    let errors = [8, 16].map(|steps| (run(steps) - exact).abs());
    assert!(errors[0] < 2e-3 * exact && errors[1] < errors[0] / 12.0, "{errors:?} of {exact}");
}

/// Gravity that grows and a velocity that is a parabola in time make `∫ m (g − g(0))·v dt` an integral by hand; an axis that is held, and
/// constant loads times the way.
#[test]
fn gravity_that_changes_works_on_the_way() {
    let mut builder = scene(&[([0.0; 3], 2.0)], &[]);
    builder.constrain(Constraint { axes: Axes::of(&[2]), ..Constraint::hold([0]) });
    let (system, _) = builder.build().unwrap();
    let values = vec![Vector3::new(0.0, -4.0, 7.0), Vector3::new(0.0, 2.0, 9.0)];
    let gravity = Some(Curve { times: vec![0.0, 1.0], values });
    let forces = vec![Vector3::new(5.0, 0.0, 8.0)];
    let system = system.with_loads(Loads { forces, gravity, ..Loads::default() }).unwrap();
    let at = |t: f64| State {
        time: t,
        positions: vec![Vector3::new(t, t * (3.0 + t * (-2.0 + t * 5.0)), 0.0)],
        velocities: vec![Vector3::new(1.0, 3.0 + t * (-4.0 + t * 15.0), 0.0)],
    };
    let (h, mut work) = (0.5, Work::new(&system, &at(0.0)));
    // ∫ 2·6t (3 − 4t + 15t²) dt, and 5 N along x.
    let expected = 12.0 * h * h * (1.5 + h * (-4.0 / 3.0 + h * 15.0 / 4.0)) + 5.0 * h;
    let found = work.enter(&at(0.0), &at(h), h, false);
    assert!((found.work - expected).abs() < 1e-13 && found.dissipated == 0.0, "{found:?} {expected}");
}

/// Drag takes `∫ c v² dt`, which a parabola makes an integral by hand, where the step resolves `m/c`; what it takes from a coordinate that is
/// moved is work of the constraint.
#[test]
fn drag_dissipates() {
    let mut builder = scene(&[([0.0; 3], 2.0)], &[]);
    let motion = Motion::Velocity(Vector3::new(0.0, 3.0, 0.0));
    builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[1]), motion });
    let (system, _) = builder.build().unwrap();
    let system = system.with_loads(Loads { drag: vec![4.0], ..Loads::default() }).unwrap();
    let at = |t: f64| State {
        time: t,
        positions: vec![Vector3::new(t * (1.0 + t * (-1.0 + t * 2.0)), 3.0 * t, 0.0)],
        velocities: vec![Vector3::new(1.0 + t * (-2.0 + t * 6.0), 3.0, 0.0)],
    };
    for (h, is_resolved) in [(0.5, true), (0.51, false)] {
        let found = Work::new(&system, &at(0.0)).enter(&at(0.0), &at(h), h, false);
        // ∫ (1 − 2t + 6t²)² dt, and of the mean velocity alone.
        let squares = h * (1.0 + h * (-2.0 + h * (16.0 / 3.0 + h * (-6.0 + h * 36.0 / 5.0))));
        let mean = 1.0 + h * (-1.0 + h * 2.0);
        let [least, all] = [h * mean * mean, squares].map(|sum| 4.0 * sum + 36.0 * h);
        let dissipated = if is_resolved { all } else { least };
        assert!((found.work - 36.0 * h).abs() < 1e-12 && (found.certain - least).abs() < 1e-12, "{found:?}");
        assert!((found.dissipated - dissipated).abs() < 1e-12, "{found:?} {dissipated}");
    }
}

/// A damped spring of 12 N/m between a free particle of 2 kg and one that is led along x at 0.3 m/s, under gravity. A length
/// `l = 1 + r₀t + r₁t²/2 + r₂t³/3` makes `∫ (κ (l − l0) + b l') u dt` and `b ∫ l'² dt` integrals by hand. A step that does not
/// resolve the spring knows the mean of the tensions at its ends, and that of the rate.
#[test]
fn a_spring_that_is_drawn_takes_its_tension_times_the_way() {
    let mut builder = scene(&[([1.0, 0.0, 0.0], 3.0), ([0.0; 3], 2.0)], &[(0, 1, [6.0, 0.5, 0.7])]);
    let motion = Motion::Velocity(Vector3::new(0.3, 0.0, 0.0));
    builder.gravity(-4.0, 0.0, 9.0).constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
    let (system, start) = builder.build().unwrap();
    let [r0, r1, r2, u, b] = [-0.3, -2.0, 5.0, 0.3, 0.7];
    let length = |t: f64| 1.0 + t * (r0 + t * (r1 / 2.0 + t * r2 / 3.0));
    let rate = |t: f64| r0 + t * (r1 + t * r2);
    let exchange = |h: f64| {
        let at = |t: f64| {
            let mut state = State { time: t, ..start.clone() };
            state.prescribe(&system);
            state.positions[1].x = state.positions[0].x - length(t);
            state.velocities[1].x = u - rate(t);
            state
        };
        Work::new(&system, &at(0.0)).enter(&at(0.0), &at(h), h, false)
    };
    let tension = |t: f64| 12.0 * (length(t) - 0.5);
    let h: f64 = 0.02;
    let whole = h + h * h * (r0 / 2.0 + h * (r1 / 6.0 + h * r2 / 12.0));
    let work = u * (12.0 * (whole - 0.5 * h) + b * (length(h) - 1.0));
    let squares =
        h * (r0 * r0 + h * (r0 * r1 + h * ((r1 * r1 + 2.0 * r0 * r2) / 3.0 + h * (r1 * r2 / 2.0 + h * r2 * r2 / 5.0))));
    let mean = |h: f64| (length(h) - 1.0) / h;
    let found = exchange(h);
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs();
    assert!(near(found.work, work) && near(found.dissipated, b * squares), "{found:?} {work} {squares}");
    assert!(near(found.certain, b * h * mean(h) * mean(h)), "{found:?}");
    // The spring's own time is 1/√(12·5/6) s, as what is led along x has two axes left.
    for (h, is_resolved) in [(0.316, true), (0.317, false)] {
        let found = exchange(h);
        let simple = u * h * ((tension(0.0) + tension(h)) / 2.0 + b * mean(h));
        assert_eq!(!near(found.work, simple), is_resolved, "{h}: {found:?} {simple}");
        assert_eq!(!near(found.dissipated, found.certain), is_resolved, "{h}: {found:?}");
    }
}
