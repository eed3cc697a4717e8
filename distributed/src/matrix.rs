//! `sprung-mpi matrix`: the matrix of the first step, gathered row by row.

use crate::agreed::agreed;
use crate::load::Source;
use crate::method::MethodArguments;
use crate::solver::{Choice, PetscSolver};
use crate::{Stop, or_end, part, ranks};
use sprung::force::SpringGeometry;
use sprung::linear::LinearSolver;
use sprung::operator::{Combination, SystemOperator};
use sprung::output::{AtomicFile, OutputFolder};
use sprung::work::Work;
use std::io::Write;
use std::path::PathBuf;

/// Assemble the matrix of the first step of a backward Euler method, and gather it
///
/// Writes A.mtx (Matrix Market, lower triangle, in N/m) as `sprung matrix` does. One rank gets all of it: for scenes small enough.
#[derive(Debug, clap::Args)]
pub struct Matrix {
    #[command(flatten)]
    source: Source,

    /// Time step, in seconds
    #[arg(long, value_name = "S")]
    dt: f64,

    #[command(flatten)]
    method: MethodArguments,

    /// Folder for the files, made where it does not exist [default: out/<scene name>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Matrix {
    /// Runs the command.
    ///
    /// # Errors
    /// Why not, on all ranks.
    pub fn execute(&self) -> Result<(), Stop> {
        let (header, slab) = self.source.load(crate::petsc::MOST_ROWS)?;
        let petsc = self.method.start();
        let part = or_end(part::cut(&petsc, &header, slab));
        let folder = self.out.clone().unwrap_or_else(|| self.source.folder(&header));
        let mut claimed = None;
        agreed(|| {
            claimed = Some(OutputFolder::claim(&folder, false).map_err(|error| error.to_string())?);
            Ok(true)
        })?;
        let (system, halo) = (&part.system, &part.halo);
        let option = sprung::Stiffness::ALL.into_iter().find(|option| option.name() == self.method.stiffness);
        let option = option.unwrap_or(sprung::Stiffness::Full);
        let extensions = or_end(SpringGeometry::at(system, &part.state));
        let operator = SystemOperator::new(system, &extensions, option, Combination::step(self.dt));
        let choice = self.method.choice();
        let mut solver = or_end(PetscSolver::new(&petsc, system, halo.clone(), choice, self.method.tolerance));
        solver.set_positions(&part.state.positions);
        or_end(solver.update(&operator, &mut Work::default()));

        // A row of the gathered matrix is the number of a free coordinate in the scene's order: particle, then axis.
        let size = header.dimension;
        let numbers = ranks_of_rows(&part, size);
        let mut entries = Vec::new();
        let upper_only = choice == Choice::Cg(crate::solver::Preconditioner::Icc);
        for p in 0..halo.own {
            for axis in system.dofs().free_axes(p).iter() {
                let row = halo.rows[p] as usize * size + axis;
                for (column, value) in or_end(solver.matrix().row(row as crate::petsc::Index)) {
                    let (row, column) = (numbers[&(row as u64)], numbers.get(&(column as u64)));
                    // Columns of prescribed coordinates hold zeros.
                    let Some(&column) = column else { continue };
                    let (row, column) = if upper_only { (row.max(column), row.min(column)) } else { (row, column) };
                    if column <= row {
                        entries.push((row, column, value));
                    }
                }
            }
        }
        let order = ranks::total(system.dofs().first_row(halo.own) as u64);
        let flat: Vec<f64> = entries.iter().flat_map(|&(r, c, v)| [r as f64, c as f64, v]).collect();
        let mut all: Vec<[f64; 3]> =
            ranks::gather(&flat).concat().chunks_exact(3).map(|entry| [entry[0], entry[1], entry[2]]).collect();
        if ranks::rank() == 0 {
            all.sort_by(|a, b| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0])));
            or_end(AtomicFile::write(folder.join("A.mtx"), |file| {
                writeln!(file, "%%MatrixMarket matrix coordinate real symmetric")?;
                writeln!(file, "{order} {order} {}", all.len())?;
                all.iter().try_for_each(|[r, c, v]| writeln!(file, "{} {} {v:?}", r + 1.0, c + 1.0))
            }));
            println!("{}: A of order {order} with {} entries", folder.display(), all.len());
        }
        Ok(())
    }
}

/// The number of every free coordinate of this part by its row in PETSc's matrix.
fn ranks_of_rows(part: &part::Part, size: usize) -> std::collections::BTreeMap<u64, u64> {
    let (system, halo) = (&part.system, &part.halo);
    // Everybody's particles with their number of free axes, so that all can count. The matrix is gathered anyway.
    let mine: Vec<u64> =
        (0..halo.own).flat_map(|p| [halo.particles[p], system.dofs().free_axes(p).count() as u64]).collect();
    let all = ranks::share(ranks::gather(&mine).concat());
    let mut counts: Vec<(u64, u64)> = all.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
    counts.sort_unstable();
    let firsts: std::collections::BTreeMap<u64, u64> = counts
        .iter()
        .scan(0, |next, &(particle, count)| Some((particle, std::mem::replace(next, *next + count))))
        .collect();
    let mut numbers = std::collections::BTreeMap::new();
    for (p, particle) in halo.particles.iter().enumerate() {
        for (rank, axis) in system.dofs().free_axes(p).iter().enumerate() {
            numbers.insert(halo.rows[p] * size as u64 + axis as u64, firsts[particle] + rank as u64);
        }
    }
    numbers
}
