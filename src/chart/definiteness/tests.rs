use super::*;
use crate::interrupt::Interrupt;
use crate::spring::Spring;
use crate::system::SystemBuilder;

fn solve(stiffness: &'static str, iterations: u64, factorizations: u64, energy: Option<f64>) -> Solve {
    Solve {
        dt: Some(1.0),
        stiffness,
        status: if energy.is_some() { Status::Completed } else { Status::NotConverged },
        message: None,
        iterations,
        factorizations,
        refused: Some(0),
        changed_terms: Some(0),
        energy,
        negative: energy.map(|_| 0),
        wall_seconds: 0.0,
    }
}

/// A row of springs, pressed to 0.6 of their length, on held ends, off its line by a thousandth to both sides.
fn pressed_row() -> (System, State) {
    let mut builder = SystemBuilder::new();
    for p in 0..8 {
        let off = |remainder: i32| if p % 3 == remainder { 1e-3 } else { 0.0 };
        builder.particle([0.6 * f64::from(p), off(1), off(2)], 0.5);
    }
    for p in 0..7 {
        builder.spring(p, p + 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
    }
    builder.hold(0).hold(7);
    builder.build().unwrap()
}

/// 10 J within all of 4 and 2, 8 and 1; of three problems on-demand solves two.
#[test]
fn ratios_are_geometric_means_over_what_both_solve() {
    let problem = |of: [(u64, u64, Option<f64>); 2]| -> Vec<Solve> {
        let [a, b] = of.map(|(i, f, e)| solve("", i, f, e));
        let mut solves = vec![a, b];
        solves.resize(StiffnessPolicy::ALL.len(), solve("", 9, 9, None));
        solves
    };
    let all = [
        problem([(4, 10, Some(1.0)), (2, 10, Some(1.0))]),
        problem([(4, 10, Some(1.0)), (32, 20, Some(2.0))]),
        problem([(4, 10, None), (1, 1, Some(1.0))]),
    ];
    let problems: Vec<&[Solve]> = all.iter().map(Vec::as_slice).collect();
    let Ratios { means, largest, solved } = ratios(&problems, 1);
    assert!((means[0] - 2.0).abs() < 1e-12 && (means[1] - 2f64.sqrt()).abs() < 1e-12, "{means:?}");
    assert_eq!((largest, solved), ([8.0, 2.0], 3));
    assert_eq!(ratios(&problems, 0), Ratios { means: [1.0; 2], largest: [1.0; 2], solved: 2 });
    let words = conclusions(&problems).join(" ");
    assert!(words.starts_with("progressive arrives at 3 of 3 solutions"), "{words}");
    assert!(words.contains("1.41 times those of on-demand, and 2.00 times"), "{words}");
    assert!(
        words.contains("on-demand at 1") && words.ends_with("At 1 of 3 the answers reach different solutions."),
        "{words}"
    );
    assert_eq!(conclusions(&[]).len(), 1);
}

/// Costs of 2 and 3, 4 and 2, and a failure: the first is best once and within 2 twice, the second once and within 1.5 twice.
#[test]
fn profiles_are_parts_within_a_factor_of_the_best() {
    let solved = [[Some(2), Some(3)], [Some(4), Some(2)], [None, None]];
    let all = solved.map(|costs| {
        let mut solves = costs.map(|cost| solve("", 1, cost.unwrap_or(1), cost.map(|_| 0.0))).to_vec();
        solves.resize(StiffnessPolicy::ALL.len(), solve("", 1, 1, None));
        solves
    });
    let series = profile_figure(&all.each_ref().map(Vec::as_slice)).series;
    // τ = 1, 2^(1/2), 2^(3/4) and 2.
    let parts = |policy: usize| [0, 2, 3, 4].map(|quarter| 3.0 * series[policy].points[quarter].1);
    assert_eq!([parts(0), parts(1)], [[1.0, 1.0, 1.0, 2.0], [1.0, 1.0, 2.0, 2.0]]);
    assert!(profile_figure(&[]).series.is_empty());
}

/// Beyond the critical step `full` is refused. Both policies end in a minimum, except in long steps in which no option arrives, and these say so.
#[test]
fn a_pressed_row_is_solved_by_the_policies() {
    let (system, state) = pressed_row();
    let until = Deadline::after(Duration::from_secs(7200), Interrupt::NEVER);
    let found = Comparison::measure("row", &system, &state, 0.1, until).unwrap();
    assert_eq!((found.skipped, found.solves.len()), (0, 6 * StiffnessPolicy::ALL.len()));
    for solves in found.problems() {
        let are_solved = solves.iter().any(Solve::is_solved);
        assert!(are_solved || solves[0].dt > Some(2.0), "{solves:?}");
        for solve in solves {
            if solve.stiffness == "full" && solve.dt.is_some() {
                assert_eq!((solve.status, solve.negative), (Status::Indefinite, None), "{solve:?}");
                assert!(solve.refused >= Some(1));
            } else if ["on-demand", "progressive"].contains(&solve.stiffness) {
                assert_eq!((solve.is_solved(), solve.message.is_none()), (are_solved, are_solved), "{solve:?}");
                assert_eq!(solve.negative, are_solved.then_some(0), "{solve:?}");
                assert!(solve.dt.is_none() || solve.changed_terms > Some(0), "{solve:?}");
            }
        }
    }
    let over = Deadline::after(Duration::ZERO, Interrupt::NEVER);
    let none = Comparison::measure("row", &system, &state, 0.1, over).unwrap();
    assert_eq!((none.skipped, none.solves.len()), (6 * StiffnessPolicy::ALL.len(), 0));
}
