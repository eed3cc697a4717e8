//! What answers by explicit methods cost, before any is made.

use super::Configuration;
use super::rates::Rates;
use crate::integrate::{ImplicitOptions, Method};

/// Steps of Verlet's method, in those that are stable for sure at the start: the state changes on the way.
const STABLE: f64 = 0.96;

/// A run has at least this many steps.
const FEWEST_STEPS: f64 = 3.0;

/// Accuracies from this on Verlet's method has, as a rule.
const FEW_DIGITS: f64 = 2e-5;

/// From the first run of a pair by Verlet's method to the second.
pub(super) const FIRST_RATIO: f64 = 1.25;

/// Radians of the fastest motion in the longest steps of DOP853. Stable are 5.9.
const DOP853_RADIANS: f64 = 5.4;

/// What a step of it takes with what is seen of it, in force evaluations.
pub(super) const DOP853_STEP: f64 = 15.0;

/// An answer by it takes so many times the work of the longest steps, as a rule, where three digits are asked for; and by what power of the
/// accuracy more where more are, steps being shorter: twice for three digits more.
pub(super) const DOP853_ANSWER: f64 = 2.3;
const MORE_DIGITS: f64 = 0.1;

/// What explicit answers are said to cost, in force evaluations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Price {
    /// A run of Verlet's method with the longest steps.
    pub verlet: f64,
    /// The longest steps of DOP853, as far as stability decides.
    pub steps: f64,
    /// The spectral radius, in 1/s.
    pub radius: f64,
}

impl Price {
    pub fn of(rates: &Rates, duration: f64) -> Self {
        let verlet = (duration / (STABLE * rates.verlet_step())).max(FEWEST_STEPS);
        let radius = rates.radius();
        let steps = (duration * radius / DOP853_RADIANS).max(FEWEST_STEPS).ceil();
        Self { verlet, steps, radius }
    }

    /// An answer of this accuracy, as a rule.
    pub fn answer(&self, accuracy: f64) -> f64 {
        if accuracy >= FEW_DIGITS { (1.0 + FIRST_RATIO) * self.verlet } else { self.dop853(accuracy) }
    }

    /// An answer of this accuracy by DOP853, as a rule.
    pub fn dop853(&self, accuracy: f64) -> f64 {
        DOP853_ANSWER * DOP853_STEP * self.steps * (1e-3 / accuracy).max(1.0).powf(MORE_DIGITS)
    }
}

pub(super) fn of(method: Method) -> Configuration {
    Configuration { method, options: ImplicitOptions::default() }
}
