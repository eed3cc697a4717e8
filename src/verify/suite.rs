//! All families of checks that run on any scene.

use super::limits::{of_estimates, of_springs, of_steps};
use super::{
    Check, Claim, Measured, Results, TestCase, Unfinished, consistency, convergence, definiteness, energy_balance,
    error_estimates, gradients, loads, momentum, prescribed_motion, products, refusals, runs, solvers, step_equations,
    v_curve,
};

type Condition = fn(&TestCase) -> bool;
type Limit = fn(&TestCase) -> Option<String>;
type Measure = fn(&TestCase) -> Measured;

/// Checks that belong together and run on any scene that they apply to.
pub struct Family {
    /// The claim that they support.
    pub claim: Claim,
    /// A short name, for test names and filters: letters and underscores.
    pub name: &'static str,
    /// Whether there is something to check on a scene.
    pub applies: Condition,
    /// The reason why the numbers of a scene do not allow a judgement, if there is one.
    limit: Limit,
    measure: Measure,
}

impl Family {
    /// Measures on a scene that the family [`applies`](Self::applies) to. A check that cannot be carried out fails; one that the scene's
    /// numbers do not allow to be judged is [not judged](Check::not_judged), with the reason.
    ///
    /// A step or a solver that reports that it cannot do its work is right to do so where the numbers do not allow it: then nothing is
    /// known. Every other obstacle counts as failed.
    pub fn check(&self, case: &TestCase) -> Vec<Check> {
        let name = || self.name.replace('_', " ");
        let not_judged = |reason: String| vec![Check::not_judged(self.claim, name(), &case.name, reason)];
        let failed = |why: String| vec![Check::new(self.claim, name(), &case.name, f64::NAN, 0.0, why)];
        if let Some(reason) = (self.limit)(case) {
            return not_judged(reason);
        }
        match (self.measure)(case) {
            Ok(checks) if checks.is_empty() => failed("nothing was measured".into()),
            Ok(checks) => checks,
            Err(reported @ (Unfinished::Step(_) | Unfinished::Solve(_))) => {
                not_judged(format!("a computation of the check reported that it could not be finished: {reported}"))
            }
            Err(unfinished) => failed(format!("could not be carried out: {unfinished}")),
        }
    }
}

/// Every family, in the order of the claims.
pub const FAMILIES: &[Family] = &[
    family(Claim::Jacobian, "jacobian", has_active_springs, of_springs, v_curve::jacobian),
    family(Claim::Jacobian, "dropped_terms", has_active_springs, of_springs, v_curve::all_dropped_terms),
    family(Claim::Consistency, "derivatives", has_active_springs, of_springs, consistency::derivatives),
    family(Claim::Consistency, "work_energy", has_springs, of_springs, consistency::work_energy),
    family(Claim::Consistency, "loads", loads::applies, of_springs, loads::measure),
    family(Claim::Consistency, "adjoints", has_equations, of_steps, gradients::adjoints),
    family(Claim::Assembly, "assembly", can_move, of_steps, products::assembly),
    family(Claim::Solvers, "solvers", can_move, of_steps, solvers::measure),
    family(Claim::Solvers, "linear_steps", can_move, of_steps, step_equations::linear),
    family(Claim::Solvers, "other_steps", can_move, of_steps, step_equations::others),
    family(Claim::Solvers, "repeated", |_| true, of_steps, runs::repeated),
    family(Claim::Definiteness, "options", has_springs, of_springs, definiteness::options),
    family(Claim::Definiteness, "always_definite", can_move, of_steps, definiteness::always),
    family(Claim::Definiteness, "on_demand", definiteness::is_affordable, of_steps, definiteness::on_demand),
    family(Claim::Definiteness, "inertia", definiteness::is_small, of_steps, definiteness::inertia),
    family(Claim::Convergence, "order", convergence::is_soft, of_steps, convergence::measure),
    family(Claim::Convergence, "remainders", has_equations, of_steps, gradients::remainders),
    family(Claim::Conservation, "linear_momentum", momentum::has_free_translation, of_steps, momentum::linear),
    family(Claim::Conservation, "angular_momentum", momentum::has_free_rotation, of_steps, momentum::angular),
    family(
        Claim::Conservation,
        "rigid_motion",
        |case| has_springs(case) && can_move(case),
        of_springs,
        products::rigid_motion,
    ),
    family(Claim::Conservation, "equilibrium", |case| case.system.particles() > 0, of_steps, momentum::equilibrium),
    family(Claim::Conservation, "energy_balance", energy_balance::applies, of_steps, energy_balance::measure),
    family(Claim::Constraints, "prescribed_motion", has_prescribed, of_steps, prescribed_motion::measure),
    family(Claim::Constraints, "in_space", |case| case.system.dimension() < 3, of_steps, runs::in_space),
    family(Claim::Failure, "indefinite", refusals::applies, of_steps, refusals::indefinite),
    family(Claim::Failure, "conjugate_gradients", has_equations, of_steps, refusals::conjugate_gradients),
    family(Claim::Failure, "broken_states", has_equations, of_steps, refusals::broken_states),
    family(Claim::Failure, "indicators", error_estimates::applies, of_estimates, error_estimates::measure),
];

const fn family(claim: Claim, name: &'static str, applies: Condition, limit: Limit, measure: Measure) -> Family {
    Family { claim, name, applies, limit, measure }
}

/// Runs every family that applies.
///
/// # Examples
/// ```
/// use sprung::scene::{Kind, builtin};
/// use sprung::verify::{TestCase, verify};
///
/// let case = TestCase::of_scene(&builtin(Kind::Pendulum, 1)?)?;
/// let results = verify(&case);
/// assert!(results.all_passed(), "{:?}", results.failures().map(|check| &check.name).collect::<Vec<_>>());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn verify(case: &TestCase) -> Results {
    let applying = FAMILIES.iter().filter(|family| (family.applies)(case));
    applying.flat_map(|family| family.check(case)).collect()
}

fn can_move(case: &TestCase) -> bool {
    !case.system.dofs().is_empty()
}

fn has_springs(case: &TestCase) -> bool {
    !case.system.pairs().is_empty()
}

fn has_active_springs(case: &TestCase) -> bool {
    !case.system.active_springs().is_empty()
}

fn has_equations(case: &TestCase) -> bool {
    case.system.dofs().len() > 1 && has_active_springs(case)
}

fn has_prescribed(case: &TestCase) -> bool {
    !case.system.prescribed().is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::integrate::StepFailure;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use crate::verify::fixtures::case;

    /// Two particles, joined or not, some of them held.
    fn pair(dimension: usize, joined: bool, held: &[usize]) -> TestCase {
        let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
        let y = if dimension > 1 { 0.5 } else { 0.0 };
        let ends = [builder.particle([0.0; 3], 1.0), builder.particle([1.5, y, 0.0], 2.0)];
        if joined {
            builder.spring(ends[0], ends[1], Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.1 });
        }
        held.iter().for_each(|&particle| {
            builder.hold(particle);
        });
        case(builder, 0.01)
    }

    fn applies(case: &TestCase, name: &str) -> bool {
        FAMILIES.iter().any(|family| family.name == name && (family.applies)(case))
    }

    /// Between held particles a spring neither pulls nor moves anything; without one there is nothing to differentiate.
    #[test]
    fn families_apply_where_there_is_something_to_check() {
        let moving = ["assembly", "solvers", "linear_steps", "other_steps", "always_definite", "on_demand", "inertia"];
        let pulled = ["jacobian", "dropped_terms", "derivatives", "conjugate_gradients", "rigid_motion"];
        let joined = ["work_energy", "options"];
        let all = |case: &TestCase, names: &[&str]| names.iter().all(|name| applies(case, name));
        let none = |case: &TestCase, names: &[&str]| !names.iter().any(|name| applies(case, name));
        let free = pair(2, true, &[0]);
        assert!(all(&free, &moving) && all(&free, &pulled) && all(&free, &joined) && all(&free, &["energy_balance"]));
        let stuck = pair(2, true, &[0, 1]);
        assert!(none(&stuck, &moving) && none(&stuck, &pulled) && all(&stuck, &joined));
        let apart = pair(2, false, &[0]);
        assert!(all(&apart, &moving) && none(&apart, &pulled) && none(&apart, &joined));
        let empty = case(SystemBuilder::new(), 0.01);
        assert!(none(&empty, &["equilibrium", "rigid_motion"]));
        assert!([free, stuck, empty].iter().all(|case| verify(case).all_passed()));
        // One coordinate alone is no system of equations.
        let systems = [pair(1, true, &[0]), pair(2, true, &[0]), pair(3, true, &[0]), pair(3, false, &[0])];
        assert_eq!(systems.each_ref().map(has_equations), [false, true, true, false]);
        // Free particles can turn in a plane and in space, and not along a line. A plane is flat, and so is a line.
        let turns = [1, 2, 3].map(|dimension| applies(&pair(dimension, true, &[]), "angular_momentum"));
        assert_eq!(turns, [false, true, true]);
        assert_eq!([1, 2, 3].map(|dimension| applies(&pair(dimension, true, &[]), "in_space")), [true, true, false]);
    }

    /// At rest without loads all errors and all units of rounding are zero: nothing is wrong.
    #[test]
    fn rest_is_no_fault() {
        let lone = |dimension| {
            let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
            builder.particle([1.0, 0.0, 0.0], 2.0);
            case(builder, 0.01)
        };
        let resting = [1, 2, 3].map(|dimension| pair(dimension, true, &[]).relaxed().unwrap());
        let held = [pair(2, true, &[0]).relaxed().unwrap(), pair(3, false, &[])];
        for case in resting.iter().chain(&held).chain(&[1, 2, 3].map(lone)) {
            let results = verify(case);
            let failures: Vec<_> = results.failures().map(|check| &check.name).collect();
            assert!(failures.is_empty() && results.passed() > 50, "{failures:?}");
        }
    }

    /// A family that measures nothing or meets an error fails; a step that reports its failure accuses nobody.
    #[test]
    fn unfinished_checks_fail_unless_a_failure_was_reported() {
        let check = |measure| family(Claim::Solvers, "a_name", |_| true, of_steps, measure).check(&pair(2, true, &[0]));
        let nothing = check(|_| Ok(Vec::new()));
        assert_eq!((nothing.len(), nothing[0].why.as_str(), nothing[0].passed()), (1, "nothing was measured", false));
        let broken = check(|_| Err(Error::Unsupported("not here".into()).into()));
        assert!(broken[0].is_judged && broken[0].why.starts_with("could not be carried out: "));
        let reported = check(|_| Err(StepFailure::NonFinite.into()));
        assert!(!reported[0].is_judged && reported[0].why.contains("reported"), "{}", reported[0].why);
        assert_eq!(reported[0].name, "a name");
    }

    /// Scenes whose rounding a check did not know: of a far particle that is held, of weights in a free fall, and of states where samples of it
    /// happen to be small.
    #[cfg(feature = "scene")]
    #[test]
    fn scenes_once_accused_pass() {
        for text in [
            include_str!("accused/far_held_particle.json"),
            include_str!("accused/long_fall.json"),
            include_str!("accused/lucky_rounding.json"),
        ] {
            let case = TestCase::of_scene(&crate::scene::Scene::from_json(text).unwrap()).unwrap();
            let results = verify(&case);
            let failures: Vec<_> = results.failures().map(|check| &check.name).collect();
            assert!(failures.is_empty() && results.passed() > 200, "{failures:?}");
        }
    }

    #[cfg(feature = "scene")]
    #[test]
    fn the_scenes_of_the_suite_are_all_judged() {
        for case in crate::verify::built_in().unwrap() {
            assert_eq!(of_steps(&case), None, "{}", case.name);
        }
    }
}
