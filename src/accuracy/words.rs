//! An answer in words.

use super::{Answer, Horizon, Pace, Verdict};

impl<R> Answer<R> {
    /// How it was found when `accuracy` was asked for, in one line.
    pub fn reason(&self, accuracy: f64) -> String {
        let Self { configuration, pace, cost, total_cost, runs, .. } = self;
        let pace = match pace {
            Pace::Step(dt) => format!("dt = {dt:.3e} s"),
            Pace::Adaptive { rtol, .. } => format!("rtol = {rtol:.1e}"),
        };
        let method = configuration.method.name();
        let error = match self.estimated_error {
            Some(error) => format!("ends with an error of about {error:.1e}, {accuracy:.0e} being asked for"),
            None => "was not compared with another run".into(),
        };
        let in_all = if *runs == 1 { "in all".into() } else { format!("in all {runs} runs") };
        format!("{method} with {pace} {error}: {cost:.0} force evaluations, {total_cost:.0} {in_all}")
    }

    /// What keeps it from being relied on when `accuracy` was asked for.
    pub fn doubt(&self, accuracy: f64) -> Option<String> {
        let known = match self.estimated_error {
            Some(error) => format!("the best answer may be wrong by {error:.1e}"),
            None => "nothing is known of the error of the best answer".into(),
        };
        let why = match &self.verdict {
            Verdict::Confirmed => return None,
            Verdict::Interrupted => "interrupted".into(),
            Verdict::Unconfirmed(why) => format!("an accuracy of {accuracy:.0e} could not be confirmed, {why}"),
        };
        Some(match self.horizon {
            None => format!("{why}: {known}"),
            Some(Horizon { known, most, spread }) => format!(
                "{why}: positions are predictable to {accuracy:.0e} until {known:.3} s, at most until {most:.3} s; beyond that runs \
                 differ by {spread:.1e}"
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Configuration, SolverReport};
    use super::*;
    use crate::integrate::{ImplicitOptions, Method, Statistics};
    use crate::system::State;

    fn answer(estimated_error: Option<f64>, verdict: Verdict) -> Answer<()> {
        Answer {
            configuration: Configuration { method: Method::Verlet, options: ImplicitOptions::default() },
            pace: Pace::Step(0.0125),
            state: State { time: 1.0, positions: Vec::new(), velocities: Vec::new() },
            steps: 80,
            statistics: Statistics::default(),
            solver: SolverReport { name: "none", preconditioner: "none", choice: None, factor: None },
            estimated_error,
            verdict,
            horizon: None,
            cost: 81.0,
            total_cost: 180.4,
            runs: 2,
            records: (),
        }
    }

    #[test]
    fn answers_say_how_they_were_found() {
        let confirmed = answer(Some(2.34e-4), Verdict::Confirmed);
        assert_eq!(
            confirmed.reason(1e-3),
            "verlet with dt = 1.250e-2 s ends with an error of about 2.3e-4, 1e-3 being asked for: 81 force evaluations, 180 in all 2 runs"
        );
        let alone =
            Answer { pace: Pace::Adaptive { rtol: 2e-5, first_step: None }, ..answer(None, Verdict::Interrupted) };
        assert_eq!(
            alone.reason(1e-3),
            "verlet with rtol = 2.0e-5 was not compared with another run: 81 force evaluations, 180 in all 2 runs"
        );
        let one = Answer { runs: 1, total_cost: 85.4, ..answer(Some(2.34e-4), Verdict::Confirmed) };
        assert!(one.reason(1e-3).ends_with(": 81 force evaluations, 85 in all"), "{}", one.reason(1e-3));
    }

    #[test]
    fn doubts_are_told() {
        assert_eq!(answer(Some(1e-4), Verdict::Confirmed).doubt(1e-3), None);
        let doubt = |error, verdict| answer(error, verdict).doubt(1e-3).unwrap();
        assert_eq!(doubt(None, Verdict::Interrupted), "interrupted: nothing is known of the error of the best answer");
        let unconfirmed = Verdict::Unconfirmed("why not".into());
        assert_eq!(
            doubt(Some(0.02), unconfirmed.clone()),
            "an accuracy of 1e-3 could not be confirmed, why not: the best answer may be wrong by 2.0e-2"
        );
        let horizon = Some(Horizon { known: 1.5, most: 2.25, spread: 0.125 });
        assert_eq!(
            Answer { horizon, ..answer(Some(0.02), unconfirmed) }.doubt(1e-3).unwrap(),
            "an accuracy of 1e-3 could not be confirmed, why not: positions are predictable to 1e-3 until 1.500 s, at most until \
             2.250 s; beyond that runs differ by 1.2e-1"
        );
    }
}
