//! Energies and damping against the forces: G and the energy's gradient by central differences, energies as work.
//!
//! From x to x + w the elastic energy grows by `−∫₀¹ f_el(x + s w)·w ds`, the gravitational one by `−Σ m gravity·w`. Gauss's quadrature with eight
//! nodes is exact to rounding as long as no spring changes by more than a twentieth: its integrand is analytic far around the interval.

use super::coloring::ForceAt;
use super::comparison::check_square;
use super::dual::{damping_turns, force_against_energy};
use super::force_error::Step;
use super::free_coordinates::{damping_force, elastic_energy, elastic_force, moved};
use super::reference::{self, active_links, field, sizes};
use super::{
    Check, Claim, ColumnGroups, ForceError, Link, Measured, SECOND, TestCase, U, VECTORS, WorstEntries, expand,
    random_vector, ratio, reduce, worst,
};
use crate::error::{Result, check_length};
use crate::force::{Energy, SpringGeometry, add_elastic_force, add_weight};
use crate::integrate::StepMatrices;
use crate::operator::LinearOperator;
use crate::spring::Stiffness;
use crate::system::{Dof, State, System};
use nalgebra::Vector3;
use nalgebra_sparse::CscMatrix;

pub(super) fn derivatives(case: &TestCase) -> Measured {
    let TestCase { system, state, dt, .. } = case;
    let mut force = vec![0.0; system.dofs().len()];
    elastic_force(system, state)(&reduce(system, &state.positions), &mut force);
    let energy = elastic_energy(system, state);
    let mut checks = vec![force_against_energy(case, &force)?, energy_slope(case, energy, &force)?];
    if system.is_damped() {
        let g = StepMatrices::assemble(system, state, Stiffness::Full, *dt)?.g;
        checks.extend([damping_entries(case, &g.to_csc())?, damping_dissipates(case, &g)?, damping_turns(case)?]);
    }
    Ok(checks)
}

/// Compares every entry of G with the central difference of the damping force by velocity.
///
/// `damping` is the whole G under test, in N·s/m. Value: the largest error as a multiple of rounding. Sees every fault of an entry above 1e-14 of the
/// dampers at its particle, damping counted twice or of undamped springs; is blind to a direction n that is wrong in both.
///
/// # Errors
/// A matrix of another size.
pub fn damping_entries(case: &TestCase, damping: &CscMatrix<f64>) -> Result<Check> {
    let TestCase { name, system, state, .. } = case;
    check_square("damping", damping, system.dofs().len())?;
    let links = active_links(system, &state.positions);
    let springs = sizes(&links, system.particles(), |_| 1.0);
    let units = sizes(&links, system.particles(), |link| U * link.damping).into_iter().zip(springs);
    let allowed: Vec<f64> = units.map(|(unit, springs)| unit * (80.0 + 2.0 * springs)).collect();
    let dofs: Vec<Dof> = system.dofs().iter().collect();
    let mut force = ForceAt { force: damping_force(system, state), x: reduce(system, &state.velocities) };
    let fastest = worst(state.velocities.iter().map(|v| v.amax()).chain([0.0]));
    let h = if fastest > 0.0 { fastest } else { 1.0 };
    let groups = ColumnGroups::of_system(system);
    let differences = |group: &[usize]| force.differences(group, |_, v| Step::around(v, h));
    let mut entries = WorstEntries::new();
    entries.compare_differences(damping, &groups, differences, |row, _, _| allowed[dofs[row].particle]);
    let why = "1 is rounding: 80 u b for every damper of a particle and u of each sum, as f_d is linear in v and h is as large \
        as the velocities; no truncation";
    let check = Check::new(Claim::Consistency, "G against ∂f_d/∂v", name, entries.worst, 1.0, why);
    Ok(check.with_table(entries.into_table(|entry| entry)))
}

/// Checks that damping only takes energy out: `vᵀG v ≤ 0` for random velocities, relative to `Σ b (‖v_i‖ + ‖v_j‖)²`.
///
/// Sees a wrong sign of G; is blind to its size.
///
/// # Errors
/// A G of another order.
pub fn damping_dissipates(case: &TestCase, damping: &impl LinearOperator) -> Result<Check> {
    let (system, n) = (&case.system, case.system.dofs().len());
    check_length("damping", damping.order(), n)?;
    let power = |seed| {
        let v = random_vector(n, seed);
        let mut f = vec![0.0; n];
        damping.apply(&v, &mut f);
        let scale = system.active().map(|(_, ends, spring)| {
            let [vi, vj] = ends.map(|end| system.dofs().get(&v, end).norm());
            spring.damping * (vi + vj).powi(2)
        });
        ratio(v.iter().zip(&f).map(|(v, f)| v * f).sum(), scale.sum())
    };
    let value = worst((0..VECTORS).map(power));
    let why = "vᵀG v is a sum of −b (nᵀδv)², never positive, each rounded a few times: 32 u of Σ b δv²";
    Ok(Check::new(Claim::Consistency, "damping takes energy out", &case.name, value, 32.0 * U, why))
}

/// Compares the elastic force with the slope of the elastic energy, `f·w = −dU(x + s w)/ds`, by central differences.
///
/// `energy` is U over the free coordinates, in J; `force` is f_el under test, in N. Value: the largest error over random directions as a multiple of
/// truncation and rounding of the whole sum. Sees a force or an energy that is wrong somewhere by more than about 1e-8 of the whole; is blind to
/// faults of single weak springs in large scenes, which [`force_against_energy`] sees.
///
/// # Errors
/// Coincident ends of a spring; a force of another length.
pub fn energy_slope(case: &TestCase, mut energy: impl FnMut(&[f64]) -> f64, force: &[f64]) -> Result<Check> {
    let TestCase { name, system, state, .. } = case;
    check_length("force", force.len(), system.dofs().len())?;
    let error = ForceError::new(system, &state.positions)?;
    let x = reduce(system, &state.positions);
    let (mut value, mut relative) = (0.0, 0.0);
    let energy_here = energy(&x);
    for seed in 0..VECTORS {
        let w = error.direction(seed);
        let moves = expand(system, &w);
        // The factor of h² in the truncation, at the lengths that h = 1/8 leaves, the rounding of the energies, that of the middle of the two points,
        // and the size of the terms of f·w.
        let (mut curvature, mut springs, mut middle, mut scale) = (0.0, 0.0, 0.0, 0.0);
        for link in &error.links {
            let (l, a, c) = (link.length, link.axial, link.curved);
            let delta = link.difference(&moves).norm();
            let elongation = link.elongation().abs() + 0.125 * delta;
            curvature += SECOND * c * delta.powi(3) / (6.0 * (l - 0.125 * delta).powi(2));
            springs += U * a * elongation * (4.0 * (l + delta) + 6.0 * elongation);
            scale += delta * (a * l).max(c);
            let [xi, xj] = link.ends.map(|end| state.positions[end].norm());
            middle += 2.0 * U * (xi + xj) * delta * (link.block_rounding() / (12.0 * U));
        }
        let rounding = springs + U * system.springs().len() as f64 * energy_here;
        let product: f64 = force.iter().zip(&w).map(|(f, w)| (f * w).abs()).sum();
        let own: f64 = moves.iter().zip(&error.rounding).map(|(w, rounding)| rounding * w.norm() * 2.0).sum();
        let slope = middle + own + U * force.len() as f64 * product;
        // The smallest h at which x ± h w is resolved; zero without a spring, whose shortest length is infinite.
        let resolved = (0..moves.len()).map(|p| 128.0 * U * state.positions[p].amax() / error.shortest(p));
        let resolved = resolved.fold(0.0, f64::max).min(0.125);
        let h = (rounding / (2.0 * curvature)).cbrt();
        let h = if h.is_finite() { h.clamp(resolved, 0.125) } else { 0.125 };
        let (ahead, behind) = (moved(&x, &w, h), moved(&x, &w, -h));
        let difference = energy(&ahead) - energy(&behind);
        let work: f64 = ahead.iter().zip(&behind).zip(force).map(|((a, b), f)| (a - b) * f).sum();
        let mismatch = (difference + work).abs() / (2.0 * h);
        relative = worst([relative, mismatch / scale]);
        value = worst([value, ratio(mismatch, curvature * h * h + rounding / h + slope)]);
    }
    let why = format!(
        "1 is truncation (2/√3) k h² δ³/(6 (l − hδ)²) of each spring and rounding of U, u for each spring of the sum, over h; \
         the mismatch is {relative:.1e} of Σ k δ"
    );
    Ok(Check::new(Claim::Consistency, "f against −∇U by differences", name, value, 1.0, why))
}

/// Nodes in (0, 1) and weights of Gauss's quadrature with eight points (Abramowitz and Stegun, table 25.4), one half.
const NODES: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_3),
];

pub(super) fn work_energy(case: &TestCase) -> Measured {
    let TestCase { system, state, .. } = case;
    let links = reference::links(system, &state.positions);
    let shortest = links.iter().map(|link| link.length).fold(f64::INFINITY, f64::min);
    let shortest = if shortest.is_finite() { shortest } else { case.extent() };
    // Both ends move by at most 3^(1/2) of a component each.
    let free: Vec<f64> = reduce(system, &field(system)).iter().map(|w| w * (shortest / 80.0)).collect();
    let w = expand(system, &free);
    let at = |s: f64| {
        let moved = state.positions.iter().zip(&w).map(|(x, w)| x + w * s);
        State { positions: moved.collect(), ..state.clone() }
    };
    let (mut elastic, mut weight) = (0.0, 0.0);
    for (node, share) in NODES.into_iter().flat_map(|(x, share)| [(-x, share), (x, share)]) {
        let geometry = SpringGeometry::at(system, &at(0.5 + 0.5 * node).positions)?;
        let [mut springs, mut weights] = [(); 2].map(|()| vec![Vector3::zeros(); w.len()]);
        add_elastic_force(system, &geometry, &mut springs);
        add_weight(system, &mut weights);
        elastic += 0.5 * share * dot(&springs, &w);
        weight += 0.5 * share * dot(&weights, &w);
    }
    let (before, after) = (Energy::of(system, state), Energy::of(system, &at(1.0)));
    let check = |name: &str, error: f64, unit, bound, why: &str| {
        Check::new(Claim::Consistency, name, &case.name, ratio(error.abs(), unit), bound, why)
    };
    let bound = 30.0 + (w.len() + links.len()) as f64;
    let unit = elastic_unit(&links, [before.elastic, after.elastic], &w, &state.positions);
    let why = "in units of rounding: of the energies, of the work, and of the positions times the force; sums of n terms \
               add n of them, and the quadrature none";
    let elastic = check("elastic energy is work", after.elastic - before.elastic + elastic, unit, bound, why);
    let unit = weight_unit(system, &state.positions);
    let error = after.gravitational - before.gravitational + weight;
    let why = "in units of rounding of the energy, u Σ m |gravity| |x|; a sum of n terms adds n of them";
    Ok(vec![elastic, check("gravitational energy is work", error, unit, bound, why)])
}

/// The rounding of two energies, of the work along w and of the positions times the force.
fn elastic_unit(links: &[Link], energies: [f64; 2], w: &[Vector3<f64>], positions: &[Vector3<f64>]) -> f64 {
    let pull = reference::pull(links, w.len());
    let work: f64 = pull.iter().zip(w).map(|(f, w)| f * w.norm()).sum();
    let arms = reference::magnitude(links, |link| link.elastic_force().norm(), positions);
    U * (energies[0] + energies[1] + work + arms.iter().sum::<f64>())
}

fn weight_unit(system: &System, positions: &[Vector3<f64>]) -> f64 {
    let heights: f64 = system.masses().iter().zip(positions).map(|(m, x)| m * x.norm()).sum();
    U * heights * system.gravity().norm()
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures;

    /// The pulls are 10, 37 and 27 N, so that moves of 1/2 and 1 m are work of 5 + 37 J; forces of 2 and 3 N have arms of 5 and 13 m, at
    /// both of their ends.
    #[test]
    fn units_of_rounding_by_hand() {
        let (system, state) = fixtures::line().build().unwrap();
        let links = reference::links(&system, &state.positions);
        let w = [0.5, -1.0, 0.0].map(|x| Vector3::new(x, 0.0, 0.0));
        assert_eq!(elastic_unit(&links, [7.0, 11.0], &w, &state.positions), U * (18.0 + 42.0 + 2.0 * (10.0 + 39.0)));
        assert_eq!(weight_unit(&system, &state.positions), U * (2.0 + 4.0 + 45.0) * 2.0);
        assert_eq!(dot(&w, &[2.0, 3.0, 4.0].map(|x| Vector3::new(x, 1.0, 1.0))), -2.0);
    }
}
