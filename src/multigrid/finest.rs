//! The finest level: the system's A as a sparse matrix of whole blocks, a row for every particle that can move.
//!
//! Blocks have as many rows as the scene has dimensions. An axis that is prescribed keeps its row, with the equation x = 0:
//! this makes all blocks equal, and costs nothing where whole particles are prescribed, for they have no row.

use super::block::{Block, zero};
use super::graph::Graph;
use super::modes::Frame;
use super::order::order;
use super::parallel::for_each_sparse_row;
use super::sparse::{BlockMatrix, Pattern};
use crate::error::Result;
use crate::operator::SystemOperator;
use crate::system::{Axes, Dof, System};
use nalgebra::Vector3;

/// A spring's end at a node: the spring's place among the active ones, and that of its block in the matrix.
#[derive(Debug, Clone, Copy)]
struct End {
    spring: u32,
    position: u32,
}

/// Stands for the block of a spring whose other end cannot move.
const NOWHERE: u32 = u32::MAX;

/// The nodes and the matrix of the finest level, D dimensions.
#[derive(Debug)]
pub(super) struct Finest<const D: usize, const M: usize> {
    particles: Vec<u32>,
    free: Vec<Axes>,
    first_rows: Vec<u32>,
    /// Ends of springs at every node, in the order of the springs.
    starts: Vec<usize>,
    ends: Vec<End>,
    pub graph: Graph,
    pub frames: Vec<Frame<D, M>>,
    pub matrix: BlockMatrix<D, D>,
}

impl<const D: usize, const M: usize> Finest<D, M> {
    /// Nodes and pattern; positions and values are zero.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    pub fn new(system: &System) -> Result<Self> {
        let dofs = system.dofs();
        let movable: Vec<u32> =
            (0..system.particles()).filter(|&p| dofs.free_axes(p) != Axes::NONE).map(|p| p as u32).collect();
        let given = springs(system, &movable);
        let order = order(&given.graph);
        let particles: Vec<u32> = order.iter().map(|&node| movable[node as usize]).collect();
        let Springs { graph, starts, ends } = springs(system, &particles);
        let pattern = Pattern::build(particles.len(), |row, columns| {
            columns.extend_from_slice(graph.neighbours(row));
            columns.push(row as u32);
        })?;
        let locate = |node: usize, (spring, other): (u32, u32)| {
            let position = pattern.position(node, other).map_or(NOWHERE, |position| position as u32);
            End { spring, position: if other as usize == node { NOWHERE } else { position } }
        };
        let ends = (0..particles.len())
            .flat_map(|node| ends[starts[node]..starts[node + 1]].iter().map(move |&end| (node, end)));
        let ends = ends.map(|(node, end)| locate(node, end)).collect();
        let free: Vec<Axes> = particles.iter().map(|&p| dofs.free_axes(p as usize)).collect();
        let modes =
            |free: &Axes| std::array::from_fn(|r| std::array::from_fn(|c| f64::from(r == c && free.contains(r))));
        let frames = free.iter().map(|free| Frame { modes: modes(free), centre: [0.0; 3] }).collect();
        let first_rows = particles.iter().map(|&p| dofs.rows(p as usize).start as u32).collect();
        Ok(Self { particles, free, first_rows, starts, ends, graph, frames, matrix: BlockMatrix::zeros(pattern) })
    }

    /// Takes over where the particles are, one position for every particle of the system.
    pub fn place(&mut self, positions: &[Vector3<f64>]) {
        for (frame, &particle) in self.frames.iter_mut().zip(&self.particles) {
            frame.centre = positions[particle as usize].into();
        }
    }

    /// Recomputes all values, each the sum of its springs' blocks in their order, as an assembled matrix has it.
    pub fn refill(&mut self, a: &SystemOperator) {
        let Self { particles, free, starts, ends, matrix, .. } = self;
        let masses = a.system().masses();
        let BlockMatrix { pattern, values } = matrix;
        for_each_sparse_row(pattern, values, &|node, row| {
            row.fill(zero());
            let mass = a.mass_factor() * masses[particles[node] as usize];
            let mut diagonal: Block<D, D> =
                std::array::from_fn(|r| std::array::from_fn(|c| if r == c { mass } else { 0.0 }));
            let first = pattern.row(node).start;
            for end in &ends[starts[node]..starts[node + 1]] {
                let block = a.blocks()[end.spring as usize].matrix();
                let coupling = row.get_mut((end.position as usize).wrapping_sub(first));
                add(&mut diagonal, 1.0, &block);
                if let Some(coupling) = coupling {
                    add(coupling, -1.0, &block);
                }
            }
            let all = Axes::first(D);
            for (&column, block) in pattern.columns(node).iter().zip(row) {
                let (rows, columns) = (free[node], free[column as usize]);
                if column as usize == node {
                    *block = diagonal;
                }
                if rows != all || columns != all {
                    restrict(block, rows, columns, column as usize == node);
                }
            }
        });
    }

    /// The coordinate of an unknown, or of the particle's first free axis if there is no such coordinate.
    pub fn dof(&self, node: usize, axis: Option<usize>) -> Dof {
        let free = self.free.get(node).copied().unwrap_or(Axes::NONE);
        let axis = axis.filter(|&axis| free.contains(axis)).or(free.iter().next()).unwrap_or(0);
        Dof { particle: self.particles.get(node).map_or(0, |&particle| particle as usize), axis }
    }

    /// A reduced vector as one block a node, zero on prescribed axes.
    pub fn gather(&self, reduced: &[f64], blocks: &mut [[f64; D]]) {
        for ((block, free), &first) in blocks.iter_mut().zip(&self.free).zip(&self.first_rows) {
            *block = [0.0; D];
            for (axis, value) in free.iter().zip(&reduced[first as usize..]) {
                block[axis] = *value;
            }
        }
    }

    /// Back from blocks to a reduced vector.
    pub fn scatter(&self, blocks: &[[f64; D]], reduced: &mut [f64]) {
        for ((block, free), &first) in blocks.iter().zip(&self.free).zip(&self.first_rows) {
            for (axis, value) in free.iter().zip(&mut reduced[first as usize..]) {
                *value = block[axis];
            }
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.particles[..])
            + size_of_val(&self.free[..])
            + size_of_val(&self.first_rows[..])
            + size_of_val(&self.starts[..])
            + size_of_val(&self.ends[..])
            + size_of_val(&self.frames[..])
            + self.matrix.bytes()
    }
}

fn add<const D: usize>(to: &mut Block<D, D>, sign: f64, block: &nalgebra::Matrix3<f64>) {
    for (r, to) in to.iter_mut().enumerate() {
        for (c, to) in to.iter_mut().enumerate() {
            *to += sign * block[(r, c)];
        }
    }
}

/// Zeros the rows and columns of axes that are not free, but for ones on the diagonal of the matrix.
fn restrict<const D: usize>(block: &mut Block<D, D>, rows: Axes, columns: Axes, on_diagonal: bool) {
    for (r, entries) in block.iter_mut().enumerate() {
        for (c, entry) in entries.iter_mut().enumerate() {
            if !(rows.contains(r) && columns.contains(c)) {
                *entry = f64::from(on_diagonal && r == c);
            }
        }
    }
}

/// The springs seen from nodes.
struct Springs {
    /// Nodes that share a spring, with their stiffnesses k/l0.
    graph: Graph,
    starts: Vec<usize>,
    /// Place among the active springs and node at the other end, or the node itself if nothing there can move.
    ends: Vec<(u32, u32)>,
}

fn springs(system: &System, particles: &[u32]) -> Springs {
    const FIXED: u32 = u32::MAX;
    let mut node_of = vec![FIXED; system.particles()];
    for (node, &particle) in (0..).zip(particles) {
        node_of[particle as usize] = node;
    }
    let ends_of =
        || (0u32..).zip(system.active()).map(|(at, (_, [i, j], spring))| (at, [node_of[i], node_of[j]], spring));
    let both_move = ends_of().filter(|(_, ends, _)| !ends.contains(&FIXED));
    let edges: Vec<_> = both_move.map(|(_, [i, j], spring)| (i, j, spring.stiffness / spring.rest_length)).collect();
    let graph = Graph::new(particles.len(), edges.iter().copied());

    let at_ends =
        || ends_of().flat_map(|(at, [i, j], _)| [(at, i, j), (at, j, i)]).filter(|&(_, node, _)| node != FIXED);
    let mut starts = vec![0usize; particles.len() + 1];
    at_ends().for_each(|(_, node, _)| starts[node as usize + 1] += 1);
    (0..particles.len()).for_each(|node| starts[node + 1] += starts[node]);
    let mut next = starts.clone();
    let mut ends = vec![(0, 0); starts[particles.len()]];
    for (at, node, other) in at_ends() {
        let place = &mut next[node as usize];
        ends[*place] = (at, if other == FIXED { node } else { other });
        *place += 1;
    }
    Springs { graph, starts, ends }
}
