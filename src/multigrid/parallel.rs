//! Rows shared out among threads. Every row is computed by one thread, always in the same way: results do not depend on how
//! many there are.

use super::sparse::Pattern;
use rayon::prelude::*;
use std::ops::Range;

/// Rows that are not worth a second thread.
const GRAIN: usize = 2048;

/// Calls `f(row, value)` for every entry of a vector.
pub(super) fn for_each_row<T: Send>(values: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    for_chunks(values, GRAIN, |start, chunk| {
        for (row, value) in (start..).zip(chunk) {
            f(row, value);
        }
    });
}

/// Calls `f(start, chunk)` for chunks of a given length.
pub(super) fn for_chunks<T: Send>(values: &mut [T], length: usize, f: impl Fn(usize, &mut [T]) + Sync) {
    if values.len() <= length {
        f(0, values);
    } else {
        values.par_chunks_mut(length).enumerate().for_each(|(chunk, values)| f(chunk * length, values));
    }
}

/// Calls `f(row, values of the row)` for every row of a sparse matrix.
pub(super) fn for_each_sparse_row<T: Send>(pattern: &Pattern, values: &mut [T], f: &(impl Fn(usize, &mut [T]) + Sync)) {
    split(pattern, 0..pattern.rows(), values, f);
}

fn split<T: Send>(pattern: &Pattern, rows: Range<usize>, values: &mut [T], f: &(impl Fn(usize, &mut [T]) + Sync)) {
    let start = pattern.row(rows.start).start;
    if rows.len() <= GRAIN {
        let mut rest = values;
        for row in rows {
            let (mine, others) = rest.split_at_mut(pattern.row(row).len());
            f(row, mine);
            rest = others;
        }
    } else {
        let middle = rows.start + rows.len() / 2;
        let (low, high) = values.split_at_mut(pattern.row(middle).start - start);
        rayon::join(|| split(pattern, rows.start..middle, low, f), || split(pattern, middle..rows.end, high, f));
    }
}
