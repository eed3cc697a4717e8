//! The preconditioners by name, and what they cost.

/// Which preconditioner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PreconditionerKind {
    /// The identity.
    None,
    /// The diagonal of A.
    Jacobi,
    /// The 3×3 diagonal block of every particle.
    BlockJacobi,
    /// Algebraic multigrid, see [`multigrid`](crate::multigrid).
    Multigrid,
}

impl PreconditionerKind {
    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Jacobi => "jacobi",
            Self::BlockJacobi => "block-jacobi",
            Self::Multigrid => "multigrid",
        }
    }

    /// What an iteration costs, in products with A: measured on cloths and lattices of 10³ to 10⁵ particles, within a third.
    pub(super) const fn iteration_effort(self) -> f64 {
        match self {
            Self::None => 1.2,
            Self::Jacobi | Self::BlockJacobi => 1.4,
            Self::Multigrid => 9.0,
        }
    }
}

/// What recomputing the coarse levels of multigrid costs, in products with A: as much as twenty iterations.
pub(super) const MULTIGRID_SETUP: f64 = 180.0;
