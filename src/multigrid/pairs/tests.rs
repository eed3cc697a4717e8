//! Which pairs are found, and what moving them does, against dense matrices.

use super::super::block::{Block, scaled, sum};
use super::super::gauss_seidel::{GaussSeidel, General};
use super::super::smoother::Smoother;
use super::super::sparse::{BlockMatrix, Pattern};
use super::Pairs;
use nalgebra::{DMatrix, DVector, Matrix2};
use std::sync::Arc;

const FACTOR: f64 = 0.25;

/// The matrix of nodes with a mass term of one and springs with these blocks, and a smoother of it with so many rows a domain.
fn system<const N: usize>(
    nodes: usize,
    springs: &[([usize; 2], Block<N, N>)],
    domain: usize,
) -> (BlockMatrix<N, N>, Smoother<N>) {
    let pattern = Pattern::build(nodes, |row, columns| {
        let others = springs.iter().filter(|(ends, _)| ends.contains(&row)).map(|&([i, j], _)| (i + j - row) as u32);
        columns.extend(others.chain([row as u32]));
    });
    let mut a = BlockMatrix::zeros(Arc::new(pattern.unwrap()));
    let place = |row: usize, column: usize| {
        let columns = a.pattern.columns(row);
        a.pattern.row(row).start + columns.binary_search(&(column as u32)).unwrap()
    };
    for row in 0..nodes {
        a.values[place(row, row)] = std::array::from_fn(|r| std::array::from_fn(|c| f64::from(u8::from(r == c))));
    }
    for &([i, j], block) in springs {
        for (row, column, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
            let at = place(row, column);
            a.values[at] = sum(&a.values[at], &scaled(sign, &block));
        }
    }
    let mut smoother = GaussSeidel::with_domains(General, &a.pattern, domain).unwrap();
    smoother.update(&a, FACTOR).unwrap();
    (a, Smoother::General(smoother))
}

fn found<const N: usize>(a: &BlockMatrix<N, N>, smoother: &Smoother<N>) -> Pairs<N> {
    let mut pairs = Pairs::default();
    pairs.find(a, smoother, FACTOR);
    pairs
}

fn nodes_of<const N: usize>(pairs: &Pairs<N>) -> Vec<[usize; 2]> {
    pairs.moves().into_iter().map(|(nodes, _)| nodes).collect()
}

/// Two nodes with a mass term of one and a spring of k between them, and a soft one to a third: 2.1 + 2k apart, 2.1 together, a tightness of 1 + k/1.05.
#[test]
fn a_pair_is_found_from_a_tightness_of_four_on_to_a_thousand() {
    let found = |k: f64, domain: usize| {
        let (a, smoother) = system(3, &[([0, 2], [[k]]), ([1, 2], [[0.1]])], domain);
        nodes_of(&found(&a, &smoother))
    };
    for domain in [3, 2, 1] {
        assert_eq!(found(2.9, domain), Vec::<[usize; 2]>::new(), "{domain}");
        assert_eq!(found(3.3, domain), [[0, 2]], "{domain}");
        assert_eq!(found(1040.0, domain), [[0, 2]], "{domain}");
        assert_eq!(found(1060.0, domain), Vec::<[usize; 2]>::new(), "{domain}");
    }
}

fn random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

/// Springs along random directions between near nodes, of stiffnesses up to a thousandfold apart.
fn springs(nodes: usize, neighbours: usize, seed: &mut u64) -> Vec<([usize; 2], Block<2, 2>)> {
    let mut springs = Vec::new();
    for i in 0..nodes {
        for j in i + 1..nodes.min(i + 1 + neighbours) {
            let (k, angle) = (1000f64.powf(random(seed)), 6.0 * random(seed));
            let (d, t) = ([angle.cos(), angle.sin()], 0.2 * random(seed));
            let block = |r: usize, c: usize| k * ((1.0 - t) * d[r] * d[c] + if r == c { t } else { 0.0 });
            springs.push(([i, j], std::array::from_fn(|r| std::array::from_fn(|c| block(r, c)))));
        }
    }
    springs
}

/// A block of a dense matrix.
fn block(a: &DMatrix<f64>, row: usize, column: usize) -> Matrix2<f64> {
    a.fixed_view::<2, 2>(2 * row, 2 * column).into()
}

fn dense(a: &BlockMatrix<2, 2>, nodes: usize) -> DMatrix<f64> {
    let mut dense = DMatrix::zeros(2 * nodes, 2 * nodes);
    for row in 0..nodes {
        for (column, block) in a.row(row) {
            (0..4).for_each(|at| dense[(2 * row + at / 2, 2 * column + at % 2)] = block[at / 2][at % 2]);
        }
    }
    dense
}

/// Those of which the definition says so, whatever domains they are in.
#[test]
fn all_tight_pairs_are_found() {
    let (mut seed, mut count) = (3, 0);
    for (nodes, neighbours) in [(2, 3), (5, 3), (12, 3), (40, 3), (600, 3), (60, 50)] {
        let springs = springs(nodes, neighbours, &mut seed);
        for domain in [nodes, 7] {
            let (a, smoother) = system(nodes, &springs, domain);
            let whole = dense(&a, nodes);
            let resisted = |[i, j]: [usize; 2]| {
                let apart = block(&whole, i, i) + block(&whole, j, j);
                (apart, apart + block(&whole, i, j) + block(&whole, j, i))
            };
            // The larger eigenvalue, from trace and determinant.
            let largest = |pair| {
                let (apart, together) = resisted(pair);
                let product = together.try_inverse().unwrap() * apart;
                let half = 0.5 * product.trace();
                half + (half * half - product.determinant()).max(0.0).sqrt()
            };
            let is_tight = |pair: [usize; 2]| (4.0..1e3).contains(&largest(pair));
            let pairs = found(&a, &smoother);
            for (pair, u) in pairs.moves() {
                let ((apart, together), u) = (resisted(pair), nalgebra::Vector2::from(u));
                assert!((FACTOR * u.dot(&(together * u)) - 1.0).abs() < 1e-4);
                let along = u.dot(&(apart * u)) / u.dot(&(together * u));
                // The power method leaves a fortieth at most, times tan² of an angle.
                assert!((0.95 * largest(pair)..1.0001 * largest(pair)).contains(&along), "{along}");
            }
            let mut found = nodes_of(&pairs);
            found.sort_unstable();
            let expected: Vec<_> = springs.iter().map(|&(ends, _)| ends).filter(|&ends| is_tight(ends)).collect();
            assert_eq!(found, expected, "{nodes} {domain}");
            count += found.len();
        }
    }
    assert!(count > 100, "{count}");
}

fn vector(blocks: &[[f32; 2]]) -> DVector<f64> {
    DVector::from_iterator(2 * blocks.len(), blocks.as_flattened().iter().map(|&entry| f64::from(entry)))
}

/// `x += w (wᵀ A w)⁻¹ wᵀ (b − A x)` for one pair after the other, w both nodes along u; afterwards in reverse order. Numbers are those of
/// the matrix that was taken over last.
#[test]
fn pairs_are_moved_as_a_whole_one_after_the_other() {
    let (nodes, mut seed) = (40, 5);
    // What single precision leaves, with the errors of a few products.
    let near = |found: &[[f32; 2]], expected: &DVector<f64>| {
        assert!((vector(found) - expected).amax() <= 2e-5 * expected.amax(), "{found:?} {expected}");
    };
    for domain in [nodes, 7] {
        let springs = springs(nodes, 3, &mut seed);
        let (a, smoother) = system(nodes, &springs, domain);
        let mut pairs = found(&a, &smoother);
        let softer: Vec<_> = springs.iter().map(|(ends, block)| (*ends, scaled(0.7, block))).collect();
        for matrix in [a, system(nodes, &softer, domain).0] {
            pairs.update(&matrix, FACTOR);
            let a = FACTOR * dense(&matrix, nodes);
            let mut moved = |nodes: usize| -> Vec<[f32; 2]> {
                (0..nodes).map(|_| [random(&mut seed) as f32, random(&mut seed) as f32]).collect()
            };
            let (b, mut x) = (moved(nodes), moved(nodes));
            let relax = |x: &mut DVector<f64>, (pair, along): &([usize; 2], [f64; 2])| {
                let of_row = |r: usize, _| if pair.contains(&(r / 2)) { along[r % 2] } else { 0.0 };
                let whole = DVector::from_fn(2 * nodes, of_row);
                let rest = whole.dot(&(vector(&b) - &a * &*x));
                x.axpy(rest / whole.dot(&(&a * &whole)), &whole, 1.0);
            };
            let order = pairs.moves();
            assert!(order.len() > 3);

            let mut expected = vector(&x);
            let mut r: Vec<[f32; 2]> = vec![[0.0; 2]; nodes];
            let rest = vector(&b) - &a * &expected;
            r.as_flattened_mut().iter_mut().zip(&rest).for_each(|(r, &rest)| *r = rest as f32);
            pairs.before(&b, &mut x, &mut r);
            order.iter().for_each(|pair| relax(&mut expected, pair));
            near(&x, &expected);
            // What is left is small beside what it is the difference of.
            assert!((vector(&r) - (vector(&b) - &a * &expected)).amax() <= 2e-5 * (&a * &expected).amax());

            let mut expected = vector(&x);
            pairs.after(&b, &mut x);
            order.iter().rev().for_each(|pair| relax(&mut expected, pair));
            near(&x, &expected);
        }
    }
}

/// A pair that resists less than nothing together stays where it is, and one that is too tight for single precision.
#[test]
fn a_pair_that_is_not_definite_or_too_tight_is_not_moved() {
    let (a, smoother) = system(2, &[([0, 1], [[5.0]])], 2);
    let mut pairs = found(&a, &smoother);
    assert_eq!(nodes_of(&pairs), [[0, 1]]);
    let mut indefinite = a;
    indefinite.values.iter_mut().flatten().flatten().for_each(|entry| *entry -= 4.0);
    let too_tight = system(2, &[([0, 1], [[1010.0]])], 2).0;
    for matrix in [indefinite, too_tight] {
        pairs.update(&matrix, FACTOR);
        let (b, mut x, mut r) = ([[1.0], [2.0]], [[0.5], [0.25]], [[0.0], [0.0]]);
        pairs.before(&b, &mut x, &mut r);
        pairs.after(&b, &mut x);
        assert_eq!((x, r), ([[0.5], [0.25]], [[0.0], [0.0]]));
    }
}
