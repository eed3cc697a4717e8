//! The checks of the Jacobian pass on the right matrix and fail on planted faults, and say in words what is wrong.

use nalgebra::{Matrix3, Vector3};
use nalgebra_sparse::CscMatrix;
use sprung::integrate::StepMatrices;
use sprung::operator::LinearOperator;
use sprung::scene::{Kind, builtin};
use sprung::spring::Extension;
use sprung::verify::*;
use sprung::{Spring, State, Stiffness, System, SystemBuilder};

/// Five particles, one held, nothing equal, no rest length 1; some springs stretched, some compressed.
fn crooked() -> (System, State) {
    let mut b = SystemBuilder::new();
    b.particle([0.0, 0.0, 0.0], 1.3);
    b.particle([1.1, 0.2, -0.1], 0.7);
    b.particle([0.3, 0.9, 0.4], 2.1);
    b.particle([0.5, 0.4, 1.2], 0.4);
    b.particle([1.4, 1.3, 0.8], 0.9);
    let links = [(0, 1, 90.0, 0.9), (0, 2, 130.0, 1.3), (1, 2, 55.0, 1.0), (0, 3, 200.0, 1.6), (3, 1, 75.0, 1.2)];
    for (i, j, stiffness, rest_length) in links.into_iter().chain([(2, 3, 310.0, 0.6), (4, 2, 40.0, 1.9)]) {
        b.spring(i, j, Spring { stiffness, rest_length, damping: 0.5 + 0.01 * stiffness });
    }
    b.hold(0);
    let (system, mut state) = b.build().unwrap();
    for (p, v) in state.velocities.iter_mut().enumerate().skip(1) {
        *v = Vector3::new(0.3 * p as f64, -0.2, 0.1 * p as f64 * p as f64);
    }
    (system, state)
}

fn stiffness(system: &System, state: &State, option: Stiffness) -> CscMatrix<f64> {
    StepMatrices::assemble(system, state, option, 0.01).unwrap().k.to_csc()
}

fn entries(k: &CscMatrix<f64>) -> Check {
    let (system, state) = crooked();
    stiffness_entries(&system, &state, elastic_force(&system, &state), k, "crooked")
}

fn duals(k: &CscMatrix<f64>) -> Check {
    let (system, state) = crooked();
    stiffness_against_duals(&system, &state, k, "crooked")
}

fn block(spring: &Spring, at: &Extension) -> Matrix3<f64> {
    spring.stiffness_block(at, Stiffness::Full).matrix()
}

/// K with its entries changed by `fault(row, column, value)`.
fn faulty(fault: impl Fn(usize, usize, f64) -> f64) -> CscMatrix<f64> {
    let (system, state) = crooked();
    let mut k = stiffness(&system, &state, Stiffness::Full);
    for (row, column, value) in k.triplet_iter_mut() {
        *value = fault(row, column, *value);
    }
    k
}

#[track_caller]
fn fails_with(check: &Check, words: &str) {
    assert!(!check.passed(), "{check:#?}");
    assert!(check.table.iter().any(|entry| entry.verdict.contains(words)), "{words}: {:#?}", check.table);
}

#[track_caller]
fn passes(check: &Check) {
    assert!(check.passed(), "{check:#?}");
}

#[test]
fn the_right_k_passes_on_every_ready_scene() {
    for kind in Kind::ALL {
        let (system, state) = builtin(kind, kind.default_size()).unwrap().build().unwrap();
        let k = stiffness(&system, &state, Stiffness::Full);
        let scene = kind.name();
        let check = stiffness_entries(&system, &state, elastic_force(&system, &state), &k, scene);
        println!("{scene}: differences {:.3}", check.value);
        passes(&check);
        let check = stiffness_against_duals(&system, &state, &k, scene);
        println!("{scene}: duals {:.3}", check.value);
        passes(&check);
        let check = spring_blocks(&system, &state, block, scene);
        println!("{scene}: spring blocks {:.3}", check.value);
        passes(&check);
        for check in blocks_against_duals(&system, &state, block, scene) {
            println!("{scene}: block duals {:.3}", check.value);
            passes(&check);
        }
        let mut force = vec![0.0; system.dofs().len()];
        elastic_force(&system, &state)(&reduce(&system, &state.positions), &mut force);
        let check = force_against_energy(&system, &state, &force, scene);
        println!("{scene}: force {:.3}", check.value);
        passes(&check);
    }
}

#[test]
fn planted_faults_in_k_are_caught_and_named() {
    for check in [entries, duals] {
        passes(&check(&faulty(|_, _, value| value)));
        fails_with(&check(&faulty(|_, _, value| -value)), "sign flipped");
        fails_with(&check(&faulty(|_, _, value| 2.0 * value)), "off by the factor 2.00");
        fails_with(
            &check(&faulty(|r, c, value| if (r, c) == (1, 5) { 1.01 * value } else { value })),
            "1.0 % too large",
        );
        fails_with(&check(&faulty(|r, c, value| if r / 3 == 1 && c / 3 == 0 { 0.0 } else { value })), "missing");
        fails_with(&check(&faulty(|r, c, value| if (r, c) == (4, 4) { f64::NAN } else { value })), "not finite");
        assert!(!check(&faulty(|_, _, value| value as f32 as f64)).passed());
        assert!(!check(&CscMatrix::zeros(11, 12)).passed());
        assert!(!check(&CscMatrix::zeros(3, 3)).passed());
    }
}

/// K with a fault as an operator.
struct Faulty(CscMatrix<f64>);

impl LinearOperator for Faulty {
    fn order(&self) -> usize {
        self.0.nrows()
    }

    fn apply(&self, w: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for (row, column, value) in self.0.triplet_iter() {
            y[row] += value * w[column];
        }
    }
}

fn report(check: &Check) {
    println!("{:40} {:60} {:10.3e} {:10.3e}", check.scene, check.name, check.value, check.bound);
}

#[test]
fn the_v_curve_has_both_slopes_and_its_floor_in_every_regime() {
    for (scene, system, state) in hard_states().unwrap() {
        let k = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.01).unwrap().k;
        let checks = v_curve(&system, &state, elastic_force(&system, &state), &k, scene);
        for check in &checks {
            report(check);
            passes(check);
        }
        let mut all = vec![
            stiffness_entries(&system, &state, elastic_force(&system, &state), &k.to_csc(), scene),
            stiffness_against_duals(&system, &state, &k.to_csc(), scene),
            spring_blocks(&system, &state, block, scene),
        ];
        all.extend(blocks_against_duals(&system, &state, block, scene));
        for option in Stiffness::ALL {
            let k = StepMatrices::assemble(&system, &state, option, 0.01).unwrap().k;
            all.extend(dropped_terms(&system, &state, elastic_force(&system, &state), option, &k, scene));
        }
        for check in &all {
            report(check);
            passes(check);
        }
        let has = |name: &str| checks.iter().any(|check| check.name.contains(name));
        assert!(has("slope of truncation"), "{scene}");
        // Where coordinates are large against a spring, their rounding leaves no room for ten halvings of h.
        let resolved = !["collapsed", "1e6 m from", "at 1e3 m"].iter().any(|words| scene.contains(words));
        assert_eq!(has("slope of rounding"), resolved, "{scene}");
    }
}

#[test]
fn the_v_curve_of_a_wrong_k_ends_on_a_plateau() {
    let (system, state) = crooked();
    let curve = |k: CscMatrix<f64>| v_curve(&system, &state, elastic_force(&system, &state), &Faulty(k), "crooked");
    assert!(curve(faulty(|_, _, value| value)).iter().all(Check::passed));
    let floor_of = |k| curve(k).into_iter().next().unwrap();
    for (fault, size) in [
        (faulty(|_, _, value| value * (1.0 + 1e-6)), 1e-6),
        (faulty(|_, _, value| f64::from(value as f32)), 1e-8),
        (faulty(|_, _, value| -value), 1.0),
        (faulty(|r, c, value| if r == c { value } else { 0.0 }), 1.0),
    ] {
        let check = floor_of(fault);
        assert!(!check.passed() && check.value > 0.1 * size && check.value < 10.0 * size, "{check:?}");
    }
    assert!(!floor_of(faulty(|_, _, _| f64::NAN)).passed());
    assert!(!floor_of(CscMatrix::zeros(2, 2)).passed());
}
