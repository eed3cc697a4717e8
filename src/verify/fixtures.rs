//! Systems that the tests of several checks work with by hand.

use super::{Entry, TestCase};
use crate::integrate::StepMatrices;
use crate::spring::{Spring, Stiffness};
use crate::system::{Axes, Constraint, Motion, State, SystemBuilder};
use nalgebra::{DMatrix, Vector3};
use nalgebra_sparse::CscMatrix;

/// A test case of what was built.
pub fn case(builder: SystemBuilder, dt: f64) -> TestCase {
    let (system, state) = builder.build().unwrap();
    TestCase { name: "case".into(), system, state, dt, loaded: None }
}

pub fn assert_close(value: f64, expected: f64) {
    assert!((value / expected - 1.0).abs() < 1e-14, "{value:e} is not {expected:e}");
}

/// Springs of k = 4 N, l0 = 2 m and of k = 12 N, l0 = 4 m between particles of 2, 1 and 5 kg at 1, 4 and 9 m.
pub fn line() -> SystemBuilder {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.gravity(-2.0, 0.0, 0.0);
    for (x, mass) in [(1.0, 2.0), (4.0, 1.0), (9.0, 5.0)] {
        builder.particle([x, 0.0, 0.0], mass);
    }
    builder.spring(0, 1, Spring { stiffness: 4.0, rest_length: 2.0, damping: 0.5 });
    builder.spring(1, 2, Spring { stiffness: 12.0, rest_length: 4.0, damping: 1.0 });
    builder
}

/// A state of three particles along a line.
pub fn line_state(time: f64, positions: [f64; 3], velocities: [f64; 3]) -> State {
    let along = |numbers: [f64; 3]| numbers.map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
    State { time, positions: along(positions), velocities: along(velocities) }
}

/// A particle of 1 kg, 1 m from a held one, on a spring of k = 100 N along x.
pub fn pair(rest_length: f64, dt: f64) -> TestCase {
    let mut builder = SystemBuilder::new();
    let (anchor, bob) = (builder.particle([0.0; 3], 1.0), builder.particle([1.0, 0.0, 0.0], 1.0));
    builder.spring(anchor, bob, Spring { stiffness: 100.0, rest_length, damping: 0.0 });
    builder.hold(anchor);
    case(builder, dt)
}

/// A particle that is moved along x from 1 m.
pub fn moved(motion: Motion, dt: f64) -> TestCase {
    let mut builder = SystemBuilder::new();
    builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
    case(builder, dt)
}

/// A path along which nothing moves, with corners at these times.
pub fn path(corners: &[f64]) -> Motion {
    Motion::Path { times: corners.to_vec(), offsets: vec![Vector3::zeros(); corners.len()] }
}

/// A chain in space that bends and swings, with unlike masses and springs, some stretched and some compressed; its first particle is held.
pub fn chain(particles: usize, dt: f64) -> TestCase {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.5, -9.0, 0.25);
    for n in 0..particles {
        let t = n as f64;
        builder.particle([1.1 * t, (0.9 * t).sin(), (0.7 * t).cos()], 1.0 + 0.5 * (1.3 * t).sin());
        if n > 0 {
            let (stiffness, rest_length) = (40.0 + 10.0 * t.cos(), 1.2 + 0.3 * t.sin());
            builder.spring(n - 1, n, Spring { stiffness, rest_length, damping: 0.25 });
        }
    }
    builder.hold(0);
    case(builder, dt)
}

/// A chain in a plane, its second link along x and its third along y. Seven coordinates: the third particle moves along x alone.
pub fn bent() -> TestCase {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for [x, y] in [[0.0, 0.0], [3.0, 4.0], [5.0, 4.0], [5.0, 1.0]] {
        builder.particle([x, y, 0.0], 1.0);
    }
    for (link, (stiffness, rest_length)) in [(2.0, 4.0), (3.0, 1.0), (1.0, 2.0)].into_iter().enumerate() {
        builder.spring(link, link + 1, Spring { stiffness, rest_length, damping: 0.0 });
    }
    builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[1]), motion: Motion::Held });
    case(builder, 1.0)
}

/// K of that chain with two faults: of the entries of the first link beside the diagonal only `nnᵀ k/l0` is there, and the coupling of
/// the second link is a fifth too weak.
pub fn wrong_stiffness(case: &TestCase) -> CscMatrix<f64> {
    let k = StepMatrices::assemble(&case.system, &case.state, Stiffness::Full, case.dt).unwrap().k.to_csc();
    let mut dense = DMatrix::from(&k);
    for (r, n_r) in [0.6, 0.8].into_iter().enumerate() {
        for (c, n_c) in [0.6, 0.8].into_iter().enumerate() {
            dense[(r, 2 + c)] = 0.5 * n_r * n_c;
            dense[(2 + r, c)] = 0.5 * n_r * n_c;
        }
    }
    dense[(2, 4)] *= 0.8;
    CscMatrix::from(&dense)
}

/// The places, springs and words with which a table names these faults. Of the second link one column alone is there, which says
/// nothing of terms.
pub fn assert_faults_are_found(table: &[Entry]) {
    let mut found: Vec<_> = table
        .iter()
        .filter(|entry| entry.verdict != "agrees")
        .map(|entry| (entry.row, entry.column.unwrap(), entry.spring.unwrap(), entry.verdict.as_str()))
        .collect();
    found.sort_unstable();
    let mut expected = vec![(2, 4, 1, "20.0 % too small")];
    for (r, c) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        expected.push((r, 2 + c, 0, "the transverse term missing"));
        expected.push((2 + r, c, 0, "the transverse term missing"));
    }
    expected.sort_unstable();
    assert_eq!(found, expected);
}
