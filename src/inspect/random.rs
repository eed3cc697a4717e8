//! Reproducible random vectors.

use rand::Rng;
use rand::rngs::Xoshiro256PlusPlus;

/// Fills a vector with independent standard normal numbers (Box and Muller 1958).
pub(super) fn gaussian(rng: &mut Xoshiro256PlusPlus, x: &mut [f64]) {
    // In (0, 1]: the logarithm below must exist.
    let mut uniform = || ((rng.next_u64() >> 11) as f64 + 1.0) * (-53f64).exp2();
    for pair in x.chunks_mut(2) {
        let radius = (-2.0 * uniform().ln()).sqrt();
        let (sine, cosine) = (std::f64::consts::TAU * uniform()).sin_cos();
        for (value, part) in pair.iter_mut().zip([cosine, sine]) {
            *value = radius * part;
        }
    }
}
