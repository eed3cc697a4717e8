use super::{BLOCK, Springs};
use crate::spring::Spring;
use crate::system::SystemBuilder;

/// Every spring counts in its own block, by its own number: so many side by side, each by a newton harder than the last, all twice
/// their length at rest of a half.
#[test]
fn blocks_follow_one_another() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], 1.0);
    let count = BLOCK + 3;
    for spring in 0..count {
        builder.spring(0, 1, Spring { stiffness: (spring + 1) as f64, rest_length: 0.5, damping: 0.0 });
    }
    let (system, state) = builder.build().unwrap();
    let sums = Springs::new(&system, &state, std::iter::empty()).enter(&state, 0.0);
    // ½ (k/l0) (l − l0)² = k/4, of the sum of all numbers up to theirs.
    assert_eq!(sums.elastic, (count * (count + 1) / 2) as f64 / 4.0);
}
