//! Some scenes of the page on answers to indefinite matrices.

use crate::definiteness::{robustness, table};
use sprung::chart::definiteness::ratios;
use sprung::integrate::StiffnessPolicy;

/// Both policies solve nearly all, the default as much as any option, with fewer factorizations than `tension` and `absolute`; nearly all ends are
/// minima: A(dt) has no negative eigenvalue there.
#[test]
fn policies_solve_most_and_cost_least() {
    let problems = table::problems(0..10).unwrap();
    let steps = table::steps(&problems);
    assert_eq!(steps.len(), 40);
    let all: Vec<_> = (0..StiffnessPolicy::ALL.len()).map(|policy| ratios(&steps, policy)).collect();
    let [on_demand, progressive, full, tension, axial, absolute] = all.try_into().unwrap();
    for option in [full, tension, axial, absolute] {
        assert!(on_demand.solved >= option.solved && progressive.solved + 2 >= option.solved, "{option:?}");
    }
    assert!(
        progressive.means[1] < tension.means[1] && tension.means[1] < absolute.means[1],
        "{tension:?} {absolute:?}"
    );
    let ends = steps.iter().flat_map(|solves| &solves[..2]).filter_map(|solve| solve.negative);
    let saddles = ends.filter(|negative| *negative > 0).count();
    assert!(saddles <= 4, "{saddles}");
}

/// Nearly all steps are solved, and no failure contradicts itself or changes the state.
#[test]
fn steps_of_any_length_are_solved_or_say_why_not() {
    let runs = robustness::runs(100..160).unwrap();
    let failed = runs.iter().filter(|run| run.failure.is_some()).count();
    assert!(failed <= 5, "{failed}");
    assert!(runs.iter().all(|run| !run.is_wrong));
}
