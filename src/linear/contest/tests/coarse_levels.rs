//! What coarse levels cost, and for how many matrices.

use super::*;

/// What a solve of so many iterations costs, the coarse levels of multigrid aside.
fn solve(costs: &CostModel, kind: Kind, iterations: u64) -> f64 {
    costs.preparation(kind) + iterations as f64 * costs.iteration(kind)
}

/// Coarse levels that have to be made anew for every matrix cost more than the iterations that they save.
#[test]
fn coarse_levels_that_age_fast_are_left() {
    for (set_ups, is_left) in [(0.0, false), (1.0, true)] {
        let (mut contest, costs) = (contest(), costs());
        let with = solve(&costs, Kind::Multigrid, 8);
        let blocks = (1..).find(|&k| solve(&costs, Kind::BlockJacobi, k) > with).unwrap();
        contest.record(Kind::BlockJacobi, blocks, 10.0);
        contest.changed(Kind::BlockJacobi, Kind::Multigrid);
        contest.set_up(1.0);
        let left = (0..100).find_map(|_| {
            contest.record(Kind::Multigrid, 8, 10.0);
            let next = contest.next(Kind::Multigrid, &costs, SurelyDefinite::Nothing);
            contest.set_up(set_ups);
            next
        });
        assert_eq!(left == Some(Kind::BlockJacobi), is_left);
    }
}

/// Coarse levels that serve seven matrices are not left for what they cost the one that they are made for.
#[test]
fn coarse_levels_that_age_slowly_stay() {
    let (mut contest, costs) = (contest(), costs());
    let of = |kind: Kind, iterations: u64| solve(&costs, kind, iterations);
    let (with, set_up) = (of(Kind::Multigrid, 1), costs.multigrid_setup());
    let blocks = (1..).find(|&k| of(Kind::BlockJacobi, k) > SURE * (with + (1.0 - MEMORY) * set_up)).unwrap();
    // If that one bore all, it and the next would lose what a trial costs.
    let lost = SURE * (2.0 * with + set_up) - 2.0 * of(Kind::BlockJacobi, blocks);
    assert!(lost > 1.2 * (costs.preparation(Kind::BlockJacobi) + with), "{lost}");
    contest.record(Kind::BlockJacobi, blocks, 10.0);
    contest.changed(Kind::BlockJacobi, Kind::Multigrid);
    contest.set_up(1.0);
    for matrix in 1..100 {
        contest.record(Kind::Multigrid, 1, 10.0);
        assert_eq!(contest.next(Kind::Multigrid, &costs, SurelyDefinite::Matrix), None, "{matrix}");
        contest.set_up(if matrix % 7 == 0 { 1.0 } else { 0.0 });
    }
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
        contest.next(kind, &costs, SurelyDefinite::Matrix);
        assert!((contest.set_ups - expected).abs() < 1e-12, "{}", contest.set_ups);
    }
}
