//! `sprung inspect`, and what a run says that ends with an indefinite matrix.

use crate::sandbox::Sandbox;
use sprung::inspect::Inertia;
use sprung::integrate::StepMatrices;
use sprung::{Scene, Stiffness};

/// One compressed spring between two free particles: A is definite up to dt = √(μ/(k(1/l − 1/l0))).
const SPRING: &str = r#"
name = "short"
particles = { positions = [[0, 0, 0], [0.6, 0, 0]], velocities = [[0, 0.1, 0], [0, 0, 0]], masses = [1.5, 0.5] }
springs = { pairs = [[0, 1]], stiffness = 80, rest_lengths = 1.2, damping = 0.4 }
time = { dt = 0.1, duration = 1 }
"#;

fn critical() -> f64 {
    (0.375 / (80.0 * (1.0 / 0.6 - 1.0 / 1.2f64))).sqrt()
}

#[test]
fn reports_everything_as_json() {
    let sandbox = Sandbox::with("short.toml", SPRING);
    let answer = sandbox.sprung(&["inspect", "short.toml", "--json"]);
    assert_eq!(answer.status, Some(0), "{}", answer.stderr);
    let json = answer.json();
    assert_eq!(json["scene"], "short");
    assert_eq!((json["dt"].as_f64(), json["stiffness"].as_str()), (Some(0.1), Some("full")));
    assert_eq!((json["dofs"].as_u64(), json["definite"].as_bool()), (Some(6), Some(false)));
    let inertia = &json["inertia"];
    assert_eq!(
        (inertia["negative"].as_u64(), inertia["zero"].as_u64(), inertia["positive"].as_u64()),
        (Some(2), Some(0), Some(4))
    );
    let close = |value: &serde_json::Value, expected: f64| {
        let value = value.as_f64().expect("a number");
        assert!((value / expected - 1.0).abs() < 1e-9, "{value} instead of {expected}");
    };
    close(&json["critical_dt"], critical());
    assert!(json["lambda_min"].as_f64() < Some(0.0) && json["lambda_max"].as_f64() > Some(0.0));
    assert!(json["condition"].as_f64() >= Some(1.0));
    assert_eq!(json["compressed_springs"], 1);
    let culprit = &json["culprits"][0];
    assert_eq!((culprit["spring"].as_u64(), culprit["particles"].to_string()), (Some(0), "[0,1]".into()));
    close(&culprit["strain"], -0.5);
    close(&culprit["share"], 1.0);
    assert_eq!(json["culprits"].as_array().map(Vec::len), Some(1));
    assert_eq!(json["smallest_set"]["springs"].to_string(), "[0]");
    close(&json["options"]["full"]["critical_dt"], critical());
    for option in ["tension", "axial"] {
        assert!(json["options"][option]["critical_dt"].is_null() && json["options"][option]["stable_dt"].is_null());
        assert_eq!(json["options"][option]["definite"], true);
    }
}

#[test]
fn tells_people_the_same_and_draws_it() {
    let sandbox = Sandbox::with("short.toml", SPRING);
    let answer = sandbox.sprung(&["inspect", "short.toml", "--out", "pictures"]);
    assert_eq!(answer.status, Some(0), "{}", answer.stderr);
    // The first answer goes to where progress does, before there is any result.
    for part in ["note: A is INDEFINITE, as a direction u with uᵀAu = -", "proves", "spring 0 (0–1): strain -0.500"]
    {
        assert!(answer.stderr.contains(part), "{part:?} is not in {}", answer.stderr);
    }
    assert!(!answer.stdout.contains("as a direction u"), "{}", answer.stdout);
    for part in [
        "at this state: A is INDEFINITE",
        "linearised, for linear-backward-euler",
        "3.41 under w2",
        "2 negative, 0 zero, 4 positive",
        "every step",
        "spring 0 (0–1): strain -0.500, share 1",
    ] {
        assert!(answer.stdout.contains(part), "{part} is not in\n{}", answer.stdout);
    }
    let names = sandbox.names("pictures");
    let expected = ["inspect.html", "lambda-min.svg", "pattern-A.svg", "pattern-L.svg", "scene.svg", "spectrum.svg"];
    assert_eq!(names, expected);
    let page = sandbox.read("pictures/inspect.html");
    assert_eq!(page.matches("<svg").count(), 5);
    assert!(!page.contains("NaN") && !page.contains("src=\"http"));
}

#[test]
fn takes_a_step_where_none_is_given_and_says_so() {
    let sandbox = Sandbox::with("short.toml", &SPRING.replace("time = { dt = 0.1, duration = 1 }", ""));
    let answer = sandbox.sprung(&["inspect", "short.toml", "--json"]).ends_with(0);
    answer.complains(&["no dt was given: 0.01 s is taken"]);
    assert_eq!(answer.json()["dt"], 0.01);
}

/// A cloth at rest: every step is definite and stable, and a run with this one breaks down at once.
#[test]
fn a_step_that_the_matrix_allows_and_the_motion_does_not_is_told() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "10");
    let answer = sandbox.sprung(&["run", "cloth.toml", "--dt", "0.05", "--stiffness", "full"]);
    answer.ends_with(1);
    let json = sandbox.sprung(&["inspect", "cloth.toml", "--dt", "0.05", "--json"]).ends_with(0).json();
    assert_eq!((json["definite"].as_bool(), json["critical_dt"].is_null()), (Some(true), true));
    assert_eq!(json["turning"]["too_far"], true);
    let safe = json["options"]["full"]["turning_dt"].as_f64().expect("a limit");
    assert!(safe > 1e-3 && safe < 5e-3, "{safe}");
    assert!(json["first_lost"].is_null());
    let json = sandbox.sprung(&["inspect", "cloth.toml", "--dt", "0.05", "--steps", "2", "--json"]).ends_with(0).json();
    let lost = &json["first_lost"];
    assert_eq!((lost["turning"]["step"].as_u64(), lost["definite"]["step"].as_u64()), (Some(1), Some(2)));
    assert!(lost["energy"]["gained"].as_f64() > Some(0.0));
    let page = sandbox.read("out/cloth/inspect.html");
    assert!(page.contains("were first lost") && page.contains("which alone stretches it by"), "{page}");
}

/// What the README shows of a terminal is what the program prints: the commands, and of their output the lines shown, whole or up
/// to "…".
#[test]
fn the_readme_shows_what_is_printed() {
    let readme = include_str!("../../README.md");
    let sandbox = Sandbox::new();
    let blocks: Vec<&str> = readme.split("```console\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert!(!blocks.is_empty());
    let mut printed = String::new();
    // Other blocks show runs, which the first minute is tested by.
    let blocks: Vec<&str> = blocks.into_iter().filter(|block| block.contains("sprung inspect")).collect();
    assert!(!blocks.is_empty());
    for line in blocks.concat().lines() {
        if let Some(command) = line.strip_prefix("$ sprung ") {
            let (command, file) =
                command.split_once(" > ").map_or((command, None), |(command, file)| (command, Some(file)));
            let arguments: Vec<&str> = command.split_whitespace().collect();
            printed = sandbox.sprung(&arguments).ends_with(0).stdout;
            if let Some(file) = file {
                sandbox.put(file, &printed);
            }
        } else if line != "…" {
            let wanted = line.strip_suffix('…').map_or(format!("{line}\n"), str::to_owned);
            let (_, rest) = printed.split_once(&wanted).unwrap_or_else(|| panic!("{line}\nis not in\n{printed}"));
            printed = rest.to_owned();
        }
    }
}

#[test]
fn quiet_about_a_definite_matrix() {
    let sandbox = Sandbox::with("short.toml", SPRING);
    let answer = sandbox.sprung(&["inspect", "short.toml", "--dt", "0.01", "--json"]);
    let json = answer.json();
    assert_eq!((json["definite"].as_bool(), json["smallest_set"].is_null()), (Some(true), true));
    let answer = sandbox.sprung(&["inspect", "short.toml", "--stiffness", "axial", "--json"]);
    let json = answer.json();
    assert_eq!((json["definite"].as_bool(), json["culprits"].to_string()), (Some(true), "[]".into()));
    assert!(json["critical_dt"].is_null());
}

/// The spring is thrown together: stretched at first, compressed later.
#[test]
fn says_when_along_a_run_definiteness_is_first_lost() {
    let sandbox = Sandbox::new();
    let scene = SPRING.replace("[0.6, 0, 0]", "[1.5, 0, 0]").replace("[0, 0.1, 0], [0, 0, 0]", "[1, 0, 0], [-5, 0, 0]");
    sandbox.put("thrown.toml", &scene);
    let answer = sandbox.sprung(&["inspect", "thrown.toml", "--dt", "0.3", "--steps", "40", "--json"]);
    assert_eq!(answer.status, Some(0), "{}", answer.stderr);
    let json = answer.json();
    assert_eq!(json["step"], 40);
    let loss = &json["first_loss"];
    let first = loss["step"].as_u64().expect("lost on the way");
    assert!((1..40).contains(&first), "{loss}");
    assert_eq!((loss["culprits"][0]["spring"].as_u64(), loss["negative"].as_u64()), (Some(0), Some(2)));

    // The states on both sides of the loss, by a run of their own.
    for (steps, negative) in [(first - 1, 0), (first, 2)] {
        let steps = steps.to_string();
        let json = sandbox.sprung(&["inspect", "thrown.toml", "--dt", "0.3", "--steps", &steps, "--json"]).json();
        assert_eq!(json["inertia"]["negative"].as_u64(), Some(negative), "after {steps} steps");
    }
}

#[test]
fn a_run_that_ends_indefinite_explains_itself_and_can_be_repeated() {
    let sandbox = Sandbox::with("short.toml", SPRING);
    let answer = sandbox.sprung(&["run", "short.toml", "--stiffness", "full", "--out", "out"]);
    assert_eq!(answer.status, Some(1));
    let said = |line: &&str| line.starts_with("error: ") || line.starts_with("help: ");
    let lines: Vec<&str> = answer.stderr.lines().filter(said).collect();
    assert_eq!(lines.len(), 5, "{}", answer.stderr);
    assert!(lines[1].contains("spring 0 (0–1, 50 % compressed"), "{}", lines[1]);
    assert!(lines[2].contains("up to dt = 0.0750 s (it was 0.100 s)"), "{}", lines[2]);
    assert!(lines[3].starts_with("help: --stiffness on-demand carries on"), "{}", lines[3]);
    assert!(lines[4].starts_with("help: this repeats the step"), "{}", lines[4]);
    assert_eq!(sandbox.names("out/failure"), ["A.mtx", "b.mtx", "culprits.json", "dofs.csv", "scene.toml"]);
    assert_eq!(sandbox.json("out/failure/culprits.json")["culprits"][0]["spring"], 0);

    let again = sandbox.sprung(&["run", "out/failure/scene.toml", "--stiffness", "full", "--out", "again"]);
    assert_eq!(again.status, Some(1));
    assert_eq!(sandbox.json("again/summary.json")["failure"]["step"], 1);
    assert_eq!(sandbox.json("again/summary.json")["status"], "indefinite");
    assert_eq!(sandbox.read("again/failure/A.mtx"), sandbox.read("out/failure/A.mtx"));
    assert_eq!(sandbox.read("again/failure/b.mtx"), sandbox.read("out/failure/b.mtx"));

    let (system, state) = Scene::load(sandbox.path("out/failure/scene.toml")).unwrap().build().unwrap();
    let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1).unwrap().a;
    assert_eq!(Inertia::of(&a).unwrap().negative, 2);

    let carried = sandbox.sprung(&["run", "short.toml", "--stiffness", "on-demand", "--out", "carried", "--json"]);
    assert_eq!(carried.status, Some(0), "{}", carried.stderr);
    let summary = carried.json();
    assert!(summary["softened_solves"].as_u64() > Some(0));
    assert_eq!(summary["dropped_terms"], summary["softened_solves"], "one spring");
}

#[test]
fn refuses_what_it_cannot_use_and_writes_nothing() {
    let sandbox = Sandbox::with("short.toml", &SPRING.replace("time = { dt = 0.1, duration = 1 }", ""));
    for (arguments, part) in [
        (&["inspect", "short.toml", "--dt", "0"][..], "positive"),
        (&["inspect", "short.toml", "--dt", "0.1", "--stiffness", "none"], "none"),
        (&["inspect", "missing.toml", "--dt", "0.1"], "missing.toml"),
    ] {
        let answer = sandbox.sprung(arguments);
        assert_eq!(answer.status, Some(2), "{arguments:?}");
        assert!(answer.stderr.contains(part), "{}", answer.stderr);
    }
    let answer = sandbox.sprung(&["inspect", "short.toml", "--dt", "1e-200"]).ends_with(1);
    answer.complains(&["not finite"]);
    assert_eq!(sandbox.names("."), ["short.toml"]);
}

/// Symmetric scenes have eigenvalues of several eigenvectors, up to their imperfections: the one that is drawn is one of many.
#[test]
fn a_degenerate_eigenvector_is_said_to_be_one() {
    let sandbox = Sandbox::new();
    let inspect = |kind: &str, size: &str, dt: &str| {
        sandbox.sprung(&["new", kind, "--size", size, "-o", &format!("{kind}.toml")]).ends_with(0);
        let answer = sandbox.sprung(&["inspect", &format!("{kind}.toml"), "--dt", dt, "--out", kind]).ends_with(0);
        (answer.stdout, sandbox.read(&format!("{kind}/inspect.html")))
    };
    // It may buckle to every side.
    let (said, page) = inspect("column", "20", "0.02");
    assert!(said.contains("λ_min is 2-fold"), "{said}");
    assert!(page.contains("N/m, 2-fold: column") && page.contains("its eigenvalue is 2-fold"));
    // A flat cloth has no stiffness across itself, and more such directions than were looked for.
    let (_, page) = inspect("cloth", "12", "0.02");
    assert!(page.contains("at least 12-fold"));
    assert!(page.contains("No spring spoils it") && !page.contains("Which springs"));
    assert!(page.contains("No spring is shorter than at rest") && page.contains("is 0 everywhere"));
    // A truss in a plane has no symmetry left.
    sandbox.sprung(&["inspect", &crate::sandbox::repository_scene("planar_truss.toml"), "--out", "truss"]).ends_with(0);
    assert!(!sandbox.read("truss/inspect.html").contains("-fold"));
}

/// Every picture names the scene and says in a sentence what it shows.
#[test]
fn pictures_have_titles_and_conclusions() {
    let sandbox = Sandbox::with("short.toml", SPRING);
    sandbox.sprung(&["inspect", "short.toml", "--out", "o"]).ends_with(0);
    let pictures = [
        ("scene.svg", "Spring 0 (0–1) spoils A most, with 100 % of the negative curvature; no other spring does."),
        ("lambda-min.svg", "A is definite up to"),
        ("spectrum.svg", "2 of 6 are negative; the lowest is"),
        ("pattern-A.svg", "9 entries in 6 rows"),
        ("pattern-L.svg", "times those of A"),
    ];
    for (file, conclusion) in pictures {
        let picture = sandbox.read(&format!("o/{file}"));
        let label = picture.split("aria-label=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap_or_default();
        assert!(label.contains(": short") && label.replace('\u{a0}', " ").contains(conclusion), "{file}: {label}");
    }
}
