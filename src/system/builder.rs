//! From a description in code or in a file to a checked [`System`] and its initial [`State`].

use super::curve::{check_length, check_times};
use super::{Axes, Constraint, DofMap, Motion, Prescribed, State, System, active_springs};
use crate::error::{Invalid, Result};
use crate::spring::{Extension, Spring};
use nalgebra::Vector3;

/// Description of a system, checked by [`build`](Self::build).
///
/// The fields are public so that large descriptions can be moved in whole; the methods are for writing one by hand.
/// Keys in error messages are those of the scene format.
///
/// # Examples
/// ```
/// use sprung::{Spring, SystemBuilder};
///
/// let mut builder = SystemBuilder::new();
/// builder.gravity(0.0, -9.81, 0.0);
/// let anchor = builder.particle([0.0, 0.0, 0.0], 1.0);
/// let bob = builder.particle([1.0, 0.0, 0.0], 2.0);
/// builder.spring(anchor, bob, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.3 });
/// builder.hold(anchor);
/// let (system, state) = builder.build()?;
/// assert_eq!((system.particles(), system.dofs().len(), state.time), (2, 3, 0.0));
///
/// let mut wrong = SystemBuilder::new();
/// wrong.particle([0.0, 0.0, 0.0], -1.0);
/// let message = wrong.build().err().map(|error| error.to_string());
/// assert_eq!(message.as_deref(), Some("particles.masses[0] = -1: must be finite and positive"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SystemBuilder {
    /// Modelled axes: 1, 2 or 3. The components of all vectors beyond it are ignored and must be zero.
    pub dimension: usize,
    /// Acceleration, in m/s².
    pub gravity: Vector3<f64>,
    /// x(0), in m.
    pub positions: Vec<Vector3<f64>>,
    /// v(0), in m/s; as many as positions.
    pub velocities: Vec<Vector3<f64>>,
    /// Masses, in kg; as many as positions.
    pub masses: Vec<f64>,
    /// End points of every spring.
    pub pairs: Vec<[u32; 2]>,
    /// Parameters of every spring; as many as pairs.
    pub springs: Vec<Spring>,
    /// Prescribed coordinates; later entries override earlier ones.
    pub constraints: Vec<Constraint>,
}

impl Default for SystemBuilder {
    fn default() -> Self {
        Self::new()
    }
}

impl SystemBuilder {
    /// An empty three-dimensional system without gravity.
    pub fn new() -> Self {
        Self {
            dimension: 3,
            gravity: Vector3::zeros(),
            positions: Vec::new(),
            velocities: Vec::new(),
            masses: Vec::new(),
            pairs: Vec::new(),
            springs: Vec::new(),
            constraints: Vec::new(),
        }
    }

    /// Sets the gravitational acceleration, in m/s².
    pub fn gravity(&mut self, x: f64, y: f64, z: f64) -> &mut Self {
        self.gravity = Vector3::new(x, y, z);
        self
    }

    /// Adds a particle at rest, position in m and mass in kg; returns its index.
    pub fn particle(&mut self, position: [f64; 3], mass: f64) -> usize {
        self.positions.push(position.into());
        self.velocities.push(Vector3::zeros());
        self.masses.push(mass);
        self.positions.len() - 1
    }

    /// Joins two particles by a spring; returns its index.
    pub fn spring(&mut self, i: usize, j: usize, spring: Spring) -> usize {
        // An index beyond u32 cannot name a particle; u32::MAX makes `build` reject it as out of range.
        self.pairs.push([i, j].map(|p| u32::try_from(p).unwrap_or(u32::MAX)));
        self.springs.push(spring);
        self.springs.len() - 1
    }

    /// Prescribes coordinates.
    pub fn constrain(&mut self, constraint: Constraint) -> &mut Self {
        self.constraints.push(constraint);
        self
    }

    /// Holds a particle where it is.
    pub fn hold(&mut self, particle: usize) -> &mut Self {
        self.constrain(Constraint::hold([particle]))
    }

    /// Checks everything and builds the system and its state at time zero. Prescribed coordinates start where
    /// their motion has them at time zero, with the motion's velocity.
    ///
    /// # Errors
    /// [`Invalid`] for the first value that breaks a rule of the scene format, with its key and index.
    pub fn build(self) -> Result<(System, State)> {
        self.check()?;
        let modelled = Axes::first(self.dimension);
        let (prescribed, held) = Prescribed::new(self.constraints, &self.positions, modelled);
        let dofs = DofMap::new(held.into_iter().map(|axes| modelled.without(axes)).collect());
        let active = active_springs(&self.pairs, &dofs);
        let has_special_springs = self.springs.iter().any(|spring| spring.rest_length == 0.0);
        let system = System {
            dimension: self.dimension,
            gravity: self.gravity,
            masses: self.masses,
            pairs: self.pairs,
            springs: self.springs,
            prescribed,
            dofs,
            active,
            law: None,
            behaviour: Default::default(),
            actuated: Default::default(),
            has_special_springs,
            loads: Default::default(),
            external: Vec::new(),
            shares: Default::default(),
            part: None,
        };
        let mut state = State { time: 0.0, positions: self.positions, velocities: self.velocities };
        state.prescribe(&system);
        check_prescribed(&system, &state)?;
        check_energies(&system, &state)?;
        Ok((system, state))
    }

    fn check(&self) -> Result<(), Invalid> {
        if !(1..=3).contains(&self.dimension) {
            return Err(Invalid::new("particles.positions", self.dimension, "rows must have 1, 2 or 3 entries"));
        }
        self.check_particles()?;
        self.check_springs()?;
        self.constraints.iter().enumerate().try_for_each(|(index, c)| self.check_constraint(index, c))
    }

    fn check_particles(&self) -> Result<(), Invalid> {
        let n = self.positions.len();
        check_count(n)?;
        check_length("particles.velocities", self.velocities.len(), n, "particles")?;
        check_length("particles.masses", self.masses.len(), n, "particles")?;
        self.check_vector("gravity", None, &self.gravity)?;
        for (i, x) in self.positions.iter().enumerate() {
            self.check_vector("particles.positions", Some(i), x)?;
        }
        for (i, v) in self.velocities.iter().enumerate() {
            self.check_vector("particles.velocities", Some(i), v)?;
        }
        self.masses.iter().enumerate().try_for_each(|(i, &m)| check_positive("particles.masses", i, m))
    }

    fn check_springs(&self) -> Result<(), Invalid> {
        let n = self.positions.len();
        check_length("springs.stiffness", self.springs.len(), self.pairs.len(), "springs")?;
        for (s, (&[i, j], spring)) in self.pairs.iter().zip(&self.springs).enumerate() {
            let wrong = |rule: String| Invalid::new("springs.pairs", format!("[{i}, {j}]"), rule).at(s);
            let (i, j) = (i as usize, j as usize);
            if i >= n || j >= n {
                return Err(wrong(format!("names a particle that does not exist (there are {n})")));
            }
            if i == j {
                return Err(wrong("joins a particle to itself".into()));
            }
            let has_length = || Extension::between(&self.positions[i], &self.positions[j]).is_some();
            if spring.rest_length != 0.0 && !has_length() {
                return Err(wrong("is a spring of zero current length".into()));
            }
            check_spring(s, spring)?;
        }
        Ok(())
    }

    fn check_constraint(&self, index: usize, constraint: &Constraint) -> Result<(), Invalid> {
        let key = format!("constraints[{index}]");
        for (at, &particle) in constraint.particles.iter().enumerate() {
            if particle >= self.positions.len() {
                let rule = format!("names a particle that does not exist (there are {})", self.positions.len());
                return Err(Invalid::new(format!("{key}.particles"), particle, rule).at(at));
            }
        }
        match &constraint.motion {
            Motion::Held => Ok(()),
            Motion::Velocity(v) => self.check_vector(&format!("{key}.velocity"), None, v),
            Motion::Path { times, offsets } => {
                let times_key = format!("{key}.path.times");
                let offsets_key = format!("{key}.path.offsets");
                check_times(&format!("{key}.path"), times, ("offsets", offsets.len()))?;
                offsets.iter().enumerate().try_for_each(|(at, x)| self.check_vector(&offsets_key, Some(at), x))?;
                for at in 1..times.len() {
                    let speed = (offsets[at] - offsets[at - 1]) / (times[at] - times[at - 1]);
                    if !State::is_finite_vector(&speed) {
                        let rule = "is not reached at a finite speed from the entry before";
                        return Err(Invalid::new(times_key, times[at], rule).at(at));
                    }
                }
                Ok(())
            }
        }
    }

    /// Finite, not beyond what states may have, and zero beyond the scene's dimension.
    fn check_vector(&self, key: &str, index: Option<usize>, v: &Vector3<f64>) -> Result<(), Invalid> {
        let rule = if v.iter().any(|c| !c.is_finite()) {
            "must be finite"
        } else if !State::is_finite_vector(v) {
            "must be at most 1e150 in size: squares of more are beyond the largest number"
        } else if v.iter().skip(self.dimension).any(|&c| c != 0.0) {
            "must be zero along the axes that are not modelled"
        } else {
            return Ok(());
        };
        let components: Vec<f64> = v.iter().take(self.dimension).copied().collect();
        Err(Invalid { index, ..Invalid::new(key, format!("{components:?}"), rule) })
    }
}

/// Rows are numbered in u32 (as in the sparse matrices), three to a particle.
fn check_count(particles: usize) -> Result<(), Invalid> {
    if particles > u32::MAX as usize / 3 {
        return Err(Invalid::new("particles.positions", particles, "more particles than can be numbered"));
    }
    Ok(())
}

/// A particle and an offset may each be at most so far away, and their sum too.
fn check_prescribed(system: &System, state: &State) -> Result<(), Invalid> {
    for (dof, _, motion) in system.prescribed.iter() {
        let at = state.positions[dof.particle][dof.axis];
        if at.abs() > State::LARGEST {
            let rule = format!("is where {dof} would start: must be at most 1e150 in size");
            return Err(Invalid::new(format!("constraints[{motion}].path.offsets"), format!("{at:?}"), rule));
        }
    }
    Ok(())
}

/// What everything has at the start, or changes by in a moment, must be a number, and their sum too.
fn check_energies(system: &System, state: &State) -> Result<(), Invalid> {
    let rule = "makes an energy beyond the largest number";
    let mut total = 0.0;
    for (p, (&mass, (x, v))) in system.masses.iter().zip(state.positions.iter().zip(&state.velocities)).enumerate() {
        total += 0.5 * mass * v.norm_squared() + (mass * system.gravity.dot(x)).abs();
        if !f64::is_finite(total) {
            return Err(Invalid::new("particles.masses", mass, rule).at(p));
        }
    }
    for (s, (&[i, j], spring)) in system.pairs.iter().zip(&system.springs).enumerate() {
        let ends = [i, j].map(|end| &state.positions[end as usize]);
        total += Extension::between(ends[0], ends[1]).map_or(0.0, |at| spring.elastic_energy(&at));
        if !total.is_finite() {
            return Err(Invalid::new("springs.stiffness", spring.stiffness, rule).at(s));
        }
    }
    Ok(())
}

/// The parameters of one spring.
pub(super) fn check_spring(number: usize, spring: &Spring) -> Result<(), Invalid> {
    check_positive("springs.stiffness", number, spring.stiffness)?;
    for (key, value) in [("springs.rest_lengths", spring.rest_length), ("springs.damping", spring.damping)] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(Invalid::new(key, value, "must be finite and not negative").at(number));
        }
    }
    Ok(())
}

fn check_positive(key: &str, index: usize, value: f64) -> Result<(), Invalid> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Invalid::new(key, value, "must be finite and positive").at(index))
}

#[cfg(test)]
mod tests;
