//! From a [`Scene`] to a checked [`System`] and its initial [`State`].

use super::schema::{AxisName, ConstraintEntry, TimeSettings};
use super::{Drag, Flags, Gravity, MeshGeometry, Row, Scene, Values};
use crate::error::{Error, Invalid, Result, each};
use crate::memory;
use crate::spring::{Extension, Spring};
use crate::system::{
    Actuation, Axes, Behaviour, Constraint, Curve, Loads, Motion, State, System, SystemBuilder, check_length,
};
use nalgebra::Vector3;

/// A scene that has been built.
#[derive(Debug, Clone)]
pub struct Built {
    /// The system.
    pub system: System,
    /// Its state at time zero.
    pub state: State,
    /// The triangles of its mesh, for display; empty where there is no mesh.
    pub triangles: Vec<[u32; 3]>,
    /// Notes on the mesh: loose parts, coincident and unused vertices, omitted faces.
    pub notes: Vec<String>,
}

impl Scene {
    /// Checks every value and builds the system and its state at time zero.
    ///
    /// # Errors
    /// [`Error::Invalid`] for the first value that breaks a rule, with file, key, index and value; a mesh that cannot be read is the
    /// value of `mesh.file`. [`Error::TooLarge`] for a scene that does not fit the memory.
    pub fn build(&self) -> Result<(System, State)> {
        self.build_with_notes().map(|built| (built.system, built.state))
    }

    /// As [`build`](Self::build), with the triangles of the mesh and notes on it.
    pub fn build_with_notes(&self) -> Result<Built> {
        let built = self.parts().and_then(|(builder, triangles, notes)| {
            let (behaviour, loads) = (self.behaviour(builder.pairs.len())?, self.loads(&builder)?);
            let (system, state) = builder.build()?;
            let system = system.with_behaviour(behaviour)?.with_loads(loads)?;
            Ok(Built { system, state, triangles, notes })
        });
        built.map_err(|error| self.without_index_of_one(error)).map_err(|error| match &self.file {
            Some(file) => error.in_file(file),
            None => error,
        })
    }

    /// The error of a value that is one number for all, which has no index.
    fn without_index_of_one(&self, error: Error) -> Error {
        let Error::Invalid(mut invalid) = error else { return error };
        let values = match invalid.key.as_str() {
            "particles.masses" => &self.particles.masses,
            "springs.stiffness" => &self.springs.stiffness,
            "springs.rest_lengths" => &self.springs.rest_lengths,
            "springs.damping" => &self.springs.damping,
            _ => &None,
        };
        if matches!(values, Some(Values::Uniform(_))) {
            invalid.index = None;
        }
        invalid.into()
    }

    /// The description of the system, with meshes read, single numbers spread and absent values filled in, but without loads, drag,
    /// gravity in time, actuation and `tension_only`.
    pub fn builder(&self) -> Result<SystemBuilder> {
        self.parts().map(|(builder, ..)| builder)
    }

    fn parts(&self) -> Result<(SystemBuilder, Vec<[u32; 3]>, Vec<String>)> {
        let (dimension, mesh) = self.geometry()?;
        let n = mesh.vertices.len();
        // Bytes of a particle and of a spring, checking and sorting included.
        memory::ensure(400 * n as u64 + 160 * mesh.edges.len() as u64, "the scene")?;
        let velocities = match &self.particles.velocities {
            Some(rows) => vectors("particles.velocities", rows, dimension)?,
            None => vec![Vector3::zeros(); n],
        };
        check_length("particles.velocities", velocities.len(), n, "particles")?;
        let gravity = match &self.gravity {
            Some(Gravity::Constant(row)) => vector("gravity", None, row, dimension)?,
            Some(Gravity::Path(_)) | None => Vector3::zeros(),
        };
        let springs = self.springs(&mesh.vertices, &mesh.edges)?;
        self.check_edges(&mesh, &springs)?;
        let masses = required("particles.masses", &self.particles.masses, (n, "particles"), Rule::Positive)?;
        let constraints = self.constraints.iter().enumerate();
        let constraints = constraints.map(|(index, entry)| constraint(index, entry, dimension));
        let builder = SystemBuilder {
            dimension,
            gravity,
            velocities,
            masses: (0..n).map(|p| masses.get(p)).collect(),
            constraints: constraints.collect::<Result<_, _>>()?,
            positions: mesh.vertices,
            pairs: mesh.edges,
            springs,
        };
        Ok((builder, mesh.triangles, mesh.notes))
    }

    /// Dimension, and positions and pairs from the lists or from the mesh.
    fn geometry(&self) -> Result<(usize, MeshGeometry)> {
        let (positions, pairs) = (&self.particles.positions, &self.springs.pairs);
        let Some(mesh) = &self.mesh else {
            let dimension = positions.first().map(Row::dimension);
            let dimension = dimension.or(self.gravity.as_ref().and_then(Gravity::dimension)).unwrap_or(3);
            let vertices = vectors("particles.positions", positions, dimension)?;
            return Ok((dimension, MeshGeometry::of_lists(vertices, pairs.clone())));
        };
        for (key, length) in [("particles.positions", positions.len()), ("springs.pairs", pairs.len())] {
            if length > 0 {
                return Err(Invalid::new(key, format!("a list of {length}"), "must be absent: [mesh] fills it").into());
            }
        }
        let scale = mesh.scale.unwrap_or(1.0);
        Rule::Positive.check("mesh.scale", scale)?;
        let folder = self.file.as_deref().and_then(std::path::Path::parent).unwrap_or("".as_ref());
        let path = folder.join(&mesh.file);
        let invalid = |rule: &str| Invalid::new("mesh.file", format!("{:?}", mesh.file), rule);
        let mut geometry = MeshGeometry::load(&path).map_err(|error| {
            // A path written as in the scene is not repeated.
            let is_as_written = path.as_os_str() == mesh.file.as_str();
            let (text, start) = (error.to_string(), format!("{}: ", path.display()));
            invalid(text.strip_prefix(&start).filter(|_| is_as_written).unwrap_or(&text))
        })?;
        geometry.vertices.iter_mut().for_each(|x| *x *= scale);
        if let Some(vertex) = geometry.vertices.iter().position(|x| !State::is_finite_vector(x)) {
            let (number, place) = (geometry.number(vertex), Vec::from_iter(&geometry.vertices[vertex]));
            let rule = format!("vertex {number} is at {place:?} m: must be at most 1e150 in size");
            return Err(invalid(&rule).into());
        }
        if let Some(weld) = mesh.weld {
            Rule::NotNegative.check("mesh.weld", weld)?;
            geometry.weld(weld);
        }
        geometry.add_notes();
        Ok((3, geometry))
    }

    /// Names the place in the mesh file of an edge of zero length, which the builder would reject by its spring's number.
    fn check_edges(&self, geometry: &MeshGeometry, springs: &[Spring]) -> Result<(), Invalid> {
        let Some(mesh) = &self.mesh else { return Ok(()) };
        let is_invalid = |(pair, spring): (&[u32; 2], &Spring)| {
            spring.rest_length != 0.0 && distance(&geometry.vertices, pair).is_none()
        };
        let Some(edge) = geometry.edges.iter().zip(springs).position(is_invalid) else { return Ok(()) };
        let rule = format!(
            "{} that lie at one place: a spring of zero current length (mesh.weld = 0 joins such vertices)",
            geometry.place(edge)
        );
        Err(Invalid::new("mesh.file", format!("{:?}", mesh.file), rule))
    }

    fn behaviour(&self, springs: usize) -> Result<Behaviour, Invalid> {
        let tension_only = match &self.springs.tension_only {
            None => Vec::new(),
            Some(Flags::Uniform(flag)) => vec![*flag; springs],
            Some(Flags::Each(flags)) => {
                check_length("springs.tension_only", flags.len(), springs, "springs")?;
                flags.clone()
            }
        };
        let actuation = self.springs.actuation.iter().map(|entry| Actuation {
            springs: entry.springs.iter().map(|&spring| spring as usize).collect(),
            factors: Curve { times: entry.path.times.clone(), values: entry.path.factors.clone() },
        });
        Ok(Behaviour { tension_only, actuation: actuation.collect() })
    }

    fn loads(&self, builder: &SystemBuilder) -> Result<Loads, Invalid> {
        let (count, dimension) = (builder.positions.len(), builder.dimension);
        let mut forces = vec![Vector3::zeros(); if self.forces.is_empty() { 0 } else { count }];
        for (index, entry) in self.forces.iter().enumerate() {
            let value = vector(&format!("forces[{index}].value"), None, &entry.value, dimension)?;
            if !State::is_finite_vector(&value) {
                let rule = "must be finite and at most 1e150 in size";
                return Err(Invalid::new(format!("forces[{index}].value"), format!("{:?}", entry.value), rule));
            }
            for (at, &particle) in entry.particles.iter().enumerate() {
                let Some(force) = forces.get_mut(particle as usize) else {
                    let rule = format!("names a particle that does not exist (there are {count})");
                    return Err(Invalid::new(format!("forces[{index}].particles"), particle, rule).at(at));
                };
                *force += value;
            }
        }
        let drag = match &self.drag {
            None => Vec::new(),
            Some(Drag { coefficient }) => {
                checked("drag.coefficient", coefficient, (count, "particles"), Rule::NotNegative)?;
                (0..count).map(|p| coefficient.get(p)).collect()
            }
        };
        let gravity = match &self.gravity {
            Some(Gravity::Path(path)) => {
                let values = vectors("gravity.values", &path.values, dimension)?;
                Some(Curve { times: path.times.clone(), values })
            }
            _ => None,
        };
        Ok(Loads { forces, drag, gravity })
    }

    fn springs<'s>(&'s self, positions: &[Vector3<f64>], pairs: &[[u32; 2]]) -> Result<Vec<Spring>, Invalid> {
        let items = (pairs.len(), "springs");
        let optional = |key, values: &'s Option<Values>| {
            values.as_ref().map(|values| checked(key, values, items, Rule::NotNegative)).transpose()
        };
        let stiffness = required("springs.stiffness", &self.springs.stiffness, items, Rule::Positive)?;
        let rest_lengths = optional("springs.rest_lengths", &self.springs.rest_lengths)?;
        let damping = optional("springs.damping", &self.springs.damping)?.unwrap_or(&Values::Uniform(0.0));
        let spring = |(s, pair): (usize, &[u32; 2])| Spring {
            stiffness: stiffness.get(s),
            rest_length: match rest_lengths {
                Some(lengths) => lengths.get(s),
                // The builder rejects springs without a length.
                None => distance(positions, pair).unwrap_or(f64::NAN),
            },
            damping: damping.get(s),
        };
        Ok(pairs.iter().enumerate().map(spring).collect())
    }
}

/// The positive current length of a spring; `None` where its ends coincide or one does not exist.
fn distance(positions: &[Vector3<f64>], &[i, j]: &[u32; 2]) -> Option<f64> {
    let (xi, xj) = (positions.get(i as usize)?, positions.get(j as usize)?);
    Extension::between(xi, xj).map(|at| at.length).filter(|length| *length > 0.0)
}

fn constraint(index: usize, entry: &ConstraintEntry, dimension: usize) -> Result<Constraint, Invalid> {
    let key = format!("constraints[{index}]");
    let mut axes = Axes::first(dimension);
    if let Some(list) = &entry.axes {
        if let Some((at, axis)) = list.iter().enumerate().find(|(_, axis)| axis.index() >= dimension) {
            let rule = format!("is not modelled: the scene's rows have length {dimension}");
            return Err(Invalid::new(format!("{key}.axes"), format!("{:?}", axis.letter()), rule).at(at));
        }
        axes = Axes::of(&list.iter().copied().map(AxisName::index).collect::<Vec<_>>());
    }
    let motion = match (&entry.velocity, &entry.path) {
        (Some(_), Some(_)) => {
            return Err(Invalid::new(key, "velocity and path", "give only one of the two"));
        }
        (Some(velocity), None) => Motion::Velocity(vector(&format!("{key}.velocity"), None, velocity, dimension)?),
        (None, Some(path)) => Motion::Path {
            times: path.times.clone(),
            offsets: vectors(&format!("{key}.path.offsets"), &path.offsets, dimension)?,
        },
        (None, None) => Motion::Held,
    };
    Ok(Constraint { particles: entry.particles.iter().map(|&particle| particle as usize).collect(), axes, motion })
}

fn vectors(key: &str, rows: &[Row], dimension: usize) -> Result<Vec<Vector3<f64>>, Invalid> {
    rows.iter().enumerate().map(|(index, row)| vector(key, Some(index), row, dimension)).collect()
}

fn vector(key: &str, index: Option<usize>, row: &Row, dimension: usize) -> Result<Vector3<f64>, Invalid> {
    if row.dimension() == dimension {
        return Ok(row.vector());
    }
    let rule = format!("must have length {dimension}, as the scene's other rows");
    Err(Invalid { index, ..Invalid::new(key, format!("{row:?}"), rule) })
}

/// The number of particles or springs, and what they are.
type Items = (usize, &'static str);

/// Checks a number for all, which has no index, and the length of a list; the builder checks its numbers.
fn checked<'v>(key: &str, values: &'v Values, (count, of): Items, rule: Rule) -> Result<&'v Values, Invalid> {
    match values {
        Values::Uniform(value) => rule.check(key, *value)?,
        Values::Each(values) => check_length(key, values.len(), count, of)?,
    }
    Ok(values)
}

fn required<'v>(key: &str, values: &'v Option<Values>, items: Items, rule: Rule) -> Result<&'v Values, Invalid> {
    match values {
        Some(values) => checked(key, values, items, rule),
        None if items.0 == 0 => Ok(&Values::Uniform(f64::NAN)),
        None => {
            let rule = format!("must be given, one number for all or one for {}", each(items.0, items.1));
            Err(Invalid::new(key, "", rule))
        }
    }
}

#[derive(Clone, Copy)]
enum Rule {
    Positive,
    NotNegative,
}

impl Rule {
    fn check(self, key: &str, value: f64) -> Result<(), Invalid> {
        match self {
            _ if !value.is_finite() => Err(Invalid::new(key, value, "must be finite")),
            Self::Positive if value <= 0.0 => Err(Invalid::new(key, value, "must be positive")),
            Self::NotNegative if value < 0.0 => Err(Invalid::new(key, value, "must not be negative")),
            _ => Ok(()),
        }
    }
}

impl TimeSettings {
    pub(super) fn check(&self) -> Result<(), Invalid> {
        self.dt.map_or(Ok(()), |dt| Rule::Positive.check("time.dt", dt))?;
        self.duration.map_or(Ok(()), |duration| Rule::NotNegative.check("time.duration", duration))
    }
}

#[cfg(test)]
mod tests {
    use crate::memory::watch::asked;
    use crate::scene::{Particles, Scene, Springs, Values};

    /// Particles in a row and springs between the first two.
    fn scene(particles: usize, springs: usize) -> Scene {
        Scene {
            particles: Particles {
                positions: (0..particles).map(|p| [p as f64, 0.0, 0.0].into()).collect(),
                masses: Some(Values::Uniform(2.0)),
                ..Particles::default()
            },
            springs: Springs {
                pairs: vec![[0, 1]; springs],
                stiffness: Some(Values::Uniform(3.0)),
                ..Springs::default()
            },
            ..Scene::default()
        }
    }

    /// The reserved memory covers the description, whether most of it is particles or springs.
    #[test]
    fn memory_is_reserved_for_particles_and_springs() {
        for (particles, springs) in [(3000, 1), (2, 3000)] {
            let (builder, bytes) = asked("the scene", || scene(particles, springs).builder().unwrap());
            let of_particles = [&builder.positions, &builder.velocities].map(|list| size_of_val(&list[..]));
            let of_springs = size_of_val(&builder.pairs[..]) + size_of_val(&builder.springs[..]);
            let total = of_particles.iter().sum::<usize>() + size_of_val(&builder.masses[..]) + of_springs;
            assert!(total > 30 * 3000 && total < bytes as usize, "{total} {bytes}");
            let spring = builder.springs[0];
            assert_eq!((builder.masses[1], spring.stiffness, spring.rest_length), (2.0, 3.0, 1.0));
        }
    }
}
