//! Relative links and anchors of pages.

use anyhow::{Context, Result, bail};
use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Folders that are not searched.
const SKIPPED: [&str; 5] = ["target", ".git", "out", "node_modules", "corpus"];

/// Checks all pages of the repository except the guide, which [`check_folder`] checks when it is built.
pub fn check(root: &Path) -> Result<()> {
    let pages = pages(root)?.into_iter().filter(|page| !page.starts_with(root.join("docs/guide"))).collect();
    check_pages(root, pages)
}

/// Checks the pages in a folder.
pub fn check_folder(folder: &Path) -> Result<()> {
    check_pages(folder, pages(folder)?)
}

fn check_pages(root: &Path, pages: Vec<PathBuf>) -> Result<()> {
    let mut broken = Vec::new();
    for page in &pages {
        let text = fs::read_to_string(page).with_context(|| page.display().to_string())?;
        for link in links(&text) {
            if let Some(why) = broken_link(page, &text, &link)? {
                broken.push(format!("{}: {link}: {why}", page.strip_prefix(root).unwrap_or(page).display()));
            }
        }
    }
    if broken.is_empty() {
        println!("{} pages, no broken links", pages.len());
        return Ok(());
    }
    bail!("broken links:\n{}", broken.join("\n"))
}

fn pages(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if path.is_dir() && !SKIPPED.contains(&name) {
            found.extend(pages(&path)?);
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn links(text: &str) -> Vec<String> {
    let parser = Parser::new_ext(text, Options::ENABLE_TABLES);
    let targets = parser.filter_map(|event| match event {
        Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => Some(dest_url.into_string()),
        _ => None,
    });
    targets.filter(|link| !link.contains("://") && !link.starts_with("mailto:")).collect()
}

/// The reason why a link is broken.
fn broken_link(page: &Path, text: &str, link: &str) -> Result<Option<String>> {
    let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
    let target = match page.parent() {
        Some(folder) if !path.is_empty() => folder.join(path),
        _ => page.to_path_buf(),
    };
    if !target.exists() {
        return Ok(Some("no such file".into()));
    }
    if anchor.is_empty() || target.extension().is_none_or(|extension| extension != "md") {
        return Ok(None);
    }
    let text = if target == page { text.to_owned() } else { fs::read_to_string(&target)? };
    Ok((!anchors(&text).contains(anchor)).then(|| "no such heading".into()))
}

/// The anchors of the headings of a page: lower case, words joined by hyphens.
fn anchors(text: &str) -> BTreeSet<String> {
    let (mut anchors, mut heading) = (BTreeSet::new(), None);
    for event in Parser::new(text) {
        match (event, &mut heading) {
            (Event::Start(Tag::Heading { .. }), _) => heading = Some(String::new()),
            (Event::Text(part) | Event::Code(part), Some(heading)) => heading.push_str(&part),
            (Event::End(TagEnd::Heading(_)), Some(text)) => {
                let words = text.to_lowercase();
                let kept = words.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
                anchors.insert(kept.map(|c| if c == ' ' { '-' } else { c }).collect());
                heading = None;
            }
            _ => {}
        }
    }
    anchors
}

#[cfg(test)]
mod tests {
    use super::{anchors, links};

    #[test]
    fn relative_links_and_pictures_are_found() {
        assert_eq!(links("[a](b.md#c) ![p](q.svg) [w](https://x.y) [h](#i)"), ["b.md#c", "q.svg", "#i"]);
    }

    #[test]
    fn anchors_are_headings_in_lower_case_with_hyphens() {
        let found = anchors("# What `A` is\n\n## K, G and M\n");
        assert_eq!(found.into_iter().collect::<Vec<_>>(), ["k-g-and-m", "what-a-is"]);
    }
}
