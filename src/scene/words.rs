//! What is wrong with a value, in the words of a scene file: those of the parser are about the types of a program.

/// A parser's message in plain words: `invalid type: string "heavy", expected f64` becomes `is the text "heavy", must be a number`.
pub fn plain(message: &str) -> String {
    let found_and_wanted = |rest: &str| {
        let (found, wanted) = rest.split_once(", expected ")?;
        Some(format!("is {}, must be {}", what(found), kind(wanted)))
    };
    let starts = [
        ("invalid type: ", &found_and_wanted as &dyn Fn(&str) -> Option<String>),
        ("invalid value: ", &found_and_wanted),
        ("invalid length ", &|rest| {
            let (length, wanted) = rest.split_once(", expected ")?;
            let entries = if length == "1" { "entry" } else { "entries" };
            Some(format!("has {length} {entries}, must be {}", kind(wanted)))
        }),
        ("unknown field ", &|rest| Some(format!("unknown key {}", known(rest)))),
        ("unknown variant ", &|rest| Some(format!("unknown word {}", known(rest)))),
        ("missing field ", &|rest| Some(format!("missing key {}", rest.replace('`', "")))),
        ("duplicate field ", &|rest| Some(format!("given twice: {}", rest.replace('`', "")))),
    ];
    let said = starts.into_iter().find_map(|(start, say)| say(message.strip_prefix(start)?));
    said.unwrap_or_else(|| message.to_owned())
}

/// What was found: ``string "x"``, ``integer `3` ``, `sequence`.
fn what(found: &str) -> String {
    let bare = |rest: &str| rest.trim_matches('`').to_owned();
    match found.split_once(' ') {
        Some(("string", text)) => format!("the text {text}"),
        Some(("integer" | "boolean", value)) => bare(value),
        Some(("floating", rest)) => bare(rest.trim_start_matches("point ")),
        _ => match found {
            "sequence" => "a list".into(),
            "map" => "a table".into(),
            other => other.to_owned(),
        },
    }
}

/// What is wanted, with what follows: `f64 at line 3 column 1`.
fn kind(wanted: &str) -> String {
    let kinds = [
        ("f64", "a number"),
        ("u32", "a whole number, not negative"),
        ("u64", "a whole number, not negative"),
        ("usize", "a whole number, not negative"),
        ("a string", "a text"),
        ("a sequence", "a list"),
        ("a map", "a table"),
    ];
    let replaced = kinds.into_iter().find_map(|(kind, words)| {
        let rest = wanted.strip_prefix(kind)?;
        (rest.is_empty() || rest.starts_with(' ')).then(|| format!("{words}{rest}"))
    });
    replaced.unwrap_or_else(|| wanted.to_owned())
}

/// The names between backticks without them: `` `x`, expected `a` or `b` ``.
fn known(rest: &str) -> String {
    rest.replace('`', "").replacen(", expected one of ", ", must be one of ", 1).replacen(
        ", expected ",
        ", must be ",
        1,
    )
}

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn messages_speak_of_what_is_in_the_file() {
        let cases = [
            (
                "invalid type: string \"heavy\", expected f64 at line 8 column 1",
                "is the text \"heavy\", must be a number at line 8 column 1",
            ),
            ("invalid value: integer `-1`, expected u32", "is -1, must be a whole number, not negative"),
            ("invalid type: floating point `1.5`, expected usize", "is 1.5, must be a whole number, not negative"),
            ("invalid type: null, expected f64", "is null, must be a number"),
            ("invalid type: sequence, expected a table", "is a list, must be a table"),
            ("invalid type: map, expected a sequence", "is a table, must be a list"),
            (
                "invalid length 1, expected a pair of particle numbers",
                "has 1 entry, must be a pair of particle numbers",
            ),
            ("invalid length 4, expected a row", "has 4 entries, must be a row"),
            (
                "unknown field `mass`, expected one of `a`, `b`; did you mean a?",
                "unknown key mass, must be one of a, b; did you mean a?",
            ),
            ("unknown field `end`, expected `dt` or `duration`", "unknown key end, must be dt or duration"),
            ("missing field `particles` at line 21 column 1", "missing key particles at line 21 column 1"),
            ("duplicate field `name`", "given twice: name"),
            ("unclosed table, expected `]`", "unclosed table, expected `]`"),
        ];
        for (message, words) in cases {
            assert_eq!(plain(message), words);
        }
    }
}
