//! The state at the end of a motion to a required accuracy, at a few times the cost of the cheapest run that has it.
//!
//! What is spent beside the answer is little: a bound tells how long explicit steps may be, and with that what they cost;
//! where they are dear a run of an implicit method is tried up to that price. A run whose steps [neglect](super::own) far less than the accuracy is the answer by
//! itself; otherwise runs come in pairs, the second finer, and the difference of two tells the error of the second. When that is small enough the second *is* the
//! answer: it was recorded as it went, and nothing is repeated.
//!
//! An estimate counts only when it was made by two runs that could have disagreed, or leaves a margin for what one run cannot know, and when steps resolve what
//! moves. What cannot be
//! confirmed so is handed out as [unconfirmed](Verdict::Unconfirmed), with the least estimate that there is. So is a motion on a line
//! in which many springs pass the length zero: their forces jump there, from pushing one way to pushing the other, and whether ends that
//! come close slowly pass each other or turn round is decided by less than any run resolves. Runs may all agree on one of the two.
//! Where few do, differences count in full: errors made at jumps follow no law of steps or tolerances.
//!
//! Costs are [counted](CostModel), not timed: the same scene gives the same answer on every machine.

use super::attempt::Task;
use super::audience::Audience;
use super::explicit;
use super::price::Price;
use super::rates::Rates;
use super::requirement::Requirement;
use super::samples::Grid;
use super::search::{Answer, Search, Verdict};
use super::{alone, settled, stiff};
use crate::error::Result;
use crate::linear::CostModel;
use crate::system::{State, System};

/// Finds an answer, as long as `go_on` says so. `None` when no run comes to its end, or not before `go_on` said no.
///
/// # Errors
/// Coincident ends of a spring in `start`; a matrix that is too large; what the audience returned.
pub fn answer<A: Audience>(
    system: &System,
    start: &State,
    requirement: &Requirement,
    audience: &mut A,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Answer<A::Records>>> {
    let Requirement { duration, interval, .. } = *requirement;
    // Runs share what is known of the matrix.
    let system = &system.keeping();
    let costs = CostModel::of(system);
    let grid = Grid::new(duration, interval, system.particles());
    let task = Task { system, start, duration, costs, grid, go_on };
    let mut search = Search::new(&task, requirement, audience);
    let rates = Rates::of(system, start)?;
    search.spend(rates.cost);
    let verdict = match requirement.method {
        Some(method) => alone::answer(&mut search, method, &rates)?,
        None => {
            let price = Price::of(&rates, duration);
            // What acts from outside may set off vibrations at any time, which long steps do not resolve, and RODAS4 takes none.
            let mut implicit = None;
            if !system.has_external_forces() {
                implicit = settled::answer(&mut search, price)?;
                if implicit.is_none() {
                    implicit = stiff::answer(&mut search, price)?;
                }
            }
            match implicit {
                Some(verdict) => verdict,
                None => explicit::answer(&mut search, price)?,
            }
        }
    };
    let verdict = if search.goes_on() || verdict == Verdict::Confirmed { verdict } else { Verdict::Interrupted };
    Ok(search.answer(verdict))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::Method;
    use crate::system::fixtures::oscillator;
    use std::cell::Cell;

    /// Who asks for an end after the last run is told what that has shown if it is confirmed, and that the search was interrupted if not:
    /// of 10⁻¹⁶ no run is sure.
    #[test]
    fn what_is_confirmed_stays_so_when_someone_asks_for_an_end() {
        let (system, start) = oscillator();
        let verdict = |accuracy: f64, looks: u32| {
            let requirement = Requirement {
                accuracy,
                duration: 1.0,
                interval: 0.5,
                par: faer::Par::Seq,
                method: Some(Method::Dop853),
                stiffness: None,
                solver: None,
            };
            let looked = Cell::new(0);
            let go_on = || looked.replace(looked.get() + 1) < looks;
            let answer = answer(&system, &start, &requirement, &mut (), &go_on).unwrap().unwrap();
            (answer.verdict, looked.get())
        };
        let (confirmed, looks) = verdict(1e-4, u32::MAX);
        assert_eq!(confirmed, Verdict::Confirmed);
        assert_eq!(verdict(1e-4, looks - 1).0, Verdict::Confirmed);
        let (unconfirmed, looks) = verdict(1e-16, u32::MAX);
        assert!(matches!(unconfirmed, Verdict::Unconfirmed(_)), "{unconfirmed:?}");
        assert_eq!(verdict(1e-16, looks - 1).0, Verdict::Interrupted);
    }
}
