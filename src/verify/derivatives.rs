//! The checks of forces, blocks and matrices against derivatives, on a scene.

use super::check::Measured;
use super::consistency::{damping_dissipates, damping_entries, energy_slope};
use super::dual::{damping_turns, force_against_energy};
use super::free_coordinates::{damping_force, elastic_energy, elastic_force, reduce};
use super::jacobian::{JacobianOptions, check_jacobian};
use super::stiffness::{blocks_against_duals, spring_blocks, stiffness_against_duals, stiffness_entries};
use super::v_curve::v_curve;
use super::{Check, Claim, TestCase};
use crate::integrate::StepMatrices;
use crate::spring::{Extension, Spring, Stiffness};
use nalgebra::Matrix3;

/// Free coordinates up to which every column is also measured on its own, trusting no pattern.
const ONE_BY_ONE_LIMIT: usize = 120;

/// K under the full stiffness along random directions, entry by entry, and spring by spring.
pub(super) fn jacobian(case: &TestCase) -> Measured {
    let TestCase { name, system, state, dt } = case;
    let k = StepMatrices::assemble(system, state, Stiffness::Full, *dt)?.k;
    let block =
        |spring: &Spring, at: &Extension| -> Matrix3<f64> { spring.stiffness_block(at, Stiffness::Full).matrix() };
    let mut checks = v_curve(system, state, elastic_force(system, state), &k, name);
    checks.push(stiffness_entries(system, state, elastic_force(system, state), &k.to_csc(), name));
    checks.push(stiffness_against_duals(system, state, &k.to_csc(), name));
    checks.push(spring_blocks(system, state, block, name));
    checks.extend(blocks_against_duals(system, state, block, name));
    if system.dofs().len() <= ONE_BY_ONE_LIMIT {
        let options = JacobianOptions { springs: Some((system, state)), ..JacobianOptions::default() };
        let x = reduce(system, &state.positions);
        let report = check_jacobian(elastic_force(system, state), &k, &x, &options)?;
        checks.push(match report.unmeasurable() {
            Some(reason) => Check::not_judged(Claim::Jacobian, "Jacobian against its force", name, reason),
            None => report.to_check(name),
        });
    }
    Ok(checks)
}

/// The terms that `tension` and `axial` drop from K, and that `absolute` takes twice.
pub(super) fn dropped_terms(case: &TestCase) -> Measured {
    let TestCase { name, system, state, dt } = case;
    let mut checks = Vec::new();
    for option in [Stiffness::Tension, Stiffness::Axial, Stiffness::Absolute] {
        let k = StepMatrices::assemble(system, state, option, *dt)?.k;
        checks.extend(super::dropped_terms(system, state, elastic_force(system, state), option, &k, name));
    }
    Ok(checks)
}

/// The elastic force against its energy, and G against the damping force.
pub(super) fn consistency(case: &TestCase) -> Measured {
    let TestCase { name, system, state, dt } = case;
    let mut force = vec![0.0; system.dofs().len()];
    elastic_force(system, state)(&reduce(system, &state.positions), &mut force);
    let mut checks = vec![
        force_against_energy(system, state, &force, name),
        energy_slope(system, state, elastic_energy(system, state), &force, name),
    ];
    if system.is_damped() {
        let g = StepMatrices::assemble(system, state, Stiffness::Full, *dt)?.g;
        checks.push(damping_entries(system, state, damping_force(system, state), &g.to_csc(), name));
        checks.push(damping_dissipates(system, &g, name));
        checks.push(damping_turns(system, state, name));
    }
    Ok(checks)
}
