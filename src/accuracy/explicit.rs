//! Answers by explicit methods: a pair of runs of [Verlet's method](super::verlet), or of DOP853 where that is not fine enough, with
//! steps of [one length](super::equal) or, where these do not do, with steps that follow [an error estimate](super::dop853).

use super::audience::Audience;
use super::price::Price;
use super::search::{Search, Verdict};
use super::verlet::Extrapolated;
use super::{dop853, equal, verlet};
use crate::error::Result;

/// An answer by explicit methods.
pub(super) fn answer<A: Audience>(search: &mut Search<'_, A>, price: Price) -> Result<Verdict> {
    // Where it is not fine enough its pair has cost a tenth of what follows, or it has shown that little moves.
    let other = match verlet::answer(search, price)? {
        Ok(verdict) => return Ok(verdict),
        Err(Extrapolated(course)) => course,
    };
    match equal::answer(search, price, other)? {
        Ok(verdict) => Ok(verdict),
        Err(Extrapolated(other)) => dop853::answer(search, price, other),
    }
}
