//! The overview: how much of its bound every check uses, a row per claim.

use super::canvas::{self, Align, Drawn, LINE, Marker, Sheet, WIDTH};
use super::number;
use super::palette;
use crate::verify::{Check, Claim, Results};

/// Height of a claim's row.
const ROW: i32 = 46;
/// Where the rows begin.
const TOP: i32 = 14 + LINE;
/// Width of the claims' names.
const NAMES: i32 = 214;
/// Width of the rails for what has no place on a logarithmic axis: exactly 0 on the left, infinite or NaN on the right.
const RAIL: i32 = 92;
/// Free space between a rail and the axis.
const GAP: i32 = 16;
/// The axis shows this range of decades at most; what lies beyond stands at its end.
const DECADES: (i32, i32) = (-10, 3);

/// Draws `value/bound` of every check on a logarithmic axis: discs left of the bound passed, crosses failed.
pub fn svg(results: &Results) -> String {
    let rows = results.by_claim();
    let height = TOP + ROW * rows.len() as i32 + 96;
    canvas::sheet("The share of its bound that every check uses", height, |sheet| {
        Strip::over(results).draw(sheet, &rows)
    })
}

struct Strip {
    low: i32,
    high: i32,
    left: i32,
    right: i32,
}

impl Strip {
    fn over(results: &Results) -> Self {
        let decades = results.checks.iter().map(|check| check.share().log10()).filter(|decade| decade.is_finite());
        let (low, high) = decades.fold((-1.0_f64, 0.0_f64), |(low, high), decade| (low.min(decade), high.max(decade)));
        let low = (low.floor() as i32).max(DECADES.0);
        let high = (high.ceil() as i32 + 1).min(DECADES.1);
        Self { low, high, left: NAMES + RAIL + GAP, right: WIDTH - RAIL - GAP }
    }

    fn column(&self, share: f64) -> i32 {
        if share.is_nan() || share == f64::INFINITY {
            self.right + GAP + RAIL / 2
        } else if share <= 0.0 {
            self.left - GAP - RAIL / 2
        } else {
            let place = (share.log10() - f64::from(self.low)) / f64::from(self.high - self.low);
            self.left + (place.clamp(0.0, 1.0) * f64::from(self.right - self.left)).round() as i32
        }
    }

    fn draw(&self, sheet: &Sheet<'_>, rows: &[(Claim, Vec<&Check>)]) -> Drawn {
        let bottom = TOP + ROW * rows.len() as i32;
        let bound = self.column(1.0);
        sheet.rectangle((bound, TOP), (WIDTH, bottom), (250, 236, 230))?;
        let step = (self.high - self.low) / 5 + 1;
        for decade in self.low..=self.high {
            let column = self.column(10f64.powi(decade));
            sheet.line(vec![(column, TOP), (column, bottom)], palette::GRID, 1)?;
            if decade % step == 0 {
                sheet.text(&number::power_of_ten(decade), (column, bottom + 24), Align::Center, palette::INK)?;
            }
        }
        sheet.text("0", (self.column(0.0), bottom + 24), Align::Center, palette::INK)?;
        sheet.text("∞ NaN", (self.column(f64::NAN), bottom + 24), Align::Center, palette::INK)?;
        sheet.line(vec![(bound, TOP), (bound, bottom)], palette::INK, 3)?;
        sheet.text("bound", (bound, TOP - LINE / 2), Align::Center, palette::INK)?;
        sheet.text("value / bound", ((self.left + self.right) / 2, bottom + 66), Align::Center, palette::INK)?;
        for (i, (claim, checks)) in rows.iter().enumerate() {
            let row = TOP + ROW * i as i32 + ROW / 2;
            sheet.line(vec![(NAMES, row + ROW / 2), (WIDTH, row + ROW / 2)], palette::GRID, 1)?;
            sheet.text(&claim.id().replace('-', " "), (NAMES - 10, row), Align::Right, palette::INK)?;
            self.draw_checks(sheet, row, checks)?;
        }
        for gap in [self.left - GAP, self.right + GAP] {
            sheet.line(vec![(gap, TOP), (gap, bottom)], palette::PAPER, 6)?;
        }
        Ok(())
    }

    /// The marks of one row, spread a little in height so that equal ones show that they are many.
    fn draw_checks(&self, sheet: &Sheet<'_>, row: i32, checks: &[&Check]) -> Drawn {
        let (passed, failed): (Vec<_>, Vec<_>) = checks.iter().enumerate().partition(|(_, check)| check.passed());
        for (i, check) in passed {
            let at = (self.column(check.share()), row + 5 * (i as i32 * 2 % 5 - 2));
            sheet.hollow(at, Marker::Disc, palette::PASS)?;
        }
        for (i, check) in failed {
            let at = (self.column(check.share()), row + 5 * (i as i32 * 2 % 5 - 2));
            sheet.marker(at, Marker::Cross, palette::FAIL)?;
        }
        Ok(())
    }
}
