//! Loads, drag, gravity and rest lengths in time, and slack springs: forces and their derivatives against a second writing of the formulas.
//!
//! All other checks leave these out of a scene. With `l0(t) = l0 s(t)` the force on a particle is
//!
//! ```text
//! f = Σ ∓(k (l/l0(t) − 1) + b n·w) n + m g(t) + p − c v
//! ```
//!
//! over its springs, w the difference of the velocities of their ends, without those that are tension-only and shorter than l0(t). So
//! `G = ∂f/∂v` has −c on its diagonal, and `∂f/∂t = Σ ±(k l/l0(t) · s'/s) n + m g'`.

use super::reference::{self, field};
use super::{Check, Claim, Link, Measured, TestCase, U, UNITS, expand, ratio, reduce, worst};
use crate::force::{SpringGeometry, add_all_forces, add_force_rate};
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::{Spring, Stiffness};
use crate::system::{Curve, State, System};
use nalgebra::Vector3;
use std::ops::{Add, Mul, Sub};

pub(super) fn applies(case: &TestCase) -> bool {
    case.loaded.is_some()
}

pub(super) fn measure(case: &TestCase) -> Measured {
    let Some(system) = &case.loaded else { return Ok(Vec::new()) };
    // A little aside: a spring that is as long as at rest to rounding is slack or not by chance.
    let lengths = reference::links(system, &case.state.positions).into_iter().map(|link| link.length);
    let aside = lengths.fold(case.extent(), f64::min) / 1024.0;
    let positions: Vec<_> = case.state.positions.iter().zip(field(system)).map(|(x, way)| x + way * aside).collect();
    // Products are of free coordinates alone.
    let w = reduce(system, &field(system));
    let velocities = expand(system, &w);
    let mut found = [0.0; 4];
    for time in times(system, case.state.time) {
        let state = State { time, positions: positions.clone(), velocities: velocities.clone() };
        let geometry = SpringGeometry::at(system, &state)?;
        let mut force = vec![Vector3::zeros(); system.particles()];
        add_all_forces(system, &geometry, &state.moment(), &mut force);
        let mut rate = vec![Vector3::zeros(); system.particles()];
        add_force_rate(system, &geometry, &state.moment(), &mut rate);
        let product = |combination| {
            let mut y = vec![0.0; w.len()];
            SystemOperator::new(system, &geometry, Stiffness::Full, combination).apply(&w, &mut y);
            expand(system, &y)
        };
        let computed = [force, product(Combination::STIFFNESS), product(Combination::DAMPING), rate];
        for ((value, computed), expected) in found.iter_mut().zip(computed).zip(sums(system, &state)) {
            *value = worst([*value, error(system, &computed, &expected)]);
        }
    }
    let why = "in units of rounding, u times the sum of the magnitudes of all terms at a particle: ten for each spring and each load, and \
               those of the interpolation in time; every other check leaves loads and changes in time out";
    let names = [
        "forces with all loads",
        "K of slack springs and changing rest lengths",
        "G of slack springs and drag",
        "change of the forces in time",
    ];
    let check = |(name, value)| Check::new(Claim::Consistency, name, &case.name, value, UNITS, why);
    Ok(names.into_iter().zip(found).map(check).collect())
}

/// The start, at most eight times between the kinks, and one beyond.
fn times(system: &System, start: f64) -> Vec<f64> {
    let kinks: Vec<f64> = system.prescribed().kinks().iter().copied().filter(|&kink| kink > start).collect();
    let stride = kinks.len().div_ceil(8).max(1);
    let ends = [start].into_iter().chain(kinks.iter().copied());
    // Not the middle: a symmetric mistake would hide there.
    let between = ends.zip(kinks.iter().copied()).map(|(from, to)| from + 0.37 * (to - from));
    let beyond = kinks.last().map(|last| last + (last - start));
    [start].into_iter().chain(between.step_by(stride)).chain(beyond).collect()
}

/// The sum of a particle's terms, and that of their magnitudes.
type Terms = (Vector3<f64>, f64);

/// The largest error along free axes, in units of rounding.
fn error(system: &System, computed: &[Vector3<f64>], expected: &[Terms]) -> f64 {
    worst(
        expected
            .iter()
            .enumerate()
            .map(|(p, (sum, size))| ratio(system.dofs().free_axes(p).project(&(computed[p] - sum)).amax(), U * size)),
    )
}

/// The forces, `K v`, `G v` and `∂f/∂t` of every particle, as the formulas above have them.
fn sums(system: &System, state: &State) -> [Vec<Terms>; 4] {
    let mut sums = [(); 4].map(|()| vec![(Vector3::zeros(), 0.0); system.particles()]);
    let [force, stiffness, damping, rate] = &mut sums;
    let add = |(sum, size): &mut Terms, term: Vector3<f64>, magnitude: f64| {
        *sum += term;
        *size += magnitude;
    };
    for (link, slope) in taut(system, state) {
        let w = link.difference(&state.velocities);
        let pull = link.axial * (link.length + link.rest_length);
        let ends = link.ends.map(|p| state.velocities[p].norm());
        let brake = link.damping * (ends[0] + ends[1]);
        let block = link.magnitude() * (ends[0] + ends[1]);
        let lost = link.axial * link.length * slope;
        for (p, sign) in [(link.ends[0], 1.0), (link.ends[1], -1.0)] {
            let damper = -link.damping_block() * w * sign;
            add(&mut force[p], link.elastic_force() * sign + damper, pull + brake);
            add(&mut stiffness[p], -link.stiffness_block(Stiffness::Full) * w * sign, block);
            add(&mut damping[p], damper, brake);
            add(&mut rate[p], link.direction * lost * sign, lost.abs());
        }
    }
    let loads = system.loads();
    for p in 0..system.particles() {
        let (mass, v) = (system.masses()[p], state.velocities[p]);
        let (gravity, slope) =
            loads.gravity.as_ref().map_or((system.gravity(), Vector3::zeros()), |curve| at(curve, state.time));
        add(&mut force[p], gravity * mass, 2.0 * mass * (gravity.norm() + system.gravity().norm()));
        add(&mut rate[p], slope * mass, mass * slope.norm());
        if let Some(load) = loads.forces.get(p) {
            add(&mut force[p], *load, load.norm());
        }
        if let Some(&c) = loads.drag.get(p) {
            add(&mut force[p], -v * c, c * v.norm());
            add(&mut damping[p], -v * c, c * v.norm());
        }
    }
    sums
}

/// The springs that pull, with their rest lengths at the state's time, and `s'/s` in 1/s.
fn taut(system: &System, state: &State) -> Vec<(Link, f64)> {
    let behaviour = system.behaviour();
    let of = |link: Link| {
        // Later entries override earlier ones.
        let entry = behaviour.actuation.iter().rfind(|entry| entry.springs.contains(&link.index));
        let (factor, slope) = entry.map_or((1.0, 0.0), |entry| at(&entry.factors, state.time));
        let spring = system.springs()[link.index];
        let spring = Spring { rest_length: spring.rest_length * factor, ..spring };
        let link = Link::new(link.index, link.ends, spring, link.separation, link.length);
        let is_slack = behaviour.tension_only.get(link.index) == Some(&true) && link.length < link.rest_length;
        (!is_slack).then_some((link, slope / factor))
    };
    reference::links(system, &state.positions).into_iter().filter_map(of).collect()
}

/// Value and slope of a piecewise linear function just after a time.
fn at<T>(curve: &Curve<T>, time: f64) -> (T, T)
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>,
{
    let last = curve.times.len() - 1;
    let value = |n: usize| curve.values[n];
    match curve.times.iter().rposition(|&from| from <= time) {
        None => (value(0), value(0) * 0.0),
        Some(n) if n == last => (value(last), value(last) * 0.0),
        Some(n) => {
            let slope = (value(n + 1) - value(n)) * (1.0 / (curve.times[n + 1] - curve.times[n]));
            (value(n) + slope * (time - curve.times[n]), slope)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{Actuation, Behaviour, Loads};
    use crate::verify::fixtures::chain;

    /// Three springs in a row: the second is slack at first and actuated, the third tension-only and stretched.
    fn case(change: impl Fn(&mut Behaviour, &mut Loads)) -> TestCase {
        let times = || vec![0.5, 1.0, 2.0];
        let factors = Curve { times: times(), values: vec![1.0, 0.6, 2.0] };
        let actuation = vec![Actuation { springs: vec![0, 1], factors }];
        let mut behaviour = Behaviour { tension_only: vec![false, true, true], actuation };
        let gravity = Some(Curve { times: times(), values: vec![-Vector3::y(), Vector3::x(), Vector3::zeros()] });
        let mut loads =
            Loads { forces: vec![Vector3::new(0.5, -2.0, 0.0); 4], drag: vec![0.0, 0.3, 0.0, 2.0], gravity };
        change(&mut behaviour, &mut loads);
        let TestCase { system, state, .. } = chain(4, 0.01);
        let system = system.with_behaviour(behaviour).unwrap().with_loads(loads).unwrap();
        TestCase::new("chain", system, state, Some(0.01)).unwrap()
    }

    /// At their rest lengths springs are slack or not by rounding alone.
    #[test]
    fn springs_as_long_as_at_rest_are_no_fault() {
        let at_rest = |behaviour: &mut Behaviour, _: &mut Loads| behaviour.tension_only = vec![true; 3];
        let mut case = case(at_rest);
        let system = case.loaded.take().unwrap();
        let springs = reference::links(&system, &case.state.positions);
        let springs = springs.iter().map(|link| Spring { stiffness: 10.0, rest_length: link.length, damping: 0.5 });
        case.loaded = Some(system.with_springs(springs.collect()).unwrap());
        assert!(measure(&case).unwrap().iter().all(Check::passed));
    }

    /// A system that differs from the formulas in one respect: a check fails, and no other.
    #[test]
    fn every_wrong_term_has_its_check() {
        type Change = fn(&mut Behaviour, &mut Loads);
        let changes: [(Change, &[usize]); 5] = [
            (|behaviour, _| behaviour.tension_only[1] = false, &[0, 1, 2, 3]),
            (|behaviour, _| behaviour.actuation[0].factors.values[1] = 0.9, &[0, 1, 2, 3]),
            (|_, loads| loads.drag[1] = 0.2, &[0, 2]),
            (|_, loads| loads.forces[2].x = 0.6, &[0]),
            (|_, loads| loads.gravity.as_mut().unwrap().values[1].y = 0.1, &[0, 3]),
        ];
        let right = case(|_, _| {});
        for (number, (change, failing)) in changes.into_iter().enumerate() {
            let wrong = case(change);
            let mut found = [0.0; 4];
            for time in times(right.loaded.as_ref().unwrap(), 0.0) {
                let [right_sums, wrong_sums] = [&right, &wrong].map(|case| {
                    let state = State { time, velocities: field(&case.system), ..case.state.clone() };
                    sums(case.loaded.as_ref().unwrap(), &state)
                });
                for (value, (expected, other)) in found.iter_mut().zip(right_sums.iter().zip(&wrong_sums)) {
                    let computed: Vec<_> = other.iter().map(|(sum, _)| *sum).collect();
                    *value = worst([*value, error(&right.system, &computed, expected)]);
                }
            }
            let failed: Vec<usize> = (0..4).filter(|&check| found[check] > UNITS).collect();
            assert_eq!(failed, failing, "change {number}: {found:?}");
        }
    }
}
