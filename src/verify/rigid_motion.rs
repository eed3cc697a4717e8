//! K and G of rigid motions and of dilation, which every spring answers the same way.
//!
//! With `d = x_i − x_j`, a translation gives a spring `w_i − w_j = 0`, a rotation `ω × d`, across it, and a dilation d, along
//! it. Multiplied by the blocks of one spring and summed over all,
//!
//! ```text
//! K 1 = 0            K (ω × x) = ω × f_kept         K x = −L_{k/l0} x
//! G 1 = 0            G (ω × x) = 0                  G x = −L_b x
//! ```
//!
//! where f_kept is the elastic force of the springs whose transverse term the option keeps (all, the stretched, none), and
//! `L_c` the graph Laplacian with weight c a spring. So K sees a rotation of a body under tension, and `axial` does not.
//! Prescribed coordinates take part: what they contribute comes through the coupling to the right-hand side.

use super::measured::Measured;
use super::{Check, Claim, Entry, TestCase, U, reference, worst};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::force::SpringGeometry;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use nalgebra::Vector3;
use std::sync::Arc;

/// A field of displacements and what K and G must make of it: full-length.
struct Motion {
    name: &'static str,
    field: Vec<Vector3<f64>>,
    stiffness: Vec<Vector3<f64>>,
    damping: Vec<Vector3<f64>>,
}

pub(super) fn measure(subject: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for option in Stiffness::ALL {
        let k = Products::of(subject, option, Combination::STIFFNESS)?;
        for motion in motions(subject, option) {
            let name = format!("K of a {}, {}", motion.name, option.name());
            let size = |link: &reference::Link| link.magnitude();
            checks.push(k.compare(name, &motion.field, &motion.stiffness, size));
        }
    }
    if subject.system.is_damped() {
        let g = Products::of(subject, Stiffness::Full, Combination::DAMPING)?;
        for motion in motions(subject, Stiffness::Full) {
            let name = format!("G of a {}", motion.name);
            checks.push(g.compare(name, &motion.field, &motion.damping, |link| link.damping));
        }
    }
    Ok(checks)
}

fn motions(subject: &TestCase, option: Stiffness) -> Vec<Motion> {
    let TestCase { system, state, .. } = subject;
    let dimension = system.dimension();
    let centre = subject.centre();
    let arms: Vec<Vector3<f64>> = state.positions.iter().map(|x| x - centre).collect();
    let links = reference::links(system, &state.positions);
    let n = system.particles();
    let zeros = || vec![Vector3::zeros(); n];
    // No component is zero, and no two are alike.
    let direction = Vector3::from_fn(|axis, _| if axis < dimension { [0.6, -0.7, 1.1][axis] } else { 0.0 });
    let translation = Motion { name: "translation", field: vec![direction; n], stiffness: zeros(), damping: zeros() };
    let along =
        |c: fn(&reference::Link) -> f64| reference::sum(&links, n, |link| -link.direction * link.length * c(link));
    let dilation = Motion {
        name: "dilation",
        field: arms.clone(),
        stiffness: along(|link| link.stiffness / link.rest_length),
        damping: along(|link| link.damping),
    };
    let omega = match dimension {
        1 => return vec![translation, dilation],
        2 => Vector3::new(0.0, 0.0, 0.9),
        _ => Vector3::new(0.4, -0.9, 0.7),
    };
    let kept = |link: &reference::Link| link.transverse(option) * link.length * link.direction;
    let rotation = Motion {
        name: "rotation",
        field: arms.iter().map(|arm| omega.cross(arm)).collect(),
        stiffness: reference::sum(&links, n, |link| -omega.cross(&kept(link))),
        damping: zeros(),
    };
    vec![translation, rotation, dilation]
}

/// The same matrix twice: assembled, and as an operator.
struct Products<'s> {
    subject: &'s TestCase,
    operator: SystemOperator<'s>,
    matrix: SystemMatrix,
}

impl<'s> Products<'s> {
    fn of(
        subject: &'s TestCase,
        option: Stiffness,
        combination: Combination,
    ) -> Result<Self, super::measured::Unfinished> {
        let system = &subject.system;
        let extensions = SpringGeometry::at(system, &subject.state.positions)?;
        let operator = SystemOperator::new(system, &extensions, option, combination);
        let matrix = SystemMatrix::assemble(Arc::new(SpringPattern::of_stiffness(system)?), &operator);
        Ok(Self { subject, operator, matrix })
    }

    /// Both products of the free rows with a full-length field against the expected one, in units of rounding.
    fn compare(
        &self,
        name: String,
        field: &[Vector3<f64>],
        expected: &[Vector3<f64>],
        size: impl Fn(&reference::Link) -> f64,
    ) -> Check {
        let TestCase { system, state, .. } = self.subject;
        let dofs = system.dofs();
        let reduced = |full: &[Vector3<f64>]| {
            let mut rows = vec![0.0; dofs.len()];
            dofs.gather(full, &mut rows);
            rows
        };
        let (w, expected) = (reduced(field), reduced(expected));
        // What prescribed coordinates contribute: −(−A_fc w_c).
        let mut known = field.to_vec();
        dofs.scatter(&vec![0.0; dofs.len()], &mut known);
        let mut coupling = vec![0.0; dofs.len()];
        self.operator.subtract_coupling(&known, &mut coupling);
        let links = reference::links(system, &state.positions);
        let rounding = reference::magnitude(&links, size, field);
        let mut entries = Vec::new();
        let mut product = vec![0.0; dofs.len()];
        let mut value: Vec<f64> = Vec::new();
        for operator in [&self.operator as &dyn LinearOperator, self.matrix.matrix()] {
            operator.apply(&w, &mut product);
            for (row, dof) in dofs.iter().enumerate() {
                let unit = U * rounding[dof.particle];
                let found = product[row] - coupling[row];
                let error = (found - expected[row]).abs();
                let share = if error == 0.0 { 0.0 } else { error / unit };
                value.push(share);
                if share.is_nan() || share > BOUND {
                    entries.push(Entry::new(row, None, found, expected[row], BOUND * unit));
                }
            }
        }
        entries.sort_by(|a, b| b.absolute.total_cmp(&a.absolute));
        entries.truncate(10);
        let why = "in units of rounding, u |K| |w| row by row: a product adds up about ten rounded terms a spring, and the \
                   direction, the length and the field are rounded too";
        Check::new(Claim::Conservation, name, &self.subject.name, worst(value), BOUND, why).with_table(entries)
    }
}

const BOUND: f64 = 30.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// Two particles at (1, 2) and (3, 4), joined; of z nothing is there in a plane.
    fn pair(dimension: usize) -> TestCase {
        let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
        let ends = [builder.particle([1.0, 2.0, 0.0], 1.0), builder.particle([3.0, 4.0, 0.0], 2.0)];
        builder.spring(ends[0], ends[1], Spring { stiffness: 8.0, rest_length: 2.0, damping: 0.5 });
        let (system, state) = builder.build().unwrap();
        TestCase { name: "pair".into(), system, state, dt: 0.1 }
    }

    /// The arms are ∓(1, 1, 0): a turn about z by 0.9, and in space about (0.4, −0.9, 0.7).
    #[test]
    fn fields_turn_and_grow_about_the_centre() {
        for (dimension, turned) in [(2, Vector3::new(-0.9, 0.9, 0.0)), (3, Vector3::new(-0.7, 0.7, 1.3))] {
            let motions = motions(&pair(dimension), Stiffness::Full);
            assert_eq!(motions.iter().map(|m| m.name).collect::<Vec<_>>(), ["translation", "rotation", "dilation"]);
            assert_eq!(motions[2].field, [Vector3::new(-1.0, -1.0, 0.0), Vector3::new(1.0, 1.0, 0.0)]);
            assert!((motions[1].field[1] - turned).amax() < 1e-15 && (motions[1].field[0] + turned).amax() < 1e-15);
            assert!(measure(&pair(dimension)).unwrap().iter().all(Check::passed));
        }
    }

    #[test]
    fn rows_beyond_rounding_are_listed_with_what_is_wrong() {
        let subject = pair(2);
        let products = Products::of(&subject, Stiffness::Full, Combination::STIFFNESS).unwrap();
        let dilation = &motions(&subject, Stiffness::Full)[2];
        let compare = |expected: &[Vector3<f64>]| {
            products.compare("dilation".into(), &dilation.field, expected, |link| link.magnitude())
        };
        let right = compare(&dilation.stiffness);
        assert!(right.passed() && right.table.is_empty());
        let mut doubled = dilation.stiffness.clone();
        doubled[1].y *= 2.0;
        let wrong = compare(&doubled);
        let told: Vec<_> = wrong.table.iter().map(|entry| (entry.row, entry.verdict.as_str())).collect();
        assert_eq!(told, [(3, "50.0 % too small"); 2]);
        assert!(!wrong.passed());
    }
}
