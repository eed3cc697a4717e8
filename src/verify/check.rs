//! A check's outcome as data.

use super::Claim;
use crate::figure::{Drawing, Plot};
use serde::Serialize;

/// One measured number held to one bound.
///
/// `value` is measured, never assumed, and grows with the error; `bound` comes from an analysis of rounding or
/// truncation, and `why` says from which. What is required from below is turned round by the check, for example into
/// the distance from what is expected.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// The claim that the check supports.
    pub claim: Claim,
    /// What is checked, the same on every scene: `K against central differences`.
    pub name: String,
    /// The scene, or the case, that it is checked on.
    pub scene: String,
    /// The measured error.
    pub value: f64,
    /// The largest value that passes.
    pub bound: f64,
    /// Where the bound comes from.
    pub why: String,
    /// The worst entries, worst first, where the check compares entries.
    pub table: Vec<Entry>,
    /// Curves behind the value: a V-curve, errors over dt, residuals.
    pub curves: Vec<Plot>,
    /// The scene with the springs that matter, where that helps to find the fault.
    pub drawing: Option<Drawing>,
    /// Whether the scene's numbers allow a judgement; where they do not, `why` says the reason, and value and bound mean nothing.
    pub is_judged: bool,
}

impl Check {
    /// A check without table and pictures.
    pub fn new(
        claim: Claim,
        name: impl Into<String>,
        scene: impl Into<String>,
        value: f64,
        bound: f64,
        why: impl Into<String>,
    ) -> Self {
        Self {
            claim,
            name: name.into(),
            scene: scene.into(),
            value,
            bound,
            why: why.into(),
            table: Vec::new(),
            curves: Vec::new(),
            drawing: None,
            is_judged: true,
        }
    }

    /// What cannot be judged on a scene, and the reason.
    pub fn not_judged(
        claim: Claim,
        name: impl Into<String>,
        scene: impl Into<String>,
        reason: impl Into<String>,
    ) -> Self {
        Self { is_judged: false, ..Self::new(claim, name, scene, 0.0, 0.0, reason) }
    }

    /// Itself, but where it fails and the scene is one that it cannot judge: then that, with the reason.
    pub(super) fn unless(self, cannot: impl FnOnce() -> Option<String>) -> Self {
        if self.passed() {
            return self;
        }
        match cannot() {
            Some(reason) => Self::not_judged(self.claim, self.name, self.scene, reason),
            None => self,
        }
    }

    /// Adds the table of worst entries.
    pub fn with_table(self, table: Vec<Entry>) -> Self {
        Self { table, ..self }
    }

    /// Adds a plot.
    pub fn with_curves(mut self, plot: Plot) -> Self {
        self.curves.push(plot);
        self
    }

    /// Adds a drawing of the scene.
    pub fn with_drawing(self, drawing: Drawing) -> Self {
        Self { drawing: Some(drawing), ..self }
    }

    /// Whether `value ≤ bound`, and everything behind it is a number.
    ///
    /// A NaN fails wherever it stands: as the value, as the bound, in the table, in a curve. An infinite value fails,
    /// and so does an infinite bound, which nothing could break.
    pub fn passed(&self) -> bool {
        let numbers = self.value.is_finite() && self.bound.is_finite();
        let table = !self.table.iter().any(Entry::has_nan);
        let curves = !self.curves.iter().any(Plot::has_nan);
        numbers && table && curves && self.value <= self.bound
    }

    /// `value/bound`, the used share of what is allowed: at most 1 where the check passes, NaN where a number is NaN.
    ///
    /// A bound of zero asks for exactness: the share is 0 when it is met, infinite otherwise.
    pub fn share(&self) -> f64 {
        if self.value.is_nan() || self.bound.is_nan() {
            f64::NAN
        } else if self.bound > 0.0 {
            self.value / self.bound
        } else if self.value <= self.bound {
            0.0
        } else {
            f64::INFINITY
        }
    }
}

/// One compared entry of a matrix or a vector.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Entry {
    /// The row.
    pub row: usize,
    /// The column; `None` in a vector.
    pub column: Option<usize>,
    /// The spring that the entry belongs to, where there is one.
    pub spring: Option<usize>,
    /// The value under test, from a formula.
    pub analytic: f64,
    /// What it is held against, from an independent measurement.
    pub numeric: f64,
    /// `|analytic − numeric|`.
    pub absolute: f64,
    /// `|analytic − numeric| / max(|analytic|, |numeric|)`, at most 2; 0 where both are zero.
    pub relative: f64,
    /// The difference in words: `missing`, `sign flipped`, `30 % too small`.
    pub verdict: String,
}

impl Entry {
    /// Compares two values; differences up to `tolerance`, in their unit, count as agreement.
    pub fn new(row: usize, column: Option<usize>, analytic: f64, numeric: f64, tolerance: f64) -> Self {
        let absolute = (analytic - numeric).abs();
        let largest = worst([analytic.abs(), numeric.abs()]);
        let relative = if largest == 0.0 { 0.0 } else { absolute / largest };
        let verdict = in_words(analytic, numeric, tolerance);
        Self { row, column, spring: None, analytic, numeric, absolute, relative, verdict }
    }

    /// Names the spring that the entry belongs to.
    pub fn of_spring(self, spring: usize) -> Self {
        Self { spring: Some(spring), ..self }
    }

    /// Replaces the verdict by one that knows more, such as `30 % of the transverse term missing`.
    pub fn with_verdict(self, verdict: impl Into<String>) -> Self {
        Self { verdict: verdict.into(), ..self }
    }

    /// Whether a number of the entry is NaN.
    pub fn has_nan(&self) -> bool {
        [self.analytic, self.numeric, self.absolute, self.relative].iter().any(|number| number.is_nan())
    }
}

/// What is wrong with `analytic` if `numeric` is right.
fn in_words(analytic: f64, numeric: f64, tolerance: f64) -> String {
    if !analytic.is_finite() || !numeric.is_finite() {
        "not finite".into()
    } else if (analytic - numeric).abs() <= tolerance {
        "agrees".into()
    } else if analytic == 0.0 {
        "missing".into()
    } else if numeric.abs() <= tolerance {
        "should be zero".into()
    } else if (analytic + numeric).abs() <= tolerance {
        "sign flipped".into()
    } else if analytic.signum() != numeric.signum() {
        "wrong sign and size".into()
    } else {
        let excess = 100.0 * (analytic / numeric - 1.0);
        match excess.abs() {
            size if size >= 100.0 => format!("{:.3} times too large", analytic / numeric),
            size if size >= 0.1 => format!("{size:.1} % too {}", if excess > 0.0 { "large" } else { "small" }),
            size => format!("relative difference {:.1e}", size / 100.0),
        }
    }
}

/// The largest of some errors, NaN if any of them is NaN and NaN if there are none.
///
/// `fold(0.0, f64::max)` swallows NaN, and a check over nothing would pass: both must fail.
///
/// # Examples
/// ```
/// use sprung::verify::worst;
///
/// assert_eq!(worst([1.0, 3.0, 2.0]), 3.0);
/// // What is no number is worse than any.
/// assert!(worst([1.0, f64::NAN]).is_nan());
/// ```
pub fn worst(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().reduce(|a, b| if a.is_nan() || a > b { a } else { b }).unwrap_or(f64::NAN)
}

/// The outcome of a suite: its checks, in the order in which they ran.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Results {
    /// The checks that were made.
    pub checks: Vec<Check>,
    /// What could not be judged on a scene, each with the reason in `why`.
    pub not_judged: Vec<Check>,
}

impl Results {
    /// Number of checks that passed.
    pub fn passed(&self) -> usize {
        self.checks.len() - self.failed()
    }

    /// Number of checks that failed.
    pub fn failed(&self) -> usize {
        self.failures().count()
    }

    /// The checks that failed.
    pub fn failures(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|check| !check.passed())
    }

    /// Whether something was checked, or said to be beyond judgement, and nothing failed.
    pub fn all_passed(&self) -> bool {
        !(self.checks.is_empty() && self.not_judged.is_empty()) && self.failed() == 0
    }

    /// The claims that have a check, in the order of [`Claim::ALL`], each with its checks.
    pub fn by_claim(&self) -> Vec<(Claim, Vec<&Check>)> {
        let of = |claim| self.checks.iter().filter(move |check| check.claim == claim).collect::<Vec<_>>();
        Claim::ALL.iter().map(|&claim| (claim, of(claim))).filter(|(_, checks)| !checks.is_empty()).collect()
    }
}

impl FromIterator<Check> for Results {
    fn from_iter<I: IntoIterator<Item = Check>>(checks: I) -> Self {
        let (checks, not_judged) = checks.into_iter().partition(|check| check.is_judged);
        Self { checks, not_judged }
    }
}

impl Extend<Check> for Results {
    fn extend<I: IntoIterator<Item = Check>>(&mut self, checks: I) {
        let Self { checks, not_judged } = checks.into_iter().collect();
        self.checks.extend(checks);
        self.not_judged.extend(not_judged);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worst_keeps_nan_and_refuses_nothing() {
        assert_eq!(worst([1.0, 3.0, 2.0]), 3.0);
        assert_eq!(worst([-2.0, -1.0]), -1.0);
        assert!(worst([f64::NAN, 1.0]).is_nan());
        assert!(worst([1.0, f64::NAN, 2.0]).is_nan());
        assert!(worst([1.0, f64::NAN]).is_nan());
        assert!(worst([]).is_nan());
    }

    #[test]
    fn entries_say_in_words_what_is_wrong() {
        let verdict = |analytic, numeric| Entry::new(0, Some(0), analytic, numeric, 1e-9).verdict;
        assert_eq!(verdict(1.0, 1.0 + 1e-10), "agrees");
        assert_eq!(verdict(0.0, 5.0), "missing");
        assert_eq!(verdict(5.0, 0.0), "should be zero");
        assert_eq!(verdict(-5.0, 5.0), "sign flipped");
        assert_eq!(verdict(-4.0, 5.0), "wrong sign and size");
        assert_eq!(verdict(7.0, 10.0), "30.0 % too small");
        assert_eq!(verdict(20.0, 10.0), "2.000 times too large");
        assert_eq!(verdict(f64::NAN, 1.0), "not finite");
        assert_eq!(verdict(1.0 + 1e-6, 1.0), "relative difference 1.0e-6");
    }

    #[test]
    fn claims_have_distinct_names() {
        let mut ids = Claim::ALL.map(Claim::id).to_vec();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), Claim::ALL.len());
    }

    fn check(claim: Claim, value: f64, bound: f64) -> Check {
        Check::new(claim, "n", "s", value, bound, "w")
    }

    /// Of a bound of zero nothing or everything is used; a NaN is never a share, and never passes.
    #[test]
    fn shares_are_of_the_bound() {
        let share = |value, bound| check(Claim::Solvers, value, bound).share();
        assert_eq!([share(1.0, 4.0), share(3.0, 2.0), share(0.0, 2.0)], [0.25, 1.5, 0.0]);
        assert_eq!(
            [share(0.0, 0.0), share(-1.0, 0.0), share(1e-9, 0.0), share(0.5, -1.0)],
            [0.0, 0.0, f64::INFINITY, f64::INFINITY]
        );
        assert!(share(f64::NAN, 1.0).is_nan() && share(1.0, f64::NAN).is_nan() && share(f64::NAN, 0.0).is_nan());
    }

    #[test]
    fn nothing_passes_that_is_no_number() {
        let passed = |value, bound| check(Claim::Solvers, value, bound).passed();
        assert!(passed(1.0, 1.0) && !passed(1.1, 1.0));
        for (value, bound) in [(f64::NAN, 1.0), (1.0, f64::NAN), (1.0, f64::INFINITY), (f64::NEG_INFINITY, 1.0)] {
            assert!(!passed(value, bound), "{value} {bound}");
        }
        let entry = Entry::new(0, None, 1.0, 1.0, 0.0);
        assert!(!entry.has_nan());
        for entry in [
            Entry { analytic: f64::NAN, ..entry.clone() },
            Entry { numeric: f64::NAN, ..entry.clone() },
            Entry { absolute: f64::NAN, ..entry.clone() },
            Entry { relative: f64::NAN, ..entry.clone() },
        ] {
            assert!(entry.has_nan() && !check(Claim::Solvers, 1.0, 1.0).with_table(vec![entry]).passed());
        }
        assert!(check(Claim::Solvers, 1.0, 1.0).with_table(vec![entry]).passed());
    }

    #[test]
    fn a_check_keeps_its_drawing() {
        let (system, state) = crate::SystemBuilder::new().build().unwrap();
        let drawing = Drawing::strains("nothing", &system, &state);
        assert_eq!(check(Claim::Solvers, 1.0, 1.0).with_drawing(drawing.clone()).drawing, Some(drawing));
    }

    #[test]
    fn results_count_what_passed_and_what_failed() {
        let none = Results::default();
        assert_eq!((none.passed(), none.failed(), none.all_passed(), none.by_claim().len()), (0, 0, false, 0));
        let mut results: Results =
            [(Claim::Failure, 0.5), (Claim::Jacobian, 2.0), (Claim::Failure, 0.7), (Claim::Jacobian, 3.0)]
                .map(|(claim, value)| check(claim, value, 1.0))
                .into_iter()
                .collect();
        assert_eq!((results.passed(), results.failed(), results.all_passed()), (2, 2, false));
        assert_eq!(results.failures().map(|check| check.value).collect::<Vec<_>>(), [2.0, 3.0]);
        results.extend([check(Claim::Solvers, 0.1, 1.0)]);
        assert_eq!((results.passed(), results.failed()), (3, 2));
        let claims: Vec<_> = results.by_claim().into_iter().map(|(claim, checks)| (claim, checks.len())).collect();
        assert_eq!(claims, [(Claim::Jacobian, 2), (Claim::Solvers, 1), (Claim::Failure, 2)]);
        results.checks.retain(|check| check.passed());
        assert!(results.all_passed() && results.passed() == 3);
    }

    /// Every claim in words of its own.
    #[test]
    fn claims_have_texts() {
        for text in [Claim::title, Claim::formula, Claim::explanation] {
            let mut texts = Claim::ALL.map(text).to_vec();
            texts.sort_unstable();
            texts.dedup();
            assert!(texts.len() == Claim::ALL.len() && texts.iter().all(|text| text.len() > 3), "{texts:?}");
        }
    }
}
