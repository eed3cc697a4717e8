//! Some scenes of the page on answers to indefinite matrices.

use crate::definiteness::{robustness, table};
use sprung::chart::definiteness::ratios;
use sprung::integrate::StiffnessPolicy;

/// Both policies solve what any option solves, with fewer factorizations than `tension` and `absolute`; what is solved ends in no saddle
/// that a policy would take for a minimum: A(dt) has no negative eigenvalue there.
#[test]
fn policies_solve_most_and_cost_least() {
    let problems = table::problems(0..10).unwrap();
    let steps = table::steps(&problems);
    assert_eq!(steps.len(), 40);
    let all: Vec<_> = (0..StiffnessPolicy::ALL.len()).map(|policy| ratios(&steps, policy)).collect();
    let [on_demand, progressive, full, tension, axial, absolute] = all.try_into().unwrap();
    for option in [full, tension, axial, absolute] {
        assert!(on_demand.solved >= option.solved && progressive.solved >= option.solved, "{option:?}");
    }
    assert!(
        progressive.means[1] < tension.means[1] && tension.means[1] < absolute.means[1],
        "{tension:?} {absolute:?}"
    );
    for solve in steps.iter().flat_map(|solves| &solves[..2]).filter(|solve| solve.is_solved()) {
        assert_eq!(solve.negative, Some(0), "{solve:?}");
    }
}

/// Nearly all steps are solved, and no failure contradicts itself or changes the state.
#[test]
fn steps_of_any_length_are_solved_or_say_why_not() {
    let runs = robustness::runs(100..160).unwrap();
    let failed = runs.iter().filter(|run| run.failure.is_some()).count();
    assert!(failed <= 5, "{failed}");
    assert!(runs.iter().all(|run| !run.is_wrong));
}
