//! Sparse `A = L B Lᵀ` for counting the signs of eigenvalues, with or without pivoting.
//!
//! Without pivoting B is diagonal. With it, faer pivots inside each supernode's dense triangle as Bunch and Kaufman (1977) do, so B has blocks of
//! order 1 and 2; the order of the supernodes stays. That keeps the symbolic analysis valid and most, but not all, rounding errors small:
//! [`PivotedLdlt::multiply`] computes `L B Lᵀ W`, with which the error `A − L B Lᵀ` is measured.

use super::analysis::Analysis;
use super::factorization::{FactorKind, Factorization, Ldl};
use super::substitution::{Supernode, supernodes};
use crate::assembly::SymmetricMatrix;
use faer::dyn_stack::MemStack;
use faer::{Side, Spec};

/// The numbers of eigenvalues of B, and so of A, by sign.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PivotSigns {
    /// Below zero.
    pub negative: usize,
    /// Exactly zero, or not a number.
    pub zero: usize,
    /// Above zero.
    pub positive: usize,
}

impl PivotSigns {
    /// Counts a block of order 1.
    pub fn count(&mut self, pivot: f64) {
        if pivot > 0.0 {
            self.positive += 1;
        } else if pivot < 0.0 {
            self.negative += 1;
        } else {
            self.zero += 1;
        }
    }

    /// Counts the eigenvalues of `[a b; b c]`, whose product is `ac − b²` and whose sum is `a + c`.
    pub fn count_pair(&mut self, a: f64, b: f64, c: f64) {
        // Divided by b², so that it neither over- nor underflows.
        let determinant = (a / b) * (c / b) - 1.0;
        if determinant < 0.0 {
            self.negative += 1;
            self.positive += 1;
        } else {
            self.count(a + c);
            self.count(determinant * (a + c));
        }
    }
}

/// The choice of pivots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pivoting {
    /// In the order of elimination: fast, and accurate for a definite matrix.
    None,
    /// The best inside each supernode.
    InSupernodes,
}

/// `A = L B Lᵀ` with [`Pivoting`], for counting signs, not for solving.
pub struct BunchKaufman {
    pivoting: Pivoting,
    subdiagonal: Vec<f64>,
    /// The pivoting permutation, within the order of elimination, and its inverse.
    forward: Vec<u32>,
    inverse: Vec<u32>,
}

/// The factorization with pivoting: analysed once, refactored for every matrix on the pattern.
pub type PivotedLdlt = Factorization<BunchKaufman>;

impl FactorKind for BunchKaufman {
    fn of_order(n: usize) -> Self {
        Self { pivoting: Pivoting::None, subdiagonal: vec![0.0; n], forward: vec![0; n], inverse: vec![0; n] }
    }

    fn factor(&mut self, analysis: &mut Analysis, a: &SymmetricMatrix) -> Result<(), usize> {
        let Self { pivoting, subdiagonal, forward, inverse } = self;
        // faer does not write where there is nothing to eliminate.
        subdiagonal.fill(0.0);
        match pivoting {
            Pivoting::None => {
                forward.iter_mut().zip(0..).for_each(|(k, same)| *k = same);
                if Ldl.factor(analysis, a).is_err() {
                    // A pivot vanished, and the factor is incomplete.
                    analysis.values.fill(f64::NAN);
                }
            }
            Pivoting::InSupernodes => {
                let Analysis { symbolic, values, memory, par, .. } = analysis;
                symbolic.factorize_numeric_intranode_lblt(
                    values,
                    subdiagonal,
                    forward,
                    inverse,
                    a.as_faer(),
                    Side::Lower,
                    *par,
                    MemStack::new(memory),
                    Spec::default(),
                );
            }
        }
        Ok(())
    }
}

impl Factorization<BunchKaufman> {
    /// Factors a matrix on the analysed pattern. Never fails: failures show in the pivots and in the error.
    pub fn factor(&mut self, a: &SymmetricMatrix, pivoting: Pivoting) {
        self.kind.pivoting = pivoting;
        self.run(a).unwrap_or_default();
    }

    /// The signs of the eigenvalues of B: by Sylvester's law those of `L B Lᵀ`.
    pub fn signs(&self) -> PivotSigns {
        let mut signs = PivotSigns::default();
        for s in supernodes(&self.analysis.symbolic) {
            self.for_each_block(s, |_, block| match block {
                Block::One(d) => signs.count(d),
                Block::Two([a, b, c]) => signs.count_pair(a, b, c),
            });
        }
        signs
    }

    /// `Y = L B Lᵀ W` in the order of A, for matrices of K columns stored by rows: the factor is read once for all of them.
    pub fn multiply<const K: usize>(&self, w: &[[f64; K]], y: &mut [[f64; K]]) {
        y.fill([0.0; K]);
        let row = |k: usize| self.analysis.row(k);
        // Row k of a supernode's triangle after pivoting; rows below it are not pivoted.
        let top = |k: usize| row(self.kind.forward[k] as usize);
        let mut z = Vec::new();
        let mut gathered = Vec::new();
        for s in supernodes(&self.analysis.symbolic) {
            gathered.clear();
            gathered.extend((s.first..s.first + s.columns).map(|k| w[top(k)]));
            gathered.extend(s.below.iter().map(|&k| w[row(k as usize)]));
            z.clear();
            for c in 0..s.columns {
                let mut sum = gathered[c];
                for (l, w) in self.column(s, c).iter().zip(&gathered[c + 1..]) {
                    add(&mut sum, *l, w);
                }
                z.push(sum);
            }
            self.for_each_block(s, |k, block| {
                let c = k - s.first;
                match block {
                    Block::One(d) => z[c].iter_mut().for_each(|z| *z *= d),
                    Block::Two([a, b, d]) => {
                        let (p, q) = (z[c], z[c + 1]);
                        z[c] = std::array::from_fn(|k| a * p[k] + b * q[k]);
                        z[c + 1] = std::array::from_fn(|k| b * p[k] + d * q[k]);
                    }
                }
            });
            gathered.fill([0.0; K]);
            for (c, z) in z.iter().enumerate() {
                add(&mut gathered[c], 1.0, z);
                for (l, y) in self.column(s, c).iter().zip(&mut gathered[c + 1..]) {
                    add(y, *l, z);
                }
            }
            let (triangle, below) = gathered.split_at(s.columns);
            for (k, part) in (s.first..).zip(triangle) {
                add(&mut y[top(k)], 1.0, part);
            }
            for (&k, part) in s.below.iter().zip(below) {
                add(&mut y[row(k as usize)], 1.0, part);
            }
        }
    }

    /// Column c of L below its unit diagonal: zero inside a block of order 2, whose entry beside the diagonal faer stores apart.
    fn column(&self, s: Supernode, c: usize) -> &[f64] {
        &self.analysis.values[s.diagonal(c) + 1..s.values + (c + 1) * s.rows()]
    }

    /// Calls `visit` with the first column and the values of every block of B in a supernode.
    fn for_each_block(&self, s: Supernode, mut visit: impl FnMut(usize, Block)) {
        let values = &self.analysis.values;
        let mut c = 0;
        while c < s.columns {
            let (d, b) = (values[s.diagonal(c)], self.kind.subdiagonal[s.first + c]);
            if b == 0.0 {
                visit(s.first + c, Block::One(d));
                c += 1;
            } else {
                visit(s.first + c, Block::Two([d, b, values[s.diagonal(c + 1)]]));
                c += 2;
            }
        }
    }
}

/// `y += l x`.
#[inline]
fn add<const K: usize>(y: &mut [f64; K], l: f64, x: &[f64; K]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += l * x;
    }
}

/// A diagonal block of B: its value, or `[a, b, c]` for `[a b; b c]`.
enum Block {
    One(f64),
    Two([f64; 3]),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::fixtures::{banded, noise};
    use crate::operator::LinearOperator;
    use faer::Par;

    fn factored(a: &SymmetricMatrix, pivoting: Pivoting) -> PivotedLdlt {
        let mut factorization = PivotedLdlt::analyse(a.pattern(), Par::Seq).unwrap();
        factorization.factor(a, pivoting);
        factorization
    }

    fn blocks_of_two(factorization: &PivotedLdlt) -> usize {
        let mut blocks = 0;
        for s in supernodes(&factorization.analysis.symbolic) {
            factorization.for_each_block(s, |_, block| blocks += usize::from(matches!(block, Block::Two(_))));
        }
        blocks
    }

    /// The largest `|A W − L B Lᵀ W|` for two columns W of numbers up to one.
    fn error(a: &SymmetricMatrix, factorization: &PivotedLdlt) -> f64 {
        let w: Vec<[f64; 2]> = (0..a.order()).map(|row| [noise(row, 1), noise(2, row)]).collect();
        let mut y = vec![[f64::NAN; 2]; w.len()];
        factorization.multiply(&w, &mut y);
        let mut error = 0.0;
        for column in 0..2 {
            let mut exact = vec![0.0; w.len()];
            a.apply(&w.iter().map(|w| w[column]).collect::<Vec<_>>(), &mut exact);
            assert!(y.iter().all(|y| y[column].is_finite()));
            error = exact.iter().zip(&y).fold(error, |error, (exact, y)| f64::max(error, (exact - y[column]).abs()));
        }
        error
    }

    /// Zero, and what is not a number, has no sign.
    #[test]
    fn pivots_are_counted_by_sign() {
        let mut signs = PivotSigns::default();
        [0.0, -0.0, f64::NAN, 3.0, f64::INFINITY, -1e-300].iter().for_each(|&pivot| signs.count(pivot));
        assert_eq!(signs, PivotSigns { negative: 1, zero: 3, positive: 2 });
    }

    /// Eigenvalues by hand: `[2 1; 1 3]` has determinant 5 and trace 5, `[-2 1; 1 -3]` the opposite eigenvalues, `[1 1; 1 1]` has 0 and 2,
    /// `[0 1; 1 0]` has ±1, `[1 2; 2 3]` has determinant −1. What counts is the ratio of the entries, even where their products or sums overflow.
    #[test]
    fn pairs_are_counted_by_the_signs_of_their_eigenvalues() {
        for ([a, b, c], [negative, zero, positive]) in [
            ([2.0, 1.0, 3.0], [0, 0, 2]),
            ([-2.0, 1.0, -3.0], [2, 0, 0]),
            ([1.0, 1.0, 1.0], [0, 1, 1]),
            ([-1.0, 1.0, -1.0], [1, 1, 0]),
            ([0.0, 1.0, 0.0], [1, 0, 1]),
            ([1.0, 2.0, 3.0], [1, 0, 1]),
            ([1.5e308, 1e308, 1.5e308], [0, 0, 2]),
            ([3e-300, 2e-300, -3e-300], [1, 0, 1]),
        ] {
            let mut signs = PivotSigns::default();
            signs.count_pair(a, b, c);
            assert_eq!(signs, PivotSigns { negative, zero, positive }, "[{a} {b}; {b} {c}]");
        }
    }

    /// `[0 B; Bᵀ 0]` with an invertible B has as many positive eigenvalues as negative ones; no pivot on its diagonal is of use.
    #[test]
    fn a_zero_diagonal_takes_blocks_of_order_two() {
        let b = [[2.0, 1.0, 0.5], [0.25, 3.0, 1.0], [1.0, 0.5, 4.0]];
        let a = banded(
            2,
            1,
            |row, column| if row / 3 == column / 3 { 0.0 } else { b[row.min(column)][row.max(column) - 3] },
        );
        let factorization = factored(&a, Pivoting::InSupernodes);
        assert_eq!(factorization.signs(), PivotSigns { negative: 3, zero: 0, positive: 3 });
        assert_eq!(blocks_of_two(&factorization), 3);
        assert!(error(&a, &factorization) < 1e-14);
    }

    /// `L B Lᵀ` is A to rounding: of a definite matrix without pivoting, and of an indefinite one, with a small diagonal, with it. Many supernodes
    /// with rows below them, and one alone.
    #[test]
    fn products_of_the_factors_are_those_of_the_matrix() {
        for (particles, reach) in [(1, 0), (4, 3), (60, 2)] {
            let a = banded(particles, reach, |row, column| noise(row, column) + if row == column { 20.0 } else { 0.0 });
            let factorization = factored(&a, Pivoting::None);
            assert_eq!(supernodes(&factorization.analysis.symbolic).count() > 1, particles > 4);
            assert!(error(&a, &factorization) < 1e-13);
            assert_eq!(factorization.signs(), PivotSigns { negative: 0, zero: 0, positive: 3 * particles });
            let a = banded(particles, reach, |row, column| noise(row, column) * if row == column { 0.1 } else { 1.0 });
            let factorization = factored(&a, Pivoting::InSupernodes);
            assert!(blocks_of_two(&factorization) > 0);
            assert!(error(&a, &factorization) < 1e-11, "{}", error(&a, &factorization));
            let PivotSigns { negative, zero, positive } = factorization.signs();
            assert_eq!([zero, negative + positive], [0, 3 * particles]);
        }
    }

    /// A factorization knows nothing of the one before: blocks of order 2 do not stay where the next matrix has none.
    #[test]
    fn a_matrix_is_factored_whatever_came_before() {
        let coupled = banded(2, 1, |row, column| if row == column { 0.0 } else { 1.0 });
        let diagonal = banded(2, 1, |row, column| if row == column { 2.0 - row as f64 % 2.0 * 5.0 } else { 0.0 });
        let mut factorization = factored(&coupled, Pivoting::InSupernodes);
        assert!(blocks_of_two(&factorization) > 0);
        factorization.factor(&diagonal, Pivoting::InSupernodes);
        assert_eq!(factorization.signs(), PivotSigns { negative: 3, zero: 0, positive: 3 });
        assert_eq!(error(&diagonal, &factorization), 0.0);
    }
}
