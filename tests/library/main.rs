//! The library through its public interface.

#[path = "../common/sandbox.rs"]
mod sandbox;
#[path = "../common/systems.rs"]
mod systems;

mod assembly;
mod automatic;
mod bunny;
mod chart;
mod chart_advice;
mod check_jacobian;
mod critical_steps;
mod culprits;
mod edge_cases;
mod energy_balance;
mod examples;
mod factor_threads;
mod faulty;
mod inertia;
mod inspection_work;
mod magnified;
mod methods_adaptive;
mod methods_bdf2;
mod methods_bdf2_kinks;
mod methods_conservation;
mod methods_newton;
mod methods_order;
mod motions;
mod multigrid;
mod output_files;
mod products;
mod spectrum;
mod tame_cloth;
mod turning;
mod verify_any_scene;
mod verify_jacobian;
mod verify_solvers;
mod work_counts;
