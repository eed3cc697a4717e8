use super::*;
use crate::assembly::SymmetricMatrix;
use crate::linear::fixtures::{banded, noise};
use crate::linear::{Factorization, Ldl, Llt, SolvingKind, norm};
use crate::operator::LinearOperator;
use faer::Par;
use std::collections::BTreeSet;

/// Of bands of more and more particles, narrow and wide, definite ones and such as have pivots of both signs.
fn matrices(diagonal: fn(usize) -> f64) -> impl Iterator<Item = SymmetricMatrix> {
    let sizes = [1, 2, 3, 4, 5, 7, 11, 16, 25, 60];
    sizes.into_iter().flat_map(|particles| [1, 2, 3, 5, 9].map(|width| (particles, width))).map(
        move |(particles, width)| {
            banded(particles, width, |row, column| noise(row, column) + if row == column { diagonal(row) } else { 0.0 })
        },
    )
}

fn factored<K: SolvingKind>(a: &SymmetricMatrix) -> Factorization<K> {
    let mut factorization = Factorization::analyse(a.pattern(), Par::Seq).unwrap();
    assert!(factorization.run(a).is_ok());
    factorization
}

fn is_solved<K: SolvingKind>(a: &SymmetricMatrix) {
    let expected: Vec<f64> = (0..a.pattern().order()).map(|row| noise(row, 3)).collect();
    let mut x = expected.clone();
    a.apply(&expected, &mut x);
    factored::<K>(a).substitute(&mut x);
    let error: Vec<f64> = x.iter().zip(&expected).map(|(x, expected)| x - expected).collect();
    assert!(norm(&error) < 1e-13 * norm(&expected), "{} rows: {:e}", x.len(), norm(&error) / norm(&expected));
}

/// Columns come in fours and what is left of them, rows too: all kinds are met. The diagonal outweighs every row, so that no digits but the last are lost.
#[test]
fn solutions_are_those_of_the_matrix() {
    let (mut columns, mut rows) = (BTreeSet::new(), BTreeSet::new());
    for a in matrices(|_| 40.0) {
        is_solved::<Llt>(&a);
        for s in supernodes(&factored::<Llt>(&a).analysis.symbolic) {
            columns.insert(s.columns % COLUMNS);
            rows.insert(s.below.len() % 4);
        }
    }
    assert!(columns.len() == 4 && rows.len() == 4, "{columns:?} {rows:?}");
    for a in matrices(|row| if row % 3 == 1 { -40.0 } else { 40.0 }) {
        is_solved::<Ldl>(&a);
    }
}
