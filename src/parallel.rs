//! Work on the pieces of a list, in parallel where that pays. Pieces are independent, so results are the same for any number
//! of threads. Every thread has as many pieces, of one size but for one item.

/// Least items for a thread: some microseconds of work.
const GRAIN: usize = 1024;

/// The number of pieces of so many items on the current threads, none with fewer than `least`.
pub(crate) fn parts(items: usize, least: usize) -> usize {
    parts_for(items, least, rayon::current_num_threads())
}

fn parts_for(items: usize, least: usize, threads: usize) -> usize {
    let most = (items / least.max(1)).max(1);
    match most / threads {
        0 => most,
        // Four pieces a thread balance the load.
        turns => threads * turns.min(4),
    }
}

/// Calls `work` with every piece of `items` and the position of its first item, without allocating.
///
/// # Errors
/// The one of the first piece that fails, in the order of the items.
pub(crate) fn try_pieces<T: Send, E: Send>(
    items: &mut [T],
    work: &(impl Fn(usize, &mut [T]) -> Result<(), E> + Sync),
) -> Result<(), E> {
    cut(0, items, parts(items.len(), GRAIN), work)
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

/// The share of some of several parts in the whole.
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
            let mut items = vec![0; 20 * GRAIN + 3];
            pool(threads).install(|| {
                pieces(&mut items, &|first, piece| {
                    piece.iter_mut().enumerate().for_each(|(index, item)| *item += first + index);
                });
            });
            assert!(items.iter().enumerate().all(|(index, &item)| item == index), "{threads}");
        }
    }

    /// As many for every thread, and no more than four.
    #[test]
    fn threads_have_as_many_pieces_each() {
        for (items, threads, expected) in [
            (0, 1, 1),
            (9, 4, 1),
            (39, 4, 3),
            (40, 4, 4),
            (79, 4, 4),
            (80, 4, 8),
            (1000, 4, 16),
            (29, 1, 2),
            (1000, 1, 4),
        ] {
            assert_eq!(parts_for(items, 10, threads), expected, "{items} {threads}");
        }
        assert_eq!(parts_for(3, 0, 1), 3);
    }

    #[test]
    fn the_first_error_is_returned() {
        let mut items = vec![(); 20 * GRAIN];
        let count = pool(2).install(|| parts(items.len(), GRAIN));
        let failed =
            pool(2).install(|| try_pieces(&mut items, &|first, _| if first > 0 { Err(first) } else { Ok(()) }));
        assert_eq!(failed, Err(20 * GRAIN / count));
    }

    /// Items of every thread, counted, on one to sixteen: each has as many pieces as the others, and a thread's work is at most a
    /// hundredth above the mean. Where there is not enough for all, those that have any have the same.
    #[test]
    fn threads_have_the_same_to_do() {
        for threads in 1..=16 {
            for length in [1, GRAIN, 3 * GRAIN + 1, 16 * GRAIN - 1, 20_483, 58_804, 598_000] {
                let sizes = Mutex::new(Vec::new());
                pool(threads).install(|| {
                    pieces(&mut vec![(); length], &|first, piece| sizes.lock().unwrap().push((first, piece.len())));
                });
                let mut sizes = sizes.into_inner().unwrap();
                sizes.sort_unstable();
                let busy = sizes.len().min(threads);
                assert_eq!(sizes.len() % busy, 0, "{threads} {length}: {} pieces", sizes.len());
                assert!(busy == threads || length < (threads + 1) * GRAIN, "{threads} {length}: {busy} threads");
                let of_threads = sizes.chunks(sizes.len() / busy);
                let most = of_threads.map(|pieces| pieces.iter().map(|piece| piece.1).sum::<usize>()).max().unwrap();
                let mean = length as f64 / busy as f64;
                assert!(most as f64 <= 1.01 * mean.max(1.0), "{threads} {length}: {most} {mean}");
            }
        }
    }
}
