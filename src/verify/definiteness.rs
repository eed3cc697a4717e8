//! The promises of the options about definiteness, and the verdicts of the factorizations.

use super::reference::{self, dense_step_matrix};
use super::runs::differences;
use super::{AFFORDABLE, Check, Claim, Measured, MethodVariant, TestCase, U, direct};
use crate::assembly::SymmetricMatrix;
use crate::integrate::StepMatrices;
use crate::linear::{Cholesky, Ldlt};
use crate::spring::Stiffness;
use faer::Par;

/// The steps, as multiples of the scene's.
const FACTORS: [f64; 8] = [0.25, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0];

pub(super) fn is_affordable(case: &TestCase) -> bool {
    (1..=AFFORDABLE).contains(&case.system.dofs().len())
}

/// Whether all eigenvalues are affordable.
pub(super) fn is_small(case: &TestCase) -> bool {
    (1..=200).contains(&case.system.dofs().len())
}

fn check(name: impl Into<String>, case: &TestCase, value: f64, why: &str) -> Check {
    Check::new(Claim::Definiteness, name, &case.name, value, 0.0, why)
}

/// The check, unless rounding left no step to try.
fn if_tried(tried: usize, check: Check) -> Check {
    if tried > 0 {
        return check;
    }
    let reason = "at steps from a quarter of dt to 4096 dt rounding hides the smallest eigenvalue";
    Check::not_judged(check.claim, check.name, check.scene, reason)
}

/// Without compressed springs `tension` is `full`; without stretched ones it is `axial`: the same K, to the bit.
pub(super) fn options(case: &TestCase) -> Measured {
    let why = "an option only decides which terms are added, not how: not one bit may differ";
    let compare = |twin: TestCase, option: Stiffness, name: &str| -> Measured<Check> {
        let k = |option| StepMatrices::assemble(&twin.system, &twin.state, option, twin.dt).map(|matrices| matrices.k);
        let (tension, other) = (k(Stiffness::Tension)?, k(option)?);
        let pairs = tension.values().iter().zip(other.values());
        let differing = pairs.filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        Ok(check(name, case, differing as f64, why))
    };
    Ok(vec![
        compare(case.stretched()?, Stiffness::Full, "tension is full where all springs are stretched")?,
        compare(case.squeezed()?, Stiffness::Axial, "tension is axial where all springs are compressed")?,
    ])
}

/// Under `tension`, `axial` and `absolute`, `λ_min(A) ≥ m_min/dt²`: A − (1 − ε) m_min/dt² is definite at every step.
pub(super) fn always(case: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for option in [Stiffness::Tension, Stiffness::Axial, Stiffness::Absolute] {
        for twin in [case.clone(), case.stretched()?, case.squeezed()?] {
            let mut factored = Factored::new(&twin)?;
            let (mut refused, mut tried) = (0, 0);
            for dt in FACTORS.map(|factor| factor * twin.dt) {
                let Some(shift) = least_eigenvalue(&twin, dt) else { continue };
                tried += 1;
                refused += u32::from(factored.refuses(&twin, option, dt, shift)?);
            }
            let why = "refusals of A less its promised smallest eigenvalue m_min/dt², at steps from a quarter of dt to 4096 dt \
                       as far as rounding can tell";
            let name = format!("{} is definite at every step", option.name());
            checks.push(if_tried(tried, check(name, &twin, f64::from(refused), why)));
        }
    }
    Ok(checks)
}

/// Cholesky's verdict and the signs of D against all eigenvalues at steps across the critical one; negative ones never get fewer as it grows.
pub(super) fn inertia(case: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for twin in [case.clone(), case.squeezed()?] {
        let mut factored = Factored::new(&twin)?;
        let (mut wrong, mut falls, mut tried, mut last) = (0, 0, 0, 0);
        for dt in FACTORS.map(|factor| factor * twin.dt) {
            let eigenvalues = dense_step_matrix(&twin, Stiffness::Full, dt).symmetric_eigenvalues();
            let rounding = rounding(&twin, dt);
            if eigenvalues.iter().any(|value| value.abs() <= rounding) {
                continue;
            }
            tried += 1;
            let negative = eigenvalues.iter().filter(|&&value| value < 0.0).count();
            let a = StepMatrices::assemble(&twin.system, &twin.state, Stiffness::Full, dt)?.a;
            let accepted = factored.cholesky.factor(&a).is_ok();
            let counted = factored.negative_pivots(&a);
            wrong += usize::from(accepted != (negative == 0) || counted != Some(negative));
            falls += usize::from(counted.is_none_or(|counted| counted < last));
            last = counted.unwrap_or(last);
        }
        let why =
            "at steps from a quarter of dt to 4096 dt, without those at which an eigenvalue is within rounding of zero";
        checks.push(if_tried(tried, check("inertia against all eigenvalues", &twin, wrong as f64, why)));
        let why = "uᵀA(dt)u falls as dt grows, for every u, because M ≥ 0 and −G ≥ 0";
        checks.push(check("negative eigenvalues only increase with the step", &twin, falls as f64, why));
    }
    Ok(checks)
}

/// `on-demand` is `full` in every step that `full` can do, to the bit, and can do every other step too.
pub(super) fn on_demand(case: &TestCase) -> Measured {
    let mut checks = Vec::new();
    let (mut different, mut compared) = (0.0, 0);
    for twin in [case.clone(), case.squeezed()?] {
        let mut refused = 0;
        for dt in FACTORS.map(|factor| factor * twin.dt) {
            if least_eigenvalue(&twin, dt).is_none() {
                continue;
            }
            let full = MethodVariant::linear(Stiffness::Full).run(&twin, direct(), dt, 1)?;
            match MethodVariant::on_demand().run(&twin, direct(), dt, 1) {
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
        checks.push(check("on-demand can do every step", &twin, f64::from(refused), why));
    }
    let why = "where A is definite nothing is dropped: the same matrix, not one bit may differ";
    checks.push(if_tried(compared, check("on-demand is full where full is definite", case, different, why)));
    Ok(checks)
}

/// `m_min/dt²`, less the rounding of a pivot, n u ‖A‖; `None` where rounding leaves less than half of it.
fn least_eigenvalue(case: &TestCase, dt: f64) -> Option<f64> {
    let least = reference::lightest(&case.system) / (dt * dt);
    let rounding = rounding(case, dt);
    (rounding <= 0.5 * least).then_some(least - rounding)
}

/// The rounding of a pivot or an eigenvalue: 4 n u ‖A‖.
fn rounding(case: &TestCase, dt: f64) -> f64 {
    4.0 * case.system.dofs().len() as f64 * U * reference::step_matrix_norm(case, &case.state, dt)
}

struct Factored {
    cholesky: Cholesky,
    ldlt: Ldlt,
}

impl Factored {
    fn new(case: &TestCase) -> Measured<Self> {
        let a = StepMatrices::assemble(&case.system, &case.state, Stiffness::Tension, case.dt)?.a;
        let pattern = a.pattern();
        Ok(Self { cholesky: Cholesky::analyse(pattern, Par::Seq)?, ldlt: Ldlt::analyse(pattern, Par::Seq)? })
    }

    /// Whether Cholesky refuses the A of a step with its diagonal lowered by `shift`.
    fn refuses(&mut self, case: &TestCase, option: Stiffness, dt: f64, shift: f64) -> Measured<bool> {
        let mut a = StepMatrices::assemble(&case.system, &case.state, option, dt)?.a;
        (0..case.system.particles()).for_each(|p| a.add_to_diagonal(p, -shift));
        Ok(self.cholesky.factor(&a).is_err())
    }

    fn negative_pivots(&mut self, a: &SymmetricMatrix) -> Option<usize> {
        self.ldlt.factor(a).ok()?;
        Some(self.ldlt.pivots().filter(|&(_, pivot)| pivot < 0.0).count())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures::pair;

    /// A is 1/dt² = 64 N/m across the spring, which is at rest, and 164 N/m along it.
    #[test]
    fn a_shift_by_less_than_the_smallest_eigenvalue_is_accepted() {
        let pair = pair(1.0, 0.125);
        let mut factored = Factored::new(&pair).unwrap();
        let mut refuses = |shift| factored.refuses(&pair, Stiffness::Tension, 0.125, shift).unwrap();
        assert_eq!([refuses(-1e3), refuses(0.0), refuses(63.9), refuses(64.1)], [false, false, false, true]);
        let rounding = rounding(&pair, 0.125);
        assert_eq!(rounding, 12.0 * U * reference::step_matrix_norm(&pair, &pair.state, 0.125));
        assert_eq!(least_eigenvalue(&pair, 0.125), Some(64.0 - rounding));
    }

    /// With steps of 10¹² s rounding hides the masses, and with them all that could be checked.
    #[test]
    fn a_check_without_a_step_to_try_is_not_judged() {
        let judged = |checks: Measured, name: &str| -> Vec<bool> {
            checks.unwrap().iter().filter(|check| check.name.contains(name)).map(|check| check.is_judged).collect()
        };
        let (long, short) = (pair(1.0, 1e12), pair(1.0, 0.01));
        assert_eq!(judged(always(&long), "every step"), [false; 9]);
        assert!(!judged(inertia(&long), "all eigenvalues")[0]);
        assert_eq!(judged(on_demand(&long), "is full where"), [false]);
        for checks in [always(&short), inertia(&short), on_demand(&short), options(&short)] {
            assert!(checks.unwrap().iter().all(|check| check.is_judged && check.passed()));
        }
    }
}
