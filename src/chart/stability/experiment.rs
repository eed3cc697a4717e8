//! One run on the model problem, and what fails first.

use crate::accuracy::Configuration;
use crate::error::Result;
use crate::force::Energy;
use crate::integrate::Status;
use crate::spring::Spring;
use crate::system::{State, System, SystemBuilder};
use serde::Serialize;

/// The first failure of a run; where several things fail in one step, the first in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TileVerdict {
    /// Nothing failed.
    Stable,
    /// The state overflowed or became undefined.
    NonFinite,
    /// A factorization was refused: A is not positive definite.
    Indefinite,
    /// A linear or nonlinear solver did not converge.
    NotConverged,
    /// Energy grew without work being done.
    EnergyGrowth,
    /// A step was longer than a spring.
    LongStep,
    /// A turning spring has lost more than a tenth of its angular momentum in a turn by one radian.
    Braked,
    /// Turning has stretched a spring by more than one per cent.
    Stretched,
}

impl TileVerdict {
    /// Every verdict, in the order in which they are looked for.
    pub const ALL: [Self; 8] = [
        Self::Stable,
        Self::NonFinite,
        Self::Indefinite,
        Self::NotConverged,
        Self::EnergyGrowth,
        Self::LongStep,
        Self::Braked,
        Self::Stretched,
    ];

    pub(super) fn of_failure(status: Status) -> Self {
        match status {
            Status::Indefinite => Self::Indefinite,
            Status::NotConverged => Self::NotConverged,
            _ => Self::NonFinite,
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stable => "stable",
            Self::NonFinite => "not finite",
            Self::Indefinite => "A indefinite",
            Self::NotConverged => "not converged",
            Self::EnergyGrowth => "energy grows",
            Self::LongStep => "step longer than a spring",
            Self::Braked => "turning is braked",
            Self::Stretched => "stretched by turning",
        }
    }
}

/// Enough steps for a growth of 0.35 % a step to multiply the energy by a thousand.
const STEPS: usize = 2000;

/// The part of the energy left when the motion counts as damped away: growth would have to begin from nothing.
const DAMPED: f64 = 1e-9;

/// The particle starts this far off its place of rest, in units of l0, half along the springs and half across: small enough
/// for the stretched model to stay linear even when the energy has grown a thousandfold.
const OFFSET: f64 = 1e-3;

/// Growth of energy above its minimum that counts when the springs are stretched. The energy of a symplectic method
/// oscillates by (2 + z)/(2 − z) there, which is a hundred at z = 1.96.
const LINEAR_GROWTH: f64 = 1000.0;

/// The same when they are compressed: the particle falls off the line, and no part of its motion is small.
const NONLINEAR_GROWTH: f64 = 2.0;

/// Rest length, mass and ω are 1, so k = ½ l0 m ω² = ½.
const STIFFNESS: f64 = 0.5;

/// The model at a stretch and an axial damping ratio ζ: `2b = 2ζ m ω`.
fn model(stretch: f64, damping_ratio: f64) -> Result<(System, State)> {
    let spring = Spring { stiffness: STIFFNESS, rest_length: 1.0, damping: damping_ratio };
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let particle = builder.particle([OFFSET / 2.0, OFFSET / 2.0, 0.0], 1.0);
    for wall in [-stretch, stretch] {
        let wall = builder.particle([wall, 0.0, 0.0], 1.0);
        builder.spring(particle, wall, spring);
        builder.hold(wall);
    }
    builder.build()
}

/// Runs the model with steps `dt = z/ω` and says what fails first.
pub(super) fn experiment(
    configuration: &Configuration,
    z: f64,
    stretch: f64,
    damping_ratio: f64,
) -> Result<TileVerdict> {
    let (system, mut state) = model(stretch, damping_ratio)?;
    let mut stepper = configuration.method.stepper(&system, &state, &configuration.options)?;
    // Compressed springs have their minimum of energy off the line, where both are at rest.
    let minimum = if stretch > 1.0 { STIFFNESS * (stretch - 1.0) * (stretch - 1.0) } else { 0.0 };
    let growth = if stretch >= 1.0 { LINEAR_GROWTH } else { NONLINEAR_GROWTH };
    let excess = |state: &State| Energy::of(&system, state).total() - minimum;
    let initial = excess(&state);
    // A ten-thousandth of the energy at rest at least: its rounding does not count. What has no more is within two rest lengths of the middle.
    let allowed = growth * initial;
    for _ in 0..STEPS {
        let before = state.positions[0];
        if let Err(failure) = stepper.step(&mut state, z) {
            return Ok(TileVerdict::of_failure(failure.status()));
        }
        let energy = excess(&state);
        let verdict = if !energy.is_finite() {
            TileVerdict::NonFinite
        } else if energy > allowed {
            TileVerdict::EnergyGrowth
        } else if (state.positions[0] - before).norm() > stretch {
            TileVerdict::LongStep
        } else if energy < DAMPED * initial {
            TileVerdict::Stable
        } else {
            continue;
        };
        return Ok(verdict);
    }
    Ok(TileVerdict::Stable)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::{ImplicitOptions, Method};

    /// Beyond its limit Verlet's method multiplies the energy, and is found out long before a step is longer than a spring.
    #[test]
    fn energy_that_grows_is_seen_while_the_motion_is_small() {
        let configuration = Configuration { method: Method::Verlet, options: ImplicitOptions::default() };
        let at = |z: f64| experiment(&configuration, z, 2.0, 0.0).unwrap();
        assert_eq!([at(1.9), at(2.1)], [TileVerdict::Stable, TileVerdict::EnergyGrowth]);
    }
}
