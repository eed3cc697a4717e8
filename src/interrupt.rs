//! Requests to stop a long computation.
//!
//! Computations check the flag between pieces of work that take less than a second, or one factorization. It is part of the options, so the
//! library has no global state and installs no signal handlers.

use std::sync::atomic::{AtomicBool, Ordering};

/// A shared flag that requests a computation to stop. The default is never requested.
///
/// # Examples
/// ```
/// use sprung::interrupt::Interrupt;
/// use sprung::linear::SolverOptions;
/// use std::sync::atomic::{AtomicBool, Ordering};
///
/// static STOP: AtomicBool = AtomicBool::new(false);
/// let interrupt = Interrupt::on(&STOP);
/// // Part of the options; your own code may check it too.
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

    /// True if the computation is to stop.
    #[inline]
    pub fn is_requested(self) -> bool {
        self.0.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}

/// Omits the flag, which does not affect results.
impl std::fmt::Debug for Interrupt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Interrupt")
    }
}

/// Equal if both refer to the same flag, or to none.
impl PartialEq for Interrupt {
    fn eq(&self, other: &Self) -> bool {
        self.0.map(std::ptr::from_ref) == other.0.map(std::ptr::from_ref)
    }
}

#[cfg(test)]
mod tests {
    use super::Interrupt;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn a_raised_flag_is_a_request_and_does_not_show() {
        static FLAG: AtomicBool = AtomicBool::new(false);
        static OTHER: AtomicBool = AtomicBool::new(false);
        let interrupt = Interrupt::on(&FLAG);
        assert!(!interrupt.is_requested() && !Interrupt::NEVER.is_requested());
        FLAG.store(true, Ordering::Relaxed);
        assert!(interrupt.is_requested() && !Interrupt::default().is_requested());
        assert!(interrupt == Interrupt::on(&FLAG) && Interrupt::NEVER == Interrupt::default());
        assert!(interrupt != Interrupt::on(&OTHER) && interrupt != Interrupt::NEVER);
        assert_eq!([Interrupt::NEVER, interrupt].map(|flag| format!("{flag:?}")), ["Interrupt"; 2]);
    }
}
