//! Ready scenes with a formula for their particles, of which every rank generates its own part.
//!
//! They equal the scenes of `sprung::scene::builtin`, as a test checks, and have no limit on their size.

use crate::ranks;
use crate::slab::{self, Header, LEAD, Moves, PARTICLE, SPRING, Slab};

/// Which ready scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// SIZE × SIZE particles that swing down from two corners
    Cloth,
    /// SIZE × SIZE × SIZE particles held at one face
    Lattice,
}

/// Particles a side up to which numbers of particles and springs are exact in a double.
const LARGEST: u64 = 1 << 17;

/// This rank's share of a ready scene.
///
/// # Errors
/// A size without particles, or one beyond what can be numbered.
pub fn make(kind: Kind, size: u64, most: u64) -> Result<(Header, Slab), String> {
    if !(1..=LARGEST).contains(&size) {
        return Err(format!("--size {size}: must lie between 1 and {LARGEST}"));
    }
    let grid = match kind {
        Kind::Cloth => Grid::cloth(size),
        Kind::Lattice => Grid::lattice(size),
    };
    slab::check_rows(grid.particles(), 3, most).map_err(|what| format!("--size {size}: {what}"))?;
    let mine = ranks::rank();
    let share = |total| -> std::ops::Range<u64> {
        let ranges = ranks::ranges(total);
        ranges[mine]..ranges[mine + 1]
    };
    // Springs are numbered in the order of the particles that they begin at: each rank counts those of its own, and then they
    // are dealt out again in equal numbers.
    let particles = share(grid.particles());
    let mut slab = Slab::default();
    let mut springs = Vec::new();
    for p in particles.clone() {
        slab.particles.extend(grid.position(p).into_iter().chain([0.0; 3]).chain([grid.mass]));
        if grid.is_held(p) {
            (0..3).for_each(|axis| slab.leads.extend([p as f64, f64::from(axis), 0.0]));
        }
        for [i, j] in grid.springs_at(p) {
            springs.extend([i as f64, j as f64, grid.stiffness, grid.distance(i, j), grid.damping]);
        }
    }
    let counts = ranks::all((springs.len() / SPRING) as u64);
    let (total, before): (u64, u64) = (counts.iter().sum(), counts[..mine].iter().sum());
    let ranges = ranks::ranges(total);
    let mut parcels = vec![Vec::new(); ranks::ranks()];
    for (number, spring) in (before..).zip(springs.chunks_exact(SPRING)) {
        parcels[ranks::owner(&ranges, number)].extend_from_slice(spring);
    }
    slab.springs = ranks::exchange(&parcels).concat();
    debug_assert!(slab.particles.len() % PARTICLE == 0 && slab.leads.len() % LEAD == 0);
    let header = Header {
        name: grid.name.into(),
        dimension: 3,
        gravity: [0.0, -9.81, 0.0],
        particles: grid.particles(),
        springs: total,
        dt: None,
        duration: Some(grid.duration),
        motions: vec![Moves::Held],
        fingerprint: format!("{} {size}", grid.name),
    };
    Ok((header, slab))
}

/// Particles on a grid, numbered with the last coordinate the fastest.
struct Grid {
    name: &'static str,
    size: u64,
    dimension: u32,
    /// The springs that a particle begins: where their ends are, seen from it.
    reach: Vec<[[i64; 3]; 2]>,
    mass: f64,
    stiffness: f64,
    damping: f64,
    duration: f64,
}

impl Grid {
    fn cloth(size: u64) -> Self {
        // Rows and columns; the last one joins the two neighbours.
        let mut reach = [[0, 1, 0], [1, 0, 0], [0, 2, 0], [2, 0, 0], [1, 1, 0]].map(|end| [[0; 3], end]).to_vec();
        reach.push([[0, 1, 0], [1, 0, 0]]);
        Self { name: "cloth", size, dimension: 2, reach, mass: 0.0005, stiffness: 1250.0, damping: 0.05, duration: 2.0 }
    }

    fn lattice(size: u64) -> Self {
        let reach =
            [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [0, 1, -1], [1, 0, 1], [1, 0, -1], [1, 1, 0], [1, -1, 0]];
        let (mass, stiffness, damping, duration) = (0.001, 4.0, 0.002, 1.0);
        let reach = reach.map(|end| [[0; 3], end]).to_vec();
        Self { name: "lattice", size, dimension: 3, reach, mass, stiffness, damping, duration }
    }

    fn particles(&self) -> u64 {
        self.size.pow(self.dimension)
    }

    fn place(&self, p: u64) -> [u64; 3] {
        let n = self.size;
        if self.dimension == 2 { [p / n, p % n, 0] } else { [p / (n * n), p / n % n, p % n] }
    }

    fn position(&self, p: u64) -> [f64; 3] {
        let [i, j, l] = self.place(p).map(|at| at as f64);
        if self.dimension == 2 { [j / 20.0, 0.0, i / 20.0] } else { [i / 100.0, j / 100.0, l / 100.0] }
    }

    fn is_held(&self, p: u64) -> bool {
        if self.dimension == 2 { p == 0 || p == self.size - 1 } else { p < self.size * self.size }
    }

    fn springs_at(&self, p: u64) -> impl Iterator<Item = [u64; 2]> + '_ {
        let at = self.place(p);
        let end = move |reach: &[i64; 3]| {
            (0..self.dimension as usize).try_fold(0, |number, axis| {
                let coordinate = at[axis].checked_add_signed(reach[axis]).filter(|&end| end < self.size)?;
                Some(number * self.size + coordinate)
            })
        };
        self.reach.iter().filter_map(move |[i, j]| Some([end(i)?, end(j)?]))
    }

    /// As a scene has it that names no rest lengths.
    fn distance(&self, p: u64, q: u64) -> f64 {
        let [x, y] = [p, q].map(|p| sprung::nalgebra::Vector3::from(self.position(p)));
        (x - y).norm()
    }
}
