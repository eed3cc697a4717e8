//! A rigorous bound on the rounding errors of a sparse factorization `L D Lᵀ` without pivoting.
//!
//! Elimination computes `l_ij d_j = a_ij − Σ_k l_ik d_k l_jk` by sums in some order, with or without fused operations. The computed L and D, as they
//! are stored, therefore satisfy (Higham, Accuracy and Stability of Numerical Algorithms, 2002, lemma 8.4 and theorem 10.3)
//!
//! ```text
//! A − L D Lᵀ = E,      |e_ij| ≤ γ_m Σ_k |l_ik| |d_k| |l_jk|,      γ_m = m u/(1 − m u),
//! ```
//!
//! with m the stored entries in row i of L and a few roundings of a term. For positive weights W the row sums of this bound give
//!
//! ```text
//! |xᵀ E x| ≤ ε xᵀ W x for every x,      ε = max_i γ_m (|L||D||Lᵀ| e)_i / w_i      (Collatz and Wielandt)
//! ```
//!
//! so that by Weyl's theorem no eigenvalue of the pencil (A, W) is farther than ε from its like of (L D Lᵀ, W), whose signs are those of D. Counting
//! pivots is then a proof about the stored matrix (Rump, BIT 46, 2006, for Cholesky factors). It takes two passes over L.

use super::factorization::{FactorKind, Factorization};
use super::substitution::columns;

/// u, the unit of rounding.
const U: f64 = f64::EPSILON / 2.0;

/// Pivots and entries of L up to this, and down to its inverse: an underflow is at most `2^−1074 · 2^600` in a row sum, all are below 1e-90.
const LARGEST: f64 = 1e120;

impl<K: FactorKind> Factorization<K> {
    /// ε for the last factored matrix, W the identity where there are no weights; infinite where the factor is not finite.
    pub(crate) fn rounding_bound(&self, weights: Option<&[f64]>) -> f64 {
        let n = self.analysis.symbolic.nrows();
        let (mut sums, mut terms, mut is_sound) = (vec![0.0; n], vec![0.0; n], true);
        for (s, c) in columns(&self.analysis.symbolic) {
            let (k, start) = (s.first + c, s.diagonal(c));
            let pivot = self.analysis.values[start].abs();
            let column = &self.analysis.values[start + 1..][..s.rows() - c - 1];
            let length = 1.0 + column.iter().map(|l| l.abs()).sum::<f64>();
            is_sound &= (1.0 / LARGEST..=LARGEST).contains(&pivot) && length <= LARGEST;
            sums[k] += pivot * length;
            for (row, l) in s.rows_below(c).zip(column) {
                sums[row] += l.abs() * (pivot * length);
                terms[row] += 1.0;
            }
        }
        // Sums of at most n terms, each of a product with a sum of at most n: computed below their value by this part at most.
        let of_sums = 1.0 + 4.0 * (n as f64 + 8.0) * U;
        let row = |k: usize| {
            // Beside the sum's, 8 roundings of a term: two products, the pivot's reciprocal and its product for each factor, the last division.
            let m = (terms[k] + 8.0) * U;
            let weight = weights.map_or(1.0, |weights| weights[self.analysis.row(k)]);
            (m / (1.0 - m) * sums[k] + 1e-90) * of_sums / weight
        };
        let largest = (0..n).map(row).fold(0.0, |largest, bound| if bound <= largest { largest } else { bound });
        if is_sound && largest.is_finite() { largest } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembly::SymmetricMatrix;
    use crate::linear::Ldlt;
    use crate::linear::fixtures::{banded, noise};
    use crate::operator::LinearOperator;
    use faer::Par;
    use nalgebra::DMatrix;

    fn factored(a: &SymmetricMatrix) -> Ldlt {
        let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
        factorization.factor(a).unwrap();
        factorization
    }

    /// `hi + lo += a b c` in twice the precision.
    fn add_product([hi, lo]: [f64; 2], [a, b, c]: [f64; 3]) -> [f64; 2] {
        let product = a * b;
        let rest = a.mul_add(b, -product);
        let (high, low) = (product * c, product.mul_add(c, -(product * c)) + rest * c);
        let sum = hi + high;
        let part = sum - hi;
        [sum, lo + low + ((hi - (sum - part)) + (high - part))]
    }

    /// `A − L D Lᵀ` in the order of elimination, in twice the precision.
    fn error(a: &SymmetricMatrix, factorization: &Ldlt) -> DMatrix<f64> {
        let (n, values) = (a.order(), &factorization.analysis.values);
        let (mut l, mut d) = (DMatrix::<f64>::identity(n, n), vec![0.0; n]);
        for (s, c) in columns(&factorization.analysis.symbolic) {
            d[s.first + c] = values[s.diagonal(c)];
            let column = s.rows_below(c).zip(&values[s.diagonal(c) + 1..]);
            column.for_each(|(row, value)| l[(row, s.first + c)] = *value);
        }
        let mut place = vec![0; n];
        (0..n).for_each(|k| place[factorization.analysis.row(k)] = k);
        let mut rest = vec![[0.0; 2]; n * n];
        for (row, column, value) in a.iter() {
            let (i, j) = (place[row], place[column]);
            rest[i * n + j] = [value, 0.0];
            rest[j * n + i] = [value, 0.0];
        }
        for i in 0..n {
            for j in 0..n {
                let term = |rest, k: usize| add_product(rest, [-l[(i, k)], d[k], l[(j, k)]]);
                rest[i * n + j] = (0..n).fold(rest[i * n + j], term);
            }
        }
        DMatrix::from_fn(n, n, |i, j| rest[i * n + j].iter().sum())
    }

    /// The bound holds for definite and indefinite matrices, graded ones and ones with tiny pivots, with weights and without; where pivots are of the
    /// size of the matrix it is less than a hundred times the error for thirty rows.
    #[test]
    fn bounds_are_above_the_error_in_twice_the_precision() {
        let graded = |row: usize| 10f64.powi(-(row as i32 % 7));
        type Entry = Box<dyn Fn(usize, usize) -> f64>;
        let matrices: [(&str, Entry); 4] = [
            ("definite", Box::new(|r, c| noise(r, c) + if r == c { 20.0 } else { 0.0 })),
            ("indefinite", Box::new(|r, c| noise(r, c) + if r == c { 20.0 - 40.0 * (r % 2) as f64 } else { 0.0 })),
            ("graded", Box::new(move |r, c| (noise(r, c) + if r == c { 20.0 } else { 0.0 }) * graded(r) * graded(c))),
            (
                "tiny pivots",
                Box::new(|r, c| if r == c && r % 3 == 0 { 1e-7 * (1.5 + noise(r, c)) } else { noise(r, c) }),
            ),
        ];
        for (name, entry) in &matrices {
            for (particles, width) in [(1, 0), (4, 2), (10, 9), (30, 3)] {
                let a = banded(particles, width, entry);
                let factorization = factored(&a);
                let error = error(&a, &factorization);
                let weights: Vec<f64> = (0..a.order()).map(|row| graded(row).powi(2)).collect();
                for weights in [None, Some(&weights[..])] {
                    let root = |k: usize| weights.map_or(1.0, |w| w[factorization.analysis.row(k)]).sqrt();
                    let n = a.order();
                    let scaled = DMatrix::from_fn(n, n, |i, j| error[(i, j)] / (root(i) * root(j)));
                    let norm = scaled.symmetric_eigenvalues().amax();
                    let bound = factorization.rounding_bound(weights);
                    assert!(norm <= bound && bound.is_finite(), "{name}, {particles}: {norm:e} {bound:e}");
                    let is_tight = bound < 100.0 * norm || *name != "definite" || n != 30 || weights.is_some();
                    assert!(is_tight, "{name}: {norm:e} {bound:e}");
                }
            }
        }
    }

    /// By hand: `[4 4; 4 4½]` has an entry of 1 in L and pivots of 4 and ½, so that `|L||D||Lᵀ|e` is (8, 8½), or backwards one of 8/9 and pivots of
    /// 4½ and 4/9, and (8½, 8). The row below has one entry of L more, which decides.
    #[test]
    fn the_bound_of_two_rows_by_hand() {
        let entry = |row: usize, column: usize| match (row.min(column), row.max(column)) {
            (0, 0) => 4.0,
            (0, 1) => 4.0,
            (1, 1) => 4.5,
            (2, 2) => 0.25,
            _ => 0.0,
        };
        let factorization = factored(&banded(1, 0, entry));
        let first = factorization.pivots().find(|(row, _)| *row < 2).unwrap().1;
        let [upper, lower] = if first == 4.0 { [8.0, 8.5] } else { [8.5, 8.0] };
        // One more entry where the third row lies between them in a supernode.
        let expected = |entries: f64| f64::max(8.0 * upper, (8.0 + entries) * lower) * U;
        let bound = factorization.rounding_bound(None);
        assert!([1.0, 2.0].iter().any(|&entries| (bound / expected(entries) - 1.0).abs() < 1e-12), "{bound:e}");
        let halved = factorization.rounding_bound(Some(&[2.0; 3]));
        assert!((2.0 * halved / bound - 1.0).abs() < 1e-12);
    }

    /// There is no bound where pivots vanish or overflow.
    #[test]
    fn nothing_is_bounded_without_a_factor() {
        let a = banded(2, 1, |_, _| 1.0);
        let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
        assert_eq!(factorization.rounding_bound(None), f64::INFINITY, "nothing is factored yet");
        for size in [0.0, 1e-130, 1e130, f64::NAN] {
            let a = banded(2, 1, |row, column| if row == column { size } else { 0.0 });
            let _ = factorization.factor(&a);
            assert_eq!(factorization.rounding_bound(None), f64::INFINITY, "{size}");
        }
    }
}
