//! The checks of the Jacobian pass on the right matrix and fail on planted faults, and say in words what is wrong.

use crate::faulty::Faulty;
use nalgebra::{Matrix3, Vector3};
use nalgebra_sparse::CscMatrix;
use sprung::integrate::StepMatrices;
use sprung::scene::{Kind, builtin};
use sprung::spring::Extension;
use sprung::verify::*;
use sprung::{Scene, Spring, Stiffness, SystemBuilder};

/// Five particles, one held, nothing equal, no rest length 1; some springs stretched, some compressed.
fn crooked() -> TestCase {
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
    TestCase { name: "crooked".into(), system, state, dt: 0.01, loaded: None }
}

fn ready(kind: Kind, size: usize) -> TestCase {
    let (system, state) = builtin(kind, size).unwrap().build().unwrap();
    TestCase { name: kind.name().into(), system, state, dt: 0.01, loaded: None }
}

fn matrices(TestCase { system, state, .. }: &TestCase, option: Stiffness) -> StepMatrices {
    StepMatrices::assemble(system, state, option, 0.01).unwrap()
}

fn stiffness(case: &TestCase, option: Stiffness) -> CscMatrix<f64> {
    matrices(case, option).k.to_csc()
}

fn block(spring: &Spring, at: &Extension) -> Matrix3<f64> {
    spring.stiffness_block(at, Stiffness::Full).matrix()
}

/// K with its entries changed by `fault(row, column, value)`.
fn faulty(fault: impl Fn(usize, usize, f64) -> f64) -> CscMatrix<f64> {
    let mut k = stiffness(&crooked(), Stiffness::Full);
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
    for case in Kind::ALL.map(|kind| ready(kind, kind.default_size())) {
        let k = stiffness(&case, Stiffness::Full);
        let mut checks = vec![stiffness_entries(&case, &k), stiffness_against_duals(&case, &k)];
        checks.push(force_against_energy(&case, &elastic(&case)));
        let blocks = spring_blocks(&case, block).into_iter();
        for check in checks.into_iter().map(Result::unwrap).chain(blocks) {
            report(&check);
            passes(&check);
        }
    }
}

#[test]
fn planted_faults_in_k_are_caught_and_named() {
    for compare in [stiffness_entries, stiffness_against_duals] {
        let check = |k: &CscMatrix<f64>| compare(&crooked(), k).unwrap();
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
        assert!(compare(&crooked(), &CscMatrix::zeros(11, 12)).is_err());
        assert!(compare(&crooked(), &CscMatrix::zeros(3, 3)).is_err());
    }
}

fn report(check: &Check) {
    println!("{:40} {:60} {:10.3e} {:10.3e}", check.scene, check.name, check.value, check.bound);
}

#[test]
fn the_v_curve_has_both_slopes_and_its_floor_in_every_regime() {
    for case in hard_states().unwrap() {
        let scene = &case.name;
        let k = matrices(&case, Stiffness::Full).k;
        let checks = v_curve(&case, &k).unwrap();
        let mut all = checks.clone();
        all.push(stiffness_entries(&case, &k.to_csc()).unwrap());
        all.push(stiffness_against_duals(&case, &k.to_csc()).unwrap());
        all.extend(spring_blocks(&case, block));
        for option in Stiffness::ALL {
            all.extend(dropped_terms(&case, option, &matrices(&case, option).k).unwrap());
        }
        for check in &all {
            report(check);
            passes(check);
        }
        let mut wrong = k.to_csc();
        wrong.values_mut().iter_mut().for_each(|value| *value *= 1.0 + 1e-6);
        assert!(!v_curve(&case, &Faulty(wrong.clone())).unwrap()[0].passed(), "{scene}");
        assert!(!stiffness_entries(&case, &wrong).unwrap().passed(), "{scene}");
        assert!(!stiffness_against_duals(&case, &wrong).unwrap().passed(), "{scene}");
        let has = |name: &str| checks.iter().any(|check| check.name.contains(name));
        assert!(has("slope of truncation"), "{scene}");
        // Where coordinates are large against a spring, their rounding leaves no room for ten halvings of h.
        let resolved = !["collapsed", "1e6 m from", "at 1e3 m"].iter().any(|words| scene.contains(words));
        assert_eq!(has("slope of rounding"), resolved, "{scene}");
    }
}

#[test]
fn the_v_curve_of_a_wrong_k_ends_on_a_plateau() {
    let curve = |k: CscMatrix<f64>| v_curve(&crooked(), &Faulty(k)).unwrap();
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
    assert!(v_curve(&crooked(), &Faulty(CscMatrix::zeros(2, 2))).is_err());
}

#[test]
fn a_term_dropped_from_the_wrong_springs_is_caught() {
    let case = crooked();
    let check = |option, of| dropped_terms(&case, option, &matrices(&case, of).k).unwrap();
    for option in Stiffness::ALL {
        for of in Stiffness::ALL {
            let checks = check(option, of);
            checks.iter().for_each(report);
            assert_eq!(checks.iter().all(Check::passed), option == of, "{option:?} {of:?}");
        }
        assert_eq!(check(option, option).len(), if option == Stiffness::Full { 2 } else { 3 });
    }
    // The term that option III drops from a stretched spring is named.
    let check = |k: CscMatrix<f64>| stiffness_against_duals(&case, &k).unwrap();
    let [full, axial] = [Stiffness::Full, Stiffness::Axial].map(|option| stiffness(&case, option));
    fails_with(&check(axial.clone()), "the transverse term missing");
    let part = |share: f64| {
        let mut k = full.clone();
        let pairs = k.values_mut().iter_mut().zip(axial.values());
        pairs.for_each(|(full, axial)| *full += share * (axial - *full));
        k
    };
    fails_with(&check(part(0.3)), "30 % of the transverse term missing");
    fails_with(&check(part(2.0)), "the transverse term with its sign flipped");
    fails_with(&check(part(-1.0)), "the transverse term 2.00 times too large");
    fails_with(&stiffness_entries(&case, &part(0.3)).unwrap(), "30 % of the transverse term missing");
}

#[test]
fn a_wrong_block_of_one_spring_is_caught_beside_stiff_ones() {
    type Block = fn(&Spring, &Extension) -> Matrix3<f64>;
    let faults: [(&str, Block); 5] = [
        ("k for k/l0", |s, at| block(s, at) * s.rest_length),
        ("sign", |s, at| -block(s, at)),
        ("1/l0 - 1/l turned round", |s, at| {
            let exact = s.stiffness_block(at, Stiffness::Full);
            sprung::spring::SpringBlock { transverse: -exact.transverse, ..exact }.matrix()
        }),
        ("32-bit k", |s, at| block(&Spring { stiffness: 7.0 * f64::from((s.stiffness / 7.0) as f32), ..*s }, at)),
        ("not a number", |_, _| Matrix3::repeat(f64::NAN)),
    ];
    for (name, fault) in faults {
        assert!(spring_blocks(&crooked(), fault).iter().all(|check| !check.passed()), "{name}");
    }
}

#[test]
fn coincident_ends_fail_with_the_spring_named() {
    let mut case = crooked();
    case.state.positions[3] = case.state.positions[1];
    let k = CscMatrix::zeros(12, 12);
    for check in [
        stiffness_entries(&case, &k),
        stiffness_against_duals(&case, &k),
        v_curve(&case, &Faulty(k)).map(|mut checks| checks.remove(0)),
    ] {
        assert!(check.is_err_and(|error| error.to_string().contains("spring 4")));
    }
    assert!(spring_blocks(&case, block).iter().all(|check| !check.passed()));
    let TestCase { system, state, .. } = &case;
    let mut f = vec![1.0; 12];
    elastic_force(system, state)(&reduce(system, &state.positions), &mut f);
    assert!(f.iter().all(|f| f.is_nan()));
}

/// All families of derivatives on one case.
fn derivatives(case: &TestCase) -> Vec<Check> {
    let families = FAMILIES.iter().filter(|f| ["jacobian", "dropped_terms", "derivatives"].contains(&f.name));
    families.flat_map(|family| family.check(case)).collect()
}

#[test]
fn a_hundred_thousand_particles_take_seconds() {
    let case = ready(Kind::Cloth, 316);
    let start = std::time::Instant::now();
    let k = stiffness(&case, Stiffness::Full);
    println!("assembled and expanded: {:?}", start.elapsed());
    let check = stiffness_entries(&case, &k).unwrap();
    println!("and compared: {:?}, {}", start.elapsed(), check.why);
    passes(&check);
    passes(&stiffness_against_duals(&case, &k).unwrap());
    println!("and with dual numbers: {:?}", start.elapsed());
    assert!(start.elapsed().as_secs() < 60);
}

#[test]
fn all_families_of_derivatives_pass_on_every_scene() {
    for case in everything() {
        let checks = derivatives(&case);
        assert!(checks.len() >= 12, "{}", case.name);
        checks.iter().for_each(passes);
    }
    let mut case = crooked();
    case.state.positions[3] = case.state.positions[1];
    let failed = derivatives(&case);
    let refuses = |check: &Check| (!check.passed() || !check.is_judged) && check.why.contains("spring 4");
    assert!(failed.iter().all(refuses), "{failed:#?}");
}

fn everything() -> Vec<TestCase> {
    let ready = Kind::ALL.map(|kind| ready(kind, kind.default_size()));
    let folders = ["src/verify/scenes", "verification/scenes"].map(|folder| std::fs::read_dir(folder).unwrap());
    let mut files: Vec<_> = folders.into_iter().flatten().map(|file| file.unwrap().path()).collect();
    files.sort();
    let files = files.into_iter().filter(|file| file.extension().is_some_and(|end| end == "toml")).map(|file| {
        let (system, state) = Scene::load(&file).unwrap().build().unwrap();
        TestCase::new(file.file_stem().unwrap().to_string_lossy(), system, state, Some(0.01)).unwrap()
    });
    hard_states().unwrap().into_iter().chain(files).chain(ready).chain([crooked()]).collect()
}

fn elastic(TestCase { system, state, .. }: &TestCase) -> Vec<f64> {
    let mut force = vec![0.0; system.dofs().len()];
    elastic_force(system, state)(&reduce(system, &state.positions), &mut force);
    force
}

#[test]
fn force_energy_and_damping_are_consistent_everywhere() {
    for case in everything() {
        let g = matrices(&case, Stiffness::Full).g;
        let force = elastic(&case);
        for check in [
            damping_entries(&case, &g.to_csc()),
            damping_dissipates(&case, &g),
            force_against_energy(&case, &force),
            energy_slope(&case, elastic_energy(&case.system, &case.state), &force),
        ]
        .map(Result::unwrap)
        {
            report(&check);
            passes(&check);
        }
    }
}

#[test]
fn faults_of_force_energy_and_damping_are_caught() {
    let case = crooked();
    let g = matrices(&case, Stiffness::Full).g.to_csc();
    let with = |fault: &dyn Fn(usize, usize, f64) -> f64| {
        let mut g = g.clone();
        g.triplet_iter_mut().for_each(|(row, column, value)| *value = fault(row, column, *value));
        damping_entries(&case, &g).unwrap()
    };
    passes(&with(&|_, _, g| g));
    fails_with(&with(&|_, _, g| -g), "sign flipped");
    fails_with(&with(&|_, _, g| 2.0 * g), "off by the factor 2.00");
    fails_with(&with(&|r, c, g| if r / 3 == c / 3 { g } else { 0.0 }), "missing");
    assert!(!with(&|r, c, g| if (r, c) == (3, 1) { 1.01 * g } else { g }).passed());
    assert!(!with(&|_, _, g| f64::from(g as f32)).passed());
    assert!(!with(&|_, _, _| f64::NAN).passed());
    assert!(damping_entries(&case, &CscMatrix::zeros(3, 3)).is_err());
    let mut negated = g.clone();
    negated.values_mut().iter_mut().for_each(|g| *g = -*g);
    assert!(!damping_dissipates(&case, &Faulty(negated)).unwrap().passed());
    assert!(damping_dissipates(&case, &Faulty(CscMatrix::zeros(1, 1))).is_err());

    let force = elastic(&case);
    let energy = || elastic_energy(&case.system, &case.state);
    let faults: [fn(usize, f64) -> f64; 4] =
        [|_, f| -f, |_, f| 2.0 * f, |row, f| if row == 4 { 1.0001 * f } else { f }, |_, _| f64::NAN];
    for fault in faults {
        let wrong: Vec<f64> = force.iter().enumerate().map(|(row, f)| fault(row, *f)).collect();
        assert!(!force_against_energy(&case, &wrong).unwrap().passed());
        assert!(!energy_slope(&case, energy(), &wrong).unwrap().passed());
    }
    let mut true_energy = energy();
    assert!(!energy_slope(&case, |x| 1.00001 * true_energy(x), &force).unwrap().passed());
    assert!(!energy_slope(&case, |_| f64::NAN, &force).unwrap().passed());
    assert!(force_against_energy(&case, &force[1..]).is_err());
    assert!(energy_slope(&case, |_| 0.0, &[]).is_err());
}
