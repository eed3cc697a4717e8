//! The map between (particle, axis) and rows: the one place that decides what is a degree of freedom.

use super::Axes;
use nalgebra::Vector3;
use std::sync::Arc;

/// One free coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Dof {
    /// The particle.
    pub particle: usize,
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
}

impl Dof {
    /// The axis as a letter.
    pub fn axis_name(&self) -> char {
        ['x', 'y', 'z'][self.axis]
    }
}

impl std::fmt::Display for Dof {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "particle {} axis {}", self.particle, self.axis_name())
    }
}

/// The free degrees of freedom, numbered by particle, then axis.
///
/// A *full-length* vector has a 3-vector for every particle; a *reduced* vector has one number for every free
/// coordinate. [`gather`](Self::gather) and [`scatter`](Self::scatter) go between them; gathering is *Project* in the lecture notes. A clone shares the map.
///
/// # Examples
/// ```
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let dofs = system.dofs();
/// // Particle 0 is held: the rows of all matrices are the three coordinates of particle 1.
/// assert_eq!((dofs.len(), dofs.rows(0).len(), dofs.rows(1)), (3, 0, 0..3));
/// let mut reduced = vec![0.0; dofs.len()];
/// dofs.gather(&state.positions, &mut reduced);
/// assert_eq!(reduced, [1.0, 0.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DofMap {
    /// first[p] is the row of particle p's first free axis; first[particles] is the number of rows.
    first: Arc<[u32]>,
    free: Arc<[Axes]>,
}

impl DofMap {
    /// From the free axes of every particle.
    pub fn new(free: Vec<Axes>) -> Self {
        let mut first = Vec::with_capacity(free.len() + 1);
        let mut rows = 0;
        first.push(rows);
        for axes in &free {
            rows += axes.count() as u32;
            first.push(rows);
        }
        Self { first: first.into(), free: free.into() }
    }

    /// All three axes of `particles` particles free.
    pub fn unconstrained(particles: usize) -> Self {
        Self::new(vec![Axes::ALL; particles])
    }

    /// Number of free degrees of freedom: the order of every matrix.
    pub fn len(&self) -> usize {
        self.first.last().map_or(0, |&rows| rows as usize)
    }

    /// Whether nothing can move.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of particles, free or not.
    pub fn particles(&self) -> usize {
        self.free.len()
    }

    /// The free axes of a particle.
    pub fn free_axes(&self, particle: usize) -> Axes {
        self.free[particle]
    }

    /// The rows of a particle: as many as it has free axes, in the order of the axes.
    pub fn rows(&self, particle: usize) -> std::ops::Range<usize> {
        self.first[particle] as usize..self.first[particle + 1] as usize
    }

    /// The number of rows before a particle's: its first row if it has any. `particle` may be one past the last.
    pub fn first_row(&self, particle: usize) -> usize {
        self.first[particle] as usize
    }

    /// The row of a coordinate; `None` when it is prescribed or not modelled.
    pub fn row(&self, dof: Dof) -> Option<usize> {
        let free = self.free[dof.particle];
        free.contains(dof.axis).then(|| self.first[dof.particle] as usize + free.rank(dof.axis))
    }

    /// The coordinate of a row.
    pub fn dof(&self, row: usize) -> Dof {
        let particle = self.first.partition_point(|&first| first as usize <= row) - 1;
        let axis = self.free[particle].iter().nth(row - self.first[particle] as usize);
        Dof { particle, axis: axis.unwrap_or(0) }
    }

    /// The coordinates of all rows, in order.
    pub fn iter(&self) -> impl Iterator<Item = Dof> + '_ {
        (0..self.particles()).flat_map(|particle| self.free[particle].iter().map(move |axis| Dof { particle, axis }))
    }

    /// A particle's part of a reduced vector, as a 3-vector with zeros on the axes that are not free.
    #[inline]
    pub fn get(&self, reduced: &[f64], particle: usize) -> Vector3<f64> {
        let rows = &reduced[self.rows(particle)];
        match *rows {
            [x, y, z] => Vector3::new(x, y, z),
            _ => {
                let mut full = Vector3::zeros();
                for (axis, &value) in self.free[particle].iter().zip(rows) {
                    full[axis] = value;
                }
                full
            }
        }
    }

    /// Adds a 3-vector to a particle's part of a reduced vector, dropping the axes that are not free.
    #[inline]
    pub fn add(&self, reduced: &mut [f64], particle: usize, v: &Vector3<f64>) {
        let rows = &mut reduced[self.rows(particle)];
        match rows {
            [x, y, z] => {
                *x += v.x;
                *y += v.y;
                *z += v.z;
            }
            _ => {
                for (axis, value) in self.free[particle].iter().zip(rows) {
                    *value += v[axis];
                }
            }
        }
    }

    /// Full-length to reduced: takes the free coordinates (*Project* in the lecture notes, which drops the others).
    pub fn gather(&self, full: &[Vector3<f64>], reduced: &mut [f64]) {
        for (particle, v) in full.iter().enumerate() {
            for (axis, value) in self.free[particle].iter().zip(&mut reduced[self.rows(particle)]) {
                *value = v[axis];
            }
        }
    }

    /// Reduced to full-length: sets the free coordinates and leaves the others as they are.
    pub fn scatter(&self, reduced: &[f64], full: &mut [Vector3<f64>]) {
        for (particle, v) in full.iter_mut().enumerate() {
            for (axis, value) in self.free[particle].iter().zip(&reduced[self.rows(particle)]) {
                v[axis] = *value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Dof, DofMap};
    use crate::system::Axes;
    use nalgebra::Vector3;

    /// Six rows: all axes of particle 0, x and z of particle 1, none of particle 2, y of particle 3.
    fn map() -> DofMap {
        DofMap::new(vec![Axes::ALL, Axes::of(&[0, 2]), Axes::NONE, Axes::of(&[1])])
    }

    #[test]
    fn rows_and_coordinates_are_each_others_inverse() {
        let map = map();
        assert_eq!((map.len(), map.particles(), map.is_empty()), (6, 4, false));
        assert_eq!([0, 1, 2, 3].map(|particle| map.rows(particle)), [0..3, 3..5, 5..5, 5..6]);
        assert_eq!([0, 1, 2, 3, 4].map(|particle| map.first_row(particle)), [0, 3, 5, 5, 6]);
        let coordinates = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (3, 1)];
        let expected = coordinates.map(|(particle, axis)| Dof { particle, axis });
        assert_eq!(map.iter().collect::<Vec<_>>(), expected);
        for (row, dof) in expected.into_iter().enumerate() {
            assert_eq!((map.row(dof), map.dof(row)), (Some(row), dof));
        }
        assert_eq!([(1, 1), (2, 0), (3, 2)].map(|(particle, axis)| map.row(Dof { particle, axis })), [None; 3]);
        assert_eq!(expected[4].to_string(), "particle 1 axis z");
        let all = DofMap::unconstrained(2);
        assert_eq!((all.len(), all.row(Dof { particle: 1, axis: 2 })), (6, Some(5)));
        let none = DofMap::new(vec![Axes::NONE]);
        assert!(none.is_empty() && none.iter().next().is_none());
    }

    #[test]
    fn vectors_go_to_reduced_ones_and_back() {
        let map = map();
        let full = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0], [10.0, 11.0, 12.0]].map(Vector3::from);
        let mut reduced = [0.0; 6];
        map.gather(&full, &mut reduced);
        assert_eq!(reduced, [1.0, 2.0, 3.0, 4.0, 6.0, 11.0]);
        let mut back = [Vector3::repeat(-1.0); 4];
        map.scatter(&reduced, &mut back);
        let expected = [[1.0, 2.0, 3.0], [4.0, -1.0, 6.0], [-1.0; 3], [-1.0, 11.0, -1.0]].map(Vector3::from);
        assert_eq!(back, expected);
        let parts = [0, 1, 2, 3].map(|particle| map.get(&reduced, particle));
        assert_eq!(parts, [[1.0, 2.0, 3.0], [4.0, 0.0, 6.0], [0.0; 3], [0.0, 11.0, 0.0]].map(Vector3::from));
        for particle in 0..4 {
            map.add(&mut reduced, particle, &Vector3::new(100.0, 200.0, 300.0));
        }
        assert_eq!(reduced, [101.0, 202.0, 303.0, 104.0, 306.0, 211.0]);
    }
}
