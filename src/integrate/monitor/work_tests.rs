//! The passes over springs and constraints, against integrals by hand.

use super::springs::{BLOCK, Springs, Sums, resolved_step};
use super::work::{BodyEnergy, End, External, Work, exchange};
use crate::spring::{Spring, SpringLaw, Tension};
use crate::system::fixtures::in_parts;
use crate::system::{Axes, Constraint, ExternalForce, Motion, State, StateView, System, SystemBuilder};
use nalgebra::Vector3;

/// Two particles on the x axis, joined by a spring of given damping.
fn pair(damping: f64) -> (System, State) {
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
    let mut springs = Springs::new(&system, &at(&start, 1.0, r0), std::iter::empty());
    let sums = springs.enter(&at(&start, 1.0 + h * (r0 + h * (r1 / 2.0 + h * r2 / 3.0)), rate(h)), h);
    // ∫ (r₀ + r₁t + r₂t²)² dt.
    let integral =
        h * (r0 * r0 + h * (r0 * r1 + h * ((r1 * r1 + 2.0 * r0 * r2) / 3.0 + h * (r1 * r2 / 2.0 + h * r2 * r2 / 5.0))));
    approx::assert_relative_eq!(sums.dissipated, 0.7 * integral, max_relative = 1e-9);
    let mean = r0 + h * (r1 / 2.0 + h * r2 / 3.0);
    approx::assert_relative_eq!(sums.certain, 0.7 * h * mean * mean, max_relative = 1e-9);
    assert!(sums.certain < sums.dissipated);
}

/// Steps that do not resolve a spring count its certain dissipation alone. Its own times: 1/sqrt(k/(l0 μ)) and μ/b, μ = 6/5 kg.
#[test]
fn unresolved_springs_dissipate_what_is_certain() {
    let (system, start) = pair(0.7);
    let longest = resolved_step(&system, 0);
    approx::assert_relative_eq!(longest, (0.5 * 1.2 / 6.0f64).sqrt(), max_relative = 1e-14);
    approx::assert_relative_eq!(resolved_step(&pair(70.0).0, 0), 1.2 / 70.0, max_relative = 1e-14);
    for (h, is_resolved) in [(0.999 * longest, true), (1.001 * longest, false)] {
        let mut springs = Springs::new(&system, &at(&start, 1.0, 0.3), std::iter::empty());
        let sums = springs.enter(&at(&start, 1.05, -0.2), h);
        assert_eq!(sums.dissipated > sums.certain, is_resolved, "{h}");
    }
}

/// Every spring counts in its own block, by its own number: so many side by side, each by a newton harder than the last, all twice
/// their length at rest of a half.
#[test]
fn blocks_follow_one_another() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    let count = BLOCK + 3;
    for spring in 0..count {
        builder.spring(0, 1, Spring { stiffness: (spring + 1) as f64, rest_length: 0.5, damping: 0.0 });
    }
    let (system, state) = builder.build().unwrap();
    let sums = Springs::new(&system, &state, std::iter::empty()).enter(&state, 0.0);
    // ½ (k/l0) (l − l0)² = k/4, of the sum of all numbers up to theirs.
    assert_eq!(sums.elastic, (count * (count + 1) / 2) as f64 / 4.0);
}

/// A spring without length has no direction, and no rate.
#[test]
fn springs_without_length_have_no_rate() {
    let (system, start) = pair(0.5);
    let mut state = start.clone();
    state.positions[1] = Vector3::zeros();
    state.velocities[1] = Vector3::new(-4.0, 1.0, 0.0);
    let sums = Springs::new(&system, &start, std::iter::empty()).enter(&state, 0.25);
    // r̄ = −4 m/s, 0 at both ends: ½ h (16 + 16/5).
    assert!((sums.dissipated - 0.125 * 19.2).abs() < 1e-12, "{}", sums.dissipated);
}

/// Springs that are harder by a newton a metre than the one before, from half a metre on.
#[derive(Debug)]
struct Harder;

impl SpringLaw for Harder {
    fn tension(&self, number: usize, _: &Spring, length: f64) -> Tension {
        let slope = (number + 1) as f64;
        Tension { force: slope * (length - 0.5), slope }
    }

    fn energy(&self, number: usize, _: &Spring, length: f64) -> f64 {
        0.5 * (number + 1) as f64 * (length - 0.5) * (length - 0.5)
    }
}

/// A law of the caller's own is asked for every spring by its number: for its energy.
#[test]
fn laws_are_asked_for_every_spring() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    let count = BLOCK + 37;
    (0..count).for_each(|_| {
        builder.spring(0, 1, Spring { stiffness: 700.0, rest_length: 0.9, damping: 0.0 });
    });
    let (system, start) = builder.build().unwrap();
    let system = system.with_spring_law(Harder);
    let sums = Springs::new(&system, &start, std::iter::empty()).enter(&start, 0.5);
    let all = (count * (count + 1) / 2) as f64;
    let near = |a: f64, b: f64| (a - b).abs() < 1e-9 * b;
    assert!(near(sums.elastic, 0.125 * all), "{sums:?} {all}");
}

/// A damped ring of 101 springs that all differ, every third particle of another part: each part goes over springs that the other one counts,
/// and what all count together is what the whole does.
#[test]
fn parts_count_every_spring_once() {
    let mut ring = SystemBuilder::new();
    let count = 101;
    for p in 0..count {
        let angle = p as f64 * std::f64::consts::TAU / count as f64;
        ring.particle([9.0 * angle.cos(), 9.0 * angle.sin(), 0.1 * (p % 4) as f64], 1.0 + 0.1 * (p % 7) as f64);
    }
    for p in 0..count {
        ring.spring(p, (p + 1) % count, Spring { stiffness: 10.0 + p as f64, rest_length: 0.5, damping: 0.2 });
    }
    let sums = |system: &System, start: &State| {
        let mut state = start.clone();
        for (x, v) in state.positions.iter_mut().zip(&mut state.velocities) {
            *v = Vector3::new(0.3 * x.y, 0.1 * x.x * x.x, x.z);
            *x += *v * 0.01;
        }
        Springs::new(system, start, std::iter::empty()).enter(&state, 0.01)
    };
    let (system, start) = ring.clone().build().unwrap();
    let whole = sums(&system, &start);
    let numbers = |sums: Sums| [sums.elastic, sums.dissipated, sums.certain];
    for part in in_parts(&ring, 2, |p| usize::from(p % 3 == 0), |cut| sums(&cut.system, &cut.state)) {
        for (found, expected) in numbers(part).into_iter().zip(numbers(whole)) {
            assert!(expected > 0.0 && (found - expected).abs() <= 1e-12 * expected, "{part:?} {whole:?}");
        }
    }
}

fn close(sums: &Sums, [work, dissipated, certain]: [f64; 3]) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs();
    near(sums.work, work) && near(sums.dissipated, dissipated) && near(sums.certain, certain)
}

#[test]
fn springs_turn_by_what_goes_across_them() {
    let end = End::new(&Vector3::new(0.0, 0.0, 2.0), &Vector3::new(3.0, 0.0, 1.0));
    assert_eq!((end.n, end.turning), (Vector3::z(), Vector3::new(1.5, 0.0, 0.0)));
    assert_eq!((end.length, end.rate), (2.0, 1.0));
    // Where both ends are at one place there is no direction, and none that turns.
    let end = End::new(&Vector3::zeros(), &Vector3::new(3.0, 0.0, 1.0));
    assert_eq!((end.n, end.turning), (Vector3::zeros(), Vector3::zeros()));
    assert_eq!((end.length, end.rate), (0.0, 0.0));
}

/// A spring that turns from x to y in half a second, by the formulas of `work` with numbers put in:
/// `g` goes from 2 to 6 m/s with the slopes 18 and −4 m/s², T g from 8 to −12 W with the slopes 76 and 26 W/s.
#[test]
fn work_and_dissipation_are_those_of_the_formulas() {
    let mut first = End::new(&Vector3::x(), &Vector3::zeros());
    let mut last = End::new(&(Vector3::y() * 2.0), &Vector3::zeros());
    (first.turning, first.rate) = (Vector3::new(0.0, 3.0, 0.0), 0.5);
    (last.turning, last.rate) = (Vector3::new(-2.0, 0.0, 0.0), -0.25);
    let (ends, force, u) = ([first, last], [(4.0, 2.0), (-2.0, 3.0)], Vector3::new(2.0, 6.0, 0.0));
    let exchange = |resolved| exchange([0.5, resolved], &ends, force, 0.75, &u);
    let elastic = 0.5 * (8.0 - 12.0) / 2.0 + 0.25 * (76.0 - 26.0) / 12.0;
    // r̄ = 2, r' − r = −0.75, c = 0.125 − 2; ḡ = 4 + ½ (18 + 4)/12, its slope 4 and its bend 4 − ḡ.
    let (bend, mean) = (-1.875, 4.0 + 11.0 / 12.0);
    let certain = 0.75 * 0.5 * 4.0;
    let dissipated = certain + 0.75 * 0.5 * (0.75 * 0.75 / 12.0 + bend * bend / 5.0);
    let pull = 0.75 * 0.5 * (2.0 * mean - 0.75 * 4.0 / 12.0 + bend * (4.0 - mean) / 5.0);
    let found = exchange(0.5);
    assert!(close(&found, [elastic + pull, dissipated, certain]), "{found:?}");
    // Without the corrections: the mean power of −2 W, and b h r̄ ḡ.
    let found = exchange(0.49);
    assert!(close(&found, [-1.0 + 0.375 * 2.0 * 4.0, certain, certain]), "{found:?}");
}

/// A damped spring of 12 N/m between a free particle of 2 kg and one that is led along x at 0.3 m/s, under gravity.
fn moved() -> (System, State) {
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
    let (system, start) = moved();
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
        Work::new(&system, &at(0.0)).enter(&at(h), h)
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

/// A coordinate led along x has kinetic energy and weight along x alone.
#[test]
fn led_coordinates_have_energy_of_their_own() {
    let (system, mut state) = moved();
    state.positions[0] = Vector3::new(0.25, 3.0, 7.0);
    state.velocities[0] = Vector3::new(0.5, 3.0, 7.0);
    let prescribed = Work::new(&system, &state).energy(&state);
    assert_eq!(prescribed, BodyEnergy { kinetic: 1.5 * 0.25, gravitational: 3.0 * 4.0 * 0.25 });
    assert_eq!(prescribed.total(), 3.375);
}

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
    let mut builder = SystemBuilder::new();
    builder.particle([1.0, 2.0, 3.0], 1.0);
    builder.particle([7.0, 0.0, 0.0], 1.0);
    builder.constrain(Constraint { axes: Axes::of(&[0, 1]), ..Constraint::hold([1]) });
    let (system, mut state) = builder.build().unwrap();
    let system = system.with_external_force(Hand);
    state.time = 1.0;
    let mut external = External::at(&system, &state);
    // From 1 s to 3 s: the first particle is pulled by twice (3, 5, −4) in the mean, the second by three times that.
    state.time = 3.0;
    state.positions[0] += Vector3::new(0.5, 0.25, -2.0);
    state.positions[1] += Vector3::new(9.0, 9.0, 0.125);
    assert_eq!(external.enter(&system, &state), 2.0 * (1.5 + 1.25 + 8.0) + 3.0 * -4.0 * 0.125);
    // From there to 5 s, back by half of that.
    state.time = 5.0;
    state.positions[0] -= Vector3::new(0.25, 0.125, -1.0);
    assert_eq!(external.enter(&system, &state), -4.0 * (0.75 + 0.625 + 4.0));
}
