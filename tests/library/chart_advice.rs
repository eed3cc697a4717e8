//! The advice of a chart is never contradicted by its own table: tables made up at random, and advice found by looking at
//! every run and everything finer of its configuration.

use proptest::prelude::*;
use sprung::chart::{Reference, Run, WorkPrecision};
use sprung::integrate::Status;
use sprung::work::Work;

/// One run of a table that was made up.
fn run(method: &'static str, stiffness: &'static str, [pace, cost]: [f64; 2], adapts: bool, error: Option<f64>) -> Run {
    Run {
        method,
        stiffness,
        solver: "llt",
        tolerance: None,
        rtol: adapts.then_some(pace),
        dt: pace,
        status: if error.is_some() { Status::Completed } else { Status::Indefinite },
        failure: None,
        error,
        quality: None,
        wall_seconds: 1e-6 * cost,
        repeats: 1,
        work: Work::default(),
        cost,
    }
}

const FLOOR: f64 = 3e-6;

fn table(runs: Vec<Run>) -> WorkPrecision {
    let state = sprung::State { time: 1.0, positions: Vec::new(), velocities: Vec::new() };
    let reference = Reference { method: "made up".into(), error_estimate: FLOOR / 3.0, state };
    WorkPrecision { scene: "s".into(), duration: 1.0, reference, runs, excluded: Vec::new() }
}

/// Configurations of up to seven runs whose errors fall more or less, or fail.
fn tables() -> impl Strategy<Value = WorkPrecision> {
    let error = prop_oneof![
        6 => (0.0..1.0f64).prop_map(Some),
        1 => Just(None),
        // Beyond what counts as a result.
        1 => Just(Some(40.0)),
    ];
    let curve = (prop::collection::vec(error, 0..8), 0.2..8.0f64, 1.0..50.0f64);
    prop::collection::vec(curve, 8).prop_map(|curves| {
        let ways = [
            ("linear-backward-euler", "full", false),
            ("linear-backward-euler", "axial", false),
            ("w2", "full", false),
            ("w2", "tension", false),
            ("w2", "on-demand", true),
            ("backward-euler", "on-demand", false),
            ("symplectic-euler", "none", false),
            ("bdf2", "on-demand", true),
        ];
        let mut runs = Vec::new();
        for ((method, stiffness, adapts), (errors, fall, cost)) in ways.into_iter().zip(curves) {
            for (k, noise) in errors.into_iter().enumerate() {
                let halvings = f64::from(k as u32);
                // Every decade of noise can undo a halving or two.
                let error = noise
                    .map(|noise| if noise > 1.0 { noise } else { 0.5 * (-fall * halvings).exp() * 10f64.powf(noise) });
                runs.push(run(
                    method,
                    stiffness,
                    [0.1 * 0.5f64.powf(halvings), cost * 2f64.powf(halvings)],
                    adapts,
                    error,
                ));
            }
        }
        // In the order of the sweep: by rounds, not by configuration.
        runs.sort_by(|a, b| b.dt.total_cmp(&a.dt));
        table(runs)
    })
}

fn same_configuration(a: &Run, b: &Run) -> bool {
    (a.method, a.stiffness, a.solver, a.rtol.is_some()) == (b.method, b.stiffness, b.solver, b.rtol.is_some())
}

/// Whether, from this run on, each succeeded and erred more than everything finer; and there is something finer, or at least the
/// next coarser one confirms it in the same way, or it is as right as the reference.
fn can_be_relied_on(run: &Run, all: &[Run]) -> bool {
    let of_it: Vec<&Run> = all.iter().filter(|other| same_configuration(run, other)).collect();
    let error = |run: &Run| run.error.filter(|error| *error < 1.0);
    let falls_from = |from: f64| {
        let part: Vec<&&Run> = of_it.iter().filter(|run| run.dt <= from).collect();
        part.iter().all(|run| error(run).is_some())
            && part.iter().all(|coarse| {
                part.iter().filter(|fine| fine.dt < coarse.dt).all(|fine| {
                    let (coarse, fine) = (error(coarse).unwrap(), error(fine).unwrap());
                    fine < coarse || (fine <= FLOOR && coarse <= FLOOR)
                })
            })
    };
    let coarser = of_it.iter().map(|run| run.dt).filter(|dt| *dt > run.dt).fold(f64::INFINITY, f64::min);
    let finest = of_it.iter().all(|other| other.dt >= run.dt);
    let is_confirmed = !finest || (coarser.is_finite() && falls_from(coarser)) || run.error.is_some_and(|e| e <= FLOOR);
    falls_from(run.dt) && is_confirmed
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    #[test]
    fn advice_is_what_a_look_at_every_run_finds(chart in tables()) {
        for exponent in 1..=6 {
            let accuracy = 10f64.powi(-exponent);
            let decision = chart.decision(accuracy);
            let enough = || {
                let close = |run: &&Run| run.error.is_some_and(|error| error <= accuracy);
                chart.runs.iter().filter(close).filter(|run| can_be_relied_on(run, &chart.runs))
            };
            let least = |runs: &mut dyn Iterator<Item = &Run>| runs.map(|run| run.cost).fold(f64::INFINITY, f64::min);
            let cost = |run: Option<&Run>| run.map_or(f64::INFINITY, |run| run.cost);
            prop_assert_eq!(cost(decision.cheapest), least(&mut enough()));
            prop_assert_eq!(cost(decision.notes), least(&mut enough().filter(|run| run.method == "linear-backward-euler")));
            // The best option of every method that gets there, once.
            for run in &decision.methods {
                prop_assert!(can_be_relied_on(run, &chart.runs) && run.error.unwrap() <= accuracy);
                prop_assert_eq!(run.cost, least(&mut enough().filter(|other| other.variant() == run.variant())));
                prop_assert_eq!(decision.methods.iter().filter(|other| other.variant() == run.variant()).count(), 1);
            }
            prop_assert!(enough().all(|run| decision.methods.iter().any(|other| other.variant() == run.variant())));
        }
    }

    /// Every step that a sentence names is one from which on everything finer did better.
    #[test]
    fn no_sentence_is_contradicted_by_the_table(chart in tables()) {
        let (sentences, reach) = chart.conclusions().split_last().map(|(last, rest)| (rest.to_vec(), last.clone())).unwrap();
        for (sentence, decision) in sentences.iter().zip(chart.decisions()) {
            let run = decision.cheapest.unwrap();
            prop_assert!(can_be_relied_on(run, &chart.runs));
            prop_assert!(sentence.contains(run.method) && sentence.contains(&run.step_control()), "{}", sentence);
        }
        for claim in reach.trim_end_matches('.').split(": ").nth(1).unwrap().split("; ") {
            let method = claim.split([' ', ',']).next().unwrap();
            if let Some((_, pace)) = claim.split_once(" up to ") {
                let named = |run: &&Run| run.method == method && run.step_control() == pace;
                prop_assert!(chart.runs.iter().filter(named).any(|run| can_be_relied_on(run, &chart.runs)), "{}", claim);
            }
        }
    }
}

/// The long step that met the right place by chance, and exploded at half its length.
#[test]
fn luck_is_not_recommended() {
    let lucky = |error| {
        table(vec![
            run("w2", "axial", [0.4, 10.0], false, Some(0.5)),
            run("w2", "axial", [0.2, 20.0], false, Some(0.009)),
            run("w2", "axial", [0.1, 40.0], false, error),
            run("w2", "axial", [0.05, 80.0], false, Some(0.008)),
            run("w2", "axial", [0.025, 160.0], false, Some(0.002)),
        ])
    };
    for error in [None, Some(0.3), Some(30.0)] {
        let chart = lucky(error);
        assert_eq!(chart.decision(0.01).cheapest.unwrap().dt, 0.05, "{error:?}");
        let reach = if error == Some(0.3) { "dt = 0.1 s" } else { "dt = 0.05 s" };
        assert!(chart.conclusions().last().unwrap().contains(&format!("w2 (axial) up to {reach}")));
    }
    assert_eq!(lucky(Some(0.0085)).decision(0.01).cheapest.unwrap().dt, 0.2);
    // One run alone confirms nothing.
    let one = table(vec![run("w2", "axial", [0.4, 10.0], false, Some(0.001))]);
    assert!(one.decision(0.1).cheapest.is_none() && one.decisions().is_empty());
    assert!(one.conclusions().iter().any(|sentence| sentence.contains("Nothing can be recommended")));
}

/// The conclusion of one of a chart's pictures.
fn conclusion(chart: &WorkPrecision, name: &str) -> String {
    let figures = chart.figures();
    figures.into_iter().find(|figure| figure.name == name).map(|figure| figure.plot.conclusion).unwrap_or_default()
}

#[test]
fn pictures_say_what_their_points_say() {
    let halvings = |method, stiffness, [dt, cost, error]: [f64; 3], order: f64| {
        (0..6).map(move |k| {
            let fine = 0.5f64.powi(k);
            run(method, stiffness, [dt * fine, cost / fine], false, Some(error * fine.powf(order)))
        })
    };
    let first = halvings("linear-backward-euler", "full", [0.1, 100.0, 0.08], 1.0);
    let axial = halvings("linear-backward-euler", "axial", [0.1, 100.0, 0.04], 1.0);
    let second = halvings("w2", "full", [0.1, 300.0, 0.08], 2.0);
    let chart = table(first.chain(axial).chain(second).collect());
    // 1 % needs three halvings of the first, two of the others: work 800, 400 and 1200.
    assert_eq!(
        conclusion(&chart, "work"),
        "Least work below 1 %: linear-backward-euler (axial) with dt = 0.025 s; next w2 (full), 3 times."
    );
    assert_eq!(
        conclusion(&chart, "options-euler"),
        "Best below 1 %: axial with llt, dt = 0.025 s; next full with llt, 2 times the work."
    );
    assert_eq!(
        conclusion(&chart, "error"),
        "The longest step that stays below 1 % has linear-backward-euler (axial): 0.025 s."
    );
    // Where only steps that adapt get there, that is said too.
    let mut adaptive = chart.clone();
    adaptive.runs.iter_mut().for_each(|run| run.rtol = Some(run.dt));
    assert_eq!(conclusion(&adaptive, "error"), "No fixed step stays below 1 %.");
    assert!(sprung::report::plot::svg(&chart.figures()[0].plot).contains("Least time below 1 %"));
}

proptest! {
    #[test]
    fn conclusions_speak_of_runs_that_can_be_relied_on(chart in tables()) {
        let text = conclusion(&chart, "work");
        let accuracy = chart.decisions().get(1).or(chart.decisions().first()).map(|decision| decision.accuracy);
        let enough = |run: &&Run| accuracy.is_some_and(|accuracy| run.error.is_some_and(|error| error <= accuracy));
        let cheapest = chart.sound_runs().into_iter().filter(enough).min_by(|a, b| a.cost.total_cmp(&b.cost));
        match cheapest {
            Some(run) => prop_assert!(text.contains(run.method) && text.contains(&run.step_control()), "{text}"),
            None => prop_assert!(text.is_empty(), "{text}"),
        }
    }
}

/// Where every run that is right here fails before the scene's own end, that is the reason, and not chance.
#[test]
fn what_does_not_hold_to_the_end_is_the_reason() {
    let runs: Vec<Run> = (0..4)
        .map(|k| run("bdf2", "on-demand", [0.1 * 0.5f64.powi(k), 2f64.powi(k)], false, Some(1e-2 * 0.25f64.powi(k))))
        .collect();
    let chart = table(runs);
    assert!(!chart.recommendations()[0].starts_with("Nothing"), "{:?}", chart.recommendations());
    let excluded = WorkPrecision { excluded: (0..4).collect(), ..chart };
    let said = excluded.recommendations();
    assert!(said[0].starts_with("Nothing can be recommended: 4 runs are right to 10 % over this motion"), "{said:?}");
}
