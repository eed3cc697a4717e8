//! A system's M, G, K and A as assembled matrices.

use super::triplets::{BlockTriplet, assemble};
use super::{BlockPattern, BlockSlot, SymmetricMatrix};
use crate::error::Result;
use crate::operator::SystemOperator;
use crate::system::System;
use nalgebra::Matrix3;
use std::sync::Arc;

/// The pattern of a system's matrices and the slot of every spring that enters it: the slot map.
#[derive(Debug, Clone)]
pub struct SpringPattern {
    pattern: Arc<BlockPattern>,
    /// Positions among the active springs, ends and slot of every spring in the pattern.
    springs: Vec<(u32, [u32; 2], BlockSlot)>,
}

impl SpringPattern {
    /// The pattern of A and K: every active spring.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn of_stiffness(system: &System) -> Result<Self> {
        Self::of(system, |_| true)
    }

    /// The pattern of G: damped springs only.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn of_damping(system: &System) -> Result<Self> {
        Self::of(system, |damping| damping > 0.0)
    }

    /// The pattern of M: the diagonal.
    ///
    /// # Errors
    /// More entries than 32-bit indices can count.
    pub fn of_mass(system: &System) -> Result<Self> {
        Self::of(system, |_| false)
    }

    fn of(system: &System, enters: impl Fn(f64) -> bool + Copy) -> Result<Self> {
        let chosen = || (0u32..).zip(system.active()).filter(move |(_, (_, _, spring))| enters(spring.damping));
        // Iterators handed to BlockPattern must be Clone; a list of pairs is, and it is short-lived.
        let pairs: Vec<[usize; 2]> = chosen().map(|(_, (_, pair, _))| pair).collect();
        let pattern = BlockPattern::new(system.dofs(), pairs.iter().copied())?;
        let slots = chosen().filter_map(|(position, (_, [i, j], _))| {
            pattern.slot(i, j).map(|slot| (position, [i as u32, j as u32], slot))
        });
        let springs = slots.collect();
        Ok(Self { pattern: Arc::new(pattern), springs })
    }
}

/// A system's matrix with the slot map that refills it.
#[derive(Debug, Clone)]
pub struct SystemMatrix {
    springs: Arc<SpringPattern>,
    matrix: SymmetricMatrix,
}

impl SystemMatrix {
    /// The zero matrix on a pattern.
    pub fn zeros(springs: Arc<SpringPattern>) -> Self {
        let matrix = SymmetricMatrix::zeros(springs.pattern.clone());
        Self { springs, matrix }
    }

    /// The assembled operator, on the pattern that fits its blocks.
    pub fn assemble(springs: Arc<SpringPattern>, operator: &SystemOperator) -> Self {
        let mut matrix = Self::zeros(springs);
        matrix.refill(operator);
        matrix
    }

    /// Recomputes all values from the operator's blocks, without sorting, searching or allocating.
    pub fn refill(&mut self, operator: &SystemOperator) {
        self.matrix.set_zero();
        let mass = operator.mass_factor();
        if mass != 0.0 {
            for (particle, m) in operator.system().masses().iter().enumerate() {
                self.matrix.add_to_diagonal(particle, mass * m);
            }
        }
        let blocks = operator.blocks();
        for &(position, pair, slot) in &self.springs.springs {
            let block = blocks[position as usize].matrix();
            self.matrix.stamp(pair.map(|p| p as usize), slot, &block);
        }
    }

    /// The matrix.
    pub fn matrix(&self) -> &SymmetricMatrix {
        &self.matrix
    }

    /// Takes the matrix out.
    pub fn into_matrix(self) -> SymmetricMatrix {
        self.matrix
    }
}

/// Assembles an operator afresh, by the simple path: all block triplets, sorted and added up.
///
/// Slow and obvious; [`SystemMatrix::refill`] is held to it bit by bit.
pub fn assemble_afresh(operator: &SystemOperator) -> Vec<super::triplets::Entry> {
    let system = operator.system();
    let masses = system.masses().iter().enumerate();
    let mass = |(p, m): (usize, &f64)| BlockTriplet {
        row: p,
        column: p,
        block: Matrix3::from_diagonal_element(operator.mass_factor() * m),
    };
    let mut triplets: Vec<BlockTriplet> = masses.map(mass).collect();
    for ((_, [i, j], _), block) in system.active().zip(operator.blocks()) {
        let block = block.matrix();
        triplets.push(BlockTriplet { row: i, column: i, block });
        triplets.push(BlockTriplet { row: j, column: j, block });
        triplets.push(BlockTriplet { row: i, column: j, block: -block });
        triplets.push(BlockTriplet { row: j, column: i, block: -block });
    }
    assemble(system.dofs(), &triplets)
}
