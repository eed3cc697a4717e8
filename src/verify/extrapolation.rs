//! Derivatives of a function about which nothing is known, each with an estimate of its own error.
//!
//! Central differences at `h, h/4, h/16, …` have an error series in h². Two neighbours give `R = D(h/4) + (D(h/4) −
//! D(h))/15`, whose error is of order h⁴ (Richardson 1911). As h shrinks R settles, until rounding shakes it; where
//! three neighbours agree best is the derivative, and how well they agree is the estimate of its error (after Ridders
//! 1982).

use super::check::worst;

/// Number of steps, each a quarter of the one before.
pub(super) const LEVELS: usize = 14;

/// A derivative and an estimate of its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Estimate {
    pub value: f64,
    pub error: f64,
}

/// Steps from an eighth of `length` down by quarters.
pub(super) fn steps(length: f64) -> [f64; LEVELS] {
    std::array::from_fn(|level| length / 8.0 * 0.25_f64.powi(level as i32))
}

/// From central differences at [`steps`], each with the rounding error it has at least; steps at which the function was
/// not finite are passed over. NaN if none is left.
pub(super) fn extrapolate(differences: &[f64; LEVELS], rounding: &[f64; LEVELS]) -> Estimate {
    let refined: [f64; LEVELS - 1] = std::array::from_fn(|level| {
        let (coarse, fine) = (differences[level], differences[level + 1]);
        fine + (fine - coarse) / 15.0
    });
    let estimates = refined.windows(3).zip(&rounding[2..]).map(|(triple, rounding)| {
        let spread = worst([(triple[1] - triple[0]).abs(), (triple[2] - triple[1]).abs()]);
        Estimate { value: triple[1], error: spread + rounding }
    });
    let best = estimates.filter(|estimate| estimate.error.is_finite()).min_by(|a, b| a.error.total_cmp(&b.error));
    best.unwrap_or(Estimate { value: f64::NAN, error: f64::NAN })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn derivative(f: impl Fn(f64) -> f64, x: f64, length: f64) -> Estimate {
        let differences = steps(length).map(|h| (f(x + h) - f(x - h)) / ((x + h) - (x - h)));
        extrapolate(&differences, &steps(length).map(|h| 1e-16 * f(x).abs() / h))
    }

    #[test]
    fn smooth_functions_have_eleven_digits_whatever_the_length() {
        for length in [1e-2, 1.0, 10.0] {
            let estimate = derivative(f64::exp, 1.0, length);
            assert!((estimate.value - 1.0_f64.exp()).abs() < 1e-10, "{estimate:?}");
            assert!((estimate.value - 1.0_f64.exp()).abs() < 100.0 * estimate.error.max(1e-14), "{estimate:?}");
        }
    }

    #[test]
    fn steps_out_of_the_domain_are_passed_over() {
        let estimate = derivative(f64::sqrt, 0.01, 1.0);
        assert!((estimate.value - 5.0).abs() < 1e-8, "{estimate:?}");
        assert!(derivative(|_| f64::NAN, 1.0, 1.0).value.is_nan());
    }
}
