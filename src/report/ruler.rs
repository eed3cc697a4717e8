//! Axes laid out: where values and tick labels stand.

use super::number;
use crate::figure::Scale;

/// Room left free at both ends of an axis, as a share of its length.
const MARGIN: f64 = 0.035;
/// About how many labels an axis has room for.
const LABELS: f64 = 6.0;

/// An axis from its least to its greatest value; places are shares of its length, from 0 to 1.
pub(super) struct Ruler {
    scale: Scale,
    low: f64,
    high: f64,
    /// Labelled places.
    pub ticks: Vec<(f64, String)>,
    /// Places of the finer grid.
    pub fine: Vec<f64>,
}

impl Ruler {
    /// An axis that holds all values, with labels at round ones; those without a place on it are passed over.
    pub fn over(scale: Scale, values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = values
            .filter_map(|value| measure(scale, value))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        match scale {
            Scale::Linear => Self::linear(low, high),
            Scale::Logarithmic => Self::logarithmic(low, high),
        }
    }

    /// The place of a value, or `None` where it has none: NaN, infinity, and on a logarithmic axis what is not positive.
    pub fn place(&self, value: f64) -> Option<f64> {
        measure(self.scale, value).map(|value| self.share(value))
    }

    /// The length of one unit, on a logarithmic axis of one decade, as a share of the axis.
    pub fn unit(&self) -> f64 {
        (1.0 - 2.0 * MARGIN) / (self.high - self.low)
    }

    fn share(&self, measured: f64) -> f64 {
        MARGIN + (measured - self.low) * self.unit()
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
            ticks: Vec::new(),
            fine: Vec::new(),
        };
        let values = (0..=count as usize).map(|i| (first + i as f64) * step);
        ruler.ticks = values.map(|value| (ruler.share(value), label(value))).collect();
        ruler
    }

    fn logarithmic(low: f64, high: f64) -> Self {
        // Where fewer than two decades lie inside, the axis grows to the decades around.
        let (first, last) = (low.ceil(), high.floor());
        let (low, high) = if last > first { (low, high) } else { (low.floor(), high.ceil().max(low.floor() + 1.0)) };
        let decades = low.ceil() as i32..=high.floor() as i32;
        let step = ((high - low) / LABELS).ceil().max(1.0) as usize;
        let mut ruler = Self { scale: Scale::Logarithmic, low, high, ticks: Vec::new(), fine: Vec::new() };
        ruler.ticks = decades
            .clone()
            .step_by(step)
            .map(|decade| (ruler.share(decade.into()), number::power_of_ten(decade)))
            .collect();
        let within: &[f64] = match high - low {
            ..=4.0 => &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
            ..=40.0 => &[1.0],
            _ => &[],
        };
        let around = decades.start() - 1..=*decades.end();
        let fine = around.flat_map(|decade| within.iter().map(move |digit| f64::from(decade) + digit.log10()));
        ruler.fine = fine.filter(|value| (low..=high).contains(value)).map(|value| ruler.share(value)).collect();
        ruler
    }
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

    #[test]
    fn labels_are_round_and_values_lie_inside() {
        let ruler = Ruler::over(Scale::Logarithmic, [3e-12, 2e-3].into_iter());
        let labels: Vec<_> = ruler.ticks.iter().map(|(_, label)| label.as_str()).collect();
        assert_eq!(labels, ["10⁻¹¹", "10⁻⁹", "10⁻⁷", "10⁻⁵", "10⁻³"]);
        let ruler = Ruler::over(Scale::Linear, [-0.11, 0.32].into_iter());
        let labels: Vec<_> = ruler.ticks.iter().map(|(_, label)| label.as_str()).collect();
        assert_eq!(labels, ["−0.2", "−0.1", "0.0", "0.1", "0.2", "0.3", "0.4"]);
    }

    #[test]
    fn every_double_is_survived() {
        let numbers = [0.0, -0.0, 1.0, -1.0, f64::MIN, f64::MAX, f64::MIN_POSITIVE, 5e-324, f64::NAN, f64::INFINITY];
        for scale in [Scale::Linear, Scale::Logarithmic] {
            for a in numbers {
                for b in numbers {
                    let ruler = Ruler::over(scale, [a, b].into_iter());
                    assert!(ruler.ticks.len() < 20 && ruler.fine.len() < 50);
                    for value in numbers {
                        assert!(ruler.place(value).is_none_or(|place| !place.is_nan()), "{value} on {a}…{b}");
                    }
                }
            }
        }
    }
}
