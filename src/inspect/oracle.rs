//! Proofs of definiteness by factorizations of matrices on one pattern, analysed once.

use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::linear::{Ldlt, NonPositivePivot};
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use faer::Par;
use std::sync::Arc;

pub(super) struct Oracle {
    pub pattern: Arc<SpringPattern>,
    pub matrix: SystemMatrix,
    pub factorization: Ldlt,
}

impl Oracle {
    pub fn analyse(system: &System, par: Par, work: &mut Work) -> Result<Self> {
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let factorization = Ldlt::analyse(pattern.pattern(), par)?;
        work.symbolic_factorizations += 1;
        Ok(Self { matrix: SystemMatrix::zeros(pattern.clone()), pattern, factorization })
    }

    /// One with its own matrix and factor.
    pub fn sharing(&self) -> Result<Self> {
        let (pattern, factorization) = (self.pattern.clone(), Ldlt::sharing(&self.factorization)?);
        Ok(Self { matrix: SystemMatrix::zeros(pattern.clone()), pattern, factorization })
    }

    pub fn factor(&mut self, operator: &SystemOperator, work: &mut Work) -> Result<(), NonPositivePivot> {
        self.matrix.refill(operator);
        work.assemblies += 1;
        work.factorizations += 1;
        self.factorization.factor(self.matrix.matrix())
    }

    pub fn is_definite(&mut self, operator: &SystemOperator, work: &mut Work) -> bool {
        self.factor(operator, work).is_ok() && self.factorization.is_positive()
    }
}
