//! The near-null space: how the nodes of every level follow a rigid motion.
//!
//! A rigid motion about a centre C is a translation t and a rotation w, `u(x) = t + w × (x − C)`: M = 6 numbers in space, 3 in
//! the plane (two translations, one rotation) and 1 on a line. A node with N unknowns follows it by its modes B, an N × M
//! block, about its own centre c: B (t', w) with the same motion seen from there,
//!
//! ```text
//! t' = t + w × (c − C),   that is   (t', w) = S(c − C) (t, w).
//! ```
//!
//! A particle's modes are `B = [I 0]` without the rows of axes that are not free, its centre is its position. The modes of an
//! aggregate's members about its centre, the mean of theirs, are the blocks `B_i S(c_i − C)`. With their Gram matrix factored,
//!
//! ```text
//! Σ (B_i S)ᵀ (B_i S) = Rᵀ R,   T_i = B_i S(c_i − C) R⁻¹,
//! ```
//!
//! the columns of T are orthonormal and span the same motions: T is the tentative prolongator, and R holds the modes of the
//! aggregate as a node of the next level, about C. A motion that the members do not feel, or not independently of the
//! others (one free axis, a single particle, particles on a line), has no pivot: its column of T and its row of R are zero.

use super::block::{Block, add_product, add_transposed_product, norm_squared, zero};

/// A motion is dropped where the part of its column that the columns before it do not span is below this share of the
/// whole. R comes from a Gram matrix, whose squares lose what is below 1e-8.
const INDEPENDENT: f64 = 1e-4;

/// Modes of a node about its centre.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<const N: usize, const M: usize> {
    pub modes: Block<N, M>,
    pub centre: [f64; 3],
}

/// `B S(s)`: modes about a centre as modes about another one, s = old − new.
#[inline(always)]
fn shifted<const N: usize, const M: usize>(b: &Block<N, M>, s: [f64; 3]) -> Block<N, M> {
    let mut shifted = *b;
    for (to, from) in shifted.iter_mut().zip(b) {
        match (&mut to[..], &from[..]) {
            ([.., x, y, z], [bx, by, bz, ..]) if M == 6 => {
                // Row · (e_k × s) for the axes k of rotation.
                *x += by * -s[2] + bz * s[1];
                *y += bx * s[2] + bz * -s[0];
                *z += bx * -s[1] + by * s[0];
            }
            ([.., z], [bx, by, ..]) if M == 3 => *z += bx * -s[1] + by * s[0],
            _ => {}
        }
    }
    shifted
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

impl<const N: usize, const M: usize> Frame<N, M> {
    /// `B_i S(c_i − C)`.
    #[inline(always)]
    fn about(&self, centre: [f64; 3]) -> Block<N, M> {
        shifted(&self.modes, difference(self.centre, centre))
    }
}

/// The frames of a level's nodes.
pub(super) trait Frames<const N: usize, const M: usize>: Sync {
    /// Of one node.
    fn frame(&self, node: usize) -> Frame<N, M>;
}

/// As the nodes of the next level, aggregates have their own modes.
impl<const M: usize> Frames<M, M> for [AggregateModes<M>] {
    #[inline(always)]
    fn frame(&self, node: usize) -> Frame<M, M> {
        self[node].frame
    }
}

/// An aggregate's own frame and what makes its members' blocks of T.
#[derive(Debug, Clone, Copy)]
pub(super) struct AggregateModes<const M: usize> {
    /// R about the aggregate's centre C.
    pub frame: Frame<M, M>,
    /// R⁻¹, with zeros for the motions that are dropped.
    inverse: Block<M, M>,
}

impl<const M: usize> AggregateModes<M> {
    /// No motion at all.
    pub const NOTHING: Self = Self { frame: Frame { modes: [[0.0; M]; M], centre: [0.0; 3] }, inverse: [[0.0; M]; M] };

    /// From the members' frames.
    pub fn of<const N: usize>(members: impl Iterator<Item = Frame<N, M>> + Clone) -> Self {
        let mut centre = [0.0; 3];
        let count = members.clone().count().max(1) as f64;
        for member in members.clone() {
            for (c, x) in centre.iter_mut().zip(member.centre) {
                *c += x / count;
            }
        }
        let mut gram: Block<M, M> = zero();
        for member in members {
            let b = member.about(centre);
            add_transposed_product(&mut gram, &b, &b);
        }
        let (modes, inverse) = factor(&gram);
        Self { frame: Frame { modes, centre }, inverse }
    }

    /// `T_i = B_i S(c_i − C) R⁻¹`.
    #[inline(always)]
    pub fn tentative<const N: usize>(&self, member: &Frame<N, M>) -> Block<N, M> {
        let mut t = zero();
        add_product(&mut t, &member.about(self.frame.centre), &self.inverse);
        t
    }

    /// Whether a motion is one of the aggregate's.
    pub fn has(&self, motion: usize) -> bool {
        self.inverse[motion][motion] != 0.0
    }
}

/// R and R⁻¹ of `G = RᵀR`, R upper triangular, with zero rows of R and zero columns of R⁻¹ where G has no pivot.
fn factor<const M: usize>(gram: &Block<M, M>) -> (Block<M, M>, Block<M, M>) {
    let mut r: Block<M, M> = zero();
    let mut inverse: Block<M, M> = zero();
    for j in 0..M {
        // Column j of R above the diagonal: the part of motion j that the motions before it span.
        let mut above = [0.0; M];
        for i in (0..j).filter(|&i| r[i][i] != 0.0) {
            let sum: f64 = (0..i).map(|k| r[k][i] * above[k]).sum();
            above[i] = (gram[i][j] - sum) / r[i][i];
        }
        for i in 0..j {
            r[i][j] = above[i];
        }
        let rest = gram[j][j] - norm_squared(&above);
        if rest > INDEPENDENT * INDEPENDENT * gram[j][j] {
            r[j][j] = rest.sqrt();
            inverse[j][j] = 1.0 / r[j][j];
            for i in 0..j {
                let sum: f64 = (i..j).map(|k| inverse[i][k] * above[k]).sum();
                inverse[i][j] = -sum * inverse[j][j];
            }
        }
    }
    (r, inverse)
}
