//! The overview: how much of its bound every check uses, a row per claim.

use super::canvas::{self, Align, Drawn, LINE, Marker, Point, Sheet, WIDTH};
use super::heading::Heading;
use super::number;
use super::palette;
use crate::verify::{Check, Claim, Results};
use std::collections::BTreeSet;

/// Height of a claim's row.
const ROW: i32 = 46;
/// Width of the claims' names.
const NAMES: i32 = 214;
/// Width of the rails for what has no place on a logarithmic axis: exactly 0 on the left, infinite or NaN on the right.
const RAIL: i32 = 92;
/// Free space between a rail and the axis.
const GAP: i32 = 16;
/// The axis shows this range of decades at most; what lies beyond stands at its end.
const DECADES: (i32, i32) = (-10, 3);

/// Columns of marks lie so far apart, in pixels: there are thousands of checks, and a mark on a mark shows nothing.
const GRAIN: i32 = 6;

/// Draws `value/bound` of every check on a logarithmic axis: discs left of the bound passed, crosses failed. Checks that stand at
/// the same place have one mark.
pub fn svg(results: &Results) -> String {
    let rows = results.by_claim();
    let (title, conclusion) = ("How much of its bound every check uses", conclusion(results));
    let heading = Heading::new(title, &conclusion);
    let strip = Strip::over(results, heading.height() + LINE);
    canvas::sheet(&format!("{title}. {conclusion}"), strip.top + ROW * rows.len() as i32 + 96, |sheet| {
        heading.draw(sheet)?;
        strip.draw(sheet, &rows)
    })
}

/// How many checks passed, and which is nearest to its bound or farthest beyond it.
fn conclusion(results: &Results) -> String {
    let passed = results.checks.len() - results.failed();
    let worst = results
        .checks
        .iter()
        .max_by(|a, b| a.passed().cmp(&b.passed()).reverse().then(a.share().total_cmp(&b.share())));
    let Some(worst) = worst else { return "Nothing was checked.".into() };
    let (share, name) = (number::share(number::pretty, worst.share()), &worst.name);
    match results.failed() {
        0 => format!("All {passed} lie within their bounds; the nearest uses {share} of it: {name}, {}.", worst.scene),
        _ => format!(
            "{passed} of {} lie within their bounds; the worst is at {share} of it: {name}, {}.",
            results.checks.len(),
            worst.scene
        ),
    }
}

struct Strip {
    top: i32,
    low: i32,
    high: i32,
    left: i32,
    right: i32,
}

impl Strip {
    fn over(results: &Results, top: i32) -> Self {
        let decades = results.checks.iter().map(|check| check.share().log10()).filter(|decade| decade.is_finite());
        let (low, high) = decades.fold((-1.0_f64, 0.0_f64), |(low, high), decade| (low.min(decade), high.max(decade)));
        let low = (low.floor() as i32).max(DECADES.0);
        let high = (high.ceil() as i32 + 1).min(DECADES.1);
        Self { top, low, high, left: NAMES + RAIL + GAP, right: WIDTH - RAIL - GAP }
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
        let bottom = self.top + ROW * rows.len() as i32;
        let bound = self.column(1.0);
        sheet.rectangle((bound, self.top), (WIDTH, bottom), (250, 236, 230))?;
        let step = (self.high - self.low) / 5 + 1;
        for decade in self.low..=self.high {
            let column = self.column(10f64.powi(decade));
            sheet.line(vec![(column, self.top), (column, bottom)], palette::GRID, 1)?;
            if decade % step == 0 {
                sheet.text(&number::power_of_ten(decade), (column, bottom + 24), Align::Center, palette::INK)?;
            }
        }
        sheet.text("0", (self.column(0.0), bottom + 24), Align::Center, palette::INK)?;
        sheet.text("∞ NaN", (self.column(f64::NAN), bottom + 24), Align::Center, palette::INK)?;
        sheet.line(vec![(bound, self.top), (bound, bottom)], palette::INK, 3)?;
        sheet.text("bound", (bound, self.top - LINE / 2), Align::Center, palette::INK)?;
        sheet.text("value / bound", ((self.left + self.right) / 2, bottom + 66), Align::Center, palette::INK)?;
        for (i, (claim, checks)) in rows.iter().enumerate() {
            let row = self.top + ROW * i as i32 + ROW / 2;
            sheet.line(vec![(NAMES, row + ROW / 2), (WIDTH, row + ROW / 2)], palette::GRID, 1)?;
            sheet.text(&claim.id().replace('-', " "), (NAMES - 10, row), Align::Right, palette::INK)?;
            self.draw_checks(sheet, row, checks)?;
        }
        for gap in [self.left - GAP, self.right + GAP] {
            sheet.line(vec![(gap, self.top), (gap, bottom)], palette::PAPER, 6)?;
        }
        Ok(())
    }

    /// The marks of one row, spread a little in height so that equal ones show that they are many.
    fn draw_checks(&self, sheet: &Sheet<'_>, row: i32, checks: &[&Check]) -> Drawn {
        let place = |(i, check): (usize, &&Check)| {
            let column = (self.column(check.share()) + GRAIN / 2).div_euclid(GRAIN) * GRAIN;
            (column, row + 5 * (i as i32 * 2 % 5 - 2))
        };
        let places = |passed: bool| -> BTreeSet<Point> {
            checks.iter().enumerate().filter(|(_, check)| check.passed() == passed).map(place).collect()
        };
        for at in places(true) {
            sheet.hollow(at, Marker::Disc, palette::PASS)?;
        }
        for at in places(false) {
            sheet.marker(at, Marker::Cross, palette::FAIL)?;
        }
        Ok(())
    }
}
