//! Sparse `A = L B Lᵀ` for counting the signs of eigenvalues, with or without pivoting.
//!
//! Without pivoting B is diagonal. With it, faer pivots inside each supernode's dense triangle as Bunch and Kaufman (1977) do, so
//! B has blocks of order 1 and 2; between supernodes the order stays. That keeps the symbolic analysis valid and most of the
//! rounding errors small, but not all: [`PivotedLdlt::multiply`] gives `L B Lᵀ W`, with which the error `A − L B Lᵀ` is measured.

use super::analysis::Analysis;
use super::factorization::{Factorization, kind};
use super::supernode::{Supernode, supernodes};
use crate::assembly::SymmetricMatrix;
use faer::dyn_stack::MemStack;
use faer::{Side, Spec};

/// How many eigenvalues of B, and so of A, have each sign.
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

/// How pivots are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pivoting {
    /// In the order of elimination: fast, and accurate for a definite matrix.
    None,
    /// The best inside each supernode.
    InSupernodes,
}

/// `A = L B Lᵀ`, pivots chosen as [`Pivoting`] says: for counting signs, not for solving.
pub struct BunchKaufman {
    pivoting: Pivoting,
    subdiagonal: Vec<f64>,
    /// The row eliminated as number k, in the order of elimination before pivoting, and its inverse.
    forward: Vec<u32>,
    inverse: Vec<u32>,
}

/// The factorization with pivots chosen as asked: analysed once, refactored for every matrix on the pattern.
pub type PivotedLdlt = Factorization<BunchKaufman>;

impl kind::Numeric for BunchKaufman {
    fn of_order(n: usize) -> Self {
        Self { pivoting: Pivoting::None, subdiagonal: vec![0.0; n], forward: vec![0; n], inverse: vec![0; n] }
    }

    /// Never fails: what went wrong shows in the pivots and in the error.
    fn factor(&mut self, analysis: &mut Analysis, a: &SymmetricMatrix) -> Result<(), usize> {
        let Analysis { symbolic, values, memory, par, .. } = analysis;
        let Self { pivoting, subdiagonal, forward, inverse } = self;
        let (a, stack) = (a.as_faer(), MemStack::new(memory));
        // faer does not write where it finds nothing to eliminate: a block of the last matrix would stay.
        subdiagonal.fill(0.0);
        match pivoting {
            Pivoting::None => {
                forward.iter_mut().zip(0..).for_each(|(k, same)| *k = same);
                let plain = Default::default();
                let done = symbolic.factorize_numeric_ldlt(values, a, Side::Lower, plain, *par, stack, Spec::default());
                if done.is_err() {
                    // A pivot that vanished: the values are half done, and must not look like a factorization.
                    values.fill(f64::NAN);
                }
            }
            Pivoting::InSupernodes => {
                symbolic.factorize_numeric_intranode_lblt(
                    values,
                    subdiagonal,
                    forward,
                    inverse,
                    a,
                    Side::Lower,
                    *par,
                    stack,
                    Spec::default(),
                );
            }
        }
        Ok(())
    }
}

impl Factorization<BunchKaufman> {
    /// Factors a matrix on the analysed pattern. Never fails: what went wrong shows in the pivots and in the error.
    pub fn factor(&mut self, a: &SymmetricMatrix, pivoting: Pivoting) {
        self.kind.pivoting = pivoting;
        // Of this kind it is always well.
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
        let order = self.analysis.forward();
        let row = |k: usize| order.map_or(k, |order| order[k] as usize);
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

    /// Column c of L below its unit diagonal. Inside a block of order 2 the entry beside the diagonal is B's, not L's, and
    /// faer stores it apart: L has a zero there.
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
mod tests;
