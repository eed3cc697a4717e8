//! Systems cut in parts, each on a thread of its own, against the whole.

use super::Communicator;
use crate::spring::Spring;
use crate::system::{State, System, SystemBuilder};
use nalgebra::Vector3;
use std::sync::{Arc, Barrier, Mutex};

/// What the threads share: one place for each, and a barrier on both sides of every use.
#[derive(Debug)]
struct Table {
    numbers: Mutex<Vec<Vec<f64>>>,
    barrier: Barrier,
}

/// One of the parts.
#[derive(Debug)]
struct Seat {
    table: Arc<Table>,
    number: usize,
    particles: Vec<usize>,
    springs: Vec<usize>,
    own: usize,
    whole: usize,
}

impl Seat {
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

impl Communicator for Seat {
    fn sum(&self, numbers: &mut [f64]) {
        self.fold(numbers, |a, b| a + b);
    }

    fn largest(&self, numbers: &mut [f64]) {
        self.fold(numbers, f64::max);
    }

    fn refresh(&self, vectors: &mut [Vector3<f64>]) {
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

/// A part of a scene: where its particles come from, the system and its state.
pub(crate) struct Cut {
    pub particles: Vec<usize>,
    pub springs: Vec<usize>,
    pub system: System,
    pub state: State,
}

/// Runs `work` on every part of a scene, each on a thread; `part_of` says whose a particle is.
pub(crate) fn in_parts<R: Send>(
    scene: &SystemBuilder,
    count: usize,
    part_of: impl Fn(usize) -> usize + Sync,
    work: impl Fn(Cut) -> R + Sync,
) -> Vec<R> {
    let table = Arc::new(Table { numbers: Mutex::new(vec![Vec::new(); count]), barrier: Barrier::new(count) });
    let seat = |number: usize| {
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
        let seat =
            Seat { table: table.clone(), number, particles: particles.clone(), springs: springs.clone(), own, whole };
        Cut { particles, springs, system: system.into_part(own, Arc::new(seat)), state }
    };
    let (seat, work) = (&seat, &work);
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..count).map(|number| scope.spawn(move || work(seat(number)))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    })
}

/// Three particles in a row; the one in the middle is of another part than the others.
fn row() -> SystemBuilder {
    let mut builder = SystemBuilder::new();
    for x in [0.0, 1.0, 2.5] {
        builder.particle([x, 0.0, 0.0], 1.0);
    }
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    builder.spring(2, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 2.0 });
    builder
}

/// Every particle and every spring is one that counts in one part, and damping anywhere is damping everywhere.
#[test]
fn parts_make_up_the_whole() {
    let found = in_parts(
        &row(),
        2,
        |p| p % 2,
        |Cut { system, .. }| {
            let springs = (0..system.springs().len()).filter(|&spring| system.counts(spring)).count();
            (system.own_particles(), system.particles(), springs, system.is_damped())
        },
    );
    assert_eq!(found, [(2, 3, 2, true), (1, 3, 0, true)]);
    let found = in_parts(&row(), 3, |p| p, |Cut { system, .. }| system.is_damped());
    assert_eq!(found, [true; 3]);
    let mut undamped = row();
    undamped.springs.iter_mut().for_each(|spring| spring.damping = 0.0);
    let found = in_parts(&undamped, 2, |p| p % 2, |Cut { system, .. }| system.is_damped());
    assert_eq!(found, [false; 2]);
}

/// Ghosts get what their owners have, and nothing else changes.
#[test]
fn ghosts_are_refreshed() {
    let found = in_parts(
        &row(),
        2,
        |p| p % 2,
        |Cut { particles, system, .. }| {
            let mine = |p: usize| Vector3::repeat(if p < system.own_particles() { particles[p] as f64 } else { -1.0 });
            let mut vectors: Vec<_> = (0..system.particles()).map(mine).collect();
            system.refresh(&mut vectors);
            particles.iter().zip(&vectors).all(|(&p, v)| *v == Vector3::repeat(p as f64))
        },
    );
    assert_eq!(found, [true, true]);
}
