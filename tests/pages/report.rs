//! Results become reports: nothing is lost, nothing is hidden, nothing breaks out of its place.

use crate::sample::{HOSTILE, chain, mixed, passing};
use serde_json::Value;
use sprung::figure::{Axis, Drawing, Guide, Plot, Series};
use sprung::output::write_report;
use sprung::report;
use sprung::verify::{Check, Claim, Entry, Results};

fn check(value: f64, bound: f64) -> Check {
    Check::new(Claim::Solvers, "name", "scene", value, bound, "why")
}

#[test]
fn only_finite_values_within_finite_bounds_pass() {
    assert!(check(1.0, 1.0).passed());
    assert!(check(0.0, 0.0).passed());
    assert!(!check(1.0 + f64::EPSILON, 1.0).passed());
    for (value, bound) in [
        (f64::NAN, 1.0),
        (0.0, f64::NAN),
        (f64::NAN, f64::NAN),
        (0.0, f64::INFINITY),
        (f64::INFINITY, f64::INFINITY),
        (f64::NEG_INFINITY, 1.0),
    ] {
        assert!(!check(value, bound).passed(), "{value} ≤ {bound}");
    }
}

#[test]
fn nan_behind_the_value_fails() {
    assert!(check(0.0, 1.0).with_table(vec![Entry::new(0, None, 1.0, 1.0, 0.0)]).passed());
    assert!(!check(0.0, 1.0).with_table(vec![Entry::new(0, None, f64::NAN, 1.0, 0.0)]).passed());
    let plot = |y| Plot::log_log("", "", "").with_series(Series::line("", vec![(1.0, 1.0), (2.0, y)]));
    assert!(check(0.0, 1.0).with_curves(plot(0.5)).passed());
    assert!(!check(0.0, 1.0).with_curves(plot(f64::NAN)).passed());
}

#[test]
fn json_has_the_agreed_keys_and_exact_numbers() {
    let results = mixed();
    let document: Value = serde_json::from_str(&report::json(&results).unwrap()).unwrap();
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&document), ["checks", "failed", "not_judged", "passed"]);
    assert_eq!(document["passed"], results.passed());
    assert_eq!(document["failed"], 6);
    let checks = document["checks"].as_array().unwrap();
    assert_eq!(checks.len(), results.checks.len());
    for (record, check) in checks.iter().zip(&results.checks) {
        assert_eq!(keys(record), ["bound", "claim", "name", "passed", "scene", "value", "why"]);
        assert_eq!(record["passed"], check.passed());
        assert_eq!(record["claim"], check.claim.id());
        assert_eq!(record["value"].as_f64(), check.value.is_finite().then_some(check.value));
    }
    let nan = checks.iter().find(|record| record["scene"] == "crumpled").unwrap();
    assert_eq!((&nan["value"], &nan["why"]), (&Value::Null, &Value::from("value is NaN; 30 u")));
}

#[test]
fn junit_counts_suites_cases_and_failures() {
    let results = mixed();
    let document = report::junit(&results).unwrap();
    let total = format!("tests=\"{}\" skipped=\"0\" failures=\"6\"", results.checks.len());
    assert!(document.contains(&total), "{document}");
    assert_eq!(document.matches("<testsuite ").count(), 11);
    assert_eq!(document.matches("<testcase ").count(), results.checks.len());
    assert_eq!(document.matches("<failure ").count(), 6);
    assert!(!document.contains("<script"));
}

#[test]
fn text_names_every_failure_with_its_numbers() {
    let table = report::text(&mixed());
    assert_eq!(table.matches("FAILED ").count(), 6);
    assert!(table.contains("FAILED jacobian: K against central differences [cloth with a wrong K]"));
    assert!(table.contains("row 108 column 144 spring 100: analytic -31.2, numeric 31.2: sign flipped"));
    assert!(table.contains("value NaN, bound 3.30e-15"));
    assert!(table.contains("value 1.000001e-12, bound 1e-12"), "numbers that differ look different: {table}");
    assert!(table.ends_with("46 checks passed, 6 failed\n"), "{table}");
    assert!(!report::text(&passing()).contains("FAIL"));
}

/// What cannot be judged is in every report with its reason, and in no count of what passed or failed.
#[test]
fn what_is_not_judged_is_said() {
    let mut results: Results = [check(0.5, 1.0)].into_iter().collect();
    results.extend([Check::not_judged(Claim::Jacobian, "jacobian", "far away", "coordinates are rounded too much")]);
    assert_eq!((results.passed(), results.failed(), results.not_judged.len()), (1, 0, 1));
    assert!(results.all_passed());
    let document: Value = serde_json::from_str(&report::json(&results).unwrap()).unwrap();
    assert_eq!((&document["passed"], &document["failed"]), (&1.into(), &0.into()));
    let expected = serde_json::json!({"name": "jacobian", "scene": "far away", "claim": "jacobian", "why": "coordinates are rounded too much"});
    assert_eq!(document["not_judged"], serde_json::json!([expected]));
    let text = report::text(&results);
    assert!(text.contains("1 check passed, 0 failed, 1 not judged:\n  jacobian [far away]: coordinates are"), "{text}");
    // A reason that several checks of a scene share is said once.
    let too_far = |name, scene| Check::not_judged(Claim::Solvers, name, scene, "coordinates are rounded too much");
    let mut shared = results.clone();
    shared.extend([too_far("solvers", "far away"), too_far("solvers", "nearer")]);
    let text = report::text(&shared);
    let expected = "3 not judged:\n  jacobian and 1 more [far away]: coordinates are rounded too much\n  solvers [nearer]: coordinates";
    assert!(text.contains(expected), "{text}");
    let suites = report::junit(&results).unwrap();
    assert!(suites.contains("skipped=\"1\"") && suites.contains("coordinates are rounded too much"), "{suites}");
    let page = report::html(&results);
    assert!(page.contains("What was not judged") && page.contains("coordinates are rounded too much"));
    assert!(!report::html(&passing()).contains("What was not judged"));
}

#[test]
fn page_escapes_what_it_shows_and_loads_nothing() {
    let page = report::html(&mixed());
    assert!(!page.contains("<script"), "{HOSTILE} broke out");
    assert!(page.contains("&lt;script&gt;"));
    let addresses = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    for request in ["http:", "https:", "src=", "@import", "url("] {
        assert!(!addresses.contains(request), "{request}");
    }
    for link in page.split("href=\"#").skip(1).filter_map(|rest| rest.split('"').next()) {
        assert!(page.contains(&format!("id=\"{link}\"")), "{link} leads nowhere");
    }
}

#[test]
fn page_tells_the_verdict() {
    assert!(report::html(&passing()).contains("Every check passed"));
    assert!(report::html(&mixed()).contains("6 of 52 checks failed"));
    assert!(report::html(&Results::default()).contains("Nothing was checked"));
    assert!(!Results::default().all_passed());
}

#[test]
fn pictures_survive_every_number() {
    let numbers = [0.0, -1.0, 1.0, f64::MAX, f64::MIN, 5e-324, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    let points: Vec<_> = numbers.iter().flat_map(|&x| numbers.iter().map(move |&y| (x, y))).collect();
    for axis in [Axis::linear, Axis::logarithmic] {
        let mut plot = Plot::new(HOSTILE, axis(HOSTILE), axis("y"))
            .with_series(Series::line(HOSTILE, points.clone()).with_slope(f64::NAN))
            .with_series(Series::failures("failed", points.clone()));
        for &number in &numbers {
            plot = plot
                .with_guide(Guide::Slope { slope: number, through: (1.0, number) })
                .with_guide(Guide::Level { y: number, label: HOSTILE.into() })
                .with_guide(Guide::Vertical { x: number, label: "here".into() });
        }
        assert_whole(&report::plot::svg(&plot));
    }
    assert_whole(&report::plot::svg(&Plot::log_log("", "", "")));

    let (system, mut state) = chain(20);
    for (position, &number) in state.positions.iter_mut().zip(&numbers) {
        position.x = number;
    }
    let arrows = state.positions.clone();
    let mut drawing =
        Drawing::strains(HOSTILE, &system, &state).highlight(12, HOSTILE).highlight(999, "").with_arrows(&arrows);
    drawing.segments[3].ends = [usize::MAX, 0];
    assert_whole(&report::drawing::svg(&drawing));
    drawing.points.clear();
    assert_whole(&report::drawing::svg(&drawing));
}

/// One SVG element, nothing broken out of it, and no coordinate that is not a number.
fn assert_whole(svg: &str) {
    assert!(svg.starts_with("<svg ") && svg.trim_end().ends_with("</svg>"), "{svg}");
    assert!(!svg.contains("<script"));
    for attribute in svg.split('"').skip(1).step_by(2).filter(|value| !value.contains("script")) {
        assert!(!attribute.contains("NaN") && !attribute.contains("inf"), "{attribute}");
    }
    assert!(!svg.contains("could not be drawn"), "{svg}");
}

#[test]
fn points_without_a_place_are_counted_or_railed() {
    let points = vec![(1.0, 1.0), (2.0, 0.0), (3.0, f64::NAN), (4.0, 2.0)];
    let plot = Plot::log_log("", "", "").with_series(Series::line("measured", points));
    assert!(report::plot::svg(&plot).contains("measured (2 points without a place on the axes)"));
    let plot = Plot::log_log("", "", "").with_series(Series::failures("broke down", vec![(1.0, f64::INFINITY)]));
    // Once in the legend, once in its lane.
    assert_eq!(report::plot::svg(&plot).matches(">broke down<").count(), 2);
    let plot = Plot::log_log("", "", "").with_series(Series::failures("broke down", vec![(f64::INFINITY, 1.0)]));
    assert_eq!(report::plot::svg(&plot).matches(">broke down<").count(), 2);
    // In the colour of a method the lane alone names the cause.
    let plot = plot.with_series(Series::line("method", vec![(0.5, 0.5), (1.0, 2.0)]));
    let failures = |x| Series::failures("gave up", vec![x]).like("method");
    let svg = report::plot::svg(&plot.with_series(failures((2.0, 0.0))).with_series(failures((3.0, f64::NAN))));
    assert_eq!(svg.matches(">gave up<").count(), 1);
    assert_eq!(svg.matches("in the colour of its method").count(), 1);
}

#[test]
fn labels_that_are_too_long_are_cut_not_lost() {
    let long = "as long as a label can be ".repeat(9);
    let plot = Plot::log_log(&long, &long, &long)
        .with_series(Series::line(&long, vec![(1.0, 1.0), (9.0, 9.0)]))
        .with_guide(Guide::Level { y: 2.0, label: long.clone() })
        .with_guide(Guide::Vertical { x: 2.0, label: long.clone() });
    assert_eq!(report::plot::svg(&plot).matches("…</text>").count(), 5);
}

#[test]
fn large_scenes_are_thinned_and_say_so() {
    let (system, state) = chain(20_001);
    let svg = report::drawing::svg(&Drawing::strains("", &system, &state).highlight(1, "kept"));
    assert!(svg.contains("one in 3 of 20001 springs drawn") && svg.contains("kept"));
    assert!(svg.len() < 400_000, "{} bytes", svg.len());
}

/// Rows are short: the page of a large suite can be sent and opened.
#[test]
fn thousands_of_checks_make_a_page_below_two_megabytes() {
    let check = |i: usize| {
        let claim = Claim::ALL[i / 22 % Claim::ALL.len()];
        let (name, scene) =
            (format!("residual of a step, solver {}", i / 22), format!("a scene of length {}, full", i % 22));
        // From about 1e-12 of the bound to all of it.
        let value = 3.3e-15 * 10f64.powf(-(i as f64 * 0.618).fract() * 12.0);
        Check::new(claim, name, scene, value, 3.3e-15, "30 u, a rounding for each of the terms of a row")
    };
    let results: Results = (0..6000).map(check).collect();
    let page = report::html(&results);
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
}

#[test]
fn reports_are_written_whole_and_the_same_each_time() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("report");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let names = ["report.html", "report.json", "junit.xml"];
    write_report(&folder, &mixed()).unwrap();
    let first = names.map(read);
    write_report(&folder, &mixed()).unwrap();
    assert_eq!(first, names.map(read));
    let left = std::fs::read_dir(&folder).unwrap().count();
    assert_eq!(left, names.len(), "a temporary file stayed behind");

    let passed = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("report-passed");
    write_report(passed, &passing()).unwrap();
    let error = write_report(folder.join("report.html"), &passing()).unwrap_err();
    assert!(error.to_string().contains("report.html"), "{error}");
}
