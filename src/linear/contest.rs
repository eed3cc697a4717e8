//! Which preconditioner costs least, found out by trying.
//!
//! What a matrix costs is what its preconditioner is prepared with and the iterations it takes. Without a preconditioner there is nothing
//! to prepare, and where masses weigh more than springs, or springs are alike, no blocks make iterations fewer. So none comes first, and is watched:
//! what a matrix has cost more than the cheapest other one is expected to is added up, starting again from zero whenever it falls
//! below, and when it exceeds what a trial costs there is one (the argument of renting or buying skis). Iterations are expected to
//! be proportional to the digits that are gained; of what has not been tried yet, as few as they can well be. One that turns
//! out to cost more is left by the same rule, and a further trial of it has to promise more each time.
//!
//! A matrix that may be indefinite is never without a preconditioner: its blocks may show it, where conjugate gradients do not come across it.
//!
//! A single solve may not wait for that: [`patience`](Contest::patience) ends it where a better preconditioner pays at once.

use super::cost::CostModel;
use super::preconditioner_kind::PreconditionerKind as Kind;
use crate::system::System;

/// Those that take part, from the cheapest to prepare to the dearest.
const KINDS: [Kind; 3] = [Kind::None, Kind::BlockJacobi, Kind::Multigrid];

/// The least iterations of blocks, over those without, where masses are alike, and of multigrid for a digit.
const BLOCKS_AT_BEST: f64 = 0.6;
const MULTIGRID_AT_BEST: f64 = 1.0;

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

/// Iterations after which a solve goes on with blocks, and then with multigrid. Together they are about what the first solve with multigrid
/// costs, its analysis included: whatever a scene needs, trying costs at most twice the better choice.
const PATIENCE: [u64; 2] = [50, 100];

/// Iterations and the digits that they gained, the latest counting most.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    iterations: f64,
    digits: f64,
}

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
}

fn place(kind: Kind) -> usize {
    KINDS.iter().position(|&other| other == kind).unwrap_or(0)
}

impl Contest {
    /// Before anything is seen. Iterations grow with the root of the condition number, and blocks take from it what masses differ by.
    pub fn new(system: &System) -> Self {
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
        }
    }

    /// The first.
    pub const FIRST: Kind = KINDS[0];

    /// Iterations after which a solve goes on with another one, and which.
    pub fn patience(kind: Kind) -> Option<(u64, Kind)> {
        KINDS
            .iter()
            .zip(KINDS.iter().skip(1))
            .zip(PATIENCE)
            .find(|((of, _), _)| **of == kind)
            .map(|((_, &next), most)| (most, next))
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

    /// Iterations that a digit takes, or may take at best.
    fn per_digit(&self, kind: usize) -> f64 {
        match self.seen.get(kind) {
            Some(seen) if seen.digits > 0.0 => seen.iterations / seen.digits,
            _ => match KINDS.get(kind) {
                Some(Kind::BlockJacobi) => self.blocks_at_best * self.per_digit(0),
                Some(Kind::Multigrid) => MULTIGRID_AT_BEST,
                _ => f64::INFINITY,
            },
        }
    }

    /// Whether another one should have the next matrix: before each, with the one that had the last.
    pub fn next(&mut self, kind: Kind, costs: &CostModel, is_definite: bool) -> Option<Kind> {
        let Seen { iterations, digits } = std::mem::take(&mut self.now);
        let set_up = std::mem::take(&mut self.set_up);
        if kind == Kind::Multigrid {
            self.set_ups = MEMORY * self.set_ups + (1.0 - MEMORY) * set_up;
        }
        if !is_definite && kind == Kind::None {
            return Some(Kind::BlockJacobi);
        }
        // Nothing was solved with the last matrix.
        if digits == 0.0 {
            return None;
        }
        let current = place(kind);
        let of = |kind: Kind, iterations: f64, set_ups: f64| {
            let set_ups = if kind == Kind::Multigrid { set_ups * costs.multigrid_setup() } else { 0.0 };
            costs.preparation(kind) + iterations * costs.iteration(kind) + set_ups
        };
        let expected = |place: usize| {
            let iterations = self.per_digit(place) * digits;
            KINDS.get(place).map_or(f64::INFINITY, |&kind| of(kind, iterations, self.set_ups))
        };
        let others = (usize::from(!is_definite)..KINDS.len()).filter(|&other| other != current);
        let best = others.min_by(|&a, &b| expected(a).total_cmp(&expected(b)))?;
        let cost = of(kind, iterations, set_up);
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

    /// Takes note of a change.
    pub fn changed_to(&mut self, kind: Kind) {
        self.lost = 0.0;
        // What another one has done for this matrix is not its own.
        self.now = Seen::default();
        self.set_up = if kind == Kind::Multigrid { -1.0 } else { 0.0 };
        if let Some(price) = self.price.get_mut(place(kind)) {
            *price *= DISAPPOINTED;
        }
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests {
    use super::*;
    use crate::SystemBuilder;
    use crate::scene::builtin;

    fn cloth() -> System {
        builtin::cloth(20).unwrap().build().unwrap().0
    }

    fn costs() -> CostModel {
        CostModel::of(&cloth())
    }

    fn contest() -> Contest {
        Contest::new(&cloth())
    }

    /// Solves of so many iterations for ten digits with each, as long as the contest does not move on, and the next.
    fn moves(contest: &mut Contest, kind: Kind, iterations: u64, matrices: usize) -> Option<(usize, Kind)> {
        (0..matrices).find_map(|matrix| {
            contest.record(kind, iterations, 10.0);
            contest.next(kind, &costs(), true).map(|next| (matrix, next))
        })
    }

    #[test]
    fn few_iterations_need_no_preconditioner() {
        assert_eq!(moves(&mut contest(), Kind::None, 3, 1000), None);
    }

    /// Blocks may save two fifths of the iterations. When what that would have saved exceeds what they cost they are tried; they save
    /// nothing, and are left when they have cost more than that again. The second trial needs a promise four times as large.
    #[test]
    fn what_does_not_pay_is_left_and_tried_later() {
        let mut contest = contest();
        let costs = costs();
        let (blocks, none, with) =
            (costs.preparation(Kind::BlockJacobi), costs.iteration(Kind::None), costs.iteration(Kind::BlockJacobi));
        let promised = SURE * 30.0 * none - blocks - 0.6 * 30.0 * with;
        assert!(promised > 0.0);
        let expected = ((blocks + 30.0 * none) / promised).floor() as usize;
        assert_eq!(moves(&mut contest, Kind::None, 30, 100), Some((expected, Kind::BlockJacobi)));
        contest.changed_to(Kind::BlockJacobi);
        let lost = SURE * (blocks + 30.0 * with) - 30.0 * none;
        let back = moves(&mut contest, Kind::BlockJacobi, 30, 100);
        assert_eq!(back, Some(((blocks / lost).floor() as usize, Kind::None)));
        contest.changed_to(Kind::None);
        // Known by now to save nothing, they are not tried again.
        assert_eq!(moves(&mut contest, Kind::None, 30, 100), None);
    }

    /// Where multigrid saves nothing, a trial without a preconditioner may cost all that multigrid costs, and blocks in between.
    #[test]
    fn what_is_not_known_to_be_safe_promises_more() {
        let costs = costs();
        let mut contest = contest();
        contest.record(Kind::None, 30, 10.0);
        contest.record(Kind::BlockJacobi, 60, 10.0);
        contest.changed_to(Kind::Multigrid);
        let of = |kind: Kind, iterations: u64| costs.preparation(kind) + iterations as f64 * costs.iteration(kind);
        // A little more than what would be called even.
        let without = of(Kind::None, 30);
        let iterations = (1..).find(|&k| SURE * of(Kind::Multigrid, k) > 1.1 * without).unwrap();
        let with = of(Kind::Multigrid, iterations);
        let trial = costs.preparation(Kind::BlockJacobi) + with;
        // What was set up for the trial does not count.
        contest.set_up(1.0);
        let expected = (trial / (SURE * with - without)).floor() as usize;
        assert!(expected > 1, "{expected}");
        assert_eq!(moves(&mut contest, Kind::Multigrid, iterations, 100), Some((expected, Kind::None)));
    }

    /// Masses of 1 and 100 kg make blocks promise a tenth of the iterations that they promise where masses are alike: they are tried sooner.
    #[test]
    fn masses_that_differ_ask_for_blocks() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0, 0.0, 0.0], 1.0);
        builder.particle([1.0, 0.0, 0.0], 100.0);
        builder.particle([2.0, 0.0, 0.0], 1e6);
        builder.hold(2);
        let (unlike, _) = builder.build().unwrap();
        assert_eq!(unlike.free_masses(), [1.0, 100.0]);
        let mut contest = Contest::new(&unlike);
        let costs = costs();
        let (blocks, none, with) =
            (costs.preparation(Kind::BlockJacobi), costs.iteration(Kind::None), costs.iteration(Kind::BlockJacobi));
        let promised = SURE * 12.0 * none - blocks - 0.06 * 12.0 * with;
        let expected = ((blocks + 12.0 * none) / promised).floor() as usize;
        assert_eq!(moves(&mut contest, Kind::None, 12, 100), Some((expected, Kind::BlockJacobi)));
        assert_eq!(moves(&mut self::contest(), Kind::None, 12, expected + 1), None);
    }

    #[test]
    fn blocks_that_save_much_stay() {
        let mut contest = contest();
        assert!(moves(&mut contest, Kind::None, 40, 100).is_some());
        contest.changed_to(Kind::BlockJacobi);
        assert_eq!(moves(&mut contest, Kind::BlockJacobi, 5, 1000), None);
    }

    /// Hundreds of iterations, which a solve with multigrid would do without.
    #[test]
    fn multigrid_comes_where_it_promises_most() {
        let mut contest = contest();
        let next = moves(&mut contest, Kind::BlockJacobi, 200, 100);
        assert_eq!(next.map(|(_, kind)| kind), Some(Kind::Multigrid));
        assert!(next.is_some_and(|(matrices, _)| matrices > 0));
    }

    /// What none would do for is left to blocks as long as the matrix may be indefinite, and then given back.
    #[test]
    fn blocks_watch_over_definiteness() {
        let (mut contest, costs) = (contest(), costs());
        assert_eq!(contest.next(Kind::None, &costs, false), Some(Kind::BlockJacobi));
        contest.record(Kind::None, 3, 10.0);
        for is_definite in [false, true] {
            let left = (0..100).any(|_| {
                contest.record(Kind::BlockJacobi, 3, 10.0);
                contest.next(Kind::BlockJacobi, &costs, is_definite) == Some(Kind::None)
            });
            assert_eq!(left, is_definite);
        }
    }

    /// Multigrid is left for no preconditioner at all when it has cost more than a matrix with it would cost in vain, and blocks beside.
    #[test]
    fn multigrid_is_left_where_little_is_to_do() {
        let (mut contest, costs) = (contest(), costs());
        contest.record(Kind::None, 3, 10.0);
        contest.changed_to(Kind::Multigrid);
        contest.set_up(1.0);
        contest.record(Kind::Multigrid, 8, 10.0);
        assert!(SURE * costs.iteration(Kind::Multigrid) * 8.0 > costs.preparation(Kind::BlockJacobi));
        assert_eq!(contest.next(Kind::Multigrid, &costs, true), None);
        assert_eq!(moves(&mut contest, Kind::Multigrid, 8, 10).map(|(_, kind)| kind), Some(Kind::None));
    }

    /// Coarse levels that have to be made anew for every matrix cost more than the iterations that they save.
    #[test]
    fn coarse_levels_that_age_fast_are_left() {
        for (set_ups, is_left) in [(0.0, false), (1.0, true)] {
            let (mut contest, costs) = (contest(), costs());
            contest.record(Kind::BlockJacobi, 100, 10.0);
            contest.changed_to(Kind::Multigrid);
            contest.set_up(1.0);
            let left = (0..100).find_map(|_| {
                contest.record(Kind::Multigrid, 8, 10.0);
                let next = contest.next(Kind::Multigrid, &costs, false);
                contest.set_up(set_ups);
                next
            });
            assert_eq!(left == Some(Kind::BlockJacobi), is_left);
        }
    }

    #[test]
    fn there_is_something_better_until_multigrid() {
        assert_eq!(Contest::patience(Kind::None), Some((50, Kind::BlockJacobi)));
        assert_eq!(Contest::patience(Kind::BlockJacobi), Some((100, Kind::Multigrid)));
        assert_eq!(Contest::patience(Kind::Multigrid), None);
    }

    /// Set-ups are a mean in which what was before counts seven tenths, of matrices that multigrid had alone.
    #[test]
    fn set_ups_are_remembered() {
        let (mut contest, costs) = (contest(), costs());
        for (kind, set_up, expected) in
            [(Kind::Multigrid, 1.0, 0.3), (Kind::BlockJacobi, 5.0, 0.3), (Kind::Multigrid, 2.0, 0.81)]
        {
            contest.set_up(set_up);
            contest.record(kind, 5, 10.0);
            contest.next(kind, &costs, true);
            assert!((contest.set_ups - expected).abs() < 1e-12, "{}", contest.set_ups);
        }
        for (kind, set_up, price) in
            [(Kind::Multigrid, -1.0, 4.0), (Kind::BlockJacobi, 0.0, 4.0), (Kind::Multigrid, -1.0, 16.0)]
        {
            contest.changed_to(kind);
            assert_eq!((contest.set_up, contest.price[place(kind)], contest.lost), (set_up, price, 0.0));
        }
    }

    /// What is lost is nine tenths of what a matrix has cost less what the cheapest other one would have; beyond what a trial costs, times what was
    /// promised in vain, there is one.
    #[test]
    fn trials_begin_where_they_have_cost_as_much_not_to_be_made() {
        let costs = costs();
        let digits = 10.0;
        let run = |kind, iterations: f64| costs.preparation(kind) + iterations * costs.iteration(kind);
        // Each one with what the others are known to take, or are hoped to.
        for (kind, iterations, set_up, best, trial) in [
            (
                Kind::BlockJacobi,
                400,
                0.0,
                Kind::Multigrid,
                3.0 * costs.multigrid_setup() + costs.preparation(Kind::Multigrid),
            ),
            (Kind::Multigrid, 40, 1.5, Kind::BlockJacobi, costs.preparation(Kind::BlockJacobi)),
        ] {
            let before = |contest: &mut Contest| {
                // Known to be hopeless without any, and with blocks to take eight iterations a digit.
                contest.record(Kind::None, 100_000, 10.0);
                if kind == Kind::Multigrid {
                    contest.record(Kind::BlockJacobi, 80, 10.0);
                }
                contest.now = Seen::default();
                contest.record(kind, iterations, digits);
                contest.set_up(set_up);
            };
            let cost = run(kind, iterations as f64) + set_up * costs.multigrid_setup();
            let expected = if best == Kind::Multigrid { run(best, digits) } else { run(best, 8.0 * digits) };
            let lost = SURE * cost - expected;
            assert!(lost > 0.0, "{lost}");
            let border = DISAPPOINTED * if best == Kind::BlockJacobi { trial + cost } else { trial };
            for (part, moves) in [(0.999, None), (1.001, Some(best))] {
                let mut contest = contest();
                contest.changed_to(best);
                before(&mut contest);
                contest.lost = part * border - lost;
                let found = contest.next(kind, &costs, true);
                assert!((contest.lost / (part * border) - 1.0).abs() < 1e-9, "{} {border}", contest.lost);
                assert_eq!(found, moves, "{part}");
            }
        }
    }
}
