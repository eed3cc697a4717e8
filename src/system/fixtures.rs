//! Small systems for tests, and systems cut into subdomains, each on a thread.

use super::{Axes, Communicator, Constraint, Motion, State, System, SystemBuilder};
use crate::spring::Spring;
use nalgebra::Vector3;
use std::sync::{Arc, Barrier, Mutex};

/// A particle of 1 kg in one dimension, on a spring of 1 N/m that is held at the origin and drawn out by 0.3 m from its length of 1 m: it is at
/// `1 + 0.3 cos t`.
pub fn oscillator() -> (System, State) {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.3, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    builder.hold(0);
    builder.build().unwrap()
}

/// A damped particle on a spring to another that starts, turns and stops suddenly, a quarter of a second each.
pub fn pulled_with_kinks() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([2.1, 0.0, 0.0], 1.0);
    let offsets = [[0.0, 0.0, 0.0], [0.5, 0.1, 0.0], [0.25, 0.0, 0.0]].map(Vector3::from).to_vec();
    let motion = Motion::Path { times: vec![0.25, 0.5, 0.75], offsets };
    builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
    builder.spring(0, 1, Spring { stiffness: 30.0, rest_length: 2.0, damping: 3.0 });
    builder.build().unwrap()
}

/// A particle of a mass on a spring along x, so far from its held end.
pub fn tethered(length: f64, mass: f64, spring: Spring) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([length, 0.0, 0.0], mass);
    builder.hold(0).spring(0, 1, spring);
    builder.build().unwrap()
}

/// Particles of 1 kg in a row along x, each joined to the next by a spring at rest, 1 N and 1 m.
pub fn row(particles: usize) -> (System, State) {
    let mut builder = SystemBuilder::new();
    for p in 0..particles {
        builder.particle([p as f64, 0.0, 0.0], 1.0);
    }
    for p in 1..particles {
        builder.spring(p - 1, p, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    }
    builder.build().unwrap()
}

/// Numbers shared by the threads, with a barrier on both sides of every use.
#[derive(Debug)]
struct Table {
    numbers: Mutex<Vec<Vec<f64>>>,
    barrier: Barrier,
}

/// The communicator of one subdomain.
#[derive(Debug)]
struct ThreadCommunicator {
    table: Arc<Table>,
    number: usize,
    particles: Vec<usize>,
    springs: Vec<usize>,
    own: usize,
    whole: usize,
}

impl ThreadCommunicator {
    fn all(&self, mine: &[f64]) -> Vec<Vec<f64>> {
        self.table.numbers.lock().unwrap()[self.number] = mine.to_vec();
        self.table.barrier.wait();
        let all = self.table.numbers.lock().unwrap().clone();
        self.table.barrier.wait();
        all
    }

    fn fold(&self, numbers: &mut [f64], join: impl Fn(f64, f64) -> f64) {
        let all = self.all(numbers);
        for (at, number) in numbers.iter_mut().enumerate() {
            *number = all.iter().map(|part| part[at]).reduce(&join).unwrap();
        }
    }
}

impl Communicator for ThreadCommunicator {
    fn sum(&self, numbers: &mut [f64]) {
        self.fold(numbers, |a, b| a + b);
    }

    fn largest(&self, numbers: &mut [f64]) {
        self.fold(numbers, f64::max);
    }

    fn halo_exchange(&self, vectors: &mut [Vector3<f64>]) {
        let mut mine = vec![f64::NAN; 3 * self.whole];
        for (p, v) in self.particles.iter().zip(&*vectors).take(self.own) {
            mine[3 * p..3 * p + 3].copy_from_slice(v.as_slice());
        }
        let all = self.all(&mine);
        for (p, v) in self.particles.iter().zip(vectors).skip(self.own) {
            let owner = all.iter().find(|part| !part[3 * p].is_nan()).unwrap();
            *v = Vector3::from_column_slice(&owner[3 * p..3 * p + 3]);
        }
    }

    fn particle(&self, particle: usize) -> usize {
        self.particles[particle]
    }

    fn spring(&self, spring: usize) -> usize {
        self.springs[spring]
    }
}

/// A subdomain of a scene, with the indices of its particles and springs in the whole.
pub(crate) struct Cut {
    pub particles: Vec<usize>,
    pub springs: Vec<usize>,
    pub system: System,
    pub state: State,
}

/// Runs `work` on every subdomain of a scene, each on a thread; `part_of` gives the owner of a particle.
pub(crate) fn in_parts<R: Send>(
    scene: &SystemBuilder,
    count: usize,
    part_of: impl Fn(usize) -> usize + Sync,
    work: impl Fn(Cut) -> R + Sync,
) -> Vec<R> {
    let table = Arc::new(Table { numbers: Mutex::new(vec![Vec::new(); count]), barrier: Barrier::new(count) });
    let cut = |number: usize| {
        let is_own = |p: usize| part_of(p) == number;
        let touches = |pair: &[u32; 2]| pair.iter().any(|&p| is_own(p as usize));
        let springs: Vec<usize> = (0..scene.pairs.len()).filter(|&s| touches(&scene.pairs[s])).collect();
        let mut particles: Vec<usize> = (0..scene.positions.len()).filter(|&p| is_own(p)).collect();
        let own = particles.len();
        let mut ghosts: Vec<usize> = springs.iter().flat_map(|&s| scene.pairs[s]).map(|p| p as usize).collect();
        ghosts.retain(|&p| !is_own(p));
        ghosts.sort_unstable();
        ghosts.dedup();
        particles.extend(ghosts);
        let local = |p: usize| particles.iter().position(|&q| q == p);
        let mut builder = SystemBuilder {
            positions: particles.iter().map(|&p| scene.positions[p]).collect(),
            velocities: particles.iter().map(|&p| scene.velocities[p]).collect(),
            masses: particles.iter().map(|&p| scene.masses[p]).collect(),
            pairs: springs.iter().map(|&s| scene.pairs[s].map(|p| local(p as usize).unwrap() as u32)).collect(),
            springs: springs.iter().map(|&s| scene.springs[s]).collect(),
            ..scene.clone()
        };
        for constraint in &mut builder.constraints {
            constraint.particles = constraint.particles.iter().filter_map(|&p| local(p)).collect();
        }
        let (system, state) = builder.build().unwrap();
        let whole = scene.positions.len();
        let communicator = ThreadCommunicator {
            table: table.clone(),
            number,
            particles: particles.clone(),
            springs: springs.clone(),
            own,
            whole,
        };
        Cut { particles, springs, system: system.into_part(own, Arc::new(communicator)), state }
    };
    let (cut, work) = (&cut, &work);
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..count).map(|number| scope.spawn(move || work(cut(number)))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    })
}
