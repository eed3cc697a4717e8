//! Copies of repository pages for the guide, with their pictures. Links between them are adapted; other relative links become plain text.

use anyhow::{Context, Result};
use regex::{Captures, Regex};
use std::fs;
use std::path::{Component, Path, PathBuf};

/// Copies pages into the folder of the guide's sources; each has its place there and its source in the repository.
pub fn copy(root: &Path, target: &Path, pages: &[(&str, &str)]) -> Result<()> {
    let link = Regex::new(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")?;
    for &(page, source) in pages {
        let text = fs::read_to_string(root.join(source)).with_context(|| source.to_owned())?;
        let mut pictures = Vec::new();
        let text = link.replace_all(&text, |found: &Captures<'_>| {
            let (is_picture, words, to) = (&found[1] == "!", &found[2], &found[3]);
            let (path, anchor) = to.split_once('#').unwrap_or((to, ""));
            let leads_to = resolved(source, path);
            if to.contains("://") || path.is_empty() {
                found[0].to_owned()
            } else if is_picture {
                pictures.push(leads_to.clone());
                format!("![{words}]({})", name(&leads_to))
            } else if let Some((other, _)) = pages.iter().find(|(_, other)| Path::new(other) == leads_to) {
                let anchor = if anchor.is_empty() { String::new() } else { format!("#{anchor}") };
                format!("[{words}]({}{anchor})", name(Path::new(other)))
            } else {
                words.to_owned()
            }
        });
        let file = target.join(page);
        let folder = file.parent().context("a page in no folder")?;
        fs::create_dir_all(folder)?;
        fs::write(&file, text.as_bytes()).with_context(|| page.to_owned())?;
        for picture in pictures {
            fs::copy(root.join(&picture), folder.join(name(&picture)))
                .with_context(|| picture.display().to_string())?;
        }
    }
    Ok(())
}

/// The target of a link, relative to the repository.
fn resolved(page: &str, link: &str) -> PathBuf {
    let mut path = PathBuf::from(page);
    path.pop();
    for part in Path::new(link).components() {
        match part {
            Component::ParentDir => _ = path.pop(),
            Component::CurDir => {}
            part => path.push(part),
        }
    }
    path
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::{copy, resolved};
    use std::fs;
    use std::path::Path;

    #[test]
    fn links_are_seen_from_their_page() {
        assert_eq!(resolved("docs/a/b.md", "../c.md"), Path::new("docs/c.md"));
        assert_eq!(resolved("b.md", "./d/e.svg"), Path::new("d/e.svg"));
    }

    /// Links to copied pages, to pictures, to the web, to other files, and within the page.
    #[test]
    fn pages_are_copied_with_their_pictures() {
        let root = std::env::temp_dir().join(format!("sprung-copied-{}", std::process::id()));
        fs::create_dir_all(root.join("docs")).unwrap();
        let text = "[b](docs/b.md#x) ![p](docs/p.svg) [w](https://w.x) [gone](src/lib.rs) [here](#h)";
        fs::write(root.join("a.md"), text).unwrap();
        fs::write(root.join("docs/b.md"), "[a](../a.md)").unwrap();
        fs::write(root.join("docs/p.svg"), "<svg/>").unwrap();
        copy(&root, &root.join("t"), &[("r/one.md", "a.md"), ("r/two.md", "docs/b.md")]).unwrap();
        let read = |file: &str| fs::read_to_string(root.join("t/r").join(file)).unwrap();
        assert_eq!(read("one.md"), "[b](two.md#x) ![p](p.svg) [w](https://w.x) gone [here](#h)");
        assert_eq!(read("two.md"), "[a](one.md)");
        assert_eq!(read("p.svg"), "<svg/>");
        fs::remove_dir_all(root).unwrap();
    }
}
