//! Axes laid out: where values and tick labels stand, and the field between two axes.

use super::sheet::{GRID, INK, LINE, Point, Sheet, WIDTH, clip, width, wrap};
use super::{list, number};
use crate::figure::{Axis, Scale};

/// About how many labels an axis has room for.
const LABELS: f64 = 6.0;

/// Digits that are labelled between powers of ten, from few to many.
const BETWEEN: [&[f64]; 4] = [
    &[1.0, 3.0],
    &[1.0, 2.0, 5.0],
    &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0],
    &[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
];

/// An axis from its least to its greatest value; places are parts of its length, from 0 to 1.
pub(super) struct ScaledAxis {
    scale: Scale,
    low: f64,
    high: f64,
    margin: f64,
    pub ticks: Vec<(f64, String)>,
    pub fine: Vec<f64>,
}

impl ScaledAxis {
    /// An axis that holds all values that have a place on it, with a margin at both ends as a part of its length. It holds guides within
    /// 0.3 of the span beside the values too, and all of them where there are no values.
    pub fn new(scale: Scale, values: impl Iterator<Item = f64>, guides: &[f64], margin: f64) -> Self {
        let (low, high) = range(values.filter_map(|value| measure(scale, value)));
        let reach = 0.3 * (high - low);
        let near = |guide: &f64| low > high || (low - reach..=high + reach).contains(guide);
        let guides = range(guides.iter().filter_map(|&guide| measure(scale, guide)).filter(near));
        let (low, high) = (low.min(guides.0), high.max(guides.1));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let (centre, span) = (0.5 * low + 0.5 * high, high - low);
        // Values that six digits do not tell apart stand in the middle of an axis of their size.
        let shortest = match scale {
            Scale::Logarithmic => 0.4,
            Scale::Linear if span > 1e-5 * centre.abs() => 1e-300,
            Scale::Linear => centre.abs().max(1e-6),
        };
        let half = 0.5 * span.max(shortest);
        let (low, high) = if span < shortest { (centre - half, centre + half) } else { (low, high) };
        let mut axis = Self { scale, low, high, margin, ticks: Vec::new(), fine: Vec::new() };
        match scale {
            Scale::Linear => axis.set_linear_ticks(),
            Scale::Logarithmic => axis.set_logarithmic_ticks(),
        }
        axis
    }

    /// The place of a value; `None` of NaN, infinity, and on a logarithmic axis of what is not positive.
    pub fn place(&self, value: f64) -> Option<f64> {
        measure(self.scale, value).map(|measured| self.part(measured))
    }

    /// As [`place`](Self::place), of values between both ends of the axis.
    pub fn inside(&self, value: f64) -> Option<f64> {
        self.place(value).filter(|place| (0.0..=1.0).contains(place))
    }

    /// The length of one unit, on a logarithmic axis of one decade, as a part of the axis.
    pub fn unit(&self) -> f64 {
        (1.0 - 2.0 * self.margin) / (self.high - self.low)
    }

    fn part(&self, measured: f64) -> f64 {
        self.margin + (measured - self.low) * self.unit()
    }

    fn set_linear_ticks(&mut self) {
        let step = round_step((self.high - self.low) / LABELS);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let label = |value: f64| match value.abs().max(step) {
            size if (1e-4..1e5).contains(&size) && decimals < 7 => {
                format!("{:.decimals$}", value + 0.0).replace('-', "−")
            }
            _ => number::pretty(value),
        };
        let (first, last) = ((self.low / step - 1e-9).ceil(), (self.high / step + 1e-9).floor());
        let values = (0..=(last - first).max(0.0) as usize).map(|i| (first + i as f64) * step);
        self.ticks = values.map(|value| (self.part(value), label(value))).collect();
    }

    /// Labels at whole decades where there are three, else at round numbers between, as few as will do.
    fn set_logarithmic_ticks(&mut self) {
        let (low, high) = (self.low, self.high);
        // Digits times powers of ten on the axis: the logarithm, the digit and the decade.
        let of_digits = |digits: &[f64]| -> Vec<(f64, f64, i32)> {
            let decades = low.floor() as i32..=high.floor() as i32;
            let all = decades.flat_map(|decade| digits.iter().map(move |&digit| (digit, decade)));
            let all = all.map(|(digit, decade)| (f64::from(decade) + digit.log10(), digit, decade));
            all.filter(|(value, ..)| (low..=high).contains(value)).collect()
        };
        let mut ticks = of_digits(&[1.0]);
        if ticks.len() > 2 {
            let step = ((high - low) / LABELS).ceil().max(1.0) as usize;
            ticks = ticks.into_iter().step_by(step).collect();
        } else {
            ticks = BETWEEN.into_iter().map(of_digits).find(|ticks| ticks.len() > 2).unwrap_or_default();
        }
        let powers = ticks.iter().all(|tick| tick.1 == 1.0);
        let label = |&(value, digit, decade): &(f64, f64, i32)| {
            let text = if powers { number::power_of_ten(decade) } else { digit_label(digit, decade) };
            (self.part(value), text)
        };
        let fine: &[f64] = match high - low {
            ..=4.0 => &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
            ..=40.0 => &[1.0],
            _ => &[],
        };
        (self.ticks, self.fine) = (list(&ticks, label), list(&of_digits(fine), |tick| self.part(tick.0)));
    }
}

/// `0.05`, `200`, `2 × 10⁻⁵`: a digit times a power of ten.
fn digit_label(digit: f64, decade: i32) -> String {
    match decade {
        -3..=3 => {
            let decimals = (i32::from(digit.fract() != 0.0) - decade).max(0) as usize;
            format!("{:.decimals$}", digit * 10f64.powi(decade))
        }
        _ if digit == 1.0 => number::power_of_ten(decade),
        _ => format!("{digit} × {}", number::power_of_ten(decade)),
    }
}

/// The least and the greatest of some numbers; of none the first is above the second.
pub(super) fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

fn measure(scale: Scale, value: f64) -> Option<f64> {
    match scale {
        // The length of an axis from the least to the greatest double would overflow.
        Scale::Linear => (value.abs() < 1e300).then_some(value),
        Scale::Logarithmic => (value > 0.0 && value.is_finite()).then(|| value.log10()),
    }
}

/// The next of 1, 2, 5, 10 times a power of ten.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor()).max(f64::MIN_POSITIVE);
    [1.0, 2.0, 5.0].map(|digit| digit * power).into_iter().find(|&round| round >= step).unwrap_or(10.0 * power)
}

/// The field of a picture between its axes, in pixels.
pub(super) struct Field<'a> {
    titles: [&'a str; 2],
    upright: Vec<String>,
    pub x: ScaledAxis,
    pub y: ScaledAxis,
    pub left: f64,
    pub right: f64,
    pub top: f64,
    pub bottom: f64,
}

impl<'a> Field<'a> {
    /// Room below a field, for tick labels and the title of the axis.
    pub const BELOW: f64 = 96.0;

    /// A field so high, from the upper edge of the sheet, with room for labels on the left and `rail` pixels on the right.
    pub fn new(titles: [&'a Axis; 2], [x, y]: [ScaledAxis; 2], height: f64, rail: f64) -> Self {
        let titles = titles.map(|axis| axis.title.as_str());
        let mut upright = wrap(titles[1], height);
        if upright.len() > 3 {
            let rest = upright.split_off(2).join(" ");
            upright.push(clip(&rest, height));
        }
        let labels = y.ticks.iter().map(|(_, label)| width(label)).fold(0.0, f64::max);
        let left = labels + LINE * upright.len() as f64 + 34.0;
        Self { titles, upright, x, y, left, right: WIDTH - 18.0 - rail, top: 0.0, bottom: height }
    }

    pub fn move_down(&mut self, by: f64) {
        self.top += by;
        self.bottom += by;
    }

    pub fn column(&self, place: f64) -> f64 {
        self.left + place * (self.right - self.left)
    }

    pub fn row(&self, place: f64) -> f64 {
        self.bottom - place * (self.bottom - self.top)
    }

    pub fn point(&self, (x, y): (f64, f64)) -> Option<Point> {
        Some([self.column(self.x.place(x)?), self.row(self.y.place(y)?)])
    }

    pub fn draw_grid(&self, sheet: &mut Sheet) {
        for (axis, is_x) in [(&self.x, true), (&self.y, false)] {
            let labelled = axis.ticks.iter().map(|tick| (tick.0, 2.0));
            for (place, width) in axis.fine.iter().map(|&place| (place, 1.0)).chain(labelled) {
                let ends = match is_x {
                    true => [[self.column(place), self.bottom], [self.column(place), self.top]],
                    false => [[self.left, self.row(place)], [self.right, self.row(place)]],
                };
                sheet.line(&ends, GRID, width);
            }
        }
    }

    pub fn draw_axes(&self, sheet: &mut Sheet) {
        let Self { left, right, top, bottom, .. } = *self;
        sheet.line(&[[left, top], [left, bottom], [right, bottom]], INK, 2.0);
        for (column, label) in self.x_labels() {
            sheet.line(&[[column, bottom], [column, bottom + 8.0]], INK, 2.0);
            sheet.text(label, [column, bottom + 26.0], "middle", INK);
        }
        for (place, label) in &self.y.ticks {
            let row = self.row(*place);
            sheet.line(&[[left - 6.0, row], [left, row]], INK, 2.0);
            sheet.text(label, [left - 11.0, row], "end", INK);
        }
        let title = clip(self.titles[0], WIDTH - 32.0);
        // A title that is wider than the field keeps to the sheet.
        let half = 0.5 * width(&title) + 8.0;
        let middle = (0.5 * (left + right)).min(WIDTH - half).max(half);
        sheet.text(&title, [middle, bottom + 67.0], "middle", INK);
        for (i, line) in self.upright.iter().enumerate() {
            sheet.upright(line, [22.0 + LINE * i as f64, 0.5 * (top + bottom)], INK);
        }
    }

    /// The labels of the horizontal axis that have room beside each other, the short and so the round ones first.
    fn x_labels(&self) -> Vec<(f64, &str)> {
        let labels = self.x.ticks.iter().map(|(place, label)| (self.column(*place), label.as_str()));
        let mut labels: Vec<(f64, &str)> = labels.collect();
        labels.sort_by(|a, b| width(a.1).total_cmp(&width(b.1)));
        let mut kept: Vec<(f64, &str)> = Vec::new();
        for (column, label) in labels {
            let apart = |(other, text): &(f64, &str)| 2.0 * (column - other).abs() > width(label) + width(text) + 16.0;
            if kept.iter().all(apart) {
                kept.push((column, label));
            }
        }
        kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MARGIN: f64 = 0.035;

    fn labels(axis: &ScaledAxis) -> Vec<&str> {
        axis.ticks.iter().map(|(_, label)| label.as_str()).collect()
    }

    /// Less than three decades have round numbers between the powers of ten.
    #[test]
    fn short_axes_have_labels_too() {
        let over = |low, high| ScaledAxis::new(Scale::Logarithmic, [low, high].into_iter(), &[], MARGIN);
        assert_eq!(labels(&over(0.4, 40.0)), ["1", "3", "10", "30"]);
        assert_eq!(labels(&over(1.1e-5, 6e-5)), ["1.5 × 10⁻⁵", "2 × 10⁻⁵", "3 × 10⁻⁵", "5 × 10⁻⁵"]);
        assert!(labels(&over(7.0, 7.0)).len() > 2);
    }

    /// A guide far from the values takes no room from them, one nearby has a place.
    #[test]
    fn axes_go_by_the_data() {
        let with = |guide| ScaledAxis::new(Scale::Logarithmic, [1e-4, 1e-1].into_iter(), &[guide], MARGIN);
        for far in [1e-13, 1e5] {
            assert_eq!(with(far).inside(far), None);
            assert_eq!(with(far).place(1e-4), Some(MARGIN));
        }
        assert_eq!(with(5e-5).inside(5e-5), Some(MARGIN));
        let alone = ScaledAxis::new(Scale::Logarithmic, std::iter::empty(), &[1e-13], MARGIN);
        assert!(alone.inside(1e-13).is_some());
    }

    /// Ends of any size, differences down to rounding: ticks stand inside, in their order, and differ.
    #[test]
    fn linear_axes_have_ticks_at_round_values_inside() {
        let ends = [(0.0, 1.0), (-3.2, 17.9), (1e-9, 2e-9), (5.0, 5.0), (0.0, 0.0), (1e6, 1e6 + 1e-3), (-1e299, 1e299)];
        for (low, high) in ends {
            let axis = ScaledAxis::new(Scale::Linear, [low, high].into_iter(), &[], MARGIN);
            let places: Vec<f64> = axis.ticks.iter().map(|tick| tick.0).collect();
            assert!(places.len() > 1 && places.windows(2).all(|pair| pair[0] < pair[1]), "{low} to {high}: {places:?}");
            assert!(places.iter().all(|place| (-1e-9..=1.0 + 1e-9).contains(place)), "{places:?}");
            assert!(axis.inside(low).is_some() && axis.inside(high).is_some());
            let mut names = labels(&axis);
            names.dedup();
            assert_eq!(names.len(), places.len(), "{names:?}");
        }
    }

    /// `3 × 10⁻⁴` and `0.001` stand near each other on an axis of two and a half decades.
    #[test]
    fn labels_of_an_axis_do_not_run_into_each_other() {
        let title = Axis::logarithmic("");
        for (low, high) in [(2e-4, 0.09), (1e-5, 1e-2), (0.1, 0.6), (3e-7, 2e-5), (1.0, 1e9)] {
            let axis = || ScaledAxis::new(Scale::Logarithmic, [low, high].into_iter(), &[], MARGIN);
            let field = Field::new([&title, &title], [axis(), axis()], 500.0, 68.0);
            let mut labels = field.x_labels();
            assert!(labels.len() >= 2, "{low} to {high}: {labels:?}");
            labels.sort_by(|a, b| a.0.total_cmp(&b.0));
            let free = |pair: &[(f64, &str)]| pair[1].0 - pair[0].0 - 0.5 * (width(pair[0].1) + width(pair[1].1));
            assert!(labels.windows(2).all(|pair| free(pair) >= 8.0), "{low} to {high}: {labels:?}");
        }
    }
}
