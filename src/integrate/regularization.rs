//! Which transverse terms to drop so that A is positive definite for certain: few, and without a factorization.
//!
//! A compressed spring's transverse term takes `c‖P(u_i − u_j)‖²` from `uᵀAu`, with `c = k(1/l − 1/l0) > 0` and
//! `P = I − nnᵀ`. As `‖P(u_i − u_j)‖² ≤ 2‖Pu_i‖² + 2‖Pu_j‖²`, and everything else in A but `M/dt²` takes nothing, A is positive
//! definite if at every particle
//!
//! ```text
//! m_i/dt² I − Σ 2 c P  is positive definite        (c instead of 2c where the spring's other end is held),
//! ```
//!
//! the sum over the particle's compressed springs, and on its free axes alone: u_i has no other components. Springs at particles
//! where this fails lose their transverse terms, the one with the largest c first, until it holds. The terms of all others,
//! stretched or compressed, stay.
//!
//! Every term less leaves more, so the terms that stay are the longest row that holds, from the smallest on: found by one pass
//! over the terms in order, whatever their number.

use crate::force::SpringGeometry;
use crate::operator::Combination;
use crate::spring::Stiffness;
use crate::system::{Axes, Communicator, System};
use nalgebra::{Cholesky, Matrix3, Vector3};

/// A choice of transverse terms to drop; allocated once for a system.
#[derive(Debug, Clone)]
pub struct Regularization {
    /// Of every active spring: `Full`, or `Tension` where its term is dropped.
    options: Vec<Stiffness>,
    /// What every active spring's transverse term takes from each of its ends that can move: 2c, or c from the only one.
    taken: Vec<f64>,
    /// The active springs of every particle: springs[starts[p]..starts[p + 1]].
    starts: Vec<u32>,
    springs: Vec<u32>,
    /// The springs of one particle from the smallest term on; has room for those of any.
    ascending: Vec<u32>,
}

impl Regularization {
    /// Nothing dropped.
    pub fn new(system: &System) -> Self {
        let active = system.active_springs().len();
        let is_free = |p: usize| system.dofs().free_axes(p) != Axes::NONE;
        let mut starts = vec![0u32; system.particles() + 1];
        for (_, ends, _) in system.active() {
            ends.into_iter().filter(|&p| is_free(p)).for_each(|p| starts[p + 1] += 1);
        }
        for p in 0..system.particles() {
            starts[p + 1] += starts[p];
        }
        let most = starts.windows(2).map(|range| range[1] - range[0]).max().unwrap_or(0);
        let mut filled = starts.clone();
        let mut springs = vec![0u32; starts.last().map_or(0, |&end| end as usize)];
        for (position, (_, ends, _)) in (0u32..).zip(system.active()) {
            for p in ends.into_iter().filter(|&p| is_free(p)) {
                springs[filled[p] as usize] = position;
                filled[p] += 1;
            }
        }
        let ascending = Vec::with_capacity(most as usize);
        Self { options: vec![Stiffness::Full; active], taken: vec![0.0; active], starts, springs, ascending }
    }

    /// Chooses for the matrix `combination` at the given extensions, without allocating; returns the number of terms that
    /// are dropped.
    pub fn choose(&mut self, system: &System, extensions: &SpringGeometry, combination: Combination) -> usize {
        for (position, ((_, ends, spring), at)) in extensions.springs(system).enumerate() {
            let transverse = spring.stiffness_block(at, Stiffness::Full).transverse * -combination.stiffness;
            let both_move = ends.iter().all(|&end| system.dofs().free_axes(end) != Axes::NONE);
            self.taken[position] = (-transverse).max(0.0) * if both_move { 2.0 } else { 1.0 };
            self.options[position] = Stiffness::Full;
        }
        if let Some(peers) = system.communicator() {
            return self.choose_together(system, peers, extensions, combination.mass);
        }
        let mut dropped = 0;
        for (particle, mass) in system.masses().iter().enumerate() {
            let free = system.dofs().free_axes(particle);
            dropped += self.relieve(particle, free, combination.mass * mass, extensions);
        }
        dropped
    }

    /// As [`choose`](Self::choose), of a system that is a part, and with the same choice: particles come to a decision after those of lower
    /// numbers, so decisions are made anew until those of ghosts, which others make, have stopped to change. What a particle drops
    /// of the terms that its lower neighbours leave is all from some term on, in the order of the search; so that term is all there is
    /// to say about it.
    fn choose_together(
        &mut self,
        system: &System,
        peers: &dyn Communicator,
        extensions: &SpringGeometry,
        mass_factor: f64,
    ) -> usize {
        let number = |position: usize| peers.spring(system.active_springs()[position] as usize) as f64;
        let ends = |position: usize| system.pair(system.active_springs()[position] as usize);
        // Of every particle: the first term that it drops, as what it takes and its spring's number, and whether there is one.
        let mut first = vec![Vector3::<f64>::zeros(); system.particles()];
        let drops =
            |first: &Vector3<f64>, taken: f64, number: f64| first.z > 0.0 && (taken, -number) >= (first.x, -first.y);
        loop {
            let mut has_changed = false;
            for particle in 0..system.own_particles() {
                let springs = self.starts[particle] as usize..self.starts[particle + 1] as usize;
                for &spring in &self.springs[springs] {
                    let position = spring as usize;
                    let other = ends(position).into_iter().find(|&end| end != particle).unwrap_or(particle);
                    let is_lower = peers.particle(other) < peers.particle(particle);
                    let is_gone = is_lower && drops(&first[other], self.taken[position], number(position));
                    self.options[position] = if is_gone { Stiffness::Tension } else { Stiffness::Full };
                }
                let mass = mass_factor * system.masses()[particle];
                let dropped = self.relieve(particle, system.dofs().free_axes(particle), mass, extensions);
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
            let is_gone = ends(position).into_iter().any(|end| drops(&first[end], taken, number));
            self.options[position] = if is_gone { Stiffness::Tension } else { Stiffness::Full };
            dropped += usize::from(is_gone && system.owns_spring(system.active_springs()[position] as usize));
        }
        let [dropped] = system.total([dropped as f64]);
        dropped as usize
    }

    /// Drops terms at one particle until the rest is small against its mass; returns their number.
    fn relieve(&mut self, particle: usize, free: Axes, mass: f64, extensions: &SpringGeometry) -> usize {
        let Self { options, taken, starts, springs, ascending } = self;
        let springs = &springs[starts[particle] as usize..starts[particle + 1] as usize];
        let extensions = extensions.as_slice();
        let term = |spring: u32| {
            let n = extensions[spring as usize].direction;
            (Matrix3::identity() - n * n.transpose()) * taken[spring as usize]
        };
        ascending.clear();
        let takes = |&spring: &u32| taken[spring as usize] > 0.0 && options[spring as usize] == Stiffness::Full;
        ascending.extend(springs.iter().copied().filter(takes));
        let whole = Matrix3::from_diagonal_element(mass);
        let rest = ascending.iter().fold(whole, |rest, &spring| rest - term(spring));
        if is_positive(&rest, free) {
            return 0;
        }
        // Of equals the first goes, so it stands last.
        ascending.sort_unstable_by(|&a, &b| taken[a as usize].total_cmp(&taken[b as usize]).then(b.cmp(&a)));
        let mut rest = whole;
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

/// Whether a matrix is positive definite on the free axes.
fn is_positive(matrix: &Matrix3<f64>, free: Axes) -> bool {
    let on_free = |i: usize, j: usize| free.contains(i) && free.contains(j);
    let entry = |i, j| if on_free(i, j) { matrix[(i, j)] } else { f64::from(u8::from(i == j)) };
    Cholesky::new(Matrix3::from_fn(entry)).is_some()
}

#[cfg(test)]
mod tests {
    use super::{Regularization, is_positive};
    use crate::force::SpringGeometry;
    use crate::operator::Combination;
    use crate::spring::{Spring, Stiffness};
    use crate::system::{Axes, Constraint, Motion, System, SystemBuilder};
    use nalgebra::Matrix3;

    /// Particle 0 in the middle, joined to one particle on each of the first axes; a spring of length 1 takes c = k(1 − 1/2).
    fn star(stiffnesses: &[f64], held: &[usize]) -> (System, SpringGeometry) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        for (s, &stiffness) in stiffnesses.iter().enumerate() {
            let mut position = [0.0; 3];
            position[s % 3] = if s < 3 { 1.0 } else { -1.0 };
            let end = builder.particle(position, 1e3);
            builder.spring(0, end, Spring { stiffness, rest_length: 2.0, damping: 0.0 });
        }
        for &p in held {
            builder.hold(p);
        }
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        (system, extensions)
    }

    /// Which terms go when the mass term of particle 0 is `mass`.
    fn dropped((system, extensions): &(System, SpringGeometry), mass: f64) -> Vec<bool> {
        let mut softening = Regularization::new(system);
        let count = softening.choose(system, extensions, Combination { mass, damping: 0.0, stiffness: -1.0 });
        let dropped: Vec<bool> = softening.options().iter().map(|&option| option == Stiffness::Tension).collect();
        assert_eq!(count, dropped.iter().filter(|&&dropped| dropped).count());
        dropped
    }

    /// c/l = k(1/l − 1/l0) is 10 here: 20 is needed where both ends move, 10 where one is held.
    #[test]
    fn one_spring_goes_where_it_takes_more_than_the_mass() {
        assert_eq!(dropped(&star(&[20.0], &[]), 20.01), [false]);
        assert_eq!(dropped(&star(&[20.0], &[]), 19.99), [true]);
        assert_eq!(dropped(&star(&[20.0], &[1]), 10.01), [false]);
        assert_eq!(dropped(&star(&[20.0], &[1]), 9.99), [true]);
    }

    /// A spring takes nothing along itself: on different axes two of three take part in each direction.
    #[test]
    fn springs_of_several_axes_are_added_up_by_direction() {
        let star = star(&[20.0, 16.0, 12.0], &[1, 2, 3]);
        // 10 + 8 across the third, 10 + 6 across the second, 8 + 6 across the first.
        assert_eq!(dropped(&star, 18.01), [false, false, false]);
        // Without the strongest 8, 6 and 14 are left; without the second 6.
        assert_eq!(dropped(&star, 17.99), [true, false, false]);
        assert_eq!(dropped(&star, 14.01), [true, false, false]);
        assert_eq!(dropped(&star, 13.99), [true, true, false]);
        assert_eq!(dropped(&star, 5.99), [true, true, true]);
    }

    /// Along x alone 1, along x and y −1 and 3.
    #[test]
    fn couplings_with_axes_that_are_not_free_do_not_count() {
        let matrix = Matrix3::new(1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, -1.0);
        assert!(is_positive(&matrix, Axes::of(&[0])) && is_positive(&matrix, Axes::of(&[1])));
        assert!(!is_positive(&matrix, Axes::of(&[0, 1])) && !is_positive(&matrix, Axes::of(&[2])));
    }

    /// Two springs along x take 10 each across, which a particle that can move along x alone does not feel, nor one of a
    /// planar scene along z: there the two that take 10 along y, and only they, are too much.
    #[test]
    fn axes_that_are_not_free_are_not_tested() {
        for (free, mass, expected) in [
            (Axes::of(&[0]), 0.01, [false, false]),
            (Axes::of(&[0, 1]), 19.99, [true, false]),
            (Axes::of(&[0, 1]), 20.01, [false, false]),
            (Axes::ALL, 19.99, [true, false]),
        ] {
            let mut builder = SystemBuilder::new();
            for x in [0.0, 1.0, -1.0] {
                builder.particle([x, 0.0, 0.0], 1.0);
            }
            builder.hold(1).hold(2);
            let held = Axes::ALL.without(free);
            builder.constrain(Constraint { particles: vec![0], axes: held, motion: Motion::Held });
            for end in [1, 2] {
                builder.spring(0, end, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
            }
            let (system, state) = builder.build().unwrap();
            let system = (system.clone(), SpringGeometry::at(&system, &state.positions).unwrap());
            assert_eq!(dropped(&system, mass), expected, "{free:?} {mass}");
        }
    }

    /// A spring at 45° to both axes takes half of its 10 along each, and as much from one to the other: the particle that moves along one
    /// alone does not feel that.
    #[test]
    fn what_couples_to_an_axis_that_is_not_free_does_not_count() {
        for (free, mass, expected) in
            [(&[0][..], 5.01, false), (&[0], 4.99, true), (&[0, 1], 9.99, true), (&[0, 1], 10.01, false)]
        {
            let mut builder = SystemBuilder::new();
            let half = 0.5f64.sqrt();
            builder.particle([0.0; 3], 1.0);
            builder.particle([half, half, 0.0], 1.0);
            builder.hold(1);
            let axes = Axes::ALL.without(Axes::of(free));
            builder.constrain(Constraint { particles: vec![0], axes, motion: Motion::Held });
            builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
            let (system, state) = builder.build().unwrap();
            let system = (system.clone(), SpringGeometry::at(&system, &state.positions).unwrap());
            assert_eq!(dropped(&system, mass), [expected], "{free:?} {mass}");
        }
    }

    /// The terms that stay at a hub are the longest row from the smallest on, however many there are: the work is that of
    /// sorting them. (One search for the largest after another would take 10¹⁰ of these sums.)
    #[test]
    fn hubs_are_relieved_in_one_pass() {
        let spokes = 100_000;
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        for spoke in 1..=spokes {
            builder.particle([1.0, 0.0, 0.0], 1.0);
            builder.hold(spoke);
            builder.spring(0, spoke, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
        }
        let (system, state) = builder.build().unwrap();
        let system = (system.clone(), SpringGeometry::at(&system, &state.positions).unwrap());
        // Each takes 10: half of them are too much by the half.
        let dropped = dropped(&system, 5.0 * f64::from(u32::try_from(spokes).unwrap()) + 5.0);
        assert_eq!(dropped.iter().filter(|&&dropped| dropped).count(), spokes / 2);
        assert!(dropped[..spokes / 2].iter().all(|&dropped| dropped));
    }

    #[test]
    fn of_equals_the_first_goes() {
        assert_eq!(dropped(&star(&[20.0, 20.0], &[1, 2]), 19.99), [true, false]);
    }

    /// Factors of M and K other than those of a step scale both sides.
    #[test]
    fn the_combination_scales_both_sides() {
        let (system, extensions) = star(&[20.0], &[]);
        let mut softening = Regularization::new(&system);
        let mut choose =
            |mass, stiffness| softening.choose(&system, &extensions, Combination { mass, damping: 0.0, stiffness });
        assert_eq!([choose(60.1, -3.0), choose(59.9, -3.0), choose(10.1, -0.5), choose(9.9, -0.5)], [0, 1, 0, 1]);
        // The other sign makes compressed springs stiffer.
        assert_eq!(choose(0.1, 1.0), 0);
    }

    /// The mass counts, not its inverse.
    #[test]
    fn heavier_particles_keep_more() {
        let mut builder = SystemBuilder::new();
        for x in 0..2 {
            builder.particle([f64::from(x), 0.0, 0.0], 4.0);
        }
        builder.hold(1);
        builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let system = (system.clone(), SpringGeometry::at(&system, &state.positions).unwrap());
        assert_eq!(dropped(&system, 2.51), [false]);
        assert_eq!(dropped(&system, 2.49), [true]);
    }
}
