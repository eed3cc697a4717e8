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
        format!("{method} with {pace} {error}: {cost:.0} force evaluations, {total_cost:.0} in all {runs} runs")
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
