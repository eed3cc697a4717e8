//! Observed orders of convergence, for every method under every option it supports, against known motions.

use crate::motions::{after, build, case, cases, distance, norm, option, policies, rows, state_at, with};
use nalgebra::Vector3;
use sprung::force::{SpringGeometry, add_damping_force, add_elastic_force, add_weight};
use sprung::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use sprung::system::Axes;
use sprung::{Constraint, Motion, Spring, State, Stiffness, System, SystemBuilder};

/// The slope of log error over log dt by least squares.
fn slope(dt: &[f64], errors: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().map(|v| v.ln()).sum::<f64>() / values.len() as f64;
    let (x, y) = (mean(dt), mean(errors));
    let sum = |f: &dyn Fn(f64, f64) -> f64| dt.iter().zip(errors).map(|(d, e)| f(d.ln() - x, e.ln() - y)).sum::<f64>();
    sum(&|d, e| d * e) / sum(&|d, _| d * d)
}

/// Orders in x and in v over runs with smaller and smaller dt, the coarsest run taking `steps` steps.
fn orders(
    system: &System,
    start: &State,
    end: &State,
    method: Method,
    options: &ImplicitOptions,
    steps: u64,
) -> [f64; 2] {
    let duration = end.time - start.time;
    // Errors of eighth order are too soon below rounding for eight times the steps.
    let counts =
        if method.order() > 4 { [0, 2, 4, 6].map(|more| steps + more) } else { [1, 2, 4, 8].map(|f| f * steps) };
    let runs = counts.map(|steps| after(system, start, method, options, duration, steps));
    let dt = counts.map(|steps| duration / steps as f64);
    let x = runs.each_ref().map(|state| distance(&state.positions, &end.positions));
    let v = runs.each_ref().map(|state| distance(&state.velocities, &end.velocities));
    [slope(&dt, &x), slope(&dt, &v)]
}

fn options_of(method: Method) -> Vec<StiffnessPolicy> {
    if method.takes_stiffness() { policies().to_vec() } else { vec![Stiffness::Full.into()] }
}

/// Steps in half a second from which errors are asymptotic, and three halvings later above rounding.
fn coarsest(method: Method) -> u64 {
    match method.order() {
        1 => 400,
        2 => 40,
        4 => 20,
        _ => 6,
    }
}

/// Orders one and two are met within 0.2, the fourth within 0.3, and eighth-order errors fall at least as h^7.5: faster on
/// many motions, where leading terms are small.
fn is_of_its_order(method: Method, order: f64) -> bool {
    let expected = f64::from(method.order());
    match method.order() {
        1 | 2 => (order - expected).abs() <= 0.2,
        4 => (order - expected).abs() <= 0.3,
        _ => order >= expected - 0.5,
    }
}

#[test]
fn every_method_has_its_order_under_every_option() {
    let scenes = ["damped tetrahedron", "undamped tetrahedron", "pendulum on a moving anchor", "pendulum on a roller"];
    for name in scenes {
        let case = case("trajectories", name);
        let (system, start) = build(&case);
        let end = state_at(&case, 0.5);
        for method in Method::ALL {
            for policy in options_of(method) {
                let steps = coarsest(method);
                for (of, order) in ["x", "v"].iter().zip(orders(&system, &start, &end, method, &with(policy), steps)) {
                    let message = format!("{name}, {}, {}: order {order:.3} in {of}", method.name(), policy.name());
                    println!("{message}");
                    assert!(is_of_its_order(method, order), "{message}");
                }
            }
        }
    }
}

#[test]
fn two_steps_of_the_w_method_in_fifty_digits() {
    let mut held_to = 0;
    for case in cases("wmethod") {
        if !(case["time_derivative"].is_null() || case["time_derivative"] == "option") {
            continue;
        }
        let (system, start) = build(&case);
        let (dt, steps) = (case["dt"].as_f64().unwrap(), case["steps"].as_u64().unwrap());
        let options = with(option(case["stiffness"].as_str().unwrap()));
        let state = after(&system, &start, Method::W2, &options, dt * steps as f64, steps);
        let error = distance(&state.positions, &rows(&case["positions"]))
            + distance(&state.velocities, &rows(&case["velocities"]));
        assert!(error < 1e-13, "{}: {error:e}", case["name"]);
        held_to += 1;
    }
    assert!(held_to >= 9);
}

/// Along which a particle is led: 40 pieces a second of `(sin 3t, ½ sin 5t, 1 − cos 4t)/4`.
fn smooth_path() -> Motion {
    let times: Vec<f64> = (0..=40).map(|i| f64::from(i) / 40.0).collect();
    let offset = |t: &f64| Vector3::new((3.0 * t).sin(), 0.5 * (5.0 * t).sin(), 1.0 - (4.0 * t).cos()) * 0.25;
    Motion::Path { offsets: times.iter().map(offset).collect(), times }
}

/// Few pieces with sharp kinks at times that no step lands on.
fn kinked_path() -> Motion {
    let offsets = [[0.0, 0.0, 0.0], [0.2, 0.1, 0.0], [-0.1, 0.1, 0.3], [0.0, -0.2, 0.1]].map(Vector3::from).to_vec();
    Motion::Path { times: vec![0.0, 0.1234567, 0.3141592, 0.6283185], offsets }
}

/// A damped double pendulum between a led particle and one that leaves at a steady velocity along two axes.
fn led_pendulum(motion: Motion) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.3, -9.81, 0.2);
    let particles = [([0.0, 0.0, 0.0], 1.0), ([0.3, -0.9, 0.1], 0.8), ([0.9, -1.4, 0.4], 0.5), ([1.5, -1.0, 0.2], 1.4)];
    let [a, b, c, d] = particles.map(|(x, mass)| builder.particle(x, mass));
    for (i, j, stiffness, rest_length, damping) in
        [(a, b, 60.0, 0.9, 0.6), (c, b, 45.0, 0.7, 0.4), (c, d, 12.0, 0.8, 0.2)]
    {
        builder.spring(i, j, Spring { stiffness, rest_length, damping });
    }
    builder.constrain(Constraint { particles: vec![a], axes: Axes::ALL, motion });
    let steady = Motion::Velocity(Vector3::new(0.4, 0.0, -0.7));
    builder.constrain(Constraint { particles: vec![d], axes: Axes::of(&[0, 2]), motion: steady });
    builder.build().unwrap()
}

/// The classical fourth-order Runge–Kutta method from one time to another, between which no motion has a kink.
fn runge_kutta(system: &System, state: &mut State, until: f64, steps: usize) {
    let h = (until - state.time) / steps as f64;
    let rate = |x: &State| {
        let extensions = SpringGeometry::at(system, &x.positions).unwrap();
        let mut force = vec![Vector3::zeros(); system.particles()];
        add_elastic_force(system, &extensions, &mut force);
        add_damping_force(system, &extensions, &x.velocities, &mut force);
        add_weight(system, &mut force);
        let acceleration: Vec<_> = force.iter().zip(system.masses()).map(|(f, m)| f / *m).collect();
        (x.velocities.clone(), acceleration)
    };
    let moved = |from: &State, by: f64, rate: &(Vec<Vector3<f64>>, Vec<Vector3<f64>>), middle: f64| {
        let mut to = from.clone();
        to.time += by;
        to.positions.iter_mut().zip(&rate.0).for_each(|(x, v)| *x += v * by);
        to.velocities.iter_mut().zip(&rate.1).for_each(|(v, a)| *v += a * by);
        system.prescribed().set_positions(to.time, &mut to.positions);
        // Their velocity is constant between kinks; taken inside the step it cannot be that of the next piece.
        system.prescribed().set_velocities(middle, &mut to.velocities);
        to
    };
    for _ in 0..steps {
        let middle = state.time + 0.5 * h;
        system.prescribed().set_velocities(middle, &mut state.velocities);
        let k1 = rate(state);
        let k2 = rate(&moved(state, 0.5 * h, &k1, middle));
        let k3 = rate(&moved(state, 0.5 * h, &k2, middle));
        let k4 = rate(&moved(state, h, &k3, middle));
        let sum =
            |a: &[Vector3<f64>], b: &[Vector3<f64>], c: &[Vector3<f64>], d: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
                (0..a.len()).map(|p| (a[p] + (b[p] + c[p]) * 2.0 + d[p]) / 6.0).collect()
            };
        let mean = (sum(&k1.0, &k2.0, &k3.0, &k4.0), sum(&k1.1, &k2.1, &k3.1, &k4.1));
        *state = moved(state, h, &mean, middle);
    }
    state.time = until;
}

#[test]
fn paths_of_kinematic_particles_keep_the_order() {
    /// At no kink: there the velocity of the led particle has two values.
    const END: f64 = 0.51;
    for (name, motion) in [("smooth path", smooth_path()), ("kinked path", kinked_path())] {
        let Motion::Path { times, .. } = &motion else { unreachable!() };
        let (system, start) = led_pendulum(motion.clone());
        let mut end = start.clone();
        for &kink in times.iter().filter(|&&kink| 0.0 < kink && kink < END) {
            runge_kutta(&system, &mut end, kink, 200);
        }
        runge_kutta(&system, &mut end, END, 400);
        // Steps that are cut at kinks and of a length that shows a high order do not become shorter in proportion.
        for method in Method::ALL.into_iter().filter(|method| method.order() > 2) {
            let state = after(&system, &start, method, &with(Stiffness::Full), END, 40);
            let errors = [(&state.positions, &end.positions), (&state.velocities, &end.velocities)];
            let [x, v] = errors.map(|(found, known)| distance(found, known) / norm(known));
            let bound = if method.order() == 4 { 1e-6 } else { 1e-9 };
            assert!(x < bound && v < bound, "{name}, {}: {x:e} {v:e}", method.name());
        }
        for method in Method::ALL.into_iter().filter(|method| method.order() <= 2) {
            for policy in options_of(method) {
                let steps = if method.order() == 1 { 800 } else { 100 };
                for (of, order) in ["x", "v"].iter().zip(orders(&system, &start, &end, method, &with(policy), steps)) {
                    let message = format!("{name}, {}, {}: order {order:.3} in {of}", method.name(), policy.name());
                    println!("{message}");
                    assert!(is_of_its_order(method, order), "{message}");
                }
            }
        }
    }
}
