//! The subdomain of a rank: its own particles, ghost copies of adjacent ones, and the springs of its own.
//!
//! PT-Scotch partitions the graph of the springs into subdomains with equally many particles and few springs between them. Own particles, ghosts
//! and springs each keep the order of the scene. Every matrix row therefore adds its springs in that order, and its entries have the same bits for
//! any partition.

use crate::petsc::{self, Petsc};
use crate::ranks;
use crate::slab::{self, Header, LEAD, PARTICLE, SPRING, Slab};
use sprung::nalgebra::Vector3;
use sprung::system::Communicator;
use sprung::{Constraint, Motion, Spring, State, System, SystemBuilder};
use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Arc;

/// The number of particles per rank below which a scene is partitioned into consecutive blocks.
const LEAST: u64 = 16;

/// A subdomain of a scene.
pub struct Part {
    pub system: System,
    pub state: State,
    pub halo: Arc<Halo>,
}

/// The connection of a subdomain to the scene.
#[derive(Debug)]
pub struct Halo {
    /// Scene indices of own particles, then of ghosts, each ascending.
    pub particles: Vec<u64>,
    /// Scene indices of springs, ascending.
    pub springs: Vec<u64>,
    /// The number of own particles.
    pub own: usize,
    /// Block rows of the matrix; those of own particles are consecutive.
    pub rows: Vec<u64>,
    /// Own particles with copies on other ranks, by rank.
    sends: Vec<(usize, Vec<u32>)>,
    /// Ghosts, by the rank of their owner.
    receives: Vec<(usize, Vec<u32>)>,
}

impl Communicator for Halo {
    fn sum(&self, numbers: &mut [f64]) {
        ranks::sum(numbers);
    }

    fn largest(&self, numbers: &mut [f64]) {
        ranks::largest(numbers);
    }

    fn halo_exchange(&self, vectors: &mut [Vector3<f64>]) {
        let pack = |list: &Vec<u32>| list.iter().flat_map(|&p| vectors[p as usize].iter().copied()).collect();
        let sent: Vec<(usize, Vec<f64>)> = self.sends.iter().map(|(rank, list)| (*rank, pack(list))).collect();
        let room = |(rank, list): &(usize, Vec<u32>)| (*rank, vec![0.0; 3 * list.len()]);
        let mut received: Vec<(usize, Vec<f64>)> = self.receives.iter().map(room).collect();
        ranks::swap(&sent, &mut received);
        for ((_, list), (_, values)) in self.receives.iter().zip(&received) {
            for (&p, value) in list.iter().zip(values.chunks_exact(3)) {
                vectors[p as usize] = Vector3::from_column_slice(value);
            }
        }
    }

    fn particle(&self, particle: usize) -> usize {
        self.particles[particle] as usize
    }

    fn spring(&self, spring: usize) -> usize {
        self.springs[spring] as usize
    }
}

/// Cuts a scene that lies on the ranks by numbers.
///
/// # Errors
/// A partitioner that fails; a scene with values that break a rule.
pub fn cut(petsc: &Petsc, header: &Header, slab: Slab) -> Result<Part, Box<dyn Error>> {
    let mine = ranks::rank();
    let ranges = ranks::ranges(header.particles);
    let first = ranges[mine];
    let part_of = assign(petsc, header, &slab, &ranges)?;
    let parts_of = |numbers: &[u64]| look_up(&ranges, numbers, |p| vec![part_of[(p - first) as usize] as u64]);

    // Springs go to both their ends, with whose these are.
    let spring_ranges = ranks::ranges(header.springs);
    let ends: Vec<u64> = slab.springs.chunks_exact(SPRING).flat_map(|s| [s[0] as u64, s[1] as u64]).collect();
    let owners = parts_of(&distinct(ends));
    let mut parcels = vec![Vec::new(); ranks::ranks()];
    for (number, spring) in (spring_ranges[mine]..).zip(slab.springs.chunks_exact(SPRING)) {
        let owner = |end: f64| owners[&(end as u64)][0] as usize;
        let parts = [owner(spring[0]), owner(spring[1])];
        let record = [number as f64, parts[0] as f64, parts[1] as f64];
        for &to in if parts[0] == parts[1] { &parts[..1] } else { &parts[..] } {
            parcels[to].extend(record.iter().chain(spring));
        }
    }
    let mut springs: Vec<Vec<f64>> = Vec::new();
    for list in ranks::exchange(&parcels) {
        springs.extend(list.chunks_exact(SPRING + 3).map(<[f64]>::to_vec));
    }
    springs.sort_by(|a, b| a[0].total_cmp(&b[0]));

    // Own particles by number, then ghosts by number.
    let mut parcels = vec![Vec::new(); ranks::ranks()];
    (first..).zip(&part_of).for_each(|(number, &part)| parcels[part].push(number));
    let mut particles: Vec<u64> = ranks::exchange(&parcels).concat();
    particles.sort_unstable();
    let own = particles.len();
    let ends = springs.iter().flat_map(|s| [(s[1], s[3]), (s[2], s[4])]);
    let ghosts: BTreeMap<u64, usize> =
        ends.filter(|&(part, _)| part as usize != mine).map(|(part, p)| (p as u64, part as usize)).collect();
    particles.extend(ghosts.keys());
    let local = |number: u64| -> usize {
        let (own, ghosts) = particles.split_at(own);
        own.binary_search(&number).or_else(|_| ghosts.binary_search(&number).map(|at| own.len() + at)).unwrap_or(0)
    };

    let (rows, sends, receives) = number_rows(&particles[..own], &ghosts);
    let leads = leads_of(&slab);
    let values = look_up(&ranges, &particles, |p| {
        let at = (p - first) as usize;
        let values = slab.particles[PARTICLE * at..PARTICLE * (at + 1)].iter().map(|value| value.to_bits());
        values
            .chain(leads.get(&p).into_iter().flatten().flat_map(|&[axis, motion]| [axis as u64, motion as u64]))
            .collect()
    });
    let mut builder = SystemBuilder::new();
    builder.dimension = header.dimension;
    builder.gravity = header.gravity.into();
    let mut led: BTreeMap<(u64, u64), Vec<usize>> = BTreeMap::new();
    for (p, number) in particles.iter().enumerate() {
        let (values, leads) = values[number].split_at(PARTICLE);
        let values: Vec<f64> = values.iter().map(|&bits| f64::from_bits(bits)).collect();
        builder.positions.push(Vector3::from_column_slice(&values[..3]));
        builder.velocities.push(Vector3::from_column_slice(&values[3..6]));
        builder.masses.push(values[6]);
        leads.chunks_exact(2).for_each(|lead| led.entry((lead[1], lead[0])).or_default().push(p));
    }
    for spring in &springs {
        builder.pairs.push([local(spring[3] as u64) as u32, local(spring[4] as u64) as u32]);
        let [stiffness, rest_length, damping] = [spring[5], spring[6], spring[7]];
        builder.springs.push(Spring { stiffness, rest_length, damping });
    }
    // Every motion stays, also those that lead nothing here: all parts stop at the kinks of all paths.
    for (number, moves) in (0u64..).zip(&header.motions) {
        for axis in 0..3 {
            let particles = led.remove(&(number, axis)).unwrap_or_default();
            let motion = Motion::from(moves);
            builder.constraints.push(Constraint { particles, axes: slab::axis(axis as f64), motion });
        }
    }
    let springs = springs.iter().map(|spring| spring[0] as u64).collect();
    let halo = Arc::new(Halo { particles, springs, own, rows, sends, receives });
    let (system, state) = builder.build()?;
    Ok(Part { system: system.into_part(own, halo.clone()), state, halo })
}

/// Which rank each of this slab's particles goes to.
fn assign(petsc: &Petsc, header: &Header, slab: &Slab, ranges: &[u64]) -> petsc::Result<Vec<usize>> {
    let (mine, count) = (ranks::rank(), ranks::ranks());
    let first = ranges[mine];
    let vertices = (ranges[mine + 1] - first) as usize;
    if count == 1 || header.particles < LEAST * count as u64 || header.springs == 0 {
        return Ok(vec![mine; vertices]);
    }
    let mut parcels = vec![Vec::new(); count];
    for spring in slab.springs.chunks_exact(SPRING) {
        let (i, j) = (spring[0] as u64, spring[1] as u64);
        parcels[ranks::owner(ranges, i)].extend([i, j]);
        parcels[ranks::owner(ranges, j)].extend([j, i]);
    }
    let mut edges: Vec<[u64; 2]> = Vec::new();
    for list in ranks::exchange(&parcels) {
        edges.extend(list.chunks_exact(2).map(|edge| [edge[0], edge[1]]));
    }
    edges.sort_unstable();
    edges.dedup();
    let mut offsets = vec![0; vertices + 1];
    edges.iter().for_each(|&[from, _]| offsets[(from - first) as usize + 1] += 1);
    (0..vertices).for_each(|v| offsets[v + 1] += offsets[v]);
    let neighbours: Vec<u64> = edges.iter().map(|edge| edge[1]).collect();
    petsc::partition(petsc, "ptscotch", header.particles as usize, &offsets, &neighbours, count)
}

/// Asks those who have numbers in their slab for values that belong to them.
fn look_up(ranges: &[u64], numbers: &[u64], answer: impl Fn(u64) -> Vec<u64>) -> BTreeMap<u64, Vec<u64>> {
    let mut questions = vec![Vec::new(); ranks::ranks()];
    numbers.iter().for_each(|&number| questions[ranks::owner(ranges, number)].push(number));
    let answers = ranks::exchange(&questions).into_iter().map(|asked| {
        let mut parcel = Vec::new();
        for number in asked {
            let values = answer(number);
            parcel.push(values.len() as u64);
            parcel.extend(values);
        }
        parcel
    });
    let mut found = BTreeMap::new();
    for (questions, answers) in questions.iter().zip(ranks::exchange(&answers.collect::<Vec<_>>())) {
        let mut rest = &answers[..];
        for &number in questions {
            let Some((&count, tail)) = rest.split_first() else { break };
            let (values, tail) = tail.split_at(count as usize);
            found.insert(number, values.to_vec());
            rest = tail;
        }
    }
    found
}

fn distinct(mut numbers: Vec<u64>) -> Vec<u64> {
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Axis and motion of the prescribed coordinates of a slab's particles.
fn leads_of(slab: &Slab) -> BTreeMap<u64, Vec<[f64; 2]>> {
    let mut leads: BTreeMap<u64, Vec<[f64; 2]>> = BTreeMap::new();
    for lead in slab.leads.chunks_exact(LEAD) {
        leads.entry(lead[0] as u64).or_default().push([lead[1], lead[2]]);
    }
    leads
}

type Lists = Vec<(usize, Vec<u32>)>;

/// Rows of the matrix for own particles and ghosts, and the lists by which ghosts are refreshed.
fn number_rows(own: &[u64], ghosts: &BTreeMap<u64, usize>) -> (Vec<u64>, Lists, Lists) {
    let counts = ranks::all(own.len() as u64);
    let first: u64 = counts[..ranks::rank()].iter().sum();
    let mut questions = vec![Vec::new(); ranks::ranks()];
    ghosts.iter().for_each(|(&number, &part)| questions[part].push(number));
    let asked: Vec<Vec<u32>> = ranks::exchange(&questions)
        .iter()
        .map(|asked| asked.iter().map(|number| own.binary_search(number).unwrap_or(0) as u32).collect())
        .collect();
    let answers: Vec<Vec<u64>> =
        asked.iter().map(|list| list.iter().map(|&p| first + u64::from(p)).collect()).collect();
    let answers = ranks::exchange(&answers);
    let rows_of: BTreeMap<u64, u64> =
        questions.iter().flatten().copied().zip(answers.iter().flatten().copied()).collect();
    let mut rows: Vec<u64> = (first..first + own.len() as u64).collect();
    rows.extend(ghosts.keys().map(|number| rows_of[number]));
    let places: BTreeMap<u64, u32> =
        (own.len() as u32..).zip(ghosts.keys()).map(|(at, &number)| (number, at)).collect();
    let receives = questions.iter().map(|list| list.iter().map(|number| places[number]).collect());
    let with_ranks =
        |lists: Vec<Vec<u32>>| lists.into_iter().enumerate().filter(|(_, list)| !list.is_empty()).collect();
    let receives: Vec<Vec<u32>> = receives.collect();
    (rows, with_ranks(asked), with_ranks(receives))
}
