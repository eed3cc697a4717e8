//! From text to a [`Scene`], with errors that say where in the text.

use super::read::{check_name, table};
use super::words::plain;
use super::{Scene, npz};
use crate::error::{Error, Invalid, Result};
use crate::memory;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::path::Path;

/// Bytes that reading holds at most for a byte of a file: of JSON the text and the numbers, of TOML a tree too. Found by lowering
/// the limit on memory until reading failed.
const JSON: u64 = 8;
const TOML: u64 = 60;

impl Scene {
    /// Reads a scene file, TOML, JSON or NumPy arrays (`.npz`, see [`write_npz`](Self::write_npz)) by its extension. Without a name in the file the scene has the file's stem.
    ///
    /// JSON is read as it comes; TOML is first held as a tree, which takes ten times the time and memory. That
    /// matters from about 10⁵ particles on. Arrays are read at the speed of the disk.
    ///
    /// # Errors
    /// [`Error::Scene`] for another extension, [`Error::Io`] for an unreadable file, [`Error::Format`] for text that is
    /// not of the format, with key and position, [`Error::Invalid`] for an unusable name or `[time]`. All
    /// other values are checked by [`build`](Self::build).
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let extension = path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
        let from_text = |parse: fn(&str) -> Result<Self, String>, share: u64| {
            let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
            memory::ensure(bytes.saturating_mul(share), "the scene file")?;
            let text = std::fs::read_to_string(path).map_err(|source| Error::io(path, source))?;
            parse(&text).map_err(|message| Error::Format { file: path.into(), message })
        };
        let scene = match extension.as_deref() {
            Some("toml") => from_text(parse_toml, TOML)?,
            Some("json") => from_text(parse_json, JSON)?,
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

    /// Reads a scene from TOML. Without a name in the text it is called `scene`.
    ///
    /// # Errors
    /// As for [`load`](Self::load), with the name of the format in place of a file's.
    pub fn from_toml(text: &str) -> Result<Self> {
        let scene = parse_toml(text).map_err(|message| Error::Format { file: "TOML".into(), message })?;
        Ok(scene.complete("scene")?)
    }

    /// Reads a scene from JSON. Without a name in the text it is called `scene`.
    ///
    /// # Errors
    /// As for [`load`](Self::load), with the name of the format in place of a file's.
    pub fn from_json(text: &str) -> Result<Self> {
        let scene = parse_json(text).map_err(|message| Error::Format { file: "JSON".into(), message })?;
        Ok(scene.complete("scene")?)
    }

    /// Reads a scene from [arrays](Self::write_npz). Without a name in its text it is called `scene`.
    ///
    /// # Errors
    /// As for [`load`](Self::load), with the name of the format in place of a file's.
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
            let column = before[start..].chars().count() + 1;
            format!("{} at line {line} column {column}", error.message())
        }
        None => error.message().to_owned(),
    };
    let deserializer = toml::Deserializer::parse(text).map_err(|error| positioned(&error))?;
    with_key(deserializer, positioned)
}

fn parse_json(text: &str) -> Result<Scene, String> {
    let text = without_byte_order_mark(text);
    // To know at every number which key it belongs to takes longer than to read it: only what does not fit is read again, to be named.
    if let Some(scene) = parse_fitting_json(text) {
        return Ok(scene);
    }
    json_table(text)
}

/// A table from JSON; what is wrong with it comes with the key, line and column.
pub(crate) fn json_table<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    let mut deserializer = serde_json::Deserializer::from_str(without_byte_order_mark(text));
    let table = with_key(&mut deserializer, serde_json::Error::to_string)?;
    deserializer.end().map_err(|error| error.to_string())?;
    Ok(table)
}

/// A scene from JSON in which there is nothing to complain of.
fn parse_fitting_json(text: &str) -> Option<Scene> {
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let scene = table(&mut deserializer).ok()?;
    deserializer.end().ok().map(|()| scene)
}

/// Deserializes, naming the key of what does not fit.
fn with_key<'de, D: serde::Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
    describe: impl Fn(&D::Error) -> String,
) -> Result<T, String> {
    let mut track = serde_path_to_error::Track::new();
    table(serde_path_to_error::Deserializer::new(deserializer, &mut track)).map_err(|error| {
        let message = plain(&with_suggestion(describe(&error)));
        let key = track.path();
        if key.iter().len() == 0 { message } else { format!("{key}: {message}") }
    })
}

/// Names the known key or value that is most like an unknown one, if any is like it. serde lists the known ones between backticks.
fn with_suggestion(message: String) -> String {
    if !message.starts_with("unknown ") {
        return message;
    }
    let mut quoted = message.split('`').skip(1).step_by(2);
    let Some(unknown) = quoted.next() else { return message };
    let alike = quoted.map(|known| (strsim::jaro_winkler(unknown, known), known));
    let nearest = alike.filter(|(likeness, _)| *likeness > ALIKE).max_by(|(a, _), (b, _)| a.total_cmp(b));
    match nearest {
        Some((_, known)) => format!("{message}; did you mean {known}?"),
        None => message,
    }
}

/// Jaro–Winkler likeness from which a word may have been meant: a letter too few, too many, wrong or in the wrong place in words of five.
const ALIKE: f64 = 0.8;

fn without_byte_order_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin::{Kind, builtin};

    /// With keys that are kept track of and without, the same is read, and the same refused.
    #[test]
    fn what_is_read_without_keeping_track_of_keys_is_what_is_read_with_it() {
        let scenes = Kind::ALL.into_iter().map(|kind| builtin(kind, 4).unwrap().to_json());
        let wrong = [
            "",
            "{",
            "{}}",
            "[]",
            "null",
            r#"{"springs": {"pairs": [[0, 1], [1, 2, 3]]}}"#,
            r#"{"springs": {"pairs": [[0, 1], [1, -2]]}}"#,
            r#"{"particles": {"positions": [[0, 1], [1, "2"]]}}"#,
            r#"{"particles": {"masses": null}}"#,
            r#"{"particles": {"mases": 1}}"#,
        ];
        let (mut read, mut refused) = (0, 0);
        for text in scenes.chain(wrong.map(str::to_owned)) {
            let mut deserializer = serde_json::Deserializer::from_str(&text);
            let tracked = with_key(&mut deserializer, serde_json::Error::to_string).ok();
            let tracked = tracked.filter(|_| deserializer.end().is_ok());
            let fitting = parse_fitting_json(&text);
            assert_eq!(fitting, tracked, "{text}");
            assert_eq!(parse_json(&text).ok(), tracked, "{text}");
            *if fitting.is_some() { &mut read } else { &mut refused } += 1;
        }
        assert_eq!((read, refused), (Kind::ALL.len(), wrong.len()));
    }
}
