//! A sheet of paper: a title, shapes and text in pixels, written as SVG. The browser sets the text, so its width is only estimated here.

use super::number;
use std::fmt::{Arguments, Write};

/// The width of every picture in pixels; a page scales it to a third or two thirds of that.
pub(super) const WIDTH: f64 = 800.0;
/// Distance of lines of text.
pub(super) const LINE: f64 = 34.0;
const TEXT: f64 = 25.0;

pub(super) type Colour = &'static str;
pub(super) const INK: Colour = "#1b1f24";
pub(super) const MUTED: Colour = "#5b6670";
pub(super) const GRID: Colour = "#e2e6ea";
pub(super) const PAPER: Colour = "#ffffff";
/// Failures, and the ground on which they stand.
pub(super) const FAIL: Colour = "#c43c00";
pub(super) const FAIL_GROUND: Colour = "#faece6";
/// Series, in order: the colours of Okabe and Ito (2008) that are dark enough for thin lines, and three more.
pub(super) const SERIES: [Colour; 10] =
    ["#0072b2", "#d55e00", "#00946e", "#b75891", "#3c3c3c", "#9e7400", "#428cc4", "#7a205a", "#6060a8", "#785230"];
/// From compressed (blue) through unstrained (grey) to stretched (orange), lightest in the middle.
pub(super) const DIVERGING: [Colour; 9] =
    ["#084081", "#2166ac", "#4389c4", "#7aa4c2", "#a0a4a8", "#ce9862", "#d67722", "#b35406", "#7f3408"];
/// Classes of cells, the harmless one first; they differ in lightness too.
pub(super) const CLASSES: [Colour; 8] =
    ["#dfeef6", "#3c3c3c", "#c43c00", "#9254a0", "#f0be46", "#00946e", "#e48a70", "#96be96"];

/// Shapes of markers, as paths around their place.
pub(super) const SHAPES: [&str; 10] = [
    "m-6 0a6 6 0 1 0 12 0a6 6 0 1 0-12 0z",
    "m-6-6h12v12h-12z",
    "m-8 6h16l-8-15z",
    "m0-9l8 9l-8 9l-8-9z",
    "m-8-6h16l-8 15z",
    "m6-8v16l-15-8z",
    "m0-10l3 6l7 1l-6 5l2 7l-6-4l-6 4l2-7l-6-5l7-1z",
    "m-6-8v16l15-8z",
    "m-3-10h6v20h-6z",
    "m-8-8h16l-16 16h16z",
];
pub(super) const CROSS: &str = "m-8-8l16 16m0-16l-16 16";

/// A point in pixels, from the upper left.
pub(super) type Point = [f64; 2];

/// Draws the sample of an entry of a legend, 40 pixels wide, to the right of a point.
pub(super) type Sample<'a> = Box<dyn Fn(&mut Sheet, Point) + 'a>;

pub(super) struct Sheet {
    body: String,
}

impl Sheet {
    /// A sheet with a title and a conclusion, and the height at which these end.
    pub fn new(title: &str, conclusion: &str) -> (Self, f64) {
        let mut sheet = Self { body: String::new() };
        let mut middle = 10.0 + 0.5 * LINE;
        for (text, weight) in [(title, "bold"), (conclusion, "normal")] {
            for line in wrap(&number::typeset(text), WIDTH - 32.0) {
                sheet.styled_text(&line, [16.0, middle], format_args!(r#"font-weight="{weight}" fill="{INK}""#));
                middle += LINE;
            }
        }
        (sheet, middle + 4.0 - 0.5 * LINE)
    }

    pub fn finish(self, alt: &str, height: f64) -> String {
        let (alt, body) = (escaped(alt), self.body);
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{alt}" viewBox="0 0 {WIDTH} {height:.0}" width="{WIDTH}" height="{height:.0}" font-family="sans-serif" font-size="{TEXT}"><rect width="{WIDTH}" height="{height:.0}" fill="{PAPER}"/>{body}</svg>"#
        )
    }

    pub fn element(&mut self, tag: &str, attributes: Arguments<'_>) {
        // Writing into memory does not fail.
        let _ = write!(self.body, "<{tag} {attributes}/>");
    }

    pub fn line(&mut self, points: &[Point], colour: Colour, width: f64) {
        self.stroke(points, "", colour, width);
    }

    pub fn dashed(&mut self, points: &[Point], colour: Colour, width: f64) {
        self.stroke(points, r#" stroke-dasharray="12 9""#, colour, width);
    }

    fn stroke(&mut self, points: &[Point], dashes: &str, colour: Colour, width: f64) {
        let stroke = format_args!(r#"stroke="{colour}" stroke-width="{width}""#);
        self.element("path", format_args!(r#"d="{}" fill="none"{dashes} {stroke}"#, path(points)));
    }

    /// A filled rectangle from its upper left corner to its lower right one.
    pub fn rectangle(&mut self, [left, top]: Point, [right, bottom]: Point, colour: Colour) {
        let (width, height) = ((right - left).max(0.0), (bottom - top).max(0.0));
        self.element(
            "rect",
            format_args!(r#"x="{left:.1}" y="{top:.1}" width="{width:.1}" height="{height:.1}" fill="{colour}""#),
        );
    }

    /// A marker, filled or as an outline; a cross is always one.
    pub fn marker(&mut self, [x, y]: Point, shape: &str, colour: Colour, hollow: bool) {
        let d = format_args!(r#"d="M{x:.1} {y:.1}{shape}""#);
        if hollow || shape == CROSS {
            self.element("path", format_args!(r#"{d} fill="{PAPER}" stroke="{colour}" stroke-width="3.5""#));
        } else {
            self.element("path", format_args!(r#"{d} fill="{colour}""#));
        }
    }

    /// Text whose middle line is at the point's height; `anchor` is `start`, `middle` or `end`.
    pub fn text(&mut self, text: &str, at: Point, anchor: &str, colour: Colour) {
        self.styled_text(text, at, format_args!(r#"text-anchor="{anchor}" fill="{colour}""#));
    }

    /// Text that reads upwards, centred at a point.
    pub fn upright(&mut self, text: &str, [x, y]: Point, colour: Colour) {
        let turn = format_args!("rotate(-90 {x:.1} {y:.1})");
        self.styled_text(text, [x, y], format_args!(r#"transform="{turn}" text-anchor="middle" fill="{colour}""#));
    }

    pub fn styled_text(&mut self, text: &str, [x, y]: Point, attributes: Arguments<'_>) {
        let (base, text) = (y + 9.0, escaped(text));
        let _ = write!(self.body, r#"<text x="{x:.1}" y="{base:.1}" {attributes}>{text}</text>"#);
    }

    /// A legend in rows below a height, and the height at which it ends. Entries without a text are left out.
    pub fn legend(&mut self, top: f64, entries: Vec<(String, Sample<'_>)>) -> f64 {
        let mut at = [16.0, top + 0.5 * LINE];
        let mut end = top;
        for (text, sample) in entries.into_iter().filter(|(text, _)| !text.is_empty()) {
            let text = clip(&number::typeset(&text), WIDTH - 90.0);
            let room = 74.0 + width(&text);
            if at[0] > 16.0 && at[0] + room > WIDTH {
                at = [16.0, at[1] + LINE];
            }
            sample(self, at);
            self.text(&text, [at[0] + 50.0, at[1]], "start", INK);
            at[0] += room;
            end = at[1] + 0.5 * LINE + 12.0;
        }
        end
    }
}

pub(super) fn path(points: &[Point]) -> String {
    let mut data = String::new();
    for (k, [x, y]) in points.iter().enumerate() {
        let _ = write!(data, "{}{x:.1} {y:.1}", if k == 0 { 'M' } else { 'L' });
    }
    data
}

fn escaped(text: &str) -> String {
    maud::html! { (text) }.into_string()
}

/// About how wide a text is in pixels, in one of the wider sans-serif fonts.
pub(super) fn width(text: &str) -> f64 {
    let em = |c: char| match c {
        _ if "ijl.,:;|!' \u{a0}ftr()".contains(c) => 0.38,
        _ if "⁰¹²³⁴⁵⁶⁷⁸⁹⁻".contains(c) => 0.42,
        _ if "mwMW→—⅓⅔½".contains(c) => 0.98,
        _ if c.is_uppercase() || "+−=<>≤≥≈∞×∇".contains(c) => 0.8,
        _ => 0.63,
    };
    TEXT * text.chars().map(em).sum::<f64>()
}

/// Breaks a text into lines of at most `limit` pixels between words, but not at no-break spaces.
pub(super) fn wrap(text: &str, limit: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split([' ', '\t', '\n']).filter(|word| !word.is_empty()) {
        match lines.last_mut() {
            Some(line) if width(line) + width(" ") + width(word) <= limit => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines.iter().map(|line| clip(line, limit)).collect()
}

pub(super) fn clip(text: &str, limit: f64) -> String {
    if width(text) <= limit {
        return text.to_owned();
    }
    let mut clipped = text.to_owned();
    while width(&clipped) + width("…") > limit && clipped.pop().is_some() {}
    clipped + "…"
}
