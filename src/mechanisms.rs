//! Mechanisms and states of self-stress: the rank of the springs' directions.
//!
//! B has a row for every spring, n on the coordinates of one end and −n on those of the other, over the free degrees of freedom. `B u` is how fast
//! lengths change when particles move by u, and `Bᵀ t` the forces of tensions t. With s springs, d degrees of freedom and rank r there are
//!
//! ```text
//! d − r mechanisms, B u = 0 (rigid motions among them),      s − r states of self-stress, Bᵀ t = 0      (Calladine 1978)
//! ```
//!
//! A spring of zero length, which has no rest length, has the stiffness κ I: it resists in every direction and has a row for every axis, so that it
//! counts as one spring in s for each.
//!
//! **Rank.** A singular value is zero up to rounding, and not zero from 1e-9 of the largest on; one between the two leaves the rank undecided. Small
//! scenes are decomposed densely. Of large ones `BᵀB` is factored: the signs of the pivots of `BᵀB − τ` count the singular values below √τ, and
//! inverse iteration finds the mechanisms. With all rounding errors bounded the gap, and in many scenes the rank, is a theorem
//! (`mechanisms/proof.rs`).
//!
//! **Prestress.** A mechanism has no stiffness but that of tensions, `uᵀ(−K)u = Σ (T/l) |(I − nnᵀ)(uᵢ − uⱼ)|²`. Where that is positive for all
//! mechanisms but rigid motions, prestress makes the structure stiff (Calladine and Pellegrino 1991).

mod proof;

use crate::eigen::{Accuracy, Pencil, ShiftInvert};
use crate::error::{Error, Result};
use crate::force::SpringGeometry;
use crate::linear::{Ldlt, dot, norm};
use crate::memory;
use crate::modes::largest;
use crate::rigid::{combination, rigid_motions};
use crate::system::{DofMap, State, System};
use crate::work::Work;
use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::svd::{self, ComputeSvdVectors};
use faer::{Mat, Par};
use nalgebra::{DMatrix, SymmetricEigen, Vector3};
use proof::{Bounds, largest_rank, least, root_above, root_below};

/// The largest number of degrees of freedom, and of springs, for which B is decomposed densely.
const DENSE: usize = 1200;

const KEPT: f64 = 1e-9;

/// Mechanisms and states of self-stress of a system; see [`mechanisms`].
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Mechanisms {
    /// d.
    pub degrees_of_freedom: usize,
    /// s, springs between held particles among them.
    pub springs: usize,
    /// r.
    pub rank: usize,
    /// d − r, rigid motions among them.
    pub mechanisms: usize,
    /// Motions of whole bodies that constraints admit.
    pub rigid_motions: usize,
    /// s − r, where a spring of zero length counts as one for every axis.
    pub self_stresses: usize,
    /// The smallest singular value that counts as not zero, and the largest that does; NaN where there is none, or where it was only counted.
    pub gap: [f64; 2],
    /// Whether no singular value lies where rounding leaves it open.
    pub decided: bool,
    /// The gap is a theorem about the springs' directions at the stored positions, in exact arithmetic: r singular values are at least
    /// `proven_gap[0]`, and the others at most `proven_gap[1]`, which is smaller.
    pub proven: bool,
    /// Bounds of the gap with all rounding errors, no wider than `gap`: 0 and infinity where nothing is proven, NaN where there are no such values.
    pub proven_gap: [f64; 2],
    /// The rank is r in exact arithmetic: it is at least r, proven, and at most r, because there are no more springs, or no more coordinates beside
    /// rigid motions, in any body. No computation proves that other singular values are zero.
    pub rank_is_exact: bool,
    /// Whether prestress stiffens every mechanism that is not a rigid motion: by the tensions at hand, or, where nothing is strained, by the only
    /// state of self-stress. `None` without such mechanisms, or where there are several states to choose from.
    pub prestress_stable: Option<bool>,
    /// A basis of the mechanisms beside rigid motions, over the free degrees of freedom, as local as elimination makes it; fewer than all in large
    /// scenes with very many.
    #[serde(skip)]
    pub motions: Vec<Vec<f64>>,
    /// The particles that move in each of `motions`, ascending.
    pub movers: Vec<Vec<usize>>,
    /// A basis of the states of self-stress: a tension for every spring. Empty for large scenes. Of the force of a spring of zero length the first
    /// component is in its place, and the others follow behind all springs.
    #[serde(skip)]
    pub self_stress: Vec<Vec<f64>>,
    /// Pairs of particles between which springs remove mechanisms, chosen greedily. At least as many springs are needed as there are mechanisms
    /// beside rigid motions, so that a list of that length is a smallest one; it is shorter where no spring helps.
    pub added_springs: Vec<[usize; 2]>,
    #[serde(skip)]
    dofs: DofMap,
}

/// Why a stiffness matrix is singular: the mechanisms of a system at a state, and its states of self-stress.
///
/// # Errors
/// A state of another system; coincident ends of a spring; a matrix that is too large to factor.
///
/// # Examples
/// ```
/// use sprung::mechanisms::mechanisms;
/// use sprung::{Spring, SystemBuilder};
///
/// // A bar that hangs from a support can turn about it in two directions.
/// let mut builder = SystemBuilder::new();
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([1.0, 0.0, 0.0], 1.0);
/// builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 1.0, damping: 0.0 });
/// builder.hold(0);
/// let (system, state) = builder.build()?;
/// let found = mechanisms(&system, &state)?;
/// assert_eq!((found.rank, found.mechanisms, found.rigid_motions, found.self_stresses), (1, 2, 2, 0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn mechanisms(system: &System, state: &State) -> Result<Mechanisms> {
    state.check(system)?;
    let geometry = SpringGeometry::at(system, state)?;
    let directions = Directions { system, geometry: &geometry };
    let [d, s] = [system.dofs().len(), directions.row_count()];
    let NullSpaces { rank, gap, decided, bounds, motions, stresses, is_complete } =
        if d.max(s) <= DENSE { directions.dense()? } else { directions.sparse()? };
    let rigid = orthonormal(rigid_motions(system, &state.positions));
    let is_at_least = rank == 0 || bounds.above > 0.0;
    let rank_is_exact = is_at_least && rank == largest_rank(system, state);
    let below = if rank_is_exact { 0.0 } else { bounds.below };
    let mut result = Mechanisms {
        degrees_of_freedom: d,
        springs: system.springs().len(),
        rank,
        mechanisms: d - rank,
        // A scene that is straight but for rounding seems to resist a rotation about its line.
        rigid_motions: rigid.len().min(d - rank),
        self_stresses: s - rank,
        gap,
        decided: decided && rigid.len() <= d - rank,
        proven: is_at_least && (rank_is_exact || rank == d || below < bounds.above),
        proven_gap: [if rank == 0 { f64::NAN } else { bounds.above }, if rank == d { f64::NAN } else { below }],
        rank_is_exact,
        prestress_stable: None,
        motions: Vec::new(),
        movers: Vec::new(),
        self_stress: stresses,
        added_springs: Vec::new(),
        dofs: system.dofs().clone(),
    };
    let count = (d - rank).saturating_sub(rigid.len());
    // Very many motions of a large scene are only counted.
    if count == 0 || motions.is_empty() {
        return Ok(result);
    }
    let beside_rigid = orthonormal(without(&motions, &rigid));
    let knows_stresses = result.self_stress.len() == result.self_stresses;
    let is_stable = directions.prestress_stable(&beside_rigid, knows_stresses.then_some(&result.self_stress));
    result.prestress_stable = is_stable.filter(|_| is_complete);
    result.motions = localised(&motions, &rigid);
    result.movers = result.motions.iter().map(|motion| movers(system.dofs(), motion)).collect();
    if is_complete {
        result.added_springs = added_springs(system, state, beside_rigid, &result.movers);
    }
    Ok(result)
}

impl Mechanisms {
    /// The displacement of every particle in one of `motions`.
    pub fn shape(&self, motion: &[f64]) -> Vec<Vector3<f64>> {
        self.dofs.full(motion)
    }
}

struct NullSpaces {
    rank: usize,
    gap: [f64; 2],
    decided: bool,
    bounds: Bounds,
    /// An orthonormal basis of the null space of B, and of that of Bᵀ.
    motions: Vec<Vec<f64>>,
    stresses: Vec<Vec<f64>>,
    is_complete: bool,
}

#[derive(Clone, Copy)]
struct Directions<'a> {
    system: &'a System,
    geometry: &'a SpringGeometry,
}

impl Directions<'_> {
    /// The rows of springs between particles of which one is free: row, ends, n. A spring of zero length has its first row at its number, and the
    /// others behind the rows of all springs.
    fn rows(&self) -> impl Iterator<Item = (usize, [usize; 2], Vector3<f64>)> + '_ {
        let mut next = self.system.springs().len();
        self.geometry.springs(self.system).flat_map(move |((number, ends, _), at)| {
            let axes = if at.length == 0.0 { self.system.dimension() } else { 1 };
            let behind = next;
            next += axes - 1;
            (0..axes).map(move |axis| {
                let n = if at.length == 0.0 { Vector3::ith(axis, 1.0) } else { at.direction };
                (if axis == 0 { number } else { behind + axis - 1 }, ends, n)
            })
        })
    }

    /// The number of rows, those of springs between held particles among them.
    fn row_count(&self) -> usize {
        let collapsed = self.geometry.iter().filter(|at| at.length == 0.0).count();
        self.system.springs().len() + collapsed * (self.system.dimension() - 1)
    }

    /// `‖B u‖`.
    fn stretch(&self, u: &[f64]) -> f64 {
        let dofs = self.system.dofs();
        let rates = self.rows().map(|(_, [i, j], n)| n.dot(&(dofs.get(u, i) - dofs.get(u, j))));
        rates.map(|rate| rate.powi(2)).sum::<f64>().sqrt()
    }

    fn dense(&self) -> Result<NullSpaces> {
        let dofs = self.system.dofs();
        let [d, s] = [dofs.len(), self.row_count()];
        let mut b = Mat::<f64>::zeros(s, d);
        for (number, [i, j], n) in self.rows() {
            for (p, sign) in [(i, 1.0), (j, -1.0)] {
                for (row, axis) in dofs.rows(p).zip(dofs.free_axes(p).iter()) {
                    b[(number, row)] += sign * n[axis];
                }
            }
        }
        if d == 0 || s == 0 {
            let unit = |n: usize| (0..n).map(|k| (0..n).map(|l| f64::from(u8::from(k == l))).collect()).collect();
            let (gap, bounds, motions, stresses) = ([f64::NAN; 2], Bounds::NONE, unit(d), unit(s));
            return Ok(NullSpaces { rank: 0, gap, decided: true, bounds, motions, stresses, is_complete: true });
        }
        // Sequential: the bits must not depend on the number of threads.
        let full = ComputeSvdVectors::Full;
        let scratch = svd::svd_scratch::<f64>(s, d, full, full, Par::Seq, Default::default());
        memory::ensure(scratch.unaligned_bytes_required() as u64, "the singular value decomposition")?;
        let (mut u, mut v) = (Mat::<f64>::zeros(s, s), Mat::<f64>::zeros(d, d));
        let mut diagonal = Diag::<f64>::zeros(s.min(d));
        svd::svd(
            b.as_ref(),
            diagonal.as_mut(),
            Some(u.as_mut()),
            Some(v.as_mut()),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
            Default::default(),
        )
        .map_err(|_| Error::Unsupported("the singular values of the springs' directions did not converge".into()))?;
        let values: Vec<f64> = diagonal.column_vector().iter().copied().collect();
        let rounding = f64::EPSILON * d.max(s) as f64;
        let largest = values.first().copied().unwrap_or(0.0);
        let rank = values.iter().filter(|value| **value > largest * (rounding * KEPT).sqrt()).count();
        let gap = [rank.checked_sub(1), Some(rank)].map(|k| k.and_then(|k| values.get(k)).copied().unwrap_or(f64::NAN));
        let decided = rank == 0 || gap[0] >= KEPT * largest && (gap[1].is_nan() || gap[1] <= 10.0 * rounding * largest);
        let columns =
            |u: faer::MatRef<'_, f64>| (rank..u.ncols()).map(|k| u.col(k).iter().copied().collect()).collect();
        let motions: Vec<Vec<f64>> = columns(v.as_ref());
        let mut bounds = Bounds { below: self.most_stretch(&motions), ..Bounds::NONE };
        if rank > 0 {
            let (a, delta) = self.gram()?;
            let (mut factorization, mut work) = (Ldlt::analyse(a.pattern(), Par::Seq)?, Work::default());
            let mut search = ShiftInvert::new(Pencil::of(&a), &mut factorization, &mut work);
            bounds.above = least(&mut search, (0.5 * gap[0]).powi(2), delta, d - rank);
        }
        Ok(NullSpaces { rank, gap, decided, bounds, motions, stresses: columns(u.as_ref()), is_complete: true })
    }

    fn sparse(&self) -> Result<NullSpaces> {
        let system = self.system;
        let d = system.dofs().len();
        let (a, delta) = self.gram()?;
        let norm = Pencil::of(&a).norm();
        let largest = norm.sqrt();
        let mut work = Work::default();
        let mut factorization = Ldlt::analyse(a.pattern(), Par::rayon(0))?;
        let mut search = ShiftInvert::new(Pencil::of(&a), &mut factorization, &mut work);
        // Below rounding of BᵀB, and well above: the same number, and nothing lies between.
        let mut bounds = Bounds::NONE;
        let mut count = |search: &mut ShiftInvert<'_>, shift: f64| {
            let (count, shift) = search.below_about(shift * norm)?;
            let error = search.count_error + delta;
            bounds = Bounds { above: root_below(shift - error), below: bounds.below.min(root_above(shift + error)) };
            Some(count)
        };
        let [low, high] = [1e-13, 1e-9].map(|shift| count(&mut search, shift));
        let zeros = low.or(high).unwrap_or(d);
        let (mut gap, mut decided) = ([f64::NAN; 2], low.is_some() && low == high);
        let mut motions = Vec::new();
        let mut found = zeros;
        if zeros <= 100 {
            let pairs = search.lowest((zeros + 1).min(d), Accuracy::FULL);
            let complete = search.edge.is_some();
            let sizes: Vec<f64> = pairs.iter().map(|pair| self.stretch(&pair.vector)).collect();
            // Vectors computed by inverse iteration have 1e-12 by rounding.
            found = sizes.iter().filter(|size| **size <= (1e-12 * KEPT).sqrt() * largest).count();
            let (dropped, kept) = sizes.split_at(found);
            // The minimum and the maximum with a NaN are those of the other number.
            gap = [kept.iter().copied().fold(f64::NAN, f64::min), dropped.iter().copied().fold(f64::NAN, f64::max)];
            decided =
                complete && (found == d || gap[0] >= KEPT * largest) && (gap[1].is_nan() || gap[1] <= 1e-10 * largest);
            let edge = search.edge.filter(|edge| pairs.iter().filter(|pair| pair.value < *edge).count() <= found);
            bounds.above = edge.map_or(0.0, |edge| root_below(edge - search.count_error - delta));
            motions = pairs.into_iter().take(found).map(|pair| pair.vector).collect();
        }
        let is_complete = motions.len() == found;
        let motions = orthonormal(motions);
        if motions.len() == found {
            bounds.below = self.most_stretch(&motions);
        } else if low != high {
            bounds = Bounds::NONE;
        }
        Ok(NullSpaces { rank: d - found, gap, decided, bounds, motions, stresses: Vec::new(), is_complete })
    }

    /// Whether tensions stiffen all motions of a set: those at hand, or else the only state of self-stress, where these states are known.
    fn prestress_stable(&self, motions: &[Vec<f64>], stresses: Option<&Vec<Vec<f64>>>) -> Option<bool> {
        let springs = || self.geometry.springs(self.system);
        let tensions: Vec<f64> = springs().map(|((.., spring), at)| spring.stiffness * spring.strain(at)).collect();
        let stiffest = springs().map(|((.., spring), _)| spring.stiffness).fold(0.0, f64::max);
        if tensions.iter().any(|tension| tension.abs() > 1e-9 * stiffest) {
            return Some(self.stiffens(&tensions, motions));
        }
        match stresses?.as_slice() {
            [] => Some(false),
            [stress] => Some([1.0, -1.0].iter().any(|sign| {
                let tensions: Vec<f64> = springs().map(|((number, ..), _)| sign * stress[number]).collect();
                self.stiffens(&tensions, motions)
            })),
            _ => None,
        }
    }

    /// Whether `Uᵀ(−K)U` is positive definite for the tensions of the active springs.
    fn stiffens(&self, tensions: &[f64], motions: &[Vec<f64>]) -> bool {
        let dofs = self.system.dofs();
        let mut form = DMatrix::<f64>::zeros(motions.len(), motions.len());
        let mut scale = 0.0f64;
        // Mechanisms do not part the ends of springs of zero length.
        let springs = self.geometry.springs(self.system).zip(tensions).filter(|((_, at), _)| at.length > 0.0);
        for (((_, [i, j], _), at), tension) in springs {
            let n = at.direction;
            let across = |u: &Vec<f64>| {
                let between = dofs.get(u, i) - dofs.get(u, j);
                between - n * n.dot(&between)
            };
            let across: Vec<Vector3<f64>> = motions.iter().map(across).collect();
            scale = scale.max((tension / at.length).abs());
            for (k, a) in across.iter().enumerate() {
                for (l, b) in across.iter().enumerate() {
                    form[(k, l)] += tension / at.length * a.dot(b);
                }
            }
        }
        form.is_empty() || form.symmetric_eigenvalues().min() > 1e-9 * scale
    }
}

/// Takes the parts in an orthonormal basis out of a vector, by Gram and Schmidt, twice.
fn subtract_parts(vector: &mut [f64], basis: &[Vec<f64>]) {
    for other in basis.iter().chain(basis) {
        let part = dot(other, vector);
        vector.iter_mut().zip(other).for_each(|(u, v)| *u -= part * v);
    }
}

fn orthonormal(vectors: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for mut vector in vectors {
        let before = norm(&vector);
        subtract_parts(&mut vector, &basis);
        let length = norm(&vector);
        if length > 1e-8 * before {
            vector.iter_mut().for_each(|u| *u /= length);
            basis.push(vector);
        }
    }
    basis
}

/// A basis of what vectors leave when their parts in an orthonormal basis are taken out: by the eigenvectors of their inner products.
fn without(vectors: &[Vec<f64>], basis: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut rest = vectors.to_vec();
    rest.iter_mut().for_each(|vector| subtract_parts(vector, basis));
    let gram = DMatrix::from_fn(rest.len(), rest.len(), |k, l| dot(&rest[k], &rest[l]));
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(gram);
    let kept = (0..rest.len()).filter(|&k| eigenvalues[k] > 1e-6);
    kept.map(|k| combination(&rest, eigenvectors.column(k))).collect()
}

/// The same space beside rigid motions with vectors as local as elimination makes them. Rigid motions are eliminated first, each by a coordinate at
/// which it is largest, so that the others are relative to a body that is held there; then every vector from all others at its own largest
/// coordinate.
fn localised(motions: &[Vec<f64>], rigid: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut all: Vec<Vec<f64>> = rigid.iter().chain(motions).cloned().collect();
    let mut open: Vec<usize> = (0..all.len()).collect();
    let mut kept = Vec::new();
    for step in 0..all.len() {
        let candidates = || open.iter().copied().filter(|&k| step >= rigid.len() || k < rigid.len());
        // Of those that are equal but for rounding the first.
        let larger = |a: (usize, f64), b: (usize, f64)| if b.1 > 1.000_001 * a.1 { b } else { a };
        let largest = |k: usize| all[k].iter().map(|u| u.abs()).enumerate().fold((0, 0.0), larger);
        let Some((k, _)) = candidates().map(|k| (k, largest(k).1)).reduce(larger) else { break };
        let (row, size) = largest(k);
        // What is left of vectors that depend on those before is rounding.
        if size < 1e-7 {
            break;
        }
        let pivot: Vec<f64> = all[k].iter().map(|u| u / all[k][row]).collect();
        for (l, other) in all.iter_mut().enumerate().filter(|(l, _)| *l != k) {
            // Rigid motions that are done stay.
            let factor = other[row];
            if factor != 0.0 && !(l < rigid.len() && step >= rigid.len()) {
                other.iter_mut().zip(&pivot).for_each(|(u, v)| *u -= factor * v);
                other[row] = 0.0;
            }
        }
        all[k] = pivot;
        open.retain(|&other| other != k);
        if k >= rigid.len() {
            kept.push(k);
        }
    }
    kept.into_iter().map(|k| all[k].iter().map(|u| if u.abs() < 1e-9 { 0.0 } else { *u }).collect()).collect()
}

fn movers(dofs: &DofMap, motion: &[f64]) -> Vec<usize> {
    let largest = largest(motion);
    (0..dofs.particles()).filter(|&p| dofs.get(motion, p).amax() > 1e-6 * largest).collect()
}

/// Springs that take mechanisms away one by one: each between the pair whose length changes fastest under what is left, of the first 400 particles.
fn added_springs(system: &System, state: &State, mut motions: Vec<Vec<f64>>, movers: &[Vec<usize>]) -> Vec<[usize; 2]> {
    let mut members: Vec<usize> = movers.concat();
    members.extend(system.pairs().iter().flatten().map(|&p| p as usize));
    members.sort_unstable();
    members.dedup();
    members.truncate(400);
    let dofs = system.dofs();
    let joined: std::collections::HashSet<[usize; 2]> =
        system.pairs().iter().map(|&[i, j]| [i.min(j) as usize, i.max(j) as usize]).collect();
    let mut added = Vec::new();
    while !motions.is_empty() {
        let mut best: (f64, [usize; 2], Vec<f64>) = (1e-6, [0, 0], Vec::new());
        for (k, &i) in members.iter().enumerate() {
            for &j in members[..k].iter().filter(|&&j| !joined.contains(&[i.min(j), i.max(j)])) {
                let between = state.positions[i] - state.positions[j];
                let Some(n) = between.try_normalize(0.0) else { continue };
                let rates: Vec<f64> = motions.iter().map(|u| n.dot(&(dofs.get(u, i) - dofs.get(u, j)))).collect();
                let size = norm(&rates);
                if size > 1.000_001 * best.0 {
                    best = (size, [j.min(i), i.max(j)], rates);
                }
            }
        }
        let (size, pair, rates) = best;
        if rates.is_empty() {
            break;
        }
        added.push(pair);
        // What is left is orthogonal to the rates: a Householder reflection takes them to the first axis, which goes.
        let sign = if rates[0] < 0.0 { -1.0 } else { 1.0 };
        let mut v = rates;
        v[0] += sign * size;
        let scale = 2.0 / dot(&v, &v);
        let sum = combination(&motions, &v);
        for (motion, factor) in motions.iter_mut().zip(&v) {
            motion.iter_mut().zip(&sum).for_each(|(u, sum)| *u -= scale * factor * sum);
        }
        motions.remove(0);
    }
    added
}

#[cfg(test)]
mod tests;
