//! Sparse `A = L B Lᵀ` with pivoting, for counting the signs of eigenvalues.
//!
//! Inside each supernode's dense triangle faer pivots as Bunch and Kaufman (1977) do, so B has blocks of order 1 and 2;
//! between supernodes the order stays. That keeps the symbolic analysis valid and most of the rounding errors small, but
//! not all: [`PivotedLdlt::multiply`] gives `L B Lᵀ w`, with which the error `A − L B Lᵀ` is measured.

use super::factorization::{Analysis, Supernode, supernodes};
use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::error::Result;
use faer::dyn_stack::MemStack;
use faer::{Par, Side, Spec};

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

/// The pivoted factorization: analysed once, refactored for every matrix on the pattern.
pub struct PivotedLdlt {
    analysis: Analysis,
    subdiagonal: Vec<f64>,
    /// The row eliminated as number k, in the order of elimination before pivoting, and its inverse.
    forward: Vec<u32>,
    inverse: Vec<u32>,
}

impl PivotedLdlt {
    /// Orders and analyses a pattern.
    ///
    /// # Errors
    /// When the factor does not fit 32-bit indices or the memory.
    pub fn analyse(pattern: &BlockPattern, par: Par) -> Result<Self> {
        let n = pattern.order();
        let analysis = Analysis::new(pattern, par)?;
        Ok(Self { analysis, subdiagonal: vec![0.0; n], forward: vec![0; n], inverse: vec![0; n] })
    }

    /// Factors a matrix on the analysed pattern. Never fails: what went wrong shows in the pivots and in the error.
    pub fn factor(&mut self, a: &SymmetricMatrix) {
        let Self { analysis: Analysis { symbolic, values, memory, par, .. }, subdiagonal, forward, inverse } = self;
        let stack = MemStack::new(memory);
        let spec = Spec::default();
        symbolic.factorize_numeric_intranode_lblt(
            values,
            subdiagonal,
            forward,
            inverse,
            a.as_faer(),
            Side::Lower,
            *par,
            stack,
            spec,
        );
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

    /// `y = L B Lᵀ w` in the order of A; `scratch` has the length of w.
    pub fn multiply(&self, w: &[f64], y: &mut [f64], scratch: &mut [f64]) {
        y.fill(0.0);
        let order = self.analysis.forward();
        let row = |k: usize| order.map_or(k, |order| order[k] as usize);
        // Row k of a supernode's triangle after pivoting; rows below it are not pivoted.
        let top = |k: usize| row(self.forward[k] as usize);
        for s in supernodes(&self.analysis.symbolic) {
            for c in 0..s.columns {
                let column = self.column(s, c);
                let (triangle, below) = column.split_at(s.columns - c - 1);
                let rows = (s.first + c + 1..).zip(triangle);
                let above: f64 = rows.map(|(k, l)| l * w[top(k)]).sum();
                let under: f64 = s.below.iter().zip(below).map(|(&k, l)| l * w[row(k as usize)]).sum();
                scratch[s.first + c] = w[top(s.first + c)] + above + under;
            }
            self.for_each_block(s, |c, block| match block {
                Block::One(d) => scratch[c] *= d,
                Block::Two([a, b, d]) => {
                    let (p, q) = (scratch[c], scratch[c + 1]);
                    scratch[c] = a * p + b * q;
                    scratch[c + 1] = b * p + d * q;
                }
            });
            for c in 0..s.columns {
                let value = scratch[s.first + c];
                let column = self.column(s, c);
                let (triangle, below) = column.split_at(s.columns - c - 1);
                y[top(s.first + c)] += value;
                for (k, l) in (s.first + c + 1..).zip(triangle) {
                    y[top(k)] += l * value;
                }
                for (&k, l) in s.below.iter().zip(below) {
                    y[row(k as usize)] += l * value;
                }
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
            let (d, b) = (values[s.diagonal(c)], self.subdiagonal[s.first + c]);
            if b == 0.0 || c + 1 == s.columns {
                visit(s.first + c, Block::One(d));
                c += 1;
            } else {
                visit(s.first + c, Block::Two([d, b, values[s.diagonal(c + 1)]]));
                c += 2;
            }
        }
    }
}

/// A diagonal block of B: its value, or `[a, b, c]` for `[a b; b c]`.
enum Block {
    One(f64),
    Two([f64; 3]),
}
