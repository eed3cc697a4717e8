//! How fast a scene can move, and what steps that asks of explicit methods.

use crate::error::Result;
use crate::force::Extensions;
use crate::linear::CostModel;
use crate::spring::{Extension, Spring, SpringBlock, Stiffness};
use crate::system::{Axes, State, System};
use nalgebra::Matrix3;

/// The fastest vibration and the strongest damping of a state, bounded from above, in 1/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rates {
    /// `√λ_max(−M⁻¹K)`.
    pub vibration: f64,
    /// `λ_max(−M⁻¹G)`.
    pub damping: f64,
    /// What finding them has cost, in force evaluations.
    pub cost: f64,
}

impl Rates {
    /// Of a state.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn of(system: &System, state: &State, costs: &CostModel) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let stiffness = |spring: &Spring, at: &Extension| spring.stiffness_block(at, Stiffness::Tension);
        let vibration = largest(system, &extensions, stiffness).sqrt();
        let damping =
            if system.is_damped() { largest(system, &extensions, |spring, at| spring.damping_block(at)) } else { 0.0 };
        Ok(Self { vibration, damping, cost: costs.assembly() })
    }

    /// The longest stable step of Verlet's method, in s. With predicted velocities a mode `x″ = −ω²x − γx′` is stable for
    /// `h²ω²/4 + hγ ≤ 1`.
    pub fn verlet_step(&self) -> f64 {
        2.0 / (self.damping + self.damping.hypot(self.vibration))
    }

    /// The spectral radius of the equations of first order, in 1/s.
    pub fn radius(&self) -> f64 {
        let Self { vibration, damping, .. } = *self;
        let under = 4.0 * vibration * vibration - damping * damping;
        if under > 0.0 { vibration } else { 0.5 * (damping + (-under).sqrt()) }
    }
}

/// A bound of `λ_max` of the springs' blocks, over the masses. A block S ≥ 0 between i and j has, for every t > 0,
///
/// ```text
/// (u_i − u_j)ᵀ S (u_i − u_j) ≤ (1 + t) u_iᵀ S u_i + (1 + 1/t) u_jᵀ S u_j.
/// ```
///
/// With `p_i = λ_max(Σ S)/m_i` over the springs of particle i and `t = p_j/p_i`,
///
/// ```text
/// λ_max ≤ max_i λ_max(Σ (1 + p_j/p_i) S)/m_i,
/// ```
///
/// where p_j is zero for an end that is held. For one spring, for a long chain of equal ones and for a hub with light spokes the bound is
/// reached. It is what W. N. Anderson and T. D. Morley (Eigenvalues of the Laplacian of a graph, 1985) found for graphs, `λ ≤ max (d_i + d_j)`,
/// by blocks. S is taken without what compression takes from it.
fn largest(system: &System, extensions: &Extensions, block: impl Fn(&Spring, &Extension) -> SpringBlock) -> f64 {
    let is_free = |end: usize| system.dofs().free_axes(end) != Axes::NONE;
    let sums = |weight: &dyn Fn(usize, usize) -> f64| {
        let mut sums = vec![Matrix3::zeros(); system.particles()];
        for ((_, [i, j], spring), at) in extensions.springs(system) {
            let block = block(spring, at).matrix();
            for (here, there) in [(i, j), (j, i)] {
                sums[here] += block * weight(here, there);
            }
        }
        let of_mass = |(sum, mass): (&Matrix3<f64>, &f64)| sum.symmetric_eigenvalues().max() / mass;
        sums.iter().zip(system.masses()).map(of_mass).collect::<Vec<f64>>()
    };
    let own = sums(&|_, _| 1.0);
    let weight = |here: usize, there: usize| match [here, there].map(is_free) {
        [true, true] if own[here] > 0.0 => 1.0 + own[there] / own[here],
        [true, _] => 1.0,
        [false, _] => 0.0,
    };
    sums(&weight).into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// A particle of 2 kg on a spring of 8 N/m, damped by 12 N·s/m: ω = 2, γ = 6.
    fn oscillator(damping: f64) -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 2.0);
        builder.spring(0, 1, Spring { stiffness: 8.0, rest_length: 1.0, damping });
        builder.hold(0);
        builder.build().unwrap()
    }

    /// A tetrahedron of unequal springs and masses: the bound is one, and taken where nothing finer is needed.
    #[test]
    fn a_bound_is_enough_for_long_steps() {
        let mut builder = SystemBuilder::new();
        for (x, mass) in
            [([0.0, 0.0, 0.0], 1.0), ([1.0, 0.0, 0.0], 2.0), ([0.2, 0.9, 0.0], 0.5), ([0.4, 0.3, 0.8], 0.7)]
        {
            builder.particle(x, mass);
        }
        let pairs = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
        for ([i, j], stiffness) in pairs.into_iter().zip([8.0, 5.0, 9.0, 20.0, 3.0, 11.0]) {
            builder.spring(i, j, Spring { stiffness, rest_length: 0.9, damping: 0.1 * stiffness });
        }
        let (system, state) = builder.build().unwrap();
        let costs = CostModel::of(&system);
        let rates = |long: f64| Rates::of(&system, &state, long, &costs).unwrap();
        let (bound, found) = (rates(0.0), rates(f64::INFINITY));
        assert!(found.vibration <= bound.vibration && bound.vibration <= 2.0 * found.vibration, "{bound:?}, {found:?}");
        assert!(found.damping <= bound.damping && bound.damping <= 4.0 * found.damping, "{bound:?}, {found:?}");
        assert!(bound.cost < 0.3 * found.cost, "{bound:?}, {found:?}");
        assert_eq!(rates(bound.verlet_step()), bound);
        assert_eq!(rates(1.01 * bound.verlet_step()), found);
    }

    #[test]
    fn the_rates_of_an_oscillator() {
        let (system, state) = oscillator(12.0);
        let rates = Rates::of(&system, &state, f64::INFINITY, &CostModel::of(&system)).unwrap();
        assert!((rates.vibration - 2.0).abs() < 1e-9 && (rates.damping - 6.0).abs() < 1e-9, "{rates:?}");
        let h = rates.verlet_step();
        assert!((h * h + 6.0 * h - 1.0).abs() < 1e-9, "{h}");
        assert!((rates.radius() - (3.0 + 5f64.sqrt())).abs() < 1e-9);
        let (system, state) = oscillator(0.0);
        let rates = Rates::of(&system, &state, f64::INFINITY, &CostModel::of(&system)).unwrap();
        assert!((rates.verlet_step() - 1.0).abs() < 1e-9 && (rates.radius() - 2.0).abs() < 1e-9, "{rates:?}");
    }

    /// A chain of so many equal springs between walls: `λ = 4 κ/m sin²(n π/(2n + 2))`. Ten products leave it a few percent too small, and half of
    /// the residual makes up for that.
    #[test]
    fn the_fastest_vibration_of_many_is_not_missed() {
        let links = 60;
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        (0..=links).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 0.5));
        for p in 0..links as usize {
            builder.spring(p, p + 1, Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.0 });
        }
        builder.hold(0);
        builder.hold(links as usize);
        let (system, state) = builder.build().unwrap();
        let found = Rates::of(&system, &state, f64::INFINITY, &CostModel::of(&system)).unwrap().vibration;
        let exact = 8.0 * ((f64::from(links) - 1.0) * std::f64::consts::PI / (2.0 * f64::from(links))).sin();
        assert!((0.0..0.03).contains(&(found / exact - 1.0)), "{found} of {exact}");
    }
}
