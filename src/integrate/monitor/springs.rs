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
use super::batch::{Block, Step};
use crate::spring::Spring;
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

/// What a pass needs of a spring and would have to divide for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Constants {
    /// k/l0, in N/m.
    pub stiffness: f64,
    /// 1/μ of its ends, in 1/kg.
    pub mobility: f64,
}

/// All springs at the last state.
pub(super) struct Springs<'s> {
    system: &'s System,
    spans: Vec<Span>,
    /// The longest step that resolves each spring, in s; negative for driven ones. Empty where nothing is damped.
    resolved: Vec<f64>,
    /// What each is, apart from its damping.
    constants: Vec<Constants>,
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
        let constants = |(number, spring): (usize, &Spring)| Constants {
            stiffness: spring.stiffness / spring.rest_length,
            mobility: mobility(system, number),
        };
        let constants = system.springs().iter().enumerate().map(constants).collect();
        let mut springs = Self { system, spans, resolved, constants, sums };
        springs.pass(state, 0.0);
        springs
    }

    /// Goes on to a state that a step of dt seconds led to.
    pub fn pass(&mut self, state: &State, dt: f64) -> Sums {
        let Self { system, spans, resolved, constants, sums } = self;
        let block = |(number, (spans, sums)): (usize, (&mut [Span], &mut Sums))| {
            let first = number * BLOCK;
            let resolved = resolved.get(first..).unwrap_or_default();
            let step = Step { system, state, dt, inverse: if dt > 0.0 { 1.0 / dt } else { 0.0 } };
            let constants = &constants[first..first + spans.len()];
            *sums = pulp::Arch::new().dispatch(Block { step, resolved, constants, first, spans });
        };
        if sums.len() > 1 {
            spans.par_chunks_mut(BLOCK).zip(sums.par_iter_mut()).enumerate().for_each(block);
        } else {
            spans.chunks_mut(BLOCK).zip(sums.iter_mut()).enumerate().for_each(block);
        }
        sums.iter().fold(Sums::default(), Sums::add).of_all(system)
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
