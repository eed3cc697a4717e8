//! Estimated global error of a run: the local errors of its steps, propagated by the linearised motion.
//!
//! With the linearised step Φ_n and its local error δ_n (numerical minus exact, leading term), the error after step n is `e_n = Φ_n e_{n−1} + δ_n`
//! (Skeel, Thirteen ways to estimate global error, Numer. Math. 48, 1986). It includes cancellation between steps, and the magnification of errors by
//! motions that fold, topple or are chaotic. The [`Monitor`](super::Monitor) updates it after every step.
//!
//! **δ** of methods without an embedded estimate follows from differences of the velocities. With the mean acceleration ā = (v' − v)/h of a step, its
//! first divided difference j (jerk) and its second s (snap),
//!
//! ```text
//! δ_x = α h² ā + β h³ j,      δ_v = α' h² j + β' h³ s,
//! ```
//!
//! with the coefficients [`LeadingTerm`] of the method's truncation error. The first jerk counts twice, for the step before too.
//!
//! **Φ** of implicit methods is a polynomial in the resolvent `w = (1 − τJ)⁻¹` of the matrix at hand, J the Jacobian of the motion: one solve each,
//! see [`LinearSystem::resolve`](super::implicit::LinearSystem::resolve). For explicit methods it is the difference quotient of the step itself, from
//! a state displaced by ε e: one more force evaluation for each of the step's. Beyond twice the extent of the scene e grows no further.

use super::norm_of_all;
use crate::force::{SpringGeometry, add_force_rate};
use crate::system::{Axes, State, StateView, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The leading term of a method's local error: coefficients of `h² ā` and `h³ j` in the positions, and of `h² j` and `h³ s` in the velocities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LeadingTerm {
    pub positions: [f64; 2],
    pub velocities: [f64; 2],
}

impl LeadingTerm {
    /// Backward Euler, linearised or solved: `x' = x + h v'`, `v' = v + h a'`.
    pub const BACKWARD_EULER: Self = Self { positions: [0.5, 0.0], velocities: [0.5, 0.0] };
    /// `x' = x + h v`, `v' = v + h a`.
    pub const FORWARD_EULER: Self = Self { positions: [-0.5, 0.0], velocities: [-0.5, 0.0] };
    /// `v' = v + h a`, `x' = x + h v'`.
    pub const SYMPLECTIC_EULER: Self = Self { positions: [0.5, 0.0], velocities: [-0.5, 0.0] };
    /// `x' = x + h v + ½h² a`, `v' = v + ½h (a + a')`.
    pub const VERLET: Self = Self { positions: [0.0, -1.0 / 6.0], velocities: [0.0, 1.0 / 12.0] };
    /// `R(z) = (1 + z/2)/(1 − z/2)`, which exceeds `e^z` by z³/12.
    pub const IMPLICIT_MIDPOINT: Self = Self::second_order(1.0 / 12.0);

    /// A method whose amplification exceeds `e^z` by `c z³`.
    pub const fn second_order(c: f64) -> Self {
        Self { positions: [0.0, c], velocities: [0.0, c] }
    }
}

/// A completed step.
#[derive(Debug, Clone, Copy)]
pub struct CompletedStep<'a> {
    /// The state at its start.
    pub before: &'a State,
    /// The state at its end.
    pub after: &'a State,
    /// Its length, in s.
    pub length: f64,
}

/// The estimated error of a run's positions, in m, and velocities, in m/s; see the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PropagatedError {
    #[serde(with = "rows")]
    pub(super) positions: Vec<Vector3<f64>>,
    #[serde(with = "rows")]
    pub(super) velocities: Vec<Vector3<f64>>,
    /// The rate at which the errors of velocities change, for Verlet's method.
    #[serde(with = "rows")]
    pub(super) accelerations: Vec<Vector3<f64>>,
    /// e one step earlier, for a method of two steps, or earlier in the same step.
    #[serde(with = "rows")]
    pub(super) positions_before: Vec<Vector3<f64>>,
    #[serde(with = "rows")]
    pub(super) velocities_before: Vec<Vector3<f64>>,
    /// δ of the step at hand.
    #[serde(with = "rows")]
    pub(super) local_positions: Vec<Vector3<f64>>,
    #[serde(with = "rows")]
    pub(super) local_velocities: Vec<Vector3<f64>>,
    /// ā and j of the last step, and the lengths of it and of the one before, in s; zero where there is none.
    #[serde(with = "rows")]
    mean_acceleration: Vec<Vector3<f64>>,
    #[serde(with = "rows")]
    pub(super) jerk: Vec<Vector3<f64>>,
    lengths: [f64; 2],
    /// `Σ ‖δ_x‖`, in m.
    sum: f64,
    /// `Σ ‖M ā − F(x', v')‖` and `Σ ‖M ā‖` over linearised steps, in N: forces left out, and forces balanced.
    left_out: f64,
    balanced: f64,
    /// The largest extent of the scene so far, in m.
    extent: f64,
}

/// Lists of vectors as rows of numbers.
pub mod rows {
    use nalgebra::Vector3;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(list: &[Vector3<f64>], to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(list.iter().map(|row| <[f64; 3]>::from(*row)))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Vector3<f64>>, D::Error> {
        Ok(Vec::<[f64; 3]>::deserialize(from)?.into_iter().map(Vector3::from).collect())
    }
}

impl PropagatedError {
    /// No error yet.
    pub fn none(system: &System) -> Self {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        Self {
            positions: zeros(),
            velocities: zeros(),
            accelerations: zeros(),
            positions_before: zeros(),
            velocities_before: zeros(),
            local_positions: zeros(),
            local_velocities: zeros(),
            mean_acceleration: zeros(),
            jerk: zeros(),
            lengths: [0.0; 2],
            sum: 0.0,
            left_out: 0.0,
            balanced: 0.0,
            extent: 0.0,
        }
    }

    /// It belongs to a system with as many particles.
    pub(super) fn fits(&self, system: &System) -> bool {
        let lists = [
            &self.positions,
            &self.velocities,
            &self.accelerations,
            &self.positions_before,
            &self.velocities_before,
            &self.local_positions,
            &self.local_velocities,
            &self.mean_acceleration,
            &self.jerk,
        ];
        lists.into_iter().all(|list| list.len() == system.particles())
    }

    /// ‖e_x‖ over all particles, in m: the estimated error of the positions. For a linearised step that leaves out λ > 0 times the forces that it
    /// balances, no less than √λ times the sum of local errors: transverse stiffness that brakes a motion brakes its error too.
    pub fn norm(&self, system: &System) -> f64 {
        let propagated = norm_of_all(system, &self.positions);
        if self.balanced == 0.0 { propagated } else { propagated.max(self.sum * self.left_out().sqrt().max(1.0)) }
    }

    /// `Σ ‖δ_x‖` over the steps, in m.
    pub fn sum_of_local_errors(&self) -> f64 {
        self.sum
    }

    /// λ, the forces that linearised steps left out over those that they balanced; zero for methods that solve their equations.
    pub fn left_out(&self) -> f64 {
        if self.balanced > 0.0 { self.left_out / self.balanced } else { 0.0 }
    }

    /// Changes ā and j of the last step, where the next one of h seconds from a state begins at a kink of gravity or rest lengths, by `−½ h₋ Δj` and
    /// Δj, Δj being the jump of the jerk `M⁻¹ ∂f/∂t`: as if forces had always changed as they do from now on.
    pub(super) fn pass_load_kinks(&mut self, system: &System, from: &State, h: f64) {
        let [last, _] = self.lengths;
        let [before, after] = [from.time - 0.5 * last, from.time + 0.5 * h];
        let kinks = system.prescribed().load_kinks();
        let is_smooth = kinks.partition_point(|&kink| kink <= before) == kinks.partition_point(|&kink| kink <= after);
        if last == 0.0 || is_smooth {
            return;
        }
        let Ok(extensions) = SpringGeometry::at(system, from) else { return };
        let [old, new] = [before, after].map(|time| {
            let mut rate = vec![Vector3::zeros(); system.particles()];
            add_force_rate(system, &extensions, &StateView { time, ..from.moment() }, &mut rate);
            rate
        });
        for (p, mass) in system.masses().iter().enumerate() {
            let jump = (new[p] - old[p]) / *mass;
            self.mean_acceleration[p] -= jump * (0.5 * last);
            self.jerk[p] += jump;
        }
    }

    /// Sets δ to the leading term of a method's local error in a step.
    pub(super) fn set_local(&mut self, system: &System, step: &CompletedStep, term: LeadingTerm) {
        let h = step.length;
        let [last, before_last] = self.lengths;
        let first = if before_last > 0.0 { 1.0 } else { 2.0 };
        let [x_a, x_j] = [term.positions[0] * h * h, term.positions[1] * h * h * h * first];
        let inverse = 1.0 / h;
        let [v_j, v_s] = [term.velocities[0] * h * h * first, term.velocities[1] * h * h * h];
        for p in 0..self.positions.len() {
            let free = system.dofs().free_axes(p);
            if free == Axes::NONE {
                continue;
            }
            let acceleration = (step.after.velocities[p] - step.before.velocities[p]) * inverse;
            let (mut jerk, mut snap) = (Vector3::zeros(), Vector3::zeros());
            if last > 0.0 {
                jerk = (acceleration - self.mean_acceleration[p]) * (2.0 / (h + last));
                if before_last > 0.0 {
                    snap = (jerk - self.jerk[p]) * (3.0 / (h + last + before_last));
                }
            }
            self.mean_acceleration[p] = acceleration;
            self.jerk[p] = jerk;
            self.local_positions[p] = free.project(&(acceleration * x_a + jerk * x_j));
            self.local_velocities[p] = free.project(&(jerk * v_j + snap * v_s));
        }
        self.lengths = [h, last];
        self.sum += norm_of_all(system, &self.local_positions);
    }

    /// Adds to δ the velocity that a method takes from springs that rotate: with `v⊥` across a spring a step of straight motion ends longer by
    /// `L = (h v⊥)²/(2 l)`, and `c κ L²` of the energy `½ μ v⊥²` across is lost, κ = k/l0 and μ the reduced mass of its ends.
    pub(super) fn add_braking(&mut self, system: &System, extensions: &SpringGeometry, step: &CompletedStep, c: f64) {
        let weight = |p: usize| if system.dofs().free_axes(p) == Axes::NONE { 0.0 } else { 1.0 / system.masses()[p] };
        for ((_, [i, j], spring), at) in extensions.springs(system) {
            let v = step.before.velocities[i] - step.before.velocities[j];
            let across = v - at.direction * at.direction.dot(&v);
            let lengthening = 0.5 * step.length * step.length * across.norm_squared() / at.length;
            let mobility = weight(i) + weight(j);
            let lost = c * spring.axial_stiffness() * lengthening * lengthening;
            let energy = 0.5 * across.norm_squared() / mobility;
            if lost == 0.0 || !lost.is_finite() {
                continue;
            }
            // The relative velocity across falls by half of the share of its energy.
            let taken = across * (0.5 * (lost / energy).min(1.0) / mobility);
            for (p, sign) in [(i, -1.0), (j, 1.0)] {
                self.local_velocities[p] += system.dofs().free_axes(p).project(&(taken * (sign * weight(p))));
            }
        }
    }

    /// Sets δ to the method's own estimate, scaled to a local error of the positions, in m.
    pub(super) fn set_local_to(&mut self, system: &System, local_error: f64, [x, v]: [&[Vector3<f64>]; 2]) {
        let size = norm_of_all(system, x);
        let scale = if size > 0.0 { local_error / size } else { 0.0 };
        for p in 0..self.positions.len() {
            let free = system.dofs().free_axes(p);
            self.local_positions[p] = free.project(&(x[p] * scale));
            self.local_velocities[p] = free.project(&(v[p] * scale));
        }
        self.sum += norm_of_all(system, &self.local_positions);
    }

    /// Enters the forces that a linearised step left out and balanced, in N.
    pub(super) fn leave_out(&mut self, left_out: f64, balanced: f64) {
        self.left_out += left_out;
        self.balanced += balanced;
    }

    /// Changes every vector of e, and of the e that is kept, by them and δ.
    pub(super) fn change(&mut self, change: impl Fn(&mut Vector3<f64>, &mut Vector3<f64>, &Vector3<f64>)) {
        let positions = self.positions.iter_mut().zip(&mut self.positions_before).zip(&self.local_positions);
        let velocities = self.velocities.iter_mut().zip(&mut self.velocities_before).zip(&self.local_velocities);
        positions.chain(velocities).for_each(|((e, kept), local)| change(e, kept, local));
    }

    pub(super) fn add_local(&mut self) {
        self.change(|e, _, local| *e += local);
    }

    /// Adds the errors of velocities that a step leaves where a force jumps by Δf within it, ½ h Δf/m, which differences of velocities do not see: the
    /// damper of a tension-only spring comes and goes with the tension, and in one dimension a spring with a rest length turns about where its ends
    /// pass each other.
    pub(super) fn add_jumps(&mut self, system: &System, step: &CompletedStep) {
        let is_line = system.dimension() == 1;
        if !is_line && system.behaviour().tension_only.is_empty() {
            return;
        }
        let states = [step.before, step.after];
        for (number, pair @ [i, j], _) in system.active() {
            let is_rope = system.behaviour().is_tension_only(number);
            if !is_line && !is_rope {
                continue;
            }
            let ends = states.map(|state| system.extension(number, &state.positions[i], &state.positions[j]));
            let [Some(before), Some(after)] = ends else { continue };
            let springs = [0, 1].map(|end| system.spring_at(number, [before, after][end].length, states[end].time));
            let damping = |end: usize| {
                let w = states[end].velocities[i] - states[end].velocities[j];
                springs[end].damping_force(&[before, after][end], &w)
            };
            let turns = before.direction.dot(&after.direction) < 0.0 && springs[1].rest_length > 0.0;
            let jump = if turns {
                springs[1].elastic_force(&after) - springs[0].elastic_force(&before)
            } else if is_rope && (springs[0].stiffness == 0.0) != (springs[1].stiffness == 0.0) {
                damping(1) - damping(0)
            } else {
                continue;
            };
            for (p, sign) in pair.into_iter().zip([1.0, -1.0]) {
                let half = jump * (0.5 * sign * step.length / system.masses()[p]);
                self.velocities[p] += system.dofs().free_axes(p).project(&half);
            }
        }
    }

    /// Sets `to` to a state displaced by ε e; returns ε, zero where there is no error. Errors of velocities are weighted by h seconds.
    pub(super) fn displace(&self, system: &System, from: &State, h: f64, to: &mut State) -> f64 {
        let size = norm_of_all(system, &self.positions) + h * norm_of_all(system, &self.velocities);
        if size == 0.0 || !size.is_finite() {
            return 0.0;
        }
        // About the root of the unit roundoff of the extent: rounding and curvature both leave six digits or more.
        let epsilon = 1e-7 * self.extent / size;
        to.time = from.time;
        for p in 0..self.positions.len() {
            to.positions[p] = from.positions[p] + self.positions[p] * epsilon;
            to.velocities[p] = from.velocities[p] + self.velocities[p] * epsilon;
        }
        epsilon
    }

    /// Sets the accelerations of e to the difference quotient of the forces at a displaced state and at the state itself.
    pub(super) fn set_accelerations(
        &mut self,
        system: &System,
        displaced: &[Vector3<f64>],
        force: &[Vector3<f64>],
        epsilon: f64,
    ) {
        for (p, a) in self.accelerations.iter_mut().enumerate() {
            let free = system.dofs().free_axes(p);
            *a = free.project(&((displaced[p] - force[p]) / (epsilon * system.masses()[p])));
        }
    }

    /// Sets e to the difference quotient of two ends of a step whose starts were εe apart.
    pub(super) fn take_difference(&mut self, system: &System, displaced: &State, end: &State, epsilon: f64) {
        let inverse = 1.0 / epsilon;
        for p in 0..self.positions.len() {
            let free = system.dofs().free_axes(p);
            self.positions[p] = free.project(&((displaced.positions[p] - end.positions[p]) * inverse));
            self.velocities[p] = free.project(&((displaced.velocities[p] - end.velocities[p]) * inverse));
        }
    }

    /// Limits e to the size of the motion, in a scene that is so many metres large now, and returns the largest extent so far: a scene may shrink to
    /// a point for a moment. An error that is not finite becomes the largest.
    pub(super) fn saturate(&mut self, system: &System, extent: f64) -> f64 {
        self.extent = self.extent.max(extent);
        let size = norm_of_all(system, &self.positions);
        let most = 2.0 * self.extent;
        if size.is_finite() && size <= most {
            return self.extent;
        }
        let scale = if size.is_finite() { most / size } else { 0.0 };
        let lists = [
            &mut self.positions,
            &mut self.velocities,
            &mut self.accelerations,
            &mut self.positions_before,
            &mut self.velocities_before,
        ];
        for list in lists {
            list.iter_mut().for_each(|e| *e = if scale > 0.0 { *e * scale } else { Vector3::zeros() });
        }
        if scale == 0.0 {
            let each = most / (self.positions.len() as f64).sqrt();
            self.positions.iter_mut().for_each(|e| e.x = each);
        }
        self.extent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::fixtures::{monitored, scene, stepper};
    use crate::integrate::{ImplicitOptions, Method, MonitorOptions, Schedule};
    use crate::linear::{PreconditionerKind, SolverChoice};
    use crate::spring::Spring;
    use crate::system::{Behaviour, SystemBuilder};
    use rand::{RngExt, SeedableRng};

    /// A particle of 1 kg in one dimension, on a spring to a held one.
    fn on_line(x: f64, spring: [f64; 3]) -> SystemBuilder {
        let scene = scene(&[([0.0; 3], 1.0), ([x, 0.0, 0.0], 1.0)], &[(0, 1, spring)]).hold(0).clone();
        SystemBuilder { dimension: 1, ..scene }
    }

    /// A particle of 1 kg, 1 m from rest on a spring of 10 N/m and a rest length, damped at the rate ζ.
    fn oscillator(rest_length: f64, zeta: f64) -> (System, State) {
        // k is in N, or in N/m without a rest length.
        let stiffness = if rest_length > 0.0 { 10.0 * rest_length } else { 10.0 };
        on_line(rest_length + 1.0, [stiffness, rest_length, 2.0 * zeta]).build().unwrap()
    }

    /// The end of a run and its propagated error of the second particle along x.
    fn run(scene: &(System, State), method: Method, dt: f64, duration: f64) -> (f64, f64) {
        let (mut stepper, schedule) = (stepper(method, &scene.0, &scene.1), Schedule::duration(dt, duration));
        let (outcome, state, monitor) = monitored(scene, &mut *stepper, MonitorOptions::default(), schedule);
        assert!(outcome.end.is_ok());
        (state.positions[1].x, monitor.error().unwrap().positions[1].x)
    }

    /// A force that jumps: a damped rope that becomes taut, and a spring whose ends pass each other, 1 m long at rest, of k = 10 N, with a particle
    /// of 1 kg that moves at ∓5 m/s from x = 0.5 m. Whatever the part of the step in which it happens, no error goes unnoticed.
    #[test]
    fn errors_of_steps_over_jumps_are_known() {
        // Both move freely or about their rest until x = 1 m or 0, and then vibrate.
        let rope = |t: f64| {
            let taut = (5.0 - 23f64.sqrt()) / 2.0;
            let (v, s) = (5.0 - 2.0 * taut, t - taut);
            0.8 + (-s).exp() * (0.2 * (3.0 * s).cos() + (v + 0.2) / 3.0 * (3.0 * s).sin())
        };
        let passing = |t: f64| {
            let w = 10f64.sqrt();
            // 1 − x = A cos(φ − ωt) with A² = 0.5² + (5/ω)² and cos φ = 0.5/A, until it is 1.
            let amplitude = 2.75f64.sqrt();
            let met = ((0.5 / amplitude).acos() - (1.0 / amplitude).acos()) / w;
            let (v, s) = (-amplitude * w * (1.0 - 1.0 / (amplitude * amplitude)).sqrt(), w * (t - met));
            -1.0 + s.cos() + v / w * s.sin()
        };
        let scene = |velocity: f64, damping: f64, gravity: f64| {
            let mut builder = on_line(0.5, [10.0, 1.0, damping]);
            builder.gravity(gravity, 0.0, 0.0).velocities[1].x = velocity;
            let (system, start) = builder.build().unwrap();
            let behaviour = Behaviour { tension_only: vec![damping > 0.0], ..Behaviour::default() };
            (system.with_behaviour(behaviour).unwrap(), start)
        };
        let cases = [(scene(5.0, 2.0, -2.0), rope(0.8)), (scene(-5.0, 0.0, 0.0), passing(0.5))];
        for ((scene, exact), duration) in cases.into_iter().zip([0.8, 0.5]) {
            for method in [Method::W2, Method::ImplicitMidpoint, Method::Verlet, Method::Bdf2] {
                for dt in [0.0137, 0.01, 0.0042, 0.00137] {
                    let (end, error) = run(&scene, method, dt, duration);
                    let name = method.name();
                    assert!((end - exact).abs() < 10.0 * error.abs(), "{name} {dt}: {error:e} for {:e}", end - exact);
                    assert!(error.abs() < 8.0 * dt, "{name} {dt}: {error:e}");
                }
            }
        }
    }

    /// `x − l0 = e^{−ζt} (cos ω_d t + ζ/ω_d sin ω_d t)`, ω_d² = 10 − ζ². The propagated error is the true one with its sign, to the next order in the
    /// step: each coefficient of each method, and each linearised step, is in it. Without a rest length no force jumps where the ends pass each other,
    /// and a scene that is a point for a moment does not limit the error.
    #[test]
    fn errors_of_an_oscillator_are_known_with_their_sign() {
        for (rest_length, zeta) in [(2.0, 0.0), (2.0, 0.4), (0.0, 0.0)] {
            let scene = oscillator(rest_length, zeta);
            let (duration, frequency) = (2.3, (10.0 - zeta * zeta).sqrt());
            let phase: f64 = frequency * duration;
            let exact = rest_length + (-zeta * duration).exp() * (phase.cos() + zeta / frequency * phase.sin());
            for method in Method::ALL.into_iter().filter(|method| method.order() <= 2) {
                let dt = if method.order() == 1 { 2.3e-4 } else { 5e-3 };
                let (end, error) = run(&scene, method, dt, duration);
                let ratio = error / (end - exact);
                // BDF2 begins with a step of backward Euler, of whose local error the jerk is not known yet.
                let within = if method == Method::Bdf2 { 0.1 } else { 0.05 };
                assert!((ratio - 1.0).abs() < within, "{} ζ {zeta}: {error:e} for {:e}", method.name(), end - exact);
            }
        }
    }

    /// Springs between particles in disorder, half of them pressed.
    fn tangle() -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.gravity(0.3, -9.8, 0.1);
        let mut random = rand::rngs::ChaCha8Rng::seed_from_u64(7);
        let places: Vec<[f64; 3]> = (0..40).map(|_| [(); 3].map(|()| random.random_range(-1.0..1.0))).collect();
        for place in &places {
            builder.particle(*place, random.random_range(0.5..2.0));
        }
        for spring in 0..110 {
            let [i, j] = [spring % 40, (spring + 1 + random.random_range(0..38)) % 40];
            let length = (Vector3::from(places[i]) - Vector3::from(places[j])).norm();
            let [stiffness, damping] = [random.random_range(10.0..100.0), random.random_range(0.0..1.0)];
            builder.spring(i, j, Spring { stiffness, rest_length: length * random.random_range(0.7..1.3), damping });
        }
        builder.hold(0);
        builder.build().unwrap()
    }

    /// The propagated error changes no bit of the motion, whatever state a solver has.
    #[test]
    fn the_motion_does_not_depend_on_the_estimate() {
        let scene = tangle();
        let every = |preconditioner| (SolverChoice::Cg, preconditioner);
        let solvers = PreconditionerKind::ALL.into_iter().map(every).chain([
            (SolverChoice::Auto, PreconditionerKind::BlockJacobi),
            (SolverChoice::Llt, PreconditionerKind::BlockJacobi),
        ]);
        for (solver, preconditioner) in solvers {
            let linear = ImplicitOptions::default().linear.with_solver(solver).with_preconditioner(preconditioner);
            let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
            for method in Method::ALL {
                let end = |watch: MonitorOptions| {
                    let mut stepper = method.stepper(&scene.0, &scene.1, &options).unwrap();
                    let schedule = Schedule::duration(0.01, 0.1);
                    let (outcome, state, monitor) = monitored(&scene, &mut *stepper, watch, schedule);
                    assert!(outcome.end.is_ok() && monitor.error().is_some() == watch.threshold.is_some());
                    state
                };
                let with = end(MonitorOptions::default());
                assert_eq!(with, end(MonitorOptions::ENERGY), "{} {solver:?} {preconditioner:?}", method.name());
            }
        }
    }

    #[test]
    fn errors_grow_no_larger_than_the_motion() {
        let (system, _) = oscillator(2.0, 0.0);
        let mut error = PropagatedError::none(&system);
        error.positions[1].x = 30.0;
        error.velocities[1].x = 6.0;
        error.saturate(&system, 5.0);
        assert_eq!((error.positions[1].x, error.velocities[1].x), (10.0, 2.0));
        error.positions[1].x = f64::NAN;
        error.saturate(&system, 5.0);
        assert!((error.norm(&system) - 10.0).abs() < 1e-12);
    }
}
