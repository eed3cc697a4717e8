//! How fast a scene can move, and what steps that asks of explicit methods.

use crate::error::Result;
use crate::force::Extensions;
use crate::spring::{SpringBlock, Stiffness};
use crate::system::{Axes, State, System};

/// What the bounds take, in force evaluations: with damping, and without. (Measured: 3.3 to 5.8 and 2.9 to 4.0, on one-dimensional scenes most.)
const DAMPED: f64 = 4.0;
const UNDAMPED: f64 = 3.3;

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
    pub fn of(system: &System, state: &State) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let is_damped = system.is_damped();
        let mut sums = vec![Sums::default(); system.particles()];
        for ((_, ends, spring), at) in extensions.springs(system) {
            let SpringBlock { direction: n, transverse, axial } = spring.stiffness_block(at, Stiffness::Tension);
            let nn = [n.x * n.x, n.x * n.y, n.x * n.z, n.y * n.y, n.y * n.z, n.z * n.z];
            let along = nn.map(|nn| (axial - transverse) * nn);
            for end in ends {
                sums[end].across += transverse;
                add(&mut sums[end].along, &along);
            }
            if is_damped {
                let damping = nn.map(|nn| spring.damping * nn);
                ends.iter().for_each(|&end| add(&mut sums[end].damping, &damping));
            }
        }
        let [vibration, damping] = largest(system, &sums, is_damped);
        let cost = if is_damped { DAMPED } else { UNDAMPED };
        Ok(Self { vibration: vibration.sqrt(), damping, cost })
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

/// Of a symmetric matrix of order 3, from above and by at most 2·10⁻⁵ of itself too large if it is positive semidefinite. With `q = ⅓ tr A`, `p² = ⅙ tr (A − q)²` and
/// `r = ½ det((A − q)/p)` it is `q + p t` with the largest t for which
///
/// ```text
/// (t − 1)² (t + 2) = 2 (1 + r),     1 ≤ t ≤ min(2, 1 + √(⅔ (1 + r)))
/// ```
///
/// (O. K. Smith, Eigenvalues of a symmetric 3 × 3 matrix, Communications of the ACM 4, 1961). From that bound two steps of Newton's method remain above it,
/// the cubic being convex there, and take half the time of its roots by cosines.
fn largest_eigenvalue(&[xx, xy, xz, yy, yz, zz]: &[f64; 6]) -> f64 {
    let q = (xx + yy + zz) / 3.0;
    let [a, b, c] = [xx - q, yy - q, zz - q];
    let square = (a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0;
    if square == 0.0 {
        return q;
    }
    let p = square.sqrt();
    // Scaled first: p³ under- and overflows long before p does.
    let inverse = 1.0 / p;
    let [a, b, c, xy, xz, yz] = [a, b, c, xy, xz, yz].map(|entry| entry * inverse);
    let determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz);
    let s = (1.0 + 0.5 * determinant).clamp(0.0, 2.0);
    let mut t = (1.0 + (2.0 / 3.0 * s).sqrt()).min(2.0);
    for _ in 0..2 {
        // (t − 1)(t + 1)·3 is the slope; at a double root there is nothing to do.
        let slope = 3.0 * (t * t - 1.0);
        if slope > 0.0 {
            t -= ((t - 1.0) * (t - 1.0) * (t + 2.0) - 2.0 * s) / slope;
        }
    }
    q + p * t
}

/// Of the springs' blocks at a particle: `Σ α`, and of `Σ (β − α) nnᵀ` and the damping blocks one triangle, row by row.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    across: f64,
    along: [f64; 6],
    damping: [f64; 6],
}

fn add(sum: &mut [f64; 6], block: &[f64; 6]) {
    sum.iter_mut().zip(block).for_each(|(sum, entry)| *sum += entry);
}

/// A bound of `λ_max` of the springs' blocks over the masses, from their sums at each particle. A block S ≥ 0 between i and j has, for every
/// t > 0,
///
/// ```text
/// (u_i − u_j)ᵀ S (u_i − u_j) ≤ (1 + t) u_iᵀ S u_i + (1 + 1/t) u_jᵀ S u_j.
/// ```
///
/// With `p_i = λ_max(Σ S)/m_i` over the springs of particle i, zero for one that is held, and `t = p_j/p_i`,
///
/// ```text
/// λ_max ≤ max_i λ_max(Σ (1 + p_j/p_i) S)/m_i ≤ max (p_i + p_j) over all springs.
/// ```
///
/// For one spring, for a long chain of equal ones and for a hub with spokes along a line the bound is reached. It is what W. N. Anderson and
/// T. D. Morley (Eigenvalues of the Laplacian of a graph, 1985) found for graphs, `λ ≤ max (d_i + d_j)`, by blocks. It is at most twice too large,
/// since `λ_max ≥ p_i`: a particle may move alone.
///
/// Both at once: of stiffness and, where there is any, of damping.
fn largest(system: &System, sums: &[Sums], is_damped: bool) -> [f64; 2] {
    let own = |(end, sums): (usize, &Sums)| {
        let is_free = system.dofs().free_axes(end) != Axes::NONE;
        let inverse = if is_free { 1.0 / system.masses()[end] } else { 0.0 };
        let damping = if is_damped { largest_eigenvalue(&sums.damping) } else { 0.0 };
        [sums.across + largest_eigenvalue(&sums.along), damping].map(|largest| largest * inverse)
    };
    let own: Vec<[f64; 2]> = sums.iter().enumerate().map(own).collect();
    let of_pairs = system.active().map(|(_, [i, j], _)| [own[i][0] + own[j][0], own[i][1] + own[j][1]]);
    of_pairs.fold([0.0; 2], |largest, both| [largest[0].max(both[0]), largest[1].max(both[1])])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::{Combination, LinearOperator, SystemOperator};
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use nalgebra::{DMatrix, Matrix3};

    /// A particle of 2 kg on a spring of 8 N/m, damped by 12 N·s/m: ω = 2, γ = 6.
    fn oscillator(damping: f64) -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 2.0);
        builder.spring(0, 1, Spring { stiffness: 8.0, rest_length: 1.0, damping });
        builder.hold(0);
        builder.build().unwrap()
    }

    fn of(system: &System, state: &State) -> Rates {
        Rates::of(system, state).unwrap()
    }

    /// The largest eigenvalues of −M⁻¹K and −M⁻¹G, of dense matrices.
    fn exact(system: &System, state: &State) -> [f64; 2] {
        let extensions = Extensions::at(system, &state.positions).unwrap();
        let n = system.dofs().len();
        let mass = |row: usize| system.masses()[system.dofs().dof(row).particle];
        [
            Combination { mass: 0.0, damping: 0.0, stiffness: -1.0 },
            Combination { mass: 0.0, damping: -1.0, stiffness: 0.0 },
        ]
        .map(|combination| {
            let operator = SystemOperator::new(system, &extensions, Stiffness::Full, combination);
            let mut scaled = DMatrix::zeros(n, n);
            for column in 0..n {
                let (mut unit, mut product) = (vec![0.0; n], vec![0.0; n]);
                unit[column] = 1.0;
                operator.apply(&unit, &mut product);
                (0..n).for_each(|row| scaled[(row, column)] = product[row] / (mass(row) * mass(column)).sqrt());
            }
            scaled.symmetric_eigenvalues().max()
        })
    }

    #[test]
    fn the_largest_eigenvalue_is_bounded_closely() {
        for entries in [
            [2.0, 0.0, 0.0, 2.0, 0.0, 2.0],
            [1.0, 0.0, 0.0, -3.0, 0.0, 0.5],
            [4.0, 2.0, -1.0, 3.0, 0.7, -2.0],
            [1e-9, 2e-9, 3e-9, 4e-9, 5e-9, 6e-9],
            [1e-120, 2e-120, 3e-120, 4e-120, 5e-120, 6e-120],
            [1e120, 2e120, 3e120, 4e120, 5e120, 6e120],
            [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
            // The largest twice: at a double root of the cubic.
            [3.0, 0.0, 0.0, 3.0, 0.0, 0.0],
            [0.0; 6],
        ] {
            let [xx, xy, xz, yy, yz, zz] = entries;
            let a = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let expected = a.symmetric_eigenvalues().max();
            let excess = (largest_eigenvalue(&entries) - expected) / a.norm().max(f64::MIN_POSITIVE);
            assert!((-1e-14..1e-4).contains(&excess), "{entries:?}: {excess:e}");
        }
    }

    /// Tetrahedra of unequal springs and masses, pulled and pressed, free and held: the bound is one, and at most twice too large, since a particle
    /// that moves alone shows that `λ_max ≥ p_i`.
    #[test]
    fn rates_are_bounded_from_above_and_closely() {
        let mut random = 0.0f64;
        let mut next = || {
            random = (random + 0.618_033_988_749_894_9).fract();
            random
        };
        for case in 0..40 {
            let mut builder = SystemBuilder::new();
            for x in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.9, 0.0], [0.4, 0.3, 0.8]] {
                builder.particle(x.map(|x| x + 0.2 * next()), 0.1 + 3.0 * next());
            }
            for [i, j] in [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]] {
                let [stiffness, rest_length, damping] = [1.0 + 20.0 * next(), 0.6 + 0.8 * next(), next()];
                builder.spring(i, j, Spring { stiffness, rest_length, damping });
            }
            (0..case % 3).for_each(|particle| _ = builder.hold(particle));
            let (system, state) = builder.build().unwrap();
            let [vibration, damping] = exact(&system, &state);
            let found = of(&system, &state);
            let near = |bound: f64, exact: f64| (1.0 - 1e-12..2.0).contains(&(bound / exact));
            assert!(near(found.vibration.powi(2), vibration) && near(found.damping, damping), "{case}: {found:?}");
        }
    }

    /// One spring between two masses, `κ (1/m₁ + 1/m₂)`, and a hub with spokes along a line that move against it, `κ (1/m + n/M)`.
    #[test]
    fn the_bound_is_reached_by_a_spring_and_by_a_hub() {
        for (spokes, hub) in [(1, 3.0), (7, 0.5), (50, 100.0)] {
            let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
            builder.particle([0.0; 3], hub);
            for spoke in 1..=spokes {
                builder.particle([1.0, 0.0, 0.0], 2.0);
                builder.spring(0, spoke, Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.5 });
            }
            let (system, state) = builder.build().unwrap();
            let (found, per_mass) = (of(&system, &state), 0.5 + spokes as f64 / hub);
            assert!((found.vibration.powi(2) / (8.0 * per_mass) - 1.0).abs() < 1e-12, "{spokes}: {found:?}");
            assert!((found.damping / (0.5 * per_mass) - 1.0).abs() < 1e-12, "{spokes}: {found:?}");
        }
    }

    #[test]
    fn the_rates_of_an_oscillator() {
        let (system, state) = oscillator(12.0);
        let rates = of(&system, &state);
        assert!((rates.vibration - 2.0).abs() < 1e-9 && (rates.damping - 6.0).abs() < 1e-9, "{rates:?}");
        let h = rates.verlet_step();
        assert!((h * h + 6.0 * h - 1.0).abs() < 1e-9, "{h}");
        assert!((rates.radius() - (3.0 + 5f64.sqrt())).abs() < 1e-9);
        let (system, state) = oscillator(0.0);
        let rates = of(&system, &state);
        assert!((rates.verlet_step() - 1.0).abs() < 1e-9 && (rates.radius() - 2.0).abs() < 1e-9, "{rates:?}");
    }

    /// Where some springs are not damped: their ends have nothing to weigh the others by.
    #[test]
    fn springs_without_damping_do_not_count_for_it() {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        (0..4).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 2.0));
        for (p, damping) in [(0, 0.0), (1, 3.0), (2, 0.0)] {
            builder.spring(p, p + 1, Spring { stiffness: 8.0, rest_length: 1.0, damping });
        }
        let (system, state) = builder.build().unwrap();
        assert!((of(&system, &state).damping - 3.0).abs() < 1e-12);
    }

    #[test]
    fn bounds_of_damping_cost_more() {
        for (damping, cost) in [(12.0, 4.0), (0.0, 3.3)] {
            let (system, state) = oscillator(damping);
            assert_eq!(of(&system, &state).cost, cost);
        }
    }

    /// A chain of so many equal springs between walls: `λ = 4 κ/m sin²(n π/(2n + 2))`.
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
        let found = of(&system, &state).vibration;
        let exact = 8.0 * ((f64::from(links) - 1.0) * std::f64::consts::PI / (2.0 * f64::from(links))).sin();
        assert!((0.0..0.001).contains(&(found / exact - 1.0)), "{found} of {exact}");
    }
}
