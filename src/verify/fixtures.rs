//! Systems that the tests of several checks work with by hand.

use super::Entry;
use crate::integrate::StepMatrices;
use crate::spring::{Spring, Stiffness};
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::DMatrix;
use nalgebra_sparse::CscMatrix;

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

/// A chain in a plane, its second link along x and its third along y. Seven coordinates: the third particle moves along x alone.
pub fn bent() -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for [x, y] in [[0.0, 0.0], [3.0, 4.0], [5.0, 4.0], [5.0, 1.0]] {
        builder.particle([x, y, 0.0], 1.0);
    }
    for (link, (stiffness, rest_length)) in [(2.0, 4.0), (3.0, 1.0), (1.0, 2.0)].into_iter().enumerate() {
        builder.spring(link, link + 1, Spring { stiffness, rest_length, damping: 0.0 });
    }
    builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[1]), motion: Motion::Held });
    builder.build().unwrap()
}

/// K of that chain with two faults: of what the first link has beside the diagonal only `nnᵀ k/l0` is there, and the coupling of the second
/// link is a fifth too weak.
pub fn wrong_stiffness(system: &System, state: &State) -> CscMatrix<f64> {
    let k = StepMatrices::assemble(system, state, Stiffness::Full, 1.0).unwrap().k.to_csc();
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

/// Where a table finds these faults, of which springs, and in which words. Of the second link one column alone is there, which says nothing
/// of terms.
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
