//! Axes laid out: where values and tick labels stand.

use super::number;
use crate::figure::Scale;

/// Room left free at both ends of an axis, as a share of its length.
const MARGIN: f64 = 0.035;
/// About how many labels an axis has room for.
const LABELS: f64 = 6.0;
/// By this share of their span the values of an axis are extended for a guide beside them, no further: the data have the room.
const REACH: f64 = 0.3;
/// Values that differ by this share of themselves are drawn as one: a picture of them would be one of rounding.
const ALIKE: f64 = 1e-5;
/// A logarithmic axis is at least so many decades long.
const SHORTEST: f64 = 0.4;

/// Digits that are labelled between powers of ten, from few to many.
const BETWEEN: [&[f64]; 4] = [
    &[1.0, 3.0],
    &[1.0, 2.0, 5.0],
    &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0],
    &[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
];

/// An axis from its least to its greatest value; places are shares of its length, from 0 to 1.
pub(super) struct Ruler {
    scale: Scale,
    low: f64,
    high: f64,
    margin: f64,
    /// Labelled places.
    pub ticks: Vec<(f64, String)>,
    /// Places of the finer grid.
    pub fine: Vec<f64>,
}

impl Ruler {
    /// An axis that holds all values, with labels at round ones; those without a place on it are passed over. It holds the guides
    /// that lie near the values too, and all of them where there are no values.
    pub fn over(scale: Scale, values: impl Iterator<Item = f64>, guides: impl Iterator<Item = f64>) -> Self {
        let guides: Vec<f64> = guides.filter_map(|guide| measure(scale, guide)).collect();
        let (low, high) = range(values.filter_map(|value| measure(scale, value)));
        let near = |guide: &&f64| {
            let reach = REACH * (high - low);
            low > high || (low - reach..=high + reach).contains(*guide)
        };
        let (least, greatest) = range(guides.iter().filter(near).copied());
        let (low, high) = (low.min(least), high.max(greatest));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        match scale {
            Scale::Linear => {
                // Labels of six digits would not tell these values apart: they are one.
                let centre = 0.5 * low + 0.5 * high;
                if high - low > ALIKE * centre.abs() { Self::linear(low, high) } else { Self::linear(centre, centre) }
            }
            Scale::Logarithmic => Self::logarithmic(low, high, MARGIN),
        }
    }

    /// An axis that begins at the least value and ends at the greatest.
    pub fn between(scale: Scale, values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = range(values.filter_map(|value| measure(scale, value)));
        match scale {
            _ if low >= high => Self::over(scale, [low].into_iter(), std::iter::empty()),
            Scale::Logarithmic => Self::logarithmic(low, high, 0.0),
            // Ends that are too near or too far from each other for a share of the way between them.
            Scale::Linear if !(high - low).is_normal() => Self::linear(low, high),
            Scale::Linear => {
                let mut ruler = Self::linear(low, high);
                let length = |ruler: &Self| ruler.high - ruler.low;
                let value =
                    |ruler: &Self, place: f64| ruler.low + (place - MARGIN) / (1.0 - 2.0 * MARGIN) * length(ruler);
                let ticks: Vec<(f64, String)> = ruler.ticks.drain(..).collect();
                let values: Vec<(f64, String)> =
                    ticks.into_iter().map(|(place, label)| (value(&ruler, place), label)).collect();
                (ruler.low, ruler.high, ruler.margin) = (low, high, 0.0);
                let inside = |ruler: &Self, value: f64| {
                    Some(ruler.share(value)).filter(|place| (-1e-9..=1.0 + 1e-9).contains(place))
                };
                ruler.ticks =
                    values.into_iter().filter_map(|(value, label)| Some((inside(&ruler, value)?, label))).collect();
                ruler
            }
        }
    }

    /// The place of a value, or `None` where it has none: NaN, infinity, and on a logarithmic axis what is not positive.
    pub fn place(&self, value: f64) -> Option<f64> {
        measure(self.scale, value).map(|value| self.share(value))
    }

    /// As [`place`](Self::place), of values between both ends of the axis.
    pub fn inside(&self, value: f64) -> Option<f64> {
        self.place(value).filter(|place| (0.0..=1.0).contains(place))
    }

    /// The length of one unit, on a logarithmic axis of one decade, as a share of the axis.
    pub fn unit(&self) -> f64 {
        (1.0 - 2.0 * self.margin) / (self.high - self.low)
    }

    fn share(&self, measured: f64) -> f64 {
        self.margin + (measured - self.low) * self.unit()
    }

    fn linear(low: f64, high: f64) -> Self {
        let centre = 0.5 * low + 0.5 * high;
        // One value alone, or several that rounding cannot tell apart, stand in the middle of an axis of their size.
        let distinct = high - low > 1e-12 * centre.abs();
        let span = if distinct { (high - low).max(1e-300) } else { centre.abs().max(1e-6) };
        let step = round_step(span / LABELS);
        let first = ((centre - 0.5 * span) / step).floor();
        let count = ((centre + 0.5 * span) / step).ceil() - first;
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let label = |value: f64| match value.abs().max(step) {
            size if (1e-4..1e5).contains(&size) && decimals < 7 => {
                format!("{:.decimals$}", value + 0.0).replace('-', "−")
            }
            _ => number::pretty(value),
        };
        let mut ruler = Self {
            scale: Scale::Linear,
            low: first * step,
            high: (first + count) * step,
            margin: MARGIN,
            ticks: Vec::new(),
            fine: Vec::new(),
        };
        let values = (0..=count as usize).map(|i| (first + i as f64) * step);
        ruler.ticks = values.map(|value| (ruler.share(value), label(value))).collect();
        ruler
    }

    fn logarithmic(low: f64, high: f64, margin: f64) -> Self {
        let missing = 0.5 * (SHORTEST - (high - low)).max(0.0);
        let (low, high) = (low - missing, high + missing);
        let mut ruler = Self { scale: Scale::Logarithmic, low, high, margin, ticks: Vec::new(), fine: Vec::new() };
        let decades = low.ceil() as i32..=high.floor() as i32;
        let inside = |value: &f64| (low..=high).contains(value);
        let around = decades.start() - 1..=*decades.end();
        let of_digits = |digits: &[f64]| -> Vec<(f64, f64, i32)> {
            let all = around.clone().flat_map(|decade| digits.iter().map(move |digit| (digit, decade)));
            all.map(|(digit, decade)| (f64::from(decade) + digit.log10(), *digit, decade))
                .filter(|tick| inside(&tick.0))
                .collect()
        };
        // Whole decades where there are three, else round numbers between, as few as will do.
        if decades.clone().count() > 2 {
            let step = ((high - low) / LABELS).ceil().max(1.0) as usize;
            let decades = decades.step_by(step);
            ruler.ticks = decades.map(|decade| (ruler.share(decade.into()), number::power_of_ten(decade))).collect();
        } else {
            let enough = BETWEEN.into_iter().map(of_digits).find(|ticks| ticks.len() > 2).unwrap_or_default();
            ruler.ticks =
                enough.iter().map(|&(value, digit, decade)| (ruler.share(value), label(digit, decade))).collect();
        }
        let within: &[f64] = match high - low {
            ..=4.0 => &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
            ..=40.0 => &[1.0],
            _ => &[],
        };
        ruler.fine = of_digits(within).into_iter().map(|tick| ruler.share(tick.0)).collect();
        ruler
    }
}

/// `0.05`, `200`, `2 × 10⁻⁵`: a digit times a power of ten.
fn label(digit: f64, decade: i32) -> String {
    match decade {
        -3..=3 => {
            let decimals = (i32::from(digit.fract() != 0.0) - decade).max(0) as usize;
            format!("{:.decimals$}", digit * 10f64.powi(decade))
        }
        _ if digit == 1.0 => number::power_of_ten(decade),
        _ => format!("{digit} × {}", number::power_of_ten(decade)),
    }
}

/// The least and the greatest of some numbers; the first is above the second where there is none.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// The value itself or its decimal logarithm.
fn measure(scale: Scale, value: f64) -> Option<f64> {
    let measured = match scale {
        // The length of an axis from the least to the greatest double would overflow.
        Scale::Linear if value.abs() < 1e300 => value,
        Scale::Linear => f64::NAN,
        Scale::Logarithmic if value > 0.0 => value.log10(),
        Scale::Logarithmic => f64::NAN,
    };
    measured.is_finite().then_some(measured)
}

/// The next of 1, 2, 5, 10 times a power of ten.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor()).max(f64::MIN_POSITIVE);
    [1.0, 2.0, 5.0].map(|digit| digit * power).into_iter().find(|&round| round >= step).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn none() -> std::iter::Empty<f64> {
        std::iter::empty()
    }

    fn labels(ruler: &Ruler) -> Vec<&str> {
        ruler.ticks.iter().map(|(_, label)| label.as_str()).collect()
    }

    /// Of less than three decades, round numbers between the powers of ten.
    #[test]
    fn short_axes_have_labels_too() {
        let over = |low, high| Ruler::over(Scale::Logarithmic, [low, high].into_iter(), none());
        assert_eq!(labels(&over(0.4, 40.0)), ["1", "3", "10", "30"]);
        assert_eq!(labels(&over(1.1e-5, 6e-5)), ["1.5 × 10⁻⁵", "2 × 10⁻⁵", "3 × 10⁻⁵", "5 × 10⁻⁵"]);
        assert!(labels(&over(7.0, 7.0)).len() > 2);
    }

    /// The values have the room: a guide far away does not take it, one nearby has a place.
    #[test]
    fn axes_go_by_the_data() {
        let with = |guide| Ruler::over(Scale::Logarithmic, [1e-4, 1e-1].into_iter(), [guide].into_iter());
        for far in [1e-13, 1e5] {
            assert_eq!(with(far).inside(far), None);
            assert_eq!(with(far).place(1e-4), Some(MARGIN));
        }
        assert_eq!(with(5e-5).inside(5e-5), Some(MARGIN));
        let alone = Ruler::over(Scale::Logarithmic, none(), [1e-13].into_iter());
        assert!(alone.inside(1e-13).is_some());
    }

    #[test]
    fn exact_axes_have_no_margins() {
        for scale in [Scale::Linear, Scale::Logarithmic] {
            let ruler = Ruler::between(scale, [0.47, 2.1].into_iter());
            assert_eq!((ruler.place(0.47), ruler.place(2.1)), (Some(0.0), Some(1.0)));
            assert!(ruler.ticks.len() > 2 && ruler.ticks.iter().all(|tick| (0.0..=1.0).contains(&tick.0)));
        }
        let linear = Ruler::between(Scale::Linear, [0.5, 2.0].into_iter());
        assert_eq!(linear.inside(1.25), Some(0.5));
    }

    #[test]
    fn labels_are_round_and_values_lie_inside() {
        let ruler = Ruler::over(Scale::Logarithmic, [3e-12, 2e-3].into_iter(), none());
        assert_eq!(labels(&ruler), ["10⁻¹¹", "10⁻⁹", "10⁻⁷", "10⁻⁵", "10⁻³"]);
        let ruler = Ruler::over(Scale::Linear, [-0.11, 0.32].into_iter(), none());
        assert_eq!(labels(&ruler), ["−0.2", "−0.1", "0.0", "0.1", "0.2", "0.3", "0.4"]);
    }

    /// No two labels are the same, however little the values differ.
    #[test]
    fn labels_tell_values_apart() {
        for difference in [0.0, 1e-13, 1e-9, 2e-6, 2e-5, 1e-3] {
            let ruler = Ruler::over(Scale::Linear, [1.0 - difference, 1.0].into_iter(), none());
            let labels = labels(&ruler);
            assert!(labels.len() > 2 && labels.windows(2).all(|pair| pair[0] != pair[1]), "{difference}: {labels:?}");
        }
    }

    #[test]
    fn every_double_is_survived() {
        let numbers = [0.0, -0.0, 1.0, -1.0, f64::MIN, f64::MAX, f64::MIN_POSITIVE, 5e-324, f64::NAN, f64::INFINITY];
        for scale in [Scale::Linear, Scale::Logarithmic] {
            for a in numbers {
                for b in numbers {
                    for ruler in [
                        Ruler::over(scale, [a, b].into_iter(), none()),
                        Ruler::over(scale, [a].into_iter(), [b].into_iter()),
                        Ruler::between(scale, [a, b].into_iter()),
                    ] {
                        assert!(ruler.ticks.len() < 20 && ruler.fine.len() < 50);
                        for value in numbers {
                            assert!(ruler.place(value).is_none_or(|place| !place.is_nan()), "{value} on {a}…{b}");
                        }
                    }
                }
            }
        }
    }
}
