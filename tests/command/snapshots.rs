//! Readable records of what the command says and writes: `cargo insta review`, or INSTA_UPDATE=always, takes over what was meant to change.
//!
//! Numbers are rounded to three digits, so that the last digits of a processor or a mathematical library do not show. What a run says of
//! its own error is measured by the study of `verification/`, not recorded here.

use crate::run::TRIANGLE;
use crate::sandbox::{Sandbox, repository_scene};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Compares with `snapshots/command__snapshots__NAME.snap`.
#[track_caller]
fn assert_is(name: &str, text: &str) {
    let mut settings = insta::Settings::clone_current();
    settings.set_omit_expression(true);
    settings.bind(|| insta::assert_snapshot!(name, text));
}

/// A text with its numbers that have a point or an exponent rounded to three digits; what is below 10⁻⁹ is rounding.
fn rounded(text: &str) -> String {
    let mut result = String::new();
    let mut rest = text;
    let mut is_in_word = false;
    while let Some(c) = rest.chars().next() {
        let length = if c.is_ascii_digit() && !is_in_word { number(rest) } else { 0 };
        let (taken, after) = rest.split_at(length.max(c.len_utf8()));
        match taken.parse::<f64>() {
            Ok(value) if length > 0 && taken.contains(['.', 'e']) => result += &three_digits(value),
            _ => result += taken,
        }
        is_in_word = length == 0 && (c.is_alphanumeric() || c == '_');
        rest = after;
    }
    result
}

/// The length of the number that a text begins with.
fn number(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| bytes[from.min(bytes.len())..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let mut end = digits(0);
    if bytes.get(end) == Some(&b'.') && digits(end + 1) > 0 {
        end += 1 + digits(end + 1);
    }
    if bytes.get(end) == Some(&b'e') {
        let sign = usize::from(bytes.get(end + 1) == Some(&b'-'));
        let exponent = digits(end + 1 + sign);
        end += if exponent > 0 { 1 + sign + exponent } else { 0 };
    }
    end
}

fn three_digits(value: f64) -> String {
    if value < 1e-9 {
        return "0".into();
    }
    let magnitude = value.log10().floor() as i32;
    if (-3..6).contains(&magnitude) {
        let digits = usize::try_from(2 - magnitude).unwrap_or(0);
        format!("{value:.digits$}")
    } else {
        format!("{value:.2e}")
    }
}

#[test]
fn numbers_are_rounded_and_nothing_else() {
    let text = "w2: 10 of 7.765363185e-2 s, -1.25e-17, 0.074999 and 1.45e5 (spring 12, 0.3 a)";
    assert_eq!(rounded(text), "w2: 10 of 0.0777 s, -0, 0.0750 and 145000 (spring 12, 0.300 a)");
}

/// Two bars that snap through under a weight, and a bar that hangs from them and can swing.
const TRUSS: &str = r#"
name = "truss"
gravity = [0.0, -9.81]
[particles]
positions = [[-1.0, 0.0], [1.1, 0.0], [0.0, 0.3], [0.0, -0.5]]
masses = [1.0, 1.0, 1.0, 0.7]
[springs]
pairs = [[0, 2], [1, 2], [2, 3]]
stiffness = 1000.0
damping = 0.5
[[constraints]]
particles = [0, 1]
"#;

/// The names of all commands, as the help lists them.
fn commands() -> Vec<String> {
    let help = Sandbox::new().sprung(&["--help"]).ends_with(0).stdout;
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names = listed.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    names.filter_map(|line| Some(line.split_whitespace().next()?.to_owned())).filter(|name| name != "help").collect()
}

#[test]
fn help() {
    let sandbox = Sandbox::new();
    assert_is("help", &sandbox.sprung(&["--help"]).ends_with(0).stdout);
    let commands = commands();
    assert!(commands.len() >= 9, "{commands:?}");
    for command in commands {
        assert_is(&format!("help-{command}"), &sandbox.sprung(&[&command, "--help"]).ends_with(0).stdout);
    }
}

/// Every unusable argument ends with status 2 and a message, says nothing on stdout and writes nothing.
#[test]
fn refusals() {
    let sandbox = Sandbox::with("triangle.toml", TRIANGLE);
    sandbox.put("timeless.toml", &TRIANGLE[..TRIANGLE.find("[time]").unwrap()]);
    let mut said = String::new();
    for line in [
        "",
        "simulate triangle.toml",
        "run",
        "run missing.toml",
        "run triangle.yaml",
        "run triangle.toml --dt 0",
        "run triangle.toml --dt -0.1",
        "run triangle.toml --dt nan",
        "run triangle.toml --dt soon",
        "run triangle.toml --duration inf",
        "run triangle.toml --steps -1",
        "run triangle.toml --steps 1.5",
        "run triangle.toml --frames 0",
        "run triangle.toml --checkpoint 0",
        "run triangle.toml --resume",
        "run triangle.toml --threads 0",
        "run triangle.toml --tolerance 1",
        "run triangle.toml --rtol 0",
        "run triangle.toml --accuracy -1",
        "run triangle.toml --method rk4",
        "run triangle.toml --stiffness soft",
        "run triangle.toml --solver qr",
        "run triangle.toml --preconditioner ilu",
        "run triangle.toml --stifness full",
        "run triangle.toml --out",
        "run triangle.toml --out triangle.toml",
        "run timeless.toml",
        "run timeless.toml --dt 0.1",
        "matrix missing.toml",
        "matrix triangle.toml --dt 0",
        "matrix triangle.toml --stiffness on-demand",
        "inspect missing.toml",
        "inspect triangle.toml --dt 0",
        "inspect triangle.toml --stiffness none",
        "inspect triangle.toml --steps two",
        "equilibrium triangle.toml --load-path 0",
        "modes triangle.toml -n 0",
        "modes triangle.toml --at nowhere.json",
        "mechanisms missing.toml",
        "verify missing.toml",
        "chart missing.toml",
        "chart triangle.toml --budget 0",
        "view missing",
        "new",
        "new carpet",
        "new cloth --size 0",
        "new cloth --size 1e9",
        "completions cmd",
    ] {
        let arguments: Vec<&str> = line.split_whitespace().collect();
        let answer = sandbox.sprung(&arguments).ends_with(2);
        assert_eq!(answer.stdout, "", "{line}");
        assert_eq!(sandbox.names("."), ["timeless.toml", "triangle.toml"], "{line}");
        writeln!(said, "$ sprung {line}\n{}", answer.stderr.trim_end()).unwrap();
    }
    assert_is("refusals", &said);
}

#[test]
fn inspections() {
    let sandbox = Sandbox::new();
    // Scenes without symmetries, of which rounding would choose one of several worst springs.
    for (scene, dt) in
        [("two_springs", "0.01"), ("two_springs", "0.5"), ("planar_truss", "0.01"), ("tetrahedron", "0.1")]
    {
        let answer = sandbox.sprung(&["inspect", &repository_scene(&format!("{scene}.toml")), "--dt", dt]).ends_with(0);
        assert_is(&format!("inspect-{scene}-{dt}"), &rounded(&answer.stdout));
    }
}

/// What a run did: its first lines, up to the energies.
#[test]
fn runs() {
    let sandbox = Sandbox::with("triangle.toml", TRIANGLE);
    let mut said = String::new();
    for options in [
        "",
        "--method backward-euler --solver ldlt",
        "--method bdf2",
        "--method w2 --stiffness axial",
        "--method implicit-midpoint --steps 3",
        "--method rodas4",
        "--method verlet",
        "--method dop853",
        "--method symplectic-euler",
        "--method forward-euler",
        "--solver cg --preconditioner jacobi",
        "--solver cg-assembled --preconditioner block-jacobi",
    ] {
        let mut arguments = vec!["run", "triangle.toml"];
        arguments.extend(options.split_whitespace());
        let answer = sandbox.sprung(&arguments).ends_with(0);
        let done = |line: &&str| ["system", "method"].iter().any(|word| line.trim_start().starts_with(word));
        let first = answer.stdout.lines().next().unwrap_or_default();
        // The seconds that it took come last.
        let first = first.rsplit_once(", in ").map_or(first, |(first, _)| first);
        writeln!(said, "$ sprung {}\n{}", arguments.join(" "), rounded(first)).unwrap();
        answer.stdout.lines().filter(done).for_each(|line| writeln!(said, "{line}").unwrap());
    }
    assert_is("runs", &said);
}

/// Keys of a JSON value and the types of what they hold; elements of a list count as one.
fn keys(value: &Value, path: &str, found: &mut BTreeMap<String, BTreeSet<&'static str>>) {
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "number",
        Value::String(_) => "text",
        Value::Array(_) => "list",
        Value::Object(_) => "object",
    };
    found.entry(path.to_owned()).or_default().insert(kind);
    match value {
        Value::Array(elements) => elements.iter().for_each(|element| keys(element, &format!("{path}[]"), found)),
        Value::Object(entries) => {
            entries.iter().for_each(|(key, value)| keys(value, &format!("{path}.{key}"), found));
        }
        _ => {}
    }
}

fn structure(value: &Value) -> String {
    let mut found = BTreeMap::new();
    keys(value, "", &mut found);
    let line = |(path, kinds): (String, BTreeSet<&str>)| {
        format!("{path}: {}\n", kinds.into_iter().collect::<Vec<_>>().join(" or "))
    };
    found.into_iter().skip(1).map(line).collect()
}

#[test]
fn files() {
    let sandbox = Sandbox::with("triangle.toml", TRIANGLE);
    sandbox.sprung(&["run", "triangle.toml", "--out", "run"]).ends_with(0);
    assert_is("keys-summary.json", &structure(&sandbox.json("run/summary.json")));
    assert_is("keys-final.json", &structure(&sandbox.json("run/final.json")));
    assert_is("header-energy.csv", sandbox.read("run/energy.csv").lines().next().unwrap_or_default());
    let scene = repository_scene("two_springs.toml");
    sandbox.sprung(&["run", &scene, "--dt", "0.5", "--stiffness", "full", "--out", "broken"]).ends_with(1);
    assert_is("keys-summary.json-of-a-failure", &structure(&sandbox.json("broken/summary.json")));
    assert_is("keys-culprits.json", &structure(&sandbox.json("broken/failure/culprits.json")));
    let inspection = sandbox.sprung(&["inspect", &scene, "--dt", "0.5", "--json"]).ends_with(0).json();
    assert_is("keys-inspect.json", &structure(&inspection));
    sandbox.put("truss.toml", TRUSS);
    for command in ["equilibrium", "modes", "mechanisms"] {
        let more: &[&str] = if command == "equilibrium" { &["--load-path", "10"] } else { &[] };
        let answer = sandbox.sprung(&[&[command, "truss.toml", "--out", "statics"], more].concat()).ends_with(0);
        // Work and what rounding leaves differ between processors.
        let kept = |line: &&str| !["work", "largest force left"].iter().any(|word| line.trim_start().starts_with(word));
        let said: Vec<&str> = answer.stdout.lines().filter(kept).collect();
        assert_is(command, &rounded(&said.join("\n")));
        let name = format!("{command}.json");
        assert_is(&format!("keys-{name}"), &structure(&sandbox.json(&format!("statics/{name}"))));
    }
    sandbox.sprung(&["verify", &scene, "--out", "verified"]).ends_with(0);
    let report = sandbox.json("verified/report.json");
    assert_is("keys-report.json", &structure(&report));
    let checks = report["checks"].as_array().unwrap().iter();
    let names: BTreeSet<String> = checks
        .map(|check| format!("{}: {}\n", check["claim"].as_str().unwrap(), check["name"].as_str().unwrap()))
        .collect();
    assert_is("checks", &names.into_iter().collect::<String>());
    for scene in ["two_springs", "planar_truss"] {
        let file = repository_scene(&format!("{scene}.toml"));
        sandbox.sprung(&["matrix", &file, "--dt", "0.01", "--out", scene]).ends_with(0);
        for name in ["A.mtx", "dofs.csv"] {
            assert_is(&format!("{scene}-{name}"), &rounded(&sandbox.read(&format!("{scene}/{name}"))));
        }
    }
}

#[test]
fn ready_scenes() {
    let sandbox = Sandbox::new();
    for (kind, size) in [
        ("chain", "2"),
        ("cloth", "3"),
        ("lattice", "2"),
        ("column", "2"),
        ("pendulum", "2"),
        ("string", "3"),
        ("network", "4"),
    ] {
        assert_is(&format!("new-{kind}"), &sandbox.sprung(&["new", kind, "--size", size]).ends_with(0).stdout);
    }
}

/// What a run says that breaks down, and what may be done about it.
#[test]
fn breakdowns() {
    let sandbox = Sandbox::new();
    let scene = repository_scene("two_springs.toml");
    let mut said = String::new();
    for options in ["--dt 0.5 --stiffness full", "--dt 0.5 --stiffness full --solver cg"] {
        let mut arguments = vec!["run", &scene];
        arguments.extend(options.split_whitespace());
        let answer = sandbox.sprung(&arguments).ends_with(1);
        writeln!(said, "$ sprung run two_springs.toml {options}").unwrap();
        let lines = answer.stderr.lines().filter(|line| !line.starts_with("warning"));
        lines.for_each(|line| writeln!(said, "{}", rounded(&line.replace(&scene, "two_springs.toml"))).unwrap());
    }
    assert_is("breakdowns", &said);
}
