//! Restriction and prolongation where columns are six.

use super::super::eight::{Eight, SIX};
use super::super::packed::{Packed, ask_for};
use super::super::parallel::for_each_row;
use super::super::sparse::ahead;
use super::Prolongator;

impl<const N: usize, const M: usize> Prolongator<N, M> {
    /// `r_c = Pᵀ r`.
    pub(super) fn restrict_eight(&self, eight: Eight, r: &[[f32; N]], coarse: &mut [[f32; M]]) {
        for_each_row(
            coarse,
            #[inline(always)]
            |aggregate, coarse| {
                let places = self.transpose.column(aggregate);
                self.ask_for(&places);
                let mut sums = [eight.nothing(); N];
                for (node, p) in self.blocks_at(places) {
                    for ((k, sum), &r) in sums.iter_mut().enumerate().zip(&r[node]) {
                        *sum = eight.add(*sum, eight.packed_row(p, k), eight.all(p.scale() * r));
                    }
                }
                *coarse = eight.first(sums.into_iter().fold(eight.nothing(), |all, sum| eight.sum(all, sum)));
            },
        );
    }

    /// `x += P e`.
    pub(super) fn prolong_eight(&self, eight: Eight, coarse: &[[f32; M]], x: &mut [[f32; N]]) {
        for_each_row(
            x,
            #[inline(always)]
            |row, x| {
                ask_for(self.matrix.pattern.values_of(&self.matrix.values, row + ahead::<Packed<N, M>>()));
                let mut sums = [eight.nothing(); SIX];
                for (aggregate, p) in self.matrix.row(row) {
                    let e = eight.product(eight.six(&coarse[aggregate]), eight.all(p.scale()));
                    for (k, sum) in sums.iter_mut().enumerate().take(N) {
                        *sum = eight.add(*sum, eight.packed_row(p, k), e);
                    }
                }
                let more: [f32; N] = eight.first(eight.across(sums));
                x.iter_mut().zip(more).for_each(|(x, more)| *x += more);
            },
        );
    }
}
