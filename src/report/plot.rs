//! Plots as SVG: here what stands where, in `draw` how it looks.

mod draw;

use super::axis::Ruler;
use super::canvas::{self, LINE, Point, WIDTH};
use super::failure_lanes::{Rails, is_railed};
use super::heading::Heading;
use super::number;
use crate::figure::{Guide, Mark, Plot, Scale, Series};

/// Height of the plotting area in pixels.
const HEIGHT: i32 = 500;
/// Room below it, for tick labels and the title of the axis.
const BELOW: i32 = 96;

/// Draws a plot as one SVG element, 800 pixels wide, that can stand in a page or alone in a file.
///
/// Points without a place on the axes (NaN, infinity, on a logarithmic axis zero or less) are left out and counted in
/// the legend; those of [`Mark::Cross`] stand on a rail instead: along the upper edge where y has no place, along the right
/// edge where only x has none, in a lane for every name of a series. Vertical guides have letters above the plot that the legend
/// explains; guides far beside the points are named there only.
pub fn svg(plot: &Plot) -> String {
    let layout = Layout::of(plot);
    canvas::sheet(&alt(plot), layout.bottom + BELOW, |sheet| layout.draw(sheet))
}

/// The title of the vertical axis in lines, whole if two or three hold it.
fn upright(title: &str) -> Vec<String> {
    let mut lines = canvas::wrap(title, HEIGHT);
    if lines.len() > 3 {
        let rest = lines.split_off(2).join(" ");
        lines.push(canvas::clip(&rest, HEIGHT));
    }
    lines
}

/// The plot in words, for those who cannot see it.
fn alt(plot: &Plot) -> String {
    let Plot { title, conclusion, x, y, series, .. } = plot;
    let mut names: Vec<&str> =
        series.iter().map(|series| series.name.as_str()).filter(|name| !name.is_empty()).collect();
    names.dedup();
    let shown = format!("{title}. {} over {}: {}", y.title, x.title, names.join(", "));
    if conclusion.is_empty() { shown } else { format!("{shown}. {conclusion}") }
}

struct Layout<'a> {
    plot: &'a Plot,
    x: Ruler,
    y: Ruler,
    heading: Heading,
    legend: Vec<(Key<'a>, String, Point)>,
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
    rails: Rails<'a>,
    /// The title of the vertical axis, in lines.
    upright: Vec<String>,
    /// Labels of sloping guides, and where.
    labels: Vec<Label>,
}

/// What the legend explains.
enum Key<'a> {
    Series(usize, &'a Series),
    Failures,
    Level,
    Slope,
    /// A vertical guide, by its letter.
    Letter(char),
    /// A guide that has no place in the picture.
    Outside,
}

/// Height of the strip for the letters of vertical guides.
const STRIP: i32 = 30;

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
        let x = Ruler::over(plot.x.scale, points().map(|p| p.0), verticals.into_iter());
        let y = Ruler::over(plot.y.scale, points().map(|p| p.1), levels.into_iter());
        let rails = Rails::of(plot, &x, &y);
        let labels = y.ticks.iter().map(|(_, label)| canvas::width(label)).max().unwrap_or(0);
        let heading = Heading::new(&plot.title, &plot.conclusion);
        let upright = upright(&plot.y.title);
        let (left, right) = (labels + LINE * upright.len() as i32 + 34, WIDTH - 18);
        let legend = Vec::new();
        let mut layout =
            Self { plot, x, y, heading, legend, left, right, top: 0, bottom: 0, rails, upright, labels: Vec::new() };
        // Places for labels do not depend on how far down the plot begins, which the legend decides.
        layout.bottom = HEIGHT + layout.rails.height();
        let refused = layout.place_labels();
        layout.top = layout.heading.height();
        layout.place_legend(&refused);
        if layout.plot.guides.iter().any(|guide| layout.vertical(guide).is_some()) {
            layout.top += STRIP;
        }
        layout.bottom += layout.top;
        for (_, at, _) in &mut layout.labels {
            at.1 += layout.top;
        }
        layout
    }

    /// The place of a vertical guide that is in the picture.
    fn vertical(&self, guide: &Guide) -> Option<i32> {
        match guide {
            Guide::Vertical { x, .. } => self.x.inside(*x).map(|place| self.column(place)),
            Guide::Level { .. } | Guide::Slope { .. } => None,
        }
    }

    /// Finds places for the labels of sloping guides that cover nothing; returns those of guides for which there is none.
    fn place_labels(&mut self) -> Vec<String> {
        let occupied = self.occupied();
        let mut refused = Vec::new();
        for guide in &self.plot.guides {
            let Guide::Slope { slope, through } = guide else { continue };
            let line = self.slope_line(*slope, *through);
            if line.is_empty() {
                continue;
            }
            let text = format!("slope {}", signed(*slope));
            let wide = canvas::width(&text);
            let around =
                |(x, y): Point| [x + 10, x - 10 - wide].into_iter().flat_map(move |x| [(x, y - LINE - 2), (x, y + 2)]);
            let candidates = sampled(&line).into_iter().flat_map(around);
            match self.free_place(&text, candidates, &occupied) {
                Some(label) => self.labels.push(label),
                None => refused.push(text),
            }
        }
        refused
    }

    /// Sets the legend's entries in rows under the title and moves the plot's top below them.
    fn place_legend(&mut self, slopes: &[String]) {
        let series = || self.plot.series.iter().enumerate();
        let coloured = |series: &Series| series.mark == Mark::Cross && series.like.is_some();
        // The lanes name the causes of failures, and colours the series that they belong to.
        let explained = |&(i, series): &(usize, &Series)| coloured(series) && self.missing(i, series) == 0;
        let keys = series().filter(|entry| !explained(entry));
        let keys = keys.map(|(i, series)| (Key::Series(i, series), self.name(i, series)));
        let failures = series().any(|(_, series)| coloured(series));
        let failures = failures.then(|| (Key::Failures, "failed, in the colour of its method".to_owned()));
        let mut letters = 'a'..='z';
        let guides = self.plot.guides.iter().filter_map(|guide| match guide {
            Guide::Level { y, label } => {
                let text = format!("{label}: {}", number::pretty(*y));
                Some(match (self.y.place(*y), self.y.inside(*y)) {
                    (_, Some(_)) => (Key::Level, text),
                    (Some(place), None) if place < 0.0 => (Key::Outside, format!("{text}, below the picture")),
                    _ => (Key::Outside, format!("{text}, above the picture")),
                })
            }
            Guide::Vertical { x, label } => {
                Some(match (self.x.place(*x), self.vertical(guide).and_then(|_| letters.next())) {
                    (_, Some(letter)) => (Key::Letter(letter), label.clone()),
                    (Some(place), None) if place < 0.0 => (Key::Outside, format!("{label}, left of the picture")),
                    _ => (Key::Outside, format!("{label}, right of the picture")),
                })
            }
            Guide::Slope { .. } => None,
        });
        let slopes = slopes.iter().map(|text| (Key::Slope, text.clone()));
        let guides: Vec<_> = guides.chain(slopes).collect();
        let mut at = (16, self.top + LINE / 2);
        let mut legend = Vec::new();
        for (key, text) in keys.chain(failures).chain(guides).filter(|(_, text)| !text.is_empty()) {
            let text = canvas::clip(&number::typeset(&text), WIDTH - 90);
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
            Guide::Level { y, .. } => {
                let row = self.y.inside(y).map(|place| self.row(place));
                row.map_or(Vec::new(), |row| sampled(&[(self.left, row), (self.edge(), row)]))
            }
            Guide::Vertical { .. } => {
                let column = self.vertical(guide);
                column.map_or(Vec::new(), |column| sampled(&[(column, self.bottom), (column, self.row(1.0))]))
            }
        });
        curves.chain(guides).flatten().collect()
    }

    /// The first of the places for a label where it covers no curve and no other label.
    fn free_place(&self, text: &str, mut candidates: impl Iterator<Item = Point>, occupied: &[Point]) -> Option<Label> {
        let wide = canvas::width(text);
        let rows = self.row(1.0)..=self.bottom - LINE;
        let place = candidates.find(|&(x, y)| {
            let covered = |p: &Point| p.0 > x - 6 && p.0 < x + wide + 6 && p.1 > y - 4 && p.1 < y + LINE + 4;
            let meets =
                |(_, at, other): &Label| x <= at.0 + other && at.0 <= x + wide && y < at.1 + LINE && at.1 < y + LINE;
            let inside = x >= self.left + 8 && x + wide <= self.edge() && rows.contains(&y);
            inside && !occupied.iter().any(covered) && !self.labels.iter().any(meets)
        })?;
        Some((text.to_owned(), place, wide))
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
