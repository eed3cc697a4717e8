//! The smoother of a level, with the kernel that suits its blocks.

use super::block::Block;
use super::gauss_seidel::{BadBlock, GaussSeidel, General};
#[cfg(target_arch = "x86_64")]
use super::gauss_seidel::{Sixes, Symmetric};
use super::sparse::{Pattern, Rows};
use crate::error::Result;

/// Block Gauss–Seidel on a matrix of N × N blocks.
#[derive(Debug, Clone)]
pub(super) enum Smoother<const N: usize> {
    General(GaussSeidel<N, General>),
    /// All blocks are symmetric.
    #[cfg(target_arch = "x86_64")]
    Symmetric(GaussSeidel<N, Symmetric>),
    /// Blocks are six by six.
    #[cfg(target_arch = "x86_64")]
    Sixes(GaussSeidel<N, Sixes>),
}

/// Calls a method of the smoother, whatever its kernel.
macro_rules! with {
    ($smoother:expr, $inner:ident => $call:expr) => {
        match $smoother {
            Smoother::General($inner) => $call,
            #[cfg(target_arch = "x86_64")]
            Smoother::Symmetric($inner) => $call,
            #[cfg(target_arch = "x86_64")]
            Smoother::Sixes($inner) => $call,
        }
    };
}

impl<const N: usize> Smoother<N> {
    /// For matrices of a pattern, of which all blocks are symmetric or not.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    #[cfg_attr(not(target_arch = "x86_64"), expect(unused_variables, reason = "there is one kernel"))]
    pub fn new(pattern: &Pattern, is_symmetric: bool) -> Result<Self> {
        #[cfg(target_arch = "x86_64")]
        if let Some(kernel) = Symmetric::of(N).filter(|_| is_symmetric) {
            return Ok(Self::Symmetric(GaussSeidel::new(kernel, pattern)?));
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(kernel) = Sixes::of(N) {
            return Ok(Self::Sixes(GaussSeidel::new(kernel, pattern)?));
        }
        Ok(Self::General(GaussSeidel::new(General, pattern)?))
    }

    /// Takes over `factor·A`.
    ///
    /// # Errors
    /// The first diagonal block that is not positive definite.
    pub fn update(&mut self, a: &impl Rows<N>, factor: f64) -> Result<(), BadBlock> {
        with!(self, smoother => smoother.update(a, factor))
    }

    /// `D̃⁻¹` of a row of `factor·A`.
    #[inline(always)]
    pub fn inverse(&self, row: usize) -> Block<N, N, f32> {
        with!(self, smoother => smoother.inverse(row))
    }

    /// Calls `visit(column, block, D̃⁻¹ of that row)` for the blocks of a row of `factor·A` before the diagonal one.
    #[inline(always)]
    pub fn visit_before(&self, row: usize, visit: impl FnMut(usize, &Block<N, N, f32>, &Block<N, N, f32>)) {
        with!(self, smoother => smoother.visit_before(row, visit));
    }

    /// Whether a row has blocks outside its domain.
    #[inline(always)]
    pub fn is_at_border(&self, row: usize) -> bool {
        with!(self, smoother => smoother.is_at_border(row))
    }

    /// Rows of a domain; the last may have fewer.
    pub fn domain(&self) -> usize {
        with!(self, smoother => smoother.domain())
    }

    /// `x = M⁻¹ b`, a forward sweep from zero, and `r = b − A x`.
    pub fn forward(&mut self, b: &[[f32; N]], x: &mut [[f32; N]], r: &mut [[f32; N]]) {
        with!(self, smoother => smoother.forward(b, x, r));
    }

    /// `x += M⁻ᵀ (b − A x)`, a backward sweep.
    pub fn backward(&mut self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        with!(self, smoother => smoother.backward(b, x));
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        with!(self, smoother => smoother.bytes())
    }
}
