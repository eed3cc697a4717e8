//! What the numbers of a scene do not let a check judge.

use super::{TestCase, reference};
use crate::system::Motion;
use nalgebra::Vector3;

/// Steps that are so many times as long as resolving ones: the square of it times u is a tenth of a percent.
const BEYOND: f64 = 1e5;

impl TestCase {
    /// The largest time, in s, in which no path has a kink.
    pub(super) fn time_to_kink(&self) -> f64 {
        let corners = |motion: &Motion| match motion {
            Motion::Path { times, .. } => times.clone(),
            Motion::Held | Motion::Velocity(_) => Vec::new(),
        };
        let start = self.state.time;
        let times = self.system.prescribed().motions().iter().flat_map(corners).filter(|&time| time > start);
        times.fold(f64::INFINITY, f64::min) - start
    }

    /// Accelerations at the start by the forces of springs and weight, in m/s²; zero along prescribed axes.
    pub(super) fn accelerations(&self) -> Vec<Vector3<f64>> {
        let Self { system, state, .. } = self;
        let links = reference::links(system, &state.positions);
        let elastic = reference::sum(&links, system.particles(), reference::Link::elastic_force);
        let damping = reference::damping_product(&links, &state.velocities);
        let acceleration = |p: usize| {
            let all = (elastic[p] + damping[p]) / system.masses()[p] + system.gravity();
            let free = system.dofs().free_axes(p);
            Vector3::from_fn(|axis, _| if free.contains(axis) { all[axis] } else { 0.0 })
        };
        (0..system.particles()).map(acceleration).collect()
    }

    /// Why a step of dt seconds is beyond what rounding can be followed through: the fastest vibration or decay is so much faster that what balances are
    /// forces a billion times as large as those that move anything.
    pub(super) fn beyond_rounding(&self, dt: f64) -> Option<String> {
        let faster = dt / self.resolving_step();
        (faster > BEYOND).then(|| {
            format!("a step is {faster:.0e} times as long as one that resolves the fastest vibration or decay")
        })
    }

    /// Why runs of a duration say little of a method, where a spring's ends move so far that it turns, or that they pass each other: by more than a quarter
    /// of its length, as velocities and accelerations at the start have it. Its force is then no smooth function of time.
    pub(super) fn passing(&self, duration: f64) -> Option<String> {
        let Self { system, state, .. } = self;
        let accelerations = self.accelerations();
        let passes = |link: &reference::Link| {
            let [i, j] = link.ends;
            let (v, a) = (state.velocities[i] - state.velocities[j], accelerations[i] - accelerations[j]);
            v.norm() * duration + 0.5 * a.norm() * duration * duration > 0.25 * link.length
        };
        let spring = reference::links(system, &state.positions).iter().position(passes)?;
        Some(format!(
            "the ends of spring {spring} turn about or pass each other within the {duration:.1e} s of the runs"
        ))
    }
}
