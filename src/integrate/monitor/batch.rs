//! Springs of a pass by the batch, for processors that compute on several numbers at once: as forces are, see `force::batch`.
//!
//! One loop gathers what springs need from their ends into lists, the others go through the lists without a branch. Sums are made
//! slot by slot of the batch, and the slots are added at the end of a block.
//!
//! A method that evaluates forces where a step ends can have both in one pass, which gathers once and computes lengths once.

use super::Sides;
use super::sums::{BLOCK, Constants, Span, Sums};
use crate::force::batch::{BATCH, Batch as Forces, Coincident, List};
use crate::force::run::Run;
use crate::spring::{Extension, Spring};
use crate::system::{Moment, System};
use nalgebra::Vector3;

/// What all blocks of a pass see.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub system: &'a System,
    pub at: Moment<'a>,
    pub dt: f64,
    /// 1/dt; divisions are what a pass would wait for.
    pub inverse: f64,
}

/// The springs from `first` on, as many as there are spans; compiled for every kind of processor that [`pulp`] tells apart.
pub(super) struct Block<'a> {
    pub step: Step<'a>,
    /// The longest step that resolves each spring, in s; negative for driven ones. Empty where nothing is damped.
    pub resolved: &'a [f64],
    pub constants: &'a [Constants],
    pub first: usize,
    pub spans: &'a mut [Span],
}

impl pulp::NullaryFnOnce for Block<'_> {
    type Output = Sums;

    #[inline(always)]
    fn call(self) -> Sums {
        let Self { step, resolved, constants, first, spans } = self;
        let Step { system, at: moment, .. } = step;
        let is_damped = !resolved.is_empty();
        // Of a system that is not a part of another all springs count.
        let all_count = system.peers().is_none();
        let (mut slots, mut batch) = (Slots::new(), Batch::new());
        let of_block = first..first + spans.len();
        let (springs, pairs) = (&system.springs()[of_block.clone()], &system.pairs()[of_block]);
        for (number, spans) in spans.chunks_mut(BATCH).enumerate() {
            let at = number * BATCH;
            let of_batch = at..at + spans.len();
            if (spans.len() < BATCH && number > 0) || !all_count {
                // Springs that are not there, or do not count here, are at rest and without stiffness: they add nothing. A first batch is new.
                batch = Batch::new();
            }
            let each = springs[of_batch.clone()].iter().zip(&pairs[of_batch.clone()]).zip(&constants[of_batch.clone()]);
            for (slot, ((spring, pair), constants)) in each.enumerate() {
                if all_count || system.counts(first + at + slot) {
                    batch.gather(slot, &moment, spring, *pair);
                    batch.set_constants(slot, constants);
                }
            }
            batch.set_spans();
            if system.has_spring_law() {
                batch.set_energies_by_law(system, first + at, spans.len());
            } else {
                batch.set_energies();
            }
            if is_damped {
                batch.gather_before(spans, &springs[of_batch.clone()], &resolved[of_batch]);
            }
            slots.add(&batch, &step, is_damped);
            batch.leave(spans);
        }
        slots.sums()
    }
}

/// All springs of a system, with the forces that they put on their ends added to `force`; for systems all of whose springs are active
/// and count, without a law of the caller's own.
pub(super) struct WithForces<'a> {
    pub step: Step<'a>,
    pub resolved: &'a [f64],
    pub constants: &'a [Constants],
    pub spans: &'a mut [Span],
    pub sums: &'a mut [Sums],
    pub force: &'a mut [Vector3<f64>],
}

impl pulp::NullaryFnOnce for WithForces<'_> {
    type Output = Result<(), Coincident>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { step, resolved, constants, spans, sums, force } = self;
        let Step { system, at, .. } = step;
        let is_damped = !resolved.is_empty();
        let mut ends = system.pairs().iter().copied().zip(system.springs());
        let (mut forces, mut run, mut batch) = (Forces::new(), Run::new(), Batch::new());
        for (block, (spans, sums)) in spans.chunks_mut(BLOCK).zip(sums).enumerate() {
            let mut slots = Slots::new();
            for (number, spans) in spans.chunks_mut(BATCH).enumerate() {
                let first = block * BLOCK + number * BATCH;
                let of_batch = first..first + spans.len();
                if spans.len() < BATCH && first > 0 {
                    (forces, batch) = (Forces::new(), Batch::new());
                }
                let count = forces.gather::<true>(&at, &mut ends);
                forces.set_pulls()?;
                forces.add_forces(count, 0, force, &mut run);
                batch.take(&forces);
                for (slot, constants) in constants[of_batch.clone()].iter().enumerate() {
                    batch.set_constants(slot, constants);
                }
                batch.set_energies();
                if is_damped {
                    batch.gather_before(spans, &system.springs()[of_batch.clone()], &resolved[of_batch]);
                }
                slots.add(&batch, &step, is_damped);
                batch.leave(spans);
            }
            *sums = slots.sums();
        }
        run.end(0, force);
        Ok(())
    }
}

/// The numbers of a batch.
struct Batch {
    /// l², d·Δv and Δv².
    squared: List,
    product: List,
    speed: List,
    rest_length: List,
    stiffness: List,
    mobility: List,
    length: List,
    /// 1/l.
    reciprocal: List,
    rate: List,
    elastic: List,
    before: [List; 2],
    /// b, zero for springs whose dissipation is counted elsewhere.
    damping: List,
    resolved: List,
}

impl Batch {
    #[inline(always)]
    fn new() -> Self {
        let (zeros, ones) = ([0.0; BATCH], [1.0; BATCH]);
        Self {
            squared: ones,
            product: zeros,
            speed: zeros,
            rest_length: ones,
            stiffness: zeros,
            mobility: zeros,
            length: ones,
            reciprocal: ones,
            rate: zeros,
            elastic: zeros,
            before: [ones, zeros],
            damping: zeros,
            resolved: zeros,
        }
    }

    #[inline(always)]
    fn gather(&mut self, slot: usize, at: &Moment<'_>, spring: &Spring, [i, j]: [u32; 2]) {
        let (i, j) = (i as usize, j as usize);
        let d = at.positions[i] - at.positions[j];
        let v = at.velocities[i] - at.velocities[j];
        self.squared[slot] = d.norm_squared();
        self.product[slot] = d.dot(&v);
        self.speed[slot] = v.norm_squared();
        self.rest_length[slot] = spring.rest_length;
    }

    #[inline(always)]
    fn set_constants(&mut self, slot: usize, constants: &Constants) {
        self.stiffness[slot] = constants.stiffness;
        self.mobility[slot] = constants.mobility;
    }

    /// In place of [`gather`](Self::gather) and [`set_spans`](Self::set_spans): what forces have been computed from. No length is zero.
    #[inline(always)]
    fn take(&mut self, forces: &Forces) {
        self.speed = forces.speed;
        self.rest_length = forces.rest_length;
        self.length = forces.length;
        self.reciprocal = forces.inverse;
        for slot in 0..BATCH {
            self.rate[slot] = forces.product[slot] * forces.inverse[slot];
        }
    }

    #[inline(always)]
    fn set_spans(&mut self) {
        for slot in 0..BATCH {
            let length = self.squared[slot].sqrt();
            let reciprocal = 1.0 / length;
            self.length[slot] = length;
            self.reciprocal[slot] = reciprocal;
            self.rate[slot] = if length > 0.0 { self.product[slot] * reciprocal } else { 0.0 };
        }
    }

    #[inline(always)]
    fn set_energies(&mut self) {
        for slot in 0..BATCH {
            let change = self.length[slot] - self.rest_length[slot];
            self.elastic[slot] = 0.5 * self.stiffness[slot] * change * change;
        }
    }

    /// Of `count` springs from `first` on that have a law of the caller's own, with the stiffness of their tangents.
    fn set_energies_by_law(&mut self, system: &System, first: usize, count: usize) {
        for (slot, spring) in (first..first + count).enumerate().filter(|&(_, spring)| system.counts(spring)) {
            let length = self.length[slot];
            let tangent = system.spring_at(spring, length);
            self.stiffness[slot] = tangent.stiffness / tangent.rest_length;
            self.elastic[slot] = system.elastic_energy(spring, &Extension { direction: Vector3::zeros(), length });
        }
    }

    /// Where springs were at the last state, and what their damping needs.
    #[inline(always)]
    fn gather_before(&mut self, spans: &[Span], springs: &[Spring], resolved: &[f64]) {
        for (slot, ((span, spring), &resolved)) in spans.iter().zip(springs).zip(resolved).enumerate() {
            let [length, rate] = &mut self.before;
            (length[slot], rate[slot]) = (span.length, span.rate);
            self.damping[slot] = if resolved >= 0.0 { spring.damping } else { 0.0 };
            self.resolved[slot] = resolved;
        }
    }

    /// Leaves what the next step will find.
    #[inline(always)]
    fn leave(&self, spans: &mut [Span]) {
        for ((span, &length), &rate) in spans.iter_mut().zip(&self.length).zip(&self.rate) {
            *span = Span { length, rate };
        }
    }
}

/// Sums of a block, one for every slot of a batch.
struct Slots {
    elastic: List,
    dissipated: List,
    certain: List,
    lifted: List,
    lifted_twice: List,
    reach: List,
}

impl Slots {
    #[inline(always)]
    fn new() -> Self {
        let zeros = [0.0; BATCH];
        Self { elastic: zeros, dissipated: zeros, certain: zeros, lifted: zeros, lifted_twice: zeros, reach: zeros }
    }

    #[inline(always)]
    fn add(&mut self, batch: &Batch, step: &Step, is_damped: bool) {
        for slot in 0..BATCH {
            self.elastic[slot] += batch.elastic[slot];
        }
        if step.dt > 0.0 {
            self.add_motion(batch, step);
            if is_damped {
                self.add_dissipation(batch, step);
            }
        }
    }

    /// What springs that turn, and ends that pass each other, make of the step.
    #[inline(always)]
    fn add_motion(&mut self, batch: &Batch, step: &Step) {
        let square = step.dt * step.dt;
        for slot in 0..BATCH {
            let (rate, reciprocal) = (batch.rate[slot], batch.reciprocal[slot]);
            let lift = 0.5 * square * (batch.speed[slot] - rate * rate) * reciprocal;
            let half = 0.5 * batch.stiffness[slot];
            let energy = half * lift * lift;
            self.lifted[slot] += energy;
            // The quotient with v⊥² cancelled.
            let across = lift * square * reciprocal;
            self.lifted_twice[slot] += energy * half * batch.mobility[slot] * across;
            let passed = square * batch.speed[slot] * reciprocal * reciprocal;
            self.reach[slot] = if passed > self.reach[slot] { passed } else { self.reach[slot] };
        }
    }

    #[inline(always)]
    fn add_dissipation(&mut self, batch: &Batch, step: &Step) {
        let [lengths, rates] = &batch.before;
        for slot in 0..BATCH {
            let before = Span { length: lengths[slot], rate: rates[slot] };
            let Sides { mean, slope, bend } = Sides::of(&before, batch.length[slot], batch.rate[slot], step.inverse);
            let damping = batch.damping[slot] * step.dt;
            let certain = damping * mean * mean;
            let resolved = damping * (slope * slope * (1.0 / 12.0) + bend * bend * 0.2);
            let is_damped = damping > 0.0;
            self.certain[slot] += if is_damped { certain } else { 0.0 };
            self.dissipated[slot] += if is_damped { certain } else { 0.0 };
            self.dissipated[slot] += if is_damped & (step.dt <= batch.resolved[slot]) { resolved } else { 0.0 };
        }
    }

    #[inline(always)]
    fn sums(&self) -> Sums {
        let sum = |list| folded(list, |a, b| a + b);
        Sums {
            elastic: sum(&self.elastic),
            dissipated: sum(&self.dissipated),
            certain: sum(&self.certain),
            lifted: sum(&self.lifted),
            lifted_twice: sum(&self.lifted_twice),
            reach: folded(&self.reach, |a, b| if a > b { a } else { b }),
        }
    }
}

/// The two halves of a list with each other, and so on: several at once, where one after the other would each wait for the last.
#[inline(always)]
fn folded(list: &List, with: impl Fn(f64, f64) -> f64) -> f64 {
    let eight: [f64; 8] = std::array::from_fn(|k| with(with(list[k], list[k + 8]), with(list[k + 16], list[k + 24])));
    let four: [f64; 4] = std::array::from_fn(|k| with(eight[k], eight[k + 4]));
    with(with(four[0], four[2]), with(four[1], four[3]))
}
