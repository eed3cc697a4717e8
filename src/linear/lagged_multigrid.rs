//! Multigrid whose coarse levels lag behind the matrix as long as that pays.
//!
//! The finest level always has the current matrix. The coarse levels are recomputed when the iterations that their age has cost add up to the cost of
//! recomputing them, which is at most twice the work of the best choice (the ski-rental argument). All is counted in iterations, not seconds, so that
//! runs are repeatable.

use super::outcome::{Evidence, SolveFailure};
use crate::error::Result;
use crate::multigrid::{Multigrid, SetupFailure};
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use nalgebra::Vector3;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Coarse {
    /// Never computed, or failed.
    Missing,
    /// Not used yet.
    New,
    /// Iterations per digit when they were new, and iterations lost to their age since.
    Used { per_digit: f64, lost: f64 },
}

/// Multigrid that keeps its coarse levels from one matrix to the next.
#[derive(Debug)]
pub struct LaggedMultigrid {
    multigrid: Multigrid,
    coarse: Coarse,
}

impl LaggedMultigrid {
    /// Analyses a system, see [`Multigrid::new`].
    ///
    /// # Errors
    /// More matrix blocks than 32-bit indices can count.
    pub fn new(system: &System) -> Result<Self> {
        Ok(Self { multigrid: Multigrid::new(system)?, coarse: Coarse::Missing })
    }

    /// See [`Multigrid::set_positions`].
    pub fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        self.multigrid.set_positions(positions);
    }

    /// Sets the matrix, with new coarse levels where the old ones have cost too much; counts a set-up.
    ///
    /// # Errors
    /// A matrix that is found not to be positive definite, or not finite.
    pub fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.multigrid.refill(a)?;
        // Recomputing costs 10 to 12 iterations by `cargo bench --bench multigrid`, less a margin for motions that go on ageing them.
        if matches!(self.coarse, Coarse::Used { lost, .. } if lost < 8.0) {
            return Ok(());
        }
        work.multigrid_setups += 1;
        self.coarse = Coarse::Missing;
        self.multigrid.rebuild(a)?;
        self.coarse = Coarse::New;
        Ok(())
    }

    /// Records the iterations of a solve that gained so many decimal digits.
    pub fn record(&mut self, iterations: u64, digits: f64) {
        // After a good first guess the rate is not representative.
        if digits.is_nan() || digits < 1.0 {
            return;
        }
        match &mut self.coarse {
            Coarse::Missing => {}
            Coarse::New => self.coarse = Coarse::Used { per_digit: iterations as f64 / digits, lost: 0.0 },
            Coarse::Used { per_digit, lost } => *lost += (iterations as f64 - *per_digit * digits).max(0.0),
        }
    }

    /// See [`Multigrid::apply`].
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        self.multigrid.apply(r, z);
    }
}

impl From<SetupFailure> for SolveFailure {
    fn from(failure: SetupFailure) -> Self {
        Self::Indefinite(match failure {
            SetupFailure::NonFinite => return Self::NonFinite,
            SetupFailure::Pivot(dof) => Evidence::Pivot(dof),
            SetupFailure::DiagonalBlock(dof) => Evidence::DiagonalBlock(dof),
            SetupFailure::CoarseLevel { level, dof } => Evidence::CoarseLevel { level, dof },
        })
    }
}

#[cfg(feature = "scene")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::SpringGeometry;
    use crate::operator::Combination;
    use crate::scene::builtin::cloth;
    use crate::spring::Stiffness;

    fn used(per_digit: f64, lost: f64) -> Coarse {
        Coarse::Used { per_digit, lost }
    }

    /// On a small system, with coarse levels of a given age.
    fn aged(coarse: Coarse) -> LaggedMultigrid {
        let (system, _) = cloth(3).unwrap().build().unwrap();
        LaggedMultigrid { coarse, ..LaggedMultigrid::new(&system).unwrap() }
    }

    /// Coarse levels are recomputed as soon as eight iterations are lost, and where there are none that a solve has used.
    #[test]
    fn coarse_levels_last_until_their_price_is_lost() {
        let (system, state) = cloth(3).unwrap().build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
        for (before, setups, after) in [
            (Coarse::Missing, 1, Coarse::New),
            (Coarse::New, 1, Coarse::New),
            (used(3.0, 0.0), 0, used(3.0, 0.0)),
            (used(3.0, 7.75), 0, used(3.0, 7.75)),
            (used(3.0, 8.0), 1, Coarse::New),
            (used(3.0, 8.25), 1, Coarse::New),
        ] {
            let (mut multigrid, mut work) = (aged(before), Work::default());
            multigrid.update(&a, &mut work).unwrap();
            assert_eq!((work.multigrid_setups, multigrid.coarse), (setups, after), "{before:?}");
        }
        // A negative mass shows on the finest level.
        let negative = Combination { mass: -1.0, damping: 0.0, stiffness: 0.0 };
        let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, negative);
        assert!(matches!(aged(Coarse::New).update(&a, &mut Work::default()), Err(SolveFailure::Indefinite(_))));
    }
}
