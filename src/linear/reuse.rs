//! Multigrid kept from one matrix to the next for as long as it pays.
//!
//! The finest level always has the matrix at hand. The coarse levels are recomputed when the iterations that their age has
//! cost since they were new add up to what recomputing costs: whatever comes next, this is at most twice the work of the
//! best choice of moments (the argument of renting or buying skis). They are also recomputed after a solve in which they took a
//! quarter more iterations than new ones, or within it: after a few iterations it can be told how many there will be. Where coarse levels
//! are too old one step after they were new, as in a fast motion, they are recomputed in every step for a while, and then tried
//! again, which costs little where it fails. All is counted in iterations, never in seconds: a run
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
}

impl ReusedMultigrid {
    /// Analyses a system, see [`Multigrid::new`].
    ///
    /// # Errors
    /// More matrix blocks than 32-bit indices can count.
    pub fn new(system: &System) -> Result<Self> {
        let multigrid = Multigrid::new(system)?;
        Ok(Self { multigrid, coarse: Coarse::Missing, solves: 0, renewals: 0, next_renewals: RENEWALS })
    }

    /// See [`Multigrid::place`].
    pub fn place(&mut self, positions: &[Vector3<f64>]) {
        self.multigrid.place(positions);
    }

    /// Takes over a matrix, with new coarse levels if it is time.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
    pub fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.multigrid.refill(a).map_err(failure)?;
        match self.coarse {
            Coarse::Used { lost, .. } if lost < REBUILD && self.renewals == 0 => Ok(()),
            _ => {
                self.renewals = self.renewals.saturating_sub(1);
                self.renew(a, work)
            }
        }
    }

    /// Recomputes the coarse levels in a solve that they have made too long; counts it.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
    pub fn rebuild(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        if matches!(self.coarse, Coarse::Used { .. }) && self.solves <= 1 {
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
            Coarse::Used { per_digit, .. } => Some(Patience { per_digit }),
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
}

impl Patience {
    /// Iterations after which it can be told how many there will be, to ask for [`more`](Self::more).
    pub const FIRST: u64 = 5;

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
mod tests {
    use super::*;
    use crate::force::Extensions;
    use crate::operator::Combination;
    use crate::scene::builtin::cloth;
    use crate::spring::Stiffness;

    fn used(per_digit: f64, lost: f64) -> Coarse {
        Coarse::Used { per_digit, lost }
    }

    /// With a small system, to be aged by hand.
    fn aged(coarse: Coarse) -> ReusedMultigrid {
        let (system, _) = cloth(3).unwrap().build().unwrap();
        ReusedMultigrid { coarse, ..ReusedMultigrid::new(&system).unwrap() }
    }

    /// What was lost is the iterations beyond those that new coarse levels would have taken; a solve that takes fewer gives
    /// nothing back, and one that gains less than a digit does not count.
    #[test]
    fn losses_are_counted_against_new_coarse_levels() {
        let mut multigrid = aged(Coarse::New);
        for (iterations, digits, coarse) in [
            (9, 0.5, Coarse::New),
            (9, f64::NAN, Coarse::New),
            (30, 5.0, used(6.0, 0.0)),
            (40, 5.0, used(6.0, 10.0)),
            (33, 5.0, used(6.0, 13.0)),
            (20, 5.0, used(6.0, 13.0)),
            (90, 0.75, used(6.0, 13.0)),
            (90, f64::NAN, used(6.0, 13.0)),
            (8, 1.0, used(6.0, 15.0)),
        ] {
            multigrid.record(iterations, digits);
            assert_eq!(multigrid.coarse, coarse, "after {iterations} iterations for {digits} digits");
        }
        // A quarter more than six a digit and one are seven and a half and one.
        for (iterations, lost) in [(8, 2.0), (9, 8.0)] {
            let mut multigrid = aged(used(6.0, 0.0));
            multigrid.record(iterations, 1.0);
            assert_eq!(multigrid.coarse, used(6.0, lost), "after {iterations} iterations for one digit");
        }
        // Of two digits these are fifteen and one.
        for (iterations, lost) in [(15, 3.0), (16, 4.0), (17, 8.0)] {
            let mut multigrid = aged(used(6.0, 0.0));
            multigrid.record(iterations, 2.0);
            assert_eq!(multigrid.coarse, used(6.0, lost), "after {iterations} iterations for two digits");
        }
        let mut multigrid = aged(Coarse::Missing);
        multigrid.record(30, 5.0);
        assert_eq!(multigrid.coarse, Coarse::Missing);
    }

    /// In the first solve with the next matrix four iterations more than expected are too many, three are not.
    #[test]
    fn coarse_levels_age_fast_by_what_they_lose() {
        for (iterations, solves, renewals) in [(9, 1, 0), (10, 1, 4), (10, 2, 0)] {
            let mut multigrid = ReusedMultigrid { solves, ..aged(used(6.0, 0.0)) };
            multigrid.record(iterations, 1.0);
            assert_eq!(multigrid.renewals, renewals, "{iterations} in solve {solves}");
        }
    }

    /// Three iterations a digit are expected. After five, at the pace so far: ten digits in thirty-eight are no more than a quarter and one beyond
    /// thirty, ten in thirty-nine are, and more than three can still be saved; of two digits five more, but not three.
    #[test]
    fn patience_ends() {
        let patience = aged(used(3.0, 1.0)).patience().unwrap();
        for (iterations, gained, left, more) in [
            (5, 5.0 / 3.85, 10.0 - 5.0 / 3.85, 1),
            (5, 5.0 / 3.95, 10.0 - 5.0 / 3.95, 0),
            (5, 1.0, 1.0, 1),
            (5, 1.0, 1.5, 0),
            (5, 0.0, 1.0, 0),
            (5, -1.0, 1.0, 0),
        ] {
            assert_eq!(patience.more(Progress { iterations, gained, left }), more, "{gained} of {}", gained + left);
        }
        assert_eq!(aged(Coarse::New).patience(), None);
        assert_eq!(aged(Coarse::Missing).patience(), None);
    }

    /// Coarse levels are recomputed as soon as eight iterations are lost, and where there are none that a solve has used.
    #[test]
    fn coarse_levels_last_until_their_price_is_lost() {
        let (system, state) = cloth(3).unwrap().build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
        for (before, setups, after) in [
            (Coarse::Missing, 1, Coarse::New),
            (Coarse::New, 1, Coarse::New),
            (used(3.0, 0.0), 0, used(3.0, 0.0)),
            (used(3.0, 7.75), 0, used(3.0, 7.75)),
            (used(3.0, 8.0), 1, Coarse::New),
            (used(3.0, 8.25), 1, Coarse::New),
        ] {
            let (mut multigrid, mut work) = (aged(before), Work::default());
            multigrid.update(&a, &mut work).unwrap();
            assert_eq!((work.multigrid_setups, multigrid.coarse), (setups, after), "{before:?}");
        }
    }

    /// Six iterations a digit in the first solve: eighty for ten digits in the next one are twenty too many, more than a quarter. So are those of
    /// a solve with the next matrix that has to ask for new coarse levels. What ages later only loses.
    #[test]
    fn coarse_levels_that_age_in_one_step_are_made_anew_for_a_while() {
        let (system, state) = cloth(3).unwrap().build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
        let (mut multigrid, mut work) = (ReusedMultigrid::new(&system).unwrap(), Work::default());
        let mut step = |multigrid: &mut ReusedMultigrid, iterations: u64| {
            multigrid.update(&a, &mut work).unwrap();
            multigrid.record(iterations, 10.0);
            work.multigrid_setups
        };
        let setups: Vec<u64> = [60, 60, 80, 60, 80].into_iter().map(|k| step(&mut multigrid, k)).collect();
        assert_eq!((setups, multigrid.renewals), (vec![1, 1, 1, 2, 2], 4));
        for renewed in 1..=4 {
            assert_eq!(step(&mut multigrid, 60), 2 + renewed);
        }
        assert_eq!((multigrid.renewals, multigrid.next_renewals), (0, 8));
        for (solves, coarse) in [(2, used(6.0, 0.0)), (1, Coarse::New)] {
            (multigrid.solves, multigrid.coarse) = (solves, coarse);
            multigrid.rebuild(&a, &mut Work::default()).unwrap();
            assert_eq!((multigrid.renewals, multigrid.next_renewals), (0, 8), "{coarse:?}");
        }
        for renewals in [8, 16, 32, 64, 128, 256, 512, 512] {
            (multigrid.solves, multigrid.coarse) = (1, used(6.0, 0.0));
            multigrid.rebuild(&a, &mut Work::default()).unwrap();
            assert_eq!(multigrid.renewals, renewals);
        }
        // Those that serve once more when they are tried again are no longer in a fast motion.
        (multigrid.solves, multigrid.coarse, multigrid.renewals) = (1, used(6.0, 0.0), 0);
        step(&mut multigrid, 61);
        assert_eq!((multigrid.renewals, multigrid.next_renewals), (0, 4));
    }

    /// A solve that asks for new coarse levels says that they age fast only if they were used, and once at most.
    #[test]
    fn new_coarse_levels_do_not_age() {
        let (system, state) = cloth(3).unwrap().build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
        for (coarse, solves, renewals) in
            [(used(6.0, 0.0), 1, 4), (used(6.0, 0.0), 2, 0), (Coarse::New, 0, 0), (Coarse::Missing, 1, 0)]
        {
            let mut multigrid = ReusedMultigrid { solves, ..aged(coarse) };
            multigrid.rebuild(&a, &mut Work::default()).unwrap();
            assert_eq!(multigrid.renewals, renewals, "{coarse:?} {solves}");
        }
    }

    /// Sixty iterations are expected of new ones, and seventy-six are no more than a quarter and one beyond; of six a ninth is, but three are
    /// no loss that new ones would pay for.
    #[test]
    fn ageing_takes_slow_solves_that_lose_much() {
        for (iterations, digits, renewals) in [(70, 10.0, 0), (76, 10.0, 0), (77, 10.0, 4), (9, 1.0, 0), (11, 1.0, 4)] {
            let mut multigrid = ReusedMultigrid { solves: 1, ..aged(used(6.0, 0.0)) };
            multigrid.record(iterations, digits);
            assert_eq!(multigrid.renewals, renewals, "{iterations} for {digits}");
        }
    }

    /// The places of the particles reach the multigrid inside: it does what one does that was told them directly.
    #[test]
    fn places_are_passed_on() {
        let (system, state) = cloth(14).unwrap().build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
        let r: Vec<f64> = (0..system.dofs().len()).map(|row| (row as f64).sin()).collect();
        let mut reused = ReusedMultigrid::new(&system).unwrap();
        reused.place(&state.positions);
        reused.update(&a, &mut Work::default()).unwrap();
        let mut of_reused = vec![0.0; r.len()];
        reused.apply(&r, &mut of_reused);
        let direct = |is_placed: bool| {
            let mut multigrid = Multigrid::new(&system).unwrap();
            if is_placed {
                multigrid.place(&state.positions);
            }
            multigrid.refill(&a).unwrap();
            multigrid.rebuild(&a).unwrap();
            let mut z = vec![0.0; r.len()];
            multigrid.apply(&r, &mut z);
            z
        };
        assert_eq!(of_reused, direct(true));
        assert_ne!(of_reused, direct(false));
    }
}
