use super::{BLOCK, Carried, Particles, Sums, Whole, norm_squared};
use crate::system::{Axes, Constraint, State, System, SystemBuilder};
use nalgebra::Vector3;

/// Two particles of 2 kg and 3 kg under gravity, the second of which cannot move along y.
fn two() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -8.0, 2.0);
    builder.particle([0.0, 1.0, 0.0], 2.0);
    builder.particle([0.0, 0.0, 4.0], 3.0);
    builder.constrain(Constraint { axes: Axes::of(&[1]), ..Constraint::hold([1]) });
    builder.build().unwrap()
}

/// Steps of ½, ¼ and 1 s with ways of 1, 2 and 8 m along x, and of 0, 1 and 1 m along z: with the ratios ½ and 4 of the steps
/// `δx' − r δx` are 1.5 and 0 m, 1 and −3 m, and the third differences are of those. What cannot move counts for nothing.
#[test]
fn third_differences_begin_with_the_third_step() {
    let (system, mut state) = two();
    let mut particles = Particles::new(&system, &state, true);
    state.velocities[0].x = 1.0;
    let still = particles.pass(&state, 0.0, None);
    assert_eq!([still.change, still.bend, still.third, still.slip, still.speed], [0.0; 5]);
    assert_eq!((still.kinetic, still.weight), (1.0, 2.0 * -8.0 + 3.0 * 8.0));
    let mut third = Vec::new();
    for (dt, x, z) in [(0.5, 1.0, 0.0), (0.25, 2.0, 1.0), (1.0, 8.0, 1.0)] {
        state.positions[0].x += x;
        state.positions[1] += Vector3::new(0.0, 100.0, z);
        third.push(particles.pass(&state, dt, None).third);
    }
    assert_eq!(third, [0.0, 0.0, (16.0f64 * 1.5).powi(2) + (3.0f64 + 16.0).powi(2)]);
}

/// `‖x' − x − ½h (v + v')‖²`, `‖v'‖²`, and energies with the particles that are held in part.
#[test]
fn positions_are_compared_with_the_mean_velocity() {
    let (system, mut state) = two();
    state.velocities = vec![Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.0, 50.0, 2.0)];
    let mut particles = Particles::new(&system, &state, true);
    particles.pass(&state, 0.0, None);
    state.positions[0] += Vector3::new(3.0, 1.0, 0.0);
    state.positions[1] += Vector3::new(0.0, 9.0, 0.5);
    state.velocities = vec![Vector3::new(7.0, 0.0, 0.0), Vector3::new(0.5, 50.0, 6.0)];
    let sums = particles.pass(&state, 0.5, None);
    // Half a second at 4 m/s is 2 m of the 3; at (0.25, ·, 4) m/s it is (0.125, ·, 2) m of (0, ·, 0.5).
    assert_eq!(sums.slip, 1.0 + 1.0 + 0.125f64.powi(2) + 1.5f64.powi(2));
    assert_eq!(sums.speed, 49.0 + 0.25 + 36.0);
    assert_eq!(sums.kinetic, 49.0 + 1.5 * (0.25 + 2500.0 + 36.0));
    assert_eq!(sums.weight, 2.0 * -8.0 * 2.0 + 3.0 * (-8.0 * 9.0 + 2.0 * 4.5));
    assert_eq!(sums.carried, Carried::default());
}

/// Without their paths all else is the same.
#[test]
fn paths_are_looked_at_where_they_are_asked_for() {
    let (system, start) = two();
    let mut state = start.clone();
    let mut both = [true, false].map(|follows| Particles::new(&system, &start, follows));
    for dt in [0.5, 0.25, 1.0] {
        for (x, v) in state.positions.iter_mut().zip(&mut state.velocities) {
            *v = Vector3::new(v.x * v.x + 1.0, 3.0, 0.5 * v.z - 2.0);
            *x += *v;
        }
        let [with, without] = both.each_mut().map(|particles| particles.pass(&state, dt, None));
        assert!(with.slip > 0.0);
        assert_eq!(without, Sums { third: 0.0, slip: 0.0, ..with });
    }
}

/// Every particle counts in its own block, by its own number.
#[test]
fn blocks_follow_one_another() {
    let mut builder = SystemBuilder::new();
    let count = BLOCK + 3;
    (0..count).for_each(|_| {
        builder.particle([0.0; 3], 2.0);
    });
    let (system, mut state) = builder.build().unwrap();
    state.velocities.iter_mut().enumerate().for_each(|(p, v)| v.y = p as f64);
    let sums = Particles::new(&system, &state, true).pass(&state, 0.0, None);
    // The sum of the squares of all numbers below.
    assert_eq!(sums.kinetic, ((count - 1) * count * (2 * count - 1) / 6) as f64);
}

/// Sums of two blocks are added one by one.
#[test]
fn sums_of_blocks_are_added() {
    let sums = |factor: f64| {
        let [kinetic, weight, change, bend, third, slip, defect, inertia, speed] =
            std::array::from_fn(|n| factor * (n + 1) as f64);
        let whole = Whole {
            mass: 10.0 * factor,
            momentum: Vector3::repeat(11.0 * factor),
            count: 12.0 * factor,
            velocity: Vector3::repeat(13.0 * factor),
        };
        let carried = Carried::default();
        Sums { kinetic, weight, change, bend, third, slip, defect, inertia, speed, carried, whole }
    };
    assert_eq!(sums(2.0).add(&sums(3.0)), sums(5.0));
}

#[test]
fn norms_are_over_free_axes() {
    let norm = |axes: &[usize]| norm_squared(&Vector3::new(3.0, 4.0, 9.0), Axes::of(axes));
    assert_eq!([norm(&[0, 1]), norm(&[1, 2]), norm(&[0, 2]), norm(&[0, 1, 2])], [25.0, 97.0, 90.0, 106.0]);
}
