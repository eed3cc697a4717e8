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
//! [`SpringVisitor`]. Of the method of Verlet velocities are then not those after the step but what the force is computed with:
//! predicted ones, or, without damping, those of the middle of the step, of which `h Δv` is what the ends move. Predicted rates are
//! off by an O(h²) that changes slowly: their differences r' − r by O(h³), and c by O(h²), which it is itself, so that the integral
//! remains right to the fourth order.
//!
//! Springs that end in a moving prescribed particle are accounted for in `driven`: their rates jump where paths have
//! kinks. Here they count for what they store.

use super::Sides;
use super::batch::{Pass, Step, WithForces};
use super::sums::{BLOCK, Block, Span, Sums};
use crate::error::DegenerateSpring;
use crate::force::batch::{BATCH, Coincident};
use crate::force::{coincide, first_degenerate, set_other_forces, set_total_force};
use crate::integrate::SpringVisitor;
use crate::spring::LawValues;
use crate::system::{Axes, State, StateView, System};
use nalgebra::Vector3;
use rayon::prelude::*;

/// All springs at the last state.
pub(super) struct Springs<'s> {
    system: &'s System,
    blocks: Vec<Block>,
    /// The springs between fixed particles.
    idle: Vec<u32>,
    /// Of a pass that has been made along with a step, before the step is entered.
    ahead: Option<Sums>,
}

impl<'s> Springs<'s> {
    /// At a state; `driven` are those whose damping is accounted for elsewhere, ascending.
    pub fn new(system: &'s System, state: &State, driven: impl Iterator<Item = usize>) -> Self {
        let springs = system.springs();
        let is_damped = springs.iter().any(|spring| spring.damping > 0.0);
        let mut blocks: Vec<Block> =
            springs.chunks(BLOCK).map(|springs| Block::new(springs.len(), is_damped)).collect();
        let mut driven = driven.peekable();
        for (number, spring) in springs.iter().enumerate().filter(|(number, _)| system.owns_spring(*number)) {
            let Block { kept, damping, .. } = &mut blocks[number / BLOCK];
            let (batch, slot) = (number % BLOCK / BATCH, number % BATCH);
            kept[batch].stiffness[slot] = spring.axial_stiffness();
            let is_driven = driven.next_if_eq(&number).is_some();
            if let Some(of_batch) = damping.get_mut(batch) {
                of_batch.damping[slot] = if is_driven { 0.0 } else { spring.damping };
                of_batch.resolved[slot] = resolved_step(system, number);
            }
        }
        let mut active = system.active_springs().iter().peekable();
        let idle = (0..springs.len() as u32).filter(|spring| active.next_if_eq(&spring).is_none()).collect();
        let mut springs = Self { system, blocks, idle, ahead: None };
        springs.pass(&state.moment(), 0.0);
        springs
    }

    /// What a step of dt seconds that led to a state adds up to: of the pass made along with it, or of one made now.
    pub fn enter(&mut self, state: &State, dt: f64) -> Sums {
        self.ahead.take().unwrap_or_else(|| self.pass(&state.moment(), dt))
    }

    /// Goes on to where a step of dt seconds led to.
    pub fn pass(&mut self, at: &StateView<'_>, dt: f64) -> Sums {
        let law = self.system.law_values(at.positions, at.time);
        let step = Step { law: &law, ..self.step(at, dt) };
        let pass = |(number, block): (usize, &mut Block)| {
            pulp::Arch::new().dispatch(Pass { step, first: number * BLOCK, block });
        };
        if self.blocks.len() > 1 {
            self.blocks.par_iter_mut().enumerate().for_each(pass);
        } else {
            self.blocks.iter_mut().enumerate().for_each(pass);
        }
        self.total()
    }

    fn step<'a>(&self, at: &StateView<'a>, dt: f64) -> Step<'a>
    where
        's: 'a,
    {
        Step { system: self.system, at: *at, law: LawValues::NONE, dt, inverse: if dt > 0.0 { 1.0 / dt } else { 0.0 } }
    }

    fn total(&self) -> Sums {
        self.blocks.iter().map(|block| &block.sums).fold(Sums::default(), Sums::add).of_all(self.system)
    }

    /// Whether fixed ends of a spring coincide, which is no error.
    fn has_fixed_without_length(&self, positions: &[Vector3<f64>]) -> bool {
        self.idle.iter().any(|&spring| coincide(positions, self.system.pair(spring as usize)))
    }
}

impl SpringVisitor for Springs<'_> {
    fn computes_forces(&self, system: &System) -> bool {
        std::ptr::eq(self.system, system)
            && !system.has_spring_law()
            && system.communicator().is_none()
            && system.thread_partitions().is_none()
    }

    fn set_force(&mut self, at: &StateView<'_>, dt: f64, force: &mut [Vector3<f64>]) -> Result<(), DegenerateSpring> {
        if self.has_fixed_without_length(at.positions) {
            set_total_force(self.system, at, force)?;
            self.see(at, dt);
            return Ok(());
        }
        set_other_forces(self.system, at, force);
        let step = self.step(at, dt);
        let done = pulp::Arch::new().dispatch(WithForces { step, blocks: &mut self.blocks, force });
        done.map_err(|Coincident| first_degenerate(self.system, at.positions))?;
        self.ahead = Some(self.total());
        Ok(())
    }

    fn see(&mut self, at: &StateView<'_>, dt: f64) {
        self.ahead = Some(self.pass(at, dt));
    }
}

/// 1/μ, the reciprocal of the reduced mass of the ends of a spring, in 1/kg.
fn mobility_of(system: &System, spring: usize) -> f64 {
    let inverse = |p: usize| if system.dofs().free_axes(p) == Axes::NONE { 0.0 } else { 1.0 / system.masses()[p] };
    system.pair(spring).into_iter().map(inverse).sum()
}

/// The longest step that resolves the motion of a spring between its ends, in s.
pub(super) fn resolved_step(system: &System, spring: usize) -> f64 {
    let mobility = mobility_of(system, spring);
    let spring = &system.springs()[spring];
    let vibration = (spring.axial_stiffness() * mobility).sqrt();
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
