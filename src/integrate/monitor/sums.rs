//! What a pass over the springs keeps of each, and what it adds up.

use crate::system::System;

/// Springs that one thread treats at a stretch. Sums are made block by block, whatever the number of threads.
pub(super) const BLOCK: usize = 4096;

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
    pub fn add(mut self, other: &Self) -> Self {
        self.elastic += other.elastic;
        self.dissipated += other.dissipated;
        self.certain += other.certain;
        self.lifted += other.lifted;
        self.lifted_twice += other.lifted_twice;
        self.reach = self.reach.max(other.reach);
        self
    }

    /// With those of all other parts of a system.
    pub fn of_all(self, system: &System) -> Self {
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
