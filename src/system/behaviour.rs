//! Springs that do not push, and springs whose rest lengths change in time.

use super::Curve;
use super::curve::check_times;
use crate::error::Invalid;
use crate::spring::Spring;

/// How springs differ from the law `T = k (l/l0 − 1)` with constant parameters; see
/// [`System::with_behaviour`](crate::System::with_behaviour).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Behaviour {
    /// Springs that exert no force at all while they are shorter than at rest, of damping neither; one for every spring, or none at all. A
    /// spring law of the caller's own decides for itself.
    pub tension_only: Vec<bool>,
    /// Rest lengths in time; later entries override earlier ones.
    pub actuation: Vec<Actuation>,
}

/// Springs whose rest length is `l0 s(t)`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Actuation {
    /// The springs.
    pub springs: Vec<usize>,
    /// s(t), positive.
    pub factors: Curve<f64>,
}

impl Behaviour {
    /// Whether all springs are as always.
    pub fn is_empty(&self) -> bool {
        !self.tension_only.contains(&true) && self.actuation.is_empty()
    }

    /// Whether a spring does not push.
    #[inline]
    pub fn is_tension_only(&self, spring: usize) -> bool {
        self.tension_only.get(spring).copied().unwrap_or(false)
    }

    /// The number of the actuation that counts for every spring, beyond the last where there is none.
    pub(super) fn of_springs(&self, springs: usize) -> Vec<u32> {
        if self.actuation.is_empty() {
            return Vec::new();
        }
        let mut deciding = vec![u32::MAX; springs];
        for (number, entry) in (0u32..).zip(&self.actuation) {
            entry.springs.iter().for_each(|&spring| deciding[spring] = number);
        }
        deciding
    }

    pub(super) fn check(&self, springs: &[Spring]) -> Result<(), Invalid> {
        if !self.tension_only.is_empty() {
            super::curve::check_length("springs.tension_only", self.tension_only.len(), springs.len(), "springs")?;
        }
        for (index, Actuation { springs: numbers, factors }) in self.actuation.iter().enumerate() {
            let key = format!("springs.actuation[{index}]");
            for (at, &spring) in numbers.iter().enumerate() {
                let wrong = |rule: String| Err(Invalid::new(format!("{key}.springs"), spring, rule).at(at));
                match springs.get(spring) {
                    None => return wrong(format!("names a spring that does not exist (there are {})", springs.len())),
                    Some(named) if named.rest_length == 0.0 => return wrong("has no rest length to change".into()),
                    Some(_) => {}
                }
            }
            let path = format!("{key}.path");
            check_times(&path, &factors.times, ("factors", factors.values.len()))?;
            for (at, &factor) in factors.values.iter().enumerate() {
                let is_good = numbers.iter().all(|&spring| {
                    let length = springs[spring].rest_length * factor;
                    length.is_finite() && length > 0.0
                });
                if !(factor.is_finite() && factor > 0.0 && is_good) {
                    let rule = "must be finite and positive, and so must the rest lengths that it makes";
                    return Err(Invalid::new(format!("{path}.factors"), factor, rule).at(at));
                }
            }
        }
        Ok(())
    }
}
