//! Gradients of runs: remainders of Taylor's theorem, the dot product of tangents and adjoints, and dual numbers.
//!
//! Some steps of every method with a gradient, the last one shorter, are run from the start and from one where all parameters p are changed by
//! h δp: stiffnesses, rest lengths, dampings, masses, gravity, loads, positions and velocities at once. Of a cost J, linear in the states in the
//! middle and at the end, with its gradient g,
//!
//! ```text
//! J(p + h δp) − J(p) = O(h),      J(p + h δp) − J(p) − h g·δp = O(h²).
//! ```
//!
//! **The window of h.** Remainders at h = 2⁻³⁰ are rounding: with δp scaled by the parameters the second order leaves 10⁻¹⁸ of J. The four
//! halvings end where remainders are 64 times that large, so that the order is off by at most log₂(1 + 1/32), and the smallest wrong
//! part of g is most visible: one of some 10⁻⁶ costs an order.
//!
//! **Tangents and adjoints.** A step solves `J d = b` for the tangent d, and `Jᵀ λ = c` for the adjoint λ. With residuals r and s of the
//! computed ones `c·d − λ·b = λ·r − s·d`: backward stable solves leave `30 u ‖J‖` of `‖λ‖ ‖d‖` each, which is at most the condition number
//! times the product.
//!
//! **Dual numbers.** Tangents as the dual parts of the states solve the steps' equations, written a second time: their dual parts vanish but
//! for rounding.

use super::TestCase;
use super::check::{Check, Claim, Measured, Unfinished, ratio, worst};
use super::convergence::{ErrorCurve, order_checks};
use super::force_error::U;
use super::free_coordinates::random_vector;
use super::reference;
use crate::error::{Error, Result};
use crate::gradient::{Cotangent, DifferentiableRun, Parameters};
use crate::integrate::Method;
use crate::system::{Axes, Loads, State, System};
use nalgebra::Vector3;
use num_dual::{Dual64, DualNum};

/// Length of the runs in steps: three and a shorter one, so that bdf2 meets unequal steps.
const LENGTH: f64 = 3.6;

/// The part of the parameters at which remainders are rounding, and the largest that moves no spring by an eighth of its length.
const FINEST: f64 = 1.0 / (1u64 << 30) as f64;
const COARSEST: f64 = 1.0 / 8.0;

/// Multiples of rounding that count as resolved, and the halvings of a window.
const RESOLVED: f64 = 64.0;
const HALVINGS: i32 = 4;

/// Degrees of freedom up to which every method is run.
const AFFORDABLE: usize = 2000;

/// A run, the direction along which its parameters change, and the cost.
struct Subject<'c> {
    case: &'c TestCase,
    method: Method,
    dt: f64,
    change: Parameters,
    run: DifferentiableRun<'c>,
    cost: Vec<Cotangent>,
}

/// The methods of a case; in place of one whose run is refused or breaks down, the reason.
fn subjects(case: &TestCase) -> impl Iterator<Item = (Method, Result<Subject<'_>>)> {
    let all = [Method::Verlet, Method::BackwardEuler, Method::ImplicitMidpoint, Method::Bdf2];
    let affordable = if case.system.dofs().len() <= AFFORDABLE { 4 } else { 2 };
    all.into_iter().take(affordable).map(|method| (method, Subject::new(case, method)))
}

impl<'c> Subject<'c> {
    fn new(case: &'c TestCase, method: Method) -> Result<Self> {
        let TestCase { system, state, .. } = case;
        let dt = case.dt.min(case.resolving_step());
        let run = DifferentiableRun::new(system, state, method, dt, LENGTH * dt)?;
        let n = system.particles();
        let vectors = |seed| random_vectors(system, seed);
        // A velocity counts by the way that it goes in the run.
        let cotangent = |step: usize| Cotangent {
            step,
            positions: vectors(step as u64),
            velocities: on_free_axes(system, vectors(9 + step as u64)).iter().map(|v| v * (LENGTH * dt)).collect(),
        };
        let mut lengths = vec![f64::INFINITY; n];
        for link in reference::links(system, &state.positions) {
            link.ends.iter().for_each(|&p| lengths[p] = lengths[p].min(link.length).min(link.rest_length));
        }
        lengths.iter_mut().filter(|length| length.is_infinite()).for_each(|length| *length = case.extent());
        let shortest = lengths.iter().copied().fold(f64::INFINITY, f64::min);
        let scaled = |seed, scale: &dyn Fn(usize) -> f64| -> Vec<Vector3<f64>> {
            vectors(seed).iter().enumerate().map(|(p, v)| v * (0.25 * scale(p))).collect()
        };
        let random = |seed, values: &mut dyn Iterator<Item = f64>| -> Vec<f64> {
            let values: Vec<f64> = values.collect();
            random_vector(values.len(), seed).iter().zip(values).map(|(r, value)| 0.5 * r * value).collect()
        };
        let time = LENGTH * dt;
        let springs = || system.springs().iter();
        let change = Parameters {
            stiffness: random(21, &mut springs().map(|spring| spring.stiffness)),
            rest_lengths: random(22, &mut springs().map(|spring| spring.rest_length)),
            damping: random(23, &mut springs().map(|spring| spring.damping)),
            masses: random(24, &mut system.masses().iter().copied()),
            gravity: scaled(25, &|_| shortest / (time * time))[0],
            loads: scaled(26, &|p| system.masses()[p] * lengths[p] / (time * time)),
            positions: scaled(27, &|p| lengths[p]),
            velocities: on_free_axes(system, scaled(28, &|p| lengths[p] / time)),
        };
        let cost = vec![cotangent(run.steps() / 2), cotangent(run.steps())];
        Ok(Self { case, method, dt, change, run, cost })
    }

    /// J with the parameters changed by h δp, less J.
    fn difference(&self, h: f64) -> Result<f64> {
        let Self { case, change, run, .. } = self;
        let mut builder = case.description();
        for (s, spring) in builder.springs.iter_mut().enumerate() {
            spring.stiffness += h * change.stiffness[s];
            spring.rest_length += h * change.rest_lengths[s];
            spring.damping += h * change.damping[s];
        }
        let add = |to: &mut [Vector3<f64>], from: &[Vector3<f64>]| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from * h);
        };
        builder.masses.iter_mut().zip(&change.masses).for_each(|(mass, more)| *mass += h * more);
        builder.gravity += change.gravity * h;
        add(&mut builder.positions, &change.positions);
        add(&mut builder.velocities, &change.velocities);
        let (system, state) = builder.build()?;
        let forces = change.loads.iter().map(|load| load * h).collect();
        let system = system.with_loads(Loads { forces, ..Loads::default() })?;
        let moved = DifferentiableRun::new(&system, &state, self.method, self.dt, LENGTH * self.dt)?;
        let states: Vec<[&State; 2]> = moved.states().zip(run.states()).map(|(moved, state)| [moved, state]).collect();
        let rise = |cotangent: &Cotangent| {
            let [moved, state] = states[cotangent.step];
            let rise = |weights: &[Vector3<f64>], after: &[Vector3<f64>], before: &[Vector3<f64>]| -> f64 {
                weights.iter().zip(after).zip(before).map(|((c, after), before)| c.dot(&(after - before))).sum()
            };
            rise(&cotangent.positions, &moved.positions, &state.positions)
                + rise(&cotangent.velocities, &moved.velocities, &state.velocities)
        };
        Ok(self.cost.iter().map(rise).sum())
    }

    /// The remainders without and with the gradient over the halvings of the window; the reason where there is none.
    fn remainders(&self) -> Result<Result<[ErrorCurve; 2], String>> {
        let slope = self.run.gradient(&self.cost)?.dot(&self.change);
        let remainders = |h: f64| -> Result<[f64; 2]> {
            let rise = self.difference(h)?;
            Ok([rise.abs(), (rise - h * slope).abs()])
        };
        let mut rounding = 0.0_f64;
        for part in [1.0, -1.0, 0.75, -0.75] {
            rounding = worst([rounding, remainders(part * FINEST)?[1]]);
        }
        // The largest h of the finest end.
        let most = COARSEST / f64::from(1 << HALVINGS);
        let coarse = remainders(most)?[1];
        if !(coarse > RESOLVED * rounding) {
            return Ok(Err(
                "the cost is linear in the parameters to rounding: there is no remainder to be measured".into()
            ));
        }
        let mut h = (most * (RESOLVED * rounding / coarse).sqrt()).max(FINEST);
        while h < most && remainders(h)?[1] < 0.5 * RESOLVED * rounding {
            h = (2.0 * h).min(most);
        }
        let mut points = [Vec::new(), Vec::new()];
        for halving in (0..=HALVINGS).rev() {
            let h = h * f64::from(1 << halving);
            points.iter_mut().zip(remainders(h)?).for_each(|(points, remainder)| points.push((h, remainder)));
        }
        let [first, second] = points;
        let curve = |words: &str, order, points| ErrorCurve {
            method: format!("{words}, {}", self.method.name()),
            order,
            points,
        };
        Ok(Ok([curve("without gradient", 1, first), curve("with gradient", 2, second)]))
    }
}

/// Remainders of Taylor's theorem.
pub(super) fn remainders(case: &TestCase) -> Measured {
    let (mut curves, mut checks) = (Vec::new(), Vec::new());
    for (method, subject) in subjects(case) {
        let found = subject.and_then(|subject| subject.remainders());
        match allowed(found)?.and_then(|found| found) {
            Ok([first, second]) => {
                curves.push(first);
                // A remainder that falls faster, because the second derivative vanishes, is no fault.
                match second.unclear() {
                    Some(reason) if second.observed() > 2.0 => checks.push(not_judged(
                        case,
                        Claim::Convergence,
                        &format!("Taylor remainder, {}", second.method),
                        reason,
                    )),
                    _ => curves.push(second),
                }
            }
            Err(reason) => checks.push(not_judged(
                case,
                Claim::Convergence,
                &format!("Taylor remainder, {}", method.name()),
                reason,
            )),
        }
    }
    let mut orders = order_checks("Taylor remainder", &case.name, "remainder of J", curves);
    orders.iter_mut().flat_map(|check| &mut check.curves).for_each(|plot| plot.x.title = "h".into());
    checks.extend(orders);
    Ok(checks)
}

/// Tangents against adjoints, and against dual numbers.
pub(super) fn tangents(case: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for (method, subject) in subjects(case) {
        match allowed(subject.and_then(|subject| subject.tangents()))? {
            Ok(found) => checks.extend(found),
            Err(reason) => {
                checks.push(not_judged(case, Claim::Consistency, &format!("tangents, {}", method.name()), reason))
            }
        }
    }
    Ok(checks)
}

type Dual3 = Vector3<Dual64>;

/// Positions and velocities with their tangents as dual parts.
type DualState = [Vec<Dual3>; 2];

fn dual(value: &Vector3<f64>, change: &Vector3<f64>) -> Dual3 {
    value.zip_map(change, Dual64::new)
}

fn dual_part(value: &Dual3) -> Vector3<f64> {
    value.map(|component| component.eps)
}

impl Subject<'_> {
    fn tangents(&self) -> Result<[Check; 2]> {
        let Self { case, method, run, .. } = self;
        let steps: Vec<usize> = (0..=run.steps()).collect();
        let changes = run.tangents(std::slice::from_ref(&self.change), &steps)?.swap_remove(0);
        let gradient = run.gradient(&self.cost)?;
        let (mut forward, mut size) = (0.0, 0.0);
        for cotangent in &self.cost {
            let [x, v] = &changes[cotangent.step];
            for (c, d) in cotangent.positions.iter().chain(&cotangent.velocities).zip(x.iter().chain(v)) {
                forward += c.dot(d);
                size += c.abs().dot(&d.abs());
            }
        }
        let backward = gradient.dot(&self.change);
        size += magnitude(&gradient).dot(&magnitude(&self.change));
        let name = |what: &str| format!("{what}, {}", method.name());
        let lightest = reference::lightest(&case.system) / (self.dt * self.dt);
        let condition = reference::step_matrix_norm(case, &case.state, self.dt) / lightest;
        let why = format!(
            "of the sum of magnitudes: a backward stable solve a step, 30 u, times the condition number of A, at most {condition:.1e}"
        );
        let bound = 30.0 * U * run.steps() as f64 * condition;
        let error = ratio((forward - backward).abs(), size);
        let dot = Check::new(Claim::Consistency, name("tangent against adjoint"), &case.name, error, bound, why);
        let why = "in units of rounding, u (‖A‖ ‖δx‖ + ‖b‖) in the maximum norm: 30 of a backward stable solve, 80 of the force of a \
                   damper, and one for each spring of a particle";
        let mut springs = vec![0u32; case.system.particles()];
        case.system.active().for_each(|(_, ends, _)| ends.into_iter().for_each(|p| springs[p] += 1));
        let bound = 110.0 + f64::from(springs.into_iter().max().unwrap_or(0));
        let states = run.states().zip(&changes).map(|(state, [x, v])| {
            let dual = |values: &[Vector3<f64>], changes: &[Vector3<f64>]| {
                values.iter().zip(changes).map(|(x, d)| dual(x, d)).collect()
            };
            [dual(&state.positions, x), dual(&state.velocities, v)]
        });
        let states: Vec<DualState> = states.collect();
        let error = self.dual_residual(&states);
        Ok([dot, Check::new(Claim::Consistency, name("tangent against dual numbers"), &case.name, error, bound, why)])
    }

    /// The largest dual part of what is left of the equations of the steps, in units of rounding.
    fn dual_residual(&self, states: &[DualState]) -> f64 {
        let system = &self.case.system;
        let masses: Vec<Dual64> =
            system.masses().iter().zip(&self.change.masses).map(|(&m, &d)| Dual64::new(m, d)).collect();
        let mut carried = (self.method == Method::Verlet).then(|| self.forces(&states[0][0], &states[0][1]));
        let (mut value, mut last) = (0.0, 0.0);
        for step in 1..states.len() {
            let [[x, v], [x_end, v_end]] = [&states[step - 1], &states[step]];
            let h =
                if step + 1 < states.len() { self.dt } else { LENGTH * self.dt - self.dt * (states.len() - 2) as f64 };
            let ahead = |now: &[Dual3], before: &[Dual3], beta: f64| -> Vec<Dual3> {
                now.iter().zip(before).map(|(now, before)| now + (now - before) * Dual64::from(beta)).collect()
            };
            // The step of a core from (x̃, ṽ) to (x, v), of which F is taken at (x, w).
            let (mut tau, mut from, mut to) = (h, [x.clone(), v.clone()], [x_end.clone(), v_end.clone()]);
            match self.method {
                Method::ImplicitMidpoint => (tau, to) = (0.5 * h, self.middle(step - 1, h, states)),
                Method::Bdf2 if step > 1 => {
                    let omega: f64 = h / last;
                    let beta = omega * omega / (1.0 + 2.0 * omega);
                    tau = h * (1.0 + omega) / (1.0 + 2.0 * omega);
                    from = [ahead(x, &states[step - 2][0], beta), ahead(v, &states[step - 2][1], beta)];
                }
                _ => {}
            }
            last = h;
            let [t, squared, two] = [tau, tau * tau, 2.0].map(Dual64::from);
            let (forces, next) = match &carried {
                None => {
                    let w: Vec<Dual3> = to[0].iter().zip(&from[0]).map(|(x, before)| (x - before) / t).collect();
                    (self.forces(&to[0], &w), None)
                }
                Some(forces) => {
                    let predicted = |p: usize| {
                        let free = system.dofs().free_axes(p);
                        let a = forces[p].0 / masses[p];
                        Vector3::from_fn(
                            |axis, _| if free.contains(axis) { v[p][axis] + a[axis] * h } else { v_end[p][axis] },
                        )
                    };
                    let predicted: Vec<Dual3> = (0..masses.len()).map(predicted).collect();
                    (forces.clone(), Some(self.forces(x_end, &predicted)))
                }
            };
            let (mut left, mut size) = (0.0_f64, 0.0_f64);
            for (p, &m) in masses.iter().enumerate() {
                let (free, scale) = (system.dofs().free_axes(p), Dual64::from(m.re));
                // Verlet: x' − x − h v = ½ h² a, v' − v = ½ h (a + a'); else the core's equation and the velocity that goes with it.
                let moved = (to[0][p] - from[0][p] - from[1][p] * t) / squared;
                let (force, bound) = forces[p];
                let [first, second] = match &next {
                    Some(next) => {
                        let [a, b] = [force, next[p].0].map(|force| force / m);
                        [(moved * two - a) * scale, ((v_end[p] - v[p]) / t - (a + b) / two) * scale]
                    }
                    None => [moved * m - force, (to[1][p] - (to[0][p] - from[0][p]) / t) * (scale / t)],
                };
                for axis in free.iter() {
                    left = worst([left, first[axis].eps.abs(), second[axis].eps.abs()]);
                }
                let norms = [&to[0][p], &from[0][p]].map(|x| dual_part(x).norm()).iter().sum::<f64>()
                    + tau * [&to[1][p], &from[1][p]].map(|v| dual_part(v).norm()).iter().sum::<f64>();
                let inertia = 2.0 * moved.map(|component| component.re).norm() * m.eps.abs();
                if free != Axes::NONE {
                    size = worst([
                        size,
                        m.re / (tau * tau) * norms + inertia + bound + next.as_ref().map_or(0.0, |next| next[p].1),
                    ]);
                }
            }
            value = worst([value, ratio(left, U * size)]);
            carried = next;
        }
        value
    }

    /// The state in the middle of a step: the mean of its ends, prescribed coordinates where they are then.
    fn middle(&self, step: usize, h: f64, states: &[DualState]) -> DualState {
        let system = &self.case.system;
        let mut middle = self.case.state.clone();
        middle.time += step as f64 * self.dt + 0.5 * h;
        middle.prescribe(system);
        let mean = |part: usize, prescribed: &[Vector3<f64>]| {
            let of = |p: usize| {
                let [before, after] = [&states[step][part][p], &states[step + 1][part][p]];
                let free = system.dofs().free_axes(p);
                Vector3::from_fn(|axis, _| match free.contains(axis) {
                    true => (after[axis] + before[axis]) * 0.5,
                    false => Dual64::new(prescribed[p][axis], before[axis].eps),
                })
            };
            (0..prescribed.len()).map(of).collect()
        };
        [mean(0, &middle.positions), mean(1, &middle.velocities)]
    }

    /// F on every particle, from the formulas of one spring, and the size of the terms of its dual part.
    fn forces(&self, x: &[Dual3], v: &[Dual3]) -> Vec<(Dual3, f64)> {
        let Self { case: TestCase { system, .. }, change, .. } = self;
        let gravity = dual(&system.gravity(), &change.gravity);
        let weight = |(p, &mass): (usize, &f64)| {
            let load = &change.loads[p];
            let size = mass * change.gravity.norm() + change.masses[p].abs() * system.gravity().norm() + load.norm();
            (gravity * Dual64::new(mass, change.masses[p]) + dual(&Vector3::zeros(), load), size)
        };
        let mut forces: Vec<(Dual3, f64)> = system.masses().iter().enumerate().map(weight).collect();
        for (s, [i, j], spring) in system.active() {
            let k = Dual64::new(spring.stiffness, change.stiffness[s]);
            let rest = Dual64::new(spring.rest_length, change.rest_lengths[s]);
            let b = Dual64::new(spring.damping, change.damping[s]);
            let (d, w) = (x[i] - x[j], v[i] - v[j]);
            let l = d.dot(&d).sqrt();
            let n = d / l;
            let f = n * (-(l / rest - 1.0) * k - n.dot(&w) * b);
            let [turned, faster] = [&d, &w].map(|vector| dual_part(vector).norm());
            let stretch = (l.re / rest.re).max(1.0);
            let speed = w.map(|component| component.re).norm();
            let size = k.re * (1.0 / rest.re + 1.0 / l.re) * turned
                + stretch * (k.eps.abs() + k.re * (rest.eps / rest.re).abs())
                + b.re * (speed * turned / l.re + faster)
                + b.eps.abs() * speed;
            for (end, sign) in [(i, 1.0), (j, -1.0)] {
                forces[end].0 += f * Dual64::from(sign);
                forces[end].1 += size;
            }
        }
        forces
    }
}

/// The absolute values of all parameters.
fn magnitude(parameters: &Parameters) -> Parameters {
    let scalars = |values: &[f64]| values.iter().map(|value| value.abs()).collect();
    let vectors = |values: &[Vector3<f64>]| values.iter().map(|value| value.abs()).collect();
    Parameters {
        stiffness: scalars(&parameters.stiffness),
        rest_lengths: scalars(&parameters.rest_lengths),
        damping: scalars(&parameters.damping),
        masses: scalars(&parameters.masses),
        gravity: parameters.gravity.abs(),
        loads: vectors(&parameters.loads),
        positions: vectors(&parameters.positions),
        velocities: vectors(&parameters.velocities),
    }
}

fn not_judged(case: &TestCase, claim: Claim, name: &str, reason: String) -> Check {
    Check::not_judged(claim, name, &case.name, reason)
}

/// What was found, or the reason for a method or a step that reports that it cannot do it.
fn allowed<T>(found: Result<T>) -> Result<Result<T, String>, Unfinished> {
    match found {
        Ok(found) => Ok(Ok(found)),
        Err(reported @ (Error::Unsupported(_) | Error::Breakdown { .. })) => Ok(Err(reported.to_string())),
        Err(other) => Err(other.into()),
    }
}

fn random_vectors(system: &System, seed: u64) -> Vec<Vector3<f64>> {
    let numbers = random_vector(3 * system.particles(), seed);
    let along = |v: &[f64]| Vector3::from_fn(|axis, _| if axis < system.dimension() { v[axis] } else { 0.0 });
    numbers.chunks_exact(3).map(along).collect()
}

fn on_free_axes(system: &System, vectors: Vec<Vector3<f64>>) -> Vec<Vector3<f64>> {
    let free = |(p, v): (usize, Vector3<f64>)| {
        Vector3::from_fn(|axis, _| if system.dofs().free_axes(p).contains(axis) { v[axis] } else { 0.0 })
    };
    vectors.into_iter().enumerate().map(free).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "scene")]
    #[test]
    fn zz_print() {
        for case in crate::verify::built_in().unwrap() {
            let begun = std::time::Instant::now();
            for check in [tangents(&case), remainders(&case)].into_iter().flat_map(|c| c.unwrap()) {
                if check.is_judged {
                    println!(
                        "{:5} {:9.2e} of {:9.2e} {}, {}",
                        check.passed(),
                        check.value,
                        check.bound,
                        check.scene,
                        check.name
                    );
                    if let Some(p) = check.curves.first() {
                        if !check.passed() {
                            println!("{:?}", p.series.iter().map(|s| (&s.name, &s.points)).collect::<Vec<_>>());
                        }
                    }
                } else {
                    println!("----- {}, {}: {}", check.scene, check.name, check.why);
                }
            }
            println!("{:?} {} {}", begun.elapsed(), case.name, case.system.dofs().len());
        }
    }
}
