//! What an inspection leaves for its pictures.

use crate::assembly::SpringPattern;
use crate::linear::Ldlt;
use std::fmt::{Debug, Formatter};
use std::sync::Arc;

/// The pattern of A, ordered and analysed, without memory for a factor.
#[derive(Clone)]
pub(super) struct Analysed {
    pub pattern: Arc<SpringPattern>,
    pub factorization: Arc<Ldlt>,
}

/// A system has one pattern: what is known of it is no part of what was found.
impl PartialEq for Analysed {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Debug for Analysed {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "Analysed")
    }
}
