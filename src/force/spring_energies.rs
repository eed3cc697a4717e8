//! The energy that springs store, and what their damping takes, in one pass over the springs after every step.
//!
//! Damping takes the power `b r²`, r = n·Δv the rate at which a spring lengthens. Over a step of h seconds the mean of r is
//! known exactly, `r̄ = (l' − l)/h`, and r at both ends. In Legendre polynomials the parabola through these three is
//! `r̄ + (r' − r)(s − ½) + c (6s² − 6s + 1)` with `c = (r + r')/2 − r̄`, so that
//!
//! ```text
//! ∫ b r² dt = b h (r̄² + (r' − r)²/12 + c²/5),
//! ```
//!
//! to fourth order. The first term is the least that any motion between these lengths dissipates (Jensen's inequality): it is
//! *certain*. The others count only where the step resolves the spring's own motion, `h² k/(l0 μ) ≤ 1` and `h b/μ ≤ 1` with
//! the reduced mass μ of its ends: beyond that, rates at the ends of steps say nothing about what happens between.
//!
//! A method whose last force evaluation is at the end of the step shares the pass as a [`SpringVisitor`]. Verlet's velocities
//! are then predicted ones or those of the middle of the step; rates are off by an O(h²) that changes slowly, and the integral
//! stays right to fourth order.
//!
//! The damping of springs that end in a moving prescribed particle is counted in `work`: their rates jump at kinks of the path.
//!
//! Springs are taken by the batch, as in `force::batch`: one loop gathers, the others run over lists without a branch. Sums are
//! made slot by slot and block by block, so that they have the same bits for any number of threads.

use crate::error::DegenerateSpring;
use crate::force::batch::{Accumulator, BATCH, Batch as Forces, Coincident, List};
use crate::force::{coincide, first_degenerate, set_other_forces, set_total_force};
use crate::integrate::SpringVisitor;
use crate::spring::{Extension, LawValues, Spring};
use crate::system::{Axes, State, StateView, System};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::ops::Range;

/// Springs of a block, which one thread treats at a stretch.
pub(super) const BLOCK: usize = 128 * BATCH;

/// Energies of springs at a state and over the step that led to it, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sums {
    pub elastic: f64,
    /// Work of constraints and external forces.
    pub work: f64,
    pub dissipated: f64,
    /// The least that damping can have taken.
    pub certain: f64,
}

impl Sums {
    pub fn add(self, other: &Self) -> Self {
        Self {
            elastic: self.elastic + other.elastic,
            work: self.work + other.work,
            dissipated: self.dissipated + other.dissipated,
            certain: self.certain + other.certain,
        }
    }

    /// Together with the sums of all other parts of a system.
    pub fn of_all_parts(self, system: &System) -> Self {
        let [elastic, work, dissipated, certain] =
            system.total([self.elastic, self.work, self.dissipated, self.certain]);
        Self { elastic, work, dissipated, certain }
    }
}

/// A rate over a step as a parabola in Legendre polynomials.
pub(super) struct RateParabola {
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

/// The springs of a batch at the last state. Slots without a spring, or with one that another part counts, have neither
/// stiffness nor damping.
#[derive(Clone)]
struct Batch {
    /// k/l0, in N/m.
    stiffness: List,
    length: List,
    rate: List,
    /// Zero where the dissipation is counted elsewhere.
    damping: List,
    /// The longest step that resolves each spring, in s.
    resolved: List,
}

struct Block {
    batches: Vec<Batch>,
    sums: Sums,
}

/// All springs at the last state.
pub(super) struct Springs<'s> {
    system: &'s System,
    is_damped: bool,
    blocks: Vec<Block>,
    /// The springs between fixed particles.
    idle: Vec<u32>,
    /// The sums of a pass made along with a step that is not entered yet.
    ahead: Option<Sums>,
}

impl<'s> Springs<'s> {
    /// At a state; `driven` are the springs whose damping is counted elsewhere, ascending.
    pub fn new(system: &'s System, state: &State, driven: impl Iterator<Item = usize>) -> Self {
        let springs = system.springs();
        let is_damped = springs.iter().any(|spring| spring.damping > 0.0);
        let zeros = [0.0; BATCH];
        let empty = Batch { stiffness: zeros, length: [1.0; BATCH], rate: zeros, damping: zeros, resolved: zeros };
        let block = |springs: &[Spring]| {
            let batches = vec![empty.clone(); springs.len().div_ceil(BATCH)];
            Block { batches, sums: Sums::default() }
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
        let mut springs = Self { system, is_damped, blocks, idle, ahead: None };
        springs.pass(&state.moment(), 0.0);
        springs
    }

    /// The sums of a step of dt seconds to a state, from the pass made along with it or from one made now.
    pub fn enter(&mut self, state: &State, dt: f64) -> Sums {
        self.ahead.take().unwrap_or_else(|| self.pass(&state.moment(), dt))
    }

    fn pass(&mut self, at: &StateView<'_>, dt: f64) -> Sums {
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
        let inverse = if dt > 0.0 { 1.0 / dt } else { 0.0 };
        let dissipates = self.is_damped && dt > 0.0;
        Step { system: self.system, at: *at, law: LawValues::NONE, dt, inverse, dissipates }
    }

    /// The sums of the last pass.
    pub fn total(&self) -> Sums {
        let sums = self.blocks.iter().map(|block| &block.sums).fold(Sums::default(), Sums::add);
        sums.of_all_parts(self.system)
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
        // Fixed ends may coincide.
        if self.idle.iter().any(|&spring| coincide(at.positions, self.system.pair(spring as usize))) {
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

/// The longest step that resolves the motion of a spring between its ends, in s.
pub(super) fn resolved_step(system: &System, spring: usize) -> f64 {
    let inverse_mass = |p: usize| if system.dofs().free_axes(p) == Axes::NONE { 0.0 } else { 1.0 / system.masses()[p] };
    let mobility = system.pair(spring).into_iter().map(inverse_mass).sum::<f64>();
    let spring = &system.springs()[spring];
    let vibration = (spring.axial_stiffness() * mobility).sqrt();
    1.0 / vibration.max(spring.damping * mobility)
}

/// The data that all blocks of a pass share.
#[derive(Clone, Copy)]
struct Step<'a> {
    system: &'a System,
    at: StateView<'a>,
    law: &'a LawValues,
    dt: f64,
    /// 1/dt.
    inverse: f64,
    dissipates: bool,
}

/// A pass over the springs of a block, the first of which is `first`; compiled for every kind of processor that [`pulp`] knows.
struct Pass<'a> {
    step: Step<'a>,
    first: usize,
    block: &'a mut Block,
}

impl pulp::NullaryFnOnce for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { step, first, block: Block { batches, sums } } = self;
        let Step { system, at, .. } = step;
        let each = system.springs()[first..].chunks(BATCH).zip(system.pairs()[first..].chunks(BATCH));
        let (ones, zeros) = ([1.0; BATCH], [0.0; BATCH]);
        let (mut squared, mut product, mut rest_length) = (ones, zeros, ones);
        let (mut length, mut rate) = (ones, zeros);
        let mut slots = Slots::new();
        for (number, (batch, (springs, pairs))) in batches.iter_mut().zip(each).enumerate() {
            // Slots behind the last spring keep those of the batch before, which add nothing without stiffness and damping.
            for (slot, (spring, &[i, j])) in springs.iter().zip(pairs).enumerate() {
                let (i, j) = (i as usize, j as usize);
                let d = at.positions[i] - at.positions[j];
                let v = at.velocities[i] - at.velocities[j];
                squared[slot] = d.norm_squared();
                product[slot] = d.dot(&v);
                rest_length[slot] = spring.rest_length;
            }
            for slot in 0..BATCH {
                length[slot] = squared[slot].sqrt();
                // A spring without length has no direction.
                let reciprocal = if length[slot] > 0.0 { 1.0 / length[slot] } else { 0.0 };
                rate[slot] = product[slot] * reciprocal;
            }
            let now = Now { length: &length, rate: &rate, rest_length: &rest_length };
            if system.has_spring_law() {
                let first = first + number * BATCH;
                slots.add_energies_by_law(&step, first..first + springs.len(), &now);
            } else {
                slots.add_energies(batch, &now);
            }
            slots.add_dissipation(&step, batch, &now);
        }
        *sums = slots.sums();
    }
}

/// A pass over all springs that also adds their forces to `force`, those on fixed ends included. For systems that are not a
/// part of another, without a spring law of the caller's own, and whose fixed ends do not coincide.
struct WithForces<'a> {
    step: Step<'a>,
    blocks: &'a mut [Block],
    force: &'a mut [Vector3<f64>],
}

impl pulp::NullaryFnOnce for WithForces<'_> {
    type Output = Result<(), Coincident>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { step, blocks, force } = self;
        let Step { system, at, .. } = step;
        let mut ends = system.pairs().iter().copied().zip(system.springs());
        let (mut forces, mut run) = (Forces::new(), Accumulator::new());
        for Block { batches, sums } in blocks {
            let mut slots = Slots::new();
            for batch in batches {
                let count = forces.gather::<true>(&at, &mut ends);
                forces.set_pulls()?;
                forces.add_forces(count, 0, force, &mut run);
                let rate = std::array::from_fn(|slot| forces.product[slot] * forces.inverse[slot]);
                let Forces { length, rest_length, .. } = &forces;
                let now = Now { length, rate: &rate, rest_length };
                slots.add_energies(batch, &now);
                slots.add_dissipation(&step, batch, &now);
            }
            *sums = slots.sums();
        }
        run.flush(0, force);
        Ok(())
    }
}

/// The springs of a batch at the end of the step.
struct Now<'a> {
    length: &'a List,
    rate: &'a List,
    rest_length: &'a List,
}

/// Sums of a block, one for every slot of a batch.
struct Slots {
    elastic: List,
    dissipated: List,
    certain: List,
}

impl Slots {
    #[inline(always)]
    fn new() -> Self {
        let zeros = [0.0; BATCH];
        Self { elastic: zeros, dissipated: zeros, certain: zeros }
    }

    #[inline(always)]
    fn add_energies(&mut self, batch: &Batch, now: &Now) {
        for slot in 0..BATCH {
            let change = now.length[slot] - now.rest_length[slot];
            self.elastic[slot] += 0.5 * batch.stiffness[slot] * change * change;
        }
    }

    fn add_energies_by_law(&mut self, step: &Step, springs: Range<usize>, now: &Now) {
        for (slot, spring) in springs.enumerate().filter(|&(_, spring)| step.system.owns_spring(spring)) {
            let at = Extension { direction: Vector3::zeros(), length: now.length[slot] };
            self.elastic[slot] += step.system.elastic_energy_with(step.law, spring, &at, step.at.time);
        }
    }

    /// Adds the dissipation of the step, and moves the batch to its end.
    #[inline(always)]
    fn add_dissipation(&mut self, step: &Step, batch: &mut Batch, now: &Now) {
        if step.dissipates {
            // Terms first: added to the sums at once they would be stored under masks, which is slow.
            let mut terms = [[0.0; 2]; BATCH];
            for (slot, terms) in terms.iter_mut().enumerate() {
                let lengths = [batch.length[slot], now.length[slot]];
                let rate = RateParabola::new(lengths, [batch.rate[slot], now.rate[slot]], step.inverse);
                let RateParabola { mean, slope, second_difference } = rate;
                let damping = batch.damping[slot] * step.dt;
                let certain = damping * mean * mean;
                let resolved = damping * (slope * slope * (1.0 / 12.0) + second_difference * second_difference * 0.2);
                let is_damped = damping > 0.0;
                let is_resolved = is_damped & (step.dt <= batch.resolved[slot]);
                *terms = [if is_damped { certain } else { 0.0 }, if is_resolved { resolved } else { 0.0 }];
            }
            for (slot, [certain, resolved]) in terms.iter().enumerate() {
                self.certain[slot] += certain;
                self.dissipated[slot] += certain;
                self.dissipated[slot] += resolved;
            }
        }
        (batch.length, batch.rate) = (*now.length, *now.rate);
    }

    #[inline(always)]
    fn sums(&self) -> Sums {
        let [elastic, dissipated, certain] = [&self.elastic, &self.dissipated, &self.certain].map(folded);
        Sums { elastic, work: 0.0, dissipated, certain }
    }
}

/// The sum of a list, by halves, several additions at once.
#[inline(always)]
fn folded(list: &List) -> f64 {
    let eight: [f64; 8] = std::array::from_fn(|k| (list[k] + list[k + 8]) + (list[k + 16] + list[k + 24]));
    let four: [f64; 4] = std::array::from_fn(|k| eight[k] + eight[k + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}
