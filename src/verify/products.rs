//! The same matrix twice: products by springs against products by entries, refilled values against fresh ones.

use super::check::{Check, Entry};
use super::claim::Claim;
use super::force_error::U;
use super::reduced::random_vector;
use super::verdict::{TABLE_ROWS, WorstEntries};
use crate::assembly::{SymmetricMatrix, assemble_afresh};
use crate::operator::{LinearOperator, SystemOperator};
use nalgebra::Vector3;

/// Random vectors tried.
const VECTORS: u64 = 4;

/// Compares products with an assembled matrix with those of the matrix-free operator, component by component.
///
/// `product` is under test, `operator` is the reference. Value: the largest difference of a component relative to u of
/// its terms, `m|w| + Σ |B| (|w_i| + |w_j|)` over springs: `|A| |w|` but for what cancels inside A. Sees missing,
/// extra, doubled and misplaced blocks, a wrong mass, dropped constraints; is blind to what both have wrong.
pub fn products_agree(operator: &SystemOperator, product: &impl LinearOperator, scene: &str) -> Check {
    let why = "30 u |A| |w| in each component: a spring's product takes about ten roundings, its entries of A and their sum as many";
    let check = |value, why: &str| {
        Check::new(Claim::Assembly, "assembled A w against matrix-free A w", scene, value, 30.0, why)
    };
    let n = operator.order();
    if product.order() != n {
        return check(f64::NAN, "the two operators have different orders");
    }
    let mut entries = WorstEntries::new(TABLE_ROWS);
    for seed in 0..VECTORS {
        let w = random_vector(n, seed);
        let (mut by_springs, mut by_entries) = (vec![0.0; n], vec![0.0; n]);
        operator.apply(&w, &mut by_springs);
        product.apply(&w, &mut by_entries);
        let terms = terms(operator, &w);
        for (row, ((a, b), terms)) in by_entries.iter().zip(&by_springs).zip(&terms).enumerate() {
            entries.compare(row, None, *a, *b, U * terms);
        }
    }
    let value = entries.worst();
    let table = entries.into_table(|entry| entry);
    // What is compared with 30 units is not wrong at 2, as the table's verdicts would have it.
    let judged = |entry: Entry| if value <= 30.0 { entry.with_verdict("agrees") } else { entry };
    check(value, why).with_table(table.into_iter().map(judged).collect())
}

/// `m |w| + Σ |B| (|w_i| + |w_j|)` for every row.
fn terms(operator: &SystemOperator, w: &[f64]) -> Vec<f64> {
    let system = operator.system();
    let dofs = system.dofs();
    let mut terms = vec![0.0; w.len()];
    for (particle, mass) in system.masses().iter().enumerate() {
        let rows = dofs.rows(particle);
        let pairs = terms[rows.clone()].iter_mut().zip(&w[rows]);
        pairs.for_each(|(terms, w)| *terms = (operator.mass_factor() * mass * w).abs());
    }
    for ((_, [i, j], _), block) in system.active().zip(operator.blocks()) {
        let size = dofs.get(w, i).abs() + dofs.get(w, j).abs();
        // Of the two parts of a block, α (I − nnᵀ) and β nnᵀ, each is rounded on its own: their magnitudes count, not
        // their sum's.
        let n = block.direction;
        let along = n * n.transpose();
        let [x, y, z] = [along[(0, 0)], along[(1, 1)], along[(2, 2)]];
        let mut across = along.abs();
        across.set_diagonal(&Vector3::new(y + z, z + x, x + y));
        let part = (across * block.transverse.abs() + along.abs() * block.axial.abs()) * size;
        dofs.add(&mut terms, i, &part);
        dofs.add(&mut terms, j, &part);
    }
    terms
}

/// Compares a refilled matrix with one assembled from nothing, to the bit.
///
/// `refilled` is under test; `operator` is what it was refilled from. Value: the number of entries that differ in a
/// bit, are stored in one only, or are not numbers. Sees values left over from the refill before; is blind to a wrong
/// block.
pub fn refill_is_fresh(operator: &SystemOperator, refilled: &SymmetricMatrix, scene: &str) -> Check {
    let why = "both add the same numbers in the same order: not one bit may differ";
    let check =
        |value, why: &str| Check::new(Claim::Refill, "refilled A against A assembled afresh", scene, value, 0.0, why);
    if refilled.order() != operator.order() {
        return check(f64::NAN, "the two matrices have different orders");
    }
    let lower = assemble_afresh(operator).into_iter().filter(|entry| entry.row >= entry.column);
    // Both come by columns, rows ascending.
    let mut fresh = lower.map(|entry| ((entry.column, entry.row), entry.value)).peekable();
    let mut wrong = WorstEntries::new(TABLE_ROWS);
    for (row, column, value) in refilled.iter() {
        while let Some(((column, row), missing)) = fresh.next_if(|(place, _)| *place < (column, row)) {
            wrong.compare(row, Some(column), 0.0, missing, 0.0);
        }
        // What nothing fills is stored as zero: an axis of a particle, or of a pair, whose blocks never touch it.
        let expected = fresh.next_if(|(place, _)| *place == (column, row)).map_or(0.0, |(_, value)| value);
        if value.to_bits() != expected.to_bits() || value.is_nan() {
            wrong.compare(row, Some(column), value, expected, 0.0);
        }
    }
    for ((column, row), missing) in fresh {
        wrong.compare(row, Some(column), 0.0, missing, 0.0);
    }
    let count = wrong.compared() as f64;
    check(count, why).with_table(wrong.into_table(|entry| entry))
}

#[cfg(test)]
mod tests {
    use super::refill_is_fresh;
    use crate::assembly::{SpringPattern, SystemMatrix};
    use crate::force::SpringGeometry;
    use crate::operator::{Combination, SystemOperator};
    use crate::spring::Stiffness;
    use crate::system::SystemBuilder;
    use crate::verify::fixtures::line;
    use std::sync::Arc;

    /// Entries of the lower triangle that a matrix has wrong, as (column, row), when it was made of this scene and should be of the line.
    fn wrong(scene: &SystemBuilder) -> (f64, Vec<(Option<usize>, usize)>) {
        let operator =
            |system, extensions| SystemOperator::new(system, extensions, Stiffness::Full, Combination::step(0.5));
        let built = [scene, &line()].map(|scene| {
            let (system, state) = scene.clone().build().unwrap();
            let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
            (system, extensions)
        });
        let [given, right] = built.each_ref().map(|(system, extensions)| operator(system, extensions));
        let pattern = Arc::new(SpringPattern::of_stiffness(&built[0].0).unwrap());
        let check = refill_is_fresh(&right, SystemMatrix::assemble(pattern, &given).matrix(), "line");
        let mut places: Vec<_> = check.table.iter().map(|entry| (entry.column, entry.row)).collect();
        places.sort_unstable();
        (check.value, places)
    }

    #[test]
    fn values_and_places_are_compared() {
        assert_eq!(wrong(&line()), (0.0, vec![]));
        // Of a spring that is not there the coupling and both diagonal entries are missing.
        let mut parted = line();
        parted.pairs.pop();
        parted.springs.pop();
        let expected = vec![(Some(1), 1), (Some(1), 2), (Some(2), 2)];
        assert_eq!(wrong(&parted), (3.0, expected.clone()));
        // One of another stiffness changes the same.
        let mut softer = line();
        softer.springs[1].stiffness = 11.0;
        assert_eq!(wrong(&softer), (3.0, expected));
    }
}
