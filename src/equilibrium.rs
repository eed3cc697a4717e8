//! Static equilibria, found as minima of the potential energy, and load paths through them.
//!
//! [`equilibrium`] searches downhill from a state; [`load_path`] follows the equilibrium as gravity and loads grow from zero. Both solve, on the free
//! coordinates and for a load factor λ (1 by default),
//!
//! ```text
//! f_el(x) + λ (M g + f_ext) = 0,      E(x) = Σ ½ k (l − l0)²/l0 − λ Σ (m g + f)·x.
//! ```
//!
//! A body that no support holds against a load has no equilibrium, which is found before the search. The result is classified by the inertia of −K.
//!
//! **Gradient.** For a cost J with `∂J/∂x = x̄` at the equilibrium, `−K λ = x̄` and `dJ/dp = λᵀ ∂f/∂p` for a parameter p (implicit function theorem).

mod factored;
mod iterative;
mod load_path;
mod search;

pub use load_path::{CriticalKind, CriticalLoad, LoadPath, load_path};

use self::search::Search;
use crate::assembly::SymmetricMatrix;
use crate::error::{Error, Invalid, Result, check_length};
use crate::force::SpringGeometry;
use crate::gradient::{Parameters, Point};
use crate::integrate::{Matrices, StiffnessPolicy};
use crate::modes::loads_at_rest;
use crate::rigid::{Body, bodies};
use crate::spring::Stiffness;
use crate::system::{Axes, State, System};
use crate::work::Work;
use nalgebra::Vector3;

/// How an equilibrium is searched for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EquilibriumOptions {
    /// The largest force left over the largest force that acts, at most.
    pub tolerance: f64,
    /// Newton steps at most.
    pub iterations: usize,
    /// The factor λ of gravity and loads.
    pub load: f64,
    /// Whether the search goes on from a saddle.
    pub leave_saddles: bool,
    /// The matrix of a step far from an equilibrium, where −K is not positive definite. Without a factorization `Progressive` is `OnDemand`.
    pub stiffness: StiffnessPolicy,
}

impl Default for EquilibriumOptions {
    fn default() -> Self {
        Self {
            tolerance: 1e-10,
            iterations: 2000,
            load: 1.0,
            leave_saddles: true,
            stiffness: StiffnessPolicy::OnDemand,
        }
    }
}

/// The kind of an equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stability {
    /// A minimum of the energy: −K is positive definite.
    Stable,
    /// −K has eigenvalues of zero and none below: the scene can move freely.
    Indifferent,
    /// A saddle: −K has negative eigenvalues.
    Unstable,
    /// There is none: a body falls.
    None,
    /// None was found within the iterations.
    NotConverged,
}

impl Stability {
    /// As in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stable => "stable",
            Self::Indifferent => "indifferent",
            Self::Unstable => "unstable",
            Self::None => "none",
            Self::NotConverged => "not-converged",
        }
    }
}

/// Numbers of eigenvalues by their signs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Signs {
    /// Below zero.
    pub negative: usize,
    /// Within rounding, and what the force that is left may change, of zero.
    pub zero: usize,
    /// Above zero.
    pub positive: usize,
}

/// Where a search for an equilibrium ended.
#[derive(Debug, Clone)]
pub struct Equilibrium {
    /// The kind.
    pub stability: Stability,
    /// The last configuration, at rest.
    pub state: State,
    /// λ, the factor of gravity and loads.
    pub load: f64,
    /// The largest force left on a free coordinate over the largest force that acts; where next to nothing acts, over what strains by rounding exert,
    /// times 1e11.
    pub residual: f64,
    /// E, in J, of all springs, those between held particles included, weight and constant loads.
    pub energy: f64,
    /// Newton steps.
    pub iterations: usize,
    /// Of −K at the end.
    pub inertia: Signs,
    /// Whether the inertia was counted, by a factorization. Where that would take too long or too much memory, the lowest eigenvalues that a search
    /// finds stand for it.
    pub counted: bool,
    /// The lowest eigenvalue of −K with its direction over the free degrees of freedom, where that is not positive.
    pub lowest: Option<(f64, Vec<f64>)>,
    /// Particles of bodies that nothing holds against their load.
    pub falling: Vec<usize>,
    /// Factorizations, solves and what else was done.
    pub work: Work,
}

/// The equilibrium that is reached downhill from a state.
///
/// # Errors
/// A state of another system; coincident ends of a spring at the start; a matrix that is too large to factor; options that cannot be used.
///
/// # Examples
/// ```
/// use sprung::equilibrium::{EquilibriumOptions, Stability, equilibrium};
/// use sprung::{Spring, SystemBuilder};
///
/// // 2 kg on a spring of 100 N, 1 m long: stretched to 1 + 2·9.81/100 m.
/// let mut builder = SystemBuilder::new();
/// builder.gravity(0.0, -9.81, 0.0);
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([0.6, -0.8, 0.0], 2.0);
/// builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
/// builder.hold(0);
/// let (system, state) = builder.build()?;
/// let found = equilibrium(&system, &state, EquilibriumOptions::default())?;
/// assert_eq!(found.stability, Stability::Stable);
/// assert!((found.state.positions[1].y + 1.1962).abs() < 1e-10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn equilibrium(system: &System, state: &State, options: EquilibriumOptions) -> Result<Equilibrium> {
    if !(options.tolerance > 0.0 && options.tolerance < 1.0) {
        return Err(Invalid::new("tolerance", options.tolerance, "must be between 0 and 1").into());
    }
    if !options.load.is_finite() {
        return Err(Invalid::new("load", options.load, "must be finite").into());
    }
    if system.external_forces().next().is_some() {
        return Err(Error::Unsupported(
            "the search for an equilibrium needs potential energies, and external forces given as functions have none"
                .into(),
        ));
    }
    let mut search = Search::new(system, state, options)?;
    search.falling = falling(system, &search.state, options.load);
    if search.falling.is_empty() { search.run() } else { search.end(Stability::None) }
}

/// Particles of bodies with an unsupported axis along which loads do not cancel.
fn falling(system: &System, state: &State, load: f64) -> Vec<usize> {
    let forces = loads(system, state, load);
    let falls = |body: &Body| {
        (0..system.dimension()).any(|axis| {
            let mut members = body.particles.iter().chain(&body.anchors);
            let along = || body.particles.iter().map(|&p| forces[p][axis]);
            let is_free = members.all(|&p| system.dofs().free_axes(p).contains(axis));
            is_free && along().sum::<f64>().abs() > 1e-12 * along().map(f64::abs).sum::<f64>()
        })
    };
    bodies(system).into_iter().filter(falls).flat_map(|body| body.particles).collect()
}

/// Weight and loads on every particle at rest, times a factor, in N.
fn loads(system: &System, state: &State, factor: f64) -> Vec<Vector3<f64>> {
    let mut forces = loads_at_rest(system, state);
    forces.iter_mut().for_each(|f| *f *= factor);
    forces
}

fn minus_k(system: &System, state: &State, option: Stiffness) -> Result<SymmetricMatrix> {
    let mut matrices = Matrices::new(system)?;
    matrices.update(state, option)?;
    Ok(matrices.k().scaled(-1.0))
}

impl Equilibrium {
    /// The derivatives of a cost by parameters, from its derivatives `∂J/∂x` by the positions at the equilibrium. Of positions, those of held
    /// coordinates count; damping and velocities are zero.
    ///
    /// # Errors
    /// An end that is no isolated equilibrium: −K is singular there; springs with a law of the caller's own; vectors of another length.
    pub fn gradient(&self, system: &System, positions: &[Vector3<f64>]) -> Result<Parameters> {
        check_length("positions", positions.len(), system.particles())?;
        if matches!(self.stability, Stability::None | Stability::NotConverged) || self.inertia.zero > 0 {
            return Err(Error::Unsupported(
                "a gradient needs an isolated equilibrium: −K is singular here, or the search did not arrive".into(),
            ));
        }
        if system.has_other_laws() {
            return Err(Error::Unsupported("gradients are those of the built-in spring law".into()));
        }
        let stiffness = minus_k(system, &self.state, Stiffness::Full)?;
        let dofs = system.dofs();
        let mut adjoint = dofs.reduced(positions);
        if !adjoint.is_empty() {
            let factored = stiffness.ldlt();
            adjoint = factored.map_err(|error| Error::Unsupported(error.to_string()))?.solve(&adjoint)?;
        }
        let geometry = SpringGeometry::at(system, &self.state)?;
        let at_rest = vec![Vector3::zeros(); system.particles()];
        let mut result = Parameters::zeros(system);
        let point = Point { geometry: &geometry, velocities: &at_rest, time: self.state.time };
        let [moved, _] = result.add_force_adjoint(system, &point, &dofs.full(&adjoint));
        result.masses.iter_mut().for_each(|m| *m *= self.load);
        result.gravity *= self.load;
        result.loads.iter_mut().for_each(|f| *f *= self.load);
        // Held coordinates move f by their stiffness, and J directly.
        for (p, (moved, direct)) in moved.iter().zip(positions).enumerate() {
            result.positions[p] = Axes::ALL.without(dofs.free_axes(p)).project(&(moved + direct));
        }
        Ok(result)
    }
}

#[cfg(test)]
mod tests;
