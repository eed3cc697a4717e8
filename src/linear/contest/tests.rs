mod coarse_levels;
mod going_on;

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
    Contest::new(&cloth(), &costs())
}

/// Solves of so many iterations for ten digits with each, as long as the contest does not move on, and the next.
fn moves(contest: &mut Contest, kind: Kind, iterations: u64, matrices: usize) -> Option<(usize, Kind)> {
    (0..matrices).find_map(|matrix| {
        contest.record(kind, iterations, 10.0);
        contest.next(kind, &costs(), SurelyDefinite::Matrix).map(|next| (matrix, next))
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
    let promised = SURE * 60.0 * none - blocks - 0.6 * 60.0 * with;
    assert!(promised > 0.0);
    let expected = ((blocks + 60.0 * none) / promised).floor() as usize;
    assert_eq!(moves(&mut contest, Kind::None, 60, 100), Some((expected, Kind::BlockJacobi)));
    contest.changed(Kind::None, Kind::BlockJacobi);
    let lost = SURE * (blocks + 60.0 * with) - 60.0 * none;
    let back = moves(&mut contest, Kind::BlockJacobi, 60, 100);
    assert_eq!(back, Some(((blocks / lost).floor() as usize, Kind::None)));
    contest.changed(Kind::BlockJacobi, Kind::None);
    // Known by now to save nothing, they are not tried again.
    assert_eq!(moves(&mut contest, Kind::None, 60, 100), None);
}

/// Where multigrid saves nothing, a trial without a preconditioner may cost all that multigrid costs, and blocks in between.
#[test]
fn what_is_not_known_to_be_safe_promises_more() {
    let costs = costs();
    let mut contest = contest();
    contest.record(Kind::None, 30, 10.0);
    contest.record(Kind::BlockJacobi, 60, 10.0);
    contest.changed(Kind::BlockJacobi, Kind::Multigrid);
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

/// After one that was refused, matrices that may be indefinite have blocks, and no others are known. From when on they are not, none takes as many iterations at
/// best, and is tried when that has been missed for as much as it costs to come back; where masses of 1 and 100 kg let it take ten times as many it is not.
#[test]
fn what_was_not_allowed_is_tried_when_it_is() {
    let costs = costs();
    let (blocks, none, with) =
        (costs.preparation(Kind::BlockJacobi), costs.iteration(Kind::None), costs.iteration(Kind::BlockJacobi));
    for (unlike, is_tried) in [(1.0, true), (10.0, false)] {
        let mut contest = contest();
        contest.blocks_at_best /= unlike;
        contest.refused();
        assert_eq!(contest.next(Kind::None, &costs, SurelyDefinite::Nothing), Some(Kind::BlockJacobi));
        let (definite, mut matrices) = ([SurelyDefinite::Blocks, SurelyDefinite::Matrix], 0);
        let tried = definite.into_iter().find_map(|definite| {
            matrices = 0;
            (0..20).find_map(|_| {
                matrices += 1;
                contest.record(Kind::BlockJacobi, 10, 10.0);
                contest.next(Kind::BlockJacobi, &costs, definite).map(|next| (definite, next))
            })
        });
        assert_eq!(tried, is_tried.then_some((SurelyDefinite::Matrix, Kind::None)));
        let missed = SURE * (blocks + 10.0 * with) - 10.0 * none;
        assert!(!is_tried || matrices == (blocks / missed).floor() as usize + 1, "{matrices} {}", blocks / missed);
    }
    // Where neither is known, nothing is hoped for of either.
    assert_eq!([0, 1].map(|kind| self::contest().per_digit(kind)), [f64::INFINITY; 2]);
    // What has needed multigrid is not tried without anything.
    let mut contest = contest();
    contest.record(Kind::BlockJacobi, 10, 10.0);
    contest.record(Kind::Multigrid, 9, 10.0);
    assert_ne!(moves(&mut contest, Kind::BlockJacobi, 10, 100).map(|(_, next)| next), Some(Kind::None));
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
    let mut contest = Contest::new(&unlike, &costs());
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
    assert!(moves(&mut contest, Kind::None, 80, 100).is_some());
    contest.changed(Kind::None, Kind::BlockJacobi);
    assert_eq!(moves(&mut contest, Kind::BlockJacobi, 10, 1000), None);
}

/// Hundreds of iterations, which a solve with multigrid would do without.
#[test]
fn multigrid_comes_where_it_promises_most() {
    let mut contest = contest();
    let next = moves(&mut contest, Kind::BlockJacobi, 200, 100);
    assert_eq!(next.map(|(_, kind)| kind), Some(Kind::Multigrid));
    assert!(next.is_some_and(|(matrices, _)| matrices > 0));
}

/// After one that was refused, what none would do for is left to blocks as long as the matrix may be indefinite, and then given back.
#[test]
fn blocks_watch_over_definiteness() {
    let (mut contest, costs) = (contest(), costs());
    assert_eq!(contest.next(Kind::None, &costs, SurelyDefinite::Nothing), None);
    contest.refused();
    assert_eq!(contest.next(Kind::None, &costs, SurelyDefinite::Nothing), Some(Kind::BlockJacobi));
    contest.record(Kind::None, 3, 10.0);
    for definite in [SurelyDefinite::Nothing, SurelyDefinite::Blocks, SurelyDefinite::Matrix] {
        let left = (0..100).any(|_| {
            contest.record(Kind::BlockJacobi, 3, 10.0);
            contest.next(Kind::BlockJacobi, &costs, definite) == Some(Kind::None)
        });
        assert_eq!(left, definite == SurelyDefinite::Matrix);
    }
}

/// Blocks that may not be definite are made without a preconditioner, too: to leave them saves their part of an iteration alone.
#[test]
fn blocks_that_watch_over_definiteness_are_made_in_any_case() {
    let costs = costs();
    let (blocks, none, with) =
        (costs.preparation(Kind::BlockJacobi), costs.iteration(Kind::None), costs.iteration(Kind::BlockJacobi));
    for (definite, watched) in
        [(SurelyDefinite::Matrix, 0.0), (SurelyDefinite::Blocks, 0.0), (SurelyDefinite::Nothing, blocks)]
    {
        let mut contest = contest();
        contest.record(Kind::None, 30, 10.0);
        contest.changed(Kind::None, Kind::BlockJacobi);
        let left = (0..100).find(|_| {
            contest.record(Kind::BlockJacobi, 30, 10.0);
            contest.next(Kind::BlockJacobi, &costs, definite) == Some(Kind::None)
        });
        let lost = SURE * (blocks + 30.0 * with) - watched - 30.0 * none;
        assert!(lost > 0.0);
        assert_eq!(left, Some((blocks / lost).floor() as usize), "{definite:?}");
    }
}

/// Multigrid is left for no preconditioner at all when it has cost more than a matrix with it would cost in vain, and blocks beside.
#[test]
fn multigrid_is_left_where_little_is_to_do() {
    let (mut contest, costs) = (contest(), costs());
    contest.record(Kind::None, 3, 10.0);
    contest.changed(Kind::None, Kind::Multigrid);
    contest.set_up(1.0);
    contest.record(Kind::Multigrid, 8, 10.0);
    assert!(SURE * costs.iteration(Kind::Multigrid) * 8.0 > costs.preparation(Kind::BlockJacobi));
    assert_eq!(contest.next(Kind::Multigrid, &costs, SurelyDefinite::Matrix), None);
    assert_eq!(moves(&mut contest, Kind::Multigrid, 8, 10).map(|(_, kind)| kind), Some(Kind::None));
}

#[test]
fn there_is_something_better_until_multigrid() {
    assert_eq!(KINDS.map(Contest::patience), [Some(50), Some(100), None]);
}

/// What is left for one that is known must promise four times as much the next time; what is left for a trial has not disappointed.
#[test]
fn disappointments_are_remembered() {
    let mut contest = contest();
    contest.record(Kind::None, 20, 10.0);
    for (from, to, set_up, price) in [
        (Kind::None, Kind::BlockJacobi, 0.0, [1.0; 3]),
        (Kind::BlockJacobi, Kind::Multigrid, -1.0, [1.0; 3]),
        (Kind::Multigrid, Kind::BlockJacobi, 0.0, [1.0, 1.0, 4.0]),
        (Kind::BlockJacobi, Kind::Multigrid, -1.0, [1.0, 4.0, 4.0]),
        (Kind::Multigrid, Kind::None, 0.0, [1.0, 4.0, 16.0]),
    ] {
        contest.record(from, 20, 10.0);
        contest.lost = 7.0;
        contest.changed(from, to);
        assert_eq!((contest.set_up, contest.price, contest.lost), (set_up, price, 0.0));
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
        // Of these set-ups it bears what a mean over matrices gives the last.
        let cost = run(kind, iterations as f64) + (1.0 - MEMORY) * set_up * costs.multigrid_setup();
        let expected = if best == Kind::Multigrid { run(best, digits) } else { run(best, 8.0 * digits) };
        let lost = SURE * cost - expected;
        assert!(lost > 0.0, "{lost}");
        let border = DISAPPOINTED * if best == Kind::BlockJacobi { trial + cost } else { trial };
        for (part, moves) in [(0.999, None), (1.001, Some(best))] {
            let mut contest = contest();
            before(&mut contest);
            contest.price[place(best)] = DISAPPOINTED;
            contest.lost = part * border - lost;
            let found = contest.next(kind, &costs, SurelyDefinite::Matrix);
            assert!((contest.lost / (part * border) - 1.0).abs() < 1e-9, "{} {border}", contest.lost);
            assert_eq!(found, moves, "{part}");
        }
    }
}

/// A solve that has gained 8 digits in 64 iterations and lacks a quarter of one seems to need two more, and gets three, which cost less than
/// making blocks. Of one that lacks as many as it has gained blocks, or multigrid, promise to cost less.
#[test]
fn solves_that_are_nearly_done_go_on() {
    let (contest, costs) = (contest(), costs());
    let budget = Budget::new(costs);
    let more = |kind, gained, left| contest.more(kind, Progress { iterations: 64, gained, left }, &budget);
    let (none, with) = (costs.iteration(Kind::None), costs.iteration(Kind::BlockJacobi));
    assert!(2.0 * none < costs.preparation(Kind::BlockJacobi) + 1.2 * with);
    assert_eq!([more(Kind::None, 8.0, 0.25), more(Kind::None, 4.0, 4.0)], [3, 0]);
    assert_eq!(more(Kind::BlockJacobi, 8.0, 0.25), 3);
    // Blocks go on as long as what seems to be left costs less than a trial of multigrid that takes an iteration a digit.
    let trial = ANALYSED * costs.multigrid_setup() + costs.preparation(Kind::Multigrid);
    let goes_on = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0].map(|left| {
        let is_cheaper = 64.0 * left * with <= trial + left * costs.iteration(Kind::Multigrid);
        assert_eq!(more(Kind::BlockJacobi, 1.0, left), if is_cheaper { 96 * left as u64 } else { 0 }, "{left}");
        is_cheaper
    });
    assert!(goes_on[0] && !goes_on[6]);
    // After multigrid comes nothing, and who has gained nothing does not go on.
    assert_eq!([more(Kind::Multigrid, 8.0, 0.25), more(Kind::None, 0.0, 8.0), more(Kind::None, -1.0, 9.0)], [0; 3]);
}

/// Blocks that are all alike precondition nothing: they are not expected to save iterations, and are not asked for after a matrix that was refused. Where
/// masses of 1 and 4 kg differ, blocks that do not are no such sign.
#[test]
fn blocks_that_are_alike_promise_nothing() {
    let costs = costs();
    for (spread, unlike, expected) in [
        (1.0, 1.0, 1.0),
        (1.02, 1.0, 0.9612),
        (2.0, 1.0, 0.6),
        (5000.0, 1.0, 0.6),
        (0.0, 1.0, 1.0),
        (f64::NAN, 1.0, 1.0),
        (1.0, 1.44, 0.8333),
        (1.0, 4.0, 0.3),
    ] {
        let mut contest = Contest { unlike, blocks_at_best: 0.6 / f64::sqrt(unlike), ..contest() };
        assert!(!contest.knows_blocks());
        contest.see_blocks(spread);
        assert!(contest.knows_blocks());
        assert!((contest.blocks_at_best - expected).abs() < 1e-4, "{}", contest.blocks_at_best);
        contest.record(Kind::None, 100, 10.0);
        assert_eq!(contest.per_digit(1), 10.0 * contest.blocks_at_best);
        contest.refused();
        let kept = contest.next(Kind::None, &costs, SurelyDefinite::Nothing);
        assert_eq!(kept, (contest.blocks_at_best < SURE).then_some(Kind::BlockJacobi), "{spread} {unlike}");
    }
}

/// A solve that was left after its slow beginning says too much of what it would have taken: no more is believed than what blocks take over what
/// they save at best.
#[test]
fn beginnings_are_not_taken_for_whole_solves() {
    let mut contest = contest();
    contest.record(Kind::None, 500, 1.0);
    contest.see_blocks(1.0);
    assert_eq!(contest.per_digit(0), 500.0);
    contest.record(Kind::BlockJacobi, 200, 10.0);
    assert_eq!(contest.per_digit(0), 20.0);
    contest.see_blocks(2.0);
    assert!((contest.per_digit(0) - 20.0 / 0.6).abs() < 1e-12);
}

/// Where springs lie in rows, an iteration a digit is hoped for. Where none does, half the root of those with blocks: of 64 four, of those that they
/// are known, hoped or seen to take in this very solve.
#[test]
fn of_networks_less_is_hoped_for() {
    let (network, _) = builtin::network(2000, 0).unwrap().build().unwrap();
    let of_network = CostModel::of(&network);
    let multigrid = place(Kind::Multigrid);
    for (kind, iterations) in [(Kind::BlockJacobi, 640), (Kind::None, 1066)] {
        for (mut seen, expected) in [(contest(), 1.0), (Contest::new(&network, &of_network), 4.0)] {
            seen.blocks_at_best = 0.6;
            assert_eq!(seen.per_digit(multigrid), 1.0, "nothing is known of blocks");
            seen.record(kind, iterations, 10.0);
            // A few of its springs, to particles that are held, do lie in rows.
            assert!((seen.per_digit(multigrid) / expected - 1.0).abs() < 0.02, "{}", seen.per_digit(multigrid));
        }
    }
    // Multigrid promises to cost less than what is left where an iteration a digit would do, and not where four have to.
    let contest = Contest::new(&network, &of_network);
    let trial = ANALYSED * of_network.multigrid_setup() + of_network.preparation(Kind::Multigrid);
    let [with, cycle] = [Kind::BlockJacobi, Kind::Multigrid].map(|kind| of_network.iteration(kind));
    let left = trial / (64.0 * with - 3.0 * cycle);
    assert!(left > 0.0 && 64.0 * left * with > trial + left * cycle);
    let progress = Progress { iterations: 640, gained: 10.0, left };
    assert_eq!(contest.more(Kind::BlockJacobi, progress, &Budget::new(of_network)), (96.0 * left).ceil() as u64);
}
