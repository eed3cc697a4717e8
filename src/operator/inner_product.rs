//! Inner products of vectors, parallel and the same to the bit for any number of threads.
//!
//! A vector is halved until a piece has at most [`PIECE`] numbers; where it is cut depends on its length alone. Sums over pieces are added up
//! pairwise, so a long inner product loses fewer digits than one sum from end to end.

use crate::registers::dispatch_simd;

/// Numbers in a piece: a few such vectors fit the first-level cache.
pub(crate) const PIECE: usize = 1024;

/// Vectors no longer than this stay on one thread.
pub(crate) const SERIAL: usize = 16_384;

/// Partial sums of a piece: as many as fill the widest vector registers twice.
const SUMS: usize = 16;

/// Both results, in parallel for long vectors.
pub(crate) fn both<A: Send, B: Send>(
    length: usize,
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    if length <= SERIAL { (a(), b()) } else { rayon::join(a, b) }
}

/// The cut, on a boundary of pieces.
pub(crate) fn middle(length: usize) -> usize {
    (length / 2).next_multiple_of(PIECE)
}

/// `aᵀb`.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    if a.len() <= PIECE {
        return dispatch_simd(
            #[inline(always)]
            || dot_piece(a, b),
        );
    }
    let ((a0, a1), (b0, b1)) = (a.split_at(middle(a.len())), b.split_at(middle(a.len())));
    let (first, second) = both(a.len(), || dot(a0, b0), || dot(a1, b1));
    first + second
}

#[inline(always)]
pub(crate) fn dot_piece(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; SUMS];
    let (a, a_rest) = a.as_chunks::<SUMS>();
    let (b, b_rest) = b.as_chunks::<SUMS>();
    for (a, b) in a.iter().zip(b) {
        for lane in 0..SUMS {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}
