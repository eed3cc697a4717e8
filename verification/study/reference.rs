//! The true motion of a scene, by an integrator of another origin on another writing of the forces.
//!
//! DOP853 of the crate `ode_solvers`, explicit, of order 8, with a local tolerance near rounding; it starts anew at every kink of
//! a prescribed motion. The same at a tolerance a hundred times as large tells how far the reference can be trusted: their
//! difference is the error of the *looser* one, and stands for that of the tighter. A third run starts from positions and velocities
//! that are off by 10⁻⁷ of the extent and tells how much the motion amplifies what is wrong at its start.
//!
//! Lengths are measured in the extent X of the scene and times in that of the run T, so that tolerances mean the same everywhere;
//! velocities in `√Ω X/T`, Ω = ωT with a bound of the highest frequency. Positions are rounded by 10⁻¹⁶ X, which the stiffest
//! springs make 10⁻¹⁶ Ω X/T of the velocities within one of their vibrations: a tolerance in X/T would ask for less than that.

use super::force::Model;
use super::random::direction;
use nalgebra::Vector3;
use ode_solvers::dop_shared::{IntegrationError, OutputType};
use ode_solvers::{DVector, Dop853};
use serde::{Deserialize, Serialize};
use sprung::accuracy::relative_position_error;
use std::cell::{Cell, RefCell};

/// Where the particles really are at the end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// x(T), in m; 3 for every particle.
    pub positions: Vec<f64>,
    /// v(T), in m/s.
    pub velocities: Vec<f64>,
    /// Relative position error, estimated from above.
    pub error: f64,
    /// By how much a deviation at the start has grown at the end, both in extents.
    pub amplification: f64,
    /// The shortest that a spring ever was, relative to its rest length.
    pub shortest: f64,
    /// Evaluations of the forces, all three runs together.
    pub evaluations: u64,
}

/// Local tolerances: of the reference, of the run that tells its error, and of the disturbed run.
const TOLERANCES: [f64; 3] = [1e-13, 1e-11, 1e-10];

/// Deviation at the start of the disturbed run, in extents: far above its tolerance, and far below what changes how a motion
/// amplifies.
const DEVIATION: f64 = 1e-7;

/// Springs evaluated at most, in one run: about half a minute.
const MOST_WORK: u64 = 2_000_000_000;

impl Reference {
    /// For `duration` seconds from time zero. `None` where it would take too long, or the motion does not go on: the ends of a
    /// spring that meet.
    pub fn compute(model: &Model, springs: usize, duration: f64) -> Option<Self> {
        let run = Motions::new(model, springs, duration);
        let [tight, loose, coarse] = TOLERANCES;
        let start = (model.positions.clone(), model.velocities.clone());
        let (positions, velocities) = run.integrate(&start, tight)?;
        let (second, _) = run.integrate(&start, loose)?;
        let shortest = run.shortest.get();
        let mut disturbed = start.clone();
        let free = &model.free;
        for (k, part) in direction(2 * free.len(), 1).into_iter().enumerate() {
            match free.get(k) {
                Some(&c) => disturbed.0[c] += DEVIATION * run.length * part,
                None => disturbed.1[free[k - free.len()]] += DEVIATION * run.length / duration * part,
            }
        }
        // Where even that goes wrong the motion is anything but predictable.
        let deviation = run.integrate(&disturbed, coarse).map_or(f64::MAX, |(x, _)| {
            let apart: f64 = x.iter().zip(&positions).map(|(a, b)| (a - b) * (a - b)).sum();
            apart.sqrt() / (DEVIATION * run.length)
        });
        let difference = relative_position_error(&vectors(&second), &vectors(&positions), &vectors(&model.positions));
        Some(Self {
            positions,
            velocities,
            error: difference.max(1e-15),
            amplification: deviation,
            shortest,
            evaluations: run.evaluations.get(),
        })
    }

    /// The positions as vectors.
    pub fn points(&self) -> Vec<Vector3<f64>> {
        vectors(&self.positions)
    }
}

fn vectors(flat: &[f64]) -> Vec<Vector3<f64>> {
    flat.chunks_exact(3).map(|v| Vector3::new(v[0], v[1], v[2])).collect()
}

/// The equations of motion in units of extent and run.
struct Motions<'m> {
    model: &'m Model,
    duration: f64,
    /// Root of the sum of the squares of the distances from the centroid, in m.
    length: f64,
    /// In m/s.
    velocity: f64,
    most_evaluations: u64,
    evaluations: Cell<u64>,
    shortest: Cell<f64>,
}

impl<'m> Motions<'m> {
    fn new(model: &'m Model, springs: usize, duration: f64) -> Self {
        let points = vectors(&model.positions);
        let length = sprung::accuracy::extent(&points, &points);
        let most_evaluations = MOST_WORK / springs.max(1) as u64;
        let velocity = length / duration * (model.highest_frequency() * duration).max(1.0).sqrt();
        let (evaluations, shortest) = (Cell::new(0), Cell::new(f64::INFINITY));
        Self { model, duration, length, velocity, most_evaluations, evaluations, shortest }
    }

    /// From full-length positions and velocities at time zero to those at the end.
    fn integrate(&self, start: &(Vec<f64>, Vec<f64>), tolerance: f64) -> Option<(Vec<f64>, Vec<f64>)> {
        let before = self.evaluations.get();
        let free = &self.model.free;
        let n = free.len();
        let (mut x, mut v) = start.clone();
        let velocity = self.velocity;
        let scaled = free.iter().map(|&c| x[c] / self.length).chain(free.iter().map(|&c| v[c] / velocity)).chain([0.0]);
        let mut y = DVector::from_iterator(2 * n + 1, scaled);
        let mut from = 0.0;
        let ends = self.model.kinks(0.0, self.duration).into_iter().chain([self.duration]);
        for to in ends {
            if n > 0 {
                y = self.interval(y, [from, to], tolerance, before)?;
            }
            from = to;
        }
        self.model.drive(self.duration, self.duration, &mut x, &mut v);
        for (k, &c) in free.iter().enumerate() {
            (x[c], v[c]) = (y[k] * self.length, y[n + k] * velocity);
        }
        x.iter().chain(&v).all(|c| c.is_finite()).then_some((x, v))
    }

    /// Between two kinks, in pieces of so many steps that the library's record of them stays small.
    fn interval(
        &self,
        mut y: DVector<f64>,
        [start, end]: [f64; 2],
        tolerance: f64,
        before: u64,
    ) -> Option<DVector<f64>> {
        const STEPS: u32 = 200;
        let [mut from, to] = [start, end].map(|t| t / self.duration);
        let inside = 0.5 * (start + end);
        let mut h = 0.0;
        loop {
            let equations = Equations {
                motions: self,
                inside,
                scratch: RefCell::new([
                    self.model.positions.clone(),
                    self.model.velocities.clone(),
                    vec![0.0; self.model.positions.len()],
                ]),
            };
            // The library's defaults, but for its test of stiffness, which would only stop it.
            let mut method = Dop853::from_param(
                equations,
                from,
                to,
                to - from,
                y,
                tolerance,
                tolerance,
                0.9,
                0.0,
                0.333,
                6.0,
                to - from,
                h,
                STEPS,
                u32::MAX,
                OutputType::Sparse,
            );
            let outcome = method.integrate();
            let (times, states) = (method.x_out(), method.y_out());
            for state in states {
                self.look(state);
            }
            let last = states.last()?.clone();
            match outcome {
                Ok(_) => return Some(last),
                Err(IntegrationError::MaxNumStepReached { .. }) => {
                    let (&reached, previous) = (times.last()?, times.iter().rev().nth(1).unwrap_or(&from));
                    if reached <= from || self.evaluations.get() - before > self.most_evaluations {
                        return None;
                    }
                    h = (reached - previous).min(to - reached);
                    (from, y) = (reached, last);
                }
                Err(_) => return None,
            }
        }
    }

    /// Keeps the length of the shortest spring.
    fn look(&self, y: &DVector<f64>) {
        let mut positions = self.model.positions.clone();
        for (k, &c) in self.model.free.iter().enumerate() {
            positions[c] = y[k] * self.length;
        }
        self.shortest.set(self.shortest.get().min(self.model.shortest(&positions)));
    }
}

/// The unknowns of the integrator between two kinks: free coordinates, their velocities, and the time as one more unknown. The library's
/// table of nodes (0.6.2) has 0 for the twelfth stage, which is at the end of the step: of the time that it hands over the method
/// would be of low order, and of none of this.
struct Equations<'m> {
    motions: &'m Motions<'m>,
    inside: f64,
    /// Positions, velocities, accelerations.
    scratch: RefCell<[Vec<f64>; 3]>,
}

impl ode_solvers::System<f64, DVector<f64>> for Equations<'_> {
    fn system(&self, _: f64, y: &DVector<f64>, dy: &mut DVector<f64>) {
        let Motions { model, duration, length, velocity, evaluations, .. } = self.motions;
        evaluations.set(evaluations.get() + 1);
        let [x, v, a] = &mut *self.scratch.borrow_mut();
        let n = model.free.len();
        model.drive(y[2 * n] * duration, self.inside, x, v);
        dy[2 * n] = 1.0;
        for (k, &c) in model.free.iter().enumerate() {
            (x[c], v[c]) = (y[k] * length, y[n + k] * velocity);
        }
        model.accelerate(x, v, a);
        for (k, &c) in model.free.iter().enumerate() {
            (dy[k], dy[n + k]) = (v[c] * duration / length, a[c] * duration / velocity);
        }
    }
}
