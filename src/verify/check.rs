//! Claims, and the outcome of the checks that support them, as data.

use super::Entry;
use crate::error::Error;
use crate::figure::{Drawing, Plot};
use crate::force::DegenerateSpring;
use crate::integrate::StepFailure;
use crate::linear::SolveFailure;
use serde::Serialize;

/// A statement about the program that a group of checks supports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Claim {
    /// The Jacobian is the derivative of the force.
    Jacobian,
    /// Damping and energy are consistent with the forces.
    Consistency,
    /// Matrix-free and assembled products agree.
    Assembly,
    /// Refilling the matrix equals assembling it afresh, to the bit.
    Refill,
    /// All solvers give the same solution.
    Solvers,
    /// Definiteness is judged right.
    Definiteness,
    /// Known answers are met.
    KnownAnswers,
    /// Methods are stable where theory says, and nowhere else.
    Stability,
    /// Errors shrink with the step at the order that theory gives.
    Convergence,
    /// Conserved quantities are conserved, and symmetries are kept.
    Conservation,
    /// Constraints are followed exactly.
    Constraints,
    /// Failure is reported.
    Failure,
}

impl Claim {
    /// All claims, in the order in which they build on each other.
    pub const ALL: [Self; 12] = [
        Self::Jacobian,
        Self::Consistency,
        Self::Assembly,
        Self::Refill,
        Self::Solvers,
        Self::Definiteness,
        Self::KnownAnswers,
        Self::Stability,
        Self::Convergence,
        Self::Conservation,
        Self::Constraints,
        Self::Failure,
    ];

    /// The short name used in files and addresses.
    pub fn id(self) -> &'static str {
        self.text()[0]
    }

    /// The claim as one sentence.
    pub fn title(self) -> &'static str {
        self.text()[1]
    }

    /// The formula that is checked, in Unicode mathematics.
    pub fn formula(self) -> &'static str {
        self.text()[2]
    }

    /// The meaning of the claim and the way it is checked, for a newcomer.
    pub fn explanation(self) -> &'static str {
        self.text()[3]
    }

    fn text(self) -> [&'static str; 4] {
        match self {
            Self::Jacobian => [
                "jacobian",
                "The Jacobian is the derivative of the force",
                "K w = [f(x + h w) − f(x − h w)] / 2h + O(h²)",
                "An implicit step needs the matrix K, the derivative of the spring forces by the positions. It is programmed from a formula, so it \
                 can be wrong where the force is right. Here the particles are moved by a small h, and the change of the force is compared with the \
                 prediction of K. As h shrinks the difference first falls with h², the truncation error, then rises with 1/h, the rounding error: a \
                 V whose slopes and floor are known beforehand. A wrong K shows as a plateau.",
            ],
            Self::Consistency => [
                "consistency",
                "Damping and energy are consistent with the forces",
                "f = −∇U,   G = ∂f_d/∂v,   vᵀG v ≤ 0",
                "The elastic force must be minus the gradient of the elastic energy, and the damping matrix the derivative of \
                 the damping force by velocity. Damping may only take energy out.",
            ],
            Self::Assembly => [
                "assembly",
                "Matrix-free and assembled products agree",
                "|A w − (M w/dt² − G w/dt − K w)| ≤ 30 u |A| |w|",
                "The same matrix exists twice: entry by entry, and as a loop over springs that multiplies without forming it. Both are applied to \
                 the same vectors, and may differ by rounding only, in every component; u = 1.1 × 10⁻¹⁶ is the unit of rounding.",
            ],
            Self::Refill => [
                "refill",
                "Refilling the matrix equals assembling it afresh, to the bit",
                "A(refilled) − A(fresh) = 0",
                "The places of the nonzero entries are found once and only their values are renewed at every step. A value left over from the step \
                 before would be hard to see in the motion, so the renewed matrix is compared with one made from nothing. Not one bit may differ.",
            ],
            Self::Solvers => [
                "solvers",
                "All solvers give the same solution",
                "‖b − A x‖ / (‖A‖ ‖x‖ + ‖b‖) ≤ 30 u",
                "Every step solves a linear system. The backward error above tells how far the system would have to be changed for the computed x to \
                 solve it exactly: a few roundings for a direct method, the tolerance for an iterative one. Independent libraries solve the same \
                 systems, and the solutions may differ by what the condition of the matrix allows.",
            ],
            Self::Definiteness => [
                "definiteness",
                "Definiteness is judged right",
                "A = L D Lᵀ:   signs of D = signs of the eigenvalues of A",
                "A compressed spring wants to buckle, and with too long a step the matrix loses positive definiteness: the \
                 step no longer follows a minimum, and the motion may look plausible and be wrong. Where the critical step is \
                 known by formula, the verdict must change exactly there, with the known number of negative eigenvalues.",
            ],
            Self::KnownAnswers => [
                "known-answers",
                "Known answers are met",
                "‖x(computed) − x(known)‖ ≤ bound",
                "Some motions are known without this program: a damped oscillation, the frequencies of a taut chain, a \
                 hanging chain at rest, two bodies that circle each other. Others were computed in high precision by \
                 independent methods. The program must arrive at the same numbers.",
            ],
            Self::Stability => [
                "stability",
                "Methods are stable where theory says, and nowhere else",
                "|g(ω dt)| ≤ 1",
                "With too long a step every oscillation grows, however exactly its equations are solved. For one particle between two springs the \
                 longest stable step is known by formula, for every method and every way of simplifying the matrix. Hundreds of runs on both sides \
                 of that limit are judged by their motion, and the judgement must change exactly there.",
            ],
            Self::Convergence => [
                "convergence",
                "Errors shrink with the step at the order that theory gives",
                "error(dt) ≈ C dtᵖ",
                "Halving the step must halve the error of a first-order method and quarter that of a second-order one: on \
                 logarithmic axes a straight line of slope p. A mistake in a method usually costs an order; one in K often \
                 does not, which is why the Jacobian is checked on its own.",
            ],
            Self::Conservation => [
                "conservation",
                "What must be conserved is, and symmetries are kept",
                "Σ m v = const,   K 1 = 0,   K(ω × x) = ω × f",
                "Springs pull equally at both ends, so a free body keeps its momentum, and moving or turning everything at \
                 once changes no spring. A method adds or removes energy by a factor that is known for a single oscillation. \
                 None of this depends on the scene, so it is checked on all of them.",
            ],
            Self::Constraints => [
                "constraints",
                "Constraints are followed exactly",
                "x_c(t) = prescribed,   A_ff δx_f = b_f − A_fc δx_c",
                "A particle that is held, or moved along a path, must be exactly there at every step, and its neighbours must \
                 feel it. A planar scene must move as the same scene in space whose third coordinate is held.",
            ],
            Self::Failure => [
                "failure",
                "Failure is reported",
                "no answer without a verdict",
                "Some systems cannot be solved, and some steps are too long. The program must then say so, with the reason \
                 and the place, at the point where theory expects it and not before. A silent answer is a failure here.",
            ],
        }
    }
}

/// One measured number held to one bound.
///
/// `value` is measured, never assumed, and grows with the error; `bound` comes from an analysis of rounding or
/// truncation, which `why` names. A requirement from below is turned into a distance from the expected value.
#[derive(Debug, Clone, PartialEq)]
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

    /// A check that cannot be judged on a scene, and the reason.
    pub fn not_judged(
        claim: Claim,
        name: impl Into<String>,
        scene: impl Into<String>,
        reason: impl Into<String>,
    ) -> Self {
        Self { is_judged: false, ..Self::new(claim, name, scene, 0.0, 0.0, reason) }
    }

    /// The check itself if it passes or there is no reason not to judge it, else not judged for that reason.
    pub(super) fn unless(self, reason: impl FnOnce() -> Option<String>) -> Self {
        match if self.passed() { None } else { reason() } {
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

    /// `value/bound`, the used share of the bound: at most 1 where the check passes, NaN where a number is NaN.
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

/// The checks of a family, or something else, or the failure that prevented them.
pub(super) type Measured<T = Vec<Check>> = Result<T, Unfinished>;

#[derive(Debug, thiserror::Error)]
pub(super) enum Unfinished {
    #[error(transparent)]
    Input(#[from] Error),
    #[error(transparent)]
    Step(#[from] StepFailure),
    #[error(transparent)]
    Solve(#[from] SolveFailure),
    #[error(transparent)]
    Degenerate(#[from] DegenerateSpring),
}

/// The outcome of a suite: its checks, in the order in which they ran.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Results {
    /// The checks that were made.
    pub checks: Vec<Check>,
    /// The checks that could not be judged on a scene, each with the reason in `why`.
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

    /// Whether there is a check, judged or not, and nothing failed.
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

    fn check(claim: Claim, value: f64, bound: f64) -> Check {
        Check::new(claim, "n", "s", value, bound, "w")
    }

    /// Every claim has texts of its own, and is written by its id.
    #[test]
    fn claims_have_distinct_texts() {
        for text in [Claim::id, Claim::title, Claim::formula, Claim::explanation] {
            let mut texts = Claim::ALL.map(text).to_vec();
            texts.sort_unstable();
            texts.dedup();
            assert!(texts.len() == Claim::ALL.len() && texts.iter().all(|text| text.len() > 3), "{texts:?}");
        }
        for claim in Claim::ALL {
            assert_eq!(serde_json::to_value(claim).unwrap(), claim.id());
        }
    }

    /// Of a bound of zero nothing or everything is used; a NaN is never a share.
    #[test]
    fn shares_are_of_the_bound() {
        let share = |value, bound| check(Claim::Solvers, value, bound).share();
        assert_eq!([share(1.0, 4.0), share(3.0, 2.0), share(0.0, 2.0)], [0.25, 1.5, 0.0]);
        assert_eq!([share(0.0, 0.0), share(-1.0, 0.0)], [0.0, 0.0]);
        assert_eq!([share(1e-9, 0.0), share(0.5, -1.0)], [f64::INFINITY, f64::INFINITY]);
        assert!(share(f64::NAN, 1.0).is_nan() && share(1.0, f64::NAN).is_nan() && share(f64::NAN, 0.0).is_nan());
    }

    #[test]
    fn no_check_passes_with_a_nan() {
        let passed = |value, bound| check(Claim::Solvers, value, bound).passed();
        assert!(passed(1.0, 1.0) && !passed(1.1, 1.0));
        for (value, bound) in [(f64::NAN, 1.0), (1.0, f64::NAN), (1.0, f64::INFINITY), (f64::NEG_INFINITY, 1.0)] {
            assert!(!passed(value, bound), "{value} {bound}");
        }
        let entry = Entry::new(0, None, 1.0, 1.0, 0.0);
        for entry in [
            Entry { analytic: f64::NAN, ..entry.clone() },
            Entry { numeric: f64::NAN, ..entry.clone() },
            Entry { absolute: f64::NAN, ..entry.clone() },
            Entry { relative: f64::NAN, ..entry.clone() },
        ] {
            assert!(entry.has_nan() && !check(Claim::Solvers, 1.0, 1.0).with_table(vec![entry]).passed());
        }
        assert!(!entry.has_nan() && check(Claim::Solvers, 1.0, 1.0).with_table(vec![entry]).passed());
    }

    #[test]
    fn results_count_passed_and_failed_checks() {
        let none = Results::default();
        assert_eq!((none.passed(), none.failed(), none.all_passed(), none.by_claim().len()), (0, 0, false, 0));
        let values = [(Claim::Failure, 0.5), (Claim::Jacobian, 2.0), (Claim::Failure, 0.7), (Claim::Jacobian, 3.0)];
        let mut results: Results = values.map(|(claim, value)| check(claim, value, 1.0)).into_iter().collect();
        assert_eq!((results.passed(), results.failed(), results.all_passed()), (2, 2, false));
        assert_eq!(results.failures().map(|check| check.value).collect::<Vec<_>>(), [2.0, 3.0]);
        results.extend([check(Claim::Solvers, 0.1, 1.0), Check::not_judged(Claim::Solvers, "n", "s", "r")]);
        let claims: Vec<_> = results.by_claim().into_iter().map(|(claim, checks)| (claim, checks.len())).collect();
        assert_eq!(claims, [(Claim::Jacobian, 2), (Claim::Solvers, 1), (Claim::Failure, 2)]);
        results.checks.retain(|check| check.passed());
        assert!(results.all_passed() && results.passed() == 3 && results.not_judged.len() == 1);
    }
}
