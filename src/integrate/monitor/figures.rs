//! The raw figures of a run, from which its indicators are made.

use super::aside::Detour;
use super::{particles, sums};
use serde::{Deserialize, Serialize};

/// Figures of a run that cost next to nothing, for what it cannot know otherwise: how wrong it is.
///
/// Sums over the steps of norms over the free coordinates, h being the length of a step and X the extent of the scene at the end,
/// `‖x − centroid‖`. Of a scene that nothing holds `way`, `exchanged` and `lost` are about the centre of mass: what the whole
/// scene does as one body is no error's business. What a monitor was not asked to look at ([`MonitorOptions`](super::MonitorOptions))
/// stays zero.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Figures {
    /// Steps.
    pub steps: u64,
    /// Length of the run, in s.
    pub duration: f64,
    /// X, in m.
    pub extent: f64,
    /// `Σ ½h ‖v' − v‖/X`: the truncation error of backward Euler, not cancelled.
    pub change: f64,
    /// The first term of `change`, times the number of steps.
    pub start: f64,
    /// `Σ h ‖(v' − v) − (h/h₋)(v − v₋)‖/X`: what second-order methods neglect, up to their error constants.
    pub bend: f64,
    /// `Σ ‖h³ x⃛‖/X` from third differences of the positions.
    pub third: f64,
    /// `Σ ‖x' − x − ½h (v + v')‖/X`: positions against the trapezoidal rule of their velocities.
    pub slip: f64,
    /// `Σ ‖M (v' − v)/h − F(x', v')‖ / Σ ‖M (v' − v)/h‖` over the steps whose forces were evaluated: what linearising left out.
    pub defect: f64,
    /// `Σ h ‖v‖/X`: the way of the particles; seen from the centre of mass where nothing holds the scene.
    pub way: f64,
    /// `Σ U/K̄`, U the energy that a step of straight motion puts into springs that turn, K̄ the kinetic energy in the mean.
    pub lifted: f64,
    /// `Σ U²/(K_s K̄)`, K_s the kinetic energy across each spring.
    pub lifted_twice: f64,
    /// The most by which the ends of a spring passed each other in a step, in lengths of the spring.
    pub reach: f64,
    /// Whether the scene has fewer springs than degrees of freedom: it can fold, turn or fall without stretching one.
    pub can_fold: bool,
    /// Energy that the motion exchanged, in J: the kinetic energy it started with, what it released, and what it was given; without that of
    /// the centre of mass where nothing holds the scene.
    pub exchanged: f64,
    /// The most that appeared from nowhere, in J, from the lowest imbalance before.
    pub gained: f64,
    /// What the method took away by the end, in J; negative where it gave. Without the centre of mass where nothing holds the scene.
    pub lost: f64,
    /// `T √(2E/m̄)/X`, E what was lost and m̄ the mean mass: how far that would have carried the particles in the whole time.
    pub lost_way: f64,
    /// The same of what was gained.
    pub gained_way: f64,
    /// `Σ ‖e‖/X` over the steps, e the method's own estimate of the local error of the positions; zero where it has none.
    pub embedded: f64,
    /// `Σ √(Σ (κ ∫|n·δ| dt)²/(κ' m̄))/X` over the steps, δ being how far prescribed paths go aside from the straight way of a step, κ and n those of
    /// a spring that they draw, κ' the sum of k/l0 at its other end, and m̄ the mean mass: what vibrations come of that.
    pub aside: f64,
    /// ‖δ‖/X, δ being what the errors of all steps have become by the end, each carried on along the motion, see
    /// [`CarriedErrors`](crate::integrate::CarriedErrors); zero where the method does not know.
    pub carried: f64,
}

/// The sums that figures are made of.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Trail {
    steps: u64,
    duration: f64,
    change: f64,
    start: f64,
    bend: f64,
    third: f64,
    slip: f64,
    defect: f64,
    inertia: f64,
    way: f64,
    lifted: f64,
    lifted_twice: f64,
    kinetic: f64,
    reach: f64,
    embedded: f64,
    aside: f64,
}

impl Trail {
    pub fn enter(
        &mut self,
        dt: f64,
        springs: &sums::Sums,
        particles: &particles::Sums,
        detour: &Detour,
        local_error: Option<f64>,
    ) {
        self.steps += 1;
        self.duration += dt;
        let change = 0.5 * dt * particles.change.sqrt();
        if self.steps == 1 {
            self.start = change;
        }
        self.change += change;
        self.bend += dt * particles.bend.sqrt();
        self.third += particles.third.sqrt();
        self.slip += particles.slip.sqrt();
        self.defect += particles.defect.sqrt();
        self.inertia += particles.inertia.sqrt();
        self.way += dt * particles.speed.sqrt();
        self.lifted += springs.lifted;
        self.lifted_twice += springs.lifted_twice;
        self.kinetic += dt * (particles.kinetic - particles.carried.kinetic);
        self.reach = self.reach.max(springs.reach);
        self.embedded += local_error.unwrap_or(0.0);
        self.aside += detour.way;
    }

    /// With the extent of the scene; its energies, its mean mass, and errors carried on are for the caller to fill in.
    pub fn figures(&self, extent: f64) -> Figures {
        let Self { steps, duration, .. } = *self;
        Figures {
            steps,
            duration,
            extent,
            change: self.change / extent,
            start: self.start * steps as f64 / extent,
            bend: self.bend / extent,
            third: self.third / extent,
            slip: self.slip / extent,
            defect: ratio(self.defect, self.inertia),
            way: self.way / extent,
            lifted: ratio(self.lifted * duration, self.kinetic),
            lifted_twice: ratio(self.lifted_twice * duration, self.kinetic),
            reach: self.reach.sqrt(),
            embedded: self.embedded / extent,
            aside: self.aside / extent,
            ..Figures::default()
        }
    }
}

/// Of two numbers that are not negative; nothing out of nothing is nothing.
fn ratio(part: f64, whole: f64) -> f64 {
    if part == 0.0 { 0.0 } else { part / whole }
}

#[cfg(test)]
mod tests;
