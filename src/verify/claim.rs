//! What the suite sets out to show: claims, each with its formula and a word to the newcomer.

use serde::{Serialize, Serializer};

/// A statement about the program that a group of checks supports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
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
    /// What must be conserved is, and symmetries are kept.
    Conservation,
    /// Constraints are followed exactly.
    Constraints,
    /// Failure is reported.
    Failure,
}

/// The words for one claim.
struct Text {
    id: &'static str,
    title: &'static str,
    formula: &'static str,
    explanation: &'static str,
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
        self.text().id
    }

    /// The claim as one sentence.
    pub fn title(self) -> &'static str {
        self.text().title
    }

    /// The formula that is checked, in Unicode mathematics.
    pub fn formula(self) -> &'static str {
        self.text().formula
    }

    /// What the claim means and how it is checked, for someone who meets it for the first time.
    pub fn explanation(self) -> &'static str {
        self.text().explanation
    }

    fn text(self) -> Text {
        match self {
            Self::Jacobian => Text {
                id: "jacobian",
                title: "The Jacobian is the derivative of the force",
                formula: "K w = [f(x + h w) − f(x − h w)] / 2h + O(h²)",
                explanation: "An implicit step needs the matrix K, which says how the spring forces change when the \
                    particles move. It is programmed from a formula, so it can be wrong where the force is right. Here \
                    the particles are really moved by a small h, and the change of the force is compared with what K \
                    predicts. As h shrinks the difference first falls with h², the truncation error, then rises with \
                    1/h, the rounding error: a V whose two slopes and whose floor are known beforehand. A wrong K \
                    shows as a plateau.",
            },
            Self::Consistency => Text {
                id: "consistency",
                title: "Damping and energy are consistent with the forces",
                formula: "f = −∇U,   G = ∂f_d/∂v,   vᵀG v ≤ 0",
                explanation: "The elastic force must be the downhill direction of the elastic energy, and the damping \
                    matrix the derivative of the damping force with respect to velocity. Damping may only take energy \
                    out. Each is measured by differences of the function that it derives from.",
            },
            Self::Assembly => Text {
                id: "assembly",
                title: "Matrix-free and assembled products agree",
                formula: "|A w − (M w/dt² − G w/dt − K w)| ≤ 30 u |A| |w|",
                explanation: "The same matrix exists twice: written out entry by entry, and as a loop over springs \
                    that multiplies without ever forming it. Both are applied to the same vectors. They may differ by \
                    rounding only, in every single component; u = 1.1 × 10⁻¹⁶ is the unit of rounding.",
            },
            Self::Refill => Text {
                id: "refill",
                title: "Refilling the matrix equals assembling it afresh, to the bit",
                formula: "A(refilled) − A(fresh) = 0",
                explanation: "The places of the nonzero entries are worked out once and only the numbers are renewed at \
                    every step. A number left over from the step before would be hard to see in the motion, so the \
                    renewed matrix is compared with one made from nothing. Not one bit may differ.",
            },
            Self::Solvers => Text {
                id: "solvers",
                title: "All solvers give the same solution",
                formula: "‖b − A x‖ / (‖A‖ ‖x‖ + ‖b‖) ≤ 30 u",
                explanation: "Every step solves a linear system. The backward error above tells how far the system \
                    would have to be changed for the computed x to be its exact solution: a few roundings for a direct \
                    method, the tolerance for an iterative one. Independent libraries solve the same systems, and the \
                    solutions may differ by what the condition of the matrix allows.",
            },
            Self::Definiteness => Text {
                id: "definiteness",
                title: "Definiteness is judged right",
                formula: "A = L D Lᵀ:   signs of D = signs of the eigenvalues of A",
                explanation: "A compressed spring wants to buckle, and with too long a step the matrix then loses \
                    positive definiteness: the step no longer follows a minimum, and the motion may look plausible and \
                    be wrong. Where the critical step is known by formula, the verdict must change exactly there, and \
                    the number of negative eigenvalues must be the known one.",
            },
            Self::KnownAnswers => Text {
                id: "known-answers",
                title: "Known answers are met",
                formula: "‖x(computed) − x(known)‖ ≤ bound",
                explanation: "Some motions are known without this program: a damped oscillation, the frequencies of a \
                    taut chain, a hanging chain at rest, two bodies that circle each other. Others were computed in \
                    high precision by independent methods. The program must arrive at the same numbers.",
            },
            Self::Stability => Text {
                id: "stability",
                title: "Methods are stable where theory says, and nowhere else",
                formula: "|g(ω dt)| ≤ 1",
                explanation: "A step can be so long that every oscillation grows instead of going on, however exactly \
                    its equations are solved. For one particle between two springs the longest stable step is known by \
                    formula, for every method and every way of simplifying the matrix. Hundreds of runs on both sides of \
                    that limit are judged by what they do, and the judgement must change exactly there.",
            },
            Self::Convergence => Text {
                id: "convergence",
                title: "Errors shrink with the step at the order that theory gives",
                formula: "error(dt) ≈ C dtᵖ",
                explanation: "Halving the step must halve the error of a first-order method and quarter that of a \
                    second-order one. On logarithmic axes the error is a straight line, and its slope is the order p. \
                    A mistake in a method usually costs an order; one in K often does not, which is why the Jacobian \
                    is checked on its own.",
            },
            Self::Conservation => Text {
                id: "conservation",
                title: "What must be conserved is, and symmetries are kept",
                formula: "Σ m v = const,   K 1 = 0,   K(ω × x) = ω × f",
                explanation: "Springs pull equally at both ends, so a free body keeps its momentum, and moving or \
                    turning everything at once changes no spring. A method adds or removes energy by a factor that is \
                    known for a single oscillation. None of this depends on the scene, so it is checked on all of them.",
            },
            Self::Constraints => Text {
                id: "constraints",
                title: "Constraints are followed exactly",
                formula: "x_c(t) = prescribed,   A_ff δx_f = b_f − A_fc δx_c",
                explanation: "A particle that is held, or led along a path, must be exactly there at every step, and \
                    its neighbours must feel it. A planar scene must move as the same scene in space whose third \
                    coordinate is held.",
            },
            Self::Failure => Text {
                id: "failure",
                title: "Failure is reported",
                formula: "no answer without a verdict",
                explanation: "Some systems cannot be solved, and some steps are too long. The program must then say \
                    so, with the reason and the place, at the point where theory expects it and not before. A silent \
                    answer is a failure here.",
            },
        }
    }
}

impl Serialize for Claim {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.id())
    }
}
