//! Collective decisions: all ranks continue, or none.

use crate::{Stop, ranks};

/// What rank 0 finds out, on all ranks.
///
/// # Errors
/// As on rank 0.
pub fn agreed(find: impl FnOnce() -> Result<bool, String>) -> Result<bool, Stop> {
    let found = if ranks::rank() == 0 { find() } else { Ok(false) };
    let (is_so, message) = match found {
        Ok(is_so) => (is_so, String::new()),
        Err(message) => (false, message),
    };
    let message = ranks::share_text(&message);
    if !message.is_empty() {
        return Err(Stop::Unusable(message));
    }
    Ok(ranks::any(is_so))
}

/// What is wrong on some rank is wrong on all; the first that has something to say says it.
///
/// # Errors
/// That, on all ranks.
pub fn one_of_all(message: Option<String>) -> Result<(), Stop> {
    let all = ranks::gather(message.as_deref().unwrap_or_default().as_bytes());
    let first = all.iter().find(|text| !text.is_empty());
    let text = ranks::share_text(&first.map_or_else(String::new, |text| String::from_utf8_lossy(text).into_owned()));
    if text.is_empty() { Ok(()) } else { Err(Stop::Unusable(text)) }
}
