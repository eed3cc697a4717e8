//! The springs behind an indefinite matrix, on scenes in which they are known.

use crate::tame_cloth::tame_cloth;
use faer::Par;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::assembly::{SpringPattern, SystemMatrix};
use sprung::force::SpringGeometry;
use sprung::inspect::{Inertia, Inspection, Minimality, smallest_set};
use sprung::integrate::{Regularization, StepMatrices};
use sprung::operator::{Combination, SystemOperator};
use sprung::work::Work;
use sprung::{Spring, State, Stiffness, System, SystemBuilder};
use std::sync::Arc;

fn a_without(system: &System, state: &State, dt: f64, dropped: &[usize]) -> Inertia {
    let extensions = SpringGeometry::at(system, &state.positions).expect("no collapsed spring");
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
    let extensions = SpringGeometry::at(&system, &state.positions).expect("no collapsed spring");
    let mut work = Work::default();
    let set = smallest_set(&system, &extensions, 0.05, Par::Seq, &mut work).expect("a small system");
    let negative = a_without(&system, &state, 0.05, &[]).negative;
    println!("{} terms, at least {}, {negative} negative: {work:?}", set.springs.len(), set.at_least);
    assert!(set.at_least >= negative.div_ceil(2) && set.at_least <= set.springs.len());
    assert!(3 * set.at_least >= 2 * set.springs.len(), "{} to {}", set.at_least, set.springs.len());
    assert!(a_without(&system, &state, 0.05, &set.springs).is_definite());
    // The final count of signs takes two, one on either side of zero.
    assert!(work.factorizations <= 9, "{work:?}");
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
    let extensions = SpringGeometry::at(&system, &state.positions).expect("no collapsed spring");
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
        let extensions = SpringGeometry::at(&system, &state.positions).expect("no collapsed spring");
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

/// The terms that the on-demand policy drops suffice, whatever the scene, and are no more than those of option II.
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
        let extensions = SpringGeometry::at(&system, &state.positions).expect("no collapsed spring");
        let mut softening = Regularization::new(&system);
        let dropped = softening.choose(&system, &extensions, Combination::step(dt)).expect("its own system");
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
