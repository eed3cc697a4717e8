//! One pass over the springs after every step: what they store, and what their damping took.
//!
//! **Dissipation.** Damping takes the power `b r²`, r = n·Δv being the rate at which a spring lengthens. Over a step of h
//! seconds the mean of r is known exactly, `r̄ = (l' − l)/h`, and r itself at both ends. In Legendre polynomials the parabola
//! through these three is `r̄ + (r' − r)(s − ½) + c (6s² − 6s + 1)` with `c = (r + r')/2 − r̄`, and so
//!
//! ```text
//! ∫ b r² dt = b h (r̄² + (r' − r)²/12 + c²/5),
//! ```
//!
//! right to the fourth order. The first term alone is the least that any motion between these lengths dissipates (Jensen's
//! inequality), however it goes: that much is *certain*. The others are counted only where the step resolves the spring's own
//! motion, `h² k/(l0 μ) ≤ 1` and `h b/μ ≤ 1` with the reduced mass μ of its ends. Where it does not, rates at the ends of
//! steps are those of a ringing that the step has stepped over, and say nothing about what happened between.
//!
//! **Velocities at the end.** A method whose last force of a step is that at its end can have this pass made along with it, as a
//! [`Watch`]. Of the method of Verlet velocities are then not those after the step but what the force is computed with:
//! predicted ones, or, without damping, those of the middle of the step, of which `h Δv` is what the ends move. Predicted rates are
//! off by an O(h²) that changes slowly: their differences r' − r by O(h³), and c by O(h²), which it is itself, so that the integral
//! remains right to the fourth order.
//!
//! Springs that end in a moving prescribed particle are accounted for in `driven`: their rates jump where paths have
//! kinks. Here they count for what they store.

use super::Sides;
use super::batch::{Block, Step, WithForces};
use super::sums::{BLOCK, Constants, Span, Sums};
use crate::error::DegenerateSpring;
use crate::force::batch::Coincident;
use crate::force::{first_degenerate, has_only_active, set_other_forces};
use crate::integrate::watch::Watch;
use crate::spring::Spring;
use crate::system::{Axes, Moment, State, System};
use nalgebra::Vector3;
use rayon::prelude::*;

/// All springs at the last state.
pub(super) struct Springs<'s> {
    system: &'s System,
    spans: Vec<Span>,
    /// The longest step that resolves each spring, in s; negative for driven ones. Empty where nothing is damped.
    resolved: Vec<f64>,
    /// What each is, apart from its damping.
    constants: Vec<Constants>,
    sums: Vec<Sums>,
    /// Of a pass that has been made along with a step, before the step is entered.
    ahead: Option<Sums>,
}

impl<'s> Springs<'s> {
    /// At a state; `driven` are those that are accounted for elsewhere.
    pub fn new(system: &'s System, state: &State, driven: impl Iterator<Item = usize>) -> Self {
        let count = system.springs().len();
        let is_damped = system.springs().iter().any(|spring| spring.damping > 0.0);
        let mut resolved = Vec::new();
        if is_damped {
            resolved = (0..count).map(|spring| resolved_step(system, spring)).collect();
            driven.for_each(|spring| resolved[spring] = -1.0);
        }
        let (spans, sums) = (vec![Span::default(); count], vec![Sums::default(); count.div_ceil(BLOCK)]);
        let constants = |(number, spring): (usize, &Spring)| Constants {
            stiffness: spring.stiffness / spring.rest_length,
            mobility: mobility(system, number),
        };
        let constants = system.springs().iter().enumerate().map(constants).collect();
        let mut springs = Self { system, spans, resolved, constants, sums, ahead: None };
        springs.pass(&state.moment(), 0.0);
        springs
    }

    /// What a step of dt seconds that led to a state adds up to: of the pass made along with it, or of one made now.
    pub fn enter(&mut self, state: &State, dt: f64) -> Sums {
        self.ahead.take().unwrap_or_else(|| self.pass(&state.moment(), dt))
    }

    /// Goes on to where a step of dt seconds led to.
    pub fn pass(&mut self, at: &Moment<'_>, dt: f64) -> Sums {
        let step = self.step(at, dt);
        let Self { spans, resolved, constants, sums, .. } = self;
        let block = |(number, (spans, sums)): (usize, (&mut [Span], &mut Sums))| {
            let first = number * BLOCK;
            let resolved = resolved.get(first..).unwrap_or_default();
            let constants = &constants[first..first + spans.len()];
            *sums = pulp::Arch::new().dispatch(Block { step, resolved, constants, first, spans });
        };
        if sums.len() > 1 {
            spans.par_chunks_mut(BLOCK).zip(sums.par_iter_mut()).enumerate().for_each(block);
        } else {
            spans.chunks_mut(BLOCK).zip(sums.iter_mut()).enumerate().for_each(block);
        }
        self.total()
    }

    fn step<'a>(&self, at: &Moment<'a>, dt: f64) -> Step<'a>
    where
        's: 'a,
    {
        Step { system: self.system, at: *at, dt, inverse: if dt > 0.0 { 1.0 / dt } else { 0.0 } }
    }

    fn total(&self) -> Sums {
        self.sums.iter().fold(Sums::default(), Sums::add).of_all(self.system)
    }
}

impl Watch for Springs<'_> {
    fn takes_forces(&self, system: &System) -> bool {
        std::ptr::eq(self.system, system)
            && has_only_active(system)
            && !system.has_spring_law()
            && system.peers().is_none()
            && system.several_shares().is_none()
    }

    fn set_force(&mut self, at: &Moment<'_>, dt: f64, force: &mut [Vector3<f64>]) -> Result<(), DegenerateSpring> {
        set_other_forces(self.system, at, force);
        let step = self.step(at, dt);
        let Self { spans, resolved, constants, sums, .. } = self;
        let done = pulp::Arch::new().dispatch(WithForces { step, resolved, constants, spans, sums, force });
        done.map_err(|Coincident| first_degenerate(self.system, at.positions))?;
        self.ahead = Some(self.total());
        Ok(())
    }

    fn see(&mut self, at: &Moment<'_>, dt: f64) {
        self.ahead = Some(self.pass(at, dt));
    }
}

/// 1/μ, the reciprocal of the reduced mass of the ends of a spring, in 1/kg.
fn mobility(system: &System, spring: usize) -> f64 {
    let inverse = |p: usize| if system.dofs().free_axes(p) == Axes::NONE { 0.0 } else { 1.0 / system.masses()[p] };
    system.pair(spring).into_iter().map(inverse).sum()
}

/// The longest step that resolves the motion of a spring between its ends, in s.
pub(super) fn resolved_step(system: &System, spring: usize) -> f64 {
    let mobility = mobility(system, spring);
    let spring = &system.springs()[spring];
    let vibration = (spring.stiffness / spring.rest_length * mobility).sqrt();
    1.0 / vibration.max(spring.damping * mobility)
}

impl Sides {
    /// Of the rate at which a spring lengthens, over a step of 1/`inverse` seconds.
    pub fn of(before: &Span, length: f64, rate: f64, inverse: f64) -> Self {
        let mean = (length - before.length) * inverse;
        Self { mean, slope: rate - before.rate, bend: 0.5 * (before.rate + rate) - mean }
    }
}

/// n and the rate of a spring between two moving points; n is zero where they coincide.
pub(super) fn span(d: &Vector3<f64>, v: &Vector3<f64>) -> (Vector3<f64>, Span) {
    let length = d.norm();
    let n = if length > 0.0 { d / length } else { Vector3::zeros() };
    (n, Span { length, rate: n.dot(v) })
}

#[cfg(test)]
mod tests;
