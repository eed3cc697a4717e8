//! What the options promise about definiteness, and whether the factorizations judge it right.

use super::measured::Measured;
use super::reference::{self, dense_step_matrix};
use super::runs::{Way, differences, direct};
use super::{Check, Claim, TestCase, U, Unfinished};
use crate::assembly::SymmetricMatrix;
use crate::integrate::{Method, StepMatrices, StiffnessPolicy};
use crate::linear::{Cholesky, Ldlt};
use crate::spring::Stiffness;
use faer::Par;

/// Degrees of freedom up to which all eigenvalues are computed.
const DENSE: usize = 200;

/// Steps that are tried, as multiples of the subject's.
const FACTORS: [f64; 8] = [0.25, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0];

/// Degrees of freedom up to which many steps of the same scene are affordable.
const AFFORDABLE: usize = 2000;

pub(super) fn is_affordable(subject: &TestCase) -> bool {
    (1..=AFFORDABLE).contains(&subject.system.dofs().len())
}

pub(super) fn is_small(subject: &TestCase) -> bool {
    (1..=DENSE).contains(&subject.system.dofs().len())
}

/// Without compressed springs `tension` is `full`; without stretched ones it is `axial`: the same K, to the bit.
pub(super) fn options(subject: &TestCase) -> Measured {
    let why = "an option only decides which terms are added, not how: not one bit may differ";
    let compare = |twin: TestCase, option: Stiffness, name: &str| -> Result<Check, Unfinished> {
        let k = |option| StepMatrices::assemble(&twin.system, &twin.state, option, twin.dt).map(|matrices| matrices.k);
        let (tension, other) = (k(Stiffness::Tension)?, k(option)?);
        let pairs = tension.values().iter().zip(other.values());
        let differing = pairs.filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        Ok(Check::new(Claim::Definiteness, name, &subject.name, differing as f64, 0.0, why))
    };
    Ok(vec![
        compare(subject.stretched()?, Stiffness::Full, "tension is full where all springs are stretched")?,
        compare(subject.squeezed()?, Stiffness::Axial, "tension is axial where all springs are compressed")?,
    ])
}

/// Under `tension` and `axial`, `λ_min(A) ≥ m_min/dt²`: A − (1 − ε) m_min/dt² is definite at every step.
pub(super) fn always(subject: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for option in [Stiffness::Tension, Stiffness::Axial] {
        for twin in [subject.clone(), subject.stretched()?, subject.squeezed()?] {
            let mut factored = Factored::new(&twin)?;
            let mut refused = 0;
            let mut tried = 0;
            for dt in FACTORS.map(|factor| factor * twin.dt) {
                let Some(shift) = promise(&twin, dt) else { continue };
                tried += 1;
                refused += u32::from(factored.refuses(&twin, option, dt, shift)?);
            }
            let why = "refusals of A less its promised smallest eigenvalue m_min/dt², at steps from a quarter of dt to 4096 dt \
                       as far as rounding can tell";
            let name = format!("{} is definite at every step", option.name());
            checks.push(unless_untried(
                tried,
                Check::new(Claim::Definiteness, name, &twin.name, f64::from(refused), 0.0, why),
            ));
        }
    }
    Ok(checks)
}

/// The check, where something was tried for it.
fn unless_untried(tried: usize, check: Check) -> Check {
    if tried > 0 {
        return check;
    }
    let reason = "at steps from a quarter of dt to 4096 dt rounding hides the smallest eigenvalue";
    Check::not_judged(check.claim, check.name, check.scene, reason)
}

/// Cholesky's verdict and the signs of D against the signs of all eigenvalues, at steps across the critical one; and the
/// number of negative ones never falls as the step grows.
pub(super) fn inertia(subject: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for twin in [subject.clone(), subject.squeezed()?] {
        let mut factored = Factored::new(&twin)?;
        let (mut wrong, mut falls, mut known) = (0, 0, 0);
        let mut last = 0;
        for dt in FACTORS.map(|factor| factor * twin.dt) {
            let eigenvalues = dense_step_matrix(&twin, Stiffness::Full, dt).symmetric_eigenvalues();
            let rounding = rounding(&twin, dt);
            if eigenvalues.iter().any(|value| value.abs() <= rounding) {
                continue;
            }
            known += 1;
            let negative = eigenvalues.iter().filter(|&&value| value < 0.0).count();
            let a = StepMatrices::assemble(&twin.system, &twin.state, Stiffness::Full, dt)?.a;
            let accepted = factored.cholesky.factor(&a).is_ok();
            let counted = factored.negative_pivots(&a);
            wrong += usize::from(accepted != (negative == 0) || counted != Some(negative));
            falls += usize::from(counted.is_none_or(|counted| counted < last));
            last = counted.unwrap_or(last);
        }
        let why = "at steps from a quarter of dt to 4096 dt, those left out at which an eigenvalue is within rounding of zero";
        let check =
            Check::new(Claim::Definiteness, "inertia against all eigenvalues", &twin.name, wrong as f64, 0.0, why);
        checks.push(unless_untried(known, check));
        let why = "uᵀA(dt)u falls as dt grows, for every u, because M ≥ 0 and −G ≥ 0";
        let name = "negative eigenvalues only increase with the step";
        checks.push(Check::new(Claim::Definiteness, name, &twin.name, falls as f64, 0.0, why));
    }
    Ok(checks)
}

/// `on-demand` is `full` in every step that `full` can do, to the bit, and can do every other step too.
pub(super) fn on_demand(subject: &TestCase) -> Measured {
    let mut checks = Vec::new();
    let way = Way { method: Method::LinearBackwardEuler, stiffness: StiffnessPolicy::OnDemand };
    let (mut different, mut compared) = (0.0, 0);
    for twin in [subject.clone(), subject.squeezed()?] {
        let mut refused = 0;
        for dt in FACTORS.map(|factor| factor * twin.dt) {
            if promise(&twin, dt).is_none() {
                continue;
            }
            let full = Way::notes(Stiffness::Full).run(&twin, direct(), dt, 1)?;
            match way.run(&twin, direct(), dt, 1) {
                Ok(on_demand) if full.is_some() => {
                    different += differences(&full, &on_demand);
                    compared += 1;
                }
                Ok(_) => {}
                Err(_) => refused += 1,
            }
        }
        let why = "refused steps from a quarter of dt to 4096 dt, as far as rounding can tell: dropping the terms of compressed \
                   springs always suffices";
        let name = "on-demand can do every step";
        checks.push(Check::new(Claim::Definiteness, name, &twin.name, f64::from(refused), 0.0, why));
    }
    let why = "where A is definite nothing is dropped: the same matrix, not one bit may differ";
    let name = "on-demand is full where full is definite";
    checks.push(unless_untried(compared, Check::new(Claim::Definiteness, name, &subject.name, different, 0.0, why)));
    Ok(checks)
}

/// `m_min/dt²`, less the rounding of a pivot, n u ‖A‖; `None` where rounding leaves less than half of it.
fn promise(subject: &TestCase, dt: f64) -> Option<f64> {
    let lightest = reference::movers(&subject.system).map(|p| subject.system.masses()[p]).fold(f64::INFINITY, f64::min);
    let least = lightest / (dt * dt);
    let rounding = rounding(subject, dt);
    (rounding <= 0.5 * least).then_some(least - rounding)
}

/// What rounding may do to a pivot or an eigenvalue: 4 n u ‖A‖.
fn rounding(subject: &TestCase, dt: f64) -> f64 {
    4.0 * subject.system.dofs().len() as f64 * U * reference::step_matrix_norm(subject, &subject.state, dt)
}

/// Both factorizations on a subject's pattern.
pub(super) struct Factored {
    pub cholesky: Cholesky,
    pub ldlt: Ldlt,
}

impl Factored {
    pub fn new(subject: &TestCase) -> Result<Self, Unfinished> {
        let a = StepMatrices::assemble(&subject.system, &subject.state, Stiffness::Tension, subject.dt)?.a;
        let pattern = a.pattern();
        Ok(Self { cholesky: Cholesky::analyse(pattern, Par::Seq)?, ldlt: Ldlt::analyse(pattern, Par::Seq)? })
    }

    /// Whether Cholesky refuses a step's A less so much on its diagonal.
    fn refuses(&mut self, subject: &TestCase, option: Stiffness, dt: f64, shift: f64) -> Result<bool, Unfinished> {
        let TestCase { system, state, .. } = subject;
        let mut a = StepMatrices::assemble(system, state, option, dt)?.a;
        (0..system.particles()).for_each(|p| a.add_to_diagonal(p, -shift));
        Ok(self.cholesky.factor(&a).is_err())
    }

    /// The number of negative pivots of LDLᵀ; `None` where it breaks down.
    pub fn negative_pivots(&mut self, a: &SymmetricMatrix) -> Option<usize> {
        self.ldlt.factor(a).ok()?;
        Some(self.ldlt.pivots().filter(|&(_, pivot)| pivot < 0.0).count())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// A particle 1 m from a held one on a spring at rest.
    fn pair(dt: f64) -> TestCase {
        let mut builder = SystemBuilder::new();
        let (anchor, bob) = (builder.particle([0.0; 3], 1.0), builder.particle([1.0, 0.0, 0.0], 1.0));
        builder.spring(anchor, bob, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
        builder.hold(anchor);
        let (system, state) = builder.build().unwrap();
        TestCase { name: "pair".into(), system, state, dt }
    }

    /// A is 1/dt² = 64 N/m across the spring, and 164 N/m along it.
    #[test]
    fn no_more_than_the_smallest_eigenvalue_is_left_out() {
        let pair = pair(0.125);
        let mut factored = Factored::new(&pair).unwrap();
        let mut refuses = |shift| factored.refuses(&pair, Stiffness::Tension, 0.125, shift).unwrap();
        assert_eq!([refuses(-1e3), refuses(0.0), refuses(63.9), refuses(64.1)], [false, false, false, true]);
        let rounding = rounding(&pair, 0.125);
        assert_eq!(rounding, 12.0 * U * reference::step_matrix_norm(&pair, &pair.state, 0.125));
        assert_eq!(promise(&pair, 0.125), Some(64.0 - rounding));
    }

    /// With steps of 10¹² s rounding hides the masses, and with them all that could be said.
    #[test]
    fn what_was_never_tried_is_not_judged() {
        let judged = |checks: Measured, name: &str| -> Vec<bool> {
            checks.unwrap().iter().filter(|check| check.name.contains(name)).map(|check| check.is_judged).collect()
        };
        assert_eq!(judged(always(&pair(1e12)), "every step"), [false; 6]);
        assert!(!judged(inertia(&pair(1e12)), "all eigenvalues")[0]);
        assert_eq!(judged(on_demand(&pair(1e12)), "is full where"), [false]);
        for checks in [always(&pair(0.01)), inertia(&pair(0.01)), on_demand(&pair(0.01)), options(&pair(0.01))] {
            assert!(checks.unwrap().iter().all(|check| check.is_judged && check.passed()));
        }
    }
}
