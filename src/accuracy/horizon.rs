//! How long a motion that forgets its beginning can be predicted.
//!
//! In a motion that folds small differences grow exponentially: those of 10⁻¹² on a cloth of 8 × 8 like `e^{21 t/s}`, until they
//! have the size of the folds. Two runs at tolerances tol and ever smaller then agree until a time `t_R(tol)`, when they first
//! differ by R, and every decade of tol gains the same number s of seconds. The whole way of T seconds would need
//!
//! ```text
//! log₁₀ tol_need = log₁₀ tol − (T − t_R)/s.
//! ```
//!
//! Where that lies below the rounding of numbers no run can follow the motion to its end.

use super::course::Difference;

/// Below this tolerance runs differ by rounding.
const LEAST_TOLERANCE: f64 = 1e-13;

/// Until when positions can be predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Horizon {
    /// Until when the answer is right, in s after the start.
    pub known: f64,
    /// Until when any run can be, in s after the start.
    pub most: f64,
    /// By how much runs differ after that, relative to the extent at the end.
    pub spread: f64,
}

/// When two runs parted, the finer one at `tolerance`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Parting {
    tolerance: f64,
    /// In s after the start; `None` where they stayed together.
    time: Option<f64>,
    spread: f64,
}

/// What two partings say about the rest of the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Outlook {
    /// This tolerance may be enough for the whole way.
    Needs(f64),
    /// None is.
    Unpredictable(Horizon),
}

impl Parting {
    /// When runs were first apart by more than `accuracy`.
    pub fn of(difference: &Difference, accuracy: f64, tolerance: f64, start: f64) -> Self {
        let time = difference.first_beyond(accuracy).map(|time| time - start);
        Self { tolerance, time, spread: difference.largest() }
    }

    /// What this parting and an earlier one, of coarser runs, say about a way of `duration` seconds; `None` where they say nothing.
    pub fn outlook(&self, before: &Self, duration: f64) -> Option<Outlook> {
        let (now, then) = (self.time?, before.time?);
        let gained = (now - then) / (before.tolerance / self.tolerance).log10();
        // Times are known to a sample: less than one of a hundred is none.
        if gained.is_nan() || gained <= 0.01 * duration {
            // Finer runs part no later: either these are too coarse to say anything, or rounding is all there is between them.
            return None;
        }
        let need = self.tolerance.log10() - (duration - now) / gained;
        if need >= LEAST_TOLERANCE.log10() {
            return Some(Outlook::Needs(10f64.powf(need)));
        }
        let most = now + gained * (self.tolerance / LEAST_TOLERANCE).log10().max(0.0);
        Some(Outlook::Unpredictable(Horizon { known: now, most: most.min(duration), spread: self.spread }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parting(tolerance: f64, time: f64) -> Parting {
        Parting { tolerance, time: Some(time), spread: 0.02 }
    }

    /// From 1e-3 to 1e-5 the runs stay together 0.4 s longer: 0.2 s a decade.
    #[test]
    fn tolerances_follow_from_the_time_gained() {
        let (coarse, fine) = (parting(1e-3, 0.2), parting(1e-5, 0.6));
        let Some(Outlook::Needs(need)) = fine.outlook(&coarse, 1.0) else { panic!("predictable") };
        assert!((need / 1e-7 - 1.0).abs() < 1e-9, "{need:e}");
        let Some(Outlook::Unpredictable(horizon)) = fine.outlook(&coarse, 3.0) else { panic!("not predictable") };
        assert!((horizon.known - 0.6).abs() < 1e-12 && (horizon.most - 2.2).abs() < 1e-9, "{horizon:?}");
        assert_eq!(horizon.spread, 0.02);
        assert_eq!(parting(1e-5, 0.2).outlook(&coarse, 1.0), None);
        assert_eq!(Parting { time: None, ..fine }.outlook(&coarse, 1.0), None);
    }

    /// Times count from the start, and less than a hundredth of the way is no gain.
    #[test]
    fn partings_are_told_from_the_start_on() {
        use crate::accuracy::course::Course;
        let course = |apart: f64| {
            let mut course = Course::default();
            for step in 0..4 {
                let x = 1.0 + if step >= 2 { apart } else { 0.0 };
                course.push(3.0 + f64::from(step), &[[0.0; 3].into(), [x, 0.0, 0.0].into()]);
            }
            course
        };
        let difference = course(0.0).compared_with(&course(0.5), &[[0.0; 3].into(), [1.0, 0.0, 0.0].into()]);
        let parting = Parting::of(&difference, 0.1, 1e-5, 3.0);
        assert_eq!((parting.time, parting.spread), (Some(2.0), difference.largest()));
        for (time, says) in [(2.09, false), (2.11, true)] {
            let outlook =
                Parting { time: Some(time), ..parting }.outlook(&Parting { tolerance: 1e-4, ..parting }, 10.0);
            assert_eq!(outlook.is_some(), says, "{time}");
        }
    }
}
