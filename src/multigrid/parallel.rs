//! Rows distributed among threads. Every row is computed by one thread, in the same way for any number of them. Loops over rows are compiled for the
//! [widest registers](dispatch_simd).

use super::sparse::Pattern;
use crate::parallel::{parts, share};
use crate::registers::dispatch_simd;
use rayon::prelude::*;
use std::ops::Range;

/// Least rows for a thread: some microseconds of work.
pub(super) const GRAIN: usize = 512;

pub(super) fn for_each_row<T: Send>(values: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    for_each_row_of(0..values.len(), GRAIN, OneEach(values), f);
}

/// Calls `f(start, chunk, chunk, workspace)` for chunks of two vectors; every thread has consecutive ones and a clone of the first workspace.
pub(super) fn for_chunks<T: Send, U: Send, R: Clone + Send>(
    first: &mut [T],
    second: &mut [U],
    length: usize,
    workspaces: &mut Vec<R>,
    f: impl Fn(usize, &mut [T], &mut [U], &mut R) + Sync,
) {
    let each = length * first.len().div_ceil(length).div_ceil(rayon::current_num_threads()).max(1);
    while workspaces.len() < first.len().div_ceil(each)
        && let Some(workspace) = workspaces.first().cloned()
    {
        workspaces.push(workspace);
    }
    let of_thread = |start: usize, first: &mut [T], second: &mut [U], workspace: &mut R| {
        let pairs = first.chunks_mut(length).zip(second.chunks_mut(length));
        for (start, (first, second)) in (start..).step_by(length).zip(pairs) {
            dispatch_simd(
                #[inline(always)]
                || f(start, first, second, workspace),
            );
        }
    };
    if let [workspace, ..] = &mut workspaces[..]
        && first.len() <= each
    {
        of_thread(0, first, second, workspace);
    } else {
        let pairs = first.par_chunks_mut(each).zip(second.par_chunks_mut(each));
        let of_threads = pairs.zip(workspaces.par_iter_mut()).enumerate();
        of_threads.for_each(|(at, ((first, second), workspace))| of_thread(at * each, first, second, workspace));
    }
}

/// The position of the first value of a row; for the row after the last, the number of values.
pub(super) trait Starts: Sync {
    fn start(&self, row: usize) -> usize;
}

impl Starts for Pattern {
    #[inline(always)]
    fn start(&self, row: usize) -> usize {
        self.row(row).start
    }
}

/// Row by row the values of one pattern, then those of another.
impl Starts for [&Pattern; 2] {
    #[inline(always)]
    fn start(&self, row: usize) -> usize {
        self[0].start(row) + self[1].start(row)
    }
}

/// Data of successive rows, to be distributed among threads.
pub(super) trait OfRows: Sized + Send {
    type Row;

    /// Splits into the data of the rows from `start` to `middle`, and the rest.
    fn split(self, start: usize, middle: usize) -> (Self, Self);

    /// Splits off the data of the first row, whose number is given.
    fn split_off(&mut self, row: usize) -> Option<Self::Row>;
}

#[derive(Debug)]
pub(super) struct OneEach<'v, T>(pub &'v mut [T]);

impl<'v, T: Send> OfRows for OneEach<'v, T> {
    type Row = &'v mut T;

    fn split(self, start: usize, middle: usize) -> (Self, Self) {
        let (first, others) = self.0.split_at_mut(middle - start);
        (Self(first), Self(others))
    }

    #[inline(always)]
    fn split_off(&mut self, _: usize) -> Option<Self::Row> {
        self.0.split_off_first_mut()
    }
}

#[derive(Debug)]
pub(super) struct Values<'v, P, T>(pub &'v P, pub &'v mut [T]);

impl<'v, P: Starts, T: Send> OfRows for Values<'v, P, T> {
    type Row = &'v mut [T];

    fn split(self, start: usize, middle: usize) -> (Self, Self) {
        let Self(pattern, values) = self;
        let (first, others) = values.split_at_mut(pattern.start(middle) - pattern.start(start));
        (Self(pattern, first), Self(pattern, others))
    }

    #[inline(always)]
    fn split_off(&mut self, row: usize) -> Option<Self::Row> {
        let count = self.0.start(row + 1) - self.0.start(row);
        self.1.split_off_mut(..count)
    }
}

impl<A: OfRows, B: OfRows> OfRows for (A, B) {
    type Row = (A::Row, B::Row);

    fn split(self, start: usize, middle: usize) -> (Self, Self) {
        let ((a, other_a), (b, other_b)) = (self.0.split(start, middle), self.1.split(start, middle));
        ((a, b), (other_a, other_b))
    }

    #[inline(always)]
    fn split_off(&mut self, row: usize) -> Option<Self::Row> {
        Some((self.0.split_off(row)?, self.1.split_off(row)?))
    }
}

/// Calls `f(row, data)` for some rows, at least `grain` a thread.
pub(super) fn for_each_row_of<R: OfRows>(
    rows: Range<usize>,
    grain: usize,
    of_rows: R,
    f: impl Fn(usize, R::Row) + Sync,
) {
    let parts = parts(rows.len(), grain);
    split(rows, parts, of_rows, &|rows: Range<usize>, mut of_rows: R| {
        dispatch_simd(
            #[inline(always)]
            || {
                for row in rows.clone() {
                    let Some(of_row) = of_rows.split_off(row) else { return };
                    f(row, of_row);
                }
            },
        );
    });
}

/// Calls `work(rows, data)` for so many parts of some rows.
fn split<R: OfRows>(rows: Range<usize>, parts: usize, of_rows: R, work: &(impl Fn(Range<usize>, R) + Sync)) {
    if parts <= 1 {
        return work(rows, of_rows);
    }
    let middle = rows.start + share(rows.len(), parts / 2, parts);
    let (first, others) = of_rows.split(rows.start, middle);
    rayon::join(
        || split(rows.start..middle, parts / 2, first, work),
        || split(middle..rows.end, parts - parts / 2, others, work),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_visited_with_what_is_its_own() {
        for rows in [0, 1, GRAIN, GRAIN + 1, 5 * GRAIN + 3] {
            let mut values = vec![0; rows];
            for_each_row(&mut values, |row, value| *value += row + 1);
            assert!(values.iter().enumerate().all(|(row, &value)| value == row + 1), "{rows}");

            for threads in [1, 2, 5] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let ([mut first, mut second], mut workspaces) = ([0; 2].map(|zero| vec![zero; rows]), vec![0]);
                pool.install(|| {
                    for_chunks(&mut first, &mut second, 1000, &mut workspaces, |start, first, second, chunks| {
                        assert!(first.len() == second.len() && first.len() <= 1000);
                        (start..).zip(first).for_each(|(row, value)| *value += row + 1);
                        (start..).zip(second).for_each(|(row, value)| *value += row + 2);
                        *chunks += 1;
                    });
                });
                assert!((0..rows).all(|row| [first[row], second[row]] == [row + 1, row + 2]), "{rows}");
                let chunks = rows.div_ceil(1000);
                assert!(
                    workspaces.len() <= threads && workspaces.iter().max() == Some(&chunks.div_ceil(threads)),
                    "{workspaces:?}"
                );
                assert_eq!(workspaces.iter().sum::<usize>(), chunks);
            }

            // A row has as many blocks as its number modulo three.
            let pattern = Pattern::build(rows, |row, columns| columns.extend(0..row as u32 % 3)).unwrap();
            let mut values = vec![0; pattern.blocks()];
            let mut beside = vec![0; rows];
            let both = (Values(&pattern, &mut values), OneEach(&mut beside));
            for_each_row_of(0..rows, GRAIN, both, |row, (values, beside)| {
                assert_eq!(values.len(), row % 3);
                values.iter_mut().for_each(|value| *value += row + 1);
                *beside += row + 1;
            });
            let own = |row: usize, values: &[usize]| values[pattern.row(row)].iter().all(|&value| value == row + 1);
            assert!((0..rows).all(|row| own(row, &values) && beside[row] == row + 1), "{rows}");

            let some = rows / 3..rows;
            let mut values = vec![0; pattern.positions(&some).len()];
            for_each_row_of(some.clone(), 7, Values(&pattern, &mut values), |row, values| {
                values.iter_mut().for_each(|value| *value += row + 1);
            });
            let mut all = vec![0; pattern.positions(&(0..some.start)).len()];
            all.extend(values);
            assert!(some.into_iter().all(|row| own(row, &all)), "{rows}");
        }
    }
}
