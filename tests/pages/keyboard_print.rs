//! The pages without a mouse, and on paper.
//!
//! By Tab one reaches everything that can be acted on, and sees where one is; Enter unfolds what is folded. On paper pages are dark on
//! white whatever the screen is, what is folded is shown, nothing is wider than the sheet, and controls are gone.

use crate::browser::{Browser, Page};
use crate::sandbox::{Sandbox, repository_scene};
use serde_json::Value;
use std::path::PathBuf;

/// Width of A4 without its margins, in pixels of CSS.
const SHEET: u32 = 680;

fn pages(folder: &Sandbox) -> [(&'static str, PathBuf); 4] {
    let make = |arguments: &[&str]| drop(folder.sprung(arguments).ends_with(0));
    folder.put("cloth.toml", &folder.sprung(&["new", "cloth", "--size", "5"]).stdout);
    make(&["inspect", "cloth.toml", "--dt", "0.05", "--steps", "2", "--out", "inspect"]);
    make(&["chart", &repository_scene("two_springs.toml"), "--budget", "2", "--out", "chart"]);
    make(&["run", "cloth.toml", "--dt", "0.01", "--steps", "20", "--view", "--out", "run"]);
    folder.put("report.html", &sprung::report::html(&crate::sample::mixed()));
    let places = [
        ("inspect", "inspect/inspect.html"),
        ("chart", "chart/chart.html"),
        ("report", "report.html"),
        ("view", "run/view.html"),
    ];
    places.map(|(name, place)| (name, folder.path(place)))
}

/// What has the focus: its name, and whether one sees that it has.
const FOCUSED: &str = r"(() => {
    const at = document.activeElement;
    if (!at || at === document.body) return null;
    const style = getComputedStyle(at);
    const ring = style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 1;
    // A ring inside an element of its own colour is none.
    const hidden = parseFloat(style.outlineOffset) < 0 && style.outlineColor === style.backgroundColor;
    const box = at.getBoundingClientRect();
    const where = [...document.querySelectorAll('*')].indexOf(at);
    return { where, name: `${at.localName} ${at.id || at.textContent.trim().slice(0, 30)}`, seen: ring && !hidden && box.width > 0 && box.height > 0 };
})()";

/// What could be acted on, and is shown.
const REACHABLE: &str = r"[...document.querySelectorAll('a[href], button, select, input, summary, [tabindex]')]
    .filter((e) => e.tabIndex >= 0 && e.checkVisibility({ visibilityProperty: true, contentVisibilityAuto: true }))
    .map((e) => [...document.querySelectorAll('*')].indexOf(e))";

fn stops(page: &mut Page<'_>, most: usize) -> Vec<Value> {
    let mut stops: Vec<Value> = Vec::new();
    for _ in 0..most {
        page.press("Tab", 9);
        let at = page.value(FOCUSED);
        if at.is_null() || stops.iter().any(|stop| stop["where"] == at["where"]) {
            break;
        }
        stops.push(at);
    }
    stops
}

#[test]
fn everything_is_reached_by_the_keyboard_and_one_sees_where_one_is() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = Sandbox::new();
    for (name, file) in pages(&folder) {
        for dark in [false, true] {
            let mut page = browser.open(&file, [1000, 800], dark);
            page.wait_for(
                "document.readyState === 'complete' && (!document.getElementById('picture') || globalThis.viewer)",
            );
            let reachable = page.value(REACHABLE);
            let reachable = reachable.as_array().unwrap();
            let stops = stops(&mut page, reachable.len() + 5);
            let missed: Vec<_> =
                reachable.iter().filter(|place| stops.iter().all(|stop| stop["where"] != **place)).collect();
            assert!(missed.is_empty() && !stops.is_empty(), "{name}: {} stops, {} missed", stops.len(), missed.len());
            let unseen: Vec<_> = stops.iter().filter(|stop| stop["seen"] != true).map(|stop| &stop["name"]).collect();
            assert!(unseen.is_empty(), "{name}, dark {dark}: no ring around {unseen:?}");
            assert_eq!(page.complaints(), [""; 0]);
        }
    }
}

#[test]
fn what_is_folded_opens_by_the_keyboard() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = Sandbox::new();
    for (name, file) in pages(&folder) {
        let mut page = browser.open(&file, [1000, 800], false);
        page.wait_for(
            "document.readyState === 'complete' && (!document.getElementById('picture') || globalThis.viewer)",
        );
        if page.value("document.querySelector('summary') === null") == true {
            continue;
        }
        page.value("document.querySelector('summary').focus()");
        for (key, code, open) in [("Enter", 13, true), (" ", 32, false)] {
            page.press(key, code);
            assert_eq!(page.value("document.querySelector('summary').parentElement.open"), open, "{name}: {key:?}");
        }
    }
}

#[test]
fn the_player_is_played_by_the_keyboard() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = Sandbox::new();
    let [.., (_, file)] = pages(&folder);
    let mut page = browser.open(&file, [1000, 800], false);
    page.wait_for("globalThis.viewer");
    // On the picture the space bar plays, and so it does on the button; arrows step and turn.
    for place in ["picture", "play"] {
        page.value(&format!("document.getElementById('{place}').focus()"));
        assert_eq!(page.value("viewer.playing"), false);
        page.press(" ", 32);
        page.wait_for("viewer.playing");
        page.press(" ", 32);
        page.wait_for("!viewer.playing");
    }
    page.value("document.getElementById('picture').focus()");
    page.key("Home");
    page.key("ArrowRight");
    page.wait_for("viewer.frame === 1");
    let before = page.value("viewer.where(3)");
    page.key("ArrowUp");
    page.wait_for("viewer.draws > 1");
    assert_ne!(page.value("viewer.where(3)"), before);
    assert_eq!(page.complaints(), [""; 0]);
}

#[test]
fn on_paper_pages_are_whole_and_dark_on_white() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = Sandbox::new();
    for (name, file) in pages(&folder) {
        let mut page = browser.open(&file, [SHEET, 960], true);
        page.wait_for(
            "document.readyState === 'complete' && (!document.getElementById('picture') || globalThis.viewer)",
        );
        let dark = serde_json::json!([{ "name": "prefers-color-scheme", "value": "dark" }]);
        page.call("Emulation.setEmulatedMedia", serde_json::json!({ "media": "print", "features": dark }));
        let [paper, ink] =
            ["backgroundColor", "color"].map(|what| page.value(&format!("getComputedStyle(document.body).{what}")));
        assert!(["rgb(255, 255, 255)", "rgba(0, 0, 0, 0)"].contains(&paper.as_str().unwrap()), "{name}: paper {paper}");
        assert!(["rgb(0, 0, 0)", "rgb(27, 31, 36)"].contains(&ink.as_str().unwrap()), "{name}: ink {ink}");
        assert!(
            page.value("document.documentElement.scrollWidth").as_u64().unwrap() <= u64::from(SHEET),
            "{name} is wider than the sheet"
        );
        let shown = "{ visibilityProperty: true, contentVisibilityAuto: true }";
        let hidden = page.value(&format!("[...document.querySelectorAll('details.values td')].filter((cell) => !cell.checkVisibility({shown})).length"));
        assert_eq!(hidden, 0, "{name}: folded away on paper");
        let controls = page.value(&format!(
            "[...document.querySelectorAll('button, select, input')].filter((e) => e.checkVisibility({shown})).length"
        ));
        assert_eq!(controls, 0, "{name}: controls on paper");
        let printed = page.call("Page.printToPDF", serde_json::json!({ "paperWidth": 8.27, "paperHeight": 11.7 }));
        assert!(printed["data"].as_str().unwrap().len() > 10_000, "{name}");
        assert_eq!(page.complaints(), [""; 0]);
    }
}

/// What a dark screen shows is drawn anew for paper, and again for the screen.
#[test]
fn the_picture_of_a_motion_prints_on_white() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = Sandbox::new();
    let [.., (_, file)] = pages(&folder);
    let mut page = browser.open(&file, [1000, 800], true);
    page.wait_for("globalThis.viewer && viewer.draws > 0");
    let corner = "(() => { const c = document.getElementById('picture'); return c.getContext('2d').getImageData(2, 2, 1, 1).data[0]; })()";
    for (event, light) in [(None, false), (Some("beforeprint"), true), (Some("afterprint"), false)] {
        if let Some(event) = event {
            page.value(&format!("dispatchEvent(new Event('{event}')) && null"));
        }
        assert_eq!(page.value(corner).as_u64().unwrap() > 200, light, "{event:?}");
    }
}
