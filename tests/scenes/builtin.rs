//! The ready scenes are what their documentation says.

use nalgebra::{DMatrix, Vector3};
use sprung::scene::builtin::{builtin, network};
use sprung::scene::{Kind, Scene};
use sprung::spring::Extension;
use sprung::{State, Stiffness, System};
use std::collections::BTreeSet;

fn build(kind: Kind, size: usize) -> (System, State) {
    builtin(kind, size).unwrap().build().unwrap()
}

/// How often each length occurs, in multiples of a unit, rounded to 1e-9.
fn lengths(system: &System, state: &State, unit: f64) -> Vec<(String, usize)> {
    let length = |&[i, j]: &[u32; 2]| (state.positions[i as usize] - state.positions[j as usize]).norm() / unit;
    let mut all: Vec<String> = system.pairs().iter().map(|pair| format!("{:.9}", length(pair))).collect();
    all.sort();
    all.chunk_by(|a, b| a == b).map(|same| (same[0].clone(), same.len())).collect()
}

#[test]
fn every_kind_is_named_after_itself_and_lets_runs_choose_their_steps() {
    for kind in Kind::ALL {
        let scene = builtin(kind, kind.default_size()).unwrap();
        assert_eq!(scene.name, kind.name());
        assert!(scene.time.dt.is_none() && scene.time.duration.unwrap() > 0.1, "{kind:?}");
        let (system, _) = scene.build().unwrap();
        assert!(!system.prescribed().is_empty() && !system.dofs().is_empty(), "{kind:?}");
        let joined: BTreeSet<_> = system.pairs().iter().map(|&[i, j]| [i.min(j), i.max(j)]).collect();
        assert_eq!(joined.len(), system.pairs().len(), "{kind:?} joins two particles twice");
    }
}

#[test]
fn particles_springs_and_degrees_of_freedom_are_as_many_as_the_size_says() {
    for (kind, size, expected) in [
        (Kind::Chain, 7, (8, 7, 21)),
        (Kind::Cloth, 1, (1, 0, 0)),
        // 2·5·4 structural, 2·4·4 shear, 2·5·3 bend.
        (Kind::Cloth, 5, (25, 40 + 32 + 30, 69)),
        // 3·4·4·3 structural, 3·2·4·3·3 face diagonals.
        (Kind::Lattice, 4, (64, 144 + 216, 144)),
        (Kind::Column, 7, (9, 8, 21)),
        (Kind::Pendulum, 2, (3, 2, 4)),
        (Kind::String, 7, (9, 8, 14)),
    ] {
        let (system, _) = build(kind, size);
        assert_eq!((system.particles(), system.springs().len(), system.dofs().len()), expected, "{kind:?} {size}");
    }
}

#[test]
fn cloth_has_structural_shear_and_bend_springs() {
    let (system, state) = build(Kind::Cloth, 5);
    let expected = [("1.000000000", 40), ("1.414213562", 32), ("2.000000000", 30)];
    assert_eq!(lengths(&system, &state, 0.05), expected.map(|(length, count)| (length.to_owned(), count)));
}

#[test]
fn lattice_has_structural_springs_and_face_diagonals() {
    let (system, state) = build(Kind::Lattice, 4);
    let expected = [("1.000000000", 144), ("1.414213562", 216)];
    assert_eq!(lengths(&system, &state, 0.01), expected.map(|(length, count)| (length.to_owned(), count)));
}

/// M/dt² + Σ K^s over the free degrees of freedom, dense.
fn system_matrix(system: &System, state: &State, dt: f64) -> DMatrix<f64> {
    let dofs = system.dofs();
    let mut a = DMatrix::zeros(dofs.len(), dofs.len());
    for (row, dof) in dofs.iter().enumerate() {
        a[(row, row)] = system.masses()[dof.particle] / (dt * dt);
    }
    for (s, spring) in system.springs().iter().enumerate() {
        let [i, j] = system.pair(s);
        let at = Extension::between(&state.positions[i], &state.positions[j]).unwrap();
        let block = spring.stiffness_block(&at, Stiffness::Full).matrix();
        for (p, q, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
            for (r, row) in dofs.free_axes(p).iter().zip(dofs.rows(p)) {
                for (c, column) in dofs.free_axes(q).iter().zip(dofs.rows(q)) {
                    a[(row, column)] += sign * block[(r, c)];
                }
            }
        }
    }
    a
}

#[test]
fn column_is_definite_at_its_own_step_and_indefinite_at_larger_ones() {
    for size in [1, 4, 9, 30] {
        let (system, state) = build(Kind::Column, size);
        assert!(system.springs().iter().enumerate().all(|(s, spring)| {
            let [i, j] = system.pair(s);
            spring.is_compressed(&Extension::between(&state.positions[i], &state.positions[j]).unwrap())
        }));
        let definite = |dt| system_matrix(&system, &state, dt).cholesky().is_some();
        // The formula of its documentation, whose straight column the offsets of 1e-3 change by about 1e-5.
        let c = 1000.0 * (1.0 / 0.095 - 1.0 / 0.1);
        let critical = (0.1 / (c * (2.0 + 2.0 * (std::f64::consts::PI / (size as f64 + 1.0)).cos()))).sqrt();
        assert!(definite(0.002) && definite(critical * 0.999) && !definite(critical * 1.001), "{size}");
    }
}

#[test]
fn string_is_struck_in_its_lowest_mode_with_a_period_of_a_fifth_of_a_second() {
    let size = 31;
    let (system, state) = build(Kind::String, size);
    // K^s v = m ω² v for the initial velocity, with M/dt² vanishing as dt → ∞.
    let k = system_matrix(&system, &state, f64::INFINITY);
    let mut v = nalgebra::DVector::zeros(system.dofs().len());
    system.dofs().gather(&state.velocities, v.as_mut_slice());
    let acceleration = &k * &v / system.masses()[1];
    let omega = acceleration.norm().sqrt() / v.norm().sqrt();
    approx::assert_relative_eq!(acceleration, &v * (omega * omega), max_relative = 1e-10);
    // The discrete string is slower than the continuous one by the factor sinc(π/(2·32)), 4e-4.
    approx::assert_relative_eq!(omega, 2.0 * std::f64::consts::PI / 0.2, max_relative = 1e-3);
}

#[test]
fn network_joins_exactly_the_near_particles_and_has_unequal_values() {
    let (system, state) = build(Kind::Network, 200);
    let radius = (10.0 / (200.0 * 4.0 / 3.0 * std::f64::consts::PI)).cbrt();
    let distance = |i: usize, j: usize| (state.positions[i] - state.positions[j]).norm();
    let near = (0..200u32).flat_map(|i| (i + 1..200).map(move |j| [i, j]));
    let near: Vec<_> = near.filter(|&[i, j]| distance(i as usize, j as usize) < radius).collect();
    assert_eq!(system.pairs(), near);
    let distinct = |values: Vec<f64>| values.iter().map(|value| value.to_bits()).collect::<BTreeSet<_>>().len();
    assert!(distinct(system.masses().to_vec()) > 190);
    assert!(distinct(system.springs().iter().map(|s| s.stiffness).collect()) > near.len() * 9 / 10);
    for (s, spring) in system.springs().iter().enumerate() {
        let [i, j] = system.pair(s);
        // Rest lengths are rounded to 1e-6 m.
        assert!((spring.rest_length / distance(i, j) - 1.0).abs() < 0.1 + 1e-6 / distance(i, j));
    }
}

#[test]
fn network_hangs_by_its_highest_tenth() {
    let (system, state) = build(Kind::Network, 95);
    let held: BTreeSet<usize> = system.prescribed().iter().map(|(dof, ..)| dof.particle).collect();
    assert_eq!(held.len(), 10);
    let height = |x: &Vector3<f64>| x.y;
    let lowest_held = held.iter().map(|&p| height(&state.positions[p])).fold(f64::INFINITY, f64::min);
    assert!((0..95).filter(|p| !held.contains(p)).all(|p| height(&state.positions[p]) < lowest_held));
}

#[test]
fn the_same_seed_gives_the_same_network_and_another_seed_another() {
    let seeded = |seed| -> Scene { network(50, seed).unwrap() };
    assert_eq!(seeded(7), seeded(7));
    assert_ne!(seeded(7), seeded(8));
    assert_eq!(seeded(0), builtin(Kind::Network, 50).unwrap());
}

#[test]
fn the_largest_sizes_are_a_million_particles() {
    for kind in [Kind::Cloth, Kind::Lattice] {
        let scene = builtin(kind, *kind.sizes().end()).unwrap();
        assert_eq!(scene.particles.positions.len(), 1_000_000);
    }
}
