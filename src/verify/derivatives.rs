//! All checks of derivatives on one scene, fed with the crate's own forces and matrices.

use super::check::Check;
use super::claim::Claim;
use super::consistency::{damping_dissipates, damping_entries, energy_slope};
use super::difference::{spring_blocks, stiffness_entries};
use super::dropped::dropped_terms;
use super::dual::{blocks_against_duals, force_against_energy, stiffness_against_duals};
use super::jacobian::{JacobianOptions, check_jacobian};
use super::reduced::{damping_force, elastic_energy, elastic_force, reduce};
use super::v_curve::v_curve;
use crate::error::{Error, Result};
use crate::integrate::StepMatrices;
use crate::spring::Stiffness;
use crate::system::{State, System};

/// Free coordinates up to which every column is measured on its own, trusting no pattern.
const ONE_BY_ONE_LIMIT: usize = 120;

/// K and K^s at a state: every spring and every entry against differences and dual numbers, the V-curve, what `tension`
/// and `axial` drop, and on small scenes the public checker. None where nothing can move.
pub fn jacobian_checks(system: &System, state: &State, dt: f64, scene: &str) -> Vec<Check> {
    let checks = || -> Result<Vec<Check>> {
        let k = StepMatrices::assemble(system, state, Stiffness::Full, dt)?.k;
        let whole = k.to_csc();
        let force = || elastic_force(system, state);
        let block = |spring: &crate::Spring, at: &_| spring.stiffness_block(at, Stiffness::Full).matrix();
        let mut checks = vec![spring_blocks(system, state, block, scene)];
        checks.extend(blocks_against_duals(system, state, block, scene));
        checks.push(stiffness_entries(system, state, force(), &whole, scene));
        checks.push(stiffness_against_duals(system, state, &whole, scene));
        checks.extend(v_curve(system, state, force(), &k, scene));
        for option in [Stiffness::Tension, Stiffness::Axial] {
            let k = StepMatrices::assemble(system, state, option, dt)?.k;
            checks.extend(dropped_terms(system, state, force(), option, &k, scene));
        }
        if whole.nrows() <= ONE_BY_ONE_LIMIT {
            let options = JacobianOptions { springs: Some((system, state)), ..JacobianOptions::default() };
            let report = check_jacobian(force(), whole, &reduce(system, &state.positions), &options)?;
            checks.push(report.to_check(scene));
        }
        Ok(checks)
    };
    unless_rigid(system, Claim::Jacobian, scene, checks)
}

/// G, f_d, f_el and U at a state: each against the function that it derives from. None where nothing can move.
pub fn consistency_checks(system: &System, state: &State, dt: f64, scene: &str) -> Vec<Check> {
    let checks = || -> Result<Vec<Check>> {
        let g = StepMatrices::assemble(system, state, Stiffness::Full, dt)?.g;
        let mut force = vec![0.0; system.dofs().len()];
        elastic_force(system, state)(&reduce(system, &state.positions), &mut force);
        Ok(vec![
            damping_entries(system, state, damping_force(system, state), &g.to_csc(), scene),
            damping_dissipates(system, &g, scene),
            force_against_energy(system, state, &force, scene),
            energy_slope(system, state, elastic_energy(system, state), &force, scene),
        ])
    };
    unless_rigid(system, Claim::Consistency, scene, checks)
}

/// Runs checks where anything can move; what cannot be run fails with the reason.
pub(super) fn unless_rigid(
    system: &System,
    claim: Claim,
    scene: &str,
    checks: impl FnOnce() -> Result<Vec<Check>>,
) -> Vec<Check> {
    if system.dofs().is_empty() {
        return Vec::new();
    }
    let failed = |error: Error| vec![Check::new(claim, "could be run", scene, f64::NAN, 0.0, error.to_string())];
    checks().unwrap_or_else(failed)
}
