//! What the state of a part shows.

use super::parts::Parts;
use crate::force::{Extensions, add_elastic_force, add_weight};
use crate::system::{Axes, Dof, Motion, State, System};
use nalgebra::Vector3;

/// Lengths, and net forces up to this many roundings of what they are the differences of, count as zero.
const ROUNDINGS: f64 = 16.0;

/// Axes along which a prescribed particle ever moves.
fn moving_axes(system: &System) -> Vec<[bool; 3]> {
    let mut moving = vec![[false; 3]; system.particles()];
    let motions = system.prescribed().motions();
    for (Dof { particle, axis }, _, motion) in system.prescribed().iter() {
        moving[particle][axis] = match &motions[motion] {
            Motion::Held => false,
            Motion::Velocity(v) => v[axis] != 0.0,
            Motion::Path { offsets, .. } => offsets.windows(2).any(|pair| pair[0][axis] != pair[1][axis]),
        };
    }
    moving
}

/// For every part (indexed by its first particle), whether nothing ever points along the axis.
pub(super) fn without_force(system: &System, state: &State, parts: &Parts, axis: usize) -> Vec<bool> {
    let mut flat = vec![system.gravity()[axis] == 0.0; system.particles()];
    let moving = moving_axes(system);
    for p in 0..system.particles() {
        flat[parts.part(p)] &= state.velocities[p][axis] == 0.0 && !moving[p][axis];
    }
    for (_, pair, _) in system.active() {
        let [xi, xj] = pair.map(|p| state.positions[p][axis]);
        let disturbed = xi != xj || pair.iter().any(|&p| moving[p][axis]);
        if disturbed {
            pair.iter().for_each(|&p| flat[parts.part(p)] = false);
        }
    }
    flat
}

/// What a part's springs do at the start, for every part (indexed by its first particle).
pub(super) struct Strains {
    /// Whether all of them have their rest lengths, to rounding: their energy is the least that there is.
    pub unstrained: Vec<bool>,
    /// Whether any is shorter than that by more than rounding.
    compressed: Vec<bool>,
}

impl Strains {
    pub fn of(system: &System, state: &State, extensions: &Extensions, parts: &Parts) -> Self {
        let n = system.particles();
        let (mut unstrained, mut compressed) = (vec![true; n], vec![false; n]);
        for ((_, pair, spring), at) in extensions.springs(system) {
            // A length is rounded like the coordinates that it is the difference of.
            let reach: f64 = pair.iter().map(|&p| state.positions[p].norm()).sum();
            let strain = at.length - spring.rest_length;
            let rounding = ROUNDINGS * f64::EPSILON * (reach + spring.rest_length);
            for part in pair.map(|p| parts.part(p)) {
                unstrained[part] &= strain.abs() <= rounding;
                compressed[part] |= strain < -rounding;
            }
        }
        Self { unstrained, compressed }
    }
}

/// For every part, whether it stays where it is.
pub(super) fn at_rest(
    system: &System,
    state: &State,
    extensions: &Extensions,
    parts: &Parts,
    strains: &Strains,
) -> Vec<bool> {
    let n = system.particles();
    let mut force = vec![Vector3::zeros(); n];
    add_elastic_force(system, extensions, &mut force);
    add_weight(system, &mut force);
    let mut magnitude: Vec<f64> = system.masses().iter().map(|mass| mass * system.gravity().norm()).collect();
    let moving = moving_axes(system);
    let mut resting = vec![true; n];
    for ((_, pair, spring), at) in extensions.springs(system) {
        let reach: f64 = pair.iter().map(|&p| state.positions[p].norm()).sum();
        let terms = spring.elastic_force(at).norm() + spring.stiffness / spring.rest_length * reach;
        let disturbed = pair.iter().any(|&p| moving[p].contains(&true));
        for p in pair {
            magnitude[p] += terms;
            resting[parts.part(p)] &= !disturbed;
        }
    }
    for p in 0..n {
        let net = system.dofs().free_axes(p).iter().map(|axis| force[p][axis].abs()).fold(0.0, f64::max);
        let allowed = if strains.compressed[parts.part(p)] { 0.0 } else { ROUNDINGS * f64::EPSILON * magnitude[p] };
        let still = state.velocities[p].iter().all(|v| *v == 0.0) && !moving[p].contains(&true);
        resting[parts.part(p)] &= still && net <= allowed;
    }
    resting
}

/// For every part, whether it moves as one, so that no spring in it is ever strained that is not now: all its particles have one
/// velocity, and those that are led are led with it, along axes without gravity.
pub(super) fn as_one(system: &System, state: &State, parts: &Parts) -> Vec<bool> {
    let mut as_one = vec![true; system.particles()];
    let motions = system.prescribed().motions();
    let mut leads = vec![[None; 3]; system.particles()];
    for (Dof { particle, axis }, _, motion) in system.prescribed().iter() {
        leads[particle][axis] = Some(match &motions[motion] {
            Motion::Held => Some(0.0),
            Motion::Velocity(v) => Some(v[axis]),
            Motion::Path { .. } => None,
        });
    }
    let agrees = |p: usize, velocity: Vector3<f64>| {
        let is_led_so = |axis: usize| {
            leads[p][axis].is_none_or(|lead| lead == Some(velocity[axis]) && system.gravity()[axis] == 0.0)
        };
        let is_free = system.dofs().free_axes(p) != Axes::NONE;
        (!is_free || state.velocities[p] == velocity) && (0..system.dimension()).all(is_led_so)
    };
    for p in 0..system.particles() {
        let part = parts.part(p);
        as_one[part] &= agrees(p, state.velocities[part]);
    }
    // A particle that is wholly led is of no part: what hangs on it must go with it.
    for (_, pair, _) in system.active() {
        for (here, there) in [(pair[0], pair[1]), (pair[1], pair[0])] {
            let part = parts.part(here);
            as_one[part] &= agrees(there, state.velocities[part]);
        }
    }
    as_one
}
