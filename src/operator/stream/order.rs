//! The order in which a product takes the springs: four at a time, in a row where they are.
//!
//! Four springs are *in a row* if their first ends are four particles that follow each other, and so are the others: the numbers of four ends
//! then lie in one piece of twelve. In meshes that are numbered row by row most springs are. A spring's first end is the one with the smaller
//! number, or the one that moves. Only what moves has rows: particles follow each other if those between them are held, and where all four others
//! are held there are no rows of theirs.
//!
//! Springs are taken by *stretches* of particles, those of the first ends: what a stretch reads and writes stays in the fastest cache. Within
//! a stretch those in a row come first, four particles after the other, and then the rest. So every row adds up its springs in one order,
//! whatever part of them is taken.

use super::batch4::NO_ROW;
use crate::system::{Axes, System};

/// Particles of a stretch, of those that move.
const STRETCH: usize = 64;

/// No spring: there are fewer.
pub const NO_SPRING: u32 = u32::MAX;

/// Four springs, by their positions among the active ones, [`NO_SPRING`] where there are fewer.
pub type Four = [u32; 4];

/// The springs of a stretch, four at a time.
#[derive(Debug, Default)]
pub struct Stretch {
    /// Those in a row, with the rows that the first and the other ends begin with, [`NO_ROW`] where the others are held.
    pub contiguous: Vec<([u32; 2], Four)>,
    /// Any others.
    pub others: Vec<Four>,
}

/// The particles that move, in order.
struct Moving<'a> {
    system: &'a System,
    /// How many there are before a particle.
    numbers: Vec<u32>,
    particles: Vec<u32>,
}

impl<'a> Moving<'a> {
    fn of(system: &'a System) -> Self {
        let mut particles = Vec::with_capacity(system.particles());
        let number = |particle| {
            // Particles are numbered in 32 bits.
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

    /// Which stretch the spring at a position belongs to.
    fn stretch(&self, position: u32) -> usize {
        let [first, _] = ends(self.system, position);
        self.numbers[first] as usize / STRETCH
    }

    /// What the spring at a position is sorted by.
    fn entry(&self, position: u32) -> Entry {
        let [first, other] = ends(self.system, position);
        let number = self.numbers[first];
        let is_held = is_held(self.system, other);
        let away = if is_held { (other as u32).wrapping_sub(first as u32) } else { self.numbers[other] - number };
        Entry { four: number / 4 * 4, is_held, away, lane: number % 4, position }
    }

    /// Where the rows of four particles begin, from the one with this number on, if there are four and all move freely along three axes.
    fn row(&self, number: u32) -> Option<u32> {
        let number = number as usize;
        let four = self.particles.get(number..number + 4)?;
        let dofs = self.system.dofs();
        let are_free = four.iter().all(|&particle| dofs.free_axes(particle as usize) == Axes::ALL);
        // Rows are numbered in 32 bits.
        are_free.then(|| dofs.first_row(four[0] as usize) as u32)
    }

    /// The rows of springs in a row, the first and the others.
    fn rows(&self, entry: &Entry) -> Option<[u32; 2]> {
        let others = if entry.is_held { NO_ROW } else { self.row(entry.four + entry.away)? };
        Some([self.row(entry.four)?, others])
    }
}

/// A spring with what it is sorted by: the first of the four particles that its first end is among, and how far the other end is away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    four: u32,
    is_held: bool,
    away: u32,
    /// Which of the four the first end is.
    lane: u32,
    position: u32,
}

impl Entry {
    /// What springs in a row share.
    fn row(&self) -> (u32, bool, u32) {
        (self.four, self.is_held, self.away)
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

/// The ends of the active spring at a position.
pub fn pair(system: &System, position: u32) -> [usize; 2] {
    system.pair(system.active_springs()[position as usize] as usize)
}

/// No system has more stretches.
pub fn most_stretches(system: &System) -> usize {
    system.particles().div_ceil(STRETCH)
}

/// All active springs of a system, stretch by stretch: all at once would be a third of what a product keeps.
pub fn stretches(system: &System) -> impl Iterator<Item = Stretch> + '_ {
    let moving = Moving::of(system);
    let (positions, ends_of_stretches) = by_stretch(&moving);
    let mut entries = Vec::new();
    let mut start = 0;
    ends_of_stretches.into_iter().map(move |end| {
        entries.clear();
        entries.extend(positions[start..end].iter().map(|&position| moving.entry(position)));
        start = end;
        of_stretch(&moving, &mut entries)
    })
}

/// The positions of all springs, those of the first stretch first, and where each stretch ends.
fn by_stretch(moving: &Moving) -> (Vec<u32>, Vec<usize>) {
    let springs = moving.system.active_springs().len();
    let mut free = vec![0; moving.stretches() + 1];
    // Springs are numbered in 32 bits.
    for position in 0..springs as u32 {
        free[moving.stretch(position) + 1] += 1;
    }
    (1..free.len()).for_each(|next| free[next] += free[next - 1]);
    let mut positions = vec![0; springs];
    for position in 0..springs as u32 {
        let place = &mut free[moving.stretch(position)];
        positions[*place] = position;
        *place += 1;
    }
    // Each has been filled up to where the next begins; behind the last there is none.
    free.pop();
    (positions, free)
}

fn of_stretch(moving: &Moving, entries: &mut [Entry]) -> Stretch {
    entries.sort_unstable();
    let mut stretch = Stretch::default();
    let mut others = Vec::new();
    for row in entries.chunk_by(|a, b| a.row() == b.row()) {
        let Some(rows) = moving.rows(&row[0]).filter(|_| row.len() > 1) else {
            others.extend_from_slice(row);
            continue;
        };
        let mut four = [NO_SPRING; 4];
        for (n, entry) in row.iter().enumerate() {
            // A second spring between the same two is one of the others.
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
    // Those that share their first end follow each other.
    others.sort_unstable_by_key(|entry| (entry.four + entry.lane, entry.position));
    let fours =
        others.chunks(4).map(|entries| std::array::from_fn(|n| entries.get(n).map_or(NO_SPRING, |e| e.position)));
    stretch.others = fours.collect();
    stretch
}

/// Puts the first of a list, the first of its second half, the second, and so on. Neighbours in the list end in rows that overlap by some, which a
/// processor cannot load before they are stored.
fn spread<T: Copy>(list: &[T], spread: &mut [T]) {
    let (near, far) = list.split_at(list.len().div_ceil(2));
    for (n, place) in spread.iter_mut().enumerate() {
        *place = if n % 2 == 0 { near[n / 2] } else { far[n / 2] };
    }
}
