//! A limit of the step, sought by trials.

/// From one length to the next where a limit is sought, how many of these at most, and how narrow the bracket shall be: a limit
/// from an estimate needs two digits.
const LEAP: f64 = 4.0;
const LEAPS: i32 = 12;
const WIDTH: f64 = 0.01;

/// How far beyond a guess a leap goes, and how many of the shortest ones it may be.
const BEYOND: f64 = 1.1;
const LONGEST_LEAP: f64 = 4.0;

/// A step that was tried.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trial {
    /// The logarithm of how much longer it is than the one that the search begins with.
    pub at: f64,
    /// The logarithm of the excess: above zero where the step is too long.
    pub excess: f64,
}

/// Where a limit is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Found {
    Nowhere,
    Between([f64; 2]),
}

/// Finds a limit near the first trial.
///
/// The excess is nearly a power of dt, so its logarithm nearly a line over that of dt: after two leaps the others go a little
/// beyond where that line is zero.
pub(super) fn search(first: Trial, mut excess: impl FnMut(f64) -> f64) -> Found {
    let is_too_long = first.excess > 0.0;
    let direction = if is_too_long { -1.0 } else { 1.0 };
    let shortest = LEAP.ln();
    let farthest = f64::from(LEAPS) * shortest;
    let (mut near, mut leap) = (first, shortest);
    while near.at.abs() < farthest {
        let at = direction * (near.at.abs() + leap).min(farthest);
        let far = Trial { at, excess: excess(at) };
        if (far.excess > 0.0) != is_too_long {
            return Found::Between(if is_too_long { narrowed(far, near, excess) } else { narrowed(near, far, excess) });
        }
        let ahead = far.excess * (far.at - near.at).abs() / (near.excess - far.excess);
        leap = if ahead.is_finite() { (BEYOND * ahead).clamp(shortest, LONGEST_LEAP * shortest) } else { shortest };
        near = far;
    }
    Found::Nowhere
}

/// Narrows a bracket to [`WIDTH`].
///
/// The trials go beyond the guess from the side that was hit last, by half the width and then by twice as much each time, but not
/// beyond the middle: so they come to lie on both sides of the limit soon, whatever the excess is like.
fn narrowed(mut low: Trial, mut high: Trial, mut excess: impl FnMut(f64) -> f64) -> [f64; 2] {
    let width = WIDTH.ln_1p();
    let mut beyond = 0.0;
    while high.at - low.at > width {
        let middle = low.at.midpoint(high.at);
        let line = low.at + (high.at - low.at) * low.excess / (low.excess - high.excess);
        let at = match beyond {
            up if up > 0.0 && line < middle => (line + up).min(middle),
            down if down < 0.0 && line > middle => (line + down).max(middle),
            _ => line,
        };
        let at = if at > low.at && at < high.at { at } else { middle };
        let trial = Trial { at, excess: excess(at) };
        if trial.excess > 0.0 {
            high = trial;
            beyond = if beyond < 0.0 { 2.0 * beyond } else { -0.5 * width };
        } else {
            low = trial;
            beyond = if beyond > 0.0 { 2.0 * beyond } else { 0.5 * width };
        }
    }
    [low.at, high.at]
}

#[cfg(test)]
mod tests {
    use super::{Found, LEAP, Trial, WIDTH, narrowed, search};

    /// Powers, as turning gives them, kinks where another spring becomes the worst, jumps, and values that are no numbers.
    #[test]
    fn limits_are_found_in_a_few_trials() {
        type Excess = fn(f64) -> f64;
        let cases: [(Excess, f64, usize); 9] = [
            (|dt| 3.0 * (dt / 1.7).ln(), 1.7, 5),
            (|dt| 4.0 * (dt / 1e-3).ln(), 1e-3, 7),
            (|dt| 1.5 * (dt / 5e4).ln(), 5e4, 8),
            (|dt| (4.0 * (dt / 1.2).ln()).max((dt / 1.1).ln()), 1.1, 7),
            (|dt| (dt / 3.9).ln() + (dt / 3.9).ln().powi(3), 3.9, 9),
            (|dt| if dt > 2.0 { 5.0 } else { -5.0 }, 2.0, 15),
            (|dt| if dt > 0.02 { 5.0 } else { -5.0 }, 0.02, 18),
            (|dt| if dt > 1.01 { 1e-9 } else { f64::NEG_INFINITY }, 1.01, 15),
            (|dt| if dt > 3.99 { f64::INFINITY } else { -1e-9 }, 3.99, 15),
        ];
        for (number, (excess, limit, most)) in cases.into_iter().enumerate() {
            let mut trials = 0;
            let found = search(Trial { at: 0.0, excess: excess(1.0) }, |at: f64| {
                trials += 1;
                excess(at.exp())
            });
            let Found::Between(between) = found else { panic!("{number}: no limit") };
            let ([low, high], rounding) = (between.map(f64::exp), 1.0 + 1e-12);
            assert!(low <= limit * rounding && limit <= high * rounding, "{number}: {low} {high}");
            assert!(high / low <= (1.0 + WIDTH) * rounding, "{number}: {low} {high}");
            assert!(trials <= most, "{number}: {trials} trials");
        }
        assert_eq!(search(Trial { at: 0.0, excess: -1.0 }, |_| -1.0), Found::Nowhere);
        assert_eq!(search(Trial { at: 0.0, excess: f64::NEG_INFINITY }, |_| f64::NEG_INFINITY), Found::Nowhere);
        assert_eq!(search(Trial { at: 0.0, excess: 1.0 }, |_| 2.0), Found::Nowhere);
    }

    /// A step of exactly the limit is not too long: the search goes up from it, and stops going down at it.
    #[test]
    fn the_limit_itself_is_kept() {
        let Found::Between([low, _]) = search(Trial { at: 0.0, excess: 0.0 }, |at| at) else { panic!("no limit") };
        assert_eq!(low, 0.0);
        let shortest = LEAP.ln();
        let Found::Between([low, _]) = search(Trial { at: 0.0, excess: shortest }, |at| at + shortest) else {
            panic!("no limit")
        };
        assert_eq!(low, -shortest);
        let ends = [Trial { at: 0.0, excess: -1.0 }, Trial { at: 1.0, excess: 1.0 }];
        assert_eq!(narrowed(ends[0], ends[1], |at| at - 0.5)[0], 0.5);
    }

    /// A bracket that is narrow enough is looked at no more, and no trial repeats an end, wherever the line between both is zero.
    #[test]
    fn every_trial_is_inside_the_bracket() {
        let width = WIDTH.ln_1p();
        let [low, high] = [Trial { at: 0.0, excess: -1.0 }, Trial { at: width, excess: 1.0 }];
        assert_eq!(narrowed(low, high, |_| panic!("a trial")), [0.0, width]);
        for (below, above) in [(-1e20, 1e-5), (-1e-5, 1e20)] {
            let mut ends = [0.0, 1.0];
            narrowed(Trial { at: 0.0, excess: below }, Trial { at: 1.0, excess: above }, |at| {
                assert!(ends[0] < at && at < ends[1], "{at} in {ends:?}");
                let excess = if at > 0.7 { above } else { below };
                ends[usize::from(excess > 0.0)] = at;
                excess
            });
        }
    }
}
