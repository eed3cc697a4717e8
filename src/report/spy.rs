//! Sparsity patterns as SVG.

use super::sheet::{GRID, INK, LINE, SERIES, Sheet, WIDTH};
use crate::figure::Spy;
use std::fmt::Write;

/// Shades of cells, from nearly empty to full.
const SHADES: [f64; 5] = [0.25, 0.4, 0.6, 0.8, 1.0];

/// Draws a pattern as one SVG element, 800 pixels wide: the lower triangle, stronger where more entries are not zero.
pub fn svg(spy: &Spy) -> String {
    let (mut sheet, top) = Sheet::new(&spy.title, &spy.conclusion);
    let (side, top) = (720.0, top + 10.0);
    let (left, cell) = (0.5 * (WIDTH - side), side / spy.cells.max(1) as f64);
    sheet.element(
        "rect",
        format_args!(
            r#"x="{left}" y="{top}" width="{side}" height="{side}" fill="none" stroke="{GRID}" stroke-width="2""#
        ),
    );
    let mut paths = SHADES.map(|_| String::new());
    for row in 0..spy.cells {
        for column in 0..=row {
            let share = spy.share(row, column);
            if share > 0.0 {
                let shade = SHADES.iter().position(|&limit| share.sqrt() <= limit).unwrap_or(SHADES.len() - 1);
                let (x, y) = (left + cell * column as f64, top + cell * row as f64);
                let _ = write!(paths[shade], "M{x:.1} {y:.1}h{cell:.2}v{cell:.2}h-{cell:.2}z");
            }
        }
    }
    for (path, shade) in paths.iter().zip(SHADES).filter(|(path, _)| !path.is_empty()) {
        sheet.element("path", format_args!(r#"d="{path}" fill="{}" fill-opacity="{shade}""#, SERIES[0]));
    }
    let bottom = top + side;
    sheet.text("the lower triangle; stronger where more is filled", [16.0, bottom + 25.0], "start", INK);
    sheet.finish(&format!("{}. {}", spy.title, spy.conclusion), bottom + 24.0 + LINE)
}
