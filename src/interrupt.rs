//! A request to stop, for everything that may take long.
//!
//! Whoever computes looks at it between pieces of work that take well under a second, or one factorization, and ends in order. It
//! is handed on with the options, so the library keeps no state of its own and knows nothing of signals.

use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that someone else may raise; by default one that nobody can.
///
/// # Examples
/// ```
/// use sprung::interrupt::Interrupt;
/// use sprung::linear::SolverOptions;
/// use std::sync::atomic::{AtomicBool, Ordering};
///
/// static STOP: AtomicBool = AtomicBool::new(false);
/// let interrupt = Interrupt::on(&STOP);
/// // Handed on with the options, or asked between pieces of work of one's own.
/// let options = SolverOptions { interrupt, ..SolverOptions::default() };
/// STOP.store(true, Ordering::Relaxed);
/// assert!(options.interrupt.is_requested());
/// ```
#[derive(Clone, Copy, Default)]
pub struct Interrupt(Option<&'static AtomicBool>);

impl Interrupt {
    /// Never requested.
    pub const NEVER: Self = Self(None);

    /// Requested as soon as the flag is true.
    pub fn on(flag: &'static AtomicBool) -> Self {
        Self(Some(flag))
    }

    /// Whether to stop.
    #[inline]
    pub fn is_requested(self) -> bool {
        self.0.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}

/// Without the flag: whether one was given makes no difference to what is computed.
impl std::fmt::Debug for Interrupt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Interrupt")
    }
}

/// The same flag.
impl PartialEq for Interrupt {
    fn eq(&self, other: &Self) -> bool {
        match (self.0, other.0) {
            (None, None) => true,
            (Some(a), Some(b)) => std::ptr::eq(a, b),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Interrupt;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// Options with a flag and without one are written the same, and those without are equal.
    #[test]
    fn flags_do_not_show() {
        static FLAG: AtomicBool = AtomicBool::new(false);
        assert!(Interrupt::NEVER == Interrupt::default());
        assert_eq!([Interrupt::NEVER, Interrupt::on(&FLAG)].map(|flag| format!("{flag:?}")), ["Interrupt"; 2]);
    }

    #[test]
    fn a_raised_flag_is_a_request() {
        static FLAG: AtomicBool = AtomicBool::new(false);
        static OTHER: AtomicBool = AtomicBool::new(false);
        let interrupt = Interrupt::on(&FLAG);
        assert!(!interrupt.is_requested() && !Interrupt::NEVER.is_requested());
        FLAG.store(true, Ordering::Relaxed);
        assert!(interrupt.is_requested() && !Interrupt::default().is_requested());
        assert!(
            interrupt == Interrupt::on(&FLAG) && interrupt != Interrupt::on(&OTHER) && interrupt != Interrupt::NEVER
        );
    }
}
