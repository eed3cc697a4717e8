//! The parts of a set-up and of a cycle, told one by one to whoever measures them.

/// A stretch of work of [`Multigrid`](super::Multigrid) that has just been done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Part {
    /// Set-up: the prolongator of the finest level.
    Prolongator,
    /// Set-up: the matrix of the first coarse level.
    CoarseMatrix,
    /// Set-up: all levels below the finest one.
    CoarseSetup,
    /// Cycle: vectors to and from single precision.
    Conversion,
    /// Cycle: a sweep over the finest level, or the only level there is.
    Smoothing,
    /// Cycle: from the finest level to the next one, or back.
    Transfer,
    /// Cycle: all levels below the finest one.
    CoarseLevels,
}

/// Is told what has been done.
pub(super) type SpringVisitor<'w> = &'w mut dyn FnMut(Part);
