//! Scene sketches as SVG.

use super::canvas::{LINE, TEXT, WIDTH, width, wrap};
use super::number;
use super::palette::{self, css};
use super::projection::{Projection, View};
use crate::figure::{Drawing, Segment};
use maud::{Markup, html};
use std::fmt::Write;

/// More springs than this are thinned out; the highlighted ones always stay.
const SPRINGS: usize = 8000;
/// More particles than this are not dotted.
const DOTS: usize = 200;
/// Length of the longest arrow, as a share of the sheet.
const ARROW: f64 = 0.12;
/// Half the height of a highlighted spring's badge.
const BADGE: f64 = 17.0;

/// Draws a scene as one SVG element, 800 pixels wide, that can stand in a page or alone in a file.
///
/// Planar scenes are drawn flat, others from above at an angle without perspective, y upwards. Springs are coloured
/// by their scalar, blue for negative and orange for positive; highlighted ones carry their number, and the lines below say why.
pub fn svg(drawing: &Drawing) -> String {
    let view = View::of(drawing);
    let labels: Vec<(usize, &Segment)> =
        drawing.segments.iter().enumerate().filter(|(_, segment)| segment.label.is_some()).collect();
    let title = wrap(&drawing.title, WIDTH - 32);
    let top = 14 + LINE * title.len() as i32;
    let notes = notes(drawing, &view, &labels);
    let below = top + view.height + 20;
    let height = below + LINE * (notes.len() as i32 + 2);
    let alt = std::iter::once(&drawing.title).chain(&notes).cloned().collect::<Vec<_>>().join("; ");
    let markup = html! {
        svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(alt)
            viewBox=(format!("0 0 {WIDTH} {height}")) width=(WIDTH) height=(height)
            font-family="sans-serif" font-size=(TEXT) fill=(css(palette::INK)) {
            rect width=(WIDTH) height=(height) fill=(css(palette::PAPER)) {}
            @for (i, line) in title.iter().enumerate() {
                text x="16" y=(10 + LINE * i as i32 + 26) font-weight="bold" { (line) }
            }
            g transform=(format!("translate(0 {top})")) stroke-linecap="round" {
                (halos(&labels, &view))
                (springs(drawing, &view))
                (highlighted(drawing, &labels, &view))
                (particles(drawing, &view))
                (arrows(drawing, &view))
                (badges(&labels, &view))
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
    html! {
        @for [x, y] in (0..dotted).filter(|p| !drawing.held.contains(p)).collect::<Vec<_>>().iter().filter_map(shown) {
            circle cx=(format!("{x:.1}")) cy=(format!("{y:.1}")) r="5" {}
        }
        @for [x, y] in drawing.held.iter().take(DOTS).filter_map(shown) {
            rect x=(format!("{:.1}", x - 8.0)) y=(format!("{:.1}", y - 8.0)) width="16" height="16"
                fill=(css(palette::PAPER)) stroke=(css(palette::INK)) stroke-width="4" {}
        }
    }
}

/// All arrows to one scale; those too short to see are left out.
fn arrows(drawing: &Drawing, view: &View) -> Markup {
    let projected = |vector: [f64; 3]| Projection::of(drawing).apply(vector);
    let size = |[x, y]: [f64; 2]| x.hypot(y);
    let sizes = drawing.arrows.iter().map(|arrow| size(projected(arrow.vector)));
    let longest = sizes.filter(|size| size.is_finite()).fold(0.0, f64::max);
    let mut path = String::new();
    for arrow in &drawing.arrows {
        let (Some([x, y]), vector) = (view.point(arrow.point), projected(arrow.vector)) else { continue };
        let share = size(vector) / longest;
        if !(0.03..=1.0).contains(&share) {
            continue;
        }
        let length = share * ARROW * f64::from(WIDTH);
        let (c, s) = (vector[0] / size(vector), -vector[1] / size(vector));
        let (tip, head) = ((x + length * c, y + length * s), 10.0_f64.min(0.5 * length));
        let _ = write!(path, "M{x:.1} {y:.1}L{:.1} {:.1}", tip.0, tip.1);
        for side in [-0.5, 0.5] {
            let (bx, by) = (tip.0 - head * (c - side * s), tip.1 - head * (s + side * c));
            let _ = write!(path, "M{:.1} {:.1}L{bx:.1} {by:.1}", tip.0, tip.1);
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
fn badges(labels: &[(usize, &Segment)], view: &View) -> Markup {
    let mut places: Vec<[f64; 3]> = Vec::new();
    html! {
        @for &(number, segment) in labels {
            @if let Some([a, b]) = view.ends(segment) {
                @let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
                @let half = 0.5 * f64::from(width(&number.to_string())) + 9.0;
                @let [x, y] = badge_place(middle, half, view, &places);
                @let () = places.push([x, y, half]);
                path d=(path([middle, [x, y]])) stroke=(css(palette::FAIL)) stroke-width="2.5" fill="none" {}
                rect x=(format!("{:.1}", x - half)) y=(format!("{:.1}", y - BADGE)) width=(format!("{:.1}", 2.0 * half)) height=(2.0 * BADGE)
                    rx=(BADGE) fill=(css(palette::FAIL)) {}
                text x=(format!("{x:.1}")) y=(format!("{:.1}", y + 9.0)) text-anchor="middle" font-weight="bold" fill=(css(palette::PAPER)) { (number) }
            }
        }
    }
}

/// A place for a badge of some half width near a spring's middle, inside the sheet and clear of the other badges where possible.
fn badge_place(middle: [f64; 2], half: f64, view: &View, badges: &[[f64; 3]]) -> [f64; 2] {
    let around = [2.4, 3.8, 5.2, 7.0].into_iter().flat_map(|radius| {
        (0..8).map(move |i| {
            let angle = std::f64::consts::FRAC_PI_4 * f64::from(i) - 1.2;
            [middle[0] + (radius * BADGE + half - BADGE) * angle.cos(), middle[1] + radius * BADGE * angle.sin()]
        })
    });
    let inside = |[x, y]: &[f64; 2]| {
        (half..f64::from(WIDTH) - half).contains(x) && (BADGE..f64::from(view.height) - BADGE).contains(y)
    };
    let apart = |[x, y]: &[f64; 2], [bx, by, other]: &[f64; 3]| {
        (bx - x).abs() > half + other + 4.0 || (by - y).abs() > 2.0 * BADGE + 4.0
    };
    let clear = |place: &[f64; 2]| badges.iter().all(|badge| apart(place, badge));
    around.clone().filter(inside).find(clear).or_else(|| around.clone().find(inside)).unwrap_or(middle)
}

/// Nine swatches with the scalar at both ends and its name.
fn colour_scale(drawing: &Drawing, y: i32) -> Markup {
    let extreme = extreme(drawing);
    let [low, high] = [format!("{} {}", drawing.scalar, number::pretty(-extreme)), number::pretty(extreme)];
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
        notes.extend(wrap(segment.label.as_deref().unwrap_or_default(), WIDTH - 32));
    }
    let every = drawing.segments.len().div_ceil(SPRINGS).max(1);
    if every > 1 {
        notes.push(format!("one in {every} of {} springs drawn", drawing.segments.len()));
    }
    let lost = drawing.segments.iter().filter(|segment| view.ends(segment).is_none()).count();
    if lost > 0 {
        notes.push(format!("{lost} springs have an end that is not finite and are not drawn"));
    }
    notes
}
