//! Forward and back substitution with a supernodal factor, for one right-hand side b.
//!
//! ```text
//! forward, block by block:      w = (b_top, 0),   x_top = L_top⁻¹ w_top,   w_below −= L_below x_top,   b_top = x_top,   b_below += w_below
//! back, in the reverse order:   w = (b_top, b_below),   b_top = L_top⁻ᵀ (w_top − L_belowᵀ w_below)
//! ```
//!
//! All of L is read twice for two operations a number: a solve takes what L takes to come from memory. So four columns of a block are read side by side,
//! from the diagonal down, and what they act on is w, which is short; memory is asked for ahead, as columns are short too and
//! the processor guesses anew at every one. (Blocks of columns in solves: Ng and Peyton, SIAM J. Sci. Comput. 14, 1993. The rest: own, and measured.)
//!
//! Every sum is taken in one order, whatever the processor and the number of threads.

use super::supernode::{Supernode, supernodes};
use crate::operator::prefetch;
use crate::registers::widely;
use faer::sparse::linalg::cholesky::SymbolicCholesky;

/// Columns that are read side by side.
const COLUMNS: usize = 4;

/// How many numbers ahead memory is asked for, and how many come at once.
const AHEAD: usize = 4096;
const LINE: usize = 8;

/// What a factor has on its diagonal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Diagonal {
    /// That of L: `A = L Lᵀ`.
    Roots,
    /// D, that of L being one: `A = L D Lᵀ`.
    Pivots,
}

/// The vectors of a solve, allocated once.
#[derive(Debug, Default)]
pub struct Substitution {
    /// b, in the order of elimination.
    ordered: Vec<f64>,
    /// w.
    block: Vec<f64>,
}

impl Substitution {
    /// Bytes that it takes.
    pub fn bytes(symbolic: &SymbolicCholesky<u32>) -> u64 {
        8 * (symbolic.nrows() + longest(symbolic)) as u64
    }

    pub fn new(symbolic: &SymbolicCholesky<u32>) -> Self {
        Self { ordered: vec![0.0; symbolic.nrows()], block: vec![0.0; longest(symbolic)] }
    }

    #[cfg(test)]
    pub fn held(&self) -> usize {
        size_of_val(&self.ordered[..]) + size_of_val(&self.block[..])
    }

    /// `b ← A⁻¹ b`.
    pub fn solve(&mut self, symbolic: &SymbolicCholesky<u32>, values: &[f64], diagonal: Diagonal, b: &mut [f64]) {
        let Self { ordered, block } = self;
        let forward = symbolic.perm().map(|perm| perm.arrays().0);
        let row = |k: usize| forward.map_or(k, |forward| forward[k] as usize);
        for (k, ordered) in ordered.iter_mut().enumerate() {
            *ordered = b[row(k)];
        }
        let pass = Pass { symbolic, values, diagonal };
        widely(
            #[inline(always)]
            || pass.solve(ordered, block),
        );
        for (k, ordered) in ordered.iter().enumerate() {
            b[row(k)] = *ordered;
        }
    }
}

/// Rows of the longest block.
fn longest(symbolic: &SymbolicCholesky<u32>) -> usize {
    supernodes(symbolic).map(|s| s.rows()).max().unwrap_or(0)
}

/// What a solve reads.
#[derive(Clone, Copy)]
struct Pass<'a> {
    symbolic: &'a SymbolicCholesky<u32>,
    values: &'a [f64],
    diagonal: Diagonal,
}

impl Pass<'_> {
    /// `b ← A⁻¹ b` in the order of elimination, with room for the longest block in w.
    #[inline(always)]
    fn solve(self, b: &mut [f64], w: &mut [f64]) {
        let Self { symbolic, values, diagonal } = self;
        for s in supernodes(symbolic) {
            let w = &mut w[..s.rows()];
            let (top, below) = w.split_at_mut(s.columns);
            top.copy_from_slice(&b[s.first..][..s.columns]);
            below.fill(0.0);
            for first in (0..s.columns).step_by(COLUMNS) {
                match s.columns - first {
                    1 => Columns::<1>::of(values, s, first).forward(diagonal, &mut w[first..]),
                    2 => Columns::<2>::of(values, s, first).forward(diagonal, &mut w[first..]),
                    3 => Columns::<3>::of(values, s, first).forward(diagonal, &mut w[first..]),
                    _ => Columns::<COLUMNS>::of(values, s, first).forward(diagonal, &mut w[first..]),
                }
            }
            let (top, below) = w.split_at(s.columns);
            b[s.first..][..s.columns].copy_from_slice(top);
            for (&row, w) in s.below.iter().zip(below) {
                b[row as usize] += w;
            }
        }
        for s in supernodes(symbolic).rev() {
            let w = &mut w[..s.rows()];
            let (top, below) = w.split_at_mut(s.columns);
            top.copy_from_slice(&b[s.first..][..s.columns]);
            for (&row, w) in s.below.iter().zip(below) {
                *w = b[row as usize];
            }
            for first in (0..s.columns).step_by(COLUMNS).rev() {
                match s.columns - first {
                    1 => Columns::<1>::of(values, s, first).back(diagonal, &mut w[first..]),
                    2 => Columns::<2>::of(values, s, first).back(diagonal, &mut w[first..]),
                    3 => Columns::<3>::of(values, s, first).back(diagonal, &mut w[first..]),
                    _ => Columns::<COLUMNS>::of(values, s, first).back(diagonal, &mut w[first..]),
                }
            }
            b[s.first..][..s.columns].copy_from_slice(&w[..s.columns]);
        }
    }
}

/// N columns of a block side by side, from the diagonal of the first one down.
#[derive(Clone, Copy)]
struct Columns<'v, const N: usize> {
    /// Of each column the N rows at the top.
    top: [&'v [f64]; N],
    /// The rows below, by fours, and those that are left.
    fours: [&'v [[f64; 4]]; N],
    rest: [&'v [f64]; N],
    values: &'v [f64],
    /// Where the first begins among the values.
    start: usize,
}

impl<'v, const N: usize> Columns<'v, N> {
    #[inline(always)]
    fn of(values: &'v [f64], s: Supernode<'_>, first: usize) -> Self {
        let (mut top, mut fours, mut rest) = ([values; N], [&[[0.0; 4]; 0][..]; N], [values; N]);
        let below = s.rows() - first - N;
        for n in 0..N {
            let column = &values[s.diagonal(first) + n * s.rows()..][..N + below];
            top[n] = &column[..N];
            let (by_fours, left) = column[N..].as_chunks();
            // The lengths once more, so that they need not be looked at in every row.
            (fours[n], rest[n]) = (&by_fours[..below / 4], &left[..below % 4]);
        }
        Self { top, fours, rest, values, start: s.diagonal(first) }
    }

    /// `x = L_top⁻¹ w_top`, `w_below −= L_below x`.
    #[inline(always)]
    fn forward(self, diagonal: Diagonal, w: &mut [f64]) {
        let Self { top: l, fours, rest, .. } = self;
        let (top, below) = w.split_at_mut(N);
        let mut x = [0.0; N];
        for n in 0..N {
            let mut sum = top[n];
            for m in 0..n {
                sum -= l[m][n] * x[m];
            }
            x[n] = if diagonal == Diagonal::Roots { sum / l[n][n] } else { sum };
        }
        top.copy_from_slice(&x);
        let (chunks, left) = below.as_chunks_mut::<4>();
        for row in 0..chunks.len() {
            if row % 2 == 0 {
                self.ask_for(row / 2, AHEAD);
            }
            let mut sum = chunks[row];
            for n in 0..N {
                for k in 0..4 {
                    sum[k] -= fours[n][row][k] * x[n];
                }
            }
            chunks[row] = sum;
        }
        for (row, w) in left.iter_mut().enumerate() {
            for n in 0..N {
                *w -= rest[n][row] * x[n];
            }
        }
    }

    /// `w_top = L_top⁻ᵀ (w_top − L_belowᵀ w_below)`, with pivots `L_top⁻ᵀ (D⁻¹ w_top − L_belowᵀ w_below)`.
    #[inline(always)]
    fn back(self, diagonal: Diagonal, w: &mut [f64]) {
        let Self { top: l, fours, rest, .. } = self;
        let (top, below) = w.split_at_mut(N);
        let (chunks, left) = below.as_chunks::<4>();
        let (pairs, odd) = chunks.as_chunks();
        // Two sums of four a column: one waits while the other is added to.
        let mut sums = [[[0.0; 4]; 2]; N];
        for (pair, [first, second]) in pairs.iter().enumerate() {
            self.ask_for(pair, AHEAD.wrapping_neg());
            for n in 0..N {
                for k in 0..4 {
                    sums[n][0][k] += fours[n][2 * pair][k] * first[k];
                    sums[n][1][k] += fours[n][2 * pair + 1][k] * second[k];
                }
            }
        }
        if let [last] = odd {
            for n in 0..N {
                for k in 0..4 {
                    sums[n][0][k] += fours[n][chunks.len() - 1][k] * last[k];
                }
            }
        }
        for n in (0..N).rev() {
            let [even, odd] = sums[n];
            let mut product = (even[0] + odd[0] + (even[1] + odd[1])) + (even[2] + odd[2] + (even[3] + odd[3]));
            for (l, w) in rest[n].iter().zip(left) {
                product += l * w;
            }
            for m in n + 1..N {
                product += l[n][m] * top[m];
            }
            top[n] = match diagonal {
                Diagonal::Roots => (top[n] - product) / l[n][n],
                Diagonal::Pivots => top[n] / l[n][n] - product,
            };
        }
    }

    /// While the eight rows with this number are read, asks for as many numbers of the memory that is `away` from the first column: after all rows
    /// as much has been asked for as the columns hold, in one piece.
    #[inline(always)]
    fn ask_for(&self, eight: usize, away: usize) {
        for n in 0..N {
            if let Some(value) = self.values.get((self.start + (eight * N + n) * LINE).wrapping_add(away)) {
                prefetch(value);
            }
        }
    }
}

#[cfg(test)]
mod tests;
