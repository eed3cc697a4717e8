//! The rank as a theorem about the springs' directions at the stored positions.
//!
//! **From below.** `A = BᵀB` is formed and `A − τ = L D Lᵀ` has at most d − r negative pivots. With ε a bound of the rounding errors of the
//! factorization (`linear/certificate.rs`) and δ one of those of A, r singular values of B are at least
//!
//! ```text
//! σ_r ≥ √(τ − ε − δ),      δ = γ_{m+20} ‖|Bᵀ||B|‖₂,      ‖|Bᵀ||B|‖₂ ≤ ‖B‖₁ ‖B‖_∞ ≤ m 2√3,
//! ```
//!
//! m the most springs at a particle: entries of A are sums of at most m products, and a component of a unit vector takes at most seven roundings from
//! the positions (Higham 2002, 3.1 and 3.5).
//!
//! **From above.** On the span of d − r motions V (Courant and Fischer)
//!
//! ```text
//! σ_{r+1} ≤ ‖B V‖_F / σ_min(V),      σ_min(V)² ≥ 1 − ‖VᵀV − I‖_∞,
//! ```
//!
//! or by a second count, where V is not known. No computation with rounded numbers proves that a singular value is zero. What a body has in springs,
//! or in coordinates beside its rigid motions where nothing holds it, bounds its rank exactly: a rank proven from below that reaches this bound is
//! exact, and the other singular values are zero.

use super::Directions;
use crate::assembly::{BlockPattern, SymmetricMatrix};
use crate::eigen::{ShiftInvert, gamma};
use crate::error::Result;
use crate::linear::dot;
use crate::rigid::{Body, bodies};
use crate::system::{State, System};
use nalgebra::Vector3;
use std::sync::Arc;

/// Lengths whose squares neither underflow nor overflow.
const LENGTHS: std::ops::Range<f64> = 1e-140..1e150;

/// Proven bounds: r singular values of B are at least `above`, the others at most `below`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub above: f64,
    pub below: f64,
}

impl Bounds {
    pub const NONE: Self = Self { above: 0.0, below: f64::INFINITY };
}

impl Directions<'_> {
    /// `BᵀB`, and δ.
    pub(super) fn gram(&self) -> Result<(SymmetricMatrix, f64)> {
        let ends: Vec<[usize; 2]> = self.rows().map(|(_, ends, _)| ends).collect();
        let pattern = Arc::new(BlockPattern::new(self.system.dofs(), ends.iter().copied())?);
        let mut a = SymmetricMatrix::zeros(pattern);
        let mut springs = vec![0usize; self.system.particles()];
        for (_, [i, j], n) in self.rows() {
            let block = n * n.transpose();
            a.add_diagonal_block(i, &block);
            a.add_diagonal_block(j, &block);
            if let Some(slot) = a.pattern().slot(i, j) {
                a.add_block(slot, &-block);
            }
            springs[i] += 1;
            springs[j] += 1;
        }
        let most = springs.into_iter().max().unwrap_or(0);
        let is_exact = self.geometry.iter().all(|at| at.length == 0.0 || LENGTHS.contains(&at.length));
        let rounding = 3.5 * most as f64 * gamma(most + 20);
        Ok((a, if is_exact { rounding } else { f64::INFINITY }))
    }

    /// A bound above the d − r smallest singular values from as many motions, orthonormal to rounding.
    pub(super) fn most_stretch(&self, motions: &[Vec<f64>]) -> f64 {
        let dofs = self.system.dofs();
        let rounding = gamma(20);
        let mut squares = 0.0;
        for (_, [i, j], n) in self.rows() {
            for u in motions {
                let [ui, uj] = [i, j].map(|p| dofs.get(u, p));
                let size = n.abs().dot(&(ui.abs() + uj.abs()));
                squares += (n.dot(&(ui - uj)).abs() + rounding * size).powi(2);
            }
        }
        let unit = |k: usize, l: usize| f64::from(u8::from(k == l));
        let defect = |k: usize| {
            let row = (0..motions.len()).map(|l| (dot(&motions[k], &motions[l]) - unit(k, l)).abs());
            row.sum::<f64>() + motions.len() as f64 * 4.0 * gamma(dofs.len() + 4)
        };
        let defect = (0..motions.len()).map(defect).fold(0.0, f64::max);
        let up = 1.0 + gamma(self.row_count() * motions.len() + motions.len() + 20);
        let bound = (squares / (1.0 - defect * up)).sqrt() * up;
        if defect < 0.5 && bound.is_finite() { bound } else { f64::INFINITY }
    }
}

/// A bound below the r largest singular values by a count of the eigenvalues of `BᵀB` below `shift` or a little less; zero where no count proves it.
pub(super) fn least(search: &mut ShiftInvert<'_>, shift: f64, delta: f64, zeros: usize) -> f64 {
    // A pivot that almost vanishes at one shift does not at another.
    let mut bounds = (0..4).map(|k| shift * (1.0 - 0.07 * f64::from(k))).map(|shift| match search.below(shift) {
        Some(count) if count <= zeros => root_below(shift - search.count_error - delta),
        _ => 0.0,
    });
    bounds.find(|bound| *bound > 0.0).unwrap_or(0.0)
}

/// A number below the root of one computed by a few sums, zero if that is negative.
pub(super) fn root_below(square: f64) -> f64 {
    square.max(0.0).sqrt() * (1.0 - 8.0 * f64::EPSILON)
}

/// A number above the root of one computed by a few sums.
pub(super) fn root_above(square: f64) -> f64 {
    square.sqrt() * (1.0 + 8.0 * f64::EPSILON)
}

/// A rank that B does not exceed, exactly: by its springs and its coordinates in each body.
pub(super) fn largest_rank(system: &System, state: &State) -> usize {
    let bodies = bodies(system);
    let mut number = vec![usize::MAX; system.particles()];
    for (k, body) in bodies.iter().enumerate() {
        body.particles.iter().for_each(|&p| number[p] = k);
    }
    let mut springs = vec![0; bodies.len()];
    for (_, ends, _) in system.active() {
        if let Some(&p) = ends.iter().find(|&&p| number[p] != usize::MAX) {
            let [xi, xj] = ends.map(|end| state.positions[end]);
            springs[number[p]] += if xi == xj { system.dimension() } else { 1 };
        }
    }
    let coordinates = |body: &Body| body.particles.iter().map(|&p| system.dofs().rows(p).len()).sum::<usize>();
    let most =
        |(body, springs): (&Body, usize)| springs.min(coordinates(body) - rigid_motions_at_least(system, state, body));
    bodies.iter().zip(springs).map(most).sum()
}

/// Rigid motions that a body surely has: none where anything is held, else the dimension of the motions of its points, by a cross product that is not
/// rounding.
fn rigid_motions_at_least(system: &System, state: &State, body: &Body) -> usize {
    let dimension = system.dimension();
    let is_free = |&p: &usize| system.dofs().rows(p).len() == dimension;
    if !body.anchors.is_empty() || !body.particles.iter().all(is_free) {
        return 0;
    }
    let arms = || body.particles.iter().map(|&p| state.positions[p] - state.positions[body.particles[0]]);
    let longer = |longest: Vector3<f64>, arm: Vector3<f64>| if arm.norm() > longest.norm() { arm } else { longest };
    let longest = arms().fold(Vector3::zeros(), longer);
    let is_across = |arm: Vector3<f64>| arm.cross(&longest).norm() > 1e-14 * arm.norm() * longest.norm();
    match dimension {
        3 if arms().any(is_across) => 6,
        3 if longest.norm() > 0.0 => 5,
        2 if longest.norm() > 0.0 => 3,
        _ => dimension,
    }
}

#[cfg(test)]
mod tests {
    use super::super::mechanisms;
    use super::super::tests::framework;
    use super::*;
    use crate::force::SpringGeometry;
    use nalgebra::DMatrix;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand::{RngExt, SeedableRng};

    /// The rank of an integer matrix modulo a prime, which its rank is not below.
    fn rank_modulo_prime(mut rows: Vec<Vec<i128>>) -> usize {
        const P: i128 = (1 << 61) - 1;
        let power = |mut base: i128, mut exponent: i128| {
            let mut result = 1;
            while exponent > 0 {
                if exponent & 1 == 1 {
                    result = result * base % P;
                }
                base = base * base % P;
                exponent >>= 1;
            }
            result
        };
        let mut rank = 0;
        for column in 0..rows.first().map_or(0, Vec::len) {
            let Some(pivot) = (rank..rows.len()).find(|&row| rows[row][column].rem_euclid(P) != 0) else { continue };
            rows.swap(rank, pivot);
            let inverse = power(rows[rank][column].rem_euclid(P), P - 2);
            for row in rank + 1..rows.len() {
                let factor = rows[row][column].rem_euclid(P) * inverse % P;
                let above = rows[rank].clone();
                rows[row].iter_mut().zip(&above).for_each(|(x, y)| *x = (*x - factor * y) % P);
            }
            rank += 1;
        }
        rank
    }

    /// Random frameworks on few integer places, many of them degenerate. Rows of B times their lengths are integers: the rank is that of exact
    /// arithmetic wherever it is said to be, and bounds of the gap hold for the singular values, for both ways of computing them.
    #[test]
    fn proven_ranks_are_those_of_exact_arithmetic() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(2_011_973);
        let (mut exact, mut proven, mut cases) = (0, 0, 0);
        for trial in 0..400 {
            let (dimension, count) = (2 + trial % 2, rng.random_range(3..9));
            let mut place = || [0, 1, 2].map(|axis| if axis < dimension { rng.random_range(-2..3) } else { 0 });
            let mut places: Vec<[i32; 3]> = (0..count).map(|_| place()).collect();
            places.sort_unstable();
            places.dedup();
            let share = rng.random_range(0.3..1.0);
            let count = places.len();
            let bars: Vec<[usize; 2]> =
                (0..count).flat_map(|i| (0..i).map(move |j| [i, j])).filter(|_| rng.random_bool(share)).collect();
            let held: Vec<usize> = (0..count).filter(|_| rng.random_bool(0.1)).collect();
            let (system, state) =
                framework(dimension, &places.iter().map(|x| x.map(f64::from)).collect::<Vec<_>>(), &bars, &held);
            let dofs = system.dofs();
            let d = dofs.len();
            let integer = |&[i, j]: &[usize; 2]| {
                let mut row = vec![0i128; d];
                for (p, sign) in [(i, 1), (j, -1)] {
                    for (dof, axis) in dofs.rows(p).zip(dofs.free_axes(p).iter()) {
                        row[dof] = sign * i128::from(places[i][axis] - places[j][axis]);
                    }
                }
                row
            };
            let rows: Vec<Vec<i128>> = bars.iter().map(integer).collect();
            let rank = rank_modulo_prime(rows.clone());
            let length = |row: &Vec<i128>, [i, j]: [usize; 2]| {
                let square: i32 = (0..3).map(|axis| (places[i][axis] - places[j][axis]).pow(2)).sum();
                row.iter().map(|x| *x as f64 / f64::from(square).sqrt()).collect::<Vec<_>>()
            };
            let unit: Vec<Vec<f64>> = rows.iter().zip(&bars).map(|(row, ends)| length(row, *ends)).collect();
            let mut values: Vec<f64> = match d.min(bars.len()) {
                0 => Vec::new(),
                _ => DMatrix::from_fn(bars.len(), d, |s, k| unit[s][k]).singular_values().iter().copied().collect(),
            };
            values.sort_by(|a, b| b.total_cmp(a));
            let geometry = SpringGeometry::at(&system, &state).unwrap();
            let directions = Directions { system: &system, geometry: &geometry };
            if d > 0 && !bars.is_empty() {
                for bounds in [directions.dense().unwrap().bounds, directions.sparse().unwrap().bounds] {
                    let [kept, dropped] = [rank.checked_sub(1), Some(rank)].map(|k| k.and_then(|k| values.get(k)));
                    assert!(
                        kept.is_none_or(|kept| bounds.above <= *kept * (1.0 + 1e-12)),
                        "{trial}: {bounds:?} {values:?}"
                    );
                    assert!(
                        dropped.is_none_or(|dropped| bounds.below >= *dropped - 1e-14),
                        "{trial}: {bounds:?} {values:?}"
                    );
                }
            }
            let found = mechanisms(&system, &state).unwrap();
            assert_eq!(found.rank, rank, "{trial}");
            assert!(largest_rank(&system, &state) >= rank, "{trial}");
            assert!(found.proven || !found.rank_is_exact);
            (exact, proven) = (exact + usize::from(found.rank_is_exact), proven + usize::from(found.proven));
            cases += 1;
        }
        println!("{exact} ranks exact and {proven} gaps proven of {cases}");
        assert!(proven == cases && 2 * exact > cases && exact < cases, "{exact} {proven} {cases}");
    }

    /// By hand: what a bar, a braced square in the plane, a straight row in space, and bodies on supports can have.
    #[test]
    fn ranks_do_not_exceed_springs_or_coordinates() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let all: Vec<[usize; 2]> = (0..4).flat_map(|i| (0..i).map(move |j| [i, j])).collect();
        let row = [0.0, 1.0, 3.0, 4.0].map(|x| [x, 2.0 * x, -x]);
        let of = |dimension, places: &[[f64; 3]], bars: &[[usize; 2]], held: &[usize]| {
            let (system, state) = framework(dimension, places, bars, held);
            largest_rank(&system, &state)
        };
        assert_eq!(of(2, &square, &all, &[]), 8 - 3);
        assert_eq!(of(3, &square, &all, &[]), 6, "twelve coordinates, six of them rigid");
        assert_eq!(of(3, &row, &all, &[]), 6, "twelve coordinates, five of them rigid, and six springs");
        assert_eq!(of(1, &row.map(|x| [x[0], 0.0, 0.0]), &all, &[]), 4 - 1);
        assert_eq!(of(2, &square, &all, &[0, 1]), 4, "not more than coordinates");
        assert_eq!(of(2, &square, &all[..1], &[]), 1);
        assert_eq!(of(2, &square, &all, &[0, 1, 2, 3]), 0, "no coordinate");
    }

    /// A motion of known stretch; vectors that do not span what they should prove nothing.
    #[test]
    fn bounds_of_motions_are_above_their_stretch() {
        let (system, state) = framework(2, &[[0.0; 3], [3.0, 4.0, 0.0]], &[[0, 1]], &[0]);
        let geometry = SpringGeometry::at(&system, &state).unwrap();
        let directions = Directions { system: &system, geometry: &geometry };
        let bound = |motions: &[Vec<f64>]| directions.most_stretch(motions);
        assert!((0.6..0.6 + 1e-14).contains(&bound(&[vec![1.0, 0.0]])));
        assert!((1.0..1.0 + 2e-14).contains(&bound(&[vec![1.0, 0.0], vec![0.0, 1.0]])));
        assert!((1e-18..1e-14).contains(&bound(&[vec![0.8, -0.6]])));
        assert_eq!(bound(&[vec![1.0, 0.0], vec![1.0, 0.0]]), f64::INFINITY);
        assert_eq!(bound(&[vec![0.5, 0.0]]), f64::INFINITY);
        let (a, delta) = directions.gram().unwrap();
        assert!(a.iter().all(|(row, column, value)| (value - [0.6, 0.8][row] * [0.6, 0.8][column]).abs() <= delta));
        assert!((1e-16..1e-14).contains(&delta));
        let (system, state) = framework(2, &[[0.0; 3], [1e-150, 0.0, 0.0]], &[[0, 1]], &[0]);
        let geometry = SpringGeometry::at(&system, &state).unwrap();
        let (_, delta) = Directions { system: &system, geometry: &geometry }.gram().unwrap();
        assert_eq!(delta, f64::INFINITY, "squares of such a length underflow");
    }
}
