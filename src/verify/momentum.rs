//! Momentum: springs pull equally at both ends, and along the line between them.
//!
//! Along an axis in which no particle of a connected part is prescribed, every method gives the part
//! `p' = p + dt Σ m g` exactly: the rows of `A δx = b` that belong to the axis add up to it, because the columns of K and G
//! add up to zero. About any point, symplectic Euler and linearised backward Euler under `axial` give a free part
//! `L' = L + dt Σ m x × g`: their forces on the two ends of a spring, at x, lie on the line between them, and
//! `x' × v' = x × v'`. Verlet does it in two halves, with the forces at x and at x', and implicit midpoint with those in the
//! middle: the weight then acts at the mean of x and x'. The transverse terms of the other options turn the parts about.

use super::measured::Measured;
use super::runs::{Way, direct};
use super::{Check, Claim, TestCase, U, Unfinished, reference, worst};
use crate::integrate::Method;
use crate::spring::Stiffness;
use crate::system::State;
use nalgebra::Vector3;

/// Steps that momentum is followed over.
const STEPS: usize = 5;

/// Particles that springs connect, and the axes along which none of them is prescribed.
struct Part {
    particles: Vec<usize>,
    axes: Vec<usize>,
}

/// The connected parts of the system.
fn parts(subject: &TestCase) -> Vec<Part> {
    let system = &subject.system;
    let mut label: Vec<usize> = (0..system.particles()).collect();
    // Every second particle on the way is hung one higher, so that no way stays long, in whatever order springs come.
    let root = |label: &mut [usize], mut p: usize| {
        while label[p] != p {
            label[p] = label[label[p]];
            p = label[p];
        }
        p
    };
    for spring in 0..system.pairs().len() {
        let [i, j] = system.pair(spring).map(|p| root(&mut label, p));
        label[i.max(j)] = i.min(j);
    }
    let mut parts: std::collections::BTreeMap<usize, Vec<usize>> = std::collections::BTreeMap::new();
    for p in 0..system.particles() {
        parts.entry(root(&mut label, p)).or_default().push(p);
    }
    let is_free = |p: &usize, axis: usize| system.dofs().free_axes(*p).contains(axis);
    let part = |particles: Vec<usize>| {
        let axes = (0..system.dimension()).filter(|&axis| particles.iter().all(|p| is_free(p, axis))).collect();
        Part { particles, axes }
    };
    parts.into_values().map(part).collect()
}

pub(super) fn has_free_translation(subject: &TestCase) -> bool {
    parts(subject).iter().any(|part| !part.axes.is_empty())
}

pub(super) fn has_free_rotation(subject: &TestCase) -> bool {
    subject.system.dimension() > 1 && parts(subject).iter().any(|part| part.axes.len() == subject.system.dimension())
}

pub(super) fn linear(subject: &TestCase) -> Measured {
    let (gravity, masses) = (subject.system.gravity(), subject.system.masses());
    let parts = parts(subject);
    let momentum = |part: &Part, axis: usize, state: &State| -> f64 {
        part.particles.iter().map(|&p| masses[p] * state.velocities[p][axis]).sum()
    };
    measure(subject, "linear momentum", Way::of(subject), |_, dt, before, after| {
        worst(parts.iter().flat_map(|part| {
            let mass: f64 = part.particles.iter().map(|&p| masses[p]).sum();
            part.axes.iter().map(move |&axis| {
                (momentum(part, axis, after) - momentum(part, axis, before) - dt * mass * gravity[axis]).abs()
            })
        }))
    })
}

pub(super) fn angular(subject: &TestCase) -> Measured {
    let system = &subject.system;
    let (gravity, masses, centre) = (system.gravity(), system.masses(), subject.centre());
    let free: Vec<Part> = parts(subject).into_iter().filter(|part| part.axes.len() == system.dimension()).collect();
    let momentum = |part: &Part, state: &State| -> Vector3<f64> {
        let of = |&p: &usize| (state.positions[p] - centre).cross(&state.velocities[p]) * masses[p];
        part.particles.iter().map(of).sum()
    };
    let turning = |way: &Way| {
        matches!(way.method, Method::SymplecticEuler | Method::Verlet | Method::ImplicitMidpoint)
            || *way == Way::notes(Stiffness::Axial)
    };
    let extent = subject.extent();
    measure(subject, "angular momentum", Way::of(subject).filter(turning), |method, dt, before, after| {
        let change = |part: &Part| {
            // The weight acts where the method takes the forces.
            let arm = |p: usize| match method {
                Method::ImplicitMidpoint | Method::Verlet => (before.positions[p] + after.positions[p]) * 0.5 - centre,
                _ => before.positions[p] - centre,
            };
            let torque: Vector3<f64> = part.particles.iter().map(|&p| arm(p).cross(&gravity) * masses[p]).sum();
            (momentum(part, after) - momentum(part, before) - torque * dt).norm() / extent
        };
        worst(free.iter().map(change))
    })
}

/// The worst share of what rounding allows over the steps of a run by each way.
fn measure(
    subject: &TestCase,
    name: &str,
    ways: impl Iterator<Item = Way>,
    error: impl Fn(Method, f64, &State, &State) -> f64,
) -> Result<Vec<Check>, Unfinished> {
    let mut checks = Vec::new();
    for way in ways {
        let dt = way.step(subject);
        let Some(states) = way.run(subject, direct(), dt, STEPS)? else { continue };
        let pairs = states.windows(2);
        let share =
            pairs.map(|pair| error(way.method, dt, &pair[0], &pair[1]) / rounding(subject, dt, &pair[0], &pair[1]));
        // Newton stops at a residual of 1e-10 of the forces, not at rounding.
        let bound = if way.is_nonlinear() { 1e-10 / U } else { 30.0 };
        let why = "in units of rounding, u (‖A‖ ‖δx‖ + ‖b‖) dt summed over the particles; a backward stable solve leaves \
                   at most 30 of them; Newton's method stops at a residual of 1e-10";
        let name = format!("{name}, {}", way.name());
        let check = Check::new(Claim::Conservation, name, &subject.name, worst(share), bound, why);
        // Iterations and directions then go through states far from those that the rounding is counted at.
        checks.push(check.unless(|| subject.passing(STEPS as f64 * dt)));
    }
    Ok(checks)
}

/// The change of momentum by one unit of rounding: `n dt u (‖A‖ ‖δx‖ + ‖b‖)`, the forces in b at their magnitudes.
fn rounding(subject: &TestCase, dt: f64, before: &State, after: &State) -> f64 {
    let system = &subject.system;
    let n = system.particles() as f64;
    let pairs = before.positions.iter().zip(&after.positions);
    let displacement = pairs.map(|(x, y)| (y - x).amax()).fold(0.0, f64::max);
    let extent = after.positions.iter().map(|x| (x - subject.centre()).amax()).fold(subject.extent(), f64::max);
    let inertia = system.masses().iter().zip(before.velocities.iter().zip(&after.velocities));
    let inertia = inertia.map(|(m, (v, w))| m * (v.amax() + w.amax()) / dt).fold(0.0, f64::max);
    let heaviest = reference::movers(system).map(|p| system.masses()[p]).fold(0.0, f64::max);
    let weight = heaviest * system.gravity().amax();
    let links = reference::links(system, &before.positions);
    let pull = links.iter().map(|link| link.elastic_force().amax()).fold(0.0, f64::max);
    // x × v: the arm may be as long as the scene has become.
    let arm = (extent / subject.extent()).max(1.0);
    arm * n * dt * U * (reference::step_matrix_norm(subject, before, dt) * displacement + inertia + weight + pull)
}

#[cfg(all(test, feature = "scene"))]
mod tests {
    use super::{U, parts, reference, rounding};
    use crate::scene::builtin;
    use crate::verify::{TestCase, fixtures};
    use nalgebra::Vector3;

    /// In a quarter of a second one of three particles goes 1/8 m and another, of 1 kg, gets 1/2 m/s; weights are 10 N at most, springs
    /// pull with 2 and 3 N.
    #[test]
    fn units_of_rounding_by_hand() {
        let (system, state) = fixtures::line().build().unwrap();
        let subject = TestCase { name: "line".into(), system, state, dt: 0.25 };
        let mut after = subject.state.clone();
        after.positions[0].x += 0.125;
        after.velocities[1] = Vector3::new(-0.5, 0.0, 0.0);
        let norm = reference::step_matrix_norm(&subject, &subject.state, 0.25);
        let expected = 3.0 * 0.25 * U * (norm * 0.125 + 2.0 + 10.0 + 3.0);
        let found = rounding(&subject, 0.25, &subject.state, &after);
        assert!((found / expected - 1.0).abs() < 1e-12, "{found:e} {expected:e}");
    }

    /// Links given from the far end on hang every particle under the next: without halving, the way to the root of the last ones
    /// is the whole chain, for every particle.
    #[test]
    fn long_chains_are_one_part() {
        let mut scene = builtin::chain(100_000).unwrap();
        scene.springs.pairs.reverse();
        let parts = parts(&TestCase::of_scene(&scene).unwrap());
        assert_eq!((parts.len(), parts[0].particles.len()), (1, 100_001));
    }
}
