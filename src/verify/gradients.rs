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
//! halvings end where remainders are 64 times that, and what Newton's method leaves, so that the order is off by at most log₂(1 + 1/32), and the smallest wrong
//! part of g is most visible: one of some 10⁻⁶ costs an order.
//!
//! **Tangents and adjoints.** A step solves `J d = b` for the tangent d, and `Jᵀ λ = c` for the adjoint λ. With residuals r and s of the computed
//! ones `c·d − λ·b = λ·r − s·d`: backward stable solves leave `30 u ‖J‖` of `‖λ‖ ‖d‖` each, which is at most the condition number times the product.

use super::{
    AFFORDABLE, Check, Claim, ErrorCurve, Measured, TestCase, U, order_checks, random_vector, ratio, reference, worst,
};
use crate::error::{Error, Result};
use crate::force::SpringGeometry;
use crate::gradient::{Cotangent, DifferentiableRun, Parameters, Point, of_free};
use crate::integrate::Method;
use crate::interrupt::Interrupt;
use crate::spring::Spring;
use crate::system::{Axes, Loads, State, System};
use nalgebra::Vector3;
use num_dual::{Dual64, DualNum};

/// Length of the runs in steps: three and a shorter one, so that bdf2 meets unequal steps.
const LENGTH: f64 = 3.6;

/// States that are kept, more than there are.
const ROOM: usize = 8;

/// The part of the parameters at which remainders are rounding, and the largest that moves no spring by an eighth of its length.
const FINEST: f64 = 1.0 / (1u64 << 30) as f64;
const COARSEST: f64 = 1.0 / 8.0;

/// Multiples of rounding that count as resolved, and the halvings of a window.
const RESOLVED: f64 = 64.0;
const HALVINGS: i32 = 4;

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

fn run<'s>(system: &'s System, state: &State, method: Method, dt: f64) -> Result<DifferentiableRun<'s>> {
    DifferentiableRun::interruptible(system, state, method, [dt, LENGTH * dt], Some(ROOM), Interrupt::NEVER)
}

impl<'c> Subject<'c> {
    fn new(case: &'c TestCase, method: Method) -> Result<Self> {
        let TestCase { system, state, .. } = case;
        let dt = case.dt.min(case.resolving_step());
        let time = LENGTH * dt;
        let run = run(system, state, method, dt)?;
        let vectors = |seed| random_vectors(system, seed);
        // A velocity counts by the way that it goes in the run.
        let cotangent = |step: usize| Cotangent {
            step,
            positions: vectors(step as u64),
            velocities: of_free(system, &vectors(9 + step as u64)).iter().map(|v| v * time).collect(),
        };
        let mut lengths = vec![f64::INFINITY; system.particles()];
        for link in reference::links(system, &state.positions) {
            let length = if link.rest_length > 0.0 { link.length.min(link.rest_length) } else { link.length };
            link.ends.iter().for_each(|&p| lengths[p] = lengths[p].min(length));
        }
        lengths.iter_mut().filter(|length| length.is_infinite()).for_each(|length| *length = case.extent());
        let shortest = lengths.iter().copied().fold(f64::INFINITY, f64::min);
        let scaled = |seed, scale: &dyn Fn(usize) -> f64| -> Vec<Vector3<f64>> {
            vectors(seed).iter().enumerate().map(|(p, v)| v * (0.25 * scale(p))).collect()
        };
        let random = |seed, values: Vec<f64>| -> Vec<f64> {
            random_vector(values.len(), seed).iter().zip(values).map(|(r, value)| 0.5 * r * value).collect()
        };
        let springs = || system.springs().iter();
        let change = Parameters {
            stiffness: random(21, springs().map(|spring| spring.stiffness).collect()),
            rest_lengths: random(22, springs().map(|spring| spring.rest_length).collect()),
            damping: random(23, springs().map(|spring| spring.damping).collect()),
            masses: random(24, system.masses().to_vec()),
            gravity: scaled(25, &|_| shortest / (time * time))[0],
            loads: scaled(26, &|p| system.masses()[p] * lengths[p] / (time * time)),
            positions: scaled(27, &|p| lengths[p]),
            velocities: of_free(system, &scaled(28, &|p| lengths[p] / time)),
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
        let moved = self::run(&system, &state, self.method, self.dt)?;
        let rise = |weights: &[Vector3<f64>], after: &[Vector3<f64>], before: &[Vector3<f64>]| -> f64 {
            weights.iter().zip(after).zip(before).map(|((c, after), before)| c.dot(&(after - before))).sum()
        };
        let rises = self.cost.iter().map(|Cotangent { step, positions, velocities }| {
            let (Some(moved), Some(state)) = (moved.states().nth(*step), run.states().nth(*step)) else {
                return f64::NAN;
            };
            rise(positions, &moved.positions, &state.positions) + rise(velocities, &moved.velocities, &state.velocities)
        });
        Ok(rises.sum())
    }

    /// What Newton's method may leave of the equations, `r = 10⁻¹³ F + u ‖A‖ ‖x‖` with the norm F of the forces and the rounding of positions,
    /// moves J by `Σ |c| r τ²/m`, as A ≥ M/τ² where steps resolve all vibrations: in every step, and twice for the states before and after a change.
    fn solves(&self) -> f64 {
        let Self { case, run, cost, .. } = self;
        let TestCase { system, state, .. } = case;
        if self.method == Method::Verlet {
            return 0.0;
        }
        let pull = reference::pull(&reference::links(system, &state.positions), system.particles());
        let force = |p: usize| {
            let speed = state.velocities[p].norm() / self.dt + system.gravity().norm();
            (pull[p] + system.masses()[p] * speed).powi(2)
        };
        let force = reference::movers(system).map(force).sum::<f64>().sqrt();
        let positions = state.positions.iter().map(|x| x.norm_squared()).sum::<f64>().sqrt();
        let left = 1e-13 * force + U * reference::step_matrix_norm(case, state, self.dt) * positions;
        let moved = |cotangent: &Cotangent| -> f64 {
            let weight = |p: usize| {
                let [x, v] = [&cotangent.positions, &cotangent.velocities].map(|c| c[p].lp_norm(1));
                (x + v / self.dt) / system.masses()[p]
            };
            reference::movers(system).map(weight).sum()
        };
        let moved: f64 = cost.iter().map(moved).sum();
        2.0 * run.steps() as f64 * left * self.dt * self.dt * moved
    }

    /// The rounding of the states in J, once: samples of differences may all be smaller by chance.
    fn rounding(&self) -> f64 {
        let of = |Cotangent { step, positions, velocities }: &Cotangent| {
            let state = self.run.states().nth(*step)?;
            let pairs = positions.iter().zip(&state.positions).chain(velocities.iter().zip(&state.velocities));
            Some(pairs.map(|(c, x)| c.abs().dot(&x.abs())).sum::<f64>())
        };
        U * self.cost.iter().filter_map(of).sum::<f64>()
    }

    fn slope(&self) -> Result<f64> {
        Ok(self.run.gradient(&self.cost)?.dot(&self.change))
    }

    /// The remainders without and with the gradient over the halvings of the window; the reason where there is none.
    fn remainders(&self, slope: f64) -> Result<Result<[ErrorCurve; 2], String>> {
        let remainders = |h: f64| -> Result<[f64; 2]> {
            let rise = self.difference(h)?;
            Ok([rise.abs(), (rise - h * slope).abs()])
        };
        let mut rounding = self.solves() + self.rounding();
        for part in [1.0, -1.0, 0.75, -0.75] {
            rounding = worst([rounding, remainders(part * FINEST)?[1]]);
        }
        // The largest h of the finest end.
        let most = COARSEST / f64::from(1 << HALVINGS);
        let coarse = remainders(most)?[1];
        if coarse <= RESOLVED * rounding {
            return Ok(Err("no remainder is 64 times as large as rounding and what Newton's method leaves".into()));
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
        let name = |words: &str| format!("{words}, {}", self.method.name());
        Ok(Ok([
            ErrorCurve { method: name("without gradient"), order: 1, points: first },
            ErrorCurve { method: name("with gradient"), order: 2, points: second },
        ]))
    }
}

pub(super) fn remainders(case: &TestCase) -> Measured {
    let (mut curves, mut checks) = (Vec::new(), Vec::new());
    for (method, subject) in subjects(case) {
        let not_judged = |method: &str, reason: String| {
            Check::not_judged(Claim::Convergence, format!("Taylor remainder, {method}"), &case.name, reason)
        };
        let found = subject.and_then(|subject| subject.remainders(subject.slope()?));
        match allowed(found)?.and_then(|found| found) {
            Ok([first, second]) => {
                curves.push(first);
                // A remainder that falls faster, or changes its sign at larger h where terms cancel, is no fault. With a wrong gradient slopes fall
                // towards 1.
                match second.unclear() {
                    Some(reason) if second.observed() > 2.0 || second.approaches() => {
                        checks.push(not_judged(&second.method, reason))
                    }
                    _ => curves.push(second),
                }
            }
            Err(reason) => checks.push(not_judged(method.name(), reason)),
        }
    }
    let mut orders = order_checks("Taylor remainder", &case.name, "remainder of J", curves);
    orders.iter_mut().flat_map(|check| &mut check.curves).for_each(|plot| plot.x.title = "h".into());
    let time = LENGTH * case.dt.min(case.resolving_step());
    checks.extend(orders.into_iter().map(|check| check.unless(|| case.passing(time))));
    Ok(checks)
}

pub(super) fn adjoints(case: &TestCase) -> Measured {
    let mut checks = vec![force_adjoint(case)?];
    for (method, subject) in subjects(case) {
        let name = format!("tangent against adjoint, {}", method.name());
        checks.push(match allowed(subject.and_then(|subject| subject.dot_product(&name)))? {
            Ok(found) => found,
            Err(reason) => Check::not_judged(Claim::Consistency, name, &case.name, reason),
        });
    }
    Ok(checks)
}

impl Subject<'_> {
    fn dot_product(&self, name: &str) -> Result<Check> {
        let Self { case, run, .. } = self;
        let steps: Vec<usize> = self.cost.iter().map(|cotangent| cotangent.step).collect();
        let changes = run.tangents(std::slice::from_ref(&self.change), &steps)?.swap_remove(0);
        let gradient = run.gradient(&self.cost)?;
        let (mut forward, mut size) = (0.0, gradient.sum_with(&self.change, |a, b| (a * b).abs()));
        // In the derivatives by masses, δm λ·(a − g), the weight of a free fall cancels its acceleration.
        let masses = self.change.masses.iter().zip(case.system.masses());
        let lighter = masses.map(|(change, mass)| (change / mass).abs()).fold(0.0, f64::max);
        size += lighter * gradient.gravity.abs().dot(&case.system.gravity().abs());
        for (cotangent, [x, v]) in self.cost.iter().zip(&changes) {
            for (c, d) in cotangent.positions.iter().chain(&cotangent.velocities).zip(x.iter().chain(v)) {
                forward += c.dot(d);
                size += c.abs().dot(&d.abs());
            }
        }
        let lightest = reference::lightest(&case.system) / (self.dt * self.dt);
        let condition = reference::step_matrix_norm(case, &case.state, self.dt) / lightest;
        let why = format!(
            "of the sum of magnitudes: a backward stable solve a step, 30 u, times the condition number of A, at most {condition:.1e}"
        );
        let value = ratio((forward - gradient.dot(&self.change)).abs(), size);
        let bound = 30.0 * U * run.steps() as f64 * condition;
        let check = Check::new(Claim::Consistency, name, &case.name, value, bound, why);
        Ok(check.unless(|| case.passing(LENGTH * self.dt)))
    }
}

/// `λ·∂F` by every parameter of a spring, by positions and by velocities, for random λ and velocities.
fn force_adjoint(case: &TestCase) -> Measured<Check> {
    let TestCase { system, state, .. } = case;
    let geometry = SpringGeometry::at(system, state)?;
    let (adjoint, velocities) = (random_vectors(system, 31), random_vectors(system, 32));
    let mut found = Parameters::zeros(system);
    let at = Point { geometry: &geometry, velocities: &velocities, time: state.time };
    let changes = found.add_force_adjoint(system, &at, &adjoint);
    // By positions and velocities, and 1 for each.
    let zeros = || vec![(Vector3::<f64>::zeros(), 0.0); system.particles()];
    let (mut expected, mut value) = ([zeros(), zeros()], 0.0);
    for link in reference::active_links(system, &state.positions) {
        let (s, d, l) = (link.index, link.separation, link.length);
        let Spring { stiffness: k, rest_length: rest, damping: b } = system.springs()[s];
        let [w, u] = [&velocities, &adjoint].map(|vectors| link.difference(vectors));
        let has_rest_length = rest > 0.0;
        let derivative = |seed: usize| {
            let mut inputs = [k, rest, b, d.x, d.y, d.z, w.x, w.y, w.z].map(Dual64::from);
            inputs[seed].eps = 1.0;
            let [k, rest, b, dx, dy, dz, wx, wy, wz] = inputs;
            let l = (dx * dx + dy * dy + dz * dz).sqrt();
            let rate = (dx * wx + dy * wy + dz * wz) / l;
            let strain = if has_rest_length { l / rest - 1.0 } else { l };
            ((-strain * k - rate * b) * (dx * u.x + dy * u.y + dz * u.z) / l).eps
        };
        let of_stiffness = if has_rest_length { (l / rest).max(1.0) } else { l };
        let of_length = if has_rest_length { k * l / (rest * rest) } else { 0.0 };
        let units = [of_stiffness, of_length, w.norm()].map(|size| 30.0 * U * size * u.norm());
        let of_spring = [found.stiffness[s], found.rest_lengths[s], found.damping[s]];
        for (seed, (found, unit)) in of_spring.into_iter().zip(units).enumerate() {
            value = worst([value, ratio((found - derivative(seed)).abs(), unit)]);
        }
        let units = [24.0 * U * link.magnitude() + 80.0 * U * b * w.norm() / l, 30.0 * U * b];
        for (part, (sums, unit)) in expected.iter_mut().zip(units).enumerate() {
            let change = Vector3::from_fn(|axis, _| derivative(3 + 3 * part + axis));
            for (end, sign) in link.ends.into_iter().zip([1.0, -1.0]) {
                sums[end].0 += change * sign;
                sums[end].1 += unit * u.norm();
            }
        }
    }
    for (found, expected) in changes.iter().zip(&expected) {
        for (found, (expected, unit)) in found.iter().zip(expected) {
            value = worst([value, ratio((found - expected).amax(), *unit)]);
        }
    }
    let why = "1 is rounding: 30 u of max(1, l/l0), k l/l0², |w| and b, 24 u (k/l0 + k/l) and 80 u b |w|/l of each spring, times |λ|";
    Ok(Check::new(Claim::Consistency, "adjoint of the force against dual numbers", &case.name, value, 1.0, why))
}

/// What was found, or the reason for a method or a step that reports that it cannot do it.
fn allowed<T>(found: Result<T>) -> Measured<Result<T, String>> {
    match found {
        Ok(found) => Ok(Ok(found)),
        Err(reported @ (Error::Unsupported(_) | Error::Breakdown { .. })) => Ok(Err(reported.to_string())),
        Err(other) => Err(other.into()),
    }
}

fn random_vectors(system: &System, seed: u64) -> Vec<Vector3<f64>> {
    let numbers = random_vector(3 * system.particles(), seed);
    let axes = Axes::first(system.dimension());
    numbers.chunks_exact(3).map(|v| axes.project(&Vector3::from_column_slice(v))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures::chain;

    /// One part in a thousand costs the order.
    #[test]
    fn a_wrong_slope_costs_an_order() {
        let case = chain(5, 0.02);
        for (method, subject) in subjects(&case) {
            let subject = subject.unwrap();
            for (factor, order) in [(1.0, 2.0), (1.0 + 1e-3, 1.0), (0.5, 1.0), (-1.0, 1.0)] {
                let [first, second] = subject.remainders(factor * subject.slope().unwrap()).unwrap().unwrap();
                assert!((first.observed() - 1.0).abs() < 0.2 && second.points.len() == 5);
                assert!((second.observed() - order).abs() < 0.2, "{} {factor}: {}", method.name(), second.observed());
            }
        }
    }

    /// Damping meets a moving constraint: not judged, with the reason.
    #[test]
    fn a_method_that_refuses_is_not_judged() {
        use crate::system::{Constraint, Motion};
        let mut builder = chain(3, 0.02).description();
        builder.constrain(Constraint { motion: Motion::Velocity(Vector3::x()), ..Constraint::hold([0]) });
        let moving = crate::verify::fixtures::case(builder, 0.02);
        for checks in [adjoints(&moving).unwrap(), remainders(&moving).unwrap()] {
            let refused: Vec<_> = checks.iter().filter(|check| !check.is_judged).collect();
            assert!(refused.len() == 1 && refused[0].why.contains("moving constraints"), "{checks:?}");
            assert!(checks.iter().all(|check| !check.is_judged || check.passed()));
        }
    }
}
