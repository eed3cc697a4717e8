//! How wrong a run is, as far as its own figures tell.
//!
//! The estimates are sums of local errors without regard to sign, over the extent of the scene: what errors of the positions add
//! up to where nothing cancels and nothing amplifies.
//!
//! | method | estimate | why |
//! |---|---|---|
//! | forward and backward Euler | `change` | `½h²ẍ` is the truncation error of both |
//! | linearised backward Euler | `change·max(1, √defect)` | and what linearising leaves out brakes springs that turn |
//! | symplectic Euler | `start/max(1, ωT) + third/24` | Störmer's method from a velocity that is off by `½h ẍ(0)` |
//! | w2 | `max(slip, bend/24, braking)` | braking as below |
//! | bdf2 | `slip` | |
//! | implicit midpoint, Störmer's method | `bend/24/max(1, ωh)⁴` | `h³x⃛/12` and `/24`; vibrations that steps do not resolve ring, but move little |
//! | dop853 | `embedded` | the method's own estimate of its local errors |
//! | rodas4 | `max(embedded, carried/3, braking)` | and what the motion makes of them, as below |
//!
//! **Braking.** A spring that turns by θ in a step without being pulled back ends it longer by `L = l θ²/2`, and holds `U = ½ κ L²`. The
//! stages of w2 and rodas4 have the directions of springs from the step's start, and see of L what their formulas make of it. On a
//! stiff spring w2 ends every step too long by cL, `c = 1 − 1/(4γ) = 0.146` (the linear part of the extension goes, the method being L-stable, and
//! of L one quarter is met, at the second stage); the tension of that works against L in the next step and takes `2c U` from the motion. rodas4 meets L
//! itself, and takes `0.4 U²/K_s` of the kinetic energy K_s across the spring (measured on a rod that turns with `κ L² ≤ K_s`). With B the share
//! of the mean kinetic energy that all steps together took, at most all of it, velocities are lower by B/2 at the end and by B/4 in the mean: so
//! positions lag by `B/4` of the way. Nothing else shows it: the motion that is left is smooth.
//!
//! **Paths that bend within a step** draw at their springs in a way that the step does not know, but for the methods that [cut their steps
//! there](Method::cuts_at_kinks): what vibrations come of that, `aside`, is an error by itself.
//!
//! ω stands for the frequency at which velocities really change, `ωh = bend/(2 change)`, mean values over the run. The factors are
//! those of the truncation errors; `verification/study.md` compares a thousand random scenes with the truth.
//!
//! **Warnings** begin where the estimate says 1 to 3 %, because it may be ten times too small: of runs that are wrong by 30 %
//! none may go without; of dop853, whose error falls with the eighth power of the step, where twice the step would be that wrong.
//! The power of ωh is measured: on the random scenes of the study estimates of the midpoint rule are within ten times of the truth in
//! 81 % without it, 88 % with the second power and 90 % with the fourth.
//!
//! **By how much the motion magnifies errors** most figures do not know: a column that buckles does, a thousandfold and more. rodas4 carries
//! the errors of its steps on along the motion, to `carried`, see `integrate/carried.rs`. A third of that counts: without regard to what
//! cancels it is more often too large than too small. Of 3968 adaptive runs on the random scenes of the study 6.6 % had estimates more than ten
//! times too small without it, and 2.7 % do with it; of 55 that are wrong by more than ten tolerances 46 went without a warning, and four do.
//! Warnings begin at two tolerances where errors were magnified, as such estimates are closer; hardly more runs than before, 36 instead of 33, are
//! warned of that keep to their tolerance.
//!
//! Where particles have gone far, many times the extent of the scene, and the ends of springs have passed each other in a
//! step, the scene has crumpled: there a local error, which is all that dop853 knows, has grown up to some hundred times in
//! nine of ten runs, and such a run is in doubt from a thousandth of the estimates that others are; of rodas4 from a tenth.
//!
//! Energy that a method took away, or made, would have moved something. Over the whole run of T seconds it carries particles of the
//! mean mass m̄ as far as `T √(2E/m̄)`, which is `lost_way` and `gained_way` in extents of the scene. Where the scene is free to fold, having
//! fewer springs than degrees of freedom, and the way lost is about an extent, no figure of the motion that is left can tell what it
//! would have been. A step longer than a spring is a cause, and no sign of its own: ends that fly past each other side by side are no harm.

use super::Figures;
use crate::integrate::failure::large;
use crate::integrate::{Method, rodas4};

/// The estimate above which a run is called doubtful. For most methods it is the lowest one of those of 4000 random scenes that are
/// more than 30 % wrong and have no other mark, less a margin.
fn doubtful(method: Method) -> f64 {
    match method {
        Method::BackwardEuler => 0.033,
        Method::ForwardEuler => 0.03,
        Method::LinearBackwardEuler => 0.0215,
        Method::Bdf2 => 0.018,
        Method::W2 => 0.0175,
        Method::Verlet => 0.016,
        Method::SymplecticEuler => 0.013,
        // It keeps all vibrations for good.
        Method::ImplicitMidpoint => 0.011,
        Method::Rodas4 => 0.01,
        // Twice the step would be 2⁸ times as wrong, by 30 %.
        Method::Dop853 => 0.3 / 256.0,
    }
}

/// The way of the particles, in extents of the scene, and how far the ends of a spring passed each other in a step, in its lengths,
/// beyond which a scene has crumpled.
const CRUMPLED: (f64, f64) = (8.0, 0.3);

/// The part of the errors carried on that counts.
const CARRIED: f64 = 1.0 / 3.0;

/// The ratio of that to the errors of the steps themselves from which the motion has magnified them.
const MAGNIFIED: f64 = 10.0;

/// Tolerances above which an estimate is doubtful: what estimates are right to, and less where the motion has magnified errors, as those are closer.
const BEYOND: f64 = 10.0;
const BEYOND_CLOSE: f64 = 2.0;

/// The part of U that w2 takes a step.
const BRAKE_W2: f64 = 0.293;

/// Energy gained, in units of what the motion exchanged, above which a run is called doubtful.
const GAINED: f64 = 2.0;

/// The estimate from which that matters: below it the vibrations that gained move nothing far.
const GAINING: f64 = 0.003;

/// The way that energy taken away, and made, would have moved the particles, in extents, from which it matters.
const LOST: f64 = 0.8;
const MADE: f64 = 2.0;

/// Energy taken away, in the same units, that is named as a cause.
const TAKEN: f64 = 0.2;

/// The share of the kinetic energy from which braking by springs that turn is.
const BRAKED: f64 = 0.05;

/// The part of an estimate from which bends of prescribed paths are named as a cause.
const BENT: f64 = 0.3;

/// `defect` from which linearising makes most of the error.
const TURNING: f64 = 4.0;

/// What makes a run doubtful.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The estimate of the error is large: the relative position error.
    Wrong(f64),
    /// Springs that turn are stretched by steps along their old direction, and brake the motion: what linearising left out over
    /// what it balances.
    Turning(f64),
    /// Springs that turn are stretched by steps along their old direction, and brake the motion: by so much of the kinetic energy, as a share.
    Braked(f64),
    /// The motion has magnified the errors of steps so many times.
    Magnified(f64),
    /// The scene has crumpled, and may have magnified errors.
    Crumpled {
        /// How far its particles have gone, in extents.
        way: f64,
        /// By how much the estimate may be too small.
        more: f64,
    },
    /// The method took energy away, in J, of so much that the motion exchanged.
    Damped {
        /// Taken.
        lost: f64,
        /// Exchanged.
        exchanged: f64,
    },
    /// Energy appeared from nowhere, in J, where the motion exchanged so much.
    Gained {
        /// Appeared.
        gained: f64,
        /// Exchanged.
        exchanged: f64,
    },
    /// Prescribed paths bend within steps, which take them straight: the relative position error that comes of it.
    Bent(f64),
    /// The ends of a spring passed each other in a step, by so many lengths of the spring.
    Long(f64),
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Wrong(estimate) => write!(f, "wrong by about {} of the extent", percent(estimate)),
            Self::Turning(defect) => write!(
                f,
                "springs that turn are stretched by the steps and brake the motion: linearising leaves out forces {} \
                 times those that move the particles",
                times(defect)
            ),
            Self::Braked(share) => write!(
                f,
                "springs that turn are stretched by the steps and brake the motion: by about {} of its kinetic energy",
                percent(share)
            ),
            Self::Magnified(by) => {
                let by = if by < 1e6 { format!("{by:.0}") } else { large(by, 0) };
                write!(f, "the motion magnified the errors of its steps about {by} times on the way")
            }
            Self::Crumpled { way, more } => write!(
                f,
                "the scene has crumpled, its particles having gone {} times its extent: such motions magnify errors, and this \
                 one may be {more:.0} times as wrong as the estimate says",
                times(way)
            ),
            Self::Damped { lost, exchanged } => write!(
                f,
                "fast modes were damped away by the method: it took {} J, where the motion exchanged {exchanged:.2e} J",
                large(lost, 2)
            ),
            Self::Gained { gained, exchanged } => write!(
                f,
                "energy was gained: {} J appeared from nowhere, where the motion exchanged {exchanged:.2e} J",
                large(gained, 2)
            ),
            Self::Bent(aside) => write!(
                f,
                "prescribed paths bend within steps, which take them straight: that alone makes about {} of the extent",
                percent(aside)
            ),
            Self::Long(reach) => {
                write!(
                    f,
                    "a step was longer than a spring: its ends passed each other by {} of its lengths",
                    times(reach)
                )
            }
        }
    }
}

/// How often, for people: with one decimal as long as that is readable.
fn times(value: f64) -> String {
    if value < 1e6 { format!("{value:.1}") } else { large(value, 1) }
}

/// A relative error for people: one or two digits, in percent.
pub fn percent(error: f64) -> String {
    let percent = 100.0 * error;
    match percent {
        _ if percent >= 9995.0 => "more than 9990 %".into(),
        _ if percent >= 95.0 => format!("{:.0} %", 10.0 * (percent / 10.0).round()),
        _ if percent >= 9.5 => format!("{percent:.0} %"),
        _ if percent >= 0.095 => format!("{percent:.1} %"),
        _ if percent >= 0.0095 => format!("{percent:.2} %"),
        _ => format!("{percent:.0e} %"),
    }
}

impl Figures {
    /// About the relative position error at the end of a run with a method; `None` where the figures do not tell, or are not
    /// finite.
    pub fn estimate(&self, method: Method) -> Option<f64> {
        let Self { change, start, bend, third, slip, defect, embedded, carried, .. } = *self;
        let pace = self.pace();
        let braking = 0.25 * self.way * self.braked(method);
        let estimate = match method {
            Method::ForwardEuler | Method::BackwardEuler => change,
            Method::LinearBackwardEuler => change * defect.sqrt().max(1.0),
            Method::SymplecticEuler => start / (self.steps as f64 * pace).max(1.0) + third / 24.0,
            Method::W2 => slip.max(bend / 24.0).max(braking),
            Method::Bdf2 => slip,
            Method::Dop853 => embedded,
            Method::Rodas4 => embedded.max(CARRIED * carried).max(braking),
            Method::ImplicitMidpoint | Method::Verlet => bend / 24.0 / pace.max(1.0).powi(4),
        };
        estimate.is_finite().then_some(estimate.max(self.missed(method)))
    }

    /// ωh of velocities, in the mean over the run.
    pub(crate) fn pace(&self) -> f64 {
        if self.change > 0.0 { self.bend / (2.0 * self.change) } else { 0.0 }
    }

    /// What bends of prescribed paths within steps are worth.
    fn missed(&self, method: Method) -> f64 {
        if method.cuts_at_kinks() { 0.0 } else { self.aside }
    }

    /// B, the share of the kinetic energy that linearising took from springs that turn, in all steps together; zero for methods that do
    /// not brake.
    fn braked(&self, method: Method) -> f64 {
        match method {
            Method::W2 => (BRAKE_W2 * self.lifted).min(1.0),
            Method::Rodas4 => (rodas4::BRAKE * self.lifted_twice).min(1.0),
            _ => 0.0,
        }
    }

    /// Where the scene has crumpled, by how much errors may have grown that the estimate does not know of.
    fn crumpled(&self, method: Method) -> Option<f64> {
        let more = match method {
            Method::Dop853 => 1000.0,
            Method::Rodas4 => 10.0,
            _ => return None,
        };
        (self.way > CRUMPLED.0 && self.reach > CRUMPLED.1).then_some(more)
    }

    /// How many times the motion has magnified what steps did wrong, where that is known and much.
    fn magnified(&self, method: Method) -> Option<f64> {
        let by = CARRIED * self.carried / self.embedded;
        (method.carries_errors() && by > MAGNIFIED).then_some(by)
    }

    /// What makes a run with a method doubtful, the error first and then causes. A run whose steps keep to a relative tolerance
    /// is doubtful when the estimate is ten times that, what estimates are right to; where it knows what the motion magnified, twice.
    pub fn warnings(&self, method: Method, rtol: Option<f64>) -> Vec<Warning> {
        let Self { exchanged, gained, lost, defect, reach, .. } = *self;
        let estimate = self.estimate(method).unwrap_or(f64::INFINITY);
        let magnified = self.magnified(method);
        let doubtful = doubtful(method);
        let crumpled = self.crumpled(method).filter(|more| more * estimate > doubtful);
        let is_wrong =
            estimate > rtol.map_or(doubtful, |rtol| rtol * if magnified.is_some() { BEYOND_CLOSE } else { BEYOND });
        let has_steps_of_its_own = rtol.is_some();
        let gains =
            gained > GAINED * exchanged && estimate > GAINING || self.gained_way > MADE && !has_steps_of_its_own;
        let damps = self.can_fold && self.lost_way > LOST && !has_steps_of_its_own;
        let turns = is_wrong && method == Method::LinearBackwardEuler && defect > TURNING;
        let (braked, missed) = (self.braked(method), self.missed(method));
        let brakes = is_wrong && braked > BRAKED;
        let damped = damps || is_wrong && !turns && lost > TAKEN * exchanged;
        let long = reach > 1.0 && (is_wrong || damps || gains || crumpled.is_some());
        let warnings = [
            is_wrong.then_some(Warning::Wrong(estimate)),
            turns.then_some(Warning::Turning(defect)),
            brakes.then_some(Warning::Braked(braked)),
            (is_wrong && missed >= BENT * estimate).then_some(Warning::Bent(missed)),
            magnified.filter(|_| is_wrong).map(Warning::Magnified),
            crumpled.map(|more| Warning::Crumpled { way: self.way, more }),
            (!brakes && damped).then_some(Warning::Damped { lost, exchanged }),
            gains.then_some(Warning::Gained { gained, exchanged }),
            long.then_some(Warning::Long(reach)),
        ];
        warnings.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests;
