//! The shortest time of what is done several times: other programs on the machine only ever add to it.

/// Number of repetitions.
pub const REPEATS: usize = 3;

/// Each time by `time`, in s.
pub fn shortest<E>(mut time: impl FnMut() -> Result<f64, E>) -> Result<f64, E> {
    (0..REPEATS).try_fold(f64::INFINITY, |least, _| Ok(least.min(time()?)))
}
