//! Fields of classified cells as SVG.

use super::axis::{Field, ScaledAxis};
use super::sheet::{CLASSES, Colour, INK, PAPER, Point, Sample, Sheet};
use crate::figure::Tiles;
use std::collections::BTreeSet;

/// Draws a field as one SVG element, 800 pixels wide, that can stand in a page or alone in a file. The legend names the classes that occur.
pub fn svg(tiles: &Tiles) -> String {
    let [columns, rows] = [&tiles.columns, &tiles.rows].map(|centres| edges(centres));
    let x = ScaledAxis::new(tiles.x.scale, columns.iter().copied(), &[], 0.0);
    let y = ScaledAxis::new(tiles.y.scale, rows.iter().copied(), &[], 0.0);
    let mut field = Field::new([&tiles.x, &tiles.y], [x, y], 420.0, 0.0);
    let (mut sheet, top) = Sheet::new(&tiles.title, &tiles.conclusion);
    field.move_down(sheet.legend(top, legend(tiles)));
    draw_cells(&mut sheet, &field, tiles, [&columns, &rows]);
    draw_curves(&mut sheet, &field, tiles);
    field.draw_axes(&mut sheet);
    sheet.finish(&format!("{}. {}", tiles.title, tiles.conclusion), field.bottom + Field::BELOW)
}

fn legend(tiles: &Tiles) -> Vec<(String, Sample<'_>)> {
    let mut entries: Vec<(String, Sample<'_>)> = Vec::new();
    let present: BTreeSet<usize> = tiles.cells.iter().flatten().copied().collect();
    for class in present {
        let swatch =
            move |sheet: &mut Sheet, [x, y]: Point| sheet.rectangle([x, y - 12.0], [x + 40.0, y + 12.0], colour(class));
        entries.push((tiles.classes.get(class).cloned().unwrap_or_default(), Box::new(swatch)));
    }
    for curve in tiles.curves.iter().filter(|curve| !curve.points.is_empty()) {
        let line = |sheet: &mut Sheet, [x, y]: Point| sheet.line(&[[x, y], [x + 40.0, y]], INK, 4.0);
        entries.push((curve.name.clone(), Box::new(line)));
    }
    entries
}

fn draw_cells(sheet: &mut Sheet, field: &Field<'_>, tiles: &Tiles, [columns, rows]: [&[f64]; 2]) {
    for (cells, span) in tiles.cells.iter().zip(rows.windows(2)) {
        // Neighbours of one class are one rectangle.
        let mut from = 0;
        for run in cells.chunk_by(|a, b| a == b) {
            let to = from + run.len();
            let corner = |column: usize, y: f64| field.point((*columns.get(column)?, y));
            if let (Some([left, top]), Some([right, bottom])) = (corner(from, span[1]), corner(to, span[0])) {
                // Half a pixel of overlap: browsers let the paper shine through where edges only touch.
                sheet.rectangle([left, top], [right + 0.5, bottom + 0.5], colour(run[0]));
            }
            from = to;
        }
    }
}

fn draw_curves(sheet: &mut Sheet, field: &Field<'_>, tiles: &Tiles) {
    let (first, last) = (tiles.columns.first(), tiles.columns.last());
    let inside = |x: f64| first.is_some_and(|first| x >= *first) && last.is_some_and(|last| x <= *last);
    for curve in &tiles.curves {
        let place = |&point: &(f64, f64)| if inside(point.0) { field.point(point) } else { None };
        let points: Vec<Option<Point>> = curve.points.iter().map(place).collect();
        for piece in points.split(Option::is_none).filter(|piece| piece.len() > 1) {
            let points: Vec<Point> = piece.iter().copied().flatten().collect();
            sheet.line(&points, PAPER, 8.0);
            sheet.line(&points, INK, 4.0);
        }
    }
}

/// The edges of cells with equal ratios around their centres, one more than these.
fn edges(centres: &[f64]) -> Vec<f64> {
    let half = match centres {
        [a, b, ..] => (b / a).sqrt(),
        _ => 1.1,
    };
    let first = centres.first().map(|first| first / half);
    first.into_iter().chain(centres.iter().map(|centre| centre * half)).collect()
}

fn colour(class: usize) -> Colour {
    CLASSES[class % CLASSES.len()]
}
