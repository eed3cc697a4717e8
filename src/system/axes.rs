//! Sets of axes.

/// A set of axes.
///
/// # Examples
/// ```
/// use sprung::system::Axes;
///
/// let plane = Axes::first(2);
/// assert!(plane.contains(0) && plane.contains(1) && !plane.contains(2));
/// assert_eq!(Axes::ALL.without(plane), Axes::of(&[2]));
/// ```
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

    /// The axes with the given indices (0, 1, 2).
    pub fn of(axes: &[usize]) -> Self {
        Self(axes.iter().fold(0, |bits, &axis| bits | 1 << axis) & Self::ALL.0)
    }

    /// Whether the axis is in the set.
    pub fn contains(self, axis: usize) -> bool {
        self.0 >> axis & 1 == 1
    }

    /// Number of axes.
    pub fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Number of axes of the set below `axis`.
    pub fn rank(self, axis: usize) -> usize {
        (self.0 & ((1 << axis) - 1)).count_ones() as usize
    }

    /// The axes in ascending order.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..3).filter(move |&axis| self.contains(axis))
    }

    /// This set and an axis (0, 1, 2).
    pub fn with(self, axis: usize) -> Self {
        Self(self.0 | 1 << axis & Self::ALL.0)
    }

    /// This set without the axes of the other.
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
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
        // What is a member already stays one, and there is no fourth axis.
        assert_eq!((ends.with(0), ends.with(1), ends.with(3)), (ends, Axes::ALL, ends));
        assert_eq!((Axes::of(&[2, 0, 0, 3]), Axes::NONE.with(1)), (ends, Axes::of(&[1])));
        assert_eq!((Axes::ALL.without(ends), ends.without(Axes::of(&[1, 2]))), (Axes::of(&[1]), Axes::of(&[0])));
    }
}
