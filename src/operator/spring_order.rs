//! The order in which a product takes the springs: four at a time, contiguous where possible.
//!
//! Four springs are *contiguous* if their first ends are four consecutive particles, and so are the others: the numbers of four ends are then one
//! piece of twelve. In meshes that are numbered row by row most springs are. The first end of a spring is the one with the smaller number, or the one
//! that moves. Only what moves has rows: particles are consecutive if those between them are held, and four held other ends have no rows.
//!
//! Springs are taken by *stretches* of their first ends, whose rows stay in the fastest cache. Within a stretch the contiguous ones come first, four
//! particles after the other, and then the rest. So every row adds up its springs in one order, whatever part of them is taken.

use crate::system::{Axes, System};

/// Moving particles of a stretch.
const STRETCH: usize = 64;

pub const NO_SPRING: u32 = u32::MAX;

/// No row: there are fewer, and so are the differences of two.
pub const NO_ROW: u32 = u32::MAX - 1;

/// Four springs, by their positions among the active ones, [`NO_SPRING`] where there are fewer.
pub type Four = [u32; 4];

#[derive(Debug, Default)]
pub struct Stretch {
    /// Contiguous ones, with the first rows of the first and the other ends, [`NO_ROW`] where the others are held.
    pub contiguous: Vec<([u32; 2], Four)>,
    pub others: Vec<Four>,
}

struct Moving<'a> {
    system: &'a System,
    /// The number of them before a particle.
    numbers: Vec<u32>,
    particles: Vec<u32>,
}

impl<'a> Moving<'a> {
    fn of(system: &'a System) -> Self {
        let mut particles = Vec::with_capacity(system.particles());
        let number = |particle| {
            let number = particles.len() as u32;
            if !is_held(system, particle) {
                particles.push(particle as u32);
            }
            number
        };
        let numbers = (0..system.particles()).map(number).collect();
        Self { system, numbers, particles }
    }

    fn stretches(&self) -> usize {
        self.particles.len().div_ceil(STRETCH)
    }

    fn stretch(&self, position: u32) -> usize {
        let [first, _] = ends(self.system, position);
        self.numbers[first] as usize / STRETCH
    }

    fn entry(&self, position: u32) -> Entry {
        let [first, other] = ends(self.system, position);
        let number = self.numbers[first];
        let is_held = is_held(self.system, other);
        let distance = if is_held { (other as u32).wrapping_sub(first as u32) } else { self.numbers[other] - number };
        Entry { four: number / 4 * 4, is_held, distance, lane: number % 4, position }
    }

    /// The first row of four consecutive particles, if there are four and all move along three axes.
    fn row(&self, number: u32) -> Option<u32> {
        let number = number as usize;
        let four = self.particles.get(number..number + 4)?;
        let dofs = self.system.dofs();
        let are_free = four.iter().all(|&particle| dofs.free_axes(particle as usize) == Axes::ALL);
        are_free.then(|| dofs.first_row(four[0] as usize) as u32)
    }

    fn rows(&self, entry: &Entry) -> Option<[u32; 2]> {
        let others = if entry.is_held { NO_ROW } else { self.row(entry.four + entry.distance)? };
        Some([self.row(entry.four)?, others])
    }
}

/// A sorting key: the first of the four particles that the first end is among, and the distance of the other end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    four: u32,
    is_held: bool,
    distance: u32,
    /// The number of the first end among the four.
    lane: u32,
    position: u32,
}

impl Entry {
    fn group(&self) -> (u32, bool, u32) {
        (self.four, self.is_held, self.distance)
    }
}

fn is_held(system: &System, particle: usize) -> bool {
    system.dofs().free_axes(particle) == Axes::NONE
}

/// The ends of the active spring at a position: first the one with the smaller number, or the one that moves.
pub fn ends(system: &System, position: u32) -> [usize; 2] {
    let [i, j] = pair(system, position);
    let (first, other) = (i.min(j), i.max(j));
    if is_held(system, first) { [other, first] } else { [first, other] }
}

pub fn pair(system: &System, position: u32) -> [usize; 2] {
    system.pair(system.active_springs()[position as usize] as usize)
}

/// An upper bound of the number of stretches.
pub fn most_stretches(system: &System) -> usize {
    system.particles().div_ceil(STRETCH)
}

/// All active springs of a system, stretch by stretch to save memory.
pub fn stretches(system: &System) -> impl Iterator<Item = Stretch> + '_ {
    let moving = Moving::of(system);
    let springs = 0..system.active_springs().len() as u32;
    let with_stretch = || springs.clone().map(|position| (moving.stretch(position), position));
    let (starts, positions) = group(moving.stretches(), with_stretch);
    let mut entries = Vec::new();
    (0..moving.stretches()).map(move |stretch| {
        entries.clear();
        entries.extend(positions[starts[stretch]..starts[stretch + 1]].iter().map(|&position| moving.entry(position)));
        of_stretch(&moving, &mut entries)
    })
}

fn of_stretch(moving: &Moving, entries: &mut [Entry]) -> Stretch {
    entries.sort_unstable();
    let mut stretch = Stretch::default();
    let mut others = Vec::new();
    for row in entries.chunk_by(|a, b| a.group() == b.group()) {
        let Some(rows) = moving.rows(&row[0]).filter(|_| row.len() > 1) else {
            others.extend_from_slice(row);
            continue;
        };
        let mut four = [NO_SPRING; 4];
        for (n, entry) in row.iter().enumerate() {
            // A second spring between the same two particles is not contiguous.
            match row.get(n.wrapping_sub(1)) {
                Some(last) if last.lane == entry.lane => others.push(*entry),
                _ => four[entry.lane as usize] = entry.position,
            }
        }
        stretch.contiguous.push((rows, four));
    }
    let mut by_distance = Vec::new();
    for row in stretch.contiguous.chunk_by_mut(|a, b| a.0[0] == b.0[0]) {
        by_distance.clear();
        by_distance.extend_from_slice(row);
        spread(&by_distance, row);
    }
    // Those that share their first end are neighbours.
    others.sort_unstable_by_key(|entry| (entry.four + entry.lane, entry.position));
    let fours =
        others.chunks(4).map(|entries| std::array::from_fn(|n| entries.get(n).map_or(NO_SPRING, |e| e.position)));
    stretch.others = fours.collect();
    stretch
}

/// Takes from both halves of a list by turns. Neighbours in the list end in overlapping rows, which a processor cannot load before they are stored.
fn spread<T: Copy>(list: &[T], spread: &mut [T]) {
    let (near, far) = list.split_at(list.len().div_ceil(2));
    for (n, place) in spread.iter_mut().enumerate() {
        *place = if n % 2 == 0 { near[n / 2] } else { far[n / 2] };
    }
}

/// Groups items by a key below `groups`, keeping their order: group k is `items[starts[k]..starts[k + 1]]`.
pub fn group<T: Copy + Default, I: Iterator<Item = (usize, T)>>(
    groups: usize,
    items: impl Fn() -> I,
) -> (Vec<usize>, Vec<T>) {
    let mut starts = vec![0; groups + 1];
    items().for_each(|(key, _)| starts[key + 1] += 1);
    (0..groups).for_each(|key| starts[key + 1] += starts[key]);
    let mut next = starts.clone();
    let mut grouped = vec![T::default(); starts[groups]];
    for (key, item) in items() {
        grouped[next[key]] = item;
        next[key] += 1;
    }
    (starts, grouped)
}
