//! Loops compiled for the widest vector registers that the processor has.
//!
//! Inlined code is compiled for every kind of processor that [`pulp`] distinguishes, without reordering or fusing: the results are the same to the
//! bit.

/// Calls the closure by reference: a closure taken by value would be compiled once, for no processor in particular.
struct ByReference<'f, F>(&'f mut F);

impl<R, F: FnMut() -> R> pulp::NullaryFnOnce for ByReference<'_, F> {
    type Output = R;

    #[inline(always)]
    fn call(self) -> R {
        (self.0)()
    }
}

/// Runs a closure, which must be `#[inline(always)]` with all it calls, compiled for the widest registers.
pub(crate) fn dispatch_simd<R>(mut f: impl FnMut() -> R) -> R {
    pulp::Arch::new().dispatch(ByReference(&mut f))
}
