//! Where a run was at times spread over it, to compare runs along their whole way.
//!
//! The difference of two runs at the end alone may be small by chance: of a vibration with wrong phases, whenever both pass the same
//! place. Over the last part of the way it shows its size.

use super::relative_position_error;
use nalgebra::Vector3;

/// Memory for the positions of one run, in bytes.
const MEMORY: usize = 134_217_728;

/// Bounds of the number of samples.
const SAMPLES: [usize; 2] = [8, 64];

/// The part of the way over which the largest difference counts for that at the end.
pub(super) const LAST_PART: f64 = 0.25;

/// The sine of the angle up to which two vectors lie on a line.
const ALIGNED: f64 = 1e-9;

/// Positions at every `every`-th of a run's samples and at its end.
#[derive(Debug, Clone, Default)]
pub(super) struct Course {
    times: Vec<f64>,
    positions: Vec<Vec<Vector3<f64>>>,
}

/// How many samples of so many particles are worth their memory.
pub(super) fn most_samples(particles: usize) -> u64 {
    let fitting = MEMORY / (size_of::<Vector3<f64>>() * particles.max(1));
    fitting.clamp(SAMPLES[0], SAMPLES[1]) as u64
}

impl Course {
    pub fn push(&mut self, time: f64, positions: &[Vector3<f64>]) {
        self.times.push(time);
        self.positions.push(positions.to_vec());
    }

    /// The positions at the end.
    pub fn end(&self) -> &[Vector3<f64>] {
        self.positions.last().map_or(&[], Vec::as_slice)
    }

    /// How many springs, whose ends are these pairs, pass the length zero on a straight line, on the way from the positions in which the run began.
    /// So do those of a motion in one dimension, also where it is written in more.
    pub fn reversed(&self, pairs: &[[u32; 2]], start: &[Vector3<f64>]) -> usize {
        pairs.iter().filter(|&&pair| self.is_reversed(pair, start)).count()
    }

    fn is_reversed(&self, [i, j]: [u32; 2], start: &[Vector3<f64>]) -> bool {
        let along = |positions: &[Vector3<f64>]| match (positions.get(i as usize), positions.get(j as usize)) {
            (Some(i), Some(j)) => j - i,
            _ => Vector3::zeros(),
        };
        let first = along(start);
        // Most springs of motions in space have turned at the end, and need not be followed.
        if !is_aligned(&first, &along(self.end())) {
            return false;
        }
        self.positions.iter().map(|positions| along(positions)).any(|d| d.dot(&first) < 0.0 && is_aligned(&first, &d))
    }

    /// `self + factor (self − coarser)`, what is left when an error of known order is taken off.
    pub fn extrapolated(&self, coarser: &Self, factor: f64) -> Self {
        let pairs = self.positions.iter().zip(&coarser.positions);
        let extrapolate = |(fine, coarse): (&Vec<Vector3<f64>>, &Vec<Vector3<f64>>)| {
            fine.iter().zip(coarse).map(|(fine, coarse)| fine + (fine - coarse) * factor).collect()
        };
        Self { times: self.times.clone(), positions: pairs.map(extrapolate).collect() }
    }

    /// How far another run of the same motion was from this one. `start` holds the positions in which both began.
    pub fn compared_with(&self, other: &Self, start: &[Vector3<f64>]) -> Difference {
        let extent = super::extent(self.end(), start);
        let distance = |(a, b): (&Vec<Vector3<f64>>, &Vec<Vector3<f64>>)| {
            let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
            let distance = sum.sqrt() / extent;
            if distance.is_nan() { f64::INFINITY } else { distance }
        };
        let distances: Vec<f64> = self.positions.iter().zip(&other.positions).map(distance).collect();
        let end = relative_position_error(other.end(), self.end(), start);
        Difference { times: self.times.clone(), distances, end: if end.is_nan() { f64::INFINITY } else { end } }
    }
}

/// Whether two vectors lie on a line, up to rounding.
fn is_aligned(a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    a.cross(b).norm() <= ALIGNED * a.norm() * b.norm()
}

/// How far two runs were apart, relative to the extent at the end.
#[derive(Debug, Clone)]
pub(super) struct Difference {
    times: Vec<f64>,
    distances: Vec<f64>,
    /// At the end.
    pub end: f64,
}

impl Difference {
    /// The largest over the last part of the way.
    pub fn envelope(&self) -> f64 {
        let (Some(first), Some(last)) = (self.times.first(), self.times.last()) else { return self.end };
        let from = last - LAST_PART * (last - first);
        let late = self.times.iter().zip(&self.distances).filter(|(time, _)| **time >= from);
        late.map(|(_, distance)| *distance).fold(self.end, f64::max)
    }

    /// When the runs were first apart by more than `distance`, in s; `None` if they never were.
    pub fn first_beyond(&self, distance: f64) -> Option<f64> {
        let mut way = self.times.iter().zip(&self.distances);
        way.find(|(_, apart)| **apart > distance).map(|(time, _)| *time)
    }

    /// The largest of all.
    pub fn largest(&self) -> f64 {
        self.distances.iter().copied().fold(self.end, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two particles, the second at `1 + x`, at times 0, 1, 2, …
    fn course(at: &[f64]) -> Course {
        let mut course = Course::default();
        for (time, x) in at.iter().enumerate() {
            course.push(time as f64, &[Vector3::zeros(), Vector3::new(1.0 + x, 0.0, 0.0)]);
        }
        course
    }

    /// The extent at the end is that of two particles 1 m apart, 1/√2 m.
    #[test]
    fn differences_are_seen_along_the_way() {
        let (exact, wrong) = (course(&[0.0; 9]), course(&[0.0, 0.0, 0.1, 0.0, 0.5, 0.0, 0.0, 0.3, 0.0]));
        let difference = exact.compared_with(&wrong, &[Vector3::zeros(); 2]);
        let relative = |distance: f64| distance * 2f64.sqrt();
        assert_eq!(difference.end, 0.0);
        assert!((difference.envelope() - relative(0.3)).abs() < 1e-15);
        assert!((difference.largest() - relative(0.5)).abs() < 1e-15);
        let beyond = [0.05, 0.2, 0.6].map(|distance| difference.first_beyond(relative(distance)));
        assert_eq!(beyond, [Some(2.0), Some(4.0), None]);
    }

    #[test]
    fn the_leading_error_is_taken_off() {
        let (coarse, fine) = (course(&[0.4, 0.8]), course(&[0.1, 0.2]));
        let better = fine.extrapolated(&coarse, 1.0 / 3.0);
        let difference = better.compared_with(&course(&[0.0, 0.0]), &[Vector3::zeros(); 2]);
        assert!(difference.largest() < 1e-15);
    }

    /// The second particle, 1 m from the first, passes it and comes back.
    #[test]
    fn springs_that_turned_round_are_seen() {
        let start = [Vector3::zeros(), Vector3::new(1.0, 0.0, 0.0)];
        for (at, expected) in [([-0.2, -0.9, 0.3], 0), ([-0.2, -1.1, 0.3], 2)] {
            assert_eq!(course(&at).reversed(&[[0, 1], [1, 0]], &start), expected);
        }
    }

    #[test]
    fn large_scenes_keep_few_samples() {
        assert_eq!([1, 87_381, 1_000_000].map(most_samples), [64, 64, 8]);
    }

    /// As far apart as asked for is not beyond it.
    #[test]
    fn runs_part_where_they_are_farther_apart_than_asked_for() {
        let difference = course(&[0.0; 3]).compared_with(&course(&[0.0, 0.1, 0.5]), &[Vector3::zeros(); 2]);
        assert_eq!(difference.first_beyond(difference.largest()), None);
        assert_eq!(difference.first_beyond(0.99 * difference.largest()), Some(2.0));
    }

    /// Away from the origin, and where ends meet without passing each other.
    #[test]
    fn springs_have_turned_round_where_ends_have_passed() {
        let at = |a: f64, b: f64| [a, b].map(|x| Vector3::new(x, 0.0, 0.0));
        for (then, expected) in [((5.5, 5.6), 0), ((5.6, 5.5), 1), ((5.5, 5.5), 0), ((-7.0, 2.0), 0), ((2.0, -7.0), 1)]
        {
            let mut course = Course::default();
            course.push(1.0, &at(then.0, then.1));
            for pair in [[0, 1], [1, 0]] {
                assert_eq!(course.reversed(&[pair], &at(5.0, 6.0)), expected, "{then:?}");
            }
        }
    }

    /// Along a line that is no axis; not where it turns round, nor beside it.
    #[test]
    fn springs_pass_the_length_zero_on_any_line() {
        let start = [Vector3::zeros(), Vector3::new(0.3, -0.7, 0.9)];
        let line = start[1];
        let aside = Vector3::new(0.7, 0.3, 0.0) * 1e-6;
        for (then, end, expected) in [
            (-line, line * 2.0, 1),
            (line * 1e-3, -line * 1e-9, 1),
            (-line, line + aside, 0),
            (-line + aside, line, 0),
            (line * 0.1, line, 0),
            (Vector3::zeros(), line, 0),
        ] {
            let mut course = Course::default();
            course.push(1.0, &[start[0], then]);
            course.push(2.0, &[start[0], end]);
            assert_eq!(course.reversed(&[[0, 1]], &start), expected, "{then} {end}");
        }
    }
}
