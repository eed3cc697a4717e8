//! A laid out plot on paper.

use super::{Key, Layout, STRIP};
use crate::figure::{Guide, Look, Mark, Series};
use crate::report::axis::Ruler;
use crate::report::canvas::{self, Align, Drawn, LINE, Marker, Point, Sheet, WIDTH};
use crate::report::palette::{self, Colour};

/// More points than this are not marked one by one where a line joins them.
const MARKED: usize = 60;

/// Free space between two labels of an axis.
const BETWEEN: i32 = 8;

/// How near two letters may stand.
const APART: i32 = 24;

impl Layout<'_> {
    pub(super) fn draw(&self, sheet: &Sheet<'_>) -> Drawn {
        self.heading.draw(sheet)?;
        self.draw_axes(sheet)?;
        for guide in &self.plot.guides {
            self.draw_guide(sheet, guide)?;
        }
        self.draw_letters(sheet)?;
        for (i, series) in self.plot.series.iter().enumerate() {
            self.draw_series(sheet, i, series)?;
        }
        for (text, at, _) in &self.labels {
            sheet.text(text, (at.0, at.1 + LINE / 2), Align::Left, palette::MUTED)?;
        }
        for (key, text, at) in &self.legend {
            self.draw_key(sheet, key, *at)?;
            sheet.text(text, (at.0 + 50, at.1), Align::Left, palette::INK)?;
        }
        Ok(())
    }

    fn draw_axes(&self, sheet: &Sheet<'_>) -> Drawn {
        let (left, right, top, bottom) = (self.left, self.right, self.top, self.bottom);
        let ceiling = self.row(1.0);
        self.rails.draw(sheet, [left, top, right, bottom])?;
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
        for (column, label) in self.x_labels() {
            sheet.text(label, (column, bottom + 24), Align::Center, palette::INK)?;
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
        for (i, line) in (0..).zip(&self.upright) {
            sheet.upright(line, (22 + LINE * i, (top + bottom) / 2), palette::INK)?;
        }
        Ok(())
    }

    /// The labels of the horizontal axis that have room beside each other, the short and so the round ones first, and where they stand.
    pub(super) fn x_labels(&self) -> Vec<(i32, &str)> {
        let mut labels: Vec<(i32, &str)> =
            self.x.ticks.iter().map(|(place, label)| (self.column(*place), label.as_str())).collect();
        labels.sort_by_key(|(_, label)| canvas::width(label));
        let mut kept: Vec<(i32, &str)> = Vec::new();
        for (column, label) in labels {
            let apart = |(other, text): &(i32, &str)| {
                2 * (column - other).abs() > canvas::width(label) + canvas::width(text) + 2 * BETWEEN
            };
            if kept.iter().all(apart) {
                kept.push((column, label));
            }
        }
        kept
    }

    fn draw_series(&self, sheet: &Sheet<'_>, index: usize, series: &Series) -> Drawn {
        let (colour, marker, hollow) = self.appearance(index, series);
        let points: Vec<Option<Point>> = series.points.iter().map(|&p| self.point(index, series, p)).collect();
        if series.mark == Mark::Line {
            // A point without a place interrupts the line: nothing is drawn where nothing was measured.
            for piece in points.split(Option::is_none).filter(|piece| piece.len() > 1) {
                sheet.line(piece.iter().copied().flatten().collect(), colour, 3)?;
            }
        }
        let marked = series.mark != Mark::Line || points.len() <= MARKED;
        for point in points.into_iter().flatten().filter(|_| marked) {
            if hollow { sheet.hollow(point, marker, colour) } else { sheet.marker(point, marker, colour) }?;
        }
        Ok(())
    }

    fn draw_key(&self, sheet: &Sheet<'_>, key: &Key<'_>, (x, y): Point) -> Drawn {
        match *key {
            Key::Failures => sheet.marker((x + 20, y), Marker::Cross, palette::INK),
            Key::Level => sheet.dashed(vec![(x, y), (x + 40, y)], palette::INK, 3),
            Key::Slope => sheet.dashed(vec![(x, y), (x + 40, y)], palette::MUTED, 2),
            Key::Letter(letter) => {
                sheet.dashed(vec![(x + 14, y - 12), (x + 14, y + 12)], palette::INK, 2)?;
                sheet.text(&letter.to_string(), (x + 22, y), Align::Left, palette::INK)
            }
            Key::Outside => sheet.text("→", (x + 8, y), Align::Left, palette::INK),
            Key::Series(index, series) => {
                let (colour, marker, hollow) = self.appearance(index, series);
                if series.mark == Mark::Line {
                    sheet.line(vec![(x, y), (x + 40, y)], colour, 3)?;
                }
                let at = (x + 20, y);
                if hollow { sheet.hollow(at, marker, colour) } else { sheet.marker(at, marker, colour) }
            }
        }
    }

    fn draw_guide(&self, sheet: &Sheet<'_>, guide: &Guide) -> Drawn {
        match guide {
            Guide::Slope { slope, through } => match self.slope_line(*slope, *through) {
                line if line.is_empty() => Ok(()),
                line => sheet.dashed(line, palette::MUTED, 2),
            },
            Guide::Level { y, .. } => match self.y.inside(*y).map(|place| self.row(place)) {
                Some(row) => sheet.dashed(vec![(self.left, row), (self.edge(), row)], palette::INK, 3),
                None => Ok(()),
            },
            Guide::Vertical { .. } => match self.vertical(guide) {
                Some(column) => sheet.dashed(vec![(column, self.bottom), (column, self.row(1.0))], palette::INK, 2),
                None => Ok(()),
            },
        }
    }

    /// The letters of the vertical guides, above the plot where no line passes, kept apart.
    fn draw_letters(&self, sheet: &Sheet<'_>) -> Drawn {
        let columns = self.plot.guides.iter().filter_map(|guide| self.vertical(guide));
        let mut lettered: Vec<(i32, char)> = columns.zip('a'..='z').collect();
        lettered.sort_unstable();
        let mut free = i32::MIN;
        for (column, letter) in lettered {
            let at = column.max(free);
            free = at + APART;
            sheet.text(&letter.to_string(), (at, self.top - STRIP / 2), Align::Center, palette::INK)?;
        }
        Ok(())
    }

    /// Colour and shape of a series, and whether the shape is hollow.
    fn appearance(&self, index: usize, series: &Series) -> (Colour, Marker, bool) {
        const MARKERS: [Marker; 10] = [
            Marker::Disc,
            Marker::Square,
            Marker::Triangle,
            Marker::Diamond,
            Marker::Wedge,
            Marker::Left,
            Marker::Star,
            Marker::Right,
            Marker::Bar,
            Marker::Hourglass,
        ];
        let named = |name: &String| self.plot.series.iter().enumerate().find(|(_, other)| other.name == *name);
        let (index, look) = match series.like.as_ref().and_then(named) {
            Some((index, other)) => (index, other.look),
            None => (index, series.look),
        };
        let Look { number, hollow } = look.unwrap_or(Look { number: index, hollow: false });
        let colour = palette::SERIES[number % palette::SERIES.len()];
        match series.mark {
            Mark::Cross if series.like.is_none() => (palette::FAIL, Marker::Cross, false),
            Mark::Cross => (colour, Marker::Cross, false),
            Mark::Line | Mark::Point => (colour, MARKERS[number % MARKERS.len()], hollow),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::Plot;

    /// `3 × 10⁻⁴` and `0.001` stand near each other on an axis of two and a half decades.
    #[test]
    fn labels_of_an_axis_do_not_run_into_each_other() {
        let lengths = [(2e-4, 0.09), (1e-5, 1e-2), (0.1, 0.6), (3e-7, 2e-5), (1.0, 1e9)];
        for (low, high) in lengths {
            let lane = Series::failures("indefinite", vec![(f64::INFINITY, 10.0)]);
            let plot = Plot::log_log("", "", "")
                .with_series(Series::line("", vec![(low, 1.0), (high, 100.0)]))
                .with_series(lane);
            let layout = Layout::of(&plot);
            let mut labels = layout.x_labels();
            assert!(labels.len() >= 2, "{low} to {high}: {labels:?}");
            labels.sort_unstable();
            let free = |pair: &[(i32, &str)]| {
                pair[1].0 - pair[0].0 - (canvas::width(pair[0].1) + canvas::width(pair[1].1)) / 2
            };
            assert!(labels.windows(2).all(|pair| free(pair) >= BETWEEN), "{low} to {high}: {labels:?}");
        }
    }

    /// Ten methods have ten colours and ten shapes.
    #[test]
    fn every_method_has_a_look_of_its_own() {
        let plot = Plot::log_log("", "", "");
        let layout = Layout::of(&plot);
        let looks: Vec<(Colour, Marker)> = (0..crate::integrate::Method::ALL.len())
            .map(|number| Series::line("", Vec::new()).looking(Look { number, hollow: false }))
            .map(|series| layout.appearance(0, &series))
            .map(|(colour, marker, _)| (colour, marker))
            .collect();
        for (k, (colour, marker)) in looks.iter().enumerate() {
            assert!(looks[..k].iter().all(|other| other.0 != *colour && other.1 != *marker), "{k}: {marker:?}");
        }
    }
}
