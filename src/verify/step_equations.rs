//! A step solves its own equations: the new state put back into them leaves rounding.
//!
//! The residuals are formed from formulas that were written a second time, for all free coordinates, with what prescribed ones
//! contribute. With `δx = dt v'`:
//!
//! ```text
//! linear backward Euler   M (v' − v)/dt − f_el(x) − K δx − G v' − g
//! backward Euler          M (v' − v)/dt − f_el(x') − f_d(x', v') − g
//! explicit Euler methods  M (v' − v)/dt − f_el(x) − f_d(x, v) − g
//! Verlet                  M (v' − v)/dt − ½ (f + f'),  f' = f_el(x') + f_d(x', v + dt M⁻¹f) + g,  f that of the step before
//! ```
//!
//! Those of bdf2 are in [`formula_steps`]. Methods of several stages are held to known answers instead.

use super::measured::Measured;
use super::reference::{self, Link, damping_product, free, links, stiffness_product};
use super::runs::{Way, direct};
use super::{Check, Claim, TestCase, U, formula_steps, worst};
use crate::integrate::{Method, PositionUpdate};
use crate::linear::{SolverChoice, SolverOptions, Tolerance, norm};
use crate::spring::Stiffness;
use crate::system::State;
use nalgebra::Vector3;

/// Steps that are put back.
const STEPS: usize = 3;

/// Units of rounding that a backward stable solve, and forming the residual, may leave.
const UNITS: f64 = 30.0;

/// The tolerance that conjugate gradients are given.
const TOLERANCE: f64 = 1e-10;

/// A residual, and what one unit of rounding in the same equations amounts to.
struct Residual {
    rows: Vec<f64>,
    right_hand_side: Vec<f64>,
    unit: f64,
}

impl Residual {
    /// The largest row in units of rounding.
    fn in_units(&self) -> f64 {
        worst(self.rows.iter().map(|row| row.abs()).chain([0.0])) / self.unit
    }

    /// The norm over what conjugate gradients may leave, with rounding in every row.
    fn over_tolerance(&self) -> f64 {
        let rounding = UNITS * self.unit * (self.rows.len() as f64).sqrt();
        norm(&self.rows) / (TOLERANCE * norm(&self.right_hand_side) + rounding)
    }
}

/// Linear backward Euler by every option and solver.
pub(super) fn linear(subject: &TestCase) -> Measured {
    let solvers = [
        (SolverChoice::Llt, "Cholesky"),
        (SolverChoice::Ldlt, "LDLᵀ"),
        (SolverChoice::Cg, "matrix-free conjugate gradients"),
        (SolverChoice::CgAssembled, "conjugate gradients on the assembled matrix"),
    ];
    let mut checks = Vec::new();
    for option in Stiffness::ALL {
        for (solver, solver_name) in solvers {
            let way = Way::notes(option);
            let options = SolverOptions { solver, tolerance: Tolerance::Fixed(TOLERANCE), ..SolverOptions::default() };
            let Some(states) = way.run(subject, options, subject.dt, STEPS)? else { continue };
            let residuals =
                states.windows(2).map(|pair| linear_residual(subject, option, subject.dt, &pair[0], &pair[1]));
            let name = format!("residual of a step, {}, {solver_name}", option.name());
            checks.push(match solver {
                SolverChoice::Llt | SolverChoice::Ldlt => {
                    let value = worst(residuals.map(|residual| residual.in_units()));
                    let why = "in units of rounding, u (‖A‖ ‖δx‖ + ‖b‖) in the maximum norm: what a backward stable solve \
                               and forming the residual leave";
                    Check::new(Claim::Solvers, name, &subject.name, value, UNITS, why)
                }
                _ => {
                    let value = worst(residuals.map(|residual| residual.over_tolerance()));
                    let why = "‖b − A δx‖ over the tolerance of 1e-10 ‖b‖, with 30 units of rounding a row for forming it";
                    Check::new(Claim::Solvers, name, &subject.name, value, 1.0, why)
                }
            });
        }
    }
    Ok(checks)
}

/// All other methods, and that positions follow velocities.
pub(super) fn others(subject: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for way in Way::of(subject) {
        if way.method == Method::Bdf2 {
            checks.extend(formula_steps::checks(subject, way)?);
            continue;
        }
        let dt = way.step(subject);
        let Some(states) = way.run(subject, direct(), dt, STEPS)? else { continue };
        if way.method.moves_by() != PositionUpdate::Other {
            let moved = states.windows(2).map(|pair| displacement_error(subject, way.method, dt, &pair[0], &pair[1]));
            let why = "in units of rounding of the position: v is the old, the new or the mean velocity, as the method has it";
            let name = format!("x' = x + dt v, {}", way.name());
            checks.push(Check::new(Claim::Solvers, name, &subject.name, worst(moved), 4.0, why));
        }
        let each = |share: fn(&TestCase, f64, &State, &State) -> f64| {
            worst(states.windows(2).map(|pair| share(subject, dt, &pair[0], &pair[1])))
        };
        let value = match way.method {
            Method::BackwardEuler => each(newton_share),
            Method::ImplicitMidpoint => each(midpoint_share),
            Method::SymplecticEuler | Method::ForwardEuler => each(explicit_share),
            Method::Verlet => verlet_share(subject, dt, &states),
            // Linear backward Euler has its own checks.
            _ => continue,
        };
        let why = match way.is_nonlinear() {
            true => "over the 1e-10 of the balancing forces at which Newton's method stops, with rounding",
            false => "over 30 units of rounding of the forces that are added up",
        };
        let name = format!("residual of a step, {}", way.name());
        checks.push(
            Check::new(Claim::Solvers, name, &subject.name, value, 1.0, why).unless(|| subject.beyond_rounding(dt)),
        );
    }
    Ok(checks)
}

fn linear_residual(subject: &TestCase, option: Stiffness, dt: f64, before: &State, after: &State) -> Residual {
    let system = &subject.system;
    let links = links(system, &before.positions);
    let n = system.particles();
    let dx: Vec<Vector3<f64>> = after.velocities.iter().map(|v| v * dt).collect();
    let elastic = reference::sum(&links, n, Link::elastic_force);
    let stiffness = stiffness_product(&links, option, &dx);
    let damping = damping_product(&links, &after.velocities);
    let mut rows = vec![Vector3::zeros(); n];
    let mut right_hand_side = vec![Vector3::zeros(); n];
    for (p, &m) in system.masses().iter().enumerate() {
        let known = before.velocities[p] * (m / dt) + elastic[p] + system.gravity() * m;
        rows[p] = known - after.velocities[p] * (m / dt) + stiffness[p] + damping[p];
        right_hand_side[p] = known;
    }
    // A_fc δx_c belongs to b: subtract it as the solver does.
    let mut prescribed = dx.clone();
    system.dofs().scatter(&vec![0.0; system.dofs().len()], &mut prescribed);
    let velocities: Vec<Vector3<f64>> = prescribed.iter().map(|d| d / dt).collect();
    let coupling = stiffness_product(&links, option, &prescribed);
    for ((b, k), g) in right_hand_side.iter_mut().zip(coupling).zip(damping_product(&links, &velocities)) {
        *b += k + g;
    }
    // ‖b‖ at the magnitudes of its parts: rounding does not know that they cancel.
    let pull = reference::pull(&links, n);
    let parts = |(p, m): (usize, &f64)| m * (before.velocities[p].amax() / dt + system.gravity().amax()) + pull[p];
    let b = system.masses().iter().enumerate().map(parts).fold(0.0, f64::max);
    let unit = U * (reference::step_matrix_norm(subject, before, dt) * max(&dx) + b);
    Residual { rows: free(system, &rows), right_hand_side: free(system, &right_hand_side), unit }
}

fn max(vectors: &[Vector3<f64>]) -> f64 {
    vectors.iter().fold(0.0, |largest, v| if v.amax() <= largest { largest } else { v.amax() })
}

/// `|x' − (x + dt v)|` in units of rounding; v is what the method moves by.
fn displacement_error(subject: &TestCase, method: Method, dt: f64, before: &State, after: &State) -> f64 {
    worst(subject.system.dofs().iter().map(|dof| {
        let of = |vectors: &[Vector3<f64>]| vectors[dof.particle][dof.axis];
        let (x, y, v, w) = (of(&before.positions), of(&after.positions), of(&before.velocities), of(&after.velocities));
        let d = dt
            * match method.moves_by() {
                PositionUpdate::Old => v,
                PositionUpdate::Mean => 0.5 * (v + w),
                PositionUpdate::New | PositionUpdate::Other => w,
            };
        let unit = U * (x.abs() + y.abs() + dt * (v.abs() + w.abs()));
        if y == x + d { 0.0 } else { (y - (x + d)).abs() / unit }
    }))
}

/// As [`newton_share`] for the implicit midpoint rule: a backward Euler step to the means, of half the length.
fn midpoint_share(subject: &TestCase, dt: f64, before: &State, after: &State) -> f64 {
    let mean = |x: &[Vector3<f64>], y: &[Vector3<f64>]| x.iter().zip(y).map(|(x, y)| (x + y) * 0.5).collect();
    let mut middle = State {
        positions: mean(&before.positions, &after.positions),
        velocities: mean(&before.velocities, &after.velocities),
        // No force here depends on the time.
        ..before.clone()
    };
    // Prescribed coordinates go by the chord of their motion.
    for (dof, ..) in subject.system.prescribed().iter() {
        let (x, y) = (before.positions[dof.particle][dof.axis], after.positions[dof.particle][dof.axis]);
        middle.velocities[dof.particle][dof.axis] = (y - x) / dt;
    }
    newton_share(subject, 0.5 * dt, before, &middle)
}

/// Residual of the nonlinear equations over what Newton's method leaves.
fn newton_share(subject: &TestCase, dt: f64, before: &State, after: &State) -> f64 {
    let forces = Forces::at(subject, after, &after.velocities);
    let (rows, magnitudes) = forces.residual(subject, dt, before, after);
    let reach = reference::magnitude(&forces.links, Link::magnitude, &after.positions);
    let rounding: Vec<f64> = reach.iter().map(|force| UNITS * U * force).collect();
    norm(&rows) / (1e-10 * norm(&magnitudes) + norm(&rounding))
}

fn explicit_share(subject: &TestCase, dt: f64, before: &State, after: &State) -> f64 {
    let forces = Forces::at(subject, before, &before.velocities);
    let (rows, magnitudes) = forces.residual(subject, dt, before, after);
    norm(&rows) / (UNITS * U * norm(&magnitudes))
}

/// The residuals of positions, `M (x' − x − dt v)/dt² − ½ f`, and of velocities over what rounding leaves. Steps over a kink of a
/// path are passed over, being several, and with them those after, which begin with a force inside one.
fn verlet_share(subject: &TestCase, dt: f64, states: &[State]) -> f64 {
    let system = &subject.system;
    let mut kept: Option<Forces> = None;
    let mut is_known = true;
    worst(states.windows(2).map(|pair| {
        let [before, after] = pair else { return 0.0 };
        let force = kept.take().unwrap_or_else(|| Forces::at(subject, before, &before.velocities));
        let slack = 1e-9 * dt;
        is_known &= system.prescribed().next_kink(before.time + slack).is_none_or(|kink| kink >= after.time + slack);
        if !is_known {
            return 0.0;
        }
        let mut predicted = before.velocities.clone();
        for dof in system.dofs().iter() {
            let p = dof.particle;
            predicted[p][dof.axis] += dt * force.total[p][dof.axis] / system.masses()[p];
        }
        let last = Forces::at(subject, after, &predicted);
        let zeros = || vec![Vector3::zeros(); system.particles()];
        let (mut places, mut speeds, mut place_sizes, mut speed_sizes) = (zeros(), zeros(), zeros(), zeros());
        for (p, &m) in system.masses().iter().enumerate() {
            let (x, y, v, w) = (before.positions[p], after.positions[p], before.velocities[p], after.velocities[p]);
            places[p] = (y - x - v * dt) * (m / dt / dt) - force.total[p] * 0.5;
            speeds[p] = (w - v) * (m / dt) - (force.total[p] + last.total[p]) * 0.5;
            let size = force.magnitudes[p] + last.magnitudes[p] + (v.norm() + w.norm()) * (m / dt);
            speed_sizes[p] = Vector3::repeat(size);
            place_sizes[p] = Vector3::repeat(size + (x.norm() + y.norm()) * (m / dt / dt));
        }
        let share = |rows: &[Vector3<f64>], sizes: &[Vector3<f64>]| {
            norm(&free(system, rows)) / (UNITS * U * norm(&free(system, sizes)))
        };
        let shares = [share(&places, &place_sizes), share(&speeds, &speed_sizes)];
        kept = Some(last);
        worst(shares)
    }))
}

/// `f_el + f_d + g` at a state, and the sums of the magnitudes in them.
struct Forces {
    links: Vec<Link>,
    total: Vec<Vector3<f64>>,
    magnitudes: Vec<f64>,
}

impl Forces {
    fn at(subject: &TestCase, state: &State, velocities: &[Vector3<f64>]) -> Self {
        let system = &subject.system;
        let links = links(system, &state.positions);
        let n = system.particles();
        let mut total = reference::sum(&links, n, Link::elastic_force);
        let damping = damping_product(&links, velocities);
        let mut magnitudes = reference::magnitude(&links, |link| link.damping, velocities);
        let pull = reference::pull(&links, n);
        for (p, &m) in system.masses().iter().enumerate() {
            total[p] += damping[p] + system.gravity() * m;
            magnitudes[p] += pull[p] + m * system.gravity().norm();
        }
        Self { links, total, magnitudes }
    }

    /// `M (v' − v)/dt − f` on free coordinates, and the magnitudes of its parts on particles that have one.
    fn residual(&self, subject: &TestCase, dt: f64, before: &State, after: &State) -> (Vec<f64>, Vec<f64>) {
        let system = &subject.system;
        let inertia = |p: usize| (after.velocities[p] - before.velocities[p]) * (system.masses()[p] / dt);
        let rows: Vec<Vector3<f64>> = (0..system.particles()).map(|p| inertia(p) - self.total[p]).collect();
        let size = |p: usize| {
            let speeds = after.velocities[p].norm() + before.velocities[p].norm();
            self.magnitudes[p] + system.masses()[p] * speeds / dt
        };
        let moving = (0..system.particles()).filter(|&p| system.dofs().free_axes(p).count() > 0);
        (free(system, &rows), moving.map(size).collect())
    }
}

#[cfg(test)]
mod tests;
