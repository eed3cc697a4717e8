use super::search::Solver;
use super::*;
use crate::spring::Spring;
use crate::system::{Behaviour, Constraint, Loads, SystemBuilder};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};

fn spring(stiffness: f64, rest_length: f64) -> Spring {
    Spring { stiffness, rest_length, damping: 0.0 }
}

fn find(system: &System, state: &State) -> Equilibrium {
    equilibrium(system, state, EquilibriumOptions::default()).unwrap()
}

/// Particles of 1 kg, springs with their ends, k and l0, and what is held.
fn net(
    dimension: usize,
    places: &[[f64; 2]],
    springs: impl IntoIterator<Item = (usize, usize, f64, f64)>,
    held: &[usize],
) -> SystemBuilder {
    let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
    for [x, y] in places {
        builder.particle([*x, *y, 0.0], 1.0);
    }
    for (i, j, stiffness, rest_length) in springs {
        builder.spring(i, j, spring(stiffness, rest_length));
    }
    builder.constrain(Constraint::hold(held.iter().copied()));
    builder
}

/// A straight row at these places, with springs of 10 N and 1 m, held at both ends.
fn column(places: &[f64]) -> (System, State) {
    let last = places.len() - 1;
    let places: Vec<[f64; 2]> = places.iter().map(|&x| [x, 0.0]).collect();
    net(2, &places, (0..last).map(|p| (p, p + 1, 10.0, 1.0)), &[0, last]).build().unwrap()
}

fn pushed(system: &System, particle: usize, force: [f64; 2]) -> System {
    let mut forces = vec![Vector3::zeros(); system.particles()];
    forces[particle] = Vector3::new(force[0], force[1], 0.0);
    system.clone().with_loads(Loads { forces, ..Loads::default() }).unwrap()
}

/// A truss of two bars of 1000 N at rest, half a span of 1 m, and its limit load `2k (1 − (a/l0)^{2/3})^{3/2}` down at its top, particle 2.
fn truss(height: f64) -> (SystemBuilder, f64) {
    let (k, length) = (1000.0, f64::hypot(1.0, height));
    let builder = net(2, &[[-1.0, 0.0], [1.0, 0.0], [0.0, height]], [(0, 2, k, length), (1, 2, k, length)], &[0, 1]);
    (builder, 2.0 * k * (1.0 - length.recip().powf(2.0 / 3.0)).powf(1.5))
}

fn lowest_eigenvalue(system: &System, state: &State) -> [f64; 2] {
    let minus_k = minus_k(system, state, Stiffness::Full).unwrap();
    let eigenvalues = nalgebra::DMatrix::from(&minus_k.to_csc()).symmetric_eigenvalues();
    [eigenvalues.min(), eigenvalues.amax()]
}

/// A weight above or at its hook, on springs and ropes whose problem has a length of its own, in one to three axes: the search passes through the
/// point at which all lengths are zero, and leaves it where it starts there.
#[test]
fn weights_pass_through_their_hooks() {
    let (mass, k) = (1.0, 10.0);
    for dimension in 1..=3 {
        let down = (dimension - 1).min(1);
        let along = |y: f64| [0, 1, 2].map(|axis| if axis == down { y } else { 0.0 });
        for (rest_length, is_rope, start) in
            [(0.0, false, 1.0), (0.0, false, 0.0), (0.0, true, 1.0), (1.0, true, 1.0), (1.0, true, 0.5)]
        {
            let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
            let [x, y, z] = along(-9.81);
            builder.gravity(x, y, z);
            builder.particle([0.0; 3], mass);
            builder.particle(along(start), mass);
            builder.spring(0, 1, spring(k, rest_length));
            builder.hold(0);
            let (system, state) = builder.build().unwrap();
            let behaviour = Behaviour { tension_only: vec![is_rope], ..Behaviour::default() };
            let found = find(&system.with_behaviour(behaviour).unwrap(), &state);
            let case = format!("{dimension} {rest_length} {is_rope} {start}: {found:?}");
            assert_eq!((found.stability, found.inertia.zero), (Stability::Stable, 0), "{case}");
            let stretched = if rest_length == 0.0 { mass * 9.81 / k } else { 1.0 + mass * 9.81 / k };
            assert!((found.state.positions[1][down] + stretched).abs() < 1e-12, "{case}");
        }
    }
}

/// The K of a spring without a rest length does not change when it closes: what force is left says nothing over its length.
#[test]
fn springs_that_close_leave_a_state_stable() {
    let row = [[-1.0, 0.0], [0.0, 0.0], [0.001, 0.0]];
    let (system, state) = net(1, &row, [(0, 1, 100.0, 1.0), (1, 2, 5.0, 0.0)], &[0]).build().unwrap();
    let found = find(&system, &state);
    assert!(found.residual > 0.0, "nothing is left");
    assert_eq!((found.stability, found.inertia.zero), (Stability::Stable, 0), "{found:?}");
}

/// The energy is that of all springs, like that of a run: half of 100 N over 0.5 m times 0.5² m² between the held particles, none elsewhere.
#[test]
fn springs_between_held_particles_have_energy() {
    let springs = [(0, 1, 100.0, 0.5), (0, 2, 50.0, 1.0), (1, 2, 50.0, 1.0)];
    let (system, state) = net(2, &[[0.0, 0.0], [1.0, 0.0], [0.5, 0.5]], springs, &[0, 1]).build().unwrap();
    assert!((find(&system, &state).energy - 25.0).abs() < 1e-12);
}

/// A tolerance below rounding is met as far as rounding allows, which is better than by default.
#[test]
fn a_tolerance_below_rounding_is_met_to_rounding() {
    let places: Vec<[f64; 2]> = (0..12).map(|p| [0.1 * f64::from(p), 0.03 * f64::from(p % 3)]).collect();
    let mut builder = net(3, &places, (0..11).map(|p| (p, p + 1, 300.0, 0.1)), &[0, 11]);
    builder.gravity(0.0, -9.81, 0.0);
    builder.masses.fill(0.1);
    let (system, state) = builder.build().unwrap();
    let options = EquilibriumOptions { tolerance: 1e-30, ..EquilibriumOptions::default() };
    let found = equilibrium(&system, &state, options).unwrap();
    assert_eq!(found.stability, Stability::Stable);
    assert!(found.residual <= EquilibriumOptions::default().tolerance, "{:e}", found.residual);
}

/// A straight column between a wall and a slider pressed together, free across: straight is a saddle, from which it buckles; without leaving it the
/// saddle is the answer.
#[test]
fn a_column_buckles_off_its_saddle() {
    let (system, state) = column(&[0.0, 0.8, 1.6]);
    let options = EquilibriumOptions { leave_saddles: false, ..EquilibriumOptions::default() };
    let saddle = equilibrium(&system, &state, options).unwrap();
    assert_eq!((saddle.stability, saddle.inertia), (Stability::Unstable, Signs { negative: 1, zero: 0, positive: 1 }));
    // 2 T/l with T = −2.
    assert!((saddle.lowest.unwrap().0 + 5.0).abs() < 1e-9);
    let found = find(&system, &state);
    assert_eq!(found.stability, Stability::Stable);
    assert!((found.state.positions[1].y.abs() - 0.6).abs() < 1e-10 && found.energy < 1e-20, "{found:?}");
}

/// Without a factorization a hung lattice comes to the same rest, a straight column leaves the same saddle, and a free pair has the same free
/// motions; signs are said not to be counted. An option takes the place of −K too: `axial` lacks the transverse terms, and converges linearly.
#[cfg(feature = "scene")]
#[test]
fn equilibria_without_a_factorization_are_the_same() {
    let mut pair = net(3, &[[0.0, 0.0], [1.3, 0.2]], [(0, 1, 10.0, 1.0)], &[]);
    pair.masses[1] = 2.0;
    let iteratively = |system: &System, state: &State, options: EquilibriumOptions| {
        let mut search = Search::new(system, state, options).unwrap();
        search.solver = Solver::iterative(system).unwrap();
        search.run().unwrap()
    };
    let lattice = crate::scene::builtin(crate::scene::Kind::Lattice, 5).unwrap().build().unwrap();
    let iterations = [StiffnessPolicy::OnDemand, Stiffness::Axial.into()].map(|stiffness| {
        let options = EquilibriumOptions { stiffness, iterations: 200, ..EquilibriumOptions::default() };
        iteratively(&lattice.0, &lattice.1, options).iterations
    });
    assert!(iterations[0] < iterations[1], "{iterations:?}");
    for (system, state) in [lattice, column(&[0.0, 0.8, 1.6, 2.4]), pair.build().unwrap()] {
        let found = find(&system, &state);
        let other = iteratively(&system, &state, EquilibriumOptions::default());
        assert_eq!((other.stability, other.inertia, other.counted), (found.stability, found.inertia, false));
        assert!(found.counted && other.residual <= 1e-10 && other.work.factorizations == 0, "{}", other.residual);
        let scale = found.energy.abs().max(1e-9);
        assert!((other.energy - found.energy).abs() <= 1e-9 * scale, "{} {}", other.energy, found.energy);
    }
}

/// A matrix is factored where that is cheaper than conjugate gradients.
#[cfg(feature = "scene")]
#[test]
fn solids_of_many_particles_are_not_factored() {
    for (size, is_factored) in [(8, true), (40, false)] {
        let (system, _) = crate::scene::builtin(crate::scene::Kind::Lattice, size).unwrap().build().unwrap();
        let matrices = Matrices::new(&system).unwrap();
        let solver = Solver::new(&system, matrices.k()).unwrap();
        assert_eq!(matches!(solver, Solver::Factored(_)), is_factored, "{size}");
    }
}

/// Without a load a free body is indifferent, with one it falls, all of it and nothing else; on rollers it falls only along them.
#[test]
fn bodies_that_nothing_holds_are_named() {
    let build = |axes: &[usize], gravity: [f64; 3]| {
        let places = [0.0, 1.0, 5.0, 6.1].map(|x| [x, 0.0]);
        let mut builder = net(3, &places, [(0, 1, 10.0, 0.9), (2, 3, 10.0, 1.0)], &[0]);
        builder.gravity(gravity[0], gravity[1], gravity[2]);
        builder.constrain(Constraint { axes: crate::system::Axes::of(axes), ..Constraint::hold([2, 3]) });
        builder.build().unwrap()
    };
    let (system, state) = build(&[], [0.0; 3]);
    let found = find(&system, &state);
    // Five rigid motions of the bar, two of the pendulum.
    assert_eq!((found.stability, found.inertia), (Stability::Indifferent, Signs { negative: 0, zero: 7, positive: 2 }));
    assert!(found.gradient(&system, &state.positions).is_err());
    let (system, state) = build(&[], [0.0, -9.81, 0.0]);
    let found = find(&system, &state);
    assert_eq!((found.stability, found.falling), (Stability::None, vec![2, 3]));
    // The force that is left says nothing of the springs: the pendulum hangs, the bar is still stretched, and moves freely along the axes.
    assert_eq!(found.inertia, Signs { negative: 0, zero: 3, positive: 6 });
    let (system, state) = build(&[1], [0.0, -9.81, 0.0]);
    assert_eq!(find(&system, &state).stability, Stability::Indifferent);
}

/// Random nets in space, thrown about, hung or free, under both policies: what is called a minimum is one, by a dense eigenvalue solver, and no force
/// is left.
#[test]
fn minima_are_minima() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(11_2026);
    for trial in 0..60 {
        let size = 3 + trial % 3;
        let mut builder = SystemBuilder::new();
        builder.gravity(0.0, if trial % 2 == 0 { -9.81 } else { 0.0 }, 0.0);
        let number = |i: usize, j: usize| i * size + j;
        let amount = [0.0, 0.3, 1.0][trial % 3];
        for i in 0..size {
            for j in 0..size {
                let x = [i as f64, 0.0, j as f64].map(|x| x + amount * rng.random_range(-1.0..1.0));
                builder.particle(x, rng.random_range(0.1..1.0));
            }
        }
        for i in 0..size {
            for j in 0..size {
                for (a, b) in [(1, 0), (0, 1), (1, 1)] {
                    if i + a < size && j + b < size {
                        let length = f64::hypot(a as f64, b as f64);
                        builder.spring(
                            number(i, j),
                            number(i + a, j + b),
                            spring(rng.random_range(10.0..1000.0), length),
                        );
                    }
                }
            }
        }
        builder.hold(0).hold(number(0, size - 1));
        let (system, state) = builder.build().unwrap();
        let stiffness = [StiffnessPolicy::OnDemand, StiffnessPolicy::Progressive][trial / 6 % 2];
        let options = EquilibriumOptions { stiffness, ..EquilibriumOptions::default() };
        let found = equilibrium(&system, &state, options).unwrap();
        assert!(
            matches!(found.stability, Stability::Stable | Stability::Indifferent),
            "{trial}: {:?}",
            found.stability
        );
        assert!(found.residual <= 1e-10 && found.iterations < 1000, "{trial}: {} {}", found.residual, found.iterations);
        let [lowest, scale] = lowest_eigenvalue(&system, &found.state);
        assert!(lowest > -1e-9 * scale, "{trial}");
        if found.stability == Stability::Stable {
            assert!(lowest > 0.0, "{trial}");
        }
    }
}

/// Free tensegrity prisms out of place: on the way −K is hardly indefinite, and regularised steps creep, while more force is left than tells its
/// lowest eigenvalue from zero.
#[test]
fn searches_do_not_creep_where_little_is_negative() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(17_2026);
    for trial in 0..80 {
        let struts = 3 + trial % 6;
        let turned = std::f64::consts::PI * (0.5 - 1.0 / struts as f64);
        let up = 2.0 * (std::f64::consts::PI / struts as f64).sin();
        let height = rng.random_range(0.5..2.0);
        let place = |p: usize| {
            let angle = std::f64::consts::TAU * (p % struts) as f64 / struts as f64;
            let (angle, y) = if p < struts { (angle, 0.0) } else { (angle + turned, height) };
            [angle.cos(), y, angle.sin()]
        };
        let mut builder = SystemBuilder::new();
        for p in 0..2 * struts {
            builder.particle(place(p).map(|x| x + 0.3 * rng.random_range(-1.0..1.0)), 1.0);
        }
        let prestress = rng.random_range(0.005..0.1);
        for k in 0..struts {
            let next = (k + 1) % struts;
            let bars = [(k, next, 1.0), (struts + k, struts + next, 1.0), (k, struts + k, up), (k, struts + next, -up)];
            for (i, j, density) in bars {
                let length = (0..3).map(|axis| (place(i)[axis] - place(j)[axis]).powi(2)).sum::<f64>().sqrt();
                let stiffness: f64 = rng.random_range(0.5..2.0);
                builder.spring(
                    i,
                    j,
                    spring(stiffness, length * stiffness / (stiffness + density * prestress * length)),
                );
            }
        }
        let (system, state) = builder.build().unwrap();
        let found = find(&system, &state);
        assert_eq!(found.stability, Stability::Indifferent, "{trial}");
        assert!(found.residual <= 1e-10 && found.iterations < 1000, "{trial}: {}", found.iterations);
    }
}

/// A free square with stressed diagonals that a loose tolerance leaves out of balance: its rotation is no stiffer than the forces left over lengths,
/// in millimetres as in kilometres.
#[test]
fn forces_left_hide_a_rotation_at_any_size() {
    for size in [1e-3, 1.0, 1e3] {
        let places = [[0.0, 0.0], [1.0, 2e-4], [1.0, 1.0], [-1e-4, 1.0]].map(|x| x.map(|x| size * x));
        let pairs = [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]].into_iter().enumerate();
        // Tensions of 1 in the sides, and of −√2 in the diagonals.
        let springs = pairs.map(|(k, [i, j])| {
            let (length, tension) = if k < 4 { (1.0, 1.0) } else { (2f64.sqrt(), -(2f64.sqrt())) };
            (i, j, 20.0, size * length / (1.0 + tension / 20.0))
        });
        let (system, state) = net(2, &places, springs, &[]).build().unwrap();
        let options = EquilibriumOptions { tolerance: 0.05, ..EquilibriumOptions::default() };
        let found = equilibrium(&system, &state, options).unwrap();
        assert!(found.residual > 1e-4, "{size}: nothing is left, {}", found.residual);
        assert_eq!(found.inertia, Signs { negative: 0, zero: 3, positive: 5 }, "{size}");
    }
}

/// Taylor's theorem for a random cost at a hanging net under a part of its load: what the gradient leaves is of second order in the change, for every
/// kind of parameter.
#[test]
fn the_gradient_is_that_of_the_equilibrium() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
    let mut random = || rng.random_range(-1.0..1.0);
    let places: Vec<[f64; 3]> = (0..9).map(|p| [f64::from(p % 3), 0.0, f64::from(p / 3)]).collect();
    // The sides of the squares, and four diagonals.
    let ends = [0, 1, 1, 2, 3, 4, 4, 5, 6, 7, 7, 8, 0, 3, 3, 6, 1, 4, 4, 7, 2, 5, 5, 8, 0, 4, 4, 8, 2, 4, 4, 6];
    let edges = ends.as_chunks::<2>().0;
    let cost: Vec<Vector3<f64>> = (0..9).map(|_| Vector3::from_fn(|_, _| random())).collect();
    let change: Vec<f64> = (0..64).map(|_| random()).collect();
    let build = |h: f64| {
        let mut builder = SystemBuilder::new();
        builder.gravity(h * change[60], -9.81 + h * change[61], h * change[62]);
        for (p, x) in places.iter().enumerate() {
            let moved = if [0, 2, 6].contains(&p) { h * change[50 + p] } else { 0.0 };
            builder.particle([x[0] + moved, x[1], x[2] - moved], 1.0 + h * change[40 + p]);
        }
        for (s, [i, j]) in edges.iter().enumerate() {
            builder.spring(*i, *j, spring(100.0 * (1.0 + h * change[s]), 1.1 + h * change[20 + s]));
        }
        builder.hold(0).hold(2).hold(6);
        let (system, state) = builder.build().unwrap();
        let mut forces = vec![Vector3::zeros(); 9];
        forces[5] = Vector3::new(1.0, 2.0 + h * change[63], 3.0);
        (system.with_loads(Loads { forces, ..Loads::default() }).unwrap(), state)
    };
    let options = EquilibriumOptions { load: 0.7, ..EquilibriumOptions::default() };
    let find = |system: &System, state: &State| equilibrium(system, state, options).unwrap();
    let (system, state) = build(0.0);
    let base = find(&system, &state);
    let gradient = base.gradient(&system, &cost).unwrap();
    let mut slope =
        gradient.gravity.dot(&Vector3::new(change[60], change[61], change[62])) + gradient.loads[5].y * change[63];
    for p in 0..9 {
        slope +=
            gradient.masses[p] * change[40 + p] + (gradient.positions[p].x - gradient.positions[p].z) * change[50 + p];
    }
    for s in 0..edges.len() {
        slope += 100.0 * gradient.stiffness[s] * change[s] + gradient.rest_lengths[s] * change[20 + s];
    }
    let value = |found: &Equilibrium| found.state.positions.iter().zip(&cost).map(|(x, c)| x.dot(c)).sum::<f64>();
    let remainders = [0.02, 0.01, 0.005, 0.0025].map(|h| {
        let (system, _) = build(h);
        let mut from = base.state.clone();
        from.prescribe(&system);
        (value(&find(&system, &from)) - value(&base) - h * slope).abs()
    });
    for pair in remainders.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.85..2.15).contains(&order), "{remainders:?}");
    }
}

#[test]
fn options_that_cannot_be_used_are_errors() {
    let (system, state) = crate::system::fixtures::row(3);
    for (tolerance, load) in [(0.0, 1.0), (1.0, 1.0), (-1.0, 1.0), (f64::NAN, 1.0), (1e-9, f64::NAN)] {
        let options = EquilibriumOptions { tolerance, load, ..EquilibriumOptions::default() };
        assert!(equilibrium(&system, &state, options).is_err());
    }
    let found = find(&system, &state);
    assert!(found.gradient(&system, &[]).is_err());
}

/// A shallow truss, pushed down at its top: the load of the textbook is a limit point, behind which the path goes on.
#[test]
fn a_shallow_truss_snaps_through_at_the_load_of_the_textbook() {
    let (builder, limit) = truss(0.3);
    let (system, state) = builder.build().unwrap();
    let path = |load: f64, count| load_path(&pushed(&system, 2, [0.0, -load]), &state, count).unwrap();
    for count in [7, 10] {
        let found = path(1.7 * limit, count);
        assert_eq!(found.critical.len(), 1, "{:?}", found.critical);
        assert_eq!(found.critical[0].kind, CriticalKind::LimitPoint);
        assert!((found.critical[0].factor * 1.7 - 1.0).abs() < 1e-8, "{}", found.critical[0].factor * 1.7);
        let (factor, last) = found.steps.last().unwrap();
        assert_eq!((*factor, last.stability), (1.0, Stability::Stable));
        assert!(last.state.positions[2].y < -0.3);
    }
    assert!(path(0.99 * limit, 10).critical.is_empty());
}

/// Just beyond the limit point forces are tiny and −K is indefinite: the search does not creep but snaps through.
#[test]
fn searches_do_not_creep_beyond_a_limit_point() {
    let (builder, limit) = truss(0.3);
    let (system, state) = builder.build().unwrap();
    let loaded = |part: f64| pushed(&system, 2, [0.0, -limit * part]);
    let below = find(&loaded(1.0 - 1e-8), &state);
    assert!(below.state.positions[2].y > 0.0);
    let above = find(&loaded(1.0 + 1e-8), &below.state);
    assert_eq!(above.stability, Stability::Stable);
    assert!(above.state.positions[2].y < -0.3 && above.iterations < 100, "{above:?}");
}

/// A braced strip of soft springs that snaps onto another branch at a twelfth of its load, within a step of the path whose length suits the tangents:
/// the critical load is found however long the steps are.
#[test]
fn steps_that_end_on_another_branch_hide_no_critical_load() {
    let corners = [-0.03, -0.01, 0.99, -0.01, 0.02, 1.25, 1.03, 1.26, -0.01, 2.63, 1.02, 2.57, 0.05, 3.91, 0.97, 3.9];
    let places = corners.as_chunks::<2>().0;
    let pairs = [0, 2, 0, 3, 1, 2, 1, 3, 2, 3, 2, 4, 2, 5, 3, 4, 3, 5, 4, 5, 4, 6, 4, 7, 5, 6, 5, 7, 6, 7];
    let stiffness = [1.3, 2.8, 2.0, 3.2, 1.8, 1.1, 3.2, 3.3, 1.1, 2.1, 2.1, 4.4, 2.6, 1.6, 4.1];
    let springs = pairs.as_chunks::<2>().0.iter().zip(stiffness).map(|(&[i, j], k)| {
        let [a, b]: [[f64; 2]; 2] = [places[i], places[j]];
        (i, j, k, f64::hypot(a[0] - b[0], a[1] - b[1]))
    });
    let mut builder = net(2, places, springs, &[0, 1]);
    builder.gravity(0.0, -0.065, 0.0);
    let (system, state) = builder.build().unwrap();
    let mut forces = vec![Vector3::zeros(); places.len()];
    forces[6..].fill(Vector3::new(0.02, -0.71, 0.0));
    let system = system.with_loads(Loads { forces, ..Loads::default() }).unwrap();
    for count in [1, 5, 40, 60] {
        let path = load_path(&system, &state, count).unwrap();
        let first = &path.critical[0];
        assert_eq!(first.kind, CriticalKind::LimitPoint, "{count}");
        assert!((first.factor - 0.084_872_478).abs() < 1e-8, "{count}: {}", first.factor);
        // On the branch from no load, and hardly stiff any more.
        assert!(first.state.positions[6].y > 3.8, "{count}: {}", first.state.positions[6]);
        let [lowest, _] = lowest_eigenvalue(&system, &first.state);
        assert!((0.0..1e-3).contains(&lowest), "{count}: {lowest}");
    }
}

/// A slack chain has no state without a load, and what happens there is no critical load.
#[test]
fn a_path_of_a_slack_chain_begins_with_its_load() {
    let row = [0.0, 1.0, 2.0, 3.0].map(|x| [x, 0.0]);
    let mut builder = net(2, &row, (0..3).map(|p| (p, p + 1, 100.0, 1.0)), &[0, 3]);
    builder.gravity(0.0, -9.81, 0.0);
    let (system, state) = builder.build().unwrap();
    let path = load_path(&system, &state, 4).unwrap();
    assert!(path.steps[0].1.inertia.zero > 0 && path.critical.is_empty(), "{:?}", path.critical);
    assert_eq!((path.steps.len(), path.steps[4].1.stability), (5, Stability::Stable));
}

/// A column of two bars braced by a spring across buckles sideways where the brace is too soft, 2P/l = κ: a bifurcation, which linear buckling
/// estimates well. The stiffness of the bars does not matter to where it is found.
#[test]
fn a_braced_column_bifurcates() {
    for k in [1e4, 1e7] {
        let brace = 50.0;
        let places = [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [1.0, 1.0], [-1.0, 1.0]];
        let springs = [(0, 1, k, 1.0), (1, 2, k, 1.0), (1, 3, brace / 2.0, 1.0), (1, 4, brace / 2.0, 1.0)];
        let mut builder = net(2, &places, springs, &[0, 3, 4]);
        builder.constrain(Constraint { axes: crate::system::Axes::of(&[0]), ..Constraint::hold([2]) });
        let (system, state) = builder.build().unwrap();
        let load = 40.0;
        let system = pushed(&system, 2, [0.0, -load]);
        let path = load_path(&system, &state, 5).unwrap();
        assert_eq!((path.critical.len(), path.critical[0].kind), (1, CriticalKind::Bifurcation));
        // Bars of length 1 − P/k: 2P/(1 − P/k) equals the stiffness of the brace across, whose own bar has sunk by P/k.
        let sideways = |factor: f64| {
            let p = factor * load;
            let (l, sunk) = (1.0 - p / k, p / k);
            let across = f64::hypot(1.0, sunk);
            let tension = brace * (across - 1.0);
            let n = 1.0 / across;
            let stiffness = brace * n * n + tension / across * (1.0 - n * n);
            stiffness - 2.0 * p / l
        };
        let found = path.critical[0].factor;
        assert!(sideways(found).abs() < 1e-6, "{k:e}: {found} {:e}", sideways(found));
        assert!((path.linear_buckling.unwrap() - found).abs() < 0.02 * found, "{:?} {found}", path.linear_buckling);
        assert!(path.critical[0].direction[0].abs() > 0.9);
    }
}

/// A truss whose steps of the load end at its limit point itself, where the tangent is as long as it likes.
#[test]
fn a_step_that_ends_at_a_limit_point_does_not_hide_it() {
    for (height, count) in [(0.6, 2), (0.8, 4), (0.4, 2)] {
        let (mut builder, limit) = truss(height);
        builder.constrain(Constraint { axes: Axes::of(&[0]), ..Constraint::hold([2]) });
        let (system, state) = builder.build().unwrap();
        let path = load_path(&pushed(&system, 2, [0.0, -2.0 * limit]), &state, count).unwrap();
        let factors: Vec<f64> = path.critical.iter().map(|critical| critical.factor).collect();
        assert!(factors.len() == 1 && (factors[0] - 0.5).abs() < 1e-8, "{height}: {factors:?}");
    }
}
