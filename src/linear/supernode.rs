//! The dense blocks of which a supernodal factor is made.

use faer::sparse::linalg::cholesky::{SymbolicCholesky, SymbolicCholeskyRaw};

/// A dense block of L: a trapezoid whose first `columns` rows are a triangle.
#[derive(Clone, Copy)]
pub struct Supernode<'a> {
    /// Its first column in L.
    pub first: usize,
    pub columns: usize,
    /// The rows below the triangle, in the order of elimination.
    pub below: &'a [u32],
    /// Where its values start, by columns.
    pub values: usize,
}

impl Supernode<'_> {
    pub fn rows(&self) -> usize {
        self.columns + self.below.len()
    }

    /// Position of the diagonal entry of a column among the factor's values; the column's entries below follow it.
    pub fn diagonal(&self, column: usize) -> usize {
        self.values + column * self.rows() + column
    }
}

/// The blocks in the order of their columns.
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
