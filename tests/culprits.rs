//! Which springs spoil definiteness, on scenes in which that is known.

use faer::Par;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sprung::assembly::{SpringPattern, SystemMatrix};
use sprung::force::Extensions;
use sprung::inspect::{
    CriticalSteps, FirstAnswer, Inertia, InertiaMethod, Inspection, LargestStep, Minimality, Part, Property, Turning,
    Why, smallest_set, spectrum,
};
use sprung::integrate::{Softening, StepMatrices};
use sprung::linear::Ldlt;
use sprung::operator::{Combination, SystemOperator};
use sprung::report::inspection::{InspectionRecord, text};
use sprung::work::Work;
use sprung::{Spring, State, Stiffness, System, SystemBuilder};
use std::sync::Arc;

/// A cloth of n × m particles with structural and one diagonal spring a cell, every spring stretched by 1 to 4 %.
fn tame_cloth(n: usize, m: usize) -> SystemBuilder {
    let mut builder = SystemBuilder::new();
    for p in 0..n * m {
        let height = 0.01 * ((7 * (p / m) + 13 * (p % m)) % 11) as f64;
        builder.particle([0.1 * (p / m) as f64, 0.1 * (p % m) as f64, height], 0.02 + 0.001 * (p % 5) as f64);
    }
    for p in 0..n * m {
        let (right, up) = (p % m + 1 < m, p + m < n * m);
        for (q, inside) in [(p + 1, right), (p + m, up), (p + m + 1, right && up)] {
            if inside {
                let length = (builder.positions[p] - builder.positions[q]).norm();
                let rest_length = length * (0.96 + 0.01 * ((3 * p + q) % 4) as f64);
                builder.spring(p, q, Spring { stiffness: 40.0 + (p % 7) as f64, rest_length, damping: 0.01 });
            }
        }
    }
    builder
}

fn a_without(system: &System, state: &State, dt: f64, dropped: &[usize]) -> Inertia {
    let extensions = Extensions::at(system, &state.positions).expect("no collapsed spring");
    let mut operator = SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(dt));
    let active = system.active_springs();
    operator.update_each(&extensions, Combination::step(dt), |position| {
        if dropped.contains(&(active[position] as usize)) { Stiffness::Tension } else { Stiffness::Full }
    });
    let pattern = Arc::new(SpringPattern::of_stiffness(system).expect("a pattern"));
    Inertia::of(SystemMatrix::assemble(pattern, &operator).matrix()).expect("a small matrix")
}

#[test]
fn one_bad_spring_among_eight_hundred_is_named_first_and_alone() {
    let mut builder = tame_cloth(17, 17);
    let bad = 400;
    assert_eq!(builder.springs.len(), 800);
    builder.springs[bad].rest_length *= 6.0;
    let (system, state) = builder.build().expect("a valid scene");
    let dt = 0.05;
    let inspection = Inspection::at(&system, &state, dt, Stiffness::Full, Par::Seq).expect("a small system");
    assert!(inspection.examined().inertia.negative > 0);
    assert_eq!(inspection.compressed_springs, 1);
    let worst = &inspection.directions[0].culprits[0];
    assert_eq!((worst.spring, worst.particles), (bad, system.pair(bad)));
    assert!((worst.strain + 0.83).abs() < 0.02, "{worst:?}");
    assert!(worst.share >= 1.0 - 1e-9, "{worst:?}");
    assert!(worst.relieved > 0.0, "dropping it is enough along this direction: {worst:?}");
    assert_eq!(inspection.clusters.len(), 1);
    assert_eq!(inspection.clusters[0].springs, [bad]);
    let set = inspection.smallest_set.expect("A is indefinite");
    assert_eq!((set.springs.as_slice(), set.minimality, set.tension), (&[bad][..], Minimality::Irredundant, 1));
    assert!(a_without(&system, &state, dt, &[bad]).is_definite());
}

/// Hundreds of rows that buckle, each by itself: as many terms must go as springs are pressed, and that no fewer will do is proven by a look at
/// the rows of each and one factorization.
#[test]
fn where_thousands_curve_downwards_the_set_is_the_smallest() {
    let mut builder = tame_cloth(40, 40);
    for spring in builder.springs.iter_mut().step_by(7) {
        spring.rest_length *= 1.5;
    }
    let (system, state) = builder.build().expect("a valid scene");
    let extensions = Extensions::at(&system, &state.positions).expect("no collapsed spring");
    let mut work = Work::default();
    let set = smallest_set(&system, &extensions, 0.05, Par::Seq, &mut work).expect("a small system");
    let negative = a_without(&system, &state, 0.05, &[]).negative;
    println!("{} terms, at least {}, {negative} negative: {work:?}", set.springs.len(), set.at_least);
    assert!(set.at_least >= negative.div_ceil(2) && set.at_least <= set.springs.len());
    assert!(3 * set.at_least >= 2 * set.springs.len(), "{} to {}", set.at_least, set.springs.len());
    assert!(a_without(&system, &state, 0.05, &set.springs).is_definite());
    assert!(work.factorizations <= 8, "{work:?}");
}

/// The same spring among hundreds that are slightly compressed: option II would drop them all.
#[test]
fn harmless_compression_is_left_alone() {
    let mut builder = tame_cloth(17, 17);
    let bad = 123;
    for (s, spring) in builder.springs.iter_mut().enumerate() {
        spring.rest_length *= if s == bad { 6.0 } else { 1.03 };
    }
    let (system, state) = builder.build().expect("a valid scene");
    let dt = 0.02;
    let inspection = Inspection::at(&system, &state, dt, Stiffness::Full, Par::Seq).expect("a small system");
    let set = inspection.smallest_set.expect("A is indefinite");
    assert!(set.tension > 200, "{} compressed", set.tension);
    assert_eq!((set.springs.as_slice(), set.minimality), (&[bad][..], Minimality::Irredundant));
}

#[test]
fn shares_of_all_springs_add_up_to_one() {
    let mut builder = tame_cloth(4, 4);
    for spring in builder.springs.iter_mut().step_by(3) {
        spring.rest_length *= 2.0;
    }
    let (system, state) = builder.build().expect("a valid scene");
    let inspection = Inspection::at(&system, &state, 0.1, Stiffness::Full, Par::Seq).expect("a small system");
    let extensions = Extensions::at(&system, &state.positions).expect("no collapsed spring");
    let direction = &inspection.directions[0];
    let u = &inspection.spectrum.lowest[0].vector;
    let curvature = |s: usize, at| {
        let [i, j] = system.pair(s);
        let w = system.dofs().get(u, i) - system.dofs().get(u, j);
        w.dot(&system.springs()[s].stiffness_block(at, Stiffness::Full).apply(&w))
    };
    let curvatures: Vec<f64> = extensions.iter().enumerate().map(|(s, at)| curvature(s, at)).collect();
    let total: f64 = curvatures.iter().sum();
    approx::assert_relative_eq!(total, direction.stiffness_curvature, max_relative = 1e-10);
    for culprit in &direction.culprits {
        approx::assert_relative_eq!(culprit.share, curvatures[culprit.spring] / total, max_relative = 1e-8);
    }
    assert!(direction.culprits.windows(2).all(|pair| pair[0].share >= pair[1].share));
    let listed = inspection.directions.iter().filter(|d| d.eigenvalue < 0.0).count();
    assert_eq!(listed, inspection.examined().inertia.negative.min(24), "every direction of negative curvature");
}

/// Against all subsets: nothing in the set can be spared, and it is rarely larger than the smallest there is.
#[test]
fn smallest_sets_are_irredundant_and_nearly_always_smallest() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut cases, mut larger, mut proven) = (0, 0, 0);
    while cases < 60 {
        let mut builder = SystemBuilder::new();
        let n = rng.random_range(3..7);
        for _ in 0..n {
            let mut coordinate = || rng.random::<f64>();
            let x = [coordinate(), coordinate(), coordinate()];
            builder.particle(x, 0.2 + rng.random::<f64>());
        }
        for s in 0..9 {
            let (i, j) = if s < n - 1 { (s, s + 1) } else { (rng.random_range(0..n), rng.random_range(0..n)) };
            if i != j {
                let length = (builder.positions[i] - builder.positions[j]).norm();
                let rest_length = length * (0.7 + 1.6 * rng.random::<f64>());
                builder.spring(i, j, Spring { stiffness: 50.0, rest_length, damping: 0.0 });
            }
        }
        let (system, state) = builder.build().expect("a valid scene");
        let dt = 10f64.powf(-1.5 + 1.5 * rng.random::<f64>());
        if a_without(&system, &state, dt, &[]).is_definite() {
            continue;
        }
        cases += 1;
        let extensions = Extensions::at(&system, &state.positions).expect("no collapsed spring");
        let set = smallest_set(&system, &extensions, dt, Par::Seq, &mut Work::default()).expect("a small system");
        assert_eq!(set.minimality, Minimality::Irredundant);
        assert!(a_without(&system, &state, dt, &set.springs).is_definite());
        for spared in &set.springs {
            let rest: Vec<usize> = set.springs.iter().copied().filter(|s| s != spared).collect();
            assert!(!a_without(&system, &state, dt, &rest).is_definite(), "{spared} can be spared of {set:?}");
        }
        let strain = |s: &usize| {
            let [i, j] = system.pair(*s);
            (state.positions[i] - state.positions[j]).norm() / system.springs()[*s].rest_length - 1.0
        };
        let compressed: Vec<usize> = (0..system.springs().len()).filter(|s| strain(s) < 0.0).collect();
        assert_eq!(compressed.len(), set.tension);
        let smallest =
            (0u32..1 << compressed.len()).filter(|bits| (bits.count_ones() as usize) < set.springs.len()).any(|bits| {
                let subset: Vec<usize> =
                    (0..compressed.len()).filter(|k| bits >> k & 1 == 1).map(|k| compressed[k]).collect();
                a_without(&system, &state, dt, &subset).is_definite()
            });
        larger += usize::from(smallest);
        // The bound from below is one, and often tells that a set is the smallest.
        let fewest = (0u32..1 << compressed.len()).filter(|bits| {
            let subset: Vec<usize> =
                (0..compressed.len()).filter(|k| bits >> k & 1 == 1).map(|k| compressed[k]).collect();
            a_without(&system, &state, dt, &subset).is_definite()
        });
        let fewest = fewest.map(|bits| bits.count_ones() as usize).min();
        assert!(Some(set.at_least) <= fewest && set.at_least >= 1, "{set:?}, {fewest:?} are enough");
        assert_eq!(set.is_smallest(), Some(set.at_least) == Some(set.springs.len()));
        proven += usize::from(set.is_smallest());
    }
    println!("{larger} of {cases} sets are larger than need be, {proven} are proven not to be");
    assert!(larger <= cases / 20, "{larger} of {cases} sets are larger than need be");
    assert!(proven >= cases / 2, "only {proven} of {cases} sets are proven to be the smallest");
}

/// What the on-demand policy drops is enough, whatever the scene, and no more than option II drops.
#[test]
fn the_local_condition_is_enough_on_random_scenes() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut spared, mut indefinite) = (0, 0);
    for _ in 0..200 {
        let (n, m) = (rng.random_range(2..7), rng.random_range(2..7));
        let mut builder = tame_cloth(n, m);
        for spring in &mut builder.springs {
            spring.rest_length *= 0.8 + 0.8 * rng.random::<f64>();
        }
        if rng.random_bool(0.5) {
            builder.hold(0);
        }
        let (system, state) = builder.build().expect("a valid scene");
        let dt = 10f64.powf(-3.0 + 3.0 * rng.random::<f64>());
        let extensions = Extensions::at(&system, &state.positions).expect("no collapsed spring");
        let mut softening = Softening::new(&system);
        let dropped = softening.choose(&system, &extensions, Combination::step(dt));
        let active = system.active_springs();
        let springs: Vec<usize> = (0..active.len())
            .filter(|&p| softening.options()[p] == Stiffness::Tension)
            .map(|p| active[p] as usize)
            .collect();
        assert_eq!(springs.len(), dropped);
        assert!(a_without(&system, &state, dt, &springs).is_definite(), "dt = {dt}");
        let a = StepMatrices::assemble(&system, &state, Stiffness::Full, dt).expect("a matrix").a;
        let compressed = system.active().zip(extensions.iter()).filter(|((_, _, s), at)| s.is_compressed(at)).count();
        if !Inertia::of(&a).expect("a small matrix").is_definite() {
            indefinite += 1;
            spared += compressed - dropped;
        }
    }
    println!("{spared} transverse terms spared in {indefinite} indefinite scenes");
    assert!(indefinite > 50 && spared > 100);
}

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
            [("stretched", rest, 0.05, 20), ("pressed", pressed, 0.05, 37), ("slack", slack, 0.004, 28)]
        {
            let (system, state) = builder.build().expect("a valid scene");
            let inspection = Inspection::at(&system, &state, dt, Stiffness::Full, Par::Seq).expect("a small system");
            assert_eq!(inspection.examined().inertia.negative > 0, what == "pressed");
            let work = inspection.work;
            println!("{what}, {} dofs: {work:?}", system.dofs().len());
            assert_eq!(work.symbolic_factorizations, 1, "{work:?}");
            assert!(work.factorizations <= most, "{what}: {work:?}");
            let mut turning = Turning::new(&system, &state, Par::Seq).expect("a small system");
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
            println!("{most:e}: {work:?}, left out {:?}", inspection.left_out);
            assert!(work.factorizations as f64 * flops <= most, "{most:e}: {work:?}");
            assert!(inspection.left_out_for(Why::Interrupted).next().is_none());
            assert!(!inspection.left_out.is_empty(), "{most:e} is enough for all");
            let signs = inspection.examined().inertia;
            let is_counted = !inspection.lacks(Part::Signs(Stiffness::Full));
            assert!(most < 1e10 || is_counted && signs.method != InertiaMethod::None);
            let found = 18 - inspection.left_out.len();
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
    let [full, tension, axial] = &inspection.options;
    assert!(
        [full.critical, full.stable, full.turning, axial.stable, tension.turning]
            .iter()
            .all(|limit| *limit == LargestStep::Unknown)
    );
    // Nothing has to be computed for these.
    assert_eq!([tension.critical, axial.critical], [LargestStep::Every; 2]);
    let told = text("k", 0, 0.0, &inspection, None);
    for part in ["A is not looked at", "left out", "the signs of eigenvalues under axial", "--all", "not looked at"] {
        assert!(told.contains(part), "{part:?} is not in {told}");
    }
    assert!(!told.contains("NaN") && !told.contains("singular"), "{told}");
    assert_eq!(told.matches("every step").count(), 2, "{told}");
    let json = serde_json::to_value(InspectionRecord::new("k", 0, 0.0, &inspection)).expect("JSON");
    assert_eq!(json["left_out"].as_array().map(Vec::len), Some(inspection.left_out.len()));
    assert!(json["left_out"].as_array().is_some_and(|all| all.iter().all(|part| part["why"] == "too much work")));
    let whole = Inspection::at(&system, &state, 0.1, Stiffness::Full, Par::Seq).expect("a small system");
    assert!(whole.left_out.is_empty() && whole.options.iter().all(|option| option.critical != LargestStep::Unknown));
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
            seen.push((first, found.work, found.left_out.len()));
        };
        let most = f64::INFINITY;
        let within = Inspection::within(&system, &state, dt, Stiffness::Full, Par::Seq, most, &mut onlooker);
        let inspection = within.expect("a small system");
        let (first, work, left) = &seen[0];
        println!("{n} {dt}: {:?} {:?} {work:?}", first.definite, first.direction.eigenvalue);
        assert_eq!((*left, work.symbolic_factorizations, work.assemblies), (17, 1, 1), "{work:?}");
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
