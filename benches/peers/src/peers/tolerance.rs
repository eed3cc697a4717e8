//! What a step may do wrong.

/// A local tolerance for the unknowns.
#[derive(Clone, Copy)]
pub struct Tolerance {
    /// Of their size.
    pub relative: f64,
    pub absolute: f64,
}
