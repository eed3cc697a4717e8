//! A limit of the step, bracketed by trials.
//!
//! The excess is nearly a power of dt, so its logarithm is nearly a line over that of dt: leaps go a little beyond where the line through the last two
//! trials is zero, until the sign changes. The false position then narrows the bracket.

/// The shortest leap, as a factor of dt; how many of these the search covers; how many one leap may be; how narrow the bracket shall be: a limit
/// from an estimate needs two digits.
const LEAP: f64 = 4.0;
const LEAPS: i32 = 12;
const LONGEST_LEAP: f64 = 4.0;
const WIDTH: f64 = 0.01;

/// Trials by the Illinois method before bisection.
const LINES: usize = 12;

/// How far beyond a guess a leap goes.
const BEYOND: f64 = 1.1;

/// A step that was tried.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trial {
    /// The logarithm of how much longer it is than the one that the search begins with.
    pub at: f64,
    /// The logarithm of the excess: above zero where the step is too long.
    pub excess: f64,
}

/// A bracket of the limit near the first trial, which lies at 0; `None` where there is none.
pub(super) fn search(first: Trial, mut excess: impl FnMut(f64) -> f64) -> Option<[f64; 2]> {
    let is_too_long = first.excess > 0.0;
    let direction = if is_too_long { -1.0 } else { 1.0 };
    let shortest = LEAP.ln();
    let farthest = f64::from(LEAPS) * shortest;
    let (mut near, mut leap) = (first, shortest);
    while near.at.abs() < farthest {
        let at = direction * (near.at.abs() + leap).min(farthest);
        let far = Trial { at, excess: excess(at) };
        if (far.excess > 0.0) != is_too_long {
            let [low, high] = if is_too_long { [far, near] } else { [near, far] };
            return Some(narrowed(low, high, excess));
        }
        let ahead = far.excess * (far.at - near.at).abs() / (near.excess - far.excess);
        leap = if ahead.is_finite() { (BEYOND * ahead).clamp(shortest, LONGEST_LEAP * shortest) } else { shortest };
        near = far;
    }
    None
}

/// Narrows a bracket to [`WIDTH`] by the Illinois method (Dowell and Jarratt 1971): an end that stays is given half of its excess. Trials keep half of the width
/// away from the ends, so that they come to lie on both sides of the limit, and after a dozen they are
/// bisections.
fn narrowed(mut low: Trial, mut high: Trial, mut excess: impl FnMut(f64) -> f64) -> [f64; 2] {
    let width = WIDTH.ln_1p();
    let (mut trials, mut was_high) = (0, None);
    while high.at - low.at > width {
        let line = low.at + (high.at - low.at) * low.excess / (low.excess - high.excess);
        let at = match line.is_finite() && trials < LINES {
            true => line.clamp(low.at + 0.5 * width, high.at - 0.5 * width),
            false => low.at.midpoint(high.at),
        };
        let trial = Trial { at, excess: excess(at) };
        let is_high = trial.excess > 0.0;
        let (moved, stays) = if is_high { (&mut high, &mut low) } else { (&mut low, &mut high) };
        *moved = trial;
        if was_high == Some(is_high) {
            stays.excess *= 0.5;
        }
        was_high = Some(is_high);
        trials += 1;
    }
    [low.at, high.at]
}

#[cfg(test)]
mod tests {
    use super::{LEAP, Trial, WIDTH, search};

    /// Powers, as turning gives them, kinks where another spring becomes the worst, jumps, and values that are no numbers.
    #[test]
    fn limits_are_found_in_a_few_trials() {
        type Excess = fn(f64) -> f64;
        let cases: [(Excess, f64); 9] = [
            (|dt| 3.0 * (dt / 1.7).ln(), 1.7),
            (|dt| 4.0 * (dt / 1e-3).ln(), 1e-3),
            (|dt| 1.5 * (dt / 5e4).ln(), 5e4),
            (|dt| (4.0 * (dt / 1.2).ln()).max((dt / 1.1).ln()), 1.1),
            (|dt| (dt / 3.9).ln() + (dt / 3.9).ln().powi(3), 3.9),
            (|dt| if dt > 2.0 { 5.0 } else { -5.0 }, 2.0),
            (|dt| if dt > 0.02 { 5.0 } else { -5.0 }, 0.02),
            (|dt| if dt > 1.01 { 1e-9 } else { f64::NEG_INFINITY }, 1.01),
            (|dt| if dt > 3.99 { f64::INFINITY } else { -1e-9 }, 3.99),
        ];
        for (number, (excess, limit)) in cases.into_iter().enumerate() {
            let mut trials = 0;
            let found = search(Trial { at: 0.0, excess: excess(1.0) }, |at: f64| {
                trials += 1;
                excess(at.exp())
            });
            let Some(between) = found else { panic!("{number}: no limit") };
            let ([low, high], rounding) = (between.map(f64::exp), 1.0 + 1e-12);
            assert!(low <= limit * rounding && limit <= high * rounding, "{number}: {low} {high}");
            assert!(high / low <= (1.0 + WIDTH) * rounding, "{number}: {low} {high}");
            assert!(trials <= if number < 5 { 9 } else { 25 }, "{number}: {trials} trials");
        }
        assert_eq!(search(Trial { at: 0.0, excess: -1.0 }, |_| -1.0), None);
        assert_eq!(search(Trial { at: 0.0, excess: f64::NEG_INFINITY }, |_| f64::NEG_INFINITY), None);
        assert_eq!(search(Trial { at: 0.0, excess: 1.0 }, |_| 2.0), None);
    }

    /// A step of exactly the limit is not too long: the search goes up from it, and stops going down at it.
    #[test]
    fn the_limit_itself_is_kept() {
        let limit =
            |first: f64, offset: f64| search(Trial { at: 0.0, excess: first }, |at| at + offset).map(|[low, _]| low);
        assert_eq!(limit(0.0, 0.0), Some(0.0));
        assert_eq!(limit(LEAP.ln(), LEAP.ln()), Some(-LEAP.ln()));
    }
}
