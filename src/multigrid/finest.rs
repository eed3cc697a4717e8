//! The finest level: the system's A as a sparse matrix of whole blocks, a row for every particle that can move.
//!
//! Blocks have as many rows as the scene has dimensions. A prescribed axis keeps its row, with the equation x = 0, so that all blocks are equal;
//! particles that are wholly prescribed have no row.

use super::aggregate::Graph;
use super::block::{Block, zero};
use super::modes::{Frame, Frames};
use super::parallel::{GRAIN, Starts, Values, for_each_row, for_each_row_of};
use super::sparse::{Pattern, Rows};
use crate::error::Result;
use crate::operator::{SystemOperator, group};
use crate::system::{Axes, Dof, System};
use nalgebra::Vector3;
use std::sync::Arc;

/// A spring seen from a node.
#[derive(Debug, Clone, Copy, Default)]
struct End {
    spring: u32,
    /// The node at its other end, or the node itself where nothing can move there.
    other: u32,
}

#[derive(Debug)]
pub(super) struct Finest<const D: usize> {
    particles: Vec<u32>,
    free: Vec<Axes>,
    /// The first reduced row of every node, and the number of rows.
    first_rows: Vec<u32>,
    positions: Vec<[f64; 3]>,
    /// Ends of springs at every node, by the other node.
    starts: Vec<usize>,
    ends: Vec<End>,
    pub pattern: Arc<Pattern>,
}

impl<const D: usize> Finest<D> {
    /// Nodes, all at the origin, and their graph, weighted by the stiffness k/l0 of springs.
    pub fn new(system: &System) -> Result<(Self, Graph)> {
        let dofs = system.dofs();
        let particles: Vec<u32> =
            (0..system.particles()).filter(|&p| dofs.free_axes(p) != Axes::NONE).map(|p| p as u32).collect();
        let (graph, starts, ends) = springs(system, &particles);
        let pattern = Pattern::build(particles.len(), |row, columns| {
            columns.extend_from_slice(graph.neighbours(row));
            columns.push(row as u32);
        })?;
        let free: Vec<Axes> = particles.iter().map(|&p| dofs.free_axes(p as usize)).collect();
        let first_rows = particles.iter().map(|&p| dofs.first_row(p as usize)).chain([dofs.len()]);
        let first_rows: Vec<u32> = first_rows.map(|row| row as u32).collect();
        let positions = vec![[0.0; 3]; particles.len()];
        let pattern = Arc::new(pattern);
        Ok((Self { particles, free, first_rows, positions, starts, ends, pattern }, graph))
    }

    pub fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        for (place, &particle) in self.positions.iter_mut().zip(&self.particles) {
            if let Some(&position) = positions.get(particle as usize) {
                *place = position.into();
            }
        }
    }

    pub fn unknowns(&self) -> usize {
        self.start(self.particles.len())
    }

    /// A power of two that brings the entries of `factor·A` near one.
    pub fn factor(&self, a: &SystemOperator) -> f64 {
        let masses = a.system().masses().iter().map(|m| a.mass_factor() * m);
        let springs = a.blocks().iter().map(|block| f64::max(block.axial.abs(), block.transverse.abs()));
        let external = a.external().iter().map(|block| block.amax());
        near_one(masses.chain(springs).chain(external).fold(0.0, f64::max))
    }

    pub fn rows<'f>(&'f self, a: &'f SystemOperator<'f>) -> FinestRows<'f, D> {
        FinestRows { finest: self, a }
    }

    /// The coordinate of an unknown, or the particle's first free one.
    pub fn dof(&self, node: usize, axis: Option<usize>) -> Dof {
        let free = self.free.get(node).copied().unwrap_or(Axes::NONE);
        let axis = axis.filter(|&axis| free.contains(axis)).or(free.iter().next()).unwrap_or(0);
        Dof { particle: self.particles.get(node).map_or(0, |&particle| particle as usize), axis }
    }

    /// A reduced vector times a factor as one block a node, zero on prescribed axes.
    pub fn gather(&self, reduced: &[f64], factor: f64, blocks: &mut [[f32; D]]) {
        for_each_row(
            blocks,
            #[inline(always)]
            |node, block| {
                let (free, values) = (self.free[node], &reduced[self.first_rows[node] as usize..]);
                if let Some(values) = values.first_chunk().filter(|_| free == Axes::first(D)) {
                    *block = values.map(|value: f64| (factor * value) as f32);
                    return;
                }
                *block = [0.0; D];
                for (axis, value) in free.iter().zip(values) {
                    block[axis] = (factor * value) as f32;
                }
            },
        );
    }

    pub fn scatter(&self, blocks: &[[f32; D]], factor: f64, reduced: &mut [f64]) {
        for_each_row_of(
            0..blocks.len(),
            GRAIN,
            Values(self, reduced),
            #[inline(always)]
            |node, values| match values.first_chunk_mut() {
                Some(values) => *values = blocks[node].map(|value| factor * f64::from(value)),
                None => {
                    for (value, axis) in values.iter_mut().zip(self.free[node].iter()) {
                        *value = factor * f64::from(blocks[node][axis]);
                    }
                }
            },
        );
    }
}

impl<const D: usize> Starts for Finest<D> {
    #[inline(always)]
    fn start(&self, node: usize) -> usize {
        self.first_rows[node] as usize
    }
}

/// The power of two that scales a number to near one; 1 where there is none.
pub(super) fn near_one(magnitude: f64) -> f64 {
    // The reciprocal has to exist too.
    let exponent = magnitude.log2().floor().clamp(-1000.0, 1000.0);
    if exponent.is_nan() { 1.0 } else { (-exponent).exp2() }
}

/// `B = [I 0]` without the rows of axes that are not free.
impl<const D: usize, const M: usize> Frames<D, M> for Finest<D> {
    #[inline(always)]
    fn frame(&self, node: usize) -> Frame<D, M> {
        let free = self.free[node];
        let modes = std::array::from_fn(|r| std::array::from_fn(|c| f64::from(u8::from(r == c && free.contains(r)))));
        Frame { modes, centre: self.positions[node] }
    }
}

/// A, row by row from the blocks of the springs: recomputing a row costs less than storing it.
pub(super) struct FinestRows<'f, const D: usize> {
    finest: &'f Finest<D>,
    a: &'f SystemOperator<'f>,
}

impl<const D: usize> Rows<D> for FinestRows<'_, D> {
    fn pattern(&self) -> &Pattern {
        &self.finest.pattern
    }

    /// The neighbours ascending, the diagonal block last.
    #[inline(always)]
    fn visit(&self, node: usize, mut visit: impl FnMut(usize, &Block<D, D>)) {
        let Self { finest, a } = self;
        let (all, free) = (Axes::first(D), finest.free[node]);
        let own = a.particle_block(finest.particles[node] as usize);
        let mut diagonal: Block<D, D> = std::array::from_fn(|r| std::array::from_fn(|c| own[(r, c)]));
        let ends = &finest.ends[finest.starts[node]..finest.starts[node + 1]];
        for parallel in ends.chunk_by(|a, b| a.other == b.other) {
            let mut coupling = zero();
            for end in parallel {
                let block = a.blocks()[end.spring as usize].matrix();
                for r in 0..D {
                    for c in 0..D {
                        diagonal[r][c] += block[(r, c)];
                        coupling[r][c] -= block[(r, c)];
                    }
                }
            }
            let other = parallel[0].other as usize;
            if other == node {
                continue;
            }
            if free != all || finest.free[other] != all {
                restrict(&mut coupling, free, finest.free[other], 0.0);
            }
            visit(other, &coupling);
        }
        if free != all {
            restrict(&mut diagonal, free, free, 1.0);
        }
        visit(node, &diagonal);
    }
}

/// Zeros the rows and columns of axes that are not free, and sets their crossings.
fn restrict<const D: usize>(block: &mut Block<D, D>, rows: Axes, columns: Axes, crossing: f64) {
    for (r, entries) in block.iter_mut().enumerate() {
        for (c, entry) in entries.iter_mut().enumerate() {
            if !(rows.contains(r) && columns.contains(c)) {
                *entry = if r == c { crossing } else { 0.0 };
            }
        }
    }
}

/// The graph of nodes and the ends of springs at every node, by the other node.
fn springs(system: &System, particles: &[u32]) -> (Graph, Vec<usize>, Vec<End>) {
    const FIXED: u32 = u32::MAX;
    let mut node_of = vec![FIXED; system.particles()];
    for (node, &particle) in (0..).zip(particles) {
        node_of[particle as usize] = node;
    }
    let springs =
        || (0u32..).zip(system.active()).map(|(at, (_, [i, j], spring))| (at, [node_of[i], node_of[j]], spring));
    let both_move = springs().filter(|(_, ends, _)| !ends.contains(&FIXED));
    let edges: Vec<_> = both_move.map(|(_, [i, j], spring)| (i, j, spring.axial_stiffness())).collect();
    let graph = Graph::new(particles.len(), edges.iter().copied());

    let end = |(spring, node, other)| {
        let other = if other == FIXED { node } else { other };
        (node as usize, End { spring, other })
    };
    let both = || springs().flat_map(|(at, [i, j], _)| [(at, i, j), (at, j, i)]);
    let ends = || both().filter(|&(_, node, _)| node != FIXED).map(end);
    let (starts, mut ends) = group(particles.len(), ends);
    for node in 0..particles.len() {
        ends[starts[node]..starts[node + 1]].sort_by_key(|end| end.other);
    }
    (graph, starts, ends)
}
