//! Theory pages of the guide, made of the headers of modules: a derivation is written once, beside the code that it is of.

use anyhow::{Context, Result, ensure};
use regex::Regex;
use serde::Deserialize;
use std::fs;
use std::path::Path;

/// A page of the guide.
pub struct Page {
    /// Its file name.
    pub file: String,
    /// Its text, in Markdown.
    pub text: String,
}

#[derive(Deserialize)]
pub struct Contents {
    page: Vec<Entry>,
    /// Pages that stand elsewhere in the repository.
    pub taken: Vec<Taken>,
}

/// A page of the repository that the guide shows too.
#[derive(Deserialize)]
pub struct Taken {
    /// Where in the guide.
    pub file: String,
    /// Where it stands.
    pub source: String,
}

/// A page as `docs/guide/theory.toml` describes it.
#[derive(Deserialize)]
struct Entry {
    file: String,
    title: String,
    intro: String,
    sources: Vec<String>,
}

/// What the guide takes from elsewhere.
pub fn contents(root: &Path) -> Result<Contents> {
    let file = root.join("docs/guide/theory.toml");
    let text = fs::read_to_string(&file).with_context(|| file.display().to_string())?;
    toml::from_str(&text).with_context(|| file.display().to_string())
}

impl Contents {
    /// All theory pages.
    pub fn pages(self, root: &Path) -> Result<Vec<Page>> {
        self.page.into_iter().map(|entry| page(root, entry)).collect()
    }
}

fn page(root: &Path, entry: Entry) -> Result<Page> {
    let Entry { file, title, intro, sources } = entry;
    let mut text = format!("# {title}\n\n{}\n", intro.trim());
    for source in sources {
        let path = root.join(&source);
        let code = fs::read_to_string(&path).with_context(|| source.clone())?;
        let header = header(&code)?;
        ensure!(!header.trim().is_empty(), "{source} has no header");
        let (first, rest) = header.split_once("\n\n").unwrap_or((header.trim_end(), ""));
        let heading = first.replace('\n', " ");
        text += &format!(
            "\n## {}\n\n{}\n\n<small>The header of `{source}`.</small>\n",
            heading.trim_end_matches('.'),
            rest.trim()
        );
    }
    Ok(Page { file, text })
}

/// The documentation at the top of a module, links to items of the code as plain names.
fn header(code: &str) -> Result<String> {
    let lines = code.lines().map_while(|line| line.strip_prefix("//!"));
    let text: String = lines.map(|line| format!("{}\n", line.strip_prefix(' ').unwrap_or(line))).collect();
    // [`Name`](path::to::item) and [text](path::to::item): what is no file and no address is an item.
    let linked = Regex::new(r"\[([^\]]+)\]\(([^)\s]+)\)")?;
    let text = linked.replace_all(&text, |found: &regex::Captures<'_>| {
        let (name, target) = (&found[1], &found[2]);
        if target.starts_with("http") || target.contains(".md") { found[0].to_owned() } else { name.to_owned() }
    });
    Ok(Regex::new(r"\[(`[^`\]]+`)\]")?.replace_all(&text, "$1").into_owned())
}

#[cfg(test)]
mod tests {
    use super::{contents, header};
    use std::collections::BTreeSet;
    use std::fs;
    use std::path::{Path, PathBuf};

    fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                collect(&path, files);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }

    /// A header with a formula is on a page, once, and so reaches its reader.
    #[test]
    fn every_derivation_is_on_a_page() {
        let root = crate::root().unwrap();
        let contents = contents(&root).unwrap();
        let listed: Vec<PathBuf> = contents.page.iter().flat_map(|page| &page.sources).map(PathBuf::from).collect();
        let known: BTreeSet<&Path> = listed.iter().map(PathBuf::as_path).collect();
        assert_eq!(known.len(), listed.len(), "a header stands twice in theory.toml");
        let mut files = Vec::new();
        collect(&root.join("src"), &mut files);
        for file in files {
            let code = fs::read_to_string(&file).unwrap();
            let file = file.strip_prefix(&root).unwrap();
            if code.lines().take_while(|line| line.starts_with("//!")).any(|line| line.contains("```text")) {
                assert!(
                    known.contains(file),
                    "{} has a formula and is on no page: docs/guide/theory.toml",
                    file.display()
                );
            }
        }
    }

    /// Who reads the documentation of a module is told which pages have its theory.
    #[test]
    fn modules_name_their_pages() {
        let root = crate::root().unwrap();
        for page in contents(&root).unwrap().page {
            let module = Path::new(&page.sources[0]).iter().nth(1).unwrap();
            let folder = root.join("src").join(module);
            let file = if folder.is_dir() { folder.join("mod.rs") } else { folder };
            let name = format!("`{}`", page.file.trim_end_matches(".md"));
            let code = fs::read_to_string(&file).unwrap();
            let header: Vec<&str> = code.lines().take_while(|line| line.starts_with("//!")).collect();
            assert!(header.iter().any(|line| line.contains(&name)), "{} does not name {name}", file.display());
        }
    }

    #[test]
    fn headers_lose_their_marks_and_links_to_items() {
        let code =
            "//! Of [`A`], [`b`](super::b), [one](crate::c) and [a page](x.md).\n//!\n//!     code\n\n//! not this\n";
        assert_eq!(header(code).unwrap(), "Of `A`, `b`, one and [a page](x.md).\n\n    code\n");
    }
}
