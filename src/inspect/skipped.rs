//! What an inspection consists of, what it may cost, and what of it was skipped.
//!
//! The parts are looked at in the order of what they tell. Before each its cost is estimated from the work of one factorization, one
//! solve and one step of a search for eigenvalues, and a part that would take the whole beyond what it may cost is skipped. These are
//! counts, not times: on every machine the same parts are skipped.

use crate::linear::FactorSize;
use crate::spring::Stiffness;

/// A part of an inspection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Whether A is positive definite under the option that is examined, and the spring that spoils it most.
    FirstAnswer,
    /// The signs of the eigenvalues of A.
    Signs(Stiffness),
    /// The modes of the exact motion that grow.
    GrowingModes,
    /// The longest step that turns no spring too far.
    Turning(Stiffness),
    /// λ_min, λ_max and the condition number; under the option that is examined also the springs behind them.
    Spectrum(Stiffness),
    /// The longest step for which A is positive definite.
    Definite(Stiffness),
    /// The longest step that adds no instability.
    Stable(Stiffness),
    /// Which transverse terms must go.
    SmallestSet,
    /// λ_min over the time step, in a picture.
    Curve,
}

impl Part {
    /// Every part, in no particular order.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        let of_each = [Self::Signs, Self::Spectrum, Self::Definite, Self::Stable];
        [Self::FirstAnswer, Self::GrowingModes, Self::SmallestSet, Self::Curve]
            .into_iter()
            .chain([Self::Turning(Stiffness::Tension), Self::Turning(Stiffness::Axial)])
            .chain(of_each.into_iter().flat_map(|of| Stiffness::ALL.map(of)))
    }
}

/// Why a part was skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SkipReason {
    /// It was not looked at yet.
    Interrupted,
    /// It would have cost more than the inspection may.
    TooMuchWork,
    /// A factor of A does not fit the memory.
    TooMuchMemory,
}

/// A part that was skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Skipped {
    /// What.
    pub part: Part,
    /// Why.
    pub why: SkipReason,
}

/// Operations that an inspection may take unless it is asked for everything: about a minute.
pub const AFFORDABLE: f64 = 1e12;

/// From so many rows on nothing is factored unless everything is asked for: one factorization of a cloth of that size takes seconds, of a
/// solid minutes, and the ordering before it as long.
pub const LARGEST_FACTORED: usize = 500_000;

/// Operations of an estimate by products and multigrid, for each row.
pub(super) const ESTIMATE: f64 = 2e5;

/// Factorizations of a count of signs, of a search for both ends of a spectrum, and of one for a limit of the step, for what is hardest of each;
/// searches for eigenvalues in the latter two; points of the curve of λ_min.
const COUNTED: f64 = 2.0;
const ENDS: f64 = 5.0;
const LIMIT: f64 = 6.0;
const TURNING: f64 = 2.0;
const END_SEARCHES: f64 = 2.0;
const LIMIT_SEARCHES: f64 = 2.0;
const CURVE: f64 = 51.0;

/// Steps of a search for eigenvalues, and operations of one for each row: every new vector is made orthogonal to some fifty others,
/// twice, and eight are made at a time.
const SEARCH_STEPS: f64 = 25.0;
const SEARCH_OPERATIONS: f64 = 6000.0;

/// Right-hand sides that are solved for together, and what an operation counts for that waits for the memory.
const COLUMNS: f64 = 8.0;
const SLOW: f64 = 4.0;

/// Operations that the parts take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cost {
    factorization: f64,
    search: f64,
    rows: f64,
}

/// Up to this order a matrix is diagonalised whole, with `10 n³` operations or so.
const LARGEST_DENSE: f64 = 240.0;

impl Cost {
    pub fn of(size: &FactorSize, rows: usize) -> Self {
        let (entries, rows) = (size.entries as f64, rows as f64);
        let step = SLOW * (4.0 * COLUMNS * entries + SEARCH_OPERATIONS * rows);
        Self { factorization: size.flops + SLOW * entries, search: SEARCH_STEPS * step, rows }
    }

    pub fn part(&self, part: Part) -> f64 {
        let Self { factorization, search, rows } = *self;
        let eigenvalues = |searches: f64| match rows <= LARGEST_DENSE {
            true => 10.0 * rows.powi(3),
            false => ENDS * factorization + searches * search,
        };
        match part {
            Part::FirstAnswer => factorization,
            Part::Signs(_) | Part::GrowingModes => COUNTED * factorization,
            Part::Turning(_) => TURNING * factorization + search,
            Part::SmallestSet => LIMIT * factorization,
            Part::Spectrum(_) => eigenvalues(END_SEARCHES),
            Part::Definite(_) | Part::Stable(_) => LIMIT * factorization + LIMIT_SEARCHES * search,
            Part::Curve => CURVE * eigenvalues(1.0),
        }
    }
}

/// What has been spent, and what is skipped as things stand.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Budget {
    cost: Cost,
    left: f64,
    spent: f64,
    /// What everything would cost.
    whole: f64,
    pub skipped: Vec<Skipped>,
}

impl Budget {
    /// Nothing done yet of these parts; `most` operations to spend.
    pub fn new(cost: Cost, most: f64, parts: impl IntoIterator<Item = Part>) -> Self {
        let skipped: Vec<Skipped> =
            parts.into_iter().map(|part| Skipped { part, why: SkipReason::Interrupted }).collect();
        let whole = skipped.iter().map(|skipped| cost.part(skipped.part)).sum::<f64>().min(most);
        Self { cost, left: most, spent: 0.0, whole, skipped }
    }

    /// Whether a part may be looked at. If so its cost is spent; if not it is skipped for good.
    pub fn affords(&mut self, part: Part) -> bool {
        let cost = self.cost.part(part);
        if cost <= self.left {
            self.left -= cost;
            self.spent += cost;
            return true;
        }
        for skipped in self.skipped.iter_mut().filter(|skipped| skipped.part == part) {
            skipped.why = SkipReason::TooMuchWork;
        }
        false
    }

    /// How much of the work is done, from 0 to 1.
    pub fn share(&self) -> f64 {
        (self.spent / self.whole.max(1.0)).min(1.0)
    }

    /// Leaves a part out as another one was that tells it; whether that was.
    pub fn follows(&mut self, part: Part, other: Part) -> bool {
        let Some(why) = self.skipped.iter().find(|skipped| skipped.part == other).map(|skipped| skipped.why) else {
            return false;
        };
        self.skipped.iter_mut().filter(|skipped| skipped.part == part).for_each(|skipped| skipped.why = why);
        true
    }

    /// A part has been looked at, or there was nothing to look at.
    pub fn done(&mut self, part: Part) {
        self.skipped.retain(|skipped| skipped.part != part);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::OrderingMethod;

    #[test]
    fn parts_are_skipped_when_they_cost_more_than_is_left() {
        let size = FactorSize { entries: 0, flops: 1.0, ordering: OrderingMethod::Natural };
        let cost = Cost::of(&size, 0);
        let [first, second] = [Part::SmallestSet, Part::Definite(Stiffness::Axial)];
        let mut budget = Budget::new(cost, 2.0 * LIMIT - 1.0, [first, second, Part::GrowingModes]);
        assert!(budget.affords(first) && !budget.affords(second) && budget.affords(Part::GrowingModes));
        assert!(!budget.follows(Part::GrowingModes, Part::Curve));
        budget.done(first);
        let expected = [(second, SkipReason::TooMuchWork), (Part::GrowingModes, SkipReason::Interrupted)];
        assert_eq!(budget.skipped, expected.map(|(part, why)| Skipped { part, why }));
        assert!(budget.follows(Part::GrowingModes, second) && budget.skipped[1].why == SkipReason::TooMuchWork);
        assert!(Budget::new(cost, f64::INFINITY, []).affords(Part::Curve));
    }
}
