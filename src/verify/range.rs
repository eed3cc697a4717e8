//! The range of numbers within which checks can judge a scene.
//!
//! Every bound of the suite is one of rounding or of truncation, and holds while something is left beside it: a spring whose length is
//! lost in the rounding of far coordinates has no derivative that could be measured, and beside one that is 10¹² times stiffer a spring
//! has no digits in any sum. What a family cannot judge on a scene is read from the scene's own numbers, never from what a check has found.

use super::reference::{self, Link};
use super::{TestCase, U};
use crate::force::Energy;

/// The share of a spring that the rounding of its ends' coordinates may be: two digits above the square root of rounding, which differences
/// of forces reach.
const COORDINATES: f64 = 1e-9;

/// The ratio of the longest to the shortest length, at rest or not, and of the largest to the smallest stiffness: their product with
/// rounding must leave digits of the smaller one in a sum.
const LENGTHS: f64 = 1e7;
const STIFFNESSES: f64 = 1e10;

/// The ratio of the masses of particles that move.
const MASSES: f64 = 1e10;

/// The largest row of A over its smallest eigenvalue m/dt², a bound of the condition number: with rounding, a solution of two digits.
const CONDITION: f64 = 1e13;

/// The share of the energy that is exchanged which rounding of the whole energy may be.
const ENERGIES: f64 = 1e-9;

/// Extents of the scene that a particle may go in a step: farther on nothing is left of where it was.
const WAY: f64 = 1e4;

/// Why differences of forces and sums over springs say nothing; `None` where they do.
pub(super) fn of_springs(subject: &TestCase) -> Option<String> {
    let TestCase { system, state, .. } = subject;
    let links = reference::links(system, &state.positions);
    let reach = |link: &Link| link.ends.iter().map(|&p| state.positions[p].norm()).fold(0.0, f64::max);
    let lost = |link: &Link| 2.0 * U * reach(link) / link.length.min(link.rest_length);
    if let Some((spring, link)) = farthest(&links, lost).filter(|(_, link)| lost(link) > COORDINATES) {
        return Some(format!(
            "spring {spring}, {:.1e} m long, has coordinates of {:.1e} m, whose rounding is {:.1e} of it: more than {COORDINATES:.0e}",
            link.length.min(link.rest_length),
            reach(link),
            lost(link)
        ));
    }
    let lengths = || links.iter().flat_map(|link| [link.length, link.rest_length]);
    let stiffnesses = || links.iter().map(Link::magnitude);
    let dampings = || links.iter().map(|link| link.damping).filter(|&damping| damping > 0.0);
    apart("lengths of springs", "m", lengths, LENGTHS)
        .or_else(|| apart("stiffnesses k/l0 + k/l", "N/m", stiffnesses, STIFFNESSES))
        .or_else(|| apart("dampings of springs", "N·s/m", dampings, STIFFNESSES))
}

/// Why steps say nothing; `None` where they do.
pub(super) fn of_steps(subject: &TestCase) -> Option<String> {
    let TestCase { system, state, dt, .. } = subject;
    let masses = || reference::movers(system).map(|p| system.masses()[p]);
    let found = of_springs(subject).or_else(|| apart("masses of particles that move", "kg", masses, MASSES));
    if found.is_some() || system.dofs().is_empty() {
        return found;
    }
    let lightest = masses().fold(f64::INFINITY, f64::min);
    let condition = reference::step_matrix_norm(subject, state, *dt) / (lightest / (dt * dt));
    if condition.is_nan() || condition > CONDITION {
        return Some(format!(
            "the largest row of A is {condition:.1e} times m/dt² of the lightest particle, more than {CONDITION:.0e}: a solution has no digits"
        ));
    }
    let fastest = state.velocities.iter().map(|v| v.norm()).fold(0.0, f64::max);
    let way = (fastest + system.gravity().norm() * dt) * dt / subject.extent();
    (way.is_nan() || way > WAY).then(|| {
        format!("a particle goes {way:.1e} times the extent of the scene in a step, more than {WAY:.0e}: nothing is left of where it was")
    })
}

/// Why what a run says of its own error cannot be held against it; `None` where it can. A run looks for energy that comes or goes, and what
/// rounding makes of the energy of everything, held particles included, must be small against what the motion has to exchange.
pub(super) fn of_estimates(subject: &TestCase) -> Option<String> {
    if let Some(reason) = of_steps(subject) {
        return Some(reason);
    }
    let TestCase { system, state, .. } = subject;
    let weight = |p: usize| system.masses()[p] * system.gravity().norm();
    let heights: f64 = (0..system.particles()).map(|p| weight(p) * state.positions[p].norm()).sum();
    let falls: f64 = reference::movers(system).map(|p| weight(p) * subject.extent()).sum();
    let energy = Energy::of(system, state);
    let exchanged = energy.kinetic + energy.elastic + falls;
    (U * heights > ENERGIES * exchanged).then(|| {
        format!(
            "the energy of weights is {heights:.1e} J, whose rounding is more than {ENERGIES:.0e} of the {exchanged:.1e} J that the motion \
             has to exchange"
        )
    })
}

fn farthest(links: &[Link], of: impl Fn(&Link) -> f64) -> Option<(usize, &Link)> {
    links.iter().enumerate().max_by(|(_, a), (_, b)| of(a).total_cmp(&of(b)))
}

/// That positive numbers lie too far apart, if they do.
fn apart<I: Iterator<Item = f64>>(what: &str, unit: &str, values: impl Fn() -> I, most: f64) -> Option<String> {
    let least = values().fold(f64::INFINITY, f64::min);
    let largest = values().fold(0.0, f64::max);
    let ratio = largest / least;
    (ratio > most || ratio.is_nan() && largest > 0.0)
        .then(|| format!("{what} lie between {least:.1e} and {largest:.1e} {unit}, more than {most:.0e} times apart: the small ones are lost in sums"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// A held particle and two that hang on it in a row, of 1 kg, on springs of k = 100 N that are 1 m long; changed.
    fn chain(change: impl FnOnce(&mut SystemBuilder)) -> TestCase {
        let mut builder = SystemBuilder::new();
        for y in [0.0, -1.0, -2.0] {
            builder.particle([0.0, y, 0.0], 1.0);
        }
        for i in [0, 1] {
            builder.spring(i, i + 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.1 });
        }
        builder.hold(0);
        change(&mut builder);
        let (system, state) = builder.build().unwrap();
        TestCase { name: "chain".into(), system, state, dt: 0.01 }
    }

    #[test]
    fn ordinary_numbers_are_judged_and_absurd_ones_named() {
        assert_eq!(of_steps(&chain(|_| {})), None);
        // What is held may be as heavy as it likes.
        assert_eq!(of_steps(&chain(|scene| scene.masses[0] = 1e16)), None);
        // But where its weight counts it hides every other energy.
        let weighty = |scene: &mut SystemBuilder| {
            (scene.masses[0], scene.gravity.y, scene.positions[0].x) = (1e16, -9.81, 0.1);
        };
        assert!(
            of_steps(&chain(weighty)).is_none() && of_estimates(&chain(weighty)).unwrap().contains("energy of weights")
        );
        assert_eq!(of_estimates(&chain(|scene| scene.gravity.y = -9.81)), None);
        let far = chain(|scene| scene.positions[2].y = -4e9);
        assert!(of_springs(&far).unwrap().contains("spring 1"));
        type Change = fn(&mut SystemBuilder);
        let cases: [(Change, &str); 4] = [
            (|scene| scene.springs[1].stiffness = 1e14, "stiffnesses"),
            (|scene| scene.springs[1].damping = 1e11, "dampings"),
            (|scene| scene.masses[2] = 1e12, "masses of particles that move"),
            (|scene| scene.velocities[1].x = 1e8, "times the extent"),
        ];
        for (change, reason) in cases {
            let found = of_steps(&chain(change)).unwrap_or_default();
            assert!(found.contains(reason), "{reason}: {found}");
        }
        let long = TestCase { dt: 1e7, ..chain(|_| {}) };
        assert!(of_springs(&long).is_none() && of_steps(&long).unwrap().contains("largest row of A"));
    }
}
