//! What a scene does not need is not modelled: exact reductions.
//!
//! Each takes degrees of freedom away that keep their value for all time, for a reason that can be read off the equations
//! of motion, so that the motion of the rest is the same. Springs between held particles and absent axes never enter a
//! [`System`]; found here is what only the state shows, for each part of the scene (particles joined by springs through
//! particles that can move) on its own:
//!
//! - **Axes without force.** Every spring of the part is perpendicular to the axis, its particles have no velocity and no
//!   gravity along it, and nothing leads them along it. A spring's force has the direction of the spring: its component along
//!   the axis is exactly zero now, the springs stay perpendicular, and so for all time.
//! - **Parts at rest.** Nothing in the part moves, the particles that hold it never do, and the net force on every free
//!   coordinate is zero: exactly, or to rounding where no spring of the part is compressed, since its equilibrium is then
//!   stable and rounding stays rounding.

use crate::force::{Extensions, add_elastic_force, add_weight};
use crate::system::{Axes, Dof, Motion, State, System};
use nalgebra::Vector3;
use serde::Serialize;

/// Something that need not be modelled.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Reduction {
    /// The scene's rows have fewer than three entries.
    Dimensions {
        /// How many they have.
        modelled: usize,
    },
    /// No spring that can move is damped: there is no damping matrix.
    Damping,
    /// Springs between wholly prescribed particles: no force of theirs moves anything.
    HeldSprings {
        /// How many.
        springs: usize,
    },
    /// Coordinates along an axis without force or velocity.
    Axis {
        /// `x`, `y` or `z`.
        axis: char,
        /// Free coordinates that this takes away.
        coordinates: usize,
    },
    /// Particles at rest that nothing moves.
    AtRest {
        /// How many.
        particles: usize,
        /// Free coordinates that this takes away.
        coordinates: usize,
    },
}

impl std::fmt::Display for Reduction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Dimensions { modelled: 1 } => write!(f, "one dimension: the other two are not modelled"),
            Self::Dimensions { .. } => write!(f, "two dimensions: the third is not modelled"),
            Self::Damping => write!(f, "no damping: no damping matrix"),
            Self::HeldSprings { springs } => write!(f, "{springs} springs between held particles left out"),
            Self::Axis { axis, coordinates } => {
                write!(f, "{coordinates} coordinates along {axis} left out: no force or velocity points along it")
            }
            Self::AtRest { particles, coordinates } => {
                write!(f, "{particles} particles at rest that nothing moves ({coordinates} coordinates) left out")
            }
        }
    }
}

/// A system without what it does not need, and what that was.
#[derive(Debug, Clone)]
pub struct Reduced {
    /// The same particles and springs with fewer degrees of freedom.
    pub system: System,
    /// What was found.
    pub reductions: Vec<Reduction>,
}

/// Net forces up to this many roundings of the forces that balance count as zero.
const ROUNDINGS: f64 = 16.0;

/// Takes from a system whatever cannot move from the given state on.
///
/// The motion is the same: bitwise where the arithmetic of the rest is (explicit methods), else to the rounding of another
/// elimination order. With the policy `on-demand` a matrix may be definite without the degrees of freedom that are left
/// out and not with them; then the reduced run keeps terms that the full one drops.
///
/// # Examples
/// ```
/// use sprung::accuracy::reduce;
/// use sprung::{Spring, SystemBuilder};
///
/// // Everything happens on the x axis, in a scene that is written in space.
/// let mut builder = SystemBuilder::new();
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([1.0, 0.0, 0.0], 1.0);
/// builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// let (system, state) = builder.build()?;
/// let reduced = reduce(&system, &state);
/// assert!(reduced.system.dofs().len() <= system.dofs().len());
/// for reduction in &reduced.reductions {
///     println!("{reduction}");
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn reduce(system: &System, state: &State) -> Reduced {
    let mut reductions = Vec::new();
    if system.dimension() < 3 {
        reductions.push(Reduction::Dimensions { modelled: system.dimension() });
    }
    if !system.is_damped() && !system.springs().is_empty() {
        reductions.push(Reduction::Damping);
    }
    let inactive = system.springs().len() - system.active_springs().len();
    if inactive > 0 {
        reductions.push(Reduction::HeldSprings { springs: inactive });
    }
    let Ok(extensions) = Extensions::at(system, &state.positions) else {
        return Reduced { system: system.clone(), reductions };
    };
    let parts = Parts::of(system);
    let resting = at_rest(system, state, &extensions, &parts);
    let mut held: Vec<Dof> = Vec::new();
    let mut rest = (0, 0);
    for particle in (0..system.particles()).filter(|&p| system.dofs().free_axes(p) != Axes::NONE) {
        if resting.get(parts.part(particle)).copied().unwrap_or(false) {
            let axes = system.dofs().free_axes(particle);
            held.extend(axes.iter().map(|axis| Dof { particle, axis }));
            rest = (rest.0 + 1, rest.1 + axes.count());
        }
    }
    for axis in 0..system.dimension() {
        let flat = without_force(system, state, &parts, axis);
        let is_flat = |p: usize| {
            let part = parts.part(p);
            flat.get(part) == Some(&true) && resting.get(part) == Some(&false)
        };
        let free = |p: &usize| system.dofs().free_axes(*p).contains(axis) && is_flat(*p);
        let before = held.len();
        held.extend((0..system.particles()).filter(free).map(|particle| Dof { particle, axis }));
        if held.len() > before {
            let axis = Dof { particle: 0, axis }.axis_name();
            reductions.push(Reduction::Axis { axis, coordinates: held.len() - before });
        }
    }
    if rest.0 > 0 {
        reductions.push(Reduction::AtRest { particles: rest.0, coordinates: rest.1 });
    }
    let system = if held.is_empty() { system.clone() } else { system.with_held(&held, &state.positions) };
    Reduced { system, reductions }
}

/// Particles joined by springs through particles that are not wholly prescribed.
struct Parts {
    part: Vec<usize>,
}

impl Parts {
    fn of(system: &System) -> Self {
        let mut part: Vec<usize> = (0..system.particles()).collect();
        let is_free = |p: usize| system.dofs().free_axes(p) != Axes::NONE;
        for (_, [i, j], _) in system.active().filter(|(_, pair, _)| pair.iter().all(|&p| is_free(p))) {
            let (a, b) = (root(&mut part, i), root(&mut part, j));
            part[a.max(b)] = a.min(b);
        }
        for p in 0..part.len() {
            part[p] = root(&mut part, p);
        }
        Self { part }
    }

    fn part(&self, particle: usize) -> usize {
        self.part[particle]
    }
}

/// The representative of a particle's part, with path halving.
fn root(part: &mut [usize], mut p: usize) -> usize {
    while part[p] != p {
        part[p] = part[part[p]];
        p = part[p];
    }
    p
}

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
fn without_force(system: &System, state: &State, parts: &Parts, axis: usize) -> Vec<bool> {
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

/// For every part, whether it stays where it is.
fn at_rest(system: &System, state: &State, extensions: &Extensions, parts: &Parts) -> Vec<bool> {
    let n = system.particles();
    let mut force = vec![Vector3::zeros(); n];
    add_elastic_force(system, extensions, &mut force);
    add_weight(system, &mut force);
    let mut magnitude: Vec<f64> = system.masses().iter().map(|mass| mass * system.gravity().norm()).collect();
    let mut compressed = vec![false; n];
    let moving = moving_axes(system);
    let mut resting = vec![true; n];
    for ((_, pair, spring), at) in extensions.springs(system) {
        // A length is rounded like the coordinates that it is the difference of.
        let reach: f64 = pair.iter().map(|&p| state.positions[p].norm()).sum();
        let terms = spring.elastic_force(at).norm() + spring.stiffness / spring.rest_length * reach;
        let disturbed = pair.iter().any(|&p| moving[p].contains(&true));
        for p in pair {
            magnitude[p] += terms;
            compressed[parts.part(p)] |= spring.is_compressed(at);
            resting[parts.part(p)] &= !disturbed;
        }
    }
    for p in 0..n {
        let net = system.dofs().free_axes(p).iter().map(|axis| force[p][axis].abs()).fold(0.0, f64::max);
        let allowed = if compressed[parts.part(p)] { 0.0 } else { ROUNDINGS * f64::EPSILON * magnitude[p] };
        let still = state.velocities[p].iter().all(|v| *v == 0.0) && !moving[p].contains(&true);
        resting[parts.part(p)] &= still && net <= allowed;
    }
    resting
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_end_at_prescribed_particles() {
        let mut builder = crate::SystemBuilder::new();
        for x in 0..5 {
            builder.particle([f64::from(x), 0.0, 0.0], 1.0);
        }
        for i in 0..4 {
            builder.spring(i, i + 1, crate::Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        builder.hold(2);
        let (system, _) = builder.build().unwrap();
        let parts = Parts::of(&system);
        assert_eq!(parts.part, [0, 0, 2, 3, 3]);
    }

    fn spring(stiffness: f64, rest_length: f64) -> crate::Spring {
        crate::Spring { stiffness, rest_length, damping: 0.1 }
    }

    /// On the x axis hang two particles, in a scene that has a part of its own before them.
    fn on_an_axis(anchor: Motion) -> (System, State) {
        let mut builder = crate::SystemBuilder::new();
        for x in [[0.0, 5.0, 0.0], [1.0, 6.0, 1.0], [0.0; 3], [1.0, 0.0, 0.0], [2.1, 0.0, 0.0]] {
            builder.particle(x, 1.0);
        }
        for [i, j] in [[0, 1], [2, 3], [3, 4]] {
            builder.spring(i, j, spring(1.0, 1.0));
        }
        builder.constrain(crate::system::Constraint { particles: vec![2], axes: Axes::ALL, motion: anchor });
        builder.build().unwrap()
    }

    #[test]
    fn axes_without_force_are_left_out_part_by_part() {
        let axis = |axis| Reduction::Axis { axis, coordinates: 2 };
        let along = |x: f64, y: f64| Vector3::new(x, y, 0.0);
        let path = |to| Motion::Path { times: vec![0.0, 1.0], offsets: vec![Vector3::zeros(), to] };
        for (motion, expected) in [
            (Motion::Held, vec![axis('y'), axis('z')]),
            (Motion::Velocity(along(1.0, 0.0)), vec![axis('y'), axis('z')]),
            (Motion::Velocity(along(0.0, 1.0)), vec![axis('z')]),
            (path(along(1.0, 0.0)), vec![axis('y'), axis('z')]),
            (path(along(0.0, 1.0)), vec![axis('z')]),
        ] {
            let (system, mut state) = on_an_axis(motion.clone());
            assert_eq!(reduce(&system, &state).reductions, expected, "{motion:?}");
            state.velocities[4].z = 1.0;
            let expected: Vec<_> = expected.into_iter().filter(|of| *of != axis('z')).collect();
            assert_eq!(reduce(&system, &state).reductions, expected, "{motion:?}");
        }
    }

    /// A heavy particle between two walls, off the middle by a part of what rounding allows: 16 ε of `2 (F + κ (|x| + 5 m))` with the κ of 200 N/m and
    /// the F of 900 N of either spring, or, where these are compressed, by nothing.
    #[test]
    fn particles_rest_where_forces_balance_to_rounding() {
        let is_left_out = |part: f64, rest_length: f64, wall: Motion| {
            let allowed = 16.0 * f64::EPSILON * 2.0 * (900.0 + 1000.0);
            let mut builder = crate::SystemBuilder { dimension: 1, ..crate::SystemBuilder::new() };
            for x in [part * allowed / 400.0, -5.0, 5.0] {
                builder.particle([x, 0.0, 0.0], 1e5);
            }
            builder.spring(0, 1, spring(200.0 * rest_length, rest_length));
            builder.spring(0, 2, spring(200.0 * rest_length, rest_length));
            builder.hold(1);
            builder.constrain(crate::system::Constraint { particles: vec![2], axes: Axes::ALL, motion: wall });
            let (system, state) = builder.build().unwrap();
            reduce(&system, &state).reductions.contains(&Reduction::AtRest { particles: 1, coordinates: 1 })
        };
        for (part, rest_length, expected) in
            [(0.0, 0.5, true), (0.7, 0.5, true), (1.5, 0.5, false), (0.0, 6.0, true), (0.4, 6.0, false)]
        {
            assert_eq!(is_left_out(part, rest_length, Motion::Held), expected, "{part} {rest_length}");
        }
        assert!(!is_left_out(0.0, 0.5, Motion::Velocity(Vector3::new(1.0, 0.0, 0.0))));
    }
}
