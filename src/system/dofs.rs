//! Free degrees of freedom: the map between (particle, axis) and rows.

use nalgebra::Vector3;
use std::sync::Arc;

/// A set of axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Axes(u8);

impl Axes {
    /// No axis.
    pub const NONE: Self = Self(0);
    /// x, y and z.
    pub const ALL: Self = Self(0b111);

    /// The first `dimension` axes.
    pub fn first(dimension: usize) -> Self {
        Self(Self::ALL.0 >> (3 - dimension.min(3)))
    }

    /// The axes with the given indices (0, 1, 2); others are ignored.
    pub fn of(axes: &[usize]) -> Self {
        axes.iter().fold(Self::NONE, |set, &axis| set.with(axis))
    }

    /// True if the axis is in the set.
    pub fn contains(self, axis: usize) -> bool {
        axis < 3 && self.0 >> axis & 1 == 1
    }

    /// The number of axes.
    pub fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    /// The number of axes of the set below `axis`.
    pub fn rank(self, axis: usize) -> usize {
        self.iter().take_while(|&member| member < axis).count()
    }

    /// The axes in ascending order.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..3).filter(move |&axis| self.contains(axis))
    }

    /// A vector with zeros on the axes that are not in the set.
    #[inline(always)]
    pub fn project(self, vector: &Vector3<f64>) -> Vector3<f64> {
        if self == Self::ALL {
            return *vector;
        }
        Vector3::from_fn(|axis, _| if self.contains(axis) { vector[axis] } else { 0.0 })
    }

    /// This set and the axis (0, 1, 2).
    pub fn with(self, axis: usize) -> Self {
        if axis < 3 { Self(self.0 | 1 << axis) } else { self }
    }

    /// This set without the axes of the other.
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}

/// One coordinate of a particle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Dof {
    /// The particle.
    pub particle: usize,
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
}

impl Dof {
    /// The letter of the axis.
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
/// A *full-length* vector has a 3-vector for every particle; a *reduced* vector has one number for every free coordinate. [`gather`](Self::gather)
/// (*Project* in the lecture notes) and [`scatter`](Self::scatter) convert between them. A clone shares the map.
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
    /// first[p] is the number of rows before those of particle p; the last entry is the number of all rows.
    first: Arc<[u32]>,
    free: Arc<[Axes]>,
}

impl DofMap {
    /// A map from the free axes of every particle.
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

    /// A map in which all three axes of `particles` particles are free.
    pub fn unconstrained(particles: usize) -> Self {
        Self::new(vec![Axes::ALL; particles])
    }

    /// The number of free degrees of freedom, which is the order of every matrix.
    pub fn len(&self) -> usize {
        self.first.last().map_or(0, |&rows| rows as usize)
    }

    /// True if there are no free degrees of freedom.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of particles, free or not.
    pub fn particles(&self) -> usize {
        self.free.len()
    }

    /// The free axes of a particle.
    pub fn free_axes(&self, particle: usize) -> Axes {
        self.free[particle]
    }

    /// The rows of a particle, one for each free axis, in the order of the axes.
    pub fn rows(&self, particle: usize) -> std::ops::Range<usize> {
        self.first[particle] as usize..self.first[particle + 1] as usize
    }

    /// The number of rows before those of a particle. `particle` may be one past the last.
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

    /// The 3-vector of a particle in a reduced vector, with zeros on the axes that are not free.
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

    /// Adds the free components of a 3-vector to the rows of a particle.
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

    /// Copies the free coordinates of a full-length vector to a reduced one.
    pub fn gather(&self, full: &[Vector3<f64>], reduced: &mut [f64]) {
        for (particle, v) in full.iter().enumerate() {
            for (axis, value) in self.free[particle].iter().zip(&mut reduced[self.rows(particle)]) {
                *value = v[axis];
            }
        }
    }

    /// Copies a reduced vector to the free coordinates of a full-length one; the others do not change.
    pub fn scatter(&self, reduced: &[f64], full: &mut [Vector3<f64>]) {
        for (particle, v) in full.iter_mut().enumerate() {
            for (axis, value) in self.free[particle].iter().zip(&reduced[self.rows(particle)]) {
                v[axis] = *value;
            }
        }
    }

    /// The free coordinates of a full-length vector.
    pub(crate) fn reduced(&self, full: &[Vector3<f64>]) -> Vec<f64> {
        let mut reduced = vec![0.0; self.len()];
        self.gather(full, &mut reduced);
        reduced
    }

    /// A full-length vector from a reduced one, with zeros on the axes that are not free.
    pub(crate) fn full(&self, reduced: &[f64]) -> Vec<Vector3<f64>> {
        (0..self.particles()).map(|particle| self.get(reduced, particle)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Axes;

    #[test]
    fn sets_are_what_their_members_are() {
        let ends = Axes::of(&[0, 2]);
        assert_eq!([0, 1, 2].map(|axis| ends.contains(axis)), [true, false, true]);
        assert_eq!([0, 1, 2].map(|axis| ends.rank(axis)), [0, 1, 1]);
        assert_eq!((ends.count(), ends.iter().collect::<Vec<_>>()), (2, vec![0, 2]));
        assert_eq!([0, 1, 2, 3, 4].map(|dimension| Axes::first(dimension).count()), [0, 1, 2, 3, 3]);
        // There is no fourth axis.
        assert_eq!((ends.with(0), ends.with(1), ends.with(3)), (ends, Axes::ALL, ends));
        assert_eq!((Axes::of(&[2, 0, 0, 3]), Axes::NONE.with(1)), (ends, Axes::of(&[1])));
        assert_eq!((Axes::ALL.without(ends), ends.without(Axes::of(&[1, 2]))), (Axes::of(&[1]), Axes::of(&[0])));
    }
}
