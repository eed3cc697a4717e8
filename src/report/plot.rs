//! Plots as SVG.

use super::axis::{Field, ScaledAxis};
use super::number;
use super::sheet::{
    CROSS, Colour, FAIL, FAIL_GROUND, INK, LINE, MUTED, PAPER, Point, SERIES, SHAPES, Sample, Sheet, clip, width,
};
use crate::figure::{Guide, Look, Mark, Plot, Scale, Series};

/// Free space at both ends of an axis, as a part of its length.
const MARGIN: f64 = 0.035;
/// Width of a failure lane: half of it for the name of the cause, half for the crosses.
const LANE: f64 = 68.0;
/// Height of the strip for the letters of vertical guides.
const STRIP: f64 = 30.0;

/// Draws a plot as one SVG element, 800 pixels wide, that can stand in a page or alone in a file.
///
/// Points without a place on the axes (NaN, infinity, on a logarithmic axis zero or less) are left out and counted in the legend; those of
/// [`Mark::Cross`] stand in a lane for their cause instead: along the upper edge where y has no place, along the right edge where only x has none.
/// Vertical guides have letters above the plot that the legend explains; guides far beside the points are named there only.
pub fn svg(plot: &Plot) -> String {
    let mut layout = Layout::of(plot);
    let (mut sheet, heading) = Sheet::new(&plot.title, &plot.conclusion);
    let legend = sheet.legend(heading, layout.legend());
    let strip = if layout.verticals().next().is_some() { STRIP } else { 0.0 };
    let ceiling = legend + strip;
    layout.field.move_down(ceiling + layout.rail(0));
    layout.draw(&mut sheet, ceiling);
    sheet.finish(&alt(plot), layout.field.bottom + Field::BELOW)
}

fn alt(plot: &Plot) -> String {
    let Plot { title, conclusion, x, y, series, .. } = plot;
    let mut names: Vec<&str> = series.iter().map(|series| series.name.as_str()).collect();
    names.retain(|name| !name.is_empty());
    names.dedup();
    let shown = format!("{title}. {} over {}: {}", y.title, x.title, names.join(", "));
    if conclusion.is_empty() { shown } else { format!("{shown}. {conclusion}") }
}

struct Layout<'a> {
    plot: &'a Plot,
    field: Field<'a>,
    /// The causes of failures without a place on the vertical axis, and without one on the horizontal axis.
    lanes: [Vec<&'a str>; 2],
}

impl<'a> Layout<'a> {
    fn of(plot: &'a Plot) -> Self {
        let (mut levels, mut verticals) = (Vec::new(), Vec::new());
        for guide in &plot.guides {
            match *guide {
                Guide::Level { y, .. } => levels.push(y),
                Guide::Vertical { x, .. } => verticals.push(x),
                Guide::Slope { .. } => {}
            }
        }
        let points = || plot.series.iter().flat_map(|series| &series.points);
        let x = ScaledAxis::new(plot.x.scale, points().map(|p| p.0), &verticals, MARGIN);
        let y = ScaledAxis::new(plot.y.scale, points().map(|p| p.1), &levels, MARGIN);
        let mut lanes = [Vec::new(), Vec::new()];
        for series in plot.series.iter().filter(|series| series.mark == Mark::Cross) {
            for point in &series.points {
                let lane = match (x.place(point.0), y.place(point.1)) {
                    (Some(_), None) => &mut lanes[0],
                    (None, Some(_)) => &mut lanes[1],
                    _ => continue,
                };
                if !lane.contains(&series.name.as_str()) {
                    lane.push(&series.name);
                }
            }
        }
        let right = LANE * lanes[1].len() as f64;
        Self { plot, field: Field::new([&plot.x, &plot.y], [x, y], 500.0, right), lanes }
    }

    fn rail(&self, side: usize) -> f64 {
        LANE * self.lanes[side].len() as f64
    }

    /// The place of a point of a series: on the field, or in the lane of its cause.
    fn point(&self, index: usize, series: &Series, (x, y): (f64, f64)) -> Option<Point> {
        let field = &self.field;
        // Crosses of different series keep a little apart: they may stand at the same place.
        let apart = (index % 3) as f64 * 8.0 - 8.0;
        let lane = |side: usize| {
            let lane = self.lanes[side].iter().position(|cause| *cause == series.name)?;
            Some(LANE * (lane as f64 + 0.75) + apart)
        };
        match (field.x.place(x), field.y.place(y)) {
            (Some(x), Some(y)) => Some([field.column(x), field.row(y)]),
            _ if series.mark != Mark::Cross => None,
            (Some(x), None) => Some([field.column(x), field.top - self.rail(0) + lane(0)?]),
            (None, Some(y)) => Some([field.right + lane(1)?, field.row(y)]),
            (None, None) => None,
        }
    }

    fn verticals(&self) -> impl Iterator<Item = (f64, char)> {
        let column = |guide: &Guide| match guide {
            Guide::Vertical { x, .. } => self.field.x.inside(*x).map(|place| self.field.column(place)),
            Guide::Level { .. } | Guide::Slope { .. } => None,
        };
        self.plot.guides.iter().filter_map(column).zip('a'..='z')
    }

    fn legend(&self) -> Vec<(String, Sample<'_>)> {
        let mut entries: Vec<(String, Sample<'_>)> = Vec::new();
        let mut coloured = false;
        for (index, series) in self.plot.series.iter().enumerate() {
            let missing = series.points.iter().filter(|&&point| self.point(index, series, point).is_none()).count();
            if series.mark == Mark::Cross && series.like.is_some() {
                coloured = true;
                // The lanes name the causes of failures, and colours the series that they belong to.
                if missing == 0 {
                    continue;
                }
            }
            let mut name = series.name.clone();
            if let Some(slope) = series.slope {
                name += &format!(", measured slope {slope:.2}").replace('-', "−");
            }
            if missing > 0 {
                name += &format!(" ({} without a place on the axes)", number::count(missing, "point"));
            }
            let (colour, shape, hollow) = self.look(index, series);
            let sample = move |sheet: &mut Sheet, [x, y]: Point| {
                if series.mark == Mark::Line {
                    sheet.line(&[[x, y], [x + 40.0, y]], colour, 3.0);
                }
                sheet.marker([x + 20.0, y], shape, colour, hollow);
            };
            entries.push((name, Box::new(sample)));
        }
        if coloured {
            let cross = |sheet: &mut Sheet, [x, y]: Point| sheet.marker([x + 20.0, y], CROSS, INK, true);
            entries.push(("failed, in the colour of its method".into(), Box::new(cross)));
        }
        let mut letters = self.verticals().map(|(_, letter)| letter);
        for guide in &self.plot.guides {
            let (text, axis, value, [before, beyond]) = match guide {
                Guide::Level { y, label } => {
                    (format!("{label}: {}", number::pretty(*y)), &self.field.y, *y, ["below", "above"])
                }
                Guide::Vertical { x, label } => (label.clone(), &self.field.x, *x, ["left of", "right of"]),
                Guide::Slope { .. } => continue,
            };
            if axis.inside(value).is_none() {
                let side = if axis.place(value).is_some_and(|place| place < 0.0) { before } else { beyond };
                let arrow = |sheet: &mut Sheet, [x, y]: Point| sheet.text("→", [x + 8.0, y], "start", INK);
                entries.push((format!("{text}, {side} the picture"), Box::new(arrow)));
                continue;
            }
            let letter = if matches!(guide, Guide::Vertical { .. }) { letters.next() } else { None };
            let sample = move |sheet: &mut Sheet, [x, y]: Point| match letter {
                Some(letter) => {
                    sheet.dashed(&[[x + 14.0, y - 12.0], [x + 14.0, y + 12.0]], INK, 2.0);
                    sheet.text(&letter.to_string(), [x + 22.0, y], "start", INK);
                }
                None => sheet.dashed(&[[x, y], [x + 40.0, y]], INK, 3.0),
            };
            entries.push((text, Box::new(sample)));
        }
        entries
    }

    fn draw(&self, sheet: &mut Sheet, ceiling: f64) {
        let Field { left, right, top, bottom, .. } = self.field;
        self.draw_lanes(sheet, ceiling);
        self.field.draw_grid(sheet);
        self.field.draw_axes(sheet);
        for guide in &self.plot.guides {
            if let Guide::Level { y, .. } = guide
                && let Some(row) = self.field.y.inside(*y).map(|place| self.field.row(place))
            {
                sheet.dashed(&[[left, row], [right, row]], INK, 3.0);
            }
        }
        let mut verticals: Vec<(f64, char)> = self.verticals().collect();
        verticals.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut free = f64::NEG_INFINITY;
        for (column, letter) in verticals {
            sheet.dashed(&[[column, bottom], [column, top]], INK, 2.0);
            let at = column.max(free);
            free = at + 24.0;
            sheet.text(&letter.to_string(), [at, ceiling - 0.5 * STRIP], "middle", INK);
        }
        let slopes = self.plot.guides.iter().filter_map(|guide| match *guide {
            Guide::Slope { slope, through } => Some((slope, self.slope_line(slope, through)?)),
            Guide::Level { .. } | Guide::Vertical { .. } => None,
        });
        let slopes: Vec<(f64, [Point; 2])> = slopes.collect();
        for (_, line) in &slopes {
            sheet.dashed(line, MUTED, 2.0);
        }
        for (index, series) in self.plot.series.iter().enumerate() {
            self.draw_series(sheet, index, series);
        }
        // Lines through one point part at their ends: there they are named, on paper of their own.
        for (k, (slope, line)) in slopes.iter().enumerate() {
            let text = format!("slope {}", signed(*slope));
            let ([x, y], step, anchor) = match k % 2 {
                0 => (line[0], 12.0, "start"),
                _ => (line[1], -12.0, "end"),
            };
            let at = [x + step, y.clamp(top + 0.5 * LINE, bottom - 0.5 * LINE)];
            let halo = format_args!(r#"paint-order="stroke" stroke="{PAPER}" stroke-width="8""#);
            sheet.styled_text(&text, at, format_args!(r#"text-anchor="{anchor}" fill="{MUTED}" {halo}"#));
        }
    }

    fn draw_lanes(&self, sheet: &mut Sheet, ceiling: f64) {
        let Field { left, right, top, bottom, .. } = self.field;
        let edge = right + self.rail(1);
        for (lane, cause) in self.lanes[0].iter().enumerate() {
            let row = ceiling + LANE * lane as f64;
            sheet.rectangle([left, row + 2.0], [edge, row + LANE], FAIL_GROUND);
            let text = clip(cause, edge - left - 16.0);
            sheet.text(&text, [left + 8.0, row + 0.25 * LANE], "start", FAIL);
        }
        for (lane, cause) in self.lanes[1].iter().enumerate() {
            let column = right + LANE * lane as f64;
            sheet.rectangle([column + 2.0, top], [column + LANE, bottom], FAIL_GROUND);
            let text = clip(cause, bottom - top - 16.0);
            sheet.upright(&text, [column + 0.25 * LANE, bottom - 8.0 - 0.5 * width(&text)], FAIL);
        }
    }

    fn draw_series(&self, sheet: &mut Sheet, index: usize, series: &Series) {
        let (colour, shape, hollow) = self.look(index, series);
        let points: Vec<Option<Point>> = series.points.iter().map(|&point| self.point(index, series, point)).collect();
        if series.mark == Mark::Line {
            // A point without a place interrupts the line.
            for piece in points.split(Option::is_none).filter(|piece| piece.len() > 1) {
                sheet.line(&piece.iter().copied().flatten().collect::<Vec<_>>(), colour, 3.0);
            }
            // So many points are not marked one by one where a line joins them.
            if points.len() > 60 {
                return;
            }
        }
        for point in points.into_iter().flatten() {
            sheet.marker(point, shape, colour, hollow);
        }
    }

    /// The colour and shape of a series, and whether the shape is hollow.
    fn look(&self, index: usize, series: &Series) -> (Colour, &'static str, bool) {
        let like = |name: &String| self.plot.series.iter().position(|other| other.name == *name);
        let index = series.like.as_ref().and_then(like).unwrap_or(index);
        let look = self.plot.series.get(index).and_then(|series| series.look);
        let Look { number, hollow } = look.unwrap_or(Look { number: index, hollow: false });
        let colour = SERIES[number % SERIES.len()];
        match series.mark {
            Mark::Cross if series.like.is_none() => (FAIL, CROSS, true),
            Mark::Cross => (colour, CROSS, true),
            Mark::Line | Mark::Point => (colour, SHAPES[number % SHAPES.len()], hollow),
        }
    }

    /// The line of a slope through a point, cut off at the edges; `None` where it misses the field, or the axes are not both logarithmic.
    fn slope_line(&self, slope: f64, through: (f64, f64)) -> Option<[Point; 2]> {
        let field = &self.field;
        let is_power_law = [&self.plot.x, &self.plot.y].iter().all(|axis| axis.scale == Scale::Logarithmic);
        let (x0, y0) = field.x.place(through.0).zip(field.y.place(through.1)).filter(|_| is_power_law)?;
        let rise = slope * field.y.unit() / field.x.unit();
        let [floor, ceiling] = [0.0, 1.0].map(|y| x0 + (y - y0) / rise);
        let (from, to) = (floor.min(ceiling).max(0.0), floor.max(ceiling).min(1.0));
        let end = |x: f64| [field.column(x), field.row((y0 + rise * (x - x0)).clamp(0.0, 1.0))];
        (rise.is_finite() && from < to).then(|| [end(from), end(to)])
    }
}

/// A slope with its sign: `+2`, `−1`, `−½`.
fn signed(slope: f64) -> String {
    let sign = if slope > 0.0 { "+" } else { "−" };
    let size = if slope.abs() == 0.5 { "½".to_owned() } else { number::pretty(slope.abs()) };
    format!("{sign}{size}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every method has a colour and a shape of its own.
    #[test]
    fn methods_look_different() {
        let count = crate::integrate::Method::ALL.len();
        let line = |number| Series::line("", Vec::new()).looking(Look { number, hollow: false });
        let plot = Plot { series: (0..count).map(line).collect(), ..Plot::log_log("", "", "") };
        let layout = Layout::of(&plot);
        let looks: Vec<_> = plot.series.iter().enumerate().map(|(k, series)| layout.look(k, series)).collect();
        for (k, (colour, shape, _)) in looks.iter().enumerate() {
            assert!(looks[..k].iter().all(|other| other.0 != *colour && other.1 != *shape), "{k}");
        }
    }

    /// A line of slope −1 through the middle of two decades by two joins opposite corners but for the margins; others are cut off.
    #[test]
    fn slopes_are_cut_off_at_the_edges() {
        let plot = Plot::log_log("", "", "").with_series(Series::line("", vec![(1.0, 100.0), (100.0, 1.0)]));
        let layout = Layout::of(&plot);
        let (field, near) = (&layout.field, |a: f64, b: f64| (a - b).abs() < 1e-6);
        let [[x0, y0], [x1, y1]] = layout.slope_line(-1.0, (10.0, 10.0)).unwrap();
        assert!(near(x0, field.left) && near(y0, field.top) && near(x1, field.right) && near(y1, field.bottom));
        let [[x0, y0], [x1, y1]] = layout.slope_line(2.0, (10.0, 10.0)).unwrap();
        let quarter = 0.25 * (field.right - field.left);
        assert!(near(x0, field.left + quarter) && near(x1, field.right - quarter));
        assert!(near(y0, field.bottom) && near(y1, field.top));
        let [[_, y0], [_, y1]] = layout.slope_line(0.0, (3.0, 10.0)).unwrap();
        assert!(near(y0, y1));
        assert!([0.0, f64::NAN, f64::INFINITY].iter().all(|&slope| layout.slope_line(slope, (10.0, 1e9)).is_none()));
    }
}
