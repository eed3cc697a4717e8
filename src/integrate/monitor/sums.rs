//! What a pass over the springs keeps of each, and what it adds up.

use crate::force::batch::{BATCH, List};
use crate::system::System;

/// Springs of a block.
pub(super) const BLOCK: usize = BATCHES * BATCH;

/// The same in batches.
const BATCHES: usize = 128;

/// Sums over springs at a state, and over the step that led to it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sums {
    /// Elastic energy, in J.
    pub elastic: f64,
    /// What damping took in the step, in J, but for driven springs.
    pub dissipated: f64,
    /// The least that it can have taken.
    pub certain: f64,
}

impl Sums {
    pub fn add(mut self, other: &Self) -> Self {
        self.elastic += other.elastic;
        self.dissipated += other.dissipated;
        self.certain += other.certain;
        self
    }

    /// With those of all other parts of a system.
    pub fn of_all(self, system: &System) -> Self {
        let [elastic, dissipated, certain] = system.total([self.elastic, self.dissipated, self.certain]);
        Self { elastic, dissipated, certain }
    }
}

/// A spring at one state.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Span {
    /// l, in m.
    pub length: f64,
    /// n·Δv, in m/s.
    pub rate: f64,
}

/// Springs that one thread treats at a stretch, and their sums. These are made block by block, whatever the number of threads.
#[derive(Debug)]
pub(super) struct Block {
    pub kept: Vec<Kept>,
    /// Empty where nothing is damped.
    pub damping: Vec<Damping>,
    pub sums: Sums,
}

/// What is kept of the springs of a batch, list by list, so that a pass loads several at once. Springs that are not there, and those that
/// count elsewhere, have no stiffness.
#[derive(Debug, Clone)]
pub(super) struct Kept {
    /// k/l0, in N/m.
    pub stiffness: List,
    /// l at the last state, in m, and n·Δv, in m/s.
    pub length: List,
    pub rate: List,
}

/// What the damping of a batch needs.
#[derive(Debug, Clone)]
pub(super) struct Damping {
    /// b, in N·s/m; zero for springs that are not there, and those whose dissipation is counted elsewhere.
    pub damping: List,
    /// The longest step that resolves each spring, in s.
    pub resolved: List,
}

impl Block {
    /// Of so many springs.
    pub fn new(springs: usize, is_damped: bool) -> Self {
        let batches = springs.div_ceil(BATCH);
        let kept = Kept { stiffness: [0.0; BATCH], length: [1.0; BATCH], rate: [0.0; BATCH] };
        let damping = Damping { damping: [0.0; BATCH], resolved: [0.0; BATCH] };
        Self {
            kept: vec![kept; batches],
            damping: vec![damping; if is_damped { batches } else { 0 }],
            sums: Sums::default(),
        }
    }
}
