//! Every answer to a matrix that is not definite, compared on one scene.
//!
//! One nonlinear backward Euler step of each length, and the search for the equilibrium (an infinite step), are solved with every stiffness option
//! and policy from the same start, by Cholesky factorizations, to a residual of [`TOLERANCE`] of the forces that balance in it. An option stays for
//! all iterations. The equations may have several solutions; so the potential that is reached and its definiteness belong to the result:
//!
//! ```text
//! Φ = ½ (v' − v)ᵀ M (v' − v) + U(x') − gᵀ M x',      definite: A(dt) at x', of a step;      E(x) and −K, of an equilibrium.
//! ```
//!
//! **Means and profiles.** Costs are compared as geometric means of the quotients to `on-demand`, over the problems that both solve. The performance profile
//! of Dolan and Moré (Mathematical Programming 91, 2002) is the part of all problems p that a solver s solves at no more than τ times the least
//! cost, `ρ_s(τ) = |{p : t_ps ≤ τ min_s t_ps}| / |P|`: at τ = 1 how often it is the best, for large τ how often it arrives at all.

use super::Deadline;
use crate::equilibrium::{EquilibriumOptions, Stability, equilibrium};
use crate::error::Result;
use crate::figure::{Axis, Plot, Series};
use crate::force::Energy;
use crate::inspect::Inertia;
use crate::integrate::{
    BackwardEuler, ImplicitOptions, NewtonOptions, Status, StepFailure, StepMatrices, StiffnessPolicy, TimeStepper,
};
use crate::linear::{SolverChoice, SolverOptions};
use crate::spring::Stiffness;
use crate::system::{State, System};
use serde::Serialize;
use std::time::{Duration, Instant};

/// The residual at the end over the forces that balance in it: the default of [`NewtonOptions`] and [`EquilibriumOptions`].
pub const TOLERANCE: f64 = 1e-10;

/// Iterations of a solve at most.
pub const ITERATIONS: u64 = 500;

/// One step, or the search for an equilibrium, under one option or policy.
#[derive(Debug, Clone, Serialize)]
pub struct Solve {
    /// The length of the step, in s; `None` for the equilibrium.
    pub dt: Option<f64>,
    /// The option or policy.
    pub stiffness: &'static str,
    /// As of a run; `"completed"` where the equations are solved.
    pub status: Status,
    /// The reason of a failure.
    pub message: Option<String>,
    /// Newton iterations.
    pub iterations: u64,
    /// Factorizations, those of refused matrices included.
    pub factorizations: u64,
    /// Matrices that were refused as indefinite; not counted on the way to an equilibrium.
    pub refused: Option<u64>,
    /// Transverse terms that were dropped, or under `absolute` changed in sign, in all matrices together; not counted on the way to an equilibrium.
    pub changed_terms: Option<u64>,
    /// Φ, or E of an equilibrium, at the end, in J; `None` after a failure.
    pub energy: Option<f64>,
    /// Negative eigenvalues of A(dt), or −K, with the full stiffness at the end; zero for a minimum. `None` after a failure.
    pub negative: Option<usize>,
    /// Time of the solve.
    pub wall_seconds: f64,
}

impl Solve {
    /// The equations were solved.
    pub fn is_solved(&self) -> bool {
        self.status == Status::Completed
    }

    fn costs(&self) -> [f64; 2] {
        [self.iterations, self.factorizations].map(|count| count.max(1) as f64)
    }
}

/// One backward Euler step of dt seconds from a state under a policy.
///
/// # Errors
/// Coincident ends of a spring in `state`; a state of another system; a matrix that is too large.
pub fn solve_step(system: &System, state: &State, dt: f64, policy: StiffnessPolicy) -> Result<Solve> {
    let linear = SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() };
    let options = ImplicitOptions { stiffness: policy, linear };
    let newton = NewtonOptions { tolerance: TOLERANCE, iteration_limit: ITERATIONS };
    let mut stepper = BackwardEuler::new(system, state, &options, newton)?;
    if let StiffnessPolicy::Always(_) = policy {
        stepper.keep_option();
    }
    let mut after = state.clone();
    let begin = Instant::now();
    let outcome = stepper.step(&mut after, dt);
    let wall_seconds = begin.elapsed().as_secs_f64();
    let work = stepper.statistics().work;
    let refused = matches!(outcome, Err(StepFailure::Solve(_)));
    let (energy, negative) = match outcome {
        Ok(()) => {
            let a = StepMatrices::assemble(system, &after, Stiffness::Full, dt)?.a;
            (Some(potential(system, state, &after)), Some(Inertia::of(&a)?.negative))
        }
        Err(_) => (None, None),
    };
    Ok(Solve {
        dt: Some(dt),
        stiffness: policy.name(),
        status: outcome.map_or_else(|failure| failure.status(), |()| Status::Completed),
        message: outcome.err().map(|failure| failure.to_string()),
        iterations: work.newton_iterations,
        factorizations: work.factorizations,
        // An iteration ends with one matrix that is accepted.
        refused: Some((work.factorizations + u64::from(refused)).saturating_sub(work.newton_iterations)),
        changed_terms: Some(stepper.changed_terms()),
        energy,
        negative,
        wall_seconds,
    })
}

/// The equilibrium that is reached downhill from a state under a policy.
///
/// # Errors
/// As of [`equilibrium`].
pub fn solve_equilibrium(system: &System, state: &State, stiffness: StiffnessPolicy) -> Result<Solve> {
    let iterations = ITERATIONS as usize;
    let options = EquilibriumOptions { tolerance: TOLERANCE, iterations, stiffness, ..EquilibriumOptions::default() };
    let begin = Instant::now();
    let found = equilibrium(system, state, options)?;
    let is_found = !matches!(found.stability, Stability::None | Stability::NotConverged);
    Ok(Solve {
        dt: None,
        stiffness: stiffness.name(),
        status: if is_found { Status::Completed } else { Status::NotConverged },
        message: (!is_found).then(|| format!("the search for an equilibrium ended as {}", found.stability.name())),
        iterations: found.iterations as u64,
        factorizations: found.work.factorizations,
        refused: None,
        changed_terms: None,
        energy: is_found.then_some(found.energy),
        negative: is_found.then_some(found.inertia.negative),
        wall_seconds: begin.elapsed().as_secs_f64(),
    })
}

/// Φ of a step without damping and loads, up to a constant of its start.
fn potential(system: &System, before: &State, after: &State) -> f64 {
    let energy = Energy::of(system, after);
    let change = before.velocities.iter().zip(&after.velocities).zip(system.masses());
    energy.elastic
        + energy.gravitational
        + change.map(|((v, w), mass)| 0.5 * mass * (w - v).norm_squared()).sum::<f64>()
}

/// Solves of one scene under every option and policy.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// The name of the scene.
    pub scene: String,
    /// The solves, by length of the step.
    pub solves: Vec<Solve>,
    /// Problems that the time was not enough for.
    pub skipped: usize,
}

impl Comparison {
    /// Compares steps of 1, 4, 16, 64 and 256 dt, in s, and the equilibrium, until the deadline.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a state of another system; a matrix that is too large.
    pub fn measure(scene: &str, system: &System, state: &State, dt: f64, until: Deadline) -> Result<Self> {
        let mut found = Self { scene: scene.into(), solves: Vec::new(), skipped: 0 };
        // Forces of the caller's own have no potential to go down.
        let equilibria = system.external_forces().next().is_none().then_some(None);
        for step in (0..5).map(|power| Some(4f64.powi(power) * dt)).chain(equilibria) {
            for policy in StiffnessPolicy::ALL {
                if !until.allows(Duration::ZERO) {
                    found.skipped += 1;
                    continue;
                }
                found.solves.push(match step {
                    Some(dt) => solve_step(system, state, dt, policy)?,
                    None => solve_equilibrium(system, state, policy)?,
                });
            }
        }
        Ok(found)
    }

    /// The problems of the comparison: the solves of each step under every policy.
    fn problems(&self) -> impl Iterator<Item = &[Solve]> {
        self.solves.chunk_by(|a, b| a.dt == b.dt).filter(|solves| solves.len() == StiffnessPolicy::ALL.len())
    }

    /// The conclusions, from the data alone.
    pub fn conclusions(&self) -> Vec<String> {
        conclusions(&self.problems().collect::<Vec<_>>())
    }

    /// The performance profile of the factorizations.
    pub fn profile(&self) -> Plot {
        profile_figure(&self.problems().collect::<Vec<_>>())
    }
}

/// The means of the quotients of iterations and factorizations to `on-demand`, the largest quotients, and the numbers of problems solved, of a policy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratios {
    /// Geometric means; NaN where there is no problem that both solve.
    pub means: [f64; 2],
    /// Largest quotients.
    pub largest: [f64; 2],
    /// Problems that the policy solves.
    pub solved: usize,
}

/// The costs of a policy, by its index in [`StiffnessPolicy::ALL`], over those of the first, `on-demand`. A problem has a solve for each of them.
pub fn ratios(problems: &[&[Solve]], policy: usize) -> Ratios {
    let both = problems.iter().filter(|solves| solves[0].is_solved() && solves[policy].is_solved());
    let quotients: Vec<[f64; 2]> = both
        .map(|solves| {
            let (reference, costs) = (solves[0].costs(), solves[policy].costs());
            [costs[0] / reference[0], costs[1] / reference[1]]
        })
        .collect();
    let mean = |of: usize| (quotients.iter().map(|q| q[of].ln()).sum::<f64>() / quotients.len() as f64).exp();
    let largest = |of: usize| quotients.iter().fold(f64::NAN, |largest, q| q[of].max(largest));
    let solved = problems.iter().filter(|solves| solves[policy].is_solved()).count();
    Ratios { means: [mean(0), mean(1)], largest: [largest(0), largest(1)], solved }
}

/// Conclusions on problems, each with a solve for every policy.
pub fn conclusions(problems: &[&[Solve]]) -> Vec<String> {
    if problems.is_empty() {
        return vec!["No problem was solved under every option and policy in this time.".into()];
    }
    let names = StiffnessPolicy::ALL.map(StiffnessPolicy::name);
    let all: Vec<Ratios> = (0..names.len()).map(|policy| ratios(problems, policy)).collect();
    let most = all.iter().map(|ratios| ratios.solved).max().unwrap_or(0);
    // Arriving counts before cost, and factorizations cost most.
    let best = (0..names.len())
        .filter(|&policy| all[policy].solved == most)
        .min_by(|&a, &b| all[a].means[1].total_cmp(&all[b].means[1]));
    let mut sentences = Vec::new();
    if let Some(best) = best {
        let [iterations, factorizations] = all[best].means;
        let costs = match best {
            0 => String::new(),
            _ => format!(": {factorizations:.2} times those of on-demand, and {iterations:.2} times its iterations"),
        };
        sentences.push(format!(
            "{} arrives at {most} of {} solutions, as many as any, with the fewest factorizations of those that do{costs}.",
            names[best],
            problems.len(),
        ));
    }
    let fails = (0..names.len()).filter(|&policy| all[policy].solved < most);
    let fails: Vec<String> =
        fails.map(|policy| format!("{} at {}", names[policy], problems.len() - all[policy].solved)).collect();
    if !fails.is_empty() {
        sentences.push(format!("Others fail more often: {}.", fails.join(", ")));
    }
    let differs = |solves: &&&[Solve]| {
        let energies = || solves.iter().filter_map(|solve| solve.energy);
        let (low, high) = (energies().fold(f64::INFINITY, f64::min), energies().fold(f64::NEG_INFINITY, f64::max));
        // Far above what the stopping rule leaves.
        high - low > 1e-6 * high.abs().max(low.abs())
    };
    let several = problems.iter().filter(differs).count();
    if several > 0 {
        sentences.push(format!("At {several} of {} the answers reach different solutions.", problems.len()));
    }
    sentences
}

/// The performance profile of the factorizations of problems, each with a solve for every policy.
pub fn profile_figure(problems: &[&[Solve]]) -> Plot {
    let cost = |solve: &Solve| if solve.is_solved() { solve.costs()[1] } else { f64::INFINITY };
    // ρ of a policy at τ.
    let part = |policy: usize, tau: f64| {
        let least = |solves: &[Solve]| solves.iter().map(cost).fold(f64::INFINITY, f64::min);
        let is_within = |solves: &&&[Solve]| solves[policy].is_solved() && cost(&solves[policy]) <= tau * least(solves);
        problems.iter().filter(is_within).count() as f64 / problems.len() as f64
    };
    let plot = Plot::new(
        "Performance profile of the factorizations",
        Axis::logarithmic("factorizations over the fewest, τ"),
        Axis::linear("part of the problems solved"),
    );
    let taus = (0..=16).map(|quarter| 2f64.powf(f64::from(quarter) / 4.0));
    let policies = StiffnessPolicy::ALL.into_iter().enumerate().filter(|_| !problems.is_empty());
    policies
        .map(|(policy, each)| Series::line(each.name(), taus.clone().map(|tau| (tau, part(policy, tau))).collect()))
        .fold(plot, Plot::with_series)
        .concluding(conclusions(problems).into_iter().next().unwrap_or_default())
}

#[cfg(test)]
mod tests;
