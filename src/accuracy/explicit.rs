//! Answers by explicit methods: a pair of runs of [Verlet's method](super::verlet), or of [DOP853](super::dop853) where that is
//! not fine enough.
//!
//! **What is believed.** Differences count with their [envelope](super::course::Difference::envelope), and for no less than half of
//! what the law makes of the one before. One that has not contracted as it should is not believed: it shows that steps were
//! too long for the law, or that the motion forgets. Of the largest difference so far such a run has 1.5 times for its error.

use super::audience::Audience;
use super::rates::Rates;
use super::search::{Search, Verdict};
use super::{Configuration, dop853, verlet};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method};

/// Steps of Verlet's method, in the longest stable ones: the state changes on the way.
const STABLE: f64 = 0.93;

/// A run has at least this many steps.
const FEWEST_STEPS: f64 = 6.0;

/// What a difference that contracts is multiplied with.
pub(super) const PROVEN: f64 = 1.5;

/// A difference counts for at least this part of what the law makes of the one before: less is chance.
pub(super) const CHANCE: f64 = 0.5;

/// The part of the accuracy that an estimate may use.
pub(super) const USABLE: f64 = 0.8;

/// Runs that break down are tried with finer steps so many times.
pub(super) const RETRIES: u32 = 6;

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
        if accuracy >= 2e-5 { (1.0 + verlet::FIRST_RATIO) * self.verlet } else { 1.6 * self.dop853(accuracy) }
    }

    /// A run of DOP853 that accuracy may decide about too: some fifteen steps for 1e-3.
    pub fn dop853(&self, accuracy: f64) -> f64 {
        self.dop853.max(150.0 * (1e-3 / accuracy).powf(0.125))
    }
}

/// An answer by explicit methods.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price) -> Result<Verdict> {
    match verlet::answer(search, price)? {
        Ok(verdict) => Ok(verdict),
        Err(extrapolated) => dop853::answer(search, price, extrapolated.0),
    }
}

pub(super) fn of(method: Method) -> Configuration {
    Configuration { method, options: ImplicitOptions::default() }
}
