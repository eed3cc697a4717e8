//! One run on the model problem, and what fails first.

use crate::accuracy::Configuration;
use crate::error::Result;
use crate::force::Energy;
use crate::integrate::{Status, TimeStepper};
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
    /// All verdicts in words, in the order in which they are looked for.
    pub const NAMES: [&'static str; 8] = [
        "stable",
        "not finite",
        "A indefinite",
        "not converged",
        "energy grows",
        "step longer than a spring",
        "turning is braked",
        "stretched by turning",
    ];

    /// In words.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

/// Takes a step of dt seconds and returns the energy after it; fails with the method, where the energy exceeds `most`, and where a particle goes
/// further than `longest`.
pub(super) fn step(
    stepper: &mut dyn TimeStepper,
    state: &mut State,
    dt: f64,
    energy: impl Fn(&State) -> f64,
    (particle, longest): (usize, f64),
    most: f64,
) -> Result<f64, TileVerdict> {
    let before = state.positions[particle];
    stepper.step(state, dt).map_err(|failure| match failure.status() {
        Status::Indefinite => TileVerdict::Indefinite,
        Status::NotConverged => TileVerdict::NotConverged,
        _ => TileVerdict::NonFinite,
    })?;
    match energy(state) {
        energy if !energy.is_finite() => Err(TileVerdict::NonFinite),
        energy if energy > most => Err(TileVerdict::EnergyGrowth),
        _ if (state.positions[particle] - before).norm() > longest => Err(TileVerdict::LongStep),
        energy => Ok(energy),
    }
}

/// Rest length, mass and ω are 1, so k = ½ l0 m ω² = ½.
const STIFFNESS: f64 = 0.5;

/// The model at a stretch and an axial damping ratio ζ: `2b = 2ζ m ω`.
fn model(stretch: f64, damping_ratio: f64) -> Result<(System, State)> {
    let spring = Spring { stiffness: STIFFNESS, rest_length: 1.0, damping: damping_ratio };
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    // So little off its place of rest, along and across, the stretched model stays linear even when its energy has grown a thousandfold.
    let particle = builder.particle([5e-4, 5e-4, 0.0], 1.0);
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
    // Stretched, the energy of a symplectic method oscillates by (2 + z)/(2 − z), a hundred at z = 1.96; compressed, the particle falls off the line.
    let growth = if stretch >= 1.0 { 1000.0 } else { 2.0 };
    let excess = |state: &State| Energy::of(&system, state).total() - minimum;
    let initial = excess(&state);
    // So many steps multiply the energy by a thousand where it grows by 0.35 % a step.
    for _ in 0..2000 {
        match step(&mut *stepper, &mut state, z, excess, (0, stretch), growth * initial) {
            Err(verdict) => return Ok(verdict),
            // Damped away: growth would have to begin from nothing.
            Ok(energy) if energy < 1e-9 * initial => break,
            Ok(_) => {}
        }
    }
    Ok(TileVerdict::Stable)
}
