//! What answers by explicit methods cost, before any is made.

use super::Configuration;
use super::rates::Rates;
use crate::integrate::{ImplicitOptions, Method};

/// Steps of Verlet's method, in the longest stable ones: the state changes on the way.
const STABLE: f64 = 0.93;

/// A run has at least this many steps.
const FEWEST_STEPS: f64 = 6.0;

/// From the first run of a pair by Verlet's method to the second.
pub(super) const FIRST_RATIO: f64 = 1.35;

/// A step of DOP853 takes twelve evaluations and spans six radians of the fastest motion; a quarter more for rejected ones.
const DOP853_COST: f64 = 12.0 / 6.0 * 1.25;

/// What explicit answers are said to cost, in force evaluations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Price {
    /// A run of Verlet's method with the longest steps.
    pub verlet: f64,
    /// A run of DOP853, as far as stability decides.
    dop853: f64,
    /// The spectral radius, in 1/s.
    pub radius: f64,
}

impl Price {
    pub fn of(rates: &Rates, duration: f64) -> Self {
        let verlet = (duration / (STABLE * rates.verlet_step())).max(FEWEST_STEPS);
        let radius = rates.radius();
        Self { verlet, dop853: DOP853_COST * duration * radius, radius }
    }

    /// An answer of this accuracy, as a rule.
    pub fn answer(&self, accuracy: f64) -> f64 {
        if accuracy >= 2e-5 { (1.0 + FIRST_RATIO) * self.verlet } else { 1.6 * self.dop853(accuracy) }
    }

    /// A run of DOP853 that accuracy may decide about too: some fifteen steps for 1e-3.
    pub fn dop853(&self, accuracy: f64) -> f64 {
        self.dop853.max(150.0 * (1e-3 / accuracy).powf(0.125))
    }
}

pub(super) fn of(method: Method) -> Configuration {
    Configuration { method, options: ImplicitOptions::default() }
}
