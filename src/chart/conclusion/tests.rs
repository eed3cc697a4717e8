//! A table made up by hand, and everything that can be read off it: decisions, sentences, pictures.

use super::called;
use crate::chart::curve::best_of_each;
use crate::chart::run::short;
use crate::chart::{Figure, Quality, Reference, Run, WorkPrecision};
use crate::figure::{Guide, Plot, Series};
use crate::integrate::Status;
use crate::system::State;
use crate::work::Work;

type Configuration = (&'static str, &'static str, &'static str);

const EULER: &str = "linear-backward-euler";

/// A run; its time is a microsecond for every unit of its cost, it solves once for every ten, and drifts as much as it errs.
fn run((method, stiffness, solver): Configuration, dt: f64, cost: f64, error: Option<f64>) -> Run {
    let quality = error.map(|error| Quality { error, energy_drift: -error, angular_momentum_drift: 2.0 * error });
    Run {
        method,
        stiffness,
        solver,
        tolerance: None,
        rtol: None,
        dt,
        status: if error.is_some() { Status::Completed } else { Status::NotConverged },
        failure: None,
        error,
        quality,
        wall_seconds: 1e-6 * cost,
        repeats: 1,
        work: Work { solves: (cost / 10.0) as u64, ..Work::default() },
        cost,
    }
}

fn adaptive(rtol: f64, dt: f64, cost: f64, error: f64) -> Run {
    Run { rtol: Some(rtol), ..run(("w2", "on-demand", "llt"), dt, cost, Some(error)) }
}

/// Two configurations of Euler's method, two ways of w2, an explicit method that is slow and fails with long steps, one that succeeds once,
/// and one that never does.
fn chart() -> WorkPrecision {
    let fixed = |configuration: Configuration, rows: &[(f64, f64, Option<f64>)]| {
        rows.iter().map(|&(dt, cost, error)| run(configuration, dt, cost, error)).collect::<Vec<_>>()
    };
    let mut explicit = fixed(
        ("symplectic-euler", "none", "none"),
        &[(0.1, 20.0, None), (0.05, 45.0, Some(2.0)), (0.025, 90.0, Some(0.006)), (0.0125, 180.0, Some(0.003))],
    );
    explicit.iter_mut().for_each(|run| run.wall_seconds *= 10.0);
    let runs = [
        fixed(
            (EULER, "full", "llt"),
            &[(0.1, 100.0, Some(0.08)), (0.05, 200.0, Some(0.04)), (0.025, 400.0, Some(0.009))],
        ),
        fixed(
            (EULER, "axial", "cg"),
            &[(0.1, 50.0, Some(0.09)), (0.05, 110.0, Some(0.03)), (0.025, 500.0, Some(0.008))],
        ),
        fixed(
            ("w2", "tension", "llt"),
            &[(0.1, 150.0, Some(0.02)), (0.05, 300.0, Some(0.005)), (0.025, 600.0, Some(0.00125))],
        ),
        vec![adaptive(1e-2, 0.04, 120.0, 0.03), adaptive(1e-3, 0.02, 290.0, 0.004)],
        explicit,
        fixed(("verlet", "none", "none"), &[(0.2, 60.0, Some(0.5)), (0.15, 70.0, None)]),
        fixed(("bdf2", "on-demand", "llt"), &[(0.2, 60.0, None)]),
    ];
    let state = State { time: 1.0, positions: Vec::new(), velocities: Vec::new() };
    WorkPrecision {
        scene: "s".into(),
        duration: 1.0,
        excluded: Vec::new(),
        reference: Reference { method: "made up".into(), error_estimate: 1e-7, state },
        runs: runs.concat(),
    }
}

#[test]
fn decisions_are_the_least_of_what_can_be_relied_on() {
    let chart = chart();
    let decisions = chart.decisions();
    // The least error is 0.00125.
    assert_eq!(decisions.iter().map(|decision| decision.accuracy).collect::<Vec<_>>(), [0.1, 0.01]);
    let of = |run: Option<&Run>| run.map(|run| (run.method, run.stiffness, run.cost));
    assert_eq!(of(decisions[0].cheapest), Some((EULER, "axial", 50.0)));
    assert_eq!(of(decisions[1].cheapest), Some(("symplectic-euler", "none", 90.0)));
    assert_eq!(of(decisions[1].notes), Some((EULER, "full", 400.0)));
    let sentences = [
        "For an error below 10 %: linear-backward-euler (axial, cg) with dt = 0.1 s (50 force evaluations, 0.05 ms).",
        "For an error below 1 %: symplectic-euler with dt = 0.025 s (90 force evaluations, 0.9 ms); \
         linear-backward-euler needs 4.44 times the work.",
    ];
    assert_eq!(chart.recommendations(), sentences);
    let options = "The best option of each method below 1 %: symplectic-euler with dt = 0.025 s (90 force evaluations); \
         w2 (on-demand) with adaptive steps, rtol = 0.001 (290 force evaluations); \
         w2 (tension) with dt = 0.05 s (300 force evaluations); \
         linear-backward-euler (full) with dt = 0.025 s (400 force evaluations).";
    let reaches = "Steps from which on every shorter one did better: linear-backward-euler (axial, cg) up to dt = 0.1 s; \
         w2 (tension) up to dt = 0.1 s; w2, adaptive (on-demand) up to adaptive steps, rtol = 0.01; \
         symplectic-euler up to dt = 0.025 s; verlet nowhere; bdf2 (on-demand) nowhere, no run succeeded.";
    assert_eq!(chart.conclusions(), [sentences[0], sentences[1], options, reaches]);
    // On a terminal a line each, without those that no run speaks for.
    let broken = [options, reaches].join("\n").replace(".\n", "\n").replace(": ", ":\n  ").replace("; ", "\n  ");
    let lines = broken.lines().filter(|line| !line.contains("nowhere"));
    assert_eq!(chart.conclusion_lines(), sentences.into_iter().chain(lines).collect::<Vec<_>>());
    // Without Euler's method, and without anything.
    let mut others = chart.clone();
    others.runs.retain(|run| run.method != EULER);
    let last = others.recommendations().pop().unwrap();
    assert!(last.ends_with("0.9 ms); linear-backward-euler did not get there."), "{last}");
    // Below the rounding of the longest run errors need not fall, and one run is enough.
    let at = |x: f64| nalgebra::Vector3::new(x, 0.0, 0.0);
    others.reference = Reference { error_estimate: 1e-15, ..others.reference };
    others.reference.state.positions = vec![at(99.0), at(101.0)];
    let exact = |dt: f64, error: f64| run(("verlet", "none", "none"), dt, 1.0 / dt, Some(error));
    others.runs = vec![exact(0.2, 2e-14), exact(0.1, 4e-14), exact(0.05, 8e-14)];
    assert_eq!(others.floor(), 20.0 * f64::EPSILON * (99.0f64 * 99.0 + 101.0 * 101.0).sqrt() / 2f64.sqrt());
    assert_eq!(others.decisions().first().and_then(|decision| decision.cheapest).map(|run| run.dt), Some(0.2));
    others.runs.truncate(1);
    assert_eq!(others.decisions().first().and_then(|decision| decision.cheapest).map(|run| run.dt), Some(0.2));
    others.runs.clear();
    let nothing = "Nothing can be recommended: there was no time for a run; a larger budget has some.";
    assert_eq!(others.recommendations(), [nothing]);
    // With a reference that is hardly one, the cause is told.
    let mut unsure = chart.clone();
    unsure.reference.error_estimate = 9.5e-2;
    let said = unsure.recommendations().concat();
    assert!(said.contains("the reference is good to about 10 % only, so that errors below 29 %"), "{said}");
    // With runs that are all far off, or broke down.
    let (far, none) = (Some(0.4), None);
    for (error, part) in [(far, "the best of 2 runs is wrong by 40 %"), (none, "none of 2 runs came to a useful end")] {
        others.runs = [0.1, 0.05].map(|dt| run((EULER, "full", "llt"), dt, 1.0 / dt, error)).into();
        let said = others.recommendations().concat();
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn pictures_say_what_they_show() {
    let chart = chart();
    let figures = chart.figures();
    let found: Vec<String> =
        figures.iter().map(|figure| format!("{}: {}", figure.name, figure.plot.conclusion)).collect();
    let expected = [
        "time: Least time below 1 %: w2 (on-demand) with adaptive steps, rtol = 0.001; next w2 (tension) with dt = 0.05 s, 1.03 times.",
        "work: Least work below 1 %: symplectic-euler with dt = 0.025 s; next w2 (on-demand), 3.22 times.",
        "error: The longest step that stays below 1 % has w2 (tension): 0.05 s.",
        "options-euler: Best below 1 %: full with llt, dt = 0.025 s; next axial with cg, 1.25 times the work.",
        "options-w2: Best below 1 %: tension with llt, dt = 0.05 s.",
        "energy: With steps of 0.025 s w2 (tension) is off by 0.00125, linear-backward-euler (axial, cg) by 0.008.",
        "angular-momentum: With steps of 0.025 s w2 (tension) is off by 0.0025, linear-backward-euler (axial, cg) by 0.016.",
    ];
    assert_eq!(found, expected);
    let figure = |name: &str| figures.iter().find(|figure| figure.name == name).unwrap();
    let series = |name: &str, of: &str| {
        let series = figure(name).plot.series.iter().find(|series| series.name == of && series.like.is_none());
        series.map(|series| series.points.clone()).unwrap_or_default()
    };
    assert_eq!(series("work", "symplectic-euler"), [(0.006, 90.0), (0.003, 180.0)]);
    assert_eq!(series("error", "w2, adaptive (on-demand)"), [(0.04, 0.03), (0.02, 0.004)]);
    assert_eq!(series("options-euler", "full, llt"), [(0.08, 100.0), (0.04, 200.0), (0.009, 400.0)]);
    assert_eq!(series("energy", "w2 (tension)"), [(0.1, 0.02), (0.05, 0.005), (0.025, 0.00125)]);
    // Failures by cause at what they cost, or at their step, in the colour of their method.
    let failures = |name: &str| {
        let failed = figure(name).plot.series.iter().filter_map(|series| Some((series.like.clone()?, series)));
        failed.map(|(like, series)| (like, series.name.clone(), series.points.clone())).collect::<Vec<_>>()
    };
    let failed = |like: &str, cause: &str, point: (f64, f64)| (like.to_owned(), cause.to_owned(), vec![point]);
    let infinity = f64::INFINITY;
    let expected = [
        failed("symplectic-euler", "error above 100 %", (infinity, 45.0)),
        failed("symplectic-euler", "not converged", (infinity, 20.0)),
        failed("verlet", "not converged", (infinity, 70.0)),
        failed("bdf2 (on-demand)", "not converged", (infinity, 60.0)),
    ];
    assert_eq!(failures("work"), expected);
    assert_eq!(failures("error")[0], failed("symplectic-euler", "error above 100 %", (0.05, infinity)));
    // Hollow where steps adapt, and with conjugate gradients; numbers by method, and by option.
    let look = |name: &str, of: &str| {
        let series = figure(name).plot.series.iter().find(|series| series.name == of).unwrap();
        series.look.map(|look| (look.number, look.hollow)).unwrap()
    };
    assert_eq!(look("work", "w2, adaptive (on-demand)").0, look("work", "w2 (tension)").0);
    assert!(look("work", "w2, adaptive (on-demand)").1 && !look("work", "w2 (tension)").1);
    assert_ne!(look("work", "w2 (tension)").0, look("work", "symplectic-euler").0);
    assert_eq!((look("options-euler", "full, llt"), look("options-euler", "axial, cg")), ((0, false), (2, true)));
}

/// Eight methods, of which the first costs most: the six cheapest are drawn in the order of their costs, with their own failures only, and
/// all eight in the full plot. Of four options with two solvers each, the cheaper solver of every option comes first.
#[test]
fn six_curves_are_drawn_and_all_are_kept() {
    let mut chart = chart();
    let configurations = |(method, stiffness, solver), cost| {
        let failed = run((method, stiffness, solver), 0.2, cost, None);
        let done =
            [(0.1, 0.1), (0.05, 0.05)].map(|(dt, error)| run((method, stiffness, solver), dt, cost / dt, Some(error)));
        done.into_iter().chain([failed])
    };
    let methods = ["verlet", "symplectic-euler", "forward-euler", "w2", "bdf2", "rodas4", "dop853", "backward-euler"];
    chart.runs = methods
        .into_iter()
        .zip((1..9).rev())
        .flat_map(|(m, cost)| configurations((m, "none", "none"), f64::from(cost)))
        .collect();
    let names = |plot: &Plot, failed: bool| -> Vec<String> {
        let series = plot.series.iter().filter(|series| series.like.is_some() == failed);
        series.map(|series| series.like.clone().unwrap_or(series.name.clone())).collect()
    };
    let figures = chart.figures();
    let work = figures.iter().find(|figure| figure.name == "work").unwrap();
    let cheapest: Vec<&str> = methods.into_iter().rev().collect();
    assert_eq!(names(&work.plot, false), cheapest[..6]);
    assert_eq!(names(&work.plot, true), cheapest[..6]);
    assert_eq!(names(work.full.as_ref().unwrap(), false), cheapest);
    assert_eq!(names(work.full.as_ref().unwrap(), true), cheapest);
    let options = [("full", 1.0), ("tension", 3.0), ("axial", 5.0), ("on-demand", 7.0)];
    let both = |(option, cost): (&'static str, f64)| {
        configurations((EULER, option, "cg"), cost + 1.0).chain(configurations((EULER, option, "llt"), cost))
    };
    chart.runs = options.into_iter().flat_map(both).collect();
    let figures = chart.figures();
    let options = figures.iter().find(|figure| figure.name == "options-euler").unwrap();
    let expected = ["full, llt", "tension, llt", "axial, llt", "on-demand, llt", "full, cg", "tension, cg"];
    assert_eq!(names(&options.plot, false), expected);
    let work = |figures: &[Figure]| figures.iter().find(|figure| figure.name == "work").cloned().unwrap();
    assert!(work(&figures).full.is_none() && work(&figures).plot.conclusion.starts_with("Least work"));
    // Where the runs of a part of the scene do not hold to its end, they are no advice.
    chart.excluded = (0..chart.runs.len()).collect();
    assert!(work(&chart.figures()).plot.conclusion.starts_with("Of this motion alone"));
}

/// Guides pass through the geometric mean of the points of a picture, that of the axes in the middle of them.
#[test]
fn guides_pass_where_the_points_are() {
    let mut chart = chart();
    let configuration = (EULER, "full", "llt");
    chart.runs = vec![
        run(configuration, 0.1, 10.0, Some(0.25)),
        run(configuration, 0.05, 1000.0, Some(0.01)),
        run(configuration, 0.2, 7.0, None),
    ];
    let figures = chart.figures();
    let guides = |name: &str| {
        let figure = figures.iter().find(|figure| figure.name == name).unwrap();
        let slopes = figure.plot.guides.iter().filter_map(|guide| match guide {
            Guide::Slope { slope, through } => Some((*slope, through.0, through.1)),
            _ => None,
        });
        slopes.collect::<Vec<_>>()
    };
    let near = |found: Vec<(f64, f64, f64)>, slopes: [f64; 2], [x, y]: [f64; 2]| {
        assert_eq!(found.iter().map(|guide| guide.0).collect::<Vec<_>>(), slopes);
        assert!(
            found.iter().all(|guide| (guide.1 / x - 1.0).abs().max((guide.2 / y - 1.0).abs()) < 1e-12),
            "{found:?}"
        );
    };
    near(guides("work"), [-1.0, -0.5], [0.05, 100.0]);
    near(guides("error"), [1.0, 2.0], [0.005_f64.sqrt(), 0.05]);
    // What has no place on logarithmic axes does not move them, and is not drawn: an error of zero, a failure that cost nothing.
    chart.runs.push(run(configuration, 0.025, 2000.0, Some(0.0)));
    chart.runs.push(run(configuration, 0.4, 0.0, None));
    let with_zeros = chart.figures();
    assert_eq!(with_zeros[1].plot.guides, figures[1].plot.guides);
    let failures = |figures: &[Figure]| figures[1].plot.series.iter().filter(|series| series.like.is_some()).count();
    assert_eq!((failures(&with_zeros), failures(&figures)), (1, 1));
    let costs =
        with_zeros[1].plot.series.iter().filter(|series| series.like.is_some()).flat_map(|series| &series.points);
    assert!(costs.into_iter().all(|point| point.1 > 0.0));
    let drifts = with_zeros.iter().find(|figure| figure.name == "energy").unwrap();
    assert!(drifts.plot.series.iter().flat_map(|series| &series.points).all(|point| point.1 > 0.0));
    let floor = |guide: &Guide| matches!(guide, Guide::Vertical { x, .. } if *x == 1e-7);
    assert!(figures[0].plot.guides.iter().any(floor));
    // Nothing to see: no pictures.
    chart.runs.clear();
    assert!(chart.figures().is_empty());
}

/// The best configuration of a method is the one whose cost times the root of its error is least anywhere in its tail.
#[test]
fn the_best_configuration_costs_least_for_its_error() {
    let chart = chart();
    let best = best_of_each(&chart.runs, 0.0);
    let names: Vec<(&str, &str)> = best.iter().map(|curve| (curve.method.as_str(), curve.stiffness)).collect();
    let expected = [
        (EULER, "axial"),
        ("w2", "tension"),
        ("w2, adaptive", "on-demand"),
        ("symplectic-euler", "none"),
        ("verlet", "none"),
        ("bdf2", "on-demand"),
    ];
    assert_eq!(names, expected);
    // 10 √½ = 7.1 and 12 √0.01 = 1.2 on the shorter steps, in either order; of equal ones the first.
    let rows = |stiffness: &'static str, cost: f64, error: f64| {
        let configuration = (EULER, stiffness, "llt");
        vec![run(configuration, 0.2, 100.0 * cost, Some(1.5 * error)), run(configuration, 0.1, cost, Some(error))]
    };
    for (first, second, expected) in [
        (rows("full", 10.0, 0.5), rows("axial", 12.0, 0.01), "axial"),
        (rows("axial", 12.0, 0.01), rows("full", 10.0, 0.5), "axial"),
        (rows("tension", 12.0, 0.01), rows("axial", 12.0, 0.01), "tension"),
    ] {
        let runs = [first, second].concat();
        assert_eq!(best_of_each(&runs, 0.0)[0].stiffness, expected);
    }
}

#[test]
fn what_is_not_drawn_is_said() {
    let euler = run((EULER, "full", "llt"), 0.1, 1.0, None);
    let drawn = [Series::line("linear-backward-euler (full)", vec![])];
    assert_eq!(called(&euler, &drawn), "linear-backward-euler (full)");
    assert_eq!(called(&euler, &[]), "linear-backward-euler (full, not drawn)");
    let w2 = adaptive(0.1, 0.1, 1.0, 0.1);
    assert_eq!(called(&w2, &[Series::line("w2, adaptive (on-demand)", vec![])]), "w2 (on-demand)");
    assert_eq!(called(&w2, &[Series::line("w2 (on-demand)", vec![])]), "w2 (on-demand, not drawn)");
    assert_eq!(called(&run(("verlet", "none", "none"), 0.1, 1.0, None), &[]), "verlet");
}

#[test]
fn numbers_have_three_digits() {
    let small = [0.0, -2.5, 0.05, 0.0012345, 0.00012345, -1e-9].map(short);
    assert_eq!(small, ["0", "-2.5", "0.05", "0.00123", "1.2e-4", "-1.0e-9"]);
    let large = [1.2345, 12.345, 123.45, 1234.5, 100.0, 9_999_999.0, 1e7].map(short);
    assert_eq!(large, ["1.23", "12.3", "123", "1234", "100", "9999999", "1.0e7"]);
}
