//! Which of several terms to drop so that `I − H`, restricted to the columns of the others, is positive definite.
//!
//! All terms are put back; while the rest is not positive definite, the one with the largest part in the worst eigenvector of H is dropped; in the
//! end each dropped one is put back if that does no harm after all, the last one first. The other way round, all are dropped and put back one by
//! one where that does no harm, the weakest first. The smaller of both sets is taken; of neither can anything be spared.

use crate::linear::norm;
use nalgebra::{Cholesky, DMatrix, DVector};

/// How small a [`DropSet`](super::DropSet) is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Minimality {
    /// None of the springs can be spared.
    Irredundant,
    /// The springs are enough; whether some could be spared was too expensive to find out.
    Enough,
}

/// Steps of the power iteration that tells which spring to drop next: a choice, not a proof.
const POWER_STEPS: usize = 40;

/// Which owners to drop so that `I − H`, restricted to the columns of the others, is positive definite; in the order in
/// which they were found. Where that would take more than `most` multiplications, whoever might be spared is not asked for any more,
/// and in the end all are dropped.
pub(super) fn choose(h: &DMatrix<f64>, owners: &[usize], count: usize, most: f64) -> (Vec<usize>, Minimality) {
    let columns = |dropped: &[bool]| -> Vec<usize> { (0..owners.len()).filter(|&c| !dropped[owners[c]]).collect() };
    let restricted = |kept: &[usize]| {
        DMatrix::from_fn(kept.len(), kept.len(), |r, c| 0.5 * (h[(kept[r], kept[c])] + h[(kept[c], kept[r])]))
    };
    let mut left = most;
    let mut is_definite = |dropped: &[bool]| {
        let kept = columns(dropped);
        left -= (kept.len() as f64).powi(3) / 6.0;
        let rest = DMatrix::identity(kept.len(), kept.len()) - restricted(&kept);
        (left > 0.0).then(|| Cholesky::new(rest).is_some())
    };
    let (mut order, mut dropped) = (Vec::new(), vec![false; count]);
    while order.len() < count {
        match is_definite(&dropped) {
            Some(true) => break,
            Some(false) => {}
            None => return ((0..count).collect(), Minimality::Enough),
        }
        let kept = columns(&dropped);
        let matrix = restricted(&kept);
        // A start that no eigenvector is likely to be orthogonal to.
        let mut x = DVector::from_fn(kept.len(), |k, _| 1.0 + 0.1 * (k as f64).sin());
        for _ in 0..POWER_STEPS {
            // Not zero: H has an eigenvalue of one or more.
            x = &matrix * x;
            x /= norm(x.as_slice());
        }
        let mut weights = vec![0.0; count];
        for (&column, x) in kept.iter().zip(x.iter()) {
            weights[owners[column]] += x * x;
        }
        let worst = (0..count).filter(|&k| !dropped[k]).max_by(|&a, &b| weights[a].total_cmp(&weights[b]));
        worst.into_iter().for_each(|worst| dropped[worst] = true);
        order.extend(worst);
    }
    for spring in order.clone().into_iter().rev() {
        dropped[spring] = false;
        match is_definite(&dropped) {
            Some(true) => order.retain(|&other| other != spring),
            Some(false) => dropped[spring] = true,
            None => return (order, Minimality::Enough),
        }
    }
    // From the other side: all dropped, and put back as long as it does no harm, the weakest first.
    let strength = |k: usize| {
        let own = owners.iter().enumerate().filter(|(_, owner)| **owner == k);
        own.map(|(column, _)| h[(column, column)]).fold(0.0, f64::max)
    };
    let mut weakest: Vec<(f64, usize)> = (0..count).map(|k| (strength(k), k)).collect();
    weakest.sort_by(|a, b| a.0.total_cmp(&b.0));
    dropped.fill(true);
    for &(_, spring) in &weakest {
        dropped[spring] = false;
        match is_definite(&dropped) {
            Some(true) => {}
            Some(false) => dropped[spring] = true,
            None => return (order, Minimality::Irredundant),
        }
    }
    let other: Vec<usize> = weakest.into_iter().rev().map(|(_, k)| k).filter(|&k| dropped[k]).collect();
    (if other.len() < order.len() { other } else { order }, Minimality::Irredundant)
}

#[cfg(test)]
mod tests {
    use super::{Minimality, choose};
    use nalgebra::DMatrix;

    /// Three owners of one column each, of which the first two are too much by themselves.
    #[test]
    fn a_search_that_costs_too_much_keeps_what_is_enough() {
        let h = DMatrix::from_partial_diagonal(3, 3, &[1.5, 1.25, 0.5]);
        let owners = [0, 1, 2];
        assert_eq!(choose(&h, &owners, 3, f64::INFINITY), (vec![0, 1], Minimality::Irredundant));
        // 27/6, 8/6 and 1/6 multiplications for the three looks on the way there.
        assert_eq!(choose(&h, &owners, 3, 5.0), (vec![0, 1, 2], Minimality::Enough));
        assert_eq!(choose(&h, &owners, 3, 6.5), (vec![0, 1], Minimality::Enough));
        // Two more of 8/6 each, and none of the other way round.
        assert_eq!(choose(&h, &owners, 3, 9.0), (vec![0, 1], Minimality::Irredundant));
        // One look at six columns takes 36: nothing may be left then.
        let none = DMatrix::zeros(6, 6);
        let owners = [0, 1, 2, 3, 4, 5];
        assert_eq!(choose(&none, &owners, 6, 36.0), ((0..6).collect(), Minimality::Enough));
        assert_eq!(choose(&none, &owners, 6, 36.5), (Vec::new(), Minimality::Irredundant));
    }

    /// Terms so strong that their powers overflow: the strongest goes first. Of equal ones it is the one with most columns, then the last.
    #[test]
    fn the_worst_goes_first() {
        let strong = DMatrix::from_partial_diagonal(2, 2, &[1e12, 1e11]);
        assert_eq!(choose(&strong, &[0, 1], 2, f64::INFINITY), (vec![0, 1], Minimality::Irredundant));
        let equal = DMatrix::from_diagonal_element(4, 4, 2.0);
        assert_eq!(choose(&equal, &[0, 2, 1, 0], 3, f64::INFINITY).0, [0, 1, 2]);
    }

    /// Four owners of one column each, of which the worst eigenvectors pick three where two are enough.
    #[test]
    fn the_smaller_set_of_both_ways_is_taken() {
        let h = [
            1.125, 0.0, -0.125, 0.3125, 0.0, 0.75, 0.1875, 0.625, -0.125, 0.1875, 0.9375, 0.125, 0.3125, 0.625, 0.125,
            0.625,
        ];
        let h = DMatrix::from_row_slice(4, 4, &h);
        assert_eq!(choose(&h, &[0, 1, 2, 3], 4, f64::INFINITY), (vec![0, 1], Minimality::Irredundant));
    }
}
