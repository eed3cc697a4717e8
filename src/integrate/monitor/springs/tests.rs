use super::{BLOCK, Springs, Sums};
use crate::spring::{Spring, SpringLaw, Tension};
use crate::system::fixtures::in_parts;
use crate::system::{State, System, SystemBuilder};
use nalgebra::Vector3;

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

/// A spring of 3 N and half a metre, 2 m long, between 2 kg and 3 kg.
fn pair(damping: f64) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([2.0, 0.0, 0.0], 3.0);
    builder.spring(0, 1, Spring { stiffness: 3.0, rest_length: 0.5, damping });
    builder.build().unwrap()
}

/// Where the ends of a spring meet it has no direction, and no rate.
#[test]
fn springs_without_length_have_no_rate() {
    let (system, start) = pair(0.5);
    let mut state = start.clone();
    state.positions[1] = Vector3::zeros();
    state.velocities[1] = Vector3::new(-4.0, 1.0, 0.0);
    let sums = Springs::new(&system, &start, std::iter::empty()).enter(&state, 0.25);
    // r̄ = −8 m/s, 0 at both ends: ½ h (64 + 64/5).
    assert!((sums.dissipated - 0.125 * 76.8).abs() < 1e-12, "{}", sums.dissipated);
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

/// A law of the caller's own is asked for every spring by its number: for its energy and for the stiffness of its tangent.
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
