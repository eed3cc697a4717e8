use super::*;
use crate::linear::FactorTimes;
use crate::linear::fixtures::{self, noise};
use crate::memory::watch::asked;
use crate::operator::LinearOperator;
use std::collections::BTreeSet;

/// What the room for an analysis is asked for under.
const ANALYSED: &str = "the analysis of the matrix";

/// A band with `diagonal` added to the diagonal.
fn banded(particles: usize, diagonal: impl Fn(usize) -> f64) -> SymmetricMatrix {
    let entry = |row, column| noise(row, column) + if row == column { diagonal(row) } else { 0.0 };
    fixtures::banded(particles, 2, entry)
}

fn ldlt(a: &SymmetricMatrix) -> Ldlt {
    Ldlt::analyse(a.pattern(), Par::Seq).unwrap()
}

fn curvature(a: &SymmetricMatrix, u: &[f64]) -> f64 {
    let mut product = vec![0.0; u.len()];
    a.apply(u, &mut product);
    product.iter().zip(u).map(|(a, u)| a * u).sum()
}

/// The pattern of L holds that of A in the order of elimination and what elimination fills in, all below the diagonal and each entry
/// once; the operations are the squares of its columns' heights.
#[test]
fn the_pattern_of_the_factor_is_closed_under_elimination() {
    for particles in [1, 3, 40] {
        let a = banded(particles, |_| 20.0);
        let mut factorization = ldlt(&a);
        factorization.factor(&a).unwrap();
        let mut place = vec![0; a.order()];
        factorization.pivots().enumerate().for_each(|(k, (row, _))| place[row] = k);
        let listed: Vec<(usize, usize)> = factorization.pattern().collect();
        let pattern: BTreeSet<(usize, usize)> = listed.iter().copied().collect();
        assert_eq!(pattern.len(), listed.len());
        assert!(pattern.iter().all(|&(row, column)| column < row && row < a.order()));
        let of_a =
            a.iter().filter(|(row, column, _)| row != column).map(|(row, column, _)| (place[row], place[column]));
        assert!(of_a.map(|(i, j)| (i.max(j), i.min(j))).all(|entry| pattern.contains(&entry)));
        let mut heights = vec![1.0; a.order()];
        pattern.iter().for_each(|&(_, column)| heights[column] += 1.0);
        assert_eq!(heights.iter().map(|h| h * h).sum::<f64>(), factorization.size().flops);
        for k in 0..a.order() {
            let below: Vec<usize> = pattern.iter().filter(|entry| entry.1 == k).map(|entry| entry.0).collect();
            let filled = below.iter().flat_map(|&j| below.iter().map(move |&i| (i, j))).filter(|(i, j)| i > j);
            assert!(filled.clone().all(|entry| pattern.contains(&entry)));
        }
        assert_eq!(pattern.len() < a.order() * (a.order() - 1) / 2, particles == 40, "dense if small");
    }
}

/// With d the most negative pivot `uᵀAu = 1/d`, wherever in the order it lies.
#[test]
fn a_negative_direction_has_the_curvature_of_the_most_negative_pivot() {
    let order = 3 * 20;
    for weak in (0..order).step_by(7) {
        let a = banded(20, |row| if row == weak { -40.0 } else { 20.0 });
        let mut factorization = ldlt(&a);
        factorization.factor(&a).unwrap();
        let worst = factorization.pivots().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert_eq!(worst.0, weak);
        assert!(!factorization.is_positive());
        let mut u = vec![f64::NAN; order];
        assert!(factorization.negative_direction(&mut u));
        assert!((curvature(&a, &u) * worst.1 - 1.0).abs() < 1e-12, "row {weak}");
        assert!((u[weak] * worst.1 - 1.0).abs() < 1e-12, "L has a unit diagonal");
    }
}

/// A definite matrix has no direction of negative curvature; a pivot that is zero is neither positive nor negative.
#[test]
fn zero_pivots_have_no_sign() {
    let a = banded(4, |_| 20.0);
    let mut factorization = ldlt(&a);
    let mut u = vec![0.0; a.order()];
    assert!(factorization.pivots().all(|(_, pivot)| pivot == 0.0), "nothing is factored yet");
    assert!(!factorization.is_positive());
    assert!(!factorization.negative_direction(&mut u));
    factorization.factor(&a).unwrap();
    assert!(factorization.is_positive());
    assert!(!factorization.negative_direction(&mut u));
}

/// Times add up over all calls, refused factorizations included.
#[test]
fn times_add_up() {
    let (a, indefinite) = (banded(4, |_| 20.0), banded(4, |_| -20.0));
    let mut x = vec![1.0; a.order()];
    let mut cholesky = Cholesky::analyse(a.pattern(), Par::Seq).unwrap();
    let mut ldlt = ldlt(&a);
    let mut before = [FactorTimes::default(); 2];
    for call in 0..3 {
        assert_eq!(cholesky.factor(if call == 1 { &indefinite } else { &a }).is_err(), call == 1);
        ldlt.factor(&a).unwrap();
        if call != 1 {
            cholesky.substitute(&mut x);
        }
        ldlt.substitute(&mut x);
        let now = [cholesky.report().times, ldlt.report().times];
        for (now, before) in now.iter().zip(before) {
            assert!(now.analysis_seconds > 0.0);
            assert!(now.factor_seconds > before.factor_seconds);
        }
        assert_eq!(now[0].solve_seconds > before[0].solve_seconds, call != 1);
        assert!(now[1].solve_seconds > before[1].solve_seconds);
        before = now;
    }
}

/// Many right-hand sides at once are solved as each alone.
#[test]
fn columns_are_solved_like_vectors() {
    let a = banded(5, |_| 20.0);
    let (mut factorization, n) = (ldlt(&a), a.order());
    factorization.factor(&a).unwrap();
    for columns in [1, 4, 5, 9] {
        let mut together: Vec<f64> = (0..columns * n).map(|at| noise(at, 3 * at + 1)).collect();
        let mut alone = together.clone();
        factorization.substitute_columns(n, &mut together);
        alone.chunks_mut(n).for_each(|x| factorization.substitute(x));
        let error = together.iter().zip(&alone).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(error < 1e-14, "{columns} columns: {error:e}");
    }
}

/// What a factor is said to take is what it then holds, but for alignment; what shares its analysis has memory of its own and has taken no time.
#[test]
fn factors_hold_what_they_say() {
    for particles in [3, 60] {
        let a = banded(particles, |_| 20.0);
        let (factorization, asked) = asked(ANALYSED, || ldlt(&a));
        assert_eq!(asked, 64 * (a.pattern().entries() + a.order()) as u64);
        let held = |of: &Ldlt| {
            size_of_val(&of.analysis.values[..]) + of.analysis.memory.len() + of.analysis.substitution.held()
        };
        let said = factorization.bytes() as usize;
        assert!(said.abs_diff(held(&factorization)) <= 256, "{said} {}", held(&factorization));
        assert!(factorization.report().times.analysis_seconds > 0.0);
        let shared = Ldlt::sharing(&factorization).unwrap();
        assert_eq!((held(&shared), shared.report().times), (held(&factorization), FactorTimes::default()));
    }
}

/// Right-hand sides that do not fit are errors.
#[test]
fn wrong_lengths_are_refused() {
    let a = crate::linear::fixtures::banded(2, 1, |row, column| if row == column { 2.0 } else { 0.1 });
    let mut cholesky = Cholesky::analyse(a.pattern(), Par::Seq).unwrap();
    cholesky.factor(&a).unwrap();
    assert!(cholesky.solve_in_place(&mut [1.0; 6]).is_ok() && cholesky.solve_columns_in_place(&mut [1.0; 12]).is_ok());
    for length in [0, 5, 7, 12] {
        assert!(cholesky.solve_in_place(&mut vec![1.0; length]).is_err(), "{length}");
    }
    assert!(cholesky.solve_columns_in_place(&mut [1.0; 13]).is_err());
}
