//! Springs of a pass by the batch, for processors that compute on several numbers at once: as forces are, see `force::batch`.
//!
//! One loop gathers what springs need from their ends into lists, the others go through the lists without a branch. Sums are made
//! slot by slot of the batch, and the slots are added at the end of a block.
//!
//! A method that evaluates forces where a step ends can have both in one pass, which gathers once and computes lengths once.

use super::Sides;
use super::sums::{Block, Damping, Kept, Span, Sums};
use crate::force::batch::{Accumulator, BATCH, Batch as Forces, Coincident, List};
use crate::spring::{Extension, LawValues, Spring};
use crate::system::{StateView, System};
use nalgebra::Vector3;

/// What all blocks of a pass see.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub system: &'a System,
    pub at: StateView<'a>,
    /// What the law says of all springs, where it is asked so.
    pub law: &'a LawValues,
    pub dt: f64,
    /// 1/dt; divisions are what a pass would wait for.
    pub inverse: f64,
}

/// The springs of a block, which begins with `first`; compiled for every kind of processor that [`pulp`] tells apart.
pub(super) struct Pass<'a> {
    pub step: Step<'a>,
    pub first: usize,
    pub block: &'a mut Block,
}

impl pulp::NullaryFnOnce for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { step, first, block: Block { kept, damping, sums } } = self;
        let Step { system, at, .. } = step;
        // Of a system that is not a part of another all springs count.
        let all_count = system.communicator().is_none();
        let each = system.springs()[first..].chunks(BATCH).zip(system.pairs()[first..].chunks(BATCH));
        let (mut slots, mut lists) = (Slots::new(), Lists::new());
        for (number, (kept, (springs, pairs))) in kept.iter_mut().zip(each).enumerate() {
            let first = first + number * BATCH;
            // Where springs are not there, or do not count here, something of batches before is left: without stiffness and damping it adds
            // nothing to sums, and what is largest has been seen.
            for (slot, (spring, pair)) in springs.iter().zip(pairs).enumerate() {
                if all_count || system.owns_spring(first + slot) {
                    lists.gather(slot, &at, spring, *pair);
                }
            }
            lists.set_spans();
            let now = lists.now();
            if system.has_spring_law() {
                slots.add_energies_by_law(&step, first, springs.len(), kept, &now);
            } else {
                slots.add_energies(kept, &now);
            }
            slots.add(&step, kept, &now, damping.get(number));
        }
        *sums = slots.sums();
    }
}

/// All springs of a system, with the forces that they put on their ends added to `force`; for systems all of whose springs count,
/// without a law of the caller's own, and whose fixed ends do not coincide. What springs do to ends that are fixed is added too.
pub(super) struct WithForces<'a> {
    pub step: Step<'a>,
    pub blocks: &'a mut [Block],
    pub force: &'a mut [Vector3<f64>],
}

impl pulp::NullaryFnOnce for WithForces<'_> {
    type Output = Result<(), Coincident>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { step, blocks, force } = self;
        let Step { system, at, .. } = step;
        let mut ends = system.pairs().iter().copied().zip(system.springs());
        let (mut forces, mut run) = (Forces::new(), Accumulator::new());
        for Block { kept, damping, sums } in blocks {
            let mut slots = Slots::new();
            for (number, kept) in kept.iter_mut().enumerate() {
                let count = forces.gather::<true>(&at, &mut ends);
                forces.set_pulls()?;
                forces.add_forces(count, 0, force, &mut run);
                // No length is zero.
                let rate = std::array::from_fn(|slot| forces.product[slot] * forces.inverse[slot]);
                let Forces { length, rest_length, .. } = &forces;
                let now = Now { length, rate: &rate, rest_length };
                slots.add_energies(kept, &now);
                slots.add(&step, kept, &now, damping.get(number));
            }
            *sums = slots.sums();
        }
        run.flush(0, force);
        Ok(())
    }
}

/// The springs of a batch where a step ends.
struct Now<'a> {
    length: &'a List,
    rate: &'a List,
    rest_length: &'a List,
}

/// What the numbers of a batch are computed in.
struct Lists {
    /// l² and d·Δv.
    squared: List,
    product: List,
    rest_length: List,
    length: List,
    rate: List,
}

impl Lists {
    #[inline(always)]
    fn new() -> Self {
        let (zeros, ones) = ([0.0; BATCH], [1.0; BATCH]);
        Self { squared: ones, product: zeros, rest_length: ones, length: ones, rate: zeros }
    }

    #[inline(always)]
    fn gather(&mut self, slot: usize, at: &StateView<'_>, spring: &Spring, [i, j]: [u32; 2]) {
        let (i, j) = (i as usize, j as usize);
        let d = at.positions[i] - at.positions[j];
        let v = at.velocities[i] - at.velocities[j];
        self.squared[slot] = d.norm_squared();
        self.product[slot] = d.dot(&v);
        self.rest_length[slot] = spring.rest_length;
    }

    #[inline(always)]
    fn set_spans(&mut self) {
        for slot in 0..BATCH {
            let length = self.squared[slot].sqrt();
            // Fixed ends may lie at one place: such a spring has no direction.
            let reciprocal = if length > 0.0 { 1.0 / length } else { 0.0 };
            self.length[slot] = length;
            self.rate[slot] = self.product[slot] * reciprocal;
        }
    }

    #[inline(always)]
    fn now(&self) -> Now<'_> {
        let Self { length, rate, rest_length, .. } = self;
        Now { length, rate, rest_length }
    }
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
    fn add_energies(&mut self, kept: &Kept, now: &Now) {
        for slot in 0..BATCH {
            let change = now.length[slot] - now.rest_length[slot];
            self.elastic[slot] += 0.5 * kept.stiffness[slot] * change * change;
        }
    }

    /// Of `count` springs from `first` on that have a law of the caller's own, with the stiffness of their tangents.
    fn add_energies_by_law(&mut self, step: &Step, first: usize, count: usize, kept: &mut Kept, now: &Now) {
        let (system, time) = (step.system, step.at.time);
        for (slot, spring) in (first..first + count).enumerate().filter(|&(_, spring)| system.owns_spring(spring)) {
            let length = now.length[slot];
            let tangent = system.spring_with(step.law, spring, length, time);
            kept.stiffness[slot] = tangent.axial_stiffness();
            let at = Extension { direction: Vector3::zeros(), length };
            self.elastic[slot] += system.elastic_energy_with(step.law, spring, &at, time);
        }
    }

    /// Adds what the step made of the springs, and leaves what the next one will find.
    #[inline(always)]
    fn add(&mut self, step: &Step, kept: &mut Kept, now: &Now, damping: Option<&Damping>) {
        if let Some(damping) = damping.filter(|_| step.dt > 0.0) {
            self.add_dissipation(step, kept, now, damping);
        }
        (kept.length, kept.rate) = (*now.length, *now.rate);
    }

    #[inline(always)]
    fn add_dissipation(&mut self, step: &Step, kept: &Kept, now: &Now, of: &Damping) {
        // Added to sums at once, they would be stored by masks, which some processors take ten times as long for.
        let mut terms = [[0.0; 2]; BATCH];
        for (slot, terms) in terms.iter_mut().enumerate() {
            let before = Span { length: kept.length[slot], rate: kept.rate[slot] };
            let Sides { mean, slope, bend } = Sides::of(&before, now.length[slot], now.rate[slot], step.inverse);
            let damping = of.damping[slot] * step.dt;
            let certain = damping * mean * mean;
            let resolved = damping * (slope * slope * (1.0 / 12.0) + bend * bend * 0.2);
            let is_damped = damping > 0.0;
            let is_resolved = is_damped & (step.dt <= of.resolved[slot]);
            *terms = [if is_damped { certain } else { 0.0 }, if is_resolved { resolved } else { 0.0 }];
        }
        for (slot, [certain, resolved]) in terms.iter().enumerate() {
            self.certain[slot] += certain;
            self.dissipated[slot] += certain;
            self.dissipated[slot] += resolved;
        }
    }

    #[inline(always)]
    fn sums(&self) -> Sums {
        Sums { elastic: folded(&self.elastic), dissipated: folded(&self.dissipated), certain: folded(&self.certain) }
    }
}

/// The two halves of a list with each other, and so on: several at once, where one after the other would each wait for the last.
#[inline(always)]
fn folded(list: &List) -> f64 {
    let eight: [f64; 8] = std::array::from_fn(|k| (list[k] + list[k + 8]) + (list[k + 16] + list[k + 24]));
    let four: [f64; 4] = std::array::from_fn(|k| eight[k] + eight[k + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}
