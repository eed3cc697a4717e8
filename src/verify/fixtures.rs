//! Systems that the tests of several checks work with by hand.

use crate::spring::Spring;
use crate::system::SystemBuilder;

/// Springs of k = 4 N, l0 = 2 m and of k = 12 N, l0 = 4 m between particles of 2, 1 and 5 kg at 1, 4 and 9 m.
pub fn line() -> SystemBuilder {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.gravity(-2.0, 0.0, 0.0);
    for (x, mass) in [(1.0, 2.0), (4.0, 1.0), (9.0, 5.0)] {
        builder.particle([x, 0.0, 0.0], mass);
    }
    builder.spring(0, 1, Spring { stiffness: 4.0, rest_length: 2.0, damping: 0.5 });
    builder.spring(1, 2, Spring { stiffness: 12.0, rest_length: 4.0, damping: 1.0 });
    builder
}
