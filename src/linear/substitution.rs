//! Supernodes, and forward and back substitution with a supernodal factor for one right-hand side b.
//!
//! ```text
//! forward, by supernodes:      w = (b_top, 0),   x_top = L_top⁻¹ w_top,   w_below −= L_below x_top,   b_top = x_top,   b_below += w_below
//! back, in reverse order:      w = (b_top, b_below),   b_top = L_top⁻ᵀ (w_top − L_belowᵀ w_below)
//! ```
//!
//! A solve reads all of L twice for two operations a number, so it takes the time of reading L. Four columns are read side by side (Ng and Peyton,
//! SIAM J. Sci. Comput. 14, 1993), acting on w, which is short, and memory is prefetched, as the processor's own prefetching starts anew in every
//! short column.
//!
//! Every sum is taken in one order, whatever the processor and the number of threads.

use crate::operator::prefetch;
use crate::registers::dispatch_simd;
use faer::sparse::linalg::cholesky::{SymbolicCholesky, SymbolicCholeskyRaw};

/// Columns that are read side by side.
const COLUMNS: usize = 4;

/// Numbers from the one in use to the one prefetched, as measured.
const AHEAD: usize = 4096;

/// A dense block of a supernodal factor L: a trapezoid whose first `columns` rows are a triangle.
#[derive(Clone, Copy)]
pub struct Supernode<'a> {
    /// Its first column in L.
    pub first: usize,
    pub columns: usize,
    /// The rows below the triangle, in the order of elimination.
    pub below: &'a [u32],
    /// The position of its first value; values are stored by columns.
    pub values: usize,
}

impl<'a> Supernode<'a> {
    pub fn rows(&self) -> usize {
        self.columns + self.below.len()
    }

    /// Position of the diagonal entry of a column among the factor's values; the column's entries below follow it.
    pub fn diagonal(&self, column: usize) -> usize {
        self.values + column * self.rows() + column
    }

    /// The rows below the diagonal entry of a column, in the order of elimination.
    pub fn rows_below(self, column: usize) -> impl Iterator<Item = usize> + 'a {
        (self.first + column + 1..self.first + self.columns).chain(self.below.iter().map(|&row| row as usize))
    }
}

/// The supernodes in the order of their columns.
pub fn supernodes(symbolic: &SymbolicCholesky<u32>) -> impl DoubleEndedIterator<Item = Supernode<'_>> + '_ {
    let supernodal = match symbolic.raw() {
        SymbolicCholeskyRaw::Supernodal(supernodal) => Some(supernodal),
        SymbolicCholeskyRaw::Simplicial(_) => None,
    };
    supernodal.into_iter().flat_map(|supernodal| {
        (0..supernodal.n_supernodes()).map(move |s| {
            let first = supernodal.supernode_begin()[s] as usize;
            let columns = supernodal.supernode_end()[s] as usize - first;
            let below = supernodal.supernode(s).pattern();
            Supernode { first, columns, below, values: supernodal.col_ptr_for_val()[s] as usize }
        })
    })
}

/// The columns of a factor: supernodes, and numbers within them.
pub fn columns(symbolic: &SymbolicCholesky<u32>) -> impl Iterator<Item = (Supernode<'_>, usize)> + '_ {
    supernodes(symbolic).flat_map(|s| (0..s.columns).map(move |c| (s, c)))
}

/// The stored diagonal of a factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Diagonal {
    /// That of L: `A = L Lᵀ`.
    Roots,
    /// D, where that of L is one: `A = L D Lᵀ`.
    Pivots,
}

/// The vectors of a solve, allocated once.
#[derive(Debug, Default)]
pub struct Substitution {
    /// b, in the order of elimination.
    pub ordered: Vec<f64>,
    /// w.
    pub block: Vec<f64>,
}

impl Substitution {
    pub fn bytes(symbolic: &SymbolicCholesky<u32>) -> u64 {
        8 * (symbolic.nrows() + longest(symbolic)) as u64
    }

    pub fn new(symbolic: &SymbolicCholesky<u32>) -> Self {
        Self { ordered: vec![0.0; symbolic.nrows()], block: vec![0.0; longest(symbolic)] }
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
        dispatch_simd(
            #[inline(always)]
            || pass.solve(ordered, block),
        );
        for (k, ordered) in ordered.iter().enumerate() {
            b[row(k)] = *ordered;
        }
    }
}

/// Rows of the longest supernode.
fn longest(symbolic: &SymbolicCholesky<u32>) -> usize {
    supernodes(symbolic).map(|s| s.rows()).max().unwrap_or(0)
}

#[derive(Clone, Copy)]
struct Pass<'a> {
    symbolic: &'a SymbolicCholesky<u32>,
    values: &'a [f64],
    diagonal: Diagonal,
}

impl Pass<'_> {
    /// `b ← A⁻¹ b` in the order of elimination; w has the rows of the longest supernode.
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

/// N columns of a supernode side by side, from the diagonal of the first one down.
#[derive(Clone, Copy)]
struct Columns<'v, const N: usize> {
    /// The N rows at the top of each column.
    top: [&'v [f64]; N],
    /// The rows below in fours, and the rest.
    fours: [&'v [[f64; 4]]; N],
    rest: [&'v [f64]; N],
    values: &'v [f64],
    /// The position of the first value.
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
            // These lengths let the compiler drop bounds checks.
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
                self.prefetch(row / 2, AHEAD);
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
        // Two sums of four a column hide the latency of additions.
        let mut sums = [[[0.0; 4]; 2]; N];
        for (pair, [first, second]) in pairs.iter().enumerate() {
            self.prefetch(pair, AHEAD.wrapping_neg());
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

    /// Prefetches `ahead` numbers from the start, a line for every column and eight rows: in all as much memory as the columns hold.
    #[inline(always)]
    fn prefetch(&self, eight: usize, ahead: usize) {
        for n in 0..N {
            if let Some(value) = self.values.get((self.start + (eight * N + n) * 8).wrapping_add(ahead)) {
                prefetch(value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembly::SymmetricMatrix;
    use crate::linear::fixtures::{banded, noise};
    use crate::linear::{Factorization, Ldl, Llt, SolvingKind, norm};
    use crate::operator::LinearOperator;
    use faer::Par;
    use std::collections::BTreeSet;

    /// Narrow and wide bands of more and more particles.
    fn matrices(diagonal: fn(usize) -> f64) -> impl Iterator<Item = SymmetricMatrix> {
        let sizes = [1, 2, 3, 4, 5, 7, 11, 16, 25, 60];
        sizes.into_iter().flat_map(|particles| [1, 2, 3, 5, 9].map(|width| (particles, width))).map(
            move |(particles, width)| {
                banded(particles, width, |row, column| {
                    noise(row, column) + if row == column { diagonal(row) } else { 0.0 }
                })
            },
        )
    }

    fn factored<K: SolvingKind>(a: &SymmetricMatrix) -> Factorization<K> {
        let mut factorization = Factorization::analyse(a.pattern(), Par::Seq).unwrap();
        assert!(factorization.run(a).is_ok());
        factorization
    }

    fn is_solved<K: SolvingKind>(a: &SymmetricMatrix) {
        let expected: Vec<f64> = (0..a.pattern().order()).map(|row| noise(row, 3)).collect();
        let mut x = expected.clone();
        a.apply(&expected, &mut x);
        factored::<K>(a).substitute(&mut x);
        let error: Vec<f64> = x.iter().zip(&expected).map(|(x, expected)| x - expected).collect();
        assert!(norm(&error) < 1e-13 * norm(&expected), "{} rows: {:e}", x.len(), norm(&error) / norm(&expected));
    }

    /// All remainders of columns and rows by four occur. The diagonal outweighs every row, so that only last digits are lost.
    #[test]
    fn solutions_are_those_of_the_matrix() {
        let (mut columns, mut rows) = (BTreeSet::new(), BTreeSet::new());
        for a in matrices(|_| 40.0) {
            is_solved::<Llt>(&a);
            for s in supernodes(&factored::<Llt>(&a).analysis.symbolic) {
                columns.insert(s.columns % COLUMNS);
                rows.insert(s.below.len() % 4);
            }
        }
        assert!(columns.len() == 4 && rows.len() == 4, "{columns:?} {rows:?}");
        for a in matrices(|row| if row % 3 == 1 { -40.0 } else { 40.0 }) {
            is_solved::<Ldl>(&a);
        }
    }
}
