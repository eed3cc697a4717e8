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
//! Springs that end in a moving prescribed particle are accounted for in `driven`: their rates jump where paths have
//! kinks. Here they count for what they store.

use super::Sides;
use crate::spring::Extension;
use crate::system::{Axes, State, System};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Springs that one thread treats at a stretch. Sums are made block by block, whatever the number of threads.
const BLOCK: usize = 4096;

/// Sums over springs at a state, and over the step that led to it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sums {
    /// Elastic energy, in J.
    pub elastic: f64,
    /// What damping took in the step, in J, but for driven springs.
    pub dissipated: f64,
    /// The least that it can have taken.
    pub certain: f64,
    /// U, what a step of straight motion puts into the springs that turn, in J: with `v⊥` across a spring its ends come apart by
    /// `(h v⊥)²/(2l)`.
    pub lifted: f64,
    /// The same times its quotient with the energy `½ μ v⊥²` of the turning, spring by spring.
    pub lifted_twice: f64,
    /// The largest `(h |Δv|/l)²`: how far the ends of a spring pass each other in a step, in lengths.
    pub reach: f64,
}

impl Sums {
    fn add(mut self, other: &Self) -> Self {
        self.elastic += other.elastic;
        self.dissipated += other.dissipated;
        self.certain += other.certain;
        self.lifted += other.lifted;
        self.lifted_twice += other.lifted_twice;
        self.reach = self.reach.max(other.reach);
        self
    }

    /// With those of all other parts of a system.
    fn of_all(self, system: &System) -> Self {
        let Self { elastic, dissipated, certain, lifted, lifted_twice, reach } = self;
        let [elastic, dissipated, certain, lifted, lifted_twice] =
            system.total([elastic, dissipated, certain, lifted, lifted_twice]);
        let [reach] = system.largest([reach]);
        Self { elastic, dissipated, certain, lifted, lifted_twice, reach }
    }
}

/// A spring at the last state.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Span {
    /// l, in m.
    pub length: f64,
    /// n·Δv, in m/s.
    pub rate: f64,
}

/// All springs at the last state.
pub(super) struct Springs<'s> {
    system: &'s System,
    spans: Vec<Span>,
    /// The longest step that resolves each spring, in s; negative for driven ones. Empty where nothing is damped.
    resolved: Vec<f64>,
    /// 1/μ of the ends of each, in 1/kg.
    mobilities: Vec<f64>,
    sums: Vec<Sums>,
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
        let mobilities = (0..count).map(|spring| mobility(system, spring)).collect();
        let mut springs = Self { system, spans, resolved, mobilities, sums };
        springs.pass(state, 0.0);
        springs
    }

    /// Goes on to a state that a step of dt seconds led to.
    pub fn pass(&mut self, state: &State, dt: f64) -> Sums {
        let Self { system, spans, resolved, mobilities, sums } = self;
        let block = |(number, (spans, sums)): (usize, (&mut [Span], &mut Sums))| {
            let first = number * BLOCK;
            let own = [&*resolved, &*mobilities].map(|list| list.get(first..).unwrap_or_default());
            *sums = block(system, state, dt, own, first, spans);
        };
        if sums.len() > 1 {
            spans.par_chunks_mut(BLOCK).zip(sums.par_iter_mut()).enumerate().for_each(block);
        } else {
            spans.chunks_mut(BLOCK).zip(sums.iter_mut()).enumerate().for_each(block);
        }
        sums.iter().fold(Sums::default(), Sums::add).of_all(system)
    }
}

/// The springs from `first` on, as many as there are spans.
fn block(
    system: &System,
    state: &State,
    dt: f64,
    [resolved, mobilities]: [&[f64]; 2],
    first: usize,
    spans: &mut [Span],
) -> Sums {
    let mut sums = Sums::default();
    let springs = system.springs().iter().zip(system.pairs()).skip(first);
    for (at, (((spring, &[i, j]), span), mobility)) in springs.zip(spans).zip(mobilities).enumerate() {
        if !system.counts(first + at) {
            continue;
        }
        let (i, j) = (i as usize, j as usize);
        let d = state.positions[i] - state.positions[j];
        let v = state.velocities[i] - state.velocities[j];
        let length = d.norm();
        let rate = if length > 0.0 { d.dot(&v) / length } else { 0.0 };
        let tangent = system.spring_at(first + at, length);
        let change = length - spring.rest_length;
        let stiffness = tangent.stiffness / tangent.rest_length;
        sums.elastic += match system.has_spring_law() {
            false => 0.5 * stiffness * change * change,
            true => system.elastic_energy(first + at, &Extension { direction: Vector3::zeros(), length }),
        };
        if dt > 0.0 {
            let (squared, step) = (v.norm_squared(), dt * dt);
            let lift = 0.5 * step * (squared - rate * rate) / length;
            let energy = 0.5 * stiffness * lift * lift;
            sums.lifted += energy;
            // The quotient with v⊥² cancelled.
            let across = lift * step / length;
            sums.lifted_twice += energy * 0.5 * stiffness * mobility * across;
            sums.reach = sums.reach.max(step * squared / (length * length));
            let longest = resolved.get(at).copied().unwrap_or(-1.0);
            if spring.damping > 0.0 && longest >= 0.0 {
                let Sides { mean, slope, bend } = Sides::of(span, length, rate, dt);
                let certain = spring.damping * dt * mean * mean;
                sums.certain += certain;
                sums.dissipated += certain;
                if dt <= longest {
                    sums.dissipated += spring.damping * dt * (slope * slope / 12.0 + bend * bend / 5.0);
                }
            }
        }
        *span = Span { length, rate };
    }
    sums
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
    /// Of the rate at which a spring lengthens, over a step.
    pub fn of(before: &Span, length: f64, rate: f64, dt: f64) -> Self {
        let mean = (length - before.length) / dt;
        Self { mean, slope: rate - before.rate, bend: 0.5 * (before.rate + rate) - mean }
    }
}

/// n and the rate of a spring between two moving points; n is zero where they coincide.
pub(super) fn span(d: &Vector3<f64>, v: &Vector3<f64>) -> (Vector3<f64>, Span) {
    let length = d.norm();
    let n = if length > 0.0 { d / length } else { Vector3::zeros() };
    (n, Span { length, rate: n.dot(v) })
}
