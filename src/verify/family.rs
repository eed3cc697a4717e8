//! The list of everything that can be checked on any scene.

use super::{Check, Claim, Results, Subject};
use super::{
    convergence, definiteness, derivatives, equilibrium, momentum, prescribed_motion, refusals, rigid_motion, sameness,
    step_equations, work_energy,
};
use crate::error::Error;
use crate::force::DegenerateSpring;
use crate::integrate::StepFailure;
use crate::linear::SolveFailure;

/// Checks that belong together and run on any scene that they apply to.
pub struct Family {
    /// The claim that they support.
    pub claim: Claim,
    /// A short name, for test names and filters: letters and underscores.
    pub name: &'static str,
    /// Whether there is something to check on a subject.
    pub applies: fn(&Subject) -> bool,
    measure: fn(&Subject) -> Outcome,
}

/// The checks of a family, or why they could not be carried out.
pub(super) type Outcome = Result<Vec<Check>, Unfinished>;

/// Why a check could not be carried out: counts as failed.
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

impl Family {
    /// Measures on a subject that the family [`applies`](Self::applies) to. What cannot be carried out is a failed check.
    pub fn check(&self, subject: &Subject) -> Vec<Check> {
        let failed = |why: String| vec![Check::new(self.claim, self.name, &subject.name, f64::NAN, 0.0, why)];
        match (self.measure)(subject) {
            Ok(checks) if checks.is_empty() => failed("nothing was measured".into()),
            Ok(checks) => checks,
            Err(unfinished) => failed(format!("could not be carried out: {unfinished}")),
        }
    }
}

/// Every family, in the order of the claims.
pub const FAMILIES: &[Family] = &[
    Family { claim: Claim::Jacobian, name: "jacobian", applies: derivatives::applies, measure: derivatives::jacobian },
    Family {
        claim: Claim::Jacobian,
        name: "dropped_terms",
        applies: derivatives::applies,
        measure: derivatives::dropped,
    },
    Family {
        claim: Claim::Consistency,
        name: "derivatives",
        applies: derivatives::applies,
        measure: derivatives::consistency,
    },
    Family {
        claim: Claim::Solvers,
        name: "linear_steps",
        applies: step_equations::can_move,
        measure: step_equations::linear,
    },
    Family {
        claim: Claim::Solvers,
        name: "other_steps",
        applies: step_equations::can_move,
        measure: step_equations::others,
    },
    Family { claim: Claim::Solvers, name: "repeated", applies: always, measure: sameness::repeated },
    Family { claim: Claim::Consistency, name: "work_energy", applies: has_springs, measure: work_energy::measure },
    Family { claim: Claim::Definiteness, name: "options", applies: has_springs, measure: definiteness::options },
    Family {
        claim: Claim::Definiteness,
        name: "always_definite",
        applies: step_equations::can_move,
        measure: definiteness::always,
    },
    Family {
        claim: Claim::Definiteness,
        name: "inertia",
        applies: definiteness::is_small,
        measure: definiteness::inertia,
    },
    Family { claim: Claim::Convergence, name: "order", applies: convergence::is_soft, measure: convergence::measure },
    Family {
        claim: Claim::Conservation,
        name: "linear_momentum",
        applies: momentum::has_free_translation,
        measure: momentum::linear,
    },
    Family {
        claim: Claim::Conservation,
        name: "angular_momentum",
        applies: momentum::has_free_rotation,
        measure: momentum::angular,
    },
    Family { claim: Claim::Conservation, name: "rigid_motion", applies: has_springs, measure: rigid_motion::measure },
    Family { claim: Claim::Conservation, name: "equilibrium", applies: always, measure: equilibrium::measure },
    Family {
        claim: Claim::Constraints,
        name: "prescribed_motion",
        applies: prescribed_motion::has_prescribed,
        measure: prescribed_motion::measure,
    },
    Family { claim: Claim::Constraints, name: "in_space", applies: sameness::is_flat, measure: sameness::in_space },
    Family { claim: Claim::Failure, name: "indefinite", applies: refusals::applies, measure: refusals::indefinite },
    Family {
        claim: Claim::Failure,
        name: "conjugate_gradients",
        applies: refusals::has_system,
        measure: refusals::conjugate_gradients,
    },
    Family {
        claim: Claim::Failure,
        name: "broken_states",
        applies: refusals::has_system,
        measure: refusals::broken_states,
    },
];

/// Runs every family that applies.
pub fn verify(subject: &Subject) -> Results {
    let applying = FAMILIES.iter().filter(|family| (family.applies)(subject));
    applying.flat_map(|family| family.check(subject)).collect()
}

fn has_springs(subject: &Subject) -> bool {
    !subject.system.pairs().is_empty()
}

fn always(_: &Subject) -> bool {
    true
}
