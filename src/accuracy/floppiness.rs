//! How far small forces displace a scene.
//!
//! A force that acts for a time T moves a free particle by `½ T² a`. What is held by stiff springs it moves by `a/ω²`, hardly at all. Both are
//! about `½ T² F a` with the [filter](super::filter) F of `h² = ½ T²`:
//!
//! ```text
//! ½ T²/(1 + ½ (Tω)²)  =  ½ T² for Tω → 0,     1/ω² for Tω → ∞.
//! ```
//!
//! So the floppiness of a scene is the root of the mean square of F, over accelerations of one length and of any direction at every particle: near one for
//! chains and cloths, which can fold; near zero for frameworks. K is that along the springs alone: a pull that stiffens them across may come and go.
//!
//! Forces between particles do not move a free scene as a whole, nor turn it, so that part is taken off beforehand, where nothing is prescribed.

use super::filter::Filter;
use crate::error::Result;
use crate::linear::{CostModel, SolverOptions};
use crate::spring::Stiffness;
use crate::system::{State, System};
use nalgebra::{Matrix3, Vector3};

/// Steps of a sequence that fills a cube evenly, powers of the inverse of the root of `x⁴ = x + 1`. (Martin Roberts, The unreasonable effectiveness of
/// quasirandom sequences, 2018.)
const STEPS: [f64; 3] = [0.819_172_513_396_164_5, 0.671_043_606_703_789_1, 0.549_700_477_901_970_2];

/// Of a motion of `duration` seconds, from 0 to 1, and what finding it has cost, in force evaluations. Not a number where a solve fails.
///
/// # Errors
/// Coincident ends of a spring; a matrix that is too large.
pub(super) fn floppiness(
    system: &System,
    state: &State,
    duration: f64,
    options: &SolverOptions,
    costs: &CostModel,
) -> Result<(f64, f64)> {
    let mut filter = Filter::new(system, state, duration * 0.5f64.sqrt(), Stiffness::Axial, options)?;
    let mut pushes = directions(system);
    let norm = |w: &[Vector3<f64>]| w.iter().map(|w| w.norm_squared()).sum::<f64>().sqrt();
    let all = norm(&pushes);
    if system.dofs().len() == system.dimension() * system.particles() {
        take_off_rigid_motion(system, &state.positions, &mut pushes);
    }
    let moved = norm(&filter.slow(&pushes));
    Ok((moved / all, filter.cost(costs)))
}

/// A direction for every particle, along the axes that are free.
fn directions(system: &System) -> Vec<Vector3<f64>> {
    let direction = |p: usize| {
        let free = system.dofs().free_axes(p);
        let of_cube = |axis: usize| 2.0 * ((p + 1) as f64 * STEPS[axis]).fract() - 1.0;
        Vector3::from_fn(|axis, _| if free.contains(axis) { of_cube(axis) } else { 0.0 })
    };
    (0..system.particles()).map(|p| direction(p).try_normalize(0.0).unwrap_or_default()).collect()
}

/// Takes off the accelerations with which the scene would move and turn as a whole; of scenes too large for numbers the second is left.
fn take_off_rigid_motion(system: &System, positions: &[Vector3<f64>], a: &mut [Vector3<f64>]) {
    let masses = system.masses();
    let mean = |of: &[Vector3<f64>]| {
        of.iter().zip(masses).map(|(x, mass)| x * *mass).sum::<Vector3<f64>>() / masses.iter().sum::<f64>()
    };
    let (centre, together) = (mean(positions), mean(a));
    let (mut inertia, mut torque) = (Matrix3::zeros(), Vector3::zeros());
    for ((x, a), mass) in positions.iter().zip(&mut *a).zip(masses) {
        *a -= together;
        let r = x - centre;
        inertia += (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * *mass;
        torque += r.cross(a) * *mass;
    }
    if !inertia.norm().is_finite() {
        return;
    }
    // What lies on a line does not turn about it.
    let about = inertia.pseudo_inverse(1e-9 * inertia.norm()).map_or(Vector3::zeros(), |inverse| inverse * torque);
    for (x, a) in positions.iter().zip(a) {
        *a -= about.cross(&(x - centre));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    fn of(duration: f64, (system, state): &(System, State)) -> f64 {
        floppiness(system, state, duration, &SolverOptions::default(), &CostModel::of(system)).unwrap().0
    }

    /// Particles in a plane, the first ones held, with stiff springs between these pairs: ω is above 10⁴/s.
    fn framework(at: &[[f64; 2]], pairs: &[[usize; 2]], held: usize) -> (System, State) {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        for (p, [x, y]) in at.iter().enumerate() {
            builder.particle([*x, *y, 0.0], 1.0 + 0.5 * p as f64);
        }
        for &[i, j] in pairs {
            builder.spring(i, j, Spring { stiffness: 1e9, rest_length: 1.1, damping: 0.0 });
        }
        (0..held).for_each(|p| _ = builder.hold(p));
        builder.build().unwrap()
    }

    /// Along a line: `1/(1 + ½ (Tω)²)`.
    #[test]
    fn a_spring_holds_by_its_stiffness() {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 2.0);
        builder.spring(0, 1, Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.0 });
        builder.hold(0);
        let scene = builder.build().unwrap();
        for duration in [0.1, 1.0, 30.0] {
            let expected = 1.0 / (1.0 + 2.0 * duration * duration);
            assert!((of(duration, &scene) / expected - 1.0).abs() < 1e-6, "{duration}");
        }
    }

    #[test]
    fn frameworks_are_stiff_and_chains_are_not() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.1, 1.0], [0.0, 0.9]];
        let sides = [[0, 1], [1, 2], [2, 3], [3, 0]];
        let braced = [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]];
        for (pairs, held, is_stiff) in
            [(&braced[..], 2, true), (&braced[..], 0, true), (&sides[..], 2, false), (&sides[..], 0, false)]
        {
            let found = of(1.0, &framework(&square, pairs, held));
            assert!(if is_stiff { found < 1e-6 } else { found > 0.1 && found < 1.0 }, "{held}: {found:e}");
        }
    }

    /// Away from the origin, with unequal masses: nothing is left of what moves and turns a scene as a whole.
    #[test]
    fn rigid_motion_is_taken_off() {
        let (system, state) = framework(&[[5.0, 2.0], [6.0, 2.5], [5.5, 4.0]], &[[0, 1], [1, 2]], 0);
        let rigid = |x: &Vector3<f64>| Vector3::new(0.3, -0.2, 0.0) + Vector3::new(0.0, 0.0, 0.7).cross(x);
        let mut a: Vec<_> = state.positions.iter().map(rigid).collect();
        take_off_rigid_motion(&system, &state.positions, &mut a);
        assert!(a.iter().all(|a| a.norm() < 1e-13), "{a:?}");
    }

    #[test]
    fn scenes_too_large_for_numbers_are_not_turned() {
        let (system, state) = framework(&[[5.0, 2.0], [6.0, 2.5]], &[[0, 1]], 0);
        let far: Vec<_> = state.positions.iter().map(|x| x * 1e200).collect();
        let mut a = vec![Vector3::x(), -Vector3::y()];
        take_off_rigid_motion(&system, &far, &mut a);
        assert!(a.iter().all(|a| a.norm() < 2.0), "{a:?}");
    }

    #[test]
    fn directions_are_free_and_of_length_one() {
        let (system, _) = framework(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], &[[0, 1], [1, 2]], 1);
        let directions = directions(&system);
        assert_eq!(directions[0], Vector3::zeros());
        for direction in &directions[1..] {
            assert!((direction.norm() - 1.0).abs() < 1e-15 && direction.z == 0.0, "{direction}");
        }
        assert!((directions[1] - directions[2]).norm() > 0.1);
    }
}
