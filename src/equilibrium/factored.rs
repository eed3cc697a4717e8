//! Directions of Newton's method by factorizations of −K.

use super::search::{NEAR, SINGULAR, Search, Solver};
use crate::assembly::SymmetricMatrix;
use crate::eigen::Pencil;
use crate::error::Result;
use crate::integrate::StiffnessPolicy;
use crate::spring::Stiffness;

impl Search<'_> {
    /// p of `−K p = f`. Where −K is singular by free motions alone, a shift of rounding makes it positive definite. Where it has negative
    /// eigenvalues, option *tension* takes its place far from an equilibrium, of the springs at large residuals alone under the progressive policy,
    /// and −K + σ near one, where *tension* is far too stiff along soft directions, σ about the smallest that makes it positive definite. Returns
    /// whether it was that shift.
    pub(super) fn factored_step(&mut self) -> Result<(Vec<f64>, bool)> {
        let policy = self.options.stiffness;
        let is_near = self.residual() < NEAR && !matches!(policy, StiffnessPolicy::Always(_));
        let (mut a, mut dropped) = match policy {
            StiffnessPolicy::Always(option) => (self.assemble(option)?, 0),
            StiffnessPolicy::OnDemand => (self.assemble(Stiffness::Full)?, 0),
            StiffnessPolicy::Progressive => {
                if is_near {
                    self.projection.restart();
                }
                self.projection.begin(self.system, &self.system.dofs().full(&self.force));
                self.assemble_projected()?
            }
        };
        if self.factor(&a) {
            return Ok((self.solve(), false));
        }
        let norm = Some(Pencil::of(&a).norm()).filter(|norm| *norm > 0.0).unwrap_or(self.acting);
        let mut added = 0.0;
        if self.is_free {
            added = SINGULAR * norm;
            a.shift(added);
            if self.factor(&a) {
                return Ok((self.solve(), false));
            }
        }
        let compressed = self.geometry.compressed(self.system);
        while policy == StiffnessPolicy::Progressive
            && !is_near
            && self.projection.lower(self.system, &self.geometry, dropped, compressed)
        {
            (a, dropped) = self.assemble_projected()?;
            a.shift(added);
            if self.factor(&a) {
                return Ok((self.solve(), false));
            }
        }
        if !is_near && !matches!(policy, StiffnessPolicy::Always(_)) {
            a = self.assemble(Stiffness::Tension)?;
            added = 0.0;
            if self.factor(&a) {
                return Ok((self.solve(), false));
            }
        }
        let [mut shift, growth] =
            if is_near { [(0.125 * self.shift).max(1e-8 * norm), 4.0] } else { [1e-9 * norm, 100.0] };
        while shift < norm {
            a.shift(shift - added);
            added = shift;
            if self.factor(&a) {
                self.shift = shift;
                return Ok((self.solve(), is_near));
            }
            shift *= growth;
        }
        Ok((self.force.clone(), false))
    }

    pub(super) fn assemble(&mut self, option: Stiffness) -> Result<SymmetricMatrix> {
        self.work.assemblies += 1;
        self.matrices.update(&self.state, option)?;
        Ok(self.matrices.k().scaled(-1.0))
    }

    /// −K without the terms that the threshold of residuals drops, and their number.
    fn assemble_projected(&mut self) -> Result<(SymmetricMatrix, usize)> {
        self.work.assemblies += 1;
        let dropped = self.projection.update(self.system, &self.geometry);
        self.matrices.update_each(&self.state, self.projection.options())?;
        Ok((self.matrices.k().scaled(-1.0), dropped))
    }

    pub(super) fn factor(&mut self, a: &SymmetricMatrix) -> bool {
        let Solver::Factored(cholesky) = &mut self.solver else { return false };
        self.work.factorizations += 1;
        cholesky.factor(a).is_ok()
    }

    pub(super) fn solve(&mut self) -> Vec<f64> {
        let mut step = self.force.clone();
        if let Solver::Factored(cholesky) = &mut self.solver {
            self.work.solves += 1;
            cholesky.substitute_columns(step.len(), &mut step);
        }
        step
    }
}
