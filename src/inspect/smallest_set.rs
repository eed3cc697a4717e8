//! A smallest set of springs whose transverse terms must be dropped to make A positive definite.
//!
//! Let F be a *sufficient* set: without the transverse terms of its springs, A_F is positive definite. Putting back the terms of some springs s of F
//! subtracts `N_s N_sᵀ`, N_s having a column `√c (t at i, −t at j)` for each direction t across the spring, with `c = k(1/l − 1/l0)`. By Schur's
//! complement
//!
//! ```text
//! A_F − Σ N_s N_sᵀ  is positive definite   ⇔   I − Nᵀ A_F⁻¹ N  is,
//! ```
//!
//! a small dense matrix: one sparse factorization and a solve a column, and every question about subsets of F is cheap.
//!
//! **From below.** Where the springs that every sufficient set must hold (`necessary`) are sufficient, by one factorization, they are the smallest
//! set.
//!
//! **From above.** A sufficient set comes from the local condition of [`Regularization`]; where it is too large, three halvings narrow it.
//!
//! **The search** in that small matrix is greedy. All terms are put back; while the rest is not positive definite, the one with the largest part in
//! the worst eigenvector of `H = Nᵀ A_F⁻¹ N` is dropped; in the end each dropped one is put back if that does no harm, the last one first. The other
//! way round, all are dropped and put back one by one, the weakest first. The smaller of both sets is *irredundant*: none of its springs can be
//! spared. It need not be of least size, which is as hard to find as a set cover.

use super::inertia::InertiaCounter;
use super::necessary::{Column, NECESSARY, Necessity, fewest};
use super::oracle::Oracle;
use crate::error::Result;
use crate::force::SpringGeometry;
use crate::integrate::Regularization;
use crate::linear::{SOLVE_COLUMNS, norm};
use crate::operator::{Combination, SystemOperator};
use crate::spring::{Spring, Stiffness};
use crate::system::System;
use crate::work::Work;
use faer::Par;
use nalgebra::{Cholesky, DMatrix, DVector, Vector3};

/// A set of springs without whose transverse terms A is positive definite, proven by a factorization.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct DropSet {
    /// The springs; where the set is irredundant, in the order of their parts in the negative curvature.
    pub springs: Vec<usize>,
    /// The minimality of the set.
    pub minimality: Minimality,
    /// A proven lower bound for the size of such a set.
    pub at_least: usize,
    /// The number of springs that option II (`tension`) drops: all that are compressed.
    #[serde(rename = "tension_drops")]
    pub tension: usize,
}

impl DropSet {
    /// No smaller set is sufficient, proven.
    pub fn is_smallest(&self) -> bool {
        self.springs.len() <= self.at_least
    }
}

/// Multiplications of the solves of one search, and of its dense factorizations: a few seconds.
const MOST_MULTIPLICATIONS: f64 = 2e10;

/// Finds a smallest set for a step of length dt, where A under `Full` is indefinite (empty where it is not).
///
/// # Errors
/// A matrix that is too large.
pub fn smallest_set(
    system: &System,
    extensions: &SpringGeometry,
    dt: f64,
    par: Par,
    work: &mut Work,
) -> Result<DropSet> {
    let oracle = Oracle::analyse(system, par, work)?;
    let counter = &mut InertiaCounter::sharing(&oracle.factorization)?;
    Ok(search(Trial::new(system, extensions, dt, oracle), 0, counter, work))
}

/// As [`smallest_set`]; A may be known to have negative eigenvalues.
pub(super) fn search(mut trial: Trial<'_>, negative: usize, counter: &mut InertiaCounter, work: &mut Work) -> DropSet {
    let (system, extensions) = (trial.system, trial.extensions);
    let set = |positions: &[usize], minimality, at_least| {
        let springs = positions.iter().map(|&p| system.active_springs()[p] as usize).collect();
        DropSet { springs, minimality, at_least, tension: extensions.compressed(system) }
    };
    if negative == 0 && trial.is_definite(&[], work) {
        return set(&[], Minimality::Irredundant, 0);
    }
    let terms = trial.terms();
    let is_necessary = |p: &usize| terms[*p].need >= NECESSARY;
    let necessary: Vec<usize> = (0..terms.len()).filter(is_necessary).collect();
    let mut at_least = fewest(negative.max(1), terms.iter().map(|term| term.rank)).max(necessary.len());
    if !necessary.is_empty() {
        if trial.is_definite(&necessary, work) {
            return set(&necessary, Minimality::Irredundant, necessary.len());
        }
        let left = counter.count(trial.oracle.matrix.matrix(), work).negative.max(1);
        let others = terms.iter().filter(|term| term.need < NECESSARY).map(|term| term.rank);
        at_least = at_least.max(necessary.len() + fewest(left, others));
    }
    let Some(enough) = trial.enough(&necessary, &terms, work) else {
        let all: Vec<usize> = (0..trial.taken.len()).filter(|&p| trial.taken[p] > 0.0).collect();
        return set(&all, Minimality::Enough, at_least);
    };
    if !is_affordable(enough.len(), trial.oracle.factorization.size().entries) {
        return set(&enough, Minimality::Enough, at_least);
    }
    let (chosen, minimality) = trial.irredundant(&enough, work);
    // A factorization of A itself proves it.
    match trial.is_definite(&chosen, work) {
        true => set(&chosen, minimality, at_least),
        false => set(&enough, Minimality::Enough, at_least),
    }
}

fn is_affordable(springs: usize, entries: usize) -> bool {
    springs <= ((MOST_MULTIPLICATIONS / (4.0 * entries as f64)) as usize).clamp(32, 500)
}

#[derive(Debug, Clone, Copy)]
struct Term {
    rank: usize,
    need: f64,
}

/// A with chosen transverse terms dropped. Springs are named by their position among the active ones.
pub(super) struct Trial<'s> {
    system: &'s System,
    extensions: &'s SpringGeometry,
    combination: Combination,
    operator: SystemOperator<'s>,
    oracle: Oracle,
    /// c of every active spring; zero where it is stretched.
    taken: Vec<f64>,
}

impl<'s> Trial<'s> {
    pub fn new(system: &'s System, extensions: &'s SpringGeometry, dt: f64, oracle: Oracle) -> Self {
        let combination = Combination::step(dt);
        let operator = SystemOperator::new(system, extensions, Stiffness::Full, combination);
        let block = |spring: &Spring, at| spring.stiffness_block(at, Stiffness::Full);
        let taken = extensions.springs(system).map(|((_, _, spring), at)| (-block(spring, at).transverse).max(0.0));
        Self { system, extensions, combination, operator, oracle, taken: taken.collect() }
    }

    fn is_definite(&mut self, dropped: &[usize], work: &mut Work) -> bool {
        let mut options = vec![Stiffness::Full; self.taken.len()];
        dropped.iter().for_each(|&position| options[position] = Stiffness::Tension);
        self.operator.update_each(self.extensions, self.combination, |position| options[position]);
        self.oracle.is_definite(&self.operator, work)
    }

    fn terms(&mut self) -> Vec<Term> {
        self.operator.update(self.extensions, Stiffness::Tension, self.combination);
        let necessity = Necessity { operator: &self.operator, pattern: &self.oracle.pattern };
        let term = |(position, &spring): (usize, &u32)| match self.taken[position] > 0.0 {
            false => Term { rank: 0, need: 0.0 },
            true => {
                let (columns, _) = self.columns(&[position]);
                let need = necessity.need(self.system.pair(spring as usize), &columns);
                Term { rank: columns.len(), need }
            }
        };
        self.system.active_springs().iter().enumerate().map(term).collect()
    }

    /// A sufficient set: the necessary springs and those nearest to it; `None` where rounding hides one.
    fn enough(&mut self, necessary: &[usize], terms: &[Term], work: &mut Work) -> Option<Vec<usize>> {
        let mut softening = Regularization::new(self.system);
        softening.choose(self.system, self.extensions, self.combination).ok()?;
        let options = softening.options();
        let is_new = |p: &usize| options[*p] == Stiffness::Tension && terms[*p].need < NECESSARY;
        let mut others: Vec<usize> = (0..options.len()).filter(is_new).collect();
        others.sort_by(|&a, &b| terms[b].need.total_cmp(&terms[a].need).then(a.cmp(&b)));
        let mut local = [necessary, &others].concat();
        if local.len() > 128 {
            let (mut refused, mut accepted) = (necessary.len(), local.len());
            let mut is_factored = false;
            for _ in 0..3 {
                if accepted - refused <= 1 + accepted / 16 {
                    break;
                }
                let middle = refused.midpoint(accepted);
                is_factored = self.is_definite(&local[..middle], work);
                match is_factored {
                    true => accepted = middle,
                    false => refused = middle,
                }
            }
            local.truncate(accepted);
            if is_factored {
                return Some(local);
            }
        }
        self.is_definite(&local, work).then_some(local)
    }

    /// An irredundant part of a sufficient set whose factorization is at hand.
    fn irredundant(&mut self, enough: &[usize], work: &mut Work) -> (Vec<usize>, Minimality) {
        let (columns, owners) = self.columns(enough);
        let n = self.system.dofs().len();
        let mut h = DMatrix::zeros(columns.len(), columns.len());
        for (group, together) in columns.chunks(SOLVE_COLUMNS).enumerate() {
            let mut z = vec![0.0; n * together.len()];
            for (column, z) in together.iter().zip(z.chunks_mut(n)) {
                column.iter().for_each(|&(row, value)| z[row] = value);
            }
            self.oracle.factorization.substitute_columns(n, &mut z);
            work.solves += together.len() as u64;
            for (c, z) in z.chunks(n).enumerate() {
                for (r, row) in columns.iter().enumerate() {
                    h[(r, group * SOLVE_COLUMNS + c)] = row.iter().map(|&(index, value)| value * z[index]).sum::<f64>();
                }
            }
        }
        let (order, minimality) = choose(&h, &owners, enough.len(), MOST_MULTIPLICATIONS);
        (order.into_iter().map(|k| enough[k]).collect(), minimality)
    }

    /// The columns of N for the given springs, as (row, value), and the index of the spring that each belongs to.
    fn columns(&self, springs: &[usize]) -> (Vec<Column>, Vec<usize>) {
        let dofs = self.system.dofs();
        let (mut columns, mut owners) = (Vec::new(), Vec::new());
        for (owner, &position) in springs.iter().enumerate() {
            let ends = self.system.pair(self.system.active_springs()[position] as usize);
            let root = self.taken[position].sqrt();
            for t in across(&self.extensions.as_slice()[position].direction) {
                let mut column = Vec::new();
                for (particle, sign) in ends.into_iter().zip([root, -root]) {
                    let free = dofs.free_axes(particle).iter();
                    column.extend(dofs.rows(particle).zip(free).map(|(row, axis)| (row, sign * t[axis])));
                }
                if column.iter().any(|&(_, value)| value != 0.0) {
                    columns.push(column);
                    owners.push(owner);
                }
            }
        }
        (columns, owners)
    }
}

/// The minimality of a [`DropSet`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Minimality {
    /// None of the springs can be spared.
    Irredundant,
    /// The set is sufficient; a search for springs that can be spared is too expensive.
    Enough,
}

/// The owners to drop so that `I − H`, restricted to the columns of the others, is positive definite; more where that takes `most` multiplications.
fn choose(h: &DMatrix<f64>, owners: &[usize], count: usize, most: f64) -> (Vec<usize>, Minimality) {
    let columns = |dropped: &[bool]| -> Vec<usize> { (0..owners.len()).filter(|&c| !dropped[owners[c]]).collect() };
    let symmetric = (h + h.transpose()) * 0.5;
    let restricted = |kept: &[usize]| symmetric.select_rows(kept).select_columns(kept);
    let mut left = most;
    let mut is_definite = |dropped: &[bool]| {
        let kept = columns(dropped);
        left -= (kept.len() as f64).powi(3) / 6.0;
        let rest = DMatrix::identity(kept.len(), kept.len()) - restricted(&kept);
        (left > 0.0).then(|| Cholesky::new(rest).is_some())
    };
    let (mut order, mut dropped) = (Vec::new(), vec![false; count]);
    while order.len() < count {
        match is_definite(&dropped) {
            Some(true) => break,
            Some(false) => {}
            None => return ((0..count).collect(), Minimality::Enough),
        }
        let kept = columns(&dropped);
        let matrix = restricted(&kept);
        // A power iteration from a vector that is hardly orthogonal to an eigenvector.
        let mut x = DVector::from_fn(kept.len(), |k, _| 1.0 + 0.1 * (k as f64).sin());
        for _ in 0..40 {
            // Not zero: H has an eigenvalue of one or more.
            x = &matrix * x;
            x /= norm(x.as_slice());
        }
        let mut weights = vec![0.0; count];
        for (&column, x) in kept.iter().zip(x.iter()) {
            weights[owners[column]] += x * x;
        }
        let worst = (0..count).filter(|&k| !dropped[k]).max_by(|&a, &b| weights[a].total_cmp(&weights[b]));
        worst.into_iter().for_each(|worst| dropped[worst] = true);
        order.extend(worst);
    }
    // Puts back what does no harm, one by one; returns `false` where that takes too much.
    let mut put_back = |springs: &[usize], dropped: &mut [bool]| {
        springs.iter().all(|&spring| {
            dropped[spring] = false;
            let is_harmless = is_definite(dropped);
            dropped[spring] = is_harmless != Some(true);
            is_harmless.is_some()
        })
    };
    let latest: Vec<usize> = order.iter().rev().copied().collect();
    let is_done = put_back(&latest, &mut dropped);
    order.retain(|&spring| dropped[spring]);
    if !is_done {
        return (order, Minimality::Enough);
    }
    let strength = |k: usize| {
        let own = owners.iter().enumerate().filter(|(_, owner)| **owner == k);
        own.map(|(column, _)| h[(column, column)]).fold(0.0, f64::max)
    };
    let mut weakest: Vec<usize> = (0..count).collect();
    weakest.sort_by(|&a, &b| strength(a).total_cmp(&strength(b)));
    dropped.fill(true);
    let is_done = put_back(&weakest, &mut dropped);
    let other: Vec<usize> = weakest.into_iter().rev().filter(|&k| dropped[k]).collect();
    (if is_done && other.len() < order.len() { other } else { order }, Minimality::Irredundant)
}

fn across(n: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = Vector3::ith(n.iamin(), 1.0);
    let first = n.cross(&axis).normalize();
    [first, n.cross(&first)]
}

/// Particles between walls, each with springs pressed from 1.25 m to 1 m: across, every spring takes 10 N/m, and m/dt² is the mass.
#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{State, SystemBuilder};

    /// A particle of each mass in the plane, with one or two springs.
    fn particles(masses: &[(f64, usize)]) -> (System, State) {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        for (row, &(mass, springs)) in masses.iter().enumerate() {
            let y = 3.0 * row as f64;
            let free = builder.particle([0.0, y, 0.0], mass);
            for x in [-1.0, 1.0].into_iter().take(springs) {
                let wall = builder.particle([x, y, 0.0], 1.0);
                builder.hold(wall);
                builder.spring(free, wall, Spring { stiffness: 50.0, rest_length: 1.25, damping: 0.0 });
            }
        }
        builder.build().unwrap()
    }

    /// The set for a step of 1 s; symbolic analyses, assemblies, factorizations and solves.
    fn set(masses: &[(f64, usize)]) -> (DropSet, [u64; 4]) {
        let (system, state) = particles(masses);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let mut work = Work::default();
        let set = smallest_set(&system, &extensions, 1.0, Par::Seq, &mut work).unwrap();
        (set, [work.symbolic_factorizations, work.assemblies, work.factorizations, work.solves])
    }

    /// Every spring is necessary if 10 N/m outweigh the mass, one of two if 20 do, else none.
    #[test]
    fn sets_and_their_work_are_those_by_hand() {
        let mixed = [(8.0, 1), (15.0, 2), (15.0, 2)];
        let most = [[(8.0, 1); 121].as_slice(), &[(15.0, 2); 9]].concat();
        let (irredundant, enough) = (Minimality::Irredundant, Minimality::Enough);
        for (masses, [springs, at_least, tension], minimality, expected) in [
            (&[(25.0, 2)][..], [0, 0, 2], irredundant, [1, 1, 1, 0]),
            // Refused, and proven to be enough.
            (&[(8.0, 2)], [2, 2, 2], irredundant, [1, 2, 2, 0]),
            // Refused, enough by the local condition, a solve for one column, and the proof.
            (&[(15.0, 2)], [1, 1, 2], irredundant, [1, 3, 3, 1]),
            // One is necessary; then two are still negative, which takes two of the four others.
            (&mixed, [3, 3, 5], irredundant, [1, 4, 6, 3]),
            // 128 terms are few enough to begin with all of them.
            (&[(15.0, 2); 128], [128, 1, 256], irredundant, [1, 3, 3, 128]),
            // Of 130, 121 of them necessary, the nine others are too few to be halved: refused twice, counted once, enough by the local condition, and
            // the proof.
            (&most, [130, 130, 139], irredundant, [1, 4, 6, 130]),
            // 600 terms are too many to tell which of them can be spared: three halvings find that fewer than 525 are not enough.
            (&[(15.0, 2); 600], [600, 1, 1200], enough, [1, 5, 5, 0]),
        ] {
            let (set, work) = set(masses);
            assert_eq!(
                ([set.springs.len(), set.at_least, set.tension], work),
                ([springs, at_least, tension], expected)
            );
            assert_eq!((set.minimality, set.is_smallest()), (minimality, springs == at_least));
        }
        assert_eq!(set(&[(8.0, 2)]).0.springs, [0, 1]);
    }

    /// Particles on pressed springs that run askew, with masses below the rounding of the springs: without all that they take across A is singular as
    /// far as can be told, so that nothing is known but that all have to go; one that is stretched takes nothing.
    #[test]
    fn where_rounding_hides_what_is_enough_all_are_named() {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        for row in 0..12 {
            let (y, angle) = (5.0 * row as f64, 0.1 + 0.11 * row as f64);
            let free = builder.particle([0.0, y, 0.0], 1e-18);
            let wall = builder.particle([f64::cos(angle), y + f64::sin(angle), 0.0], 1.0);
            builder.hold(wall);
            let rest_length = if row == 5 { 0.5 } else { 1.25 };
            builder.spring(free, wall, Spring { stiffness: 50.0, rest_length, damping: 0.0 });
        }
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let set = smallest_set(&system, &extensions, 1.0, Par::Seq, &mut Work::default()).unwrap();
        let pressed: Vec<usize> = (0..12).filter(|&spring| spring != 5).collect();
        assert_eq!((set.springs, set.minimality, set.tension), (pressed, Minimality::Enough, 11));
    }

    /// Three owners of one column each, of which the first two are too much by themselves.
    #[test]
    fn a_search_that_costs_too_much_keeps_what_is_enough() {
        let h = DMatrix::from_partial_diagonal(3, 3, &[1.5, 1.25, 0.5]);
        let owners = [0, 1, 2];
        assert_eq!(choose(&h, &owners, 3, f64::INFINITY), (vec![0, 1], Minimality::Irredundant));
        // 27/6, 8/6 and 1/6 multiplications for the three looks on the way there.
        assert_eq!(choose(&h, &owners, 3, 5.0), (vec![0, 1, 2], Minimality::Enough));
        assert_eq!(choose(&h, &owners, 3, 6.5), (vec![0, 1], Minimality::Enough));
        // Two more of 8/6 each, and none of the other way round.
        assert_eq!(choose(&h, &owners, 3, 9.0), (vec![0, 1], Minimality::Irredundant));
        // One look at six columns takes 36: nothing may be left then.
        let none = DMatrix::zeros(6, 6);
        let owners = [0, 1, 2, 3, 4, 5];
        assert_eq!(choose(&none, &owners, 6, 36.0), ((0..6).collect(), Minimality::Enough));
        assert_eq!(choose(&none, &owners, 6, 36.5), (Vec::new(), Minimality::Irredundant));
    }

    /// Terms so strong that their powers overflow: the strongest goes first. Of equal ones it is the one with most columns, then the last.
    #[test]
    fn the_worst_goes_first() {
        let strong = DMatrix::from_partial_diagonal(2, 2, &[1e12, 1e11]);
        assert_eq!(choose(&strong, &[0, 1], 2, f64::INFINITY), (vec![0, 1], Minimality::Irredundant));
        let equal = DMatrix::from_diagonal_element(4, 4, 2.0);
        assert_eq!(choose(&equal, &[0, 2, 1, 0], 3, f64::INFINITY).0, [0, 1, 2]);
    }

    /// Four owners of one column each, of which the worst eigenvectors pick three where two are enough.
    #[test]
    fn the_smaller_set_of_both_ways_is_taken() {
        let h = [
            1.125, 0.0, -0.125, 0.3125, 0.0, 0.75, 0.1875, 0.625, -0.125, 0.1875, 0.9375, 0.125, 0.3125, 0.625, 0.125,
            0.625,
        ];
        let h = DMatrix::from_row_slice(4, 4, &h);
        assert_eq!(choose(&h, &[0, 1, 2, 3], 4, f64::INFINITY), (vec![0, 1], Minimality::Irredundant));
    }
}
