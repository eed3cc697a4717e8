//! The cost of an inspection, the parts that it skips, and that skipping loses no result.

use crate::tame_cloth::tame_cloth;
use faer::Par;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::inspect::{
    CriticalSteps, FirstAnswer, Inertia, InertiaMethod, Inspection, LargestStep, Part, Property, RotationLimit,
    SkipReason, spectrum,
};
use sprung::integrate::StepMatrices;
use sprung::linear::Ldlt;
use sprung::report::inspection::InspectionReport;
use sprung::work::Work;
use sprung::{Spring, State, Stiffness, System, SystemBuilder};

/// A whole inspection costs so many factorizations, whatever the size, all on one analysis: of a cloth whose springs are all stretched, of one in
/// which every seventh is pressed, and of one in which many are compressed a little. The numbers are those counted.
#[test]
fn an_inspection_costs_few_factorizations() {
    for n in [12, 24, 48] {
        let rest = tame_cloth(n, n);
        let mut pressed = tame_cloth(n, n);
        pressed.springs.iter_mut().step_by(7).for_each(|spring| spring.rest_length *= 1.5);
        let mut slack = tame_cloth(n, n);
        slack.springs.iter_mut().enumerate().for_each(|(s, spring)| spring.rest_length *= 1.0 + 0.02 * (s % 3) as f64);
        for (what, builder, dt, most) in
            [("stretched", rest, 0.05, 22), ("pressed", pressed, 0.05, 41), ("slack", slack, 0.004, 35)]
        {
            let (system, state) = builder.build().expect("a valid scene");
            let inspection = Inspection::at(&system, &state, dt, Stiffness::Full, Par::Seq).expect("a small system");
            assert_eq!(inspection.examined().inertia.negative > 0, what == "pressed");
            let work = inspection.work;
            println!("{what}, {} dofs: {work:?}", system.dofs().len());
            assert_eq!(work.symbolic_factorizations, 1, "{work:?}");
            assert!(work.factorizations <= most, "{what}: {work:?}");
            let mut turning = RotationLimit::new(&system, &state, Par::Seq).expect("a small system");
            for option in [Stiffness::Tension, Stiffness::Axial] {
                turning.largest_step(option, dt);
            }
            println!("of these for turning {}", turning.work.factorizations);
            assert!(turning.work.factorizations <= 11, "{:?}", turning.work);
        }
    }
}

/// n particles on a sphere and one in the middle, joined to all of them by springs that are compressed by up to a half.
fn hub(n: usize) -> (System, State) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    for _ in 0..n {
        let x = nalgebra::Vector3::from_fn(|_, _| rng.random::<f64>() - 0.5).normalize();
        let end = builder.particle([x.x, x.y, x.z], 1.0);
        let rest_length = 1.0 + rng.random::<f64>();
        builder.spring(0, end, Spring { stiffness: 100.0, rest_length, damping: 0.0 });
    }
    builder.build().expect("a valid scene")
}

/// n particles, each joined to every other.
fn complete(n: usize) -> (System, State) {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut builder = SystemBuilder::new();
    for _ in 0..n {
        let mut coordinate = || rng.random::<f64>();
        let x = [coordinate(), coordinate(), coordinate()];
        builder.particle(x, 1.0);
    }
    for i in 0..n {
        for j in 0..i {
            let rest_length = 0.3 + rng.random::<f64>();
            builder.spring(i, j, Spring { stiffness: 1.0, rest_length, damping: 0.0 });
        }
    }
    builder.build().expect("a valid scene")
}

/// Where many springs meet, and where all are joined to all, an inspection takes the work that it is allowed, counted in
/// factorizations of this size, and names what it leaves out for it; the signs come first.
#[test]
fn inspections_leave_out_what_takes_too_much_work() {
    for (system, state) in [hub(4000), complete(120)] {
        let a = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.1).expect("a matrix").a;
        let flops = Ldlt::analyse(a.pattern(), Par::Seq).expect("a small matrix").size().flops;
        let mut before = 0;
        for most in [20.0 * flops, 1e10, 3e10] {
            let within = Inspection::within(&system, &state, 0.1, Stiffness::Full, Par::Seq, most, &mut |_, _| ());
            let inspection = within.expect("a small system");
            let work = inspection.work;
            println!("{most:e}: {work:?}, left out {:?}", inspection.skipped);
            assert!(work.factorizations as f64 * flops <= most, "{most:e}: {work:?}");
            assert!(inspection.skipped_for(SkipReason::Interrupted).next().is_none());
            assert!(!inspection.skipped.is_empty(), "{most:e} is enough for all");
            let signs = inspection.examined().inertia;
            let is_counted = !inspection.lacks(Part::Signs(Stiffness::Full));
            assert!(most < 1e10 || is_counted && signs.method != InertiaMethod::None);
            let found = 22 - inspection.skipped.len();
            assert!(found >= before, "{most:e}: less for more work");
            before = found;
        }
        assert!(before > 4, "{before}");
    }
}

/// A part that was left out is not told as if it had been found.
#[test]
fn what_is_left_out_is_said() {
    let (system, state) = complete(20);
    let within = Inspection::within(&system, &state, 0.1, Stiffness::Full, Par::Seq, 1.0, &mut |_, _| ());
    let inspection = within.expect("a small system");
    let [full, tension, axial, _] = &inspection.options;
    assert!(
        [full.critical, full.stable, full.turning, axial.stable, tension.turning]
            .iter()
            .all(|limit| *limit == LargestStep::Unknown)
    );
    // Nothing has to be computed for these.
    assert_eq!([tension.critical, axial.critical], [LargestStep::Every; 2]);
    let report = InspectionReport { scene: "k", step: 0, time: 0.0, inspection: &inspection, losses: None };
    let told = report.text();
    for part in ["A is not looked at", "left out", "the signs of eigenvalues under axial", "--all", "not looked at"] {
        assert!(told.contains(part), "{part:?} is not in {told}");
    }
    assert!(!told.contains("NaN") && !told.contains("singular"), "{told}");
    assert_eq!(told.matches("every step").count(), 3, "{told}");
    let json = serde_json::to_value(report).expect("JSON");
    assert_eq!(json["left_out"].as_array().map(Vec::len), Some(inspection.skipped.len()));
    assert!(json["left_out"].as_array().is_some_and(|all| all.iter().all(|part| part["why"] == "too much work")));
    let whole = Inspection::at(&system, &state, 0.1, Stiffness::Full, Par::Seq).expect("a small system");
    assert!(whole.skipped.is_empty() && whole.options.iter().all(|option| option.critical != LargestStep::Unknown));
}

/// The first answer is there before any other part: after one analysis and at most one factorization. What it says is what is found out
/// later by other ways.
#[test]
fn the_first_answer_comes_first_and_is_true() {
    for (n, dt) in [(17, 0.05), (17, 0.001), (40, 0.05)] {
        let mut builder = tame_cloth(n, n);
        let bad = 400;
        builder.springs[bad].rest_length *= 6.0;
        let (system, state) = builder.build().expect("a valid scene");
        let mut seen: Vec<(FirstAnswer, Work, usize)> = Vec::new();
        let mut onlooker = |_: f64, found: &Inspection| {
            let first = found.first.clone().expect("an answer before all else");
            seen.push((first, found.work, found.skipped.len()));
        };
        let most = f64::INFINITY;
        let within = Inspection::within(&system, &state, dt, Stiffness::Full, Par::Seq, most, &mut onlooker);
        let inspection = within.expect("a small system");
        let (first, work, left) = &seen[0];
        println!("{n} {dt}: {:?} {:?} {work:?}", first.definite, first.direction.eigenvalue);
        assert_eq!((*left, work.symbolic_factorizations, work.assemblies), (21, 1, 1), "{work:?}");
        assert!(work.factorizations <= 1 && work.solves <= 4, "{work:?}");
        assert_eq!(inspection.first.as_ref(), Some(first));
        assert_eq!(first.definite, inspection.examined().inertia.is_definite());
        let lowest = &inspection.directions[0];
        let (curvature, smallest) = (first.direction.eigenvalue, inspection.examined().smallest);
        assert!(curvature >= smallest - 1e-6 * smallest.abs() && (curvature < 0.0) != first.definite);
        if !first.definite {
            let worst = first.worst().expect("a compressed spring");
            assert_eq!((worst.spring, lowest.culprits[0].spring), (bad, bad));
            assert!(curvature <= 0.9 * smallest, "{curvature} {smallest}");
        }
    }
}

/// A matrix whose lowest eigenvalue lies so little below zero that products alone do not see it is factored.
#[test]
fn the_first_answer_sees_what_products_do_not() {
    let mut builder = tame_cloth(30, 30);
    for spring in &mut builder.springs {
        spring.stiffness *= 1e4;
    }
    // A soft spring with a loose end, a tenth shorter than at rest.
    let end = builder.particle([-0.1, 0.0, 0.0], 0.02);
    let soft = builder.spring(0, end, Spring { stiffness: 1.0, rest_length: 0.11, damping: 0.0 });
    let (system, state) = builder.build().expect("a valid scene");
    let mut steps = CriticalSteps::new(&system, &state, Par::Seq).expect("a small system");
    let limit = steps.largest_step(Property::Definite, Stiffness::Full).dt().expect("a limit");
    for (dt, definite) in [(0.999 * limit, true), (1.001 * limit, false)] {
        let inspection = Inspection::at(&system, &state, dt, Stiffness::Full, Par::Seq).expect("a small system");
        let first = inspection.first.as_ref().expect("an answer");
        assert_eq!((first.definite, inspection.examined().inertia.is_definite()), (definite, definite), "{dt}");
        assert_eq!(first.direction.eigenvalue > 0.0, definite);
        assert_eq!(first.worst().map(|worst| worst.spring), Some(soft));
        assert!(inspection.examined().smallest.abs() < 1e-8 * inspection.examined().largest);
    }
}

/// Signs that the springs settle, and ends that are only certified, are those that a count and a whole search find.
#[test]
fn what_an_inspection_spares_is_what_it_would_have_found() {
    let mut builder = tame_cloth(16, 16);
    for spring in builder.springs.iter_mut().step_by(7) {
        spring.rest_length *= 1.5;
    }
    let (system, state) = builder.build().expect("a valid scene");
    for dt in [0.01, 0.2] {
        let inspection = Inspection::at(&system, &state, dt, Stiffness::Full, Par::Seq).expect("a small system");
        for each in &inspection.options {
            let a = StepMatrices::assemble(&system, &state, each.option, dt).expect("a matrix").a;
            let counted = Inertia::of(&a).expect("a small matrix");
            let signs = |inertia: &Inertia| (inertia.negative, inertia.zero, inertia.positive);
            assert_eq!(signs(&each.inertia), signs(&counted));
            let spared = each.inertia.method == InertiaMethod::Springs;
            assert_eq!(spared, each.option != Stiffness::Full, "{:?}", each.option);
            let whole = spectrum(&a, &counted, 6, Par::Seq, &mut Work::default()).expect("a small matrix");
            approx::assert_relative_eq!(each.smallest, whole.smallest(), max_relative = 1e-3);
            approx::assert_relative_eq!(each.largest, whole.largest, max_relative = 1e-6);
            approx::assert_relative_eq!(each.condition, whole.condition, max_relative = 2e-3);
        }
    }
}
