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

/// Bytes of a cache line, on nearly all processors.
const LINE: usize = 64;

/// Asks for all memory of some numbers that follow each other, a line at a time. The last line may be left to what follows.
#[inline(always)]
pub(crate) fn prefetch_all<T>(values: &[T]) {
    values.iter().step_by((LINE / size_of::<T>()).max(1)).for_each(prefetch);
}
