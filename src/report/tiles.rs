//! Fields of classified cells as SVG.

use super::axis::Ruler;
use super::canvas::{self, Align, Drawn, LINE, Sheet, WIDTH};
use super::heading::Heading;
use super::palette;
use crate::figure::Tiles;
use std::collections::BTreeSet;

/// Height of the field in pixels.
const HEIGHT: i32 = 420;
/// Room below it, for tick labels and the title of the axis.
const BELOW: i32 = 96;

/// Draws a field as one SVG element, 800 pixels wide, that can stand in a page or alone in a file. The legend names the
/// classes that occur.
pub fn svg(tiles: &Tiles) -> String {
    let layout = Layout::of(tiles);
    canvas::sheet(&format!("{}. {}", tiles.title, tiles.conclusion), layout.bottom + BELOW, |sheet| layout.draw(sheet))
}

struct Layout<'a> {
    tiles: &'a Tiles,
    x: Ruler,
    y: Ruler,
    heading: Heading,
    legend: Vec<(Option<usize>, String, (i32, i32))>,
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
}

impl<'a> Layout<'a> {
    fn of(tiles: &'a Tiles) -> Self {
        let x = Ruler::between(tiles.x.scale, edges(&tiles.columns).into_iter());
        let y = Ruler::between(tiles.y.scale, edges(&tiles.rows).into_iter());
        let labels = y.ticks.iter().map(|(_, label)| canvas::width(label)).max().unwrap_or(0);
        let heading = Heading::new(&tiles.title, &tiles.conclusion);
        let mut top = heading.height();
        let present: BTreeSet<usize> = tiles.cells.iter().flatten().copied().collect();
        let classes = present.iter().filter_map(|&class| Some((Some(class), tiles.classes.get(class)?.clone())));
        let curves = tiles.curves.iter().filter(|curve| !curve.points.is_empty());
        let curves = curves.map(|curve| (None, curve.name.clone()));
        let mut at = (16, top + LINE / 2);
        let mut legend = Vec::new();
        for (class, text) in classes.chain(curves) {
            let wide = 50 + canvas::width(&text) + 24;
            if at.0 > 16 && at.0 + wide > WIDTH {
                at = (16, at.1 + LINE);
            }
            legend.push((class, text, at));
            at.0 += wide;
        }
        if !legend.is_empty() {
            top = at.1 + LINE / 2 + 12;
        }
        Self { tiles, x, y, heading, legend, left: labels + LINE + 34, right: WIDTH - 18, top, bottom: top + HEIGHT }
    }

    fn column(&self, x: f64) -> Option<i32> {
        let place = self.x.place(x)?;
        Some(self.left + (place * f64::from(self.right - self.left)).round() as i32)
    }

    fn row(&self, y: f64) -> Option<i32> {
        let place = self.y.place(y)?;
        Some(self.bottom - (place * f64::from(self.bottom - self.top)).round() as i32)
    }

    fn draw(&self, sheet: &Sheet<'_>) -> Drawn {
        self.heading.draw(sheet)?;
        self.draw_cells(sheet)?;
        self.draw_curves(sheet)?;
        self.draw_axes(sheet)?;
        for (class, text, (x, y)) in &self.legend {
            match class {
                Some(class) => sheet.rectangle((*x, y - 12), (x + 40, y + 12), colour(*class))?,
                None => sheet.line(vec![(*x, *y), (x + 40, *y)], palette::INK, 4)?,
            }
            sheet.text(text, (x + 50, *y), Align::Left, palette::INK)?;
        }
        Ok(())
    }

    fn draw_cells(&self, sheet: &Sheet<'_>) -> Drawn {
        let columns: Vec<Option<i32>> = edges(&self.tiles.columns).into_iter().map(|x| self.column(x)).collect();
        let rows: Vec<Option<i32>> = edges(&self.tiles.rows).into_iter().map(|y| self.row(y)).collect();
        for (cells, span) in self.tiles.cells.iter().zip(rows.windows(2)) {
            let [Some(low), Some(high)] = *span else { continue };
            // Neighbours of one class are one rectangle.
            let mut from = 0;
            for run in cells.chunk_by(|a, b| a == b) {
                let to = from + run.len();
                let ends = (columns.get(from).copied().flatten(), columns.get(to).copied().flatten());
                if let ((Some(left), Some(right)), Some(&class)) = (ends, run.first()) {
                    // One pixel of overlap: browsers let the paper shine through where edges only touch.
                    sheet.rectangle((left, high), (right + 1, low + 1), colour(class))?;
                }
                from = to;
            }
        }
        Ok(())
    }

    fn draw_curves(&self, sheet: &Sheet<'_>) -> Drawn {
        let (first, last) = (self.tiles.columns.first(), self.tiles.columns.last());
        let inside = |x: f64| first.is_some_and(|first| x >= *first) && last.is_some_and(|last| x <= *last);
        for curve in &self.tiles.curves {
            let place = |&(x, y): &(f64, f64)| if inside(x) { self.column(x).zip(self.row(y)) } else { None };
            let points: Vec<Option<(i32, i32)>> = curve.points.iter().map(place).collect();
            for piece in points.split(Option::is_none).filter(|piece| piece.len() > 1) {
                let points: Vec<_> = piece.iter().copied().flatten().collect();
                sheet.line(points.clone(), palette::PAPER, 8)?;
                sheet.line(points, palette::INK, 4)?;
            }
        }
        Ok(())
    }

    fn draw_axes(&self, sheet: &Sheet<'_>) -> Drawn {
        let (left, right, top, bottom) = (self.left, self.right, self.top, self.bottom);
        sheet.line(vec![(left, top), (left, bottom), (right, bottom)], palette::INK, 2)?;
        let across = |place: f64| left + (place * f64::from(right - left)).round() as i32;
        let up = |place: f64| bottom - (place * f64::from(bottom - top)).round() as i32;
        for (place, label) in &self.x.ticks {
            sheet.line(vec![(across(*place), bottom), (across(*place), bottom + 8)], palette::INK, 2)?;
            sheet.text(label, (across(*place), bottom + 28), Align::Center, palette::INK)?;
        }
        for (place, label) in &self.y.ticks {
            sheet.line(vec![(left - 6, up(*place)), (left, up(*place))], palette::INK, 2)?;
            sheet.text(label, (left - 12, up(*place)), Align::Right, palette::INK)?;
        }
        let title = canvas::clip(&self.tiles.x.title, WIDTH - 32);
        sheet.text(&title, ((left + right) / 2, bottom + 68), Align::Center, palette::INK)?;
        sheet.upright(&canvas::clip(&self.tiles.y.title, HEIGHT), (22, (top + bottom) / 2), palette::INK)
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

fn colour(class: usize) -> palette::Colour {
    palette::CLASSES[class % palette::CLASSES.len()]
}
