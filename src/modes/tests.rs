use super::*;
use crate::spring::Spring;
use crate::system::{Loads, SystemBuilder};
use nalgebra::SymmetricEigen;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use std::f64::consts::PI;

fn spring(stiffness: f64, rest_length: f64) -> Spring {
    Spring { stiffness, rest_length, damping: 0.0 }
}

/// A straight row of particles of one mass between held ends.
fn row(places: impl IntoIterator<Item = f64>, mass: f64, spring: Spring) -> (System, State) {
    let mut builder = SystemBuilder::new();
    for x in places {
        builder.particle([x, 0.0, 0.0], mass);
    }
    let last = builder.positions.len() - 1;
    for p in 0..last {
        builder.spring(p, p + 1, spring);
    }
    builder.hold(0).hold(last);
    builder.build().unwrap()
}

fn values(found: &Modes) -> Vec<f64> {
    found.modes.iter().map(|mode| mode.eigenvalue).collect()
}

fn assert_close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
    let scale = expected.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() <= 1e-12 * scale + 1e-10 * b.abs(), "{found:?} {expected:?}");
    }
}

/// ω² of the dense generalised problem, ascending.
fn dense(system: &System, state: &State) -> Vec<f64> {
    let mut matrices = Matrices::new(system).unwrap();
    matrices.update(state, Stiffness::Full).unwrap();
    let k = DMatrix::from(&matrices.k().to_csc());
    let root: Vec<f64> = matrices.masses().iter().map(|mass| mass.sqrt()).collect();
    let scaled = DMatrix::from_fn(k.nrows(), k.ncols(), |i, j| -k[(i, j)] / (root[i] * root[j]));
    let mut values: Vec<f64> = SymmetricEigen::new(scaled).eigenvalues.iter().copied().collect();
    values.sort_by(f64::total_cmp);
    values
}

/// A particle on a taut string swings alike along two axes. One of the two modes lies at the edge of what is counted, and its interval reaches down
/// to there: below it is no eigenvalue.
#[test]
fn half_of_a_double_mode_is_known_to_the_edge_of_the_count() {
    let (system, state) = row([0.0, 1.0, 2.0], 1.0, spring(10.0, 0.9));
    let found = modes(&system, &state, 1).unwrap();
    // 2 T/(m l) with T = 10 · 0.1/0.9.
    assert_close(&values(&found), &[20.0 / 9.0]);
    assert!(found.proven && found.modes[0].error_bound >= found.modes[0].eigenvalue - found.counted_below, "{found:?}");
}

/// A taut chain of N masses between two walls, held to its line: `ω_k = 2 √(κ/m) sin(kπ / 2(N+1))`. Along it with κ = k/l0, across with the tension
/// over the length.
#[test]
fn a_taut_chain_has_the_modes_of_the_textbook() {
    let count = 30;
    let (system, state) = row((0..count + 2).map(|p| 1.5 * p as f64), 0.5, spring(20.0, 1.0));
    let (along, across) = (20.0, 20.0 * (1.5 - 1.0) / 1.5);
    let omega = |kappa: f64, k: usize| 4.0 * kappa / 0.5 * (k as f64 * PI / (2.0 * (count + 1) as f64)).sin().powi(2);
    let mut expected: Vec<f64> =
        (1..=count).flat_map(|k| [omega(along, k), omega(across, k), omega(across, k)]).collect();
    expected.sort_by(f64::total_cmp);
    for wanted in [1, 2, 5, 17, 90] {
        let found = modes(&system, &state, wanted).unwrap();
        assert_close(&values(&found), &expected[..wanted]);
        assert!(found.complete && found.zero_modes.is_empty() && found.imbalance < 1e-14);
    }
}

/// Random scenes of several equal copies, so that eigenvalues are three-fold and more, free, tied or under compression: the same as a dense solver's,
/// each as often.
#[test]
fn no_mode_is_missed_and_none_is_invented() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7_2026);
    for trial in 0..40 {
        let [copies, particles] = [[1, 2, 3, 4][trial % 4], 4 + trial % 5];
        let place: Vec<[f64; 3]> = (0..particles).map(|_| [0; 3].map(|_| rng.random_range(0.0..2.0))).collect();
        let stretch = [1.0, 1.2, 0.8][trial % 3];
        let mut builder = SystemBuilder::new();
        for copy in 0..copies {
            for x in &place {
                builder.particle([x[0] + 10.0 * copy as f64, x[1], x[2]], 1.0);
            }
            for i in 0..particles {
                for j in 0..i {
                    if (i + j) % 3 != 0 || i == j + 1 {
                        let length = (0..3).map(|axis| (place[i][axis] - place[j][axis]).powi(2)).sum::<f64>().sqrt();
                        builder.spring(copy * particles + i, copy * particles + j, spring(length, length / stretch));
                    }
                }
            }
            if trial % 5 == 0 {
                builder.hold(copy * particles);
            }
        }
        let (system, state) = builder.build().unwrap();
        let reference = dense(&system, &state);
        let scale = reference.last().unwrap().abs();
        let count = 1 + trial % 11;
        let found = modes(&system, &state, count).unwrap();
        assert!(found.complete, "{trial}");
        let mut all: Vec<f64> = found.zero_modes.iter().chain(&found.modes).map(|mode| mode.eigenvalue).collect();
        all.sort_by(f64::total_cmp);
        for (a, b) in all.iter().zip(&reference) {
            assert!((a - b).abs() <= 1e-11 * scale, "{trial}: {all:?} {reference:?}");
        }
        let zeros = reference.iter().filter(|value| value.abs() < 1e-11 * scale).count();
        assert!(found.modes.len() == count.min(reference.len() - zeros), "{trial}");
        let below = reference.iter().filter(|value| **value < found.counted_below).count();
        assert_eq!(below, all.iter().filter(|value| **value < found.counted_below).count(), "{trial}");
        for (k, a) in found.modes.iter().chain(&found.zero_modes).enumerate() {
            for (l, b) in found.modes.iter().chain(&found.zero_modes).enumerate() {
                let product: f64 = a.vector.iter().zip(&b.vector).map(|(a, b)| a * b).sum();
                assert!((product - f64::from(u8::from(k == l))).abs() < 1e-7, "{trial}: {k} {l} {product}");
            }
        }
    }
}

/// A mass on a damped spring: ζ = b/(2 √(κ m)), effective mass m along the spring, and the response of the textbook.
#[test]
fn damping_response_and_effective_mass_of_one_mass() {
    let (kappa, mass, b) = (50.0, 2.0, 3.0);
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.particle([0.0, 0.0, 0.0], 1.0);
    builder.particle([1.0, 0.0, 0.0], mass);
    builder.spring(0, 1, Spring { damping: b, ..spring(kappa, 1.0) });
    builder.hold(0);
    let (system, state) = builder.build().unwrap();
    let found = modes(&system, &state, 1).unwrap();
    let mode = &found.modes[0];
    assert!((mode.damping_ratio.unwrap() - b / (2.0 * (kappa * mass).sqrt())).abs() < 1e-14);
    assert!((mode.frequency().unwrap() - (kappa / mass).sqrt() / TAU).abs() < 1e-14);
    assert!((mode.effective_mass[0] - mass).abs() < 1e-14 && mode.effective_mass[1..] == [0.0; 2]);
    let frequencies = [0.0, 0.5, 0.8, 3.0];
    for (x, f) in found.harmonic_response(&[4.0], &frequencies).unwrap().iter().zip(frequencies) {
        let w = TAU * f;
        let denominator = c64::new(kappa - mass * w * w, w * b);
        assert!((x[0] * denominator - c64::new(4.0, 0.0)).norm() < 1e-12);
    }
    let space = found.state_space(&[0], &[0]).unwrap();
    // At rest C A⁻¹ B = −1/κ.
    let gain = (&space.c * space.a.clone().try_inverse().unwrap() * &space.b)[(0, 0)];
    assert!((gain + 1.0 / kappa).abs() < 1e-15);
    assert!(found.state_space(&[1], &[0]).is_err() && found.harmonic_response(&[1.0, 2.0], &[1.0]).is_err());
}

/// Pressed together a chain buckles: the mode is a growth, and the state, which a load balances not, is said to be out of balance.
#[test]
fn growth_and_imbalance_are_told() {
    let (system, state) = row([0.0, 0.8, 1.6], 1.0, spring(10.0, 1.0));
    let found = modes(&system, &state, 2).unwrap();
    // 2 T/l across, with T = −2 and l = 0.8.
    assert_close(&values(&found), &[-5.0, -5.0]);
    assert_eq!((found.modes[0].frequency(), found.modes[0].damping_ratio, found.imbalance), (None, None, 0.0));
    assert!((found.modes[0].growth_rate().unwrap() - 5f64.sqrt()).abs() < 1e-12);
    let forces = vec![Vector3::zeros(), Vector3::new(0.0, 1.0, 0.0), Vector3::zeros()];
    let loaded = system.with_loads(Loads { forces, ..Loads::default() }).unwrap();
    assert!((modes(&loaded, &state, 1).unwrap().imbalance - 0.5).abs() < 1e-15);
    assert!(modes(&loaded, &state, 0).is_err());
}

/// A pressed chain, of which all bends grow, beside a bent double pendulum of bars at rest, which turns about its hook and in its joint: there are
/// two zero modes, however many modes are asked for.
#[test]
fn zero_modes_above_growing_modes_are_counted() {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for p in 0..9 {
        builder.particle([0.8 * p as f64, 0.0, 0.0], 1.0);
    }
    for x in [[0.0, 5.0, 0.0], [1.0, 5.0, 0.0], [1.0, 6.0, 0.0]] {
        builder.particle(x, 2.0);
    }
    (0..8).chain([9, 10]).for_each(|p| {
        builder.spring(p, p + 1, spring(10.0, 1.0));
    });
    builder.hold(0).hold(8).hold(9);
    let (system, state) = builder.build().unwrap();
    for count in 1..=18 {
        let found = modes(&system, &state, count).unwrap();
        let growing = found.modes.iter().filter(|mode| mode.eigenvalue < 0.0).count();
        assert_eq!((growing, found.modes.len()), (count.min(7), count.min(16)));
        assert_eq!((found.zero_count, found.rigid_motions, found.complete), (Some(2), 1, true), "{count}");
        assert_eq!(found.zero_modes.len(), if count > 7 { 2 } else { 0 }, "{count}");
        assert_eq!(found.hanging, [vec![10, 11]], "{count}");
    }
}

/// Multigrid finds what factorizations find, on a held net under tension and on a free one.
#[test]
fn modes_without_a_factorization_are_the_same() {
    for is_held in [true, false] {
        let size = 12;
        let mut builder = SystemBuilder::new();
        for i in 0..size {
            for j in 0..size {
                builder.particle([1.1 * i as f64, 1.1 * j as f64, 0.0], 0.5 + 0.01 * (i * j) as f64);
            }
        }
        for i in 0..size {
            for j in 0..size {
                for (a, b) in [(1, 0), (0, 1), (1, 1)] {
                    if i + a < size && j + b < size {
                        let length = f64::hypot(a as f64, b as f64) * if is_held { 1.0 } else { 1.1 };
                        builder.spring(i * size + j, (i + a) * size + j + b, spring(100.0, length));
                    }
                }
            }
        }
        let edge = (0..size * size).filter(|p| is_held && (p % size == 0 || p % size == size - 1));
        builder.constrain(crate::system::Constraint::hold(edge));
        let (system, state) = SystemBuilder { dimension: 2 + usize::from(is_held), ..builder }.build().unwrap();
        let found = modes(&system, &state, 6).unwrap();
        let mut matrices = Matrices::new(&system).unwrap();
        matrices.update(&state, Stiffness::Full).unwrap();
        let a = matrices.k().scaled(-1.0);
        let rigid = rigid_motions(&system, &state.positions).into_iter();
        let rigid: Vec<_> = rigid.map(|vector| Eigenpair { value: 0.0, vector, residual: 0.0 }).collect();
        let rigid = if is_held { &[] } else { &rigid[..] };
        let wanted = 6 + rigid.len();
        let pairs = uncounted(&system, &state, &a, matrices.masses(), rigid, wanted, &mut Work::default()).unwrap();
        assert_eq!((rigid.len(), pairs.len()), (found.zero_modes.len(), wanted));
        let values: Vec<f64> = found.modes.iter().map(|mode| mode.eigenvalue).collect();
        for (pair, value) in pairs[rigid.len()..].iter().zip(values) {
            assert!((pair.value - value).abs() < 1e-8 * value, "{} {value}", pair.value);
        }
    }
}

/// Far from the origin, coordinates are rounded so coarsely that springs at rest are strained by 1e-13: the motions of a chain that bends freely are
/// zero modes there as well, whatever the masses.
#[test]
fn zero_modes_far_from_the_origin_are_zero_modes() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3_2026);
    for trial in 0..20 {
        let place: Vec<[f64; 3]> =
            (0..6).map(|p| [f64::from(p) + rng.random_range(0.0..0.7), rng.random_range(0.0..0.7), 0.0]).collect();
        let mut builder = SystemBuilder::new();
        for x in &place {
            builder.particle([x[0], x[1], x[2] + 1000.7], [1.0, 1e-6, 1e6][trial % 3]);
        }
        for p in 1..6 {
            let length = (0..3).map(|axis| (place[p][axis] - place[p - 1][axis]).powi(2)).sum::<f64>().sqrt();
            builder.spring(p - 1, p, spring(rng.random_range(10.0..1000.0), length));
        }
        let (system, mut state) = builder.build().unwrap();
        // Positions that are rounded, and rest lengths that are not.
        state.positions.iter_mut().for_each(|x| x.x = (x.x + 1000.3) - 0.1);
        let found = modes(&system, &state, 5).unwrap();
        assert_eq!((found.zero_modes.len(), found.rigid_motions, found.modes.len()), (13, 6, 5), "{trial}");
        assert!(found.complete && found.gap[1] > 1e-3 * found.modes[4].eigenvalue, "{trial}: {:?}", found.gap);
    }
}
