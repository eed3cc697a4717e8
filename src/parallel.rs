//! Work on the pieces of a list, in parallel where that pays. What a piece gets does not depend on the others, so results
//! are the same for any number of threads.

/// Items that one thread treats at a stretch.
const PIECE: usize = 4096;

/// Calls `work` with every piece of `items` and the position of its first item, without allocating.
///
/// # Errors
/// The one of the first piece that fails, in the order of the items.
pub(crate) fn try_pieces<T: Send, E: Send>(
    items: &mut [T],
    work: &(impl Fn(usize, &mut [T]) -> Result<(), E> + Sync),
) -> Result<(), E> {
    halve(0, items, work)
}

/// As [`try_pieces`], with work that cannot fail.
pub(crate) fn pieces<T: Send>(items: &mut [T], work: &(impl Fn(usize, &mut [T]) + Sync)) {
    let Ok(()) = halve(0, items, &|first, piece: &mut [T]| {
        work(first, piece);
        Ok::<(), std::convert::Infallible>(())
    });
}

fn halve<T: Send, E: Send>(
    first: usize,
    items: &mut [T],
    work: &(impl Fn(usize, &mut [T]) -> Result<(), E> + Sync),
) -> Result<(), E> {
    if items.len() <= PIECE {
        return work(first, items);
    }
    let middle = items.len() / 2;
    let (left, right) = items.split_at_mut(middle);
    let (left, right) = rayon::join(|| halve(first, left, work), || halve(first + middle, right, work));
    left.and(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_piece_knows_where_it_begins() {
        let mut items = vec![0; 5 * PIECE + 3];
        pieces(&mut items, &|first, piece| {
            piece.iter_mut().enumerate().for_each(|(index, item)| *item += first + index);
        });
        assert!(items.iter().enumerate().all(|(index, &item)| item == index));
    }

    #[test]
    fn the_first_error_is_told() {
        let mut items = vec![(); 5 * PIECE];
        let failed = try_pieces(&mut items, &|first, _| if first > 0 { Err(first) } else { Ok(()) });
        assert!(failed.is_err_and(|first| first > 0 && first <= PIECE), "{failed:?}");
    }
}
