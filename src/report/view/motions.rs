//! A page of motions about a state, one of which swings: normal modes, or mechanisms. The encoded frames are the state, and the state moved along each
//! motion by one length; the page composes what lies between.

use super::encode::{Amplitude, encode, extent};
use super::{document, help, lead, stage, switches, thinned};
use crate::figure::{Animation, SceneTopology};
use crate::report::number::{pretty, typeset};
use maud::{Markup, html};
use nalgebra::Vector3;
use std::io;

/// The largest displacement of the frames, as a part of the extent of the scene.
const AMPLITUDE: f64 = 0.1;

/// The largest amplitude that can be chosen, as a part of the extent.
const LARGEST: f64 = 0.3;

const CONTROLS: &str = include_str!("motions.js");

/// One motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Its name, for example `mode 3`.
    pub name: String,
    /// Its cells in the list, one for each column.
    pub cells: Vec<String>,
    /// A few words on it, shown while it plays.
    pub remark: String,
    /// The displacement of every particle, to any scale.
    pub shape: Vec<Vector3<f64>>,
}

/// Motions about a state.
#[derive(Debug, Clone, PartialEq)]
pub struct Motions {
    /// The title of the page.
    pub title: String,
    /// Sentences below the title: what was found.
    pub facts: Vec<String>,
    /// Sentences that stand out: reasons to doubt.
    pub warnings: Vec<String>,
    /// Columns of the list besides the name.
    pub columns: Vec<String>,
    /// The motions.
    pub motions: Vec<Motion>,
    /// The motion that is chosen first.
    pub first: usize,
}

impl Motions {
    /// The page that plays them, about a state given by its positions.
    pub fn html(&self, topology: SceneTopology, positions: &[Vector3<f64>]) -> io::Result<String> {
        let (low, high) = extent(positions.iter());
        let widest = (high - low).max();
        let length = AMPLITUDE * if widest > 0.0 { widest } else { 1.0 };
        let mut animation = Animation::new(&self.title, topology);
        animation.push(0.0, positions);
        let shown = self.shown(&animation);
        for (number, motion) in self.motions[..shown].iter().enumerate() {
            let largest = motion.shape.iter().map(Vector3::norm).fold(f64::MIN_POSITIVE, f64::max);
            let scale = length / largest;
            let moved: Vec<_> = positions.iter().zip(&motion.shape).map(|(x, u)| x + scale * u).collect();
            animation.push(1.0 + number as f64, &moved);
        }
        let mut encoded = encode(&animation, usize::MAX);
        encoded.about.amplitude = Some(Amplitude { length, part: AMPLITUDE });
        encoded.about.tracks.clear();
        let header = html! {
            p.lead { (lead(&animation)) }
            @for fact in &self.facts { p.told { (typeset(fact)) } }
            @for warning in &self.warnings { p.note { (typeset(warning)) } }
            @if shown < self.motions.len() {
                p.note { "The first " (shown) " of " (self.motions.len()) " motions are shown, so that this file stays small." }
            }
            @if let Some(note) = thinned(&animation) { p.note { (note) } }
        };
        let body = html! {
            main.beside {
                div {
                    (stage(&animation, &encoded))
                    (transport())
                    (switches(&animation))
                }
                (self.list(shown))
                (help(&encoded, &keys()))
            }
        };
        document(&self.title, &header, &body, &encoded, CONTROLS)
    }

    /// The number of motions in a list that can be read, and in 28 MB before compression, which make a page of at most 40 MB.
    fn shown(&self, animation: &Animation) -> usize {
        let bytes = 6 * animation.cast().bindings.len() + 2 * animation.cast().pairs.len();
        self.motions.len().min(500).min((28_000_000 / bytes.max(1)).saturating_sub(1).max(1))
    }

    fn list(&self, shown: usize) -> Markup {
        html! {
            div.list role="region" aria-label="Motions" tabindex="0" {
                table id="motions" {
                    thead { tr { th scope="col" { "" } @for column in &self.columns { th scope="col" { (column) } } } }
                    tbody {
                        @for (number, motion) in self.motions[..shown].iter().enumerate() {
                            tr data-name=(motion.name) data-about=(typeset(&motion.remark)) {
                                th scope="row" {
                                    label {
                                        input type="radio" name="motion" value=(number + 1) checked[number == self.first.min(shown - 1)];
                                        (motion.name)
                                    }
                                }
                                @for cell in &motion.cells { td { (typeset(cell)) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn transport() -> Markup {
    let percent = |part: f64| format!("{}", (100.0 * part).round());
    html! {
        div.transport role="group" aria-label="Playing" {
            button id="play" type="button" aria-label="Play" { "▶" }
            div.clock { span id="time" {} small id="count" {} }
            label.amplitude {
                span.quiet { "amplitude " }
                input id="slider" type="range" min="0" max=(percent(LARGEST)) value=(percent(AMPLITUDE)) step="0.5";
                output id="size" {}
            }
        }
    }
}

fn keys() -> Markup {
    html! {
        dt { "motions" } dd { kbd { "space" } " plays and pauses, " kbd { "n" } " and " kbd { "p" } " choose the next and the previous one" }
        dt { "amplitude" } dd {
            "the largest displacement of a particle, enlarged to be seen: up to " (pretty(100.0 * LARGEST)) " % of the scene's extent. Small ones are \
             straight lines; a rotation, drawn large, makes things longer. Every motion swings once in two seconds, whatever its period"
        }
    }
}
