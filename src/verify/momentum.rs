//! Momentum, rest and drift: springs pull equally at both ends, along the line between them, and not at all at their rest lengths.
//!
//! Along an axis in which no particle of a connected part is prescribed, every method gives the part `p' = p + dt Σ m g` exactly: the rows of `A δx =
//! b` that belong to the axis add up to it, because the columns of K and G add up to zero. About any point, symplectic Euler and linear backward
//! Euler under `axial` give a free part `L' = L + dt Σ m x × g`: their forces on the two ends of a spring, at x, lie on the line between them, and
//! `x' × v' = x × v'`. Verlet does it in two halves, with the forces at x and at x', and implicit midpoint with those in the middle: the weight then
//! acts at the mean of x and x'. The transverse terms of the other options turn the parts about.
//!
//! With rest lengths equal to the lengths no spring pulls: b is zero, and so is δx, whatever the option, the step and
//! the method. Given one velocity to all particles and no constraints, all move by `dt v` a step.

use super::runs::{each_run, worst_step};
use super::{Check, Claim, Link, Measured, MethodVariant, TestCase, U, ratio, reference, worst};
use crate::integrate::Method;
use crate::rigid::{Body, bodies};
use crate::spring::Stiffness;
use crate::system::{Axes, State};
use nalgebra::Vector3;

/// Particles that springs connect, and the axes along which none of them is prescribed.
struct Part {
    particles: Vec<usize>,
    axes: Vec<usize>,
}

/// The connected parts of the system that no spring ties to a held particle.
fn parts(case: &TestCase) -> Vec<Part> {
    let system = &case.system;
    let is_free = |p: &usize, axis: usize| system.dofs().free_axes(*p).contains(axis);
    let untied = bodies(system).into_iter().filter(|body| body.anchors.is_empty());
    let part = |Body { particles, .. }: Body| {
        let axes = (0..system.dimension()).filter(|&axis| particles.iter().all(|p| is_free(p, axis))).collect();
        Part { particles, axes }
    };
    untied.map(part).collect()
}

pub(super) fn has_free_translation(case: &TestCase) -> bool {
    parts(case).iter().any(|part| !part.axes.is_empty())
}

pub(super) fn has_free_rotation(case: &TestCase) -> bool {
    case.system.dimension() > 1 && parts(case).iter().any(|part| part.axes.len() == case.system.dimension())
}

pub(super) fn linear(case: &TestCase) -> Measured {
    let (gravity, masses) = (case.system.gravity(), case.system.masses());
    let parts = parts(case);
    let change = |part: &Part, axis: usize, dt: f64, before: &State, after: &State| {
        let momentum =
            |state: &State| part.particles.iter().map(|&p| masses[p] * state.velocities[p][axis]).sum::<f64>();
        let mass: f64 = part.particles.iter().map(|&p| masses[p]).sum();
        (momentum(after) - momentum(before) - dt * mass * gravity[axis]).abs()
    };
    follow(case, "linear momentum", MethodVariant::of(case), |_, dt, before, after| {
        let axes = parts.iter().flat_map(|part| part.axes.iter().map(move |&axis| (part, axis)));
        worst(axes.map(|(part, axis)| change(part, axis, dt, before, after)))
    })
}

pub(super) fn angular(case: &TestCase) -> Measured {
    let (gravity, masses, centre) = (case.system.gravity(), case.system.masses(), case.centre());
    let dimension = case.system.dimension();
    let free: Vec<Part> = parts(case).into_iter().filter(|part| part.axes.len() == dimension).collect();
    let momentum = |part: &Part, state: &State| -> Vector3<f64> {
        let of = |&p: &usize| (state.positions[p] - centre).cross(&state.velocities[p]) * masses[p];
        part.particles.iter().map(of).sum()
    };
    // Springs without a rest length keep their transverse terms.
    let are_axial = case.system.springs().iter().all(|spring| spring.rest_length > 0.0);
    let conserves = |variant: &MethodVariant| {
        matches!(variant.method, Method::SymplecticEuler | Method::Verlet | Method::ImplicitMidpoint)
            || are_axial && *variant == MethodVariant::linear(Stiffness::Axial)
    };
    let extent = case.extent();
    follow(case, "angular momentum", MethodVariant::of(case).filter(conserves), |method, dt, before, after| {
        let arm = |p: usize| match method {
            Method::ImplicitMidpoint | Method::Verlet => (before.positions[p] + after.positions[p]) * 0.5 - centre,
            _ => before.positions[p] - centre,
        };
        worst(free.iter().map(|part| {
            let torque: Vector3<f64> = part.particles.iter().map(|&p| arm(p).cross(&gravity) * masses[p]).sum();
            (momentum(part, after) - momentum(part, before) - torque * dt).norm() / extent
        }))
    })
}

fn follow(
    case: &TestCase,
    name: &str,
    variants: impl Iterator<Item = MethodVariant>,
    error: impl Fn(Method, f64, &State, &State) -> f64,
) -> Measured {
    each_run(case, variants, 5, |variant, dt, states| {
        let value = worst_step(states, |before, after| {
            ratio(error(variant.method, dt, before, after), rounding(case, dt, before, after))
        });
        // Newton stops at a residual of 1e-10 of the forces, not at rounding.
        let bound = if variant.is_nonlinear() { 1e-10 / U } else { 30.0 };
        let why = "in units of rounding, u (‖A‖ ‖δx‖ + ‖b‖) dt summed over the particles; a backward stable solve leaves \
                   at most 30 of them; Newton's method stops at a residual of 1e-10";
        let name = format!("{name}, {}", variant.name());
        // Where springs turn about, iterations and directions go through states far from those that the rounding is counted at.
        let passing = || case.passing((states.len() - 1) as f64 * dt);
        [Check::new(Claim::Conservation, name, &case.name, value, bound, why).unless(passing)]
    })
}

/// The change of momentum by one unit of rounding: `n dt u (‖A‖ ‖δx‖ + ‖b‖)`, the forces in b at their magnitudes.
fn rounding(case: &TestCase, dt: f64, before: &State, after: &State) -> f64 {
    let system = &case.system;
    let n = system.particles() as f64;
    let pairs = before.positions.iter().zip(&after.positions);
    let displacement = pairs.map(|(x, y)| (y - x).amax()).fold(0.0, f64::max);
    let centre = case.centre();
    let extent = after.positions.iter().map(|x| (x - centre).amax()).fold(case.extent(), f64::max);
    let inertia = system.masses().iter().zip(before.velocities.iter().zip(&after.velocities));
    let inertia = inertia.map(|(m, (v, w))| m * (v.amax() + w.amax()) / dt).fold(0.0, f64::max);
    let heaviest = reference::movers(system).map(|p| system.masses()[p]).fold(0.0, f64::max);
    let weight = heaviest * system.gravity().amax();
    let links = reference::links(system, &before.positions);
    let pull = links.iter().map(|link| link.elastic_force().amax()).fold(0.0, f64::max);
    // x × v: the arm may be as long as the scene has become.
    let arm = (extent / case.extent()).max(1.0);
    arm * n * dt * U * (reference::step_matrix_norm(case, before, dt) * displacement + inertia + weight + pull)
}

pub(super) fn equilibrium(case: &TestCase) -> Measured {
    let resting = case.relaxed()?;
    let mut drifting = resting.freed()?;
    let velocity = Axes::first(case.system.dimension()).project(&Vector3::new(0.3, -0.2, 0.5));
    drifting.state.velocities.fill(velocity * (case.extent() / case.dt) * 0.01);
    let mut checks = Vec::new();
    for (case, name) in [(resting, "rest is kept"), (drifting, "a drift is kept")] {
        checks.extend(each_run(&case, MethodVariant::of(&case), 3, |variant, dt, states| {
            let distances = states.iter().enumerate().skip(1);
            let value = worst(distances.map(|(n, state)| drift_error(&case, dt, n as f64, state)));
            let why = "over 30 units of rounding: u k (|x_i| + |x_j|)/l0 and u b (|v_i| + |v_j|) of each spring, as a force on the \
                       lightest particle for the time, and u |x|";
            let name = format!("{name}, {}", variant.name());
            let check = Check::new(Claim::Conservation, name, &case.name, value, 1.0, why);
            [check.unless(|| case.beyond_rounding(dt))]
        })?);
    }
    Ok(checks)
}

/// The distance of the state after n steps from `x + n dt v` over 30 units of rounding.
fn drift_error(case: &TestCase, dt: f64, n: f64, state: &State) -> f64 {
    let TestCase { system, state: start, .. } = case;
    let links = reference::links(system, &state.positions);
    let elastic = reference::magnitude(&links, Link::magnitude, &state.positions);
    let damping = reference::magnitude(&links, |link| link.damping, &state.velocities);
    // ‖δx‖ ≤ dt²/m ‖f‖ in the Euclidean norm, since A ≥ M/dt²; velocities, and with them later steps, add up.
    let force = elastic.iter().zip(&damping).map(|(e, d)| (e + d) * (e + d)).sum::<f64>().sqrt();
    let drift = n * n * dt * dt / reference::lightest(system) * U * force;
    worst((0..system.particles()).map(|p| {
        let expected = start.positions[p] + start.velocities[p] * (n * dt);
        let rounding = drift + n * U * (state.positions[p].norm() + start.positions[p].norm());
        ratio((state.positions[p] - expected).norm(), 30.0 * rounding)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures;

    /// In a quarter of a second one of three particles goes 1/8 m and another, of 1 kg, gets 1/2 m/s; weights are 10 N at most, springs
    /// pull with 2 and 3 N.
    #[test]
    fn units_of_rounding_by_hand() {
        let case = fixtures::case(fixtures::line(), 0.25);
        let mut after = case.state.clone();
        after.positions[0].x += 0.125;
        after.velocities[1] = Vector3::new(-0.5, 0.0, 0.0);
        let norm = reference::step_matrix_norm(&case, &case.state, 0.25);
        let expected = 3.0 * 0.25 * U * (norm * 0.125 + 2.0 + 10.0 + 3.0);
        fixtures::assert_close(rounding(&case, 0.25, &case.state, &after), expected);
    }
}
