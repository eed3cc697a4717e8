//! The fastest vibration and the fastest decay of a scene, and the method that follows from them.
//!
//! An explicit method resolves the fastest vibration, of frequency ω, and the fastest decay, of rate c: the square root of the largest
//! eigenvalue of `−M⁻¹K`, and the largest of `−M⁻¹G`. DOP853 is stable for about `h max(ω, c) ≤ 6` (Hairer, Nørsett and Wanner,
//! Solving Ordinary Differential Equations I, II.10) and takes twelve evaluations a step, `2 T max(ω, c)` in a run of T seconds. An
//! implicit method's steps need not resolve vibrations that carry no motion; each takes a factorization and several solves.

use crate::error::{Result, significant};
use crate::force::{SpringGeometry, add_damping_product, add_elastic_differential};
use crate::integrate::Method;
use crate::system::{State, System};
use nalgebra::Vector3;

/// The largest frequency and decay rate of the linearised motion at a state, in 1/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectralRadius {
    /// ω, of vibrations.
    pub frequency: f64,
    /// c, of damping.
    pub decay: f64,
}

impl SpectralRadius {
    /// At a state, by the power method.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn at(system: &System, state: &State) -> Result<Self> {
        let extensions = SpringGeometry::at(system, state)?;
        let stiffness = power_method(system, |u, force| add_elastic_differential(system, &extensions, u, force));
        let decay = if system.is_damped() || !extensions.external().is_empty() {
            power_method(system, |u, force| add_damping_product(system, &extensions, u, force))
        } else {
            0.0
        };
        Ok(Self { frequency: stiffness.sqrt(), decay })
    }

    /// The longest step of Verlet's method that is stable, in s: `hω ≤ 2 (√(1 + 4ζ²) − 2ζ)` with ζ = c/2ω.
    pub fn verlet_limit(&self) -> f64 {
        let ratio = if self.frequency > 0.0 { self.decay / self.frequency } else { 0.0 };
        let limit = 2.0 / ((1.0 + ratio * ratio).sqrt() + ratio);
        if self.frequency > 0.0 { limit / self.frequency } else { 1.0 / self.decay }
    }
}

/// The largest magnitude of an eigenvalue of `−M⁻¹ P` on the free coordinates, P being a product that is added to its second argument.
fn power_method(system: &System, product: impl Fn(&[Vector3<f64>], &mut [Vector3<f64>])) -> f64 {
    // Neighbours move against each other in the fastest vibration; the golden angle from one particle to the next has a part of that.
    let direction = |p: usize| {
        let turn = p as f64 * 2.399_963_229_728_653;
        system.dofs().free_axes(p).project(&Vector3::new(turn.cos(), turn.sin(), (1.7 * turn).sin()))
    };
    let mut u: Vec<Vector3<f64>> = (0..system.particles()).map(direction).collect();
    let mut force = vec![Vector3::zeros(); system.particles()];
    let norm =
        |u: &[Vector3<f64>]| u.iter().zip(system.masses()).map(|(u, mass)| mass * u.norm_squared()).sum::<f64>().sqrt();
    let mut largest = 0.0;
    // Right to some percent.
    for _ in 0..20 {
        let size = norm(&u);
        if size == 0.0 || !size.is_finite() {
            break;
        }
        u.iter_mut().for_each(|u| *u /= size);
        force.fill(Vector3::zeros());
        product(&u, &mut force);
        for (p, ((u, f), mass)) in u.iter_mut().zip(&force).zip(system.masses()).enumerate() {
            *u = system.dofs().free_axes(p).project(&(-f / *mass));
        }
        // In the norm of M the matrix is symmetric: it stretches nothing by more than its largest eigenvalue.
        largest = f64::max(largest, norm(&u));
    }
    largest
}

/// The method for an adaptive run of `duration` seconds, with the reason: explicit where that resolves the fastest vibration for less work.
///
/// # Errors
/// Coincident ends of a spring.
pub fn default_method(system: &System, state: &State, duration: f64) -> Result<(Method, String)> {
    let radius = SpectralRadius::at(system, state)?;
    let rate = radius.frequency.max(radius.decay);
    let fastest = if radius.frequency >= radius.decay { "vibration" } else { "decay" };
    let (explicit, speed) = (significant(2.0 * duration * rate, 2), significant(rate, 3));
    // Up to 10⁵ evaluations: RODAS4 takes as many with `rtol = 1e-2` on cloths of 10² and 20² particles that swing down.
    let is_explicit = duration * rate <= 5e4 || system.has_external_forces();
    let reason = if !is_explicit {
        format!("implicit: resolving the fastest {fastest}, {speed}/s, would take {explicit} force evaluations")
    } else if rate == 0.0 {
        "explicit: nothing vibrates or decays at the start".into()
    } else {
        format!("explicit: about {explicit} force evaluations resolve the fastest {fastest}, {speed}/s")
    };
    Ok((if is_explicit { Method::Dop853 } else { Method::Rodas4 }, reason))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use crate::system::fixtures::tethered;

    /// A particle of 2 kg on a held one: ω² = κ/m with κ = k/l0 = 18 N/m, and c = b/m.
    fn oscillator(damping: f64) -> (System, State) {
        tethered(1.5, 2.0, Spring { stiffness: 27.0, rest_length: 1.5, damping })
    }

    #[test]
    fn the_rates_of_an_oscillator_are_known() {
        let (system, state) = oscillator(5.0);
        let radius = SpectralRadius::at(&system, &state).unwrap();
        assert!((radius.frequency - 3.0).abs() < 1e-9 && (radius.decay - 2.5).abs() < 1e-9, "{radius:?}");
        // ζ = c/2ω = 5/12.
        let zeta: f64 = 5.0 / 12.0;
        let expected = 2.0 * ((1.0 + 4.0 * zeta * zeta).sqrt() - 2.0 * zeta) / 3.0;
        assert!((radius.verlet_limit() - expected).abs() < 1e-9);
    }

    /// A taut chain between walls: ω = 2 √(κ/m) sin(Nπ/(2(N + 1))), to some percent and never more.
    #[test]
    fn the_fastest_vibration_of_a_chain_is_found() {
        let mut builder = SystemBuilder::new();
        for p in 0..22 {
            builder.particle([f64::from(p), 0.0, 0.0], 0.5);
        }
        for p in 0..21 {
            builder.spring(p, p + 1, Spring { stiffness: 10.0, rest_length: 0.8, damping: 0.0 });
        }
        builder.hold(0);
        builder.hold(21);
        let (system, state) = builder.build().unwrap();
        let found = SpectralRadius::at(&system, &state).unwrap().frequency;
        let exact = 2.0 * (10.0 / 0.8 / 0.5_f64).sqrt() * (20.0 * std::f64::consts::PI / 42.0).sin();
        assert!(found <= exact * (1.0 + 1e-12) && found > 0.95 * exact, "{found} {exact}");
    }

    #[test]
    fn stiffness_decides_between_explicit_and_implicit() {
        let (system, state) = oscillator(0.0);
        for (duration, expected) in [(1.0, Method::Dop853), (1e6, Method::Rodas4)] {
            assert_eq!(default_method(&system, &state, duration).unwrap().0, expected);
        }
    }
}
