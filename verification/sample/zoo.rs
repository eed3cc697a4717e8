//! The zoo of matrices, all of it.

use crate::zoo::{TESTS, Tested, matrices, tests};

/// No ratio reaches the threshold of LAPACK's testers, and nothing fails without a word. Every test has at least seven ratios, so that none is
/// right for lack of claims.
#[test]
fn ratios_are_below_the_threshold_of_lapack() {
    let mut ratios = [0; TESTS.len()];
    for animal in matrices::all() {
        for ((tested, test), ratios) in tests(&animal).iter().zip(TESTS).zip(&mut ratios) {
            assert!(tested.is_right(), "{}, {test}: {tested:?}", animal.name);
            *ratios += usize::from(matches!(tested, Tested::Ratio(_)));
        }
    }
    for (ratios, test) in ratios.iter().zip(TESTS) {
        assert!(*ratios >= 7 || test == "eigenpairs", "{test}: {ratios}");
    }
}
