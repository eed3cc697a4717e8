//! Rigorous enclosures of eigenvalues: residuals with all of their rounding errors, and clusters.
//!
//! For vectors X of full rank and any Θ = diag(θ) as many eigenvalues of A φ = λ M φ, each counted as often as it occurs, can be paired with the θ
//! such that (Kahan 1967; Cao, Xie and Li, SIAM J. Matrix Anal. Appl. 17, 1996)
//!
//! ```text
//! |λ_k − θ_k| ≤ ‖M^{-1/2}(AX − MXΘ)‖₂ / σ_min(M^{1/2}X),      σ_min² ≥ 1 − ‖XᵀMX − I‖_∞
//! ```
//!
//! in the order of their sizes. A single pair has its own residual. Pairs whose intervals meet are one cluster, with the root of the sum of the
//! squares of their residuals. Clusters are disjoint in the end: each holds at least as many eigenvalues as it has pairs.
//!
//! **Rounding.** `r = Ax − θMx` is computed with an error of at most `γ_m (|A||x| + |θ|M|x|)` in each component, m the entries in its row of A and a
//! few more (Higham 2002, 3.5); sums of n products of vectors with `γ_n` of the product of their lengths.

use super::{Eigenpair, Pencil};
use crate::assembly::SymmetricMatrix;
use crate::operator::LinearOperator;
use std::ops::Range;

/// `γ_k = k u/(1 − k u)`.
pub(crate) fn gamma(roundings: usize) -> f64 {
    let part = roundings as f64 * (f64::EPSILON / 2.0);
    part / (1.0 - part)
}

/// Distances from the values of ascending pairs, `xᵀMx = 1` to rounding, within which there are as many eigenvalues of the stored pencil as pairs.
/// Infinite where that cannot be shown.
pub(crate) fn enclosures(pencil: &Pencil<'_>, pairs: &[Eigenpair]) -> Vec<f64> {
    let squares = residuals(pencil, pairs);
    let mut cluster = Clusters { pencil, pairs, defects: vec![0.0; pairs.len()] };
    let mut found: Vec<(Range<usize>, f64)> = Vec::new();
    for (k, square) in squares.into_iter().enumerate() {
        let mut last = (k..k + 1, square);
        cluster.defects[k] = cluster.defect(k, k);
        while let Some((before, square)) = found.pop_if(|(before, square)| {
            let reach = cluster.radius(before, *square) + cluster.radius(&last.0, last.1);
            // An infinite radius meets everything.
            let is_apart = pairs[last.0.start].value - pairs[before.end - 1].value > reach;
            !is_apart
        }) {
            cluster.join(&before, &last.0);
            last = (before.start..last.0.end, square + last.1);
        }
        found.push(last);
    }
    found.iter().flat_map(|(range, square)| vec![cluster.radius(range, *square); range.len()]).collect()
}

struct Clusters<'a> {
    pencil: &'a Pencil<'a>,
    pairs: &'a [Eigenpair],
    /// `Σ_l |xᵀM x_l − δ|` over the vectors of the cluster of each.
    defects: Vec<f64>,
}

impl Clusters<'_> {
    /// `|x_kᵀM x_l − δ_kl|` with its rounding, for vectors no longer than 2.
    fn defect(&self, k: usize, l: usize) -> f64 {
        let [a, b] = [k, l].map(|k| &self.pairs[k].vector);
        let product: f64 = match self.pencil.masses {
            Some(masses) => a.iter().zip(b).zip(masses).map(|((a, b), mass)| a * b * mass).sum(),
            None => a.iter().zip(b).map(|(a, b)| a * b).sum(),
        };
        (product - f64::from(u8::from(k == l))).abs() + 4.0 * gamma(a.len() + 4)
    }

    fn join(&mut self, before: &Range<usize>, last: &Range<usize>) {
        for k in before.clone() {
            for l in last.clone() {
                let defect = self.defect(k, l);
                self.defects[k] += defect;
                self.defects[l] += defect;
            }
        }
    }

    fn radius(&self, range: &Range<usize>, square: f64) -> f64 {
        let larger = |largest: f64, d: &f64| if *d <= largest { largest } else { *d };
        let defect = self.defects[range.clone()].iter().fold(0.0, larger);
        // Sums, roots and quotients of positive numbers, rounded up.
        let up = 1.0 + gamma(4 * range.len() + 20);
        let radius = (square / (1.0 - defect * up)).sqrt() * up;
        if defect < 0.5 && radius.is_finite() { radius } else { f64::INFINITY }
    }
}

/// Bounds above `‖M^{-1/2}(Ax − θMx)‖²`.
fn residuals(pencil: &Pencil<'_>, pairs: &[Eigenpair]) -> Vec<f64> {
    let (a, n) = (pencil.a, pencil.a.order());
    let roundings = gamma(entries_in_a_row(a) + 8);
    let absolute = a.absolute();
    let (mut product, mut sizes) = (vec![0.0; n], vec![0.0; n]);
    let of = |pair: &Eigenpair| {
        a.apply(&pair.vector, &mut product);
        let lengths: Vec<f64> = pair.vector.iter().map(|x| x.abs()).collect();
        absolute.apply(&lengths, &mut sizes);
        let rows = product.iter().zip(&sizes).zip(&pair.vector).enumerate();
        let squares = rows.map(|(row, ((product, size), x))| {
            let mass = pencil.masses.map_or(1.0, |masses| masses[row]);
            let inertia = pair.value * (mass * x);
            let most = (product - inertia).abs() + roundings * (size + inertia.abs()) * (1.0 + roundings);
            (most.powi(2) + f64::MIN_POSITIVE) / mass
        });
        squares.sum::<f64>() * (1.0 + gamma(n + 20))
    };
    pairs.iter().map(of).collect()
}

fn entries_in_a_row(a: &SymmetricMatrix) -> usize {
    let mut counts = vec![0; a.order()];
    for (row, column, _) in a.iter() {
        counts[row] += 1;
        if row != column {
            counts[column] += 1;
        }
    }
    counts.into_iter().max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::fixtures::{banded, noise};
    use nalgebra::DMatrix;

    fn pairs(values: &[f64], vectors: &[Vec<f64>]) -> Vec<Eigenpair> {
        let pair =
            |(value, vector): (&f64, &Vec<f64>)| Eigenpair { value: *value, vector: vector.clone(), residual: 0.0 };
        values.iter().zip(vectors).map(pair).collect()
    }

    fn axis(n: usize, k: usize) -> Vec<f64> {
        (0..n).map(|row| f64::from(u8::from(row == k))).collect()
    }

    /// `diag(1, 1 + δ, 3)`: two values at 1 are one cluster, whose vectors must not be one and the same, nor one that leans on two others. By hand the
    /// residual of `(e_1 + t e_3)/‖·‖` is `2t/(1 + t²)`.
    #[test]
    fn clusters_hold_as_many_eigenvalues_as_pairs() {
        for diagonal in [[1.0 + 1e-14, 1.0, 3.0], [1.0, 1.0 + 1e-14, 3.0]] {
            let a = banded(1, 0, |row, column| if row == column { diagonal[row] } else { 0.0 });
            let pencil = Pencil::of(&a);
            let radii = enclosures(&pencil, &pairs(&[1.0, 1.0, 3.0], &[axis(3, 0), axis(3, 1), axis(3, 2)]));
            assert!(radii[0] == radii[1] && (1e-14..1e-13).contains(&radii[0]) && radii[2] < 1e-14, "{radii:?}");
        }
        let a = banded(1, 0, |row, column| if row == column { [1.0, 1.0 + 1e-14, 3.0][row] } else { 0.0 });
        let pencil = Pencil::of(&a);
        let twice = enclosures(&pencil, &pairs(&[1.0, 1.0], &[axis(3, 0), axis(3, 0)]));
        assert_eq!(twice, [f64::INFINITY; 2], "the same vector twice proves one eigenvalue");
        let lean = 0.91f64.sqrt();
        let leaning = [axis(3, 0), vec![0.3, lean, 0.0], vec![0.3, 0.0, lean]];
        let unit = banded(1, 0, |row, column| f64::from(u8::from(row == column)));
        let three = enclosures(&Pencil::of(&unit), &pairs(&[1.0; 3], &leaning));
        assert_eq!(three, [f64::INFINITY; 3], "two products of 0.3 are more than a half");
        let t = 1e-3f64;
        let tilted = vec![1.0 / t.hypot(1.0), 0.0, t / t.hypot(1.0)];
        let value = (1.0 + 3.0 * t * t) / (1.0 + t * t);
        let radius = enclosures(&pencil, &pairs(&[value], &[tilted]))[0];
        assert!((radius / (2.0 * t / (1.0 + t * t)) - 1.0).abs() < 1e-10, "{radius}");
        let short = enclosures(&pencil, &pairs(&[3.0], &[axis(3, 2).iter().map(|x| 0.5 * x).collect()]));
        assert_eq!(short, [f64::INFINITY], "not of unit length");
    }

    /// Pairs of random pencils of low rank from a dense decomposition, blurred by 0 to 1e-3: the k-th eigenvalue is never outside, and the radius is
    /// about the size of the cluster's residuals.
    #[test]
    fn enclosures_hold_the_eigenvalues_of_random_pencils() {
        for (seed, blur) in [(1, 0.0), (2, 1e-12), (3, 1e-6), (4, 1e-3)] {
            let entry = |row: usize, column: usize| noise(row + 50 * seed, column) + noise(column + 50 * seed, row);
            let a = banded(8, 7, entry);
            let n = a.order();
            let masses: Vec<f64> = (0..n).map(|k| 1.0 + (k % 5) as f64).collect();
            let pencil = Pencil { masses: Some(&masses), ..Pencil::of(&a) };
            let dense = DMatrix::from(&a.to_csc());
            let scaled =
                DMatrix::from_fn(n, n, |row, column| dense[(row, column)] / (masses[row] * masses[column]).sqrt());
            let eigen = scaled.symmetric_eigen();
            let mut order: Vec<usize> = (0..n).collect();
            order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
            let blurred = |k: usize| {
                let x = eigen.eigenvectors.column(k);
                let x = x.iter().enumerate().map(|(row, x)| (x + blur * noise(row, k + 7)) / masses[row].sqrt());
                super::super::eigenpair(&pencil, x.collect())
            };
            let mut found: Vec<Eigenpair> = order.iter().map(|&k| blurred(k)).collect();
            found.sort_by(|a, b| a.value.total_cmp(&b.value));
            let radii = enclosures(&pencil, &found);
            for (k, (pair, radius)) in found.iter().zip(&radii).enumerate() {
                let error = (eigen.eigenvalues[order[k]] - pair.value).abs();
                assert!(error <= *radius || !radius.is_finite(), "{blur:e}: {error:e} {radius:e}");
                let cluster = found.iter().zip(&radii).filter(|(_, other)| *other == radius);
                let residual = cluster.map(|(pair, _)| pair.residual.powi(2)).sum::<f64>().sqrt();
                assert!(*radius < 1.1 * residual + 1e-12 || blur > 1e-5, "{blur:e}: {radius:e} {:e}", pair.residual);
            }
        }
    }
}
