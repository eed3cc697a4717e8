//! Pairs of nodes that hold to each other much more than to all others.
//!
//! Gauss–Seidel moves one node at a time. Where two hold to each other stiffly, and softly to the others, each is kept in its place by
//! the other, and what both have to move together takes many sweeps; nor do coarse levels see it, whose nodes are a dozen or two
//! of these. In a crumpled cloth half of the springs are pressed, and resist nothing that moves across them: in thousands of
//! nodes there is a pair with a stretched spring between them and pressed ones around. These motions are few, but conjugate gradients
//! take an iteration or so for each, and the larger a cloth the worse is its worst pair.
//!
//! Such a pair C is therefore moved as a whole too, along the direction u in which it [resists least](tight) beside its nodes, by the equation that is the sum of those of its nodes there,
//!
//! ```text
//! (uᵀ A_CC u) c = uᵀ Σ_i (b − A x)_i,   A_CC = Σ_ij A_ij,   x_i += c u,   i, j ∈ C,
//! ```
//!
//! one pair after the other between the forward sweep of the smoother and the coarse correction, and in reverse order between that and the
//! backward sweep. With N the matrix of the first of these two, the coarse correction `P B_c Pᵀ` of a cycle becomes
//!
//! ```text
//! N̄⁻¹ + (I − N⁻ᵀ A) P B_c Pᵀ (I − A N⁻¹),   N̄⁻¹ = N⁻¹ + N⁻ᵀ − N⁻ᵀ A N⁻¹,
//! ```
//!
//! symmetric, and no less definite than it was: `rᵀ N̄⁻¹ r = Σ_C c² uᵀ A_CC u`, with the c of the first pass from zero. Which pairs these are is found
//! whenever coarse levels are made, u is of every matrix. Where A_CC is not positive definite, or single precision would not do, a pair stays as it is. (Along all axes at
//! once it would be moved by `A_CC⁻¹`, of which single precision keeps what is soft alone.)
//!
//! Own derivation. To relax a few unknowns together is as old as multigrid for systems (Trottenberg, Oosterlee and Schüller 2001, "Multigrid",
//! chapter 8); to do so by a single one that all share is aggregation, here for the few nodes that ask for it.

mod search;
mod tight;

use super::block::{self, Block, add_transposed_apply, scaled};
use super::parallel::for_chunks;
use super::smoother::Smoother;
use super::sparse::Rows;
use search::search;
use tight::Tight;

/// All pairs of a level, in the order in which they are moved.
#[derive(Debug, Clone, Default)]
pub(super) struct Pairs<const N: usize> {
    /// Rows of a domain of the smoother.
    domain: usize,
    /// Of each domain the pairs that have no neighbour outside: threads take them side by side.
    within: Vec<Vec<Pair<N>>>,
    /// The others, after them.
    across: Vec<Pair<N>>,
    /// Room for the search.
    likely: Vec<u32>,
}

#[derive(Debug, Clone)]
struct Pair<const N: usize> {
    nodes: [u32; 2],
    /// u, with `uᵀ A_CC u = 1`; zero where the pair stays as it is.
    along: [f32; N],
    /// `v_j = Σ_i A_ji u` of its nodes and all their neighbours j, ascending.
    near: Vec<(u32, [f32; N])>,
}

impl<const N: usize> Pairs<N> {
    /// Finds the pairs of `factor·A`, which the smoother has, and takes it over. Where there are none and there were none, nothing is allocated after the first time.
    pub fn find(&mut self, a: &impl Rows<N>, smoother: &Smoother<N>, factor: f64) {
        let Self { domain, within, across, likely } = self;
        *domain = smoother.domain();
        across.clear();
        within.resize(a.pattern().rows().div_ceil(*domain), Vec::new());
        within.iter_mut().for_each(Vec::clear);
        search(a, smoother, likely, &mut |nodes| {
            let pair = Pair::new(a, nodes);
            let ends = [pair.near.first(), pair.near.last()];
            match ends.map(|end| end.map_or(0, |&(node, _)| node as usize / *domain)) {
                [first, last] if first == last => within[first].push(pair),
                _ => across.push(pair),
            }
        });
        self.update(a, factor);
    }

    /// Takes over `factor·A`, with the pairs that there are.
    pub fn update(&mut self, a: &impl Rows<N>, factor: f64) {
        self.within.iter_mut().flatten().chain(&mut self.across).for_each(|pair| pair.update(a, factor));
    }

    /// Moves every pair, given `r = b − A x`, which stays that.
    pub fn before(&self, b: &[[f32; N]], x: &mut [[f32; N]], r: &mut [[f32; N]]) {
        if self.count() == 0 {
            return;
        }
        for_chunks(x, r, self.domain, &mut vec![()], |start, x, r, ()| {
            self.within[start / self.domain].iter().for_each(|pair| pair.relax_with(b, start, x, r));
        });
        self.across.iter().for_each(|pair| pair.relax_with(b, 0, x, r));
    }

    /// Moves every pair, in reverse order.
    pub fn after(&self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        if self.count() == 0 {
            return;
        }
        self.across.iter().rev().for_each(|pair| _ = pair.relax(b, 0, x));
        let none = &mut vec![(); x.len()];
        for_chunks(x, none, self.domain, &mut vec![()], |start, x, _, ()| {
            self.within[start / self.domain].iter().rev().for_each(|pair| _ = pair.relax(b, start, x));
        });
    }

    /// How many there are.
    fn count(&self) -> usize {
        self.within.iter().chain([&self.across]).map(Vec::len).sum()
    }

    /// The nodes of every pair and u, in the order in which they are moved.
    #[cfg(test)]
    pub fn moves(&self) -> Vec<([usize; 2], [f64; N])> {
        let all = self.within.iter().flatten().chain(&self.across);
        all.map(|pair| (pair.nodes.map(|node| node as usize), pair.along.map(f64::from))).collect()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let all = self.within.iter().flatten().chain(&self.across);
        size_of_val(&self.likely[..])
            + size_of_val(&self.within[..])
            + all.map(|pair| size_of_val(pair) + size_of_val(&pair.near[..])).sum::<usize>()
    }
}

impl<const N: usize> Pair<N> {
    /// Without numbers.
    fn new(a: &impl Rows<N>, nodes: [u32; 2]) -> Self {
        let mut near = nodes.map(|node| a.pattern().columns(node as usize)).concat();
        near.sort_unstable();
        near.dedup();
        Self { nodes, along: [0.0; N], near: near.into_iter().map(|node| (node, [0.0; N])).collect() }
    }

    fn update(&mut self, a: &impl Rows<N>, factor: f64) {
        let Self { nodes, along, near } = self;
        near.iter_mut().for_each(|(_, v)| *v = [0.0; N]);
        let tight = Tight::of(a, nodes.map(|node| node as usize));
        // Of `factor·A`.
        let u = tight.map_or([0.0; N], |tight| tight.along.map(|u| u / factor.sqrt()));
        *along = single(&u);
        // Those of its own nodes nearly cancel: they are summed up in double precision.
        let mut own = [[0.0; N]; 2];
        for &node in &*nodes {
            a.visit(node as usize, |column, block| {
                let block: Block<N, N> = scaled(factor, block);
                if let Some(place) = nodes.iter().position(|&node| node as usize == column) {
                    add_transposed_apply(&mut own[place], &block, &u);
                } else if let Ok(place) = near.binary_search_by_key(&(column as u32), |&(node, _)| node) {
                    let mut v = [0.0; N];
                    add_transposed_apply(&mut v, &block, &u);
                    near[place].1.iter_mut().zip(single(&v)).for_each(|(sum, v)| *sum += v);
                }
            });
        }
        for (node, own) in nodes.iter().zip(&own) {
            if let Ok(place) = near.binary_search_by_key(node, |&(node, _)| node) {
                near[place].1 = single(own);
            }
        }
    }

    /// Moves the pair by c u, and tells c. x begins with the row `start`.
    #[inline(always)]
    fn relax(&self, b: &[[f32; N]], start: usize, x: &mut [[f32; N]]) -> f32 {
        let [one, other] = self.nodes.map(|node| node as usize);
        let mut rest = dot(&self.along, &b[one]) + dot(&self.along, &b[other]);
        for (node, v) in &self.near {
            rest -= dot(v, &x[*node as usize - start]);
        }
        for node in [one, other] {
            x[node - start].iter_mut().zip(self.along).for_each(|(x, u)| *x += rest * u);
        }
        rest
    }

    /// As [`relax`](Self::relax), and keeps r what is left.
    #[inline(always)]
    fn relax_with(&self, b: &[[f32; N]], start: usize, x: &mut [[f32; N]], r: &mut [[f32; N]]) {
        let by = self.relax(b, start, x);
        for (node, v) in &self.near {
            r[*node as usize - start].iter_mut().zip(v).for_each(|(r, v)| *r -= by * v);
        }
    }
}

#[inline(always)]
fn dot<const N: usize>(a: &[f32; N], b: &[f32; N]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn single<const N: usize>(numbers: &[f64; N]) -> [f32; N] {
    let [numbers] = block::single(1.0, &[*numbers]);
    numbers
}

#[cfg(test)]
mod tests;
