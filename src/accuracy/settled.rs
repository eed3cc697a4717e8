//! Answers for motions whose fast part displaces nothing: bodies that creep, settle or hang still, however stiff their springs are. A few long
//! implicit steps follow them, where explicit ones would have to follow vibrations that are not there.
//!
//! Long steps that damp what they do not resolve agree on a motion without it. So they are not even tried before that is known
//! to be right: what [they do not resolve](super::resolution) has a small amplitude at the start, no kink of a prescribed path sets it
//! off later, and no compressed spring makes the state unstable within a step, which long implicit steps would calm as they calm
//! everything. Then runs of the second-order backward differentiation formula follow, each with twice the steps of the one before, and the
//! difference of two stands for the error of the finer one, which by the order is a third of it.

use super::audience::Audience;
use super::course::Course;
use super::price::Price;
use super::resolution::unresolved;
use super::search::{Search, Verdict, Went};
use super::stiff::linear_options;
use super::{Configuration, Pace};
use crate::error::Result;
use crate::force::Extensions;
use crate::integrate::{ImplicitOptions, Method};
use crate::linear::{CholeskySolver, LinearSolver, Prepare, SolverOptions};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::work::Work;

/// Steps of the runs.
const STEPS: [f64; 4] = [6.0, 12.0, 24.0, 48.0];

/// How many times the price of the first two runs an explicit answer must have, for them to be tried.
const WORTH: f64 = 3.0;

/// The part of the accuracy that an estimate may use.
const USABLE: f64 = 0.3;

/// What cannot be resolved may have this part of the accuracy: a motion may amplify what long steps leave out. In 1500 random scenes one
/// answer of 1122 was wrong with it, by 1.9; with twice as much four of 1254, by up to 4.8.
const UNRESOLVED: f64 = 0.05;

/// Another run is made where by the law its estimate will do: a quarter of the one before.
const LAW: f64 = 4.0;

/// Free coordinates of a matrix that is factored to see whether it is definite.
const LARGEST: usize = 30_000;

/// An answer, or `None` where other methods are to find one.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price) -> Result<Option<Verdict>> {
    let (accuracy, duration) = (search.requirement.accuracy, search.task.duration);
    let (system, start, costs) = (search.task.system, search.task.start, search.task.costs);
    let explicit = price.answer(accuracy);
    let [first, second, ..] = STEPS;
    let step = 2.0 + costs.assembly() + costs.least_factorization() + costs.least_direct_solve();
    if explicit <= WORTH * (first + second) * step || search.task.has_kinks() {
        return Ok(None);
    }
    search.left = explicit;
    let linear = linear_options(search);
    let h = duration / second;
    if !is_definite(search, h, &linear)? {
        return Ok(None);
    }
    let (size, cost) = unresolved(system, start, h, &linear, &costs)?;
    search.spend(cost);
    if size > UNRESOLVED * accuracy {
        return Ok(None);
    }
    let configuration =
        Configuration { method: Method::Bdf2, options: ImplicitOptions { linear, ..Default::default() } };
    let (mut coarse, mut last): (Option<Course>, _) = (None, f64::INFINITY);
    for steps in STEPS {
        let fine = match search.run(configuration, Pace::Step(duration / steps), 0.5 * explicit)? {
            Went::Well(course, _) => course,
            Went::Stopped => return Ok(Some(Verdict::Interrupted)),
            Went::Wrong | Went::TooFar => return Ok(None),
        };
        if let Some(coarse) = coarse.take() {
            let apart = search.difference(&fine, &coarse).largest();
            if apart < last {
                search.estimate(apart);
            }
            if apart < last && apart <= USABLE * accuracy {
                return Ok(Some(Verdict::Confirmed));
            }
            if apart > LAW * USABLE * accuracy {
                return Ok(None);
            }
            last = apart;
        }
        coarse = Some(fine);
    }
    Ok(None)
}

/// Whether the full matrix of a step of h seconds is positive definite at the start, as far as can be told.
fn is_definite<A: Audience>(search: &mut Search<'_, A>, h: f64, linear: &SolverOptions) -> Result<bool> {
    let (system, start) = (search.task.system, search.task.start);
    let extensions = Extensions::at(system, &start.positions)?;
    if system.dofs().len() > LARGEST {
        return Ok(false);
    }
    let operator = SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(h));
    let mut work = Work::default();
    let mut solver = CholeskySolver::new(system, linear.par, &mut work)?;
    let is_definite = solver.prepare(&operator, &mut work).is_ok();
    let factor = solver.factor().map(|factor| factor.size);
    search.spend(search.task.costs.cost(&work, factor));
    Ok(is_definite)
}
