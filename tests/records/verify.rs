//! Every figure of the checks on small scenes is the one that was measured when it was looked at.
//!
//! A check that passes says that its value is below its bound; a slip in a check can leave it there. Value and bound, table, curves and
//! sentences are held to a list here: one test a family.

use crate::record::{Row, beside, hold};
use sprung::verify::{FAMILIES, built_in};

fn family(name: &str) {
    let family = FAMILIES.iter().find(|family| family.name == name).unwrap();
    let subjects = built_in().unwrap();
    hold(&format!("verify_{name}"), |seed| {
        let mut rows = Vec::new();
        for subject in subjects.iter().filter(|subject| (family.applies)(subject)) {
            for (number, check) in family.check(&beside(subject, seed)).iter().enumerate() {
                rows.push(Row::of(format!("{} {number}", subject.name), &serde_json::to_value(check).unwrap()));
            }
        }
        rows
    });
}

macro_rules! families {
    ($($name:ident)*) => { $(#[test] fn $name() { family(stringify!($name)); })* };
}

families!(
    jacobian dropped_terms derivatives work_energy assembly solvers linear_steps other_steps repeated options always_definite
    on_demand inertia order linear_momentum angular_momentum rigid_motion equilibrium ledger prescribed_motion in_space
    indefinite conjugate_gradients broken_states indicators
);
