//! The order in which a product takes the springs: four at a time, in a row where they are.
//!
//! Four springs are *in a row* if their first ends are four particles that follow each other, and so are the others: the numbers of four ends
//! then lie in one piece of twelve. In meshes that are numbered row by row most springs are. A spring's first end is the one with the smaller
//! number.
//!
//! Springs are taken by *stretches* of particles, those of the first ends: what a stretch reads and writes stays in the fastest cache. Within
//! a stretch those in a row come first, four particles after the other, and then the rest. So every row adds up its springs in one order,
//! whatever part of them is taken.

use crate::system::{Axes, DofMap, System};

/// Particles of a stretch.
const STRETCH: usize = 64;

/// No spring: there are fewer.
pub const NO_SPRING: u32 = u32::MAX;

/// Four springs, by their positions among the active ones, [`NO_SPRING`] where there are fewer.
pub type Four = [u32; 4];

/// The springs of a stretch, four at a time.
#[derive(Debug, Default)]
pub struct Stretch {
    /// Those in a row, with the particles that the first and the other ends begin with.
    pub in_a_row: Vec<([u32; 2], Four)>,
    /// Any others.
    pub others: Vec<Four>,
}

impl Stretch {
    fn springs_in_a_row(&self) -> usize {
        self.in_a_row.iter().flat_map(|(_, four)| four).filter(|&&position| position != NO_SPRING).count()
    }
}

/// A spring with what it is sorted by: the first of the four particles that its first end is among, and how far the other end is away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    four: u32,
    away: u32,
    /// Which of the four the first end is.
    lane: u32,
    position: u32,
}

impl Entry {
    fn of(system: &System, position: u32) -> Self {
        let [first, other] = ends(system.pair(system.active_springs()[position as usize] as usize));
        Self { four: first / 4 * 4, away: other - first, lane: first % 4, position }
    }

    /// What springs in a row share.
    fn row(&self) -> [u32; 2] {
        [self.four, self.four + self.away]
    }
}

/// The ends of a spring, the smaller number first.
pub fn ends([i, j]: [usize; 2]) -> [u32; 2] {
    // Particles are numbered in 32 bits.
    [i.min(j) as u32, i.max(j) as u32]
}

/// All active springs of a system.
pub fn stretches(system: &System) -> Vec<Stretch> {
    let (positions, ends_of_stretches) = by_stretch(system);
    let mut entries = Vec::new();
    let mut start = 0;
    let of_stretch = |end: usize| {
        entries.clear();
        entries.extend(positions[start..end].iter().map(|&position| Entry::of(system, position)));
        start = end;
        of_stretch(system, &mut entries)
    };
    ends_of_stretches.into_iter().map(of_stretch).collect()
}

/// The positions of all springs, those of the first stretch first, and where each stretch ends.
fn by_stretch(system: &System) -> (Vec<u32>, Vec<usize>) {
    let stretch = |pair| ends(pair)[0] as usize / STRETCH;
    let mut free = vec![0; system.particles().div_ceil(STRETCH) + 1];
    for (_, pair, _) in system.active() {
        free[stretch(pair) + 1] += 1;
    }
    (1..free.len()).for_each(|next| free[next] += free[next - 1]);
    let mut positions = vec![0; system.active_springs().len()];
    for (position, (_, pair, _)) in (0u32..).zip(system.active()) {
        let place = &mut free[stretch(pair)];
        positions[*place] = position;
        *place += 1;
    }
    // Each has been filled up to where the next begins; behind the last there is none.
    free.pop();
    (positions, free)
}

/// Stretches that are looked at for a share.
const SAMPLED: usize = 16;

/// Which share of the springs a product takes in a row, counted in every k-th stretch: in all stretches where there are up to sixteen, in 8 to 16 otherwise.
pub fn share_in_a_row(system: &System) -> f64 {
    if system.dimension() < 3 {
        return 0.0;
    }
    let each = system.particles().div_ceil(STRETCH).div_ceil(SAMPLED).max(1) as u32;
    let stretch = |entry: &Entry| entry.four / STRETCH as u32;
    let entries = (0..system.active_springs().len() as u32).map(|position| Entry::of(system, position));
    let mut entries: Vec<Entry> = entries.filter(|entry| stretch(entry).is_multiple_of(each)).collect();
    entries.sort_unstable();
    let stretches = entries.chunk_by_mut(|a, b| stretch(a) == stretch(b));
    let in_a_row: usize = stretches.map(|entries| of_stretch(system, entries).springs_in_a_row()).sum();
    in_a_row as f64 / entries.len().max(1) as f64
}

fn of_stretch(system: &System, entries: &mut [Entry]) -> Stretch {
    entries.sort_unstable();
    let mut stretch = Stretch::default();
    let mut others = Vec::new();
    for row in entries.chunk_by(|a, b| a.row() == b.row()) {
        let [first, other] = row[0].row();
        if row.len() == 1 || !are_free(system, first) || !are_free(system, other) {
            others.extend_from_slice(row);
            continue;
        }
        let mut four = [NO_SPRING; 4];
        for (n, entry) in row.iter().enumerate() {
            // A second spring between the same two is one of the others.
            match row.get(n.wrapping_sub(1)) {
                Some(last) if last.lane == entry.lane => others.push(*entry),
                _ => four[entry.lane as usize] = entry.position,
            }
        }
        stretch.in_a_row.push(([first, other], four));
    }
    let mut by_distance = Vec::new();
    for row in stretch.in_a_row.chunk_by_mut(|a, b| a.0[0] == b.0[0]) {
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

/// Whether four particles from this one on are there and move freely along three axes.
fn are_free(system: &System, first: u32) -> bool {
    let dofs: &DofMap = system.dofs();
    let particles = first as usize..first as usize + 4;
    particles.end <= system.particles() && particles.into_iter().all(|particle| dofs.free_axes(particle) == Axes::ALL)
}
