//! Rows of six numbers in double precision, four and two side by side.

use super::super::block::Block;
use super::rows::RowProducts;
use pulp::cast;
use pulp::x86::V3;
use std::arch::x86_64::{__m128d, __m256d};

/// For processors that multiply and add in one operation.
#[derive(Debug, Clone, Copy)]
pub struct RowsOfSix(V3);

impl RowsOfSix {
    /// For rows of so many numbers, if they are six and the processor is such a one.
    pub fn of(columns: usize) -> Option<Self> {
        V3::try_new().filter(|_| columns == 6).map(Self)
    }

    #[inline(always)]
    fn row<const C: usize>(self, row: &[f64; C]) -> (__m256d, __m128d) {
        match row[..] {
            [a, b, c, d, e, f] => (cast([a, b, c, d]), cast([e, f])),
            _ => (cast([0f64; 4]), cast([0f64; 2])),
        }
    }

    /// `c += Σ_k a_k b_k`.
    #[inline(always)]
    fn add<const K: usize, const C: usize>(self, c: &mut [f64; C], a: [f64; K], b: &[(__m256d, __m128d); K]) {
        let (mut four, mut two) = self.row(c);
        for (a, &(b_four, b_two)) in a.into_iter().zip(b) {
            four = self.0.fma._mm256_fmadd_pd(self.0.avx._mm256_set1_pd(a), b_four, four);
            two = self.0.fma._mm_fmadd_pd(self.0.sse2._mm_set1_pd(a), b_two, two);
        }
        if let Some((to, rest)) = c.split_first_chunk_mut::<4>()
            && let Some(rest) = rest.first_chunk_mut::<2>()
        {
            (*to, *rest) = (cast(four), cast(two));
        }
    }
}

impl<const C: usize> RowProducts<C> for RowsOfSix {
    type Row = (__m256d, __m128d);

    #[inline(always)]
    fn rows<const R: usize>(self, block: &Block<R, C>) -> [Self::Row; R] {
        std::array::from_fn(|r| self.row(&block[r]))
    }

    #[inline(always)]
    fn double_rows<const R: usize>(self, block: &Block<R, C, f32>) -> [Self::Row; R] {
        std::array::from_fn(|r| match block[r][..] {
            [a, b, c, d, e, f] => {
                (self.0.avx._mm256_cvtps_pd(cast([a, b, c, d])), self.0.sse2._mm_cvtps_pd(cast([e, f, 0.0, 0.0])))
            }
            _ => self.row(&[0.0; 6]),
        })
    }

    #[inline(always)]
    fn add_product<const R: usize, const K: usize>(self, c: &mut Block<R, C>, a: &Block<R, K>, b: &[Self::Row; K]) {
        for (c, a) in c.iter_mut().zip(a) {
            self.add(c, *a, b);
        }
    }

    #[inline(always)]
    fn add_transposed_product<const R: usize, const K: usize>(
        self,
        c: &mut Block<K, C>,
        a: &Block<R, K>,
        b: &[Self::Row; R],
    ) {
        for (k, c) in c.iter_mut().enumerate() {
            self.add(c, a.map(|a| a[k]), b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::AnyRows;
    use super::{RowProducts, RowsOfSix};
    use crate::multigrid::block::Block;

    /// Of small whole numbers, which no sum rounds.
    fn block<const R: usize>(seed: usize) -> Block<R, 6> {
        std::array::from_fn(|r| std::array::from_fn(|c| ((seed + 7 * r + 5 * c) % 11) as f64 - 5.0))
    }

    fn products<const R: usize>(products: impl RowProducts<6>) -> [Vec<f64>; 3] {
        let (mut c, mut coarse) = (block::<R>(1), block::<6>(2));
        let a: Block<R, R> = std::array::from_fn(|r| std::array::from_fn(|k| (3 * r + k) as f64 - 2.0));
        products.add_product(&mut c, &a, &products.rows(&block::<R>(3)));
        products.add_transposed_product(&mut coarse, &block::<R>(4), &products.rows(&block::<R>(5)));
        let mut double = block::<R>(6);
        let single = block::<R>(7).map(|row| row.map(|entry| entry as f32));
        products.add_product(&mut double, &a, &products.double_rows(&single));
        [c.as_flattened().to_vec(), coarse.as_flattened().to_vec(), double.as_flattened().to_vec()]
    }

    #[test]
    fn rows_of_six_have_the_products_of_any_rows() {
        assert!(RowsOfSix::of(3).is_none());
        let Some(six) = RowsOfSix::of(6) else { return };
        assert_eq!(products::<3>(six), products::<3>(AnyRows));
        assert_eq!(products::<6>(six), products::<6>(AnyRows));
    }
}
