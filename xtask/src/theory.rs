//! The theory chapters of the guide: LaTeX formulas become MathML, and tests hold each chapter to what it must have.

use anyhow::{Context, Result, anyhow};
use pulldown_cmark::{Event, Options, Parser};
use pulldown_latex::config::{DisplayMode, RenderConfig};
use pulldown_latex::{Storage, push_mathml};
use std::fs;
use std::path::{Path, PathBuf};

/// The files of the chapters, in a folder that holds a guide.
pub fn chapters(guide: &Path) -> Result<Vec<PathBuf>> {
    let folder = guide.join("src/theory");
    let entries = fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
    let mut files = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<PathBuf>>>()?;
    files.retain(|file| file.extension().is_some_and(|extension| extension == "md"));
    files.sort();
    Ok(files)
}

/// The page with its formulas, `$…$` and `$$…$$`, as MathML. Code keeps its dollars.
pub fn typeset(page: &str) -> Result<String> {
    let (mut text, mut end) = (String::with_capacity(2 * page.len()), 0);
    for (latex, display, range) in formulas(page) {
        text += &page[end..range.start];
        let after = &page[range.end..];
        let mark = after.len() - after.trim_start_matches([',', '.', ';', ':', ')']).len();
        let formula = mathml(&latex, display)?;
        // No line begins with the mark after a formula.
        text += &if mark > 0 { format!("<span class=\"formula\">{formula}{}</span>", &after[..mark]) } else { formula };
        end = range.end + mark;
    }
    Ok(text + &page[end..])
}

fn formulas(page: &str) -> impl Iterator<Item = (String, DisplayMode, std::ops::Range<usize>)> {
    let events = Parser::new_ext(page, Options::ENABLE_MATH | Options::ENABLE_TABLES).into_offset_iter();
    events.filter_map(|(event, range)| match event {
        Event::InlineMath(latex) => Some((latex.into_string(), DisplayMode::Inline, range)),
        Event::DisplayMath(latex) => Some((latex.into_string(), DisplayMode::Block, range)),
        _ => None,
    })
}

fn mathml(latex: &str, display_mode: DisplayMode) -> Result<String> {
    let storage = Storage::new();
    let events: Result<Vec<_>, _> = pulldown_latex::Parser::new(latex, &storage).collect();
    let events = events.map_err(|error| anyhow!("the formula {latex:?}: {error}"))?;
    let mut mathml = String::new();
    let config = RenderConfig { display_mode, ..RenderConfig::default() };
    push_mathml(&mut mathml, events.into_iter().map(Ok::<_, std::fmt::Error>), config)?;
    Ok(hidden_from_markdown(&mathml.replace("&nbsp;", "\u{a0}")))
}

/// Markup on one line, whose text Markdown cannot take for its own: no `*`, `|` or `'` between tags.
fn hidden_from_markdown(markup: &str) -> String {
    let (mut hidden, mut in_tag, mut in_entity) = (String::with_capacity(markup.len()), false, false);
    for c in markup.chars() {
        match c {
            '<' => in_tag = true,
            '>' => in_tag = false,
            '&' => in_entity = true,
            ';' if in_entity => {
                in_entity = false;
                hidden.push(c);
                continue;
            }
            _ => {}
        }
        match c {
            '\n' => hidden.push(' '),
            _ if in_tag || in_entity || !c.is_ascii_punctuation() || c == '>' => hidden.push(c),
            _ => hidden += &format!("&#{};", u32::from(c)),
        }
    }
    hidden
}

#[cfg(test)]
mod tests {
    use super::{chapters, formulas, typeset};
    use regex::Regex;
    use std::fs;
    use std::path::{Path, PathBuf};

    fn all() -> Vec<(PathBuf, String)> {
        let guide = crate::root().unwrap().join("docs/guide");
        chapters(&guide).unwrap().into_iter().map(|file| (file.clone(), fs::read_to_string(file).unwrap())).collect()
    }

    /// All texts that a pattern finds, by its first group.
    fn found<'t>(pattern: &str, text: &'t str) -> Vec<regex::Captures<'t>> {
        Regex::new(pattern).unwrap().captures_iter(text).collect()
    }

    #[test]
    fn formulas_become_one_line_of_mathml() {
        let page = "Let $a_i^* = \\frac{1}{2}$, hold.\n\n$$\nf'(x) = |x|\n$$\n\nKeep `$x$`.\n";
        let typeset = typeset(page).unwrap();
        assert!(typeset.starts_with("Let <span class=\"formula\"><math"), "{typeset}");
        assert!(typeset.contains("</math>,</span> hold."), "{typeset}");
        assert!(typeset.contains("<mfrac>") && typeset.contains("display=\"block\""), "{typeset}");
        assert!(typeset.ends_with("\n\nKeep `$x$`.\n"), "{typeset}");
        assert_eq!(typeset.lines().count(), 5);
        let text = Regex::new("<[^>]*>").unwrap().replace_all(&typeset, "");
        assert!(!text.contains(['*', '|', '\'', '$']) || text.matches('$').count() == 2, "{text}");
    }

    #[test]
    fn a_formula_that_does_not_parse_is_an_error() {
        for wrong in ["$\\frac{1}$", "$\\nosuchcommand x$", "$$\\begin{aligned} a$$"] {
            assert!(typeset(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn all_formulas_parse() {
        for (file, text) in all() {
            typeset(&text).unwrap_or_else(|error| panic!("{}: {error:#}", file.display()));
        }
    }

    #[test]
    fn every_chapter_is_in_the_summary_and_every_picture_in_a_chapter() {
        let root = crate::root().unwrap();
        let summary = fs::read_to_string(root.join("docs/guide/src/SUMMARY.md")).unwrap();
        let chapters = all();
        assert!(chapters.len() >= 11);
        for (file, text) in &chapters {
            let name = file.file_name().unwrap().to_str().unwrap();
            assert!(summary.contains(&format!("(theory/{name})")), "{name} is not in SUMMARY.md");
            let pictures = found(r"!\[[^\]]+\]\(([\w-]+\.svg)\)", text);
            assert!(!pictures.is_empty(), "{name} has no picture with a description");
            assert!(formulas(text).count() > 0, "{name} has no formula");
        }
        for entry in fs::read_dir(root.join("docs/guide/src/theory")).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            if name.ends_with(".svg") {
                let used = chapters.iter().any(|(_, text)| text.contains(&format!("({name})")));
                assert!(used, "{name} is in no chapter");
            }
        }
    }

    /// A place in the code is written `` `function` in `src/file.rs` ``.
    #[test]
    fn every_chapter_names_functions_that_exist() {
        let root = crate::root().unwrap();
        for (file, text) in all() {
            let places = found(r"`([\w:]+)`\s+in\s+`((?:src|verification)/[\w/]+\.rs)`", &text);
            assert!(!places.is_empty(), "{} names no function", file.display());
            for place in places {
                let (name, path) = (&place[1], &place[2]);
                let code = fs::read_to_string(root.join(path)).unwrap_or_else(|_| panic!("{}: {path}", file.display()));
                for part in name.split("::") {
                    let defined = format!(r"(fn|struct|enum|trait|const) {part}\b|impl\b[^{{]*\b{part}\b");
                    assert!(Regex::new(&defined).unwrap().is_match(&code), "{}: {name} in {path}", file.display());
                }
            }
        }
    }

    /// A check is named by its claim and its family, `` `claim::family` ``, as the suite's tests are.
    #[test]
    fn every_chapter_names_checks_that_exist() {
        let root = crate::root().unwrap();
        let families = fs::read_to_string(root.join("src/verify/suite.rs")).unwrap();
        let claims: Vec<String> = found(r#"Claim::(\w+),\s+"(\w+)""#, &families)
            .iter()
            .map(|family| format!("{}::{}", family[1].to_lowercase(), &family[2]))
            .collect();
        assert!(claims.len() >= 20, "{claims:?}");
        for (file, text) in all() {
            let named = found(r"`([a-z]+::[a-z_]+)`", &text);
            assert!(!named.is_empty(), "{} names no check", file.display());
            for check in named {
                let name = check[1].to_owned();
                assert!(claims.contains(&name), "{}: no check {name}", file.display());
            }
        }
    }

    /// Files of the repository that commands in a chapter use.
    #[test]
    fn files_in_commands_exist() {
        let root = crate::root().unwrap();
        for (file, text) in all() {
            for path in found(r"(?m)^sprung .*?\s((?:docs|src|verification)/[\w/]+\.toml)", &text) {
                assert!(Path::new(&root).join(&path[1]).exists(), "{}: {}", file.display(), &path[1]);
            }
        }
    }
}
