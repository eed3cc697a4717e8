//! What work costs, in one unit for everything that chooses or compares.
//!
//! The unit is a force evaluation of the system at hand. What an operation costs follows from sizes that are known before it is
//! done: springs, coordinates, entries and operations of a factor. Each of them takes so many nanoseconds on one core; only ratios of
//! these are used, and they hardly depend on the machine. They are fitted to `verification/costs.json`, which
//! `cargo xtask costs` measures, and held to it within a factor of 1.5 (the coarse levels of multigrid, which depend on more than sizes, of 1.6).
//!
//! Counting instead of timing makes the same choice as often as a run is repeated, and for any number of threads.

use super::analysis::FactorSize;
use super::ordering::OrderingMethod;
use super::preconditioner_kind::PreconditionerKind;
use crate::operator::row_shares;
use crate::system::System;
use crate::work::Work;

/// What the operations of a step cost on one system, in units of one force evaluation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostModel {
    axes: usize,
    springs: f64,
    /// Of them, those that a product takes four in a row, and those of these that overlap.
    in_a_row: f64,
    overlapping: f64,
    dofs: f64,
    /// Entries of the lower triangle of A.
    entries: f64,
    /// A force evaluation, in ns.
    force: f64,
    /// Multiplications in the coarse matrices of multigrid, where known.
    multiplications: Option<f64>,
}

/// A force evaluation with the step of an explicit method around it, in ns: once, a spring, a coordinate; a scattered spring of many the more.
const FORCE: [f64; 4] = [174.0, 5.3, 1.36, 3.8];

/// Scattered springs whose ends stay in the processor's memory.
const CACHED_SPRINGS: f64 = 1e4;

/// A product with A: once, a spring that is taken in a row with its neighbours, one that overlaps with them the more, any other, a scattered one of many the
/// more.
const PRODUCT: [f64; 5] = [80.0, 1.35, 0.9, 2.2, 1.5];

/// Extensions and blocks of all springs: once, a spring; a scattered spring of many the more.
const ASSEMBLY: [f64; 3] = [36.0, 8.4, 1.0];

/// Refilling and factoring A: once, a spring, an entry of the factor, an operation.
const FACTORIZATION: [f64; 4] = [300.0, 43.0, 3.5, 0.016];

/// A first ordering: once, a spring.
const GLANCE: [f64; 2] = [860.0, 162.0];

/// Ordering and symbolic analysis: once, an entry of the factor, a spring of what is dissected.
const ANALYSIS: [f64; 3] = [2700.0, 6.5, 900.0];

/// A solve with the factor, beside the product that checks it: once, a coordinate, an entry of the factor that stays in the
/// processor's memory from one solve to the next, one that does not.
const SOLVE: [f64; 4] = [105.0, 19.0, 0.2, 0.66];

/// Entries of a factor that stay.
const CACHED: f64 = 1e6;

/// Coordinates whose vectors stay, with about ten numbers each.
const CACHED_DOFS: f64 = 0.1 * CACHED;

/// The vectors of an iteration of conjugate gradients, beside the product: a coordinate whose numbers stay, one whose do not.
const VECTORS: [f64; 2] = [0.6, 1.6];

/// Blocks of block Jacobi: the same.
const BLOCKS: [f64; 2] = [1.3, 1.6];

/// Making the blocks of block Jacobi: once, a spring, a coordinate.
const MAKING_BLOCKS: [f64; 3] = [59.0, 4.1, 2.9];

/// The finest level of multigrid, with its smoother: a spring, a coordinate, the more for a spring whose blocks do not stay; with one dense level,
/// once, a pair and a triple of coordinates.
const FINEST: [f64; 3] = [15.0, 6.5, 6.0];
const DENSE_LEVEL: [f64; 3] = [90.0, 2.7, 0.00078];

/// A cycle of multigrid: a coordinate, a spring, the more for a spring whose blocks do not stay, and for a scattered one of many; of a system so small that
/// there is but one dense level, a pair of coordinates.
const CYCLE: [f64; 4] = [20.0, 0.8, 1.2, 12.0];
const DENSE_CYCLE: f64 = 0.3;

/// Springs whose blocks stay in the processor's memory from one pass of multigrid to the next.
const CACHED_BLOCKS: f64 = 2e5;

/// Computing the coarse levels: a coordinate, a multiplication, the more for a scattered spring of many; where multiplications are not known yet, a
/// coordinate, a spring that lies in a row, the power 4/3 of scattered ones, as which the coarse levels of networks of 400 to 30 000 particles fill in. One
/// dense level has none.
const SETUP: [f64; 3] = [245.0, 0.11, 115.0];
const UNKNOWN_SETUP: [f64; 3] = [258.0, 44.0, 3.6];

/// Coordinates up to which multigrid is one dense level.
const DENSE: f64 = 400.0;

/// The residuals of the first guess and of the solution in a solve by conjugate gradients: products with A, and their vectors, a
/// coordinate. The product of a first guess that is zero is spared.
const RESIDUALS: [f64; 2] = [2.0, 3.0];

/// `Σ times_i · sizes_i`, the first size being one.
fn nanoseconds<const N: usize>(times: [f64; N], sizes: [f64; N]) -> f64 {
    times.iter().zip(sizes).map(|(time, size)| time * size).sum()
}

/// Those up to a limit, and those beyond.
fn split(size: f64, limit: f64) -> [f64; 2] {
    [size.min(limit), (size - limit).max(0.0)]
}

impl CostModel {
    /// Of a system.
    pub fn of(system: &System) -> Self {
        let axes = system.dimension();
        let (springs, dofs) = (system.active_springs().len() as f64, system.dofs().len() as f64);
        let entries = 0.5 * (axes as f64 + 1.0) * dofs + (axes * axes) as f64 * springs;
        let shares = row_shares(system);
        let [in_a_row, overlapping] = [shares.in_a_row, shares.overlapping].map(|share| share * springs);
        let costs = Self { axes, springs, in_a_row, overlapping, dofs, entries, force: 1.0, multiplications: None };
        Self { force: nanoseconds(FORCE, [1.0, springs, dofs, costs.far_ends()]), ..costs }
    }

    /// With [so many multiplications](crate::multigrid::Multigrid::multiplications) in the coarse matrices of multigrid: in random networks they
    /// are two to three times as many as sizes tell.
    #[must_use]
    pub fn with_coarse_levels(self, multiplications: f64) -> Self {
        Self { multiplications: Some(multiplications), ..self }
    }

    /// The part of the springs that do not lie in rows: hardly any of a grid's, nearly all of a network's. In less than three dimensions
    /// rows are not looked for, and none counts.
    pub(super) fn scattered_share(&self) -> f64 {
        self.scattered() / self.springs.max(1.0)
    }

    /// How many do not.
    fn scattered(&self) -> f64 {
        if self.axes < 3 { 0.0 } else { self.springs - self.in_a_row }
    }

    /// How many have ends that do not stay in the processor's memory.
    fn far_ends(&self) -> f64 {
        let [_, far] = split(self.scattered(), CACHED_SPRINGS);
        far
    }

    /// How many have blocks that multigrid reads from far away.
    fn far_springs(&self) -> f64 {
        let [_, far] = split(self.springs, CACHED_BLOCKS);
        far
    }

    /// A product of A with a vector, matrix-free.
    pub fn product(&self) -> f64 {
        let others = self.springs - self.in_a_row;
        let times = [1.0, self.in_a_row, self.overlapping, others, self.far_ends()];
        nanoseconds(PRODUCT, times) / self.force
    }

    /// The spring blocks of A.
    pub fn assembly(&self) -> f64 {
        nanoseconds(ASSEMBLY, [1.0, self.springs, self.far_ends()]) / self.force
    }

    /// A numeric factorization, assembly of the sparse matrix included.
    pub fn factorization(&self, size: FactorSize) -> f64 {
        self.factoring(size.entries as f64, size.flops)
    }

    /// The least that a factorization can cost: as if it filled nothing in.
    pub fn least_factorization(&self) -> f64 {
        self.factoring(self.entries, 0.0)
    }

    fn factoring(&self, entries: f64, flops: f64) -> f64 {
        nanoseconds(FACTORIZATION, [1.0, self.springs, entries, flops]) / self.force
    }

    /// A look at what a factorization takes at least.
    pub fn glance(&self) -> f64 {
        nanoseconds(GLANCE, [1.0, self.springs]) / self.force
    }

    /// An ordering with symbolic analysis.
    pub fn analysis(&self, size: FactorSize) -> f64 {
        let dissected = if size.ordering == OrderingMethod::NestedDissection { self.springs } else { 0.0 };
        nanoseconds(ANALYSIS, [1.0, size.entries as f64, dissected]) / self.force
    }

    /// The least that an ordering with symbolic analysis can cost: as if nothing were filled in, nor dissected.
    pub fn least_analysis(&self) -> f64 {
        nanoseconds(ANALYSIS, [1.0, self.entries, 0.0]) / self.force
    }

    /// A solve with a factor, its residual included.
    pub fn direct_solve(&self, size: FactorSize) -> f64 {
        self.solving(size.entries as f64)
    }

    /// The least that a solve with a factor can cost.
    pub fn least_direct_solve(&self) -> f64 {
        self.solving(self.entries)
    }

    fn solving(&self, entries: f64) -> f64 {
        let [cached, others] = split(entries, CACHED);
        nanoseconds(SOLVE, [1.0, self.dofs, cached, others]) / self.force + self.product()
    }

    /// An iteration of conjugate gradients.
    pub fn iteration(&self, preconditioner: PreconditionerKind) -> f64 {
        let dofs = split(self.dofs, CACHED_DOFS);
        let others = match preconditioner {
            PreconditionerKind::None => 0.0,
            PreconditionerKind::Jacobi | PreconditionerKind::BlockJacobi => nanoseconds(BLOCKS, dofs),
            PreconditionerKind::Multigrid if self.dofs <= DENSE => DENSE_CYCLE * self.dofs * self.dofs,
            PreconditionerKind::Multigrid => {
                nanoseconds(CYCLE, [self.dofs, self.springs, self.far_springs(), self.far_ends()])
            }
        };
        self.product() + (nanoseconds(VECTORS, dofs) + others) / self.force
    }

    /// What a preconditioner does for every matrix, the coarse levels of multigrid aside.
    pub fn preparation(&self, preconditioner: PreconditionerKind) -> f64 {
        let times = match preconditioner {
            PreconditionerKind::None => return 0.0,
            PreconditionerKind::Jacobi | PreconditionerKind::BlockJacobi => MAKING_BLOCKS,
            PreconditionerKind::Multigrid if self.dofs <= DENSE => {
                return nanoseconds(DENSE_LEVEL, [1.0, self.dofs.powi(2), self.dofs.powi(3)]) / self.force;
            }
            PreconditionerKind::Multigrid => {
                return nanoseconds(FINEST, [self.springs, self.dofs, self.far_springs()]) / self.force;
            }
        };
        nanoseconds(times, [1.0, self.springs, self.dofs]) / self.force
    }

    /// The coarse levels of multigrid.
    pub fn multigrid_setup(&self) -> f64 {
        let time = match self.multiplications {
            _ if self.dofs <= DENSE => 0.0,
            Some(multiplications) => nanoseconds(SETUP, [self.dofs, multiplications, self.far_ends()]),
            None => {
                let scattered = self.scattered();
                nanoseconds(UNKNOWN_SETUP, [self.dofs, self.springs - scattered, scattered.powf(4.0 / 3.0)])
            }
        };
        time / self.force
    }

    /// A solve by conjugate gradients beside its iterations.
    pub fn iterative_solve(&self) -> f64 {
        RESIDUALS[0] * self.product() + RESIDUALS[1] * self.dofs / self.force
    }

    /// A first guess from earlier solutions: two products.
    pub fn warm_start(&self) -> f64 {
        2.0 * self.product()
    }

    /// The cost of some work, with the factor that it used, if any. Without one an ordering counts as a glance.
    pub fn cost(&self, work: &Work, factor: Option<FactorSize>) -> f64 {
        let factorization = factor.map_or(self.least_factorization(), |size| self.factorization(size));
        let direct_solve = factor.map_or(self.least_direct_solve(), |size| self.direct_solve(size));
        let analysis = factor.map_or(self.glance(), |size| self.analysis(size));
        let others = work.cg_iterations.saturating_sub(work.plain_iterations).saturating_sub(work.multigrid_iterations);
        let terms = [
            (work.force_evaluations, 1.0),
            (work.assemblies, self.assembly()),
            (work.symbolic_factorizations, analysis),
            (work.factorizations, factorization),
            (work.solves.saturating_sub(work.iterative_solves), direct_solve),
            (work.iterative_solves, self.iterative_solve()),
            (work.plain_iterations, self.iteration(PreconditionerKind::None)),
            (others, self.iteration(PreconditionerKind::BlockJacobi)),
            (work.multigrid_iterations, self.iteration(PreconditionerKind::Multigrid)),
            (work.multigrid_setups, self.multigrid_setup()),
            (work.warm_starts, self.warm_start()),
        ];
        terms.iter().map(|(count, each)| *count as f64 * each).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> CostModel {
        let (springs, in_a_row, overlapping, dofs, entries) = (5000.0, 4000.0, 1000.0, 3000.0, 20_000.0);
        CostModel { axes: 3, springs, in_a_row, overlapping, dofs, entries, force: 1000.0, multiplications: None }
    }

    /// 80 + 1.35 · 4000 + 0.9 · 1000 + 2.2 · 1000 ns, in force evaluations of 1000 ns; of 25 000 scattered springs 15 000 cost 1.5 ns more.
    #[test]
    fn a_product_costs_less_for_springs_in_a_row() {
        assert!((model().product() - 8.58).abs() < 1e-9, "{}", model().product());
        let scattered = CostModel { springs: 29_000.0, ..model() };
        assert!((scattered.product() - 8.58 - 24.0 * 2.2 - 15.0 * 1.5).abs() < 1e-9, "{}", scattered.product());
    }

    /// Beside two products 3 · 3000 ns.
    #[test]
    fn a_solve_costs_by_products_and_coordinates() {
        let costs = model();
        assert!((costs.iterative_solve() - 2.0 * costs.product() - 9.0).abs() < 1e-9, "{}", costs.iterative_solve());
    }

    /// Beside a product 0.6 + 1.3 ns a coordinate; of 150 000 coordinates the last 50 000 are too many for the processor's memory and cost 1.6 + 1.6 ns.
    #[test]
    fn vectors_that_do_not_stay_in_the_cache_cost_more() {
        let vectors = |costs: CostModel| costs.iteration(PreconditionerKind::BlockJacobi) - costs.product();
        assert!((vectors(model()) - 5.7).abs() < 1e-9);
        let large = CostModel { dofs: 150_000.0, ..model() };
        assert!((vectors(large) - (190.0 + 160.0)).abs() < 1e-9, "{}", vectors(large));
    }

    /// Of 300 000 springs 100 000 have blocks that multigrid reads from far away: 6 ns more each once a matrix, 1.2 ns in every cycle.
    #[test]
    fn blocks_that_do_not_stay_cost_multigrid_more() {
        let of = |springs: f64| {
            let costs = CostModel { springs, in_a_row: springs, ..model() };
            let cycle = costs.iteration(PreconditionerKind::Multigrid) - costs.iteration(PreconditionerKind::None);
            [costs.preparation(PreconditionerKind::Multigrid), cycle]
        };
        let [few, some, many] = [100_000.0, 200_000.0, 300_000.0].map(of);
        for ((few, some), (many, more)) in few.into_iter().zip(some).zip(many.into_iter().zip([6.0, 1.2])) {
            assert!((many - some - (some - few) - 100.0 * more).abs() < 1e-6, "{few} {some} {many}");
        }
    }

    /// Ten iterations: two without a preconditioner, three with multigrid, five with blocks.
    #[test]
    fn iterations_cost_by_their_preconditioner() {
        let costs = model();
        let work = Work { cg_iterations: 10, plain_iterations: 2, multigrid_iterations: 3, ..Work::default() };
        let [none, blocks, multigrid] =
            [PreconditionerKind::None, PreconditionerKind::BlockJacobi, PreconditionerKind::Multigrid]
                .map(|kind| costs.iteration(kind));
        let expected = 2.0 * none + 5.0 * blocks + 3.0 * multigrid;
        assert!((costs.cost(&work, None) - expected).abs() < 1e-9 && none < blocks, "{expected}");
    }

    /// A cycle takes so long for a coordinate and so long for a spring: 20 · 3000 + 0.8 · 5000 = 64 000 ns, in force evaluations of 1000 ns; of
    /// 25 000 scattered springs 15 000 cost 12 ns more.
    #[test]
    fn a_cycle_costs_by_coordinates_and_springs() {
        let cycle = |costs: CostModel| {
            costs.iteration(PreconditionerKind::Multigrid) - costs.iteration(PreconditionerKind::None)
        };
        assert!((cycle(model()) - 64.0).abs() < 1e-9, "{}", cycle(model()));
        let scattered = CostModel { springs: 29_000.0, ..model() };
        assert!((cycle(scattered) - 64.0 - 24.0 * 0.8 - 15.0 * 12.0).abs() < 1e-9, "{}", cycle(scattered));
    }

    /// A first ordering by springs: 860 + 162 · 5000 ns. An analysis by entries of the factor: 2700 + 6.5 · 100 000 ns, and 900 · 5000 ns where
    /// they are dissected. Of work without a factor an ordering counts as the one, with it as the other.
    #[test]
    fn orderings_cost_by_springs_and_by_entries() {
        let costs = model();
        let size = FactorSize { entries: 100_000, flops: 1e6, ordering: OrderingMethod::MinimumDegree };
        assert!((costs.glance() - 810.86).abs() < 1e-9 && (costs.analysis(size) - 652.7).abs() < 1e-9);
        let dissected = FactorSize { ordering: OrderingMethod::NestedDissection, ..size };
        assert!((costs.analysis(dissected) - costs.analysis(size) - 4500.0).abs() < 1e-9);
        let work = Work { symbolic_factorizations: 2, ..Work::default() };
        assert_eq!(
            [None, Some(size)].map(|size| costs.cost(&work, size)),
            [2.0 * costs.glance(), 2.0 * costs.analysis(size)]
        );
    }

    /// 258 · 3000 + 44 · 4000 + 3.6 · 1000^(4/3) ns by sizes, 245 · 3000 + 0.11 · 10⁶ ns by multiplications; one dense level has no others. In a plane, where
    /// rows are not looked for, no spring is scattered: 258 · 3000 + 44 · 5000 ns.
    #[test]
    fn coarse_levels_cost_by_multiplications_where_these_are_known() {
        let costs = model();
        let known = costs.with_coarse_levels(1e6);
        assert!((costs.multigrid_setup() - 986.0).abs() < 1e-9, "{}", costs.multigrid_setup());
        assert!((known.multigrid_setup() - 845.0).abs() < 1e-9, "{}", known.multigrid_setup());
        // Of 25 000 scattered springs 15 000 cost 115 ns more.
        let scattered = CostModel { springs: 29_000.0, ..known };
        assert!((scattered.multigrid_setup() - 845.0 - 1725.0).abs() < 1e-9, "{}", scattered.multigrid_setup());
        let plane = CostModel { axes: 2, ..costs };
        assert!((plane.multigrid_setup() - 994.0).abs() < 1e-9, "{}", plane.multigrid_setup());
        assert_eq!([costs, plane].map(|costs| costs.scattered_share()), [0.2, 0.0]);
        for (dofs, has_levels) in [(400.0, false), (401.0, true)] {
            let setups = [costs, known].map(|costs| CostModel { dofs, ..costs }.multigrid_setup());
            assert!(setups.iter().all(|&cost| (cost > 0.0) == has_levels), "{dofs}: {setups:?}");
        }
    }
}
