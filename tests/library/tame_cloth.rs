//! A cloth that nothing spoils, for tests that spoil it.

use sprung::{Spring, SystemBuilder};

/// A cloth of n × m particles with structural and one diagonal spring a cell, every spring stretched by 1 to 4 %.
pub fn tame_cloth(n: usize, m: usize) -> SystemBuilder {
    let mut builder = SystemBuilder::new();
    for p in 0..n * m {
        let height = 0.01 * ((7 * (p / m) + 13 * (p % m)) % 11) as f64;
        builder.particle([0.1 * (p / m) as f64, 0.1 * (p % m) as f64, height], 0.02 + 0.001 * (p % 5) as f64);
    }
    for p in 0..n * m {
        let (right, up) = (p % m + 1 < m, p + m < n * m);
        for (q, inside) in [(p + 1, right), (p + m, up), (p + m + 1, right && up)] {
            if inside {
                let length = (builder.positions[p] - builder.positions[q]).norm();
                let rest_length = length * (0.96 + 0.01 * ((3 * p + q) % 4) as f64);
                builder.spring(p, q, Spring { stiffness: 40.0 + (p % 7) as f64, rest_length, damping: 0.01 });
            }
        }
    }
    builder
}
