//! The preconditioners by name.

/// Which preconditioner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
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
    /// Every kind.
    pub const ALL: [Self; 4] = [Self::None, Self::Jacobi, Self::BlockJacobi, Self::Multigrid];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Jacobi => "jacobi",
            Self::BlockJacobi => "block-jacobi",
            Self::Multigrid => "multigrid",
        }
    }
}
