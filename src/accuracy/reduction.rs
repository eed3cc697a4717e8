//! What a scene does not need is not modelled: exact reductions.
//!
//! Each takes degrees of freedom away that keep their value for all time, or springs that never pull, for a reason that can be read off the
//! equations of motion, so that the motion of the rest is the same. Springs between held particles and absent axes never enter a
//! [`System`]; found here is what only the state shows, for each part of the scene (particles joined by springs through
//! particles that can move) on its own:
//!
//! - **Axes without force.** Every spring of the part is perpendicular to the axis, its particles have no velocity and no
//!   gravity along it, and nothing leads them along it. A spring's force has the direction of the spring: its component along
//!   the axis is exactly zero now, the springs stay perpendicular, and so for all time.
//! - **Parts at rest.** Nothing in the part moves, the particles that hold it never do, and the net force on every free
//!   coordinate is zero: exactly, or to rounding where no spring of the part is compressed by more than that, since its equilibrium is then
//!   stable and rounding stays rounding.
//! - **Springs of parts that fall or drift as one.** Every spring has its rest length, all particles have one velocity, and what leads some
//!   of them leads them with it. Only gravity acts, on all in the same way, and lengths stay what they are: the springs never pull. That
//!   lengths are rounded gives them an energy of rounding, and more than that no motion of the part ever gets.
//!
//! Forces from outside may do anything: with them nothing is looked for that the state shows. Nor are equilibria with a spring law of the
//! caller's own, which may fall where tension rises.

mod found;
mod parts;

use crate::force::Extensions;
use crate::system::{Axes, Dof, State, System};
use found::{Strains, as_one, at_rest, without_force};
use parts::Parts;
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
    /// Springs of parts that fall or drift as one, which never pull.
    Slack {
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
            Self::Slack { springs } => {
                write!(f, "{springs} springs left out: what they join moves as one, and they keep their rest lengths")
            }
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
/// assert_eq!([system.dofs().len(), reduced.system.dofs().len()], [6, 2]);
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
    let found = if system.has_external_forces() { None } else { Found::of(system, state) };
    let Some(found) = found else { return Reduced { system: system.clone(), reductions } };
    let is_free = |p: usize| system.dofs().free_axes(p) != Axes::NONE;
    let mut held: Vec<Dof> = Vec::new();
    let mut particles = 0;
    for particle in (0..system.particles()).filter(|&p| is_free(p) && found.rests(p)) {
        held.extend(system.dofs().free_axes(particle).iter().map(|axis| Dof { particle, axis }));
        particles += 1;
    }
    let coordinates = held.len();
    for axis in 0..system.dimension() {
        let flat = without_force(system, state, &found.parts, axis);
        let is_flat = |p: usize| flat[found.parts.part(p)] && !found.rests(p);
        let free = |p: &usize| system.dofs().free_axes(*p).contains(axis) && is_flat(*p);
        let before = held.len();
        held.extend((0..system.particles()).filter(free).map(|particle| Dof { particle, axis }));
        if held.len() > before {
            let axis = Dof { particle: 0, axis }.axis_name();
            reductions.push(Reduction::Axis { axis, coordinates: held.len() - before });
        }
    }
    if particles > 0 {
        reductions.push(Reduction::AtRest { particles, coordinates });
    }
    let moving = system.with_held(&held, &state.positions);
    let system = moving.without_springs(|_, pair| pair.into_iter().any(|p| is_free(p) && found.is_slack(p)));
    let springs = moving.active_springs().len() - system.active_springs().len();
    if springs > 0 {
        reductions.push(Reduction::Slack { springs });
    }
    Reduced { system, reductions }
}

/// What the state shows.
struct Found {
    parts: Parts,
    resting: Vec<bool>,
    slack: Vec<bool>,
}

impl Found {
    fn of(system: &System, state: &State) -> Option<Self> {
        let extensions = Extensions::at(system, &state.positions).ok()?;
        let parts = Parts::of(system);
        if system.has_spring_law() {
            let nowhere = vec![false; system.particles()];
            return Some(Self { parts, resting: nowhere.clone(), slack: nowhere });
        }
        let strains = Strains::of(system, state, &extensions, &parts);
        let resting = at_rest(system, state, &extensions, &parts, &strains);
        let as_one = as_one(system, state, &parts);
        let slack =
            as_one.into_iter().zip(strains.unstrained).map(|(as_one, unstrained)| as_one && unstrained).collect();
        Some(Self { parts, resting, slack })
    }

    fn rests(&self, particle: usize) -> bool {
        self.resting[self.parts.part(particle)]
    }

    fn is_slack(&self, particle: usize) -> bool {
        self.slack[self.parts.part(particle)]
    }
}

#[cfg(test)]
mod tests;
