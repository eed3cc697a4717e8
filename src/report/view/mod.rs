//! `view.html`: a motion that plays in any browser, from one file that loads nothing. The page draws by itself: springs coloured by strain, the triangles
//! of a mesh as a shaded surface, particles that are held or moved marked.

mod encode;
mod motions;

pub use motions::{Motion, Motions};

use super::number::{count, pretty, typeset};
use super::page::{self, footer};
use crate::figure::{Animation, Binding};
use encode::{Encoded, encode};
use maud::{Markup, PreEscaped, html};
use std::io;

/// The page of an animation. Frames are left out, evenly, where the page would be larger than 40 MB, which mail and phones refuse; the page says so.
pub fn html(animation: &Animation) -> io::Result<String> {
    within(animation, 38_000_000)
}

/// As [`html()`], with at most so many bytes of data.
pub fn within(animation: &Animation, limit: usize) -> io::Result<String> {
    let encoded = &encode(animation, limit);
    let header = html! {
        p.lead { (lead(animation)) }
        p.told { (typeset(&summary(animation))) }
        @for note in &notes(animation, encoded) { p.note { (note) } }
    };
    let body = html! {
        main {
            (stage(animation, encoded))
            @if encoded.about.frames > 1 { (transport()) }
            @else { div hidden { (transport()) } }
            (switches(animation))
            div id="tracks" {}
            (help(encoded, &time_keys()))
        }
    };
    document(&animation.title, &header, &body, encoded, CONTROLS)
}

/// The program, in the order in which its parts use each other; the last one is that of the page.
const SCRIPTS: [&str; 8] = [
    include_str!("decode.js"),
    include_str!("camera.js"),
    include_str!("raster.js"),
    include_str!("draw.js"),
    include_str!("pick.js"),
    include_str!("tracks.js"),
    include_str!("gestures.js"),
    include_str!("stage.js"),
];
const CONTROLS: &str = include_str!("controls.js");

/// A page of a picture: its title, what stands below that, its content, its data, and the script that steers it.
fn document(title: &str, header: &Markup, body: &Markup, encoded: &Encoded, script: &str) -> io::Result<String> {
    // No text in it ends a script.
    let about = serde_json::to_string(&encoded.about)?.replace('<', "\\u003c");
    let body = html! {
        header { h1 { (title) } (header) }
        (body)
        (footer())
        script type="application/json" id="about" { (PreEscaped(&about)) }
        script type="text/plain" id="data" { (PreEscaped(&encoded.data)) }
        script type="module" {
            @for script in SCRIPTS { (PreEscaped(script)) }
            (PreEscaped(script))
            (PreEscaped("start().catch((error) => say(`The motion cannot be shown: ${error.message}`));\n"))
        }
    };
    Ok(page::document(title, include_str!("view.css"), &body))
}

fn lead(animation: &Animation) -> String {
    let [particles, springs] = animation.whole();
    let mut parts = vec![format!("{}, {}", count(particles, "particle"), count(springs, "spring"))];
    parts.extend(animation.remarks.iter().cloned());
    parts.join(" · ")
}

/// The span of the motion and of the strains, in a sentence.
fn summary(animation: &Animation) -> String {
    let signed = |part: f64| format!("{}{} %", if part > 0.0 { "+" } else { "" }, pretty(100.0 * part));
    let mut parts = Vec::new();
    if let [start, .., end] = animation.times.as_slice() {
        let within = match animation.clock {
            [symbol, ""] => format!("from {symbol} {} to {}", pretty(*start), pretty(*end)),
            [_, unit] => format!("within {} {unit}", pretty(end - start)),
        };
        let distance = pretty(animation.farthest());
        parts.push(format!("{within} particles come up to {distance} m from where they start"));
    }
    match animation.strain_range() {
        None => {}
        Some([0.0, 0.0]) => parts.push("no spring is strained".into()),
        Some([least, most]) => {
            parts.push(format!("springs are strained from {} to {}", signed(least), signed(most)));
        }
    }
    let sentence = parts.join("; ");
    match sentence.split_at_checked(1) {
        Some((first, rest)) => format!("{}{rest}.", first.to_uppercase()),
        None => sentence,
    }
}

fn notes(animation: &Animation, encoded: &Encoded) -> Vec<String> {
    let thinned = thinned(animation).map(|note| note + " The curves below are of all springs.");
    let [shown, all] = [encoded.about.frames, animation.times.len()];
    let spaced = (shown < all)
        .then(|| format!("Thinned: {shown} of {all} frames are shown, evenly spaced, so that this file stays small."));
    thinned.into_iter().chain(spaced).collect()
}

/// A sentence on the neighbourhoods that a thinned scene shows.
fn thinned(animation: &Animation) -> Option<String> {
    animation.decimation()?;
    let ([particles, springs], shown) = (animation.whole(), animation.cast());
    Some(format!(
        "Thinned: {} of {particles} particles are shown, each for its neighbourhood, and {} lines for {springs} springs, each with \
         the mean strain of the springs from one neighbourhood to the next.",
        shown.bindings.len(),
        shown.pairs.len(),
    ))
}

fn stage(animation: &Animation, encoded: &Encoded) -> Markup {
    let has = |binding| animation.cast().bindings.contains(&binding);
    let strain = &encoded.about.strain;
    let shown = percent(strain.shown);
    // Beyond the ends of the map colours are the same.
    let [least, most] = if strain.largest > strain.shown { ["≤ −", "≥ +"] } else { ["−", "+"] };
    let label = format!("The motion of {}: springs coloured by strain", animation.title);
    html! {
        div.stage {
            canvas id="picture" tabindex="0" role="img" aria-label=(label) {}
            div.overlay id="legend" {
                @if encoded.about.springs > 0 {
                    strong { "strain l/l₀ − 1" }
                    span.scale {}
                    span.ends { span { (least) (shown) } span { "0" } span { (most) (shown) } }
                    span.ends { span { "compressed" } span { "stretched" } }
                }
                @if has(Binding::Held) { span.kind.held { "held" } }
                @if has(Binding::Moved) { span.kind.moved { "moved" } }
            }
            div.overlay id="name" role="status" hidden {}
            div.overlay.corner {
                svg id="compass" viewBox="-36 -36 72 72" aria-hidden="true" {}
                span { span id="bar" {} span id="length" {} }
            }
            div.overlay id="message" role="status" { noscript { "The picture needs JavaScript." } }
        }
    }
}

/// A part as a percentage, in at most three digits.
fn percent(part: f64) -> String {
    let value = 100.0 * part;
    if (1e-3..1e4).contains(&value) { format!("{} %", (value * 1e6).round() / 1e6) } else { format!("{value:.0e} %") }
}

fn transport() -> Markup {
    html! {
        div.transport role="group" aria-label="Playing" {
            button id="play" type="button" aria-label="Play" { "▶" }
            button id="back" type="button" aria-label="One frame back" { "◂" }
            button id="forward" type="button" aria-label="One frame forward" { "▸" }
            input id="slider" type="range" min="0" max="0" value="0" step="1" aria-label="Time";
            div.clock { span id="time" {} small id="count" {} }
            label { span.quiet { "speed " } select id="speed" {} }
        }
    }
}

fn switches(animation: &Animation) -> Markup {
    html! {
        div.switches {
            label { input id="springs" type="checkbox" checked; "springs" }
            label { input id="particles" type="checkbox" checked; "particles" }
            @if !animation.cast().triangles.is_empty() { label { input id="surface" type="checkbox" checked; "surface" } }
            button id="fit" type="button" { "fit" }
        }
    }
}

fn time_keys() -> Markup {
    html! {
        dt { "time" } dd { kbd { "space" } " plays and pauses, " kbd { "←" } " " kbd { "→" } " step, " kbd { "Home" } " " kbd { "End" } "; or point at a curve" }
    }
}

fn help(encoded: &Encoded, keys: &Markup) -> Markup {
    let about = &encoded.about;
    html! {
        details {
            summary { "Keys, fingers, and how exact this is" }
            dl {
                dt { "turn" } dd { "drag, or one finger; on the picture " kbd { "↑" } " " kbd { "↓" } ", and " kbd { "Shift" } " with arrows (a planar scene moves instead)" }
                dt { "move" } dd { "drag with " kbd { "Shift" } " or the right button, or two fingers" }
                dt { "magnify" } dd { "wheel, pinch, " kbd { "+" } " " kbd { "−" } "; double click or " kbd { "f" } " fits" }
                (keys)
                dt { "marks" } dd { "a square is held, along all axes or some; a diamond is moved" }
                dt { "numbers" } dd { "point at a particle or spring; a click or tap keeps it, " kbd { "Esc" } " lets go" }
                dt { "exactness" } dd {
                    "positions are within " (format!("{:.1e}", about.quantum / 2.0)) " m along each axis of what was computed, strains within "
                    (format!("{:.1e}", about.strain.error())) ", small ones much closer; nothing is shown between frames. Lengths can be compared: the \
                     projection is parallel"
                }
            }
        }
    }
}
