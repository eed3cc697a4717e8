//! Whether a graph is like a volume or like a surface, told without coordinates.
//!
//! A surface of n vertices has separators of some √n vertices, a volume such of n^(2/3). Minimum degree finds a good order of the former;
//! of the latter dissections are better, by more the larger n. Two signs tell a volume:
//!
//! - **its growth**: within r edges of a vertex there are about r^d others, d = 2 on a surface, 3 in a volume, also in a corner. The
//!   exponent is taken between half the distance within which a quarter of the component lies and that distance, from two vertices that are
//!   far from each other;
//! - **its cost**: eliminating separators of `c √n` vertices of w rows each takes `c³ w³ n^(3/2)` operations, with c³ below a hundred where a
//!   cloth is joined up to the second neighbour. A slab of a few layers, whose growth is a surface's, takes more.
//!
//! What is taken for a volume though it is none is dissected in vain, which costs time once; nothing depends on it else.

/// Dimension up to which a graph is a surface: cloths have 1.7 to 2.0, triangulated bodies 2.1, lattices and networks 2.35 to 3.2.
pub const SURFACE: f64 = 2.25;

/// c³ above which a factorization is dearer than a surface's: cloths of 24² to 1000² particles have 37 to 109, slabs of three layers 160.
const SURFACE_COST: f64 = 130.0;

/// Whether an elimination takes more operations than those of surfaces do.
pub fn is_costly(flops: f64, vertices: usize, rows: f64) -> bool {
    let vertices = vertices as f64;
    flops > SURFACE_COST * (rows / vertices).powi(3) * vertices.powf(1.5)
}

/// The exponent d by which the number of vertices within a distance grows, in the component of a vertex; zero where there are no distances.
pub fn dimension<I: Iterator<Item = u32>>(vertices: usize, inside: u32, neighbours: impl Fn(u32) -> I) -> f64 {
    let mut balls = Balls { seen: vec![false; vertices], reached: Vec::new(), sizes: Vec::new() };
    let mut far = balls.grow(inside, &neighbours);
    let mut sum = 0.0;
    for _ in 0..2 {
        far = balls.grow(far, &neighbours);
        sum += balls.exponent();
    }
    sum / 2.0
}

/// What is reached from a vertex.
struct Balls {
    seen: Vec<bool>,
    reached: Vec<u32>,
    /// How many vertices are within 0, 1, … edges.
    sizes: Vec<f64>,
}

impl Balls {
    /// Goes out from a vertex; returns one that is farthest from it.
    fn grow<I: Iterator<Item = u32>>(&mut self, start: u32, neighbours: &impl Fn(u32) -> I) -> u32 {
        let Self { seen, reached, sizes } = self;
        seen.fill(false);
        reached.clear();
        sizes.clear();
        let mut reach = |v: u32, reached: &mut Vec<u32>| {
            if let Some(seen) = seen.get_mut(v as usize).filter(|seen| !**seen) {
                *seen = true;
                reached.push(v);
            }
        };
        reach(start, reached);
        let mut shell = 0..reached.len();
        while !shell.is_empty() {
            sizes.push(shell.end as f64);
            for k in shell.clone() {
                let Some(&v) = reached.get(k) else { continue };
                neighbours(v).for_each(|u| reach(u, reached));
            }
            shell = shell.end..reached.len();
        }
        reached.last().copied().unwrap_or(start)
    }

    /// `log₂` of how much a ball of a quarter of all vertices is larger than one of half its radius.
    fn exponent(&self) -> f64 {
        let all = self.sizes.last().copied().unwrap_or(0.0);
        let radius = self.sizes.partition_point(|&size| size < all / 4.0);
        let size = |radius: usize| self.sizes.get(radius).copied().unwrap_or(all);
        // Between two radii a power of the radius is nearly a straight line over it in the logarithm.
        let half = (size(radius / 2).ln() + size(radius.div_ceil(2)).ln()) / 2.0;
        if radius == 0 { 0.0 } else { (size(radius).ln() - half) / std::f64::consts::LN_2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The graph of a box of points, joined along the axes.
    fn grid(lengths: [u32; 3]) -> (usize, impl Fn(u32) -> std::vec::IntoIter<u32>) {
        let [a, b, c] = lengths;
        let neighbours = move |v: u32| {
            let at = [v / (b * c), v / c % b, v % c];
            let steps = [b * c, c, 1];
            let mut joined = Vec::new();
            for axis in 0..3 {
                if at[axis] > 0 {
                    joined.push(v - steps[axis]);
                }
                if at[axis] + 1 < lengths[axis] {
                    joined.push(v + steps[axis]);
                }
            }
            joined.into_iter()
        };
        ((a * b * c) as usize, neighbours)
    }

    #[test]
    fn chains_surfaces_and_volumes_are_told_apart() {
        for (lengths, expected) in [([400, 1, 1], 1.0), ([40, 40, 1], 2.0), ([60, 60, 2], 2.0), ([20, 20, 20], 2.75)] {
            let (vertices, neighbours) = grid(lengths);
            for inside in [0, vertices as u32 / 2] {
                let d = dimension(vertices, inside, &neighbours);
                assert!((d - expected).abs() < 0.2, "{lengths:?}: {d}");
            }
        }
    }

    #[test]
    fn where_there_are_no_distances_there_is_no_dimension() {
        for (vertices, joined) in [(1, vec![]), (4, vec![0, 1, 2, 3])] {
            assert_eq!(dimension(vertices, 0, |_| joined.clone().into_iter()), 0.0);
        }
        assert_eq!(dimension(0, 0, |_| [].into_iter()), 0.0);
    }

    /// Eliminating a dense graph of n vertices takes n³/3 operations: more than that of any surface from some size on.
    #[test]
    fn what_is_dense_is_costly() {
        let dense = |n: f64| is_costly((3.0 * n).powi(3) / 3.0, n as usize, 3.0 * n);
        assert!(!dense(50.0) && dense(60.0));
    }
}
