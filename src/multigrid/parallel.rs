//! Rows shared out among threads. Every row is computed by one thread, always in the same way: results do not depend on how
//! many there are.

use super::sparse::Pattern;
use rayon::prelude::*;
use std::ops::Range;

/// Rows that are not worth a second thread.
const GRAIN: usize = 2048;

/// Calls `f(row, value)` for every entry of a vector.
pub(super) fn for_each_row<T: Send>(values: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    let rows = |(start, values): (usize, &mut [T])| (start..).zip(values).for_each(|(row, value)| f(row, value));
    if values.len() <= GRAIN {
        rows((0, values));
    } else {
        values.par_chunks_mut(GRAIN).enumerate().for_each(|(chunk, values)| rows((chunk * GRAIN, values)));
    }
}

/// Calls `f(start, chunk, chunk)` for chunks of a given length of two vectors.
pub(super) fn for_chunks<T: Send, U: Send>(
    first: &mut [T],
    second: &mut [U],
    length: usize,
    f: impl Fn(usize, &mut [T], &mut [U]) + Sync,
) {
    if first.len() <= length {
        f(0, first, second);
    } else {
        let chunks = first.par_chunks_mut(length).zip(second.par_chunks_mut(length)).enumerate();
        chunks.for_each(|(chunk, (first, second))| f(chunk * length, first, second));
    }
}

/// Calls `f(row, values of the row, value)` for every row of a sparse matrix and every entry of a vector beside it.
pub(super) fn for_each_sparse_row<T: Send, U: Send>(
    pattern: &Pattern,
    values: &mut [T],
    beside: &mut [U],
    f: &(impl Fn(usize, &mut [T], &mut U) + Sync),
) {
    split(pattern, 0..pattern.rows(), GRAIN, values, beside, f);
}

/// Calls `f(row, values of the row)` for some rows of a sparse matrix; `values` are those of these rows. At most `grain` rows
/// stay together.
pub(super) fn for_each_row_of<T: Send>(
    pattern: &Pattern,
    rows: Range<usize>,
    grain: usize,
    values: &mut [T],
    f: &(impl Fn(usize, &mut [T]) + Sync),
) {
    let mut beside = vec![(); rows.len()];
    split(pattern, rows, grain, values, &mut beside, &|row, values, ()| f(row, values));
}

fn split<T: Send, U: Send>(
    pattern: &Pattern,
    rows: Range<usize>,
    grain: usize,
    values: &mut [T],
    beside: &mut [U],
    f: &(impl Fn(usize, &mut [T], &mut U) + Sync),
) {
    if rows.len() <= grain {
        let mut rest = values;
        for (row, beside) in rows.zip(beside) {
            let (mine, others) = rest.split_at_mut(pattern.row(row).len());
            f(row, mine, beside);
            rest = others;
        }
    } else {
        let half = rows.len() / 2;
        let middle = rows.start + half;
        let (low, high) = values.split_at_mut(pattern.row(middle).start - pattern.row(rows.start).start);
        let (low_beside, high_beside) = beside.split_at_mut(half);
        rayon::join(
            || split(pattern, rows.start..middle, grain, low, low_beside, f),
            || split(pattern, middle..rows.end, grain, high, high_beside, f),
        );
    }
}
