use super::{ConstraintWork, DrivenEnergy, End, Exchange, Step};
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;

fn close(exchange: &Exchange, [work, dissipated, certain]: [f64; 3]) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs();
    near(exchange.work, work) && near(exchange.dissipated, dissipated) && near(exchange.certain, certain)
}

#[test]
fn springs_turn_by_what_goes_across_them() {
    let end = End::of(&Vector3::new(0.0, 0.0, 2.0), &Vector3::new(3.0, 0.0, 1.0));
    assert_eq!((end.n, end.turn), (Vector3::z(), Vector3::new(1.5, 0.0, 0.0)));
    assert_eq!((end.span.length, end.span.rate), (2.0, 1.0));
    // Where both ends are at one place there is no direction, and none that turns.
    let end = End::of(&Vector3::zeros(), &Vector3::new(3.0, 0.0, 1.0));
    assert_eq!((end.n, end.turn), (Vector3::zeros(), Vector3::zeros()));
    assert_eq!((end.span.length, end.span.rate), (0.0, 0.0));
}

/// A spring that turns from x to y in half a second, by the formulas at the head of `driven.rs` with numbers put in:
/// `g` goes from 2 to 6 m/s with the slopes 18 and −4 m/s², T g from 8 to −12 W with the slopes 76 and 26 W/s.
#[test]
fn work_and_dissipation_are_those_of_the_formulas() {
    let mut first = End::of(&Vector3::x(), &Vector3::zeros());
    let mut last = End::of(&(Vector3::y() * 2.0), &Vector3::zeros());
    (first.turn, first.span.rate) = (Vector3::new(0.0, 3.0, 0.0), 0.5);
    (last.turn, last.span.rate) = (Vector3::new(-2.0, 0.0, 0.0), -0.25);
    let (ends, force, u) = ([first, last], [(4.0, 2.0), (-2.0, 3.0)], Vector3::new(2.0, 6.0, 0.0));
    let exchange = |is_resolved| Step { dt: 0.5, is_resolved }.exchange(&ends, force, 0.75, &u);
    let elastic = 0.5 * (8.0 - 12.0) / 2.0 + 0.25 * (76.0 - 26.0) / 12.0;
    // r̄ = 2, r' − r = −0.75, c = 0.125 − 2; ḡ = 4 + ½ (18 + 4)/12, its slope 4 and its bend 4 − ḡ.
    let (bend, mean) = (-1.875, 4.0 + 11.0 / 12.0);
    let certain = 0.75 * 0.5 * 4.0;
    let dissipated = certain + 0.75 * 0.5 * (0.75 * 0.75 / 12.0 + bend * bend / 5.0);
    let pull = 0.75 * 0.5 * (2.0 * mean - 0.75 * 4.0 / 12.0 + bend * (4.0 - mean) / 5.0);
    let found = exchange(true);
    assert!(close(&found, [elastic + pull, dissipated, certain]), "{found:?}");
    // Without the corrections: the mean power of −2 W, and b h r̄ ḡ.
    let found = exchange(false);
    assert!(close(&found, [-1.0 + 0.375 * 2.0 * 4.0, certain, certain]), "{found:?}");
}

/// A damped spring of 12 N/m between a free particle of 2 kg and one that is led along x at 0.3 m/s, under gravity.
fn led() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity(-4.0, 0.0, 9.0);
    builder.particle([1.0, 0.0, 0.0], 3.0);
    builder.particle([0.0; 3], 2.0);
    builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 0.5, damping: 0.7 });
    let motion = Motion::Velocity(Vector3::new(0.3, 0.0, 0.0));
    builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
    builder.build().unwrap()
}

/// A length `l = 1 + r₀t + r₁t²/2 + r₂t³/3` makes `∫ (κ (l − l0) + b l') u dt` and `b ∫ l'² dt` integrals by hand. A step that does not
/// resolve the spring knows the mean of the tensions at its ends, and that of the rate.
#[test]
fn a_spring_that_is_drawn_takes_its_tension_times_the_way() {
    let (system, start) = led();
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
        ConstraintWork::new(&system, &at(0.0)).pass(&at(h), h)
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

/// What moves along x has the kinetic energy and the weight of that alone.
#[test]
fn led_coordinates_have_energy_of_their_own() {
    let (system, mut state) = led();
    state.positions[0] = Vector3::new(0.25, 3.0, 7.0);
    state.velocities[0] = Vector3::new(0.5, 3.0, 7.0);
    let led = ConstraintWork::new(&system, &state).energy(&state);
    assert_eq!(led, DrivenEnergy { kinetic: 1.5 * 0.25, gravitational: 3.0 * 4.0 * 0.25 });
    assert_eq!(led.total(), 3.375);
}
