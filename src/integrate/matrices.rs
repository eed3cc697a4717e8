//! The matrices and the right-hand side of one step, assembled for the caller.

use crate::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix};
use crate::error::Result;
use crate::force::{Extensions, add_elastic_force, add_undamped_external_forces, add_weight};
use crate::memory;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use nalgebra::Vector3;
use std::sync::Arc;

/// Everything of `A δx = b` at a state, over the free degrees of freedom ordered by particle, then axis.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::integrate::StepMatrices;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let step = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.5)?;
/// let k = sprung::nalgebra::DMatrix::from(&step.k.to_csc());
/// assert_eq!(k.diagonal().as_slice(), [-10.0, 10.0, 10.0]); // stable along the spring, unstable across
/// assert_eq!(step.b, [10.0, 0.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct StepMatrices {
    /// `A = M/dt² − G/dt − K`, in N/m.
    pub a: SymmetricMatrix,
    /// M, in kg.
    pub m: SymmetricMatrix,
    /// `G = ∂f/∂v`, of springs, drag and forces from outside, in N·s/m; empty without damping.
    pub g: SymmetricMatrix,
    /// `K = ∂f_el/∂x` under the option, in N/m; negative where the system is stable.
    pub k: SymmetricMatrix,
    /// `b = M v/dt + g + f_el(x) − A_fc δx_c`, in N, and of forces from outside `f_ext − D v`, with the prescribed motion on the right-hand side.
    pub b: Vec<f64>,
}

/// Bytes of four matrices and their patterns, at most, for a spring and for a particle.
const SPRING: u64 = 800;
const PARTICLE: u64 = 800;

impl StepMatrices {
    /// Assembles the linearised backward Euler step of length dt from a state.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn assemble(system: &System, state: &State, option: Stiffness, dt: f64) -> Result<Self> {
        let [springs, particles] = [system.active_springs().len() as u64, system.particles() as u64];
        memory::ensure(SPRING * springs + PARTICLE * particles, "the matrices of a step")?;
        let extensions = Extensions::at(system, state)?;
        let stiffness = Arc::new(SpringPattern::of_stiffness(system)?);
        let matrix = |pattern: Arc<SpringPattern>, combination| {
            let operator = SystemOperator::new(system, &extensions, option, combination);
            (SystemMatrix::assemble(pattern, &operator).into_matrix(), operator)
        };
        let (m, _) = matrix(Arc::new(SpringPattern::of_mass(system)?), Combination::MASS);
        let (g, _) = matrix(Arc::new(SpringPattern::of_damping(system)?), Combination::DAMPING);
        let (k, _) = matrix(stiffness.clone(), Combination::STIFFNESS);
        let (a, operator) = matrix(stiffness, Combination::step(dt));

        let mut force: Vec<Vector3<f64>> =
            system.masses().iter().zip(&state.velocities).map(|(m, v)| v * (m / dt)).collect();
        add_weight(system, &mut force);
        add_undamped_external_forces(system, &extensions, &state.moment(), &mut force);
        add_elastic_force(system, &extensions, &mut force);
        let mut displacement = vec![Vector3::zeros(); system.particles()];
        system.prescribed().displacement(state.time + dt, &state.positions, &mut displacement);
        let mut b = vec![0.0; system.dofs().len()];
        system.dofs().gather(&force, &mut b);
        operator.subtract_coupling(&displacement, &mut b);
        Ok(Self { a, m, g, k, b })
    }
}
