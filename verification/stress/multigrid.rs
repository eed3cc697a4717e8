//! Random systems, and how far multigrid's preconditioner is from being symmetric and positive definite.
//!
//! B is scaled by A to order one, as the test of one system in `tests/multigrid.rs` does, and errors are counted in the unit of that
//! test's bound. Systems are those of the tests' strategies: one to three dimensions, up to 14 particles, prescribed axes, parts that
//! do not hang together; coarsened as far as can be.

use crate::common::{descriptions, log_uniform};
use nalgebra::DMatrix;
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use sprung::assembly::{SpringPattern, SystemMatrix};
use sprung::force::SpringGeometry;
use sprung::multigrid::Multigrid;
use sprung::operator::{Combination, SystemOperator};
use sprung::{State, Stiffness, System};
use std::sync::Arc;
use std::time::Instant;

/// The outcome for one system; `None` where A's condition is beyond single precision.
#[derive(Debug, Clone, Copy)]
struct Found {
    condition: f64,
    smallest: f64,
    asymmetry: f64,
}

/// Says what was found on stdout; returns whether every preconditioner was positive definite.
///
/// `only` examines one system alone, and shows it.
pub fn search(count: u64, seed: u64, only: Option<u64>) -> bool {
    let mut bytes = [7u8; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
    let mut runner = TestRunner::new_with_rng(Config::default(), rng);
    let strategy = (descriptions(), log_uniform(1e-3, 0.1), 0usize..20, proptest::bool::ANY);
    let start = Instant::now();
    let (mut preconditioners, mut indefinite, mut asymmetric) = (0u64, 0u64, 0u64);
    let (mut least, mut most, mut excess) = (f64::INFINITY, 0.0_f64, 0.0_f64);
    for index in 0..count {
        let Ok(tree) = strategy.new_tree(&mut runner) else { continue };
        if only.is_some_and(|only| only != index) {
            continue;
        }
        let (description, dt, largest_dense, placed) = tree.current();
        if only.is_some() {
            println!("{description:#?}");
        }
        let Ok(scene) = description.build() else { continue };
        for dt in [dt, 1.1 * dt, 1.3 * dt] {
            let Some(found) = examine(&scene, dt, largest_dense, placed) else { continue };
            preconditioners += 1;
            if only.is_some() {
                println!("dt {dt:e}, {largest_dense} {placed}: {found:?}");
            }
            least = least.min(found.smallest);
            most = most.max(found.asymmetry);
            let unit = 0.5 * f64::from(f32::EPSILON) * (found.condition + 1e3);
            excess = excess.max(found.asymmetry / unit);
            asymmetric += u64::from(found.asymmetry > 1e-3);
            if found.smallest <= 0.0 {
                indefinite += 1;
                println!("indefinite: system {index} of seed {seed}, dt {dt:e}, {largest_dense} {placed}: {found:?}");
            }
        }
        if (index + 1).is_power_of_two() || index + 1 == count {
            println!(
                "{} systems, {preconditioners} preconditioners in {:.0} s: {indefinite} indefinite, {asymmetric} with an \
                 asymmetry above 1e-3; smallest eigenvalue {least:.3e}, asymmetry at most {most:.3e}, {excess:.2} units",
                index + 1,
                start.elapsed().as_secs_f64()
            );
        }
    }
    indefinite == 0
}

fn examine((system, state): &(System, State), dt: f64, largest_dense: usize, placed: bool) -> Option<Found> {
    let extensions = SpringGeometry::at(system, &state.positions).ok()?;
    let a = SystemOperator::new(system, &extensions, Stiffness::Tension, Combination::step(dt));
    let pattern = Arc::new(SpringPattern::of_stiffness(system).ok()?);
    let matrix = DMatrix::from(&SystemMatrix::assemble(pattern, &a).matrix().to_coo());
    let order = matrix.nrows();
    if order == 0 {
        return None;
    }
    let eigenvalues = matrix.symmetric_eigenvalues();
    let condition = eigenvalues.max() / eigenvalues.min();
    if !(condition > 0.0 && condition < 1e5) {
        return None;
    }
    let mut multigrid = Multigrid::down_to(system, largest_dense).ok()?;
    if placed {
        multigrid.set_positions(&state.positions);
    }
    multigrid.refill(&a).and_then(|()| multigrid.rebuild(&a)).ok()?;
    let mut b = DMatrix::zeros(order, order);
    for (k, mut column) in b.column_iter_mut().enumerate() {
        let mut unit = vec![0.0; order];
        unit[k] = 1.0;
        multigrid.apply(&unit, column.as_mut_slice());
    }
    let l = matrix.cholesky()?.l();
    let scaled = l.transpose() * b * &l;
    let asymmetry = (&scaled - scaled.transpose()).norm();
    let smallest = ((&scaled + scaled.transpose()) * 0.5).symmetric_eigenvalues().min();
    Some(Found { condition, smallest, asymmetry })
}
