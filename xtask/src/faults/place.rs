//! Source locations by function name and expression text, independent of line breaks and of moves between files.

use crate::cycles::{collect as files_below, module};
use anyhow::{Context, Result, ensure};
use proc_macro2::Span;
use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use syn::spanned::Spanned;
use syn::{Block, ImplItem, Item, Signature, TraitItem, Type};

/// Functions and constants of the source, without tests, by name.
pub struct Source {
    items: Vec<Named>,
    texts: BTreeMap<PathBuf, String>,
}

/// A function or a constant, `module::Type::function`, with its file and bytes.
struct Named {
    path: String,
    file: PathBuf,
    bytes: Range<usize>,
    /// The body of a function, in braces, unless it may be evaluated by the compiler.
    body: Option<Range<usize>>,
}

/// A range of bytes in a file.
#[derive(Debug, PartialEq)]
pub struct Place {
    pub file: PathBuf,
    pub bytes: Range<usize>,
    /// The body of the function that it is in.
    pub body: Option<Range<usize>>,
}

impl Source {
    /// Reads all files below a folder.
    pub fn read(folder: &Path) -> Result<Self> {
        let mut files = Vec::new();
        files_below(folder, &mut files)?;
        let mut source = Self { items: Vec::new(), texts: BTreeMap::new() };
        for file in files {
            let text = fs::read_to_string(&file).with_context(|| file.display().to_string())?;
            source.add(&file, module(file.strip_prefix(folder)?), text)?;
        }
        Ok(source)
    }

    fn add(&mut self, file: &Path, module: Vec<String>, text: String) -> Result<()> {
        let parsed = syn::parse_file(&text).with_context(|| file.display().to_string())?;
        collect(&parsed.items, &mut module.clone(), &mut |path, bytes, body| {
            self.items.push(Named { path, file: file.to_owned(), bytes, body });
        });
        self.texts.insert(file.to_owned(), text);
        Ok(())
    }

    /// The location of a text in the function or constant whose path ends with `name`. Whitespace and comments are ignored.
    ///
    /// # Errors
    /// No such function, several of them, or not exactly one such text in it.
    pub fn find(&self, name: &str, text: &str) -> Result<Place> {
        let is_meant =
            |path: &str| path.strip_suffix(name).is_some_and(|before| before.is_empty() || before.ends_with("::"));
        let meant: Vec<&Named> = self.items.iter().filter(|item| is_meant(&item.path)).collect();
        let paths: Vec<&str> = meant.iter().map(|item| item.path.as_str()).collect();
        ensure!(!meant.is_empty(), "there is no function {name}");
        // Several implementations of a trait share a name; the text distinguishes them.
        let mut places = Vec::new();
        for item in &meant {
            let whole = &self.texts[&item.file];
            let found = occurrences(&whole[item.bytes.clone()], text);
            places.extend(found.into_iter().map(|found| Place {
                file: item.file.clone(),
                bytes: item.bytes.start + found.start..item.bytes.start + found.end,
                body: item.body.clone(),
            }));
        }
        ensure!(places.len() == 1, "{} places like `{text}` in {}", places.len(), paths.join(", "));
        places.pop().context("a place")
    }
}

/// Reports functions and constants with their paths and bodies, without tests.
fn collect(items: &[Item], path: &mut Vec<String>, found: &mut impl FnMut(String, Range<usize>, Option<Range<usize>>)) {
    let mut hand_on = |path: &[String], name: &syn::Ident, item: Span, body: Option<Span>| {
        found([path, &[name.to_string()]].concat().join("::"), item.byte_range(), body.map(|body| body.byte_range()));
    };
    let body = |signature: &Signature, block: &Block| signature.constness.is_none().then(|| block.span());
    for item in items {
        match item {
            Item::Fn(function) => {
                hand_on(path, &function.sig.ident, function.span(), body(&function.sig, &function.block));
            }
            Item::Const(constant) => hand_on(path, &constant.ident, constant.span(), None),
            Item::Static(constant) => hand_on(path, &constant.ident, constant.span(), None),
            Item::Impl(block) => {
                path.push(type_name(&block.self_ty));
                for item in &block.items {
                    match item {
                        ImplItem::Fn(function) => {
                            hand_on(path, &function.sig.ident, function.span(), body(&function.sig, &function.block));
                        }
                        ImplItem::Const(constant) => hand_on(path, &constant.ident, constant.span(), None),
                        _ => {}
                    }
                }
                path.pop();
            }
            Item::Trait(definition) => {
                path.push(definition.ident.to_string());
                for item in &definition.items {
                    if let TraitItem::Fn(function) = item {
                        let body = function.default.as_ref().and_then(|block| body(&function.sig, block));
                        hand_on(path, &function.sig.ident, function.span(), body);
                    }
                }
                path.pop();
            }
            _ => {}
        }
    }
    for item in items {
        if let Item::Mod(module) = item
            && let Some((_, items)) = &module.content
            && module.ident != "tests"
        {
            path.push(module.ident.to_string());
            collect(items, path, found);
            path.pop();
        }
    }
}

/// The name of a type without its parameters.
fn type_name(of: &Type) -> String {
    match of {
        Type::Path(path) => path.path.segments.last().map(|segment| segment.ident.to_string()).unwrap_or_default(),
        Type::Reference(reference) => type_name(&reference.elem),
        _ => String::new(),
    }
}

/// The occurrences of a text in another, ignoring whitespace and comments.
fn occurrences(source: &str, text: &str) -> Vec<Range<usize>> {
    let (source, text) = (marks(source), marks(text));
    let is_same = |window: &&[(usize, char)]| window.iter().map(|mark| mark.1).eq(text.iter().map(|mark| mark.1));
    let range = |window: &[(usize, char)]| match window {
        [(first, _), .., (last, end)] => *first..last + end.len_utf8(),
        [(only, end)] => *only..only + end.len_utf8(),
        [] => 0..0,
    };
    source.windows(text.len().max(1)).filter(is_same).map(range).collect()
}

/// Characters outside of whitespace and comments, with their positions.
fn marks(text: &str) -> Vec<(usize, char)> {
    let mut marks = Vec::new();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let code = line.find("//").map_or(line, |comment| &line[..comment]);
        marks.extend(code.char_indices().map(|(at, c)| (start + at, c)).filter(|(_, c)| !c.is_whitespace()));
        start += line.len();
    }
    marks
}

#[cfg(test)]
mod tests {
    use super::{Place, Source};
    use crate::cycles::module;
    use std::collections::BTreeMap;
    use std::path::Path;

    const TEXT: &str = "const LIMIT: f64 = 2.0;\n\
        impl Spring<'_> {\n    fn force(&self) -> f64 {\n        // k x\n        self.k\n            * self.x // here\n    }\n}\n\
        impl Rod { fn force(&self) -> f64 { self.k * self.x } }\n\
        mod tests { fn force() { self.k * self.x } }\n";

    fn source() -> Source {
        let mut source = Source { items: Vec::new(), texts: BTreeMap::new() };
        source.add(Path::new("a/b.rs"), module(Path::new("a/b.rs")), TEXT.into()).unwrap();
        source
    }

    fn found(name: &str, text: &str) -> String {
        let Place { file, bytes, .. } = source().find(name, text).unwrap();
        assert_eq!(file, Path::new("a/b.rs"));
        TEXT[bytes].to_owned()
    }

    #[test]
    fn places_are_found_by_function_and_text() {
        assert_eq!(found("a::b::Spring::force", "self.k * self.x"), "self.k\n            * self.x");
        assert_eq!(found("Spring::force", "k*self.x"), "k\n            * self.x");
        assert_eq!(found("Rod::force", "self.k * self.x"), "self.k * self.x");
        assert_eq!(found("b::LIMIT", "2.0"), "2.0");
    }

    #[test]
    fn what_is_not_one_place_is_refused() {
        for (name, text, why) in [
            ("Bar::force", "self.k", "no function"),
            ("od::force", "self.k", "no function"),
            ("force", "self.k * self.x", "2 places"),
            ("Rod::force", "self", "3 places"),
            ("Rod::force", "self.z", "0 places"),
        ] {
            let error = source().find(name, text).unwrap_err().to_string();
            assert!(error.contains(why), "{name}: {error}");
        }
    }
}
