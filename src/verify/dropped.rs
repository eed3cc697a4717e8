//! Options II and III must leave out exactly the transverse terms that they promise to leave out.

use super::assembled::against_blocks;
use super::check::Check;
use super::claim::Claim;
use super::dual::dual_stiffness_block;
use super::v_curve::VCurve;
use crate::assembly::SymmetricMatrix;
use crate::figure::{Guide, Plot};
use crate::operator::LinearOperator;
use crate::spring::{Spring, Stiffness};
use crate::system::{State, System};
use nalgebra::{Matrix3, Vector3};

/// The term that an option leaves out of `K^s`: `P K^s P` with `P = I − nnᵀ` and K^s by dual numbers, or nothing.
fn dropped_block(option: Stiffness, spring: &Spring, d: &Vector3<f64>) -> Matrix3<f64> {
    let l = d.norm();
    let drops = match option {
        Stiffness::Full => false,
        Stiffness::Tension => l < spring.rest_length,
        Stiffness::Axial => true,
    };
    if !drops {
        return Matrix3::zeros();
    }
    let n = d / l;
    let across = Matrix3::identity() - n * n.transpose();
    across * dual_stiffness_block(spring, d) * across
}

/// A product with what an option leaves out of K added back.
struct Completed<'a, A> {
    stiffness: &'a A,
    blocks: Vec<([usize; 2], Matrix3<f64>)>,
    system: &'a System,
}

impl<'a, A: LinearOperator> Completed<'a, A> {
    fn new(system: &'a System, state: &State, option: Stiffness, stiffness: &'a A) -> Self {
        let block = |(_, [i, j], spring): (usize, [usize; 2], &Spring)| {
            ([i, j], dropped_block(option, spring, &(state.positions[i] - state.positions[j])))
        };
        Self { stiffness, blocks: system.active().map(block).collect(), system }
    }
}

impl<A: LinearOperator> LinearOperator for Completed<'_, A> {
    fn order(&self) -> usize {
        self.stiffness.order()
    }

    fn apply(&self, w: &[f64], y: &mut [f64]) {
        self.stiffness.apply(w, y);
        let dofs = self.system.dofs();
        for ([i, j], block) in &self.blocks {
            let s = block * (dofs.get(w, *i) - dofs.get(w, *j));
            dofs.add(y, *i, &-s);
            dofs.add(y, *j, &s);
        }
    }
}

/// The zero matrix: completed, it is the dropped terms alone.
struct Nothing(usize);

impl LinearOperator for Nothing {
    fn order(&self) -> usize {
        self.0
    }

    fn apply(&self, _: &[f64], y: &mut [f64]) {
        y.fill(0.0);
    }
}

/// Shows that K under an option is the exact K less the transverse terms of exactly the right springs.
///
/// `stiffness` is K under test, for `option`. Checks: every entry against dual-number blocks without those terms
/// (rounding); the floor of the V-curve once those terms are added back; and, where anything is dropped, the plateau of
/// the V-curve without them. Sees a term dropped from the wrong spring, in part, or not at all; is blind to a wrong
/// force law.
pub fn dropped_terms(
    system: &System,
    state: &State,
    force: impl FnMut(&[f64], &mut [f64]),
    option: Stiffness,
    stiffness: &SymmetricMatrix,
    scene: &str,
) -> Vec<Check> {
    let mut force = force;
    let name = |what: &str| format!("{what} under {}", option.name());
    let entries = name("K against dual numbers without the dropped terms");
    let kept = |spring: &Spring, d: &Vector3<f64>| dual_stiffness_block(spring, d) - dropped_block(option, spring, d);
    let mut checks = vec![against_blocks(system, state, &stiffness.to_csc(), &entries, scene, kept)];
    if stiffness.order() != system.dofs().len() {
        return checks;
    }
    let completed = Completed::new(system, state, option, stiffness);
    let zero = Nothing(stiffness.order());
    let dropped = Completed::new(system, state, option, &zero);
    let curves = VCurve::measure(system, state, &mut force, &completed).and_then(|completed| {
        let without = VCurve::measure(system, state, &mut force, stiffness)?;
        let (h, plateau, allowed) = without.plateau();
        // The error of a vanishing force against the dropped terms alone is their size.
        let size = VCurve::measure_at(system, state, |_: &[f64], f: &mut [f64]| f.fill(0.0), &dropped, &[h])?;
        Ok((completed, without, [plateau, allowed, size.plateau().1]))
    });
    let check = |what: &str, value, bound, why: &str| Check::new(Claim::Jacobian, name(what), scene, value, bound, why);
    let Ok((completed, without, [plateau, allowed, expected])) = curves else {
        let why = "a spring has length zero";
        checks.push(check("V-curve of K w with the dropped terms added", f64::NAN, 1.0, why));
        return checks;
    };
    let (floor, least) = completed.floor();
    let why = "with the dropped terms added back K is exact: least over h of truncation and rounding, of the order of u^(2/3)";
    checks.push(check("V-curve of K w with the dropped terms added", floor, least, why));
    if expected > 10.0 * allowed {
        let plot = Plot::log_log(name("Error of K w"), "h, fraction of the shortest spring", "relative error")
            .concluding(format!("As it is K w stays {plateau:.1e} off, with the dropped terms added {floor:.1e}."))
            .with_series(without.series("as it is"))
            .with_series(completed.series("with the dropped terms"))
            .with_guide(Guide::Level { y: expected, label: "size of the dropped terms".into() });
        let why = "the V-curve ends on a plateau as high as the dropped terms: relative difference of the two heights, \
            bounded by the floor of the exact V-curve over that height";
        let difference = (plateau / expected - 1.0).abs();
        checks.push(check("plateau of K w", difference, allowed / expected, why).with_curves(plot));
    }
    checks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::SystemBuilder;

    /// A spring of k = 100 N along x, pushed from 4 m to 1 m: `axial` and `tension` leave out −75 N/m across it.
    #[test]
    fn dropped_terms_are_added_back() {
        let mut builder = SystemBuilder::new();
        let (anchor, bob) = (builder.particle([0.0; 3], 1.0), builder.particle([1.0, 0.0, 0.0], 1.0));
        builder.spring(anchor, bob, Spring { stiffness: 100.0, rest_length: 4.0, damping: 0.0 });
        builder.hold(anchor);
        let (system, state) = builder.build().unwrap();
        let nothing = Nothing(3);
        let mut y = [7.0; 3];
        nothing.apply(&[1.0; 3], &mut y);
        assert_eq!((nothing.order(), y), (3, [0.0; 3]));
        for (option, across) in [(Stiffness::Full, 0.0), (Stiffness::Tension, 75.0), (Stiffness::Axial, 75.0)] {
            let completed = Completed::new(&system, &state, option, &nothing);
            completed.apply(&[1.0, 2.0, 3.0], &mut y);
            assert_eq!(
                (completed.order(), y.map(|y| y + 0.0)),
                (3, [0.0, 2.0 * across, 3.0 * across]),
                "{}",
                option.name()
            );
        }
    }
}
