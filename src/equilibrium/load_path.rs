//! Load paths: equilibria from no load to the full one, and the loads at which their inertia changes.
//!
//! Between two equilibria whose −K have different numbers of negative eigenvalues lies a critical load. Bisection locates it. On the direction u that
//! loses its stiffness there, and the load p, depends what it is:
//!
//! - `uᵀp = 0`, a bifurcation: another branch of equilibria leaves the path, as where a column buckles;
//! - `uᵀp ≠ 0`, a limit point: the path turns back, and at a higher load the next equilibrium is far away, as where a shallow arch snaps through.
//!
//! Where motions are free, as those of a slack net without a load, the path begins under the first load that gives them a direction. Behind a limit
//! point the inertia may be what it was before: a step over it agrees with no tangents of the path, so that halving steps that do not agree finds it.
//!
//! **Linear buckling** estimates the first critical load from a small one: the smallest λ at which `K_a + λ K_g` is singular, K_a the axial stiffness
//! at rest and K_g the transverse terms of the tensions per unit of load. It neglects how shape and tensions change on the way.

use super::search::SINGULAR;
use super::{Equilibrium, EquilibriumOptions, Stability, equilibrium, loads, minus_k};
use crate::eigen::{Pencil, product};
use crate::error::{Invalid, Result};
use crate::linear::{Ldlt, dot, norm};
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::Par;
use nalgebra::DVector;

/// The kind of a critical load.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CriticalKind {
    /// Other equilibria branch off.
    Bifurcation,
    /// The path turns back: at higher loads the next equilibrium is far away, or there is none.
    LimitPoint,
}

impl CriticalKind {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bifurcation => "bifurcation",
            Self::LimitPoint => "limit point",
        }
    }
}

/// A load at which the inertia changes, or the path ends.
#[derive(Debug, Clone, PartialEq)]
pub struct CriticalLoad {
    /// The factor of the full load.
    pub factor: f64,
    /// The kind.
    pub kind: CriticalKind,
    /// The direction that loses its stiffness, over the free degrees of freedom, of length 1.
    pub direction: Vec<f64>,
    /// The equilibrium just below that load.
    pub state: State,
}

/// Equilibria under rising loads.
#[derive(Debug, Clone)]
pub struct LoadPath {
    /// Factors of the full load with their equilibria, from zero to one; those followed, unstable ones too.
    pub steps: Vec<(f64, Equilibrium)>,
    /// Ascending.
    pub critical: Vec<CriticalLoad>,
    /// The first critical load by linear buckling; `None` where springs alone do not make the scene stiff, or nothing buckles.
    pub linear_buckling: Option<f64>,
}

/// Width of the interval to which critical factors are located.
const LOCATED: f64 = 4e-9;

/// The part of a step that the mean of the tangents at its ends may leave over: as much as of an arc of 95°, or of a step that comes seven times
/// nearer to a limit point.
const TURN: f64 = 0.25;

/// The equilibria of a system from no load to all of gravity and loads in `count` steps, each found from the one before, saddles included.
///
/// # Errors
/// No steps; as of [`equilibrium`].
pub fn load_path(system: &System, state: &State, count: usize) -> Result<LoadPath> {
    if count == 0 {
        return Err(Invalid::new("load-path", count, "must be at least 1").into());
    }
    let path = Path { system, load: system.dofs().reduced(&loads(system, state, 1.0)) };
    let first = path.at(0.0, state)?;
    let linear_buckling = path.linear_buckling(&first)?;
    let mut result = LoadPath { steps: vec![(0.0, first)], critical: Vec::new(), linear_buckling };
    for step in 1..=count {
        let target = step as f64 / count as f64;
        for _ in 0..20 {
            let (_, from) = &result.steps[result.steps.len() - 1];
            if matches!(from.stability, Stability::None | Stability::NotConverged) {
                return Ok(result);
            }
            let (critical, mut after) = path.advance(from.clone(), target)?;
            let Some(critical) = critical else {
                result.steps.push((after.load, after));
                break;
            };
            // Nearer to each other than they are located they are one: the last step before a limit point, which is steep there, and that over it.
            let _ = result.critical.pop_if(|before| critical.factor - before.factor <= 2.0 * LOCATED);
            result.critical.push(critical);
            // Just beyond a limit point little drives the search; under the load of the step it arrives.
            if after.stability == Stability::NotConverged {
                let options = EquilibriumOptions { load: target, ..EquilibriumOptions::default() };
                after = equilibrium(system, &after.state, options)?;
            }
            let is_done = after.load >= target;
            result.steps.push((after.load, after));
            if is_done {
                break;
            }
        }
    }
    Ok(result)
}

struct Path<'s> {
    system: &'s System,
    load: Vec<f64>,
}

impl Path<'_> {
    fn at(&self, load: f64, from: &State) -> Result<Equilibrium> {
        // Well below LOCATED, so that none is found beyond a limit point by what its force leaves over.
        let tolerance = 1e-12;
        let options = EquilibriumOptions { load, tolerance, leave_saddles: false, ..EquilibriumOptions::default() };
        equilibrium(self.system, from, options)
    }

    /// Whether the distance of two equilibria is more than a small part of all coordinates together.
    fn is_jump(&self, from: &Equilibrium, to: &Equilibrium) -> bool {
        let pairs = from.state.positions.iter().zip(&to.state.positions);
        let distance = pairs.map(|(a, b)| (a - b).norm_squared()).sum::<f64>().sqrt();
        let size = from.state.positions.iter().map(|x| x.norm_squared()).sum::<f64>().sqrt();
        distance > 1e-4 * size
    }

    /// The slope `dx/dλ = (−K)⁻¹ p` of the path on the free degrees of freedom; `None` where −K is singular. Free motions, along which no load acts,
    /// are shifted off zero.
    fn tangent(&self, at: &Equilibrium) -> Result<Option<DVector<f64>>> {
        let mut a = minus_k(self.system, &at.state, Stiffness::Full)?;
        if at.inertia.zero > 0 {
            let norm = Pencil::of(&a).norm();
            a.shift(SINGULAR * norm);
        }
        Ok(a.ldlt().ok().and_then(|mut factored| factored.solve(&self.load).ok()).map(DVector::from_vec))
    }

    /// Whether the path leads from one equilibrium to another: the inertia is the same, and the secant agrees with the tangents at both ends,
    ///
    /// ```text
    /// |x₁ − x₀ − ½ (λ₁ − λ₀) (x₀' + x₁')| ≤ TURN |x₁ − x₀|,      (λ₁ − λ₀) |x₁' − x₀'| ≤ |x₁ − x₀|.
    /// ```
    ///
    /// On a smooth path what is left over the length falls with the square of the step, and the turn of the tangent with the step. A step onto
    /// another branch does not become shorter, and agrees with no tangents: just below a limit point the tangent alone may be as long as the jump,
    /// but turns by twice that. Where there is no tangent the inertia alone tells.
    fn leads(&self, from: &Equilibrium, to: &Equilibrium) -> Result<bool> {
        if to.stability == Stability::NotConverged || to.inertia.negative != from.inertia.negative {
            return Ok(false);
        }
        if !self.is_jump(from, to) {
            return Ok(true);
        }
        let (Some(before), Some(after)) = (self.tangent(from)?, self.tangent(to)?) else { return Ok(true) };
        let place = |at: &Equilibrium| DVector::from_vec(self.system.dofs().reduced(&at.state.positions));
        let (secant, rise) = (place(to) - place(from), to.load - from.load);
        let left = &secant - (&before + &after) * (0.5 * rise);
        let turn = (after - before) * rise;
        let [secant, left, turn] = [secant, left, turn].map(|vector| norm(vector.as_slice()));
        Ok(left <= TURN * secant && turn <= secant)
    }

    /// Follows the path from an equilibrium to a load, or to the first critical load before it: that load, and the equilibrium that was reached,
    /// beyond the critical load. Steps that do not lead on are halved.
    fn advance(&self, start: Equilibrium, target: f64) -> Result<(Option<CriticalLoad>, Equilibrium)> {
        let factor = start.load;
        let last = self.at(target, &start.state)?;
        // What hangs has fallen, and no equilibrium led there. Under a load a motion without stiffness is a critical one.
        if factor == 0.0 && last.inertia.zero < start.inertia.zero {
            return Ok((None, last));
        }
        let mut ahead = vec![last];
        let mut low = start;
        while let Some(found) = ahead.pop() {
            if self.leads(&low, &found)? {
                low = found;
                continue;
            }
            if found.load - low.load > LOCATED {
                let middle = self.at(0.5 * (low.load + found.load), &low.state)?;
                ahead.extend([found, middle]);
                continue;
            }
            // It may have been found from farther away.
            let high = self.at(found.load, &low.state)?;
            let changes = high.inertia.negative != low.inertia.negative;
            let jumped = high.stability == Stability::NotConverged || self.is_jump(&low, &high);
            if changes || jumped {
                return Ok((Some(self.critical(factor, low, high.load, jumped)?), high));
            }
            low = high;
        }
        Ok((None, low))
    }

    /// The critical load just above an equilibrium and below another factor, on a path from a first factor.
    fn critical(&self, factor: f64, low: Equilibrium, high: f64, jumped: bool) -> Result<CriticalLoad> {
        let mut factor_found = 0.5 * (low.load + high);
        let (mut value, mut direction) = self.softest(&low.state)?;
        let mut state = low.state;
        if !jumped {
            // The inertia changes where the eigenvalue is below the band of zeros; the load at which it is zero, by secants.
            let mut other = low.load - 1e-3 * (low.load - factor);
            for _ in 0..10 {
                let found = self.at(other, &state)?.state;
                let (there, its) = self.softest(&found)?;
                let next = other - there * (other - factor_found) / (there - value);
                let is_done = (next - other).abs() <= LOCATED;
                (factor_found, value, state, direction) = (other, there, found, its);
                if !(factor..=high).contains(&next) || is_done {
                    break;
                }
                other = next;
            }
        }
        let along = dot(&direction, &self.load).abs() / norm(&self.load);
        let kind = if jumped || along > 1e-3 { CriticalKind::LimitPoint } else { CriticalKind::Bifurcation };
        Ok(CriticalLoad { factor: factor_found, kind, direction, state })
    }

    /// The eigenvalue of −K nearest to zero, in N/m, and its eigenvector, by inverse iteration.
    fn softest(&self, state: &State) -> Result<(f64, Vec<f64>)> {
        let a = minus_k(self.system, state, Stiffness::Full)?;
        let mut direction: Vec<f64> = (0..a.pattern().order()).map(|row| 1.0 + 0.5 * (row as f64).sin()).collect();
        if let Ok(mut factored) = a.ldlt() {
            for _ in 0..20 {
                direction = factored.solve(&direction)?;
                let length = norm(&direction);
                direction.iter_mut().for_each(|u| *u /= length);
            }
        }
        Ok((dot(&direction, &product(&a, &direction)), direction))
    }

    /// Up to λ = 1e6.
    fn linear_buckling(&self, rest: &Equilibrium) -> Result<Option<f64>> {
        if self.load.iter().all(|f| *f == 0.0) || rest.stability != Stability::Stable {
            return Ok(None);
        }
        let small = 1e-6;
        let little = self.at(small, &rest.state)?;
        let axial = minus_k(self.system, &little.state, Stiffness::Axial)?;
        let full = minus_k(self.system, &little.state, Stiffness::Full)?;
        let mut factorization = Ldlt::analyse(axial.pattern(), Par::rayon(0))?;
        let mut is_positive = |factor: f64| {
            let part = factor / small;
            let a = axial.scaled(1.0 - part).plus(&full.scaled(part));
            factorization.factor(&a).is_ok() && factorization.is_positive()
        };
        if !is_positive(0.0) {
            return Ok(None);
        }
        let (mut low, mut high) = (0.0, small);
        while is_positive(high) {
            low = high;
            high *= 2.0;
            if high > 1e6 {
                return Ok(None);
            }
        }
        while high - low > 1e-10 * high {
            let middle = 0.5 * (low + high);
            if is_positive(middle) { low = middle } else { high = middle }
        }
        Ok(Some(0.5 * (low + high)))
    }
}
