//! What is stored of a scene in `verification/costs.json`.

use serde::{Deserialize, Serialize};

/// One scene: its sizes, and the time of each operation in ns.
#[derive(Serialize, Deserialize)]
pub struct Row {
    pub scene: String,
    pub size: usize,
    pub factor_entries: usize,
    pub factor_flops: f64,
    pub dissected: bool,
    pub force: f64,
    pub product: f64,
    pub assembly: f64,
    pub glance: f64,
    pub analysis: f64,
    /// Of scenes whose factorization takes seconds at most.
    pub factorization: Option<f64>,
    pub solve: Option<f64>,
    pub iteration_none: f64,
    pub iteration_jacobi: f64,
    pub iteration_block_jacobi: f64,
    pub iteration_multigrid: f64,
    pub blocks: f64,
    pub finest_level: f64,
    pub multigrid_setup: f64,
    /// With block Jacobi.
    pub solve_of_one_iteration: f64,
}
