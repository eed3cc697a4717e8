//! Products of the same matrix formed twice, refilled values against fresh ones, and products that are known beforehand.
//!
//! With `d = x_i − x_j`, a translation gives a spring `w_i − w_j = 0`, a rotation `ω × d`, across it, and a dilation d, along
//! it. Multiplied by the blocks of one spring and summed over all,
//!
//! ```text
//! K 1 = 0            K (ω × x) = ω × f_t            K x = −L_{k/l0} x
//! G 1 = 0            G (ω × x) = 0                  G x = −L_b x
//! ```
//!
//! where f_t is the elastic force of the springs whose transverse term the option keeps (all, the stretched, none), and
//! `L_c` the graph Laplacian with weight c a spring. So K sees a rotation of a body under tension, and `axial` does not.
//! Prescribed coordinates take part: they contribute through the coupling to the right-hand side.

use super::{
    Check, Claim, Entry, Link, Measured, TestCase, U, UNITS, VECTORS, WorstEntries, random_vector, reduce, reference,
};
use crate::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix, assemble_afresh};
use crate::error::{Result, check_length};
use crate::force::SpringGeometry;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use crate::system::Axes;
use nalgebra::Vector3;
use std::sync::Arc;

/// Products and refill of A, for every option. The refilled matrix held the values of twice the step under another option before.
pub(super) fn assembly(case: &TestCase) -> Measured {
    let TestCase { name, system, state, dt, .. } = case;
    let geometry = SpringGeometry::at(system, &state.positions)?;
    let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
    let mut checks = Vec::new();
    for option in Stiffness::ALL {
        let scene = format!("{name}, {}", option.name());
        let before = if option == Stiffness::Full { Stiffness::Axial } else { Stiffness::Full };
        let before = SystemOperator::new(system, &geometry, before, Combination::step(2.0 * dt));
        let operator = SystemOperator::new(system, &geometry, option, Combination::step(*dt));
        let mut matrix = SystemMatrix::assemble(pattern.clone(), &before);
        matrix.refill(&operator);
        checks.push(products_agree(&operator, matrix.matrix(), &scene)?);
        checks.push(refill_is_fresh(&operator, matrix.matrix(), &scene)?);
        // K alone, where no mass hides what springs cancel.
        let stiffness = SystemOperator::new(system, &geometry, option, Combination::STIFFNESS);
        matrix.refill(&stiffness);
        checks.push(products_agree(&stiffness, matrix.matrix(), &format!("{scene}, K"))?);
    }
    Ok(checks)
}

/// Compares products with an assembled matrix with those of the matrix-free operator, component by component.
///
/// `product` is under test, `operator` is the reference. Value: the largest difference of a component relative to u of
/// its terms, `m|w| + Σ |B| (|w_i| + |w_j|)` over springs: `|A| |w|` but for what cancels inside A. Sees missing,
/// extra, doubled and misplaced blocks, a wrong mass, dropped constraints; is blind to faults of both.
///
/// # Errors
/// Operators of different orders.
pub fn products_agree(operator: &SystemOperator, product: &impl LinearOperator, scene: &str) -> Result<Check> {
    let n = operator.order();
    check_length("product", product.order(), n)?;
    let mut entries = WorstEntries::new();
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
    let value = entries.worst;
    // Entries that differ by 2 to 30 units are not wrong, as the table's verdicts would have it.
    let judged = |entry: Entry| if value <= UNITS { entry.with_verdict("agrees") } else { entry };
    let why = "30 u |A| |w| in each component: a spring's product takes about ten roundings, its entries of A and their sum as many";
    let check = Check::new(Claim::Assembly, "assembled A w against matrix-free A w", scene, value, UNITS, why);
    Ok(check.with_table(entries.into_table(judged)))
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
        // The two parts of a block, α (I − nnᵀ) and β nnᵀ, are rounded separately: their magnitudes count, not their sum's.
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
/// `refilled` is under test; `operator` is what it was refilled from. Value: the number of entries that differ in a bit, are stored in one only, or
/// are not numbers. Sees values left over from the refill before; is blind to a wrong block.
///
/// # Errors
/// Matrices of different orders.
pub fn refill_is_fresh(operator: &SystemOperator, refilled: &SymmetricMatrix, scene: &str) -> Result<Check> {
    check_length("refilled", refilled.order(), operator.order())?;
    let lower = assemble_afresh(operator).into_iter().filter(|entry| entry.row >= entry.column);
    // Both come by columns, rows ascending.
    let mut fresh = lower.map(|entry| ((entry.column, entry.row), entry.value)).peekable();
    let mut wrong = WorstEntries::new();
    for (row, column, value) in refilled.iter() {
        while let Some(((column, row), missing)) = fresh.next_if(|(place, _)| *place < (column, row)) {
            wrong.compare(row, Some(column), 0.0, missing, 0.0);
        }
        // An entry that no block touches is stored as zero: an axis of a particle, or of a pair.
        let expected = fresh.next_if(|(place, _)| *place == (column, row)).map_or(0.0, |(_, value)| value);
        if value.to_bits() != expected.to_bits() || value.is_nan() {
            wrong.compare(row, Some(column), value, expected, 0.0);
        }
    }
    for ((column, row), missing) in fresh {
        wrong.compare(row, Some(column), 0.0, missing, 0.0);
    }
    let count = wrong.compared as f64;
    let why = "both add the same numbers in the same order: not one bit may differ";
    let check = Check::new(Claim::Refill, "refilled A against A assembled afresh", scene, count, 0.0, why);
    Ok(check.with_table(wrong.into_table(|entry| entry)))
}

/// A field of displacements and its products with K and G: full-length.
struct RigidField {
    name: &'static str,
    field: Vec<Vector3<f64>>,
    stiffness: Vec<Vector3<f64>>,
    damping: Vec<Vector3<f64>>,
}

pub(super) fn rigid_motion(case: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for option in Stiffness::ALL {
        let k = Products::new(case, option, Combination::STIFFNESS)?;
        for field in rigid_fields(case, option) {
            let name = format!("K of a {}, {}", field.name, option.name());
            checks.push(k.compare(name, &field.field, &field.stiffness, Link::magnitude));
        }
    }
    if case.system.is_damped() {
        let g = Products::new(case, Stiffness::Full, Combination::DAMPING)?;
        for field in rigid_fields(case, Stiffness::Full) {
            checks.push(g.compare(format!("G of a {}", field.name), &field.field, &field.damping, |link| link.damping));
        }
    }
    Ok(checks)
}

fn rigid_fields(case: &TestCase, option: Stiffness) -> Vec<RigidField> {
    let TestCase { system, state, .. } = case;
    let n = system.particles();
    let links = reference::links(system, &state.positions);
    let centre = case.centre();
    let arms: Vec<Vector3<f64>> = state.positions.iter().map(|x| x - centre).collect();
    let zeros = || vec![Vector3::zeros(); n];
    let laplacian = |c: fn(&Link) -> f64| reference::sum(&links, n, |link| -link.direction * link.length * c(link));
    let mut fields = vec![
        RigidField {
            name: "translation",
            // No component is zero, and no two are alike.
            field: vec![Axes::first(system.dimension()).project(&Vector3::new(0.6, -0.7, 1.1)); n],
            stiffness: zeros(),
            damping: zeros(),
        },
        RigidField {
            name: "dilation",
            field: arms.clone(),
            stiffness: laplacian(|link| link.axial),
            damping: laplacian(|link| link.damping),
        },
    ];
    let omega = match system.dimension() {
        1 => return fields,
        2 => Vector3::new(0.0, 0.0, 0.9),
        _ => Vector3::new(0.4, -0.9, 0.7),
    };
    let transverse_force = |link: &Link| link.transverse(option) * link.length * link.direction;
    fields.push(RigidField {
        name: "rotation",
        field: arms.iter().map(|arm| omega.cross(arm)).collect(),
        stiffness: reference::sum(&links, n, |link| -omega.cross(&transverse_force(link))),
        damping: zeros(),
    });
    fields
}

struct Products<'s> {
    case: &'s TestCase,
    operator: SystemOperator<'s>,
    matrix: SystemMatrix,
}

impl<'s> Products<'s> {
    fn new(case: &'s TestCase, option: Stiffness, combination: Combination) -> Result<Self> {
        let geometry = SpringGeometry::at(&case.system, &case.state.positions)?;
        let operator = SystemOperator::new(&case.system, &geometry, option, combination);
        let matrix = SystemMatrix::assemble(Arc::new(SpringPattern::of_stiffness(&case.system)?), &operator);
        Ok(Self { case, operator, matrix })
    }

    /// Both products of the free rows with a full-length field against the expected one, in units of rounding.
    fn compare(
        &self,
        name: String,
        field: &[Vector3<f64>],
        expected: &[Vector3<f64>],
        size: impl Fn(&Link) -> f64,
    ) -> Check {
        let TestCase { system, state, .. } = self.case;
        let dofs = system.dofs();
        let (w, expected) = (reduce(system, field), reduce(system, expected));
        // The contribution of prescribed coordinates: −(−A_fc w_c).
        let zeros = || vec![0.0; dofs.len()];
        let (mut known, mut coupling, mut product) = (field.to_vec(), zeros(), zeros());
        dofs.scatter(&zeros(), &mut known);
        self.operator.subtract_coupling(&known, &mut coupling);
        let rounding = reference::magnitude(&reference::links(system, &state.positions), size, field);
        let mut entries = WorstEntries::new();
        for operator in [&self.operator as &dyn LinearOperator, self.matrix.matrix()] {
            operator.apply(&w, &mut product);
            for (row, dof) in dofs.iter().enumerate() {
                let found = product[row] - coupling[row];
                entries.compare(row, None, found, expected[row], UNITS * (U * rounding[dof.particle]));
            }
        }
        let why = "in units of rounding, u |K| |w| row by row: a product adds up about ten rounded terms a spring, and the \
                   direction, the length and the field are rounded too";
        let check = Check::new(Claim::Conservation, name, &self.case.name, UNITS * entries.worst, UNITS, why);
        let mut table = if check.passed() { Vec::new() } else { entries.into_table(|entry| entry) };
        table.retain(|entry| entry.verdict != "agrees");
        check.with_table(table)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures::chain;

    #[test]
    fn rows_beyond_rounding_are_listed_with_their_fault() {
        let case = chain(3, 0.1);
        let products = Products::new(&case, Stiffness::Full, Combination::STIFFNESS).unwrap();
        let dilation = &rigid_fields(&case, Stiffness::Full)[1];
        let compare =
            |expected: &[Vector3<f64>]| products.compare("dilation".into(), &dilation.field, expected, Link::magnitude);
        let right = compare(&dilation.stiffness);
        assert!(right.passed() && right.table.is_empty());
        let mut doubled = dilation.stiffness.clone();
        doubled[1].y *= 2.0;
        let wrong = compare(&doubled);
        let found: Vec<_> = wrong.table.iter().map(|entry| (entry.row, entry.verdict.as_str())).collect();
        assert_eq!(found, [(1, "off by the factor 0.50"); 2]);
        assert!(!wrong.passed());
    }
}
