//! The parts of a scene that do not know of each other.

use crate::system::{Axes, System};

/// Particles joined by springs through particles that are not wholly prescribed.
pub(super) struct Parts {
    part: Vec<usize>,
}

impl Parts {
    pub fn of(system: &System) -> Self {
        let mut part: Vec<usize> = (0..system.particles()).collect();
        let is_free = |p: usize| system.dofs().free_axes(p) != Axes::NONE;
        for (_, [i, j], _) in system.active().filter(|(_, pair, _)| pair.iter().all(|&p| is_free(p))) {
            let (a, b) = (root(&mut part, i), root(&mut part, j));
            part[a.max(b)] = a.min(b);
        }
        for p in 0..part.len() {
            part[p] = root(&mut part, p);
        }
        Self { part }
    }

    pub fn part(&self, particle: usize) -> usize {
        self.part[particle]
    }
}

/// The representative of a particle's part, with path halving.
fn root(part: &mut [usize], mut p: usize) -> usize {
    while part[p] != p {
        part[p] = part[part[p]];
        p = part[p];
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_end_at_prescribed_particles() {
        let mut builder = crate::SystemBuilder::new();
        for x in 0..5 {
            builder.particle([f64::from(x), 0.0, 0.0], 1.0);
        }
        for i in 0..4 {
            builder.spring(i, i + 1, crate::Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        builder.hold(2);
        let (system, _) = builder.build().unwrap();
        let parts = Parts::of(&system);
        assert_eq!(parts.part, [0, 0, 2, 3, 3]);
    }
}
