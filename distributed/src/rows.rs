//! The rows of the matrix that belong to a part.
//!
//! Every particle has a row of blocks of as many axes as the scene has. Coordinates that are prescribed stay in the
//! matrix, with a diagonal entry of the size of the others and nothing beside it, so that all blocks are alike and a rigid motion
//! is one; their solution is zero.

use crate::part::Halo;
use crate::petsc::{Counts, Index, Result};
use sprung::System;
use sprung::nalgebra::Matrix3;
use sprung::operator::SystemOperator;
use sprung::system::Axes;

/// A spring as one of its ends sees it: its position among the active ones, and the place of the other end's block in the row.
#[derive(Clone, Copy)]
struct Incidence {
    spring: u32,
    place: Option<u32>,
}

/// Where a part's blocks stand in the matrix.
pub struct Rows {
    /// Axes of the scene, so rows of a block.
    pub size: usize,
    own: usize,
    rows: Vec<Index>,
    /// Of own particle p: columns[starts[p]..starts[p + 1]], ascending.
    starts: Vec<u32>,
    columns: Vec<Index>,
    /// Which axes are free in each column.
    column_free: Vec<Axes>,
    /// Of the diagonal block in each row.
    diagonals: Vec<u32>,
    spring_starts: Vec<u32>,
    incidences: Vec<Incidence>,
    /// Which axes are free, of own particles and ghosts.
    free: Vec<Axes>,
}

impl Rows {
    /// Of a part, once.
    pub fn new(system: &System, halo: &Halo) -> Self {
        let own = halo.own;
        let free: Vec<Axes> = (0..system.particles()).map(|p| system.dofs().free_axes(p)).collect();
        let rows: Vec<Index> = halo.rows.iter().map(|&row| row as Index).collect();
        let mut touching: Vec<Vec<(u32, u32)>> = vec![Vec::new(); own];
        for (position, (_, [i, j], _)) in (0u32..).zip(system.active()) {
            for (here, there) in [(i, j), (j, i)] {
                if here < own {
                    touching[here].push((position, there as u32));
                }
            }
        }
        let (mut starts, mut spring_starts) = (vec![0], vec![0]);
        let (mut columns, mut column_free) = (Vec::new(), Vec::new());
        let (mut diagonals, mut incidences) = (Vec::new(), Vec::new());
        for (p, touching) in touching.iter().enumerate() {
            // Blocks with particles that are wholly prescribed would be zero.
            let enters = |other: u32| free[p] != Axes::NONE && free[other as usize] != Axes::NONE;
            let others = touching.iter().map(|&(_, other)| other).filter(|&other| enters(other));
            let mut row: Vec<(Index, u32)> =
                others.chain([p as u32]).map(|other| (rows[other as usize], other)).collect();
            row.sort_unstable();
            row.dedup();
            let place = |column: Index| row.binary_search_by_key(&column, |entry| entry.0).ok().map(|at| at as u32);
            incidences.extend(touching.iter().map(|&(spring, other)| Incidence {
                spring,
                place: if enters(other) { place(rows[other as usize]) } else { None },
            }));
            diagonals.push(place(rows[p]).unwrap_or(0));
            columns.extend(row.iter().map(|entry| entry.0));
            column_free.extend(row.iter().map(|entry| free[entry.1 as usize]));
            starts.push(columns.len() as u32);
            spring_starts.push(incidences.len() as u32);
        }
        Self {
            size: system.dimension(),
            own,
            rows,
            starts,
            columns,
            column_free,
            diagonals,
            spring_starts,
            incidences,
            free,
        }
    }

    fn columns(&self, particle: usize) -> &[Index] {
        &self.columns[self.starts[particle] as usize..self.starts[particle + 1] as usize]
    }

    /// How many blocks each own row has.
    pub fn counts(&self) -> Counts {
        let first = self.rows.first().copied().unwrap_or(0);
        let range = first..first + self.own as Index;
        let mut counts = Counts::default();
        for p in 0..self.own {
            let count = |keep: &dyn Fn(&Index) -> bool| self.columns(p).iter().filter(|&c| keep(c)).count() as Index;
            let is_upper = |c: &Index| *c >= self.rows[p];
            counts.own.push(count(&|c| range.contains(c)));
            counts.other.push(count(&|c| !range.contains(c)));
            counts.own_upper.push(count(&|c| range.contains(c) && is_upper(c)));
            counts.other_upper.push(count(&|c| !range.contains(c) && is_upper(c)));
        }
        counts
    }

    /// Computes every own row of the matrix of an operator.
    ///
    /// # Errors
    /// Those of `row`.
    pub fn fill(&self, a: &SystemOperator, mut row: impl FnMut(Index, &[Index], &[f64]) -> Result<()>) -> Result<()> {
        let (size, masses) = (self.size, a.system().masses());
        let mut values: Vec<f64> = Vec::new();
        for (p, mass) in masses.iter().enumerate().take(self.own) {
            let columns = self.columns(p);
            let width = size * columns.len();
            values.clear();
            values.resize(size * width, 0.0);
            let mut diagonal = Matrix3::from_diagonal_element(a.mass_factor() * mass);
            let springs = &self.incidences[self.spring_starts[p] as usize..self.spring_starts[p + 1] as usize];
            for &Incidence { spring, place } in springs {
                let block = a.blocks()[spring as usize].matrix();
                diagonal += block;
                if let Some(place) = place {
                    for (r, c) in pairs(size) {
                        values[r * width + size * place as usize + c] -= block[(r, c)];
                    }
                }
            }
            let at = size * self.diagonals[p] as usize;
            // What is prescribed needs some entry of its own, best of the size of the others.
            let scale = diagonal.trace() / 3.0;
            for r in 0..size {
                for c in 0..size {
                    values[r * width + at + c] = diagonal[(r, c)];
                }
            }
            self.clear_prescribed(p, columns, &mut values);
            for axis in (0..size).filter(|&axis| !self.free[p].contains(axis)) {
                values[axis * width + at + axis] = scale;
            }
            row(self.rows[p], columns, &values)?;
        }
        Ok(())
    }

    /// Zeros in the rows and columns of prescribed coordinates.
    fn clear_prescribed(&self, p: usize, columns: &[Index], values: &mut [f64]) {
        let all = Axes::first(self.size);
        let width = self.size * columns.len();
        if self.free[p] != all {
            for axis in (0..self.size).filter(|&axis| !self.free[p].contains(axis)) {
                values[axis * width..(axis + 1) * width].fill(0.0);
            }
        }
        for (place, free) in self.column_free[self.starts[p] as usize..].iter().take(columns.len()).enumerate() {
            for c in (0..self.size).filter(|&c| *free != all && !free.contains(c)) {
                (0..self.size).for_each(|r| values[r * width + self.size * place + c] = 0.0);
            }
        }
    }
}

fn pairs(size: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..size).flat_map(move |r| (0..size).map(move |c| (r, c)))
}
