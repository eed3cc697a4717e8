//! What of a motion is too fast for a step.
//!
//! A method that damps vibrations which its steps do not resolve may converge, step halved after step, to the motion
//! without them, and its runs agree. So it is asked first how large that part of the motion is. Backward Euler's filter
//!
//! ```text
//! F = (1 + h² M⁻¹(−K))⁻¹,     1/(1 + (hω)²) of a mode of frequency ω,
//! ```
//!
//! keeps what is slow against h. What `(1 − F)³` leaves of the velocities and of the accelerations is fast. Modes of hω = 0.3 count with
//! 6·10⁻⁴ of themselves, those of hω = 3 with 0.73.
//!
//! What is fast may displace little: a mode of velocity v has the amplitude `v/ω`, one of acceleration a the amplitude `a/ω²`. Both
//! follow from the same filter, since `1/ω² = h² F/(1 − F)`: of the accelerations it is `h² F (1 − F)² a`, and the square of that of the
//! velocities `h² ⟨(1 − F)² v, F (1 − F)³ v⟩`, a scalar product with the masses, in which F is symmetric, over their mean.
//!
//! Yet what displaces little may push: as a vibration of energy E is slowly changed it keeps `E/ω` (the adiabatic invariant of Landau and Lifshitz,
//! Mechanics, § 49), so that E acts as a potential on what is slow, with the force `−E ∇ω/ω`. A frequency changes by a part of order one where a
//! particle moves by the length ℓ of a spring. With velocities of amplitude w, `E = m w²/2`, particles drift in the time T by
//!
//! ```text
//! ½ (E/(m ℓ)) T² = ¼ w² T²/ℓ,
//! ```
//!
//! w² being the mean, by mass, of the squares of what is fast of the velocities, `(1 − F)² v`, and of `a/ω`, `h² ⟨(1 − F)² a, F (1 − F) a⟩`. Of 418
//! implicit answers to random scenes that left out fast vibrations of amplitudes up to the accuracy 22 were wrong, of 20 of which this
//! drift was above 0.7 of it, and of a third of the others.
//!
//! **Damping** takes away what is fast. With β the least `b l0/k` of all springs, the damping matrix is at least β times the stiffness along the
//! springs, `−G ≥ −β K_axial`, and the energy of a vibration of frequency ω decays at a rate of at least `Γ = βω²`. With `z = ΓT` its amplitude at the
//! end is `exp(−z/2)` of what it was, and its pushing adds up to
//!
//! ```text
//! ∫₀ᵀ (T − t) exp(−Γt) dt = T² (exp(−z) − 1 + z)/z² ≤ ½ T²/(1 + z/3)
//! ```
//!
//! instead of ½ T². A second filter, with the stiffness along the springs and `h² = βT/4`, keeps `D = 1/(1 + z/4)` of such a vibration: w² counts with D,
//! and amplitudes with D², since `exp(−z/2) ≤ 1/(1 + z/4)²`. What is damped so much that it creeps back does so in a time of β or more, which steps that damp
//! follow or need not follow. (Own derivation. One spring without damping, and nothing is known of its vibrations.)
//!
//! **Stiffness** holds what is pushed. A drift counts with the [floppiness](super::floppiness) of the scene: the part of ½ T² a by which an acceleration a of any
//! direction displaces it. (Of 234 implicit answers to the thousand random scenes of the study, made whatever the drift, 215 had a drift below 0.7 of the
//! accuracy with it, one of them wrong, by 1.5, and 164 without; of the 19 others 4 were wrong, by up to 4.8.)

use super::extent;
use super::filter::Filter;
use super::floppiness::floppiness;
use crate::error::Result;
use crate::force::{Extensions, set_accelerations};
use crate::linear::{CostModel, SolverOptions};
use crate::spring::{Extension, Spring, Stiffness};
use crate::system::{State, System};
use nalgebra::Vector3;

/// What steps do not resolve of a motion, relative to the extent of the scene. Not numbers where they cannot be found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unresolved {
    /// The size of what is too fast, at the end.
    pub amplitude: f64,
    /// How far it pushes what is slow until then.
    pub drift: f64,
}

impl Unresolved {
    /// Whether neither is more than that of another.
    pub fn is_within(&self, other: &Self) -> bool {
        self.amplitude <= other.amplitude && self.drift <= other.drift
    }
}

/// What steps of `h` seconds do not resolve of a motion of `duration` seconds in which prescribed velocities make these jumps, in m/s, and what finding
/// it has cost, in force evaluations. Bounds are drawn closer, at some cost, only where they are not within what does no harm.
///
/// # Errors
/// Coincident ends of a spring; a matrix that is too large.
pub(super) fn unresolved(
    system: &System,
    state: &State,
    [h, duration]: [f64; 2],
    jumps: &[Vec<Vector3<f64>>],
    harmless: &Unresolved,
    options: &SolverOptions,
    costs: &CostModel,
) -> Result<(Unresolved, f64)> {
    let extensions = Extensions::at(system, &state.positions)?;
    let mut acceleration = vec![Vector3::zeros(); system.particles()];
    set_accelerations(system, &extensions, &state.moment(), &mut acceleration);
    // Without the terms that make A indefinite: a filter must be one.
    let mut filter = Filter::new(system, state, h, Stiffness::Tension, options)?;
    let mut fast = vec![Fast::of(system, &mut filter, &state.velocities, &acceleration)];
    let no_acceleration = vec![Vector3::zeros(); system.particles()];
    fast.extend(jumps.iter().map(|jump| Fast::of(system, &mut filter, jump, &no_acceleration)));
    let extent = extent(&state.positions, &state.positions);
    let mean_length = extensions.iter().map(|at| at.length).sum::<f64>() / extensions.iter().len().max(1) as f64;
    let all = (system.particles() as f64).sqrt();
    let pushing = if mean_length > 0.0 { 0.25 * duration * duration / mean_length * all / extent } else { 0.0 };
    let mut left = Unresolved { amplitude: 0.0, drift: 0.0 };
    for fast in &fast {
        left.amplitude += fast.amplitude(&mut filter, [&fast.velocities, &fast.accelerations]) / extent;
        left.drift += pushing * fast.square_velocity([&fast.velocities, &fast.accelerations]);
    }
    let mut cost = 1.0;
    let decay = least_decay(system, &extensions);
    // What kinks set off may have no time to decay.
    if let [fast] = &fast[..]
        && left.amplitude > harmless.amplitude
        && decay > 0.0
    {
        let mut damping = Filter::new(system, state, (0.25 * decay * duration).sqrt(), Stiffness::Axial, options)?;
        let lasting = [&fast.velocities, &fast.accelerations].map(|of| damping.slow(of));
        let last = lasting.each_ref().map(|of| damping.slow(of));
        left.amplitude = fast.amplitude(&mut filter, [&last[0], &last[1]]) / extent;
        left.drift = pushing * fast.square_velocity([&lasting[0], &lasting[1]]);
        cost += damping.cost(costs);
    }
    if left.amplitude <= harmless.amplitude && left.drift > harmless.drift {
        let (floppiness, looking) = floppiness(system, state, duration, options, costs)?;
        left.drift *= floppiness;
        cost += looking;
    }
    Ok((left, cost + filter.cost(costs)))
}

/// β: by how much of the square of its frequency the energy of any vibration decays at least, in s.
fn least_decay(system: &System, extensions: &Extensions) -> f64 {
    let decay = |((.., spring), at): ((usize, [usize; 2], &Spring), &Extension)| {
        spring.damping / spring.stiffness_block(at, Stiffness::Axial).axial
    };
    extensions.springs(system).map(decay).reduce(f64::min).unwrap_or(0.0)
}

/// What is too fast of a state's motion.
struct Fast<'s> {
    system: &'s System,
    /// `(1 − F)² v`, in m/s.
    velocities: Vec<Vector3<f64>>,
    /// `(1 − F)² a`, in m/s².
    accelerations: Vec<Vector3<f64>>,
    /// `h² F (1 − F) a`, in m.
    displacements: Vec<Vector3<f64>>,
}

impl<'s> Fast<'s> {
    fn of(system: &'s System, filter: &mut Filter, v: &[Vector3<f64>], a: &[Vector3<f64>]) -> Self {
        let mut twice = |w: &[Vector3<f64>]| {
            let once = filter.fast(w);
            let twice = filter.fast(&once);
            [once, twice]
        };
        let [_, velocities] = twice(v);
        let [once, accelerations] = twice(a);
        let square = filter.h * filter.h;
        // F (1 − F) a is what the second filter has taken away.
        let displacements = once.iter().zip(&accelerations).map(|(once, twice)| (once - twice) * square).collect();
        Self { system, velocities, accelerations, displacements }
    }

    /// `Σ m v·w`, not negative but by rounding.
    fn product(&self, v: &[Vector3<f64>], w: &[Vector3<f64>]) -> f64 {
        let terms = v.iter().zip(w).zip(self.system.masses()).map(|((v, w), mass)| mass * v.dot(w));
        // Keeps what is not a number.
        terms.sum::<f64>().clamp(0.0, f64::INFINITY)
    }

    /// How far all particles swing of which these velocities and accelerations are left, in m.
    fn amplitude(&self, filter: &mut Filter, [velocities, accelerations]: [&[Vector3<f64>]; 2]) -> f64 {
        let square = filter.h * filter.h;
        let faster = filter.fast(velocities);
        let mean_mass = self.system.masses().iter().sum::<f64>() / self.system.particles() as f64;
        let by_velocity = (square * self.product(velocities, &filter.slow(&faster)) / mean_mass).sqrt();
        let slowed = filter.slow(accelerations);
        by_velocity + square * slowed.iter().map(|w| w.norm_squared()).sum::<f64>().sqrt()
    }

    /// w², the mean square of velocities by mass, of which these velocities and accelerations last, in m²/s².
    fn square_velocity(&self, [velocities, accelerations]: [&[Vector3<f64>]; 2]) -> f64 {
        let twice = self.product(&self.velocities, velocities) + self.product(accelerations, &self.displacements);
        twice / self.system.masses().iter().sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::{SolverChoice, Tolerance};
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// A particle on a spring of 1 m, with a velocity along it: ω = 10/s, and the amplitude is 0.1 v. The masses are its own and the anchor's.
    fn moving(speed: f64, rest_length: f64, [mass, anchor]: [f64; 2]) -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], anchor);
        let particle = builder.particle([1.0, 0.0, 0.0], mass);
        builder.spring(0, 1, Spring { stiffness: 100.0 * mass * rest_length, rest_length, damping: 0.0 });
        builder.hold(0);
        builder.velocities[particle] = Vector3::new(speed, 0.0, 0.0);
        builder.build().unwrap()
    }

    /// What nothing is within: bounds are drawn as close as they can be.
    const NOTHING: Unresolved = Unresolved { amplitude: 0.0, drift: 0.0 };

    /// What anything is within: bounds are not drawn closer.
    const ANYTHING: Unresolved = Unresolved { amplitude: f64::INFINITY, drift: f64::INFINITY };

    fn left(h: f64, (system, state): &(System, State)) -> Unresolved {
        unresolved(system, state, [h, 1.0], &[], &ANYTHING, &SolverOptions::default(), &CostModel::of(system))
            .unwrap()
            .0
    }

    /// However loosely equations are to be solved elsewhere, here they are to a millionth.
    #[test]
    fn what_is_fast_is_found_exactly() {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        for p in 0..30 {
            let particle = builder.particle([f64::from(p), 0.0, 0.0], 1.0 + 0.1 * f64::from(p));
            builder.velocities[particle].x = (0.7 * f64::from(p)).sin();
        }
        for p in 0..29 {
            builder.spring(p, p + 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
        }
        let (system, state) = builder.build().unwrap();
        let sizes = [SolverChoice::Llt, SolverChoice::Cg].map(|solver| {
            let options = SolverOptions { solver, tolerance: Tolerance::Fixed(0.3), ..SolverOptions::default() };
            unresolved(&system, &state, [0.5, 1.0], &[], &ANYTHING, &options, &CostModel::of(&system))
                .unwrap()
                .0
                .amplitude
        });
        assert!((sizes[1] / sizes[0] - 1.0).abs() < 1e-4, "{sizes:?}");
    }

    #[test]
    fn what_is_fast_is_told_from_what_is_slow() {
        let relative = |h: f64, masses: [f64; 2]| left(h, &moving(0.01, 1.0, masses)).amplitude;
        let extent = 0.5f64.sqrt();
        // hω = 0.1: (0.01/1.01)³; hω = 10: (100/101)³.
        let expected = |filter: f64| 0.01 / 10.0 * filter / extent;
        let close = |value: f64, expected: f64| (value / expected - 1.0).abs() < 1e-6;
        // Squares count with the mass, over the mean of both: of 4 kg and 12 kg a half.
        for (masses, part) in [([1.0, 1.0], 1.0f64), ([4.0, 12.0], 0.5)] {
            for (h, filter) in [(0.01, 0.01f64 / 1.01), (1.0, 100.0 / 101.0)] {
                let found = relative(h, masses);
                assert!(close(found, part.sqrt() * expected(filter.powi(3))), "{h} {masses:?}: {found:e}");
            }
        }
    }

    /// A vibration of 1 m/s, begun with that velocity or with a force: w² is the particle's part of the mass, in m²/s², and in a second both particles
    /// drift by `¼ w²` over the metre of the spring. Of two that is √2 times as much, and the extent is √½ m.
    #[test]
    fn what_is_fast_pushes_what_is_slow() {
        let filter = 100.0f64 / 101.0;
        for (speed, rest_length) in [(1.0, 1.0), (0.0, 0.9)] {
            for (masses, part) in [([1.0, 1.0], 0.5), ([3.0, 1.0], 0.75)] {
                let found = left(1.0, &moving(speed, rest_length, masses)).drift;
                let expected = 0.25 * part * filter.powi(4) * 2.0f64.sqrt() / 0.5f64.sqrt();
                assert!((found / expected - 1.0).abs() < 1e-6, "{speed} {masses:?}: {found:e}, {expected:e}");
            }
        }
        assert_eq!(left(1.0, &moving(0.0, 1.0, [1.0; 2])).drift, 0.0);
    }

    /// With 0.2 N·s/m on 100 N/m β is 2 ms, so that energy decays at Γ = 0.2/s: of an amplitude `1/(1 + ΓT/4)²` is left after T, of what pushes
    /// `1/(1 + ΓT/4)`, more than there is in truth. Where bounds are close enough already they are not drawn closer.
    #[test]
    fn what_is_damped_dies_out() {
        let (h, duration): (f64, f64) = (0.5, 30.0);
        let scene = |damping: f64| {
            let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
            builder.particle([0.0; 3], 1.0);
            builder.particle([1.0, 0.0, 0.0], 1.0);
            builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 1.0, damping });
            builder.hold(0);
            builder.velocities[1].x = 0.3;
            builder.build().unwrap()
        };
        let left = |(system, state): &(System, State), harmless: &Unresolved| {
            let (options, costs) = (SolverOptions::default(), CostModel::of(system));
            unresolved(system, state, [h, duration], &[], harmless, &options, &costs).unwrap()
        };
        let (damped, undamped) = (scene(0.2), scene(0.0));
        let (without, cost) = left(&damped, &ANYTHING);
        assert_eq!(left(&undamped, &NOTHING), left(&undamped, &ANYTHING));
        let (with, closer) = left(&damped, &NOTHING);
        let decay: f64 = 0.2 * duration;
        assert!((with.amplitude / without.amplitude * (1.0 + decay / 4.0).powi(2) - 1.0).abs() < 1e-6);
        assert!((with.drift / without.drift * (1.0 + decay / 4.0) - 1.0).abs() < 1e-6);
        assert!(with.amplitude / without.amplitude > (-decay / 2.0).exp());
        assert!(with.drift / without.drift > 2.0 * ((-decay).exp() - 1.0 + decay) / (decay * decay));
        assert!(closer > cost);

        // One spring without damping, and nothing is known.
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        (0..3).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 1.0));
        for (p, damping) in [(0, 0.2), (1, 0.0)] {
            builder.spring(p, p + 1, Spring { stiffness: 100.0, rest_length: 1.0, damping });
        }
        builder.hold(0);
        builder.velocities[2].x = 0.3;
        let partly = builder.build().unwrap();
        assert_eq!(left(&partly, &NOTHING), left(&partly, &ANYTHING));
    }

    /// An anchor that is led away from now on with a velocity sets off what a particle's own velocity would that is as large: a spring of ω = 10/s.
    #[test]
    fn jumps_of_prescribed_velocities_vibrate() {
        let (system, state) = moving(0.0, 1.0, [1.0; 2]);
        let jump = vec![Vector3::new(0.01, 0.0, 0.0), Vector3::zeros()];
        let (options, costs) = (SolverOptions::default(), CostModel::of(&system));
        let jumps = |jumps: &[Vec<Vector3<f64>>]| {
            unresolved(&system, &state, [1.0, 1.0], jumps, &ANYTHING, &options, &costs).unwrap().0
        };
        let once = jumps(std::slice::from_ref(&jump));
        let expected = left(1.0, &moving(0.01, 1.0, [1.0; 2]));
        assert!((once.amplitude / expected.amplitude - 1.0).abs() < 1e-6, "{once:?} {expected:?}");
        assert!((once.drift / expected.drift - 1.0).abs() < 1e-6, "{once:?} {expected:?}");
        let twice = jumps(&[jump.clone(), jump]);
        assert!(
            (twice.amplitude / once.amplitude - 2.0).abs() < 1e-12 && (twice.drift / once.drift - 2.0).abs() < 1e-12
        );
        assert_eq!(jumps(&[]), Unresolved { amplitude: 0.0, drift: 0.0 });
    }

    /// What is held by stiff springs is not pushed far; in one dimension a spring alone holds.
    #[test]
    fn drift_counts_by_what_gives_way() {
        let (system, state) = moving(1.0, 1.0, [1.0; 2]);
        let (options, costs) = (SolverOptions::default(), CostModel::of(&system));
        let of = |harmless: &Unresolved| {
            unresolved(&system, &state, [1.0, 1.0], &[], harmless, &options, &costs).unwrap().0.drift
        };
        let (floppiness, _) = floppiness(&system, &state, 1.0, &options, &costs).unwrap();
        let closer = of(&Unresolved { amplitude: f64::INFINITY, drift: 0.0 });
        assert!((closer / of(&ANYTHING) / floppiness - 1.0).abs() < 1e-12 && floppiness < 1.0, "{floppiness}");
    }
}
