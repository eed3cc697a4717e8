//! Particles between walls: steps that are never, always or sometimes too long.

use super::*;
use crate::inspect::tests::chain;
use crate::system::{ExternalForce, StateView};
use nalgebra::Vector3;

/// A particle between two walls that flies across its springs at 10⁹ m/s: no step that is tried is short enough.
#[test]
fn a_motion_so_fast_that_every_step_is_too_long_has_no_limit() {
    let (system, mut state) = chain(1, 1.0);
    let limit =
        |state: &State| RotationLimit::new(&system, state, Par::Seq).unwrap().largest_step(Stiffness::Axial, 1.0);
    assert_eq!(limit(&state), LargestStep::Every);
    state.velocities[1].y = 1e9;
    assert_eq!(limit(&state), LargestStep::UpTo { dt: 0.0, refused: 1.0 });
    state.velocities[1].y = 1.0;
    assert!(matches!(limit(&state), LargestStep::UpTo { dt, refused } if 0.0 < dt && dt < refused));
}

#[test]
fn forces_are_evaluated_once() {
    let (system, state) = chain(1, 1.0);
    let turning = RotationLimit::new(&system, &state, Par::Seq).unwrap();
    assert_eq!((turning.work.force_evaluations, turning.work.symbolic_factorizations), (1, 1));
}

/// Wind that pushes as gravity would limits steps as gravity does.
#[test]
fn external_forces_turn_springs_too() {
    #[derive(Debug)]
    struct Wind;

    impl ExternalForce for Wind {
        fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
            force.iter_mut().take(at.positions.len()).for_each(|f| f.y -= 90.0);
        }
    }

    let (system, state) = chain(1, 1.0);
    let limit =
        |system: &System| RotationLimit::new(system, &state, Par::Seq).unwrap().largest_step(Stiffness::Axial, 1.0);
    let calm = limit(&system);
    let blown = limit(&system.clone().with_external_force(Wind));
    assert!(calm == LargestStep::Every && matches!(blown, LargestStep::UpTo { .. }), "{calm:?} {blown:?}");
}
