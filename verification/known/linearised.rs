//! bdf2 where forces linearised at the start of a step, or iterations without tension, lead astray; and its formula with steps of
//! unequal length.

use super::compare::U;
use super::direct;
use crate::collect::Collector;
use libtest_mimic::Trial;
use nalgebra::Vector3;
use sprung::chart::dop853;
use sprung::integrate::{Bdf2, ImplicitOptions, Method, Schedule, Status, StiffnessPolicy, TimeStepper, run};
use sprung::scene::{Kind, builtin};
use sprung::verify::{Check, Claim};
use sprung::{State, Stiffness, System, SystemBuilder};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

type Measured = Result<Vec<Check>, Box<dyn std::error::Error>>;

/// A test by its name.
type Named = (&'static str, fn() -> Measured);

pub fn trials(collector: &mut Collector) -> Vec<Trial> {
    let claim = Claim::KnownAnswers;
    let tests: [Named; 3] =
        [("swinging_cloth", swinging_cloth), ("taut_string", taut_string), ("falling_particle", falling_particle)];
    let test = |(name, measure): Named| {
        let failed = move |error: Box<dyn std::error::Error>| {
            vec![Check::new(claim, "linearised", name, f64::NAN, 0.0, format!("could not be carried out: {error}"))]
        };
        collector.trial(claim, format!("known_answers::linearised::{name}"), move || measure().unwrap_or_else(failed))
    };
    tests.into_iter().map(test).collect()
}

/// The distance of all positions at the end from those of DOP853 over their distance from their centroid, and the iterations
/// beyond the first of a step.
fn error(
    (system, start): &(System, State),
    truth: &State,
    method: Method,
    stiffness: StiffnessPolicy,
    [dt, duration]: [f64; 2],
) -> Result<(f64, u64), Box<dyn std::error::Error>> {
    let mut stepper = method.stepper(system, start, &direct(stiffness))?;
    let mut state = start.clone();
    let schedule = Schedule::duration(dt, duration);
    let outcome = run(&mut *stepper, &mut state, &schedule, |_, _| ControlFlow::Continue(()));
    if outcome.status() != Status::Completed {
        return Err(format!("{}: {outcome:?}", method.name()).into());
    }
    let centroid = truth.positions.iter().sum::<Vector3<f64>>() / truth.positions.len() as f64;
    let spread: f64 = truth.positions.iter().map(|x| (x - centroid).norm_squared()).sum();
    let apart: f64 = truth.positions.iter().zip(&state.positions).map(|(x, y)| (x - y).norm_squared()).sum();
    Ok(((apart / spread).sqrt(), stepper.statistics().work.newton_iterations))
}

fn truth((system, start): &(System, State), duration: f64) -> Result<State, Box<dyn std::error::Error>> {
    let deadline = Instant::now() + Duration::from_secs(250);
    Ok(dop853(system, start, duration, 1e-9, deadline).ok_or("no reference")?)
}

fn swinging_cloth() -> Measured {
    let cloth = builtin(Kind::Cloth, 6)?.build()?;
    let truth = truth(&cloth, 0.5)?;
    let mut checks = Vec::new();
    for dt in [1.0 / 60.0, 0.01] {
        let of = |method| error(&cloth, &truth, method, StiffnessPolicy::OnDemand, [dt, 0.5]);
        let ((bdf2, _), (notes, _)) = (of(Method::Bdf2)?, of(Method::LinearBackwardEuler)?);
        let why = "over the error of steps linearised at their start: springs that turn are not braked";
        let name = format!("error of bdf2, dt = {dt:.4}");
        checks.push(Check::new(Claim::KnownAnswers, name, "swinging cloth", bdf2 / notes, 0.1, why));
    }
    Ok(checks)
}

fn taut_string() -> Measured {
    let string = builtin(Kind::String, 40)?.build()?;
    let truth = truth(&string, 0.4)?;
    let check = |name: &str, value: f64, bound: f64, why: &str| {
        Check::new(Claim::KnownAnswers, name, "taut string", value, bound, why)
    };
    let of = |policy| error(&string, &truth, Method::Bdf2, policy, [0.4 / 120.0, 0.4]);
    let ((lasting, more), (axial, _)) = (of(StiffnessPolicy::OnDemand)?, of(Stiffness::Axial.into())?);
    let why = "twice the error of the formula with this step";
    Ok(vec![
        check("error of bdf2, on-demand", lasting, 0.0034, why),
        check("error of bdf2, axial", axial, 0.0034, why),
        check("iterations beyond the first of a step", more as f64, 0.0, "the matrix has the tension that lasts"),
    ])
}

/// Under its weight alone the velocity is linear, and the formula exact for it, whatever the lengths of the steps; the places are
/// those of the formula's own recursion, whose only error is that of the first step, ½ h² g.
fn falling_particle() -> Measured {
    const STEPS: [f64; 7] = [0.1, 0.22, 0.1, 0.06, 0.138, 0.07, 0.16];
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    builder.particle([0.0, 1.0, 0.0], 2.0);
    let (system, mut state) = builder.build()?;
    state.velocities[0].y = 3.0;
    let mut stepper = Bdf2::new(&system, &state, &ImplicitOptions::default())?;
    let (mut speed_error, mut place_error) = (0.0f64, 0.0f64);
    // The error of the place, now and one step before.
    let (mut error, mut before, mut last) = (0.0, 0.0, None);
    for h in STEPS {
        stepper.step(&mut state, h)?;
        let next = match last {
            None => 0.5 * h * h * -9.81,
            Some(last) => {
                let ratio: f64 = h / last;
                error + ratio * ratio / (1.0 + 2.0 * ratio) * (error - before)
            }
        };
        (before, error, last) = (error, next, Some(h));
        let t = state.time;
        speed_error = speed_error.max((state.velocities[0].y - (3.0 - 9.81 * t)).abs());
        let place = 1.0 + 3.0 * t - 0.5 * 9.81 * t * t + error;
        place_error = place_error.max((state.positions[0].y - place).abs());
    }
    let check = |name: &str, value: f64, why: &str| {
        Check::new(Claim::KnownAnswers, name, "falling particle", value / U, 3000.0, why)
    };
    let why = "in units of rounding of 1: sums of a few numbers below 10, divided by steps of a tenth";
    Ok(vec![check("velocities", speed_error, why), check("places", place_error, why)])
}
