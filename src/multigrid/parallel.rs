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

/// What successive rows have, to be shared out among threads.
pub(super) trait OfRows: Sized + Send {
    /// What one row has.
    type Row;

    /// What the first rows have, from `start` to `middle`, and what the others have.
    fn split(self, start: usize, middle: usize) -> (Self, Self);

    /// What the first of these rows has, whose number this is; the others stay. None after the last.
    fn take(&mut self, row: usize) -> Option<Self::Row>;
}

/// One value for every row.
#[derive(Debug)]
pub(super) struct OneEach<'v, T>(pub &'v mut [T]);

impl<'v, T: Send> OfRows for OneEach<'v, T> {
    type Row = &'v mut T;

    fn split(self, start: usize, middle: usize) -> (Self, Self) {
        let (first, others) = self.0.split_at_mut(middle - start);
        (Self(first), Self(others))
    }

    #[inline(always)]
    fn take(&mut self, _: usize) -> Option<Self::Row> {
        self.0.split_off_first_mut()
    }
}

/// As many values for every row as a pattern says.
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
    fn take(&mut self, row: usize) -> Option<Self::Row> {
        let count = self.0.start(row + 1) - self.0.start(row);
        self.1.split_off_mut(..count)
    }
}

/// Two of these side by side.
impl<A: OfRows, B: OfRows> OfRows for (A, B) {
    type Row = (A::Row, B::Row);

    fn split(self, start: usize, middle: usize) -> (Self, Self) {
        let ((a, other_a), (b, other_b)) = (self.0.split(start, middle), self.1.split(start, middle));
        ((a, b), (other_a, other_b))
    }

    #[inline(always)]
    fn take(&mut self, row: usize) -> Option<Self::Row> {
        Some((self.0.take(row)?, self.1.take(row)?))
    }
}

/// Calls `f(row, what it has)` for some rows. Fewer than `grain` rows are not worth a second thread.
pub(super) fn for_each_row_of<R: OfRows>(
    rows: Range<usize>,
    grain: usize,
    of_rows: R,
    f: impl Fn(usize, R::Row) + Sync,
) {
    let parts = parts(rows.len(), grain);
    split(rows, parts, of_rows, &|rows: Range<usize>, mut of_rows: R| {
        widely(
            #[inline(always)]
            || {
                for row in rows.clone() {
                    let Some(of_row) = of_rows.take(row) else { return };
                    f(row, of_row);
                }
            },
        );
    });
}

/// Calls `work(rows, what they have)` for so many parts of some rows.
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
    use super::{GRAIN, OneEach, PIECE, Values, for_chunks, for_each_row, for_each_row_of, largest, split};
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
                let both = (Values(&pattern, &mut values), OneEach(&mut beside));
                split(0..pattern.rows(), parts, both, &|rows, (Values(_, values), OneEach(beside))| {
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
