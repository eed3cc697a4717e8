//! The list of everything that can be checked on any scene.

use super::measured::Measured;
use super::range::{of_estimates, of_springs, of_steps};
use super::{Check, Claim, Results, TestCase};
use super::{
    convergence, definiteness, derivatives, equilibrium, indicators, ledger, momentum, prescribed_motion, refusals,
    reproducibility, rigid_motion, solvers, step_equations, work_energy,
};

/// Checks that belong together and run on any scene that they apply to.
pub struct Family {
    /// The claim that they support.
    pub claim: Claim,
    /// A short name, for test names and filters: letters and underscores.
    pub name: &'static str,
    /// Whether there is something to check on a subject.
    pub applies: fn(&TestCase) -> bool,
    /// Why the numbers of a subject do not allow a judgement; `None` where they do.
    beyond: fn(&TestCase) -> Option<String>,
    measure: fn(&TestCase) -> Measured,
}

impl Family {
    /// Measures on a subject that the family [`applies`](Self::applies) to. What cannot be carried out is a failed check; what the numbers
    /// of the subject do not allow to be judged is [left out](Check::not_judged), with the reason.
    pub fn check(&self, subject: &TestCase) -> Vec<Check> {
        if let Some(reason) = (self.beyond)(subject) {
            return vec![Check::not_judged(self.claim, self.name.replace('_', " "), &subject.name, reason)];
        }
        let failed = |why: String| vec![Check::new(self.claim, self.name, &subject.name, f64::NAN, 0.0, why)];
        match (self.measure)(subject) {
            Ok(checks) if checks.is_empty() => failed("nothing was measured".into()),
            Ok(checks) => checks,
            Err(unfinished) if unfinished.is_reported() => {
                let reason = format!("a computation of the check came to no end, and said so: {unfinished}");
                vec![Check::not_judged(self.claim, self.name.replace('_', " "), &subject.name, reason)]
            }
            Err(unfinished) => failed(format!("could not be carried out: {unfinished}")),
        }
    }
}

/// Every family, in the order of the claims.
pub const FAMILIES: &[Family] = &[
    family(Claim::Jacobian, "jacobian", pulls, of_springs, derivatives::jacobian),
    family(Claim::Jacobian, "dropped_terms", pulls, of_springs, derivatives::dropped),
    family(Claim::Consistency, "derivatives", pulls, of_springs, derivatives::consistency),
    family(Claim::Consistency, "work_energy", has_springs, of_springs, work_energy::measure),
    family(Claim::Assembly, "assembly", can_move, of_steps, solvers::assembly),
    family(Claim::Solvers, "solvers", can_move, of_steps, solvers::solvers),
    family(Claim::Solvers, "linear_steps", can_move, of_steps, step_equations::linear),
    family(Claim::Solvers, "other_steps", can_move, of_steps, step_equations::others),
    family(Claim::Solvers, "repeated", always, of_steps, reproducibility::repeated),
    family(Claim::Definiteness, "options", has_springs, of_springs, definiteness::options),
    family(Claim::Definiteness, "always_definite", can_move, of_steps, definiteness::always),
    family(Claim::Definiteness, "on_demand", definiteness::is_affordable, of_steps, definiteness::on_demand),
    family(Claim::Definiteness, "inertia", definiteness::is_small, of_steps, definiteness::inertia),
    family(Claim::Convergence, "order", convergence::is_soft, of_steps, convergence::measure),
    family(Claim::Conservation, "linear_momentum", momentum::has_free_translation, of_steps, momentum::linear),
    family(Claim::Conservation, "angular_momentum", momentum::has_free_rotation, of_steps, momentum::angular),
    family(Claim::Conservation, "rigid_motion", has_springs_that_move, of_springs, rigid_motion::measure),
    family(Claim::Conservation, "equilibrium", has_particles, of_steps, equilibrium::measure),
    family(Claim::Conservation, "ledger", ledger::applies, of_steps, ledger::measure),
    family(
        Claim::Constraints,
        "prescribed_motion",
        prescribed_motion::has_prescribed,
        of_steps,
        prescribed_motion::measure,
    ),
    family(Claim::Constraints, "in_space", reproducibility::is_flat, of_steps, reproducibility::in_space),
    family(Claim::Failure, "indefinite", refusals::applies, of_steps, refusals::indefinite),
    family(Claim::Failure, "conjugate_gradients", refusals::has_system, of_steps, refusals::conjugate_gradients),
    family(Claim::Failure, "broken_states", refusals::has_system, of_steps, refusals::broken_states),
    family(Claim::Failure, "indicators", indicators::applies, of_estimates, indicators::measure),
];

const fn family(
    claim: Claim,
    name: &'static str,
    applies: fn(&TestCase) -> bool,
    beyond: fn(&TestCase) -> Option<String>,
    measure: fn(&TestCase) -> Measured,
) -> Family {
    Family { claim, name, applies, beyond, measure }
}

/// Runs every family that applies.
///
/// # Examples
/// ```
/// use sprung::scene::{Kind, builtin};
/// use sprung::verify::{TestCase, verify};
///
/// let subject = TestCase::of_scene(&builtin(Kind::Pendulum, 1)?)?;
/// let results = verify(&subject);
/// assert!(results.all_passed(), "{:?}", results.failures().map(|check| &check.name).collect::<Vec<_>>());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn verify(subject: &TestCase) -> Results {
    let applying = FAMILIES.iter().filter(|family| (family.applies)(subject));
    applying.flat_map(|family| family.check(subject)).collect()
}

fn has_springs(subject: &TestCase) -> bool {
    !subject.system.pairs().is_empty()
}

fn has_springs_that_move(subject: &TestCase) -> bool {
    has_springs(subject) && can_move(subject)
}

fn has_particles(subject: &TestCase) -> bool {
    subject.system.particles() > 0
}

fn always(_: &TestCase) -> bool {
    true
}

fn can_move(subject: &TestCase) -> bool {
    !subject.system.dofs().is_empty()
}

fn pulls(subject: &TestCase) -> bool {
    !subject.system.active_springs().is_empty()
}

#[cfg(test)]
mod tests;
