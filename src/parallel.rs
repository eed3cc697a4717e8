//! Work on the pieces of a list, in parallel where that pays. What a piece gets does not depend on the others, so results
//! are the same for any number of threads.
//!
//! There are as many pieces for every thread, all of one size but for one item: no thread has more to do than another. Halving until
//! pieces are small enough would give three threads four pieces, and one of them twice the work.

/// Items that are not worth a second thread: some microseconds of work.
const LEAST: usize = 1024;

/// Pieces for every thread, where there is enough: what a thread that is held up leaves, others take.
const TURNS: usize = 4;

/// How many pieces so many items are cut into on the current threads, none of fewer than `least`.
pub(crate) fn parts(items: usize, least: usize) -> usize {
    parts_for(items, least, rayon::current_num_threads())
}

fn parts_for(items: usize, least: usize, threads: usize) -> usize {
    let most = (items / least.max(1)).max(1);
    if most < 2 * threads { most.min(threads) } else { threads * (most / threads).min(TURNS) }
}

/// Calls `work` with every piece of `items` and the position of its first item, without allocating.
///
/// # Errors
/// The one of the first piece that fails, in the order of the items.
pub(crate) fn try_pieces<T: Send, E: Send>(
    items: &mut [T],
    work: &(impl Fn(usize, &mut [T]) -> Result<(), E> + Sync),
) -> Result<(), E> {
    cut(0, items, parts(items.len(), LEAST), work)
}

/// As [`try_pieces`], with work that cannot fail.
pub(crate) fn pieces<T: Send>(items: &mut [T], work: &(impl Fn(usize, &mut [T]) + Sync)) {
    let Ok(()) = try_pieces(items, &|first, piece: &mut [T]| {
        work(first, piece);
        Ok::<(), std::convert::Infallible>(())
    });
}

fn cut<T: Send, E: Send>(
    first: usize,
    items: &mut [T],
    parts: usize,
    work: &(impl Fn(usize, &mut [T]) -> Result<(), E> + Sync),
) -> Result<(), E> {
    if parts <= 1 {
        return work(first, items);
    }
    let middle = share(items.len(), parts / 2, parts);
    let (left, right) = items.split_at_mut(middle);
    let (left, right) =
        rayon::join(|| cut(first, left, parts / 2, work), || cut(first + middle, right, parts - parts / 2, work));
    left.and(right)
}

/// What some of several parts have of the whole.
pub(crate) fn share(whole: usize, some: usize, parts: usize) -> usize {
    (whole as u128 * some as u128 / parts.max(1) as u128) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    fn pool(threads: usize) -> rayon::ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
    }

    #[test]
    fn every_piece_knows_where_it_begins() {
        for threads in [1, 2, 3, 7] {
            let mut items = vec![0; 20 * LEAST + 3];
            pool(threads).install(|| {
                pieces(&mut items, &|first, piece| {
                    piece.iter_mut().enumerate().for_each(|(index, item)| *item += first + index);
                });
            });
            assert!(items.iter().enumerate().all(|(index, &item)| item == index), "{threads}");
        }
    }

    #[test]
    fn the_first_error_is_told() {
        let mut items = vec![(); 20 * LEAST];
        let count = pool(2).install(|| parts(items.len(), LEAST));
        let failed =
            pool(2).install(|| try_pieces(&mut items, &|first, _| if first > 0 { Err(first) } else { Ok(()) }));
        assert_eq!(failed, Err(20 * LEAST / count));
    }

    /// Items of every thread, counted, on one to sixteen: each has as many pieces as the others, and a thread's work is at most a
    /// hundredth above the mean. Where there is not enough for all, those that have any have the same.
    #[test]
    fn threads_have_the_same_to_do() {
        for threads in 1..=16 {
            for length in [1, LEAST, 3 * LEAST + 1, 16 * LEAST - 1, 20_483, 58_804, 598_000] {
                let sizes = Mutex::new(Vec::new());
                pool(threads).install(|| {
                    pieces(&mut vec![(); length], &|first, piece| sizes.lock().unwrap().push((first, piece.len())));
                });
                let mut sizes = sizes.into_inner().unwrap();
                sizes.sort_unstable();
                let busy = sizes.len().min(threads);
                assert_eq!(sizes.len() % busy, 0, "{threads} {length}: {} pieces", sizes.len());
                assert!(busy == threads || length < (threads + 1) * LEAST, "{threads} {length}: {busy} threads");
                let of_threads = sizes.chunks(sizes.len() / busy);
                let most = of_threads.map(|pieces| pieces.iter().map(|piece| piece.1).sum::<usize>()).max().unwrap();
                let mean = length as f64 / busy as f64;
                assert!(most as f64 <= 1.01 * mean.max(1.0), "{threads} {length}: {most} {mean}");
            }
        }
    }
}
