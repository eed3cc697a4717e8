//! Cyclic dependencies between files.
//!
//! A path in the code, `crate::a::b::Name` or `super::Name`, is resolved through re-exports (`pub use`) to the file that defines the name. A module
//! and its submodules (`a.rs` and `a/b.rs`) may use each other, so dependencies between them are ignored.

use anyhow::{Context, Result};
use regex::Regex;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Names of modules from the crate's root on.
type Module = Vec<String>;

/// The dependencies and re-exports of a file.
#[derive(Default)]
struct File {
    /// Used paths, from the root.
    uses: BTreeSet<Module>,
    /// Re-exported names and their paths.
    reexports: BTreeMap<String, Module>,
}

/// Groups of files that depend on each other cyclically.
pub fn find(source: &Path) -> Result<Vec<Vec<String>>> {
    let mut files = Vec::new();
    collect(source, &mut files)?;
    let mut modules = BTreeMap::new();
    for path in files {
        let code = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let module = module(path.strip_prefix(source)?);
        modules.insert(module.clone(), read(&module, &code)?);
    }
    let edges: BTreeMap<&Module, BTreeSet<&Module>> =
        modules.iter().map(|(module, file)| (module, used(&modules, module, file))).collect();
    Ok(cycles(&edges).into_iter().map(|cycle| cycle.iter().map(|module| module.join("::")).collect()).collect())
}

/// The source files in a folder, without tests.
pub fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let is_test = name.ends_with("tests.rs") || name.starts_with("fixtures");
        if path.is_dir() && !is_test {
            collect(&path, files)?;
        } else if name.ends_with(".rs") && !is_test {
            files.push(path);
        }
    }
    Ok(())
}

/// The module that a file is: `a/mod.rs` and `a.rs` are `a`.
pub fn module(file: &Path) -> Module {
    let file = file.with_extension("");
    let parts = file.iter().map(|part| part.to_string_lossy().into_owned());
    let mut parts: Module = parts.collect();
    if parts.last().is_some_and(|last| ["mod", "lib", "main"].contains(&last.as_str())) {
        parts.pop();
    }
    parts
}

fn read(module: &Module, code: &str) -> Result<File> {
    let code = code.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let code = code.split("\n#[cfg(all(test, feature = \"scene\"))]\nmod tests {").next().unwrap_or_default();
    let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    let code = lines.collect::<Vec<_>>().join("\n");
    let mut file = File::default();
    // A `use` may start with a submodule.
    let declared = Regex::new(r"(?m)^\s*(?:pub(?:\([a-z]+\))? )?mod ([a-z_0-9]+);")?;
    let parts: BTreeSet<String> = declared.captures_iter(&code).map(|found| found[1].to_owned()).collect();
    let used = Regex::new(r"(?m)^(pub(?:\([a-z]+\))? )?use ([^;]+);")?;
    for found in used.captures_iter(&code) {
        for mut path in tree(&found[2]) {
            let last = path.pop().unwrap_or_default();
            let (name, known_as) = last.split_once(" as ").unwrap_or((&last, &last));
            path.push(name.to_owned());
            let Some(from) = absolute(module, &parts, &path) else { continue };
            if found.get(1).is_some() {
                file.reexports.insert(known_as.to_owned(), from);
            } else {
                file.uses.insert(from);
            }
        }
    }
    let inline = Regex::new(r"\b((?:crate|super)(?:::[A-Za-z_0-9]+)+)")?;
    for found in inline.captures_iter(&used.replace_all(&code, "")) {
        let path: Module = found[1].split("::").map(str::to_owned).collect();
        file.uses.extend(absolute(module, &parts, &path));
    }
    Ok(file)
}

/// The paths of `a::{b, c::{d, self}}`.
fn tree(text: &str) -> Vec<Module> {
    let text = text.trim();
    let Some((before, list)) = text.split_once('{') else {
        return vec![text.split("::").map(|part| part.trim().to_owned()).collect()];
    };
    let stem: Module = before.split("::").map(str::trim).filter(|part| !part.is_empty()).map(str::to_owned).collect();
    let list = list.trim_end().strip_suffix('}').unwrap_or(list);
    let (mut depth, mut items) = (0, vec![String::new()]);
    for letter in list.chars() {
        depth += i32::from(letter == '{') - i32::from(letter == '}');
        match (letter, depth, items.last_mut()) {
            (',', 0, _) => items.push(String::new()),
            (letter, _, Some(item)) => item.push(letter),
            _ => {}
        }
    }
    let paths = items.iter().filter(|item| !item.trim().is_empty()).flat_map(|item| tree(item));
    paths.map(|path| stem.iter().cloned().chain(path.into_iter().filter(|part| part != "self")).collect()).collect()
}

/// A path of this crate from its root on.
fn absolute(module: &Module, parts: &BTreeSet<String>, path: &Module) -> Option<Module> {
    let first = path.first()?;
    let ups = path.iter().take_while(|part| *part == "super").count();
    let stem = match first.as_str() {
        "crate" => &module[..0],
        "self" => module,
        "super" => module.get(..module.len().checked_sub(ups)?)?,
        own if parts.contains(own) => module,
        _ => return None,
    };
    let rest = path.iter().filter(|part| !["crate", "self", "super"].contains(&part.as_str()));
    Some(stem.iter().chain(rest).cloned().collect())
}

/// The files that a file depends on.
fn used<'m>(modules: &'m BTreeMap<Module, File>, module: &Module, file: &File) -> BTreeSet<&'m Module> {
    let defined = file.uses.iter().filter_map(|path| definer(modules, path.clone()));
    defined.filter(|other| !other.starts_with(module) && !module.starts_with(other)).collect()
}

/// The file that defines a path, through re-exports.
fn definer(modules: &BTreeMap<Module, File>, mut path: Module) -> Option<&Module> {
    // A limit on chains of re-exports.
    for _ in 0..8 {
        let length = (0..=path.len()).rev().find(|&length| modules.contains_key(&path[..length]))?;
        let (module, file) = modules.get_key_value(&path[..length])?;
        let Some(from) = path.get(length).and_then(|name| file.reexports.get(name)) else { return Some(module) };
        path = from.iter().cloned().chain(path.drain(length + 1..)).collect();
    }
    None
}

/// Strongly connected components of more than one file, by reachability.
fn cycles<'m>(edges: &BTreeMap<&'m Module, BTreeSet<&'m Module>>) -> Vec<Vec<&'m Module>> {
    let reached = |from: &Module| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
        while let Some(next) = open.pop() {
            for other in edges.get(next).into_iter().flatten() {
                if seen.insert(*other) {
                    open.push(other);
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&Module, BTreeSet<&Module>> = edges.keys().map(|module| (*module, reached(module))).collect();
    let mut cycles: Vec<Vec<&Module>> = Vec::new();
    for (module, others) in &reached {
        if !others.contains(module) || cycles.iter().any(|cycle| cycle.contains(module)) {
            continue;
        }
        cycles.push(
            others
                .iter()
                .filter(|other| reached.get(**other).is_some_and(|back| back.contains(module)))
                .copied()
                .collect(),
        );
    }
    cycles
}

#[cfg(test)]
mod tests {
    use super::{find, tree};
    use std::fs;

    #[test]
    fn trees_of_uses_are_their_paths() {
        let paths: Vec<String> = tree("crate::{a::{B, self}, c as d}").iter().map(|path| path.join("::")).collect();
        assert_eq!(paths, ["crate::a::B", "crate::a", "crate::c as d"]);
    }

    /// A cycle of two files, one of them through a re-exported name.
    #[test]
    fn cycles_are_found_through_reexports() {
        let folder = std::env::temp_dir().join(format!("sprung-cycles-{}", std::process::id()));
        fs::create_dir_all(folder.join("m")).unwrap();
        let put = |file: &str, code: &str| fs::write(folder.join(file), code).unwrap();
        put("lib.rs", "mod m;\nmod n;\npub use m::A;\n");
        put("m/mod.rs", "mod a;\nmod b;\npub use a::A;\npub struct C;\n");
        put("m/a.rs", "use super::b::B;\npub struct A(B);\n");
        put("m/b.rs", "use super::C;\npub struct B(C);\nfn f() { crate::m::A }\n#[cfg(test)]\nmod tests {\n}\n");
        put("n.rs", "use crate::A;\n#[cfg(test)]\nmod tests {\n    use crate::n;\n}\n");
        assert_eq!(find(&folder).unwrap(), [["m::a", "m::b"]]);
        put("m/b.rs", "use super::C;\npub struct B(C);\n// crate::m::A\n");
        assert!(find(&folder).unwrap().is_empty());
        fs::remove_dir_all(folder).unwrap();
    }
}
