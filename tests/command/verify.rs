//! `sprung verify`: the suite on a user's scenes.

use crate::sandbox::Sandbox;
use serde_json::Value;

const PENDULUM: &str = r#"
name = "swing"
gravity = [0, -9.81]
[particles]
positions = [[0, 0], [0.9, -0.3]]
masses = [1.0, 0.4]
[springs]
pairs = [[0, 1]]
stiffness = 25.0
rest_lengths = 0.85
damping = 0.1
[[constraints]]
particles = [0]
"#;

#[test]
fn a_user_s_scene_is_verified_and_reported() {
    let sandbox = Sandbox::with("swing.toml", PENDULUM);
    let answer = sandbox.sprung(&["verify", "swing.toml", "--json"]).ends_with(0);
    let report = answer.json();
    let checks = report["checks"].as_array().unwrap();
    assert!(checks.len() > 100, "{} checks", checks.len());
    assert_eq!(report["passed"], checks.len());
    assert_eq!(report["failed"], 0);
    for check in checks {
        assert!(
            check["passed"] == Value::Bool(true) && check["scene"].as_str().unwrap().starts_with("swing"),
            "{check}"
        );
        assert!(check["value"].as_f64().unwrap() <= check["bound"].as_f64().unwrap(), "{check}");
    }
    for claim in ["jacobian", "consistency", "assembly", "refill", "solvers", "definiteness", "convergence"] {
        assert!(checks.iter().any(|check| check["claim"] == claim), "nothing for {claim}");
    }
    let written: Value = serde_json::from_str(&sandbox.read("out/swing/report.json")).unwrap();
    assert_eq!(written, report);
    assert!(sandbox.read("out/swing/report.html").contains("Every check passed"));
    assert!(sandbox.read("out/swing/junit.xml").contains("<testsuite"));
}

#[test]
fn several_scenes_share_a_report_in_the_folder_asked_for() {
    let sandbox = Sandbox::with("a.toml", PENDULUM);
    sandbox.put("b.toml", &PENDULUM.replace("swing", "sway"));
    let answer = sandbox.sprung(&["verify", "a.toml", "b.toml", "--out", "here"]).ends_with(0);
    assert!(answer.stdout.contains("holds") && answer.stdout.contains("report.html"), "{}", answer.stdout);
    let report = sandbox.read("here/report.json");
    assert!(report.contains("swing") && report.contains("sway"));
}

#[test]
fn an_unusable_scene_is_refused_before_anything_is_computed_or_written() {
    let sandbox = Sandbox::with("good.toml", PENDULUM);
    sandbox.put("bad.toml", &PENDULUM.replace("masses = [1.0, 0.4]", "masses = [1.0, -0.4]"));
    let answer = sandbox.sprung(&["verify", "good.toml", "bad.toml"]).ends_with(2);
    answer.complains(&["bad.toml", "particles.masses", "1", "-0.4"]);
    sandbox.sprung(&["verify", "missing.toml"]).ends_with(2).complains(&["missing.toml"]);
    assert!(!sandbox.path("out").exists());
}

#[test]
fn a_scene_that_arithmetic_cannot_hold_fails_with_a_report() {
    let sandbox = Sandbox::with("swing.toml", &PENDULUM.replace("stiffness = 25.0", "stiffness = 1e300"));
    let answer = sandbox.sprung(&["verify", "swing.toml"]).ends_with(1);
    assert!(answer.stdout.contains("FAILED"), "{}", answer.stdout);
    assert!(sandbox.read("out/swing/report.html").contains("failed"));
}
