//! Inner products of vectors, parallel and the same to the bit for any number of threads.
//!
//! A vector is halved until a piece has at most [`PIECE`] numbers; where it is cut depends on its length alone. Sums over
//! pieces are added up pairwise, so a long inner product loses fewer digits than one sum from end to end. Where both vectors pass by anyway,
//! pieces can be [summed](PieceSums) while they are in the cache, and [added up](total) in the end.

use crate::registers::widely;
use std::ops::Range;

/// Numbers in a piece: a few vectors of them fit the first-level cache.
pub(crate) const PIECE: usize = 1024;

/// Vectors no longer than this stay on one thread.
pub(crate) const SERIAL: usize = 16_384;

/// Partial sums of a piece: as many as fill the widest vector registers twice.
const LANES: usize = 16;

/// Both results; in parallel where that pays.
pub(crate) fn both<A: Send, B: Send>(
    length: usize,
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    if length <= SERIAL { (a(), b()) } else { rayon::join(a, b) }
}

/// Where to cut; on a boundary of pieces.
pub(crate) fn middle(length: usize) -> usize {
    (length / 2).next_multiple_of(PIECE)
}

/// `aᵀb`.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    if a.len() <= PIECE {
        return widely(
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
    let mut sums = [0.0; LANES];
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

/// How many pieces so many numbers have.
pub(crate) fn pieces(length: usize) -> usize {
    length.div_ceil(PIECE)
}

/// `aᵀb` of vectors of a length, from the sums over their pieces: what [`dot`] computes, to the bit.
pub(crate) fn total(length: usize, sums: &[f64]) -> f64 {
    if length <= PIECE {
        return sums.first().copied().unwrap_or(0.0);
    }
    let at = middle(length);
    let (first, second) = sums.split_at(at / PIECE);
    total(at, first) + total(length - at, second)
}

/// Sums over those pieces of two vectors that lie wholly within some rows, made one after the other.
#[derive(Debug)]
pub(crate) struct PieceSums<'a> {
    /// Where the next piece begins.
    next: usize,
    sums: std::slice::IterMut<'a, f64>,
}

impl<'a> PieceSums<'a> {
    /// For rows from a first one on, and room for as many sums as are wanted.
    pub fn from(first_row: usize, sums: &'a mut [f64]) -> Self {
        Self { next: pieces(first_row) * PIECE, sums: sums.iter_mut() }
    }

    /// Sums up the pieces that end in these rows, of which `a` and `b` have nothing but.
    #[inline(always)]
    pub fn sum_up(&mut self, rows: Range<usize>, a: &[f64], b: &[f64]) {
        while self.next + PIECE <= rows.end
            && let Some(sum) = self.sums.next()
        {
            let piece = self.next - rows.start..self.next + PIECE - rows.start;
            *sum = dot_piece(&a[piece.clone()], &b[piece]);
            self.next += PIECE;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{PIECE, PieceSums, SERIAL, dot, pieces, total};

    fn vector(length: usize, seed: f64) -> Vec<f64> {
        (0..length).map(|i| ((i as f64 + 0.5) * seed).sin()).collect()
    }

    /// On lengths around every boundary, against the plain loop and its rounding bound.
    #[test]
    fn inner_products_agree_with_a_plain_loop() {
        for length in [0, 1, 15, 16, 17, PIECE - 1, PIECE, PIECE + 1, 3 * PIECE + 5, SERIAL, SERIAL + 1, 5 * SERIAL + 7]
        {
            let (a, b) = (vector(length, 0.7), vector(length, 1.3));
            let magnitude: f64 = a.iter().zip(&b).map(|(a, b)| (a * b).abs()).sum();
            let plain: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
            assert!((dot(&a, &b) - plain).abs() <= length as f64 * f64::EPSILON * magnitude);
        }
    }

    /// Of rows that begin anywhere those pieces are summed that lie within, as soon as they have come by; with the others they make the same bits.
    #[test]
    fn sums_over_pieces_make_the_same_inner_product() {
        for length in [0, 5, PIECE, PIECE + 1, 2 * PIECE + 1, 3 * PIECE - 1, 7 * PIECE + 5, SERIAL + 1, 3 * SERIAL + 7]
        {
            let (a, b) = (vector(length, 0.7), vector(length, 1.3));
            let each = |n: usize| n * PIECE..((n + 1) * PIECE).min(length);
            let all: Vec<f64> = (0..pieces(length)).map(|n| dot(&a[each(n)], &b[each(n)])).collect();
            assert_eq!(total(length, &all), dot(&a, &b), "{length}");
            for start in [0, 1, PIECE - 1, PIECE, PIECE + 1].into_iter().filter(|&start| start < length) {
                let mut sums = vec![f64::NAN; pieces(length) - pieces(start)];
                let mut of_rows = PieceSums::from(start, &mut sums);
                for end in (start..=length).step_by(100).chain([length]) {
                    of_rows.sum_up(start..end, &a[start..end], &b[start..end]);
                }
                let whole = (length / PIECE).saturating_sub(pieces(start));
                assert_eq!(sums[..whole], all[pieces(start)..][..whole], "{start} {length}");
                assert!(sums[whole..].iter().all(|sum| sum.is_nan()), "{start} {length}");
                // Without room for any.
                PieceSums::from(start, &mut []).sum_up(start..length, &a[start..], &b[start..]);
            }
        }
    }
}
