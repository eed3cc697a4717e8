//! Ready scenes of any size, made by formula.
//!
//! All use SI units and start at rest unless they say otherwise. None has a time step. The vertical axis is y.

mod chain;
mod cloth;
mod column;
mod lattice;
mod network;
mod pendulum;
mod refined;
mod string;

pub use chain::chain;
pub use cloth::cloth;
pub use column::column;
pub use lattice::lattice;
pub use network::network;
pub use pendulum::pendulum;
pub use refined::refined;
pub use string::string;

use super::{ConstraintEntry, Gravity, Scene, TimeSettings};
use crate::error::{Error, Result};
use std::ops::RangeInclusive;

/// The standard acceleration of free fall downwards, rounded, in m/s².
const GRAVITY: [f64; 3] = [0.0, -9.81, 0.0];

/// The kinds of ready scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[non_exhaustive]
pub enum Kind {
    /// A chain of SIZE links, held at one end and let go from the horizontal.
    Chain,
    /// A square cloth of SIZE × SIZE particles that swings down from two corners.
    Cloth,
    /// A cantilever block of SIZE × SIZE × SIZE particles that bends under its weight.
    Lattice,
    /// A straight column of SIZE joints, compressed between two held ends, that buckles.
    Column,
    /// A stiff pendulum of SIZE bobs in the plane, let go from the horizontal.
    Pendulum,
    /// A taut string of SIZE particles in the plane, struck in its lowest mode.
    String,
    /// A random network of SIZE particles with all values unequal, hung by its highest particles.
    Network,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 7] =
        [Self::Chain, Self::Cloth, Self::Lattice, Self::Column, Self::Pendulum, Self::String, Self::Network];

    /// The kind's name, also that of its scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Chain => "chain",
            Self::Cloth => "cloth",
            Self::Lattice => "lattice",
            Self::Column => "column",
            Self::Pendulum => "pendulum",
            Self::String => "string",
            Self::Network => "network",
        }
    }

    /// A size that shows what the kind is about and runs in a moment.
    pub fn default_size(self) -> usize {
        match self {
            Self::Chain => 20,
            Self::Cloth => 20,
            Self::Lattice => 8,
            Self::Column => 9,
            Self::Pendulum => 1,
            Self::String => 31,
            Self::Network => 60,
        }
    }

    /// The sizes there are: up to about 10⁶ particles.
    pub fn sizes(self) -> RangeInclusive<usize> {
        match self {
            Self::Cloth => 1..=1000,
            Self::Lattice => 1..=100,
            Self::Pendulum => 1..=1000,
            Self::Chain | Self::Column | Self::String | Self::Network => 1..=1_000_000,
        }
    }

    fn check_size(self, size: usize) -> Result<()> {
        let sizes = self.sizes();
        if sizes.contains(&size) {
            return Ok(());
        }
        let (name, least, most) = (self.name(), sizes.start(), sizes.end());
        Err(Error::Scene(format!("size {size}: a {name} can have a size from {least} to {most}")))
    }
}

/// The scene of a kind and size; a random one is made with seed 0.
///
/// # Errors
/// [`Error::Scene`] for a size outside [`Kind::sizes`].
///
/// # Examples
/// ```
/// use sprung::scene::{Kind, builtin};
///
/// let scene = builtin(Kind::Cloth, 10)?;
/// let (system, _) = scene.build()?;
/// assert_eq!(system.particles(), 100);
/// assert!(builtin(Kind::Cloth, 0).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn builtin(kind: Kind, size: usize) -> Result<Scene> {
    match kind {
        Kind::Chain => chain(size),
        Kind::Cloth => cloth(size),
        Kind::Lattice => lattice(size),
        Kind::Column => column(size),
        Kind::Pendulum => pendulum(size),
        Kind::String => string(size),
        Kind::Network => network(size, 0),
    }
}

fn hold(particles: impl IntoIterator<Item = usize>) -> ConstraintEntry {
    ConstraintEntry { particles: particles.into_iter().map(|p| p as u32).collect(), ..ConstraintEntry::default() }
}

/// Neighbours in a row of particles: (0, 1), (1, 2), …
fn links(count: usize) -> Vec<[u32; 2]> {
    (0..count as u32).map(|i| [i, i + 1]).collect()
}

fn gravity() -> Option<Gravity> {
    Some(GRAVITY.into())
}

/// For a while, in s; a run chooses its steps.
fn lasting(duration: f64) -> TimeSettings {
    TimeSettings { dt: None, duration: Some(duration) }
}

#[cfg(test)]
mod tests {
    use super::{Kind, builtin};

    /// At 9.81 m/s²; the taut string alone has no weight.
    #[test]
    fn what_hangs_falls_down() {
        for kind in Kind::ALL {
            let (system, _) = builtin(kind, kind.default_size()).unwrap().build().unwrap();
            let expected = if kind == Kind::String { 0.0 } else { -9.81 };
            assert_eq!(system.gravity().as_slice(), [0.0, expected, 0.0], "{}", kind.name());
        }
    }
}
