//! The overview of a verification: how much of its bound every check uses, a row per claim.

use super::number;
use super::sheet::{CROSS, DISC, FAIL, FAIL_GROUND, GRID, INK, LINE, PAPER, SERIES, Sheet, WIDTH};
use crate::verify::{Check, Results};
use std::collections::BTreeSet;

/// Height of a claim's row.
const ROW: f64 = 46.0;
/// Width of the claims' names.
const NAMES: f64 = 214.0;
/// The ends of the axis: beside it are strips for shares of exactly 0 and for those that are infinite or NaN.
const LEFT: f64 = NAMES + STRIP;
const RIGHT: f64 = WIDTH - STRIP;
const STRIP: f64 = 108.0;

/// Draws `value/bound` of every check on a logarithmic axis: discs left of the bound passed, crosses failed. Checks that stand at
/// the same place have one mark.
pub fn svg(results: &Results) -> String {
    let rows = results.by_claim();
    let (title, conclusion) = ("How much of its bound every check uses", conclusion(results));
    let (mut sheet, heading) = Sheet::new(title, &conclusion);
    let top = heading + LINE;
    let bottom = top + ROW * rows.len() as f64;
    let axis = Axis::of(results);
    let bound = axis.column(1.0);
    sheet.rectangle([bound, top], [WIDTH, bottom], FAIL_GROUND);
    let step = (axis.high - axis.low) / 5 + 1;
    for decade in axis.low..=axis.high {
        let column = axis.column(10f64.powi(decade));
        sheet.line(&[[column, top], [column, bottom]], GRID, 1.0);
        if decade % step == 0 {
            sheet.text(&number::power_of_ten(decade), [column, bottom + 24.0], "middle", INK);
        }
    }
    for (share, label) in [(0.0, "0"), (f64::NAN, "∞ NaN")] {
        sheet.text(label, [axis.column(share), bottom + 24.0], "middle", INK);
    }
    sheet.line(&[[bound, top], [bound, bottom]], INK, 3.0);
    sheet.text("bound", [bound, top - 0.5 * LINE], "middle", INK);
    sheet.text("value / bound", [0.5 * (LEFT + RIGHT), bottom + 66.0], "middle", INK);
    for (i, (claim, checks)) in rows.iter().enumerate() {
        let middle = top + ROW * (i as f64 + 0.5);
        sheet.line(&[[NAMES, middle + 0.5 * ROW], [WIDTH, middle + 0.5 * ROW]], GRID, 1.0);
        sheet.text(&claim.id().replace('-', " "), [NAMES - 10.0, middle], "end", INK);
        draw_checks(&mut sheet, &axis, middle, checks);
    }
    for gap in [LEFT - 16.0, RIGHT + 16.0] {
        sheet.line(&[[gap, top], [gap, bottom]], PAPER, 6.0);
    }
    sheet.finish(&format!("{title}. {conclusion}"), bottom + 96.0)
}

/// The number of checks that passed, and which is nearest to its bound or farthest beyond it.
fn conclusion(results: &Results) -> String {
    let (all, failed) = (results.checks.len(), results.failed());
    let by_severity = |a: &&Check, b: &&Check| b.passed().cmp(&a.passed()).then(a.share().total_cmp(&b.share()));
    let Some(worst) = results.checks.iter().max_by(by_severity) else { return "Nothing was checked.".into() };
    let (share, name) = (number::share(number::pretty, worst.share()), format!("{}, {}", worst.name, worst.scene));
    match failed {
        0 => format!("All {all} lie within their bounds; the nearest uses {share} of it: {name}."),
        _ => format!("{} of {all} lie within their bounds; the worst is at {share} of it: {name}.", all - failed),
    }
}

/// The logarithmic axis, in decades; what lies beyond stands at its ends.
struct Axis {
    low: i32,
    high: i32,
}

impl Axis {
    fn of(results: &Results) -> Self {
        let decades = results.checks.iter().map(|check| check.share().log10()).filter(|decade| decade.is_finite());
        let (low, high) = decades.fold((-1.0_f64, 0.0_f64), |(low, high), decade| (low.min(decade), high.max(decade)));
        Self { low: (low.floor() as i32).max(-10), high: (high.ceil() as i32 + 1).min(3) }
    }

    fn column(&self, share: f64) -> f64 {
        let place = (share.log10() - f64::from(self.low)) / f64::from(self.high - self.low);
        match share {
            _ if share.is_nan() || share == f64::INFINITY => WIDTH - 46.0,
            ..=0.0 => NAMES + 46.0,
            _ => LEFT + place.clamp(0.0, 1.0) * (RIGHT - LEFT),
        }
    }
}

/// The marks of one row, spread a little in height so that equal ones show that they are many, and in columns of six pixels: of thousands of
/// checks a mark on a mark shows nothing.
fn draw_checks(sheet: &mut Sheet, axis: &Axis, middle: f64, checks: &[&Check]) {
    let place = |(i, check): (usize, &&Check)| ((axis.column(check.share()) / 6.0).round() as i32, i * 2 % 5);
    for (passed, shape, colour) in [(true, DISC, SERIES[0]), (false, CROSS, FAIL)] {
        let all = checks.iter().enumerate().filter(|(_, check)| check.passed() == passed);
        for (column, level) in all.map(place).collect::<BTreeSet<_>>() {
            let at = [6.0 * f64::from(column), middle + 5.0 * level as f64 - 10.0];
            sheet.marker(at, shape, colour, true);
        }
    }
}
