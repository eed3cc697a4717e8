//! Residuals on matrices that are hard, as ratios to what a backward stable method may leave, after the testers of LAPACK (Anderson et al.,
//! LAPACK Users' Guide, 1999; LAPACK Working Note 41): a ratio below 30 passes.
//!
//! ```text
//! factors         ‖A − L B Lᵀ‖ / (n ε ‖A‖)
//! solution        ‖b − A x‖ / (n ε ‖A‖ ‖x‖)
//! eigenpairs      ‖A φ − λ φ‖ / (n ε ‖A‖),     ‖ΦᵀΦ − I‖ / (n ε),     (min |λ − λ_dense| − residual) / (n ε ‖A‖)
//! ```
//!
//! Some ratios are shown and not judged. Without pivoting nothing keeps the errors of an indefinite matrix small, which the factorization says
//! of itself. Eigenpairs are computed to a tolerance; the claim is that the residual bounds the error, and that none is missing.

pub mod matrices;

use faer::Par;
use matrices::{Animal, dense};
use nalgebra::DMatrix;
use sprung::eigen::lowest;
use sprung::inspect::Inertia;
use sprung::linear::{
    BlockJacobi, CgOutcome, Cholesky, ConjugateGradient, DiagonalPart, Ldlt, PivotedLdlt, Pivoting, Preconditioner,
    norm,
};
use sprung::operator::LinearOperator;
use sprung::work::Work;

/// The threshold of LAPACK's testers.
pub const THRESHOLD: f64 = 30.0;

/// The result of one test: a ratio, or words where there is none.
#[derive(Debug, Clone, PartialEq)]
pub enum Tested {
    Ratio(f64),
    /// A ratio without a claim.
    Unclaimed(f64),
    /// The routine says itself that it cannot.
    Reported(&'static str),
    /// Wrong, without a word.
    Silent(String),
}

impl Tested {
    pub fn is_right(&self) -> bool {
        match self {
            Self::Ratio(ratio) => *ratio < THRESHOLD,
            Self::Unclaimed(_) | Self::Reported(_) => true,
            Self::Silent(_) => false,
        }
    }
}

/// The tests, in the order of their columns.
pub const TESTS: [&str; 10] = [
    "LLᵀ, solution",
    "LDLᵀ, factors",
    "LDLᵀ, solution",
    "LBLᵀ, factors",
    "inertia",
    "CG, residual over tolerance",
    "CG with block Jacobi",
    "eigenpairs",
    "orthogonality",
    "eigenvalues beyond the residual",
];

/// All tests on one matrix.
pub fn tests(animal: &Animal) -> [Tested; 10] {
    let [pairs, orthogonality, values] = eigenpairs(animal);
    [
        cholesky(animal),
        factors(animal, Pivoting::None),
        ldlt(animal),
        factors(animal, Pivoting::InSupernodes),
        inertia(animal),
        conjugate_gradients(animal, false),
        conjugate_gradients(animal, true),
        pairs,
        orthogonality,
        values,
    ]
}

/// `n ε ‖A‖`.
fn unit(animal: &Animal) -> f64 {
    animal.a.order() as f64 * f64::EPSILON * animal.norm
}

fn right_hand_side(animal: &Animal) -> Vec<f64> {
    (0..animal.a.order()).map(|row| (row as f64 * 12.9898).sin()).collect()
}

fn residual(animal: &Animal, b: &[f64], x: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; b.len()];
    animal.a.apply(x, &mut product);
    b.iter().zip(&product).map(|(b, product)| b - product).collect()
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most, x| if x.abs() <= most { most } else { x.abs() })
}

fn solution(animal: &Animal, solve: impl FnOnce(&mut [f64])) -> Tested {
    let b = right_hand_side(animal);
    let mut x = b.clone();
    solve(&mut x);
    claimed(animal, largest(&residual(animal, &b, &x)) / (unit(animal) * largest(&x)))
}

/// A ratio of a factorization, which is claimed to be small without negative eigenvalues beyond rounding.
fn claimed(animal: &Animal, ratio: f64) -> Tested {
    if animal.eigenvalues[0] > -unit(animal) { Tested::Ratio(ratio) } else { Tested::Unclaimed(ratio) }
}

/// Refuses what is indefinite, and what is definite only to rounding if it likes.
fn cholesky(animal: &Animal) -> Tested {
    let mut factorization = Cholesky::analyse(animal.a.pattern(), Par::Seq).expect("a small factor");
    match factorization.factor(&animal.a) {
        Ok(()) if animal.eigenvalues[0] < -unit(animal) => Tested::Silent("an indefinite matrix passes".into()),
        Ok(()) => solution(animal, |x| factorization.solve_in_place(x).unwrap_or_else(|_| x.fill(f64::NAN))),
        Err(_) if animal.is_definite() => Tested::Silent("a definite matrix is refused".into()),
        Err(_) => Tested::Reported("indefinite"),
    }
}

fn ldlt(animal: &Animal) -> Tested {
    let mut factorization = Ldlt::analyse(animal.a.pattern(), Par::Seq).expect("a small factor");
    match factorization.factor(&animal.a) {
        Ok(()) => solution(animal, |x| factorization.solve_in_place(x).unwrap_or_else(|_| x.fill(f64::NAN))),
        Err(_) => Tested::Reported("zero pivot"),
    }
}

fn factors(animal: &Animal, pivoting: Pivoting) -> Tested {
    const BLOCK: usize = 8;
    let n = animal.a.order();
    let mut factorization = PivotedLdlt::analyse(animal.a.pattern(), Par::Seq).expect("a small factor");
    factorization.factor(&animal.a, pivoting);
    let mut error = dense(&animal.a);
    for first in (0..n).step_by(BLOCK) {
        let unit = |row: usize| std::array::from_fn(|k| f64::from(u8::from(row == first + k)));
        let w: Vec<[f64; BLOCK]> = (0..n).map(unit).collect();
        let mut y = vec![[0.0; BLOCK]; n];
        factorization.multiply(&w, &mut y);
        for (row, y) in y.iter().enumerate() {
            for column in first..n.min(first + BLOCK) {
                error[(row, column)] -= y[column - first];
            }
        }
    }
    claimed(animal, row_sums(&error) / unit(animal))
}

fn row_sums(matrix: &DMatrix<f64>) -> f64 {
    largest(&matrix.row_iter().map(|row| row.iter().map(|x| x.abs()).sum()).collect::<Vec<f64>>())
}

/// Signs that dense eigenvalues beyond their rounding contradict are wrong; the ratio is the band that was left undecided, over `n ε`.
fn inertia(animal: &Animal) -> Tested {
    let found = Inertia::of(&animal.a).expect("a small factor");
    let count = |of: &dyn Fn(f64) -> bool| animal.eigenvalues.iter().filter(|&&value| of(value)).count();
    let rounding = unit(animal);
    let most = [count(&|value| value < rounding), count(&|value| value > -rounding)];
    if found.negative > most[0] || found.positive > most[1] {
        return Tested::Silent(format!("{found:?}"));
    }
    Tested::Ratio(found.band / (animal.a.order() as f64 * f64::EPSILON))
}

/// The tolerance of conjugate gradients.
const TOLERANCE: f64 = 1e-10;

fn conjugate_gradients(animal: &Animal, is_preconditioned: bool) -> Tested {
    let (n, b) = (animal.a.order(), right_hand_side(animal));
    let mut preconditioner = Preconditioner::Identity;
    if is_preconditioned {
        let mut blocks = BlockJacobi::new(DiagonalPart::Blocks, animal.a.dofs());
        if blocks.update(&animal.a).is_err() {
            return Tested::Reported("negative block");
        }
        preconditioner = Preconditioner::BlockJacobi(blocks);
    }
    let (mut method, mut x) = (ConjugateGradient::new(n, TOLERANCE), vec![0.0; n]);
    let report = method.solve(&animal.a, &mut preconditioner, &b, &mut x);
    let true_residual = norm(&residual(animal, &b, &x)) / norm(&b);
    match report.outcome {
        CgOutcome::Converged => Tested::Ratio(true_residual / TOLERANCE),
        CgOutcome::NegativeCurvature { .. } if animal.is_definite() => {
            Tested::Silent("negative curvature of a definite matrix".into())
        }
        CgOutcome::NegativeCurvature { .. } => Tested::Reported("negative curvature"),
        CgOutcome::Stagnated => Tested::Reported("stagnated"),
        CgOutcome::IterationLimit => Tested::Reported("limit"),
        _ => Tested::Reported("not finite"),
    }
}

/// Twelve pairs: residuals, which stop at the tolerance of the search; orthogonality; and distances to the dense spectrum beyond the
/// residuals that were reported. The count below the last pair must be that of the dense eigenvalues.
fn eigenpairs(animal: &Animal) -> [Tested; 3] {
    let (n, count) = (animal.a.order(), 12);
    let found = match lowest(&animal.a, None, count, Par::Seq, &mut Work::default()) {
        Ok(found) if found.complete => found,
        _ => return ["not counted"; 3].map(Tested::Reported),
    };
    let image = |pair: &sprung::eigen::Eigenpair| {
        let mut product = vec![0.0; n];
        animal.a.apply(&pair.vector, &mut product);
        product.iter_mut().zip(&pair.vector).for_each(|(y, x)| *y -= pair.value * x);
        norm(&product)
    };
    let residual = largest(&found.pairs.iter().map(image).collect::<Vec<_>>());
    let vectors = DMatrix::from_fn(n, found.pairs.len(), |row, k| found.pairs[k].vector[row]);
    let gram = vectors.transpose() * &vectors - DMatrix::identity(vectors.ncols(), vectors.ncols());
    let beyond = |pair: &sprung::eigen::Eigenpair| {
        let distances = animal.eigenvalues.iter().map(|value| (pair.value - value).abs());
        (distances.fold(f64::INFINITY, f64::min) - pair.residual).max(0.0)
    };
    let beyond = largest(&found.pairs.iter().map(beyond).collect::<Vec<_>>());
    let below = animal.eigenvalues.iter().filter(|&&value| value < found.counted_below - unit(animal)).count();
    let counted = found.pairs.iter().filter(|pair| pair.value < found.counted_below).count();
    let values = match below > counted {
        true => Tested::Silent(format!("{} missing", below - counted)),
        false => Tested::Ratio(beyond / unit(animal)),
    };
    let orthogonality = row_sums(&gram) / (n as f64 * f64::EPSILON);
    [Tested::Unclaimed(residual / unit(animal)), Tested::Ratio(orthogonality), values]
}
