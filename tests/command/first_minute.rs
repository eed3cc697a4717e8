//! What a person reads first: whether a run worked, how right it is, where its picture is, and what it takes the place of.

use crate::sandbox::{Answer, Sandbox};

/// A spring that swings on a hook, with a step of its own.
const SPRING: &str = r#"
gravity = [0.0, -9.81]
[particles]
positions = [[0, 0], [0, -1]]
masses = 0.3
[springs]
pairs = [[0, 1]]
stiffness = 40.0
damping = 0.1
[[constraints]]
particles = [0]
[time]
dt = 0.003
duration = 1
"#;

fn sandbox() -> Sandbox {
    Sandbox::with("spring.toml", SPRING)
}

fn run(sandbox: &Sandbox, more: &[&str]) -> Answer {
    sandbox.sprung(&[&["run", "spring.toml", "--out", "o"], more].concat()).ends_with(0)
}

/// The last line opens the page; without one it says how to get it. Bookkeeping is for those who ask.
#[test]
fn the_first_lines_are_what_a_person_wants_to_know() {
    let sandbox = sandbox();
    let plain = run(&sandbox, &[]).stdout;
    assert!(plain.lines().count() <= 6, "{plain}");
    assert!(plain.starts_with("spring: completed at t = 1 s after 334 steps, in "), "{plain}");
    assert!(plain.lines().nth(1).unwrap().starts_with("  error "), "{plain}");
    assert!(plain.trim_end().lines().last().unwrap().contains("--view"), "{plain}");
    assert!(!plain.contains("unexplained") && !plain.contains("residual"), "{plain}");
    let seen = run(&sandbox, &["--view"]).stdout;
    let page = sandbox.path("o/view.html");
    assert_eq!(seen.trim_end().lines().last().unwrap(), "open o/view.html");
    assert!(page.is_file());
    let kept = run(&sandbox, &["--frames", "9"]).stdout;
    assert_eq!(kept.trim_end().lines().last().unwrap(), "  motion    kept; sprung view o plays it");
    let full = run(&sandbox, &["--view", "--verbose"]).stdout;
    for part in ["unexplained", "residual", "2 particles, 1 spring, 2 degrees of freedom", "J at the end"] {
        assert!(full.contains(part), "{part:?} is not in {full}");
    }
    assert_eq!(full.trim_end().lines().last().unwrap(), "open o/view.html");
    let one = run(&sandbox, &["--steps", "1"]).stdout;
    assert!(one.contains("after 1 step, in"), "{one}");
    let viewed = sandbox.sprung(&["view", "spring.toml", "-o", "rest.html"]).ends_with(0).stdout;
    assert_eq!(viewed.trim_end().lines().last().unwrap(), "open rest.html");
}

/// No number for people has more than six digits, nor a line more than two hundred letters.
#[test]
fn numbers_are_short() {
    let sandbox = sandbox();
    for more in
        [&["--verbose"][..], &["--verbose", "--duration", "1.6666666666666667"], &["--verbose", "--rtol", "1e-3"]]
    {
        let text = run(&sandbox, more).stdout;
        for word in text.split(|c: char| !c.is_ascii_digit() && !".e-".contains(c)) {
            let mantissa = word.split('e').next().unwrap_or_default().trim_start_matches(['-', '0', '.']);
            let digits = mantissa.chars().filter(char::is_ascii_digit).count();
            assert!(digits <= 6, "{word:?} in {text}");
        }
        assert!(text.lines().all(|line| line.chars().count() <= 200), "{text}");
    }
}

/// Warnings come before the page to open.
#[test]
fn the_page_is_the_last_line() {
    let sandbox = sandbox();
    let script = format!("'{}' run spring.toml --dt 0.1 --view --out o 2>&1", env!("CARGO_BIN_EXE_sprung"));
    let output = sandbox.shell(&script).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("warning: ") && text.trim_end().lines().last().unwrap().starts_with("open "), "{text}");
}

/// A wrong option is blamed, and not the scene.
#[test]
fn an_option_is_blamed_by_its_name() {
    let message = "error: --dt = 1e-320: is too short for a run of 1.0 s: it would take more than 2^53 steps";
    sandbox().sprung(&["run", "spring.toml", "--dt", "1e-320"]).ends_with(2).complains(&[message]);
}

/// Maxwell's count: two springs on two particles in a plane leave two motions, and none where one of them resists in both directions.
#[test]
fn springs_without_a_rest_length_hold_in_every_direction() {
    let sandbox = Sandbox::new();
    for (rest_lengths, floppy) in [("[1, 1]", "at least 2 motions stretch no spring"), ("[1, 0]", "at least 1 motion ")]
    {
        let springs = format!("pairs = [[0, 1], [0, 2]], stiffness = 1, rest_lengths = {rest_lengths}");
        let particles = "positions = [[0, 0], [1, 0], [0, 1]], masses = 1";
        let held = "constraints = [{ particles = [0] }]";
        sandbox.put("net.toml", &format!("{held}\nparticles = {{ {particles} }}\nsprings = {{ {springs} }}"));
        let text = sandbox.sprung(&["run", "net.toml", "--dt", "0.1", "--steps", "1", "-v"]).ends_with(0).stdout;
        assert!(text.contains(&format!("  floppy    {floppy}")), "{text}");
    }
}

#[test]
fn a_second_run_says_what_it_replaces() {
    let sandbox = sandbox();
    assert_eq!(run(&sandbox, &["--method", "bdf2"]).stderr, "");
    run(&sandbox, &["--method", "w2"]).complains(&[
        "note: o: a run of spring by bdf2 ended here, completed at t = 1 s: this run replaces its files\n",
    ]);
    run(&sandbox, &["--view", "--quiet"]);
    run(&sandbox, &[]).complains(&[": this run replaces its files, and removes trajectory.npz and view.html\n"]);
    assert_eq!(sandbox.names("o"), ["energy.csv", "final.json", "summary.json"]);
    assert_eq!(run(&sandbox, &["--quiet"]).stderr, "");
    run(&sandbox, &["--view", "--frames", "9", "--quiet"]);
    run(&sandbox, &[]).complains(&["and removes frames.pvd, trajectory.npz and view.html\n"]);
    run(&sandbox, &["--view", "--quiet"]);
    run(&sandbox, &["--frames", "9"]).complains(&["and removes view.html\n"]);
}

/// A run that was complete goes on with a longer duration, from its last checkpoint that lies on the longer run: its own last step was cut short.
#[test]
fn resuming_what_is_complete_goes_on() {
    let sandbox = sandbox();
    run(&sandbox, &["--checkpoint", "50"]);
    for (more, step) in [
        (&["--duration", "2", "--resume", "--checkpoint", "50"][..], 300),
        (&["--duration", "3", "--resume", "--checkpoint", "50"], 650),
    ] {
        let said = format!("this run goes on from its checkpoint at step {step}");
        run(&sandbox, more).complains(&["completed at t = ", &said]);
        assert_eq!(sandbox.json("o/summary.json")["time"].as_f64().unwrap().to_string(), more[1]);
    }
    assert_eq!(sandbox.csv("o/energy.csv").len(), 1001);
}

/// Without checkpoints there is nothing to go on from, and the run says that it starts again.
#[test]
fn resuming_what_kept_nothing_starts_again() {
    let sandbox = sandbox();
    run(&sandbox, &[]);
    run(&sandbox, &["--duration", "2", "--resume", "--checkpoint", "50"]).complains(&["this run starts again"]);
    assert_eq!(sandbox.json("o/summary.json")["time"].as_f64().unwrap(), 2.0);
}

/// The scene has a step, and the command has the last word.
#[test]
fn a_tolerance_wins_over_the_step_of_a_scene() {
    let sandbox = sandbox();
    let answer = run(&sandbox, &["--rtol", "1e-4"]);
    assert!(
        answer.stderr.contains("--rtol: steps are adaptive; the scene's dt of 0.003 s is not used"),
        "{}",
        answer.stderr
    );
    let summary = sandbox.json("o/summary.json");
    assert_eq!((&summary["method"], &summary["rtol"]), (&"dop853".into(), &1e-4.into()));
    assert_eq!(sandbox.csv("o/energy.csv").len(), 301);
    // A step beside it is the interval of records.
    run(&sandbox, &["--rtol", "1e-4", "--dt", "0.1"]);
    assert_eq!(sandbox.csv("o/energy.csv").len(), 11);
}

#[test]
fn what_is_neither_a_run_nor_a_scene_is_said_to_be_missing() {
    let sandbox = sandbox();
    sandbox
        .sprung(&["view", "out/none"])
        .ends_with(2)
        .complains(&["out/none: there is nothing of this name", "output folder"]);
    sandbox.sprung(&["run", "spring.toml", "--view"]).ends_with(0);
    sandbox.sprung(&["view", "spring"]).ends_with(2).complains(&["did you mean out/spring?"]);
}

/// A cloth of twice as many particles along a side is twice as wide, but for --refine, which wants a size.
#[test]
fn sizes_enlarge_and_refining_does_not() {
    let sandbox = sandbox();
    let width = |arguments: &[&str]| {
        let scene = sandbox.sprung(&[&["new", "cloth", "--json"], arguments].concat()).ends_with(0).json();
        let positions = scene["particles"]["positions"].as_array().unwrap();
        (positions.len(), positions.last().unwrap()[0].as_f64().unwrap())
    };
    let (count, whole) = width(&[]);
    assert_eq!(count, 400);
    let (larger, refined) = (width(&["--size", "39"]), width(&["--size", "39", "--refine"]));
    assert_eq!((larger.0, refined.0), (39 * 39, 39 * 39));
    assert!((larger.1 / whole - 2.0).abs() < 1e-12 && (refined.1 / whole - 1.0).abs() < 1e-12);
    sandbox.sprung(&["new", "cloth", "--refine"]).ends_with(2).complains(&["--size"]);
    sandbox.sprung(&["new", "network", "--size", "9", "--refine"]).ends_with(2).complains(&["network"]);
    let help = sandbox.sprung(&["new", "--help"]).ends_with(0).stdout;
    assert!(help.contains("larger scene") && help.contains("--refine"), "{help}");
}

/// A budget is one for the map of stability too, which has what there was time for.
#[test]
fn charts_keep_to_their_budget() {
    let sandbox = sandbox();
    let began = std::time::Instant::now();
    let chart = ["chart", "spring.toml", "--budget", "6", "--stability", "--duration", "0.1", "--out", "c"];
    let answer = sandbox.sprung(&chart);
    // What is under way is finished: a run, a tile, the pages.
    assert!(began.elapsed().as_secs_f64() < 18.0, "{:?}: {}", began.elapsed(), answer.stderr);
    assert!(sandbox.json("c/chart.json")["stability"]["tiles"].is_array());
}

/// Forces of the hook, in the file of the end: its weight and what hangs on it, which still swings.
#[test]
fn final_states_have_reactions() {
    let sandbox = sandbox();
    run(&sandbox, &[]);
    let end = sandbox.json("o/final.json");
    assert_eq!(end["reactions"]["particles"], serde_json::json!([0]));
    let [force, weight] = [end["reactions"]["forces"][0][1].as_f64().unwrap(), 0.3 * 9.81];
    let [y, v] = ["positions", "velocities"].map(|key| end[key][1][1].as_f64().unwrap());
    let tension = 40.0 * (-y - 1.0) - 0.1 * v;
    assert!((force - weight - tension).abs() < 1e-12, "{force} {tension}");
}
