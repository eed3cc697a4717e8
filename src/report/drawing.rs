//! Scene sketches as SVG.

use super::axis::range;
use super::number::{self, typeset};
use super::sheet::{DIVERGING, FAIL, INK, LINE, PAPER, Point, Sheet, WIDTH, path, width, wrap};
use crate::figure::{Arrow, Drawing, Segment};

/// More particles than this are not dotted.
const DOTS: usize = 200;
/// Only so many arrows are drawn, the longest, so that the strain is seen between them.
const ARROWS: usize = 48;
/// Length of the longest arrow.
const ARROW: f64 = 96.0;
/// Half the height of the badge with a spring's number.
const BADGE: f64 = 17.0;
/// Free space around a badge.
const GAP: f64 = 4.0;

/// Draws a scene as one SVG element, 800 pixels wide, that can stand in a page or alone in a file.
///
/// Planar scenes are drawn flat, others from above at an angle without perspective, upwards against gravity. Springs are coloured
/// by their scalar, blue for negative and orange for positive; highlighted ones carry their number, and the lines below say why.
pub fn svg(drawing: &Drawing) -> String {
    let (mut sheet, top) = Sheet::new(&drawing.title, &drawing.conclusion);
    let view = View::of(drawing, top);
    let labelled = drawing.segments.iter().enumerate().filter(|(_, segment)| segment.label.is_some());
    let labels: Vec<(usize, &Segment)> = labelled.collect();
    let (arrows, shorter) = arrows(drawing, &view);
    let notes = notes(drawing, &view, &labels, shorter);
    let colours = Colours::of(drawing);
    draw_springs(&mut sheet, drawing, &view, &colours);
    for (_, segment) in &labels {
        if let Some(ends) = view.ends(segment) {
            let halo = r#"stroke-width="20" stroke-opacity="0.3" stroke-linecap="round""#;
            sheet.element("path", format_args!(r#"d="{}" stroke="{FAIL}" {halo}"#, path(&ends)));
            sheet.line(&ends, DIVERGING[colours.step(segment)], 6.0);
        }
    }
    draw_particles(&mut sheet, drawing, &view);
    draw_arrows(&mut sheet, &arrows);
    draw_badges(&mut sheet, drawing, &view, &labels, &arrows);
    let below = view.bottom + 20.0;
    colours.draw_scale(&mut sheet, drawing, below);
    for (i, note) in notes.iter().enumerate() {
        sheet.text(note, [16.0, below + LINE * (i as f64 + 2.0) + 5.0], "start", INK);
    }
    let said = [&drawing.title, &drawing.conclusion].into_iter().chain(&notes).filter(|text| !text.is_empty());
    let alt = said.cloned().collect::<Vec<_>>().join("; ");
    sheet.finish(&alt, below + LINE * (notes.len() as f64 + 2.0))
}

/// A parallel projection, right and up. Scenes in a plane z = const are seen from the front, others turned by 35° about the vertical axis and from 22° above.
fn projection(drawing: &Drawing) -> impl Fn([f64; 3]) -> [f64; 2] {
    let up = drawing.up;
    let depths = drawing.points.iter().map(|&point| up.upright(point)[2]);
    let flat = drawing.dimension < 3 || depths.clone().zip(depths.skip(1)).all(|(a, b)| a == b);
    let [turn, raise] = [35f64, 22.0].map(f64::to_radians);
    move |vector| {
        let [x, y, z] = up.upright(vector);
        let depth = x * turn.sin() + z * turn.cos();
        match flat {
            true => [x, y],
            false => [x * turn.cos() - z * turn.sin(), y * raise.cos() - depth * raise.sin()],
        }
    }
}

struct View {
    top: f64,
    bottom: f64,
    points: Vec<Option<Point>>,
}

impl View {
    fn of(drawing: &Drawing, top: f64) -> Self {
        let projection = projection(drawing);
        let finite = |p: Point| p.iter().all(|c| c.is_finite()).then_some(p);
        let flat: Vec<Option<Point>> = drawing.points.iter().map(|&p| finite(projection(p))).collect();
        // The centre and the half size along an axis.
        let extent = |axis: usize| {
            let (low, high) = range(flat.iter().flatten().map(|p| p[axis]));
            if low <= high { (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low) } else { (0.0, 0.0) }
        };
        let ((cx, rx), (cy, ry)) = (extent(0), extent(1));
        let border = if drawing.arrows.is_empty() { 70.0 } else { ARROW + 12.0 };
        let scale = ((0.5 * WIDTH - border) / rx).min((320.0 - border) / ry);
        let scale = if scale.is_finite() { scale } else { 1.0 };
        let height = (2.0 * (ry * scale + border)).clamp(220.0, 640.0).round();
        let place = |[x, y]: Point| [0.5 * WIDTH + (x - cx) * scale, top + 0.5 * height - (y - cy) * scale];
        Self { top, bottom: top + height, points: flat.into_iter().map(|p| p.map(place).and_then(finite)).collect() }
    }

    fn point(&self, index: usize) -> Option<Point> {
        self.points.get(index).copied().flatten()
    }

    fn ends(&self, segment: &Segment) -> Option<[Point; 2]> {
        let [i, j] = segment.ends;
        Some([self.point(i)?, self.point(j)?])
    }
}

struct Colours {
    extreme: f64,
}

impl Colours {
    fn of(drawing: &Drawing) -> Self {
        let sizes = drawing.segments.iter().map(|segment| segment.scalar.abs());
        Self { extreme: sizes.filter(|size| size.is_finite()).fold(0.0, f64::max) }
    }

    /// The step of the scale for a segment. NaN counts as unstrained here: its place is the report's table.
    fn step(&self, segment: &Segment) -> usize {
        let share = if self.extreme > 0.0 { segment.scalar / self.extreme } else { 0.0 };
        let middle = DIVERGING.len() / 2;
        (middle as f64 * (1.0 + if share.is_nan() { 0.0 } else { share.clamp(-1.0, 1.0) })).round() as usize
    }

    /// Nine swatches with the scalar at both ends and its name.
    fn draw_scale(&self, sheet: &mut Sheet, drawing: &Drawing, top: f64) {
        let middle = top + 12.0;
        if self.extreme == 0.0 {
            if !drawing.segments.is_empty() {
                sheet.text(&format!("{} is 0 everywhere", drawing.scalar), [16.0, middle], "start", INK);
            }
            return;
        }
        let low = format!("{}: {}", drawing.scalar, number::pretty(-self.extreme));
        sheet.text(&low, [16.0, middle], "start", INK);
        let mut left = 16.0 + width(&low) + 12.0;
        for colour in DIVERGING {
            sheet.rectangle([left, top], [left + 28.0, top + 24.0], colour);
            left += 28.0;
        }
        sheet.text(&number::pretty(self.extreme), [left + 12.0, middle], "start", INK);
    }
}

/// One path per colour, the most strained last so that they lie on top.
fn draw_springs(sheet: &mut Sheet, drawing: &Drawing, view: &View, colours: &Colours) {
    let mut paths = DIVERGING.map(|colour| (colour, String::new()));
    for segment in drawing.segments.iter().step_by(spacing(drawing)) {
        if let Some(ends) = view.ends(segment) {
            paths[colours.step(segment)].1 += &path(&ends);
        }
    }
    let width = if drawing.segments.len() > 1500 { 1.5 } else { 4.0 };
    let mut order: Vec<usize> = (0..paths.len()).collect();
    order.sort_by_key(|&step| step.abs_diff(DIVERGING.len() / 2));
    for (colour, path) in order.into_iter().map(|step| &paths[step]).filter(|(_, path)| !path.is_empty()) {
        let stroke = format_args!(r#"stroke="{colour}" stroke-width="{width}" fill="none" stroke-linecap="round""#);
        sheet.element("path", format_args!(r#"d="{path}" {stroke}"#));
    }
}

/// One in so many springs is drawn, about 8000; the highlighted ones always are.
fn spacing(drawing: &Drawing) -> usize {
    drawing.segments.len().div_ceil(8000).max(1)
}

fn draw_particles(sheet: &mut Sheet, drawing: &Drawing, view: &View) {
    let dotted = if drawing.points.len() > DOTS { 0 } else { drawing.points.len() };
    for p in (0..dotted).filter(|p| !drawing.held.contains(p)) {
        if let Some([x, y]) = view.point(p) {
            sheet.element("circle", format_args!(r#"cx="{x:.1}" cy="{y:.1}" r="5" fill="{INK}""#));
        }
    }
    let (half, stroke) = if drawing.held.len() > 40 { (4.0, 2) } else { (8.0, 4) };
    for [x, y] in drawing.held.iter().take(DOTS).filter_map(|&p| view.point(p)) {
        let (left, top, side) = (x - half, y - half, 2.0 * half);
        let square = format_args!(r#"x="{left:.1}" y="{top:.1}" width="{side}" height="{side}""#);
        sheet.element("rect", format_args!(r#"{square} fill="{PAPER}" stroke="{INK}" stroke-width="{stroke}""#));
    }
}

/// The longest arrows that are long enough to be seen, from their feet to their tips, to one scale, and how many are left out as shorter than these.
fn arrows(drawing: &Drawing, view: &View) -> (Vec<[Point; 2]>, usize) {
    let projection = projection(drawing);
    let length = |arrow: &Arrow| projection(arrow.vector).into_iter().fold(0.0, f64::hypot);
    let longest = drawing.arrows.iter().map(length).filter(|length| length.is_finite()).fold(0.0, f64::max);
    let seen = |arrow: &&Arrow| (0.03..=1.0).contains(&(length(arrow) / longest)) && view.point(arrow.point).is_some();
    let mut arrows: Vec<&Arrow> = drawing.arrows.iter().filter(seen).collect();
    arrows.sort_by(|a, b| length(b).total_cmp(&length(a)));
    let ends = |arrow: &&Arrow| {
        let ([x, y], [right, up]) = (view.point(arrow.point)?, projection(arrow.vector));
        Some([[x, y], [x + ARROW * (right / longest), y - ARROW * (up / longest)]])
    };
    (arrows.iter().take(ARROWS).filter_map(ends).collect(), arrows.len().saturating_sub(ARROWS))
}

fn draw_arrows(sheet: &mut Sheet, arrows: &[[Point; 2]]) {
    for &[foot, tip] in arrows {
        let along = [tip[0] - foot[0], tip[1] - foot[1]];
        let length = along[0].hypot(along[1]);
        let ([c, s], head) = (along.map(|part| part / length), 10.0_f64.min(0.5 * length));
        let barb = |side: f64| [tip[0] - head * (c - side * s), tip[1] - head * (s + side * c)];
        sheet.line(&[foot, tip, barb(0.5), tip, barb(-0.5)], INK, 2.5);
    }
}

fn draw_badges(sheet: &mut Sheet, drawing: &Drawing, view: &View, labels: &[(usize, &Segment)], arrows: &[[Point; 2]]) {
    let springs = drawing.segments.iter().filter_map(|segment| view.ends(segment));
    let lines = springs.chain(arrows.iter().copied()).collect();
    let mut placement = LabelPlacement { lines, badges: Vec::new() };
    for &(number, segment) in labels {
        let Some([a, b]) = view.ends(segment) else { continue };
        let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
        let text = number.to_string();
        let half = 0.5 * width(&text) + 9.0;
        let [x, y] = placement.place(middle, half, [view.top, view.bottom]);
        sheet.line(&[middle, [x, y]], FAIL, 2.5);
        let (left, top, wide, high) = (x - half, y - BADGE, 2.0 * half, 2.0 * BADGE);
        let place = format_args!(r#"x="{left:.1}" y="{top:.1}" width="{wide:.1}" height="{high}" rx="{BADGE}""#);
        sheet.element("rect", format_args!(r#"{place} fill="{FAIL}""#));
        sheet.styled_text(&text, [x, y], format_args!(r#"text-anchor="middle" font-weight="bold" fill="{PAPER}""#));
    }
}

struct LabelPlacement {
    /// Springs, arrows, and the leaders from springs to their badges.
    lines: Vec<[Point; 2]>,
    badges: Vec<[f64; 3]>,
}

impl LabelPlacement {
    /// The nearest place for a badge to a spring's middle that is clear of the other badges and over as few lines as possible.
    fn place(&mut self, middle: Point, half: f64, [top, bottom]: [f64; 2]) -> Point {
        let around = [2.4, 3.4, 4.6, 6.0, 8.0, 11.0, 14.0].into_iter().flat_map(|radius| {
            (0..16).map(move |i| {
                let (sine, cosine) = (std::f64::consts::FRAC_PI_8 * f64::from(i) - 1.2).sin_cos();
                [middle[0] + (radius * BADGE + half - BADGE) * cosine, middle[1] + radius * BADGE * sine]
            })
        });
        let inside = |[x, y]: &Point| (half..WIDTH - half).contains(x) && (top + BADGE..bottom - BADGE).contains(y);
        let cost = |place: &Point| {
            let covered = self.badges.iter().filter(|[x, y, other]| {
                (x - place[0]).abs() <= half + other + GAP && (y - place[1]).abs() <= 2.0 * BADGE + GAP
            });
            let crossed = |line: &&[Point; 2]| meets(line, *place, [half + GAP, BADGE + GAP]);
            // A badge over a badge hides a number: worse than any number of lines.
            covered.count() * (self.lines.len() + 1) + self.lines.iter().filter(crossed).count()
        };
        let place = around.filter(inside).min_by_key(cost).unwrap_or(middle);
        self.badges.push([place[0], place[1], half]);
        self.lines.push([middle, place]);
        place
    }
}

/// True where a line passes through a rectangle around a point: its parts between the rectangle's sides along both axes overlap.
fn meets([a, b]: &[Point; 2], centre: Point, half: Point) -> bool {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for axis in [0, 1] {
        let (start, along) = (a[axis] - centre[axis], b[axis] - a[axis]);
        if along == 0.0 && start.abs() > half[axis] {
            return false;
        }
        if along != 0.0 {
            let (enter, leave) = ((-half[axis] - start) / along, (half[axis] - start) / along);
            (from, to) = (from.max(enter.min(leave)), to.min(enter.max(leave)));
        }
    }
    from <= to
}

fn notes(drawing: &Drawing, view: &View, labels: &[(usize, &Segment)], shorter: usize) -> Vec<String> {
    let reasons = labels.iter().filter_map(|(_, segment)| segment.label.as_deref());
    let mut notes: Vec<String> = reasons.flat_map(|reason| wrap(&typeset(reason), WIDTH - 32.0)).collect();
    if spacing(drawing) > 1 {
        notes.push(format!("one in {} of {} springs drawn", spacing(drawing), drawing.segments.len()));
    }
    if shorter > 0 {
        notes.push(format!("the {ARROWS} longest of {} arrows drawn", ARROWS + shorter));
    }
    let lost = drawing.segments.iter().filter(|segment| view.ends(segment).is_none()).count();
    if lost > 0 {
        notes.push(format!("{lost} springs have an end that is not finite and are not drawn"));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_through_a_rectangle_are_seen() {
        let meets = |line: [Point; 2]| meets(&line, [10.0, 10.0], [3.0, 2.0]);
        let [across, within, through_a_corner] =
            [[[0.0, 10.0], [20.0, 10.0]], [[10.0; 2], [10.5; 2]], [[6.0, 9.0], [9.0, 13.0]]];
        assert_eq!([across, within, through_a_corner].map(meets), [true; 3]);
        let [before, below, past_a_corner] =
            [[[0.0, 10.0], [6.0, 10.0]], [[0.0, 12.5], [20.0, 12.5]], [[5.0, 10.0], [10.0, 20.0]]];
        assert_eq!([before, below, past_a_corner].map(meets), [false; 3]);
    }

    /// A spring in a row of them has its number where none of them is.
    #[test]
    fn badges_stand_beside_lines_and_each_other() {
        let end = |i: i32| [60.0 + 70.0 * f64::from(i), 200.0];
        let springs: Vec<[Point; 2]> = (0..9).map(|i| [end(i), end(i + 1)]).collect();
        let mut placement = LabelPlacement { lines: springs.clone(), badges: Vec::new() };
        for i in 0..9 {
            let place = placement.place([95.0 + 70.0 * f64::from(i), 200.0], 20.0, [0.0, 400.0]);
            assert!(!springs.iter().any(|line| meets(line, place, [20.0, BADGE])), "{place:?} covers a spring");
        }
        for (k, [x, y, half]) in placement.badges.iter().enumerate() {
            let apart = |other: &[f64; 3]| (other[0] - x).abs() > half + other[2] || (other[1] - y).abs() > 2.0 * BADGE;
            assert!(placement.badges[..k].iter().all(apart), "badge {k} covers another");
        }
    }
}
