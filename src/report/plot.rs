//! Plots as SVG.

use super::canvas::{self, Align, LINE, Marker, Outcome, Point, Sheet, WIDTH};
use super::number;
use super::palette::{self, Colour};
use super::rails::{Rails, is_railed};
use super::ruler::Ruler;
use crate::figure::{Guide, Mark, Plot, Scale, Series};

/// Height of the plotting area in pixels.
const HEIGHT: i32 = 500;
/// Room below it, for tick labels and the title of the axis.
const BELOW: i32 = 96;
/// More points than this are not marked one by one where a line joins them.
const MARKED: usize = 60;

/// Draws a plot as one SVG element, 800 pixels wide, that can stand in a page or alone in a file.
///
/// Points without a place on the axes (NaN, infinity, on a logarithmic axis zero or less) are left out and counted in
/// the legend; those of [`Mark::Cross`] stand on a rail instead: along the upper edge where y has no place, along the right
/// edge where only x has none, in a lane for every name of a series.
pub fn svg(plot: &Plot) -> String {
    let layout = Layout::of(plot);
    canvas::sheet(&plot.title, layout.bottom + BELOW, |sheet| layout.draw(sheet))
}

struct Layout<'a> {
    plot: &'a Plot,
    x: Ruler,
    y: Ruler,
    title: Vec<String>,
    legend: Vec<(Key<'a>, String, Point)>,
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
    rails: Rails<'a>,
}

/// What the legend explains.
enum Key<'a> {
    Series(usize, &'a Series),
    Failures,
    Level,
}

impl<'a> Layout<'a> {
    fn of(plot: &'a Plot) -> Self {
        let points = || plot.series.iter().flat_map(|series| &series.points);
        let (mut levels, mut verticals) = (Vec::new(), Vec::new());
        for guide in &plot.guides {
            match *guide {
                Guide::Level { y, .. } => levels.push(y),
                Guide::Vertical { x, .. } => verticals.push(x),
                Guide::Slope { .. } => {}
            }
        }
        let x = Ruler::over(plot.x.scale, points().map(|p| p.0).chain(verticals));
        let y = Ruler::over(plot.y.scale, points().map(|p| p.1).chain(levels));
        let rails = Rails::of(plot, &x, &y);
        let labels = y.ticks.iter().map(|(_, label)| canvas::width(label)).max().unwrap_or(0);
        let title = canvas::wrap(&plot.title, WIDTH - 32);
        let (left, right) = (labels + LINE + 34, WIDTH - 18);
        let mut layout = Self { plot, x, y, title, legend: Vec::new(), left, right, top: 0, bottom: 0, rails };
        layout.top = 14 + LINE * layout.title.len() as i32;
        layout.place_legend();
        layout.bottom = layout.top + HEIGHT;
        layout
    }

    /// Sets the legend's entries in rows under the title and moves the plot's top below them.
    fn place_legend(&mut self) {
        let series = || self.plot.series.iter().enumerate();
        let coloured = |series: &Series| series.mark == Mark::Cross && series.like.is_some();
        // The lanes name the causes of failures, and colours the series that they belong to.
        let explained = |&(i, series): &(usize, &Series)| coloured(series) && self.missing(i, series) == 0;
        let keys = series().filter(|entry| !explained(entry));
        let keys = keys.map(|(i, series)| (Key::Series(i, series), self.name(i, series)));
        let failures = series().any(|(_, series)| coloured(series));
        let failures = failures.then(|| (Key::Failures, "failed, in the colour of its method".to_owned()));
        let guides = self.plot.guides.iter().filter_map(|guide| match guide {
            Guide::Level { y, label } => Some((Key::Level, format!("{label}: {}", number::pretty(*y)))),
            Guide::Slope { .. } | Guide::Vertical { .. } => None,
        });
        let mut at = (16, self.top + LINE / 2);
        let mut legend = Vec::new();
        for (key, text) in keys.chain(failures).chain(guides).filter(|(_, text)| !text.is_empty()) {
            let text = canvas::clip(&text, WIDTH - 90);
            let wide = 50 + canvas::width(&text) + 24;
            if at.0 > 16 && at.0 + wide > WIDTH {
                at = (16, at.1 + LINE);
            }
            legend.push((key, text, at));
            at.0 += wide;
        }
        if !legend.is_empty() {
            self.top = at.1 + LINE / 2 + 12;
        }
        self.legend = legend;
    }

    /// A series in the legend: its name, its measured slope, and how many of its points could not be drawn.
    fn name(&self, index: usize, series: &Series) -> String {
        let missing = self.missing(index, series);
        let mut name = series.name.clone();
        if let Some(slope) = series.slope {
            name += &format!(", measured slope {slope:.2}").replace('-', "−");
        }
        if missing > 0 {
            name += &format!(" ({} without a place on the axes)", number::count(missing, "point"));
        }
        name
    }

    fn missing(&self, index: usize, series: &Series) -> usize {
        series.points.iter().filter(|&&p| self.point(index, series, p).is_none()).count()
    }

    /// Where the right rail begins.
    fn edge(&self) -> i32 {
        self.right - self.rails.width()
    }

    fn column(&self, place: f64) -> i32 {
        self.left + (place * f64::from(self.edge() - self.left)).round() as i32
    }

    fn row(&self, place: f64) -> i32 {
        self.bottom - (place * f64::from(self.bottom - self.top - self.rails.height())).round() as i32
    }

    fn point(&self, index: usize, series: &Series, (x, y): (f64, f64)) -> Option<Point> {
        match (self.x.place(x), self.y.place(y)) {
            (Some(x), Some(y)) => Some((self.column(x), self.row(y))),
            (Some(x), None) if is_railed(series, None) => {
                Some((self.column(x), self.top + self.rails.below_the_top(index, series)?))
            }
            (None, Some(y)) if is_railed(series, None) => {
                Some((self.edge() + self.rails.right_of_the_plot(index, series)?, self.row(y)))
            }
            _ => None,
        }
    }

    fn draw(&self, sheet: &Sheet<'_>) -> Outcome {
        for (i, line) in self.title.iter().enumerate() {
            sheet.heading(line, (16, 10 + LINE / 2 + LINE * i as i32))?;
        }
        self.draw_axes(sheet)?;
        let occupied = self.occupied();
        let mut labels = Vec::new();
        for guide in &self.plot.guides {
            self.draw_guide(sheet, guide, &occupied, &mut labels)?;
        }
        for (i, series) in self.plot.series.iter().enumerate() {
            self.draw_series(sheet, i, series)?;
        }
        for (text, at, align) in labels.iter().map(|(text, corner, _)| (text, *corner, Align::Left)) {
            sheet.text(text, (at.0, at.1 + LINE / 2), align, palette::MUTED)?;
        }
        for (key, text, at) in &self.legend {
            self.draw_key(sheet, key, *at)?;
            sheet.text(text, (at.0 + 50, at.1), Align::Left, palette::INK)?;
        }
        Ok(())
    }

    fn draw_axes(&self, sheet: &Sheet<'_>) -> Outcome {
        let (left, right, top, bottom) = (self.left, self.right, self.top, self.bottom);
        let ceiling = self.row(1.0);
        self.rails.draw(sheet, [left, top, right, bottom], &self.crosses())?;
        let labelled = |ruler: &Ruler| ruler.ticks.iter().map(|tick| tick.0).collect::<Vec<_>>();
        for (places, width) in [(self.x.fine.clone(), 1), (labelled(&self.x), 2)] {
            for column in places.into_iter().map(|place| self.column(place)) {
                sheet.line(vec![(column, bottom), (column, ceiling)], palette::GRID, width)?;
            }
        }
        for (places, width) in [(self.y.fine.clone(), 1), (labelled(&self.y), 2)] {
            for row in places.into_iter().map(|place| self.row(place)) {
                sheet.line(vec![(left, row), (self.edge(), row)], palette::GRID, width)?;
            }
        }
        let right = self.edge();
        sheet.line(vec![(left, top), (left, bottom), (right, bottom)], palette::INK, 2)?;
        for (place, label) in &self.x.ticks {
            sheet.text(label, (self.column(*place), bottom + 24), Align::Center, palette::INK)?;
        }
        for (place, label) in &self.y.ticks {
            sheet.text(label, (left - 10, self.row(*place)), Align::Right, palette::INK)?;
        }
        sheet.text(
            &canvas::clip(&self.plot.x.title, WIDTH - 32),
            ((left + right) / 2, bottom + 66),
            Align::Center,
            palette::INK,
        )?;
        sheet.upright(&canvas::clip(&self.plot.y.title, HEIGHT), (22, (top + bottom) / 2), palette::INK)
    }

    fn draw_series(&self, sheet: &Sheet<'_>, index: usize, series: &Series) -> Outcome {
        let (colour, marker) = self.appearance(index, series);
        let points: Vec<Option<Point>> = series.points.iter().map(|&p| self.point(index, series, p)).collect();
        if series.mark == Mark::Line {
            // A point without a place interrupts the line: nothing is drawn where nothing was measured.
            for piece in points.split(Option::is_none).filter(|piece| piece.len() > 1) {
                sheet.line(piece.iter().copied().flatten().collect(), colour, 3)?;
            }
        }
        let marked = series.mark != Mark::Line || points.len() <= MARKED;
        for point in points.into_iter().flatten().filter(|_| marked) {
            sheet.marker(point, marker, colour)?;
        }
        Ok(())
    }

    fn draw_key(&self, sheet: &Sheet<'_>, key: &Key<'_>, (x, y): Point) -> Outcome {
        match *key {
            Key::Failures => sheet.marker((x + 20, y), Marker::Cross, palette::INK),
            Key::Level => sheet.dashed(vec![(x, y), (x + 40, y)], palette::INK, 3),
            Key::Series(index, series) => {
                let (colour, marker) = self.appearance(index, series);
                if series.mark == Mark::Line {
                    sheet.line(vec![(x, y), (x + 40, y)], colour, 3)?;
                }
                sheet.marker((x + 20, y), marker, colour)
            }
        }
    }

    fn draw_guide(&self, sheet: &Sheet<'_>, guide: &Guide, occupied: &[Point], labels: &mut Vec<Label>) -> Outcome {
        match guide {
            Guide::Slope { slope, through } => match self.slope_line(*slope, *through) {
                line if line.is_empty() => {}
                line => {
                    let text = format!("slope {}", signed(*slope));
                    let wide = canvas::width(&text);
                    let around = |(x, y): Point| {
                        [x + 10, x - 10 - wide].into_iter().flat_map(move |x| [(x, y - LINE - 2), (x, y + 2)])
                    };
                    let candidates = sampled(&line).into_iter().flat_map(around);
                    labels.extend(self.free_place(text, candidates, occupied, labels));
                    sheet.dashed(line, palette::MUTED, 2)?;
                }
            },
            Guide::Level { y, .. } => {
                if let Some(row) = self.y.place(*y).map(|place| self.row(place)) {
                    sheet.dashed(vec![(self.left, row), (self.edge(), row)], palette::INK, 3)?;
                }
            }
            Guide::Vertical { x, label } => {
                if let Some(column) = self.x.place(*x).map(|place| self.column(place)) {
                    sheet.dashed(vec![(column, self.bottom), (column, self.row(1.0))], palette::INK, 2)?;
                    let text = canvas::clip(label, (column - self.left).max(self.edge() - column) - 8);
                    let wide = canvas::width(&text);
                    let rows = (0..HEIGHT / LINE - 1).map(|i| self.row(1.0) + 4 + LINE * i);
                    let candidates = rows.flat_map(|y| [(column + 8, y), (column - 8 - wide, y)]);
                    labels.extend(self.free_place(text, candidates, occupied, labels));
                }
            }
        }
        Ok(())
    }

    /// The line of a slope through a point, cut off at the edges; empty where the axes are not both logarithmic.
    fn slope_line(&self, slope: f64, through: (f64, f64)) -> Vec<Point> {
        if (self.plot.x.scale, self.plot.y.scale) != (Scale::Logarithmic, Scale::Logarithmic) {
            return Vec::new();
        }
        let Some((x0, y0)) = self.x.place(through.0).zip(self.y.place(through.1)) else { return Vec::new() };
        let (decade_x, decade_y) = (self.x.unit(), self.y.unit());
        let height = |x: f64| y0 + slope * (x - x0) / decade_x * decade_y;
        let inside = |x: &f64| (0.0..=1.0).contains(&height(*x));
        let places: Vec<f64> = (0..=400).map(|i| f64::from(i) / 400.0).filter(inside).collect();
        let ends = places.first().into_iter().chain(places.last());
        ends.map(|&x| (self.column(x), self.row(height(x)))).collect()
    }

    /// Where curves and sloping guides run, sampled every few pixels.
    fn occupied(&self) -> Vec<Point> {
        let curves = self.plot.series.iter().enumerate().map(|(index, series)| {
            let points: Vec<Point> = series.points.iter().filter_map(|&p| self.point(index, series, p)).collect();
            if series.mark == Mark::Line { sampled(&points) } else { points }
        });
        let guides = self.plot.guides.iter().map(|guide| match *guide {
            Guide::Slope { slope, through } => sampled(&self.slope_line(slope, through)),
            Guide::Level { .. } | Guide::Vertical { .. } => Vec::new(),
        });
        curves.chain(guides).flatten().collect()
    }

    /// Of the places for a label the one where it covers least of the curves and no other label.
    fn free_place(
        &self,
        text: String,
        candidates: impl Iterator<Item = Point>,
        occupied: &[Point],
        labels: &[Label],
    ) -> Option<Label> {
        let wide = canvas::width(&text);
        let rows = self.row(1.0)..=self.bottom - LINE;
        let inside = |&(x, y): &Point| x >= self.left && x + wide <= self.edge() && rows.contains(&y);
        let covers = |&(x, y): &Point| {
            let covered = |p: &&Point| p.0 > x - 6 && p.0 < x + wide + 6 && p.1 > y - 4 && p.1 < y + LINE + 4;
            let meets =
                |(_, at, other): &&Label| x <= at.0 + other && at.0 <= x + wide && y < at.1 + LINE && at.1 < y + LINE;
            occupied.iter().filter(covered).count() + 1000 * labels.iter().filter(meets).count()
        };
        let best = candidates.filter(inside).min_by_key(covers)?;
        Some((text, best, wide))
    }

    /// Where failures stand.
    fn crosses(&self) -> Vec<Point> {
        let series = self.plot.series.iter().enumerate().filter(|(_, series)| series.mark == Mark::Cross);
        series.flat_map(|(i, series)| series.points.iter().filter_map(move |&p| self.point(i, series, p))).collect()
    }

    fn appearance(&self, index: usize, series: &Series) -> (Colour, Marker) {
        const MARKERS: [Marker; 4] = [Marker::Disc, Marker::Square, Marker::Triangle, Marker::Ring];
        let named = |name: &String| self.plot.series.iter().position(|other| other.name == *name);
        let colour = |index: usize| palette::SERIES[index % palette::SERIES.len()];
        match (series.mark, series.like.as_ref().and_then(named)) {
            (Mark::Cross, None) => (palette::FAIL, Marker::Cross),
            (Mark::Cross, Some(like)) => (colour(like), Marker::Cross),
            (Mark::Line | Mark::Point, like) => (colour(like.unwrap_or(index)), MARKERS[index % MARKERS.len()]),
        }
    }
}

/// A line's points and points between them, a few pixels apart.
fn sampled(line: &[Point]) -> Vec<Point> {
    let between = line.windows(2).flat_map(|ends| {
        let (a, b) = (ends[0], ends[1]);
        let steps = ((a.0 - b.0).abs().max((a.1 - b.1).abs()) / 8).max(1);
        (1..steps).map(move |i| (a.0 + (b.0 - a.0) * i / steps, a.1 + (b.1 - a.1) * i / steps))
    });
    line.iter().copied().chain(between).collect()
}

/// A text, its upper left corner and its width.
type Label = (String, Point, i32);

/// A slope with its sign: `+2`, `−1`, `−½`.
fn signed(slope: f64) -> String {
    let sign = if slope > 0.0 { "+" } else { "−" };
    let size = if slope.abs() == 0.5 { "½".to_owned() } else { number::pretty(slope.abs()) };
    format!("{sign}{size}")
}
