//! Bodies, the parts of a scene that springs connect, and their rigid motions.
//!
//! A rigid motion of a body is `u_i = t + ω × (x_i − c)`, in the plane with one rotation, on a line with none. Constraints admit those for which
//! every held coordinate stays: the null space of the six motions' values there.

use crate::system::System;
use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector3};
use std::collections::BTreeMap;

/// Particles that springs connect, and the held particles that they are tied to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Body {
    /// Particles with a free coordinate, ascending.
    pub particles: Vec<usize>,
    /// Particles without one at the other ends of springs.
    pub anchors: Vec<usize>,
}

/// The bodies of a system, ordered by their first particles. A particle that is held along all axes joins none.
pub(crate) fn bodies(system: &System) -> Vec<Body> {
    let is_free = |p: usize| !system.dofs().rows(p).is_empty();
    let joins = system.active().map(|(_, ends, _)| ends).filter(|ends| ends.iter().all(|&p| is_free(p)));
    let firsts = first_connected(system.particles(), joins);
    let mut bodies: BTreeMap<usize, Body> = BTreeMap::new();
    for p in (0..system.particles()).filter(|&p| is_free(p)) {
        bodies.entry(firsts[p]).or_default().particles.push(p);
    }
    for (_, [i, j], _) in system.active() {
        for (free, held) in [(i, j), (j, i)] {
            if is_free(free) && !is_free(held) {
                bodies.entry(firsts[free]).or_default().anchors.push(held);
            }
        }
    }
    for body in bodies.values_mut() {
        body.anchors.sort_unstable();
        body.anchors.dedup();
    }
    bodies.into_values().collect()
}

/// The first particle that each is connected with by pairs.
pub(crate) fn first_connected(particles: usize, pairs: impl Iterator<Item = [usize; 2]>) -> Vec<usize> {
    // Path halving: every second particle is hung one higher, so that no path stays long, in whatever order pairs come.
    fn root(parent: &mut [usize], mut p: usize) -> usize {
        while parent[p] != p {
            parent[p] = parent[parent[p]];
            p = parent[p];
        }
        p
    }
    let mut parent: Vec<usize> = (0..particles).collect();
    for [i, j] in pairs {
        let (a, b) = (root(&mut parent, i), root(&mut parent, j));
        parent[a.max(b)] = a.min(b);
    }
    (0..particles).map(|p| root(&mut parent, p)).collect()
}

/// The sums of what springs give to both of their ends, for every particle.
pub(crate) fn sums_at_ends(system: &System, springs: impl Iterator<Item = ([usize; 2], f64)>) -> Vec<f64> {
    let mut sums = vec![0.0; system.particles()];
    springs.for_each(|(ends, value)| ends.iter().for_each(|&end| sums[end] += value));
    sums
}

/// Positions moved rigidly to where they are nearest to a reference, by the singular value decomposition of their covariance (Kabsch,
/// Acta Cryst. A32, 1976).
pub(crate) fn rigidly_aligned(reference: &[Vector3<f64>], positions: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let count = positions.len().max(1) as f64;
    let [centre, to] = [positions, reference].map(|list| list.iter().sum::<Vector3<f64>>() / count);
    let mut covariance = Matrix3::zeros();
    for (x, reference) in positions.iter().zip(reference) {
        covariance += (reference - to) * (x - centre).transpose();
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return positions.to_vec() };
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let turn = u * mirror * v_t;
    positions.iter().map(|x| to + turn * (x - centre)).collect()
}

impl Body {
    /// A basis of the rigid motions that the constraints admit, as velocities of the body's particles, in their order; orthonormal in the inner
    /// product of the free coordinates' masses.
    pub fn rigid_motions(&self, system: &System, positions: &[Vector3<f64>]) -> Vec<Vec<Vector3<f64>>> {
        let dimension = system.dimension();
        let members: Vec<usize> = self.particles.iter().chain(&self.anchors).copied().collect();
        let centre = members.iter().map(|&p| positions[p]).sum::<Vector3<f64>>() / members.len() as f64;
        let arm = |p: usize| positions[p] - centre;
        let radius = members.iter().map(|&p| arm(p).norm()).fold(0.0, f64::max);
        let rotations = match dimension {
            3 => 0..3,
            2 => 2..3,
            _ => 0..0,
        };
        let zero = Vector3::zeros();
        let translations = (0..dimension).map(|axis| [Vector3::ith(axis, 1.0), zero]);
        let motions: Vec<[Vector3<f64>; 2]> =
            translations.chain(rotations.map(|axis| [zero, Vector3::ith(axis, 1.0)])).collect();
        let velocity = |[t, omega]: &[Vector3<f64>; 2], p: usize| match radius > 0.0 {
            true => t + omega.cross(&arm(p)) / radius,
            false => *t,
        };
        let count = motions.len();
        // Motion of the held coordinates, and of the free ones, as quadratic forms of the coefficients.
        let (mut held, mut free) = (DMatrix::zeros(count, count), DMatrix::zeros(count, count));
        for &p in &members {
            let at: Vec<Vector3<f64>> = motions.iter().map(|motion| velocity(motion, p)).collect();
            let axes = system.dofs().free_axes(p);
            #[expect(clippy::needless_range_loop, reason = "an axis is an index of several vectors")]
            for axis in 0..dimension {
                let (form, weight) = match axes.contains(axis) {
                    true => (&mut free, system.masses()[p]),
                    false => (&mut held, 1.0),
                };
                for a in 0..count {
                    for b in 0..count {
                        form[(a, b)] += weight * at[a][axis] * at[b][axis];
                    }
                }
            }
        }
        let admitted = null_space(held);
        if admitted.is_empty() {
            return Vec::new();
        }
        // Relative to all motions: those admitted may be none but the rotation of a row of particles about itself.
        let size = free.trace();
        let projected = admitted.transpose() * free * &admitted;
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(projected);
        // The rounding of a sum of squares, with room: a body is straight to a ten-millionth of its length.
        let kept = (0..eigenvalues.len()).filter(|&k| eigenvalues[k] > 1e-14 * size);
        kept.map(|k| {
            let coefficients = &admitted * eigenvectors.column(k) / eigenvalues[k].sqrt();
            let of_particle = |&p: &usize| {
                let parts = motions.iter().zip(&coefficients).map(|(motion, c)| velocity(motion, p) * *c);
                system.dofs().free_axes(p).project(&parts.sum())
            };
            self.particles.iter().map(of_particle).collect()
        })
        .collect()
    }
}

/// An orthonormal basis of the null space of a positive semidefinite matrix, of eigenvalues up to 1e-9 of its trace.
fn null_space(form: DMatrix<f64>) -> DMatrix<f64> {
    let size = form.trace();
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(form);
    let null: Vec<usize> = (0..eigenvalues.len()).filter(|&k| eigenvalues[k] <= 1e-9 * size).collect();
    eigenvectors.select_columns(&null)
}

pub(crate) fn combination<'f>(vectors: &[Vec<f64>], factors: impl IntoIterator<Item = &'f f64>) -> Vec<f64> {
    let mut sum = vec![0.0; vectors.first().map_or(0, Vec::len)];
    for (vector, factor) in vectors.iter().zip(factors) {
        sum.iter_mut().zip(vector).for_each(|(sum, u)| *sum += factor * u);
    }
    sum
}

pub(crate) fn rigid_motions(system: &System, positions: &[Vector3<f64>]) -> Vec<Vec<f64>> {
    let of_body = |body: &Body| {
        let motions = body.rigid_motions(system, positions).into_iter();
        let reduced = motions.map(|motion| {
            let mut reduced = vec![0.0; system.dofs().len()];
            for (&p, u) in body.particles.iter().zip(&motion) {
                system.dofs().add(&mut reduced, p, u);
            }
            reduced
        });
        reduced.collect::<Vec<_>>()
    };
    bodies(system).iter().flat_map(of_body).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::{Constraint, SystemBuilder};

    /// Pairs given from the far end on hang every particle under the next: without path halving the path to the root of the last ones
    /// is the whole chain, for every particle.
    #[test]
    fn long_chains_are_one_part() {
        let firsts = first_connected(100_001, (0..100_000).rev().map(|p| [p, p + 1]));
        assert!(firsts.iter().all(|&first| first == 0));
    }

    fn built(places: &[[f64; 3]], springs: &[[usize; 2]], constraint: Constraint) -> (System, Vec<Vector3<f64>>) {
        let mut builder = SystemBuilder::new();
        for &x in places {
            builder.particle(x, 2.0);
        }
        for &[i, j] in springs {
            builder.spring(i, j, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        builder.constrain(constraint);
        let (system, state) = builder.build().unwrap();
        (system, state.positions)
    }

    /// A row of particles that is held at two of them cannot move, though nothing stops its rotation about itself.
    #[test]
    fn a_row_does_not_turn_about_itself() {
        let places = [0.0, 1.1, 2.3, 3.7].map(|place| [place, 0.5 * place, 0.25 * place]);
        for (held, motions) in [(vec![0, 1], 0), (vec![0], 2), (vec![], 5)] {
            let (system, positions) = built(&places, &[[0, 1], [1, 2], [2, 3], [0, 3], [1, 3]], Constraint::hold(held));
            assert_eq!(rigid_motions(&system, &positions).len(), motions);
        }
    }

    /// A triangle, a bar and a free particle, with a held particle beside: 6 + 5 + 3 motions; by constraints fewer.
    #[test]
    fn rigid_motions_are_those_that_constraints_admit() {
        let places =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 0.0, 0.0], [6.0, 0.0, 1.0], [9.0, 9.0, 9.0]];
        for (held, parts, motions) in [
            (Constraint::hold([]), 3, 14),
            // Three rotations of the triangle about its corner are left.
            (Constraint::hold([0]), 3, 11),
            // One about an edge.
            (Constraint::hold([0, 1]), 3, 9),
            // Along z only: two translations, one rotation.
            (Constraint { axes: crate::system::Axes::of(&[2]), ..Constraint::hold([0, 1, 2]) }, 3, 11),
            (Constraint::hold([5]), 2, 11),
        ] {
            let (system, positions) = built(&places, &[[0, 1], [1, 2], [2, 0], [3, 4]], held.clone());
            assert_eq!(bodies(&system).len(), parts);
            let basis = rigid_motions(&system, &positions);
            assert_eq!(basis.len(), motions, "{held:?}");
            for (k, a) in basis.iter().enumerate() {
                for (l, b) in basis.iter().enumerate() {
                    let product: f64 = a.iter().zip(b).map(|(a, b)| 2.0 * a * b).sum();
                    assert!((product - f64::from(u8::from(k == l))).abs() < 1e-12);
                }
            }
        }
    }
}
