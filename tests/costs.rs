//! The cost model against measured times.

#[path = "../verification/costs/row.rs"]
mod row;

use row::Row;
use sprung::linear::{CostModel, FactorSize, OrderingMethod, PreconditionerKind};
use sprung::multigrid::Multigrid;
use sprung::scene::{Kind, builtin};

/// Costs that decide between solvers and methods: within this factor of the times.
const CLOSE: f64 = 1.5;

/// Coarse levels are denser in random networks than elsewhere.
const COARSE: f64 = 1.6;

/// An ordering depends on more than sizes, and is done once.
const ROUGH: f64 = 2.5;

#[test]
fn costs_are_those_that_were_measured() {
    let rows: Vec<Row> = serde_json::from_str(include_str!("../verification/costs.json")).unwrap();
    let mut far = Vec::new();
    for row in &rows {
        let kind = Kind::ALL.into_iter().find(|kind| kind.name() == row.scene).unwrap();
        let (system, _) = builtin(kind, row.size).unwrap().build().unwrap();
        let costs = CostModel::of(&system);
        let ordering = if row.dissected { OrderingMethod::NestedDissection } else { OrderingMethod::MinimumDegree };
        let size = FactorSize { entries: row.factor_entries, flops: row.factor_flops, ordering };
        let levels = costs.with_coarse_levels(Multigrid::new(&system).unwrap().multiplications());
        let direct = [
            ("factorization", costs.factorization(size), row.factorization),
            ("solve", costs.direct_solve(size), row.solve),
        ];
        let direct = direct.into_iter().filter_map(|(operation, cost, time)| Some((operation, cost, time?, CLOSE)));
        let pairs = [
            ("product", costs.product(), row.product, CLOSE),
            ("assembly", costs.assembly(), row.assembly, CLOSE),
            ("glance", costs.glance(), row.glance, ROUGH),
            ("analysis", costs.analysis(size), row.analysis, ROUGH),
            ("iteration", costs.iteration(PreconditionerKind::None), row.iteration_none, CLOSE),
            ("iteration, jacobi", costs.iteration(PreconditionerKind::Jacobi), row.iteration_jacobi, CLOSE),
            (
                "iteration, block-jacobi",
                costs.iteration(PreconditionerKind::BlockJacobi),
                row.iteration_block_jacobi,
                CLOSE,
            ),
            ("iteration, multigrid", costs.iteration(PreconditionerKind::Multigrid), row.iteration_multigrid, CLOSE),
            ("blocks", costs.preparation(PreconditionerKind::BlockJacobi), row.blocks, CLOSE),
            ("finest level", costs.preparation(PreconditionerKind::Multigrid), row.finest_level, COARSE),
            // One dense level has no others.
            ("multigrid set-up", levels.multigrid_setup(), row.multigrid_setup, CLOSE),
            ("multigrid set-up by sizes", costs.multigrid_setup(), row.multigrid_setup, COARSE),
            (
                "solve of one iteration",
                costs.iterative_solve() + costs.iteration(PreconditionerKind::BlockJacobi),
                row.solve_of_one_iteration,
                CLOSE,
            ),
        ];
        for (operation, cost, time, bound) in pairs.into_iter().chain(direct) {
            // What conjugate gradients do on a few coordinates is too short for the clock, and nothing depends on it.
            let iterates = ["product", "iterati", "multigr", "finest", "solve of"]
                .iter()
                .any(|start| operation.starts_with(start));
            let has_one_level = operation.starts_with("multigrid set-up") && cost == 0.0;
            if (system.dofs().len() <= 60 && iterates) || has_one_level {
                continue;
            }
            let ratio = cost / (time / row.force);
            if !(1.0 / bound..=bound).contains(&ratio) {
                far.push(format!(
                    "{} {}: {operation} is said to cost {ratio:.2} times what it does",
                    row.scene, row.size
                ));
            }
        }
    }
    assert!(far.is_empty(), "{} of {} scenes:\n{}", far.len(), rows.len(), far.join("\n"));
}
