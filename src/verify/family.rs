//! The list of everything that can be checked on any scene.

use super::measured::Measured;
use super::{Check, Claim, Results, Subject};
use super::{
    convergence, definiteness, derivatives, equilibrium, indicators, ledger, momentum, prescribed_motion, refusals,
    rigid_motion, sameness, solvers, step_equations, work_energy,
};

/// Checks that belong together and run on any scene that they apply to.
pub struct Family {
    /// The claim that they support.
    pub claim: Claim,
    /// A short name, for test names and filters: letters and underscores.
    pub name: &'static str,
    /// Whether there is something to check on a subject.
    pub applies: fn(&Subject) -> bool,
    measure: fn(&Subject) -> Measured,
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
    family(Claim::Jacobian, "jacobian", pulls, derivatives::jacobian),
    family(Claim::Jacobian, "dropped_terms", pulls, derivatives::dropped),
    family(Claim::Consistency, "derivatives", pulls, derivatives::consistency),
    family(Claim::Consistency, "work_energy", has_springs, work_energy::measure),
    family(Claim::Assembly, "assembly", can_move, solvers::assembly),
    family(Claim::Solvers, "solvers", can_move, solvers::solvers),
    family(Claim::Solvers, "linear_steps", can_move, step_equations::linear),
    family(Claim::Solvers, "other_steps", can_move, step_equations::others),
    family(Claim::Solvers, "repeated", always, sameness::repeated),
    family(Claim::Definiteness, "options", has_springs, definiteness::options),
    family(Claim::Definiteness, "always_definite", can_move, definiteness::always),
    family(Claim::Definiteness, "on_demand", definiteness::is_affordable, definiteness::on_demand),
    family(Claim::Definiteness, "inertia", definiteness::is_small, definiteness::inertia),
    family(Claim::Convergence, "order", convergence::is_soft, convergence::measure),
    family(Claim::Conservation, "linear_momentum", momentum::has_free_translation, momentum::linear),
    family(Claim::Conservation, "angular_momentum", momentum::has_free_rotation, momentum::angular),
    family(Claim::Conservation, "rigid_motion", has_springs_that_move, rigid_motion::measure),
    family(Claim::Conservation, "equilibrium", has_particles, equilibrium::measure),
    family(Claim::Conservation, "ledger", ledger::applies, ledger::measure),
    family(Claim::Constraints, "prescribed_motion", prescribed_motion::has_prescribed, prescribed_motion::measure),
    family(Claim::Constraints, "in_space", sameness::is_flat, sameness::in_space),
    family(Claim::Failure, "indefinite", refusals::applies, refusals::indefinite),
    family(Claim::Failure, "conjugate_gradients", refusals::has_system, refusals::conjugate_gradients),
    family(Claim::Failure, "broken_states", refusals::has_system, refusals::broken_states),
    family(Claim::Failure, "indicators", indicators::applies, indicators::measure),
];

const fn family(
    claim: Claim,
    name: &'static str,
    applies: fn(&Subject) -> bool,
    measure: fn(&Subject) -> Measured,
) -> Family {
    Family { claim, name, applies, measure }
}

/// Runs every family that applies.
///
/// # Examples
/// ```
/// use sprung::scene::{Kind, builtin};
/// use sprung::verify::{Subject, verify};
///
/// let subject = Subject::of_scene(&builtin(Kind::Pendulum, 1)?)?;
/// let results = verify(&subject);
/// assert!(results.all_passed(), "{:?}", results.failures().map(|check| &check.name).collect::<Vec<_>>());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn verify(subject: &Subject) -> Results {
    let applying = FAMILIES.iter().filter(|family| (family.applies)(subject));
    applying.flat_map(|family| family.check(subject)).collect()
}

fn has_springs(subject: &Subject) -> bool {
    !subject.system.pairs().is_empty()
}

fn has_springs_that_move(subject: &Subject) -> bool {
    has_springs(subject) && can_move(subject)
}

fn has_particles(subject: &Subject) -> bool {
    subject.system.particles() > 0
}

fn always(_: &Subject) -> bool {
    true
}

fn can_move(subject: &Subject) -> bool {
    !subject.system.dofs().is_empty()
}

fn pulls(subject: &Subject) -> bool {
    !subject.system.active_springs().is_empty()
}

#[cfg(test)]
mod tests;
