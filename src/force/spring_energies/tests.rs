//! The energies of springs, against integrals by hand.

use super::{BLOCK, SpringEnergies, SpringSums, resolved_step};
use crate::spring::{Spring, SpringLaw, Tension};
use crate::system::fixtures::in_parts;
use crate::system::{Behaviour, State, System, SystemBuilder};
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
    let mut springs = SpringEnergies::new(&system, &at(&start, 1.0, r0), std::iter::empty());
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
        let mut springs = SpringEnergies::new(&system, &at(&start, 1.0, 0.3), std::iter::empty());
        let sums = springs.enter(&at(&start, 1.05, -0.2), h);
        assert_eq!(sums.dissipated > sums.certain, is_resolved, "{h}");
    }
}

/// A slack tension-only spring dissipates nothing, and in a step through its rest length of a half the taut part alone: that it lengthens or shortens
/// from a half to x takes at least b (x − ½)²/h.
#[test]
fn slack_springs_dissipate_nothing() {
    let (system, start) = pair(0.7);
    let system = system.with_behaviour(Behaviour { tension_only: vec![true], ..Behaviour::default() }).unwrap();
    let h = 0.02;
    let mut springs = SpringEnergies::new(&system, &at(&start, 0.3, -1.0), std::iter::empty());
    assert_eq!(springs.enter(&at(&start, 0.28, -1.0), h), SpringSums::default());
    for x in [0.6, 0.2] {
        let sums = springs.enter(&at(&start, x, 9.0), h);
        approx::assert_relative_eq!(sums.certain, 0.7 * 0.1 * 0.1 / h, max_relative = 1e-9);
    }
    assert_eq!(springs.enter(&at(&start, 0.4, -1.0), h), SpringSums::default());
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

/// Every spring counts in its own block, by its own number: so many side by side, each harder by two newtons a metre than the last, and by a law of
/// the caller's own, by one; all are twice their length at rest of a half.
#[test]
fn blocks_follow_one_another() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    let count = BLOCK + 37;
    for spring in 0..count {
        builder.spring(0, 1, Spring { stiffness: (spring + 1) as f64, rest_length: 0.5, damping: 0.0 });
    }
    let (system, state) = builder.build().unwrap();
    // ½ (k/l0) (l − l0)² = k/4, of the sum of all numbers up to theirs.
    let expected = (count * (count + 1) / 2) as f64 / 4.0;
    for (system, expected) in [(system.clone(), expected), (system.with_spring_law(Harder), 0.5 * expected)] {
        let sums = SpringEnergies::new(&system, &state, std::iter::empty()).enter(&state, 0.5);
        assert_eq!(sums.elastic, expected);
    }
}

/// A spring without length has no direction, and no rate.
#[test]
fn springs_without_length_have_no_rate() {
    let (system, start) = pair(0.5);
    let mut state = start.clone();
    state.positions[1] = Vector3::zeros();
    state.velocities[1] = Vector3::new(-4.0, 1.0, 0.0);
    let sums = SpringEnergies::new(&system, &start, std::iter::empty()).enter(&state, 0.25);
    // r̄ = −4 m/s, 0 at both ends: ½ h (16 + 16/5).
    assert!((sums.dissipated - 0.125 * 19.2).abs() < 1e-12, "{}", sums.dissipated);
}

/// A damped ring of 101 springs that all differ, every third particle of another part: each part goes over springs that the other one counts, and
/// what all count together is what the whole does.
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
        SpringEnergies::new(system, start, std::iter::empty()).enter(&state, 0.01).of_all_parts(system)
    };
    let (system, start) = ring.clone().build().unwrap();
    let whole = sums(&system, &start);
    let numbers = |sums: SpringSums| [sums.elastic, sums.dissipated, sums.certain];
    for part in in_parts(&ring, 2, |p| usize::from(p % 3 == 0), |cut| sums(&cut.system, &cut.state)) {
        for (found, expected) in numbers(part).into_iter().zip(numbers(whole)) {
            assert!(expected > 0.0 && (found - expected).abs() <= 1e-12 * expected, "{part:?} {whole:?}");
        }
    }
}
