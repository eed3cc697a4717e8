//! The near-null space: the rigid motions of the nodes of every level.
//!
//! A rigid motion about a centre C is a translation t and a rotation w, `u(x) = t + w × (x − C)`: M = 6 numbers in space, 3 in the plane (two
//! translations, one rotation) and 1 on a line. A node with N unknowns follows it by its modes B, an N × M block, about its own centre c: B (t', w)
//! with the same motion seen from there,
//!
//! ```text
//! t' = t + w × (c − C),   that is   (t', w) = S(c − C) (t, w).
//! ```
//!
//! A particle's modes are `B = [I 0]` without the rows of axes that are not free, its centre is its position. The modes of an aggregate's members
//! about its centre, the mean of theirs, are the blocks `B_i S(c_i − C)`. With their Gram matrix factored,
//!
//! ```text
//! Σ (B_i S)ᵀ (B_i S) = Rᵀ R,   T_i = B_i S(c_i − C) R⁻¹,
//! ```
//!
//! the columns of T are orthonormal and span the same motions: T is the tentative prolongator, and R holds the modes of the aggregate as a node of
//! the next level, about C. A motion that the members do not feel, or not independently of the others (one free axis, a single particle, particles on
//! a line), has no pivot: its column of T and its row of R are zero.

use super::block::{Block, add_product, add_transposed_product, zero};

/// Least independent share of a motion's column that is kept: R comes from a Gram matrix, whose squares lose parts below 1e-8.
const INDEPENDENT: f64 = 1e-4;

#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<const N: usize, const M: usize> {
    pub modes: Block<N, M>,
    pub centre: [f64; 3],
}

impl<const N: usize, const M: usize> Frame<N, M> {
    /// `B S(c − C)`: the modes about another centre C.
    #[inline(always)]
    pub fn about(&self, centre: [f64; 3]) -> Block<N, M> {
        let s: [f64; 3] = std::array::from_fn(|axis| self.centre[axis] - centre[axis]);
        let mut shifted = self.modes;
        for (to, from) in shifted.iter_mut().zip(&self.modes) {
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
}

pub(super) trait Frames<const N: usize, const M: usize>: Sync {
    fn frame(&self, node: usize) -> Frame<N, M>;
}

impl<const M: usize> Frames<M, M> for [AggregateModes<M>] {
    #[inline(always)]
    fn frame(&self, node: usize) -> Frame<M, M> {
        self[node].frame
    }
}

/// An aggregate's frame, and R⁻¹ for its members' blocks of T.
#[derive(Debug, Clone, Copy)]
pub(super) struct AggregateModes<const M: usize> {
    /// R about the aggregate's centre C.
    pub frame: Frame<M, M>,
    /// R⁻¹, with zeros for the motions that are dropped.
    inverse: Block<M, M>,
}

impl<const M: usize> AggregateModes<M> {
    pub const NONE: Self = Self { frame: Frame { modes: [[0.0; M]; M], centre: [0.0; 3] }, inverse: [[0.0; M]; M] };

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
        self.normalised(&member.about(self.frame.centre))
    }

    /// `X R⁻¹`.
    #[inline(always)]
    pub fn normalised<const N: usize>(&self, x: &Block<N, M>) -> Block<N, M> {
        let mut product = zero();
        add_product(&mut product, x, &self.inverse);
        product
    }

    pub fn has(&self, motion: usize) -> bool {
        self.inverse[motion][motion] != 0.0
    }
}

/// R and R⁻¹ of `G = RᵀR`, with zero rows of R and zero columns of R⁻¹ where G has no pivot.
///
/// The motion with the largest share of its column that those before do not span comes next, so that nearly dependent motions come last: earlier,
/// their small pivots would leave errors that look like independent parts.
fn factor<const M: usize>(gram: &Block<M, M>) -> (Block<M, M>, Block<M, M>) {
    let mut r: Block<M, M> = zero();
    let mut inverse: Block<M, M> = zero();
    let mut rest: [f64; M] = std::array::from_fn(|j| gram[j][j]);
    let mut taken = [false; M];
    let mut order = [0; M];
    for count in 0..M {
        let share = |j: usize| if gram[j][j] > 0.0 { rest[j] / gram[j][j] } else { 0.0 };
        let left = (0..M).filter(|&j| !taken[j]);
        let next =
            left.fold(None, |best, j| if best.is_some_and(|best| share(best) >= share(j)) { best } else { Some(j) });
        let Some(j) = next.filter(|&j| share(j) > INDEPENDENT * INDEPENDENT) else { break };
        let before = &order[..count];
        let pivot = rest[j].sqrt();
        for c in (0..M).filter(|&c| !taken[c] && c != j) {
            let spanned: f64 = before.iter().map(|&p: &usize| r[p][j] * r[p][c]).sum();
            r[j][c] = (gram[j][c] - spanned) / pivot;
            rest[c] -= r[j][c] * r[j][c];
        }
        for &i in before {
            let sum: f64 = before.iter().map(|&p| inverse[i][p] * r[p][j]).sum();
            inverse[i][j] = -sum / pivot;
        }
        (r[j][j], inverse[j][j]) = (pivot, 1.0 / pivot);
        (taken[j], order[count]) = (true, j);
    }
    (r, inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Aggregates of two and three particles near a line, with nearly or wholly dependent rotations: the columns of T are orthonormal, and T R has
    /// the modes.
    #[test]
    fn kept_motions_are_orthonormal_however_dependent_others_are() {
        let mut seed = 1u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let mut kept = [0; 7];
        for case in 0..10_000 {
            let offset = 10f64.powi(-(case % 7));
            let members: Vec<Frame<3, 6>> = (0..2 + case % 2)
                .map(|k| {
                    let held = if random() < 0.0 { 3 } else { (case / 3 % 3) as usize };
                    let modes =
                        std::array::from_fn(|a| std::array::from_fn(|b| f64::from(u8::from(a == b && a != held))));
                    let along = f64::from(k) + 0.3 * random();
                    Frame { modes, centre: [along, 0.5 * along + offset * random(), 0.2 * along + offset * random()] }
                })
                .collect();
            let aggregate = AggregateModes::of(members.iter().copied());
            let blocks: Vec<Block<3, 6>> = members.iter().map(|member| aggregate.tentative(member)).collect();
            let has: Vec<usize> = (0..6).filter(|&m| aggregate.has(m)).collect();
            kept[has.len()] += 1;
            for (&a, &b) in has.iter().flat_map(|a| has.iter().map(move |b| (a, b))) {
                let product: f64 = blocks.iter().flatten().map(|row| row[a] * row[b]).sum();
                assert!((product - f64::from(u8::from(a == b))).abs() < 1e-6, "case {case}: {a} {b} {product}");
            }
            for (member, block) in members.iter().zip(&blocks) {
                let mut again: Block<3, 6> = zero();
                add_product(&mut again, block, &aggregate.frame.modes);
                let expected = member.about(aggregate.frame.centre);
                let error = again.iter().flatten().zip(expected.iter().flatten()).map(|(a, b)| (a - b).abs());
                assert!(error.fold(0.0, f64::max) < 1e-3, "case {case}");
            }
        }
        assert!(kept[4] > 50 && kept[5] > 500 && kept[6] > 500, "{kept:?}");
    }

    /// A motion is kept while its independent part is above 10⁻⁴. Of equals the first comes first.
    #[test]
    fn factors_keep_what_is_independent() {
        let kept =
            |gram: Block<2, 2>| factor(&gram).1.iter().enumerate().map(|(j, row)| row[j] != 0.0).collect::<Vec<_>>();
        assert_eq!(kept([[1.0, 1.0], [1.0, 1.0 + 1e-6]]), [true, true]);
        assert_eq!(kept([[1.0, 1.0], [1.0, 1.0 + 1e-9]]), [true, false]);
        assert_eq!(kept([[1.0, 0.0], [0.0, 0.0]]), [true, false]);
        assert_eq!(kept([[0.0, 0.0], [0.0, 1.0]]), [false, true]);
        assert_eq!(factor(&[[6.0, 0.9], [0.9, 4.0]]).0[1][0], 0.0);
        let gram: Block<3, 3> = [[1.0, 0.5, 0.2], [0.5, 4.0, 0.7], [0.2, 0.7, 9.0]];
        let (r, inverse) = factor(&gram);
        assert!(r[1][0] == 0.0 && r[2][0] == 0.0 && r[0][1] != 0.0 && r[0][2] != 0.0);
        let (mut square, mut unit): (Block<3, 3>, Block<3, 3>) = (zero(), zero());
        add_transposed_product(&mut square, &r, &r);
        add_product(&mut unit, &r, &inverse);
        for i in 0..3 {
            for j in 0..3 {
                assert!((square[i][j] - gram[i][j]).abs() < 1e-14, "{i} {j}");
                assert!((unit[i][j] - f64::from(u8::from(i == j))).abs() < 1e-14, "{i} {j}");
            }
        }
    }
}
