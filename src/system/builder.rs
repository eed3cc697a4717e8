//! Construction of a checked [`System`] and its initial [`State`].

use super::loads::{check_length, check_times};
use super::{Axes, Constraint, DofMap, Motion, Prescribed, State, System, active_springs};
use crate::error::{Invalid, Result};
use crate::spring::{Extension, Spring};
use nalgebra::Vector3;

/// A description of a system, checked by [`build`](Self::build).
///
/// The fields are public so that large lists can be moved in. Keys in error messages are those of the scene format.
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
    /// The number of modelled axes: 1, 2 or 3. All vectors must be zero along the others.
    pub dimension: usize,
    /// The gravitational acceleration, in m/s².
    pub gravity: Vector3<f64>,
    /// x(0), in m.
    pub positions: Vec<Vector3<f64>>,
    /// v(0), in m/s; as many as positions.
    pub velocities: Vec<Vector3<f64>>,
    /// Masses, in kg; as many as positions.
    pub masses: Vec<f64>,
    /// The end points of every spring.
    pub pairs: Vec<[u32; 2]>,
    /// The parameters of every spring; as many as pairs.
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
        // `build` rejects u32::MAX as out of range.
        self.pairs.push([i, j].map(|p| u32::try_from(p).unwrap_or(u32::MAX)));
        self.springs.push(spring);
        self.springs.len() - 1
    }

    /// Prescribes coordinates.
    pub fn constrain(&mut self, constraint: Constraint) -> &mut Self {
        self.constraints.push(constraint);
        self
    }

    /// Holds a particle at its position.
    pub fn hold(&mut self, particle: usize) -> &mut Self {
        self.constrain(Constraint::hold([particle]))
    }

    /// Checks all values and returns the system and its state at time zero. Prescribed coordinates have the position and velocity of their motion.
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
            partitions: Default::default(),
            subdomain: None,
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
        for (key, list) in [("particles.positions", &self.positions), ("particles.velocities", &self.velocities)] {
            list.iter().enumerate().try_for_each(|(i, vector)| self.check_vector(key, Some(i), vector))?;
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

    /// An error unless a vector is finite, within the range of states, and zero along axes that are not modelled.
    fn check_vector(&self, key: &str, index: Option<usize>, v: &Vector3<f64>) -> Result<(), Invalid> {
        let rule = if v.iter().any(|c| !c.is_finite()) {
            "must be finite"
        } else if !State::is_finite_vector(v) {
            "must be at most 1e150 in size: larger numbers overflow when squared"
        } else if v.iter().skip(self.dimension).any(|&c| c != 0.0) {
            "must be zero along the axes that are not modelled"
        } else {
            return Ok(());
        };
        let components: Vec<f64> = v.iter().take(self.dimension).copied().collect();
        Err(Invalid { index, ..Invalid::new(key, format!("{components:?}"), rule) })
    }
}

/// Rows have 32-bit numbers, up to three for each particle.
fn check_count(particles: usize) -> Result<(), Invalid> {
    if particles > u32::MAX as usize / 3 {
        return Err(Invalid::new("particles.positions", particles, "more particles than can be numbered"));
    }
    Ok(())
}

/// The sum of a start and its offset must be within the range of states.
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

/// The initial energies and their sum must not overflow.
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
mod tests {
    use super::{State, SystemBuilder, check_count};
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion};
    use nalgebra::Vector3;

    /// The error for a particle at x₀ on a path.
    fn on_path(x: f64, times: &[f64], offsets: &[f64]) -> Option<String> {
        let mut builder = SystemBuilder::new();
        builder.particle([x, 0.0, 0.0], 1.0);
        let offsets = offsets.iter().map(|&x| Vector3::new(x, 0.0, 0.0)).collect();
        let motion = Motion::Path { times: times.to_vec(), offsets };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
        builder.build().err().map(|error| error.to_string())
    }

    /// The speed of a segment is the difference of its offsets over that of its times: 10¹⁵⁵ m/s is too much, 10¹⁴⁵ is not.
    #[test]
    fn starts_and_velocities_of_paths_are_within_what_states_may_have() {
        let times = [1.0, 1.0 + 2.0_f64.powi(-34)];
        for offsets in [[0.0, 1e135], [1e149, 1e149]] {
            assert_eq!(on_path(0.0, &times, &offsets), None);
        }
        for offsets in [[0.0, 1e145], [1e145, 0.0]] {
            let message = on_path(0.0, &times, &offsets).unwrap();
            assert!(message.starts_with("constraints[0].path.times[1]") && message.ends_with("before"), "{message}");
        }
        for (x, offset) in [(0.0, State::LARGEST), (State::LARGEST, 0.0)] {
            assert_eq!(on_path(x, &[0.0], &[offset]), None);
        }
        for sign in [1.0, -1.0] {
            let message = on_path(sign * State::LARGEST, &[0.0], &[sign * 1e140]).unwrap();
            assert!(message.starts_with("constraints[0].path.offsets = "), "{message}");
        }
    }

    /// The error for a system with these kinetic, gravitational and elastic energies, in 10³⁰⁰ J; the largest number is 1.797 · 10³⁰⁸. With
    /// v = g = 10¹⁵⁰ and x = −10¹⁵⁰ the energies of a mass m are ½ m 10³⁰⁰ and m 10³⁰⁰; that of a spring of rest length 2 and length 4 is k.
    fn with_energies([kinetic, gravitational, elastic]: [f64; 3]) -> Option<String> {
        const LITTLE: f64 = 1e-300;
        let mut builder = SystemBuilder::new();
        builder.gravity(State::LARGEST, 0.0, 0.0);
        let moving = builder.particle([0.0; 3], (2.0 * kinetic).max(LITTLE));
        builder.velocities[moving].y = State::LARGEST;
        builder.particle([-State::LARGEST, 0.0, 0.0], gravitational.max(LITTLE));
        builder.particle([0.0, 2.0, 0.0], LITTLE);
        builder.particle([0.0, 6.0, 0.0], LITTLE);
        builder.spring(2, 3, Spring { stiffness: (elastic * 1e300).max(LITTLE), rest_length: 2.0, damping: 0.0 });
        builder.build().err().map(|error| error.to_string())
    }

    #[test]
    fn energies_and_their_sum_are_numbers() {
        for energies in [[1.7e8, 0.0, 0.0], [0.0, 1.7e8, 0.0], [0.0, 0.0, 1.7e8], [0.5e8; 3]] {
            assert_eq!(with_energies(energies), None, "{energies:?}");
        }
        for (energies, key) in [
            ([1.9e8, 0.0, 0.0], "particles.masses[0]"),
            ([0.0, 1.9e8, 0.0], "particles.masses[1]"),
            ([1e8, 1e8, 0.0], "particles.masses[1]"),
            ([0.9e8, 0.0, 1e8], "springs.stiffness[0]"),
            ([0.0, 0.9e8, 1e8], "springs.stiffness[0]"),
        ] {
            let message = with_energies(energies).unwrap();
            assert!(message.starts_with(key) && message.ends_with("beyond the largest number"), "{message}");
        }
    }

    /// The error for two particles and a spring after a change.
    fn changed(change: impl FnOnce(&mut SystemBuilder)) -> Option<String> {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        change(&mut builder);
        builder.build().err().map(|error| error.to_string())
    }

    /// Rows can be numbered too: 2³² − 1 = 3 · 1 431 655 765.
    #[test]
    fn lists_have_an_entry_for_everything() {
        assert!(check_count(1_431_655_765).is_ok());
        assert!(check_count(1_431_655_766).is_err() && check_count(usize::MAX).is_err());
        assert_eq!(changed(|_| {}), None);
        for (message, key) in [
            (changed(|builder| _ = builder.masses.pop()), "particles.masses"),
            (changed(|builder| builder.velocities.push(Vector3::zeros())), "particles.velocities"),
            (changed(|builder| _ = builder.springs.pop()), "springs"),
        ] {
            let message = message.unwrap();
            assert!(message.starts_with(key) && message.contains("must have one entry for "), "{message}");
        }
    }
}
