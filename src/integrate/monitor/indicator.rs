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
//! | w2 | `max(slip, bend/24)` | |
//! | bdf2 | `slip` | |
//! | implicit midpoint and others of second order | `bend/24/max(1, ωh)²` | `h³x⃛/12` and `/24`; vibrations that steps do not resolve ring, but move little |
//! | of higher order p | `embedded`, else `bend/24·(ωh)ᵖ⁻²` | the method's own estimates; without them, how smooth its motion is |
//!
//! ω stands for the frequency at which velocities really change, `ωh = bend/(2 change)`, mean values over the run. The factors are
//! those of the truncation errors; on a thousand random scenes nine of ten estimates are within ten times of the truth, and half
//! within twice.
//!
//! **Warnings** begin where the estimate says 1 to 3 %, because it may be ten times too small: of runs that are wrong by 30 %
//! none may go without. Energy that a method took away warns of itself where the scene is free to fold, having fewer springs
//! than degrees of freedom: it would have moved something there, and no figure of the motion that is left can tell what. A step
//! longer than a spring is a cause, and no sign of its own: ends that fly past each other side by side are no harm.

use super::Figures;
use crate::integrate::Method;
use crate::integrate::failure::large;

/// Estimates above which a run is called doubtful: of implicit methods, of w2, of explicit ones.
const DOUBTFUL: f64 = 0.025;
const DOUBTFUL_W2: f64 = 0.02;
const DOUBTFUL_EXPLICIT: f64 = 0.013;

/// Energy gained, in units of what the motion exchanged, above which a run is called doubtful.
const GAINED: f64 = 2.0;

/// The estimate from which that matters: below it the vibrations that gained move nothing far.
const GAINING: f64 = 0.003;

/// Energy taken away, in the same units, from which it matters where scenes can fold, and the estimate from which it does.
const LOST: (f64, f64) = (0.6, 0.0045);

/// The same of w2, whose linearised stages brake springs that turn, for all scenes.
const BRAKED: (f64, f64) = (0.2, 0.012);

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
        _ if percent > 9999.0 => "more than 9999 %".into(),
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
        let Self { change, start, bend, third, slip, defect, embedded, .. } = *self;
        // ωh of velocities, in the mean over the run.
        let pace = if change > 0.0 { bend / (2.0 * change) } else { 0.0 };
        let estimate = match method {
            Method::ForwardEuler | Method::BackwardEuler => change,
            Method::LinearBackwardEuler => change * defect.sqrt().max(1.0),
            Method::SymplecticEuler => start / (self.steps as f64 * pace).max(1.0) + third / 24.0,
            Method::W2 => slip.max(bend / 24.0),
            Method::Bdf2 => slip,
            _ if method.order() <= 2 => bend / 24.0 / (pace * pace).max(1.0),
            _ if embedded > 0.0 => embedded,
            // Each further order takes a factor of ωh.
            _ => bend / 24.0 * pace.powi(method.order() as i32 - 2),
        };
        estimate.is_finite().then_some(estimate)
    }

    /// What makes a run with a method doubtful, the error first and then causes. A run whose steps keep to a relative tolerance
    /// is doubtful when the estimate is ten times that, what estimates are right to.
    pub fn warnings(&self, method: Method, rtol: Option<f64>) -> Vec<Warning> {
        let Self { exchanged, gained, lost, defect, reach, .. } = *self;
        let estimate = self.estimate(method).unwrap_or(f64::INFINITY);
        let doubtful = match method {
            Method::W2 => DOUBTFUL_W2,
            _ if method.is_implicit() => DOUBTFUL,
            _ => DOUBTFUL_EXPLICIT,
        };
        let doubtful = rtol.map_or(doubtful, |rtol| 10.0 * rtol);
        let is_wrong = estimate > doubtful;
        let gains = gained > GAINED * exchanged && estimate > GAINING;
        let takes = |(share, least): (f64, f64)| lost > share * exchanged && estimate > least;
        let is_damped = rtol.is_none() && (self.can_fold && takes(LOST) || method == Method::W2 && takes(BRAKED));
        let turns = is_wrong && method == Method::LinearBackwardEuler && defect > TURNING;
        let candidates = [
            (is_wrong, Warning::Wrong(estimate)),
            (turns, Warning::Turning(defect)),
            (is_damped || is_wrong && !turns && lost > BRAKED.0 * exchanged, Warning::Damped { lost, exchanged }),
            (gains, Warning::Gained { gained, exchanged }),
            (reach > 1.0 && (is_wrong || is_damped || gains), Warning::Long(reach)),
        ];
        candidates.into_iter().filter(|(applies, _)| *applies).map(|(_, warning)| warning).collect()
    }
}
