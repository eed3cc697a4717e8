//! When a solve is left for another preconditioner, and for which.

use super::*;

/// Of what is known its own iterations count, and one set-up.
#[test]
fn what_is_known_decides_whether_a_solve_goes_on() {
    let (costs, budget) = (costs(), Budget::new(costs()));
    let with = costs.iteration(Kind::BlockJacobi);
    let cycle = costs.iteration(Kind::Multigrid);
    let once = costs.preparation(Kind::Multigrid) + costs.multigrid_setup();
    for per_digit in [1.0, 2.0, 5.0, 20.0, 50.0] {
        let mut contest = contest();
        contest.record(Kind::Multigrid, (10.0 * per_digit) as u64, 10.0);
        let progress = Progress { iterations: 100, gained: 5.0, left: 5.0 };
        let goes_on = 100.0 * with <= once + 5.0 * per_digit * cycle;
        assert_eq!(contest.more(Kind::BlockJacobi, progress, &budget), if goes_on { 150 } else { 0 }, "{per_digit}");
    }
    // Without a preconditioner twelve iterations are left. Blocks may take six tenths of them, or what they are known to.
    let progress = Progress { iterations: 24, gained: 8.0, left: 4.0 };
    let blocks = costs.preparation(Kind::BlockJacobi);
    for per_digit in [None, Some(0.5), Some(1.0), Some(2.0), Some(3.0)] {
        let mut contest = contest();
        per_digit.into_iter().for_each(|per_digit| contest.record(Kind::BlockJacobi, (10.0 * per_digit) as u64, 10.0));
        let of_blocks = per_digit.map_or(0.6 * 12.0, |per_digit| 4.0 * per_digit);
        let goes_on = 12.0 * costs.iteration(Kind::None) <= blocks + of_blocks * with;
        assert_eq!(contest.more(Kind::None, progress, &budget), if goes_on { 18 } else { 0 }, "{per_digit:?}");
    }
}

/// A solve that seems to need as many iterations again as it has taken, and may take half as many more. It is left for a trial of multigrid, which
/// takes an iteration a digit, where that costs less than they seem to and can be afforded. Those that it has taken are not spent yet.
#[test]
fn a_solve_is_left_for_what_costs_less_and_can_be_afforded() {
    let (contest, costs) = (contest(), costs());
    let with = costs.iteration(Kind::BlockJacobi);
    let [prepared, cycle] = [costs.preparation(Kind::Multigrid), costs.iteration(Kind::Multigrid)];
    let trial = ANALYSED * costs.multigrid_setup() + prepared + 5.0 * cycle;
    let [cheaper, dearer] = [0.9, 1.1].map(|share| 2 * (0.5 * share * trial / with) as u64);
    for (iterations, room, goes_on) in [
        (cheaper, f64::INFINITY, true),
        (cheaper, 1.01 * trial, true),
        (cheaper, 0.5 * trial, true),
        (dearer, f64::INFINITY, false),
        (dearer, 1.01 * trial, false),
        (dearer, 0.99 * trial, true),
    ] {
        let mut budget = Budget::new(costs);
        budget.spend(1000.0);
        budget.allow(iterations as f64 * with + room);
        let more = contest.more(Kind::BlockJacobi, Progress { iterations, gained: 5.0, left: 5.0 }, &budget);
        assert_eq!(more, if goes_on { 3 * iterations / 2 } else { 0 }, "{iterations} {room}");
    }
}

/// Ten iterations a digit are left of a solve that has taken as many, not the tenth of one that an easier solve took; nothing is hoped for of blocks that are
/// alike. Where these are known to take four, no more is believed to be left without them.
#[test]
fn a_solve_is_compared_with_itself() {
    let costs = costs();
    let progress = Progress { iterations: 50, gained: 5.0, left: 5.0 };
    let mut contest = contest();
    contest.see_blocks(1.0);
    contest.record(Kind::None, 1, 10.0);
    contest.record(Kind::Multigrid, 1000, 10.0);
    assert_eq!(contest.more(Kind::None, progress, &Budget::new(costs)), 75);
    contest.record(Kind::BlockJacobi, 40, 10.0);
    assert_eq!(contest.more(Kind::None, progress, &Budget::new(costs)), 30);
}

/// What is left goes to the one that promises to cost least, not to the next in line: to multigrid where many digits are left, to blocks where few are.
#[test]
fn the_cheapest_of_those_that_follow_goes_on() {
    let costs = costs();
    let mut contest = contest();
    // An easier solve does not count.
    contest.record(Kind::None, 1, 10.0);
    for (left, expected) in [(0.5, Kind::BlockJacobi), (100.0, Kind::Multigrid)] {
        let progress = Progress { iterations: 500, gained: 10.0, left };
        let (kind, cost) = contest.better(Kind::None, progress, &Budget::new(costs)).unwrap();
        let set_up = if kind == Kind::Multigrid { ANALYSED * costs.multigrid_setup() } else { 0.0 };
        let per_digit = if kind == Kind::Multigrid { 1.0 } else { 0.6 * 50.0 };
        let iterations = left * per_digit * costs.iteration(kind);
        assert_eq!(kind, expected);
        assert!((cost - costs.preparation(kind) - set_up - iterations).abs() < 1e-9 * cost);
        // Where there is no room for coarse levels and a solve with them there are blocks.
        let mut tight = Budget::new(costs);
        tight.allow(0.99 * cost);
        assert_eq!(contest.better(Kind::None, progress, &tight).map(|(kind, _)| kind), Some(Kind::BlockJacobi));
    }
    let progress = Progress { iterations: 10, gained: 5.0, left: 5.0 };
    assert_eq!(contest.better(Kind::Multigrid, progress, &Budget::new(costs)), None);
}

/// A solve whose residual has grown at first goes on where blocks are alike and coarse levels cannot be afforded, and is left for them otherwise: what is left
/// is long for all, but not without end.
#[test]
fn a_solve_that_has_gained_nothing_is_compared_as_well() {
    let costs = costs();
    let progress = Progress { iterations: 50, gained: -0.1, left: 4.1 };
    let mut tight = Budget::new(costs);
    tight.allow(50.0 * costs.iteration(Kind::None) + 2.0 * costs.preparation(Kind::BlockJacobi));
    for (spread, budget, expected) in
        [(1.0, tight, None), (1e3, tight, Some(Kind::BlockJacobi)), (1.0, Budget::new(costs), Some(Kind::Multigrid))]
    {
        let mut contest = contest();
        contest.see_blocks(spread);
        let changes = contest.more(Kind::None, progress, &budget) == 0;
        assert_eq!(changes, expected.is_some(), "{spread}");
        let better = contest.better(Kind::None, progress, &budget).map(|(kind, _)| kind);
        assert!(expected.is_none() || better == expected, "{spread}: {better:?}");
    }
}
