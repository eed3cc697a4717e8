//! What was probably meant by a word that is not known.

use clap::Command;
use clap::error::{ContextKind, ContextValue, Error};

/// Adds to an error what was probably meant, where the parser found nothing: it compares letters from the front, and finds little of `run` in
/// `rnu`.
pub fn suggesting(mut error: Error, program: &Command) -> Error {
    let text = |error: &Error, kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    if let Some(word) = text(&error, ContextKind::InvalidSubcommand)
        && error.get(ContextKind::SuggestedSubcommand).is_none()
        && let Some(meant) = nearest(&word, program.get_subcommands().map(Command::get_name))
    {
        let meant = ContextValue::Strings(vec![meant.to_owned()]);
        error.insert(ContextKind::SuggestedSubcommand, meant);
    }
    if let (Some(word), Some(ContextValue::Strings(valid))) =
        (text(&error, ContextKind::InvalidValue), error.get(ContextKind::ValidValue))
        && error.get(ContextKind::SuggestedValue).is_none()
        && let Some(meant) = nearest(&word, valid.iter().map(String::as_str))
    {
        let meant = ContextValue::String(meant.to_owned());
        error.insert(ContextKind::SuggestedValue, meant);
    }
    error
}

/// The known word that takes the fewest letters added, left out, changed or swapped, if these are a third of the word at most.
fn nearest<'a>(word: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let most = word.chars().count().div_ceil(3);
    let distances = known.map(|known| (strsim::osa_distance(word, known), known));
    distances.filter(|(distance, _)| *distance <= most).min_by_key(|(distance, _)| *distance).map(|(_, known)| known)
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn slips_are_understood_and_guesses_are_not() {
        let meant = |word| nearest(word, ["run", "matrix", "inspect", "chart", "new", "w2"].into_iter());
        assert_eq!(meant("rnu"), Some("run"));
        assert_eq!(meant("nwe"), Some("new"));
        assert_eq!(meant("w3"), Some("w2"));
        assert_eq!(meant("isnpetc"), Some("inspect"));
        assert_eq!(meant("simulate"), None);
        assert_eq!(meant(""), None);
    }
}
