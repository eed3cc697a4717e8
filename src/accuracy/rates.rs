//! How fast a scene can move, and what steps that asks of explicit methods.

use crate::error::Result;
use crate::force::Extensions;
use crate::inspect::lanczos_ends;
use crate::linear::CostModel;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};

/// Products by which an end of a spectrum is found, to a few percent; a frequency is its root, known twice as well.
const PRODUCTS: usize = 10;

/// The fastest vibration and the strongest damping of a state, in 1/s.
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
    /// Of a state: by Lanczos' method, matrix-free; a bound, which is cheaper, where it shows that explicit steps may be `long` seconds.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn of(system: &System, state: &State, long: f64, costs: &CostModel) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let bound = Self::bound(system, &extensions, costs);
        if bound.verlet_step() >= long {
            return Ok(bound);
        }
        let masses = &system.masses();
        let scale: Vec<f64> =
            (0..system.dofs().len()).map(|row| 1.0 / masses[system.dofs().dof(row).particle].sqrt()).collect();
        let mut cost = 0.0;
        let mut largest = |combination: Combination| {
            let operator = SystemOperator::new(system, &extensions, Stiffness::Full, combination);
            let mut scaled = vec![0.0; scale.len()];
            let mut products = 0;
            let [_, end] = lanczos_ends(scale.len(), PRODUCTS, |x, y| {
                for ((scaled, x), scale) in scaled.iter_mut().zip(x).zip(&scale) {
                    *scaled = x * scale;
                }
                operator.apply(&scaled, y);
                for (y, scale) in y.iter_mut().zip(&scale) {
                    *y *= scale;
                }
                products += 1;
            });
            cost += costs.assembly() + f64::from(products) * costs.product();
            // An eigenvalue lies within the residual: as a rule above, and nearer.
            let value = end.value + 0.5 * end.residual;
            if value > 0.0 { value } else { 0.0 }
        };
        let stiffness = Combination { mass: 0.0, damping: 0.0, stiffness: -1.0 };
        let vibration = largest(stiffness).sqrt();
        let damping =
            if system.is_damped() { largest(Combination { mass: 0.0, damping: -1.0, stiffness: 0.0 }) } else { 0.0 };
        Ok(Self { vibration, damping, cost })
    }

    /// Bounds of both, by the theorem of Gershgorin: a spring of stiffness κ between particles of masses m has the energy
    /// `½κ |u_i − u_j|² ≤ κ (|u_i|² + |u_j|²)`, so that `λ_max(−M⁻¹K) ≤ max_i Σ 2κ/m_i` over the springs of particle i.
    fn bound(system: &System, extensions: &Extensions, costs: &CostModel) -> Self {
        let mut sums = vec![[0.0; 2]; system.particles()];
        for ((_, ends, spring), _) in extensions.springs(system) {
            // Along the spring; across it κ is less.
            let stiffness = spring.stiffness / spring.rest_length;
            for end in ends {
                if let Some([stiffnesses, dampings]) = sums.get_mut(end) {
                    *stiffnesses += 2.0 * stiffness;
                    *dampings += 2.0 * spring.damping;
                }
            }
        }
        let largest = |which: usize| {
            let rates = sums.iter().zip(system.masses()).map(|(sums, mass)| sums[which] / mass);
            rates.fold(0.0, f64::max)
        };
        Self { vibration: largest(0).sqrt(), damping: largest(1), cost: costs.assembly() }
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
