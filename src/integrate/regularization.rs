//! A regularization of A that is certain to be positive definite: few dropped transverse terms, without a factorization.
//!
//! A compressed spring's transverse term takes `c‖P(u_i − u_j)‖²` from `uᵀAu`, with `c = k(1/l − 1/l0) > 0` and `P = I − nnᵀ`. As
//! `‖P(u_i − u_j)‖² ≤ 2‖Pu_i‖² + 2‖Pu_j‖²`, and everything else in A but `M/dt²` takes nothing, A is positive definite if at every particle, on its
//! free axes, `m_i/dt² I − Σ 2 c P` is, the sum over the particle's compressed springs (c instead of 2c where the spring's other end is held).
//! Springs at particles where this fails lose their transverse terms, the one with the largest c first, until it holds. So the terms that stay are
//! the longest series that holds, from the smallest on: one pass over the sorted terms finds it.

use crate::error::{Invalid, Result};
use crate::force::SpringGeometry;
use crate::operator::Combination;
use crate::spring::Stiffness;
use crate::system::{Axes, Communicator, System};
use nalgebra::{Cholesky, Matrix3, Vector3};

/// A choice of transverse terms to drop; allocated once for a system.
#[derive(Debug, Clone)]
pub struct Regularization {
    particles: usize,
    /// For every active spring: `Full`, or `Tension` where its term is dropped.
    options: Vec<Stiffness>,
    /// For every active spring, what its transverse term takes from each movable end: 2c, or c from the only one.
    taken: Vec<f64>,
    /// Every movable end of an active spring, as particle and spring, sorted.
    ends: Vec<(u32, u32)>,
    /// The springs of one particle from the smallest term on.
    ascending: Vec<u32>,
}

impl Regularization {
    /// Nothing dropped.
    pub fn new(system: &System) -> Self {
        let active = system.active_springs().len();
        let is_free = |p: &usize| system.dofs().free_axes(*p) != Axes::NONE;
        let of_spring = |(spring, (_, pair, _)): (u32, (usize, [usize; 2], _))| {
            pair.into_iter().filter(is_free).map(move |p| (p as u32, spring))
        };
        let mut ends: Vec<(u32, u32)> = (0..).zip(system.active()).flat_map(of_spring).collect();
        ends.sort_unstable();
        let most = ends.chunk_by(|a, b| a.0 == b.0).map(<[_]>::len).max().unwrap_or(0);
        Self {
            particles: system.particles(),
            options: vec![Stiffness::Full; active],
            taken: vec![0.0; active],
            ends,
            ascending: Vec::with_capacity(most),
        }
    }

    /// Chooses for the matrix `combination` at the given extensions, without allocating; returns the number of dropped terms.
    ///
    /// # Errors
    /// A system, or extensions, other than those that the regularization was made for: the number of springs or particles differs.
    pub fn choose(
        &mut self,
        system: &System,
        extensions: &SpringGeometry,
        combination: Combination,
    ) -> Result<usize, Invalid> {
        let springs = self.options.len();
        let found = [system.particles(), system.active_springs().len(), extensions.as_slice().len()];
        if found != [self.particles, springs, springs] {
            let expected = format!("must have {} particles and {springs} active springs", self.particles);
            return Err(Invalid::new("system", format!("{found:?} particles, springs and extensions"), expected));
        }
        Ok(self.update(system, extensions, combination))
    }

    /// As [`choose`](Self::choose), for the same system.
    pub(super) fn update(&mut self, system: &System, extensions: &SpringGeometry, combination: Combination) -> usize {
        for (position, ((_, ends, spring), at)) in extensions.springs(system).enumerate() {
            let transverse = spring.stiffness_block(at, Stiffness::Full).transverse * -combination.stiffness;
            let both_move = ends.iter().all(|&end| system.dofs().free_axes(end) != Axes::NONE);
            self.taken[position] = (-transverse).max(0.0) * if both_move { 2.0 } else { 1.0 };
            self.options[position] = Stiffness::Full;
        }
        let ends = std::mem::take(&mut self.ends);
        let particles = ends.chunk_by(|a, b| a.0 == b.0);
        let dropped = match system.communicator() {
            Some(peers) => self.choose_together(system, peers, extensions, combination.mass, &ends),
            None => particles.map(|ends| self.drop_terms(system, extensions, combination.mass, ends)).sum(),
        };
        self.ends = ends;
        dropped
    }

    /// The same choice for a part of a system. A particle decides after its neighbours of lower numbers, so decisions are repeated until those of
    /// ghosts no longer change. A particle drops, of the terms that its lower neighbours leave, all from some term on: that term is the whole
    /// decision.
    fn choose_together(
        &mut self,
        system: &System,
        peers: &dyn Communicator,
        extensions: &SpringGeometry,
        mass_factor: f64,
        ends: &[(u32, u32)],
    ) -> usize {
        let number = |position: usize| peers.spring(system.active_springs()[position] as usize) as f64;
        let pair = |position: usize| system.pair(system.active_springs()[position] as usize);
        // For every particle the first term that it drops: what the term takes, the number of its spring, and 1 where there is one.
        let mut first = vec![Vector3::<f64>::zeros(); system.particles()];
        let drops =
            |first: &Vector3<f64>, taken: f64, number: f64| first.z > 0.0 && (taken, -number) >= (first.x, -first.y);
        loop {
            let mut has_changed = false;
            for ends in ends.chunk_by(|a, b| a.0 == b.0) {
                let particle = ends[0].0 as usize;
                if particle >= system.own_particles() {
                    break;
                }
                for position in ends.iter().map(|end| end.1 as usize) {
                    let other = pair(position).into_iter().find(|&end| end != particle).unwrap_or(particle);
                    let is_lower = peers.particle(other) < peers.particle(particle);
                    let is_dropped = is_lower && drops(&first[other], self.taken[position], number(position));
                    self.options[position] = if is_dropped { Stiffness::Tension } else { Stiffness::Full };
                }
                let dropped = self.drop_terms(system, extensions, mass_factor, ends);
                // There is none where nothing is dropped.
                let at = self.ascending.len() - dropped;
                let decision = self.ascending.get(at).map_or_else(Vector3::zeros, |&spring| {
                    Vector3::new(self.taken[spring as usize], number(spring as usize), 1.0)
                });
                has_changed |= decision != first[particle];
                first[particle] = decision;
            }
            peers.halo_exchange(&mut first);
            let [changed] = system.largest([f64::from(u8::from(has_changed))]);
            if changed == 0.0 {
                break;
            }
        }
        let mut dropped = 0;
        for position in 0..self.options.len() {
            let (taken, number) = (self.taken[position], number(position));
            let is_dropped = pair(position).into_iter().any(|end| drops(&first[end], taken, number));
            self.options[position] = if is_dropped { Stiffness::Tension } else { Stiffness::Full };
            dropped += usize::from(is_dropped && system.owns_spring(system.active_springs()[position] as usize));
        }
        let [dropped] = system.total([dropped as f64]);
        dropped as usize
    }

    /// Drops terms at the particle of these ends until the rest is small against its mass; returns their number.
    fn drop_terms(
        &mut self,
        system: &System,
        extensions: &SpringGeometry,
        mass_factor: f64,
        ends: &[(u32, u32)],
    ) -> usize {
        let Self { options, taken, ascending, .. } = self;
        let particle = ends[0].0 as usize;
        let free = system.dofs().free_axes(particle);
        let extensions = extensions.as_slice();
        let term = |spring: u32| {
            let n = extensions[spring as usize].direction;
            (Matrix3::identity() - n * n.transpose()) * taken[spring as usize]
        };
        ascending.clear();
        let takes = |&spring: &u32| taken[spring as usize] > 0.0 && options[spring as usize] == Stiffness::Full;
        ascending.extend(ends.iter().map(|end| end.1).filter(takes));
        let inertia = Matrix3::from_diagonal_element(mass_factor * system.masses()[particle]);
        let rest = ascending.iter().fold(inertia, |rest, &spring| rest - term(spring));
        if is_positive(&rest, free) {
            return 0;
        }
        // Of equal terms that of the first spring is dropped first.
        ascending.sort_unstable_by(|&a, &b| taken[a as usize].total_cmp(&taken[b as usize]).then(b.cmp(&a)));
        let mut rest = inertia;
        let stay = ascending.iter().take_while(|&&spring| {
            rest -= term(spring);
            is_positive(&rest, free)
        });
        let stay = stay.count();
        for &spring in &ascending[stay..] {
            options[spring as usize] = Stiffness::Tension;
        }
        ascending.len() - stay
    }

    /// The choice: an option for every active spring, in their order.
    pub fn options(&self) -> &[Stiffness] {
        &self.options
    }
}
fn is_positive(matrix: &Matrix3<f64>, free: Axes) -> bool {
    let on_free = |i: usize, j: usize| free.contains(i) && free.contains(j);
    let entry = |i, j| if on_free(i, j) { matrix[(i, j)] } else { f64::from(u8::from(i == j)) };
    Cholesky::new(Matrix3::from_fn(entry)).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::fixtures::row;
    use crate::system::{Constraint, Motion, SystemBuilder};

    fn built(builder: SystemBuilder) -> (System, SpringGeometry) {
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        (system, extensions)
    }

    /// Particle 0 in the middle, on springs to particles at a distance of 1. There a spring is half compressed: c = k(1 − 1/2).
    fn star(springs: &[([f64; 3], f64)]) -> SystemBuilder {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        for &(position, stiffness) in springs {
            let end = builder.particle(position, 1e3);
            builder.spring(0, end, Spring { stiffness, rest_length: 2.0, damping: 0.0 });
        }
        builder
    }

    const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    /// Springs along the first axes.
    fn on_axes(stiffnesses: &[f64], held: &[usize]) -> (System, SpringGeometry) {
        let springs: Vec<_> = AXES.into_iter().zip(stiffnesses.iter().copied()).collect();
        let mut builder = star(&springs);
        builder.constrain(Constraint::hold(held.iter().copied()));
        built(builder)
    }

    /// The dropped terms where a mass of 1 kg has the inertia `mass`.
    fn dropped((system, extensions): &(System, SpringGeometry), mass: f64) -> Vec<bool> {
        let mut regularization = Regularization::new(system);
        let combination = Combination { mass, damping: 0.0, stiffness: -1.0 };
        let count = regularization.choose(system, extensions, combination).unwrap();
        let dropped: Vec<bool> = regularization.options().iter().map(|&o| o == Stiffness::Tension).collect();
        assert_eq!(count, dropped.iter().filter(|&&dropped| dropped).count());
        dropped
    }

    /// c is 10 here: 20 is needed where both ends move, 10 where one is held.
    #[test]
    fn one_term_is_dropped_where_it_exceeds_the_inertia() {
        for (held, limit) in [(&[][..], 20.0), (&[1], 10.0)] {
            assert_eq!(dropped(&on_axes(&[20.0], held), limit + 0.01), [false]);
            assert_eq!(dropped(&on_axes(&[20.0], held), limit - 0.01), [true]);
        }
    }

    /// A spring takes nothing along itself: on different axes two of three contribute in each direction. Of equal terms the first is dropped.
    #[test]
    fn terms_are_added_up_by_direction() {
        let unequal = on_axes(&[20.0, 16.0, 12.0], &[1, 2, 3]);
        // 10 + 8 across the third, 10 + 6 across the second, 8 + 6 across the first. Without the strongest 8, 6 and 14 are left; without the second 6.
        for (mass, count) in [(18.01, 0), (17.99, 1), (14.01, 1), (13.99, 2), (5.99, 3)] {
            assert_eq!(dropped(&unequal, mass), [count > 0, count > 1, count > 2], "{mass}");
        }
        assert_eq!(dropped(&on_axes(&[20.0, 20.0], &[1, 2]), 19.99), [true, false]);
    }

    /// Particle 0 can move along some axes alone. Two springs along x take 10 each across; one at 45° to x and y takes half of its 10
    /// along each, and as much from one to the other.
    #[test]
    fn axes_that_are_not_free_are_ignored() {
        let half = 0.5f64.sqrt();
        let along = &[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]][..];
        let diagonal = &[[half, half, 0.0]];
        for (ends, free, mass, expected) in [
            (along, &[0][..], 0.01, &[false, false][..]),
            (along, &[0, 1], 19.99, &[true, false]),
            (along, &[0, 1], 20.01, &[false, false]),
            (along, &[0, 1, 2], 19.99, &[true, false]),
            (diagonal, &[0], 5.01, &[false]),
            (diagonal, &[0], 4.99, &[true]),
            (diagonal, &[0, 1], 9.99, &[true]),
            (diagonal, &[0, 1], 10.01, &[false]),
        ] {
            let mut builder = star(&ends.iter().map(|&end| (end, 20.0)).collect::<Vec<_>>());
            builder.constrain(Constraint::hold(1..=ends.len()));
            let axes = Axes::ALL.without(Axes::of(free));
            builder.constrain(Constraint { particles: vec![0], axes, motion: Motion::Held });
            assert_eq!(dropped(&built(builder), mass), expected, "{free:?} {mass}");
        }
        // Along x alone 1, along x and y −1 and 3.
        let matrix = Matrix3::new(1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, -1.0);
        assert!(is_positive(&matrix, Axes::of(&[0])) && is_positive(&matrix, Axes::of(&[1])));
        assert!(!is_positive(&matrix, Axes::of(&[0, 1])) && !is_positive(&matrix, Axes::of(&[2])));
    }

    /// At a hub of 100 000 springs that take 10 each, half of them are dropped by one sort. (One search for the largest after another would
    /// take 10¹⁰ of these sums.)
    #[test]
    fn hubs_take_one_pass() {
        let spokes = 100_000;
        let mut builder = star(&vec![(AXES[0], 20.0); spokes]);
        builder.constrain(Constraint::hold(1..=spokes));
        let dropped = dropped(&built(builder), 5.0 * spokes as f64 + 5.0);
        assert_eq!(dropped.iter().filter(|&&dropped| dropped).count(), spokes / 2);
        assert!(dropped[..spokes / 2].iter().all(|&dropped| dropped));
    }

    /// Factors of M and K other than those of a step scale both sides. Other systems are refused.
    #[test]
    fn the_combination_scales_both_sides() {
        let (system, extensions) = on_axes(&[20.0], &[]);
        let mut regularization = Regularization::new(&system);
        let mut choose = |mass, stiffness| {
            regularization.choose(&system, &extensions, Combination { mass, damping: 0.0, stiffness }).unwrap()
        };
        assert_eq!([choose(60.1, -3.0), choose(59.9, -3.0), choose(10.1, -0.5), choose(9.9, -0.5)], [0, 1, 0, 1]);
        // The other sign makes compressed springs stiffer.
        assert_eq!(choose(0.1, 1.0), 0);

        let (other, state) = row(3);
        let foreign = SpringGeometry::at(&other, &state.positions).unwrap();
        let combination = Combination::step(1.0);
        assert!(regularization.choose(&other, &foreign, combination).is_err());
        assert!(regularization.choose(&system, &foreign, combination).is_err());
    }
}
