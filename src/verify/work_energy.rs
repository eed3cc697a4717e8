//! Energies are the work of the forces.
//!
//! From x to x + w the elastic energy grows by `−∫₀¹ f_el(x + s w)·w ds`, the gravitational one by `−Σ m gravity·w`. Gauss's
//! quadrature with eight nodes makes no error that a double could hold as long as no spring changes by more than a
//! twentieth: its integrand is analytic far around the interval.

use super::measured::Measured;
use super::reference::{self, Link, field};
use super::{Check, Claim, TestCase, U};
use crate::force::{Energy, SpringGeometry, add_elastic_force, add_weight};
use crate::system::{State, System};
use nalgebra::Vector3;

/// Nodes in (0, 1) and weights of Gauss's quadrature with eight points (Abramowitz and Stegun, table 25.4), one half.
const NODES: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_3),
];

pub(super) fn measure(subject: &TestCase) -> Measured {
    let TestCase { system, state, .. } = subject;
    let links = reference::links(system, &state.positions);
    let shortest = links.iter().map(|link| link.length).fold(f64::INFINITY, f64::min);
    let shortest = if shortest.is_finite() { shortest } else { subject.extent() };
    // Both ends move by at most 3^(1/2) of a component each.
    let mut w: Vec<Vector3<f64>> = field(system).iter().map(|v| v * (shortest / 80.0)).collect();
    let free = reference::free(system, &w);
    w.fill(Vector3::zeros());
    system.dofs().scatter(&free, &mut w);
    let at = |s: f64| {
        let moved = state.positions.iter().zip(&w).map(|(x, w)| x + w * s);
        State { positions: moved.collect(), ..state.clone() }
    };
    let (mut elastic, mut weight) = (0.0, 0.0);
    for (node, share) in NODES.into_iter().flat_map(|(x, share)| [(-x, share), (x, share)]) {
        let positions = at(0.5 + 0.5 * node).positions;
        let extensions = SpringGeometry::at(system, &positions)?;
        let mut force = vec![Vector3::zeros(); w.len()];
        add_elastic_force(system, &extensions, &mut force);
        elastic += 0.5 * share * dot(&force, &w);
        force.fill(Vector3::zeros());
        add_weight(system, &mut force);
        weight += 0.5 * share * dot(&force, &w);
    }
    let (before, after) = (Energy::of(system, state), Energy::of(system, &at(1.0)));
    let unit = elastic_unit(&links, [before.elastic, after.elastic], &w, &state.positions);
    let why = "in units of rounding: of the energies, of the work, and of the positions times the force; sums of n terms \
               add n of them, and the quadrature none";
    let error = (after.elastic - before.elastic + elastic).abs();
    let bound = 30.0 + (w.len() + links.len()) as f64;
    let mut checks =
        vec![Check::new(Claim::Consistency, "elastic energy is work", &subject.name, share(error, unit), bound, why)];
    let unit = weight_unit(system, &state.positions);
    let error = (after.gravitational - before.gravitational + weight).abs();
    let why = "in units of rounding of the energy, u Σ m |gravity| |x|; a sum of n terms adds n of them";
    let value = share(error, unit);
    checks.push(Check::new(Claim::Consistency, "gravitational energy is work", &subject.name, value, bound, why));
    Ok(checks)
}

/// The rounding of two energies, of the work along w and of the positions times the force.
fn elastic_unit(links: &[Link], energies: [f64; 2], w: &[Vector3<f64>], positions: &[Vector3<f64>]) -> f64 {
    let pull = reference::pull(links, w.len());
    let work: f64 = pull.iter().zip(w).map(|(f, w)| f * w.norm()).sum();
    let reach = reference::magnitude(links, |link| link.elastic_force().norm(), positions);
    U * (energies[0] + energies[1] + work + reach.iter().sum::<f64>())
}

/// `u Σ m |gravity| |x|`.
fn weight_unit(system: &System, positions: &[Vector3<f64>]) -> f64 {
    let heights: f64 = system.masses().iter().zip(positions).map(|(m, x)| m * x.norm()).sum();
    U * heights * system.gravity().norm()
}

fn share(error: f64, unit: f64) -> f64 {
    if error == 0.0 { 0.0 } else { error / unit }
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

#[cfg(test)]
mod tests;
