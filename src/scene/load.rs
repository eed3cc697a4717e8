//! From text to a [`Scene`], with errors that give key, line and column in a scene file's words.

use super::values::{check_name, table};
use super::{Scene, npz};
use crate::error::{Error, Invalid, Result};
use crate::memory;
use serde::de::{Deserialize, DeserializeOwned, Deserializer};
use std::path::Path;

impl Scene {
    /// Reads a scene file, TOML, JSON or NumPy arrays (`.npz`, see [`write_npz`](Self::write_npz)) by its extension. Without a name in
    /// the file the scene has the file's stem.
    ///
    /// JSON is read as it comes; TOML is first held as a tree, which takes ten times the time and memory: that matters from about 10⁵
    /// particles on. Arrays are read at the speed of the disk.
    ///
    /// # Errors
    /// [`Error::Scene`] for another extension, [`Error::Io`] for an unreadable file, [`Error::Format`] with key and position for text
    /// that is not of the format, [`Error::Invalid`] for an unusable name or `[time]`. [`build`](Self::build) checks all other values.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let extension = path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
        // Parsing holds at most so many bytes for a byte of the file: of JSON the text and the numbers, of TOML also a tree.
        let from_text = |parse: fn(&str) -> Result<Self, String>, share: u64| {
            let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
            memory::ensure(bytes.saturating_mul(share), "the scene file")?;
            let text = std::fs::read_to_string(path).map_err(|source| Error::reading_text(path, source))?;
            parse(&text).map_err(|message| Error::Format { file: path.into(), message })
        };
        let scene = match extension.as_deref() {
            Some("toml") => from_text(parse_toml, 60)?,
            Some("json") => from_text(parse_json, 8)?,
            Some("npz") => {
                let file = std::fs::File::open(path).map_err(|source| Error::io(path, source))?;
                npz::read(std::io::BufReader::new(file), path, parse_json)?
            }
            _ => {
                return Err(Error::Scene(format!("{}: a scene file must end in .toml, .json or .npz", path.display())));
            }
        };
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        Self { file: Some(path.into()), ..scene }.complete(&stem).map_err(|invalid| Error::from(invalid).in_file(path))
    }

    /// Reads a scene from TOML, with the errors of [`load`](Self::load). Without a name in the text it is called `scene`.
    pub fn from_toml(text: &str) -> Result<Self> {
        let scene = parse_toml(text).map_err(|message| Error::Format { file: "TOML".into(), message })?;
        Ok(scene.complete("scene")?)
    }

    /// Reads a scene from JSON, with the errors of [`load`](Self::load). Without a name in the text it is called `scene`.
    pub fn from_json(text: &str) -> Result<Self> {
        let scene = parse_json(text).map_err(|message| Error::Format { file: "JSON".into(), message })?;
        Ok(scene.complete("scene")?)
    }

    /// Reads a scene from [arrays](Self::write_npz), with the errors of [`load`](Self::load). Without a name in its text it is called `scene`.
    pub fn from_npz(file: impl std::io::Read + std::io::Seek) -> Result<Self> {
        Ok(npz::read(file, Path::new("NPZ"), parse_json)?.complete("scene")?)
    }

    fn complete(mut self, default_name: &str) -> Result<Self, Invalid> {
        if self.name.is_empty() {
            self.name = default_name.to_owned();
            check_name(&self.name).map_err(|rule| Invalid::new("name", format!("{:?}", self.name), rule))?;
        }
        self.time.check()?;
        Ok(self)
    }
}

fn parse_toml(text: &str) -> Result<Scene, String> {
    let text = without_byte_order_mark(text);
    let positioned = |error: &toml::de::Error| match error.span() {
        Some(span) => {
            let before = text.get(..span.start).unwrap_or(text);
            let (line, start) = before.rfind('\n').map_or((1, 0), |end| (before.matches('\n').count() + 1, end + 1));
            // The parser hands over a date as a table, which cannot begin with a digit.
            let is_date = text.get(span.start..).is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()));
            let found = if is_date { "invalid type: a date or a time" } else { "invalid type: map" };
            let message = match (error.message(), text.get(span)) {
                ("duplicate key", Some(key)) => format!("given twice: {}", key.trim_matches(['"', '\''])),
                (message, _) => message.replacen("invalid type: map", found, 1),
            };
            format!("{message} at line {line} column {}", before[start..].chars().count() + 1)
        }
        None => error.message().to_owned(),
    };
    let deserializer = toml::Deserializer::parse(text).map_err(|error| positioned(&error))?;
    with_key(deserializer, positioned)
}

fn parse_json(text: &str) -> Result<Scene, String> {
    // Tracking keys takes longer than parsing: only a text with an error is parsed with it.
    let mut deserializer = serde_json::Deserializer::from_str(without_byte_order_mark(text));
    match table(&mut deserializer) {
        Ok(scene) if deserializer.end().is_ok() => Ok(scene),
        _ => json_table(text),
    }
}

/// Reads a table from JSON; errors come with key, line and column.
pub(crate) fn json_table<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    let mut deserializer = serde_json::Deserializer::from_str(without_byte_order_mark(text));
    // The parser counts columns from 1, and those of a wrong beginning from 0.
    let describe = |error: &serde_json::Error| match error.to_string() {
        message if error.column() == 0 => message.replace(" column 0", " column 1"),
        message => message,
    };
    let table = with_key(&mut deserializer, describe)?;
    deserializer.end().map_err(|error| error.to_string())?;
    Ok(table)
}

fn with_key<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
    describe: impl Fn(&D::Error) -> String,
) -> Result<T, String> {
    let mut track = serde_path_to_error::Track::new();
    table(serde_path_to_error::Deserializer::new(deserializer, &mut track)).map_err(|error| {
        let message = plain(&with_suggestion(describe(&error)));
        // A text that ends, and a date of TOML, have a key that is none.
        let key = track.path().to_string();
        let key =
            [".?", "?", &format!(".{DATE}")].iter().fold(&key[..], |key, end| key.strip_suffix(end).unwrap_or(key));
        if matches!(key, "" | ".") { message } else { format!("{key}: {message}") }
    })
}

/// The key in which the parser of TOML hands over a date.
const DATE: &str = "$__toml_private_datetime";

fn without_byte_order_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// Names the known key or value that is most like an unknown one. serde lists the known ones between backticks.
fn with_suggestion(message: String) -> String {
    if !message.starts_with("unknown ") {
        return message;
    }
    let mut quoted = message.split('`').skip(1).step_by(2);
    let Some(unknown) = quoted.next() else { return message };
    let similar = quoted.map(|known| (strsim::jaro_winkler(unknown, known), known));
    // From 0.8 on: one letter too few, too many, wrong or misplaced in a word of five.
    let nearest = similar.filter(|(similarity, _)| *similarity > 0.8).max_by(|(a, _), (b, _)| a.total_cmp(b));
    match nearest {
        Some((_, known)) => format!("{message}; did you mean {known}?"),
        None => message,
    }
}

/// A parser's message in a scene file's words: `invalid type: string "heavy", expected f64` becomes `is the text "heavy", must be a number`.
fn plain(message: &str) -> String {
    if let Some(rest) = message.strip_prefix(&format!("unknown field `{DATE}`")) {
        let place = rest.find(" at line ").map_or("", |at| &rest[at..]);
        return format!("is a date or a time, which no key takes{place}");
    }
    if let Some(rest) = message.strip_prefix("EOF while parsing ") {
        return format!("the text ends in {}", rest.replacen("an object", "a table", 1));
    }
    let split = |start: &str| message.strip_prefix(start)?.split_once(", expected ");
    if let Some((found, wanted)) = split("invalid type: ").or_else(|| split("invalid value: ")) {
        let found = found_value(found);
        return format!("is {found}, must be {}", wanted_kind(wanted, found.parse().unwrap_or(0.0)));
    }
    if let Some((length, wanted)) = split("invalid length ") {
        let entries = if length == "1" { "entry" } else { "entries" };
        return format!("has {length} {entries}, must be {}", wanted_kind(wanted, 0.0));
    }
    for (start, words) in [
        ("unknown field ", "unknown key "),
        ("unknown variant ", "unknown word "),
        ("missing field ", "missing key "),
        ("duplicate field ", "given twice: "),
    ] {
        if let Some(rest) = message.strip_prefix(start) {
            return format!("{words}{}", rest.replace('`', "").replacen(", expected ", ", must be ", 1));
        }
    }
    message.to_owned()
}

/// What was found: ``string "x"``, ``integer `3` ``, `sequence`.
fn found_value(found: &str) -> String {
    match found.split_once(' ') {
        Some(("string", text)) => format!("the text {text}"),
        // A very long one is followed by its type.
        Some(("integer" | "boolean" | "floating", rest)) => rest.split('`').nth(1).unwrap_or(rest).to_owned(),
        _ if found == "sequence" => "a list".into(),
        _ if found == "map" => "a table".into(),
        _ => found.to_owned(),
    }
}

/// What is wanted instead of a number, with what follows: `f64 at line 3 column 1`.
fn wanted_kind(wanted: &str, found: f64) -> String {
    let whole =
        |bits: i32, limit: &'static str| if found < 2f64.powi(bits) { "a whole number, not negative" } else { limit };
    let kinds = [
        ("f64", "a number"),
        ("u32", whole(32, "a whole number below 2^32")),
        ("u64", whole(64, "a whole number below 2^64")),
        ("usize", whole(64, "a whole number below 2^64")),
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

#[cfg(test)]
mod tests {
    use super::{parse_json, parse_toml};

    /// A message says what is wrong in the words of a scene file, not of a parser.
    #[test]
    fn messages_have_no_words_of_parsers() {
        let toml = |text: &str| parse_toml(text).unwrap_err();
        let json = |text: &str| parse_json(text).unwrap_err();
        for (message, expected) in [
            (
                toml("springs.pairs = [[0, 99999999999999999999]]"),
                "springs.pairs[0][1]: is 99999999999999999999, must be a whole number below 2^32 at line 1 column 22",
            ),
            (
                json("{\"springs\": {\"pairs\": [[0, 4294967296]]}}"),
                "springs.pairs[0][1]: is 4294967296, must be a whole number below 2^32 at line 1 column 37",
            ),
            (toml("gravity = 1\n'gravity' = 2"), "given twice: gravity at line 2 column 1"),
            (toml("[time]\ndt = 1\n[time]\nduration = 1"), "given twice: time at line 3 column 2"),
            (
                toml("particles.masses = 123456789012345678901234567890"),
                "particles.masses: is 123456789012345678901234567890, must be a number or a list of numbers at line 1 column 20",
            ),
            (toml("gravity = 1979-05-27"), "gravity: is a date or a time, which no key takes at line 1 column 11"),
            (json("{"), "the text ends in a table at line 1 column 1"),
            (json("{\"springs\": {\"pairs\": [[0"), "springs.pairs[0]: the text ends in a list at line 1 column 25"),
            (
                json("{\"particles\": {\"masses\": null}}"),
                "particles.masses: is null, must be a number or a list of numbers at line 1 column 29",
            ),
            (json("{\"particles\": {\"masses\": 1.5e3x"), "particles: expected `,` or `}` at line 1 column 31"),
        ] {
            assert_eq!(message, expected);
        }
        for key in ["name", "particles", "particles.masses", "particles.positions", "springs.pairs", "time.dt"] {
            let message = toml(&format!("{key} = 1979-05-27"));
            assert!(
                message.starts_with(&format!("{key}: is a date or a time, ")) && !message.contains("private"),
                "{message}"
            );
        }
    }
}
