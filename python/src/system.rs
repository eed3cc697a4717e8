//! Systems: from arrays, from files, ready ones; what is asked of a state.

use crate::arrays::{Given, Handed, handed, rows, state, vectors};
use crate::compute::{Flag, compute};
use crate::error::{of_argument, raised};
use crate::functions::{Functions, GivenForce};
use crate::names;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::{PyTraverseError, PyVisit};
use sprung::error::Invalid;
use sprung::force::{DegenerateSpring, Energy, Reactions, add_external_forces, add_weight};
use sprung::nalgebra::Vector3;
use sprung::output::AtomicFile;
use sprung::scene::{Built, Scene, TimeSettings, builtin, refined};
use sprung::spring::Extension;
use sprung::system::{Actuation, Axes, Behaviour, Constraint, Curve, Loads, Motion};
use sprung::{Error, Spring, State, SystemBuilder};
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

/// A system with the state it starts from, and what its scene says beside.
#[pyclass(frozen, module = "sprung._native")]
pub struct System {
    /// Without functions of the user's.
    pub system: Arc<sprung::System>,
    functions: Functions,
    pub start: State,
    pub name: String,
    pub time: TimeSettings,
    /// Of its mesh, to be shown.
    pub triangles: Vec<[u32; 3]>,
}

/// Particles, axes, velocity, and times and offsets of a path.
type GivenConstraint = (Vec<usize>, Option<Vec<usize>>, Option<[f64; 3]>, Option<(Vec<f64>, Vec<[f64; 3]>)>);

impl System {
    /// The system of a scene, and the notes on its mesh.
    fn of_scene(scene: Scene) -> PyResult<(Self, Vec<String>)> {
        let Built { system, state: start, triangles, notes } = scene.build_with_notes().map_err(raised)?;
        let (system, functions) = (Arc::new(system), Functions::default());
        Ok((Self { system, functions, start, name: scene.name, time: scene.time, triangles }, notes))
    }

    /// The system with the user's functions, for a computation that has this flag.
    pub fn bound(&self, py: Python<'_>, flag: &Arc<Flag>) -> Arc<sprung::System> {
        if self.functions.is_empty() {
            self.system.clone()
        } else {
            Arc::new(self.functions.bind(py, &self.system, flag))
        }
    }

    /// # Errors
    /// Functions, which no scene file can hold.
    fn check_can_be_written(&self) -> PyResult<()> {
        if self.functions.is_empty() {
            return Ok(());
        }
        Err(PyValueError::new_err(
            "forces and laws of the system are functions: they cannot be written to a scene file",
        ))
    }
}

#[pymethods]
impl System {
    /// From arrays that have the right types and lengths; values are checked here.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "one for each argument of the class's own constructor")]
    fn from_arrays(
        py: Python<'_>,
        name: String,
        positions: PyReadonlyArray2<'_, f64>,
        velocities: PyReadonlyArray2<'_, f64>,
        masses: PyReadonlyArray1<'_, f64>,
        pairs: PyReadonlyArray2<'_, u32>,
        stiffness: PyReadonlyArray1<'_, f64>,
        rest_lengths: Option<PyReadonlyArray1<'_, f64>>,
        damping: PyReadonlyArray1<'_, f64>,
        gravity: [f64; 3],
        constraints: Vec<GivenConstraint>,
    ) -> PyResult<Self> {
        let dimension = positions.as_array().dim().1;
        if pairs.as_array().dim().1 != 2 {
            let found = format!("rows of {}", pairs.as_array().dim().1);
            return Err(raised(Error::Invalid(Invalid::new("pairs", found, "must have two entries in each row"))));
        }
        let positions = vectors(&positions);
        let pairs: Vec<[u32; 2]> = pairs.as_array().outer_iter().map(|pair| [pair[0], pair[1]]).collect();
        let rest_lengths: Vec<f64> = match rest_lengths {
            Some(given) => given.as_array().to_vec(),
            None => pairs.iter().map(|pair| distance(&positions, pair)).collect(),
        };
        let parameters = stiffness.as_array().into_iter().zip(rest_lengths).zip(damping.as_array());
        let springs = parameters
            .map(|((&stiffness, rest_length), &damping)| Spring { stiffness, rest_length, damping })
            .collect();
        let builder = SystemBuilder {
            dimension,
            gravity: gravity.into(),
            velocities: vectors(&velocities),
            masses: masses.as_array().to_vec(),
            pairs,
            springs,
            constraints: constraints.into_iter().map(|given| constraint(given, dimension)).collect(),
            positions,
        };
        let (system, start) = py.detach(|| builder.build()).map_err(of_argument)?;
        let (system, functions, time, triangles) =
            (Arc::new(system), Functions::default(), TimeSettings::default(), Vec::new());
        Ok(Self { system, functions, start, name, time, triangles })
    }

    /// From a scene file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<(Self, Vec<String>)> {
        py.detach(|| Scene::load(path).map_err(raised).and_then(Self::of_scene))
    }

    /// From the text of a scene file, `toml` or `json`.
    #[staticmethod]
    fn parse(py: Python<'_>, text: &str, format: &str) -> PyResult<(Self, Vec<String>)> {
        let parse = match format {
            "toml" => Scene::from_toml,
            "json" => Scene::from_json,
            _ => {
                let rule = "must be one of toml, json";
                return Err(raised(Error::Invalid(Invalid::new("format", format!("{format:?}"), rule))));
            }
        };
        py.detach(|| parse(text).map_err(raised).and_then(Self::of_scene))
    }

    /// A ready scene.
    #[staticmethod]
    fn ready(py: Python<'_>, kind: &str, size: Option<usize>, refine: bool) -> PyResult<Self> {
        let kind = names::kind(kind)?;
        let size = size.unwrap_or(kind.default_size());
        let scene = if refine { refined(kind, size) } else { builtin(kind, size) };
        py.detach(|| scene.map_err(raised).and_then(Self::of_scene).map(|(system, _)| system))
    }

    /// The same system with more forces, and with a law for its springs where one is given.
    fn with_functions(&self, py: Python<'_>, forces: Vec<GivenForce>, law: Option<Py<PyAny>>) -> Self {
        let kept = |function: &Option<Py<PyAny>>| function.as_ref().map(|function| function.clone_ref(py));
        let before = self.functions.forces.iter();
        let before = before.map(|(value, derivatives, rate)| (value.clone_ref(py), kept(derivatives), kept(rate)));
        Self {
            system: self.system.clone(),
            functions: Functions {
                forces: before.chain(forces).collect(),
                law: law.or_else(|| kept(&self.functions.law)),
            },
            start: self.start.clone(),
            name: self.name.clone(),
            time: self.time,
            triangles: self.triangles.clone(),
        }
    }

    /// The same system with other parameters for its springs.
    fn with_springs(
        &self,
        py: Python<'_>,
        stiffness: PyReadonlyArray1<'_, f64>,
        rest_lengths: PyReadonlyArray1<'_, f64>,
        damping: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let (stiffness, rest_lengths, damping) = (stiffness.as_array(), rest_lengths.as_array(), damping.as_array());
        let parameters = stiffness.into_iter().zip(rest_lengths).zip(damping);
        let springs = parameters
            .map(|((&stiffness, &rest_length), &damping)| Spring { stiffness, rest_length, damping })
            .collect();
        let system = Arc::new(self.system.with_springs(springs).map_err(of_argument)?);
        Ok(Self { system, ..self.with_functions(py, Vec::new(), None) })
    }

    /// The same system with these loads, drag, gravity in time, tension-only springs and rest lengths in time.
    fn with_loads(
        &self,
        py: Python<'_>,
        loads: Option<PyReadonlyArray2<'_, f64>>,
        drag: PyReadonlyArray1<'_, f64>,
        gravity: Option<(Vec<f64>, Vec<[f64; 3]>)>,
        tension_only: Vec<bool>,
        actuation: Vec<(Vec<usize>, Vec<f64>, Vec<f64>)>,
    ) -> PyResult<Self> {
        let gravity =
            gravity.map(|(times, values)| Curve { times, values: values.into_iter().map(Vector3::from).collect() });
        let loads = Loads {
            forces: loads.map(|loads| vectors(&loads)).unwrap_or_default(),
            drag: Some(drag.as_array().to_vec()).filter(|drag| drag.iter().any(|&c| c != 0.0)).unwrap_or_default(),
            gravity,
        };
        let actuation = actuation.into_iter();
        let actuation =
            actuation.map(|(springs, times, values)| Actuation { springs, factors: Curve { times, values } }).collect();
        let system = (*self.system).clone().with_behaviour(Behaviour { tension_only, actuation });
        let system = system.and_then(|system| system.with_loads(loads)).map_err(of_argument)?;
        Ok(Self { system: Arc::new(system), ..self.with_functions(py, Vec::new(), None) })
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.functions.traverse(&visit)
    }

    /// The system at a state as a scene file, `toml` or `json`.
    fn write(&self, py: Python<'_>, given: Given<'_>, format: &str) -> PyResult<String> {
        self.check_can_be_written()?;
        let state = state(&self.system, &given)?;
        let is_json = format == "json";
        Ok(py.detach(|| {
            let scene = Scene { time: self.time, ..Scene::snapshot(&self.name, &self.system, &state) };
            if is_json { scene.to_json() } else { scene.to_toml() }
        }))
    }

    /// Writes the system at a state as a scene file, TOML, JSON or NumPy arrays by its extension, whole or not at all.
    fn save(&self, py: Python<'_>, given: Given<'_>, path: PathBuf) -> PyResult<()> {
        self.check_can_be_written()?;
        let state = state(&self.system, &given)?;
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_owned();
        if !["toml", "json", "npz"].contains(&extension.as_str()) {
            let rule = "a scene file must end in .toml, .json or .npz";
            return Err(raised(Error::Usage(format!("{}: {rule}", path.display()))));
        }
        let written = py.detach(|| {
            let scene = Scene { time: self.time, ..Scene::snapshot(&self.name, &self.system, &state) };
            AtomicFile::write(path, |file| match extension.as_str() {
                "toml" => file.write_all(scene.to_toml().as_bytes()),
                "json" => file.write_all(scene.to_json().as_bytes()),
                _ => scene.write_npz(file),
            })
        });
        written.map_err(raised)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// Number of modelled axes.
    #[getter]
    fn dimension(&self) -> usize {
        self.system.dimension()
    }

    /// Number of free degrees of freedom.
    #[getter]
    fn order(&self) -> usize {
        self.system.dofs().len()
    }

    /// `time.dt` and `time.duration` of the scene.
    #[getter]
    fn time(&self) -> (Option<f64>, Option<f64>) {
        (self.time.dt, self.time.duration)
    }

    #[getter]
    fn gravity(&self) -> Vec<f64> {
        self.system.gravity().iter().take(self.system.dimension()).copied().collect()
    }

    /// Constant loads, a row for every particle.
    #[getter]
    fn loads<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut forces = self.system.loads().forces.clone();
        forces.resize(self.system.particles(), Vector3::zeros());
        rows(py, &forces, self.system.dimension())
    }

    #[getter]
    fn drag<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let mut drag = self.system.loads().drag.clone();
        drag.resize(self.system.particles(), 0.0);
        PyArray1::from_vec(py, drag)
    }

    #[getter]
    fn tension_only<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let springs = 0..self.system.springs().len();
        PyArray1::from_iter(py, springs.map(|spring| self.system.behaviour().is_tension_only(spring)))
    }

    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.system.masses())
    }

    #[getter]
    fn pairs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        use numpy::PyArrayMethods;
        let pairs = self.system.pairs();
        PyArray1::from_vec(py, pairs.as_flattened().to_vec()).reshape([pairs.len(), 2])
    }

    /// Stiffness, rest length and damping of every spring.
    #[getter]
    fn springs<'py>(&self, py: Python<'py>) -> [Bound<'py, PyArray1<f64>>; 3] {
        let each = |value: fn(&Spring) -> f64| PyArray1::from_iter(py, self.system.springs().iter().map(value));
        [each(|spring| spring.stiffness), each(|spring| spring.rest_length), each(|spring| spring.damping)]
    }

    /// Particle and axis of every row of the matrices.
    #[getter]
    fn dofs<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i8>>) {
        let dofs = || self.system.dofs().iter();
        let particles: Vec<i64> = dofs().map(|dof| dof.particle as i64).collect();
        let axes: Vec<i8> = dofs().map(|dof| dof.axis as i8).collect();
        (PyArray1::from_vec(py, particles), PyArray1::from_vec(py, axes))
    }

    /// The state that it starts from.
    fn start<'py>(&self, py: Python<'py>) -> PyResult<Handed<'py>> {
        handed(py, &self.system, &self.start)
    }

    /// Forces on all particles at a state, in N: those of springs, of damping, of gravity, from outside, or all.
    fn force<'py>(&self, py: Python<'py>, given: Given<'py>, kind: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let state = state(&self.system, &given)?;
        let [elastic, damping, weight, external] = match kind {
            "all" => [true; 4],
            "elastic" => [true, false, false, false],
            "damping" => [false, true, false, false],
            "weight" => [false, false, true, false],
            "external" => [false, false, false, true],
            _ => {
                let rule = "must be one of all, elastic, damping, weight, external";
                return Err(raised(Error::Invalid(Invalid::new("kind", format!("{kind:?}"), rule))));
            }
        };
        let flag = Flag::new();
        let system = &*self.bound(py, &flag);
        let force = compute(py, &flag, || -> sprung::Result<_> {
            let mut force = vec![Vector3::zeros(); system.particles()];
            if elastic || damping {
                add_spring_forces(system, &state, [elastic, damping], &mut force)?;
            }
            if weight {
                add_weight(system, &mut force);
            }
            if external {
                add_external_forces(system, &state.moment(), &mut force);
            }
            Ok(force)
        })?;
        rows(py, &force.map_err(raised)?, system.dimension())
    }

    /// Forces with which constraints act at a state, in N: a row for every particle, zero along free axes.
    fn reactions<'py>(&self, py: Python<'py>, given: Given<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let state = state(&self.system, &given)?;
        let flag = Flag::new();
        let system = self.bound(py, &flag);
        let found = compute(py, &flag, || Reactions::at(&system, &state))?.map_err(|error| raised(error.into()))?;
        let mut forces = vec![Vector3::zeros(); self.system.particles()];
        found.particles.iter().zip(&found.forces).for_each(|(&p, force)| forces[p] = *force);
        rows(py, &forces, self.system.dimension())
    }

    /// Kinetic, elastic and gravitational energy of a state, in J.
    fn energy(&self, py: Python<'_>, given: Given<'_>) -> PyResult<(f64, f64, f64)> {
        let state = state(&self.system, &given)?;
        let flag = Flag::new();
        let system = self.bound(py, &flag);
        let Energy { kinetic, elastic, gravitational } = compute(py, &flag, || Energy::of(&system, &state))?;
        Ok((kinetic, elastic, gravitational))
    }
}

/// Adds forces of springs, elastic ones and those of damping; of springs between two held particles too: they move nothing, and pull on what
/// holds them.
fn add_spring_forces(
    system: &sprung::System,
    state: &State,
    [elastic, damping]: [bool; 2],
    force: &mut [Vector3<f64>],
) -> sprung::Result<()> {
    for (number, spring) in system.springs_at(&state.moment()).iter().enumerate() {
        let pair @ [i, j] = system.pair(number);
        let at = system.extension(number, &state.positions[i], &state.positions[j]);
        let at = at.ok_or(DegenerateSpring { spring: number, pair })?;
        let mut f = Vector3::zeros();
        if elastic {
            f += spring.elastic_force(&at);
        }
        if damping && spring.damping > 0.0 {
            f += spring.damping_force(&at, &(state.velocities[i] - state.velocities[j]));
        }
        force[i] += f;
        force[j] -= f;
    }
    Ok(())
}

/// The length of a spring; NaN where an end does not exist, for which the builder rejects the pair.
fn distance(positions: &[Vector3<f64>], &[i, j]: &[u32; 2]) -> f64 {
    let ends = positions.get(i as usize).zip(positions.get(j as usize));
    // Of ends that coincide there is no distance to take for a rest length.
    ends.and_then(|(xi, xj)| Extension::between(xi, xj)).map_or(f64::NAN, |at| at.length)
}

fn constraint((particles, axes, velocity, path): GivenConstraint, dimension: usize) -> Constraint {
    let axes = axes.map_or(Axes::first(dimension), |axes| Axes::of(&axes));
    let motion = match (velocity, path) {
        (Some(velocity), _) => Motion::Velocity(velocity.into()),
        (None, Some((times, offsets))) => {
            Motion::Path { times, offsets: offsets.into_iter().map(Vector3::from).collect() }
        }
        (None, None) => Motion::Held,
    };
    Constraint { particles, axes, motion }
}
