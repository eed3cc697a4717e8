//! Four springs as a product reads them, their numbers list by list, and what they do to a vector.

use crate::operator::lanes::Lanes;
use crate::spring::SpringBlock;

/// Four springs; of some there may be none, which are all zeros.
#[derive(Debug, Clone, Copy)]
pub struct SpringBatch4<E> {
    /// g, in √(N/m), by axes.
    pub g: [[f64; 4]; 3],
    /// α, in N/m.
    pub transverse: [f64; 4],
    pub ends: E,
}

/// Ends in a row.
#[derive(Debug, Clone, Copy)]
pub struct InARow {
    /// Where the twelve rows of the first ends begin, and those of the others; [`NO_ROW`] where the others are held.
    pub rows: [u32; 2],
    /// A bit for every spring that goes through its matrix.
    pub by_matrix: u32,
}

/// The first rows of the first ends, and of the others, [`NO_ROW`] of one that is held; [`BY_MATRIX`] and the spring's position for one that goes
/// through its matrix, twice [`NO_ROW`] for none.
pub type AnyEnds = [[u32; 4]; 2];

pub const BY_MATRIX: u32 = u32::MAX;

/// No row: rows are fewer, and so are the differences of two.
pub const NO_ROW: u32 = u32::MAX - 1;

impl<E> SpringBatch4<E> {
    pub fn new(ends: E) -> Self {
        Self { g: [[0.0; 4]; 3], transverse: [0.0; 4], ends }
    }

    /// Zeros, where there is no spring to be streamed.
    pub fn set(&mut self, spring: usize, streamed: Option<Streamed>) {
        let Streamed { g, transverse } = streamed.unwrap_or_default();
        (0..3).for_each(|axis| self.g[axis][spring] = g[axis]);
        self.transverse[spring] = transverse;
    }

    /// `B d = α d + g σ (g·d)` of four springs, axis by axis; `sign` is σ four times.
    #[inline(always)]
    pub fn times<L: Lanes>(&self, lanes: L, sign: L::Four, d: [L::Four; 3]) -> [L::Four; 3] {
        let g = self.g.map(|g| lanes.four(g));
        let products: [L::Four; 3] = std::array::from_fn(|axis| lanes.mul(g[axis], d[axis]));
        let along = lanes.add(lanes.add(products[0], products[1]), products[2]);
        let along = lanes.mul(sign, along);
        let transverse = lanes.four(self.transverse);
        std::array::from_fn(|axis| lanes.add(lanes.mul(transverse, d[axis]), lanes.mul(g[axis], along)))
    }
}

/// A block in the form in which it is streamed.
#[derive(Debug, Clone, Copy, Default)]
pub struct Streamed {
    g: [f64; 3],
    transverse: f64,
}

impl Streamed {
    /// A block whose product cancels nothing in this form; `sign` is σ.
    #[inline]
    pub fn of(block: &SpringBlock, sign: f64) -> Option<Self> {
        let SpringBlock { direction, transverse, axial } = *block;
        let excess = sign * (axial - transverse);
        let without_cancellation = transverse.abs() <= axial.abs() && excess >= 0.0;
        without_cancellation.then(|| Self { g: (direction * excess.sqrt()).into(), transverse })
    }
}
