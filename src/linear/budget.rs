//! What a solver has spent on one system, and the most that it may spend.

use super::cost::CostModel;
use super::preconditioner_kind::PreconditionerKind;

/// How many times what a preconditioner is set up and [prepared](CostModel::preparation) with must be left for it to be worth it: the rest is for
/// its iterations.
const WORTH: f64 = 1.5;

/// What a solver has spent and may spend, in [force evaluations](CostModel).
#[derive(Debug, Clone, Copy)]
pub(super) struct Budget {
    pub costs: CostModel,
    spent: f64,
    allowed: f64,
}

impl Budget {
    /// Without a limit.
    pub fn new(costs: CostModel) -> Self {
        Self { costs, spent: 0.0, allowed: f64::INFINITY }
    }

    /// Takes note of work.
    pub fn spend(&mut self, effort: f64) {
        self.spent += effort;
    }

    /// What has been spent so far.
    pub fn spent(&self) -> f64 {
        self.spent
    }

    /// Lets so much be spent from now on.
    pub fn allow(&mut self, more: f64) {
        self.allowed = self.spent + more;
    }

    /// What may still be spent.
    pub fn left(&self) -> f64 {
        self.allowed - self.spent
    }

    /// Iterations with a preconditioner that can be afforded.
    pub fn iterations(&self, kind: PreconditionerKind) -> u64 {
        (self.left() / self.costs.iteration(kind)) as u64
    }

    /// Whether a preconditioner can be afforded, and iterations that make it worth it.
    pub fn affords(&self, kind: PreconditionerKind) -> bool {
        let setup = if kind == PreconditionerKind::Multigrid { self.costs.multigrid_setup() } else { 0.0 };
        self.left() > WORTH * (setup + self.costs.preparation(kind))
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests {
    use super::*;
    use crate::scene::builtin;

    /// A preconditioner is worth it when more than one and a half times what it is prepared with may still be spent.
    #[test]
    fn preconditioners_need_the_means() {
        let (system, _) = builtin::cloth(16).unwrap().build().unwrap();
        let costs = CostModel::of(&system);
        let mut budget = Budget::new(costs);
        assert!(budget.affords(PreconditionerKind::Multigrid), "there is no limit at first");
        let [blocks, finest] =
            [PreconditionerKind::BlockJacobi, PreconditionerKind::Multigrid].map(|kind| costs.preparation(kind));
        let setup = finest + costs.multigrid_setup();
        for (kind, price) in [(PreconditionerKind::Multigrid, setup), (PreconditionerKind::BlockJacobi, blocks)] {
            assert!(price > 0.1);
            budget.spend(100.0);
            budget.allow(1.49 * price);
            assert!(!budget.affords(kind));
            budget.allow(1.51 * price);
            assert!(budget.affords(kind));
        }
    }

    /// What is spent is no longer left, and iterations are those that what is left pays for as a whole.
    #[test]
    fn iterations_are_as_many_as_what_is_left_pays_for() {
        let (system, _) = builtin::cloth(16).unwrap().build().unwrap();
        let mut budget = Budget::new(CostModel::of(&system));
        assert_eq!(budget.iterations(PreconditionerKind::None), u64::MAX);
        let iteration = budget.costs.iteration(PreconditionerKind::BlockJacobi);
        budget.spend(7.0);
        budget.allow(12.5 * iteration);
        assert_eq!(budget.iterations(PreconditionerKind::BlockJacobi), 12);
        budget.spend(2.0 * iteration);
        assert_eq!(budget.iterations(PreconditionerKind::BlockJacobi), 10);
        assert_eq!(budget.spent(), 7.0 + 2.0 * iteration);
    }
}
