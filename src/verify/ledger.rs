//! The energy ledger holds what forces and velocities say.
//!
//! An accurate motion, of many short steps, is entered into the ledger by every eighth state, as if one step had led from one
//! to the next. What the ledger then has for the work of moving constraints and for dissipation is held to Simpson's rule on the
//! powers at all states,
//!
//! ```text
//! Σ b (n·Δv)²      and      −Σ (f_c + m g)·v_c  over the coordinates c that move,
//! ```
//!
//! computed here a second time from the numbers of the scene. Steps have z = ω h ≤ 1/8, the short ones 1/64: the ledger's
//! formulas leave `(2z)⁴/720 = 5·10⁻⁶`, and Simpson's rule less. The motion is that of DOP853, explicit and of eighth order, whose short steps
//! are wrong by `7·10⁻⁸ z⁹ = 4·10⁻²⁴` of an amplitude: by rounding, and not by what an iteration leaves of the forces of a scene at
//! rest, which adds up from step to step. A wrong coefficient of a correction shows as z²/12 = 10⁻³ of a power. The imbalance is what neither
//! explains, and as small.

use super::measured::Measured;
use super::{Check, Claim, TestCase, U, Unfinished, convergence, reference, worst};
use crate::integrate::{ImplicitOptions, Method, Monitor, MonitorOptions};
use crate::system::{State, System};

/// Steps of the ledger, and steps of the motion in each; even, for Simpson's rule.
const STEPS: usize = 12;
const PARTS: usize = 8;

/// The largest share of the magnitude of a power that its integral may be off.
const BOUND: f64 = 2e-4;

/// What rounding may make of the sums that energies are, relative to them.
const ROUNDING: f64 = 100.0 * U;

/// Degrees of freedom up to which the many short steps are affordable.
const AFFORDABLE: usize = 2000;

pub(super) fn applies(subject: &TestCase) -> bool {
    (1..=AFFORDABLE).contains(&subject.system.dofs().len()) && !subject.system.pairs().is_empty()
}

pub(super) fn measure(subject: &TestCase) -> Measured {
    let TestCase { system, state, name, .. } = subject;
    let h = step(subject);
    let states = motion(subject, h / PARTS as f64)?;
    let mut monitor = Monitor::new(system, state, MonitorOptions::default())?;
    let mut exchanged = 0.0;
    for (number, state) in (1..).zip(states.iter().skip(PARTS).step_by(PARTS)) {
        let before = monitor.energy();
        monitor.enter(number, state, h)?;
        let now = monitor.energy();
        exchanged += (now.kinetic - before.kinetic).abs();
        exchanged += (now.elastic - before.elastic).abs() + (now.gravitational - before.gravitational).abs();
    }
    let balance = monitor.balance();
    let integral = |power: &dyn Fn(&State) -> f64| simpson(states.iter().map(power), h / PARTS as f64);
    let work = integral(&|state| led(system, state).iter().sum());
    let moved = integral(&|state| led(system, state).iter().map(|power| power.abs()).sum());
    let dissipated = integral(&|state| damping_power(system, state));
    // A rule of fourth order at the ledger's own steps: where that misses a power, the ledger's formulas say nothing.
    let resolved = |power: &dyn Fn(&State) -> f64| {
        let size = integral(&|state| power(state).abs());
        let coarse = simpson(states.iter().step_by(PARTS).map(power), h);
        (coarse - integral(power)).abs() <= 0.1 * BOUND * size
    };
    let elastic = |state: &State| elastic_power(system, state);
    let damping = |state: &State| damping_power(system, state);
    let leading = |state: &State| led(system, state).iter().sum::<f64>();
    if !(resolved(&elastic) && resolved(&damping) && resolved(&leading)) {
        let reason = "powers change faster than the vibrations that the steps resolve: springs turn or come close";
        return Ok(vec![Check::not_judged(Claim::Conservation, "ledger", name, reason)]);
    }
    // Rates are differences of positions at both ends of a step.
    let travelled =
        |pair: &[State]| worst(pair[0].positions.iter().zip(&pair[1].positions).map(|(a, b)| (a - b).norm()));
    let moved_most = worst(states.windows(2).map(travelled)) * PARTS as f64;
    let why = "as a share of the magnitudes of the powers: (2z)⁴/720 of the ledger's formulas with z = 1/8 and a margin of forty for \
               powers that change faster than vibrations; a wrong correction shows as z²/12";
    // Where next to nothing moves there is what rounding leaves of the energies.
    let energy = monitor.energy();
    let left = ROUNDING * (energy.kinetic + energy.elastic + energy.gravitational.abs());
    let share = |error: f64, whole: f64| if error == 0.0 { 0.0 } else { error / (whole + left / BOUND) };
    let check = |what: &str, value| Check::new(Claim::Conservation, what, name, value, BOUND, why);
    let checks = vec![
        check("work of moving constraints", share((balance.work - work).abs(), moved)),
        check("dissipation of damping", share((balance.dissipated - dissipated).abs(), dissipated)),
        check("imbalance of an accurate motion", share(balance.imbalance.abs(), exchanged + moved + dissipated)),
    ];
    if checks.iter().all(Check::passed) {
        return Ok(checks);
    }
    let is_lost = U * (subject.extent() + subject.centre().norm()) > 0.02 * BOUND * moved_most
        || exchanged + moved + dissipated < left / BOUND;
    let lost = is_lost
        .then(|| "what a step that resolves everything moves is lost in the rounding of positions or energies".into());
    let reason = lost.or_else(|| subject.passing(STEPS as f64 * h));
    Ok(match reason {
        Some(reason) => vec![Check::not_judged(Claim::Conservation, "ledger", name, reason)],
        None => checks,
    })
}

/// The step of the ledger, in s: short enough for every vibration, and for all steps to end before a path has a kink.
fn step(subject: &TestCase) -> f64 {
    convergence::coarsest(subject).min(0.9 * subject.time_to_kink() / STEPS as f64)
}

fn motion(subject: &TestCase, dt: f64) -> Result<Vec<State>, Unfinished> {
    let TestCase { system, state, .. } = subject;
    let mut stepper = Method::Dop853.stepper(system, state, &ImplicitOptions::default())?;
    let mut states = vec![state.clone()];
    let mut state = state.clone();
    for _ in 0..STEPS * PARTS {
        stepper.step(&mut state, dt)?;
        states.push(state.clone());
    }
    Ok(states)
}

/// What springs give to the motion, in W.
fn elastic_power(system: &System, state: &State) -> f64 {
    let links = reference::links(system, &state.positions);
    let power = |link: &reference::Link| {
        let [i, j] = link.ends;
        link.elastic_force().dot(&(state.velocities[i] - state.velocities[j]))
    };
    links.iter().map(power).sum()
}

/// What every moving coordinate's constraint puts in, in W.
fn led(system: &System, state: &State) -> Vec<f64> {
    let links = reference::links(system, &state.positions);
    let elastic = reference::sum(&links, system.particles(), reference::Link::elastic_force);
    let damping = reference::damping_product(&links, &state.velocities);
    let prescribed = system.prescribed();
    let power = |(dof, _, motion): (crate::system::Dof, f64, usize)| {
        let (p, axis) = (dof.particle, dof.axis);
        let weight = system.masses()[p] * system.gravity()[axis];
        -(elastic[p][axis] + damping[p][axis] + weight) * prescribed.motions()[motion].velocity(state.time, axis)
    };
    prescribed.iter().map(power).collect()
}

fn damping_power(system: &System, state: &State) -> f64 {
    let links = reference::links(system, &state.positions);
    let rate =
        |link: &reference::Link| link.direction.dot(&(state.velocities[link.ends[0]] - state.velocities[link.ends[1]]));
    links.iter().map(|link| link.damping * rate(link) * rate(link)).sum()
}

/// Simpson's rule on an odd number of equidistant values.
fn simpson(values: impl ExactSizeIterator<Item = f64>, dt: f64) -> f64 {
    let last = values.len() - 1;
    let weight = |at: usize| match at {
        0 => 1.0,
        _ if at == last => 1.0,
        _ if at % 2 == 1 => 4.0,
        _ => 2.0,
    };
    values.enumerate().map(|(at, value)| weight(at) * value).sum::<f64>() * dt / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};
    use nalgebra::Vector3;

    /// Nothing vibrates, so a quarter of a second would do; of a path with corners at 0.5 s and 1.1 s there is a tenth of a second
    /// left at 1 s.
    #[test]
    fn all_steps_end_before_the_next_corner_of_a_path() {
        let step_at = |time: f64| {
            let mut builder = SystemBuilder::new();
            builder.particle([0.0; 3], 1.0);
            let motion = Motion::Path { times: vec![0.5, 1.1], offsets: vec![Vector3::zeros(); 2] };
            builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[0]), motion });
            let (system, state) = builder.build().unwrap();
            step(&TestCase { name: "led".into(), system, state: State { time, ..state }, dt: 1.0 })
        };
        assert!((step_at(1.0) - 0.9 * 0.1 / STEPS as f64).abs() < 1e-15);
        assert!((step_at(0.0) - 0.9 * 0.5 / STEPS as f64).abs() < 1e-15);
        assert_eq!(step_at(2.0), 0.25);
    }
}
