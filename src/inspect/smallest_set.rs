//! A smallest set of springs whose transverse terms must be dropped to make A positive definite.
//!
//! Let F be springs that are *enough*: without their transverse terms, A_F is positive definite. Putting back the terms of some
//! springs s of F subtracts `N_s N_sᵀ`, N_s having a column `√c (t at i, −t at j)` for each direction t across the spring, with
//! `c = k(1/l − 1/l0)`. By Schur's complement
//!
//! ```text
//! A_F − Σ N_s N_sᵀ  is positive definite   ⇔   I − Nᵀ A_F⁻¹ N  is,
//! ```
//!
//! a small dense matrix: one sparse factorization and a solve a column, and every question about subsets of F is cheap.
//!
//! **From below.** Some springs are in every set that is enough, and N negative eigenvalues take N/2 terms or more, see `necessary`. Where the
//! necessary springs are enough by themselves, which one factorization tells, they are the smallest set there is.
//!
//! **From above.** *Enough* springs come from the local condition of [`Regularization`]. Where these are too many, only the necessary ones of them
//! and those that are nearest to it are taken, as few as three halvings with a factorization each find to be enough.
//!
//! **The search** is one in that small matrix (`choice`). Dropping more never hurts, so what remains is *irredundant*: none of its springs can be
//! spared. It need not be of least size, to find which is as hard as covering a set; where one spring is to blame, it is that spring.

use super::greedy_selection::{Minimality, choose};
use super::inertia::InertiaCounter;
use super::necessary::{Column, NECESSARY, Necessity, fewest};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::force::SpringGeometry;
use crate::integrate::Regularization;
use crate::linear::{Ldlt, SOLVE_COLUMNS};
use crate::operator::{Combination, SystemOperator};
use crate::spring::{Spring, Stiffness};
use crate::system::System;
use crate::work::Work;
use faer::Par;
use nalgebra::{DMatrix, Vector3};
use std::sync::Arc;

/// Springs without whose transverse terms A is positive definite, proven by a factorization.
#[derive(Debug, Clone, PartialEq)]
pub struct DropSet {
    /// The springs; those that matter most first, where the set is irredundant.
    pub springs: Vec<usize>,
    /// How small the set is.
    pub minimality: Minimality,
    /// No set of fewer springs than this is enough, proven.
    pub at_least: usize,
    /// How many springs option II (`tension`) would drop: all that are compressed.
    pub tension: usize,
}

impl DropSet {
    /// Whether no smaller set is enough.
    pub fn is_smallest(&self) -> bool {
        self.springs.len() <= self.at_least
    }
}

/// Multiplications that the solves of one search may take, and the factorizations of its dense matrices: a few seconds.
const AFFORDABLE: f64 = 2e10;

/// Springs up to which a search is always affordable, and beyond which it never is (the dense matrix is too large).
const ALWAYS: usize = 32;
const NEVER: usize = 500;

/// Terms up to which the search begins with all that the local condition names: the wider the choice, the smaller the set.
const WHOLE: usize = 128;

/// Factorizations that narrow down how many of the most negative terms are enough.
const HALVINGS: usize = 3;

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
    let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
    let factorization = Ldlt::analyse(pattern.pattern(), par)?;
    work.symbolic_factorizations += 1;
    let counter = &mut InertiaCounter::sharing(&factorization)?;
    Ok(smallest_set_with(Trial::new(system, extensions, dt, pattern, factorization), 0, counter, work))
}

/// As [`smallest_set`]; A may be known to have negative eigenvalues. `counter` knows the pattern.
pub(super) fn smallest_set_with(
    mut trial: Trial,
    negative: usize,
    counter: &mut InertiaCounter,
    work: &mut Work,
) -> DropSet {
    let (system, extensions) = (trial.system, trial.extensions);
    let compressed = extensions.springs(system).filter(|((_, _, spring), at)| spring.is_compressed(at));
    let tension = compressed.count();
    let set = |springs: &[usize], minimality, at_least| {
        let springs = springs.iter().filter_map(|&p| system.active_springs().get(p)).map(|&s| s as usize).collect();
        DropSet { springs, minimality, at_least, tension }
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
        let left = counter.count(trial.matrix.matrix(), work).negative.max(1);
        let others = terms.iter().filter(|term| term.need < NECESSARY).map(|term| term.rank);
        at_least = at_least.max(necessary.len() + fewest(left, others));
    }
    let Some(enough) = trial.enough(&necessary, &terms, work) else {
        let all: Vec<usize> = (0..extensions.as_slice().len()).filter(|&p| trial.taken(p) > 0.0).collect();
        return set(&all, Minimality::Enough, at_least);
    };
    if !is_affordable(enough.len(), trial.factorization.size().entries) {
        return set(&enough, Minimality::Enough, at_least);
    }
    let (chosen, minimality) = trial.irredundant(&enough, work);
    // What the dense matrix says is proven by a factorization of A itself.
    match trial.is_definite(&chosen, work) {
        true => set(&chosen, minimality, at_least),
        false => set(&enough, Minimality::Enough, at_least),
    }
}

/// Whether it is affordable to find out which of so many springs can be spared, with a factor of so many entries.
fn is_affordable(springs: usize, entries: usize) -> bool {
    let affordable = (AFFORDABLE / (4.0 * entries as f64)) as usize;
    springs <= affordable.clamp(ALWAYS, NEVER)
}

/// What a transverse term is like.
#[derive(Debug, Clone, Copy)]
struct Term {
    /// The rank of what it takes.
    rank: usize,
    /// How far it goes towards making A indefinite by itself, see [`Necessity::need`].
    need: f64,
}

/// A with chosen transverse terms dropped. Springs are named by their position among the active ones.
pub(super) struct Trial<'s> {
    system: &'s System,
    extensions: &'s SpringGeometry,
    combination: Combination,
    operator: SystemOperator<'s>,
    pattern: Arc<SpringPattern>,
    matrix: SystemMatrix,
    factorization: Ldlt,
    options: Vec<Stiffness>,
    /// c, what the transverse term of every active spring takes; zero where it takes nothing.
    taken: Vec<f64>,
}

impl<'s> Trial<'s> {
    /// For a step of length dt, on a pattern that has been analysed.
    pub fn new(
        system: &'s System,
        extensions: &'s SpringGeometry,
        dt: f64,
        pattern: Arc<SpringPattern>,
        factorization: Ldlt,
    ) -> Self {
        let combination = Combination::step(dt);
        let operator = SystemOperator::new(system, extensions, Stiffness::Full, combination);
        let matrix = SystemMatrix::zeros(pattern.clone());
        let options = vec![Stiffness::Full; extensions.as_slice().len()];
        let block = |spring: &Spring, at| spring.stiffness_block(at, Stiffness::Full);
        let taken = extensions.springs(system).map(|((_, _, spring), at)| (-block(spring, at).transverse).max(0.0));
        let taken = taken.collect();
        Self { system, extensions, combination, operator, pattern, matrix, factorization, options, taken }
    }

    fn taken(&self, position: usize) -> f64 {
        self.taken.get(position).copied().unwrap_or(0.0)
    }

    fn is_definite(&mut self, dropped: &[usize], work: &mut Work) -> bool {
        self.options.fill(Stiffness::Full);
        for &position in dropped {
            if let Some(option) = self.options.get_mut(position) {
                *option = Stiffness::Tension;
            }
        }
        let options = &self.options;
        self.operator.update_each(self.extensions, self.combination, |position| options[position]);
        self.matrix.refill(&self.operator);
        work.assemblies += 1;
        work.factorizations += 1;
        self.factorization.factor(self.matrix.matrix()).is_ok() && self.factorization.is_positive()
    }

    /// What each active spring's term is like.
    fn terms(&mut self) -> Vec<Term> {
        self.operator.update(self.extensions, Stiffness::Tension, self.combination);
        let necessity = Necessity::new(&self.operator, &self.pattern);
        let term = |(position, &spring): (usize, &u32)| match self.taken(position) > 0.0 {
            false => Term { rank: 0, need: 0.0 },
            true => {
                let (columns, _) = self.columns(&[position]);
                let need = necessity.need(self.system.pair(spring as usize), &columns);
                Term { rank: columns.len(), need }
            }
        };
        self.system.active_springs().iter().enumerate().map(term).collect()
    }

    /// Springs that are enough: the necessary ones, which are not, and those that are nearest to it; `None` if rounding hides that they are.
    fn enough(&mut self, necessary: &[usize], terms: &[Term], work: &mut Work) -> Option<Vec<usize>> {
        let mut softening = Regularization::new(self.system);
        softening.choose(self.system, self.extensions, self.combination).ok()?;
        let options = softening.options();
        let is_new = |p: &usize| options[*p] == Stiffness::Tension && terms[*p].need < NECESSARY;
        let mut others: Vec<usize> = (0..options.len()).filter(is_new).collect();
        others.sort_by(|&a, &b| terms[b].need.total_cmp(&terms[a].need).then(a.cmp(&b)));
        let mut local = [necessary, &others].concat();
        if local.len() > WHOLE {
            // Between `refused` and `accepted` of them.
            let (mut refused, mut accepted) = (necessary.len(), local.len());
            let mut is_factored = false;
            for _ in 0..HALVINGS {
                if accepted - refused <= 1 + accepted / 16 {
                    break;
                }
                let middle = refused.midpoint(accepted);
                is_factored = self.is_definite(&local[..middle], work);
                if is_factored {
                    accepted = middle;
                } else {
                    refused = middle;
                }
            }
            local.truncate(accepted);
            // The factorization that was accepted last may still be at hand.
            if is_factored {
                return Some(local);
            }
        }
        self.is_definite(&local, work).then_some(local)
    }

    /// Of `enough`, whose factorization is at hand, the springs that must be dropped.
    fn irredundant(&mut self, enough: &[usize], work: &mut Work) -> (Vec<usize>, Minimality) {
        let (columns, owners) = self.columns(enough);
        let n = self.system.dofs().len();
        let mut h = DMatrix::zeros(columns.len(), columns.len());
        let mut z = Vec::new();
        for (group, together) in columns.chunks(SOLVE_COLUMNS).enumerate() {
            z.clear();
            z.resize(n * together.len(), 0.0);
            for (column, z) in together.iter().zip(z.chunks_mut(n)) {
                column.iter().for_each(|&(row, value)| z[row] = value);
            }
            self.factorization.substitute_columns(n, &mut z);
            work.solves += together.len() as u64;
            for (c, z) in z.chunks(n).enumerate() {
                for (r, row) in columns.iter().enumerate() {
                    h[(r, group * SOLVE_COLUMNS + c)] = row.iter().map(|&(index, value)| value * z[index]).sum::<f64>();
                }
            }
        }
        let (order, minimality) = choose(&h, &owners, enough.len(), AFFORDABLE);
        (order.into_iter().filter_map(|k| enough.get(k).copied()).collect(), minimality)
    }

    /// The columns of N for the given springs, as (row, value), and which of the springs each belongs to.
    fn columns(&self, springs: &[usize]) -> (Vec<Column>, Vec<usize>) {
        let dofs = self.system.dofs();
        let (mut columns, mut owners) = (Vec::new(), Vec::new());
        for (owner, &position) in springs.iter().enumerate() {
            let (Some(&spring), Some(at)) =
                (self.system.active_springs().get(position), self.extensions.as_slice().get(position))
            else {
                continue;
            };
            let root = self.taken(position).sqrt();
            for t in across(&at.direction) {
                let mut column = Vec::new();
                for (particle, sign) in self.system.pair(spring as usize).into_iter().zip([root, -root]) {
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

/// Two unit vectors across n.
fn across(n: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = Vector3::ith(n.iamin(), 1.0);
    let first = n.cross(&axis).normalize();
    [first, n.cross(&first)]
}

#[cfg(test)]
mod tests;
