//! The energy that springs store, and what their damping takes, in one pass over the springs after every step.
//!
//! Damping takes the power `b r²`, r = n·Δv the rate at which a spring lengthens. Over a step of h seconds the mean of r is known exactly,
//! `r̄ = (l' − l)/h`, and r at both ends. In Legendre polynomials the parabola through these three is `r̄ + (r' − r)(s − ½) + c (6s² − 6s + 1)` with
//! `c = (r + r')/2 − r̄`, so that
//!
//! ```text
//! ∫ b r² dt = b h (r̄² + (r' − r)²/12 + c²/5),
//! ```
//!
//! to fourth order. The first term is the least that any motion between these lengths dissipates (Jensen's inequality): it is *certain*. The others
//! count only where the step resolves the spring's own motion, `h² k/(l0 μ) ≤ 1` and `h b/μ ≤ 1` with the reduced mass μ of its ends: beyond that,
//! rates at the ends of steps say nothing about what happens between.
//!
//! A method whose last force evaluation is at the end of the step makes the pass along with it. Verlet's rates are then off by an O(h²) that changes
//! slowly, and the integral stays right to fourth order.
//!
//! The damping of springs that end in a moving prescribed particle is counted elsewhere (`integrate::monitor::work`): their rates jump at kinks of
//! the path.
//!
//! A slack tension-only spring has no damping: `b ∫ ċ² dt` with `c = max(l, l0)` takes the place of the integral over r.
//!
//! Sums are made slot by slot of a batch and block by block, so that they have the same bits for any number of threads.

use super::DegenerateSpring;
use super::batch::{Accumulator, BATCH, Batch as Forces, Coincident, List};
use super::total::{coincide, first_degenerate, set_other_forces, set_total_force};
use crate::registers::dispatch_simd;
use crate::spring::{Extension, LawValues, Spring};
use crate::system::{Axes, State, StateView, System};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::ops::Range;

/// Springs or particles of a block, which one thread treats at a stretch.
pub(crate) const BLOCK: usize = 128 * BATCH;

/// Energies of springs at a state and over the step that led to it, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SpringSums {
    /// ½ k (l − l0)²/l0.
    pub elastic: f64,
    /// Work of constraints, loads and rest lengths.
    pub work: f64,
    /// Dissipated by damping and drag.
    pub dissipated: f64,
    /// The least that damping can have taken.
    pub certain: f64,
}

impl SpringSums {
    pub(crate) fn add(self, other: &Self) -> Self {
        Self {
            elastic: self.elastic + other.elastic,
            work: self.work + other.work,
            dissipated: self.dissipated + other.dissipated,
            certain: self.certain + other.certain,
        }
    }

    /// Together with the sums of all other parts of a system.
    pub(crate) fn of_all_parts(self, system: &System) -> Self {
        let Self { elastic, work, dissipated, certain } = self;
        let [elastic, work, dissipated, certain] = system.total([elastic, work, dissipated, certain]);
        Self { elastic, work, dissipated, certain }
    }
}

/// A rate over a step as a parabola in Legendre polynomials.
pub(crate) struct RateParabola {
    pub mean: f64,
    pub slope: f64,
    pub second_difference: f64,
}

impl RateParabola {
    /// The rate at which a spring lengthens in a step of 1/`inverse` seconds, from lengths and rates at both ends.
    #[inline(always)]
    pub fn new(lengths: [f64; 2], rates: [f64; 2], inverse: f64) -> Self {
        let mean = (lengths[1] - lengths[0]) * inverse;
        Self { mean, slope: rates[1] - rates[0], second_difference: 0.5 * (rates[0] + rates[1]) - mean }
    }
}

/// The springs of a batch at the last state. Slots without a spring, or with one that another part counts, have neither stiffness nor damping.
#[derive(Clone, Default)]
struct Batch {
    /// k/l0, in N/m.
    stiffness: List,
    length: List,
    rate: List,
    /// Zero where the dissipation is counted elsewhere.
    damping: List,
    /// The longest step that resolves each spring, in s.
    resolved: List,
    /// Tension-only springs that are slack.
    is_slack: [bool; BATCH],
}

struct Block {
    batches: Vec<Batch>,
    sums: SpringSums,
}

/// The springs at the last state of a run.
pub struct SpringEnergies<'s> {
    system: &'s System,
    is_damped: bool,
    blocks: Vec<Block>,
    /// The springs between fixed particles.
    idle: Vec<u32>,
    /// The sums of a pass made along with a step that is not entered yet.
    ahead: Option<SpringSums>,
}

impl<'s> SpringEnergies<'s> {
    /// At a state; `driven` are the springs whose damping is counted elsewhere, ascending.
    pub(crate) fn new(system: &'s System, state: &State, driven: impl Iterator<Item = usize>) -> Self {
        let springs = system.springs();
        let block = |springs: &[Spring]| {
            let batches = vec![Batch::default(); springs.len().div_ceil(BATCH)];
            Block { batches, sums: SpringSums::default() }
        };
        let mut blocks: Vec<Block> = springs.chunks(BLOCK).map(block).collect();
        let mut driven = driven.peekable();
        for (number, spring) in springs.iter().enumerate().filter(|(number, _)| system.owns_spring(*number)) {
            let (batch, slot) = (&mut blocks[number / BLOCK].batches[number % BLOCK / BATCH], number % BATCH);
            let is_driven = driven.next_if_eq(&number).is_some();
            batch.stiffness[slot] = spring.axial_stiffness();
            batch.damping[slot] = if is_driven { 0.0 } else { spring.damping };
            batch.resolved[slot] = resolved_step(system, number);
        }
        let mut active = system.active_springs().iter().peekable();
        let idle = (0..springs.len() as u32).filter(|spring| active.next_if_eq(&spring).is_none()).collect();
        let is_damped = springs.iter().any(|spring| spring.damping > 0.0);
        let mut springs = Self { system, is_damped, blocks, idle, ahead: None };
        springs.pass(&state.moment(), 0.0);
        springs
    }

    /// Does [`set_total_force`] and [`see`](Self::see), in one pass where one thread has all springs, with the same bits except in the forces on
    /// fixed particles, which nothing depends on. A spring whose ends coincide is an error.
    pub(crate) fn set_force(
        &mut self,
        system: &System,
        at: &StateView<'_>,
        dt: f64,
        force: &mut [Vector3<f64>],
    ) -> Result<(), DegenerateSpring> {
        let is_whole = std::ptr::eq(self.system, system) && system.communicator().is_none();
        let is_simple = is_whole && !system.has_spring_law() && system.thread_partitions().is_none();
        // Fixed ends may coincide.
        let coincide = |&spring: &u32| coincide(at.positions, system.pair(spring as usize));
        if !is_simple || self.idle.iter().any(coincide) {
            set_total_force(system, at, force)?;
            self.see(at, dt);
            return Ok(());
        }
        set_other_forces(system, at, force);
        let step = Step { system, at: *at, law: LawValues::NONE, dt, is_damped: self.is_damped };
        let done = step.pass(0, &mut self.blocks, Some(force));
        done.map_err(|Coincident| first_degenerate(system, at.positions))?;
        self.ahead = Some(self.total());
        Ok(())
    }

    /// Visits the springs at the end of a step of dt seconds, with the velocities of the method's force evaluation; not at a foreign state.
    pub(crate) fn see(&mut self, at: &StateView<'_>, dt: f64) {
        if at.positions.len() == self.system.particles() {
            self.ahead = Some(self.pass(at, dt));
        }
    }

    /// The sums of a step of dt seconds to a state, from the pass made along with it or from one made now.
    pub(crate) fn enter(&mut self, state: &State, dt: f64) -> SpringSums {
        self.ahead.take().unwrap_or_else(|| self.pass(&state.moment(), dt))
    }

    fn pass(&mut self, at: &StateView<'_>, dt: f64) -> SpringSums {
        let law = self.system.law_values(at.positions, at.time);
        let step = Step { system: self.system, at: *at, law: &law, dt, is_damped: self.is_damped };
        // Without forces it does not fail.
        let pass = |(number, block): (usize, &mut Block)| {
            let _ = step.pass(number * BLOCK, std::slice::from_mut(block), None);
        };
        if self.blocks.len() > 1 {
            self.blocks.par_iter_mut().enumerate().for_each(pass);
        } else {
            self.blocks.iter_mut().enumerate().for_each(pass);
        }
        self.total()
    }

    pub(crate) fn total(&self) -> SpringSums {
        self.blocks.iter().map(|block| &block.sums).fold(SpringSums::default(), SpringSums::add)
    }
}

/// The longest step that resolves the motion of a spring between its ends, in s.
pub(crate) fn resolved_step(system: &System, spring: usize) -> f64 {
    let inverse_mass = |p: usize| if system.dofs().free_axes(p) == Axes::NONE { 0.0 } else { 1.0 / system.masses()[p] };
    let mobility = system.pair(spring).into_iter().map(inverse_mass).sum::<f64>();
    let spring = &system.springs()[spring];
    let vibration = (spring.axial_stiffness() * mobility).sqrt();
    1.0 / vibration.max(spring.damping * mobility)
}

/// A step of dt seconds, and the state at its end.
#[derive(Clone, Copy)]
struct Step<'a> {
    system: &'a System,
    at: StateView<'a>,
    law: &'a LawValues,
    dt: f64,
    is_damped: bool,
}

impl Step<'_> {
    /// A pass over the springs of some blocks, the first of which is `first`. Where there is a `force` it adds their forces, those on fixed ends
    /// included, and fails at coincident ends: for systems that are not a part of another, without a spring law of the caller's own.
    fn pass(
        &self,
        first: usize,
        blocks: &mut [Block],
        mut force: Option<&mut [Vector3<f64>]>,
    ) -> Result<(), Coincident> {
        dispatch_simd(
            #[inline(always)]
            || {
                // A copy stays in registers.
                let step = *self;
                let Step { system, at, .. } = step;
                let mut ends = system.pairs()[first..].iter().copied().zip(&system.springs()[first..]);
                let (mut forces, mut accumulator, mut number) = (Forces::new(), Accumulator::new(), first);
                for Block { batches, sums } in &mut *blocks {
                    // One for every slot of a batch.
                    let [mut elastic, mut dissipated, mut certain] = [[0.0; BATCH]; 3];
                    for batch in batches {
                        // Slots behind the last spring keep earlier ones, which add nothing without stiffness and damping.
                        let count = forces.gather(&at, &mut ends);
                        if let Some(force) = &mut force {
                            forces.set_pulls()?;
                            forces.add_forces(count, 0, force, &mut accumulator);
                        } else {
                            forces.set_lengths();
                        }
                        if system.has_spring_law() {
                            step.add_energies(number..number + count, &forces.length, &mut elastic);
                            batch.hold_slack(&step, number..number + count, &mut forces);
                        } else {
                            batch.add_energies(&forces, &mut elastic);
                        }
                        batch.move_on(&step, &forces, [&mut certain, &mut dissipated]);
                        number += count;
                    }
                    let [elastic, dissipated, certain] = [&elastic, &dissipated, &certain].map(folded);
                    *sums = SpringSums { elastic, work: 0.0, dissipated, certain };
                }
                if let Some(force) = &mut force {
                    accumulator.flush(0, force);
                }
                Ok(())
            },
        )
    }

    /// Adds the elastic energies of springs by a law.
    fn add_energies(&self, springs: Range<usize>, length: &List, elastic: &mut List) {
        for (slot, spring) in springs.enumerate().filter(|&(_, spring)| self.system.owns_spring(spring)) {
            let at = Extension { direction: Vector3::zeros(), length: length[slot] };
            elastic[slot] += self.system.elastic_energy_with(self.law, spring, &at, self.at.time);
        }
    }
}

impl Batch {
    #[inline(always)]
    fn add_energies(&self, now: &Forces, elastic: &mut List) {
        for (slot, elastic) in elastic.iter_mut().enumerate() {
            let change = now.length[slot] - now.rest_length[slot];
            *elastic += 0.5 * self.stiffness[slot] * change * change;
        }
    }

    /// Slack tension-only springs keep their rest length, so that only the taut part of a step dissipates.
    fn hold_slack(&mut self, step: &Step, springs: Range<usize>, now: &mut Forces) {
        for (slot, number) in springs.enumerate() {
            let Some(rest_length) = step.system.slack_length(number, step.at.time) else { continue };
            let was_slack = std::mem::replace(&mut self.is_slack[slot], now.length[slot] <= rest_length);
            if was_slack {
                self.length[slot] = rest_length;
            }
            if self.is_slack[slot] {
                (now.length[slot], now.product[slot]) = (rest_length, 0.0);
            }
        }
    }

    /// Moves on to the end of a step, and adds what is dissipated in it.
    #[inline(always)]
    fn move_on(&mut self, step: &Step, now: &Forces, [certain, dissipated]: [&mut List; 2]) {
        let rates = std::array::from_fn(|slot| now.product[slot] * now.inverse[slot]);
        if step.is_damped && step.dt > 0.0 {
            let inverse = 1.0 / step.dt;
            // Terms first: added to the sums at once they would be stored under masks, which is slow.
            let mut terms = [[0.0; 2]; BATCH];
            for (slot, terms) in terms.iter_mut().enumerate() {
                let lengths = [self.length[slot], now.length[slot]];
                let RateParabola { mean, slope, second_difference } =
                    RateParabola::new(lengths, [self.rate[slot], rates[slot]], inverse);
                let damping = self.damping[slot] * step.dt;
                let certain = damping * mean * mean;
                let resolved = damping * (slope * slope * (1.0 / 12.0) + second_difference * second_difference * 0.2);
                let is_damped = damping > 0.0;
                let is_resolved = is_damped & (step.dt <= self.resolved[slot]);
                *terms = [if is_damped { certain } else { 0.0 }, if is_resolved { resolved } else { 0.0 }];
            }
            for (slot, terms) in terms.iter().enumerate() {
                certain[slot] += terms[0];
                dissipated[slot] += terms[0];
                dissipated[slot] += terms[1];
            }
        }
        (self.length, self.rate) = (now.length, rates);
    }
}

/// The sum of a list, by halves, several additions at once.
#[inline(always)]
fn folded(list: &List) -> f64 {
    let eight: [f64; 8] = std::array::from_fn(|k| (list[k] + list[k + 8]) + (list[k + 16] + list[k + 24]));
    let four: [f64; 4] = std::array::from_fn(|k| eight[k] + eight[k + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

#[cfg(test)]
mod tests;
