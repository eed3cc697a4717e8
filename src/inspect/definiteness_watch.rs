//! Watching definiteness along a run: when it is first lost, and where.

use super::culprits::{Culprit, direction};
use super::matrix_pencil::{MatrixPencil, Property};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::eigen::{Pencil, eigenpair, unit};
use crate::error::Result;
use crate::force::{DegenerateSpring, SpringGeometry};
use crate::linear::Ldlt;
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::Par;
use std::sync::Arc;

/// A state at which A is not positive definite.
#[derive(Debug, Clone, PartialEq)]
pub struct Loss {
    /// Steps done before it.
    pub step: u64,
    /// Its time, in s.
    pub time: f64,
    /// The option of A.
    pub option: Stiffness,
    /// Negative pivots of A, the number of directions of negative curvature where the factorization has not lost its digits.
    pub negative: usize,
    /// `uᵀAu` of the unit vector u along which the culprits were found, in N/m.
    pub curvature: f64,
    /// The springs behind that curvature, worst first.
    pub culprits: Vec<Culprit>,
}

/// Looks at A for one step length and option, state after state: one factorization each, no symbolic analysis after the first.
///
/// # Examples
/// ```
/// use faer::Par;
/// use sprung::Stiffness;
/// use sprung::inspect::DefinitenessWatch;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// // A step of one second is too long for a compressed spring.
/// let mut watch = DefinitenessWatch::new(&system, &state, Stiffness::Full, 1.0, Par::Seq)?;
/// assert!(watch.look(0, &state)?.is_some());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct DefinitenessWatch<'s> {
    system: &'s System,
    property: Property,
    option: Stiffness,
    dt: f64,
    pencil: MatrixPencil<'s>,
    matrix: SystemMatrix,
    factorization: Ldlt,
    direction: Vec<f64>,
}

impl<'s> DefinitenessWatch<'s> {
    /// For steps of length dt of a system in a state like the given one.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, option: Stiffness, dt: f64, par: Par) -> Result<Self> {
        Self::of(Property::Definite, system, state, option, dt, par)
    }

    /// As [`new`](Self::new), for the matrix whose definiteness is that property.
    pub(super) fn of(
        property: Property,
        system: &'s System,
        state: &State,
        option: Stiffness,
        dt: f64,
        par: Par,
    ) -> Result<Self> {
        let pencil = MatrixPencil::new(system, SpringGeometry::at(system, state)?);
        let matrix = SystemMatrix::zeros(Arc::new(SpringPattern::of_stiffness(system)?));
        let factorization = Ldlt::analyse(matrix.matrix().pattern(), par)?;
        let direction = vec![0.0; system.dofs().len()];
        Ok(Self { system, property, option, dt, pencil, matrix, factorization, direction })
    }

    /// Whether the matrix can be factored at a state, and is positive definite.
    fn factor(&mut self, state: &State) -> Result<[bool; 2], DegenerateSpring> {
        self.pencil.update(state)?;
        self.pencil.set(self.property, self.option, self.dt.recip());
        self.matrix.refill(self.pencil.operator());
        let is_factored = self.factorization.factor(self.matrix.matrix()).is_ok();
        Ok([is_factored, is_factored && self.factorization.is_positive()])
    }

    /// Whether the property holds at a state.
    pub(super) fn holds(&mut self, state: &State) -> Result<bool, DegenerateSpring> {
        self.factor(state).map(|[_, is_positive]| is_positive)
    }

    /// What is lost at a state; `None` where A is positive definite.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn look(&mut self, step: u64, state: &State) -> Result<Option<Loss>, DegenerateSpring> {
        let [factored, is_positive] = self.factor(state)?;
        if is_positive {
            return Ok(None);
        }
        let negative = self.factorization.pivots().filter(|&(_, d)| d < 0.0).count();
        let option = self.option;
        let mut loss = Loss { step, time: state.time, option, negative, curvature: f64::NAN, culprits: Vec::new() };
        if factored && self.factorization.negative_direction(&mut self.direction) {
            let pencil = Pencil::of(self.matrix.matrix());
            let lost = unit(self.direction.clone()).map(|u| eigenpair(&pencil, u));
            // One inverse iteration brings out the eigenvector nearest to zero, the one that has just been lost, or one above zero.
            self.factorization.substitute(&mut self.direction);
            let nearest = unit(self.direction.clone()).map(|u| eigenpair(&pencil, u)).filter(|pair| pair.value < 0.0);
            if let Some(pair) = nearest.or(lost) {
                loss.curvature = pair.value;
                loss.culprits = direction(self.system, self.pencil.extensions(), self.option, &pair).culprits;
            }
        }
        Ok(Some(loss))
    }
}

#[cfg(test)]
mod tests {
    use super::DefinitenessWatch;
    use crate::inspect::fixtures::{pin, pinned};
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;
    use faer::Par;

    /// m/dt² is what the spring takes, exactly: A is not definite any more, and has no negative pivot yet.
    #[test]
    fn a_pivot_of_zero_is_a_loss_but_not_negative() {
        for (mass, negative) in [(11.0, None), (10.0, Some(0)), (9.0, Some(1))] {
            let (system, state) = pinned(&[pin(mass, 10.0)]);
            let mut watch = DefinitenessWatch::new(&system, &state, Stiffness::Full, 1.0, Par::Seq).unwrap();
            let loss = watch.look(7, &state).unwrap();
            assert_eq!(loss.map(|loss| loss.negative), negative, "{mass}");
        }
    }

    /// Two free particles a metre apart with a pressed spring between them: across it A = [[a − c, c], [c, a − c]] with a = 0.2 N/m and
    /// c = 10 N/m, of the eigenvalues 0.2 and −19.8. Inverse iteration leads to the first, along which nothing is lost.
    #[test]
    fn what_is_lost_has_negative_curvature_and_culprits() {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        let [i, j] = [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 0.2));
        builder.spring(i, j, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let mut watch = DefinitenessWatch::new(&system, &state, Stiffness::Full, 1.0, Par::Seq).unwrap();
        let loss = watch.look(0, &state).unwrap().unwrap();
        assert_eq!((loss.negative, loss.culprits.len()), (1, 1));
        assert!(loss.curvature < 0.0, "{}", loss.curvature);
    }
}
