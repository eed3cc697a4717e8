//! Answers where forces act from outside, or jump within less than a step.

use super::{answer_by_tolerance, fine_answer, found, requirement};
use sprung::accuracy::{Verdict, relative_position_error};
use sprung::nalgebra::Vector3;
use sprung::system::{Axes, ExternalForce, Moment};
use sprung::{Constraint, Motion, Spring, SystemBuilder};

/// A constant push along one axis.
#[derive(Debug)]
struct Push(f64);

impl ExternalForce for Push {
    fn add(&self, _: &Moment<'_>, force: &mut [Vector3<f64>]) {
        force[1].x += self.0;
    }
}

/// A spring of ω = 1000/s at rest is pushed: by `a (1 − cos ωt)` with a = 0.1 m, for ever, which long steps would damp; with a velocity at the start
/// too. Explicit methods are dear, RODAS4 takes no external forces.
#[test]
fn what_acts_from_outside_is_seen() {
    for speed in [0.0, 30.0] {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 1e6, rest_length: 1.0, damping: 0.0 });
        builder.hold(0);
        builder.velocities[1].x = speed;
        let (system, start) = builder.build().unwrap();
        let system = system.with_external_force(Push(1e5));
        let found = found(&system, &start, &requirement(1e-2, 2.0));
        let u = 0.1 * (1.0 - 2000f64.cos()) + speed / 1000.0 * 2000f64.sin();
        let error = (found.state.positions[1].x - (1.0 + u)).abs() * 2f64.sqrt();
        assert!(found.verdict == Verdict::Confirmed && error <= 1e-2, "{error:e} {:?}", found.verdict);
    }
}

/// The path of the anchor of a spring bends twice within the longest step of an explicit method. Runs that take one step from kink to kink, whatever
/// their steps elsewhere, agree on what that does.
#[test]
fn short_ways_between_kinks_are_resolved() {
    for (stiffness, up, hold) in [(41.0, 0.007, 0.029), (400.0, 0.002, 0.003), (9.0, 0.02, 0.05)] {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        builder.gravity(0.0, -9.81, 0.0);
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness, rest_length: 1.0, damping: 0.0 });
        let offsets = [0.0, 0.49, 0.49].map(|y| Vector3::new(0.0, y, 0.0)).to_vec();
        let motion = Motion::Path { times: vec![0.0, up, up + hold], offsets };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, start) = builder.build().unwrap();
        let exact = fine_answer(&system, &start, 0.1);
        for accuracy in [1e-3, 1e-4, 5e-5, 1e-5] {
            let found = found(&system, &start, &requirement(accuracy, 0.1));
            let error = relative_position_error(&found.state.positions, &exact.positions, &start.positions);
            assert!(found.verdict == Verdict::Confirmed && error <= accuracy, "{stiffness} {accuracy:e}: {error:e}");
        }
    }
}

/// A particle that its anchor passes through, along no axis: the force jumps there.
#[test]
fn springs_may_pass_the_length_zero_in_the_plane() {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    builder.particle([-0.75, -1.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 538.0, rest_length: 1.25, damping: 0.0 });
    let offsets = [[0.0, 0.0], [0.45, 0.6], [-0.225, -0.3]].map(|[x, y]| Vector3::new(x, y, 0.0)).to_vec();
    let motion = Motion::Path { times: vec![0.0, 0.132, 0.169], offsets };
    builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
    let (system, start) = builder.build().unwrap();
    // No step across a jump of the forces is short enough for a tolerance of 1e-12.
    let exact = answer_by_tolerance(&system, &start, 0.5, 1e-7);
    for accuracy in [1e-2, 1e-3, 1e-4] {
        let found = found(&system, &start, &requirement(accuracy, 0.5));
        let error = relative_position_error(&found.state.positions, &exact.positions, &start.positions);
        assert!(
            found.verdict == Verdict::Confirmed && error <= accuracy,
            "{accuracy:e}: {error:e}, {:?}",
            found.verdict
        );
    }
}
