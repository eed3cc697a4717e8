//! A second writing of the forces and of the motion of prescribed particles, from a scene's values to accelerations.
//!
//! It shares no line with the library: plain arrays, springs as `f = −(k (l/l0 − 1) + b ṙ) n` with `ṙ = n·(v_i − v_j)`, paths by
//! their corners. Only [`System`] is read, to learn the numbers that the scene came to.

use sprung::system::{Motion, State, System};

/// A system as plain numbers. Coordinate 3p + a is axis a of particle p.
#[derive(Debug, Clone)]
pub struct Model {
    inverse_masses: Vec<f64>,
    springs: Vec<Tie>,
    gravity: [f64; 3],
    /// The coordinates that equations of motion decide.
    pub free: Vec<usize>,
    driven: Vec<Driven>,
    /// Where and how fast it starts.
    pub positions: Vec<f64>,
    /// As above, in m/s.
    pub velocities: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Tie {
    ends: [usize; 2],
    stiffness: f64,
    rest_length: f64,
    damping: f64,
}

/// A prescribed coordinate by the corners (time, place) of its way, which goes on beyond the last two of them as `rate` says.
#[derive(Debug, Clone)]
struct Driven {
    coordinate: usize,
    corners: Vec<[f64; 2]>,
    rate: f64,
}

impl Driven {
    /// Place at t, and velocity just after t; `[before, t]` is an interval without corners inside.
    fn at(&self, t: f64, after: f64) -> [f64; 2] {
        let [first, last] = [self.corners[0], self.corners[self.corners.len() - 1]];
        if after < first[0] {
            return [first[1], 0.0];
        }
        if after >= last[0] {
            return [last[1] + self.rate * (t - last[0]), self.rate];
        }
        let mut way = [first[1], 0.0];
        for corner in self.corners.windows(2) {
            let [[t0, x0], [t1, x1]] = [corner[0], corner[1]];
            if t0 <= after && after < t1 {
                let rate = (x1 - x0) / (t1 - t0);
                way = [x0 + rate * (t - t0), rate];
            }
        }
        way
    }
}

impl Model {
    /// From a built scene.
    pub fn new(system: &System, start: &State) -> Self {
        let prescribed = system.prescribed();
        let driven: Vec<Driven> = prescribed
            .iter()
            .map(|(dof, place, motion)| {
                let coordinate = 3 * dof.particle + dof.axis;
                match &prescribed.motions()[motion] {
                    Motion::Held => Driven { coordinate, corners: vec![[0.0, place]], rate: 0.0 },
                    Motion::Velocity(v) => Driven { coordinate, corners: vec![[0.0, place]], rate: v[dof.axis] },
                    Motion::Path { times, offsets } => {
                        let corners = times.iter().zip(offsets).map(|(t, x)| [*t, place + x[dof.axis]]).collect();
                        Driven { coordinate, corners, rate: 0.0 }
                    }
                }
            })
            .collect();
        let is_driven = |coordinate: &usize| driven.iter().any(|d| d.coordinate == *coordinate);
        let coordinates = (0..3 * system.particles()).filter(|c| c % 3 < system.dimension());
        let ties = system.pairs().iter().zip(system.springs()).map(|(&[i, j], spring)| Tie {
            ends: [i as usize, j as usize],
            stiffness: spring.stiffness,
            rest_length: spring.rest_length,
            damping: spring.damping,
        });
        let flat = |vectors: &[nalgebra::Vector3<f64>]| vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        Self {
            inverse_masses: system.masses().iter().map(|m| 1.0 / m).collect(),
            springs: ties.collect(),
            gravity: system.gravity().into(),
            free: coordinates.filter(|c| !is_driven(c)).collect(),
            driven,
            positions: flat(&start.positions),
            velocities: flat(&start.velocities),
        }
    }

    /// The times at which a prescribed velocity jumps, between `start` and `end`.
    pub fn kinks(&self, start: f64, end: f64) -> Vec<f64> {
        let corners = self.driven.iter().flat_map(|d| d.corners.iter().map(|corner| corner[0]));
        let mut kinks: Vec<f64> = corners.filter(|&t| t > start && t < end).collect();
        kinks.sort_by(f64::total_cmp);
        kinks.dedup();
        kinks
    }

    /// Puts the prescribed coordinates where they are at time t; velocities are those at `inside`, a time of the same interval
    /// between kinks.
    pub fn drive(&self, t: f64, inside: f64, positions: &mut [f64], velocities: &mut [f64]) {
        for driven in &self.driven {
            let [x, v] = driven.at(t, inside);
            positions[driven.coordinate] = x;
            velocities[driven.coordinate] = v;
        }
    }

    /// The acceleration of every coordinate that springs and gravity alone would give it. Not a number where the ends of a
    /// spring coincide.
    pub fn accelerate(&self, positions: &[f64], velocities: &[f64], acceleration: &mut [f64]) {
        for of_particle in acceleration.chunks_exact_mut(3) {
            of_particle.copy_from_slice(&self.gravity);
        }
        for tie in &self.springs {
            let [i, j] = tie.ends.map(|end| 3 * end);
            let d = [0, 1, 2].map(|a| positions[i + a] - positions[j + a]);
            let u = [0, 1, 2].map(|a| velocities[i + a] - velocities[j + a]);
            let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            let rate = (d[0] * u[0] + d[1] * u[1] + d[2] * u[2]) / length;
            let pull = tie.stiffness * (length - tie.rest_length) / tie.rest_length + tie.damping * rate;
            let [at_i, at_j] = tie.ends.map(|end| pull / length * self.inverse_masses[end]);
            for a in 0..3 {
                acceleration[i + a] -= at_i * d[a];
                acceleration[j + a] += at_j * d[a];
            }
        }
    }

    /// Gershgorin's bound of the highest frequency with springs at their rest lengths: `ω² ≤ max 2 Σ k/(l0 m)` over the particles.
    pub fn highest_frequency(&self) -> f64 {
        let mut squares = vec![0.0; self.inverse_masses.len()];
        for tie in &self.springs {
            for end in tie.ends {
                squares[end] += 2.0 * tie.stiffness / tie.rest_length * self.inverse_masses[end];
            }
        }
        squares.into_iter().fold(0.0, f64::max).sqrt()
    }

    /// The shortest spring, relative to its rest length.
    pub fn shortest(&self, positions: &[f64]) -> f64 {
        let ratio = |tie: &Tie| {
            let [i, j] = tie.ends.map(|end| 3 * end);
            let square: f64 = (0..3).map(|a| (positions[i + a] - positions[j + a]).powi(2)).sum();
            square.sqrt() / tie.rest_length
        };
        self.springs.iter().map(ratio).fold(f64::INFINITY, f64::min)
    }
}
