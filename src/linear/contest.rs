//! Which preconditioner costs least, found out by trying.
//!
//! What a matrix costs is what its preconditioner is prepared with, the iterations it takes, and its share of coarse levels that serve
//! several. Without a preconditioner there is nothing to prepare, and where masses weigh more than springs, or springs are alike, no blocks
//! make iterations fewer. So none comes first, and is watched: what a matrix has cost more than the cheapest other one is expected to is
//! added up, starting again from zero whenever it falls below, and when it exceeds what a trial costs there is one (the argument of renting
//! or buying skis). Iterations are expected to be proportional to the digits that are gained; of what has not been tried yet, as few as
//! they can well be. One that turns out to cost more is left by the same rule, and a further trial of it has to promise more each time.
//!
//! The blocks of a matrix that may be indefinite are made even where nothing is preconditioned: they may show it, where conjugate gradients
//! do not come across it. From the first on that is refused such matrices are preconditioned with them at least, as iterations then sooner
//! come across what is negative; not where blocks are alike, which make none sooner. The first matrix has its blocks made in any case: how much they
//! differ tells what they can save.
//!
//! A single solve may not wait for that: [`patience`](Contest::patience) ends it where a better preconditioner pays at once, unless
//! [little seems to be left](Contest::more) of it.

use super::budget::Budget;
use super::cost::CostModel;
use super::outcome::Progress;
use super::preconditioner_kind::PreconditionerKind as Kind;
use crate::operator::SurelyDefinite;
use crate::system::System;

/// Those that take part, from the cheapest to prepare to the dearest.
const KINDS: [Kind; 3] = [Kind::None, Kind::BlockJacobi, Kind::Multigrid];

/// The least iterations of blocks, over those without, where masses are alike; and where blocks are too, by what power of their
/// [spread](super::BlockJacobi::spread) they become fewer. In lattices, where it is 1.01 to 1.05, blocks take 0.92 to 1.07 times as many; in networks it is no
/// more, but their masses differ, and they take 0.33 to 0.69 times as many.
const BLOCKS_AT_BEST: f64 = 0.6;
const BY_SPREAD: i32 = -2;

/// Masses that differ by less are alike.
const ALIKE: f64 = 1.5;

/// The least iterations of multigrid for a digit; where no springs lie in rows, over the root of those with blocks: networks of 400 to 10⁴ particles take 0.5
/// to 1.0 of that root and the triangulated bunny 0.45 to 1.3, cloths and lattices 0.2 to 0.5.
const MULTIGRID_AT_BEST: [f64; 2] = [1.0, 0.5];

/// What the first set-up of multigrid costs with the analysis of the pattern, in set-ups.
const ANALYSED: f64 = 3.0;

/// The weight of what was known before a matrix.
const MEMORY: f64 = 0.7;

/// The part of a cost that another one must be below, to be called cheaper.
const SURE: f64 = 0.9;

/// How much more a further trial must promise.
const DISAPPOINTED: f64 = 4.0;

/// Digits that a solve gains at least: the iterations of one that began with its solution say little.
const LEAST_DIGITS: f64 = 0.5;

/// Digits that a solve has gained at least, as far as what it will take is concerned: early on its residual may have grown, and what others promise is to be
/// compared all the same.
const BEGUN: f64 = 0.01;

/// Iterations after which a solve without a preconditioner, and one with blocks, asks for something better. Together they are about what the first solve with multigrid
/// costs, its analysis included: whatever a scene needs, trying costs at most twice the better choice.
const PATIENCE: [u64; 2] = [50, 100];

/// Iterations and the digits that they gained, the latest counting most.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    iterations: f64,
    digits: f64,
}

/// Iterations that a solve gets beyond its patience, in those that seem to be left.
const MORE: f64 = 1.5;

/// What is known of each.
#[derive(Debug, Clone)]
pub(super) struct Contest {
    seen: [Seen; 3],
    /// What a trial must promise, in what it costs.
    price: [f64; 3],
    /// Of the matrix at hand.
    now: Seen,
    /// Set-ups of multigrid for the matrix at hand, and for one as a rule. The first is the trial's.
    set_up: f64,
    set_ups: f64,
    lost: f64,
    /// The least iterations of blocks, over those without.
    blocks_at_best: f64,
    /// The heaviest mass over the lightest.
    unlike: f64,
    knows_blocks: bool,
    /// The part of the springs that do not lie in rows.
    scattered: f64,
    /// Whether a matrix was found to be indefinite.
    has_refused: bool,
}

fn place(kind: Kind) -> usize {
    KINDS.iter().position(|&other| other == kind).unwrap_or(0)
}

impl Contest {
    /// Before anything is seen. Iterations grow with the root of the condition number, and blocks take from it what masses differ by.
    pub fn new(system: &System, costs: &CostModel) -> Self {
        let [lightest, heaviest] = system.free_masses();
        let unlike = if heaviest > lightest { heaviest / lightest } else { 1.0 };
        Self {
            seen: [Seen::default(); 3],
            price: [1.0; 3],
            now: Seen::default(),
            set_up: 0.0,
            set_ups: 0.0,
            lost: 0.0,
            blocks_at_best: BLOCKS_AT_BEST / unlike.sqrt(),
            unlike,
            knows_blocks: false,
            scattered: costs.scattered_share(),
            has_refused: false,
        }
    }

    /// Whether the blocks of a matrix have been seen.
    pub fn knows_blocks(&self) -> bool {
        self.knows_blocks
    }

    /// Takes note of how much they differ: where they hardly do, and masses neither, nothing is preconditioned.
    pub fn see_blocks(&mut self, spread: f64) {
        if self.unlike < ALIKE {
            self.blocks_at_best = spread.max(1.0).powi(BY_SPREAD).max(BLOCKS_AT_BEST) / self.unlike.sqrt();
        }
        self.knows_blocks = true;
    }

    /// The first.
    pub const FIRST: Kind = KINDS[0];

    /// Iterations after which a solve asks whether to go on with another one, where one follows.
    pub fn patience(kind: Kind) -> Option<u64> {
        PATIENCE.get(place(kind)).copied()
    }

    /// How many iterations more a solve may take whose patience has come to its end: as many as seem to be left and half of them again, unless one
    /// that follows would cost less; none where no other follows. What was spent on these iterations is not taken off the budget yet.
    pub fn more(&self, kind: Kind, progress: Progress, budget: &Budget) -> u64 {
        if Some(&kind) == KINDS.last() {
            return 0;
        }
        let seem_left = progress.left * self.during(kind, progress).per_digit(place(kind));
        let iteration = budget.costs.iteration(kind);
        let mut budget = *budget;
        budget.spend(progress.iterations as f64 * iteration);
        let changes = self.better(kind, progress, &budget).is_some_and(|(_, cost)| cost <= seem_left * iteration);
        if changes { 0 } else { (MORE * seem_left).ceil() as u64 }
    }

    /// What is known, with what one has done in this very solve instead of others: all begin slowly, and what is hoped for of those that follow depends
    /// on it.
    fn during(&self, kind: Kind, progress: Progress) -> Self {
        let Progress { iterations, gained, .. } = progress;
        let mut known = self.clone();
        if let Some(seen) = known.seen.get_mut(place(kind)) {
            *seen = Seen { iterations: iterations as f64, digits: gained.max(BEGUN) };
        }
        known
    }

    /// Of those that follow the one that costs least for what is left of a solve, and what that is. Coarse levels are of no use where the budget does not
    /// suffice for the whole solve with them; what blocks have gained in vain is little, and not lost for those that come after.
    pub fn better(&self, kind: Kind, progress: Progress, budget: &Budget) -> Option<(Kind, f64)> {
        let (costs, known) = (&budget.costs, self.during(kind, progress));
        let of_other = |(place, &other): (usize, &Kind)| {
            let set_ups = if self.is_seen(place) { 1.0 } else { ANALYSED };
            let set_up = if other == Kind::Multigrid { set_ups * costs.multigrid_setup() } else { 0.0 };
            let iterations = progress.left * known.per_digit(place);
            (other, costs.preparation(other) + set_up + iterations * costs.iteration(other))
        };
        let others = KINDS.iter().enumerate().skip(place(kind) + 1).map(of_other);
        others
            .filter(|&(other, cost)| other != Kind::Multigrid || cost <= budget.left())
            .min_by(|(_, one), (_, other)| one.total_cmp(other))
    }

    /// Takes note of a solve, or of the part of one that had this preconditioner.
    pub fn record(&mut self, kind: Kind, iterations: u64, digits: f64) {
        let digits = if digits > LEAST_DIGITS { digits } else { LEAST_DIGITS };
        let Some(seen) = self.seen.get_mut(place(kind)) else { return };
        seen.iterations = MEMORY * seen.iterations + iterations as f64;
        seen.digits = MEMORY * seen.digits + digits;
        self.now.iterations += iterations as f64;
        self.now.digits += digits;
    }

    /// Takes note of new coarse levels.
    pub fn set_up(&mut self, times: f64) {
        self.set_up += times;
    }

    /// Takes note of a matrix that is indefinite.
    pub fn refused(&mut self) {
        self.has_refused = true;
    }

    /// Iterations that a digit takes, or may take at best.
    fn per_digit(&self, kind: usize) -> f64 {
        match self.seen.get(kind) {
            // Solves that were broken off say more of their beginning, which is slow, than of the rest.
            Some(seen) if kind == 0 && seen.digits > 0.0 && self.knows_blocks && self.is_seen(1) => {
                (seen.iterations / seen.digits).min(self.per_digit(1) / self.blocks_at_best)
            }
            Some(seen) if seen.digits > 0.0 => seen.iterations / seen.digits,
            _ => match KINDS.get(kind) {
                // Where the first matrices were refused, blocks may be all that is known. Without them as many do at best, times
                // what masses differ by; where blocks were too few, nothing is hoped for.
                Some(Kind::None) if !self.is_seen(2) => BLOCKS_AT_BEST / self.blocks_at_best * self.per_digit(1),
                Some(Kind::BlockJacobi) if self.is_seen(0) => self.blocks_at_best * self.per_digit(0),
                Some(Kind::Multigrid) => {
                    let [in_rows, scattered] = MULTIGRID_AT_BEST;
                    let with_blocks = self.per_digit(1);
                    let least = scattered * self.scattered * with_blocks.sqrt();
                    if with_blocks.is_finite() { in_rows.max(least) } else { in_rows }
                }
                _ => f64::INFINITY,
            },
        }
    }

    /// Whether another one should have the next matrix: before each, with the one that had the last. Where not even its blocks are sure to be definite they
    /// are made in any case.
    pub fn next(&mut self, kind: Kind, costs: &CostModel, definite: SurelyDefinite) -> Option<Kind> {
        let Seen { iterations, digits } = std::mem::take(&mut self.now);
        let set_up = std::mem::take(&mut self.set_up);
        if kind == Kind::Multigrid {
            self.set_ups = MEMORY * self.set_ups + (1.0 - MEMORY) * set_up;
        }
        let needs_blocks = definite != SurelyDefinite::Matrix && self.has_refused && self.blocks_at_best < SURE;
        if needs_blocks && kind == Kind::None {
            return Some(Kind::BlockJacobi);
        }
        // Nothing was solved with the last matrix.
        if digits == 0.0 {
            return None;
        }
        let current = place(kind);
        // Coarse levels serve several matrices: each bears what they cost as a rule, also the one that they are made for.
        let of = |kind: Kind, iterations: f64| {
            let set_ups = if kind == Kind::Multigrid { self.set_ups * costs.multigrid_setup() } else { 0.0 };
            let watched = kind == Kind::None && definite == SurelyDefinite::Nothing;
            let made = if watched { Kind::BlockJacobi } else { kind };
            costs.preparation(made) + iterations * costs.iteration(kind) + set_ups
        };
        let expected = |place: usize| {
            let iterations = self.per_digit(place) * digits;
            KINDS.get(place).map_or(f64::INFINITY, |&kind| of(kind, iterations))
        };
        let others = (usize::from(needs_blocks)..KINDS.len()).filter(|&other| other != current);
        let best = others.min_by(|&a, &b| expected(a).total_cmp(&expected(b)))?;
        let cost = of(kind, iterations);
        let expected = expected(best);
        self.lost = (self.lost + SURE * cost - expected).max(0.0);
        let trial = match KINDS.get(best)? {
            Kind::Multigrid => ANALYSED * costs.multigrid_setup() + costs.preparation(Kind::Multigrid),
            // Blocks do as many iterations or fewer: to come back to them is all that it can cost.
            Kind::None if kind == Kind::BlockJacobi => costs.preparation(Kind::BlockJacobi),
            _ => costs.preparation(Kind::BlockJacobi) + cost,
        };
        let promised = self.price.get(best).is_some_and(|price| self.lost > trial * price);
        promised.then(|| KINDS.get(best).copied()).flatten()
    }

    /// Takes note of a change. What is left for another one that is known already has not kept what it promised.
    pub fn changed(&mut self, from: Kind, to: Kind) {
        self.lost = 0.0;
        // What another one has done for this matrix is not its own.
        self.now = Seen::default();
        self.set_up = if to == Kind::Multigrid { -1.0 } else { 0.0 };
        if self.is_seen(place(to))
            && let Some(price) = self.price.get_mut(place(from))
        {
            *price *= DISAPPOINTED;
        }
    }

    fn is_seen(&self, kind: usize) -> bool {
        self.seen.get(kind).is_some_and(|seen| seen.digits > 0.0)
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests;
