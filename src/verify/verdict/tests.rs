//! Errors ranked and put into words: every number here follows by hand from the two values that are compared.

use super::*;

fn compared(limit: usize, pairs: &[(f64, f64, f64)]) -> WorstEntries {
    let mut entries = WorstEntries::new(limit);
    pairs.iter().enumerate().for_each(|(row, &(a, b, allowed))| entries.compare(row, None, a, b, allowed));
    entries
}

/// The errors are 0 of 0, 2 of 4, 4 of 2, 1 of ½, 5 of 2½ and 1 of 1 of what is allowed. The worst come first, and of equals those
/// that were there first.
#[test]
fn the_worst_entries_are_kept_in_order() {
    let pairs = [(1.0, 1.0, 0.0), (3.0, 1.0, 4.0), (1.0, 5.0, 2.0), (5.0, 4.0, 0.5), (2.0, 7.0, 2.5), (8.0, 9.0, 1.0)];
    let entries = compared(2, &pairs);
    assert_eq!((entries.worst(), entries.compared(), entries.wrong()), (2.0, 6, 3));
    let rows = |limit| compared(limit, &pairs).into_table(|entry| entry).iter().map(|e| e.row).collect::<Vec<_>>();
    assert_eq!([rows(2), rows(4), rows(9)], [vec![2, 3], vec![2, 3, 4, 5], vec![2, 3, 4, 5, 1, 0]]);
    let none = compared(2, &[]);
    assert!(none.worst().is_nan() && none.compared() == 0 && none.into_table(|entry| entry).is_empty());
}

/// One that comes late and is worse than all pushes the last one out.
#[test]
fn a_worse_entry_takes_the_place_of_the_last() {
    let table = compared(2, &[(0.0, 1.0, 1.0), (0.0, 2.0, 1.0), (0.0, 3.0, 1.0)]).into_table(|entry| entry);
    assert_eq!(table.iter().map(|entry| entry.row).collect::<Vec<_>>(), [2, 1]);
    assert!(table.iter().all(|entry| entry.spring.is_none() && entry.verdict == "missing"));
}

#[test]
fn what_cannot_be_measured_is_worst_and_wrong() {
    let inf = f64::INFINITY;
    let entries = compared(9, &[(1.0, 1.5, 1.0), (2.0, 2.0, inf), (3.0, 9.0, 1.0), (f64::NAN, 1.0, 1.0)]);
    assert!(entries.worst().is_nan());
    assert_eq!((entries.compared(), entries.wrong()), (4, 3));
    let words: Vec<_> = entries.into_table(|entry| entry).into_iter().map(|e| (e.row, e.verdict)).collect();
    let expected = [(1, "cannot be measured"), (3, "not finite"), (2, "off by the factor 0.33"), (0, "agrees")];
    assert_eq!(words, expected.map(|(row, words)| (row, words.to_owned())));
    for (a, b) in [(f64::NAN, 1.0), (1.0, inf), (f64::NAN, inf)] {
        assert_eq!(compared(1, &[(a, b, inf)]).into_table(|entry| entry)[0].verdict, "not finite");
    }
    // The largest is that of numbers only where all are numbers.
    let last = compared(9, &[(1.0, 3.0, 1.0), (1.0, 2.0, 1.0)]);
    assert_eq!((last.worst(), last.wrong()), (2.0, 1));
}

#[test]
fn only_wrong_entries_are_explained() {
    let mut entries = WorstEntries::new(3);
    entries.compare_spring(7, (1, Some(2)), 1.0, 2.0, 1.0);
    entries.compare_spring(8, (3, Some(4)), 1.0, 2.0, 0.5);
    let table = entries.into_table(|entry| entry.with_verdict("explained"));
    let told: Vec<_> = table.iter().map(|e| (e.spring, e.row, e.column, e.verdict.as_str())).collect();
    assert_eq!(told, [(Some(8), 3, Some(4), "explained"), (Some(7), 1, Some(2), "agrees")]);
}

/// A size is told in percent from two thirds to one and a half, and as a factor beyond.
#[test]
fn sizes_are_told_as_percent_or_as_a_factor() {
    let words = |a, b| compared(1, &[(a, b, 1e-9)]).into_table(|entry| entry).remove(0).verdict;
    assert_eq!(words(7.0, 10.0), "30.0 % too small");
    assert_eq!(words(14.0, 10.0), "40.0 % too large");
    assert_eq!(words(6.0, 10.0), "off by the factor 0.60");
    assert_eq!(words(15.0, 10.0), "off by the factor 1.50");
    assert_eq!(words(20.0, 10.0), "off by the factor 2.00");
    assert_eq!(words(-10.0, 10.0), "sign flipped");
    assert_eq!(words(5.0, 0.0), "extra");
}

/// `α (I − nnᵀ) + β nnᵀ` over the first axes.
fn block(n: Vector3<f64>, dimension: usize, transverse: f64, axial: f64) -> Matrix3<f64> {
    let along = n * n.transpose();
    let mut identity = Matrix3::zeros();
    (0..dimension).for_each(|axis| identity[(axis, axis)] = 1.0);
    (identity - along) * transverse + along * axial
}

/// In the plane with n = (3, 4)/5: an entry of ½ beside the diagonal adds ½ · 12/25 = 0.24 to β and takes it from α, and the block of
/// that form differs most in the same entry, by ½ − 0.48 · 0.48 = 0.2696.
#[test]
fn coefficients_of_a_block_and_what_is_left_over() {
    let cases = [
        (Vector3::x(), 1, (0.0, 5.0)),
        (Vector3::new(0.6, 0.8, 0.0), 2, (2.0, 5.0)),
        (Vector3::new(2.0, -1.0, 2.0) / 3.0, 3, (-1.5, 7.0)),
    ];
    for (n, dimension, (transverse, axial)) in cases {
        let (a, b, rest) = coefficients(&block(n, dimension, transverse, axial), &n, dimension);
        assert!(
            (a - transverse).abs() < 1e-14 && (b - axial).abs() < 1e-14 && rest < 1e-14,
            "{dimension}: {a} {b} {rest}"
        );
    }
    let n = Vector3::new(0.6, 0.8, 0.0);
    let mut odd = block(n, 2, 2.0, 5.0);
    odd[(0, 1)] += 0.5;
    let (a, b, rest) = coefficients(&odd, &n, 2);
    assert!((a - 1.76).abs() < 1e-14 && (b - 5.24).abs() < 1e-14 && (rest - 0.2696).abs() < 1e-14, "{a} {b} {rest}");
}

/// A spring's block with other coefficients than the measured ones, α = 2 and β = 5 where nothing else is said.
#[test]
fn a_block_is_told_by_its_terms() {
    let n = Vector3::new(0.6, 0.8, 0.0);
    let words = |(a, b): (f64, f64), (c, d): (f64, f64), rest_length: f64| {
        of_block(&block(n, 2, a, b), &block(n, 2, c, d), &n, rest_length, 2, 1e-6)
    };
    let said = |analytic, numeric| words(analytic, numeric, 0.5).unwrap_or_default();
    let told = |transverse, axial| said((transverse, axial), (2.0, 5.0));
    assert_eq!(words((2.0, 5.0), (2.0, 5.0), 0.5), None);
    assert_eq!(told(-2.0, -5.0), "sign flipped");
    assert_eq!(told(0.0, 0.0), "missing");
    assert_eq!(told(4.0, 10.0), "off by the factor 2.00");
    assert_eq!(told(1.0, 2.5), "off by the factor l0 = 0.5000: k in place of k/l0");
    assert_eq!(
        words((4.0, 10.0), (2.0, 5.0), 2.0).unwrap_or_default(),
        "off by the factor l0 = 2.0000: k in place of k/l0"
    );
    assert_eq!(told(0.0, 5.0), "the transverse term missing");
    assert_eq!(told(-2.0, 5.0), "the transverse term with its sign flipped");
    assert_eq!(told(-1.0, 5.0), "the transverse term of the wrong sign and 0.50 times its size");
    assert_eq!(told(1.5, 5.0), "25 % of the transverse term missing");
    assert_eq!(told(3.0, 5.0), "the transverse term 1.50 times too large");
    assert_eq!(told(2.0, 7.0), "the axial term 1.40 times too large");
    assert_eq!(told(2.0, -5.0), "the axial term with its sign flipped");
    assert_eq!(told(1.0, 7.0), "50 % of the transverse term missing, the axial term 1.40 times too large");
    assert_eq!(said((2.0, 5.0), (0.0, 5.0)), "a transverse term that should not be there");
    assert_eq!(said((-3.0, 5.0), (-2.0, 5.0)), "the transverse term 1.50 times too large");
}

/// Of a block that has not a spring's form, measured or not, nothing is said, whatever else is wrong with it.
#[test]
fn other_blocks_are_not_told_by_terms() {
    let n = Vector3::new(0.6, 0.8, 0.0);
    let right = block(n, 2, 2.0, 5.0);
    let mut odd = right * 2.0;
    odd[(0, 1)] += 0.5;
    let words = |a: &Matrix3<f64>, b: &Matrix3<f64>| of_block(a, b, &n, 0.5, 2, 1e-6);
    assert_eq!([words(&odd, &right), words(&right, &odd), words(&odd, &odd)], [None, None, None]);
    assert!(words(&(right * 2.0), &right).is_some());
}

/// A term so small that its share of the truth rounds to zero is missing, not of the wrong sign.
#[test]
fn shares_that_round_to_zero_have_no_sign() {
    assert_eq!(of_term("axial", 1e-200, 1e200, 0.0), "100 % of the axial term missing");
}
