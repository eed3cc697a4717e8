//! The chart: what it measures, that failures stay on it, and that its files are whole.

use sprung::accuracy::{Configuration, StepControl, relative_position_error, trial};
use sprung::chart::stability::{Tile, TileVerdict, Varied};
use sprung::chart::{Reference, SweepOptions, WorkPrecision, configurations};
use sprung::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use sprung::interrupt::Interrupt;
use sprung::scene::Scene;
use sprung::{Spring, State, Stiffness, System, SystemBuilder};
use std::path::Path;
use std::time::{Duration, Instant};

use crate::sandbox::{Sandbox, repository_scene};

/// One particle on a damped spring along a line, whose motion is known in closed form.
fn oscillator() -> (System, State) {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    let wall = builder.particle([0.0; 3], 1.0);
    let mass = builder.particle([1.5, 0.0, 0.0], 2.0);
    builder.spring(wall, mass, Spring { stiffness: 30.0, rest_length: 1.2, damping: 0.8 });
    builder.hold(wall);
    builder.build().unwrap()
}

/// `l0 + e^{−ζt}(a cos ω_d t + ζ a/ω_d sin ω_d t)` with κ = k/l0, ζ = b/2m.
fn oscillation(t: f64) -> f64 {
    let (zeta, amplitude): (f64, f64) = (0.8 / 4.0, 1.5 - 1.2);
    let damped = (30.0 / 1.2 / 2.0 - zeta * zeta).sqrt();
    1.2 + (-zeta * t).exp() * (amplitude * (damped * t).cos() + zeta * amplitude / damped * (damped * t).sin())
}

#[test]
fn the_reference_meets_a_known_answer_within_its_own_estimate() {
    let (system, start) = oscillator();
    let reference = Reference::compute(&system, &start, [0.01, 3.0], Duration::from_secs(60)).unwrap().unwrap();
    let mut exact = start.positions.clone();
    exact[1].x = oscillation(3.0);
    let error = relative_position_error(&reference.state.positions, &exact, &start.positions);
    assert!(reference.method.contains("DOP853"));
    assert!(error <= reference.error_estimate && reference.error_estimate < 1e-8, "{error:e} {reference:?}");
}

#[test]
fn the_extrapolated_reference_meets_a_known_answer_within_its_own_estimate() {
    let (system, start) = oscillator();
    let deadline = Instant::now() + Duration::from_millis(300);
    let reference = Reference::by_extrapolation(&system, &start, [0.05, 3.0], deadline).unwrap().unwrap();
    let mut exact = start.positions.clone();
    exact[1].x = oscillation(3.0);
    let error = relative_position_error(&reference.state.positions, &exact, &start.positions);
    assert!(error <= 2.0 * reference.error_estimate && reference.error_estimate < 1e-5, "{error:e} {reference:?}");
}

fn measure(name: &str, budget: f64) -> WorkPrecision {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/verify/scenes").join(name);
    let scene = Scene::load(path).unwrap();
    let (system, start) = scene.build().unwrap();
    let options = SweepOptions {
        duration: scene.time.duration.unwrap(),
        dt: scene.time.dt.unwrap(),
        budget: Duration::from_secs_f64(budget),
        par: faer::Par::Seq,
        interrupt: Interrupt::NEVER,
    };
    WorkPrecision::measure(&scene.name, &system, &start, &options, &mut |_, _: &str| {}).unwrap().unwrap()
}

#[test]
fn failed_runs_stay_with_their_cause() {
    let chart = measure("compressed_chain.toml", 4.0);
    let full = chart.runs.iter().filter(|run| run.method == "linear-backward-euler" && run.stiffness == "full");
    let refused: Vec<_> = full.filter(|run| run.dt > 0.08).collect();
    assert!(!refused.is_empty());
    for run in refused {
        assert_eq!(run.cause().as_deref(), Some("indefinite"));
        assert!(run.error.is_none() && run.failure.as_ref().is_some_and(|why| why.contains("pivot")));
    }
    assert!(chart.runs.iter().any(|run| run.rtol.is_some()));
    let errors = chart.figures().into_iter().find(|figure| figure.name == "error").unwrap();
    // The methods that fail so are not among the cheapest.
    let all = errors.full.unwrap();
    let rail = all.series.iter().find(|series| series.name == "indefinite").unwrap();
    assert!(rail.points.iter().all(|point| point.1.is_infinite()));
    assert!(sprung::report::plot::svg(&all).contains("indefinite"));
}

#[test]
fn decisions_are_the_cheapest_runs() {
    let chart = measure("tetrahedron.toml", 4.0);
    let decisions = chart.decisions();
    assert!(decisions.len() >= 3);
    for decision in &decisions {
        let cheapest = decision.cheapest.unwrap();
        assert!(cheapest.error.unwrap() <= decision.accuracy);
        let enough = || chart.sound_runs().into_iter().filter(|run| run.error.is_some_and(|e| e <= decision.accuracy));
        assert!(enough().all(|run| run.cost >= cheapest.cost));
        assert!(enough().any(|run| run == cheapest) && decision.methods.contains(&cheapest));
    }
    assert!(chart.conclusions().iter().all(|sentence| sentence.ends_with('.')));
}

#[test]
fn work_is_the_stages_of_the_method_times_the_steps() {
    let (system, start) = oscillator();
    let counts = |method, stiffness| {
        let configuration = Configuration { method, options: ImplicitOptions { stiffness, ..Default::default() } };
        let work =
            trial(&system, &start, &configuration, StepControl::Step(0.01), 1.0, &|| true).unwrap().statistics.work;
        (work.force_evaluations, work.factorizations, work.solves)
    };
    assert_eq!(counts(Method::LinearBackwardEuler, StiffnessPolicy::OnDemand), (100, 100, 100));
    assert_eq!(counts(Method::W2, StiffnessPolicy::Always(Stiffness::Axial)), (200, 100, 200));
    assert_eq!(counts(Method::SymplecticEuler, StiffnessPolicy::OnDemand), (100, 0, 0));
    assert_eq!(counts(Method::Verlet, StiffnessPolicy::OnDemand), (101, 0, 0));
    assert_eq!(counts(Method::Dop853, StiffnessPolicy::OnDemand), (1200, 0, 0));
    // A damped oscillator: two corrections in each of six stages.
    assert_eq!(counts(Method::Rodas4, StiffnessPolicy::OnDemand), (600, 100, 1800));
}

#[test]
fn the_map_knows_the_three_deaths() {
    let all = configurations(faer::Par::Seq);
    let tile = |method: Method, stiffness: &str| {
        let configuration = all.iter().find(|c| c.method == method && c.stiffness() == stiffness).unwrap();
        Tile::measure(configuration, Varied::Stretch, &[1.0, 4.0], &[0.5, 2.0]).unwrap().verdicts
    };
    use TileVerdict::*;
    let [full, axial] = ["full", "axial"].map(|option| tile(Method::LinearBackwardEuler, option));
    // Compressed: λ = 0.5 has its critical step at z = 1. Stretched: λ = 2 has the limit of `axial` at z = 2.83.
    assert_eq!(full, [[full[0][0], Indefinite], [Stable, Stable]]);
    assert_eq!(axial[1], [Stable, EnergyGrowth]);
    assert_eq!(tile(Method::ForwardEuler, "none")[1], [EnergyGrowth, EnergyGrowth]);
    assert_eq!(tile(Method::SymplecticEuler, "none")[1], [Stable, EnergyGrowth]);
    assert_eq!(tile(Method::Verlet, "none")[1], [Stable, EnergyGrowth]);
    assert_eq!(tile(Method::Dop853, "none")[1], [Stable, Stable]);
    assert_eq!(tile(Method::Rodas4, "full")[1], [Stable, Stable]);
}

#[test]
fn the_command_writes_whole_files() {
    let folder = Sandbox::new();
    let scene = repository_scene("two_springs.toml");
    let answer = folder.sprung(&["chart", &scene, "--budget", "2", "--json", "--out", "o"]).ends_with(0);
    let chart = folder.json("o/chart.json");
    assert_eq!(answer.json()["runs"].as_array().unwrap().len(), chart["runs"].as_array().unwrap().len());
    assert_eq!(chart["scene"], "two springs");
    assert!(chart["reference"]["error_estimate"].as_f64().unwrap() < 1e-6);
    for run in chart["runs"].as_array().unwrap() {
        for key in ["method", "stiffness", "solver", "dt", "status", "error", "wall_seconds", "work"] {
            assert!(run.get(key).is_some(), "{key}");
        }
    }
    assert!(chart["stability"].is_object());
    let page = folder.read("o/chart.html");
    assert!(page.contains("What to use") && page.contains("</html>") && !page.contains("http-equiv"));
    assert!(folder.names("o/chart").contains(&"work.svg".to_owned()));
}

#[test]
fn unusable_arguments_write_nothing() {
    let folder = Sandbox::new();
    let scene = repository_scene("two_springs.toml");
    for arguments in [["--budget", "0"], ["--budget", "nan"], ["--dt", "-1"]] {
        folder.sprung(&[&["chart", &scene, "--out", "o"], &arguments[..]].concat()).ends_with(2);
    }
    folder.sprung(&["chart", "missing.toml", "--out", "o"]).ends_with(2);
    assert!(!folder.path("o").exists());
}
