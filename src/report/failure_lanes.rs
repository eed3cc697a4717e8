//! Rails: where failures stand that have no place on an axis, with a lane for every cause.

use super::axis::Ruler;
use super::canvas::{self, Align, Drawn, Sheet};
use super::palette::{self, Colour};
use crate::figure::{Mark, Plot, Series};

/// Width of a lane: half of it for the name, half for the crosses, so that neither covers the other.
const LANE: i32 = 2 * HALF;
const HALF: i32 = 34;
/// The ground of rails.
const GROUND: Colour = (250, 236, 230);

/// The causes of failures on the rail along the upper edge, from the top, and on the one along the right edge, from the left.
pub(super) struct Rails<'a> {
    above: Vec<&'a str>,
    aside: Vec<&'a str>,
}

/// Whether a point stands on a rail: a failure without a place of its own on an axis.
pub(super) fn is_railed(series: &Series, place: Option<f64>) -> bool {
    series.mark == Mark::Cross && place.is_none()
}

impl<'a> Rails<'a> {
    pub fn of(plot: &'a Plot, x: &Ruler, y: &Ruler) -> Self {
        let causes = |stands: &dyn Fn(&Series, &(f64, f64)) -> bool| {
            let mut causes: Vec<&str> = Vec::new();
            for series in plot.series.iter().filter(|series| series.points.iter().any(|point| stands(series, point))) {
                if !causes.contains(&series.name.as_str()) {
                    causes.push(&series.name);
                }
            }
            causes
        };
        Self {
            above: causes(&|series, p| x.place(p.0).is_some() && is_railed(series, y.place(p.1))),
            aside: causes(&|series, p| is_railed(series, x.place(p.0)) && y.place(p.1).is_some()),
        }
    }

    /// Height of the rail along the upper edge.
    pub fn height(&self) -> i32 {
        LANE * self.above.len() as i32
    }

    /// Width of the rail along the right edge.
    pub fn width(&self) -> i32 {
        LANE * self.aside.len() as i32
    }

    /// How far below the upper edge failures of a series stand.
    pub fn below_the_top(&self, index: usize, series: &Series) -> Option<i32> {
        place(&self.above, &series.name).map(|middle| middle + aside(index))
    }

    /// How far right of the rail's left edge failures of a series stand.
    pub fn right_of_the_plot(&self, index: usize, series: &Series) -> Option<i32> {
        place(&self.aside, &series.name).map(|middle| middle + aside(index))
    }

    /// Draws the grounds and names the lanes. The plot lies between the corners `(left, top)` and `(right, bottom)`, both rails
    /// included.
    pub fn draw(&self, sheet: &Sheet<'_>, [left, top, right, bottom]: [i32; 4]) -> Drawn {
        let (ceiling, edge) = (top + self.height(), right - self.width());
        if !self.above.is_empty() {
            sheet.rectangle((left, top), (right, ceiling), GROUND)?;
        }
        if !self.aside.is_empty() {
            sheet.rectangle((edge, ceiling), (right, bottom), GROUND)?;
        }
        for (lane, cause) in (0..).zip(&self.above) {
            let (text, row) = (canvas::clip(cause, right - left - 16), top + LANE * lane);
            sheet.text(&text, (left + 8, row + HALF / 2), Align::Left, palette::FAIL)?;
            sheet.line(vec![(left, row), (right, row)], palette::PAPER, 3)?;
        }
        for (lane, cause) in (0..).zip(&self.aside) {
            let (text, column) = (canvas::clip(cause, bottom - ceiling - 16), edge + LANE * lane);
            let middle = bottom - 8 - canvas::width(&text) / 2;
            sheet.upright(&text, (column + HALF / 2, middle.max((ceiling + bottom) / 2)), palette::FAIL)?;
            sheet.line(vec![(column, ceiling), (column, bottom)], palette::PAPER, 3)?;
        }
        Ok(())
    }
}

/// Where crosses of a cause stand, from the beginning of the rail.
fn place(causes: &[&str], cause: &str) -> Option<i32> {
    let lane = causes.iter().position(|other| *other == cause)?;
    Some(LANE * lane as i32 + HALF + HALF / 2)
}

/// Crosses of different series keep a little apart: they may stand at the same place.
fn aside(index: usize) -> i32 {
    (index % 3) as i32 * 8 - 8
}
