//! Scene sketches as SVG.

use super::canvas::{LINE, TEXT, WIDTH, width, wrap};
use super::heading::Heading;
use super::label_placement::{BADGE, LabelPlacement};
use super::number::{self, typeset};
use super::palette::{self, css};
use super::projection::{ARROW, Projection, View};
use crate::figure::{Arrow, Drawing, Segment};
use maud::{Markup, html};
use std::fmt::Write;

/// More springs than this are thinned out; the highlighted ones always stay.
const SPRINGS: usize = 8000;
/// More particles than this are not dotted.
const DOTS: usize = 200;
/// Of more arrows than this only the longest are drawn: the strain is to be seen between them.
const ARROWS: usize = 48;
/// More held particles than this have small squares.
const CROWD: usize = 40;

/// Draws a scene as one SVG element, 800 pixels wide, that can stand in a page or alone in a file.
///
/// Planar scenes are drawn flat, others from above at an angle without perspective, upwards against gravity. Springs are coloured
/// by their scalar, blue for negative and orange for positive; highlighted ones carry their number, and the lines below say why.
pub fn svg(drawing: &Drawing) -> String {
    let view = View::of(drawing);
    let labels: Vec<(usize, &Segment)> =
        drawing.segments.iter().enumerate().filter(|(_, segment)| segment.label.is_some()).collect();
    let heading = Heading::new(&drawing.title, &drawing.conclusion);
    let top = heading.height();
    let notes = notes(drawing, &view, &labels);
    let below = top + view.height + 20;
    let height = below + LINE * (notes.len() as i32 + 2);
    let said = [&drawing.title, &drawing.conclusion].into_iter().chain(&notes).filter(|text| !text.is_empty());
    let alt = said.cloned().collect::<Vec<_>>().join("; ");
    let markup = html! {
        svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(alt)
            viewBox=(format!("0 0 {WIDTH} {height}")) width=(WIDTH) height=(height)
            font-family="sans-serif" font-size=(TEXT) fill=(css(palette::INK)) {
            rect width=(WIDTH) height=(height) fill=(css(palette::PAPER)) {}
            (heading.markup())
            g transform=(format!("translate(0 {top})")) stroke-linecap="round" {
                (halos(&labels, &view))
                (springs(drawing, &view))
                (highlighted(drawing, &labels, &view))
                (particles(drawing, &view))
                (arrows(drawing, &view))
                (badges(drawing, &labels, &view))
            }
            (colour_scale(drawing, below))
            @for (i, note) in notes.iter().enumerate() {
                text x="16" y=(below + LINE * (i as i32 + 2) + 14) { (note) }
            }
        }
    };
    markup.into_string()
}

/// The largest size of a scalar: the end of the colour scale.
fn extreme(drawing: &Drawing) -> f64 {
    drawing.segments.iter().map(|segment| segment.scalar.abs()).filter(|size| size.is_finite()).fold(0.0, f64::max)
}

/// The step of the colour scale for a segment. NaN counts as unstrained here: its place is the report's table.
fn step(segment: &Segment, extreme: f64) -> usize {
    let middle = palette::DIVERGING.len() / 2;
    let share = if extreme > 0.0 { segment.scalar / extreme } else { 0.0 };
    (middle as f64 * (1.0 + share)).round() as usize
}

/// The path of a segment.
fn path([a, b]: [[f64; 2]; 2]) -> String {
    format!("M{:.1} {:.1}L{:.1} {:.1}", a[0], a[1], b[0], b[1])
}

/// One path per colour, the most strained last so that they lie on top.
fn springs(drawing: &Drawing, view: &View) -> Markup {
    let middle = palette::DIVERGING.len() / 2;
    let extreme = extreme(drawing);
    let mut paths = vec![String::new(); palette::DIVERGING.len()];
    let every = drawing.segments.len().div_ceil(SPRINGS).max(1);
    for segment in drawing.segments.iter().step_by(every) {
        let Some(ends) = view.ends(segment) else { continue };
        if let Some(of_colour) = paths.get_mut(step(segment, extreme)) {
            of_colour.push_str(&path(ends));
        }
    }
    let mut order: Vec<usize> = (0..paths.len()).collect();
    order.sort_by_key(|&colour| colour.abs_diff(middle));
    let width = if drawing.segments.len() > 1500 { 1.5 } else { 4.0 };
    html! {
        @for colour in order.into_iter().filter(|&colour| !paths[colour].is_empty()) {
            path d=(paths[colour]) stroke=(css(palette::DIVERGING[colour])) stroke-width=(width) fill="none" {}
        }
    }
}

/// Dots for particles, where they are few enough, and squares for those that are held.
fn particles(drawing: &Drawing, view: &View) -> Markup {
    let dotted = if drawing.points.len() > DOTS { 0 } else { drawing.points.len() };
    let shown = |p: &usize| view.point(*p);
    let (half, stroke) = if drawing.held.len() > CROWD { (4.0, 2) } else { (8.0, 4) };
    html! {
        @for [x, y] in (0..dotted).filter(|p| !drawing.held.contains(p)).collect::<Vec<_>>().iter().filter_map(shown) {
            circle cx=(format!("{x:.1}")) cy=(format!("{y:.1}")) r="5" {}
        }
        @for [x, y] in drawing.held.iter().take(DOTS).filter_map(shown) {
            rect x=(format!("{:.1}", x - half)) y=(format!("{:.1}", y - half)) width=(2.0 * half) height=(2.0 * half)
                fill=(css(palette::PAPER)) stroke=(css(palette::INK)) stroke-width=(stroke) {}
        }
    }
}

/// The arrows that are drawn, from their feet to their tips, and how many are left out as shorter than these. All are to one scale;
/// those too short to see are no arrows.
fn drawn_arrows(drawing: &Drawing, view: &View) -> (Vec<[[f64; 2]; 2]>, usize) {
    let projection = Projection::of(drawing);
    let projected = |arrow: &Arrow| projection.apply(arrow.vector);
    let size = |[x, y]: [f64; 2]| x.hypot(y);
    let sizes = drawing.arrows.iter().map(|arrow| size(projected(arrow)));
    let longest = sizes.filter(|size| size.is_finite()).fold(0.0, f64::max);
    let mut arrows: Vec<(f64, [[f64; 2]; 2])> = Vec::new();
    for arrow in &drawing.arrows {
        let (Some([x, y]), vector) = (view.point(arrow.point), projected(arrow)) else { continue };
        let share = size(vector) / longest;
        if (0.03..=1.0).contains(&share) {
            let scale = ARROW * f64::from(WIDTH) / longest;
            arrows.push((share, [[x, y], [x + scale * vector[0], y - scale * vector[1]]]));
        }
    }
    arrows.sort_by(|a, b| b.0.total_cmp(&a.0));
    let left_out = arrows.len().saturating_sub(ARROWS);
    (arrows.into_iter().take(ARROWS).map(|(_, ends)| ends).collect(), left_out)
}

fn arrows(drawing: &Drawing, view: &View) -> Markup {
    let mut path = String::new();
    for [foot, tip] in drawn_arrows(drawing, view).0 {
        let along = [tip[0] - foot[0], tip[1] - foot[1]];
        let length = along[0].hypot(along[1]);
        let ([c, s], head) = (along.map(|part| part / length), 10.0_f64.min(0.5 * length));
        let _ = write!(path, "M{:.1} {:.1}L{:.1} {:.1}", foot[0], foot[1], tip[0], tip[1]);
        for side in [-0.5, 0.5] {
            let (bx, by) = (tip[0] - head * (c - side * s), tip[1] - head * (s + side * c));
            let _ = write!(path, "M{:.1} {:.1}L{bx:.1} {by:.1}", tip[0], tip[1]);
        }
    }
    html! { @if !path.is_empty() { path d=(path) stroke=(css(palette::INK)) stroke-width="2.5" fill="none" {} } }
}

/// Light halos under the highlighted springs, so that the strain stays to be seen.
fn halos(labels: &[(usize, &Segment)], view: &View) -> Markup {
    let ends = labels.iter().filter_map(|(_, segment)| view.ends(segment));
    let all: String = ends.map(path).collect();
    html! { @if !all.is_empty() { path d=(all) stroke=(css(palette::FAIL)) stroke-width="20" stroke-opacity="0.3" fill="none" {} } }
}

/// The highlighted springs once more, above the others, in the colours of their scalars.
fn highlighted(drawing: &Drawing, labels: &[(usize, &Segment)], view: &View) -> Markup {
    let extreme = extreme(drawing);
    let colour = |segment: &Segment| palette::DIVERGING.get(step(segment, extreme)).copied().unwrap_or(palette::MUTED);
    html! {
        @for (segment, ends) in labels.iter().filter_map(|(_, segment)| Some((segment, view.ends(segment)?))) {
            path d=(path(ends)) stroke=(css(colour(segment))) stroke-width="6" fill="none" {}
        }
    }
}

/// The numbers of the highlighted springs beside them.
fn badges(drawing: &Drawing, labels: &[(usize, &Segment)], view: &View) -> Markup {
    let springs = drawing.segments.iter().filter_map(|segment| view.ends(segment));
    let mut taken = LabelPlacement::by(springs.chain(drawn_arrows(drawing, view).0).collect());
    html! {
        @for &(number, segment) in labels {
            @if let Some([a, b]) = view.ends(segment) {
                @let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
                @let half = 0.5 * f64::from(width(&number.to_string())) + 9.0;
                @let [x, y] = taken.place(middle, half, f64::from(view.height));
                path d=(path([middle, [x, y]])) stroke=(css(palette::FAIL)) stroke-width="2.5" fill="none" {}
                rect x=(format!("{:.1}", x - half)) y=(format!("{:.1}", y - BADGE)) width=(format!("{:.1}", 2.0 * half)) height=(2.0 * BADGE)
                    rx=(BADGE) fill=(css(palette::FAIL)) {}
                text x=(format!("{x:.1}")) y=(format!("{:.1}", y + 9.0)) text-anchor="middle" font-weight="bold" fill=(css(palette::PAPER)) { (number) }
            }
        }
    }
}

/// Nine swatches with the scalar at both ends and its name.
fn colour_scale(drawing: &Drawing, y: i32) -> Markup {
    let extreme = extreme(drawing);
    if extreme == 0.0 {
        return html! { @if !drawing.segments.is_empty() { text x="16" y=(y + 20) { (drawing.scalar) " is 0 everywhere" } } };
    }
    let [low, high] = [format!("{}: {}", drawing.scalar, number::pretty(-extreme)), number::pretty(extreme)];
    let left = 16 + width(&low) + 12;
    html! {
        text x="16" y=(y + 20) { (low) }
        @for (i, &colour) in palette::DIVERGING.iter().enumerate() {
            rect x=(left + 28 * i as i32) y=(y) width="28" height="24" fill=(css(colour)) {}
        }
        text x=(left + 28 * palette::DIVERGING.len() as i32 + 12) y=(y + 20) { (high) }
    }
}

/// Why springs are highlighted, and what is not shown.
fn notes(drawing: &Drawing, view: &View, labels: &[(usize, &Segment)]) -> Vec<String> {
    let mut notes = Vec::new();
    for (_, segment) in labels {
        notes.extend(wrap(&typeset(segment.label.as_deref().unwrap_or_default()), WIDTH - 32));
    }
    let every = drawing.segments.len().div_ceil(SPRINGS).max(1);
    if every > 1 {
        notes.push(format!("one in {every} of {} springs drawn", drawing.segments.len()));
    }
    let shorter = drawn_arrows(drawing, view).1;
    if shorter > 0 {
        notes.push(format!("the {ARROWS} longest of {} arrows drawn", ARROWS + shorter));
    }
    let lost = drawing.segments.iter().filter(|segment| view.ends(segment).is_none()).count();
    if lost > 0 {
        notes.push(format!("{lost} springs have an end that is not finite and are not drawn"));
    }
    notes
}
