//! Following a run: the property that it loses first, and after how many steps.

use super::critical::{MatrixPencil, Property};
use super::culprits::{self, Culprit};
use super::oracle::Oracle;
use super::rotation_limit::Turn;
use crate::eigen::{Pencil, eigenpair, unit};
use crate::error::Result;
use crate::force::{DegenerateSpring, SpringGeometry};
use crate::integrate::{ErrorIndicators, Monitor, MonitorOptions};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use nalgebra::Vector3;

/// A state at which A is not positive definite.
#[derive(Debug, Clone, PartialEq)]
pub struct Loss {
    /// Steps done before it.
    pub step: u64,
    /// Its time, in s.
    pub time: f64,
    /// The option of A.
    pub option: Stiffness,
    /// Negative pivots of A: directions of negative curvature, unless the factorization has lost its digits.
    pub negative: usize,
    /// `uᵀAu` of the unit vector u along which the culprits were found, in N/m.
    pub curvature: f64,
    /// The springs behind that curvature, worst first.
    pub culprits: Vec<Culprit>,
}

/// Watches A for one step length and option, state after state: one factorization each, on one symbolic analysis.
pub struct DefinitenessWatch<'s> {
    dt: f64,
    pencil: MatrixPencil<'s>,
    oracle: Oracle,
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
    fn of(property: Property, system: &'s System, state: &State, option: Stiffness, dt: f64, par: Par) -> Result<Self> {
        let pencil = MatrixPencil::new(system, SpringGeometry::at(system, state)?, property, option);
        let oracle = Oracle::analyse(system, par, &mut Work::default())?;
        Ok(Self { dt, pencil, oracle })
    }

    fn factor(&mut self, state: &State) -> Result<[bool; 2], DegenerateSpring> {
        self.pencil.update(state)?;
        self.pencil.set(self.dt.recip());
        let is_factored = self.oracle.factor(&self.pencil.operator, &mut Work::default()).is_ok();
        Ok([is_factored, is_factored && self.oracle.factorization.is_positive()])
    }

    /// The loss at a state; `None` where A is positive definite.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn look(&mut self, step: u64, state: &State) -> Result<Option<Loss>, DegenerateSpring> {
        let [factored, is_positive] = self.factor(state)?;
        if is_positive {
            return Ok(None);
        }
        let Self { pencil, oracle: Oracle { matrix, factorization, .. }, .. } = self;
        let mut direction = vec![0.0; pencil.system.dofs().len()];
        let negative = factorization.pivots().filter(|&(_, d)| d < 0.0).count();
        let option = pencil.option;
        let mut loss = Loss { step, time: state.time, option, negative, curvature: f64::NAN, culprits: Vec::new() };
        if factored && factorization.negative_direction(&mut direction) {
            let pair = |u: Vec<f64>| unit(u).map(|u| eigenpair(&Pencil::of(matrix.matrix()), u));
            let lost = pair(direction.clone());
            // One inverse iteration leads to the eigenvector nearest to zero, which may lie above it.
            factorization.substitute(&mut direction);
            if let Some(pair) = pair(direction).filter(|pair| pair.value < 0.0).or(lost) {
                loss.curvature = pair.value;
                loss.culprits = culprits::direction(pencil.system, &pencil.extensions, option, &pair).culprits;
            }
        }
        Ok(Some(loss))
    }
}

/// A point of a run.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Passed {
    /// Steps done.
    pub step: u64,
    /// The time, in s.
    pub time: f64,
}

/// Energy from nowhere.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Gain {
    /// The growth of energy since its lowest balance, in J: a passive system has none.
    pub gained: f64,
    /// Energy that the motion has exchanged until then, in J.
    pub exchanged: f64,
}

/// The properties that a run has lost, each where it was lost first.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FirstLosses {
    /// A is not positive definite.
    pub definite: Option<Loss>,
    /// A is, but the step is longer than the largest stable one. Watched under `Axial` only: the other options lose definiteness first, or nothing.
    pub stable: Option<Passed>,
    /// The step has rotated a spring too far.
    pub turning: Option<(Passed, Turn)>,
    /// Energy has appeared from nowhere.
    pub energy: Option<(Passed, Gain)>,
}

impl FirstLosses {
    /// The first step after which anything was lost.
    pub fn first(&self) -> Option<u64> {
        let steps = [
            self.definite.as_ref().map(|loss| loss.step),
            self.stable.map(|passed| passed.step),
            self.turning.map(|(passed, _)| passed.step),
            self.energy.map(|(passed, _)| passed.step),
        ];
        steps.into_iter().flatten().min()
    }
}

/// Follows a run, for one option and one step length, and remembers where each of four [properties](FirstLosses) was lost first. The first three are
/// properties of a state, known before the step that goes wrong; energy from nowhere, by the [energy balance](Monitor), follows a wrong step.
pub struct Follower<'s> {
    definiteness: DefinitenessWatch<'s>,
    stability: Option<DefinitenessWatch<'s>>,
    /// Positions and springs at the last state.
    before: Vec<Vector3<f64>>,
    extensions: SpringGeometry,
    monitor: Monitor<'s>,
    first: FirstLosses,
}

impl<'s> Follower<'s> {
    /// At the start of a run with steps of length dt, in s.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(system: &'s System, start: &State, option: Stiffness, dt: f64, par: Par) -> Result<Self> {
        let mut follower = Self {
            definiteness: DefinitenessWatch::new(system, start, option, dt, par)?,
            stability: (option == Stiffness::Axial)
                .then(|| DefinitenessWatch::of(Property::Stable, system, start, option, dt, par))
                .transpose()?,
            before: start.positions.clone(),
            extensions: SpringGeometry::at(system, start)?,
            monitor: Monitor::new(system, start, MonitorOptions { stops_unstable: false, ..MonitorOptions::ENERGY })?,
            first: FirstLosses::default(),
        };
        follower.look_at(0, start)?;
        Ok(follower)
    }

    /// Looks at the state after so many steps.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn look(&mut self, step: u64, state: &State) -> Result<(), DegenerateSpring> {
        let DefinitenessWatch { dt, pencil: MatrixPencil { system, option, .. }, .. } = &self.definiteness;
        let passed = Passed { step, time: state.time };
        if self.first.turning.is_none() {
            let moved: Vec<_> = state.positions.iter().zip(&self.before).map(|(x, before)| x - before).collect();
            let worst = Turn::worst(system, &self.extensions, &moved, *dt, *option);
            self.first.turning = worst.filter(|turn| turn.excess() > 1.0).map(|turn| (passed, turn));
            self.before.clone_from(&state.positions);
            self.extensions.update(system, state)?;
        }
        if self.first.energy.is_none() {
            // It does not end the run.
            let _ = self.monitor.enter(step, state, *dt);
            self.first.energy = self.gain(state).map(|gain| (passed, gain));
        }
        self.look_at(step, state)
    }

    /// Energy from nowhere, from a tenth of the energy exchanged on: methods that keep energy on average let it swing.
    fn gain(&self, state: &State) -> Option<Gain> {
        let ErrorIndicators { gained, exchanged, .. } = self.monitor.indicators(state);
        let (now, initial) = (self.monitor.energy(), self.monitor.initial());
        let rounding = 1e-10 * (now.kinetic + now.elastic + now.gravitational.abs() + initial.gravitational.abs());
        // A NaN is a gain too.
        let is_passive = gained <= 0.1 * exchanged || gained <= rounding;
        (!is_passive).then_some(Gain { gained, exchanged })
    }

    fn look_at(&mut self, step: u64, state: &State) -> Result<(), DegenerateSpring> {
        if self.first.definite.is_none() {
            self.first.definite = self.definiteness.look(step, state)?;
        }
        if let (None, Some(watch)) = (self.first.stable, &mut self.stability) {
            let [_, stable] = watch.factor(state)?;
            self.first.stable = (!stable).then_some(Passed { step, time: state.time });
        }
        Ok(())
    }

    /// The properties lost until now.
    pub fn first_losses(&self) -> &FirstLosses {
        &self.first
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

    /// Two free particles a metre apart with a pressed spring between them: across it A = [[a − c, c], [c, a − c]] with a = 0.2 N/m and c = 10 N/m,
    /// of the eigenvalues 0.2 and −19.8. Inverse iteration leads to the first, along which nothing is lost.
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
