//! The lowest eigenvalue alone, for those who want no more: curves over the time step.

use super::search::{Digits, Search};
use super::spectrum::{LARGEST_DENSE, diagonalise};
use crate::assembly::SymmetricMatrix;
use crate::error::Result;
use crate::linear::Ldlt;
use crate::work::Work;
use faer::Par;

/// λ_min alone, in N/m; NaN where A is empty or has entries that are not finite.
///
/// # Errors
/// A matrix that is too large to factor.
///
/// # Examples
/// ```
/// use faer::Par;
/// use sprung::Stiffness;
/// use sprung::inspect::smallest_eigenvalue;
/// use sprung::integrate::StepMatrices;
/// use sprung::work::Work;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let step = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0)?;
/// // M/dt² = 1 N/m, and the spring under compression has k (1/l0 − 1/l) = −10 N/m across.
/// let smallest = smallest_eigenvalue(&step.a, Par::Seq, &mut Work::default())?;
/// assert!((smallest + 9.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn smallest_eigenvalue(a: &SymmetricMatrix, par: Par, work: &mut Work) -> Result<f64> {
    work.symbolic_factorizations += 1;
    Ok(smallest_eigenvalue_with(&mut Ldlt::analyse(a.pattern(), par)?, a, work))
}

/// As [`smallest_eigenvalue`], with a factorization that has been analysed before.
pub(super) fn smallest_eigenvalue_with(factorization: &mut Ldlt, a: &SymmetricMatrix, work: &mut Work) -> f64 {
    let n = a.dofs().len();
    if n == 0 || !a.norm_inf(&mut vec![0.0; n]).is_finite() {
        return f64::NAN;
    }
    if n <= LARGEST_DENSE
        && let Some(eigen) = diagonalise(a)
    {
        return eigen.eigenvalues.min();
    }
    let mut search = Search::new(a, a, factorization, work);
    let ends = search.ends();
    search.lowest(0, 1, Digits::All, &ends).first().map_or(f64::NAN, |pair| pair.value)
}
