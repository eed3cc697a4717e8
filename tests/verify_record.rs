//! Every figure of the checks on small scenes is the one that was measured when it was looked at.
//!
//! A check that passes says that its value is below its bound; a slip in a check can leave it there. Value and bound, table, curves and
//! sentences are held to a list here: one test a family.

#[path = "common/record.rs"]
mod record;

use record::{Row, hold};
use sprung::verify::{FAMILIES, Subject, built_in};

/// The subject, or one beside it: free coordinates and velocities moved by some units in the last place.
fn beside(subject: &Subject, seed: u64) -> Subject {
    let mut subject = subject.clone();
    if seed > 0 {
        let dofs: Vec<_> = (0..subject.system.dofs().len()).map(|row| subject.system.dofs().dof(row)).collect();
        for (row, dof) in dofs.into_iter().enumerate() {
            let by = 1.0 + (seed as f64 * (3.0 + row as f64)).sin() * 2e-15;
            subject.state.positions[dof.particle][dof.axis] *= by;
            subject.state.velocities[dof.particle][dof.axis] *= by;
        }
    }
    subject
}

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
