use super::*;
use crate::spring::Spring;
use crate::system::SystemBuilder;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use std::f64::consts::PI;

pub(super) fn framework(dimension: usize, places: &[[f64; 3]], bars: &[[usize; 2]], held: &[usize]) -> (System, State) {
    let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
    for &x in places {
        builder.particle(x, 1.0);
    }
    for &[i, j] in bars {
        let length = (0..3).map(|axis| (places[i][axis] - places[j][axis]).powi(2)).sum::<f64>().sqrt();
        builder.spring(i, j, Spring { stiffness: 10.0, rest_length: length, damping: 0.0 });
    }
    held.iter().for_each(|&p| {
        builder.hold(p);
    });
    builder.build().unwrap()
}

fn find(dimension: usize, places: &[[f64; 3]], bars: &[[usize; 2]], held: &[usize]) -> Mechanisms {
    let (system, state) = framework(dimension, places, bars, held);
    mechanisms(&system, &state).unwrap()
}

const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
const SIDES: [[usize; 2]; 4] = [[0, 1], [1, 2], [2, 3], [3, 0]];

/// A square of four bars has a mechanism, which one diagonal removes; two diagonals have a state of self-stress.
#[test]
fn squares_with_and_without_diagonals() {
    let found = find(2, &SQUARE, &SIDES, &[]);
    assert_eq!((found.rank, found.mechanisms, found.rigid_motions, found.self_stresses), (4, 4, 3, 0));
    assert_eq!((found.decided, found.prestress_stable), (true, Some(false)));
    assert_eq!(found.added_springs.len(), 1);
    let [i, j] = found.added_springs[0];
    assert_eq!((i + 2) % 4, j, "a diagonal");
    let braced = [SIDES.as_slice(), &[[0, 2], [1, 3]]].concat();
    let found = find(2, &SQUARE, &braced, &[]);
    assert_eq!((found.rank, found.mechanisms, found.self_stresses, found.prestress_stable), (5, 3, 1, None));
    // Equal tensions in the sides, −√2 of them in the diagonals.
    let stress = &found.self_stress[0];
    assert!(
        (0..4).all(|k| (stress[k] / stress[0] - 1.0).abs() < 1e-12)
            && (stress[4] / stress[0] + 2f64.sqrt()).abs() < 1e-12
    );
    // On supports: no rigid motion; the two upper particles move together.
    let found = find(2, &SQUARE, &SIDES, &[0, 1]);
    assert_eq!(
        (found.degrees_of_freedom, found.springs, found.rank, found.mechanisms, found.rigid_motions),
        (4, 4, 3, 1, 0)
    );
    assert_eq!(found.movers, [[2, 3]]);
    // The bar between the supports bears any tension.
    assert_eq!(found.self_stresses, 1);
}

/// A spring of zero length has the stiffness κ I: it holds particles together along every axis, and several of them are in self-stress.
#[test]
fn springs_of_zero_length_resist_in_every_direction() {
    for dimension in 1..=3 {
        let found = find(dimension, &[[0.0; 3]; 2], &[[0, 1]], &[0]);
        assert_eq!((found.springs, found.rank, found.mechanisms, found.self_stresses), (1, dimension, 0, 0));
        assert!(found.decided && found.rank_is_exact);
        let found = find(dimension, &[[0.0; 3]; 2], &[[0, 1], [1, 0]], &[0]);
        assert_eq!((found.rank, found.mechanisms, found.self_stresses), (dimension, 0, dimension));
        assert!(found.self_stress.iter().all(|stress| stress.len() == 2 * dimension));
        // Free, both move as one point.
        let found = find(dimension, &[[0.0; 3]; 2], &[[0, 1]], &[]);
        assert_eq!((found.rank, found.mechanisms, found.rigid_motions), (dimension, dimension, dimension));
    }
    // A link of zero length in a row between supports: its ends move across together, and tension stiffens that.
    let row = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
    let (system, state) = framework(2, &row, &[[0, 1], [1, 2], [2, 3]], &[0, 3]);
    let found = mechanisms(&system, &state).unwrap();
    assert_eq!((found.rank, found.mechanisms, found.self_stresses, found.prestress_stable), (3, 1, 1, Some(true)));
    assert_eq!(found.movers, [[1, 2]]);
    assert!((found.self_stress[0][0] / found.self_stress[0][2] - 1.0).abs() < 1e-12);
    let geometry = SpringGeometry::at(&system, &state).unwrap();
    let sparse = Directions { system: &system, geometry: &geometry }.sparse().unwrap();
    assert_eq!((sparse.rank, sparse.decided), (3, true));
    assert!(sparse.bounds.above > 0.9 && sparse.bounds.below < 1e-14);
}

/// Two squares on supports, apart: two mechanisms, each of its own square.
#[test]
fn motions_are_local() {
    let places: Vec<[f64; 3]> =
        SQUARE.iter().chain(&SQUARE).enumerate().map(|(k, x)| [x[0] + 3.0 * (k / 4) as f64, x[1], 0.0]).collect();
    let bars: Vec<[usize; 2]> = (0..8).map(|k| SIDES[k % 4].map(|p| p + 4 * (k / 4))).collect();
    let mut found = find(2, &places, &bars, &[0, 1, 4, 5]);
    found.movers.sort();
    assert_eq!((found.mechanisms, found.movers), (2, vec![vec![2, 3], vec![6, 7]]));
}

/// The prism of three struts, its top turned by an angle against its bottom: at 30° a state of self-stress that makes it stiff, elsewhere none.
#[test]
fn a_tensegrity_prism_is_stiffened_by_prestress() {
    let prism = |degrees: f64| {
        let corner = |k: usize, turned: f64, height: f64| {
            let angle = (120.0 * k as f64 + turned) * PI / 180.0;
            [angle.cos(), angle.sin(), height]
        };
        let places: Vec<_> =
            (0..3).map(|k| corner(k, 0.0, 0.0)).chain((0..3).map(|k| corner(k, degrees, 1.0))).collect();
        let bars: Vec<_> = (0..3)
            .flat_map(|k| [[k, (k + 1) % 3], [3 + k, 3 + (k + 1) % 3], [k, 3 + k], [k, 3 + (k + 1) % 3]])
            .collect();
        find(3, &places, &bars, &[])
    };
    let found = prism(30.0);
    assert_eq!((found.rank, found.mechanisms, found.rigid_motions, found.self_stresses), (11, 7, 6, 1));
    assert_eq!((found.decided, found.prestress_stable), (true, Some(true)));
    // Eleven of twelve springs: nothing but rounded numbers says that the last singular value is zero.
    assert!(found.proven && !found.rank_is_exact && found.proven_gap[1] < 1e-13, "{:?}", found.proven_gap);
    let stress = &found.self_stress[0];
    // Horizontal cables 1, vertical ones 1.126, struts −2.175, as force densities times lengths.
    let ratio = |k: usize| stress[k] / stress[0];
    assert!((ratio(1) - 1.0).abs() < 1e-10 && ratio(2) > 0.0 && ratio(3) < 0.0, "{stress:?}");
    let found = prism(31.0);
    assert_eq!((found.rank, found.mechanisms, found.self_stresses, found.decided), (12, 6, 0, true));
    assert!(found.proven && found.rank_is_exact && found.proven_gap[1] == 0.0);
    // A nanometre off is neither one nor the other; a count of eigenvalues of BᵀB proves half of the digits.
    assert!(!prism(30.0 + 1e-9).decided);
    for (off, is_proven) in [(1e-3, true), (1e-4, true), (1e-6, false)] {
        let found = prism(30.0 + off);
        assert_eq!((found.rank, found.decided, found.proven, found.rank_is_exact), (12, true, is_proven, is_proven));
        assert!(found.proven_gap[0] <= 0.5 * found.gap[0] && (found.proven_gap[0] > 0.3 * found.gap[0]) == is_proven);
    }
}

/// A particle between two supports on a line moves across it against Σ T/l: the shorter spring decides, though the longer one has the larger tension.
#[test]
fn prestress_stiffens_by_tension_over_length() {
    let judged = |stiffness: f64, signs: [f64; 2]| {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        for x in [0.0, 3.0, 4.0] {
            builder.particle([x, 0.0, 0.0], 1.0);
        }
        // With 10 N, T of 1 N over 3 m and of ½ N over 1 m.
        for ([i, j], length, tension) in [([0, 1], 3.0, signs[0]), ([1, 2], 1.0, 0.5 * signs[1])] {
            builder.spring(i, j, Spring { stiffness, rest_length: length / (1.0 + 0.1 * tension), damping: 0.0 });
        }
        builder.hold(0).hold(2);
        let (system, state) = builder.build().unwrap();
        mechanisms(&system, &state).unwrap().prestress_stable
    };
    for stiffness in [10.0, 1e-9, 1e12] {
        let found = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0]].map(|signs| judged(stiffness, signs));
        assert_eq!(found, [Some(true), Some(false), Some(true)], "{stiffness}");
    }
}

/// Three squares in a row have three mechanisms, and as many springs as that take all of them away.
#[test]
fn added_springs_take_all_mechanisms_away() {
    let places: Vec<[f64; 3]> = (0..8).map(|p| [f64::from(p / 2), f64::from(p % 2), 0.0]).collect();
    let mut bars: Vec<[usize; 2]> = (0..4).map(|k| [2 * k, 2 * k + 1]).collect();
    bars.extend((0..6).map(|k| [k, k + 2]));
    let found = find(2, &places, &bars, &[]);
    assert_eq!((found.mechanisms, found.rigid_motions, found.added_springs.len()), (6, 3, 3));
    let found = find(2, &places, &[bars, found.added_springs].concat(), &[]);
    assert_eq!((found.mechanisms, found.rigid_motions), (3, 3));
}

/// Random frameworks: the sparse way finds the rank that the dense one finds, and motions that stretch nothing.
#[test]
fn large_and_small_scenes_are_judged_alike() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(29_2026);
    for trial in 0..60 {
        let (dimension, count) = (2 + trial % 2, 6 + trial % 9);
        let grid = trial % 3 == 0;
        let places: Vec<[f64; 3]> = (0..count)
            .map(|p| match grid {
                true => [(p % 3) as f64, (p / 3) as f64, 0.0],
                false => [0, 1, 2].map(|axis| if axis < dimension { rng.random_range(-1.0..1.0) } else { 0.0 }),
            })
            .collect();
        let share = rng.random_range(0.2..0.9);
        let bars: Vec<_> =
            (0..count).flat_map(|i| (0..i).map(move |j| [i, j])).filter(|_| rng.random_bool(share)).collect();
        let (system, state) = framework(dimension, &places, &bars, if trial % 4 == 0 { &[0] } else { &[] });
        let geometry = SpringGeometry::at(&system, &state).unwrap();
        let directions = Directions { system: &system, geometry: &geometry };
        let (dense, sparse) = (directions.dense().unwrap(), directions.sparse().unwrap());
        assert!(dense.decided, "{trial}");
        assert_eq!(dense.rank, sparse.rank, "{trial}");
        assert_eq!(sparse.motions.len(), dense.motions.len(), "{trial}");
        for motion in sparse.motions.iter().chain(&dense.motions) {
            assert!(directions.stretch(motion) < 1e-10, "{trial}: {}", directions.stretch(motion));
        }
        let found = mechanisms(&system, &state).unwrap();
        assert_eq!(found.motions.len(), found.mechanisms - found.rigid_motions, "{trial}");
        for motion in &found.motions {
            assert!(directions.stretch(motion) < 1e-8 * norm(motion), "{trial}");
        }
    }
}

/// Three joined points, one of them more or less aside of the line of the others: what is decided is the triangle or the line, and no more rigid
/// motions are counted than motions that stretch nothing.
#[test]
fn rigid_motions_are_among_the_mechanisms() {
    for exponent in -160..0 {
        let aside = 10f64.powf(f64::from(exponent) / 10.0);
        let places = [(0.0, 0.0), (0.43, aside), (1.17, 0.0)].map(|(x, y)| [x, y, 0.3 * x]);
        let found = find(3, &places, &[[0, 1], [1, 2], [0, 2]], &[]);
        let counts = (found.rank, found.mechanisms, found.rigid_motions);
        assert!(found.rigid_motions <= found.mechanisms, "{aside:e}: {counts:?}");
        // Between, a rotation about the line is told neither from none nor from rounding.
        let is_between = (1e-10..1e-6).contains(&aside);
        assert!(!found.decided || is_between || counts == (3, 6, 6) || counts == (2, 7, 5), "{aside:e}: {counts:?}");
    }
}
