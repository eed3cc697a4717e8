//! A sheet of paper: shapes and text in pixels, written as SVG by plotters.
//!
//! Coordinates are whole pixels, so sheets are drawn large and scaled down by the page. Text is set by whoever shows
//! the picture; only its width is estimated here.

use super::palette::{self, Colour};
use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Where text stands relative to its point.
pub(super) use plotters::style::text_anchor::HPos as Align;

/// The width of every picture in pixels; on a page one is scaled to a third or two thirds of that.
pub(super) const WIDTH: i32 = 800;
/// Size of text in pixels.
pub(super) const TEXT: i32 = 25;
/// Distance of lines of text.
pub(super) const LINE: i32 = 34;

/// What drawing returns. Writing into memory does not fail; plotters cannot know that.
pub(super) type Drawn = Result<(), Box<dyn std::error::Error>>;
/// A point in pixels, from the upper left.
pub(super) type Point = (i32, i32);

/// Draws a picture with a name for those who cannot see it.
///
/// Should drawing fail, the picture says so instead.
pub(super) fn sheet(name: &str, height: i32, draw: impl FnOnce(&Sheet<'_>) -> Drawn) -> String {
    let mut svg = String::new();
    let outcome = {
        let area = SVGBackend::with_string(&mut svg, (WIDTH as u32, height.max(1) as u32)).into_drawing_area();
        let sheet = Sheet { area };
        sheet
            .rectangle((0, 0), (WIDTH, height), palette::PAPER)
            .and_then(|()| draw(&sheet))
            .and_then(|()| sheet.finish())
    };
    let label = |text: &str| maud::html! { (text) }.into_string();
    match outcome {
        Ok(()) => svg.replacen("<svg ", &format!("<svg role=\"img\" aria-label=\"{}\" ", label(name)), 1),
        Err(reason) => format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} 60\"><text x=\"8\" y=\"40\">{}</text></svg>",
            label(&format!("{name} could not be drawn: {reason}"))
        ),
    }
}

/// The sheet being drawn on.
pub(super) struct Sheet<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

/// The shape of a marker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Marker {
    Disc,
    Square,
    Triangle,
    Diamond,
    Wedge,
    Left,
    Right,
    Star,
    Hourglass,
    Bar,
    Cross,
}

impl Sheet<'_> {
    /// A line through points.
    pub fn line(&self, points: Vec<Point>, colour: Colour, width: u32) -> Drawn {
        Ok(self.area.draw(&PathElement::new(points, rgb(colour).stroke_width(width)))?)
    }

    /// A dashed line.
    pub fn dashed(&self, points: Vec<Point>, colour: Colour, width: u32) -> Drawn {
        let style = rgb(colour).stroke_width(width);
        Ok(self.area.draw(&DashedPathElement::new(points, 12, 9, style))?)
    }

    /// A filled rectangle between two corners.
    pub fn rectangle(&self, a: Point, b: Point, colour: Colour) -> Drawn {
        Ok(self.area.draw(&Rectangle::new([a, b], rgb(colour).filled()))?)
    }

    /// A marker.
    pub fn marker(&self, at: Point, marker: Marker, colour: Colour) -> Drawn {
        match marker {
            Marker::Disc => Ok(self.area.draw(&Circle::new(at, 6, rgb(colour).filled()))?),
            Marker::Cross => {
                let (x, y) = at;
                self.line(vec![(x - 8, y - 8), (x + 8, y + 8)], colour, 4)?;
                self.line(vec![(x - 8, y + 8), (x + 8, y - 8)], colour, 4)
            }
            _ => Ok(self.area.draw(&Polygon::new(corners(marker, at), rgb(colour).filled()))?),
        }
    }

    /// A marker's outline, with paper inside.
    pub fn hollow(&self, at: Point, marker: Marker, colour: Colour) -> Drawn {
        match marker {
            Marker::Cross => self.marker(at, marker, colour),
            Marker::Disc => {
                self.area.draw(&Circle::new(at, 6, rgb(palette::PAPER).filled()))?;
                Ok(self.area.draw(&Circle::new(at, 6, rgb(colour).stroke_width(3)))?)
            }
            _ => {
                let mut outline = corners(marker, at);
                self.area.draw(&Polygon::new(outline.clone(), rgb(palette::PAPER).filled()))?;
                outline.extend(outline.first().copied());
                self.line(outline, colour, 3)
            }
        }
    }

    /// Text whose middle line is at the point's height.
    pub fn text(&self, text: &str, at: Point, align: Align, colour: Colour) -> Drawn {
        self.draw_text(text, at, align, colour, FontStyle::Normal, FontTransform::None)
    }

    /// Bold text.
    pub fn heading(&self, text: &str, at: Point) -> Drawn {
        self.draw_text(text, at, HPos::Left, palette::INK, FontStyle::Bold, FontTransform::None)
    }

    /// Text that reads upwards, centred at a point.
    pub fn upright(&self, text: &str, at: Point, colour: Colour) -> Drawn {
        self.draw_text(text, at, HPos::Center, colour, FontStyle::Normal, FontTransform::Rotate270)
    }

    fn draw_text(
        &self,
        text: &str,
        at: Point,
        align: Align,
        colour: Colour,
        style: FontStyle,
        transform: FontTransform,
    ) -> Drawn {
        // plotters divides font sizes by 1.24.
        let font = FontDesc::new(FontFamily::SansSerif, f64::from(TEXT) * 1.24, style).transform(transform);
        let colour = rgb(colour);
        let style = TextStyle::from(font).color(&colour).pos(Pos::new(align, VPos::Center));
        Ok(self.area.draw(&Text::new(text, at, style))?)
    }

    fn finish(&self) -> Drawn {
        Ok(self.area.present()?)
    }
}

/// The corners of a star with five points.
const STAR: [Point; 10] = [(0, -10), (3, -4), (10, -3), (4, 2), (6, 9), (0, 5), (-6, 9), (-4, 2), (-10, -3), (-3, -4)];

/// The corners of a marker that has some.
fn corners(marker: Marker, (x, y): Point) -> Vec<Point> {
    match marker {
        Marker::Square => vec![(x - 6, y - 6), (x + 6, y - 6), (x + 6, y + 6), (x - 6, y + 6)],
        Marker::Triangle => vec![(x - 8, y + 6), (x + 8, y + 6), (x, y - 9)],
        Marker::Wedge => vec![(x - 8, y - 6), (x + 8, y - 6), (x, y + 9)],
        Marker::Diamond => vec![(x, y - 9), (x + 8, y), (x, y + 9), (x - 8, y)],
        Marker::Left => vec![(x + 6, y - 8), (x + 6, y + 8), (x - 9, y)],
        Marker::Right => vec![(x - 6, y - 8), (x - 6, y + 8), (x + 9, y)],
        Marker::Star => STAR.map(|(dx, dy)| (x + dx, y + dy)).to_vec(),
        Marker::Hourglass => vec![(x - 8, y - 8), (x + 8, y - 8), (x - 8, y + 8), (x + 8, y + 8)],
        Marker::Bar => vec![(x - 3, y - 10), (x + 3, y - 10), (x + 3, y + 10), (x - 3, y + 10)],
        Marker::Disc | Marker::Cross => Vec::new(),
    }
}

fn rgb((red, green, blue): Colour) -> RGBColor {
    RGBColor(red, green, blue)
}

/// About how wide a text is in pixels, in one of the wider sans-serif fonts.
pub(super) fn width(text: &str) -> i32 {
    let em = |c: char| match c {
        'i' | 'j' | 'l' | '.' | ',' | ':' | ';' | '|' | '!' | '\'' | ' ' | '\u{a0}' | 'f' | 't' | 'r' | '(' | ')' => {
            0.38
        }
        '⁰'..='⁹' | '¹' | '²' | '³' | '⁻' => 0.42,
        'm' | 'w' | 'M' | 'W' | '→' | '—' | '⅓' | '⅔' | '½' => 0.98,
        c if c.is_uppercase() || "+−=<>≤≥≈∞×∇".contains(c) => 0.8,
        _ => 0.63,
    };
    (f64::from(TEXT) * text.chars().map(em).sum::<f64>()).ceil() as i32
}

/// Breaks a text into lines not wider than `limit` pixels, between words where it can; not at spaces that hold together.
pub(super) fn wrap(text: &str, limit: i32) -> Vec<String> {
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

/// Cuts a text that is wider than `limit` pixels.
pub(super) fn clip(text: &str, limit: i32) -> String {
    let mut clipped = text.to_string();
    while width(&clipped) > limit && clipped.pop().is_some() {}
    if clipped.len() < text.len() {
        clipped.pop();
        clipped.push('…');
    }
    clipped
}
