//! Rows shared out among threads. Every row is computed by one thread, always in the same way: results do not depend on how
//! many there are. Loops over rows are compiled for [wider registers](widely) too, with what they call as far as that is inlined.

use super::sparse::Pattern;
use crate::parallel::{parts, pieces, share};
use crate::registers::widely;
use rayon::prelude::*;
use std::ops::Range;

/// Rows that are not worth a second thread.
pub(super) const GRAIN: usize = 512;

/// Numbers that are searched by one thread, and side by side.
const PIECE: usize = 16_384;
const LANES: usize = 16;

/// Calls `f(row, value)` for every entry of a vector.
pub(super) fn for_each_row<T: Send>(values: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    let rows = |start: usize, values: &mut [T]| {
        widely(
            #[inline(always)]
            || {
                for (row, value) in (start..).zip(values.iter_mut()) {
                    f(row, value);
                }
            },
        );
    };
    pieces(values, &rows);
}

/// The largest magnitude, those that are not numbers left out; the same however it is searched for.
pub(super) fn largest(numbers: &[f64]) -> f64 {
    if numbers.len() > PIECE {
        let (first, second) = numbers.split_at(numbers.len() / 2);
        let (first, second) = rayon::join(|| largest(first), || largest(second));
        return f64::max(first, second);
    }
    widely(
        #[inline(always)]
        || {
            let (chunks, rest) = numbers.as_chunks::<LANES>();
            let mut lanes = [0.0; LANES];
            for chunk in chunks {
                for (largest, number) in lanes.iter_mut().zip(chunk) {
                    // As registers do it: a comparison with what is no number fails.
                    *largest = if number.abs() > *largest { number.abs() } else { *largest };
                }
            }
            lanes.iter().chain(rest).fold(0.0, |largest, number| f64::max(largest, number.abs()))
        },
    )
}

/// Calls `f(start, chunk, chunk, room)` for chunks of a given length of two vectors. Every thread has some that follow each other, one after the other in
/// its room; rooms that are missing are made like the first.
pub(super) fn for_chunks<T: Send, U: Send, R: Clone + Send>(
    first: &mut [T],
    second: &mut [U],
    length: usize,
    rooms: &mut Vec<R>,
    f: impl Fn(usize, &mut [T], &mut [U], &mut R) + Sync,
) {
    let each = length * first.len().div_ceil(length).div_ceil(rayon::current_num_threads()).max(1);
    while rooms.len() < first.len().div_ceil(each)
        && let Some(room) = rooms.first().cloned()
    {
        rooms.push(room);
    }
    let of_thread = |start: usize, first: &mut [T], second: &mut [U], room: &mut R| {
        let pairs = first.chunks_mut(length).zip(second.chunks_mut(length));
        for (start, (first, second)) in (start..).step_by(length).zip(pairs) {
            widely(
                #[inline(always)]
                || f(start, first, second, room),
            );
        }
    };
    if let [room, ..] = &mut rooms[..]
        && first.len() <= each
    {
        of_thread(0, first, second, room);
    } else {
        let pairs = first.par_chunks_mut(each).zip(second.par_chunks_mut(each));
        let of_threads = pairs.zip(rooms.par_iter_mut()).enumerate();
        of_threads.for_each(|(at, ((first, second), room))| of_thread(at * each, first, second, room));
    }
}

/// Calls `f(row, values of the row, value)` for every row of a sparse matrix and every entry of a vector beside it.
pub(super) fn for_each_sparse_row<T: Send, U: Send>(
    pattern: &Pattern,
    values: &mut [T],
    beside: &mut [U],
    f: impl Fn(usize, &mut [T], &mut U) + Sync,
) {
    for_each_beside(pattern, 0..pattern.rows(), GRAIN, values, beside, f);
}

/// Where the values of a row begin, in all values; those of the row after the last begin at their end.
pub(super) trait Starts: Sync {
    fn start(&self, row: usize) -> usize;
}

impl Starts for Pattern {
    #[inline(always)]
    fn start(&self, row: usize) -> usize {
        self.row(row).start
    }
}

/// Values of one pattern, and behind them, row by row, those of another.
impl Starts for [&Pattern; 2] {
    #[inline(always)]
    fn start(&self, row: usize) -> usize {
        self[0].start(row) + self[1].start(row)
    }
}

/// Calls `f(row, values of the row)` for some rows of a sparse matrix; `values` are those of these rows. Fewer than `grain` rows
/// are not worth a second thread.
pub(super) fn for_each_row_of<T: Send>(
    pattern: &impl Starts,
    rows: Range<usize>,
    grain: usize,
    values: &mut [T],
    f: impl Fn(usize, &mut [T]) + Sync,
) {
    let mut beside = vec![(); rows.len()];
    for_each_beside(
        pattern,
        rows,
        grain,
        values,
        &mut beside,
        #[inline(always)]
        |row, values, ()| f(row, values),
    );
}

fn for_each_beside<T: Send, U: Send>(
    pattern: &impl Starts,
    rows: Range<usize>,
    grain: usize,
    values: &mut [T],
    beside: &mut [U],
    f: impl Fn(usize, &mut [T], &mut U) + Sync,
) {
    let parts = parts(rows.len(), grain);
    split(pattern, rows, parts, values, beside, &|rows: Range<usize>, values: &mut [T], beside: &mut [U]| {
        widely(
            #[inline(always)]
            || {
                let mut rest = &mut values[..];
                for (row, beside) in rows.clone().zip(beside.iter_mut()) {
                    let (mine, others) = rest.split_at_mut(pattern.start(row + 1) - pattern.start(row));
                    f(row, mine, beside);
                    rest = others;
                }
            },
        );
    });
}

/// Calls `work(rows, their values, what is beside them)` for so many parts of some rows.
fn split<T: Send, U: Send>(
    pattern: &impl Starts,
    rows: Range<usize>,
    parts: usize,
    values: &mut [T],
    beside: &mut [U],
    work: &(impl Fn(Range<usize>, &mut [T], &mut [U]) + Sync),
) {
    if parts <= 1 {
        return work(rows, values, beside);
    }
    let some = share(rows.len(), parts / 2, parts);
    let middle = rows.start + some;
    let (low, high) = values.split_at_mut(pattern.start(middle) - pattern.start(rows.start));
    let (low_beside, high_beside) = beside.split_at_mut(some);
    rayon::join(
        || split(pattern, rows.start..middle, parts / 2, low, low_beside, work),
        || split(pattern, middle..rows.end, parts - parts / 2, high, high_beside, work),
    );
}

#[cfg(test)]
mod tests {
    use super::{GRAIN, PIECE, for_chunks, for_each_row, for_each_row_of, for_each_sparse_row, largest, split};
    use crate::multigrid::sparse::Pattern;
    use crate::parallel::parts;
    use std::sync::Mutex;

    /// However many pieces there are, every row is visited once and knows its number.
    #[test]
    fn every_row_is_visited_with_what_is_its_own() {
        for rows in [0, 1, GRAIN, GRAIN + 1, 5 * GRAIN + 3] {
            let mut values = vec![0; rows];
            for_each_row(&mut values, |row, value| *value += row + 1);
            assert!(values.iter().enumerate().all(|(row, &value)| value == row + 1), "{rows}");

            for threads in [1, 2, 5] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let ([mut first, mut second], mut rooms) = ([0; 2].map(|zero| vec![zero; rows]), vec![0]);
                pool.install(|| {
                    for_chunks(&mut first, &mut second, 1000, &mut rooms, |start, first, second, chunks| {
                        assert!(first.len() == second.len() && first.len() <= 1000);
                        (start..).zip(first).for_each(|(row, value)| *value += row + 1);
                        (start..).zip(second).for_each(|(row, value)| *value += row + 2);
                        *chunks += 1;
                    });
                });
                assert!((0..rows).all(|row| [first[row], second[row]] == [row + 1, row + 2]), "{rows}");
                let chunks = rows.div_ceil(1000);
                assert!(rooms.len() <= threads && rooms.iter().max() == Some(&chunks.div_ceil(threads)), "{rooms:?}");
                assert_eq!(rooms.iter().sum::<usize>(), chunks);
            }

            // A row has as many blocks as its number modulo three.
            let pattern = Pattern::build(rows, |row, columns| columns.extend(0..row as u32 % 3)).unwrap();
            let mut values = vec![0; pattern.blocks()];
            let mut beside = vec![0; rows];
            for_each_sparse_row(&pattern, &mut values, &mut beside, |row, values, beside| {
                assert_eq!(values.len(), row % 3);
                values.iter_mut().for_each(|value| *value += row + 1);
                *beside += row + 1;
            });
            let own = |row: usize, values: &[usize]| values[pattern.row(row)].iter().all(|&value| value == row + 1);
            assert!((0..rows).all(|row| own(row, &values) && beside[row] == row + 1), "{rows}");

            let some = rows / 3..rows;
            let mut values = vec![0; pattern.positions(&some).len()];
            for_each_row_of(&pattern, some.clone(), 7, &mut values, |row, values| {
                values.iter_mut().for_each(|value| *value += row + 1);
            });
            let mut all = vec![0; pattern.positions(&(0..some.start)).len()];
            all.extend(values);
            assert!(some.into_iter().all(|row| own(row, &all)), "{rows}");
        }
    }

    /// Wherever it is, in a chunk or in what is left of a piece, and whatever its sign; what is no number does not count.
    #[test]
    fn the_largest_magnitude_is_found_anywhere() {
        assert_eq!(largest(&[]), 0.0);
        for length in [1, 15, 16, 17, PIECE, PIECE + 1, 3 * PIECE + 5] {
            for place in [0, length / 3, length / 2, length - 1] {
                let mut numbers: Vec<f64> = (0..length).map(|i| (i as f64).sin()).collect();
                numbers[place] = -2.0;
                assert_eq!(largest(&numbers), 2.0, "{place} of {length}");
                numbers[place] = f64::NAN;
                let others = numbers.iter().fold(0.0, |most, number| f64::max(most, number.abs()));
                assert_eq!(largest(&numbers), others, "{place} of {length}");
            }
        }
    }

    /// Entries of every thread, counted, on one to sixteen, for the pattern of a cloth of 100² nodes and nine blocks a row: each has as many
    /// pieces as the others, and a thread's work is at most a fiftieth above the mean.
    #[test]
    fn threads_have_the_same_rows() {
        let side = 100;
        let pattern = Pattern::build(side * side, |row, columns| {
            let near = |at: usize| at.saturating_sub(1)..(at + 2).min(side);
            columns.extend(near(row / side).flat_map(|y| near(row % side).map(move |x| (y * side + x) as u32)));
        });
        let pattern = pattern.unwrap();
        for threads in 1..=16 {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let entries = Mutex::new(Vec::new());
            pool.install(|| {
                let parts = parts(pattern.rows(), GRAIN);
                let (mut values, mut beside) = (vec![(); pattern.blocks()], vec![(); pattern.rows()]);
                split(&pattern, 0..pattern.rows(), parts, &mut values, &mut beside, &|rows, values, beside| {
                    assert_eq!((values.len(), beside.len()), (pattern.positions(&rows).len(), rows.len()));
                    entries.lock().unwrap().push((rows.start, values.len()));
                });
            });
            let mut entries = entries.into_inner().unwrap();
            entries.sort_unstable();
            assert_eq!(entries.len() % threads, 0, "{threads}");
            let of_threads = entries.chunks(entries.len() / threads);
            let most = of_threads.map(|pieces| pieces.iter().map(|piece| piece.1).sum::<usize>()).max().unwrap();
            assert!(most as f64 <= 1.02 * pattern.blocks() as f64 / threads as f64, "{threads}: {most}");
        }
    }
}
