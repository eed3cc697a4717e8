//! The public checker names what is wrong with a caller's Jacobian, of any force and in any matrix type.

use nalgebra::DMatrix;
use nalgebra_sparse::{CooMatrix, CscMatrix};
use sprung::integrate::StepMatrices;
use sprung::verify::*;
use sprung::{Spring, State, Stiffness, System, SystemBuilder};

/// Four free particles and a held one.
fn net() -> (System, State) {
    let mut b = SystemBuilder::new();
    for x in [[0.0, 0.0, 0.0], [1.1, 0.2, -0.1], [0.3, 0.9, 0.4], [0.5, 0.4, 1.2], [1.4, 1.3, 0.8]] {
        b.particle(x, 1.0);
    }
    let links = [
        (0, 1, 90.0, 0.9),
        (0, 2, 130.0, 1.3),
        (1, 2, 55.0, 1.7),
        (3, 1, 75.0, 1.2),
        (2, 3, 310.0, 0.6),
        (4, 2, 40.0, 0.8),
    ];
    for (i, j, stiffness, rest_length) in links {
        b.spring(i, j, Spring { stiffness, rest_length, damping: 0.0 });
    }
    b.hold(0);
    b.build().unwrap()
}

fn k(system: &System, state: &State) -> CscMatrix<f64> {
    StepMatrices::assemble(system, state, Stiffness::Full, 0.01).unwrap().k.to_csc()
}

fn report(fault: impl Fn(usize, usize, f64) -> f64) -> JacobianReport {
    let (system, state) = net();
    let mut matrix = k(&system, &state);
    matrix.triplet_iter_mut().for_each(|(row, column, value)| *value = fault(row, column, *value));
    let options = JacobianOptions { springs: Some((&system, &state)), ..JacobianOptions::default() };
    let x = reduce(&system, &state.positions);
    let report = check_jacobian(elastic_force(&system, &state), matrix, &x, &options).unwrap();
    println!("{report}\n");
    assert_eq!(report.passed(), report.to_check("net").passed());
    report
}

#[test]
fn the_right_matrix_passes_in_every_type_and_grouping() {
    let right = report(|_, _, value| value);
    assert!(right.passed() && right.wrong == 0 && right.compared == 144, "{right}");
    assert!(right.to_string().contains("all 144 entries agree"));
    let (system, state) = net();
    let x = reduce(&system, &state.positions);
    let csc = k(&system, &state);
    let assembled = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.01).unwrap().k;
    let groups = [None, Some(ColumnGroups::of_system(&system)), Some(ColumnGroups::of_matrix(&csc))];
    for groups in groups {
        let options = JacobianOptions { groups, ..JacobianOptions::default() };
        let force = || elastic_force(&system, &state);
        assert!(check_jacobian(force(), csc.clone(), &x, &options).unwrap().passed());
        assert!(check_jacobian(force(), &DMatrix::from(&csc), &x, &options).unwrap().passed());
        assert!(check_jacobian(force(), &CooMatrix::from(&csc), &x, &options).unwrap().passed());
        assert!(check_jacobian(force(), &assembled, &x, &options).unwrap().passed());
    }
}

#[test]
fn a_flipped_sign_is_named() {
    // The block between particles 2 and 3, spring 4, rows 3..6 and columns 6..9.
    let report = report(|r, c, value| if r / 3 == 1 && c / 3 == 2 { -value } else { value });
    assert_eq!(report.wrong, 9);
    assert!(report.worst.iter().take(9).all(|entry| {
        entry.verdict == "sign flipped"
            && entry.spring == Some(4)
            && entry.row / 3 == 1
            && entry.column.unwrap() / 3 == 2
    }));
}

#[test]
fn a_partly_missing_transverse_term_is_named() {
    let (_, state) = net();
    let n = (state.positions[2] - state.positions[3]).normalize();
    let l = (state.positions[2] - state.positions[3]).norm();
    let transverse = 310.0 * (1.0 / 0.6 - 1.0 / l);
    let across = |r: usize, c: usize| f64::from(r % 3 == c % 3) - n[r % 3] * n[c % 3];
    let report = report(|r, c, value| match (r / 3, c / 3) {
        (1, 2) | (2, 1) => value - 0.3 * transverse * across(r, c),
        _ => value,
    });
    assert_eq!(report.wrong, 18);
    assert!(
        report
            .worst
            .iter()
            .all(|entry| entry.verdict == "30 % of the transverse term missing" && entry.spring == Some(4))
    );
}

#[test]
fn the_stiffness_in_place_of_the_stiffness_over_the_rest_length_is_named() {
    // Spring 5 joins particle 4 to particle 2 alone: its block stands alone off the diagonal and at particle 4.
    let report = report(|r, c, value| if r / 3 == 3 || c / 3 == 3 { 0.8 * value } else { value });
    assert!(report.worst[0].verdict.contains("k in place of k/l0"), "{report}");
    assert_eq!(report.worst[0].spring, Some(5));
}

#[test]
fn missing_extra_and_scaled_entries_are_named() {
    let missing = report(|r, c, value| if (r, c) == (0, 4) { 0.0 } else { value });
    assert_eq!((missing.wrong, missing.worst[0].row, missing.worst[0].column), (1, 0, Some(4)));
    assert_eq!(missing.worst[0].verdict, "missing");
    let scaled = report(|_, _, value| 2.0 * value);
    assert_eq!(scaled.overall.as_deref(), Some("off by the factor 2.00"));
    let flipped = report(|_, _, value| -value);
    assert_eq!(flipped.overall.as_deref(), Some("sign flipped"));
    let percent = report(|r, c, value| if (r, c) == (7, 7) { 1.01 * value } else { value });
    assert_eq!((percent.wrong, percent.worst[0].verdict.as_str()), (1, "1.0 % too large"));
    let slightly = report(|r, c, value| if (r, c) == (7, 7) { 1.000001 * value } else { value });
    assert_eq!(slightly.wrong, 1);
    let nan = report(|r, c, value| if (r, c) == (7, 7) { f64::NAN } else { value });
    assert_eq!((nan.wrong, nan.worst[0].verdict.as_str()), (1, "not finite"));
    assert!(nan.value.is_nan() && !nan.passed());
    let dense = |value: f64| {
        let (system, state) = net();
        let mut dense = DMatrix::from(&k(&system, &state));
        dense[(0, 9)] = value;
        let x = reduce(&system, &state.positions);
        check_jacobian(elastic_force(&system, &state), &dense, &x, &JacobianOptions::default()).unwrap()
    };
    assert_eq!(dense(3.0).worst[0].verdict, "extra");
    assert!(dense(0.0).passed());
}

/// A force that is not a gradient, with a full Jacobian that is not symmetric.
fn swirl(x: &[f64], f: &mut [f64]) {
    f[0] = x[0] * x[1] + x[2].sin();
    f[1] = x[2] * x[2] - 3.0 * x[0];
    f[2] = (0.1 * x[1]).exp() + x[0] / x[2];
}

fn swirl_jacobian(x: &[f64]) -> DMatrix<f64> {
    let rows = [
        [x[1], x[0], x[2].cos()],
        [-3.0, 0.0, 2.0 * x[2]],
        [1.0 / x[2], 0.1 * (0.1 * x[1]).exp(), -x[0] / (x[2] * x[2])],
    ];
    DMatrix::from_fn(3, 3, |r, c| rows[r][c])
}

#[test]
fn any_force_will_do_and_a_transposed_matrix_is_named() {
    let x = [1.3, -0.7, 0.9];
    let matrix = swirl_jacobian(&x);
    for length in [None, Some(1e-3), Some(1e2)] {
        let options = JacobianOptions { length, ..JacobianOptions::default() };
        let right = check_jacobian(swirl, &matrix, &x, &options).unwrap();
        assert!(right.passed(), "{right}");
        let transposed = check_jacobian(swirl, &matrix.transpose(), &x, &options).unwrap();
        assert_eq!(transposed.overall.as_deref(), Some("transposed"), "{transposed}");
        assert!(transposed.worst.iter().any(|entry| entry.verdict == "transposed"));
    }
    // Grouped by the pattern of a matrix that lacks an entry: the row shows it.
    let mut lacking = matrix.clone();
    lacking[(0, 2)] = 0.0;
    let groups = Some(ColumnGroups::of_matrix(&CscMatrix::from(&lacking)));
    let report = check_jacobian(swirl, &lacking, &x, &JacobianOptions { groups, ..Default::default() }).unwrap();
    assert_eq!((report.wrong, report.worst[0].verdict.as_str()), (1, "missing"), "{report}");
}

#[test]
fn forces_that_are_not_finite_are_wrong_entries() {
    let report = |force: fn(&[f64], &mut [f64])| {
        check_jacobian(force, &DMatrix::identity(2, 2), &[1.0, 2.0], &JacobianOptions::default()).unwrap()
    };
    assert!(report(|x, f| f.copy_from_slice(x)).passed());
    let nan = report(|x, f| (f[0], f[1]) = (x[0], f64::NAN));
    assert!(!nan.passed() && nan.wrong == 2 && nan.worst[0].verdict == "not finite", "{nan}");
    assert!(!report(|_, f| f.fill(f64::INFINITY)).passed());
    // A force that is constant to rounding cannot vouch for any derivative.
    let constant = report(|x, f| (f[0], f[1]) = (x[0], 1e20 + x[1]));
    assert_eq!((constant.wrong, constant.worst[0].verdict.as_str()), (1, "cannot be measured"), "{constant}");
}

#[test]
fn unusable_input_is_an_error_with_key_and_value() {
    let identity = |n| DMatrix::<f64>::identity(n, n);
    let message = |matrix: DMatrix<f64>, x: &[f64], options: &JacobianOptions| {
        check_jacobian(|x, f| f.copy_from_slice(x), &matrix, x, options).unwrap_err().to_string()
    };
    let usual = JacobianOptions::default();
    assert_eq!(message(identity(0), &[], &usual), "point = []: must have at least one coordinate");
    assert_eq!(message(identity(3), &[1.0, 2.0], &usual), "matrix = 3 × 3: must be 2 × 2 for a point of 2 coordinates");
    assert!(message(DMatrix::zeros(2, 3), &[1.0, 2.0], &usual).contains("2 × 3"));
    assert!(message(identity(2), &[1.0, f64::NAN], &usual).starts_with("point[1] = NaN"));
    let length = |length| JacobianOptions { length: Some(length), ..JacobianOptions::default() };
    for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(message(identity(1), &[1.0], &length(wrong)).starts_with("options.length"));
        let options = JacobianOptions { tolerance: wrong, ..JacobianOptions::default() };
        assert!(message(identity(1), &[1.0], &options).starts_with("options.tolerance"));
    }
    let groups = JacobianOptions { groups: Some(ColumnGroups::one_by_one(3)), ..JacobianOptions::default() };
    assert!(message(identity(2), &[1.0, 2.0], &groups).starts_with("options.groups"));
    let (system, state) = net();
    let springs = JacobianOptions { springs: Some((&system, &state)), ..JacobianOptions::default() };
    assert!(message(identity(2), &[1.0, 2.0], &springs).starts_with("options.springs"));
}
