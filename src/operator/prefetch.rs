//! A hint to the processor that memory will be read soon.

/// Asks for the cache line in which `value` begins. Changes nothing but time; does nothing where there is no such hint.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) fn prefetch<T>(value: &T) {
    safe_arch::prefetch_t0(value);
}

/// Does nothing: this architecture's prefetch cannot be reached without unsafe code.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(crate) fn prefetch<T>(_: &T) {}
