//! Which ladder to climb next, and what all ladders agree on.

use super::Requirement;
use super::candidates::{Kind, candidates, kind};
use super::ladder::{Ladder, Task};
use crate::error::Result;
use crate::integrate::Method;
use crate::system::System;
use nalgebra::Vector3;

/// The part of the required accuracy that the chosen run may use, by its estimate.
pub(super) const SAFETY: f64 = 0.75;

/// How much better the limit must be known than the accuracy required.
const LIMIT_SHARE: f64 = 1.0 / 3.0;

/// A ladder that needs this many times the work of another is given up.
const HOPELESS: f64 = 2.0;

/// A run that confirms another may have this many times the error allowed, by its own estimate.
const CONFIRMATION: f64 = 2.0;

/// Pilots that cost this many times the cheapest run have tried enough for a confirmation by a conservative method.
const EXPENSIVE: f64 = 100.0;

/// The end positions that methods agree on, and the relative error that is left in them.
pub(super) struct Limit {
    pub positions: Vec<Vector3<f64>>,
    pub error: f64,
}

/// All candidates, and what they have cost.
pub(super) struct Race {
    pub ladders: Vec<Ladder>,
    pub pilots: u32,
    pub pilot_cost: f64,
}

impl Race {
    pub fn new(system: &System, requirement: &Requirement) -> Self {
        Self { ladders: candidates(system, requirement), pilots: 0, pilot_cost: 0.0 }
    }

    pub fn climb(&mut self, ladder: usize, task: &Task<'_>) -> Result<()> {
        if let Some(ladder) = self.ladders.get_mut(ladder) {
            self.pilot_cost += ladder.climb(task)?;
            self.pilots += 1;
        }
        Ok(())
    }

    /// The ladder to climb next: the one with the cheapest rung, among those that may still win against `cheapest`.
    ///
    /// As long as there is no winner a ladder is measured against its own kind, and against the second cheapest of all kinds:
    /// what the methods of one kind agree on may be wrong, but hardly what two do. One that does not converge yet needs at
    /// least its next rung.
    pub fn next(&self, cheapest: f64, accuracy: f64) -> Option<usize> {
        let predicted = |ladder: &Ladder| ladder.predicted_cost(SAFETY * accuracy);
        let least = |of: Kind| {
            let rivals = self.ladders.iter().filter(|rival| kind(rival.configuration.method) == of);
            rivals.filter_map(predicted).fold(cheapest, f64::min)
        };
        let mut of_kinds = Kind::ALL.map(least);
        of_kinds.sort_by(f64::total_cmp);
        let [first, second, _] = of_kinds;
        let of_any = if cheapest.is_finite() { first } else { second };
        let promising = |ladder: &Ladder| {
            let rival = least(kind(ladder.configuration.method)).min(of_any);
            ladder.open
                && ladder.next_cost() < cheapest
                && predicted(ladder).unwrap_or(ladder.next_cost()) <= HOPELESS * rival
        };
        let open = self.ladders.iter().enumerate().filter(|(_, ladder)| promising(ladder));
        open.min_by(|(_, a), (_, b)| a.next_cost().total_cmp(&b.next_cost())).map(|(index, _)| index)
    }

    /// The best-known end positions, if they are known well enough and confirmed.
    ///
    /// A method that damps may converge, at steps much longer than a vibration, to the motion without that vibration; so do
    /// its relatives. So the limit must agree with a method of another kind, and with one that cannot damp, each of about the
    /// accuracy required by its own estimate. Only when that has become far too expensive any other method will do.
    pub fn limit(&self, task: &Task<'_>, accuracy: f64) -> Option<Limit> {
        let mut limits: Vec<_> = self
            .ladders
            .iter()
            .filter_map(|ladder| {
                let (positions, error) = ladder.limit()?;
                (error <= LIMIT_SHARE * accuracy).then_some((ladder.configuration.method, positions, error))
            })
            .collect();
        limits.sort_by(|a, b| a.2.total_cmp(&b.2));
        let is_asked_alone = |method: Method| self.ladders.iter().all(|ladder| ladder.configuration.method == method);
        let confirmed = |(method, positions, error): &(Method, Vec<Vector3<f64>>, f64)| {
            let confirms = |ladder: &&Ladder| {
                let (Some(last), Some(own)) = (ladder.rungs.last(), ladder.estimate()) else { return false };
                own < CONFIRMATION * accuracy && task.distance(&last.positions, positions) <= 2.0 * (own + error)
            };
            let confirming = || self.ladders.iter().filter(confirms).map(|ladder| ladder.configuration.method);
            let cheapest =
                self.ladders.iter().filter_map(|ladder| ladder.predicted_cost(accuracy)).fold(f64::MAX, f64::min);
            let is_expensive = self.pilot_cost > EXPENSIVE * cheapest;
            is_asked_alone(*method)
                || (confirming().any(|other| kind(other) != kind(*method))
                    && (is_expensive || confirming().any(|other| kind(other) == Kind::Conservative)))
        };
        let (_, positions, error) = limits.into_iter().find(confirmed)?;
        Some(Limit { positions, error })
    }
}
