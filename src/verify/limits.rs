//! The numbers within which checks can judge a scene.
//!
//! Every bound of the suite is one of rounding or of truncation, and needs some digits beside it: a spring whose length is
//! lost in the rounding of far coordinates has no derivative that could be measured, and beside one that is 10¹² times stiffer a
//! spring has no digits in any sum. These limits are read from the scene's own numbers, never from the result of a check.

use super::{Link, TestCase, reference};
use crate::force::Energy;
use crate::system::State;
use nalgebra::Vector3;

/// The unit of rounding, 2⁻⁵³.
pub const U: f64 = f64::EPSILON / 2.0;

/// Units of rounding that a backward stable solve, or a sum of some ten rounded terms a spring, may leave.
pub(super) const UNITS: f64 = 30.0;

/// Degrees of freedom up to which a scene is run many times, and those up to which every method and several directions are tried.
pub(super) const AFFORDABLE: usize = 2000;
pub(super) const LARGE: usize = 10_000;

/// The largest rounding of a spring's coordinates over its length: two digits above √u, the accuracy of differences of forces.
const COORDINATES: f64 = 1e-9;

/// The largest ratio of two stiffnesses, dampings or masses: the smaller one must have digits in a sum.
const RATIO: f64 = 1e10;

/// The largest row of A over its smallest eigenvalue m/dt², a bound of the condition number: a solution has two digits.
const CONDITION: f64 = 1e13;

/// The largest rounding of the whole energy relative to the energy that is exchanged.
const ENERGIES: f64 = 1e-9;

/// Extents of the scene that a particle may go in a step: farther on its old position is lost in rounding.
const PATH_LENGTH: f64 = 1e4;

/// The reason why differences of forces and sums over springs say nothing, if there is one.
pub(super) fn of_springs(case: &TestCase) -> Option<String> {
    let TestCase { system, state, .. } = case;
    if system.has_other_laws() || system.external_forces().next().is_some() {
        return Some("a spring law or a force of the caller's own acts, and no check knows it".into());
    }
    let links = reference::links(system, &state.positions);
    if let Some(spring) = links.iter().position(|link| link.length == 0.0) {
        return Some(format!("the ends of spring {spring} are at one place, so that it has no direction"));
    }
    let distance = |link: &Link| link.ends.iter().map(|&p| state.positions[p].norm()).fold(0.0, f64::max);
    let rest_length = |link: &Link| Some(link.rest_length).filter(|&length| length > 0.0);
    let length = |link: &Link| rest_length(link).map_or(link.length, |rest| rest.min(link.length));
    let lost = |link: &Link| 2.0 * U * distance(link) / length(link);
    let worst = links.iter().enumerate().max_by(|(_, a), (_, b)| lost(a).total_cmp(&lost(b)));
    if let Some((spring, link)) = worst.filter(|(_, link)| lost(link) > COORDINATES) {
        return Some(format!(
            "spring {spring}, {:.1e} m long, has coordinates of {:.1e} m, whose rounding is {:.1e} of it: more than {COORDINATES:.0e}",
            length(link),
            distance(link),
            lost(link)
        ));
    }
    let lengths = || links.iter().flat_map(|link| [Some(link.length), rest_length(link)]).flatten();
    let stiffnesses = || links.iter().map(Link::magnitude);
    let dampings = || links.iter().map(|link| link.damping).filter(|&damping| damping > 0.0);
    too_far_apart("lengths of springs", "m", lengths, 1e7)
        .or_else(|| too_far_apart("stiffnesses k/l0 + k/l", "N/m", stiffnesses, RATIO))
        .or_else(|| too_far_apart("dampings of springs", "N·s/m", dampings, RATIO))
}

/// The reason why steps say nothing, if there is one.
pub(super) fn of_steps(case: &TestCase) -> Option<String> {
    let TestCase { system, state, dt, .. } = case;
    let masses = || reference::movers(system).map(|p| system.masses()[p]);
    let found = of_springs(case).or_else(|| too_far_apart("masses of particles that move", "kg", masses, RATIO));
    if found.is_some() || system.dofs().is_empty() {
        return found;
    }
    let fastest = state.velocities.iter().map(|v| v.norm()).fold(0.0, f64::max);
    // A force that moves the scene by its extent, or as far as it goes anyway, in the shortest step that is taken.
    let shortest = dt.min(case.resolving_step());
    let way = case.extent() + (fastest + system.gravity().norm() * dt) * dt;
    let force = reference::step_matrix_norm(case, state, shortest) * way;
    if !(State::LARGEST.recip()..=State::LARGEST).contains(&force) {
        let what = if force < 1.0 { "vanish" } else { "overflow" };
        return Some(format!("forces of {force:.1e} N, as they act in steps of {shortest:.1e} s, {what} when squared"));
    }
    let condition = reference::step_matrix_norm(case, state, *dt) / (reference::lightest(system) / (dt * dt));
    if condition.is_nan() || condition > CONDITION {
        return Some(format!(
            "the largest row of A is {condition:.1e} times m/dt² of the lightest particle, more than {CONDITION:.0e}: a solution has no digits"
        ));
    }
    let path = (fastest + system.gravity().norm() * dt) * dt / case.extent();
    (path.is_nan() || path > PATH_LENGTH).then(|| {
        format!(
            "a particle goes {path:.1e} times the extent of the scene in a step, more than {PATH_LENGTH:.0e}: its old position is lost in rounding"
        )
    })
}

/// The reason why a run's estimates of its own error cannot be judged, if there is one: the rounding of all energy hides the exchanged energy.
pub(super) fn of_estimates(case: &TestCase) -> Option<String> {
    if let Some(reason) = of_steps(case) {
        return Some(reason);
    }
    let TestCase { system, state, .. } = case;
    let weight = |p: usize| system.masses()[p] * system.gravity().norm();
    let heights: f64 = (0..system.particles()).map(|p| weight(p) * state.positions[p].norm()).sum();
    let falls: f64 = reference::movers(system).map(|p| weight(p) * case.extent()).sum();
    let energy = Energy::of(system, state);
    let exchanged = energy.kinetic + energy.elastic + falls;
    (U * heights > ENERGIES * exchanged).then(|| {
        format!(
            "the energy of weights is {heights:.1e} J, whose rounding is more than {ENERGIES:.0e} of the {exchanged:.1e} J that the motion exchanges"
        )
    })
}

fn too_far_apart<I: Iterator<Item = f64>>(what: &str, unit: &str, values: impl Fn() -> I, most: f64) -> Option<String> {
    let least = values().fold(f64::INFINITY, f64::min);
    let largest = values().fold(0.0, f64::max);
    let ratio = largest / least;
    (ratio > most || ratio.is_nan() && largest > 0.0).then(|| {
        format!(
            "{what} lie between {least:.1e} and {largest:.1e} {unit}, more than {most:.0e} times apart: the small ones are lost in sums"
        )
    })
}

impl TestCase {
    /// The time, in s, until a path has a kink.
    pub(super) fn time_to_kink(&self) -> f64 {
        let start = self.state.time;
        self.system.prescribed().next_kink(start).map_or(f64::INFINITY, |kink| kink - start)
    }

    /// Accelerations at the start by the forces of springs and weight, in m/s²; zero along prescribed axes.
    pub(super) fn accelerations(&self) -> Vec<Vector3<f64>> {
        let Self { system, state, .. } = self;
        let links = reference::links(system, &state.positions);
        let elastic = reference::sum(&links, system.particles(), Link::elastic_force);
        let damping = reference::damping_product(&links, &state.velocities);
        let acceleration = |p: usize| {
            let all = (elastic[p] + damping[p]) / system.masses()[p] + system.gravity();
            system.dofs().free_axes(p).project(&all)
        };
        (0..system.particles()).map(acceleration).collect()
    }

    /// The reason why rounding cannot be followed through a step of dt seconds, if there is one.
    pub(super) fn beyond_rounding(&self, dt: f64) -> Option<String> {
        let factor = dt / self.resolving_step();
        // The square of that, times u, is a tenth of a percent.
        (factor > 1e5).then(|| {
            format!("a step is {factor:.0e} times as long as one that resolves the fastest vibration or decay")
        })
    }

    /// The reason why runs of a duration say little of a method, if there is one: the force of a spring that turns about is no smooth function of time.
    pub(super) fn passing(&self, duration: f64) -> Option<String> {
        let Self { system, state, .. } = self;
        let accelerations = self.accelerations();
        let passes = |link: &Link| {
            let (v, a) = (link.difference(&state.velocities), link.difference(&accelerations));
            v.norm() * duration + 0.5 * a.norm() * duration * duration > 0.25 * link.length
        };
        let spring = reference::links(system, &state.positions).iter().position(passes)?;
        Some(format!(
            "the ends of spring {spring} turn about or pass each other within the {duration:.1e} s of the runs"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::SystemBuilder;
    use crate::verify::fixtures::{self, case};

    /// A chain of three particles of about 1 kg on springs of about 50 N that are 1 m long; the first is held, 1 m from the origin.
    fn chain(change: impl FnOnce(&mut SystemBuilder)) -> TestCase {
        let mut builder = fixtures::chain(3, 0.01).description();
        change(&mut builder);
        case(builder, 0.01)
    }

    #[test]
    fn ordinary_numbers_are_judged_and_absurd_ones_named() {
        assert_eq!(of_steps(&chain(|_| {})), None);
        // A held particle may have any mass, but where its weight counts it hides every other energy.
        let weighty = chain(|scene| scene.masses[0] = 1e16);
        assert_eq!(of_steps(&weighty), None);
        assert!(of_estimates(&weighty).unwrap().contains("energy of weights"));
        assert_eq!(of_estimates(&chain(|_| {})), None);
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
        for mass in [1e200, 1e-200] {
            let case = chain(|scene| {
                scene.masses.fill(mass);
                scene.springs.iter_mut().for_each(|spring| spring.stiffness *= mass);
            });
            let found = of_steps(&case).unwrap_or_default();
            assert!(found.contains("when squared"), "{mass:e}: {found}");
        }
        // A spring needs no rest length, but a direction.
        assert_eq!(of_steps(&chain(|scene| scene.springs[1].rest_length = 0.0)), None);
        let collapsed = of_springs(&chain(|scene| {
            scene.springs[1].rest_length = 0.0;
            scene.positions[2] = scene.positions[1];
        }));
        assert!(collapsed.unwrap().starts_with("the ends of spring 1 are at one place"));
        let long = TestCase { dt: 1e7, ..chain(|_| {}) };
        assert!(of_springs(&long).is_none() && of_steps(&long).unwrap().contains("largest row of A"));
    }
}
