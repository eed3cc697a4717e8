//! Multigrid kept from one matrix to the next for as long as it pays.
//!
//! The finest level always has the matrix at hand. The coarse levels are recomputed when the iterations that their age has
//! cost since they were new add up to what recomputing costs: whatever comes next, this is at most twice the work of the
//! best choice of moments (the argument of renting or buying skis). They are also recomputed after a solve in which they took a
//! quarter more iterations than new ones, or within it: after a few iterations it can be told how many there will be. Where coarse levels
//! are too old one step after they were new, as in a fast motion, they are recomputed in every step for a while, and then tried
//! again, which costs little where it fails. Where every second matrix is refused as indefinite, and solved with when it has been made definite,
//! coarse levels are made for the definite ones alone. All is counted in iterations, never in seconds: a run
//! does the same as often as it is repeated (see `docs/robustness.md` for what another kind of processor may change).

use super::outcome::{Evidence, Progress, SolveFailure};
use crate::error::Result;
use crate::multigrid::{Multigrid, SetupFailure};
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use nalgebra::Vector3;

/// What recomputing the coarse levels costs, in iterations. It costs 10 to 12 (`cargo bench --bench multigrid`); counted with a little less a
/// crumpled cloth in motion never takes more than one and a half times the iterations of its first steps, for the same work in all.
const REBUILD: f64 = 8.0;

/// Coarse levels that took so many times the iterations of new ones, and more than one beyond, are not used again: the next solve would
/// take still more.
const SLOW: f64 = 1.25;

/// Iterations that new coarse levels must save, to take over within a solve.
const SAVED: f64 = 3.0;

/// What coarse levels may lose in the first solve with the next matrix; if more, the next so many matrices get new ones, and from time to
/// time twice as many, up to the most.
const AGED: f64 = 0.5 * REBUILD;
const RENEWALS: u32 = 4;
const MOST_RENEWALS: u32 = 512;

/// Age of the coarse levels.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Coarse {
    /// Never computed, or refused.
    Missing,
    /// Not used yet.
    New,
    /// Iterations per digit when they were new, and iterations lost to their age since.
    Used { per_digit: f64, lost: f64 },
}

/// Multigrid with a memory of what it has cost.
#[derive(Debug)]
pub struct ReusedMultigrid {
    multigrid: Multigrid,
    coarse: Coarse,
    /// Solves since the coarse levels were new.
    solves: u32,
    /// Matrices that get new coarse levels whatever the old ones cost.
    renewals: u32,
    /// How many such matrices there will be the next time.
    next_renewals: u32,
    /// Whether the last matrix was refused, and the one before.
    refused: [bool; 2],
    /// Whether the matrix at hand is likely to be.
    is_doubtful: bool,
}

impl ReusedMultigrid {
    /// Analyses a system, see [`Multigrid::new`].
    ///
    /// # Errors
    /// More matrix blocks than 32-bit indices can count.
    pub fn new(system: &System) -> Result<Self> {
        let multigrid = Multigrid::new(system)?;
        Ok(Self {
            multigrid,
            coarse: Coarse::Missing,
            solves: 0,
            renewals: 0,
            next_renewals: RENEWALS,
            refused: [false; 2],
            is_doubtful: false,
        })
    }

    /// See [`Multigrid::place`].
    pub fn place(&mut self, positions: &[Vector3<f64>]) {
        self.multigrid.place(positions);
    }

    /// Takes over a matrix, with new coarse levels if it is time, and if it is not likely to be refused: where matrices are refused and
    /// made definite then, step after step, every second one is.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
    pub fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.is_doubtful = self.refused == [false, true];
        self.refused = [false, self.refused[0]];
        let updated = self.refill_and_renew(a, work);
        if updated.is_err() {
            self.refused();
        }
        updated
    }

    fn refill_and_renew(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.multigrid.refill(a).map_err(failure)?;
        match self.coarse {
            Coarse::Used { .. } if self.is_doubtful => Ok(()),
            Coarse::Used { lost, .. } if lost < REBUILD && self.renewals == 0 => Ok(()),
            _ => {
                self.renewals = self.renewals.saturating_sub(1);
                self.renew(a, work)
            }
        }
    }

    /// Takes note that the matrix at hand is not positive definite, as a solve has found.
    pub fn refused(&mut self) {
        self.refused[0] = true;
    }

    /// Recomputes the coarse levels in a solve that they have made too long; counts it.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
    pub fn rebuild(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        if matches!(self.coarse, Coarse::Used { .. }) && self.solves <= 1 && !self.is_doubtful {
            self.age_fast();
        }
        self.renew(a, work)
    }

    /// Takes note of coarse levels that one matrix later are too old.
    fn age_fast(&mut self) {
        self.renewals = self.next_renewals;
        self.next_renewals = (2 * self.next_renewals).min(MOST_RENEWALS);
    }

    fn renew(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        work.multigrid_setups += 1;
        self.solves = 0;
        self.coarse = Coarse::Missing;
        self.multigrid.rebuild(a).map_err(failure)?;
        self.coarse = Coarse::New;
        Ok(())
    }

    /// Whether a solve should go on with coarse levels that are not new; `None` when they are.
    pub(super) fn patience(&self) -> Option<Patience> {
        match self.coarse {
            Coarse::Used { per_digit, .. } => {
                let first = if self.is_doubtful { FIRST + REBUILD as u64 } else { FIRST };
                Some(Patience { per_digit, first })
            }
            Coarse::New | Coarse::Missing => None,
        }
    }

    /// Takes note of what a solve has cost that gained this many decimal digits.
    pub fn record(&mut self, iterations: u64, digits: f64) {
        // A good first guess leaves too little to judge by.
        if digits.is_nan() || digits < 1.0 {
            return;
        }
        match &mut self.coarse {
            Coarse::New => self.coarse = Coarse::Used { per_digit: iterations as f64 / digits, lost: 0.0 },
            Coarse::Used { per_digit, lost } => {
                let (taken, expected) = (iterations as f64, *per_digit * digits);
                *lost += (taken - expected).max(0.0);
                let is_slow = is_slow(taken, expected);
                if is_slow {
                    *lost = lost.max(REBUILD);
                }
                if self.solves == 1 {
                    if is_slow && taken - expected >= AGED {
                        self.age_fast();
                    } else {
                        self.next_renewals = RENEWALS;
                    }
                }
            }
            Coarse::Missing => {}
        }
        self.solves = self.solves.saturating_add(1);
    }

    /// See [`Multigrid::multiplications`].
    pub fn multiplications(&self) -> f64 {
        self.multigrid.multiplications()
    }

    /// See [`Multigrid::apply`].
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        self.multigrid.apply(r, z);
    }
}

/// How long a solve goes on with coarse levels that are not new.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Patience {
    /// Iterations per digit when they were new.
    per_digit: f64,
    /// Iterations after which to ask for [`more`](Self::more).
    pub first: u64,
}

/// Iterations after which it can be told how many there will be. A matrix that is likely to be refused gets as many more as new coarse levels cost.
const FIRST: u64 = 5;

impl Patience {
    /// How many iterations more there may be: none, if the coarse levels will not be used again after this solve and new ones take
    /// few enough for what is left of it, and otherwise one. Residuals fall evenly, so that it is soon known how many will be needed.
    pub fn more(self, progress: Progress) -> u64 {
        let Progress { iterations, gained, left } = progress;
        let seem_left = iterations as f64 * left / gained.max(f64::MIN_POSITIVE);
        let is_late = is_slow(iterations as f64 + seem_left, self.per_digit * (gained + left));
        u64::from(!(is_late && seem_left - self.per_digit * left >= SAVED))
    }
}

/// Whether a solve took many iterations beside those that were expected.
fn is_slow(taken: f64, expected: f64) -> bool {
    taken > SLOW * expected + 1.0
}

fn failure(failure: SetupFailure) -> SolveFailure {
    SolveFailure::Indefinite(match failure {
        SetupFailure::NonFinite => return SolveFailure::NonFinite,
        SetupFailure::Pivot(dof) => Evidence::Pivot(dof),
        SetupFailure::DiagonalBlock(dof) => Evidence::DiagonalBlock(dof),
        SetupFailure::CoarseLevel { level, dof } => Evidence::CoarseLevel { level, dof },
    })
}

#[cfg(all(test, feature = "scene"))]
mod tests;
