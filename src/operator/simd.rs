//! Four numbers side by side in vector registers, one of each of four springs, and prefetching.
//!
//! A vector along three axes is loaded with the number behind it, which is padding. Four of them are transposed into three lists of four springs, one
//! an axis, and go back as a pair and a single number each: sums are loaded and stored in these two pieces, as processors forward a store to a load
//! of the same bytes only.
//!
//! Both implementations round alike, in the same order: their results are the same to the bit.

pub trait Simd: Copy {
    type Four: Copy;
    type Two: Copy;

    fn four(self, numbers: [f64; 4]) -> Self::Four;
    fn all(self, four: Self::Four) -> [f64; 4];
    fn add(self, a: Self::Four, b: Self::Four) -> Self::Four;
    fn sub(self, a: Self::Four, b: Self::Four) -> Self::Four;
    fn mul(self, a: Self::Four, b: Self::Four) -> Self::Four;
    /// Transposes four vectors of three numbers and padding.
    fn transpose(self, vectors: [Self::Four; 4]) -> [Self::Four; 3];
    /// Transposes back, in two pieces.
    fn split_transpose(self, lists: [Self::Four; 3]) -> [(Self::Two, f64); 4];

    /// Transposes four vectors of three contiguous numbers.
    fn deinterleave(self, twelve: [Self::Four; 3]) -> [Self::Four; 3];
    /// Transposes back.
    fn interleave(self, axes: [Self::Four; 3]) -> [Self::Four; 3];

    fn two(self, numbers: [f64; 2]) -> Self::Two;
    fn numbers(self, two: Self::Two) -> [f64; 2];
    fn add_two(self, a: Self::Two, b: Self::Two) -> Self::Two;
    fn sub_two(self, a: Self::Two, b: Self::Two) -> Self::Two;

    fn all_equal(self, numbers: &[u32; 4]) -> bool;
}

#[derive(Debug, Clone, Copy)]
pub struct Portable;

#[inline(always)]
fn each<const N: usize>(a: [f64; N], b: [f64; N], f: impl Fn(f64, f64) -> f64) -> [f64; N] {
    std::array::from_fn(|lane| f(a[lane], b[lane]))
}

impl Simd for Portable {
    type Four = [f64; 4];
    type Two = [f64; 2];

    #[inline(always)]
    fn four(self, numbers: [f64; 4]) -> [f64; 4] {
        numbers
    }

    #[inline(always)]
    fn all(self, four: [f64; 4]) -> [f64; 4] {
        four
    }

    #[inline(always)]
    fn add(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each(a, b, |a, b| a + b)
    }

    #[inline(always)]
    fn sub(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each(a, b, |a, b| a - b)
    }

    #[inline(always)]
    fn mul(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        each(a, b, |a, b| a * b)
    }

    #[inline(always)]
    fn transpose(self, vectors: [[f64; 4]; 4]) -> [[f64; 4]; 3] {
        std::array::from_fn(|axis| vectors.map(|vector| vector[axis]))
    }

    #[inline(always)]
    fn split_transpose(self, [x, y, z]: [[f64; 4]; 3]) -> [([f64; 2], f64); 4] {
        std::array::from_fn(|spring| ([x[spring], y[spring]], z[spring]))
    }

    #[inline(always)]
    fn deinterleave(self, twelve: [[f64; 4]; 3]) -> [[f64; 4]; 3] {
        let numbers = twelve.as_flattened();
        std::array::from_fn(|axis| std::array::from_fn(|spring| numbers[3 * spring + axis]))
    }

    #[inline(always)]
    fn interleave(self, axes: [[f64; 4]; 3]) -> [[f64; 4]; 3] {
        std::array::from_fn(|piece| {
            std::array::from_fn(|n| {
                let number = 4 * piece + n;
                axes[number % 3][number / 3]
            })
        })
    }

    #[inline(always)]
    fn two(self, numbers: [f64; 2]) -> [f64; 2] {
        numbers
    }

    #[inline(always)]
    fn numbers(self, two: [f64; 2]) -> [f64; 2] {
        two
    }

    #[inline(always)]
    fn add_two(self, a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
        each(a, b, |a, b| a + b)
    }

    #[inline(always)]
    fn sub_two(self, a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
        each(a, b, |a, b| a - b)
    }

    #[inline(always)]
    fn all_equal(self, numbers: &[u32; 4]) -> bool {
        numbers.iter().all(|number| *number == numbers[0])
    }
}

#[cfg(target_arch = "x86_64")]
mod wide {
    use super::Simd;
    use pulp::cast;
    use pulp::x86::V3;
    use std::arch::x86_64::{__m128d, __m128i, __m256d};

    impl Simd for V3 {
        type Four = __m256d;
        type Two = __m128d;

        #[inline(always)]
        fn four(self, numbers: [f64; 4]) -> __m256d {
            cast(numbers)
        }

        #[inline(always)]
        fn all(self, four: __m256d) -> [f64; 4] {
            cast(four)
        }

        #[inline(always)]
        fn add(self, a: __m256d, b: __m256d) -> __m256d {
            self.avx._mm256_add_pd(a, b)
        }

        #[inline(always)]
        fn sub(self, a: __m256d, b: __m256d) -> __m256d {
            self.avx._mm256_sub_pd(a, b)
        }

        #[inline(always)]
        fn mul(self, a: __m256d, b: __m256d) -> __m256d {
            self.avx._mm256_mul_pd(a, b)
        }

        #[inline(always)]
        fn transpose(self, [a, b, c, d]: [__m256d; 4]) -> [__m256d; 3] {
            let avx = self.avx;
            // x and z of two springs, alternating; y and the padding.
            let (ab, ab_y) = (avx._mm256_unpacklo_pd(a, b), avx._mm256_unpackhi_pd(a, b));
            let (cd, cd_y) = (avx._mm256_unpacklo_pd(c, d), avx._mm256_unpackhi_pd(c, d));
            [
                avx._mm256_permute2f128_pd::<0x20>(ab, cd),
                avx._mm256_permute2f128_pd::<0x20>(ab_y, cd_y),
                avx._mm256_permute2f128_pd::<0x31>(ab, cd),
            ]
        }

        #[inline(always)]
        fn split_transpose(self, [x, y, z]: [__m256d; 3]) -> [(__m128d, f64); 4] {
            let avx = self.avx;
            // x and y of the springs 0 and 2, 1 and 3.
            let (even, odd) = (avx._mm256_unpacklo_pd(x, y), avx._mm256_unpackhi_pd(x, y));
            let odd_z = avx._mm256_unpackhi_pd(z, z);
            let low = |xy, z| (avx._mm256_castpd256_pd128(xy), self.numbers(avx._mm256_castpd256_pd128(z))[0]);
            let high = |xy, z| (avx._mm256_extractf128_pd::<1>(xy), self.numbers(avx._mm256_extractf128_pd::<1>(z))[0]);
            [low(even, z), low(odd, odd_z), high(even, z), high(odd, odd_z)]
        }

        #[inline(always)]
        fn deinterleave(self, [a, b, c]: [__m256d; 3]) -> [__m256d; 3] {
            let avx = self.avx;
            // x0 y0 x2 y2, z0 x1 z2 x3, y1 z1 y3 z3.
            let xy = avx._mm256_blend_pd::<0b1100>(a, b);
            let zx = avx._mm256_permute2f128_pd::<0x21>(a, c);
            let yz = avx._mm256_blend_pd::<0b1100>(b, c);
            [
                avx._mm256_shuffle_pd::<0b1010>(xy, zx),
                avx._mm256_shuffle_pd::<0b0101>(xy, yz),
                avx._mm256_shuffle_pd::<0b1010>(zx, yz),
            ]
        }

        #[inline(always)]
        fn interleave(self, [x, y, z]: [__m256d; 3]) -> [__m256d; 3] {
            let avx = self.avx;
            let xy = avx._mm256_unpacklo_pd(x, y);
            let zx = avx._mm256_shuffle_pd::<0b1010>(z, x);
            let yz = avx._mm256_unpackhi_pd(y, z);
            [
                avx._mm256_permute2f128_pd::<0x20>(xy, zx),
                avx._mm256_blend_pd::<0b1100>(yz, xy),
                avx._mm256_permute2f128_pd::<0x31>(zx, yz),
            ]
        }

        #[inline(always)]
        fn two(self, numbers: [f64; 2]) -> __m128d {
            cast(numbers)
        }

        #[inline(always)]
        fn numbers(self, two: __m128d) -> [f64; 2] {
            cast(two)
        }

        #[inline(always)]
        fn add_two(self, a: __m128d, b: __m128d) -> __m128d {
            self.sse2._mm_add_pd(a, b)
        }

        #[inline(always)]
        fn sub_two(self, a: __m128d, b: __m128d) -> __m128d {
            self.sse2._mm_sub_pd(a, b)
        }

        #[inline(always)]
        fn all_equal(self, numbers: &[u32; 4]) -> bool {
            let numbers: __m128i = cast(*numbers);
            let first = self.sse2._mm_shuffle_epi32::<0>(numbers);
            self.sse2._mm_movemask_epi8(self.sse2._mm_cmpeq_epi32(numbers, first)) == 0xffff
        }
    }
}

/// Prefetches the cache line in which `value` begins.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) fn prefetch<T>(value: &T) {
    safe_arch::prefetch_t0(value);
}

/// Does nothing: safe code has no prefetch on this architecture.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(crate) fn prefetch<T>(_: &T) {}

/// Prefetches contiguous values, by cache lines of 64 bytes.
#[inline(always)]
pub(crate) fn prefetch_all<T>(values: &[T]) {
    values.iter().step_by((64 / size_of::<T>()).max(1)).for_each(prefetch);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn results<L: Simd>(simd: L) -> Vec<f64> {
        let vectors = [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], [9.0, 10.0, 11.0, 12.0], [13.0, 14.0, 15.0, 16.0]];
        let four = vectors.map(|vector| simd.four(vector));
        let lists = simd.transpose(four);
        let back = simd.split_transpose(lists);
        let sums = simd.split_transpose([
            simd.add(lists[0], lists[1]),
            simd.sub(lists[1], lists[2]),
            simd.mul(lists[0], lists[2]),
        ]);
        let pair = simd.add_two(simd.two([1.0, 2.0]), simd.sub_two(simd.two([7.0, 9.0]), simd.two([3.0, 4.0])));
        let pieces = back.into_iter().chain(sums).chain([(pair, 0.0)]);
        let axes = simd.deinterleave([four[0], four[1], four[2]]);
        let twelve = axes.into_iter().chain(simd.interleave(axes)).flat_map(|four| simd.all(four));
        pieces.flat_map(|(xy, z)| simd.numbers(xy).into_iter().chain([z])).chain(twelve).collect()
    }

    #[test]
    fn all_implementations_agree() {
        let expected = [
            [1.0, 2.0, 3.0],
            [5.0, 6.0, 7.0],
            [9.0, 10.0, 11.0],
            [13.0, 14.0, 15.0],
            [3.0, -1.0, 3.0],
            [11.0, -1.0, 35.0],
            [19.0, -1.0, 99.0],
            [27.0, -1.0, 195.0],
            [5.0, 7.0, 0.0],
            [1.0, 4.0, 7.0],
            [10.0, 2.0, 5.0],
            [8.0, 11.0, 3.0],
            [6.0, 9.0, 12.0],
            [1.0, 2.0, 3.0],
            [4.0, 5.0, 6.0],
            [7.0, 8.0, 9.0],
            [10.0, 11.0, 12.0],
        ];
        assert_eq!(results(Portable), expected.concat());
        assert!(
            Portable.all_equal(&[7; 4]) && !Portable.all_equal(&[7, 7, 7, 8]) && !Portable.all_equal(&[8, 7, 7, 7])
        );
        #[cfg(target_arch = "x86_64")]
        if let Some(wide) = pulp::x86::V3::try_new() {
            assert_eq!(results(wide), expected.concat());
            assert!(wide.all_equal(&[7; 4]) && !wide.all_equal(&[7, 7, 7, 8]) && !wide.all_equal(&[8, 7, 7, 7]));
        }
    }
}
