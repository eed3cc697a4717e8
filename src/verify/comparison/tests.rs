//! Errors ranked and put into words: every number here follows by hand from the two values that are compared.

use super::*;
use crate::spring::Spring;

/// A difference is given in percent from two thirds to one and a half, and as a factor beyond.
#[test]
fn entries_name_their_fault() {
    let cases = [
        (1.0, 1.0 + 1e-10, "agrees"),
        (0.0, 5.0, "missing"),
        (5.0, 0.0, "extra"),
        (-5.0, 5.0, "sign flipped"),
        (-4.0, 5.0, "wrong sign and size"),
        (7.0, 10.0, "30.0 % too small"),
        (14.0, 10.0, "40.0 % too large"),
        (6.0, 10.0, "off by the factor 0.60"),
        (15.0, 10.0, "off by the factor 1.50"),
        (f64::NAN, 1.0, "not finite"),
        (1.0 + 1e-6, 1.0, "relative difference 1.0e-6"),
    ];
    for (analytic, numeric, words) in cases {
        assert_eq!(Entry::new(0, Some(0), analytic, numeric, 1e-9).verdict, words);
    }
}

#[test]
fn the_worst_of_errors_is_nan_if_one_is_or_there_are_none() {
    assert_eq!([worst([1.0, 3.0, 2.0]), worst([-2.0, -1.0])], [3.0, -1.0]);
    let nan: [&[f64]; 4] = [&[f64::NAN, 1.0], &[1.0, f64::NAN, 2.0], &[1.0, f64::NAN], &[]];
    assert!(nan.iter().all(|values| worst(values.iter().copied()).is_nan()));
    assert_eq!([ratio(0.0, 0.0), ratio(0.0, 2.0), ratio(3.0, 2.0)], [0.0, 0.0, 1.5]);
}

fn compared(pairs: &[(f64, f64, f64)]) -> WorstEntries {
    let mut entries = WorstEntries::new();
    pairs.iter().enumerate().for_each(|(row, &(a, b, allowed))| entries.compare(row, None, a, b, allowed));
    entries
}

/// The errors are 0 of 0, 2 of 4, 4 of 2, 1 of ½, 5 of 2½ and 1 of 1 allowed. The worst come first, and of equals those that were first.
#[test]
fn the_worst_entries_come_first() {
    let pairs = [(1.0, 1.0, 0.0), (3.0, 1.0, 4.0), (1.0, 5.0, 2.0), (5.0, 4.0, 0.5), (2.0, 7.0, 2.5), (8.0, 9.0, 1.0)];
    let entries = compared(&pairs);
    assert_eq!((entries.worst, entries.compared, entries.wrong), (2.0, 6, 3));
    let rows = |entries: WorstEntries| entries.into_table(|entry| entry).iter().map(|e| e.row).collect::<Vec<_>>();
    assert_eq!(rows(entries), [2, 3, 4, 5, 1, 0]);
    let none = compared(&[]);
    assert!(none.worst.is_nan() && none.compared == 0 && none.into_table(|entry| entry).is_empty());
    // An entry that comes late and is worse than all pushes the last one out.
    let growing: Vec<_> = (1..=12).map(|n| (0.0, f64::from(n), 1.0)).collect();
    assert_eq!(rows(compared(&growing)), [11, 10, 9, 8, 7, 6, 5, 4, 3, 2]);
}

#[test]
fn an_entry_that_cannot_be_measured_is_worst_and_wrong() {
    let inf = f64::INFINITY;
    let entries = compared(&[(1.0, 1.5, 1.0), (2.0, 2.0, inf), (3.0, 9.0, 1.0), (f64::NAN, 1.0, 1.0)]);
    assert!(entries.worst.is_nan());
    assert_eq!((entries.compared, entries.wrong), (4, 3));
    let words: Vec<_> = entries.into_table(|entry| entry).into_iter().map(|e| (e.row, e.verdict)).collect();
    let expected = [(1, "cannot be measured"), (3, "not finite"), (2, "off by the factor 0.33"), (0, "agrees")];
    assert_eq!(words, expected.map(|(row, words)| (row, words.to_owned())));
    for (a, b) in [(f64::NAN, 1.0), (1.0, inf), (f64::NAN, inf)] {
        assert_eq!(compared(&[(a, b, inf)]).into_table(|entry| entry)[0].verdict, "not finite");
    }
}

/// Only wrong entries are explained; those of a spring's block are named with it.
#[test]
fn only_wrong_entries_are_explained() {
    let mut entries = WorstEntries::new();
    entries.spring = Some(7);
    for (row, column) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        entries.compare(row, Some(column), 1.0, if (row, column) == (1, 0) { 2.0 } else { 1.0 }, 0.5);
    }
    let table = entries.into_table(|entry| entry.with_verdict("explained"));
    let table: Vec<_> = table.iter().map(|e| (e.spring, e.row, e.column, e.verdict.as_str())).collect();
    let agrees = |row, column| (Some(7), row, Some(column), "agrees");
    assert_eq!(table, [(Some(7), 1, Some(0), "explained"), agrees(0, 0), agrees(0, 1), agrees(1, 1)]);
}

/// `α (I − nnᵀ) + β nnᵀ` over the first axes.
fn block(n: Vector3<f64>, dimension: usize, transverse: f64, axial: f64) -> Matrix3<f64> {
    let along = n * n.transpose();
    let mut identity = Matrix3::zeros();
    (0..dimension).for_each(|axis| identity[(axis, axis)] = 1.0);
    (identity - along) * transverse + along * axial
}

fn along(n: Vector3<f64>, rest_length: f64) -> Link {
    Link::new(0, [0, 1], Spring { stiffness: 1.0, rest_length, damping: 0.0 }, n, 1.0)
}

/// A spring's block with coefficients α and β other than the true ones.
#[test]
fn wrong_blocks_are_described_by_their_terms() {
    let n = Vector3::new(0.6, 0.8, 0.0);
    let words = |(a, b): (f64, f64), (c, d): (f64, f64), rest_length: f64| {
        block_verdict(&along(n, rest_length), [&block(n, 2, a, b), &block(n, 2, c, d)], 2, 1e-6).unwrap_or_default()
    };
    let cases = [
        ((2.0, 5.0), ""),
        ((-2.0, -5.0), "sign flipped"),
        ((0.0, 0.0), "missing"),
        ((4.0, 10.0), "off by the factor 2.00"),
        ((1.0, 2.5), "off by the factor l0 = 0.5000: k in place of k/l0"),
        ((0.0, 5.0), "the transverse term missing"),
        ((-2.0, 5.0), "the transverse term with its sign flipped"),
        ((-1.0, 5.0), "the transverse term of the wrong sign and 0.50 times its size"),
        ((1.5, 5.0), "25 % of the transverse term missing"),
        ((3.0, 5.0), "the transverse term 1.50 times too large"),
        ((2.0, 7.0), "the axial term 1.40 times too large"),
        ((2.0, -5.0), "the axial term with its sign flipped"),
        ((1.0, 7.0), "50 % of the transverse term missing, the axial term 1.40 times too large"),
    ];
    for (analytic, expected) in cases {
        assert_eq!(words(analytic, (2.0, 5.0), 0.5), expected);
    }
    assert_eq!(words((4.0, 10.0), (2.0, 5.0), 2.0), "off by the factor l0 = 2.0000: k in place of k/l0");
    assert_eq!(words((2.0, 5.0), (0.0, 5.0), 0.5), "a transverse term that should not be there");
    assert_eq!(words((-3.0, 5.0), (-2.0, 5.0), 0.5), "the transverse term 1.50 times too large");
    // A term so small that its part of the truth rounds to zero is missing, not of the wrong sign.
    assert_eq!(term_verdict("axial", 1e-200, 1e200, 0.0), "100 % of the axial term missing");
    // A block without a spring's form, measured or not, has no terms, whatever else is wrong with it.
    let right = block(n, 2, 2.0, 5.0);
    let mut odd = right * 2.0;
    odd[(0, 1)] += 0.5;
    let words = |a: &Matrix3<f64>, b: &Matrix3<f64>| block_verdict(&along(n, 0.5), [a, b], 2, 1e-6);
    assert_eq!([words(&odd, &right), words(&right, &odd), words(&odd, &odd)], [None, None, None]);
    assert!(words(&(right * 2.0), &right).is_some());
}
