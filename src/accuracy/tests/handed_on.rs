//! What ways hand on: options to their runs, and a course to the way that follows.

use super::super::resolution::{Unresolved, unresolved};
use super::*;
use crate::linear::{SolverChoice, SolverOptions, Tolerance};
use faer::Par;

/// Both implicit ways solve with what was asked for, and a thousand times more exactly than the accuracy.
#[test]
fn implicit_runs_solve_as_they_are_told() {
    let case = Case::new(led(3.0), 1.0, 1e-2).with(priced(1e5, 1e5, 1e3)).with(|case| {
        case.solver = Some(SolverChoice::Ldlt);
        case.par = Par::rayon(2);
    });
    for way in [&by_settled as Way<'_>, &by_stiff] {
        let linear = case.followed(way).1.unwrap().configuration.options.linear;
        assert_eq!((linear.solver, linear.par), (SolverChoice::Ldlt, Par::rayon(2)));
        assert_eq!(linear.tolerance, Tolerance::Fixed(1e-3 * 1e-2));
    }
}

/// A particle of 1 kg on 1 N/m, 0.3 m from rest: runs of 20 and 25 steps are off by 10⁻⁴ m, what they leave to DOP853 by the fourth
/// power of the step.
#[test]
fn verlet_leaves_a_course_without_its_leading_error() {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    let [anchor, particle] = [0.0, 1.3].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
    builder.spring(anchor, particle, spring(1.0, 1.0, 0.0));
    builder.hold(anchor);
    let case = Case::new(builder.build().unwrap(), 2.0, 1e-6).with(priced(20.0, 3.0, 1.0));
    let error = |course: &Course| (course.end()[1].x - 1.0 - 0.3 * 2f64.cos()).abs();
    let led = case.tried(&|search, price| {
        let Err(Extrapolated(Some(course))) = verlet::answer(search, price)? else { panic!("an answer") };
        assert!(error(&course) < 2e-6, "{:e}", error(&course));
        Ok("elsewhere".into())
    });
    assert!(led.contains("of 2 runs") && led.contains("in 25 steps"), "{led}");
}

/// A stiff chain that hangs from its first particle, stretched by its weight, and swings slowly, by conjugate gradients.
fn weighted_chain(accuracy: f64) -> Case {
    let (links, stiffness, weight) = (4, 1e6, 9.81);
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.gravity(0.0, -weight, 0.0);
    let mut below = 0.0;
    for p in 0..=links {
        let particle = builder.particle([0.0, -below, 0.0], 1.0);
        builder.velocities[particle].x = 0.02 * below;
        below += 1.0 + weight * f64::from(links - p) / stiffness;
    }
    (0..links as usize).for_each(|p| _ = builder.spring(p, p + 1, spring(stiffness, 1.0, 1e3)));
    builder.hold(0);
    Case::new(builder.build().unwrap(), 1.0, accuracy).with(|case| case.solver = Some(SolverChoice::Cg))
}

/// The runs that would do after the first two cost more than half of the cheapest explicit answer that is dear enough, and less than half of one that is
/// three times as dear.
#[test]
fn runs_may_cost_half_of_an_explicit_answer() {
    let case = weighted_chain(3e-4);
    let costs = CostModel::of(&case.system);
    let border = 36.0
        * (0.1f64 / 3e-4).powf(0.12)
        * (2.0 + costs.assembly() + costs.least_factorization() + costs.least_direct_solve());
    for (times, goes_on) in [(1.01, false), (3.03, true)] {
        let tried = case.with(priced(times * border / 2.25, 1e3, 1e3)).tried(&by_settled);
        assert!(tried.contains("bdf2 with dt = 8.333e-2 s"), "{tried}");
        assert_eq!(tried.contains("bdf2 with dt = 2.778e-2 s"), goes_on, "{tried}");
        assert_eq!(tried.contains("Some(Confirmed)"), goes_on, "{tried}");
    }
}

/// Twelve steps err by 1.3e-3 by three times the law: nine tenths of the accuracy may be used.
#[test]
fn estimates_of_implicit_runs_may_use_nine_tenths() {
    for (accuracy, goes_on) in [(1.0 / 0.89, false), (1.0 / 0.91, true)] {
        let tried = weighted_chain(accuracy * 1.2965e-3).with(priced(1e5, 1e5, 1e3)).tried(&by_settled);
        assert!(tried.contains("Some(Confirmed)"), "{tried}");
        assert_eq!(tried.contains("of 3 runs"), goes_on, "{tried}");
    }
}

/// Two stiff springs that hang from an anchor in a row, and vibrate with 2 m/s or 20 µm/s: what a twelfth of the time does not resolve may be half of the
/// accuracy, and drift by 0.7 of it. The first decides where little vibrates, the second where much does.
#[test]
fn what_implicit_runs_leave_out_is_little() {
    for (speed, duration) in [(2.0, 2.0), (2e-5, 2.0), (2.0, 1.0)] {
        let mut builder = SystemBuilder::new();
        (0..3).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 1.0));
        builder.velocities[2].x = speed;
        (0..2).for_each(|p| _ = builder.spring(p, p + 1, spring(1e9, 1.0, 0.0)));
        builder.hold(0);
        let (system, start) = builder.build().unwrap();
        let (options, spans) = (SolverOptions::default(), [duration / 12.0, duration]);
        let closest = Unresolved { amplitude: f64::INFINITY, drift: 0.0 };
        let (left, _) = unresolved(&system, &start, spans, &[], &closest, &options, &CostModel::of(&system)).unwrap();
        let (size, drift) = (left.amplitude / 0.5, left.drift / 0.7);
        assert_eq!(size > drift, speed < 1.0, "{size:e} {drift:e}");
        for (part, is_tried) in [(0.99, false), (1.01, true)] {
            let case = Case::new((system.clone(), start.clone()), duration, part * size.max(drift));
            let tried = case.with(priced(1e7, 1e7, 1e5)).tried(&by_settled);
            assert_eq!(tried.contains("bdf2"), is_tried, "{speed} {part}: {tried}");
        }
    }
}

/// A path with four bends before the end is followed, one with five is not.
#[test]
fn few_kinks_are_looked_at() {
    for (kinks, is_tried) in [(4u8, true), (5, false)] {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        (0..2).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 1.0));
        builder.spring(0, 1, spring(1e9, 1.0, 0.0));
        let times: Vec<f64> = (0..=kinks).map(|kink| 0.1 * f64::from(kink)).collect();
        let offsets = times.iter().map(|time| Vector3::new(1e-3 * time * time, 0.0, 0.0)).collect();
        let motion = Motion::Path { times, offsets };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let case = Case::new(builder.build().unwrap(), 1.0, 1e-2).with(priced(1e7, 1e7, 1e5));
        let tried = case.tried(&by_settled);
        assert_eq!(tried.contains("bdf2"), is_tried, "{kinks}: {tried}");
    }
}

/// An anchor that stands still for half a second and then moves, on a spring of ω = 100/s: a tenth of a metre a second sets off vibrations of a millimetre,
/// which may be left out of one per cent of the extent, a whole one ten times as much, which may not.
#[test]
fn vibrations_that_kinks_set_off_are_not_left_out() {
    for (speed, is_tried) in [(0.1, true), (1.0, false)] {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        (0..2).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 1.0));
        builder.spring(0, 1, spring(1e4, 1.0, 0.0));
        let offsets = [0.0, 0.0, speed].map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
        let motion = Motion::Path { times: vec![0.0, 0.5, 1.5], offsets };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let case = Case::new(builder.build().unwrap(), 1.0, 1e-2).with(priced(1e7, 1e7, 1e5));
        let tried = case.tried(&by_settled);
        assert_eq!(tried.contains("bdf2"), is_tried, "{speed}: {tried}");
    }
}
