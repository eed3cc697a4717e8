//! The page of a motion in a real browser: it draws, plays, and says nothing on the console.

use crate::browser::{Browser, Page};
use crate::sandbox::Sandbox;
use serde_json::Value;

/// A triangle whose corners are free, held and moved; it swings and stretches.
const SCENE: &str = r#"
name = "three kinds"
gravity = [0.0, -9.81, 0.0]
[particles]
positions = [[0, 0, 0], [1, 0, 0], [0.4, -0.8, 0.3]]
masses = [1.0, 2.0, 0.5]
[springs]
pairs = [[0, 1], [1, 2], [2, 0]]
stiffness = 60.0
rest_lengths = [1.1, 0.9, 0.8]
damping = 0.1
[[constraints]]
particles = [0]
[[constraints]]
particles = [1]
velocity = [0.5, 0.0, 0.0]
[time]
dt = 0.02
duration = 1.0
"#;

const SIZES: [[u32; 2]; 2] = [[1400, 900], [390, 844]];

fn page_of_a_run() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.put("scene.toml", SCENE);
    sandbox.sprung(&["run", "scene.toml", "--view", "--out", "out"]).ends_with(0);
    sandbox
}

/// Sums over the pixels of the picture, which differ where the pictures do, and how many differ from the first.
fn picture(page: &mut Page<'_>) -> (Value, u64) {
    page.wait_for("viewer.draws > 0");
    page.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))");
    let read = "(() => { const c = document.getElementById('picture');
        const p = new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer);
        let sum = 0, other = 0;
        for (let i = 0; i < p.length; i++) { sum = (sum * 31 + p[i]) % 4294967291; other += p[i] !== p[0]; }
        return [sum, other]; })()";
    let read = page.value(read);
    (read[0].clone(), read[1].as_u64().unwrap())
}

#[test]
fn the_page_draws_plays_and_moves_with_the_slider() {
    let Some(mut browser) = Browser::start() else { return };
    let sandbox = page_of_a_run();
    for size in SIZES {
        for dark in [false, true] {
            let mut page = browser.open(&sandbox.path("out/view.html"), size, dark);
            page.wait_for("globalThis.viewer");
            let (first, drawn) = picture(&mut page);
            assert!(drawn > 200, "{drawn} pixels");

            page.value("(() => { const s = document.getElementById('slider'); s.value = 40; s.dispatchEvent(new Event('input')); })()");
            let (later, _) = picture(&mut page);
            assert_ne!(first, later);
            assert_eq!(page.value("document.getElementById('time').textContent"), "t = 0.8 s");
            assert_eq!(page.value("document.getElementById('count').textContent"), "frame 41 of 51");
            assert_ne!(page.value("document.querySelector('.track .now').getAttribute('x1')"), "0");

            let beside = "[...document.querySelectorAll('.plot')].every((plot) => [...plot.querySelectorAll('span')].every((label) => label.scrollWidth <=
                label.clientWidth && label.getBoundingClientRect().right <= plot.querySelector('svg').getBoundingClientRect().left))";
            assert_eq!(page.value(beside), true, "a number lies over a curve");

            page.key("ArrowLeft");
            page.wait_for("viewer.frame === 39");
            page.key("Home");
            page.wait_for("viewer.frame === 0");
            assert_eq!(picture(&mut page).0, first);
            page.value("document.getElementById('play').click()");
            page.wait_for("viewer.frame > 5");
            page.value("document.getElementById('play').click()");
            assert_eq!(page.value("viewer.playing"), false);

            assert_eq!(
                page.value("document.documentElement.scrollWidth - document.documentElement.clientWidth"),
                0,
                "{size:?}"
            );
            assert_eq!(page.complaints(), [""; 0]);
        }
    }
}

/// A canvas of another size is drawn on before it is shown.
#[test]
fn the_picture_is_never_blank() {
    let Some(mut browser) = Browser::start() else { return };
    let sandbox = page_of_a_run();
    let mut page = browser.open(&sandbox.path("out/view.html"), SIZES[0], false);
    page.wait_for("globalThis.viewer");
    picture(&mut page);
    // This observer is called after the page's own, when all callbacks before the frame have run.
    let resized = "new Promise((done) => {
        const c = document.getElementById('picture'), { height } = c;
        new ResizeObserver(() => {
            if (c.height !== height) done(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some((v) => v > 0));
        }).observe(c);
        c.style.height = '300px';
    })";
    assert_eq!(page.value(resized), true);
    assert_eq!(page.complaints(), [""; 0]);
}

/// Pointing at the picture names what is there, and its numbers are those of the run.
#[test]
fn what_is_pointed_at_is_named_with_its_numbers() {
    let Some(mut browser) = Browser::start() else { return };
    let sandbox = page_of_a_run();
    let mut page = browser.open(&sandbox.path("out/view.html"), SIZES[0], false);
    page.wait_for("globalThis.viewer");
    page.key("End");
    page.wait_for("viewer.frame === 50");
    let name_at = |page: &mut Page<'_>, place: &str| {
        let place = page.value(place);
        page.hover([0, 1].map(|k| place[k].as_f64().unwrap()));
        page.wait_for("!document.getElementById('name').hidden");
        let lines = page.value("[...document.querySelectorAll('#name span')].map((line) => line.textContent)");
        let lines: Vec<String> = serde_json::from_value(lines).unwrap();
        page.hover([1.0, 1.0]);
        page.wait_for("document.getElementById('name').hidden");
        lines
    };
    let held = name_at(&mut page, "viewer.where(0)");
    assert_eq!((held[0].as_str(), held[2].as_str()), ("particle 0, held", "0 m from where it started"));
    let moved = name_at(&mut page, "viewer.where(1)");
    assert_eq!((moved[0].as_str(), moved[2].as_str()), ("particle 1, moved", "0.5 m from where it started"));
    assert_eq!(name_at(&mut page, "viewer.where(2)")[0], "particle 2");
    let spring = name_at(&mut page, "[0, 1].map((k) => (viewer.where(1)[k] + viewer.where(2)[k]) / 2)");
    assert_eq!(spring[0], "spring 1, from 1 to 2");
    assert!(spring[2].ends_with("at rest 0.9 m"), "{spring:?}");

    let state = sandbox.json("out/final.json");
    let position = |p: usize| [0, 1, 2].map(|axis| state["positions"][p][axis].as_f64().unwrap());
    let [a, b] = [position(1), position(2)];
    let length = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let strain = spring[1].split("strain ").nth(1).unwrap().trim_end_matches(" %").replace('−', "-");
    let strain: f64 = strain.parse().unwrap();
    // Three digits are shown, of a strain kept to 15 bits.
    let expected = 100.0 * (length / 0.9 - 1.0);
    assert!((strain - expected).abs() < 0.006 * expected.abs(), "{strain} is not {expected}");
    assert_eq!(page.complaints(), [""; 0]);
}

/// A scene at rest has nothing to play, but can be looked at.
#[test]
fn a_scene_at_rest_is_drawn() {
    let Some(mut browser) = Browser::start() else { return };
    let sandbox = Sandbox::new();
    sandbox.put("scene.toml", SCENE);
    sandbox.sprung(&["view", "scene.toml", "-o", "still.html"]).ends_with(0);
    let mut page = browser.open(&sandbox.path("still.html"), SIZES[1], false);
    page.wait_for("globalThis.viewer");
    assert!(picture(&mut page).1 > 200);
    assert_eq!(page.value("document.getElementById('play').offsetParent === null"), true);
    assert_eq!(page.complaints(), [""; 0]);
}

/// The page of modes: the one chosen swings about the state, as far as the slider says.
#[test]
fn modes_are_chosen_and_swing() {
    let Some(mut browser) = Browser::start() else { return };
    let sandbox = Sandbox::new();
    sandbox.put("scene.toml", SCENE);
    sandbox.sprung(&["modes", "scene.toml", "-n", "3", "--out", "out"]).ends_with(0);
    for size in SIZES {
        for dark in [false, true] {
            let mut page = browser.open(&sandbox.path("out/modes.html"), size, dark);
            page.wait_for("globalThis.viewer");
            let chosen = page.value("document.getElementById('time').textContent");
            assert_eq!(chosen, "mode 1");
            // Those who want less motion see the end of the swing until they play it.
            assert_eq!(page.value("viewer.playing"), false);
            let (end, drawn) = picture(&mut page);
            assert!(drawn > 200, "{drawn} pixels");
            let amplitude = page.value("document.getElementById('size').textContent");
            assert_eq!(amplitude, "0.1 m", "a tenth of the extent");
            let place = |page: &mut Page<'_>| {
                picture(page);
                let at = page.value("viewer.where(2)");
                [0, 1].map(|k| at[k].as_f64().unwrap())
            };
            let at_end = place(&mut page);
            page.value("viewer.turn(0)");
            let in_state = place(&mut page);
            page.value("viewer.turn(-Math.PI / 2)");
            let other_end = place(&mut page);
            for k in 0..2 {
                let middle = (at_end[k] + other_end[k]) / 2.0;
                assert!((middle - in_state[k]).abs() < 0.1, "{at_end:?} {in_state:?} {other_end:?}");
            }
            // Twice as far.
            page.value("viewer.turn(Math.PI / 2)");
            page.value("(() => { const s = document.getElementById('slider'); s.value = 20; s.dispatchEvent(new Event('input')); })()");
            let far = place(&mut page);
            for k in 0..2 {
                assert!((far[k] - in_state[k] - 2.0 * (at_end[k] - in_state[k])).abs() < 0.1);
            }
            page.value("document.querySelectorAll('#motions input')[1].click()");
            assert_eq!(page.value("viewer.motion"), 2);
            assert_eq!(page.value("document.getElementById('time').textContent"), "mode 2");
            assert_ne!(picture(&mut page).0, end);
            page.key("n");
            page.wait_for("viewer.motion === 3");
            page.key("n");
            page.wait_for("viewer.motion === 1");
            let before = page.value("viewer.angle").as_f64().unwrap();
            page.value("document.getElementById('play').click()");
            page.wait_for(&format!("viewer.angle > {before} + 0.5"));
            page.value("document.getElementById('play').click()");
            assert_eq!(page.value("viewer.playing"), false);
            assert_eq!(
                page.value("document.documentElement.scrollWidth - document.documentElement.clientWidth"),
                0,
                "{size:?}"
            );
            assert_eq!(page.complaints(), [""; 0]);
        }
    }
}
