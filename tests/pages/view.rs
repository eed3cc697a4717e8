//! What the page of a motion carries: how exact it is, how large, and what it leaves out.

use crate::sandbox::Sandbox;
use base64::Engine;
use nalgebra::Vector3;
use serde_json::Value;
use sprung::figure::{Animation, SceneTopology};
use sprung::output::playback;
use sprung::report::view::{html, within};
use sprung::scene::builtin;
use sprung::{Scene, State, System};
use std::io::Read;

/// A cloth that waves along a formula: positions without a short binary form, strains of both signs.
fn waving(size: usize) -> (System, impl Fn(usize) -> Vec<Vector3<f64>>) {
    let (system, state) = builtin::cloth(size).unwrap().build().unwrap();
    let at = move |frame: usize| {
        let wave = |x: &Vector3<f64>| x + Vector3::new(0.0, 0.1 * (7.0 * x.x + 0.3 * frame as f64).sin(), 0.002 * x.x);
        state.positions.iter().map(wave).collect()
    };
    (system, at)
}

fn film(size: usize, frames: usize) -> (System, Animation) {
    let (system, at) = waving(size);
    let mut animation = Animation::new("waving", SceneTopology::of(&system, &[]));
    (0..frames).for_each(|frame| animation.push(0.1 * frame as f64, &at(frame)));
    (system, animation)
}

/// The facts and the bytes of a page.
fn carried(page: &str) -> (Value, Vec<u8>) {
    let element = |id: &str| page.split(&format!("id=\"{id}\">")).nth(1).unwrap().split("</script>").next().unwrap();
    let packed = base64::engine::general_purpose::STANDARD.decode(element("data")).unwrap();
    let mut bytes = Vec::new();
    flate2::read::DeflateDecoder::new(packed.as_slice()).read_to_end(&mut bytes).unwrap();
    (serde_json::from_str(element("about")).unwrap(), bytes)
}

/// A channel's values, frame after frame, as `decode.js` restores them.
fn channel(bytes: &[u8], channel: &Value, frames: usize, count: usize) -> Vec<i64> {
    let [offset, order] = ["offset", "order"].map(|key| channel[key].as_u64().unwrap() as usize);
    let wide = channel["wide"].as_bool().unwrap();
    let mut values = vec![0i64; frames * count];
    for i in 0..values.len() {
        let high = if wide { i64::from(bytes[offset + values.len() + i]) } else { 0 };
        let folded = i64::from(bytes[offset + i]) | high << 8;
        let guess = match (i / count).min(order) {
            0 => 0,
            1 => values[i - count],
            _ => 2 * values[i - count] - values[i - 2 * count],
        };
        values[i] = guess + (folded >> 1 ^ -(folded & 1));
    }
    values
}

#[test]
fn positions_and_strains_are_as_exact_as_the_page_says() {
    let (system, animation) = film(9, 12);
    let (_, at) = waving(9);
    let page = html(&animation).unwrap();
    let (about, bytes) = carried(&page);
    let [n, springs] = [system.particles(), system.springs().len()];
    assert_eq!((&about["particles"], &about["springs"], &about["frames"]), (&n.into(), &springs.into(), &12.into()));
    let quantum = about["quantum"].as_f64().unwrap();
    for axis in 0..3 {
        let low = about["origin"][axis].as_f64().unwrap();
        let quanta = channel(&bytes, &about["channels"]["places"][axis], 12, n);
        for (i, q) in quanta.iter().enumerate() {
            let kept = low + quantum * (*q as u16) as f64;
            let error = (kept - at(i / n)[i % n][axis]).abs();
            assert!(error <= 0.5 * quantum * (1.0 + 1e-9), "{error} > {quantum}/2");
        }
    }
    let scale = &about["strain"];
    let [levels, largest] = ["levels", "largest"].map(|key| scale[key].as_f64().unwrap());
    let bound = largest * (1.0 / levels + 0.25 / (levels * levels));
    assert!(bound < 1e-3 * largest);
    let kept = channel(&bytes, &about["channels"]["strain"], 12, springs);
    let mut largest_error: f64 = 0.0;
    for (i, q) in kept.iter().enumerate() {
        let part = f64::from(*q as i16) / levels;
        let [a, b] = system.pair(i % springs).map(|p| at(i / springs)[p]);
        let strain = (a - b).norm() / system.springs()[i % springs].rest_length - 1.0;
        largest_error = largest_error.max((largest * part * part.abs() - strain).abs());
    }
    // Strains pass through single precision on their way.
    assert!(largest_error <= bound + 1e-7, "{largest_error} > {bound}");
    assert!(page.contains(&format!("{:.1e}", quantum / 2.0)) && page.contains(&format!("{bound:.1e}")));
}

/// The promise of 40 MB, at a small limit: frames are left out evenly, and the page says so.
#[test]
fn a_page_that_would_be_too_large_leaves_out_frames() {
    let (_, animation) = film(12, 40);
    let whole = html(&animation).unwrap();
    assert!(!whole.contains("Thinned"));
    let limit = carried_length(&whole) / 2;
    let page = within(&animation, limit).unwrap();
    assert!(carried_length(&page) <= limit);
    let (about, _) = carried(&page);
    let frames = about["frames"].as_u64().unwrap();
    assert!((8..=20).contains(&frames), "{frames}");
    assert!(page.contains(&format!("Thinned: {frames} of 40 frames are shown")));
    let times: Vec<f64> = serde_json::from_value(about["times"].clone()).unwrap();
    let first = times[1] - times[0];
    assert!(times.windows(2).all(|pair| (pair[1] - pair[0] - first).abs() < 1e-12));
}

fn carried_length(page: &str) -> usize {
    page.split("id=\"data\">").nth(1).unwrap().split("</script>").next().unwrap().len()
}

/// Particles stand for their neighbourhoods: few enough, the held ones among them, where they are in the scene; lines join neighbours,
/// and a strain is the mean of those that a line stands for.
#[test]
fn large_scenes_are_thinned() {
    let (system, at) = waving(40);
    let whole = SceneTopology::of(&system, &[[0, 1, 40], [0, 39, 1599]]);
    let mut animation = Animation::with_limits("large", whole, 200, 600);
    animation.push(0.0, &at(3));
    let topology = animation.cast();
    assert!((40..=200).contains(&topology.bindings.len()), "{}", topology.bindings.len());
    assert!(topology.pairs.len() <= 600 && topology.pairs.len() >= topology.bindings.len(), "{}", topology.pairs.len());
    let founders = &animation.decimation().unwrap().founders;
    for (founder, position) in founders.iter().zip(&animation.positions) {
        assert_eq!(*position, at(3)[*founder as usize]);
    }
    for held in [0, 39] {
        let shown = founders.iter().position(|&p| p == held).unwrap();
        assert_eq!(topology.bindings[shown], sprung::figure::Binding::Held);
    }
    // A stretch by the same factor everywhere is the strain of every line.
    let rest: Vec<Vector3<f64>> = waving(40).0.prescribed().iter().map(|_| Vector3::zeros()).collect();
    assert_eq!(rest.len(), 6);
    let (_, state) = builtin::cloth(40).unwrap().build().unwrap();
    let stretched: Vec<Vector3<f64>> = state.positions.iter().map(|x| 1.25 * x).collect();
    let mut even = Animation::with_limits("even", SceneTopology::of(&system, &[]), 200, 600);
    even.push(0.0, &stretched);
    assert!(even.strains.iter().all(|strain| (strain - 0.25).abs() < 1e-6));
    let page = html(&animation).unwrap();
    let said = format!("{} of 1600 particles are shown", topology.bindings.len());
    assert!(page.contains(&said), "{said}");
}

#[test]
fn particles_without_springs_are_thinned_too() {
    let mut builder = sprung::SystemBuilder::new();
    for p in 0..1000 {
        builder.particle([f64::from(p), 0.0, 0.0], 1.0);
    }
    let (system, state) = builder.build().unwrap();
    let mut animation = Animation::with_limits("dust", SceneTopology::of(&system, &[]), 100, 100);
    animation.push(0.0, &state.positions);
    assert!((50..=100).contains(&animation.positions.len()), "{}", animation.positions.len());
}

/// `run --frames` leaves what `view` needs: the same positions to the bit, and the energies beside them.
#[test]
fn a_run_is_played_back_from_its_folder() {
    let sandbox = Sandbox::new();
    let scene = builtin::cloth(5).unwrap();
    sandbox.put("scene.toml", &scene.to_toml());
    let run = ["run", "scene.toml", "--dt", "0.01", "--steps", "20", "--frames", "5", "--out", "out"];
    sandbox.sprung(&run).ends_with(0);
    let animation = playback(&sandbox.path("out")).unwrap();
    assert_eq!(animation.title, "cloth");
    assert_eq!(animation.times.len(), 5);
    let last = sandbox.json("out/final.json");
    for (p, position) in animation.positions[100..].iter().enumerate() {
        assert_eq!(serde_json::json!([position.x, position.y, position.z]), last["positions"][p]);
    }
    // The zero of gravitational energy means nothing: its lowest is the picture's.
    let energy = &animation.tracks[0];
    assert_eq!((energy.unit.as_str(), energy.times.len()), ("J", 21));
    assert!(energy.title.contains("gravitational from its lowest"), "{}", energy.title);
    let rows = sandbox.csv("out/energy.csv");
    let lowest = rows.iter().map(|row| row[3]).fold(f64::INFINITY, f64::min);
    assert!(lowest < 0.0);
    for (name, column) in [("kinetic", 1), ("gravitational", 3), ("total", 4)] {
        let (_, values) = energy.curves.iter().find(|(curve, _)| curve == name).unwrap();
        let counted_from = if column == 1 { 0.0 } else { lowest };
        assert!(rows.iter().zip(values).all(|(row, &value)| value == row[column] - counted_from), "{name}");
    }

    sandbox.sprung(&["view", "out"]).ends_with(0);
    assert!(sandbox.read("out/view.html").contains("25 particles"));
}

#[test]
fn a_folder_without_a_motion_says_how_to_keep_one() {
    let sandbox = Sandbox::new();
    sandbox.put("out/summary.json", "{}");
    sandbox.sprung(&["view", "out"]).ends_with(2).complains(&["out: no trajectory.npz", "--view or --frames N"]);
    sandbox.put("out/trajectory.npz", "PK but no zip");
    sandbox.sprung(&["view", "out"]).ends_with(2).complains(&["trajectory.npz"]);
    sandbox.sprung(&["view", "none.toml"]).ends_with(2).complains(&["none.toml"]);
}

/// Names end up in the page as text, not as markup.
#[test]
fn names_are_text() {
    let scene = Scene { name: "</script><b>&".into(), ..builtin::chain(2).unwrap() };
    let (system, state): (System, State) = scene.build().unwrap();
    let mut animation = Animation::still(&scene.name, SceneTopology::of(&system, &[]), &state);
    animation.tracks.push(sprung::figure::Track {
        title: "</script>".into(),
        unit: String::new(),
        times: vec![0.0, 1.0],
        curves: vec![("x".into(), vec![f64::NAN, 1.0])],
    });
    let page = html(&animation).unwrap();
    assert_eq!(page.matches("</script>").count(), 3, "three scripts end");
    assert!(page.contains("&lt;/script&gt;&lt;b&gt;&amp;"));
}

/// How far particles come, how springs are strained, and how a run was made: a run that chose its steps has no dt.
#[test]
fn pages_say_what_they_show() {
    let (_, animation) = film(6, 8);
    let page = html(&animation).unwrap().replace('\u{a0}', " ");
    let told = page.split("<p class=\"told\">").nth(1).unwrap().split("</p>").next().unwrap();
    let [least, most] = animation.strain_range().unwrap();
    let way = animation.farthest();
    assert!(least < 0.0 && most > 0.0 && way > 0.01);
    let number = |text: &str| text.replace('−', "-").replace('+', "").parse::<f64>().unwrap();
    let after = |words: &str| number(told.split(words).nth(1).unwrap().split(' ').next().unwrap());
    // Three digits are said.
    let said = [
        (after("Within "), 0.7),
        (after("come up to "), way),
        (after("strained from "), 100.0 * least),
        (after(" % to "), 100.0 * most),
    ];
    for (said, true_one) in said {
        assert!((said / true_one - 1.0).abs() < 6e-3, "{told}");
    }
    let still =
        Animation::still("still", SceneTopology::of(&waving(3).0, &[]), &builtin::cloth(3).unwrap().build().unwrap().1);
    assert!(html(&still).unwrap().contains("No spring is strained."));

    let sandbox = Sandbox::new();
    sandbox.put("scene.toml", &builtin::chain(3).unwrap().to_toml());
    sandbox
        .sprung(&["run", "scene.toml", "--view", "--rtol", "1e-2", "--duration", "0.2", "--out", "chosen"])
        .ends_with(0);
    sandbox.sprung(&["run", "scene.toml", "--view", "--dt", "0.01", "--steps", "5", "--out", "given"]).ends_with(0);
    let [chosen, given] = ["chosen", "given"].map(|folder| sandbox.read(&format!("{folder}/view.html")));
    assert!(chosen.contains("steps by rtol 0.01") && !chosen.contains("dt ="));
    assert!(given.contains("dt = 0.01 s") && !given.contains("rtol"));
}
