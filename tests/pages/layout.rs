//! The pages in a real browser: every page at the width of a desk and of a phone, light and dark. Nothing on the console, nothing
//! wider than the page, every picture with a text, contrast AA (WCAG 2.1: 4.5, large text 3), and filters that filter.
//!
//! Needs Chromium on the path (`chromium`, `chromium-browser`, `google-chrome`, or what the variable CHROMIUM names); without one
//! it says so and checks nothing.

use crate::sandbox::{Sandbox, repository_scene};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

const WIDTHS: [u32; 2] = [1400, 390];

/// Looks into the frames of a page and writes what is wrong as JSON.
const PROBE: &str = include_str!("probe.js");

fn browser() -> Option<String> {
    let named = std::env::var("CHROMIUM").ok();
    let usual = ["chromium", "chromium-browser", "google-chrome"].map(str::to_owned);
    named.into_iter().chain(usual).find(|name| {
        let version = Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        version.is_ok_and(|status| status.success())
    })
}

/// The page in frames of all widths, and what the probe and the console say of it.
fn look(browser: &str, folder: &Path, page: &str, dark: bool) -> (Value, Vec<String>) {
    let escaped = page.replace('&', "&amp;").replace('"', "&quot;");
    let frame = |width: &u32| {
        format!("<iframe width=\"{width}\" height=\"900\" style=\"border:0\" srcdoc=\"{escaped}\"></iframe>")
    };
    let frames: String = WIDTHS.iter().map(frame).collect();
    let wrapper = format!(
        "<!DOCTYPE html><html><head><meta charset=\"utf-8\"><link rel=\"icon\" href=\"data:,\"></head><body>{frames}\
         <pre id=\"found\"></pre><script>{PROBE}</script></body></html>"
    );
    let file = folder.join("wrapper.html");
    std::fs::write(&file, wrapper).unwrap();
    let profile = tempfile::tempdir().unwrap();
    let scheme = if dark { 0 } else { 1 };
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--enable-logging=stderr", "--v=0"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--blink-settings=preferredColorScheme={scheme}"))
        .args(["--window-size=1500,1000", "--dump-dom"])
        .arg(format!("file://{}", file.display()))
        .output()
        .unwrap();
    let (dom, log) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let found = dom.split("<pre id=\"found\">").nth(1).and_then(|rest| rest.split("</pre>").next()).unwrap_or_default();
    let found = found.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    let found =
        serde_json::from_str(&found).unwrap_or_else(|error| panic!("the probe found {found:?}: {error}\n{log}"));
    (found, log.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect())
}

#[test]
fn every_page_is_whole_at_every_width_light_and_dark() {
    let Some(browser) = browser() else {
        eprintln!("the pages were not looked at: no Chromium here");
        return;
    };
    let folder = Sandbox::new();
    let make = |arguments: &[&str]| drop(folder.sprung(arguments).ends_with(0));
    folder.put("cloth.toml", &folder.sprung(&["new", "cloth", "--size", "6"]).stdout);
    folder.put("column.toml", &folder.sprung(&["new", "column", "--size", "5"]).stdout);
    make(&["inspect", "cloth.toml", "--dt", "0.05", "--steps", "2", "--out", "cloth"]);
    make(&["inspect", "column.toml", "--dt", "0.02", "--out", "column"]);
    make(&["inspect", &repository_scene("planar_truss.toml"), "--out", "truss"]);
    make(&["chart", &repository_scene("two_springs.toml"), "--budget", "2", "--out", "chart"]);
    make(&["run", "cloth.toml", "--dt", "0.01", "--steps", "20", "--view", "--out", "run"]);
    let frame = "particles = { positions = [[0, 0], [1, 0], [1, 1], [0, 1]], masses = 1 }
        springs = { pairs = [[0, 1], [1, 2], [2, 3], [3, 0]], stiffness = 4 }";
    folder.put("frame.toml", frame);
    make(&["modes", "cloth.toml", "-n", "12", "--out", "modes"]);
    make(&["mechanisms", "frame.toml", "--out", "frame"]);
    make(&["equilibrium", "cloth.toml", "--load-path", "5", "--out", "equilibrium"]);
    let report = sprung::report::html(&crate::sample::mixed());
    let pages = [
        ("inspect.html of a cloth", folder.read("cloth/inspect.html")),
        ("inspect.html of a column", folder.read("column/inspect.html")),
        ("inspect.html of a truss", folder.read("truss/inspect.html")),
        ("chart.html", folder.read("chart/chart.html")),
        ("report.html", report),
        ("view.html", folder.read("run/view.html")),
        ("equilibrium.html of a load path", folder.read("equilibrium/equilibrium.html")),
        ("modes.html", folder.read("modes/modes.html")),
        ("mechanisms.html", folder.read("frame/mechanisms.html")),
    ];
    let mut wrong = Vec::new();
    for (name, page) in &pages {
        for dark in [false, true] {
            let (found, console) = look(&browser, &folder.path("."), page, dark);
            let scheme = if dark { "dark" } else { "light" };
            wrong.extend(console.iter().map(|line| format!("{name}, {scheme}: console: {line}")));
            let problems = found["problems"].as_array().expect("a list of problems");
            wrong.extend(problems.iter().map(|problem| format!("{name}, {scheme}: {problem}")));
            assert_eq!(found["dark"], dark, "the browser does not show pages {scheme}");
            assert_eq!(found["frames"], WIDTHS.len());
            assert!(found["pictures"].as_u64() > Some(0) && found["texts"].as_u64() > Some(20), "{name}: {found}");
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The check is worth what it catches.
#[test]
fn the_check_sees_what_is_wrong() {
    let Some(browser) = browser() else { return };
    let folder = Sandbox::new();
    let page = "<!DOCTYPE html><html><body><p style=\"width:1600px\">wide</p><p style=\"color:#999;background:#fff\">faint</p>\
        <svg role=\"img\"><path d=\"M0 0\"/></svg><img src=\"data:,\"><script>console.log('said')</script></body></html>";
    let (found, console) = look(&browser, &folder.path("."), page, false);
    let problems = found["problems"].to_string();
    for part in [
        "1400 px: wider than the page",
        "390 px: wider than the page",
        "contrast",
        "picture without a text",
        "image without alt",
    ] {
        assert!(problems.contains(part), "{part} is not in {problems}");
    }
    assert_eq!(console.len(), WIDTHS.len(), "{console:?}");
}
