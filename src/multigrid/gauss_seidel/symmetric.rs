//! Symmetric blocks of three axes, as springs between particles that can move along all of them have.
//!
//! Six numbers say such a block: its diagonal d and, beside it, o = (xy, yz, zx). With τ(x, y, z) = (y, z, x)
//!
//! ```text
//! A v = d ∘ v + o ∘ τv + τ²(o ∘ v),   ∘ number by number,
//! ```
//!
//! so that a vector takes one register, a block six numbers, and the same product serves A and Aᵀ. τ² is left until a sum is complete. Where all is in the caches, a sweep of a
//! cloth takes half the time that it takes by rows of 3 × 3 numbers.

use super::super::block::Block;
use super::kernel::Kernel;
use crate::operator::prefetch_all;
use pulp::cast;
use pulp::x86::V3;
use std::arch::x86_64::__m128;

/// For processors that multiply and add in one operation.
#[derive(Debug, Clone, Copy)]
pub struct Symmetric(V3);

/// d and o. Registers are loaded with a number more, which the zero behind a vector takes out of products.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SymmetricBlock([f32; 6]);

impl SymmetricBlock {
    /// d.
    #[inline(always)]
    fn diagonal(&self) -> __m128 {
        let Self([xx, yy, zz, xy, ..]) = *self;
        cast([xx, yy, zz, xy])
    }

    /// A number, and o behind it.
    #[inline(always)]
    fn behind(&self) -> __m128 {
        let Self([.., zz, xy, yz, zx]) = *self;
        cast([zz, xy, yz, zx])
    }
}

/// A vector with a zero behind it.
#[derive(Debug, Clone, Copy)]
#[repr(align(16))]
pub struct Three([f32; 4]);

impl Three {
    #[inline(always)]
    fn register(self) -> __m128 {
        cast(self.0)
    }
}

/// What of a sum is as it is, what is to be added, and what is to be turned twice before.
#[derive(Debug, Clone, Copy)]
pub struct Sum([__m128; 3]);

impl Symmetric {
    /// For blocks of so many axes, if they are three and the processor is such a one.
    pub fn of(axes: usize) -> Option<Self> {
        V3::try_new().filter(|_| axes == 3).map(Self)
    }

    /// o.
    #[inline(always)]
    fn beside(self, block: &SymmetricBlock) -> __m128 {
        self.0.avx._mm_permute_ps::<0b00_11_10_01>(block.behind())
    }

    /// τ²o.
    #[inline(always)]
    fn beside_turned_twice(self, block: &SymmetricBlock) -> __m128 {
        self.0.avx._mm_permute_ps::<0b00_10_01_11>(block.behind())
    }

    #[inline(always)]
    fn turned(self, vector: __m128) -> __m128 {
        self.0.avx._mm_permute_ps::<0b11_00_10_01>(vector)
    }

    #[inline(always)]
    fn turned_twice(self, vector: __m128) -> __m128 {
        self.0.avx._mm_permute_ps::<0b11_01_00_10>(vector)
    }
}

impl<const N: usize> Kernel<N> for Symmetric {
    type Block = SymmetricBlock;
    type Vector = Three;
    type Sum = Sum;

    #[inline(always)]
    fn keep(self, block: &Block<N, N, f32>) -> SymmetricBlock {
        match *block.as_flattened() {
            [xx, xy, _, _, yy, yz, zx, _, zz] => SymmetricBlock([xx, yy, zz, xy, yz, zx]),
            _ => SymmetricBlock([0.0; 6]),
        }
    }

    #[inline(always)]
    fn block(self, kept: &SymmetricBlock) -> Block<N, N, f32> {
        let SymmetricBlock([xx, yy, zz, xy, yz, zx]) = *kept;
        let rows = [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]];
        std::array::from_fn(|r| std::array::from_fn(|c| rows[r][c]))
    }

    #[inline(always)]
    fn ask_for(self, blocks: &[SymmetricBlock]) {
        prefetch_all(blocks);
    }

    #[inline(always)]
    fn vector(self, numbers: [f32; N]) -> Three {
        Three(std::array::from_fn(|axis| numbers.get(axis).copied().unwrap_or(0.0)))
    }

    #[inline(always)]
    fn numbers(self, vector: Three) -> [f32; N] {
        std::array::from_fn(|axis| vector.0[axis])
    }

    #[inline(always)]
    fn begin(self, b: Three) -> Sum {
        let nothing = cast([0f32; 4]);
        Sum([b.register(), nothing, nothing])
    }

    #[inline(always)]
    fn subtract(self, Sum(sum): &mut Sum, a: &SymmetricBlock, x: Three) {
        let (fma, [d, o], x) = (self.0.fma, [a.diagonal(), self.beside(a)], x.register());
        sum[0] = fma._mm_fnmadd_ps(d, x, sum[0]);
        sum[1] = fma._mm_fnmadd_ps(o, self.turned(x), sum[1]);
        sum[2] = fma._mm_fnmadd_ps(o, x, sum[2]);
    }

    #[inline(always)]
    fn apply(self, a: &SymmetricBlock, Sum([plain, more, turned]): Sum) -> Three {
        let (sse, fma, [d, o]) = (self.0.sse, self.0.fma, [a.diagonal(), self.beside(a)]);
        let v = sse._mm_add_ps(sse._mm_add_ps(plain, self.turned_twice(turned)), more);
        let product = fma._mm_fmadd_ps(o, self.turned(v), sse._mm_mul_ps(d, v));
        Three(cast(sse._mm_add_ps(product, self.turned_twice(sse._mm_mul_ps(o, v)))))
    }

    #[inline(always)]
    fn subtract_transposed(self, y: &mut Three, a: &SymmetricBlock, x: Three) {
        let (fma, [d, o], x) = (self.0.fma, [a.diagonal(), self.beside(a)], x.register());
        let sum = fma._mm_fnmadd_ps(d, x, y.register());
        let sum = fma._mm_fnmadd_ps(o, self.turned(x), sum);
        *y = Three(cast(fma._mm_fnmadd_ps(self.beside_turned_twice(a), self.turned_twice(x), sum)));
    }
}
