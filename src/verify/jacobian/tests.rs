//! What is said of matrices and entries that are written down, and what is refused.

use super::*;
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, SystemBuilder};
use nalgebra::{DMatrix, Vector3};

fn sparse(rows: usize, entries: &[f64]) -> CscMatrix<f64> {
    CscMatrix::from(&DMatrix::from_row_slice(rows, entries.len() / rows, entries))
}

#[test]
fn one_fault_of_the_whole_matrix_is_named() {
    let numeric = [1e3, 2e3, 3e3, 5e3];
    let said = |analytic: [f64; 4]| overall(&sparse(2, &analytic), &sparse(2, &numeric));
    let times = |factor: f64| said(numeric.map(|entry| factor * entry));
    assert_eq!(said([1e3, 3e3, 2e3, 5e3]).as_deref(), Some("transposed"));
    assert_eq!(said([0.0; 4]).as_deref(), Some("missing"));
    assert_eq!(times(2.0).as_deref(), Some("off by the factor 2.00"));
    assert_eq!(times(0.5).as_deref(), Some("off by the factor 0.50"));
    assert_eq!(times(-3.0).as_deref(), Some("off by the factor -3.00"));
    assert_eq!([times(-1.0).as_deref(), times(-1.00005).as_deref()], [Some("sign flipped"); 2]);
    // A factor with the rounding of a measurement is one; no factor, and one too near to 1, is none.
    assert_eq!(said([2e3, 4e3, 6e3, 1e4 + 1e-3]).as_deref(), Some("off by the factor 2.00"));
    assert_eq!(
        [times(1.0), times(1.00005), said([1e3, 2e3, 3e3, 1e4]), said([2e3, 4e3, 6e3, 1.1e4])],
        [const { None }; 4]
    );
}

/// A symmetric matrix that is nearly right is not called transposed.
#[test]
fn a_symmetric_matrix_is_never_transposed() {
    let (right, near) = (sparse(2, &[1.0, 2.0, 2.0, 5.0]), sparse(2, &[1.0, 2.0, 2.0, 5.000001]));
    assert_eq!(overall(&near, &right), None);
}

fn entry(row: usize, column: usize, analytic: f64, numeric: f64) -> Entry {
    Entry::new(row, Some(column), analytic, numeric, 1e-7 * numeric.abs()).with_verdict("wrong")
}

/// Beside the diagonal, as large as its mirror image up to ten times the tolerance, and not zero.
#[test]
fn an_entry_in_the_place_of_its_mirror_image_is_transposed() {
    let numeric = sparse(3, &[1.0, 2.0, 7.0, 3.0, 5.0, 0.0, 0.0, 6.0, 4.0]);
    let said = |row, column, analytic| {
        let entry = entry(row, column, analytic, entry_of(&numeric, row, column));
        explain(entry, &numeric, &numeric, None, 1e-7).verdict
    };
    assert_eq!([said(0, 1, 3.0), said(0, 1, 3.0000015), said(1, 0, 2.0)], ["transposed"; 3]);
    assert_eq!([said(0, 1, 3.000004), said(0, 1, 4.0), said(0, 1, -3.0), said(0, 1, 9.0)], ["wrong"; 4]);
    // On the diagonal an entry is its own mirror image; two zeros are nothing that was exchanged.
    assert_eq!([said(1, 1, 5.0000015), said(0, 2, 0.0)], ["wrong"; 2]);
}

const K: f64 = 5e3;

/// In the plane a spring along (3, 4)/5 between two free particles, and one to a third, which rolls along y. `K^s` of the first has
/// α = 2000 and β = 5000 N/m over the four coordinates of its ends.
fn plane() -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for x in [[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, -2.0, 0.0]] {
        builder.particle(x, 1.0);
    }
    builder.spring(0, 1, Spring { stiffness: 3.0 * K, rest_length: 3.0, damping: 0.0 });
    builder.spring(1, 2, Spring { stiffness: 10.0, rest_length: 2.0, damping: 0.0 });
    builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0]), motion: Motion::Held });
    builder.build().unwrap()
}

/// −K with these coefficients of the first spring, and what stands for the second.
fn matrix(transverse: f64, axial: f64) -> CscMatrix<f64> {
    let n = Vector3::new(0.6, 0.8, 0.0);
    let block = (Matrix3::identity() - n * n.transpose()) * transverse + n * n.transpose() * axial;
    let mut whole = DMatrix::zeros(5, 5);
    for (row, column) in (0..4).flat_map(|row| (0..4).map(move |column| (row, column))) {
        let sign = if row / 2 == column / 2 { -1.0 } else { 1.0 };
        whole[(row, column)] = sign * block[(row % 2, column % 2)];
    }
    (whole[(3, 3)], whole[(3, 4)], whole[(4, 3)], whole[(4, 4)]) = (whole[(3, 3)] - 5.0, 5.0, 5.0, -5.0);
    CscMatrix::from(&whole)
}

#[test]
fn a_wrong_entry_is_told_by_its_spring_and_its_terms() {
    let (system, state) = plane();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let springs = (&system, ForceError::new(&system, &extensions));
    let numeric = matrix(2e3, K);
    let said = |analytic: &CscMatrix<f64>, row, column| {
        let entry = entry(row, column, entry_of(analytic, row, column), entry_of(&numeric, row, column));
        let entry = explain(entry, analytic, &numeric, Some(&springs), 1e-7);
        (entry.spring, entry.verdict)
    };
    let of = |spring: usize, words: &str| (Some(spring), words.to_owned());
    assert_eq!(said(&matrix(0.0, K), 0, 2), of(0, "the transverse term missing"));
    assert_eq!(said(&matrix(0.0, K), 2, 1), of(0, "the transverse term missing"));
    assert_eq!(said(&matrix(1e3, K + 1e-4), 0, 2), of(0, "50 % of the transverse term missing"));
    assert_eq!(said(&matrix(2e3, K + 5.0), 0, 2), of(0, "the axial term 1.00 times too large"));
    assert_eq!(said(&matrix(4e3, 2.0 * K), 0, 3), of(0, "off by the factor 2.00"));
    // The first spring is alone at its first end; at the other one two put their blocks into one place.
    assert_eq!(said(&matrix(0.0, K), 0, 0), of(0, "the transverse term missing"));
    assert_eq!(said(&matrix(0.0, K), 2, 2), (None, "wrong".into()));
    // Of the roller there is one row: no whole block. Particles without a spring between them have none to be named.
    let mut odd = DMatrix::from(&numeric);
    (odd[(3, 4)], odd[(4, 3)], odd[(0, 4)]) = (9.0, 8.0, 7.0);
    let odd = CscMatrix::from(&odd);
    assert_eq!([said(&odd, 3, 4), said(&odd, 4, 3)], [of(1, "wrong"), of(1, "wrong")]);
    assert_eq!(said(&odd, 0, 4), (None, "wrong".into()));
}

/// Eight times the error of the estimate, the tolerance times the larger value, and what is negligible in the column or of all.
#[test]
fn what_is_allowed_for_an_entry() {
    let allowed = |value: f64, estimate: f64, error: f64, of_all: f64| {
        let estimate = Estimate { value: estimate, error };
        Comparison { row: 0, column: 0, value, estimate, largest: 4.0 }.allowed(1e-3, of_all)
    };
    let is = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-15, "{value} {expected}");
    is(allowed(-2.0, 3.0, 0.125, 5.0), 1.0 + 3e-3 + 4e-6);
    is(allowed(-2.0, 1.0, 0.125, 1e10), 1.0 + 2e-3 + 1e-2);
    // What is as unsure as it is large says nothing of an entry that is there, and all of one that is negligible.
    assert!(allowed(2.0, 1.0, 0.25, 5.0).is_nan());
    let negligible = 1e-3 * 1e-3 * 4.0;
    is(allowed(negligible, 0.0, 1.0, 5.0), 8.0 + 1e-3 * negligible + negligible);
    assert!(allowed(1.01 * negligible, 0.0, 1.0, 5.0).is_nan());
}

#[test]
fn the_spread_of_a_point_is_never_zero() {
    let spread = |point: &[f64]| {
        let n = point.len();
        check_input(&CscMatrix::zeros(n, n), point, &JacobianOptions::default()).unwrap()
    };
    let points: [&[f64]; 5] = [&[2.0, -1.0, 3.0], &[5.0], &[-5.0, -5.0], &[0.0], &[7.0, 8.0]];
    assert_eq!(points.map(spread), [4.0, 5.0, 5.0, 1.0, 1.0]);
}

#[test]
fn inputs_that_do_not_fit_are_refused_by_name() {
    let key = |options: &JacobianOptions| {
        check_input(&CscMatrix::zeros(5, 5), &[1.0; 5], options).err().map(|e| e.to_string())
    };
    let refused = |options: JacobianOptions, name: &str| {
        let said = key(&options).unwrap_or_default();
        assert!(said.starts_with(name), "{name}: {said}");
    };
    let default = JacobianOptions::default;
    for value in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        refused(JacobianOptions { tolerance: value, ..default() }, "options.tolerance");
        refused(JacobianOptions { length: Some(value), ..default() }, "options.length");
    }
    let groups = |n| Some(ColumnGroups::one_by_one(n));
    refused(JacobianOptions { groups: groups(4), ..default() }, "options.groups");
    assert_eq!(key(&JacobianOptions { groups: groups(5), length: Some(1.0), ..default() }), None);
    let (system, state) = plane();
    assert_eq!(key(&JacobianOptions { springs: Some((&system, &state)), ..default() }), None);
    let mut short = state.clone();
    short.positions.pop();
    refused(JacobianOptions { springs: Some((&system, &short)), ..default() }, "options.springs");
    let mut builder = SystemBuilder::new();
    for x in [0.0, 1.0, 2.0] {
        builder.particle([x, 0.0, 0.0], 1.0);
    }
    let (other, at) = builder.build().unwrap();
    refused(JacobianOptions { springs: Some((&other, &at)), ..default() }, "options.springs");
}

/// A force that never changes has no derivative: nothing is measured, and a matrix of zeros is right, not missing.
#[test]
fn a_matrix_of_zeros_is_right_for_a_constant_force() {
    let report =
        check_jacobian(|_, f| f.fill(3.0), &DMatrix::zeros(2, 2), &[1.0, 2.0], &JacobianOptions::default()).unwrap();
    assert!(report.passed() && report.value == 0.0);
    assert_eq!((report.numeric.nnz(), report.compared, report.wrong, report.overall), (0, 4, 0, None));
}

#[test]
fn only_what_is_measured_is_stored_and_faults_are_told() {
    let linear = |x: &[f64], f: &mut [f64]| (f[0], f[1]) = (2.0 * x[0], 3.0 * x[0] + 5.0 * x[1]);
    let report = |entries: [f64; 4]| {
        check_jacobian(linear, sparse(2, &entries), &[1.0, 2.0], &JacobianOptions::default()).unwrap()
    };
    let right = report([2.0, 0.0, 3.0, 5.0]);
    assert!(right.passed() && right.numeric.nnz() == 3 && right.overall.is_none());
    let flipped = report([-2.0, 0.0, -3.0, -5.0]);
    assert!(!flipped.passed() && flipped.wrong == 3);
    assert_eq!(flipped.overall.as_deref(), Some("sign flipped"));
    let with = |value| JacobianReport { value, ..report([2.0, 0.0, 3.0, 5.0]) }.passed();
    assert_eq!([0.0, 1.0, 1.1, f64::NAN].map(with), [true, true, false, false]);
}

#[test]
fn wrong_terms_are_named_where_all_of_a_block_is_there() {
    use crate::verify::fixtures::{assert_faults_are_found, bent, wrong_stiffness};
    let (system, state) = bent();
    let options = JacobianOptions { springs: Some((&system, &state)), ..JacobianOptions::default() };
    let (force, wrong) = (crate::verify::elastic_force(&system, &state), wrong_stiffness(&system, &state));
    let point = crate::verify::reduced::reduce(&system, &state.positions);
    let report = check_jacobian(force, wrong, &point, &options).unwrap();
    assert_eq!((report.wrong, report.overall), (9, None));
    assert_faults_are_found(&report.worst);
}
