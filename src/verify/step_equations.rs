//! A step solves its own equations: the new state put back into them leaves rounding.
//!
//! The residuals are formed from formulas that were written a second time, for all free coordinates, with the contributions of
//! prescribed ones. With `δx = dt v'`:
//!
//! ```text
//! linear backward Euler   M (v' − v)/dt − f_el(x) − K δx − G v' − g
//! backward Euler          M (v' − v)/dt − f_el(x') − f_d(x', v') − g
//! explicit Euler methods  M (v' − v)/dt − f_el(x) − f_d(x, v) − g
//! Verlet                  M (v' − v)/dt − ½ (f + f'),  f' = f_el(x') + f_d(x', v + dt M⁻¹f) + g,  f that of the step before
//! ```
//!
//! For bdf2, with the states x₋, x at the ends of the last step of the same length, `x̃ = (4x − x₋)/3`, `ṽ = (4v − v₋)/3`, `τ = 2h/3`
//! and the prediction `y = x + h v + ½ h (v − v₋)`; in the first step and after kinks of paths `x̃ = x`, `ṽ = v`, `τ = h`, `y = x + h v`.
//! Then, on free coordinates, with `w = (y − x̃)/τ` and K and G at y,
//!
//! ```text
//! M (w − ṽ)/τ − f_el(y) − f_d(y, w) − g + (M/τ² − G/τ − K)(x' − y) = 0,      v' = (x' − x̃)/τ.
//! ```
//!
//! Its steps are short enough for one iteration. The default's choice of K is not written a second time; of it, as of all
//! others, the exact residual after the step is compared with that before it. Methods of several stages have known answers instead.

use super::reference::{self, damping_product, links, movers, stiffness_product};
use super::runs::{each_run, worst_step};
use super::{Check, Claim, Link, Measured, MethodVariant, TestCase, U, UNITS, direct, ratio, reduce, worst};
use crate::integrate::{Method, PositionUpdate, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions, Tolerance, norm};
use crate::spring::Stiffness;
use crate::system::{Motion, State};
use nalgebra::Vector3;

/// Steps that are put back; of bdf2 more, as it starts with another formula.
const STEPS: usize = 3;
const BDF2_STEPS: usize = 5;

/// The tolerance of conjugate gradients.
const TOLERANCE: f64 = 1e-10;

/// The part of the exact residual that one iteration of bdf2 may leave where steps resolve all vibrations.
const CONTRACTION: f64 = 0.5;

pub(super) fn linear(case: &TestCase) -> Measured {
    let solvers = [
        (SolverChoice::Llt, "Cholesky"),
        (SolverChoice::Ldlt, "LDLᵀ"),
        (SolverChoice::Cg, "matrix-free conjugate gradients"),
        (SolverChoice::CgAssembled, "conjugate gradients on the assembled matrix"),
    ];
    let mut checks = Vec::new();
    for option in Stiffness::ALL {
        for (solver, solver_name) in solvers {
            let options = SolverOptions { solver, tolerance: Tolerance::Fixed(TOLERANCE), ..SolverOptions::default() };
            let Some(states) = MethodVariant::linear(option).run(case, options, case.dt, STEPS)? else { continue };
            let iterates = matches!(solver, SolverChoice::Cg | SolverChoice::CgAssembled);
            let value = worst_step(&states, |before, after| {
                let residual = linear_residual(case, option, case.dt, before, after);
                if iterates { residual.over_tolerance() } else { residual.in_units() }
            });
            let (bound, why) = if iterates {
                (1.0, "‖b − A δx‖ over the tolerance of 1e-10 ‖b‖, with 30 units of rounding a row for forming it")
            } else {
                let why = "in units of rounding, u (‖A‖ ‖δx‖ + ‖b‖) in the maximum norm: a backward stable solve and forming the \
                           residual leave so many";
                (UNITS, why)
            };
            let name = format!("residual of a step, {}, {solver_name}", option.name());
            checks.push(Check::new(Claim::Solvers, name, &case.name, value, bound, why));
        }
    }
    Ok(checks)
}

pub(super) fn others(case: &TestCase) -> Measured {
    let variants = MethodVariant::of(case).filter(|variant| variant.method != Method::Bdf2);
    let mut checks = each_run(case, variants, STEPS, |variant, dt, states| {
        let check = |name: &str, value, bound, why: &str| {
            Check::new(Claim::Solvers, format!("{name}, {}", variant.name()), &case.name, value, bound, why)
        };
        let mut checks = Vec::new();
        if variant.method.moves_by() != PositionUpdate::Other {
            let moved = worst_step(states, |before, after| displacement_error(case, variant.method, dt, before, after));
            let why = "in units of rounding of the position: v is the old, the new or the mean velocity, as the method has it";
            checks.push(check("x' = x + dt v", moved, 4.0, why));
        }
        let each = |error: fn(&TestCase, f64, &State, &State) -> f64| {
            Some(worst_step(states, |before, after| error(case, dt, before, after)))
        };
        let residual = match variant.method {
            Method::BackwardEuler => each(newton_error),
            Method::ImplicitMidpoint => each(midpoint_error),
            Method::SymplecticEuler | Method::ForwardEuler => each(explicit_error),
            Method::Verlet => Some(verlet_error(case, dt, states)),
            _ => None,
        };
        let why = match variant.is_nonlinear() {
            true => "over the 1e-10 of the balancing forces at which Newton's method stops, with rounding",
            false => "over 30 units of rounding of the forces that are added up",
        };
        let residual = residual.map(|value| check("residual of a step", value, 1.0, why));
        checks.extend(residual.map(|check| check.unless(|| case.beyond_rounding(dt))));
        checks
    })?;
    for variant in MethodVariant::of(case).filter(|variant| variant.method == Method::Bdf2) {
        checks.extend(bdf2(case, variant)?);
    }
    Ok(checks)
}

/// A residual, and one unit of rounding in the same equations.
struct Residual {
    rows: Vec<f64>,
    right_hand_side: Vec<f64>,
    unit: f64,
}

impl Residual {
    /// The largest row in units of rounding.
    fn in_units(&self) -> f64 {
        ratio(worst(self.rows.iter().map(|row| row.abs()).chain([0.0])), self.unit)
    }

    /// The norm over the tolerance of conjugate gradients, with rounding in every row.
    fn over_tolerance(&self) -> f64 {
        let rounding = UNITS * self.unit * (self.rows.len() as f64).sqrt();
        ratio(norm(&self.rows), TOLERANCE * norm(&self.right_hand_side) + rounding)
    }
}

fn linear_residual(case: &TestCase, option: Stiffness, dt: f64, before: &State, after: &State) -> Residual {
    let system = &case.system;
    let links = links(system, &before.positions);
    let n = system.particles();
    let elastic = reference::sum(&links, n, Link::elastic_force);
    let pull = reference::pull(&links, n);
    let dx: Vec<Vector3<f64>> = after.velocities.iter().map(|v| v * dt).collect();
    // A_fc δx_c belongs to b: subtract it as the solver does.
    let mut prescribed = dx.clone();
    system.dofs().scatter(&vec![0.0; system.dofs().len()], &mut prescribed);
    let springs = |dx: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        let velocities: Vec<Vector3<f64>> = dx.iter().map(|d| d / dt).collect();
        let products = stiffness_product(&links, option, dx).into_iter().zip(damping_product(&links, &velocities));
        products.map(|(k, g)| k + g).collect()
    };
    let (mut rows, mut right_hand_side, mut b) = (springs(&dx), springs(&prescribed), 0.0_f64);
    for (p, &m) in system.masses().iter().enumerate() {
        let known = before.velocities[p] * (m / dt) + elastic[p] + system.gravity() * m;
        rows[p] += known - after.velocities[p] * (m / dt);
        right_hand_side[p] += known;
        // ‖b‖ at the magnitudes of its parts: rounding does not know that they cancel.
        b = b.max(m * (before.velocities[p].amax() / dt + system.gravity().amax()) + pull[p]);
    }
    let unit = U * (reference::step_matrix_norm(case, before, dt) * largest(&dx) + b);
    Residual { rows: reduce(system, &rows), right_hand_side: reduce(system, &right_hand_side), unit }
}

/// The largest component of vectors, at least 0; NaN if there is one.
fn largest(vectors: &[Vector3<f64>]) -> f64 {
    worst(vectors.iter().map(|v| v.amax()).chain([0.0]))
}

/// `|x' − (x + dt v)|` in units of rounding; v is the velocity that the method moves by.
fn displacement_error(case: &TestCase, method: Method, dt: f64, before: &State, after: &State) -> f64 {
    worst(case.system.dofs().iter().map(|dof| {
        let of = |vectors: &[Vector3<f64>]| vectors[dof.particle][dof.axis];
        let (x, y, v, w) = (of(&before.positions), of(&after.positions), of(&before.velocities), of(&after.velocities));
        let velocity = match method.moves_by() {
            PositionUpdate::Old => v,
            PositionUpdate::Mean => 0.5 * (v + w),
            PositionUpdate::New | PositionUpdate::Other => w,
        };
        ratio((y - (x + dt * velocity)).abs(), U * (x.abs() + y.abs() + dt * (v.abs() + w.abs())))
    }))
}

/// `f_el + f_d + g` at a state, and the sums of the magnitudes in them.
struct Forces {
    links: Vec<Link>,
    total: Vec<Vector3<f64>>,
    magnitudes: Vec<f64>,
}

impl Forces {
    fn at(case: &TestCase, state: &State, velocities: &[Vector3<f64>]) -> Self {
        let system = &case.system;
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

    /// `M (v' − v)/dt − f`, and the magnitudes of its parts.
    fn residual(&self, case: &TestCase, dt: f64, before: &State, after: &State) -> (Vec<Vector3<f64>>, Vec<f64>) {
        let (v, w) = (&before.velocities, &after.velocities);
        let masses = case.system.masses().iter().enumerate();
        let rows = masses.clone().map(|(p, m)| (w[p] - v[p]) * (m / dt) - self.total[p]);
        let sizes = masses.map(|(p, m)| self.magnitudes[p] + m * (w[p].norm() + v[p].norm()) / dt);
        (rows.collect(), sizes.collect())
    }

    /// The rounding of positions times the stiffness of the springs, particle by particle.
    fn position_rounding(&self, state: &State) -> Vec<f64> {
        reference::magnitude(&self.links, Link::magnitude, &state.positions)
    }
}

fn free_norm(case: &TestCase, rows: &[Vector3<f64>]) -> f64 {
    norm(&reduce(&case.system, rows))
}

fn mover_norm(case: &TestCase, sizes: &[f64]) -> f64 {
    norm(&movers(&case.system).map(|p| sizes[p]).collect::<Vec<_>>())
}

/// The residual of the nonlinear equations over the tolerance of Newton's method.
fn newton_error(case: &TestCase, dt: f64, before: &State, after: &State) -> f64 {
    let forces = Forces::at(case, after, &after.velocities);
    let (rows, sizes) = forces.residual(case, dt, before, after);
    let rounding = UNITS * U * norm(&forces.position_rounding(after));
    ratio(free_norm(case, &rows), 1e-10 * mover_norm(case, &sizes) + rounding)
}

/// As [`newton_error`] for the implicit midpoint rule: a backward Euler step to the means, of half the length.
fn midpoint_error(case: &TestCase, dt: f64, before: &State, after: &State) -> f64 {
    let mean = |x: &[Vector3<f64>], y: &[Vector3<f64>]| x.iter().zip(y).map(|(x, y)| (x + y) * 0.5).collect();
    let mut middle = State {
        positions: mean(&before.positions, &after.positions),
        velocities: mean(&before.velocities, &after.velocities),
        // No force here depends on the time.
        ..before.clone()
    };
    // Prescribed coordinates go by the chord of their motion.
    for (dof, ..) in case.system.prescribed().iter() {
        let (x, y) = (before.positions[dof.particle][dof.axis], after.positions[dof.particle][dof.axis]);
        middle.velocities[dof.particle][dof.axis] = (y - x) / dt;
    }
    newton_error(case, 0.5 * dt, before, &middle)
}

fn explicit_error(case: &TestCase, dt: f64, before: &State, after: &State) -> f64 {
    let (rows, sizes) = Forces::at(case, before, &before.velocities).residual(case, dt, before, after);
    ratio(free_norm(case, &rows), UNITS * U * mover_norm(case, &sizes))
}

/// The residuals of positions, `M (x' − x − dt v)/dt² − ½ f`, and of velocities over rounding. A step over a kink of a path is
/// passed over, being several, and with it all later ones, which begin with a force inside one.
fn verlet_error(case: &TestCase, dt: f64, states: &[State]) -> f64 {
    let system = &case.system;
    let mut last: Option<Forces> = None;
    let mut is_known = true;
    worst(states.windows(2).map(|pair| {
        let (before, after) = (&pair[0], &pair[1]);
        let force = last.take().unwrap_or_else(|| Forces::at(case, before, &before.velocities));
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
        let next = Forces::at(case, after, &predicted);
        let zeros = || vec![Vector3::zeros(); system.particles()];
        let [mut places, mut speeds, mut place_sizes, mut speed_sizes] = [(); 4].map(|()| zeros());
        for (p, &m) in system.masses().iter().enumerate() {
            let (x, y, v, w) = (before.positions[p], after.positions[p], before.velocities[p], after.velocities[p]);
            places[p] = (y - x - v * dt) * (m / dt / dt) - force.total[p] * 0.5;
            speeds[p] = (w - v) * (m / dt) - (force.total[p] + next.total[p]) * 0.5;
            let size = force.magnitudes[p] + next.magnitudes[p] + (v.norm() + w.norm()) * (m / dt);
            speed_sizes[p] = Vector3::repeat(size);
            place_sizes[p] = Vector3::repeat(size + (x.norm() + y.norm()) * (m / dt / dt));
        }
        last = Some(next);
        let error = |rows: &[_], sizes: &[_]| ratio(free_norm(case, rows), UNITS * U * free_norm(case, sizes));
        worst([error(&places, &place_sizes), error(&speeds, &speed_sizes)])
    }))
}

struct Bdf2Step {
    tau: f64,
    /// x̃ and ṽ.
    base: State,
    /// y and w.
    prediction: State,
}

fn bdf2(case: &TestCase, variant: MethodVariant) -> Measured {
    let dt = case.dt.min(case.resolving_step());
    let Some(states) = variant.run(case, direct(), dt, BDF2_STEPS)? else { return Ok(Vec::new()) };
    let steps: Vec<(Bdf2Step, &State)> = (0..BDF2_STEPS)
        .map(|n| (Bdf2Step::new(case, n.checked_sub(1).map(|last| &states[last]), &states[n], dt), &states[n + 1]))
        .collect();
    let check = |what: &str, error: &dyn Fn(&Bdf2Step, &State) -> f64, bound: f64, why: &str| {
        let value = worst(steps.iter().map(|(step, after)| error(step, after)));
        Check::new(Claim::Solvers, format!("{what}, {}", variant.name()), &case.name, value, bound, why)
    };
    let why = "in units of rounding of the positions over τ";
    let moved = check("v' = (x' − x̃)/τ", &|step, after| step.velocity_error(case, after), UNITS, why);
    let mut checks = vec![moved];
    if let StiffnessPolicy::Always(option) = variant.stiffness {
        let error = |step: &Bdf2Step, after: &State| {
            let links = links(&case.system, &step.prediction.positions);
            step.linear_error(case, after, &stiffness_product(&links, option, &step.correction(case, after)))
        };
        let why = "in units of rounding, u (‖A‖ (‖x‖ + ‖δx‖) + ‖b‖) in the maximum norm: a backward stable solve, rounding the \
                   positions and forming the residual leave so many";
        checks.push(check("residual of a step", &error, UNITS, why));
    }
    let why = "exact residual forces after the step over those at its prediction, weighted by 1/√m: the matrix need only contract";
    let left = |step: &Bdf2Step, after: &State| step.contraction(case, after);
    checks.push(check("residual that is left", &left, CONTRACTION, why));
    Ok(checks)
}

impl Bdf2Step {
    fn new(case: &TestCase, before: Option<&State>, state: &State, h: f64) -> Self {
        let (mut base, mut prediction) = (state.clone(), state.clone());
        let before = before.filter(|_| !starts_afresh(case, state.time, h));
        let tau = if before.is_some() { 2.0 * h / 3.0 } else { h };
        for p in 0..state.positions.len() {
            let (x, v) = (state.positions[p], state.velocities[p]);
            prediction.positions[p] = x + v * h;
            if let Some(before) = before {
                // In this form what rests has no rounding: of a far held particle that would be a velocity.
                base.positions[p] = x + (x - before.positions[p]) / 3.0;
                base.velocities[p] = v + (v - before.velocities[p]) / 3.0;
                prediction.positions[p] += (v - before.velocities[p]) * (0.5 * h);
            }
        }
        prediction.time = state.time + h;
        prediction.prescribe(&case.system);
        let mut step = Self { tau, base, prediction };
        step.prediction.velocities = step.rates(&step.prediction);
        step
    }

    /// `(x − x̃)/τ`.
    fn rates(&self, state: &State) -> Vec<Vector3<f64>> {
        state.positions.iter().zip(&self.base.positions).map(|(x, base)| (x - base) / self.tau).collect()
    }

    /// `x' − y`, zero on prescribed coordinates.
    fn correction(&self, case: &TestCase, after: &State) -> Vec<Vector3<f64>> {
        let mut moved = vec![Vector3::zeros(); after.positions.len()];
        for dof in case.system.dofs().iter() {
            let (p, axis) = (dof.particle, dof.axis);
            moved[p][axis] = after.positions[p][axis] - self.prediction.positions[p][axis];
        }
        moved
    }

    /// `|v' − (x' − x̃)/τ|` in units of rounding.
    fn velocity_error(&self, case: &TestCase, after: &State) -> f64 {
        worst(case.system.dofs().iter().map(|dof| {
            let of = |vectors: &[Vector3<f64>]| vectors[dof.particle][dof.axis];
            let (x, base, v) = (of(&after.positions), of(&self.base.positions), of(&after.velocities));
            ratio((v - (x - base) / self.tau).abs(), U * (x.abs() + 2.0 * base.abs()) / self.tau)
        }))
    }

    /// `M (v − ṽ)/τ − f_el − f_d − g` at a state, and the magnitudes of its parts.
    fn residual(&self, case: &TestCase, at: &State) -> (Vec<Vector3<f64>>, Vec<f64>) {
        let forces = Forces::at(case, at, &at.velocities);
        let (rows, sizes) = forces.residual(case, self.tau, &self.base, at);
        let positions = forces.position_rounding(at);
        (rows, sizes.iter().zip(&positions).map(|(size, position)| size + position).collect())
    }

    /// The largest row of the linear equations, in units of rounding; `stiffness` is K (x' − y).
    fn linear_error(&self, case: &TestCase, after: &State, stiffness: &[Vector3<f64>]) -> f64 {
        let Self { tau, prediction, .. } = self;
        let system = &case.system;
        let moved = self.correction(case, after);
        let rates: Vec<Vector3<f64>> = moved.iter().map(|d| d / *tau).collect();
        let damping = damping_product(&links(system, &prediction.positions), &rates);
        let (mut rows, sizes) = self.residual(case, prediction);
        for (p, &m) in system.masses().iter().enumerate() {
            rows[p] += rates[p] * (m / tau) - damping[p] - stiffness[p];
        }
        let x = largest(&moved) + largest(&after.positions);
        let b = sizes.into_iter().fold(0.0, f64::max);
        let unit = U * (reference::step_matrix_norm(case, prediction, *tau) * x + b);
        worst(reduce(system, &rows).iter().map(|row| ratio(row.abs(), unit)))
    }

    /// The exact residual after the step over that at the prediction, both weighted by 1/√m, beside rounding.
    fn contraction(&self, case: &TestCase, after: &State) -> f64 {
        let after = State { velocities: self.rates(after), ..after.clone() };
        let size = |rows: &[Vector3<f64>]| {
            let weighted = rows.iter().zip(case.system.masses()).map(|(row, m)| row / m.sqrt());
            free_norm(case, &weighted.collect::<Vec<_>>())
        };
        let ((before, _), (now, sizes)) = (self.residual(case, &self.prediction), self.residual(case, &after));
        let units = |of: &dyn Fn(usize) -> f64| -> Vec<Vector3<f64>> {
            (0..sizes.len()).map(|p| Vector3::repeat(UNITS * U * of(p))).collect()
        };
        // Rounding moves a position by u |x|, and that moves the inertial force.
        let inertia = |p: usize| case.system.masses()[p] * after.positions[p].norm() / self.tau.powi(2);
        let rounding = size(&units(&|p| sizes[p])) + size(&units(&inertia));
        ratio(size(&now), size(&before) + rounding / CONTRACTION)
    }
}

/// Whether a corner of a path parts the step of length h from time t from the one before.
fn starts_afresh(case: &TestCase, t: f64, h: f64) -> bool {
    let corners: Vec<f64> = case.system.prescribed().motions().iter().flat_map(Motion::kinks).copied().collect();
    let slack = 1e-9 * h;
    let any = |from: f64, to: f64| corners.iter().any(|&corner| from <= corner && corner < to);
    let (now, before) = (any(t - slack, t + h - slack), any(t - h - slack, t - slack));
    (now && !before) || (!now && any(t - h + slack, t - slack))
}

#[cfg(test)]
mod tests;
