//! Matrices that are hard on factorizations, conjugate gradients and eigensolvers.

use nalgebra::{DMatrix, Matrix3, SymmetricEigen};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::DofMap;
use sprung::assembly::{BlockPattern, SymmetricMatrix};
use sprung::operator::LinearOperator;
use std::sync::Arc;

/// A matrix with a name.
pub struct Animal {
    pub name: &'static str,
    pub a: SymmetricMatrix,
    /// Ascending, by a dense decomposition.
    pub eigenvalues: Vec<f64>,
    /// The row sum norm.
    pub norm: f64,
}

impl Animal {
    fn new(name: &'static str, a: SymmetricMatrix) -> Self {
        let mut eigenvalues: Vec<f64> = SymmetricEigen::new(dense(&a)).eigenvalues.iter().copied().collect();
        eigenvalues.sort_by(f64::total_cmp);
        let norm = a.norm_inf(&mut vec![0.0; a.order()]);
        Self { name, a, eigenvalues, norm }
    }

    /// Whether all eigenvalues are above what factorization in place of A may lose.
    pub fn is_definite(&self) -> bool {
        self.eigenvalues[0] > 10.0 * self.a.order() as f64 * f64::EPSILON * self.norm
    }
}

pub fn dense(a: &SymmetricMatrix) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(a.order(), a.order());
    for (row, column, value) in a.iter() {
        matrix[(row, column)] = value;
        matrix[(column, row)] = value;
    }
    matrix
}

/// A matrix on the pattern of a graph, from the block of every vertex and of every edge.
fn of_blocks(
    vertices: usize,
    edges: &[[usize; 2]],
    mut vertex: impl FnMut(usize) -> Matrix3<f64>,
    mut edge: impl FnMut(usize, usize) -> Matrix3<f64>,
) -> SymmetricMatrix {
    let pattern = BlockPattern::new(&DofMap::unconstrained(vertices), edges.iter().copied()).expect("a small pattern");
    let mut a = SymmetricMatrix::zeros(Arc::new(pattern));
    (0..vertices).for_each(|p| a.add_diagonal_block(p, &vertex(p)));
    for &[i, j] in edges {
        let block = edge(i, j);
        if let Some(slot) = a.pattern().slot(i, j) {
            a.add_block(slot, &block);
        }
    }
    a
}

/// `shift I + Σ w (e_i − e_j)(e_i − e_j)ᵀ ⊗ B` over the edges: a stiffness matrix, with B a spring's block.
fn stiffness(
    vertices: usize,
    edges: &[[usize; 2]],
    shift: f64,
    mut spring: impl FnMut(usize, usize) -> Matrix3<f64>,
) -> SymmetricMatrix {
    let blocks: Vec<Matrix3<f64>> = edges.iter().map(|&[i, j]| spring(i, j)).collect();
    let at = |p: usize| {
        let ends = edges.iter().zip(&blocks).filter(|(edge, _)| edge.contains(&p));
        ends.fold(Matrix3::from_diagonal_element(shift), |sum, (_, block)| sum + block)
    };
    let between = |i: usize, j: usize| {
        let number = edges.iter().position(|edge| *edge == [i, j]).unwrap_or(0);
        -blocks[number]
    };
    of_blocks(vertices, edges, at, between)
}

/// A chain, a grid of five columns with diagonals, a star, and all pairs.
fn chain(n: usize) -> Vec<[usize; 2]> {
    (1..n).map(|p| [p, p - 1]).collect()
}

fn grid(n: usize) -> Vec<[usize; 2]> {
    let side = |p: usize| (!p.is_multiple_of(5)).then(|| [p, p - 1]);
    let up = |p: usize| (p >= 5).then(|| [p, p - 5]);
    let across = |p: usize| (p >= 5 && !p.is_multiple_of(5)).then(|| [p, p - 6]);
    (0..n).flat_map(|p| [side(p), up(p), across(p)]).flatten().collect()
}

fn star(n: usize) -> Vec<[usize; 2]> {
    (1..n).map(|p| [p, 0]).collect()
}

fn complete(n: usize) -> Vec<[usize; 2]> {
    (1..n).flat_map(|p| (0..p).map(move |q| [p, q])).collect()
}

/// All matrices, of 12 to 360 rows.
pub fn all() -> Vec<Animal> {
    let mut rng = ChaCha8Rng::seed_from_u64(73);
    // Springs in random directions, with a tenth of the stiffness across.
    let mut spring = move |across: f64| {
        let n = nalgebra::Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0f64)).normalize();
        let axial = n * n.transpose();
        axial + (Matrix3::identity() - axial) * across
    };
    let mut zoo = Vec::new();
    let mut add = |name, a| zoo.push(Animal::new(name, a));

    add("well-conditioned grid", stiffness(100, &grid(100), 1.0, |_, _| spring(0.1)));
    let grading = |row: usize, n: usize, decades: f64| 10f64.powf(-decades * row as f64 / n as f64);
    for (name, decades, is_reversed) in
        [("graded downwards over 16 decades", 8.0, false), ("graded upwards over 16 decades", 8.0, true)]
    {
        let mut a = stiffness(100, &grid(100), 1.0, |_, _| spring(0.1));
        let scales: Vec<f64> =
            (0..300).map(|row| grading(if is_reversed { 299 - row } else { row }, 300, decades)).collect();
        a.scale(&scales).expect("as many as rows");
        add(name, a);
    }
    add("nearly singular: free, and 1e-13", stiffness(60, &grid(60), 1e-13, |_, _| spring(0.1)));
    add("singular: free", stiffness(60, &grid(60), 0.0, |_, _| spring(0.1)));
    add("condition of 1e13: stiffnesses 1e12 apart", {
        stiffness(80, &grid(80), 0.1, |i, _| spring(0.1) * 10f64.powi((i % 13) as i32))
    });
    add("hub: a star of 120", stiffness(120, &star(120), 1e-3, |_, _| spring(1.0)));
    add("hub, stiff: a star of 120, 1e8 times its rest", stiffness(120, &star(120), 1.0, |_, _| spring(1.0) * 1e8));
    add("long chain of 120", stiffness(120, &chain(120), 1e-6, |_, _| spring(1.0)));
    add("long chain of 120 with a stiff half", {
        stiffness(120, &chain(120), 1e-6, |i, _| spring(1.0) * if i < 60 { 1e9 } else { 1.0 })
    });
    add("clustered at 1, within 1e-10", stiffness(80, &grid(80), 1.0, |_, _| spring(0.1) * 1e-11));
    let copies: Vec<[usize; 2]> = (0..30).flat_map(|k| [[3 * k + 1, 3 * k], [3 * k + 2, 3 * k + 1]]).collect();
    let block = spring(0.5);
    add("thirty copies: every eigenvalue thirty times", stiffness(90, &copies, 0.5, |_, _| block));
    let links: Vec<[usize; 2]> = copies.iter().copied().chain((1..30).map(|k| [3 * k, 3 * k - 1])).collect();
    add("thirty copies, joined by 1e-12", {
        stiffness(90, &links, 0.5, |i, j| if i / 3 == j / 3 { block } else { Matrix3::identity() * 1e-12 })
    });
    add("Wilkinson's W₂₁⁺, nine of them, glued by 1e-8", {
        let diagonal = |row: usize| ((row % 21) as f64 - 10.0).abs();
        let beside = |row: usize, column: usize| match row.abs_diff(column) {
            1 => {
                if row.max(column).is_multiple_of(21) {
                    1e-8
                } else {
                    1.0
                }
            }
            _ => 0.0,
        };
        let entry = move |row: usize, column: usize| if row == column { diagonal(row) } else { beside(row, column) };
        let at = |p: usize| Matrix3::from_fn(|r, c| entry(3 * p + r, 3 * p + c));
        of_blocks(63, &chain(63), at, |i, j| Matrix3::from_fn(|r, c| entry(3 * i + r, 3 * j + c)))
    });
    add("Hilbert's, of order 12", {
        let entry = |row: usize, column: usize| 1.0 / (row + column + 1) as f64;
        let at = |p: usize| Matrix3::from_fn(|r, c| entry(3 * p + r, 3 * p + c));
        of_blocks(4, &complete(4), at, |i, j| Matrix3::from_fn(|r, c| entry(3 * i + r, 3 * j + c)))
    });
    add("indefinite: pressed grid", stiffness(100, &grid(100), 0.3, |_, _| spring(-0.4)));
    add("indefinite: tiny pivots", {
        let at = |_| Matrix3::from_diagonal_element(1e-9);
        of_blocks(90, &grid(90), at, |_, _| spring(0.3))
    });
    add("saddle points: zero diagonal in a third of the rows", {
        let at = |_| Matrix3::new(2.0, 0.3, 1.0, 0.3, 3.0, 0.7, 1.0, 0.7, 0.0);
        of_blocks(90, &grid(90), at, |_, _| spring(0.2) * 0.2)
    });
    for (name, factor) in [("grid times 1e-150", 1e-150), ("grid times 1e150", 1e150)] {
        let mut a = stiffness(60, &grid(60), 1.0, |_, _| spring(0.1));
        a.scale(&vec![f64::sqrt(factor); a.order()]).expect("as many as rows");
        add(name, a);
    }
    zoo
}
