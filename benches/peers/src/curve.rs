//! What was measured of one contender on one scene.

use sprung::figure::Look;

/// Errors that the tables ask for.
pub const ACCURACIES: [f64; 8] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8];

/// Whose method it is.
#[derive(Clone, Copy, PartialEq)]
pub enum Side {
    Ours,
    Peer,
}

/// A measured run.
pub struct Run {
    pub seconds: f64,
    /// The relative position error at the end, or why there is no useful one.
    pub outcome: Result<f64, String>,
}

/// The runs of one contender, from coarse to fine.
pub struct Curve {
    pub name: String,
    pub side: Side,
    pub look: Look,
    pub runs: Vec<Run>,
}

impl Run {
    /// Whether it errs no more than this.
    pub fn reaches(&self, accuracy: f64) -> bool {
        self.outcome.as_ref().is_ok_and(|error| *error <= accuracy)
    }
}

impl Curve {
    /// The shortest time of the runs that err no more, in s.
    pub fn shortest(&self, accuracy: f64) -> Option<f64> {
        self.fastest(accuracy).and_then(|rung| self.runs.get(rung)).map(|run| run.seconds)
    }

    /// Which run that is.
    pub fn fastest(&self, accuracy: f64) -> Option<usize> {
        let enough = self.runs.iter().enumerate().filter(|(_, run)| run.reaches(accuracy));
        enough.min_by(|(_, a), (_, b)| a.seconds.total_cmp(&b.seconds)).map(|(rung, _)| rung)
    }

    /// Errors and times, in s, of the runs than which no other of them is both as fast and as accurate, the most accurate first.
    pub fn front(&self) -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> =
            self.runs.iter().filter_map(|run| Some((*run.outcome.as_ref().ok()?, run.seconds))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut shortest = f64::INFINITY;
        points.retain(|&(_, seconds)| {
            let is_faster = seconds < shortest;
            shortest = shortest.min(seconds);
            is_faster
        });
        points
    }
}

/// The fastest of the curves of a side for an error: its name and its time, in s.
pub fn fastest<'c>(curves: impl IntoIterator<Item = &'c Curve>, side: Side, accuracy: f64) -> Option<(&'c str, f64)> {
    let times = curves.into_iter().filter(|curve| curve.side == side);
    let times = times.filter_map(|curve| Some((curve.name.as_str(), curve.shortest(accuracy)?)));
    times.min_by(|(_, a), (_, b)| a.total_cmp(b))
}

/// The shortest time of all curves for an error, in s.
pub fn shortest_of_all(curves: &[Curve], accuracy: f64) -> Option<f64> {
    curves.iter().filter_map(|curve| curve.shortest(accuracy)).reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_and_wrong_runs_are_not_in_front() {
        let runs = [(1.0, Ok(0.1)), (2.0, Ok(0.3)), (3.0, Ok(0.01)), (2.5, Ok(0.001)), (9.0, Err("no".into()))];
        let runs = runs.into_iter().map(|(seconds, outcome)| Run { seconds, outcome }).collect();
        let curve = Curve { name: String::new(), side: Side::Ours, look: Look { number: 0, hollow: false }, runs };
        assert_eq!(curve.front(), [(0.001, 2.5), (0.1, 1.0)]);
        assert_eq!((curve.shortest(0.05), curve.shortest(1e-4)), (Some(2.5), None));
    }
}
