//! What may be chosen: the configurations that a choice tries.

use super::ladder::Ladder;
use super::{Configuration, Requirement};
use crate::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions};
use crate::spring::Stiffness;
use crate::system::System;

/// Degrees of freedom from which conjugate gradients can be cheaper than a factorization.
const ITERATIVE: usize = 300;

/// What methods do to vibrations that their steps do not resolve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Damp them, as backward Euler does.
    Euler,
    /// Damp them in the way of the W-method.
    Rosenbrock,
    /// Keep their energy, or blow up.
    Conservative,
}

impl Kind {
    pub const ALL: [Self; 3] = [Self::Euler, Self::Rosenbrock, Self::Conservative];
}

/// Of a method.
pub(super) fn kind(method: Method) -> Kind {
    match method {
        Method::LinearBackwardEuler | Method::BackwardEuler | Method::Bdf2 => Kind::Euler,
        Method::W2 | Method::Rodas4 => Kind::Rosenbrock,
        Method::ImplicitMidpoint | Method::Verlet | Method::Dop853 | Method::SymplecticEuler | Method::ForwardEuler => {
            Kind::Conservative
        }
    }
}

/// A ladder for every configuration that a requirement leaves open.
pub(super) fn candidates(system: &System, requirement: &Requirement) -> Vec<Ladder> {
    use Method::*;
    let Requirement { duration, par, accuracy, .. } = *requirement;
    // An error of this size in every step is far below the one that is allowed at the end.
    let tolerance = (1e-3 * accuracy).clamp(1e-12, 1e-4);
    let with = |method, stiffness, solver| {
        let linear = SolverOptions { solver, par, tolerance, ..SolverOptions::default() };
        Configuration { method, options: ImplicitOptions { stiffness, linear } }
    };
    let (on_demand, axial) = (StiffnessPolicy::OnDemand, StiffnessPolicy::Always(Stiffness::Axial));
    let pairs = [
        (Verlet, on_demand),
        (LinearBackwardEuler, axial),
        (LinearBackwardEuler, on_demand),
        (W2, on_demand),
        (W2, axial),
        (ImplicitMidpoint, on_demand),
        (BackwardEuler, on_demand),
    ];
    let mut solvers = vec![SolverChoice::Llt];
    if system.dofs().len() >= ITERATIVE {
        solvers.push(SolverChoice::Cg);
    }
    let asked = requirement.solver.filter(|solver| *solver != SolverChoice::Auto);
    let solvers = asked.map_or(solvers, |solver| vec![solver]);
    let mut ladders = Vec::new();
    for (method, stiffness) in pairs.into_iter().filter(|pair| requirement.method.is_none_or(|asked| asked == pair.0)) {
        if requirement.stiffness.is_some() && stiffness != on_demand {
            continue;
        }
        let stiffness = requirement.stiffness.unwrap_or(stiffness);
        let solvers = if method.is_implicit() { solvers.as_slice() } else { &[SolverChoice::Auto] };
        for &solver in solvers {
            let configuration = with(method, stiffness, solver);
            ladders.push(Ladder::fixed(configuration, duration));
            if method == W2 && stiffness != axial {
                ladders.push(Ladder::adaptive(configuration, duration));
            }
        }
    }
    if ladders.is_empty()
        && let Some(method) = requirement.method
    {
        ladders.push(Ladder::fixed(with(method, on_demand, SolverChoice::Auto), duration));
    }
    ladders
}
