//! The widest registers that the processor has, for loops that the compiler makes use of them in.
//!
//! What is compiled for every kind of processor that [`pulp`] tells apart is what is inlined. The results are the same to the bit, because
//! nothing is reordered or fused.

/// A closure is called by reference: taken by value it goes through a function of its own, which is compiled for no kind in particular.
struct Widely<'f, F>(&'f mut F);

impl<R, F: FnMut() -> R> pulp::NullaryFnOnce for Widely<'_, F> {
    type Output = R;

    #[inline(always)]
    fn call(self) -> R {
        (self.0)()
    }
}

/// Does something with the widest registers; the closure, and what it calls, is to be inlined always.
pub(crate) fn widely<R>(mut f: impl FnMut() -> R) -> R {
    pulp::Arch::new().dispatch(Widely(&mut f))
}
