//! The product of one part, stretch by stretch. Rows get their first term just before springs add to them, while they are in the cache.

use super::Springs;
use super::batch4::{InARow, SpringBatch4};
use super::contiguous::Row;
use super::gathered::Run;
use super::part::{Part, Progress, Quads};
use crate::operator::lanes::Lanes;
use crate::operator::prefetch;
use std::ops::Range;

/// How many quads ahead of their use memory is asked for: about the delay of main memory. Measured, 64 is the best of
/// 16, 32, 64 and 128, and twice as fast as the processor's own prefetching alone.
const AHEAD: usize = 64;

/// `y = diagonal · w + B w` of a part, in N dimensions; `y` holds the rows of the part.
pub struct Product<'a, L, const N: usize> {
    pub lanes: L,
    pub part: &'a Part,
    pub springs: &'a Springs<'a>,
    pub diagonal: &'a [f64],
    pub w: &'a [f64],
    pub y: &'a mut [f64],
}

impl<L: Lanes, const N: usize> pulp::NullaryFnOnce for Product<'_, L, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { lanes, part, springs, diagonal, w, y } = self;
        let rows = part.rows.clone();
        let (own, diagonal) = (&w[rows.clone()], &diagonal[rows.clone()]);
        let mut begun = Progress::default();
        for reach in &part.stretches {
            begin(begun.rows..reach.rows, diagonal, own, y);
            let (quads, ahead) = part.contiguous.with_those_ahead(begun.contiguous..reach.contiguous, AHEAD);
            let mut row = Row::new(lanes, rows.start, springs.sign);
            for ((n, quad), ahead) in (begun.contiguous..).zip(quads).zip(ahead) {
                ask_for(ahead);
                row.add(quad, w, y);
                if quad.ends.by_matrix != 0 {
                    add_by_matrix(n, &part.contiguous, springs, w, rows.start, y);
                }
            }
            row.end(y);
            let (quads, ahead) = part.others.with_those_ahead(begun.others..reach.others, AHEAD);
            let mut run = Run::<L, N>::new(lanes, rows.start);
            for (quad, ahead) in quads.iter().zip(ahead) {
                ask_for(ahead);
                run.add_four(quad, springs, w, y);
            }
            run.end(y);
            begun = *reach;
        }
        begin(begun.rows..y.len(), diagonal, own, y);
    }
}

/// Asks for the memory of a quad.
#[inline(always)]
fn ask_for<E>(quad: &SpringBatch4<E>) {
    prefetch(&quad.g[0]);
    prefetch(&quad.g[2]);
    prefetch(&quad.ends);
}

/// The springs of a quad in a row that go through their matrix; y begins with the row `first`.
#[cold]
fn add_by_matrix(number: usize, quads: &Quads<InARow>, springs: &Springs, w: &[f64], first: usize, y: &mut [f64]) {
    let by_matrix = quads.quads[number].ends.by_matrix;
    for (n, position) in quads.positions(number).into_iter().enumerate() {
        if by_matrix & (1 << n) != 0 {
            springs.add_by_matrix(position, w, first, y);
        }
    }
}

/// Sets some rows to `diagonal · w`.
#[inline(always)]
fn begin(rows: Range<usize>, diagonal: &[f64], w: &[f64], y: &mut [f64]) {
    let terms = diagonal[rows.clone()].iter().zip(&w[rows.clone()]);
    for (y, (m, w)) in y[rows].iter_mut().zip(terms) {
        *y = m * w;
    }
}
