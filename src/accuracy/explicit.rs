//! Answers by explicit methods: a pair of runs of [Verlet's method](super::verlet), or of [DOP853](super::dop853) where that is
//! not fine enough.

use super::audience::Audience;
use super::price::Price;
use super::search::{Search, Verdict};
use super::{dop853, verlet};
use crate::error::Result;

/// An answer by explicit methods.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price) -> Result<Verdict> {
    match verlet::answer(search, price)? {
        Ok(verdict) => Ok(verdict),
        Err(extrapolated) => dop853::answer(search, price, extrapolated.0),
    }
}
