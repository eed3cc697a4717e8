//! Sparsity patterns as SVG.

use super::canvas::{LINE, TEXT, WIDTH};
use super::heading::Heading;
use super::palette::{self, css};
use crate::figure::Spy;
use maud::html;
use std::fmt::Write;

/// Shades of cells, from nearly empty to full.
const SHADES: [f64; 5] = [0.25, 0.4, 0.6, 0.8, 1.0];

/// Side of the square in pixels.
const SIDE: f64 = 720.0;

/// Draws a pattern as one SVG element, 800 pixels wide: the lower triangle, stronger where more entries are not zero.
pub fn svg(spy: &Spy) -> String {
    let heading = Heading::new(&spy.title, &spy.conclusion);
    // The frame keeps clear of the letters above it.
    let top = heading.height() + 10;
    let left = 0.5 * (f64::from(WIDTH) - SIDE);
    let cell = SIDE / spy.cells.max(1) as f64;
    let mut paths = vec![String::new(); SHADES.len()];
    for row in 0..spy.cells {
        for column in 0..=row {
            let share = spy.share(row, column);
            if share > 0.0 {
                let shade = SHADES.iter().position(|&limit| share.sqrt() <= limit).unwrap_or(SHADES.len() - 1);
                let (x, y) = (left + cell * column as f64, f64::from(top) + cell * row as f64);
                let _ = write!(paths[shade], "M{x:.1} {y:.1}h{cell:.2}v{cell:.2}h-{cell:.2}z");
            }
        }
    }
    let note = "the lower triangle; stronger where more is filled";
    let alt = format!("{}. {}", spy.title, spy.conclusion);
    let height = top + SIDE as i32 + 24 + LINE;
    let markup = html! {
        svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(alt)
            viewBox=(format!("0 0 {WIDTH} {height}")) width=(WIDTH) height=(height)
            font-family="sans-serif" font-size=(TEXT) fill=(css(palette::INK)) {
            rect width=(WIDTH) height=(height) fill=(css(palette::PAPER)) {}
            (heading.markup())
            rect x=(left) y=(top) width=(SIDE) height=(SIDE) fill="none" stroke=(css(palette::GRID)) stroke-width="2" {}
            @for (path, shade) in paths.iter().zip(SHADES).filter(|(path, _)| !path.is_empty()) {
                path d=(path) fill=(css(palette::SERIES[0])) fill-opacity=(shade) {}
            }
            text x="16" y=(top + SIDE as i32 + LINE) { (note) }
        }
    };
    markup.into_string()
}
