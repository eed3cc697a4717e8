//! Assembled K, G, M, A and b.

use super::backward_euler::set_right_hand_side;
use super::ensure_room;
use crate::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix};
use crate::error::{Error, Invalid, Result};
use crate::force::SpringGeometry;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use nalgebra::Vector3;
use std::sync::Arc;

/// The matrices of a system at a state, over the free degrees of freedom ordered by particle, then axis. Patterns are computed once, values by every
/// [`update`](Self::update).
///
/// # Examples
/// ```
/// use sprung::integrate::Matrices;
/// use sprung::Stiffness;
///
/// # let mut builder = sprung::SystemBuilder::new();
/// # [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
/// # builder.hold(0).spring(0, 1, sprung::Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// let (system, mut state) = builder.build()?;
/// let mut matrices = Matrices::new(&system)?;
/// matrices.update(&state, Stiffness::Full)?;
/// let k = sprung::nalgebra::DMatrix::from(&matrices.k().to_csc());
/// assert_eq!(k.diagonal().as_slice(), [-10.0, 10.0, 10.0]); // stable along the spring, unstable across
/// assert_eq!(matrices.masses(), [1.0, 1.0, 1.0]);
///
/// // A step of 0.1 s, by A δx = b.
/// let (a, b) = (matrices.a(0.1)?, matrices.b(&state, 0.1)?);
/// let x = a.cholesky()?.solve(&b)?;
/// assert!((x[0] - 10.0 / 110.0).abs() < 1e-15);
///
/// // The values of another state on the same pattern.
/// state.positions[1].x = 2.0;
/// matrices.update(&state, Stiffness::Full)?;
/// assert_eq!(matrices.k().values()[0], -10.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Matrices<'s> {
    system: &'s System,
    stiffness: Arc<SpringPattern>,
    k: SystemMatrix,
    g: SystemMatrix,
    masses: Vec<f64>,
    at: Option<Linearization<'s>>,
}
struct Linearization<'s> {
    extensions: SpringGeometry,
    operator: SystemOperator<'s>,
    option: Stiffness,
}

impl<'s> Matrices<'s> {
    /// The patterns of a system; K and G are zero until the first [`update`](Self::update).
    ///
    /// # Errors
    /// A matrix that is too large.
    pub fn new(system: &'s System) -> Result<Self> {
        // Three matrices and their patterns, in bytes for a spring and a particle.
        ensure_room(system, [800, 800], "the matrices of a system")?;
        let stiffness = Arc::new(SpringPattern::of_stiffness(system)?);
        let dofs = system.dofs();
        Ok(Self {
            system,
            k: SystemMatrix::try_zeros(stiffness.clone())?,
            g: SystemMatrix::try_zeros(Arc::new(SpringPattern::of_damping(system)?))?,
            stiffness,
            masses: (0..dofs.len()).map(|row| system.masses()[dofs.dof(row).particle]).collect(),
            at: None,
        })
    }

    /// Computes K and G at a state, with the stiffness of an option.
    ///
    /// # Errors
    /// A state of another system; coincident ends of a spring. Without an update that succeeds there is neither A nor b.
    pub fn update(&mut self, state: &State, option: Stiffness) -> Result<()> {
        self.update_with(state, option, |operator, extensions, combination| {
            operator.update(extensions, option, combination);
        })
    }

    /// As [`update`](Self::update), with an option for every active spring.
    pub(crate) fn update_each(&mut self, state: &State, options: &[Stiffness]) -> Result<()> {
        self.update_with(state, Stiffness::Tension, |operator, extensions, combination| {
            operator.update_each(extensions, combination, |position| options[position]);
        })
    }

    fn update_with(
        &mut self,
        state: &State,
        option: Stiffness,
        set: impl Fn(&mut SystemOperator<'s>, &SpringGeometry, Combination),
    ) -> Result<()> {
        state.check(self.system)?;
        let mut at = if let Some(mut last) = self.at.take() {
            last.extensions.update(self.system, state)?;
            Linearization { option, ..last }
        } else {
            let extensions = SpringGeometry::at(self.system, state)?;
            let operator = SystemOperator::new(self.system, &extensions, option, Combination::STIFFNESS);
            Linearization { extensions, operator, option }
        };
        for (matrix, combination) in [(&mut self.k, Combination::STIFFNESS), (&mut self.g, Combination::DAMPING)] {
            set(&mut at.operator, &at.extensions, combination);
            matrix.refill(&at.operator);
        }
        self.at = Some(at);
        Ok(())
    }

    /// `K = ∂f_el/∂x` under the option, in N/m; negative where the system is stable.
    pub fn k(&self) -> &SymmetricMatrix {
        self.k.matrix()
    }

    /// `G = ∂f/∂v`, of springs, drag and forces from outside, in N·s/m; empty without damping.
    pub fn g(&self) -> &SymmetricMatrix {
        self.g.matrix()
    }

    /// The diagonal of M, in kg.
    pub fn masses(&self) -> &[f64] {
        &self.masses
    }

    fn step_operator(&self, dt: f64) -> Result<(&Linearization<'s>, SystemOperator<'s>)> {
        if !(dt.is_finite() && dt > 0.0) {
            return Err(Invalid::new("dt", dt, "must be finite and positive").into());
        }
        let at =
            self.at.as_ref().ok_or_else(|| Error::Unsupported("A and b need a state: call update first".into()))?;
        Ok((at, SystemOperator::new(self.system, &at.extensions, at.option, Combination::step(dt))))
    }

    /// `A = M/dt² − G/dt − K`, in N/m.
    ///
    /// # Errors
    /// A dt that is not positive; no state yet; too little memory.
    pub fn a(&self, dt: f64) -> Result<SymmetricMatrix> {
        let (_, operator) = self.step_operator(dt)?;
        let mut a = SystemMatrix::try_zeros(self.stiffness.clone())?;
        a.refill(&operator);
        Ok(a.into_matrix())
    }

    /// `b = M v/dt + g + f_el(x) + f_ext − D v − A_fc δx_c`, in N, with the prescribed motion on the right-hand side, for a step from the
    /// state of the last update; `state` has its velocities and time.
    ///
    /// # Errors
    /// A dt that is not positive; no state yet; a state of another system.
    pub fn b(&self, state: &State, dt: f64) -> Result<Vec<f64>> {
        let (Linearization { extensions, .. }, operator) = self.step_operator(dt)?;
        let system = self.system;
        state.check(system)?;
        let mut force = vec![Vector3::zeros(); system.particles()];
        set_right_hand_side(system, extensions, state, dt, &mut force);
        let mut displacement = vec![Vector3::zeros(); system.particles()];
        system.prescribed().displacement(state.time + dt, &state.positions, &mut displacement);
        let mut b = vec![0.0; system.dofs().len()];
        system.dofs().gather(&force, &mut b);
        operator.subtract_coupling(&displacement, &mut b);
        Ok(b)
    }
}

/// The matrices and the right-hand side of one step `A δx = b`.
#[derive(Debug, Clone)]
pub struct StepMatrices {
    /// `A = M/dt² − G/dt − K`, in N/m.
    pub a: SymmetricMatrix,
    /// The diagonal of M, in kg.
    pub m: Vec<f64>,
    /// `G = ∂f/∂v`, in N·s/m; empty without damping.
    pub g: SymmetricMatrix,
    /// `K = ∂f_el/∂x` under the option, in N/m.
    pub k: SymmetricMatrix,
    /// The right-hand side, in N, see [`Matrices::b`].
    pub b: Vec<f64>,
}

impl StepMatrices {
    /// Assembles the linearised backward Euler step of length dt from a state.
    ///
    /// # Errors
    /// A dt that is not positive; a state of another system; coincident ends of a spring; a matrix that is too large.
    pub fn assemble(system: &System, state: &State, option: Stiffness, dt: f64) -> Result<Self> {
        let mut matrices = Matrices::new(system)?;
        matrices.update(state, option)?;
        let (a, b) = (matrices.a(dt)?, matrices.b(state, dt)?);
        let Matrices { k, g, masses, .. } = matrices;
        Ok(Self { a, m: masses, g: g.into_matrix(), k: k.into_matrix(), b })
    }
}
