//! The monitor's energy balance agrees with forces and velocities.
//!
//! The states of an accurate motion, of many short steps, are entered into the balance by every eighth one, as if one step had led from one to the
//! next. Its work of moving constraints and its dissipation are compared with Simpson's rule on the powers at all states,
//!
//! ```text
//! Σ b (n·Δv)²      and      −Σ (f_c + m g)·v_c  over the coordinates c that move,
//! ```
//!
//! computed here a second time from the numbers of the scene. Steps have z = ω h ≤ 1/8, the short ones 1/64. The motion is that of DOP853, explicit and
//! of eighth order, whose short steps are wrong by `7·10⁻⁸ z⁹ = 4·10⁻²⁴` of an amplitude: by rounding, and not by the remainder of an iteration, which
//! at rest adds up from step to step.

use super::{
    AFFORDABLE, Check, Claim, Link, Measured, MethodVariant, TestCase, U, convergence, direct, ratio, reference, worst,
};
use crate::integrate::{Monitor, MonitorOptions};
use crate::system::{Dof, State, System};

/// Steps of the balance, and steps of the motion in each; even, for Simpson's rule.
const STEPS: usize = 12;
const PARTS: usize = 8;

/// The largest error of an integral relative to the integral of the power's magnitude.
const BOUND: f64 = 2e-4;

pub(super) fn applies(case: &TestCase) -> bool {
    (1..=AFFORDABLE).contains(&case.system.dofs().len()) && !case.system.pairs().is_empty()
}

pub(super) fn measure(case: &TestCase) -> Measured {
    let TestCase { system, state, name, .. } = case;
    let h = step(case);
    let states = MethodVariant::dop853().run(case, direct(), h / PARTS as f64, STEPS * PARTS)?.unwrap_or_default();
    let mut monitor = Monitor::new(system, state, MonitorOptions::default())?;
    let mut exchanged = 0.0;
    for (number, state) in (1..).zip(states.iter().skip(PARTS).step_by(PARTS)) {
        let before = monitor.energy();
        monitor.enter(number, state, h)?;
        let now = monitor.energy();
        exchanged += (now.kinetic - before.kinetic).abs();
        exchanged += (now.elastic - before.elastic).abs() + (now.gravitational - before.gravitational).abs();
    }
    let powers: Vec<Powers> = states.iter().map(|state| Powers::at(system, state)).collect();
    let integral = |power: fn(&Powers) -> f64| simpson(powers.iter().map(power), h / PARTS as f64);
    // A rule of fourth order at the balance's own steps: where that misses a power, the balance's formulas say nothing.
    let is_resolved = |power: fn(&Powers) -> f64| {
        let coarse = simpson(powers.iter().step_by(PARTS).map(power), h);
        let size = simpson(powers.iter().map(|at| power(at).abs()), h / PARTS as f64);
        (coarse - integral(power)).abs() <= 0.1 * BOUND * size
    };
    let not_judged = |reason: String| Ok(vec![Check::not_judged(Claim::Conservation, "energy balance", name, reason)]);
    if !(is_resolved(|at| at.elastic) && is_resolved(|at| at.damping) && is_resolved(|at| at.constraints)) {
        let reason = "powers change faster than the vibrations that the steps resolve: springs turn or come close";
        return not_judged(reason.into());
    }
    let (work, moved) = (integral(|at| at.constraints), integral(|at| at.magnitude));
    let dissipated = integral(|at| at.damping);
    // Where next to nothing moves the rounding of energies remains.
    let energy = monitor.energy();
    let rounding = 100.0 * U * (energy.kinetic + energy.elastic + energy.gravitational.abs());
    let why = "relative to the magnitudes of the powers: (2z)⁴/720 of the balance's formulas with z = 1/8 and a margin of forty for \
               powers that change faster than vibrations; a wrong correction shows as z²/12";
    let check = |name: &str, error: f64, whole: f64| {
        let value = ratio(error.abs(), whole + rounding / BOUND);
        Check::new(Claim::Conservation, name, &case.name, value, BOUND, why)
    };
    let balance = monitor.balance();
    let whole = exchanged + moved + dissipated;
    let checks = vec![
        check("work of moving constraints", balance.work - work, moved),
        check("dissipation of damping", balance.dissipated - dissipated, dissipated),
        check("imbalance of an accurate motion", balance.imbalance, whole),
    ];
    if checks.iter().all(Check::passed) {
        return Ok(checks);
    }
    // Rates are differences of positions at both ends of a step.
    let path = |pair: &[State]| worst(pair[0].positions.iter().zip(&pair[1].positions).map(|(a, b)| (a - b).norm()));
    let longest = worst(states.windows(2).map(path)) * PARTS as f64;
    let is_lost = U * (case.extent() + case.centre().norm()) > 0.02 * BOUND * longest || whole < rounding / BOUND;
    if is_lost {
        return not_judged(
            "the motion in a step that resolves it is lost in the rounding of positions or energies".into(),
        );
    }
    case.passing(STEPS as f64 * h).map_or(Ok(checks), not_judged)
}

/// The step of the balance, in s: short enough for every vibration, and for all steps to end before a path has a kink.
fn step(case: &TestCase) -> f64 {
    convergence::coarsest(case).min(0.9 * case.time_to_kink() / STEPS as f64)
}

/// The powers of the springs, the power that their damping dissipates, and those of the moving coordinates' constraints and their magnitudes, in W.
struct Powers {
    elastic: f64,
    damping: f64,
    constraints: f64,
    magnitude: f64,
}

impl Powers {
    fn at(system: &System, state: &State) -> Self {
        let links = reference::links(system, &state.positions);
        let dissipated = |link: &Link| {
            let rate = link.direction.dot(&link.difference(&state.velocities));
            link.damping * rate * rate
        };
        let elastic = reference::sum(&links, system.particles(), Link::elastic_force);
        let damping = reference::damping_product(&links, &state.velocities);
        let prescribed = system.prescribed();
        let power = |(dof, _, motion): (Dof, f64, usize)| {
            let (p, axis) = (dof.particle, dof.axis);
            let weight = system.masses()[p] * system.gravity()[axis];
            -(elastic[p][axis] + damping[p][axis] + weight) * prescribed.motions()[motion].velocity(state.time, axis)
        };
        let constraints: Vec<f64> = prescribed.iter().map(power).collect();
        Self {
            elastic: links.iter().map(|link| link.elastic_force().dot(&link.difference(&state.velocities))).sum(),
            damping: links.iter().map(dissipated).sum(),
            constraints: constraints.iter().sum(),
            magnitude: constraints.iter().map(|power| power.abs()).sum(),
        }
    }
}

/// Simpson's rule on an odd number of equidistant values.
fn simpson(values: impl ExactSizeIterator<Item = f64>, dt: f64) -> f64 {
    let last = values.len() - 1;
    let weight = |at: usize| if at == 0 || at == last { 1.0 } else { [2.0, 4.0][at % 2] };
    values.enumerate().map(|(at, value)| weight(at) * value).sum::<f64>() * dt / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures::{moved, path};

    /// Nothing vibrates, so a quarter of a second would do; of a path with corners at 0.5 s and 1.1 s there is a tenth of a second left at 1 s.
    #[test]
    fn all_steps_end_before_the_next_corner_of_a_path() {
        let step_at = |time: f64| {
            let mut case = moved(path(&[0.5, 1.1]), 1.0);
            case.state.time = time;
            step(&case)
        };
        assert!((step_at(1.0) - 0.9 * 0.1 / STEPS as f64).abs() < 1e-15);
        assert!((step_at(0.0) - 0.9 * 0.5 / STEPS as f64).abs() < 1e-15);
        assert_eq!(step_at(2.0), 0.25);
    }
}
